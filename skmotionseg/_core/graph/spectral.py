"""Spectral embeddings of one affinity and of several that are fused.

All functions work with normalised affinities ``N = D^-1/2 K D^-1/2``; the Laplacian of
the paper is ``L = I - N``, so its smallest eigenvectors are the largest ones here.
Several views are joined by a fusion (see :mod:`skmotionseg._core.graph.fusion`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from .lazy import lazy

# Eigenvectors of a view that are there for each small problem of a fusion, over those
# that are asked for: more make the problems larger and fewer.
EXTRA_VECTORS = 8
# Length of the residual at which an eigenvector is found.
EIGENVECTOR_TOLERANCE = 1e-9
# Eigenvalues up to this are none: their directions say nothing about the tracks.
NO_EIGENVALUE = 1e-10
# Rows of orthonormal columns up to this length are zero but for rounding: tracks of a
# component of the graph that no column is about.
NO_LENGTH = 1e-10
# Decimals of the features: rows that differ by rounding alone are the same to k-means.
FEATURE_DECIMALS = 9


@dataclass(frozen=True)
class ViewGraph:
    """The affinities of several views among the tracks that meet another.

    Eigenvectors are computed when first asked for and serve every number of clusters
    up to ``n_leading``.

    Attributes
    ----------
    n_samples : int
        Tracks, those that meet no other included.
    connected : ndarray of int, shape (n,)
        The tracks that do, by their position.
    degrees : ndarray of shape (n_views, n)
    normalized : ndarray of shape (n_views, n, n)
        ``D^-1/2 K D^-1/2`` of each view.
    n_leading : int
    map_views : callable
        Like :func:`map`, which it is unless views are to be decomposed in parallel.
    """

    n_samples: int
    connected: np.ndarray
    degrees: np.ndarray
    normalized: np.ndarray
    n_leading: int
    map_views: Callable = map

    @classmethod
    def from_affinities(cls, views, n_leading, map_views=map):
        """Build the graph from affinities (n_views, n_samples, n_samples)."""
        n_samples = views.shape[1]
        connected = connected_tracks(views)
        views = views[:, connected[:, None], connected]
        normalized = np.stack([normalized_affinity(view) for view in views])
        n_leading = min(n_leading, len(connected))
        degrees = views.sum(axis=2)
        return cls(n_samples, connected, degrees, normalized, n_leading, map_views)

    @lazy
    def view_spectra(self):
        """All eigenvalues, the largest first, and eigenvectors of each view."""
        return list(self.map_views(spectrum, self.normalized))

    @lazy
    def sum_spectrum(self):
        """Leading eigenvalues and eigenvectors, (n, n_leading), of the sum of views."""
        return leading_eigenvectors(self.normalized.sum(axis=0), self.n_leading)


def normalized_affinity(affinity):
    """``D^-1/2 K D^-1/2``; a row without any affinity stays zero.

    Parameters
    ----------
    affinity : ndarray of shape (n, n)
        Symmetric and non-negative.

    Returns
    -------
    ndarray of shape (n, n), float64
    """
    scale = inverse_sqrt(affinity.sum(axis=1, dtype=float))
    return affinity * scale[:, None] * scale


def connected_tracks(views):
    """Positions of the tracks that have an affinity to another, in any view.

    Parameters
    ----------
    views : ndarray of shape (n_views, n, n)

    Returns
    -------
    ndarray of int
        A single track counts as connected: it is a group by itself.
    """
    positive = (views > 0).any(axis=0)
    if len(positive) > 1:
        np.fill_diagonal(positive, False)
        return np.flatnonzero(positive.any(axis=1))
    return np.arange(len(positive))


def inverse_sqrt(degrees):
    """``d^-1/2``, and 0 where the degree is 0."""
    positive = degrees > 0
    return np.where(positive, 1 / np.sqrt(np.where(positive, degrees, 1)), 0)


def leading_eigenvectors(matrix, n_vectors):
    """Eigenvectors of the largest eigenvalues of a symmetric matrix.

    Parameters
    ----------
    matrix : ndarray of shape (n, n)
    n_vectors : int

    Returns
    -------
    values : ndarray of shape (n_vectors,)
        Largest first.
    vectors : ndarray of shape (n, n_vectors)
        The entry of largest magnitude in each is positive.
    """
    n = len(matrix)
    try:
        # Bisection and inverse iteration. The faster "evr" driver silently returns
        # fewer vectors than asked for when eigenvalues are close, which ours are by
        # design.
        values, vectors = scipy.linalg.eigh(
            matrix, subset_by_index=[n - n_vectors, n - 1], driver="evx"
        )
        values, vectors = values[::-1], vectors[:, ::-1]
    except np.linalg.LinAlgError:  # inverse iteration did not converge
        values = vectors = np.empty(0)
    if len(values) < n_vectors:
        # Bisection lost count of equal eigenvalues; LAPACK's cure is to find them all.
        values, vectors = spectrum(matrix)
        values, vectors = values[:n_vectors], vectors[:, :n_vectors]
    largest = np.abs(vectors).argmax(axis=0)
    return values, vectors * np.sign(vectors[largest, np.arange(n_vectors)])


def spectrum(matrix):
    """All eigenvalues of a symmetric matrix, the largest first, and eigenvectors."""
    values, vectors = np.linalg.eigh(matrix)
    return values[::-1], np.ascontiguousarray(vectors[:, ::-1])


def leading_of_perturbed(values, vectors, perturb, n_vectors):
    """Eigenvectors of the largest eigenvalues of a known matrix plus a small one.

    Davidson's method in the eigenvectors of the known matrix: the leading ones and
    those that the residuals, divided by the distances of the eigenvalues, point to.
    A few small problems take the place of a decomposition.

    Parameters
    ----------
    values : ndarray of shape (n,)
        Eigenvalues of the known matrix, the largest first.
    vectors : ndarray of shape (n, n)
    perturb : callable
        ``(n, k) -> (n, k)``: the small symmetric matrix times some columns.
    n_vectors : int

    Returns
    -------
    values : ndarray of shape (n_vectors,)
        The largest first.
    vectors : ndarray of shape (n, n_vectors)
    """
    n = len(values)
    n_exact = min(n, 2 * n_vectors + EXTRA_VECTORS)
    basis = np.eye(n, n_exact)
    image = vectors.T @ perturb(vectors[:, :n_exact])
    while True:
        small = basis.T @ (values[:, None] * basis + image)
        ritz, mixture = np.linalg.eigh((small + small.T) / 2)
        ritz, mixture = ritz[-n_vectors:][::-1], mixture[:, -n_vectors:][:, ::-1]
        found = basis @ mixture
        residual = values[:, None] * found + image @ mixture - found * ritz
        open_ = np.linalg.norm(residual, axis=0) > EIGENVECTOR_TOLERANCE
        if basis.shape[1] + open_.sum() > n or not open_.any():
            return ritz, vectors @ found
        distance = np.maximum(ritz[open_] - values[:, None], EIGENVECTOR_TOLERANCE)
        new = residual[:, open_] / distance
        new[:n_exact] = 0
        for _ in range(2):  # once more for what rounding left
            new -= basis @ (basis.T @ new)
            new = np.linalg.qr(new)[0]
        basis = np.hstack([basis, new])
        image = np.hstack([image, vectors.T @ perturb(vectors @ new)])


def supported_directions(values, vectors):
    """Eigenvectors (n, k) with zeros for those whose eigenvalue (k,) is not positive.

    Where fewer directions than clusters carry affinity, the others are any basis of
    what is left, in which even tracks that are alike to the last bit differ.
    """
    return vectors * (values > NO_EIGENVALUE)


def normalize_rows(matrix):
    """Rows of length 1; rows that are zero but for rounding are zero."""
    length = np.linalg.norm(matrix, axis=-1, keepdims=True)
    there = length > NO_LENGTH
    return np.divide(matrix, length, out=np.zeros_like(matrix), where=there)


def cluster_features(embeddings):
    """What k-means sees: rows of all views at length 1, side by side, at length 1.

    Parameters
    ----------
    embeddings : sequence of ndarray of shape (n, n_clusters)

    Returns
    -------
    ndarray of shape (n, n_views * n_clusters)
        Rounded, so that tracks that are alike have the same row.
    """
    features = normalize_rows(np.hstack([normalize_rows(U) for U in embeddings]))
    return np.round(features, FEATURE_DECIMALS) + 0.0  # no negative zeros


def extend_embedding(rows, degrees, embedding, shrinkage):
    """Embed rows that were not there in fit (the Nystroem extension).

    Parameters
    ----------
    rows : ndarray of shape (m, n)
        Affinities of the new rows to the fitted ones.
    degrees : ndarray of shape (n,)
        Of the fitted affinity.
    embedding : ndarray of shape (n, n_clusters)
    shrinkage : ndarray of shape (n_clusters,)
        ``u^T N u`` for each column: how much one application of ``N`` shrinks it. A
        fitted row of an eigenvector is embedded where it was.

    Returns
    -------
    ndarray of shape (m, n_clusters)
    """
    scale = inverse_sqrt(rows.sum(axis=1, dtype=float))
    smoothed = scale[:, None] * (rows @ (inverse_sqrt(degrees)[:, None] * embedding))
    return np.divide(
        smoothed, shrinkage, out=np.zeros_like(smoothed), where=shrinkage > 0
    )
