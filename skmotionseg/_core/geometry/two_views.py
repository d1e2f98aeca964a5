"""Motions between two images, each a density of where its points go.

A fundamental matrix leaves the place along the epipolar line free, so that in two
images any motion explains a few in a hundred of all mismatches, and many tracks of
other motions. But the depths of a thing vary little against its distance: along the
line, too, its points are near where an affine map takes them. So the density of a point
of the second image, given its place in the first, is here the product of two, both of
Student's t: across the epipolar line, as wide as the noise, and along it, about the
affine map, as wide as the parallax of the thing. A plane or a distant thing has next to
no parallax; the density knows its points in both coordinates then, as a homography
does, and no choice between models is needed.

Two images may be one pair of several, whose motions are fitted side by side: all arrays
have an axis of the pairs (...) before the others then, and where one pair sees fewer
tracks than another, or tells nothing of a motion, shares in them are 0.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.special import gammaln

from .epipolar import cheapest_rank_two
from .motion_models import epipolar_equations, homogeneous
from .tracks import covered

# Degrees of freedom of Student's t: scales of noise that differ by a factor of two
# from track to track leave tails like these.
FREEDOM = 4.0
# A pixel of an image of 640 x 480, as a share of the side of a square of that area.
PIXEL = 1 / 550
# In such pixels: the noise that is expected, and its least and largest value.
NOISE, LEAST_NOISE, MOST_NOISE = 1.0, 0.15, 2.0
# Tracks that the expected noise counts as, and those that the noise of all motions
# together counts as, when that of one is estimated.
TRACKS_OF_NOISE, TRACKS_OF_COMMON_NOISE = 5.0, 50.0
# Parallax, as a share of the side, that is expected, and the tracks it counts as.
PARALLAX, TRACKS_OF_PARALLAX = 0.0125, 2.0
# Unknowns of the epipolar geometries that compete, of an affine and of a perspective
# camera, and of the affine map along the line.
AFFINE_UNKNOWNS, PERSPECTIVE_UNKNOWNS, MAP_UNKNOWNS = 4, 7, 3
# Tracks below which the geometry is that of an affine camera.
FEWEST_FOR_PERSPECTIVE = 9
# Added to what is inverted, as a share of its trace.
SINGULAR = 1e-12
TINY = np.finfo(float).tiny


@dataclass(frozen=True)
class TwoViews:
    """Places of tracks in two images.

    Attributes
    ----------
    x, y : ndarray of shape (..., n, 3)
        Homogeneous, in working units, the origin amid the tracks of each image.
    side : float or ndarray of shape (...)
        Side of a square as large as what the tracks cover, in working units.
    at_rest : ndarray of shape (2,), optional
        How far what rests goes from the one to the other: their origins are not the
        same place. None where that is not known.
    """

    x: np.ndarray
    y: np.ndarray
    side: float | np.ndarray
    at_rest: np.ndarray | None = None

    def __len__(self):
        return self.x.shape[-2]

    def of_pairs(self, pairs):
        """The same in some of several pairs of images."""
        return TwoViews(self.x[pairs], self.y[pairs], np.asarray(self.side)[pairs])

    @property
    def pixel(self):
        """A pixel of an image of 640 x 480, in working units."""
        return self.side * PIXEL

    @cached_property
    def moved(self):
        """How far tracks go, in pixels of an image of 640 x 480; (n,)."""
        gone = (self.y - self.x)[..., :2] - np.asarray(self.at_rest)
        return np.linalg.norm(gone, axis=-1) / self.pixel

    @property
    def log_density_of_mismatches(self):
        """Of a point that may be anywhere in the second image."""
        return -2 * np.log(self.side)

    @cached_property
    def equations(self):
        """Products of entries of the epipolar equations, (..., n, 81)."""
        return _products(epipolar_equations(self.x, self.y))

    @cached_property
    def joint(self):
        """Products of both places and 1, (..., n, 25)."""
        return _products(np.concatenate([self.x[..., :2], self.y], axis=-1))

    @cached_property
    def places(self):
        """Products of the places in the first image, (..., n, 9)."""
        return _products(self.x)

    @cached_property
    def moves(self):
        """Products of the places in both images, (..., n, 6)."""
        products = self.x[..., :, None] * self.y[..., None, :2]
        return products.reshape(*self.x.shape[:-1], 6)


def _products(rows):
    products = rows[..., :, None] * rows[..., None, :]
    return products.reshape(*rows.shape[:-1], -1)


def two_views(x, y, side=None, at_rest=None):
    """Put correspondences into one system.

    Parameters
    ----------
    x, y : ndarray of shape (n, 2)
        In working units.
    side : float, optional
        Of the tracks that motions were fitted to, where these are others.
    at_rest : ndarray of shape (2,), optional
        As of :class:`TwoViews`.

    Returns
    -------
    TwoViews
    """
    side = _side_of(x, y) if side is None else side
    return TwoViews(homogeneous(x), homogeneous(y), side, at_rest)


def _side_of(x, y):
    """Side of a square as large as what correspondences cover, but for astray ones."""
    extents = np.concatenate([np.ptp(covered(points), axis=0) for points in (x, y)])
    # A still camera's single row of points has no area.
    extents = np.maximum(extents, max(1e-3 * extents.max(), 1e-9))
    return float(np.prod(extents) ** 0.25)


@dataclass(frozen=True)
class TwoViewMotions:
    """Several motions between two images.

    Attributes
    ----------
    fundamental : ndarray of shape (..., M, 3, 3)
        Of rank two.
    affine : ndarray of shape (..., M, 3, 2)
        Takes homogeneous places of the first image, as rows, to the second.
    noise, parallax : ndarray of shape (..., M)
        Widths of the density across and along the epipolar line, in working units.
    n_unknowns : ndarray of int, shape (..., M)
        Of the epipolar geometry: 4 of an affine and 7 of a perspective camera.
    """

    fundamental: np.ndarray
    affine: np.ndarray
    noise: np.ndarray
    parallax: np.ndarray
    n_unknowns: np.ndarray

    def __len__(self):
        return len(self.fundamental)

    def __getitem__(self, chosen):
        """Some of the motions."""
        return TwoViewMotions(*(part[chosen] for part in self._parts))

    def __add__(self, other):
        """These motions and then others."""
        both = zip(self._parts, other._parts, strict=True)
        return TwoViewMotions(*(np.concatenate(parts) for parts in both))

    @property
    def _parts(self):
        return [getattr(self, field.name) for field in fields(self)]

    def replaced(self, where, other):
        """These motions, but those of another stack where it is true, (..., M)."""
        return TwoViewMotions(
            *(
                np.where(
                    where.reshape(*where.shape, *[1] * (own.ndim - where.ndim)),
                    theirs,
                    own,
                )
                for own, theirs in zip(self._parts, other._parts, strict=True)
            )
        )

    def with_rows(self, rows, other):
        """These motions, but those of another stack in some rows."""
        parts = [part.copy() for part in self._parts]
        for part, theirs in zip(parts, other._parts, strict=True):
            part[rows] = theirs
        return TwoViewMotions(*parts)

    def log_densities(self, views):
        """Log density (..., M, n) of points of the second image, given the first."""
        across, along, _ = squared_distances(self.fundamental, self.affine, views)
        return self.log_densities_at(across, along)

    def log_densities_at(self, across, along):
        """The same of points whose squared distances (..., M, n) are known."""
        return log_student(across, self.noise) + log_student(along, self.parallax)

    def with_mismatches(self, views):
        """Log densities (M + 1, n), the last row being those of mismatches."""
        mismatches = np.full((1, len(views)), views.log_density_of_mismatches)
        return np.concatenate([self.log_densities(views), mismatches])

    def costs(self, views):
        """Nats to write down each motion, (..., M).

        Each unknown costs what a coordinate that may be anywhere costs more than one
        that is known: so many coordinates of tracks determine the motion, and are not
        explained by it. Those of the geometry are known but for the noise, those of the
        map along the line but for the parallax.
        """
        return self.costs_of_geometry(views) + MAP_UNKNOWNS * _known(
            views, self.parallax
        )

    def lengths(self, views, shares, log_densities):
        """Nats (..., M) of motions, and of where their shares (..., M, n) are."""
        return self.costs(views) - (shares * log_densities).sum(axis=-1)

    def costs_of_geometry(self, views):
        """The part of them, (..., M), that motions of one geometry pay once."""
        return self.n_unknowns * _known(views, self.noise)


def _known(views, widths):
    """Nats that a coordinate tells that is known but for so much, at least 1."""
    certain = np.log(views.side / np.sqrt(2 * np.pi * np.e))
    return np.maximum(_of_pairs(certain) - np.log(widths), 1)


def _of_pairs(values):
    """A value per pair of images (...), to go with one per motion (..., M)."""
    return np.asarray(values)[..., None]


def log_student(squares, scale, dimension=1):
    """Log density of Student's t, of given squared distances (..., n) from its middle.

    Parameters
    ----------
    squares : ndarray of shape (..., M, n)
    scale : ndarray of shape (..., M)
    dimension : int, default=1

    Returns
    -------
    ndarray of shape (..., M, n)
    """
    half = (FREEDOM + dimension) / 2
    constant = float(gammaln(half) - gammaln(FREEDOM / 2))
    constant -= dimension / 2 * np.log(FREEDOM * np.pi)
    # Not log1p, which on many processors is not vectorised and takes up to eight times
    # as long: digits that the sum loses are of 1e-16 nats, or 1e-7 in single precision.
    logarithms = squares * (1 / (FREEDOM * scale**2))[..., None]
    logarithms += 1
    np.log(logarithms, out=logarithms)
    logarithms *= -half
    logarithms += (constant - dimension * np.log(scale))[..., None]
    return logarithms


def _weights(squares, scale):
    """Weights of squares (..., M, n) in the likelihood equations of Student's t."""
    return (FREEDOM + 1) / (FREEDOM + squares / scale[..., None] ** 2)


