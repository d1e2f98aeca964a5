"""Readers of the benchmarks whose truth are regions of images, not labels of tracks."""

from __future__ import annotations

import os
import re
import warnings
from pathlib import Path
from textwrap import shorten

import numpy as np
from sklearn.utils import Bunch

from .._core.geometry.tracks import unpack_tracks
from .._utils.optional import require
from .._utils.warning import warn_user
from ._moseg import read_definition, read_moseg_tracks

FBMS_SETS = ("Trainingset", "Testset")
MASK_ENDINGS = (".pgm", ".ppm", ".png")
# Of a mask, before it is read: 8K has as many.
MOST_PIXELS = 2**25


def load_fbms59(
    folder: str | os.PathLike[str],
    *,
    n_frames: int | None = 10,
    tracks: str | os.PathLike[str] | None = None,
) -> list[Bunch]:
    """Read FBMS-59: hand-held videos of people, animals and cars.

    The benchmark has images and regions, but no tracks: those come from a tracker, as a
    rule from MoSeg, its authors'.

    Parameters
    ----------
    folder : str or path-like
        Holds ``Trainingset/NAME/`` and ``Testset/NAME/`` (either will do), and each of
        those ``GroundTruth/NAMEDef.dat`` with the .pgm or .ppm masks that it names.
    n_frames : int or None, default=10
        Read the first frames only, as the paper does; None for all.
    tracks : str or path-like, optional
        Holds the tracks, as ``NAME.dat`` or ``NAME/Tracks*.dat``. By default they are
        looked for in ``Trainingset/NAME/`` and, where MoSeg writes them, in
        ``Trainingset/Results/*/NAME/`` (and so for ``Testset``). If there are several
        for a sequence, that named ``Tracks10.dat`` after ``n_frames`` is taken.

    Returns
    -------
    list of Bunch
        In the order of ``set``, then ``name``. Each has

        - ``data`` (n_tracks, 2 * n_frames): pixels, NaN where unseen;
        - ``target`` (n_tracks,): the region that a track lies on in the labelled
          frames (in most of them), -1 if it is seen in none;
        - ``track_labels`` (n_tracks,): the labels in the track file, which are what its
          writer found;
        - ``name``; ``set``: "Trainingset" or "Testset";
        - ``masks``: a region of each pixel (height, width) for each labelled frame;
          ``mask_frames``: which these are, from 0;
        - the tracks' points in the labelled frames, to score labels of tracks by:
          ``point_track``, ``point_frame``, ``point_target`` (their region) and
          ``point_weight`` (n_points,); last, for each track without such a point, one
          of frame and region -1 and weight 0, so that its group is known of; and
          ``region_sizes`` (n_regions,): pixels, weighted, of each region in all
          labelled frames.

        Weights are 1, or less near the borders of regions, where the benchmark says so
        (a .pgm beside a .ppm mask, of 255ths).

    Raises
    ------
    FileNotFoundError
        If there is no sequence, or no track file for one.
    ImportError
        If Pillow, which comes with the extra ``plot``, is missing.
    ValueError
        If a file is malformed, with its name and line, or no labelled frame is read.

    Warns
    -----
    UserWarning
        If a mask has colours that the definition does not list. They are taken as the
        first region, as the benchmark's own program takes them.

    References
    ----------
    .. [1] P. Ochs, J. Malik and T. Brox, "Segmentation of Moving Objects by Long Term
       Video Analysis", IEEE TPAMI 36(6), 2014.
       https://doi.org/10.1109/TPAMI.2013.242

    Examples
    --------
    >>> from skmotionseg.datasets import load_fbms59
    >>> load_fbms59("nowhere")
    Traceback (most recent call last):
    FileNotFoundError: no file */*/GroundTruth/*Def.dat in nowhere

    Scores of a segmentation of each sequence:

    >>> from skmotionseg import MotionSegmenter
    >>> from skmotionseg.metrics import fbms_scores
    >>> for clip in load_fbms59("FBMS59"):  # doctest: +SKIP
    ...     labels = MotionSegmenter(random_state=0).fit_predict(clip.data)
    ...     fbms_scores(
    ...         clip.point_target,
    ...         labels[clip.point_track],
    ...         sample_weight=clip.point_weight,
    ...         region_sizes=clip.region_sizes,
    ...     )
    """
    _check_n_frames(n_frames)
    sequences = [
        (part, path.parent.parent)
        for part in FBMS_SETS
        for path in sorted(Path(folder).glob(f"{part}/*/GroundTruth/*Def.dat"))
    ]
    if not sequences:
        raise FileNotFoundError(f"no file */*/GroundTruth/*Def.dat in {folder}")
    return [
        _load_sequence(
            home, _masks_of_definition(home / "GroundTruth"), n_frames, tracks, part
        )
        for part, home in sequences
    ]


