"""Motions that live: brought from frame to frame, compared, and judged."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .assignment import measure
from .births import FEWEST_MEMBERS, apartness, is_at_infinity
from .buffer import UNKNOWN
from .window import FEWEST_TRACKS, Fit

# Median deviation, in scales, above which a motion is fitted from several starts, and
# how many are at a time.
BADLY, MOST_REFITTED = 1.0, 2
# Frames until a motion is fitted so again, if it fits badly, and in any case.
REFITTED_AFTER, REFITTED_ANYWAY = 3, 8
# Frames in which a candidate is new, and after which it is a motion, or is none, and by
# how much it is apart.
YOUNG, CONFIRMED_AFTER, DROPPED_AFTER, APART = 3, 5, 10, 2.0
# Apartness below which two motions are alike, and frames of it after which one that
# was apart for less than so many frames, judged one in three, is merged with the other.
ALIKE, MERGED_AFTER, ESTABLISHED = 0.7, 10, 10
# Times that a joint motion explains it and the closest, until then, after which they
# are merged.
TOGETHER = 3
# Frames without enough tracks after which a motion is hidden.
HIDDEN_AFTER = 8


@dataclass(eq=False)
class LivingMotion:
    """A motion that tracks in view follow.

    Attributes
    ----------
    number : int
        Below -1 while it is a candidate.
    fit : Fit
    refitted : int
        Frame in which it was last fitted from several starts.
    age : int
        Frames since it was found.
    unseen : int
        Frames since enough of its tracks were seen.
    apart, alike : int
        In how many frames it was apart from all others, and no joint motion explained
        it and the closest of them, and for how many it has been alike to a larger one.
    is_apart : bool
        Whether it is apart from all others now.
    together : int
        How often in succession a joint motion explained it and the closest.
    source : int
        Number of the motion that its tracks followed before.
    """

    number: int
    fit: Fit
    refitted: int
    age: int = 0
    unseen: int = 0
    apart: int = 0
    alike: int = 0
    is_apart: bool = False
    together: int = 0
    source: int = UNKNOWN

    @property
    def is_candidate(self):
        return self.number < UNKNOWN

    @property
    def is_closed(self):
        """Whether only tracks that nothing else explains may join."""
        return self.is_candidate or self.alike > 0

    @property
    def is_established(self):
        return self.apart >= ESTABLISHED

    @property
    def is_in_question(self):
        """Whether a joint motion may explain it and another: a candidate is new."""
        return self.age < YOUNG if self.is_candidate else not self.is_established

    @property
    def is_part(self):
        """Whether joint motions have explained it and another often enough."""
        if self.is_candidate:
            return self.together > 0
        return self.together >= TOGETHER and self.number > 0


def advance(window, motions, groups):
    """Fit living motions to the newest frame.

    Parameters
    ----------
    window : Window
    motions : list of LivingMotion
        Changed in place.
    groups : list of ndarray of int
        Their tracks.
    """
    fits = window.advance(groups, [motion.fit for motion in motions])
    refined = window.fit(groups, fits)
    for motion, fit, new, rows in zip(motions, fits, refined, groups, strict=True):
        motion.fit = fit if new is None else new
        motion.age += 1
        enough = window.seen[rows, -1].sum() >= FEWEST_TRACKS
        motion.unseen = 0 if enough else motion.unseen + 1


def refit(window, motions, groups, scale, frame, anyway=True):
    """Fit from several starts what fits badly, or what was not for longest.

    Depths and poses that were carried on for long may drift, and a sudden movement may
    lead them astray. What fits worse than before is not taken. ``anyway``, also what
    fits well is fitted again after some frames.
    """
    if not motions:
        return
    order = sorted(range(len(motions)), key=lambda k: motions[k].refitted)
    ages = [frame - motion.refitted for motion in motions]
    deviations = {
        k: _deviation(window, motions[k].fit, groups[k], scale)
        for k in order
        if ages[k] >= REFITTED_AFTER
    }
    bad = [k for k, deviation in deviations.items() if deviation > BADLY]
    late = [k for k in order if anyway and ages[k] >= REFITTED_ANYWAY]
    due = bad[:MOST_REFITTED] or late[:1]
    for k, fit in zip(due, window.fit([groups[k] for k in due]), strict=True):
        motions[k].refitted = frame
        if fit and _deviation(window, fit, groups[k], scale) <= deviations[k]:
            motions[k].fit = fit


def _deviation(window, fit, rows, scale):
    """Median deviation of tracks from a motion, in scales; 0 if nothing is known."""
    own = measure(window, [fit], scale, rows).deviations()
    own = own[np.isfinite(own)]
    return float(np.median(own)) if len(own) else 0.0


def compare(window, residuals, motions, column, groups, sizes):
    """Note in a motion whether it is apart from all others, or alike to a larger one.

    Parameters
    ----------
    window : Window
    residuals : Residuals
    motions : list of LivingMotion
    column : int
        Of the motion.
    groups : list of ndarray of int
        Tracks of each motion in the newest frame that can be judged.
    sizes : ndarray of int, shape (M,)
        Tracks of each motion.

    Returns
    -------
    alike : LivingMotion or None
        The largest one that it is alike to.
    closest : LivingMotion or None
        The one that explains it best of the others that are no candidates.
    """
    motion, rows = motions[column], groups[column]
    apart = apartness(window, residuals, column, rows)
    motion.is_apart = len(rows) > 0 and bool(apart.min(initial=np.inf) > APART)
    known = [
        k
        for k, other in enumerate(motions)
        if np.isfinite(apart[k]) and not other.is_candidate
    ]
    closest = motions[min(known, key=lambda k: apart[k])] if known else None
    larger = [
        k
        for k, other in enumerate(motions)
        if apart[k] < ALIKE and not other.is_candidate and sizes[k] > sizes[column]
        if not is_at_infinity(window, residuals.scale, other.fit, (rows, groups[k]))
    ]
    motion.alike = motion.alike + 1 if larger else 0
    alike = motions[max(larger, key=lambda k: sizes[k])] if larger else None
    return alike, closest


def verdict(motion, n_tracks, alike=None):
    """What becomes of a motion with so many tracks in the newest frame.

    Parameters
    ----------
    motion : LivingMotion
    n_tracks : int
    alike : LivingMotion or None
        A larger one that it is alike to.

    Returns
    -------
    {"confirmed", "dropped", "hidden", "joined", "merged", "continued"} or None
        None if it goes on as it is; "joined" if it is the same as the closest, "merged"
        as the one that it is alike to, and "continued" if that one came later.
    """
    if motion.is_candidate:
        if motion.is_part:
            return "dropped"
        ripe = motion.age >= CONFIRMED_AFTER and n_tracks >= FEWEST_MEMBERS
        if ripe and motion.is_apart:
            return "confirmed"
        late = motion.age >= DROPPED_AFTER or n_tracks < FEWEST_TRACKS
        return "dropped" if late else None
    if motion.unseen > HIDDEN_AFTER:
        return "hidden"
    if motion.is_part:
        return "joined"
    if alike is None or motion.alike <= MERGED_AFTER:
        return None
    if motion.number > 0 and not motion.is_established:
        return "merged"
    later = alike.number > motion.number and not alike.is_established
    return "continued" if later else None
