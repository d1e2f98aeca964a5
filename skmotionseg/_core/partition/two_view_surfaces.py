"""Surfaces of one motion between two images.

A motion as it is searched for takes its points, along the epipolar lines, near to where
one affine map takes them. Of a street, the ground and the facades are then cheaper as
several: each has a map of its own. But they have one epipolar geometry, which then
needs to be told only once, and where they meet, tracks go the same way. So what is
found are surfaces, and those that meet are joined to one motion if that costs less.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..geometry.two_views import TwoViewMotions, cost_of_surfaces, fit_common_geometry
from .two_view_energy import NATS_OF_MOTION, RESTING, Scene, Segmentation

# Links between two surfaces from which on they meet: a quarter of those of a track. In
# simulated pairs of images, things that move apart have next to none.
FEWEST_LINKS = 0.25
# How many times as far from its place what rests is, at most, as by its affine map; and
# how many times as far what moves is, at least.
AS_WELL, MOVES = 1.5, 4.0
# Steps in which a common geometry is fitted.
ROUNDS = 6


class Surfaces(NamedTuple):
    """A segmentation into surfaces, and the motion that each has.

    Attributes
    ----------
    cost, data_cost : float
        Nats in all, and those of the places of the tracks.
    motions : TwoViewMotions
        Of each surface; the geometry of those of one motion is the same.
    shares : ndarray of shape (S + 1, n)
        Probabilities of the surfaces; the last row is that of a mismatch.
    labels : ndarray of int, shape (n,)
        ``0..S``, of which S is a mismatch.
    motion_of : ndarray of int, shape (S,)
        ``0..M - 1``.
    """

    cost: float
    data_cost: float
    motions: TwoViewMotions
    shares: np.ndarray
    labels: np.ndarray
    motion_of: np.ndarray

    @property
    def n_motions(self):
        return int(self.motion_of.max()) + 1

    @property
    def shares_of_motions(self):
        """Probabilities (M, n) of the motions."""
        shares = np.zeros((self.n_motions, self.shares.shape[1]))
        np.add.at(shares, self.motion_of, self.shares[:-1])
        return shares


def with_fewer_motions(scene: Scene, found: Segmentation):
    """Yield a segmentation, each surface a motion, and with ever more of them joined.

    Parameters
    ----------
    scene : Scene
    found : Segmentation

    Yields
    ------
    Surfaces
        Of one motion less each time, as long as that costs less.
    """
    now = Surfaces(*found, np.arange(len(found.motions)))
    links = _links_between(scene, found)
    if scene.views.at_rest is not None:
        links = np.where(_one_rests(scene.views, found), -np.inf, links)
    joints: dict[bytes, _Joint] = {}
    while True:
        yield now
        tried = [
            _joined(scene, now, i, j, joints)
            for i in range(now.n_motions)
            for j in range(i)
            if _linked(links, now.motion_of, i, j) >= FEWEST_LINKS
        ]
        best = min(tried, key=_cost_of, default=now)
        if not best.cost < now.cost:
            return
        now = best


def _links_between(scene, found):
    """Links (S, S) between the tracks of each two surfaces."""
    of_surface = np.eye(len(found.motions) + 1)[found.labels]
    return (of_surface.T @ (scene.links @ of_surface))[:-1, :-1]


def _one_rests(views, found):
    """Whether one of each two surfaces (S, S) rests in the images, and one moves.

    No motion of a camera gives both, but of a scene at infinity before a camera that
    goes straight on. A surface rests if that explains its tracks as well as its affine
    map does.
    """
    moved, apart = np.zeros((2, len(found.motions)))
    for k, affine in enumerate(found.motions.affine):
        tracks = np.flatnonzero(found.labels == k)
        if len(tracks):
            gaps = views.y[tracks, :2] - views.x[tracks] @ affine
            moved[k] = np.median(views.moved[tracks])
            apart[k] = np.median(np.hypot(*gaps.T)) / views.pixel
    rests = (moved <= AS_WELL * apart) & (moved <= RESTING)
    beside = rests & (moved[:, None] > MOVES * moved)
    return beside | beside.T


def _linked(links, motion_of, i, j):
    return links[np.ix_(motion_of == i, motion_of == j)].sum()


class _Joint(NamedTuple):
    """Surfaces of one motion, and what that saves and costs more in their places."""

    motions: TwoViewMotions
    saved: float
    places: float


def _joined(scene, now, i, j, joints):
    """The same with two motions made one, of their common geometry.

    What was fitted before, to the same surfaces, is in ``joints``.
    """
    parts = [np.flatnonzero(now.motion_of == motion) for motion in (i, j)]
    both = np.sort(np.concatenate(parts))
    key = both.tobytes()
    if key not in joints:
        joints[key] = _joint(scene.views, now, parts, both)
    joint = joints[key]
    motion_of = np.where(now.motion_of == i, j, now.motion_of)
    return now._replace(
        cost=now.cost - joint.saved,
        data_cost=now.data_cost + joint.places,
        motions=now.motions.with_rows(both, joint.motions),
        motion_of=motion_of - (motion_of > i),
    )


def _joint(views, now, parts, both):
    """The :class:`_Joint` of the surfaces of two motions."""
    shares = now.shares[both]
    joint = fit_common_geometry(views, shares, now.motions[both], ROUNDS)
    places = -(shares * joint.log_densities(views)).sum()
    places += (shares * now.motions[both].log_densities(views)).sum()
    saved = NATS_OF_MOTION - cost_of_surfaces(views, shares, joint)
    for part in parts:
        saved += cost_of_surfaces(views, now.shares[part], now.motions[part])
    return _Joint(joint, saved, float(places))


def _cost_of(found):
    return found.cost
