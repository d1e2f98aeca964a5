"""How the paper's rules, or an estimator of one's own, choose the number of motions."""

from __future__ import annotations

from numbers import Integral
from typing import Any

import numpy as np
from sklearn.base import BaseEstimator, clone

from .._core.graph.cuts import own_shares
from .._core.labels import canonical_labels
from .._core.partition.search import PartitionSearch
from .._utils.seeds import seed_names
from .._utils.validation import check_label_each
from ..model_selection import (
    EigengapModelSelector,
    NCREModelSelector,
    SelfTuningModelSelector,
)

SELECTORS = {
    "ncre": NCREModelSelector,
    "eigengap": EigengapModelSelector,
    "self_tuning": SelfTuningModelSelector,
}
# The default, by description length, and these.
SELECTIONS = ("description_length", *SELECTORS)
# What a selector has that compares counts.
OF_COUNTS = ("counts_", "costs_", "candidate_labels_", "best_index_")


def make_selector(
    selection: str | BaseEstimator, clusterer: BaseEstimator, delta: float
) -> BaseEstimator:
    """An estimator of affinities, not fitted.

    Parameters
    ----------
    selection : str or estimator
        One of :data:`SELECTORS`, which cluster by the clusterer, or an estimator, of
        which a clone is taken as it is.
    clusterer : MultiModelSpectralClustering
        With the seed for all that has none of its own.
    delta : float
        Weight of the reconstruction error, for "ncre".

    Returns
    -------
    estimator
    """
    if isinstance(selection, str):
        named = SELECTORS[selection](clusterer)
        return named.set_params(delta=delta) if selection == "ncre" else named
    selector: Any = clone(selection)
    params = selector.get_params()
    for name in seed_names(selector):
        if params[name] is None:
            selector.set_params(**{name: clusterer.random_state})
    return selector


def set_counts(selector: BaseEstimator, **counts: int) -> None:
    """Set those of these parameters that the selector has."""
    known = selector.get_params(deep=False)
    selector.set_params(**{k: value for k, value in counts.items() if k in known})


def select_by_graph(selector: Any, views: np.ndarray) -> PartitionSearch:
    """Fit a selector to affinities and take over what it says.

    Parameters
    ----------
    selector : estimator
        With ``labels_`` once it is fitted. ``counts_``, ``costs_``,
        ``candidate_labels_``, ``best_index_``, ``cost_names_``, ``cost_weights_`` and
        ``cost_tolerance_`` are taken over where it has them.
    views : ndarray of shape (n_views, n, n)

    Returns
    -------
    PartitionSearch

    Raises
    ------
    ValueError
        If its labels are not whole numbers, one per track, or none is of a motion, or
        what it says of several counts does not fit together.
    AttributeError
        If it has no labels.
    """
    selector.fit(np.hstack(list(views)))
    name = type(selector).__name__
    if not hasattr(selector, "labels_"):
        raise AttributeError(f"{name} must set labels_ in fit; it has none")
    labels = check_label_each(selector.labels_, views.shape[1], f"labels_ of {name}")
    if not (labels >= 0).any():
        raise ValueError(f"{name} found no motion: all its labels are negative")
    labels = canonical_labels(labels)
    alone = np.array([labels.max() + 1]), np.full((1, 3), np.nan), labels[None], 0
    complete = all(hasattr(selector, name) for name in OF_COUNTS)
    counts, costs, candidates, best = (
        _compared(selector, len(labels)) if complete else alone
    )
    return PartitionSearch(
        counts,
        costs,
        candidates,
        best,
        own_shares(views, labels),
        cost_names=getattr(selector, "cost_names_", ("first term", "second term")),
        cost_weights=getattr(selector, "cost_weights_", (1, 1)),
        cost_tolerance=getattr(selector, "cost_tolerance_", 1e-9),
    )


def _compared(selector, n_tracks):
    """What a selector says of several counts, checked: the values of ``OF_COUNTS``."""
    name = type(selector).__name__
    counts, costs, candidates = (
        np.asarray(getattr(selector, k)) for k in OF_COUNTS[:3]
    )
    shapes = {
        "counts_": (counts.shape, (counts.size,)),
        "costs_": (costs.shape, (counts.size, 3)),
        "candidate_labels_": (candidates.shape, (counts.size, n_tracks)),
    }
    for attribute, (shape, expected) in shapes.items():
        if shape != expected:
            raise ValueError(
                f"{attribute} of {name} must have shape {expected}, for {counts.size} "
                f"counts and {n_tracks} tracks; got {shape}"
            )
    best = selector.best_index_
    if not (isinstance(best, Integral) and 0 <= int(best) < counts.size):
        raise ValueError(
            f"best_index_ of {name} must be a position among {counts.size} counts; got "
            f"{best!r}"
        )
    return counts, costs, candidates, int(best)
