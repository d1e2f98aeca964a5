"""Readers of benchmarks that are videos with masks, to be tracked and segmented."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
from sklearn.utils import Bunch

from ._moseg import read_definition
from ._regions import read_mask


def load_bms26(folder: str | os.PathLike[str]) -> list[Bunch]:
    """Find the videos of BMS-26, the first 26 of FBMS-59, and their region masks.

    Nothing is read but the definitions; frames and masks are, when they are due.

    Parameters
    ----------
    folder : str or path-like
        Holds ``NAME/`` with the frames, ``.jpg``, and ``NAMEDef.dat`` with the masks
        that it names beside them.

    Returns
    -------
    list of Bunch
        In the order of ``name``. Each has

        - ``frames``: the folder of the frames, which
          :func:`~skmotionseg.video.track_video` takes;
        - ``mask_frames`` (n_masks,): frames, from 0, that have a mask; ``mask_paths``,
          the files; ``mask_scales``: the grey values of the regions;
        - ``mask_sizes`` (n_masks,): their bytes;
        - ``name``; ``binary``: False.

    Raises
    ------
    FileNotFoundError
        If there is no video, or a mask is missing.
    ValueError
        If a definition is malformed, with its name and line.

    References
    ----------
    T. Brox and J. Malik, "Object Segmentation by Long Term Analysis of Point
    Trajectories", ECCV 2010.

    Examples
    --------
    >>> from skmotionseg.datasets import load_bms26
    >>> load_bms26("nowhere")
    Traceback (most recent call last):
    FileNotFoundError: no file */*Def.dat in nowhere
    """
    definitions = sorted(Path(folder).glob("*/*Def.dat"))
    if not definitions:
        raise FileNotFoundError(f"no file */*Def.dat in {folder}")
    return [_bms_video(path) for path in definitions]


def _bms_video(path):
    definition = read_definition(path)
    frames, names = zip(*definition.masks, strict=True)
    return _video(
        path.parent.name,
        path.parent,
        frames,
        [path.parent / name for name in names],
        np.array(definition.scales),
        binary=False,
    )


def load_davis16(folder: str | os.PathLike[str]) -> list[Bunch]:
    """Find the videos of DAVIS 2016, and their masks of the annotated object.

    Nothing is read; frames and masks are, when they are due.

    Parameters
    ----------
    folder : str or path-like
        Holds ``JPEGImages/NAME/00000.jpg`` and ``Annotations/NAME/00000.png``, or
        these with a folder ``480p`` between.

    Returns
    -------
    list of Bunch
        As from :func:`load_bms26`, with a mask for every frame, ``mask_scales`` None
        (the object is what is not 0) and ``binary`` True.

    Raises
    ------
    FileNotFoundError
        If there is no video, or a mask is missing.

    References
    ----------
    F. Perazzi et al., "A Benchmark Dataset and Evaluation Methodology for Video Object
    Segmentation", CVPR 2016.

    Examples
    --------
    >>> from skmotionseg.datasets import load_davis16
    >>> load_davis16("nowhere")
    Traceback (most recent call last):
    FileNotFoundError: no file JPEGImages/*/*.jpg in nowhere
    """
    folder = Path(folder)
    below = "480p" if (folder / "JPEGImages" / "480p").is_dir() else ""
    images = sorted((folder / "JPEGImages" / below).glob("*/*.jpg"))
    if not images:
        raise FileNotFoundError(f"no file JPEGImages/*/*.jpg in {folder}")
    videos = []
    for home in sorted({image.parent for image in images}):
        own = [image for image in images if image.parent == home]
        masks = folder / "Annotations" / below / home.name
        paths = [masks / f"{image.stem}.png" for image in own]
        videos.append(
            _video(home.name, home, range(len(own)), paths, None, binary=True)
        )
    return videos


def _video(name, home, frames, paths, scales, *, binary):
    for path in paths:
        if not path.is_file():
            raise FileNotFoundError(f"{name}: no mask at {path}")
    return Bunch(
        name=name,
        frames=home,
        mask_frames=np.array(frames),
        mask_paths=list(paths),
        mask_scales=scales,
        mask_sizes=np.array([path.stat().st_size for path in paths]),
        binary=binary,
    )


def read_video_mask(video, number):
    """Region of each pixel (height, width) in the mask of that number."""
    image = read_mask(video.mask_paths[number])
    if video.mask_scales is None:
        return (image > 0).astype(int)
    order = np.argsort(video.mask_scales)
    place = np.searchsorted(video.mask_scales[order], image)
    place = np.minimum(place, len(order) - 1)
    region = order[place]
    # As the benchmark's program takes them: colours of no region are the first's.
    return np.where(video.mask_scales[region] == image, region, 0)
