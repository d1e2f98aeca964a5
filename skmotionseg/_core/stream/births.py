"""Motions that nobody follows yet: found among tracks that no motion explains."""

from __future__ import annotations

from functools import partial

import numpy as np
from scipy.spatial import KDTree

from ..geometry.camera import LEAST_NOISE, REFERENCE_WIDTH
from ..geometry.joint_depths import infinitely_far
from .assignment import measure, noise_of

# Tracks are unexplained above so many scales, if they have enough residuals to tell.
UNEXPLAINED, LEAST_FREEDOM = 2.0, 5
# Groups of neighbours that motions are fitted to, and tracks of each.
N_SEEDS, TRACKS_PER_SEED = 5, 10
# Tracks that make a motion, and nats that it saves, per track and in all.
FEWEST_MEMBERS, NATS_PER_TRACK, LEAST_SAVED = 6, 3.0, 60.0
# Times that a candidate is fitted to the tracks that it explains.
ROUNDS = 2
# Tracks of each of two motions that a joint one is fitted to.
JOINTLY = 20
# Residuals that say as much as one that is independent: noise of trackers drifts.
ALIKE_IN_TIME = 2.0
# Deviations, in pixels of a video 640 pixels wide, below which all are alike.
ALIKE = 0.1
# How clearly a motion has to place one of two groups at infinity, and one not, above
# which it does not explain both.
FAR = 0.7
# Neighbours in the picture, and links between two groups over those that chance would
# give above which they are in one place.
N_NEIGHBOURS, MIXED = 6, 0.5


def find_candidate(window, residuals, chosen, points, seen_now, rng):
    """A motion of tracks that no living motion explains.

    Parameters
    ----------
    window : Window
    residuals : Residuals
        From the living motions.
    chosen : ndarray of int, shape (n,)
        Motion of each track.
    points : ndarray of shape (n, 2)
        Newest positions, pixels.
    seen_now : ndarray of bool, shape (n,)
    rng : RandomState

    Returns
    -------
    fit : Fit or None
    members : ndarray of int
        Tracks that it explains much better than their own motions.
    """
    judged = seen_now & (window.freedom >= LEAST_FREEDOM)
    own = np.take_along_axis(residuals.usual(), chosen[:, None], axis=1)[:, 0]
    lost = np.flatnonzero(judged & ~(own < UNEXPLAINED))
    nothing = None, lost[:0]
    if len(lost) < FEWEST_MEMBERS:
        return nothing
    fits = [fit for fit in window.fit(_neighbourhoods(points[lost], lost, rng)) if fit]
    rows = np.flatnonzero(judged)
    costs = np.take_along_axis(residuals.nats, chosen[:, None], axis=1)[rows, 0]
    for _ in range(ROUNDS):
        fit, members, _ = _best(window, fits, residuals.scale, rows, costs)
        fits = [fit for fit in window.fit([members], [fit]) if fit] if fit else []
    fit, members, saved = _best(window, fits, residuals.scale, rows, costs)
    return (fit, members) if saved >= LEAST_SAVED else nothing


def joint_motions(window, scale, pairs):
    """One motion for the tracks of two, and what two motions save, for some pairs.

    Parameters
    ----------
    window : Window
    scale : float
    pairs : list of ((Fit, Fit), (ndarray of int, ndarray of int))
        Motions and their tracks.

    Returns
    -------
    list of (Fit or None, float, float)
        What can be refined from either to some tracks of both; if two motions are
        better, also what is fitted from the start. And nats by which two motions
        describe the tracks of both groups in fewer words, the numbers of the second
        motion included. And how much worse the joint motion explains the tracks of
        one group, or of the other: the larger median of the logarithm of the ratio of
        squared deviations. Both are infinite if there is no fit, or one with one of the
        groups at infinity.
    """
    some = [
        np.sort(np.concatenate([_spread(rows) for rows in groups]))
        for _, groups in pairs
    ]
    twice = [rows for rows in some for _ in range(2)]
    refined = window.fit(twice, [fit for fits, _ in pairs for fit in fits])
    fitted = list(zip(refined[::2], refined[1::2], strict=True))
    found = [
        _of_both(window, scale, pair, rows, fits)
        for pair, rows, fits in zip(pairs, some, fitted, strict=True)
    ]
    apart = [k for k, (_, saved, _) in enumerate(found) if saved > 0]
    for k, fit in zip(apart, window.fit([some[k] for k in apart]), strict=True):
        found[k] = _of_both(window, scale, pairs[k], some[k], (*fitted[k], fit))
    return found