def squared_distances(fundamental, affine, views):
    """Squared distances of tracks across and along the epipolar lines of motions.

    Parameters
    ----------
    fundamental : ndarray of shape (..., M, 3, 3)
    affine : ndarray of shape (..., M, 3, 2)
    views : TwoViews

    Returns
    -------
    across : ndarray of shape (..., M, n)
        Squared Sampson errors (Hartley and Zisserman 2004, eq. 11.9).
    along : ndarray of shape (..., M, n)
        Squared distances from where the affine map takes the track, parallel to the
        epipolar line in the second image.
    gradient : ndarray of shape (..., M, n)
        Squared gradient of the epipolar equation.
    """
    # Coordinates before tracks: sums over two or three neighbours in memory are slow.
    x, y = (_transposed(places)[..., None, :, :] for places in (views.x, views.y))
    u, v = y[..., 0, :], y[..., 1, :]  # (..., 1, n)
    a, b, c = _rows(fundamental @ x)
    d, e, _ = _rows(_transposed(fundamental) @ y)
    normal = a**2 + b**2
    gradient = np.maximum(normal + d**2 + e**2, TINY)
    across = (u * a + v * b + c) ** 2 / gradient
    right, down = _rows(y[..., :2, :] - _transposed(affine) @ x)
    along = a * down - b * right
    return across, along**2 / np.maximum(normal, TINY), gradient


