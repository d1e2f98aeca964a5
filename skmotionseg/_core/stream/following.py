"""Which tracks of a stream decide on a motion, and which may follow it."""

from __future__ import annotations

import numpy as np

from ..geometry.coverage import Neighbours
from .births import LEAST_FREEDOM, UNEXPLAINED
from .buffer import UNKNOWN
from .window import FEWEST_TRACKS

# Outliers are above so many deviations from their motion, and these times remoteness
# from their neighbours is above: noise of trackers drifts, so that deviations do not
# say enough alone. In simulated streams 0.3 % of the tracks and 53 % of the outliers
# are, by a limit of 4 deviations 0.5 and 57 %; in clips filmed from cars, a seventh.
OUTLYING, STRANGE = 3.0, 16.0
# Tracks that a motion has explained before which tell that it is bent, and which
# determine it whatever else follows it.
FEWEST_HELD, FIRM = 6, 10


def groups_of(buffer, motions):
    """Rows of the tracks of each living motion, without outliers.

    Parameters
    ----------
    buffer : TrackBuffer
    motions : list of LivingMotion

    Returns
    -------
    list of ndarray of int
    """
    labels = np.where(buffer.outlying, UNKNOWN, buffer.labels)
    return [np.flatnonzero(labels == motion.number) for motion in motions]


def fitted_groups(buffer, motions):
    """Rows of the tracks to which each living motion is fitted.

    What follows it only because nothing else explains it does not bend it, as long as
    half of its tracks are explained. Tracks that it has never explained do not, either;
    but they do belong to the static scene, whose place nothing takes.
    """
    found = []
    for motion, rows in zip(motions, groups_of(buffer, motions), strict=True):
        rows = rows if motion.number == 0 else rows[buffer.held[rows]]
        explained = rows[~buffer.doubtful[rows]]
        found.append(explained if 2 * len(explained) >= len(rows) else rows)
    return found


def newly_held(buffer, motions, judged):
    """Tracks that the motion which they follow explains, as far as it can tell.

    What takes the place of a motion that leaves would bend it, and have its number. So
    one that has few tracks left takes no more new ones at a time than it has. One that
    no longer explains most of those that it did explain is bent itself, and what it
    does not explain says nothing; the static scene is where most tracks are, anyway.

    Parameters
    ----------
    buffer : TrackBuffer
    motions : list of LivingMotion
    judged : ndarray of bool, shape (n,)
        Tracks in the newest frame that can be judged.

    Returns
    -------
    ndarray of bool, shape (n,)
    """
    columns = columns_of(buffer.labels, motions)
    known = judged & (columns >= 0)
    explained = known & ~buffer.doubtful

    def count(some):
        return np.bincount(columns[known & some], minlength=len(motions))

    before, still = count(buffer.held), count(buffer.held & explained)
    scene = np.array([motion.number == 0 for motion in motions])
    firm = still >= np.clip(count(~buffer.held), FEWEST_TRACKS, FIRM)
    bent = (before >= FEWEST_HELD) & (2 * still < before)
    bent |= scene & (still < FEWEST_TRACKS)
    return known & np.where(firm[columns], explained, bent[columns])


def columns_of(labels, motions):
    """Which living motion each track follows, int, (n,); -1 for none."""
    columns = np.full(len(labels), UNKNOWN)
    for k, motion in enumerate(motions):
        columns[labels == motion.number] = k
    return columns


def may_join(residuals, columns, motions):
    """Which tracks may follow which motions.

    Parameters
    ----------
    residuals : Residuals
    columns : ndarray of int, shape (n,)
        As of :func:`columns_of`.
    motions : list of LivingMotion

    Returns
    -------
    ndarray of bool, shape (n, M)
        To those that are closed come only tracks that no other explains.
    """
    closed = np.array([motion.is_closed for motion in motions])
    if closed.all():
        return np.ones((len(columns), len(closed)), dtype=bool)
    deviations = residuals.usual()[:, ~closed]
    lost = ~(deviations < UNEXPLAINED).any(axis=1)
    own = columns[:, None] == np.arange(len(closed))
    return ~closed | own | lost[:, None]


def can_be_told(window, residuals, labels, columns, shares):
    """Which tracks can be told to follow a living motion.

    What is too young to be judged, and has no neighbours, follows nothing. What
    followed a motion that is hidden does so until another one explains it.

    Parameters
    ----------
    window : Window
    residuals : Residuals
    labels, columns : ndarray of int, shape (n,)
        Number and living motion of each track.
    shares : ndarray of shape (n, M)
        Of its neighbours.

    Returns
    -------
    ndarray of bool, shape (n,)
    """
    judged = window.freedom >= LEAST_FREEDOM
    explained = (residuals.deviations() < UNEXPLAINED).any(axis=1) & judged
    hidden = (labels > UNKNOWN) & (columns < 0)
    known = (window.freedom > 0) | shares.any(axis=1) | (columns >= 0)
    return np.where(hidden, explained, known)


def are_doubtful(window, deviations):
    """Which tracks their own motion does not explain, as far as they can be judged.

    Parameters
    ----------
    window : Window
    deviations : ndarray of shape (n,)
        From their own motions, in scales; NaN where unknown.

    Returns
    -------
    ndarray of bool, shape (n,)
    """
    return (deviations > UNEXPLAINED) & (window.freedom >= LEAST_FREEDOM)


def are_outliers(buffer, deviations):
    """Which tracks neither follow their own motion nor go with their neighbours.

    Parameters
    ----------
    buffer : TrackBuffer
    deviations : ndarray of shape (n,)
        From their own motions, in units of what is usual; NaN where unknown.

    Returns
    -------
    ndarray of bool, shape (n,)
    """
    outlying = deviations > OUTLYING
    if outlying.any():
        neighbours = Neighbours(buffer.points, buffer.seen)
        remote = neighbours.remoteness(buffer.points[outlying], buffer.seen[outlying])
        outlying[outlying] = deviations[outlying] * remote > STRANGE
    return outlying
