"""How good a segmentation is, given true labels."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from numbers import Real
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.ndimage import distance_transform_edt
from scipy.optimize import linear_sum_assignment
from sklearn.base import BaseEstimator
from sklearn.metrics import get_scorer

__all__ = [
    "FBMSObjects",
    "FBMSScores",
    "boundary_f_measure",
    "fbms_mean",
    "fbms_objects",
    "fbms_scores",
    "misclassification_error",
    "motion_count_accuracy",
    "region_similarity",
    "sequence_scorer",
]


def misclassification_error(y_true: npt.ArrayLike, y_pred: npt.ArrayLike) -> float:
    """Compute the share of misclassified tracks under the best matching of labels.

    Each true motion is matched with at most one predicted motion so that as many tracks
    as possible agree; all others are misclassified. Tracks whose true label is negative
    are ignored. Of the others, those with a predicted label of -1 are misclassified.

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
        If the lengths differ, labels are not integers, or all true labels are negative.

    Examples
    --------
    >>> from skmotionseg.metrics import misclassification_error
    >>> misclassification_error([0, 0, 1, 1, -1], [1, 1, 0, 1, 0])
    0.25
    """
    y_true, y_pred = _judged(y_true, y_pred)
    counts = _contingency(y_true, y_pred)
    return float(1 - counts[linear_sum_assignment(-counts)].sum() / len(y_true))


def motion_count_accuracy(
    y_true: Sequence[npt.ArrayLike], y_pred: Sequence[npt.ArrayLike]
) -> float:
    """Compute the share of sequences in which the number of motions is correct.

    Parameters
    ----------
    y_true, y_pred : list, one entry per sequence
        Label arrays, in which negative labels do not count as motions, or counts.

    Returns
    -------
    float
        Between 0 and 1.

    Raises
    ------
    ValueError
        If the lengths differ or are zero, labels are not integers, or a count is not a
        whole number of 0 or more.

    Examples
    --------
    >>> from skmotionseg.metrics import motion_count_accuracy
    >>> motion_count_accuracy([[0, 0, 1], [0, 1, 2]], [[1, 0, 0], [0, 0, 1]])
    0.5
    >>> motion_count_accuracy([2, 3], [2, 3])
    1.0
    """
    if not (np.iterable(y_true) and np.iterable(y_pred)):
        raise ValueError(
            "motion counts need a list with an entry per sequence; got "
            f"{type(y_true).__name__} and {type(y_pred).__name__}"
        )
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


def sequence_scorer(scoring: str | Callable) -> Callable:
    """Make a scorer for sequences from a scorer for the tracks of a sequence.

    Samples of :class:`~skmotionseg.PerSequence` are sequences, so their labels are
    lists of arrays, which scorers of scikit-learn do not accept. This scorer returns
    the mean score over the sequences. Tracks whose true label is negative are ignored.

    Parameters
    ----------
    scoring : str or callable
        Name of a scorer of scikit-learn, such as "adjusted_rand_score", or a function
        ``(y_true, y_pred) -> float`` of label arrays, of which more is better.

    Returns
    -------
    callable
        ``(estimator, X, y) -> float``, for ``scoring=`` of
        :class:`~sklearn.model_selection.GridSearchCV` and
        ``cross_val_score``.

    Raises
    ------
    TypeError, ValueError
        If it is neither, there is no scorer of that name, or the one of that name
        depends on the numbers of the labels, as "accuracy" does; that is not tried of a
        function. If a function gives no number for the labels of a few tracks, or less
        for all correct ones than for wrong ones, as an error does; or if it is
        :func:`motion_count_accuracy`, which takes all sequences at once.

    Examples
    --------
    >>> from sklearn.model_selection import cross_val_score
    >>> from skmotionseg import MotionSegmenter, PerSequence
    >>> from skmotionseg.datasets import make_rigid_motions
    >>> from skmotionseg.metrics import sequence_scorer
    >>> scenes = [
    ...     make_rigid_motions(n_tracks=60, n_frames=4, n_motions=2, random_state=seed)
    ...     for seed in range(2)
    ... ]
    >>> sequences, labels = [X for X, y in scenes], [y for X, y in scenes]
    >>> estimator = PerSequence(MotionSegmenter(2, n_hypotheses=50, random_state=0))
    >>> cross_val_score(
    ...     estimator,
    ...     sequences,
    ...     labels,
    ...     scoring=sequence_scorer("adjusted_rand_score"),
    ...     cv=2,
    ... ).shape
    (2,)
    """
    _check_scoring(scoring)
    return partial(_score_sequences, scoring)


def _check_scoring(scoring):
    """Refuse, before any work, what is no score of labels as a partition."""
    if hasattr(scoring, "_score_func") or not (
        isinstance(scoring, str) or callable(scoring)
    ):
        raise TypeError(
            "sequence_scorer takes the name of a scorer, or a function of true and "
            f"found labels; got {scoring!r}"
        )
    true = np.arange(20) % 2
    if not isinstance(scoring, str):
        _check_score(scoring, true)
        return
    get_scorer(scoring)  # raises if there is none
    try:
        same, swapped = (_score_by_name(scoring, true, y) for y in (true, 1 - true))
    except Exception as error:
        raise ValueError(f"{scoring!r} is no scorer of labels: {error}") from error
    if same != swapped:
        raise ValueError(
            f"{scoring!r} depends on the numbers of the labels, which are arbitrary: "
            "take one of partitions, such as 'adjusted_rand_score', or the score of "
            "PerSequence itself"
        )


def _check_score(function, true):
    """Refuse a function that is no score of one sequence, where more is better."""
    if function is motion_count_accuracy:
        raise ValueError(
            "motion_count_accuracy takes the labels of all sequences at once: give "
            "make_scorer(motion_count_accuracy) instead of a sequence_scorer"
        )
    try:
        right, wrong = (function(true, found) for found in (true, np.zeros_like(true)))
    except Exception:  # it may need other labels than these
        return
    if np.ndim(right) > 0:
        raise TypeError(
            f"a score must be a number; got {type(right).__name__} from {function!r}"
        )
    if right < wrong:
        raise ValueError(
            f"more must be better, but {function!r} gives {right:.3g} for correct "
            f"labels and {wrong:.3g} for wrong ones: give a function that returns its "
            "negative, or leave scoring out for 1 - misclassification_error"
        )


def _score_sequences(scoring, estimator, X, y):
    """Mean of a score over the sequences."""
    if y is None or not len(X) == len(y) > 0:
        raise ValueError(
            "each sequence needs true labels; got "
            f"{'none' if y is None else len(y)} for {len(X)} sequences"
        )
    if any(np.ndim(labels) == 0 for labels in y):
        raise ValueError(
            "sequence_scorer takes a list of labels per sequence, for PerSequence; got "
            "a number for one: to score a MotionSegmenter, pass the scoring itself"
        )
    score = _score_by_name if isinstance(scoring, str) else _score_by_function
    pairs = (
        _judged(true, found)
        for true, found in zip(y, estimator.predict(X), strict=True)
    )
    return float(np.mean([score(scoring, *pair) for pair in pairs]))


def _score_by_function(function, y_true, y_pred):
    return function(y_true, y_pred)


def _score_by_name(name, y_true, y_pred):
    return get_scorer(name)(_Found(y_pred), y_pred[:, None], y_true)


class _Found(BaseEstimator):
    """Predicts labels that were found already."""

    def __init__(self, labels):
        self.labels = labels

    def __sklearn_is_fitted__(self):
        return True

    def predict(self, X):
        return self.labels


class FBMSScores(NamedTuple):
    """What :func:`fbms_scores` returns.

    Parameters
    ----------
    density : float
        Share of the points of a region that have a group, the mean over the regions.
    precision, recall : float
        Means over the regions.
    f_measure : float
        Their harmonic mean.

    Examples
    --------
    >>> from skmotionseg.metrics import FBMSScores, fbms_mean
    >>> fbms_mean([FBMSScores(0.9, 1.0, 0.4, 0.57), FBMSScores(1.0, 0.8, 0.9, 0.85)])
    FBMSScores(density=0.95, precision=0.9, recall=0.65, f_measure=...)
    """

    density: float
    precision: float
    recall: float
    f_measure: float


class FBMSObjects(NamedTuple):
    """What :func:`fbms_objects` returns.

    Parameters
    ----------
    extracted : int
        Objects that were found.
    visible : int
        Objects that there are.

    Examples
    --------
    >>> from skmotionseg.metrics import FBMSObjects
    >>> found = FBMSObjects(extracted=3, visible=4)
    >>> found.extracted / found.visible
    0.75
    """

    extracted: int
    visible: int


def fbms_scores(
    y_true: npt.ArrayLike,
    y_pred: npt.ArrayLike,
    *,
    sample_weight: npt.ArrayLike | None = None,
    region_sizes: npt.ArrayLike | None = None,
) -> FBMSScores:
    """Density, precision, recall and F-measure of a labelling of points.

    As the program of the Freiburg-Berkeley benchmark computes them
    (``MoSegEval_PR.cpp``, MoSegEval version 2.0), with the background as a region like
    the others. With ``c_i`` the points of found group i, and ``g_j`` those of true
    region j *that have a group*,

    - ``P_ij = |c_i & g_j| / |c_i|``, ``R_ij = |c_i & g_j| / |g_j|``, and ``F_ij`` is
      their harmonic mean;
    - groups and regions are matched one to one so that the sum of ``F_ij`` is largest;
    - precision and recall are the means over the *regions* of what they are matched
      with. A region for which no group is left counts as precision 1 and recall 0; one
      whose group has no point on it, as 0 and 0. Groups for which no region is left do
      not count;
    - the F-measure is the harmonic mean of the two means.

    Parameters
    ----------
    y_true : array-like of int, shape (n_points,)
        True region of each annotated point (a pixel, or a track in an annotated
        frame); negative values are not annotated.
    y_pred : array-like of int, shape (n_points,)
        Group found for the point; negative values are points without a group. A group
        counts as one even if none of its points is annotated.
    sample_weight : array-like of shape (n_points,), optional
        What each point counts, in pixels; 1 by default. Not negative. As in the
        benchmark's program, a region of 0.0001 pixels or less in all is not visible,
        and does not count.
    region_sizes : array-like of shape (n_regions,), optional
        Annotated pixels in each region, if they are more than the points given, as they
        are of tracks: what the density is a share of, and which regions are visible.
        By default the points given, with a group or without one.

    Returns
    -------
    FBMSScores
        ``density`` is the mean over the visible regions of the share that has a group:
        all of it 1, and more if several points lie on a pixel. The others are between
        0 and 1.

    Raises
    ------
    ValueError
        If the lengths differ, labels are not whole numbers, no point is annotated, or
        weights or sizes are negative or do not fit.

    References
    ----------
    .. [1] P. Ochs, J. Malik and T. Brox, "Segmentation of Moving Objects by Long Term
       Video Analysis", IEEE TPAMI 36(6), 2014, sec. 6; the program is that of the
       benchmark's archive ``pami2013_MoSeg_eval``.
       https://doi.org/10.1109/TPAMI.2013.242

    Examples
    --------
    >>> from skmotionseg.metrics import fbms_scores
    >>> scores = fbms_scores([0, 0, 0, 0, 1, 1, 1, 1], [0, 0, 0, 1, 1, 1, 1, -1])
    >>> scores.density, scores.precision, scores.recall
    (0.875, 0.875, 0.875)
    """
    density, precision, recall = _match_regions(
        y_true, y_pred, sample_weight, region_sizes
    )
    means = float(precision.mean()), float(recall.mean())
    return FBMSScores(density, *means, float(_harmonic(*means)))


def fbms_objects(
    y_true: npt.ArrayLike,
    y_pred: npt.ArrayLike,
    *,
    sample_weight: npt.ArrayLike | None = None,
    region_sizes: npt.ArrayLike | None = None,
    threshold: float = 0.75,
) -> FBMSObjects:
    """Count the true objects that are found, as the Freiburg benchmark does.

    Parameters
    ----------
    y_true, y_pred, sample_weight, region_sizes
        As of :func:`fbms_scores`.
    threshold : float, default=0.75
        A region is found if the F-measure of its match is larger.

    Returns
    -------
    FBMSObjects
        Numbers of regions ``extracted`` and ``visible``, each minus one for the
        background, whichever region that is, as in the benchmark's program.

    Raises
    ------
    ValueError
        As from :func:`fbms_scores`, or if the threshold is no number.

    Examples
    --------
    >>> from skmotionseg.metrics import fbms_objects
    >>> fbms_objects([0, 0, 0, 1, 1, 2, 2], [0, 0, 0, 1, 1, 1, 1])
    FBMSObjects(extracted=0, visible=2)
    >>> fbms_objects([0, 0, 0, 1, 1, 2, 2], [0, 0, 0, 1, 1, 2, -1])
    FBMSObjects(extracted=2, visible=2)
    """
    if not isinstance(threshold, Real) or not np.isfinite(threshold):
        raise ValueError(f"threshold must be a number; got {threshold!r}")
    _, *pair = _match_regions(y_true, y_pred, sample_weight, region_sizes)
    n_found = int((_harmonic(*pair) > threshold).sum())
    return FBMSObjects(max(n_found - 1, 0), len(pair[0]) - 1)


def fbms_mean(scores: Sequence[FBMSScores]) -> FBMSScores:
    """Scores of a set of sequences, from those of each.

    Parameters
    ----------
    scores : sequence of FBMSScores
        As from :func:`fbms_scores`, one per sequence.

    Returns
    -------
    FBMSScores
        Mean density, precision and recall; the F-measure is the harmonic mean of those
        two, as in the benchmark's program and in its tables, and not a mean of
        F-measures.

    Raises
    ------
    ValueError
        If there are none, or these are of one sequence and in no list.

    Examples
    --------
    >>> from skmotionseg.metrics import fbms_mean, fbms_scores
    >>> perfect = fbms_scores([0, 0, 1, 1], [0, 0, 1, 1])
    >>> merged = fbms_scores([0, 0, 1, 1], [0, 0, 0, 0])
    >>> fbms_mean([perfect, merged]).precision
    0.875
    """
    if isinstance(scores, FBMSScores):
        raise ValueError("a mean needs a list of scores, one per sequence; got one")
    if len(scores) == 0:
        raise ValueError("a mean needs the scores of one sequence at least; got none")
    density, precision, recall = np.mean([score[:3] for score in scores], axis=0)
    f_measure = _harmonic(precision, recall)
    return FBMSScores(*map(float, (density, precision, recall, f_measure)))


def region_similarity(y_true: npt.ArrayLike, y_pred: npt.ArrayLike) -> float:
    """Intersection over union of two binary masks: J of DAVIS.

    Parameters
    ----------
    y_true, y_pred : array-like of bool, shape (height, width)

    Returns
    -------
    float
        Between 0 and 1; 1 if both are empty.

    Raises
    ------
    ValueError
        If the shapes differ or are not of two dimensions.

    References
    ----------
    F. Perazzi et al., "A Benchmark Dataset and Evaluation Methodology for Video Object
    Segmentation", CVPR 2016, sec. 4.1.

    Examples
    --------
    >>> from skmotionseg.metrics import region_similarity
    >>> region_similarity([[1, 1, 0, 0]], [[0, 1, 1, 0]])
    0.3333333333333333
    """
    true, found = _as_masks(y_true, y_pred)
    union = (true | found).sum()
    return float((true & found).sum() / union) if union else 1.0


def boundary_f_measure(
    y_true: npt.ArrayLike, y_pred: npt.ArrayLike, *, tolerance: float = 0.008
) -> float:
    """Compute the F-measure of the contours of two binary masks: F of DAVIS.

    It is the harmonic mean of the share of the predicted contour that is near the true
    one and the share of the true contour that is near the predicted one.

    Parameters
    ----------
    y_true, y_pred : array-like of bool, shape (height, width)
    tolerance : float, default=0.008
        Distance at which contours match, as a share of the image diagonal, rounded up
        to pixels.

    Returns
    -------
    float
        Between 0 and 1; 1 if neither has a contour.

    Raises
    ------
    ValueError
        If the shapes differ or are not of two dimensions, or the tolerance is negative
        or not finite.

    References
    ----------
    F. Perazzi et al., "A Benchmark Dataset and Evaluation Methodology for Video Object
    Segmentation", CVPR 2016, sec. 4.1.

    Examples
    --------
    >>> import numpy as np
    >>> from skmotionseg.metrics import boundary_f_measure
    >>> mask = np.zeros((60, 80), dtype=bool)
    >>> mask[20:40, 20:40] = True
    >>> boundary_f_measure(mask, mask), boundary_f_measure(mask, np.roll(mask, 30))
    (1.0, 0.0)
    """
    if not isinstance(tolerance, Real) or not 0 <= tolerance < np.inf:
        raise ValueError(f"tolerance must be a share of 0 or more; got {tolerance!r}")
    true, found = (_outline(mask) for mask in _as_masks(y_true, y_pred))
    if not true.any() or not found.any():
        return float(true.any() == found.any())
    reach = np.ceil(tolerance * np.hypot(*true.shape))
    precision = (distance_transform_edt(~true)[found] <= reach).mean()
    recall = (distance_transform_edt(~found)[true] <= reach).mean()
    return float(_harmonic(precision, recall))


def _as_masks(y_true, y_pred):
    _refuse_masked(y_true, "y_true")
    _refuse_masked(y_pred, "y_pred")
    true, found = (np.asarray(mask, dtype=bool) for mask in (y_true, y_pred))
    if true.ndim != 2 or true.shape != found.shape:
        raise ValueError(
            "two masks of one shape (height, width) are needed; got "
            f"{true.shape} and {found.shape}"
        )
    return true, found


def _outline(mask):
    """Pixels that differ from their right, lower or lower right neighbour."""
    if not mask.size:
        return mask
    padded = np.pad(mask, ((0, 1), (0, 1)), mode="edge")
    shifted = (padded[:-1, 1:], padded[1:, :-1], padded[1:, 1:])
    return (mask ^ shifted[0]) | (mask ^ shifted[1]) | (mask ^ shifted[2])


# A region with less than this (in weighted pixels) is not visible, says the program.
VISIBLE = 1e-4


def _match_regions(y_true, y_pred, sample_weight, region_sizes):
    """Density, and the precision and recall of each visible region's match."""
    y_true, y_pred = _as_labels(y_true, "y_true"), _as_labels(y_pred, "y_pred")
    groups = np.unique(y_pred[y_pred >= 0])
    weight = _as_sizes(sample_weight, "sample_weight", np.ones(len(y_true)))
    if len(weight) != len(y_true):
        raise ValueError(
            f"sample_weight needs one weight per point; got {len(weight)} for "
            f"{len(y_true)} points"
        )
    weight = weight[y_true >= 0]
    y_true, y_pred = _judged(y_true, y_pred)
    if region_sizes is None:
        _, y_true = np.unique(y_true, return_inverse=True)
        sizes = np.bincount(y_true, weight)
    else:
        sizes = _as_sizes(region_sizes, "region_sizes", None)
    if y_true.max() >= len(sizes):
        raise ValueError(
            f"region_sizes must have a size for each region; got {len(sizes)} for "
            f"region {y_true.max()}"
        )
    overlap = np.zeros((len(sizes), len(groups)))
    placed = y_pred >= 0
    columns = np.searchsorted(groups, y_pred[placed])
    np.add.at(overlap, (y_true[placed], columns), weight[placed])
    visible = sizes > VISIBLE
    if not visible.any():
        raise ValueError(
            f"no region is visible: all have a size or weight of {VISIBLE} or less"
        )
    group_sizes = overlap.sum(axis=0)
    overlap, sizes = overlap[visible], sizes[visible]
    covered = overlap.sum(axis=1)
    all_precision = _share(overlap, group_sizes)
    all_recall = _share(overlap, covered[:, None])
    match = linear_sum_assignment(-_harmonic(all_precision, all_recall))
    precision, recall = np.ones(len(sizes)), np.zeros(len(sizes))
    precision[match[0]], recall[match[0]] = all_precision[match], all_recall[match]
    return float(np.mean(covered / sizes)), precision, recall