def _transposed(matrices):
    return matrices.swapaxes(-1, -2)


def _rows(matrices):
    """Yield the rows (..., M, n) of matrices (..., M, k, n)."""
    return (matrices[..., k, :] for k in range(matrices.shape[-2]))


# ---------------------------------------------------------------------------- fitting


def fit_two_view_motions(views, shares, before=None, common_noise=True):
    """Fit motions to the shares that they have in the tracks.

    A step of the EM algorithm for mixtures of t distributions (Peel and McLachlan 2000)
    from the motions as they were. Each is fitted with the epipolar geometry of an
    affine and of a perspective camera, and keeps the one of lower cost.

    Parameters
    ----------
    views : TwoViews
    shares : ndarray of shape (..., M, n)
        Probabilities that a track follows a motion.
    before : TwoViewMotions, optional
        None begins with equal weights of the tracks.
    common_noise : bool, default=True
        Whether the noise of each motion is drawn to that of all.

    Returns
    -------
    TwoViewMotions
    """
    if before is None:
        before = _begin(views, shares)
    weighted = _weighted(views, shares, before)
    found = [
        _step(views, shares, weighted, fit, n_unknowns, common_noise)
        for fit, n_unknowns in GEOMETRIES
    ]
    lengths = [
        each.lengths(views, shares, each.log_densities_at(*distances))
        for each, distances in found
    ]
    (affine, _), (perspective, _) = found
    better = lengths[1] < lengths[0]
    better &= shares.sum(axis=-1) >= FEWEST_FOR_PERSPECTIVE
    return affine.replaced(better, perspective)


