"""How the paper's rules, or an estimator of one's own, choose the number of motions."""

from __future__ import annotations

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
        If its labels are not whole numbers, one per track, or none is of a motion.
    """
    selector.fit(np.hstack(list(views)))
    name = type(selector).__name__
    labels = check_label_each(selector.labels_, views.shape[1], f"labels_ of {name}")
    if not (labels >= 0).any():
        raise ValueError(f"{name} found no motion: all its labels are negative")
    labels = canonical_labels(labels)
    alone = np.array([labels.max() + 1]), np.full((1, 3), np.nan), labels[None], 0
    names = ("counts_", "costs_", "candidate_labels_", "best_index_")
    complete = all(hasattr(selector, name) for name in names)
    counts, costs, candidates, best = (
        [getattr(selector, name) for name in names] if complete else alone
    )
    return PartitionSearch(
        np.asarray(counts),
        np.asarray(costs),
        np.asarray(candidates),
        int(best),
        own_shares(views, labels),
        cost_names=getattr(selector, "cost_names_", ("first term", "second term")),
        cost_weights=getattr(selector, "cost_weights_", (1, 1)),
        cost_tolerance=getattr(selector, "cost_tolerance_", 1e-9),
    )
