"""Masks and prompts that ``skmotionseg segment`` writes for a video."""

from __future__ import annotations

import json
import zlib
from pathlib import Path

import numpy as np

from .._utils.png import encode_grey, encode_labels
from .._utils.warning import warn_user
from .._utils.writing import check_output, check_output_folder, replacing
from .console import timed_stage

# Options whose outputs are of things that move, in the frames of a video.
OF_THINGS = ("masks", "static_masks", "prompts", "viewer")


def add_mask_options(videos):
    """Add the options to a group of a parser."""
    videos.add_argument(
        "--masks",
        type=Path,
        metavar="DIR",
        help="folder for a mask per frame, NAME.png, with the palette of DAVIS: 0 for "
        "the static scene, 1, 2, ... for moving objects",
    )
    videos.add_argument(
        "--static-masks",
        type=Path,
        metavar="DIR",
        help="folder for a mask per frame: 255 where the scene is static, 0 elsewhere;"
        " named after the image as COLMAP expects: NAME.jpg.png",
    )
    videos.add_argument(
        "--prompts",
        type=Path,
        metavar="FILE",
        help="points inside and outside each moving object in each frame, as prompts "
        "for a promptable segmentation model: .json",
    )

    videos.add_argument(
        "--viewer",
        type=Path,
        metavar="FILE",
        help="web page with the video, its masks and its tracks: .html",
    )


def check_mask_options(arguments, video):
    """Refuse what could not be written, before any work."""
    wanted = [option for option in OF_THINGS if getattr(arguments, option)]
    if wanted and not video:
        raise ValueError(
            f"--{wanted[0].replace('_', '-')} needs a video or a folder of frames; "
            f"{arguments.file} is neither"
        )
    for folder in (arguments.masks, arguments.static_masks):
        check_output_folder(folder)
    check_output(arguments.prompts, (".json",))
    check_output(arguments.viewer, (".html",))


def check_mask_names(arguments, frames):
    """Refuse frames whose masks would have one name, before any work."""
    if arguments.masks is None:
        return
    masks: dict[str, str] = {}
    for name in frames.names or []:
        other = masks.setdefault(_mask_name(name), name)
        if other != name:
            raise ValueError(
                f"the masks of {other} and {name} would both be {_mask_name(name)}"
            )


def write_masks(arguments, frames, sequence, objects, console):
    """Write the masks that are asked for.

    Returns
    -------
    callable or None
        Gives the masks again, one by one, to whoever draws them; None if there are
        none.
    """
    if arguments.prompts is not None:
        _write_prompts(arguments.prompts, frames, sequence, objects)
    drawn = arguments.render is not None or arguments.viewer is not None
    if not (drawn or wants_masks(arguments)):
        return None
    from ..video import dense_masks

    make_folders(arguments)
    kept = []
    with timed_stage("masks", sequence, console) as progress:
        masks = dense_masks(frames, sequence.data, objects, progress=progress)
        for number, mask in enumerate(masks):
            write_mask(arguments, frames.name_of(number), mask)
            if drawn:
                kept.append(zlib.compress(mask.tobytes(), 1))
    warn_of_others(arguments, map(frames.name_of, range(number + 1)))
    shape = mask.shape
    return lambda: (
        np.frombuffer(zlib.decompress(each), np.uint8).reshape(shape) for each in kept
    )


def wants_masks(arguments):
    """Whether masks are to be written to a folder."""
    return arguments.masks is not None or arguments.static_masks is not None


def make_folders(arguments):
    """Make the folders that masks are written to."""
    for folder in (arguments.masks, arguments.static_masks):
        if folder is not None:
            folder.mkdir(exist_ok=True)


def _mask_name(name):
    return f"{Path(name).stem}.png"


def write_mask(arguments, name, mask):
    """Write the mask of the frame of that name to the folders that are asked for."""
    labels, static = _paths_of(arguments, name)
    if labels is not None:
        with replacing(labels) as file:
            file.write(encode_labels(mask))
    if static is not None:
        with replacing(static) as file:
            file.write(encode_grey(np.where(mask == 0, 255, 0).astype(np.uint8)))


def _paths_of(arguments, name):
    """Where the labels of a frame and its static scene go; None if nowhere."""
    masks, static = arguments.masks, arguments.static_masks
    return masks and masks / _mask_name(name), static and static / f"{name}.png"


def warn_of_others(arguments, names):
    """Say if a folder of masks holds pictures that are not those of such frames."""
    written = {path for name in names for path in _paths_of(arguments, name)}
    for folder in (arguments.masks, arguments.static_masks):
        others = sorted(set(folder.glob("*.png")) - written) if folder else []
        if others:
            warn_user(
                f"{folder} holds {len(others)} more pictures than were written now, "
                f"such as {others[0].name}",
            )


def _write_prompts(path, frames, sequence, objects):
    from ..video import prompt_points

    prompts = prompt_points(sequence.data, objects)
    for prompt in prompts:
        prompt["image"] = frames.name_of(prompt["frame"])
    with replacing(path) as file:
        file.write(json.dumps({"prompts": prompts}, indent=1).encode())
