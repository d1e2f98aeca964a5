"""Motions of a stream of tracks, carried from frame to frame."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ..geometry.tracks import covered
from .assignment import assign, measure, neighbour_shares, remembered
from .births import (
    LEAST_FREEDOM,
    apartness,
    are_mixed,
    find_candidate,
    is_at_infinity,
    joint_motions,
)
from .buffer import UNKNOWN, TrackBuffer
from .calibration import FRAMES_PER_ESTIMATE
from .doubts import FRAMES_PER_SEARCH, Doubts
from .following import (
    are_doubtful,
    are_outliers,
    can_be_told,
    columns_of,
    fitted_groups,
    may_join,
    newly_held,
)
from .history import History
from .identities import Numbers, Trace, enough_shared, parts, pixel_of
from .living import (
    ALIKE,
    ESTABLISHED,
    LivingMotion,
    advance,
    compare,
    refit,
    verdict,
)
from .renewing import in_order, recognised, rows_of_groups, shared_tracks
from .starting import SCALE_OF_NOISE, SEARCHED_AGAIN, Beginning, calibrate
from .window import FEWEST_TRACKS, LENGTH, Window

# Frames, tracks and observations of each by which motions are found at first.
FIRST_FRAMES, FIRST_TRACKS, FIRST_SEEN = 10, 16, 4
# Share of the scale of residuals that follows what they are now.
FOLLOWING = 0.05
# Frames from one look for new motions to the next. What else takes long is done in the
# frames between: whether motions are of their own is asked in the first of them.
FRAMES_PER_LOOK, ASKED_AT, COMPARED_AT = 3, 1, 2
# Frames in which nothing goes on after which the film was cut: a stray one is none.
CUT_AFTER = 3


class Event(NamedTuple):
    """Something that happened in a stream.

    Parameters
    ----------
    frame : int
        The frame in which it did; 0 is the first.
    kind : str
        Such as "new", for a motion that was not there before.
    words : str
        What happened, in a sentence.

    Examples
    --------
    >>> from skmotionseg.online import Event
    >>> print(Event(12, "new", "motion 2 is new"))
    frame 12: motion 2 is new
    """

    frame: int
    kind: str
    words: str

    def __str__(self):
        return f"frame {self.frame}: {self.words}"


class MotionStream:
    """Motions that live in a stream, and the tracks in view.

    Parameters
    ----------
    n_motions : int or None
        Motions at most; None for any number.
    rng : RandomState
    keep_history : bool
        Whether labels of tracks that are out of view are kept.

    Attributes
    ----------
    frame : int
        Of the newest frame; -1 before the first.
    buffer : TrackBuffer
    motions : list of LivingMotion
    numbers : Numbers
    history : History or None
    camera : Camera or None
        None as long as no motion was found.
    estimate : CameraEstimate or None
        What is known of the camera.
    scale : float
        Of the residuals, in calibrated coordinates.
    size : ndarray of shape (2,)
        Of the picture, pixels: of what the first tracks cover.
    beginning : Beginning or None
        All frames, until the last search of all.
    doubts : Doubts
        Whether the last frames are to be searched.
    """

    def __init__(self, n_motions, rng, keep_history=True, focal_length=None):
        self.n_motions, self.rng, self.focal_length = n_motions, rng, focal_length
        self.frame = -1
        self.buffer = TrackBuffer(LENGTH)
        self.history = History() if keep_history else None
        self.numbers = Numbers()
        self.motions: list[LivingMotion] = []
        self.camera: Any = None
        self.size = np.ones(2)
        self.estimate: Any = None
        self.scale = 0.0
        self.beginning: Any = Beginning()
        self.doubts = Doubts()
        self.broken = 0  # frames in which no track of before goes on

    def step(self, points, ids, partition):
        """Take in a frame.

        Parameters
        ----------
        points : ndarray of shape (n_seen, 2)
            Pixels.
        ids : ndarray of int, shape (n_seen,)
            Each once.
        partition : callable
            ``(points, seen, n_living) -> labels (n,)``: motions ``0..M - 1`` of tracks
            (n, L, 2), the static scene first, -1 for none; so many live already.

        Returns
        -------
        labels : ndarray of int, shape (n_seen,)
        events : list of Event
        """
        self.frame += 1
        rows, new, gone = self.buffer.push(points, ids)
        self._recall(new, gone)
        events = self._continuity(len(ids))
        if self.beginning is not None:
            self.beginning.push(points, ids)
        if self.motions:
            events += self._follow()
            events += self._search_again(partition)
        events += self._forget()
        if not self.motions:
            events += self._start(partition)
        return self.labels()[rows], events

    def labels(self):
        """Labels of the tracks in the buffer: -1 for outliers, and before a start."""
        return np.where(self.buffer.outlying, UNKNOWN, self.buffer.shown())

    def result(self):
        """Ids of all tracks, ascending, and their labels."""
        ids, labels = self.buffer.ids, self.labels()
        if self.history is not None:
            ids, labels = self.history.everything(ids, labels)
        return ids, self.numbers.final(labels)

    # ------------------------------------------------------------------ before motions

    def _recall(self, new, gone):
        """Keep labels of tracks that have left, and find those of what came back."""
        if self.history is not None:
            self.history.add(*gone)
            known = self.history.labels_of(self.buffer.ids[new])
            self.buffer.labels[new] = self.numbers.final(known)
            self.buffer.known[new] = self.buffer.labels[new]

    def _continuity(self, n_seen):
        """Note frames that see nothing, or nothing of before."""
        if n_seen == 0:
            return [Event(self.frame, "empty", "no track is seen")]
        before = self.buffer.seen[:, : -self.broken - 1].any(axis=1)
        goes_on = bool((before & self.buffer.seen[:, -1]).any())
        if goes_on or not before.any():
            resumed, self.broken = self.broken > 0 and goes_on, 0
            words = "tracks of before go on again"
            return [Event(self.frame, "resumed", words)] if resumed else []
        self.broken += 1
        if self.broken > 1:
            return []
        return [Event(self.frame, "break", "no track of the frames before goes on")]

    def _start(self, partition):
        """Find motions among the tracks of the first frames."""
        if self.beginning is None:
            self.beginning = self._last_frames()
        del self.beginning.frames[:-LENGTH]
        if len(self.beginning) < FIRST_FRAMES:
            return []
        rows = np.flatnonzero(self.buffer.seen.sum(axis=1) >= FIRST_SEEN)
        if len(rows) < FIRST_TRACKS:
            return []
        labels = partition(self.buffer.points[rows], self.buffer.seen[rows], 0)
        groups = [rows[labels == k] for k in range(labels.max(initial=-1) + 1)]
        found, self.estimate = calibrate(
            self.buffer.points, self.buffer.seen, rows, groups, self.focal_length
        )
        if np.isfinite(found.nats):
            self.camera, self.scale = found.camera, found.scale
            self.size = _covered(self.buffer)
        for k, (group, fit) in enumerate(zip(groups, found.fits, strict=True)):
            if fit is not None:
                number, _ = self._begin(group, fit, static=k == 0)
                self.buffer.labels[group] = UNKNOWN if number is None else number
                self.buffer.held[group] = number is not None
        self.buffer.memory = np.zeros((len(self.buffer.ids), len(self.motions)))
        if self.motions:  # also tracks that are too short to find motions by follow one
            window = Window(self.buffer.points, self.buffer.seen, self.camera)
            self._assign(window, fitted_groups(self.buffer, self.motions))
        else:
            self.beginning = Beginning()  # to look again
        names = ", ".join(str(motion.number) for motion in self.motions)
        return [Event(self.frame, "start", f"motions {names}")] if names else []

    def _begin(self, group, fit, static):
        """Let a motion live that a search found; say which, and if it did before."""
        former = 0 if static else _most(self.buffer.labels[group])
        living = {motion.number for motion in self.motions}
        number, again = self._number_of(group, living, former)
        if number is not None:
            self.numbers.see(number, self._trace(group))
            self.motions.append(LivingMotion(number, fit, self.frame))
        return number, again

    def _number_of(self, rows, living, former):
        """Number of what has appeared, and whether it was there before."""
        found = self.numbers.of(
            self._trace(rows, first=True),
            self.size,
            living,
            former,
            self.n_motions,
            self._fading(),
        )
        for other in self.motions:
            if other.number == found[0]:  # it has lost its tracks: this one has them
                other.number = UNKNOWN - 1
        return found

    def _search_again(self, partition):
        """Search for motions that were missed, or are taken for one with another."""
        beginning = self._searched_again()
        if beginning is None:
            return []
        events = self._found_in(beginning, partition)
        self.doubts.close(self.frame, bool(events) or len(beginning) > LENGTH)
        return events

    def _found_in(self, beginning, partition):
        """Motions that a search of some frames finds, as events."""
        ids, points, seen = beginning.tracks()
        often = seen.sum(axis=1) >= FIRST_SEEN
        if often.sum() < FIRST_TRACKS:
            return []
        labels = np.full(len(ids), UNKNOWN)
        straight = self.camera.straightened(points[often])
        n_living = sum(not motion.is_candidate for motion in self.motions)
        labels[often] = partition(straight, seen[often], n_living)
        return self._renew(ids, labels) if labels.max() > UNKNOWN else []

    def _searched_again(self):
        """Frames that are searched now: all, as long as they are few, or the last."""
        beginning = self.beginning
        if beginning is not None and len(beginning) in SEARCHED_AGAIN:
            if beginning.is_over:
                self.beginning = None
            return beginning
        soon = beginning is not None and beginning.is_searched_within(FRAMES_PER_SEARCH)
        due = self.doubts.is_due(self.frame) and not soon
        return self._last_frames() if due else None

    def _last_frames(self):
        return Beginning.of(self.buffer, LENGTH)

    def _renew(self, ids, labels):
        """Motions of a new partition of tracks, and those that live.

        Motions that it has as one are merged, unless an earlier one found them, too.
        Others that it misses live on: a search of so few frames misses small things.
        Of groups that are new, the largest begin: as many as it has more than live.
        """
        buffer = self.buffer
        for column in reversed(range(len(self.motions))):
            if self.motions[column].is_candidate:
                self._remove(column, "dropped", None, [])
        groups = rows_of_groups(buffer, ids, labels)
        events: list[Event] = []
        self._merge_parts(groups, events)
        groups, names = recognised(buffer, self.motions, groups)
        window = Window(buffer.points, buffer.seen, self.camera)
        fits = window.fit(groups)
        # What lives already first: what is new is compared with it.
        for k in in_order(groups, names, len(groups) - len(self.motions)):
            if fits[k] is not None:
                names[k] = self._renew_one(window, groups[k], fits[k], names[k], events)
        if self.history is not None:
            told = np.where(labels > UNKNOWN, names[labels], UNKNOWN)
            gone = ~np.isin(ids, buffer.ids) & (told > UNKNOWN)
            self.history.add(ids[gone], told[gone])
        if self.motions:
            self._assign(window, fitted_groups(buffer, self.motions))
        return events

    def _merge_parts(self, groups, events):
        """Merge motions that are in one group, unless they were found apart before."""
        shared = shared_tracks(self.buffer, self.motions, groups)
        for number, other in parts(*shared):
            living = {motion.number: motion for motion in self.motions}
            kept, ended = living.get(number), living.get(other)
            if kept and ended and not ended.is_established:
                self._remove(self.motions.index(ended), "merged", kept, events)

    def _renew_one(self, window, group, fit, number, events):
        """Give a living motion the tracks of a group, or let one begin; its number."""
        if number == UNKNOWN:
            if self._is_alike(window, group, fit):
                return UNKNOWN
            number, again = self._begin(group, fit, static=False)
            if number is None:
                return UNKNOWN
            events.append(_appeared(self.frame, number, again))
            self.buffer.add_motion()
        else:
            (motion,) = (m for m in self.motions if m.number == number)
            motion.fit, motion.refitted = fit, self.frame
            motion.alike = motion.together = 0
            motion.apart = max(motion.apart, ESTABLISHED)
        column = [m.number for m in self.motions].index(number)
        self.buffer.settle(group, number, column)
        return number

    def _is_alike(self, window, group, fit):
        """Whether a motion that lives explains the tracks of another nearly as well.

        What the frames of a window do not tell apart cannot be carried on apart.
        """
        rows = group[window.freedom[group] >= LEAST_FREEDOM]
        fits = [fit, *(motion.fit for motion in self.motions)]
        apart = apartness(window, measure(window, fits, self.scale, rows), 0)[1:]
        return any(
            not is_at_infinity(window, self.scale, motion.fit, (rows, others))
            for motion, worse in zip(self.motions, apart, strict=True)
            if worse < ALIKE
            for others in [np.setdiff1d(self._telling(window, motion), group)]
        )

    # ------------------------------------------------------------------ from then on

    def _follow(self):
        """Bring motions, and the labels of tracks, to the newest frame."""
        window = Window(self.buffer.points, self.buffer.seen, self.camera)
        groups = fitted_groups(self.buffer, self.motions)
        advance(window, self.motions, groups)
        between = self.frame % FRAMES_PER_LOOK > 0
        refit(window, self.motions, groups, self.scale, self.frame, anyway=between)
        residuals = self._assign(window, groups)
        residuals, events = self._judge(window, residuals)
        if self.frame % FRAMES_PER_LOOK == COMPARED_AT:
            self.doubts.ask_of_entered(self.buffer, self.motions)
        self._look(window, residuals)
        self._calibrate(window)
        if self.broken >= CUT_AFTER:
            self._cut()
            events.append(Event(self.frame, "cut", "a cut: all motions have ended"))
        return events

    def _forget(self):
        """Give up motions that were not seen for long, unless their number is known.

        Then what comes back is one of so many.
        """
        if self.n_motions is not None:
            return []
        return [
            Event(self.frame, "gone", f"motion {number} has not been seen for long")
            for number in self.numbers.forget(self.frame)
        ]

    def _calibrate(self, window):
        """Improve the camera."""
        if self.frame % FRAMES_PER_ESTIMATE != COMPARED_AT or not self.motions:
            return
        groups = fitted_groups(self.buffer, self.motions)
        fits = [motion.fit for motion in self.motions]
        camera, known = self.estimate.improved(window, groups, fits)
        self.estimate.add(*known)
        refined = window.seen_by(camera).fit(groups, fits)
        self.scale *= self.camera.unit / camera.unit
        self.camera = camera
        for motion, fit in zip(self.motions, refined, strict=True):
            motion.fit = motion.fit if fit is None else fit

    def _cut(self):
        """End all motions: what comes is another film."""
        for motion in self.motions:
            self.buffer.release(motion.number)
        self.motions, self.broken, self.doubts = [], 0, Doubts()
        self.numbers.forget_all()
        self.buffer.memory = np.zeros((len(self.buffer.ids), 0))
        self.beginning = Beginning.of(self.buffer, CUT_AFTER)

    def _assign(self, window, groups):
        """Residuals of all tracks from all motions, by which tracks follow one."""
        buffer, now = self.buffer, self.buffer.seen[:, -1]
        fits = [motion.fit for motion in self.motions]
        residuals = measure(window, fits, self.scale, groups=groups)
        columns = columns_of(buffer.labels, self.motions)
        judged = now & (window.freedom >= LEAST_FREEDOM)
        residuals = residuals.with_noise(columns, judged & buffer.held)
        shares = self._shares(np.where(judged, columns, UNKNOWN))
        nats = np.where(
            may_join(residuals, columns, self.motions), residuals.nats, np.inf
        )
        chosen = assign(nats, buffer.memory, shares, columns)
        told = can_be_told(window, residuals, buffer.labels, columns, shares) & now
        numbers = np.array([motion.number for motion in self.motions])
        buffer.follow(np.where(told, numbers[chosen], buffer.labels))
        kept = remembered(buffer.memory, residuals.nats, LENGTH)
        buffer.memory = np.where(now[:, None], kept, buffer.memory)
        own = np.take_along_axis(residuals.usual(), chosen[:, None], 1)[:, 0]
        outlying = are_outliers(buffer, np.where(now, own, np.nan))
        buffer.outlying = np.where(now, outlying, buffer.outlying)
        buffer.doubtful = np.where(now, are_doubtful(window, own), buffer.doubtful)
        buffer.hold(newly_held(buffer, self.motions, judged))
        self._follow_noise((own * residuals.noise[chosen])[now])
        return residuals

    def _shares(self, columns):
        """Shares (n, M) of the neighbours of tracks that follow each motion."""
        buffer, now = self.buffer, self.buffer.seen[:, -1]
        places, before = buffer.points[now, -1], buffer.points[now, -2]
        steps = np.where(buffer.seen[now, -2, None], places - before, np.nan)
        noise = self.camera.unit * self.camera.noise
        shares = np.zeros((len(now), len(self.motions)))
        shares[now] = neighbour_shares(
            places, steps, columns[now], len(self.motions), noise
        )
        return shares

    def _follow_noise(self, own):
        own = own[np.isfinite(own)]
        if len(own):
            wanted = SCALE_OF_NOISE * float(np.median(own)) * self.scale
            wanted = np.clip(wanted, self.camera.noise, 2 * self.scale)
            self.scale += FOLLOWING * float(wanted - self.scale)

    def _judge(self, window, residuals):
        """Confirm, drop, merge and hide motions."""
        events: list[Event] = []
        motions = list(self.motions)
        alike, closest = self._compare(window, residuals)
        self._establish(window, closest)
        for k in reversed(range(len(motions))):
            motion, rows = motions[k], self._telling(window, motions[k])
            known = alike[k] if alike[k] in self.motions else None
            decision = verdict(motion, len(rows), known)
            if decision == "joined" and closest[k] not in self.motions:
                decision = None
            decision = self.doubts.weighed(decision, motion, len(rows), self.frame)
            if decision == "confirmed":
                decision = self._confirm(motion, window, events)
            if decision is not None:
                other = closest[k] if decision == "joined" else known
                self._remove(k, decision, other, events)
                residuals = residuals.without(k)
        return residuals, events

    def _telling(self, window, motion):
        """Tracks of a motion in the newest frame that can be judged."""
        own = self.buffer.seen[:, -1] & (self.buffer.labels == motion.number)
        return np.flatnonzero(own & (window.freedom >= LEAST_FREEDOM))

    def _compare(self, window, residuals):
        """The larger motion that each is alike to, and the closest to each; or None."""
        labels = self.buffer.labels
        held = self.buffer.seen[:, -1] & self.buffer.held
        sizes = np.array([np.sum(labels == motion.number) for motion in self.motions])
        telling = [self._telling(window, motion) for motion in self.motions]
        found = []
        for k, motion in enumerate(self.motions):
            if not motion.is_candidate:
                rows = np.flatnonzero(held & (labels == motion.number))
                self.numbers.see(motion.number, self._trace(rows, 1))
            if motion.is_established:
                self.numbers.proven.add(motion.number)
            found.append(compare(window, residuals, self.motions, k, telling, sizes))
        return zip(*found, strict=True)

    def _establish(self, window, closest):
        """Note which motions are of their own, and no parts of the closest.

        Motions of parts of one thing may explain their own tracks better than each
        other's, where the camera is not quite calibrated.
        """
        if self.frame % FRAMES_PER_LOOK != ASKED_AT:
            return
        asked = {
            motion: self._source(motion) if motion.is_candidate else other
            for motion, other in zip(self.motions, closest, strict=True)
            if motion.is_in_question
        }
        joint = self._joint(window, asked)
        for motion, other in asked.items():
            if motion not in joint:
                motion.apart += FRAMES_PER_LOOK * motion.is_apart
                motion.together = 0
                continue
            motion.apart, motion.together = 0, motion.together + 1
            if motion.is_part:
                other.fit = joint[motion]

    def _source(self, candidate):
        """The living motion that most tracks of a candidate followed; or None."""
        former = _most(self.buffer.before[self.buffer.labels == candidate.number])
        known = [motion for motion in self.motions if motion.number == former]
        return known[0] if known else None

    def _joint(self, window, asked):
        """Joint motions of pairs of motions, by the first, where they explain both.

        Any motion goes on as another that is seen after it, and not at the same time.
        """
        pairs = {}
        for motion, other in asked.items():
            rows = self._telling(window, motion)
            seen = other is not None and not other.unseen
            others = fitted_groups(self.buffer, [other])[0] if seen else rows[:0]
            if min(len(others), len(rows)) >= FEWEST_TRACKS:
                pairs[motion] = (other.fit, motion.fit), (others, rows)
        found = joint_motions(window, self.scale, list(pairs.values()))
        return {
            motion: fit
            for motion, (fit, saved, worse) in zip(pairs, found, strict=True)
            if saved <= 0 or (worse < ALIKE and self._are_mixed(pairs[motion][1]))
        }

    def _are_mixed(self, groups):
        """Whether two groups are in one place of the newest frame."""
        now = self.buffer.seen[:, -1]
        names = np.cumsum(now) - 1
        seen = [names[rows[now[rows]]] for rows in groups]
        return are_mixed(self.buffer.points[now, -1], seen)

    def _confirm(self, motion, window, events):
        """Give a candidate a number; "dropped" if there are as many as may be.

        Or if the motion that its tracks followed before explains them, fitted better.
        """
        source = self._source(motion)
        joint = self._joint(window, {motion: source})
        if joint:
            source.fit, self.doubts.is_open = joint[motion], True
            return "dropped"
        rows = self._telling(window, motion)
        living = {other.number for other in self.motions if not other.unseen}
        number, again = self._number_of(rows, living, self._former(rows))
        if number is None:
            return "dropped"
        self.buffer.confirm(motion.number, number)
        motion.number, motion.apart = number, 0
        motion.source = _most(self.buffer.known[rows])
        events.append(_appeared(self.frame, number, again))
        return None

    def _former(self, rows):
        """The number of a motion that has explained what some tracks are; or None.

        They are most of those in the newest frame that it has explained.
        """
        now, known = self.buffer.seen[:, -1], self.numbers.final(self.buffer.known)
        own = known[rows][known[rows] > UNKNOWN]
        if len(own) == 0:
            return None
        former = _most(own)
        shared, of = np.sum(own == former), np.sum(known[now] == former)
        return former if enough_shared(shared, of) else None

    def _fading(self):
        """Numbers of motions that have lost their tracks."""
        return [
            other.number
            for other in self.motions
            if other.unseen and other.is_established
        ]

    def _trace(self, rows, n_frames=LENGTH, first=False):
        """Where some tracks are in the last frames."""
        points, seen = self.buffer.points[rows], self.buffer.seen[rows]
        start = self.frame - n_frames + 1
        last = points[:, -n_frames:], seen[:, -n_frames:]
        return Trace.of(start, *last, first, pixel_of(self.size))

    def _remove(self, column, decision, other, events):
        """Take a motion out of the living."""
        motion = self.motions.pop(column)
        buffer = self.buffer
        buffer.memory = np.delete(buffer.memory, column, axis=1)
        if motion.is_candidate:
            buffer.release(motion.number)
            return
        decision, heir = self._successor(motion, decision, other)
        words = f"motion {motion.number} is out of view"
        if decision == "merged":
            self._join(motion.number, other.number)
            words = f"motion {motion.number} is the same as {other.number}"
        elif heir is not None:
            decision = "merged"
            words = f"motion {heir.number} is the same as {motion.number}"
            self._join(heir.number, motion.number)
            heir.number, heir.apart = motion.number, motion.apart
        elif motion.number in self.numbers.proven or self.n_motions is not None:
            # Else it may not have been one; but of so many, its number is free again.
            self.numbers.hide(motion.number)
        events.append(Event(self.frame, decision, words))

    def _successor(self, motion, decision, other):
        """What becomes of the number of a motion that ends, and who has it next.

        The number of a motion that was of its own for long is no other's: if it is the
        same as a newer one, this is what has come back, and goes on with its number; if
        as another of that kind, something else was taken for it, and it is still away.
        """
        heir = other if decision == "continued" else self._heir(motion)
        if decision not in ("joined", "merged"):
            return decision, heir
        proven = self.numbers.proven
        if motion.number not in proven:
            return "merged", None
        if other.number not in proven:
            return "continued", other
        own = self.buffer.labels == motion.number
        self.buffer.labels = np.where(own, other.number, self.buffer.labels)
        return "hidden", None

    def _join(self, number, other):
        """Give tracks of a motion the number of another."""
        self.numbers.merge(number, other)
        self.buffer.labels = self.numbers.final(self.buffer.labels)

    def _heir(self, motion):
        """What has taken the tracks of a motion, and may not be one of its own.

        It began while the motion was seen, or has most of its tracks now.
        """
        taker = self.buffer.taker(motion.number)
        known = [
            other
            for other in self.motions
            if (other.source == motion.number and not other.is_established)
            or (other.number == taker and other.age < motion.age)
            if not other.is_candidate
        ]
        return known[0] if known else None

    def _look(self, window, residuals):
        """Look for a motion of tracks that none explains: a candidate."""
        if self.frame % FRAMES_PER_LOOK or not self.motions:
            return
        buffer, columns = self.buffer, columns_of(self.buffer.labels, self.motions)
        chosen = np.where(columns < 0, residuals.nats.argmin(axis=1), columns)
        now = buffer.seen[:, -1]
        fit, members = find_candidate(
            window, residuals, chosen, buffer.points[:, -1], now, self.rng
        )
        if fit is None:
            return
        buffer.add_motion()
        number = UNKNOWN - 1 - self.frame
        self.motions.append(LivingMotion(number, fit, self.frame))
        labels = buffer.labels.copy()
        labels[members] = number
        buffer.follow(labels)
        buffer.outlying[members], buffer.held[members] = False, True


def _appeared(frame, number, again):
    kind, words = ("again", "is seen again") if again else ("new", "is new")
    return Event(frame, kind, f"motion {number} {words}")


def _covered(buffer):
    low, high = covered(buffer.points, buffer.seen)
    return np.where(high > low, high - low, 1)


def _most(labels):
    """The most frequent of some labels."""
    names, counts = np.unique(labels, return_counts=True)
    return int(names[counts.argmax()])
