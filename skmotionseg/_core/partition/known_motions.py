"""Rigid motions that a search has fitted so far, by which other groups are explained.

A search asks for the motions of hundreds of groups that differ by a few tracks. A fit
may end at another optimum in each window, and of those that a search ends with, four in
ten are worse somewhere than what was fitted to another group. So what is known is never
lost: a fit starts with what explains its group best, window by window, and keeps that
where it ends with something worse.
"""

from __future__ import annotations

import numpy as np

from ..geometry.rigid_motion import nats_of_residuals
from ..geometry.windows import RigidMotion

# Nats per residual that a track costs at most, whatever its motion.
MOST_NATS = 3.0
# Nats per residual above which a motion does not explain a group, which is then fitted
# from several starts: about what residuals of 0.7 times the scale cost, of which the
# noise is half.
NATS_OF_EXPLAINED = 0.6
# Motions that there is room for at first.
FIRST_ROOM = 64


def nats_in_windows(windows, motion, scale, tracks=slice(None)):
    """Nats of tracks by a motion, window by window.

    Parameters
    ----------
    windows : Windows
    motion : RigidMotion
    scale : float
        Of residuals.
    tracks : ndarray of int, default=all

    Returns
    -------
    ndarray of shape (n_tracks, n_windows)
        The most that there are where the motion is not known; 0 where a track is seen
        too little.
    """
    freedom = windows.freedom[tracks]
    nats = nats_of_residuals(windows.relative_squares(motion, tracks), freedom, scale)
    most = MOST_NATS * freedom
    nats = np.where(np.isnan(nats), most, np.minimum(nats, most))
    return np.where(freedom > 0, nats, 0)


class KnownMotions:
    """Motions by one camera and scale, and what each track costs by them.

    Parameters
    ----------
    windows : Windows
        With the focal length that is in use.
    scale : float
        Of residuals.
    motions : iterable of RigidMotion
        To begin with.
    """

    def __init__(self, windows, scale, motions=()):
        self._windows, self._scale = windows, scale
        n_tracks, n_windows = windows.freedom.shape
        # Tracks come first, as the costs of a group's are summed for each fit.
        self._nats = np.empty((n_tracks, FIRST_ROOM, n_windows), dtype=np.float32)
        self._motions: list[RigidMotion] = []
        # By identity, which lasts as long as the motions above are kept.
        self._totals: dict[int, np.ndarray] = {}
        self._add(motions)

    def nats(self, motion):
        """Nats (n_tracks,) of all tracks by a motion, known or not."""
        if id(motion) in self._totals:
            return self._totals[id(motion)]
        return nats_in_windows(self._windows, motion, self._scale).sum(axis=1)

    def found(self, fits):
        """The motions of several :class:`FitRequest`, which are known from then on.

        Parameters
        ----------
        fits : list of FitRequest

        Returns
        -------
        list of RigidMotion
            In no window worse, for all of its group, than a motion known before.
        """
        self._add(start for fit in fits for start in fit.starts)
        known = [self._best_for(fit.group) for fit in fits]
        begun = [self._begun(*each) for each in zip(fits, known, strict=True)]
        motions = self._windows.found(begun)
        motions = [
            self._better(motion, motion.tracks, best)
            for motion, best in zip(motions, known, strict=True)
        ]
        self._add(motions)
        return motions

    def improved(self, motion, group):
        """A motion that was found, with what explains a group better by now.

        It stays a motion of the tracks that it was fitted to.
        """
        known = self._best_for(group)
        return motion if known is None else self._better(motion, group, known)

    def _add(self, motions):
        """Know some motions, those that are known already but once."""
        for motion in motions:
            n_known = len(self._motions)
            if id(motion) in self._totals:
                continue
            if n_known == self._nats.shape[1]:
                more = np.empty_like(self._nats)
                self._nats = np.concatenate([self._nats, more], axis=1)
            nats = nats_in_windows(self._windows, motion, self._scale)
            self._nats[:, n_known] = nats
            self._motions.append(motion)
            self._totals[id(motion)] = nats.sum(axis=1)

    def _best_for(self, group):
        """What explains a group best, window by window, of what is known; its nats."""
        nats = self._nats[group, : len(self._motions)].sum(axis=0)
        if not len(nats):
            return None
        return [self._motions[k] for k in nats.argmin(axis=0)], nats.min(axis=0)

    def _begun(self, fit, known):
        """A fit that starts with what is known; from several starts where that is bad.

        Where it had more than one start, these are tried, too.
        """
        if known is None:
            return fit
        best, nats = known
        poses = [motion.poses[k] for k, motion in enumerate(best)]
        if not fit.starts:
            most = NATS_OF_EXPLAINED * self._windows.freedom[fit.group].sum(axis=0)
            pairs = zip(poses, nats <= most, strict=True)
            poses = [pose if explained else None for pose, explained in pairs]
        start = best[0].with_poses(poses)
        others = fit.starts if len(fit.starts) > 1 else ()
        return fit._replace(starts=(start, *others))

    def _better(self, motion, group, known):
        """A motion, with what was known in windows where it is worse for a group."""
        if known is None:
            return motion
        best, least = known
        nats = nats_in_windows(self._windows, motion, self._scale, group)
        # As what is known is summed, lest a motion be worse than itself.
        worse = nats.astype(np.float32).sum(axis=0) > least
        if not worse.any():
            return motion
        chosen = [k if w else motion for k, w in zip(best, worse, strict=True)]
        return self._windows.composed(motion.tracks, chosen)