def fit_common_geometry(views, shares, before, rounds):
    """Fit the surfaces of one motion: a map along the lines each, and one geometry.

    Parameters
    ----------
    views : TwoViews
    shares : ndarray of shape (M, n)
        Probabilities that a track is of a surface.
    before : TwoViewMotions
        The surfaces as motions of their own.
    rounds : int
        Steps of the EM algorithm.

    Returns
    -------
    TwoViewMotions
        With the same fundamental matrix, noise and unknowns: those of an affine or a
        perspective camera, whichever cost less.
    """
    everywhere = np.full(len(shares), before.noise.max())
    geometry = _affine_geometries(views, _pooled(shares))
    geometry = np.broadcast_to(geometry, before.fundamental.shape)
    begin = replace(before, fundamental=geometry, noise=everywhere)
    found = []
    for fit, n_unknowns in GEOMETRIES:
        motions = begin
        for _ in range(rounds):
            weighted = _weighted(views, shares, motions)
            motions, _ = _step(views, shares, weighted, fit, n_unknowns, False, _pooled)
        found.append(motions)
    return min(found, key=lambda motions: cost_of_surfaces(views, shares, motions))


def cost_of_surfaces(views, shares, motions):
    """Nats of a motion of several surfaces, and of where their tracks are."""
    n_more = len(motions) - 1
    twice = n_more * motions.costs_of_geometry(views)[0]
    places = (shares * motions.log_densities(views)).sum()
    return float(motions.costs(views).sum() - twice - places)


def _begin(views, shares):
    """Motions of affine cameras, their densities wide."""
    fundamental, affine = _affine_geometries(views, shares), _maps(views, shares)
    _, along, _ = squared_distances(fundamental, affine, views)
    return TwoViewMotions(
        fundamental,
        affine,
        np.ones(shares.shape[:-1]) * _of_pairs(MOST_NOISE * NOISE * views.pixel),
        _parallax(views, shares, along),
        np.full(shares.shape[:-1], AFFINE_UNKNOWNS),
    )


def _each(rows):
    """Rows (..., M, n) of motions of their own."""
    return rows


def _pooled(rows):
    """The sum of rows (..., M, n), as one row: of motions that are one."""
    return rows.sum(axis=-2, keepdims=True)


class _Weighted(NamedTuple):
    """What motions are fitted to: weights and gradients (..., M, n) of the tracks.

    And the maps (..., M, 3, 2) along the lines, which are the same for any geometry.
    """

    before: TwoViewMotions
    weights: np.ndarray
    gradient: np.ndarray
    affine: np.ndarray


def _weighted(views, shares, before):
    """The tracks as motions weigh them."""
    across, along, gradient = squared_distances(
        before.fundamental, before.affine, views
    )
    weights = shares * _weights(across, before.noise)
    affine = _maps(views, shares * _weights(along, before.parallax))
    return _Weighted(before, weights, gradient, affine)


def _step(views, shares, weighted, fit, n_unknowns, common_noise, pool=_each):
    """Motions whose geometry is fitted by a function, and squared distances."""
    before, affine = weighted.before, weighted.affine
    weights = pool(weighted.weights)
    # One geometry is fitted once: rows of a product of matrices that should be equal
    # need not be, to the last bit, on every processor.
    n_fitted = weights.shape[-2]
    fundamental = fit(views, weights, weighted.gradient[..., :n_fitted, :])
    fundamental = np.broadcast_to(fundamental, before.fundamental.shape)
    across, along, _ = squared_distances(fundamental, affine, views)
    squares = pool(shares * _weights(across, before.noise) * across)
    noise = _noise(views, pool(shares), squares, n_unknowns, common_noise)
    noise = np.broadcast_to(noise, shares.shape[:-1])
    squares = _weights(along, before.parallax) * along
    parallax = np.maximum(_parallax(views, shares, squares), noise)
    kinds = np.full(shares.shape[:-1], n_unknowns)
    motions = TwoViewMotions(fundamental, affine, noise, parallax, kinds)
    return motions, (across, along)


