"""Numbers of motions that last: who is still, or again, the same."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.special import expit

from ..geometry.camera import REFERENCE_WIDTH

# Tracks that show where a motion is.
FEWEST_TRACKS = 3
# Where a motion that nobody sees may be: it forgets where it was in so many frames, and
# is then about where it used to be, which is known after so many; before, anywhere
# within so many widths of the picture.
FORGETS, LEARNT, ANYWHERE = 21.0, 67.0, 0.28
# Standard deviation of the logarithm of its radius, then from now; and that of any
# motion: its mean, in widths of the picture, and standard deviation.
SIZE_CHANGES, ANY_SIZE, SIZES = 0.6, 0.06, 0.8
# A motion goes on if it shares this part of the tracks that the smaller of two groups
# shares with others, and so many.
SHARED_PART, SHARED_TRACKS = 0.5, 3
# Part of the tracks of a motion that are in the group of another if it is part of that.
CONTAINED = 0.75
# Frames after which a motion that nobody sees is given up.
MOST_ABSENT = 100


class Trace(NamedTuple):
    """Where a motion was in the picture, in pixels.

    Attributes
    ----------
    frame : int
        In which it was seen last, or first.
    place : ndarray of shape (2,)
        In this frame.
    n_frames : int
        Frames that saw it.
    mean, variance : ndarray of shape (2,)
        Of its places in these.
    log_radius : float
        Mean logarithm of its radius.
    """

    frame: int
    place: np.ndarray
    n_frames: int
    mean: np.ndarray
    variance: np.ndarray
    log_radius: float

    @classmethod
    def of(cls, start, points, seen, first=False, least_radius=1.0):
        """The trace of some tracks; None if no frame sees three of them.

        Parameters
        ----------
        start : int
            The first of the frames.
        points : ndarray of shape (n, L, 2)
        seen : ndarray of bool, shape (n, L)
        first : bool
            Whether the frame is the first that sees them, and not the last.
        least_radius : float
            What a motion's is taken to be at least (see :func:`pixel_of`).
        """
        frames = np.flatnonzero(seen.sum(axis=0) >= FEWEST_TRACKS)
        if len(frames) == 0:
            return None
        shown = np.where(seen[:, frames, None], points[:, frames], np.nan)
        # Medians that need not look for what is unseen take a fraction of the time.
        median = np.median if seen[:, frames].all() else np.nanmedian
        places = median(shown, axis=0)
        radii = median(np.abs(shown - places), axis=0).max(axis=1)
        at = 0 if first else -1
        return cls(
            start + int(frames[at]),
            places[at],
            len(frames),
            places.mean(axis=0),
            places.var(axis=0),
            float(np.log(np.maximum(radii, least_radius)).mean()),
        )

    def after(self, other):
        """With what another trace says of the same motion; the later frame is kept."""
        n_frames = self.n_frames + other.n_frames
        share = self.n_frames / n_frames
        apart = self.mean - other.mean
        variance = share * self.variance + (1 - share) * other.variance
        last = self if self.frame >= other.frame else other
        return Trace(
            last.frame,
            last.place,
            n_frames,
            other.mean + share * apart,
            variance + share * (1 - share) * apart**2,
            share * self.log_radius + (1 - share) * other.log_radius,
        )

    def evidence(self, first, size):
        """Logarithm of how much likelier a motion that appears is this one than any.

        Places are those of an Ornstein-Uhlenbeck process, whose mean and variance are
        those of the places so far. Any motion appears anywhere in the picture.

        Parameters
        ----------
        first : Trace
        size : ndarray of shape (2,)
            Of the picture, pixels.

        Returns
        -------
        float
            Nats: above 0, it is the same rather than another.
        """
        width = size.max()
        known = self.n_frames / (self.n_frames + LEARNT)
        kept = np.exp(-max(first.frame - self.frame, 1) / FORGETS)
        usual = known * self.mean + (1 - known) * self.place
        variance = known * self.variance + (1 - known) * (ANYWHERE * width) ** 2
        variance = variance * (1 - kept**2)
        variance += np.exp(2 * max(self.log_radius, first.log_radius))
        expected = usual + kept * (self.place - usual)
        same = _log_normal(first.place, expected, variance).sum()
        same += _log_normal(first.log_radius, self.log_radius, SIZE_CHANGES**2)
        usual_size = np.log(ANY_SIZE * width)
        other = _log_normal(first.log_radius, usual_size, SIZES**2)
        return float(same - other + np.log(size).sum())

    def evidence_of_part(self, size):
        """As :meth:`evidence`, for what may be a part of it: near it, of any size."""
        return float(np.log(size).sum() - np.log(2 * np.pi) - 2 * self.log_radius)


def pixel_of(size):
    """A pixel of a video 640 pixels wide, where a picture has this size (2,)."""
    return size.max() / REFERENCE_WIDTH


def _log_normal(value, mean, variance):
    return -((value - mean) ** 2 / variance + np.log(2 * np.pi * variance)) / 2


def going_on(shared, living, evidence=None):
    """Number of each group that goes on: {group: number}.

    Parameters
    ----------
    shared : ndarray of int, shape (n_groups, n_living)
        Tracks of each group that had each of these numbers.
    living : list of int
    evidence : ndarray of shape (n_groups, n_living), optional
        What tells which group goes on, if not the tracks. These must be enough.
    """
    if not shared.size:
        return {}
    rows, columns = linear_sum_assignment(-(shared if evidence is None else evidence))
    known = np.minimum(shared.sum(axis=1)[:, None], shared.sum(axis=0))
    return {
        int(k): living[j]
        for k, j in zip(rows, columns, strict=True)
        if enough_shared(shared[k, j], known[k, j])
    }


def parts(shared, living):
    """Pairs of numbers that are in one group: [(the older, the other), ...].

    One of the two goes on in the group, and most tracks of the other are in it.

    Parameters
    ----------
    shared : ndarray of int, shape (n_groups, n_living)
        Tracks of each group that had each of these numbers.
    living : list of int
    """
    known = going_on(shared, living)
    left = [j for j, number in enumerate(living) if number not in known.values()]
    pairs = []
    for j in left if known else []:
        k, in_groups = int(shared[:, j].argmax()), shared[:, j].sum()
        if k in known and shared[k, j] >= max(CONTAINED * in_groups, 1):
            pairs.append((min(known[k], living[j]), max(known[k], living[j])))
    return pairs


def enough_shared(shared, of):
    """Whether a motion goes on by tracks that are shared, of so many that could be."""
    return shared >= max(SHARED_TRACKS, SHARED_PART * of)


class Numbers:
    """Numbers of motions, none given twice, and where they were seen.

    Attributes
    ----------
    next : int
        Given to the next new motion.
    ended : int
        How many were given before all motions were given up, but that of the static
        scene, which goes on.
    traces : dict of int to Trace
    hidden : set of int
        Motions that nobody sees.
    proven : set of int
        Motions that were apart from all others for long, and are not given up.
    merged : dict of int to int
        Numbers that turned out to be of a motion with another number.
    n_again, n_new : float
        How many of the motions that appeared while others were hidden were probably one
        of these, and how many were not, and one of each: some films show the same
        things again and again, others never.
    """

    def __init__(self):
        self.next = self.ended = 0
        self.traces = {}
        self.hidden = set()
        self.proven = set()
        self.merged = {}
        self.n_again = self.n_new = 1.0

    def merge(self, number, other):
        """Note that two numbers are of one motion."""
        of = {old: other if new == number else new for old, new in self.merged.items()}
        self.merged = {**of, number: other}
        self._drop(number)

    def new(self):
        self.next += 1
        return self.next - 1

    def see(self, number, trace):
        """Note where a motion is seen; None if that is not known."""
        if trace is not None:
            known = self.traces.get(number)
            self.traces[number] = trace if known is None else trace.after(known)

    def hide(self, number):
        """Keep in mind a motion that is not seen."""
        if number in self.traces:
            self.hidden.add(number)

    def forget(self, frame):
        """Give up motions that were not seen for long; say which."""
        ended = {number: self.traces[number].frame for number in sorted(self.hidden)}
        lost = [n for n, last in ended.items() if frame - last > MOST_ABSENT]
        for number in lost:
            self._drop(number)
        return lost

    def forget_all(self):
        """Give up all motions."""
        self.ended = max(self.next - 1, 0)
        self.traces, self.hidden, self.proven = {}, set(), set()

    def of(
        self,
        first,
        size,
        living,
        former=None,
        most=None,
        fading=(),
        shared=None,
        since=0,
    ):
        """Number of a motion that has appeared, and whether it was there before.

        Parameters
        ----------
        first : Trace or None
            Where it has appeared.
        size : ndarray of shape (2,)
            Of the picture, pixels.
        living : collection of int
            Numbers that others have.
        former : int, optional
            The number that most of its tracks had: theirs, if nobody has it.
        most : int, optional
            Numbers that may be given, but for those before all were given up. If all
            are, it is the likeliest hidden one.
        fading : collection of int
            Motions that have lost their tracks, and are not hidden yet: they may be
            this one as well as those that are.
        shared : int, optional
            The number of a motion that it may be a part of, if all numbers are given:
            its own unless one that is hidden is likelier.
        since : int
            A frame: what was seen last before it is not seen again.

        Returns
        -------
        number : int or None
            None if there are as many as may be, and none is hidden.
        again : bool
        """
        if former is not None and 0 <= former < self.next and former not in living:
            self.hidden.discard(former)
            return former, True
        full = most is not None and self.next - self.ended >= most
        known = self._evidence(first, size, fading, since)
        if full and first is not None and shared in self.traces:
            known[shared] = self.traces[shared].evidence_of_part(size)
        likely = [number for number, nats in known.items() if nats > 0]
        if full and not likely:
            if shared is not None:
                return shared, True
            likely = list(known)
        if likely:
            number = max(likely, key=lambda n: known[n])
            self.hidden.discard(number)
            return number, True
        return (None, False) if full else (self.new(), False)

    def final(self, labels):
        """Labels with the numbers of motions that merged replaced."""
        labels = labels.copy()
        for number, other in self.merged.items():
            labels[labels == number] = other
        return labels

    def _evidence(self, first, size, fading, since):
        """Log odds that what appears is each motion that nobody sees, and none new."""
        gone = sorted(self.hidden | (set(fading) & set(self.traces)))
        gone = [number for number in gone if self.traces[number].frame >= since]
        if first is None or not gone:
            return {}
        odds = float(np.log(self.n_again / self.n_new))
        nats = {n: odds + self.traces[n].evidence(first, size) for n in gone}
        again = float(expit(max(nats.values())))
        self.n_again += again
        self.n_new += 1 - again
        return nats

    def _drop(self, number):
        self.hidden.discard(number)
        self.proven.discard(number)
        self.traces.pop(number, None)
