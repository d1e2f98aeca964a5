"""Readers of the motion segmentation benchmarks, from their authors' files."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
from sklearn.utils import Bunch

from ._files import load_tracks

_LOADER_DOC = """Read {title}, one :class:`~sklearn.utils.Bunch` per sequence.

    Parameters
    ----------
    folder : str or path-like
        Holds {layout}.

    Returns
    -------
    list of Bunch
        As from :func:`load_tracks`, sorted by ``name``.

    Raises
    ------
    FileNotFoundError
        If there is no such folder, or no such file in it.

    Notes
    -----
    The data are not part of this package. {published}

    References
    ----------
    .. [1] {reference}

    Examples
    --------
    >>> from skmotionseg.datasets import {name}
    >>> {name}("nowhere")
    Traceback (most recent call last):
    FileNotFoundError: no folder nowhere
    """


def _read_folder(folder, pattern, suffix, n_frames=None):
    if not Path(folder).is_dir():
        raise FileNotFoundError(f"no folder {folder}")
    paths = sorted(Path(folder).glob(pattern))
    if not paths:
        raise FileNotFoundError(f"no file {pattern} in {folder}")
    sequences = [load_tracks(path) for path in paths]
    for sequence in sequences:
        found = sequence.data.shape[1] // 2
        if n_frames not in (None, found):
            raise ValueError(
                f"{sequence.name} has {found} frames, where {n_frames} are expected: "
                "it is of another benchmark"
            )
        sequence.name = sequence.name.removesuffix(suffix)
        if sequence.target is not None:
            sequence.target = _from_zero(sequence.target)
    return sequences


def _from_zero(target):
    """Labels 0, 1, ... of the motions, whatever they were; -1 stays."""
    numbers = np.unique(target[target >= 0])
    return np.where(target >= 0, np.searchsorted(numbers, target), -1)


def _loader(
    name: str,
    title: str,
    pattern: str,
    suffix: str,
    layout: str,
    reference: str,
    published: str,
    n_frames: int | None = None,
) -> Callable[[str | os.PathLike[str]], list[Bunch]]:
    def load(folder: str | os.PathLike[str]) -> list[Bunch]:
        return _read_folder(folder, pattern, suffix, n_frames)

    load.__name__ = load.__qualname__ = name
    load.__doc__ = _LOADER_DOC.format(
        name=name,
        title=title,
        layout=layout,
        reference=reference,
        pattern=pattern,
        published=published,
    )
    return load


load_kt3dmoseg = _loader(
    "load_kt3dmoseg",
    "KT3DMoSeg: clips of a driving car, with strong perspective",
    "*_Tracks.mat",
    "_Tracks",
    "``NAME_Tracks.mat``",
    'X. Xu, L.-F. Cheong and Z. Li, "Motion Segmentation by Exploiting Complementary\n'
    '       Geometric Models", CVPR 2018.',
    "Their authors publish them at\n"
    "    https://alex-xun-xu.github.io/ProjectPage/KT3DMoSeg/index.html",
)
load_mtpv62 = _loader(
    "load_mtpv62",
    "the outdoor clips of MTPV62: gaps and some strong perspective",
    "*_Tracks.mat",
    "_Tracks",
    "``NAME_Tracks.mat``",
    'Z. Li, J. Guo, L.-F. Cheong and S. Z. Zhou, "Perspective Motion Segmentation via\n'
    '       Collaborative Clustering", ICCV 2013.',
    "Their authors publish them with\n    the paper.",
)
load_hopkins12 = _loader(
    "load_hopkins12",
    "Hopkins12: Hopkins155 scenes with incomplete tracks",
    "*_Tracks.mat",
    "_Tracks",
    "``NAME_Tracks.mat``",
    'S. Rao, R. Tron, R. Vidal and Y. Ma, "Motion Segmentation in the Presence of\n'
    '       Outlying, Incomplete, or Corrupted Trajectories", IEEE TPAMI 32(10), 2010.',
    "They are among the data at\n    http://www.vision.jhu.edu/data/",
)
load_adelaide = _loader(
    "load_adelaide",
    "AdelaideRMF: pairs of images, of which up to half and more are mismatches",
    "*.mat",
    "",
    "``NAME.mat``, each with ``data`` (6, n_tracks), homogeneous pixels of two\n"
    "        images, and ``label`` (n_tracks,), 0 for mismatches",
    'H. S. Wong, T.-J. Chin, J. Yu and D. Suter, "Dynamic and Hierarchical\n'
    '       Multi-Structure Geometric Model Fitting", ICCV 2011.\n'
    "       https://doi.org/10.1109/ICCV.2011.6126350",
    "Their authors publish them; those\n"
    "    of fundamental matrices are motions, those of homographies are planes.",
    n_frames=2,
)
load_arrigoni = _loader(
    "load_arrigoni",
    "photographs of a table, unordered, between which two things are moved",
    "*.npz",
    "",
    "``NAME.npz``, each with ``points`` (n_tracks, n_images, 2),\n"
    "        ``visibility`` (n_tracks, n_images) and ``labels`` (n_tracks,), -1 for\n"
    "        tracks that go from one thing to another; mismatches within a thing\n"
    "        have its label",
    'F. Arrigoni and T. Pajdla, "Robust Motion Segmentation from Pairwise Matches",\n'
    "       ICCV 2019.",
    "Their authors publish matches\n"
    "    of image pairs; tracks are matches that are linked over all pairs.",
)
load_hopkins155 = _loader(
    "load_hopkins155",
    "Hopkins155: checkerboards, cars and people, complete tracks",
    "*/*_truth.mat",
    "_truth",
    "``NAME/NAME_truth.mat``",
    'R. Tron and R. Vidal, "A Benchmark for the Comparison of 3-D Motion Segmentation\n'
    '       Algorithms", CVPR 2007.\n'
    "       https://doi.org/10.1109/CVPR.2007.382974",
    "Their authors publish them at\n    http://www.vision.jhu.edu/data/hopkins155/",
)
