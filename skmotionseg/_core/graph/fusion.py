"""Fusions: one embedding for each view, drawn together in different ways.

Here are those of the paper, by name, and how a function of one's own takes their place.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType

import numpy as np

from .spectral import leading_of_perturbed, supported_directions


@dataclass(frozen=True)
class Fusion:
    """Embeddings of all views, and how the alternation got there.

    Attributes
    ----------
    embeddings : ndarray of shape (n_views, n, n_clusters)
        Orthonormal columns; zero for directions that no affinity supports.
    objective : ndarray of shape (n_sweeps + 1,)
        The cost of the views by themselves, and after each sweep over them.
    """

    embeddings: np.ndarray
    objective: np.ndarray


def kernel_addition(graph, n_clusters, *, lam=None, gamma=None, max_iter=0, tol=0.0):
    """One embedding for all views, of the sum of their Laplacians.

    Xu, Cheong and Li (2021), "Kernel Addition": ``min tr(U^T sum_v L_v U)``.

    Parameters
    ----------
    graph : ViewGraph
    n_clusters : int
    lam, gamma, max_iter, tol : ignored
        So that all fusions are called alike.

    Returns
    -------
    Fusion
    """
    values, vectors = graph.sum_spectrum
    n_views = len(graph.normalized)
    leading = supported_directions(values[:n_clusters], vectors[:, :n_clusters])
    embeddings = np.stack([leading] * n_views)
    cost = n_views * n_clusters - values[:n_clusters].sum()
    return Fusion(embeddings, np.array([cost]))


def co_regularization(graph, n_clusters, *, lam, gamma=None, max_iter, tol):
    """An embedding per view, drawn towards those of the other views.

    Xu, Cheong and Li (2021), eq. 3, after Kumar, Rai and Daume (2011): each view in
    turn takes the first eigenvectors of ``L_v - lam sum_{w != v} U_w U_w^T``. That
    never raises ``sum_v tr(U_v^T L_v U_v) - lam sum_{v < w} |U_v^T U_w|_F^2``, which is
    what ``objective`` holds.

    Parameters
    ----------
    graph : ViewGraph
    n_clusters : int
    lam : float
        Weight of agreement.
    gamma : ignored
    max_iter : int
        Maximum number of iterations over the views.
    tol : float
        Stop when a sweep lowers the cost by less than this share of ``n_clusters``.

    Returns
    -------
    Fusion
    """

    def pull(v, U):  # lam sum_{w != v} U_w U_w^T
        others = np.hstack([U[w] for w in range(len(U)) if w != v])
        return lambda X: lam * (others @ (others.T @ X))

    def cost(U):
        agreement = sum(
            np.sum((U[v].T @ U[w]) ** 2) for v in range(len(U)) for w in range(v)
        )
        return _cut_cost(graph, U) - lam * agreement

    return _alternate(graph, n_clusters, pull, cost, max_iter, tol)


def subset_constraint(graph, n_clusters, *, lam=None, gamma, max_iter, tol):
    """An embedding per view, under "what a simpler model joins, a richer one joins".

    Xu, Cheong and Li (2021), eq. 5 and algorithm 1. Views are in the order affine,
    homography, fundamental: a view inherits the positive entries of ``U U^T`` from the
    simpler view before it and the negative ones from the richer view after it.
    Convergence is not guaranteed.

    Parameters
    ----------
    graph : ViewGraph
        The simplest model first.
    n_clusters : int
    lam : ignored
    gamma : float
        Weight of the constraint.
    max_iter : int
    tol : float

    Returns
    -------
    Fusion
    """

    def pull(v, U):  # gamma Q_v
        Q = np.zeros_like(graph.normalized[v])
        if v > 0:
            Q += np.maximum(U[v - 1] @ U[v - 1].T, 0)
        if v + 1 < len(U):
            Q += np.minimum(U[v + 1] @ U[v + 1].T, 0)
        Q *= gamma
        return lambda X: Q @ X

    def cost(U):
        return _cut_cost(graph, U) - sum(
            np.sum(U[v] * pull(v, U)(U[v])) for v in range(len(U))
        )

    return _alternate(graph, n_clusters, pull, cost, max_iter, tol)


def _alternate(graph, n_clusters, pull, cost, max_iter, tol):
    """Sweep over the views until the cost settles; one view needs no sweep."""
    U = np.stack(
        [
            supported_directions(values[:n_clusters], vectors[:, :n_clusters])
            for values, vectors in graph.view_spectra
        ]
    )
    objective = [cost(U)]
    for _ in range(max_iter if len(U) > 1 else 0):
        for v, (values, vectors) in enumerate(graph.view_spectra):
            leading = leading_of_perturbed(values, vectors, pull(v, U), n_clusters)
            U[v] = supported_directions(*leading)
        objective.append(cost(U))
        if abs(objective[-2] - objective[-1]) < tol * n_clusters:
            break
    return Fusion(U, np.array(objective))


def _cut_cost(graph, embeddings):
    """``sum_v tr(U_v^T L_v U_v)``."""
    return embeddings.shape[0] * embeddings.shape[2] - np.sum(
        embeddings * (graph.normalized @ embeddings)
    )


FUSIONS: Mapping[str, Callable[..., Fusion]] = MappingProxyType(
    {
        "kernel_addition": kernel_addition,
        "coreg": co_regularization,
        "subset": subset_constraint,
    }
)


def check_fusion(fusion: str | Callable) -> None:
    """Refuse what is neither the name of a fusion nor a function.

    Raises
    ------
    ValueError
        If it is another name.
    """
    if not callable(fusion) and fusion not in FUSIONS:
        raise ValueError(
            f"unknown fusion {fusion!r}; expected a callable or one of "
            f"{sorted(FUSIONS)}"
        )


def bind_fusion(fusion, *, lam, gamma, max_iter, tol):
    """A function ``(graph, n_clusters) -> Fusion``, of a name or a user's function.

    Parameters
    ----------
    fusion : str or callable
        One of :data:`FUSIONS`, or ``(views, n_clusters) -> embeddings`` with normalised
        affinities (n_views, n, n) and embeddings (n_views, n, n_clusters).
    lam, gamma : float
    max_iter : int
    tol : float
        For those that have a name.

    Returns
    -------
    callable

    Raises
    ------
    ValueError
        As :func:`check_fusion`.
    """
    check_fusion(fusion)
    if callable(fusion):
        return partial(_fuse_by, fusion)
    return partial(FUSIONS[fusion], lam=lam, gamma=gamma, max_iter=max_iter, tol=tol)


def _fuse_by(function, graph, n_clusters):
    """What a user's function gives, checked; it may work in place."""
    given = graph.normalized.copy()
    embeddings = np.asarray(function(given, n_clusters))
    wanted = (*graph.normalized.shape[:2], n_clusters)
    expected = (
        "a fusion must give finite real embeddings of shape (n_views, n, n_clusters) = "
        f"{wanted}"
    )
    if embeddings.shape != wanted:
        raise ValueError(f"{expected}; got shape {embeddings.shape}")
    if embeddings.dtype.kind not in "fiub":
        raise ValueError(f"{expected}; got dtype {embeddings.dtype}")
    n_bad = np.count_nonzero(~np.isfinite(embeddings))
    if n_bad:
        raise ValueError(f"{expected}; got {n_bad} that are NaN or infinite")
    return Fusion(embeddings.astype(float), np.zeros(0))
