"""How good a segmentation is, given true labels."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment


def misclassification_error(y_true, y_pred):
    """Share of tracks with the wrong motion, under the best matching of labels.

    Each true motion is matched with at most one found motion so that as many tracks as
    possible agree; all others are wrong. Tracks whose true label is negative are not
    judged; a judged track that was labelled -1 is wrong.

    Parameters
    ----------
    y_true : array-like of int, shape (n_tracks,)
    y_pred : array-like of int, shape (n_tracks,)

    Returns
    -------
    float
        Between 0 and 1.

    Raises
    ------
    ValueError
        If the lengths differ, labels are not whole numbers, or no track is judged.

    Examples
    --------
    >>> from skmotionseg.metrics import misclassification_error
    >>> misclassification_error([0, 0, 1, 1, -1], [1, 1, 0, 1, 0])
    0.25
    """
    y_true, y_pred = _judged(y_true, y_pred)
    counts = _contingency(y_true, y_pred)
    return float(1 - counts[linear_sum_assignment(-counts)].sum() / len(y_true))


def motion_count_accuracy(y_true, y_pred):
    """Share of sequences in which the number of motions is right.

    Parameters
    ----------
    y_true, y_pred : list, one entry a sequence
        Label arrays, whose negative labels are no motion, or plain counts.

    Returns
    -------
    float
        Between 0 and 1.

    Raises
    ------
    ValueError
        If the lengths differ or are zero.

    Examples
    --------
    >>> from skmotionseg.metrics import motion_count_accuracy
    >>> motion_count_accuracy([[0, 0, 1], [0, 1, 2]], [[1, 0, 0], [0, 0, 1]])
    0.5
    >>> motion_count_accuracy([2, 3], [2, 3])
    1.0
    """
    if len(y_true) != len(y_pred) or len(y_true) == 0:
        raise ValueError(
            "motion counts need as many found as true sequences, and at least one; got "
            f"{len(y_pred)} and {len(y_true)}"
        )
    return float(
        np.mean(
            [
                _n_motions(true) == _n_motions(found)
                for true, found in zip(y_true, y_pred, strict=True)
            ]
        )
    )


class FBMSScores(NamedTuple):
    """What :func:`fbms_scores` returns; all between 0 and 1."""

    density: float
    precision: float
    recall: float
    f_measure: float


def fbms_scores(y_true, y_pred):
    """Density, precision, recall and F-measure of a labelling of points.

    Found groups are matched one to one with true regions so that the sum of their
    F-measures is largest. Precision is averaged over the found groups and recall over
    the true regions; a group or region without a partner counts as 0.

    Parameters
    ----------
    y_true : array-like of int, shape (n_points,)
        True region of each annotated point (a pixel, or a track in an annotated
        frame); negative values are not annotated.
    y_pred : array-like of int, shape (n_points,)
        Group found for the point; negative values are points without a group.

    Returns
    -------
    FBMSScores
        ``density`` is the share of annotated points that have a group; the F-measure
        is the harmonic mean of precision and recall.

    Raises
    ------
    ValueError
        If the lengths differ, labels are not whole numbers, or no point is annotated.

    References
    ----------
    P. Ochs, J. Malik and T. Brox, "Segmentation of Moving Objects by Long Term Video
    Analysis", IEEE TPAMI 36(6), 2014, sec. 6.

    Examples
    --------
    >>> from skmotionseg.metrics import fbms_scores
    >>> scores = fbms_scores([0, 0, 0, 0, 1, 1, 1, 1], [0, 0, 0, 1, 1, 1, 1, -1])
    >>> scores.density, scores.precision, scores.recall
    (0.875, 0.875, 0.75)
    """
    y_true, y_pred = _judged(y_true, y_pred)
    density = float(np.mean(y_pred >= 0))
    overlap = _contingency(y_true, y_pred)  # (n_regions, n_groups)
    if overlap.shape[1] == 0:
        return FBMSScores(density, 0.0, 0.0, 0.0)
    precision = overlap / overlap.sum(axis=0)
    recall = overlap / np.bincount(np.unique(y_true, return_inverse=True)[1])[:, None]
    match = linear_sum_assignment(-_harmonic(precision, recall))
    mean_precision = float(precision[match].sum() / overlap.shape[1])
    mean_recall = float(recall[match].sum() / overlap.shape[0])
    f_measure = float(_harmonic(mean_precision, mean_recall))
    return FBMSScores(density, mean_precision, mean_recall, f_measure)


def _harmonic(a, b):
    total = np.asarray(a + b, dtype=float)
    return np.divide(2 * a * b, total, out=np.zeros_like(total), where=total > 0)


def _judged(y_true, y_pred):
    """Check two labellings and keep the points whose true label is not negative."""
    y_true, y_pred = _as_labels(y_true, "y_true"), _as_labels(y_pred, "y_pred")
    if len(y_true) != len(y_pred):
        raise ValueError(
            f"y_true and y_pred need one label a track; got {len(y_true)} and "
            f"{len(y_pred)}"
        )
    judged = y_true >= 0
    if not judged.any():
        raise ValueError(
            f"none of the {len(y_true)} tracks has a true label of 0 or above to judge"
        )
    return y_true[judged], y_pred[judged]


def _as_labels(labels, name):
    labels = np.asarray(labels)
    if labels.ndim != 1 or labels.dtype.kind not in "iufb":
        raise ValueError(
            f"{name} must be a list of whole numbers; got shape {labels.shape} and "
            f"dtype {labels.dtype}"
        )
    if not np.array_equal(labels, np.round(labels)):  # NaN equals nothing
        raise ValueError(f"{name} must be whole numbers; got dtype {labels.dtype}")
    return labels.astype(np.int64)


def _contingency(y_true, y_pred):
    """Tracks a true and found motion share; -1 found is no motion."""
    _, true = np.unique(y_true, return_inverse=True)
    found_labels, found = np.unique(y_pred, return_inverse=True)
    counts = np.zeros((true.max() + 1, len(found_labels)))
    np.add.at(counts, (true, found), 1)
    return counts[:, found_labels >= 0]


def _n_motions(labels):
    labels = np.asarray(labels)
    return int(labels) if labels.ndim == 0 else len(np.unique(labels[labels >= 0]))