def _of_both(window, scale, pair, some, found):
    """The best of the motions found for two groups, and how much better two are."""
    fits, groups = pair
    found = [fit for fit in found if fit]
    if not found:
        return None, np.inf, np.inf
    own = list(zip(fits, groups, strict=True))
    # Each track is its own measure here, however fast it is.
    measured = partial(measure, window, relative=False)
    deviations = [measured([fit], scale, rows).deviations() for fit, rows in own]
    scale = scale * max(noise_of(each[:, 0]) for each in deviations)
    costs = measured(found, scale, some).nats.sum(axis=0)
    best = found[int(costs.argmin())]
    if is_at_infinity(window, scale, best, groups):
        return best, np.inf, np.inf
    both = np.concatenate(groups)
    saved, worse = measured([best], scale, both, [both]).nats.sum(), []
    for fit, rows in own:
        alone = measured([fit], scale, rows, [rows])
        saved -= alone.nats.sum()
        jointly = _log_squares(window, measured([best], scale, rows))
        ratios = jointly - _log_squares(window, alone)
        known = ratios[np.isfinite(ratios)]
        worse.append(np.median(known) if len(known) else np.inf)
    price = window.own_numbers(fits[1]) / 2 * np.log(max(window.freedom[both].sum(), 1))
    return best, float(saved - ALIKE_IN_TIME * price), float(max(worse))


def are_mixed(points, groups):
    """Whether tracks of two groups are in one place of the picture.

    Parameters
    ----------
    points : ndarray of shape (n, 2)
        Of all tracks that are seen.
    groups : pair of ndarray of int
        Among them.

    Returns
    -------
    bool
        Parts of a thing that were taken apart by chance are mixed; things are beside
        each other.
    """
    first, second = (np.isin(np.arange(len(points)), rows) for rows in groups)
    near = nearest_in_picture(points, np.arange(len(points)))
    links = second[near[first]].sum() + first[near[second]].sum()
    chance = 2 * near.shape[1] * first.sum() * second.sum() / len(points)
    return links > MIXED * chance


def nearest_in_picture(points, rows):
    """The neighbours (n_rows, k) of some of the points (n, 2) among all of them."""
    k = min(N_NEIGHBOURS + 1, len(points))
    _, near = KDTree(points).query(points[rows], k)
    return near.reshape(len(rows), k)[:, 1:]


def _spread(rows):
    return rows[np.linspace(0, len(rows) - 1, min(JOINTLY, len(rows))).astype(int)]


def apartness(window, residuals, column, rows=None):
    """How much worse tracks of a motion are explained by each of the others.

    Parameters
    ----------
    window : Window
    residuals : Residuals
    column : int
    rows : ndarray of int, optional
        Tracks of the motion; all if not given.

    Returns
    -------
    ndarray of shape (M,)
        Medians of the logarithm of the ratio of squared deviations: half of the tracks
        must tell the two apart. Infinite for the motion itself, and where no track
        says anything.
    """
    rows = slice(None) if rows is None else rows
    logs = _log_squares(window, residuals)[rows]
    worse = logs - logs[:, [column]]
    apart = np.full(worse.shape[1], np.inf)
    for other in np.flatnonzero(np.isfinite(worse).any(axis=0)):
        if other != column:
            apart[other] = np.nanmedian(worse[:, other])
    return apart


def _log_squares(window, residuals):
    """Logarithms of squared deviations (n, M), those that are small being alike."""
    alike = (ALIKE / REFERENCE_WIDTH * _share(window.camera)) ** 2
    # Squares are over variances, and so is the least of them that counts.
    alike = alike / residuals.variances[:, None]
    return np.log(residuals.squares / np.maximum(residuals.freedom, 1) + alike)


def is_at_infinity(window, scale, fit, groups):
    """Whether a motion explains two groups only with one of them at infinity.

    What stands still before a camera that only turns follows any motion, as if it were
    infinitely far.

    Parameters
    ----------
    window : Window
    scale : float
    fit : Fit
    groups : pair of ndarray of int

    Returns
    -------
    bool
    """
    placed = [window.inverse_depths(fit, rows) for rows in groups]
    depths = [depth[:, None] for depth, _ in placed]
    errors = [scale * error[:, None] for _, error in placed]
    return infinitely_far(depths, errors) > FAR


def _share(camera):
    """Calibrated units per width of the picture."""
    return camera.noise * REFERENCE_WIDTH / LEAST_NOISE


def _neighbourhoods(points, rows, rng):
    """Groups of tracks that are near each other: one about each of some."""
    k = min(TRACKS_PER_SEED, len(rows))
    some = rng.permutation(len(rows))[:N_SEEDS]
    _, near = KDTree(points).query(points[some], k)
    return [np.sort(rows[group]) for group in near.reshape(len(some), k)]


def _best(window, fits, scale, rows, costs):
    """Of some motions the one that saves most nats, its members, and what it saves."""
    if not fits:
        return None, rows[:0], 0.0
    measured = measure(window, fits, scale, rows)
    saved = costs[:, None] - measured.nats
    members = (saved > NATS_PER_TRACK) & (measured.deviations() < UNEXPLAINED)
    members &= members.sum(axis=0) >= FEWEST_MEMBERS
    total = np.where(members, saved, 0).sum(axis=0)
    best = int(total.argmax())
    if not members[:, best].any():
        return None, rows[:0], 0.0
    return fits[best], rows[members[:, best]], float(total[best])
