"""What a segmentation of two images costs, in nats, and the nearest one of least cost.

The cost is a description length: for each track, where its point of the second image
is, given its motion, or anywhere if it is a mismatch; which motion it has, given how
many tracks have it, and that neighbours mostly have the same (a Potts term); and the
unknowns of each motion. From motions and labels, the least cost nearby is reached by
turns, labels given the motions and motions given the labels (Isack and Boykov 2012,
"Energy-based geometric multi-model fitting", there with graph cuts).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array
from scipy.spatial import KDTree

from ..geometry.two_views import TwoViewMotions, TwoViews, fit_two_view_motions

# Neighbours of a track in the joint space of its places in both images, and the nats
# that it costs to differ from all of them.
N_NEIGHBOURS = 8
NATS_OF_NEIGHBOURS = 2.0
# Links fall with the distance, in units of the median distance of this neighbour:
# mismatches are far from all others.
USUAL_NEIGHBOUR = 5
# Nats of a motion beside its unknowns: there are many places to look for one. On
# simulated pairs of images, 5 give spurious motions.
NATS_OF_MOTION = 10.0
# Tracks of the smallest motion.
FEWEST_TRACKS = 4
# Rounds of labels among each other, given the motions; and of both by turns.
ROUNDS_OF_LABELS, ROUNDS = 4, 6
# A cost that falls by less, in nats, is the least.
SMALL_FALL = 0.05
# Pixels, of an image of 640 x 480, that what rests is from its place at most.
RESTING = 2.0


class Scene(NamedTuple):
    """Tracks of two images and who is whose neighbour.

    Attributes
    ----------
    views : TwoViews
    nearest : ndarray of int, shape (n, k)
        Neighbours in the joint space of both images, the nearest first.
    links : csr_array of shape (n, n)
        Symmetric; a track is linked to its neighbours by up to 1 in all.
    """

    views: TwoViews
    nearest: np.ndarray
    links: csr_array


class Segmentation(NamedTuple):
    """Motions, the tracks that have them, and what both cost.

    Attributes
    ----------
    cost, data_cost : float
        Nats in all, and those of the places of the tracks.
    motions : TwoViewMotions
    shares : ndarray of shape (M + 1, n)
        Probabilities of the motions; the last row is that of a mismatch.
    labels : ndarray of int, shape (n,)
        ``0..M``, of which M is a mismatch.
    """

    cost: float
    data_cost: float
    motions: TwoViewMotions
    shares: np.ndarray
    labels: np.ndarray


def two_view_scene(views, n_nearest):
    """Find the neighbours of each track.

    Parameters
    ----------
    views : TwoViews
    n_nearest : int

    Returns
    -------
    Scene
    """
    n = len(views)
    joint = np.concatenate([views.x[:, :2], views.y[:, :2]], axis=1)
    distances, nearest = KDTree(joint).query(joint, min(n_nearest + 1, n))
    k = min(N_NEIGHBOURS, n - 1)
    usual = np.median(distances[:, min(USUAL_NEIGHBOUR, n - 1)]) + 1e-12
    weights = np.exp(-0.5 * (distances[:, 1 : k + 1] / usual) ** 2) / k
    rows = np.repeat(np.arange(n), k)
    columns = nearest[:, 1 : k + 1].ravel()
    links = csr_array((weights.ravel(), (rows, columns)), shape=(n, n))
    return Scene(views, nearest[:, 1:], csr_array((links + links.T) / 2))


def best_log_densities(scene, motions):
    """Log density of each track by the motion that explains it best, (n,).

    Or that of a mismatch, where that is higher.
    """
    if len(motions) == 0:
        return np.full(len(scene.views), scene.views.log_density_of_mismatches)
    return motions.with_mismatches(scene.views).max(axis=0)


def assign(scene, motions, shares=None):
    """Probabilities of motions by mean field, and log densities.

    Parameters
    ----------
    scene : Scene
    motions : TwoViewMotions
    shares : ndarray of shape (M + 1, n), optional
        To begin from. None begins with every second track a mismatch, all motions
        alike.

    Returns
    -------
    shares, log_densities : ndarray of shape (M + 1, n)
        The last row is of mismatches.
    """
    n_motions = len(motions)
    densities = motions.with_mismatches(scene.views)
    if shares is None:
        first = np.append(np.full(n_motions, 0.5 / n_motions), 0.5)
        shares = normalized(densities + np.log(first)[:, None])
    for _ in range(ROUNDS_OF_LABELS):
        near = NATS_OF_NEIGHBOURS * (scene.links @ shares.T).T
        shares = normalized(densities + log_shares(shares)[:, None] + near)
    return shares, densities


def log_shares(shares):
    """Logarithms (M + 1,) of the shares that motions have in all tracks.

    Parameters
    ----------
    shares : ndarray of shape (M + 1, n)
        Probabilities of the motions, the last row that of a mismatch. As if each had
        one track more.
    """
    return np.log((shares.sum(axis=1) + 1) / sum(shares.shape))


def normalized(logarithms):
    """Probabilities (M + 1, n) from logarithms that lack a constant per track."""
    shares = np.exp(logarithms - logarithms.max(axis=0))
    return shares / shares.sum(axis=0)


def judged(scene, motions, shares, densities):
    """The segmentation into the most probable labels, with its cost.

    Parameters
    ----------
    scene : Scene
    motions : TwoViewMotions
    shares, densities : ndarray of shape (M + 1, n)

    Returns
    -------
    Segmentation
    """
    n = shares.shape[1]
    labels = shares.argmax(axis=0)
    data = -densities[labels, np.arange(n)].sum()
    names = nats_of_labels(labels, len(shares))
    rows, columns = scene.links.nonzero()
    apart = labels[rows] != labels[columns]
    cut = NATS_OF_NEIGHBOURS / 2 * scene.links.data[apart].sum()
    unknowns = motions.costs(scene.views).sum() + NATS_OF_MOTION * len(motions)
    total = float(data + names + cut + unknowns)
    return Segmentation(total, float(data), motions, shares, labels)


def nats_of_labels(labels, n_labels):
    """Nats that labels (n,) tell, given how many tracks have each."""
    counts = np.bincount(labels, minlength=n_labels)
    return -(counts * np.log((counts + 1) / (len(labels) + n_labels))).sum()


def settle(scene, motions, shares=None, rounds=ROUNDS):
    """The segmentation of least cost near given motions.

    Parameters
    ----------
    scene : Scene
    motions : TwoViewMotions
    shares : ndarray of shape (M + 1, n), optional
        To fit the motions to anew at first; None assigns the tracks to them.
    rounds : int

    Returns
    -------
    Segmentation or None
        Of fewer motions, if some lose their tracks; None if all do.
    """
    best = None
    if shares is None:
        shares, _ = assign(scene, motions)
    else:
        motions = fit_two_view_motions(scene.views, shares[:-1])
    for done in range(rounds):
        motions = fit_two_view_motions(scene.views, shares[:-1], motions)
        shares, densities = assign(scene, motions, shares)
        members = np.bincount(shares.argmax(axis=0), minlength=len(shares))[:-1]
        kept = members >= FEWEST_TRACKS
        if not kept.any():
            break
        if not kept.all():
            motions = motions[kept]
            shares, densities = assign(scene, motions)
        found = judged(scene, motions, shares, densities)
        if best is None or len(motions) < len(best.motions):
            best = found
            continue
        fall = best.cost - found.cost
        best = found if fall > 0 else best
        if fall < SMALL_FALL and done > 1:
            break
    return best