def _noise(views, shares, squares, n_unknowns, common_noise):
    """Widths across the lines, (..., M), from weighted squares (..., M, n)."""
    pixel = _of_pairs(views.pixel)
    sums, members = squares.sum(axis=-1), shares.sum(axis=-1)
    prior, weight = NOISE * pixel, 2.0
    if common_noise:
        n_motions = np.count_nonzero(members, axis=-1, keepdims=True)
        freedom = members.sum(axis=-1, keepdims=True) - n_unknowns * n_motions
        freedom = np.maximum(freedom, 0) + TRACKS_OF_NOISE
        total = sums.sum(axis=-1, keepdims=True) + TRACKS_OF_NOISE * prior**2
        prior, weight = np.sqrt(total / freedom), TRACKS_OF_COMMON_NOISE
    freedom = np.maximum(members - n_unknowns + weight, 1)
    noise = np.sqrt((sums + weight * prior**2) / freedom)
    return np.clip(noise, LEAST_NOISE * pixel, MOST_NOISE * NOISE * pixel)


def _parallax(views, shares, squares):
    """Widths along the lines, (..., M), from weighted squares (..., M, n)."""
    expected = TRACKS_OF_PARALLAX * (PARALLAX * _of_pairs(views.side)) ** 2
    freedom = shares.sum(axis=-1) - MAP_UNKNOWNS + TRACKS_OF_PARALLAX
    variance = ((shares * squares).sum(axis=-1) + expected) / np.maximum(freedom, 1)
    return np.maximum(np.sqrt(variance), LEAST_NOISE * _of_pairs(views.pixel))


def _summed(weights, products, *shape):
    """Products (..., n, k) summed with weights (..., M, n), as matrices of a shape."""
    return (weights @ products).reshape(*weights.shape[:-1], *shape)


def _trace(matrices):
    return np.trace(matrices, axis1=-2, axis2=-1)[..., None, None]


def _maps(views, weights):
    """Affine maps (..., M, 3, 2) of least squared error."""
    places = _summed(weights, views.places, 3, 3)
    moves = _summed(weights, views.moves, 3, 2)
    trace = _trace(places)
    return np.linalg.solve(places + (1e-7 * trace + SINGULAR) * np.eye(3), moves)


def _affine_geometries(views, weights, gradient=None):
    """Fundamental matrices of affine cameras: planes through the joint places.

    Hartley and Zisserman 2004, algorithm 14.1, with weights.
    """
    moments = _summed(weights, views.joint, 5, 5)
    total = moments[..., 4, 4] + SINGULAR
    mean = moments[..., :4, 4] / total[..., None]
    scatter = moments[..., :4, :4] / total[..., None, None]
    scatter -= mean[..., :, None] * mean[..., None, :]
    normal = np.linalg.eigh(scatter)[1][..., 0]  # (..., M, 4)
    fundamental = np.zeros((*total.shape, 3, 3))
    fundamental[..., 2, :2] = normal[..., :2]
    fundamental[..., :2, 2] = normal[..., 2:]
    fundamental[..., 2, 2] = -(normal * mean).sum(axis=-1)
    return fundamental


def _perspective_geometries(views, weights, gradient):
    """Fundamental matrices (..., M, 3, 3) of least weighted Sampson error."""
    least = 1e-6 * gradient.max(axis=-1, keepdims=True)
    weights = weights / np.maximum(gradient, least)
    weights /= weights.max(axis=-1, keepdims=True) + TINY
    moments = _summed(weights, views.equations, 9, 9)
    inverse = np.linalg.inv(moments / (_trace(moments) + TINY) + SINGULAR * np.eye(9))
    found = cheapest_rank_two(inverse.reshape(-1, 9, 9))
    return found.reshape(*weights.shape[:-1], 3, 3)


# What is fitted, and how many unknowns it has.
GEOMETRIES = (
    (_affine_geometries, AFFINE_UNKNOWNS),
    (_perspective_geometries, PERSPECTIVE_UNKNOWNS),
)