def _share(part, whole):
    whole = np.broadcast_to(whole, part.shape)
    return np.divide(part, whole, out=np.zeros_like(part), where=whole > 0)


def _as_sizes(values, name, default):
    _refuse_masked(values, name)
    values = default if values is None else np.asarray(values, dtype=float)
    good = np.isfinite(values) & (values >= 0)
    if values.ndim != 1 or not good.all():
        got = f"shape {values.shape}" if values.ndim != 1 else values[~good][0]
        raise ValueError(f"{name} must be a list of numbers of 0 or more; got {got}")
    return values


def _harmonic(a, b):
    total = np.asarray(a + b, dtype=float)
    return np.divide(2 * a * b, total, out=np.zeros_like(total), where=total > 0)


def _judged(
    y_true: npt.ArrayLike, y_pred: npt.ArrayLike
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Check two labellings and keep the points whose true label is not negative."""
    y_true, y_pred = _as_labels(y_true, "y_true"), _as_labels(y_pred, "y_pred")
    if len(y_true) != len(y_pred):
        raise ValueError(
            f"y_true and y_pred need one label per track; got {len(y_true)} and "
            f"{len(y_pred)}"
        )
    judged = y_true >= 0
    if not judged.any():
        raise ValueError(
            f"none of the {len(y_true)} tracks has a true label of 0 or above to judge"
        )
    return y_true[judged], y_pred[judged]


def _as_labels(labels: npt.ArrayLike, name: str) -> npt.NDArray[np.int64]:
    _refuse_masked(labels, name)
    labels = np.asarray(labels)
    if labels.ndim != 1 or labels.dtype.kind not in "iufb":
        raise ValueError(
            f"{name} must be a list of whole numbers; got shape {labels.shape} and "
            f"dtype {labels.dtype}"
        )
    # NaN equals nothing, and what is out of range would be another label.
    whole = np.array_equal(labels, np.round(labels))
    if not whole or (np.abs(labels.astype(float)) >= 2.0**63).any():
        raise ValueError(
            f"{name} must be whole numbers of 64 bits; got dtype {labels.dtype}"
        )
    return labels.astype(np.int64)


def _refuse_masked(values, name):
    if np.ma.is_masked(values):  # under a mask is any number
        raise ValueError(f"{name} must be known throughout; some are masked")


def _contingency(y_true, y_pred):
    """Tracks a true and found motion share; -1 found is no motion."""
    _, true = np.unique(y_true, return_inverse=True)
    found_labels, found = np.unique(y_pred, return_inverse=True)
    counts = np.zeros((true.max() + 1, len(found_labels)))
    np.add.at(counts, (true, found), 1)
    return counts[:, found_labels >= 0]


def _n_motions(given):
    """Motions of a sequence, of which labels are given or how many they are."""
    count = np.asarray(given)
    if count.ndim > 0:
        labels = _as_labels(given, "labels of a sequence")
        return len(np.unique(labels[labels >= 0]))
    _refuse_masked(given, "the number of motions of a sequence")
    whole = count.dtype.kind in "iuf" and np.isfinite(count) and count % 1 == 0
    if not whole or count < 0:
        raise ValueError(
            f"a number of motions must be a whole number of 0 or more; got {count}"
        )
    return int(count)
