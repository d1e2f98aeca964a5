"""Numbers of motions that last: who is still, or again, the same."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

# Frames over which the velocity of a motion in the picture is measured, and over which
# it is trusted to go on when nobody sees it.
VELOCITY_FRAMES, TRUSTED_FRAMES = 5, 10
# A motion that comes back is expected within so many of its own radii, steps of its
# velocity and pixels per frame of absence (of a picture 640 pixels wide).
RADII, STEPS, PER_FRAME, AT_ONCE = 3.0, 4.0, 2.0, 20.0
# Frames after which a motion that nobody sees is given up.
MOST_ABSENT = 100


class Trace(NamedTuple):
    """Where a motion was in the picture when it was last seen.

    Attributes
    ----------
    frame : int
    place, velocity : ndarray of shape (2,)
        Pixels, and pixels per frame.
    radius : float
        Pixels.
    """

    frame: int
    place: np.ndarray
    velocity: np.ndarray
    radius: float

    @classmethod
    def of(cls, frame, points, seen):
        """The trace of tracks (n, L, 2) seen in the newest frame; None of too few."""
        rows = np.flatnonzero(seen[:, -1])
        if len(rows) < 3:
            return None
        place = np.median(points[rows, -1], axis=0)
        radius = np.median(np.abs(points[rows, -1] - place), axis=0).max()
        velocity = np.zeros(2)
        back = min(VELOCITY_FRAMES, seen.shape[1] - 1)
        both = rows[seen[rows, -1 - back]]
        if len(both):
            steps = points[both, -1] - points[both, -1 - back]
            velocity = np.median(steps, axis=0) / back
        return cls(frame, place, velocity, float(radius))

    @classmethod
    def first(cls, frame, points, seen):
        """As :meth:`of`, for the first frame in which three of the tracks are seen.

        The velocity is that of time running backwards.
        """
        frames = np.flatnonzero(seen.sum(axis=0) >= 3)
        if len(frames) == 0:
            return None
        back = slice(None, frames[0] - 1 if frames[0] else None, -1)
        first = frame - seen.shape[1] + 1 + int(frames[0])
        return cls.of(first, points[:, back], seen[:, back])

    def continued(self, other, pixel):
        """How well a later trace is where this one leads.

        Parameters
        ----------
        other : Trace
        pixel : float
            Pixels per pixel of a picture 640 pixels wide.

        Returns
        -------
        distance : float
            Within 1 it may be the same motion.
        surprise : float
            By which motions that may be the same compare: nats, if places are normally
            distributed and the distance is of three standard deviations.
        """
        gap = other.frame - self.frame
        # What leaves the picture may turn and come back where it left.
        way = self.velocity * min(gap, TRUSTED_FRAMES)
        along = (other.place - self.place) @ way / max(way @ way, 1e-12)
        expected = self.place + way * np.clip(along, 0, 1)
        reach = RADII * max(self.radius, other.radius)
        reach += STEPS * np.linalg.norm(self.velocity)
        reach += pixel * (AT_ONCE + PER_FRAME * gap)
        distance = float(np.linalg.norm(other.place - expected) / reach)
        return distance, 4.5 * distance**2 + 2 * float(np.log(reach))


class Numbers:
    """Numbers of motions, none given twice, and motions that nobody sees.

    Attributes
    ----------
    next : int
        Given to the next new motion.
    hidden : dict of int to Trace
    merged : dict of int to int
        Numbers that turned out to be of a motion with another number.
    """

    def __init__(self):
        self.next = 0
        self.hidden = {}
        self.merged = {}

    def merge(self, number, other):
        """Note that two numbers are of one motion."""
        of = {old: other if new == number else new for old, new in self.merged.items()}
        self.merged = {**of, number: other}

    def new(self):
        self.next += 1
        return self.next - 1

    def hide(self, number, trace):
        """Keep in mind a motion that is not seen."""
        if trace is not None:
            self.hidden[number] = trace

    def forget(self, frame):
        """Give up motions that were not seen for long; say which."""
        lost = [n for n, t in self.hidden.items() if frame - t.frame > MOST_ABSENT]
        for number in lost:
            del self.hidden[number]
        return lost

    def of(
        self, trace, pixel, living, former=None, most=None, fading=None, shared=None
    ):
        """Number of a motion that has appeared, and whether it was there before.

        Parameters
        ----------
        trace : Trace or None
        pixel : float
            As for :meth:`Trace.continued`.
        living : collection of int
            Numbers that others have.
        former : int, optional
            The number that most of its tracks had: theirs, if nobody has it.
        most : int, optional
            Numbers that may be given. If all are, it is the likeliest hidden one.
        fading : dict of int to Trace, optional
            Motions that have lost their tracks, and are not hidden yet: they may be
            this one as well as those that are.
        shared : int, optional
            The number of a motion that it may be a part of: its own if all numbers are
            given and none is expected there.

        Returns
        -------
        number : int or None
            None if there are as many as may be, and none is hidden.
        again : bool
        """
        if former is not None and 0 <= former < self.next and former not in living:
            self.hidden.pop(former, None)
            return former, True
        traces = {} if trace is None else {**self.hidden, **(fading or {})}
        known = {n: each.continued(trace, pixel) for n, each in traces.items()}
        full = most is not None and self.next >= most
        likely = [n for n, (distance, _) in known.items() if distance <= 1]
        if full and not likely:
            if shared is not None:
                return shared, True
            likely = list(known)
        if likely:
            number = min(likely, key=lambda n: known[n][1])
            self.hidden.pop(number, None)
            return number, True
        return (None, False) if full else (self.new(), False)

    def final(self, labels):
        """Labels with the numbers of motions that merged replaced."""
        labels = labels.copy()
        for number, other in self.merged.items():
            labels[labels == number] = other
        return labels
