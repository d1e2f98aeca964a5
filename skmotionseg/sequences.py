"""Settings for a set of sequences."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from numbers import Integral
from types import FrameType
from typing import Self

import numpy as np
import numpy.typing as npt
from joblib import Memory
from scipy.sparse import issparse
from sklearn.base import BaseEstimator, _fit_context, clone
from sklearn.utils._param_validation import HasMethods
from sklearn.utils.validation import check_is_fitted

from ._core.geometry.tracks import as_array
from ._parallel.engine import register_dask, run_tasks
from ._parallel.tasks import Task
from ._parallel.threads import single_threaded
from ._utils.caching import as_memory, check_cacheable, recall
from ._utils.callers import LIBRARIES, package_of
from ._utils.seeds import seed_names
from ._utils.validation import N_JOBS, check_instance, nothing_masked, unmasked
from .metrics import misclassification_error

__all__ = ["PerSequence"]

# Calls between a search and an estimator, some of them in a pipeline.
MOST_CALLERS = 20

register_dask()  # for searches over sequences


class PerSequence(BaseEstimator):
    """Segment many sequences with one setting: each sample is a whole sequence.

    Wraps an estimator of one sequence so that :class:`~sklearn.model_selection.\
GridSearchCV` can search the parameters with the lowest error over a *set* of sequences.
    Sequences are independent: :meth:`fit` only checks its input, and :meth:`predict`
    segments each sequence separately with a clone of the estimator. It returns a list
    of label arrays, which ``cross_val_predict`` cannot join to one array.

    Parameters
    ----------
    estimator : estimator
        Estimator with ``fit_predict``, such as :class:`MotionSegmenter`. Set its
        ``random_state`` to an integer for reproducible results.
    n_jobs : int or None, default=None
        Number of sequences to segment in parallel, on the backend that
        ``joblib.parallel_config`` selects, such as a Dask cluster. ``None`` means 1
        unless in a :obj:`joblib.parallel_backend` context. ``-1`` means using all
        processors. See :term:`Glossary <n_jobs>` for more details. For a search on a
        Dask cluster, use ``parallel_config(backend="skmotionseg-dask")``: it raises an
        error if a task kills every worker, where joblib's "dask" waits forever.
    memory : str, joblib.Memory or None, default=None
        Caches the labels of each sequence and setting, so that a search that was
        interrupted continues when it is run again. Requires an integer ``random_state``
        in the estimator.

    Attributes
    ----------
    n_sequences_ : int
        Sequences seen in ``fit``.

    Examples
    --------
    >>> from sklearn.model_selection import GridSearchCV, KFold
    >>> from skmotionseg import MotionSegmenter, PerSequence
    >>> from skmotionseg.datasets import make_rigid_motions
    >>> scenes = [
    ...     make_rigid_motions(n_tracks=60, n_frames=4, n_motions=2, random_state=seed)
    ...     for seed in range(2)
    ... ]
    >>> sequences, labels = [X for X, y in scenes], [y for X, y in scenes]
    >>> segmenter = MotionSegmenter(n_motions=2, n_hypotheses=50, random_state=0)
    >>> search = GridSearchCV(
    ...     PerSequence(segmenter), {"estimator__n_hypotheses": [25, 50]}, cv=KFold(2)
    ... )
    >>> len(search.fit(sequences, labels).cv_results_["params"])
    2
    """

    _parameter_constraints: dict = {
        "estimator": [HasMethods(["fit_predict", "get_params", "set_params"])],
        "n_jobs": N_JOBS,
        "memory": [str, os.PathLike, Memory, None],
    }

    def __init__(
        self,
        estimator: BaseEstimator,
        n_jobs: int | None = None,
        memory: str | os.PathLike[str] | Memory | None = None,
    ) -> None:
        self.estimator = estimator
        self.n_jobs = n_jobs
        self.memory = memory

    @_fit_context(prefer_skip_nested_validation=False)
    def fit(
        self,
        X: Sequence[npt.ArrayLike],
        y: Sequence[npt.ArrayLike] | None = None,
    ) -> Self:
        """Check the sequences.

        Parameters
        ----------
        X : list of array-like, each of shape (n_tracks, 2 * n_frames)
        y : list of array-like of int, each of shape (n_tracks,), optional

        Returns
        -------
        self

        Raises
        ------
        ValueError
            If ``X`` holds no sequence, ``y`` not one label per track, or a search
            scores by a function that compares label arrays.
        TypeError
            If ``estimator`` is a class.
        """
        check_instance(self.estimator)
        _refuse_scorers_of_tracks()
        sequences = self._read_sequences(X, reset=True)
        check_cacheable(self.memory, *_seed_of(self.estimator))
        if y is not None:
            self._read_labels(y, sequences)
        return self

    def _read_sequences(self, X, *, reset):
        """Check sequences and list them as arrays."""
        listed = X if _is_listlike(X) else []
        if issparse(X) or any(map(issparse, listed)):
            raise TypeError("sparse data is not supported; give a list of track arrays")
        sequences = [np.asarray(unmasked(as_array(x))) for x in listed]
        if not sequences:
            raise ValueError(
                "X must be a list of track arrays, one per sequence; got "
                f"{type(X).__name__}" + (" without any" if _is_listlike(X) else "")
            )
        for i, x in enumerate(sequences):
            if x.ndim != 2:
                raise ValueError(
                    "each sequence must be a track array of shape (n_tracks, "
                    f"2 * n_frames); sequence {i} has shape {x.shape}"
                )
        if reset:
            self.n_sequences_ = len(sequences)
        return sequences

    def _read_labels(self, y, sequences):
        """Check labels against sequences and list them as arrays."""
        if not np.iterable(y):
            raise ValueError(
                "true labels are needed: a label array per sequence; got "
                f"{type(y).__name__}"
            )
        labels = [nothing_masked(labels, "labels of a sequence") for labels in y]
        if len(labels) != len(sequences):
            raise ValueError(
                f"got {len(sequences)} sequences and {len(labels)} label arrays"
            )
        for i, (one, x) in enumerate(zip(labels, sequences, strict=True)):
            if one.shape != (len(x),):
                raise ValueError(
                    f"sequence {i} has {len(x)} tracks and labels of shape {one.shape}"
                )
            if one.dtype.kind not in "iufb" or not np.array_equal(one, np.round(one)):
                raise ValueError(
                    f"labels of sequence {i} must be whole numbers; got dtype "
                    f"{one.dtype}"
                )
        return labels

    @single_threaded
    def predict(self, X: Sequence[npt.ArrayLike]) -> list[npt.NDArray[np.intp]]:
        """Segment each sequence.

        Parameters
        ----------
        X : list of array-like, each of shape (n_tracks, 2 * n_frames)

        Returns
        -------
        list of ndarray of int, each of shape (n_tracks,)

        Raises
        ------
        Exception
            An error of the estimator, or of Dask if all workers failed, with a note
            that names the sequence (0 is the first).
        """
        check_is_fitted(self)
        _refuse_scorers_of_tracks()
        seed, _ = _seed_of(self.estimator)
        memory = as_memory(self.memory if isinstance(seed, Integral) else None)
        return run_tasks(
            (
                Task(
                    f"segmenting sequence {i}",
                    recall,
                    memory,
                    _segment,
                    self.estimator,
                    x,
                )
                for i, x in enumerate(self._read_sequences(X, reset=False))
            ),
            n_jobs=self.n_jobs,
        )

    def score(self, X: Sequence[npt.ArrayLike], y: Sequence[npt.ArrayLike]) -> float:
        """One minus the mean misclassification error over the sequences.

        Parameters
        ----------
        X : list of array-like, each of shape (n_tracks, 2 * n_frames)
        y : list of array-like of int, each of shape (n_tracks,)
            True labels; tracks of label -1 are ignored.

        Returns
        -------
        float
        """
        check_is_fitted(self)
        labels = self._read_labels(y, self._read_sequences(X, reset=False))
        errors = map(misclassification_error, labels, self.predict(X))
        return 1 - float(np.mean(list(errors)))


def _seed_of(estimator):
    """A seed on which labels depend, and its name: one that is not set, if there is.

    Of a pipeline, all steps that are random must have one. What a step holds gets its
    seed from it; and a selector without one leaves its clusterer the seed that it has.
    """
    params, names = estimator.get_params(), seed_names(estimator)
    if "random_state" in names or not names:
        return params.get("random_state", 0), "random_state of the estimator"
    are_set = {name: isinstance(params[name], Integral) for name in names}
    loose = (name for name in names if not _is_seeded(name, are_set))
    name = next(loose, max(names, key=are_set.__getitem__))
    return params[name], f"{name} of the estimator"


def _is_seeded(name, are_set):
    """Whether a seed is set, or that of what holds it, or of the clusterer in it."""
    *holders, _ = name.split("__")
    above = ("__".join([*holders[:k], "random_state"]) for k in range(len(holders) + 1))
    within = "__".join([*holders, "clusterer", "random_state"])
    return any(are_set.get(each, False) for each in (*above, within))


def _segment(estimator, X, version):
    """Labels; the version says of what code they are, where they are kept."""
    return clone(estimator).fit_predict(X)


def _refuse_scorers_of_tracks():
    """Say what to use where a scorer of scikit-learn is about to compare lists.

    It would fail in its own words, or not at all say why, as it cannot know that each
    sample is a sequence. Nobody tells an estimator what it will be scored by; so it is
    looked up in the calls of scikit-learn that led here. If that is known in ``fit``
    already, a search in which no setting can be scored fails there, and all that is
    said is the reason; if in ``predict``, each score is NaN and has a warning.
    """
    for scorer in _scorers_of_callers():
        score = getattr(scorer, "_score_func", None)
        if score is misclassification_error:
            raise ValueError(
                "misclassification_error compares label arrays, and each sample of "
                "PerSequence is a sequence; use no scoring: one minus the mean error "
                "is the score of PerSequence"
            )
        if score is not None and score.__module__.startswith("sklearn."):
            raise ValueError(
                f"{score.__name__} compares label arrays, and each sample of "
                "PerSequence is a sequence; use scoring=sequence_scorer("
                f"{score.__name__!r}) of skmotionseg.metrics, or no scoring"
            )


def _scorers_of_callers():
    """Yield what functions of scikit-learn among the callers are, or score by.

    What is called by an estimator of others is left alone: it is that one which is
    scored, and it may make of labels what it likes, such as their number.
    """
    frame: FrameType | None = sys._getframe(2)
    for _ in range(MOST_CALLERS):
        if frame is None or package_of(frame) not in LIBRARIES:
            return
        if package_of(frame) == "sklearn":
            for name in ("self", "scorer"):
                found = frame.f_locals.get(name)
                yield from getattr(found, "_scorers", {name: found}).values()
        frame = frame.f_back


def _is_listlike(X):
    return isinstance(X, (list, tuple, np.ndarray)) and np.ndim(X[:0]) > 0
