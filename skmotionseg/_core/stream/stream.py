"""Motions of a stream of tracks, carried from frame to frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..geometry.windows import FOCAL_LENGTHS, REFERENCE_WIDTH
from ..labels import groups_of
from .assignment import OUTLYING, assign, measure, neighbour_shares, remembered
from .births import (
    FEWEST_MEMBERS,
    LEAST_FREEDOM,
    UNEXPLAINED,
    apartness,
    find_candidate,
    joint_motion,
)
from .buffer import UNKNOWN, TrackBuffer
from .history import History
from .identities import Numbers, Trace
from .window import FEWEST_TRACKS, LENGTH, Camera, Fit, Window

# The scale of residuals, in units of their median, and the share of it that follows.
SCALE_OF_NOISE, FOLLOWING = 2.0, 0.05
# Frames from one look for new motions to the next.
FRAMES_PER_LOOK = 3
# Frames after which a candidate is a motion, or is none, and by how much it is apart.
CONFIRMED_AFTER, DROPPED_AFTER, APART = 5, 10, 2.0
# Median deviation, in scales, above which a motion is fitted from several starts, and
# how many at a time.
BADLY, MOST_REFITTED = 1.0, 2
# Apartness below which two motions are alike; frames of it after which one that was apart
# for less than so many is merged with the other.
ALIKE, MERGED_AFTER, ESTABLISHED = 0.7, 10, 25
# Frames without enough tracks after which a motion is hidden.
HIDDEN_AFTER = 8
# Scales above which a track belongs to no motion.
REJECTED = 6.0


@dataclass
class LivingMotion:
    """A motion that tracks in view follow.

    Attributes
    ----------
    number : int
        Negative while it is a candidate.
    fit : Fit
    age : int
        Frames since it was found.
    unseen : int
        Frames since enough of its tracks were seen.
    refitted : int
        Frame in which it was last fitted from several starts.
    apart : int
        Frames in which it was apart from all others.
    alike : int
        Frames since it was not alike to a larger one.
    trace : Trace or None
    """

    number: int
    fit: Fit
    age: int = 0
    unseen: int = 0
    refitted: int = 0
    apart: int = 0
    alike: int = 0
    trace: Trace | None = None
    is_apart: bool = False

    @property
    def is_candidate(self):
        return self.number < UNKNOWN

    @property
    def is_closed(self):
        """Whether only tracks that nothing else explains may join."""
        return self.is_candidate or self.alike > 0


class Event(NamedTuple):
    """Something that happened in a stream.

    Attributes
    ----------
    frame : int
    kind : str
    words : str
    """

    frame: int
    kind: str
    words: str


class MotionStream:
    """Motions that live in a stream, and the tracks in view.

    Parameters
    ----------
    n_motions : int or None
        Motions at most; None for any number.
    rng : RandomState
    keep_history : bool
        Whether labels of tracks that are long out of view are kept.
    """

    def __init__(self, n_motions, rng, keep_history=True):
        self.n_motions, self.rng = n_motions, rng
        self.frame = -1
        self.buffer = TrackBuffer(LENGTH)
        self.history = History() if keep_history else None
        self.numbers = Numbers()
        self.motions: list[LivingMotion] = []
        self.camera: Camera | None = None
        self.scale = 0.0; self.dv={}
        self.outlying = np.empty(0, dtype=bool)

    # ------------------------------------------------------------------------- frames

    def push(self, points, ids):
        """Take in a frame; see :meth:`TrackBuffer.push`."""
        self.frame += 1
        outlying = set(self.buffer.ids[self.outlying].tolist())
        rows, new, gone = self.buffer.push(points, ids)
        self.outlying = np.isin(self.buffer.ids, sorted(outlying))
        if self.history is not None:
            self.history.add(*gone)
            known = self.history.labels_of(self.buffer.ids[new])
            self.buffer.labels[new] = known
        return rows

    def follow(self):
        """Bring the living motions, and the labels of tracks, to the newest frame."""
        window = self.window()
        self._advance(window)
        residuals, chosen = self._assign(window)
        residuals, events = self._judge(window, residuals)
        events += self._look(window, residuals)
        return events

    def window(self):
        return Window(self.buffer.points, self.buffer.seen, self.camera)

    def labels(self):
        """Labels of the tracks in the buffer, -1 for outliers."""
        return np.where(self.outlying, UNKNOWN, self.buffer.shown())

    # -------------------------------------------------------------------------- start

    def start(self, rows, labels):
        """Begin with a partition of tracks.

        Parameters
        ----------
        rows : ndarray of int, shape (n,)
            Of the buffer.
        labels : ndarray of int, shape (n,)
            ``0..M - 1``, none empty; -1 for none.
        """
        groups = [rows[labels == k] for k in range(labels.max(initial=-1) + 1)]
        some = self.buffer.points[self.buffer.seen]
        best = np.inf
        for share in FOCAL_LENGTHS:
            camera = Camera.around(some, share)
            window = Window(self.buffer.points, self.buffer.seen, camera)
            fits = window.fit(groups)
            measured = measure(window, [f for f in fits if f], camera.noise, rows)
            if not measured.nats.size:
                continue
            total = measured.nats.min(axis=1).sum()
            if total < best:
                best, self.camera = total, camera
                noise = np.nanmedian(np.nanmin(measured.deviations(), axis=1))
                self.scale = camera.noise * max(1.0, SCALE_OF_NOISE * noise)
                found = fits
        if self.camera is None:
            return
        for group, fit in zip(groups, found, strict=True):
            number = self.numbers.new()
            self.buffer.labels[group] = number
            if fit is not None:
                self.motions.append(LivingMotion(number, fit, refitted=self.frame))
        self.buffer.memory = np.zeros((len(self.buffer.ids), len(self.motions)))

    # -------------------------------------------------------------------- one by one

    def _groups(self):
        """Rows of the tracks of each living motion, without outliers."""
        labels = np.where(self.outlying, UNKNOWN, self.buffer.labels)
        return [np.flatnonzero(labels == m.number) for m in self.motions]

    def _advance(self, window):
        """Fit the living motions to the newest frame."""
        groups = self._groups()
        fits = window.advance(groups, [m.fit for m in self.motions])
        refined = window.fit(groups, fits)
        for motion, fit, new, rows in zip(
            self.motions, fits, refined, groups, strict=True
        ):
            motion.fit = fit if new is None else new
            motion.age += 1
            enough = window.seen[rows, -1].sum() >= FEWEST_TRACKS
            motion.unseen = 0 if enough else motion.unseen + 1
        self._refit(window, groups)

    def _refit(self, window, groups):
        """Fit from several starts what fits badly, and what was not for longest."""
        if not self.motions:
            return
        deviations = self._own_deviations(window, groups)
        self.dv={m.number:d for m,d in zip(self.motions,deviations)}
        longest = min(range(len(groups)), key=lambda k: self.motions[k].refitted)
        due = [k for k in range(len(groups)) if deviations[k] > BADLY]
        due = sorted(due, key=lambda k: self.motions[k].refitted)[:MOST_REFITTED]
        due = due or [longest]
        new = window.fit([groups[k] for k in due])
        for k, fit in zip(due, new, strict=True):
            self.motions[k].refitted = self.frame
            if fit is not None:
                old, self.motions[k].fit = self.motions[k].fit, fit
                if self._own_deviations(window, groups)[k] > deviations[k]:
                    self.motions[k].fit = old

    def _own_deviations(self, window, groups):
        """Median deviation, in scales, of the tracks of each motion from it."""
        found = []
        for motion, rows in zip(self.motions, groups, strict=True):
            own = measure(window, [motion.fit], self.scale, rows).deviations()
            found.append(np.nanmedian(own) if np.isfinite(own).any() else 0.0)
        return found

    def _assign(self, window):
        """Residuals of all tracks, and the motion of each."""
        buffer = self.buffer
        residuals = measure(window, [m.fit for m in self.motions], self.scale)
        columns = self._columns()
        now = buffer.seen[:, -1]
        shares = np.zeros_like(residuals.nats)
        voters = np.where(window.freedom[now] >= LEAST_FREEDOM, columns[now], UNKNOWN)
        shares[now] = neighbour_shares(
            buffer.points[now, -1], voters, len(self.motions)
        )
        nats = np.where(self._may_join(residuals, columns), residuals.nats, np.inf)
        chosen = assign(nats, buffer.memory, shares, columns)
        numbers = np.array([m.number for m in self.motions])
        before = np.where(buffer.labels < UNKNOWN, buffer.before, buffer.labels)
        buffer.labels = np.where(now, numbers[chosen], buffer.labels)
        buffer.before = before
        kept = remembered(buffer.memory, residuals.nats, LENGTH)
        buffer.memory = np.where(now[:, None], kept, buffer.memory)
        own = np.take_along_axis(residuals.deviations(), chosen[:, None], 1)[:, 0]
        self.outlying = np.where(now, own > OUTLYING, self.outlying)
        self._follow_noise(own[now])
        return residuals, chosen

    def _may_join(self, residuals, columns):
        """Which tracks may follow which motions: bool, (n, M)."""
        closed = np.array([m.is_closed for m in self.motions])
        deviations = np.where(closed, np.inf, residuals.deviations())
        lost = ~(deviations.min(axis=1, initial=np.inf) < UNEXPLAINED)
        own = columns[:, None] == np.arange(len(closed))
        return ~closed | own | lost[:, None]

    def _columns(self):
        """Living motion of each track of the buffer; -1 for none."""
        columns = np.full(len(self.buffer.ids), UNKNOWN)
        for k, motion in enumerate(self.motions):
            columns[self.buffer.labels == motion.number] = k
        return columns

    def _follow_noise(self, own):
        own = own[np.isfinite(own)]
        if len(own):
            wanted = SCALE_OF_NOISE * float(np.median(own)) * self.scale
            wanted = max(self.camera.noise, wanted)
            self.scale += FOLLOWING * (min(wanted, 2 * self.scale) - self.scale)

    def _judge(self, window, residuals):
        """Confirm, drop, merge and hide motions."""
        events = []
        for k in reversed(range(len(self.motions))):
            motion = self.motions[k]
            rows = np.flatnonzero(self.buffer.labels == motion.number)
            rows = rows[self.buffer.seen[rows, -1]]
            trace = Trace.of(self.frame, self.buffer.points[rows], self.buffer.seen[rows])
            motion.trace = trace or motion.trace
            rows = rows[window.freedom[rows] >= LEAST_FREEDOM]
            other = self._compare(window, residuals, k, rows)
            verdict = self._verdict(window, motion, rows)
            if verdict == "confirmed":
                events += self._confirm(motion, rows)
            elif verdict is not None:
                residuals = residuals.without(k)
                events += self._remove(k, verdict, other)
        lost = self.numbers.forget(self.frame)
        events += [Event(self.frame, "gone", f"motion {n} has gone") for n in lost]
        return residuals, events

    def _compare(self, window, residuals, column, rows):
        """Note whether a motion is apart from all, or alike to a larger one: which."""
        motion = self.motions[column]
        apart = apartness(window, residuals, column, rows)
        motion.apart += len(rows) > 0 and apart.min() > APART
        sizes = [np.sum(self.buffer.labels == m.number) for m in self.motions]
        larger = [
            k
            for k, other in enumerate(self.motions)
            if apart[k] < ALIKE and not other.is_candidate and sizes[k] > sizes[column]
        ]
        motion.alike = motion.alike + 1 if larger else 0
        motion.is_apart = len(rows) > 0 and apart.min() > APART
        return self.motions[max(larger, key=sizes.__getitem__)] if larger else None

    def _verdict(self, window, motion, rows):
        """What becomes of a motion; None if it goes on."""
        if not motion.is_candidate:
            if motion.unseen > HIDDEN_AFTER:
                return "hidden"
            spurious = motion.alike > MERGED_AFTER and motion.apart < ESTABLISHED
            return "merged" if spurious and motion.number > 0 else None
        if motion.age >= CONFIRMED_AFTER and len(rows) >= FEWEST_MEMBERS:
            if motion.is_apart:
                joint = self._explained_jointly(window, motion.fit, rows)
                return "dropped" if joint else "confirmed"
        if motion.age >= DROPPED_AFTER or len(rows) < FEWEST_TRACKS:
            return "dropped"
        return None

    def _confirm(self, motion, rows):
        """Give a candidate a number."""
        names, counts = np.unique(self.buffer.before[rows], return_counts=True)
        former = int(names[counts.argmax()])
        number, again = self.numbers.of(
            motion.trace, self._pixel(), former, self.n_motions
        )
        if number is None:
            return []
        own = self.buffer.labels == motion.number
        self.buffer.labels = np.where(own, number, self.buffer.labels)
        motion.number, motion.apart = number, 0
        words = "is seen again" if again else "is new"
        return [Event(self.frame, "again" if again else "new", f"motion {number} {words}")]

    def _remove(self, column, verdict, other):
        """Take a motion out of the living."""
        motion = self.motions.pop(column)
        self.buffer.memory = np.delete(self.buffer.memory, column, axis=1)
        if motion.is_candidate:
            self.buffer.release(motion.number)
            return []
        if verdict == "merged":
            self.numbers.merge(motion.number, other.number)
            own = self.buffer.labels == motion.number
            self.buffer.labels = np.where(own, other.number, self.buffer.labels)
            words = f"motion {motion.number} is the same as {other.number}"
            return [Event(self.frame, verdict, words)]
        self.numbers.hide(motion.number, motion.trace)
        return [Event(self.frame, verdict, f"motion {motion.number} is out of view")]

    def _look(self, window, residuals):
        """Look for a new motion."""
        if self.frame % FRAMES_PER_LOOK or not self.motions:
            return []
        buffer = self.buffer
        columns = self._columns()
        chosen = np.where(columns < 0, residuals.nats.argmin(axis=1), columns)
        fit, members = find_candidate(
            window, residuals, chosen, buffer.points[:, -1], buffer.seen[:, -1], self.rng
        )
        if fit is None or self._explained_jointly(window, fit, members):
            return []
        number = UNKNOWN - 1 - self.frame
        self.motions.append(LivingMotion(number, fit, refitted=self.frame))
        least = buffer.memory[members].min(axis=1, initial=0)
        buffer.memory = np.column_stack([buffer.memory, np.zeros(len(buffer.ids))])
        buffer.memory[members, -1] = least
        buffer.labels[members] = number
        self.outlying[members] = False
        return []

    def _explained_jointly(self, window, fit, members):
        """Whether the motion that most tracks followed explains them, fitted better."""
        names, counts = np.unique(self.buffer.shown()[members], return_counts=True)
        former = names[counts.argmax()]
        for motion, rows in zip(self.motions, self._groups(), strict=True):
            rows = np.setdiff1d(rows, members)
            if motion.number == former and len(rows) >= FEWEST_TRACKS:
                fits = motion.fit, fit
                joint, apart = joint_motion(window, self.scale, fits, (rows, members))
                if apart < APART:
                    motion.fit = joint
                    return True
        return False

    def _pixel(self):
        """Pixels per pixel of a picture 640 pixels wide."""
        return self.camera.unit * self.camera.noise / 0.15
