"""Motions carried from frame to frame, the first ones being told."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from helpers.films import SIZE, drive, film, together
from numpy.testing import assert_array_equal

from skmotionseg._core.stream.identities import Trace
from skmotionseg._core.stream.living import LivingMotion
from skmotionseg._core.stream.starting import SEARCHED_AGAIN
from skmotionseg._core.stream.stream import FIRST_FRAMES, FIRST_SEEN, MotionStream


def told(movie, known=lambda things, n_frames: things):
    """A partition that recognises tracks of a film, of which something is known.

    They are where they were, as far as a lens may have been straightened.
    """

    def partition(points, seen, n_living):
        near = np.flatnonzero(seen.sum(axis=1) >= 4)
        assert_array_equal(near, np.arange(len(points)))
        n_frames = int(seen.any(axis=0).sum())
        rows = [
            recognised(movie, p[-n_frames:], s[-n_frames:])
            for p, s in zip(points, seen, strict=True)
        ]
        return known(movie.things[rows], n_frames)

    return partition


def recognised(movie, places, seen):
    """The track that is seen in the same first frames, in places like these."""
    same = np.flatnonzero((movie.seen[:, : len(seen)] == seen).all(axis=1))
    away = np.abs(movie.points[same][:, : len(seen)] - places)[:, seen].max(axis=(1, 2))
    assert away.min() < 40
    return same[away.argmin()]


def test_motions_that_are_told_go_on():
    movie = film(n_frames=FIRST_FRAMES + 8, life=60, n_static=150, n_moving=60)
    stream = MotionStream(None, np.random.RandomState(0))
    partition = told(movie)
    for frame in range(movie.n_frames):
        points, ids = movie.frame(frame)
        labels, events = stream.step(points, ids, partition)
        if frame < FIRST_FRAMES - 1:
            assert (labels == -1).all()
        if frame == FIRST_FRAMES - 1:
            assert list(map(str, events)) == [f"frame {frame}: motions 0, 1"]
    assert (labels == movie.things[ids]).mean() > 0.97
    ids, labels = stream.result()
    assert (np.diff(ids) > 0).all()


def test_nothing_begins_without_a_partition():
    movie = film(n_frames=FIRST_FRAMES + 2)
    stream = MotionStream(None, np.random.RandomState(0))
    for frame in range(movie.n_frames):
        labels, events = stream.step(
            *movie.frame(frame), lambda points, seen, n_living: np.full(len(points), -1)
        )
        assert not events
    assert (labels == -1).all()


def play(movie, partition, n_motions=None):
    """Labels of the newest frame, the stream, and all events."""
    stream, happened = MotionStream(n_motions, np.random.RandomState(0)), []
    for frame in range(movie.n_frames):
        points, ids = movie.frame(frame)
        labels, events = stream.step(points, ids, partition)
        happened += [(event.kind, event.frame) for event in events]
    return labels, ids, stream, happened


@pytest.fixture(scope="module")
def movie():
    return film(n_frames=SEARCHED_AGAIN[1], life=14, n_static=260, n_moving=120)


def without_the_thing(things, n_frames):
    """What a search says that misses the thing in the first frames."""
    return things if n_frames >= SEARCHED_AGAIN[0] else np.zeros_like(things)


def only_at_first(things, n_frames):
    """What a search says that rejects the thing later."""
    return things if n_frames < SEARCHED_AGAIN[0] else -things


def one_later(after):
    """What a search says that has two things as one, from a number of frames on."""
    return lambda things, n_frames: things * (n_frames < after)


def test_what_first_frames_do_not_show_is_found_when_they_are_searched_again(
    movie, monkeypatch
):
    nothing = None, np.arange(0)
    name = "skmotionseg._core.stream.stream.find_candidate"
    monkeypatch.setattr(name, lambda *args: nothing)  # nor is it found between searches
    labels, ids, stream, happened = play(movie, told(movie, without_the_thing))
    assert happened == [
        ("start", FIRST_FRAMES - 1),
        ("new", SEARCHED_AGAIN[0] - 1),
    ]
    assert (labels == movie.things[ids]).mean() > 0.97
    # Also tracks that had left by then, and were taken for the scene's.
    ids, labels = stream.result()
    left = ~movie.seen[ids, SEARCHED_AGAIN[0] - 1 :].any(axis=1)
    left &= (movie.seen[ids].sum(axis=1) >= 4) & (movie.things[ids] == 1)
    assert left.sum() >= 3
    assert (labels[left] == 1).mean() > 0.9


def test_a_search_ends_no_motion(movie):
    labels, ids, _, happened = play(movie, told(movie, only_at_first))
    assert happened == [("start", FIRST_FRAMES - 1)]
    assert (labels == movie.things[ids]).mean() > 0.97


def test_a_search_merges_what_the_first_frames_have_as_two(movie, monkeypatch):
    nothing = None, np.arange(0)
    name = "skmotionseg._core.stream.stream.find_candidate"
    monkeypatch.setattr(name, lambda *args: nothing)
    partition = told(movie, one_later(SEARCHED_AGAIN[0]))
    labels, _, stream, happened = play(movie, partition)
    assert happened == [("start", FIRST_FRAMES - 1), ("merged", SEARCHED_AGAIN[0] - 1)]
    assert labels.max() == 0
    assert set(stream.result()[1]) <= {-1, 0}


def test_what_was_found_apart_twice_is_not_merged(movie):
    partition = told(movie, one_later(SEARCHED_AGAIN[1]))
    labels, ids, _, happened = play(movie, partition)
    assert happened == [("start", FIRST_FRAMES - 1)]
    assert (labels == movie.things[ids]).mean() > 0.97


def test_no_more_groups_begin_than_there_are_more_motions(movie, monkeypatch):
    """Of another partition into as many motions, none is new."""
    renewed, whole = [], MotionStream._renew_one

    def renew_one(self, window, group, fit, number, events):
        renewed.append(int(number))
        return whole(self, window, group, fit, number, events)

    def other(things, n_frames):
        halves = np.arange(len(things)) % 3 == 0
        later = np.where(things == 0, halves, -1)
        return things if n_frames < SEARCHED_AGAIN[0] else later

    monkeypatch.setattr(MotionStream, "_renew_one", renew_one)
    _, _, _, happened = play(movie, told(movie, other))
    assert set(renewed) == {0}
    assert happened == [("start", FIRST_FRAMES - 1)]


def in_two(things, n_frames):
    """What a search says that makes two motions of the scene later."""
    halves = np.where(np.arange(len(things)) % 3 == 0, 2, 0)
    return np.where(things == 0, halves * (n_frames >= SEARCHED_AGAIN[0]), things)


def test_motions_that_the_last_frames_do_not_tell_apart_do_not_begin(movie):
    labels, ids, _, happened = play(movie, told(movie, in_two))
    assert happened == [("start", FIRST_FRAMES - 1)]
    assert (labels == movie.things[ids]).mean() > 0.97


def test_what_is_new_is_compared_with_what_lives_as_the_search_has_it(
    movie, monkeypatch
):
    """And not with what lived before, which may be a motion of both."""
    renewed, whole = [], MotionStream._renew_one

    def renew_one(self, window, group, fit, number, events):
        renewed.append(int(number))
        return whole(self, window, group, fit, number, events)

    monkeypatch.setattr(MotionStream, "_renew_one", renew_one)
    first_new = told(movie, lambda *known: 1 - without_the_thing(*known))
    _, _, _, happened = play(movie, first_new)
    assert renewed == [0, -1, 1, 0]
    assert ("new", SEARCHED_AGAIN[0] - 1) in happened


def test_a_search_gives_no_more_numbers_than_motions(movie):
    labels, _, stream, _ = play(movie, told(movie, without_the_thing), n_motions=1)
    assert labels.max() == 0
    assert stream.numbers.next == 1


@pytest.mark.parametrize("n_motions", [None, 2])
def test_what_is_away_for_long_is_given_up_unless_its_number_is_known(n_motions):
    """Also while nothing is seen; then what comes back is one of so many."""
    movie = film(n_frames=FIRST_FRAMES + 2, n_static=60, n_moving=30)
    stream = MotionStream(n_motions, np.random.RandomState(0))
    begins, kinds = told(movie), []

    def partition(points, seen, n_living):
        nothing = np.full(len(points), -1)
        return nothing if n_living else begins(points, seen, n_living)

    for frame in range(movie.n_frames + 130):
        seen = movie.frame(frame) if frame < movie.n_frames else ([], [])
        points, ids = (np.asarray(each) for each in seen)
        _, events = stream.step(points.reshape(-1, 2), ids.astype(int), partition)
        kinds += [event.kind for event in events]
        if n_motions is None:
            stream.numbers.proven.update(range(stream.numbers.next))
    assert kinds.count("hidden") == 2
    assert kinds.count("gone") == (2 if n_motions is None else 0)
    assert (set(stream.numbers.traces) == set()) == (n_motions is None)


def test_frames_are_kept_until_the_last_search():
    movie = film(n_frames=SEARCHED_AGAIN[-1], life=20, n_static=90, n_moving=30)
    asked = []

    def known(things, n_frames):
        asked.append(n_frames)
        return things

    _, _, stream, _ = play(movie, told(movie, known))
    assert asked == [FIRST_FRAMES, *SEARCHED_AGAIN]
    assert stream.beginning is None


class Ending:
    """A stream in which a motion ends that others explain."""

    def __init__(self, proven):
        self.stream = MotionStream(None, np.random.RandomState(0))
        self.stream.numbers.proven = set(proven)
        self.stream.motions = [
            LivingMotion(number, None, 0, age=30 - number) for number in range(4)
        ]
        trace = Trace.of(0, np.zeros((3, 1, 2)), np.ones((3, 1), dtype=bool))
        for _ in range(4):
            self.stream.numbers.see(self.stream.numbers.new(), trace)
        buffer = self.stream.buffer
        buffer.push(np.zeros((20, 2)), np.arange(20))
        buffer.follow(np.repeat([0, 1, 2, 3], 5))
        buffer.memory = np.zeros((20, 4))

    def end(self, number, decision, other=None):
        """Numbers of the living, what is hidden, and the words of the event."""
        motions, events = self.stream.motions, []
        known = motions[other] if other is not None else None
        self.stream._remove(number, decision, known, events)
        numbers = [motion.number for motion in motions]
        words = str(events[0]).split(": ")[1]
        assert events[0].kind == ("merged" if "the same as" in words else "hidden")
        return numbers, self.stream.numbers.hidden, words


def test_what_was_of_its_own_for_a_short_time_only_ends_in_another():
    ending = Ending(proven=[0])
    found = ending.end(2, "joined", 0)
    assert found == ([0, 1, 3], set(), "motion 2 is the same as 0")
    assert_array_equal(ending.stream.labels(), np.repeat([0, 1, 0, 3], 5))


def test_a_motion_that_is_the_same_as_a_newer_one_goes_on_in_it():
    ending = Ending(proven=[0, 2])
    found = ending.end(2, "joined", 3)
    assert found == ([0, 1, 2], set(), "motion 3 is the same as 2")
    assert_array_equal(ending.stream.labels(), np.repeat([0, 1, 2, 2], 5))


def test_a_return_that_was_none_does_not_end_a_motion():
    ending = Ending(proven=[0, 2])
    found = ending.end(2, "joined", 0)
    assert found == ([0, 1, 3], {2}, "motion 2 is out of view")
    assert_array_equal(ending.stream.labels(), np.repeat([0, 1, 0, 3], 5))
    # What its tracks of before had as label stays.
    assert_array_equal(ending.stream.numbers.final(np.array([2])), [2])


def test_what_has_taken_the_tracks_of_a_motion_is_that_motion():
    ending = Ending(proven=[0, 2])
    ending.stream.buffer.follow(np.repeat([0, 1, 3, 3], 5))
    found = ending.end(2, "hidden")
    assert found == ([0, 1, 3], {2}, "motion 2 is out of view")  # they are too few
    ending = Ending(proven=[0, 2])
    ending.stream.buffer.follow(np.repeat([0, 2, 2, 3], 5))
    ending.stream.buffer.follow(np.repeat([0, 3, 3, 3], 5))
    found = ending.end(2, "hidden")
    assert found == ([0, 1, 2], set(), "motion 3 is the same as 2")


def test_a_motion_that_is_older_takes_no_number():
    ending = Ending(proven=[0, 2])
    ending.stream.buffer.follow(np.repeat([0, 2, 2, 3], 5))
    ending.stream.buffer.follow(np.repeat([0, 1, 1, 3], 5))
    found = ending.end(2, "hidden")
    assert found == ([0, 1, 3], {2}, "motion 2 is out of view")


def test_a_stream_sees_through_its_lens():
    movie = film(n_frames=32, life=60, n_static=150, n_moving=60, noise=0.05)
    away = (movie.points - SIZE / 2) / np.hypot(*SIZE) * 2
    bent = 1 - 0.06 * (away**2).sum(axis=2, keepdims=True)
    movie = movie._replace(points=away * bent * np.hypot(*SIZE) / 2 + SIZE / 2)
    labels, ids, stream, happened = play(movie, told(movie))
    assert happened == [("start", FIRST_FRAMES - 1)]
    assert (labels == movie.things[ids]).mean() > 0.97
    assert abs(stream.camera.bend + 0.06) < 0.02


class Confirming:
    """A stream of two motions, and of a candidate that is to get a number."""

    def __init__(self, before, n_motions=None, explained=True):
        self.stream = MotionStream(n_motions, np.random.RandomState(0))
        self.stream.frame, self.stream.size = 5, SIZE
        self.stream.motions = [
            LivingMotion(number, None, 0, age=30) for number in (0, 1, -7)
        ]
        self.candidate = self.stream.motions[-1]
        self.candidate.apart = 8
        for _ in range(2):
            self.stream.numbers.new()
        buffer = self.stream.buffer
        rng = np.random.default_rng(0)
        buffer.push(rng.uniform(0, 100, size=(30, 2)), np.arange(30))
        buffer.follow(np.repeat([0, 1 if before != 1 else 0, before], 10))
        buffer.hold(np.full(30, explained))
        labels = buffer.labels.copy()
        labels[20:] = -7
        buffer.follow(labels)

    def confirm(self):
        """What is decided, and what has happened."""
        window = SimpleNamespace(freedom=np.full(30, 9), fit=lambda *_: [])
        events = []
        decision = self.stream._confirm(self.candidate, window, events)
        return decision, [(event.kind, event.words) for event in events]


def test_a_candidate_gets_a_new_number():
    confirming = Confirming(before=-1)
    assert confirming.confirm() == (None, [("new", "motion 2 is new")])
    candidate = confirming.candidate
    assert (candidate.number, candidate.apart, candidate.source) == (2, 0, -1)
    assert_array_equal(confirming.stream.labels(), np.repeat([0, 1, 2], 10))


def test_a_candidate_is_dropped_where_there_are_as_many_as_may_be():
    confirming = Confirming(before=-1, n_motions=2)
    assert confirming.confirm() == ("dropped", [])
    assert confirming.candidate.number == -7
    assert_array_equal(confirming.stream.labels(), np.repeat([0, 1, -1], 10))


def test_a_candidate_that_has_all_tracks_of_a_motion_gets_its_number():
    confirming = Confirming(before=1)
    confirming.stream.motions[1].unseen = 1
    assert confirming.confirm() == (None, [("again", "motion 1 is seen again")])
    assert (confirming.candidate.number, confirming.candidate.source) == (1, 1)
    # What had it before is of no number, and ends.
    assert [m.number for m in confirming.stream.motions] == [0, -2, 1]
    assert_array_equal(confirming.stream.labels(), np.repeat([0, 0, 1], 10))


def test_a_candidate_that_takes_the_place_of_a_motion_gets_a_new_number():
    # Its tracks followed the motion, which never explained them.
    confirming = Confirming(before=1, explained=False)
    confirming.stream.motions[1].unseen = 1
    assert confirming.confirm() == (None, [("new", "motion 2 is new")])
    assert confirming.candidate.source == -1


@pytest.mark.parametrize(
    ("own", "elsewhere", "number"), [(4, 3, 1), (4, 5, 2), (2, 0, 2)]
)
def test_a_candidate_is_what_has_explained_most_of_its_tracks_before(
    own, elsewhere, number
):
    confirming = Confirming(before=-1)
    confirming.stream.motions[1].unseen = 1
    known = confirming.stream.buffer.known
    known[10:20], known[20 : 20 + own] = -1, 1
    known[10 : 10 + elsewhere] = 1
    confirming.confirm()
    assert confirming.candidate.number == number


def test_a_motion_goes_on_as_any_that_is_seen_after_it(monkeypatch):
    # So one that explains both says nothing.
    monkeypatch.setattr(
        "skmotionseg._core.stream.stream.joint_motions",
        lambda window, scale, pairs: [("both", -1.0, 0.0) for _ in pairs],
    )
    confirming = Confirming(before=-1)
    motion, candidate = confirming.stream.motions[1:]
    window = SimpleNamespace(freedom=np.full(30, 9))
    joint = confirming.stream._joint
    assert joint(window, {candidate: motion}) == {candidate: "both"}
    motion.unseen = 1
    assert joint(window, {candidate: motion}) == {}


def test_a_candidate_that_is_what_its_tracks_followed_is_dropped(monkeypatch):
    confirming = Confirming(before=1)
    motion, candidate = confirming.stream.motions[1:]
    monkeypatch.setattr(
        confirming.stream, "_joint", lambda _, asked: {candidate: ("both", *asked)}
    )
    assert confirming.confirm() == ("dropped", [])
    assert motion.fit == ("both", candidate)  # that explains them, too
    assert candidate.number == -7


def test_frames_that_see_nothing_of_before_are_noted_once():
    stream = MotionStream(None, np.random.RandomState(0))
    happened = []
    for ids in (range(3), range(3), (), range(5, 8), range(9, 12), range(3), range(3)):
        ids = np.array(ids, dtype=int)
        _, events = stream.step(np.zeros((len(ids), 2)), ids, None)
        happened.append([event.kind for event in events])
    assert happened == [[], [], ["empty"], ["break"], [], ["resumed"], []]


def test_what_enters_and_is_taken_for_another_thing_is_searched_for(monkeypatch):
    """Where it does not even become a candidate."""
    prefix = "skmotionseg._core.stream.stream."
    monkeypatch.setattr(prefix + "find_candidate", lambda *args: (None, np.arange(0)))
    for module in (prefix, "skmotionseg._core.stream.starting."):
        monkeypatch.setattr(module + "SEARCHED_AGAIN", ())
    beside, speed = np.array([0.0, 1.8, -1.0]), np.array([0, 0, 0.08])

    def path(frame):
        return drive(frame) + beside + frame * speed

    entering = film(26, path=path, seed=1)
    entering.seen[entering.things == 1, :12] = False
    movie = together(film(26), entering)
    stream = MotionStream(None, np.random.RandomState(0))

    def partition(points, seen, n_living):
        often = stream.buffer.seen.sum(axis=1) >= FIRST_SEEN
        return movie.things[stream.buffer.ids[often]]

    happened = []
    for frame in range(movie.n_frames):
        points, ids = movie.frame(frame)
        labels, events = stream.step(points, ids, partition)
        happened += [(event.kind, event.frame) for event in events]
    assert happened[0] == ("start", FIRST_FRAMES - 1)
    assert [kind for kind, _ in happened[1:]] == ["new"]
    assert 12 < happened[1][1] <= 22
    assert (labels == movie.things[ids]).mean() > 0.97


def test_few_tracks_are_not_searched_again():
    stream = MotionStream(None, np.random.RandomState(0))
    for frame in range(SEARCHED_AGAIN[0]):
        ids = np.arange(10) + 10 * (frame // 3)  # none is seen often
        stream.beginning.push(np.zeros((10, 2)), ids)
    asked = []
    assert stream._search_again(lambda *tracks: asked.append(tracks)) == []
    assert not asked