def load_complex_background(
    folder: str | os.PathLike[str],
    *,
    n_frames: int | None = 10,
    tracks: str | os.PathLike[str] | None = None,
    first_number: int = 1,
) -> list[Bunch]:
    """Read the five ComplexBackground videos, with masks that tell all moving objects.

    Parameters
    ----------
    folder : str or path-like
        Holds ``NAME/GroundTruth/`` (or ``groundtruth``, or ``GT``), and each of those a
        ``NAMEDef.dat`` as of FBMS-59, or else a mask for each labelled frame: .png,
        .ppm or .pgm, a colour for a region, the last number in its name that of the
        frame (``forest_0021_gt.png``). The masks' authors describe what they mean, but
        not how their files are laid out, so that this is our convention.
    n_frames, tracks
        As of :func:`load_fbms59`; tracks lie in ``NAME/`` or ``Results/*/NAME/``.
    first_number : int, default=1
        The number, in the names of the masks, of the first frame of the video.

    Returns
    -------
    list of Bunch
        As from :func:`load_fbms59`, ``set`` being "". Regions without a definition
        are numbered by their colours, black first.

    Raises
    ------
    FileNotFoundError, ImportError, ValueError
        As from :func:`load_fbms59`.

    References
    ----------
    .. [1] M. Narayana, A. Hanson and E. Learned-Miller, "Coherent Motion Segmentation
       in Moving Camera Videos Using Optical Flow Orientations", ICCV 2013.
    .. [2] P. Bideau and E. Learned-Miller, "A Detailed Rubric for Motion Segmentation",
       2016.
       https://arxiv.org/abs/1610.10033

    Examples
    --------
    >>> from skmotionseg.datasets import load_complex_background
    >>> load_complex_background("nowhere")
    Traceback (most recent call last):
    FileNotFoundError: no masks */GroundTruth/* in nowhere
    """
    _check_n_frames(n_frames)
    truths = [
        path
        for path in sorted(Path(folder).glob("*/*"))
        if path.is_dir() and path.name.lower() in ("groundtruth", "gt")
    ]
    if not truths:
        raise FileNotFoundError(f"no masks */GroundTruth/* in {folder}")
    return [
        _load_sequence(
            truth.parent,
            _masks_of_definition(truth)
            if any(truth.glob("*Def.dat"))
            else _masks_of_names(truth, first_number),
            n_frames,
            tracks,
        )
        for truth in truths
    ]


def _check_n_frames(n_frames):
    if n_frames is not None and n_frames < 2:
        raise ValueError(f"n_frames must be 2 or more, or None for all; got {n_frames}")


# ------------------------------------------------------------------------- sequences


def _load_sequence(home, masks, n_frames, tracks, part=""):
    """One Bunch. ``masks``: scales of regions or None, and (frame, path) of each."""
    name = home.name
    path = _find_tracks(home, n_frames, tracks)
    try:
        fields = read_moseg_tracks(path, n_frames)
    except (OSError, ValueError) as error:
        raise ValueError(f"{path} is not a track file: {error}") from error
    points, seen = unpack_tracks(fields["data"])
    scales, images = masks
    # The benchmark's program counts a mask of frame 10, too, in the area that tracks of
    # the first ten frames, 0 to 9, may cover; they cannot.
    images = [(frame, image) for frame, image in images if frame < seen.shape[1]]
    if not images:
        raise ValueError(
            f"{name}: none of the first {seen.shape[1]} frames has a mask; the tracks "
            f"were read from {path}"
        )
    frames, paths = zip(*images, strict=True)
    regions, weights, n_regions = _read_regions(paths, scales)
    samples = _sample(points, seen, frames, regions, weights)
    return Bunch(
        name=name,
        set=part,
        data=fields["data"],
        track_labels=fields["track_labels"],
        target=_regions_of_tracks(samples, len(points), n_regions),
        masks=regions,
        mask_frames=np.array(frames),
        region_sizes=sum(
            np.bincount(region.ravel(), weight.ravel(), minlength=n_regions)
            for region, weight in zip(regions, weights, strict=True)
        ),
        **samples,
    )


def _find_tracks(home, n_frames, tracks):
    """The track file of the sequence whose folder is ``home``."""
    name = home.name
    if tracks is None:
        patterns = [
            (home, "*.dat"),
            (home.parent, f"Results/*/{name}/Tracks*.dat"),
        ]
    else:
        patterns = [(Path(tracks), f"{name}.dat"), (Path(tracks), f"{name}/*.dat")]
    found = [path for top, pattern in patterns for path in sorted(top.glob(pattern))]
    if len(found) > 1:
        exact = [path for path in found if path.name == f"Tracks{n_frames}.dat"]
        found = exact or found
    if len(found) != 1:
        places = " or ".join(str(top / pattern) for top, pattern in patterns)
        raise FileNotFoundError(
            f"{name} needs one track file {places}; got "
            f"{', '.join(map(str, found)) or 'none'}"
        )
    return found[0]


