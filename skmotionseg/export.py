"""Export of labelled tracks: a mask of static points, a track file per motion."""

from __future__ import annotations

import os
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ._core.geometry.tracks import pack_tracks, unpack_tracks
from ._utils.validation import check_ids, check_label_each
from ._utils.writing import check_output, check_stale, motion_file, replacing

__all__ = ["save_motions", "static_mask"]


def static_mask(
    X: npt.ArrayLike, labels: npt.ArrayLike, *, background: int | None = None
) -> npt.NDArray[np.bool_]:
    """Mark the points of each track that belong to the static scene, per frame.

    A structure-from-motion program may use these points only.

    Parameters
    ----------
    X : array-like of shape (n_tracks, 2 * n_frames)
        Tracks in pixels; NaN where unseen.
    labels : array-like of int, shape (n_tracks,)
        Motion of each track; tracks with negative labels belong to no motion.
    background : int, optional
        Label of the static scene; by default the label of the largest motion.

    Returns
    -------
    ndarray of bool, shape (n_tracks, n_frames)
        True where a track of the static scene is seen.

    Raises
    ------
    ValueError
        If there is not one label per track, no track belongs to a motion, or none is of
        ``background``.

    Examples
    --------
    >>> import numpy as np
    >>> from skmotionseg import static_mask
    >>> X = [[0, 0, 1, 0], [5, 5, np.nan, np.nan], [9, 0, 9, 4]]
    >>> static_mask(X, [0, 0, 1])
    array([[ True,  True],
           [ True, False],
           [False, False]])
    """
    _, visibility = unpack_tracks(X)
    labels = check_label_each(labels, len(visibility))
    if background is None:
        motions, sizes = np.unique(labels[labels >= 0], return_counts=True)
        if not len(motions):
            raise ValueError("none of the tracks belongs to a motion")
        background = motions[sizes.argmax()]
    elif background not in labels[labels >= 0].tolist():
        raise ValueError(
            f"background must be the label of a motion; got {background!r}, where "
            f"there are {np.unique(labels).tolist()}"
        )
    return visibility & (labels == background)[:, None]


def save_motions(
    folder: str | os.PathLike[str],
    X: npt.ArrayLike,
    labels: npt.ArrayLike,
    *,
    track_ids: npt.ArrayLike | None = None,
) -> list[Path]:
    """Write the tracks of each motion to a file of its own.

    Parameters
    ----------
    folder : str or path-like
        Made if it is not there. Files of the same names are replaced, each at once,
        when all are written.
    X : array-like of shape (n_tracks, 2 * n_frames)
        Tracks in pixels; NaN where unseen.
    labels : array-like of int, shape (n_tracks,)
        Motion of each track; negative ones belong to none.
    track_ids : array-like of int, shape (n_tracks,), optional
        What to call the tracks; their rows in ``X`` by default. Objects and floats are
        taken where they are whole numbers, and written as integers.

    Returns
    -------
    list of Path
        ``motion_0.npz``, ``motion_1.npz``, ... by label, then ``no_motion.npz`` if
        there are such tracks. Each holds ``X`` (as many frames as given), ``labels``
        and ``track_ids``, and is read by :func:`skmotionseg.datasets.load_tracks`.

    Raises
    ------
    FileExistsError
        If the folder holds such a file of another segmentation, which would stay.
    FileNotFoundError
        If there is no folder to make it in.
    ValueError
        If there is not a label and an id per track, ids are no whole numbers or come
        twice, there are infinities, or something that is no file has the name of one.

    Examples
    --------
    >>> import tempfile
    >>> from skmotionseg import save_motions
    >>> from skmotionseg.datasets import load_tracks, make_rigid_motions
    >>> X, y = make_rigid_motions(n_tracks=70, n_frames=10, random_state=0)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     files = save_motions(folder, X, y)
    ...     [(path.name, len(load_tracks(path).data)) for path in files]
    [('motion_0.npz', 40), ('motion_1.npz', 20), ('motion_2.npz', 10)]
    """
    X = pack_tracks(unpack_tracks(X)[0], layout="tracks_first")
    labels = check_label_each(labels, len(X))
    track_ids = check_ids(range(len(X)) if track_ids is None else track_ids, len(X))
    folder = Path(folder)
    groups = {motion_file(m): labels == m for m in np.unique(labels[labels >= 0])}
    if (labels < 0).any():
        groups[motion_file(-1)] = labels < 0
    folder.mkdir(exist_ok=True)
    check_stale(folder, groups)
    for name in groups:
        check_output(folder / name)
    with ExitStack() as files:  # all are written before the first is put in its place
        for name, rows in groups.items():
            np.savez_compressed(
                files.enter_context(replacing(folder / name)),
                X=X[rows],
                labels=labels[rows],
                track_ids=track_ids[rows],
            )
    return [folder / name for name in groups]
