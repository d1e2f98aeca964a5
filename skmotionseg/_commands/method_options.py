"""Options of ``skmotionseg segment`` on how files are read and motions looked for."""

from __future__ import annotations

import argparse
from typing import Any

from .._core.geometry.motion_models import MOTION_MODELS
from .._core.geometry.tracks import LAYOUTS
from .._segmenter.selection import SELECTIONS
from .._segmenter.views import DEFAULT_MODELS
from .console import count, jobs, positive, seed, threshold

MOST_MOTIONS = 10  # that are tried by default


def number_of_motions(text):
    """A whole number of motions, or "auto"."""
    return text if text == "auto" else count(text, or_else=', or "auto"')


def model_names(text):
    """Names of motion models with commas between them, as a tuple."""
    names = tuple(name.strip() for name in text.split(","))
    unknown = [name for name in names if name not in MOTION_MODELS]
    if unknown:
        raise argparse.ArgumentTypeError(
            f"expected some of {','.join(MOTION_MODELS)}; got {unknown[0]!r}"
        )
    return names


METHOD_OPTIONS: dict[str, dict[str, Any]] = {
    "--motions": {
        "type": number_of_motions,
        "default": "auto",
        "help": "number of motions, or auto (default: auto)",
    },
    "--min-motions": {
        "type": count,
        "metavar": "N",
        "help": "smallest number of motions to try with --motions auto (default: 1)",
    },
    "--max-motions": {
        "type": count,
        "metavar": "N",
        "help": "largest number of motions to try with --motions auto (default: "
        f"{MOST_MOTIONS})",
    },
    "--models": {
        "type": model_names,
        "default": DEFAULT_MODELS,
        "metavar": "NAMES",
        "help": "motion models to combine, with commas between them (default: "
        f"{','.join(DEFAULT_MODELS)})",
    },
    "--selection": {
        "choices": SELECTIONS,
        "default": SELECTIONS[0],
        "help": "rule that chooses the number of motions (default: "
        "description_length; ncre is the paper's)",
    },
    "--focal-length": {
        "type": positive,
        "metavar": "PIXELS",
        "help": "focal length of the camera, if it is known (default: estimated)",
    },
    "--seed": {"type": seed, "default": 0, "help": "random seed (default: 0)"},
    "--jobs": {
        "type": jobs,
        "default": -1,
        "help": "parallel jobs; -1 is all processors (default: -1)",
    },
}
FILE_OPTIONS: dict[str, dict[str, Any]] = {
    "--layout": {
        "choices": LAYOUTS,
        "help": "order of the axes in a .npz or .npy file, if it is not clear from the "
        "names of the arrays",
    },
    "--visible-above": {
        "type": threshold,
        "metavar": "P",
        "help": "if the visibility in a .npz file is a probability: points above this "
        "threshold count as seen",
    },
    "--image-size": {
        "type": count,
        "nargs": 2,
        "metavar": ("WIDTH", "HEIGHT"),
        "help": "size of the image, if the coordinates in a .npz, .npy or .csv file "
        "were divided by it",
    },
}


def add_method_options(segment):
    """Add the options to a parser.

    Parameters
    ----------
    segment : argparse.ArgumentParser
    """
    for name, options in METHOD_OPTIONS.items():
        segment.add_argument(name, **options)
    files = segment.add_argument_group("track files")
    for name, options in FILE_OPTIONS.items():
        files.add_argument(name, **options)


def check_method_options(arguments, video):
    """Refuse options that do not go together, before any work.

    Parameters
    ----------
    arguments : argparse.Namespace
    video : bool
        Whether the input is a video or a folder of frames.

    Raises
    ------
    ValueError
    """
    counts = [n for n in ("min_motions", "max_motions") if getattr(arguments, n)]
    if counts and arguments.motions != "auto":
        raise ValueError(
            f"{option_name(counts[0])} is for --motions auto; got --motions "
            f"{arguments.motions}"
        )
    fewest, most = arguments.min_motions or 1, arguments.max_motions or MOST_MOTIONS
    if fewest > most:
        raise ValueError(
            f"--min-motions must not exceed --max-motions; got {fewest} and {most}"
        )
    if video:
        check_no_file_options(arguments)


def check_no_file_options(arguments):
    """Refuse options on how track files are read, where a video is."""
    options = file_options(arguments)
    given = [name for name in options if options[name] is not None]
    if given:
        raise ValueError(
            f"{option_name(given[0])} is for track files; {arguments.file} is a video "
            "or a folder"
        )


def file_options(arguments):
    """Arguments of :func:`~skmotionseg.datasets.load_tracks`."""
    size = arguments.image_size
    return {
        "layout": arguments.layout,
        "image_size": None if size is None else tuple(size),
        "visible_above": arguments.visible_above,
    }


def method_parameters(arguments):
    """Parameters of :class:`~skmotionseg.MotionSegmenter`."""
    counts = {
        name: value
        for name in ("min_motions", "max_motions")
        if (value := getattr(arguments, name)) is not None
    }
    return {
        "n_motions": arguments.motions,
        "models": arguments.models,
        "selection": arguments.selection,
        "focal_length": arguments.focal_length,
        "n_jobs": arguments.jobs,
        "random_state": arguments.seed,
        **counts,
    }


def option_name(name):
    """What a parameter is called on the command line."""
    return f"--{name.replace('_', '-')}"