def _sample(points, seen, frames, regions, weights):
    """Region and weight under each track in the labelled frames.

    A point belongs to the pixel whose centre, a whole number, is nearest.
    """
    parts = []
    for frame, region, weight in zip(frames, regions, weights, strict=True):
        track = np.flatnonzero(seen[:, frame])
        pixel = np.floor(points[track, frame] + 0.5)  # (x, y)
        inside = ((pixel >= 0) & (pixel < region.shape[::-1])).all(axis=1)
        track, (column, row) = track[inside], pixel[inside].astype(int).T
        parts.append(
            (
                track,
                np.full(len(track), frame),
                region[row, column].astype(int),
                weight[row, column],
            )
        )
    elsewhere = np.setdiff1d(np.arange(len(points)), np.hstack([p[0] for p in parts]))
    nowhere = np.full(len(elsewhere), -1)
    parts.append((elsewhere, nowhere, nowhere, np.zeros(len(elsewhere))))
    names = ("point_track", "point_frame", "point_target", "point_weight")
    return {
        name: np.concatenate(part)
        for name, part in zip(names, zip(*parts, strict=True), strict=True)
    }


def _regions_of_tracks(samples, n_tracks, n_regions):
    """The region with most weight under each track; -1 under which none was seen."""
    weight = np.zeros((n_tracks, n_regions))
    place = samples["point_track"], samples["point_target"]
    np.add.at(weight, place, samples["point_weight"])  # -1 has none
    return np.where(weight.any(axis=1), weight.argmax(axis=1), -1)


# ----------------------------------------------------------------------------- masks


def _masks_of_definition(truth):
    """Scales of regions, and (frame, path) of each mask."""
    path, *others = sorted(truth.glob("*Def.dat"))
    if others:
        raise ValueError(f"{truth} needs one *Def.dat; got {len(others) + 1}")
    definition = read_definition(path)
    return definition.scales, [
        (frame, truth / name) for frame, name in definition.masks
    ]


def _masks_of_names(truth, first_number):
    """No scales, and (frame, path) of each mask, by the number in its name."""
    masks = []
    for path in sorted(truth.iterdir()):
        if path.suffix.lower() not in MASK_ENDINGS:
            continue
        numbers = re.findall(r"\d+", path.stem)
        if not numbers or int(numbers[-1]) < first_number:
            raise ValueError(
                f"{path}: a mask's name needs the number of its frame, from "
                f"{first_number} on"
            )
        masks.append((int(numbers[-1]) - first_number, path))
    if not masks:
        raise FileNotFoundError(f"no masks {', '.join(MASK_ENDINGS)} in {truth}")
    if len({frame for frame, _ in masks}) < len(masks):
        raise ValueError(f"{truth}: two masks have the same number")
    return None, sorted(masks)


def _read_regions(paths, scales):
    """Region (height, width) and weight of each pixel for each mask, and a count."""
    images = [read_mask(path) for path in paths]
    if scales is None:
        scales = np.unique(np.concatenate([np.unique(image) for image in images]))
    scales = np.asarray(scales)
    dtype = np.min_scalar_type(len(scales))
    regions = [
        _as_regions(image, scales, path).astype(dtype)
        for image, path in zip(images, paths, strict=True)
    ]
    weights = [
        _read_weights(path, region.shape)
        for path, region in zip(paths, regions, strict=True)
    ]
    return regions, weights, len(scales)


def _as_regions(image, scales, path):
    """Index of each pixel's scale."""
    order = np.argsort(scales)
    place = np.minimum(np.searchsorted(scales[order], image), len(scales) - 1)
    region = order[place]
    unknown = scales[region] != image
    if unknown.any():
        warn_user(
            f"{path}: {int(unknown.sum())} pixels have colours that the definition "
            "does not list; they are taken as its first region",
        )
        region[unknown] = 0
    return region


def _read_weights(path, shape):
    """Weights of the pixels of a .ppm mask, from the .pgm of that name, if any."""
    beside = path.with_suffix(".pgm")
    if path.suffix.lower() != ".ppm" or not beside.is_file():
        return np.ones(shape)
    weights = read_mask(beside) / 255
    if weights.shape != shape:
        raise ValueError(
            f"{beside} must be as large as its mask, {shape}; got {weights.shape}"
        )
    return weights


def read_mask(path):
    """Grey values, or 65536 red + 256 green + blue, of an image (height, width)."""
    # Pillow comes with matplotlib, and so with the extra; it reads all kinds of
    # portable maps, and .png.
    module = require("PIL.Image", extra="plot")
    if not path.is_file():
        raise FileNotFoundError(f"no mask at {path}")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", module.DecompressionBombWarning)
            with module.open(path) as image:
                size = image.width * image.height
                if size <= MOST_PIXELS:
                    return _scales_of(image)
    except (module.DecompressionBombError, module.DecompressionBombWarning) as error:
        raise ValueError(f"{path} claims to be too large an image: {error}") from error
    except Exception as error:  # whatever Pillow meets in a broken file
        raise ValueError(
            f"{path} is not an image: {shorten(str(error), 300)} (expected a whole "
            f"{', '.join(MASK_ENDINGS)})"
        ) from error
    raise ValueError(
        f"{path} claims to be too large an image: {size} pixels; expected "
        f"{MOST_PIXELS} at most"
    )


def _scales_of(image):
    if image.mode in ("1", "L"):
        return np.asarray(image.convert("L"), dtype=int)
    colours = np.asarray(image.convert("RGB"))
    scales = np.zeros(colours.shape[:2], dtype=int)
    for channel in range(3):
        scales *= 256
        scales += colours[..., channel]
    return scales
