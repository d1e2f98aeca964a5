"""Frame by frame: identities that last, whatever comes."""

from __future__ import annotations

import pickle
from types import SimpleNamespace

import numpy as np
import pytest
from helpers.films import FOCAL, enter, film, stop_and_go, together
from numpy.testing import assert_array_equal
from sklearn.base import clone
from sklearn.exceptions import NotFittedError

from skmotionseg import (
    MotionSegmenter,
    OnlineMotionSegmenter,
    pack_tracks,
)
from skmotionseg._core.partition.scene import background_motion
from skmotionseg._segmenter.reasons import stream_reasons
from skmotionseg.metrics import misclassification_error
from skmotionseg.online import _with_first, _with_living


def play(movie, segmenter=None, frames=None, shuffle=None, pieces=()):
    """Labels of each frame, (n_frames, n_tracks), -2 where unseen; and all events."""
    segmenter = (
        OnlineMotionSegmenter(random_state=0) if segmenter is None else segmenter
    )
    frames = range(movie.n_frames) if frames is None else frames
    table, events = np.full((movie.n_frames, len(movie.points)), -2), []
    for frame in frames:
        points, ids = movie.frame(frame)
        if shuffle is not None:
            order = shuffle.permutation(len(ids))
            points, ids = points[order], ids[order]
        if frame in pieces:
            segmenter = pickle.loads(pickle.dumps(segmenter))
        table[frame, ids] = segmenter.update(points, ids)
        events += segmenter.events_
    return table, events, segmenter


def kinds(events):
    return [event.kind for event in events]


def partition_by_graph(self, points, seen, n_living):
    """In the place of a search, which takes ten times as long."""
    n_motions = min(2, self.n_motions) if self.n_motions != "auto" else 2
    search = MotionSegmenter(
        n_motions, selection="ncre", n_hypotheses=50, random_state=0
    )
    labels = search.fit_predict(pack_tracks(points, seen))
    return _with_first(labels, background_motion(points, seen, labels))


@pytest.fixture
def started_by_graph(monkeypatch):
    """Where it does not matter how the motions of the first frames are found."""
    monkeypatch.setattr(OnlineMotionSegmenter, "_partition", partition_by_graph)


@pytest.fixture(scope="module")
def movie():
    return film(n_frames=26, n_static=60, n_moving=30, life=22)


@pytest.fixture(scope="module")
def halves(movie):
    """What playing the film gives, and its segmenter pickled on the way."""
    table, events, pickles, segmenter = [], [], {}, None
    for frame in range(movie.n_frames):
        pickles[frame] = pickle.dumps(segmenter)
        row, more, segmenter = play(movie, segmenter, [frame])
        table.append(row[frame])
        events += more
    return (np.stack(table), events, segmenter), pickles


@pytest.fixture(scope="module")
def played(halves):
    return halves[0]


@pytest.fixture(scope="module")
def half(halves):
    """The segmenter after twenty frames; after two more it searches again."""
    return halves[1][20]


@pytest.fixture(scope="module")
def searched(halves):
    """The segmenter after 22 frames, none of the next ten of which is searched."""
    return halves[1][22]


def test_a_focal_length_that_is_given_is_kept(movie, started_by_graph):
    segmenter = OnlineMotionSegmenter(focal_length=FOCAL, random_state=0)
    _, _, segmenter = play(movie, segmenter, range(13))
    assert segmenter._stream.camera.unit == pytest.approx(FOCAL)
    assert segmenter.n_motions_ == 2


@pytest.mark.parametrize("name, value", [("n_motions", 0), ("keep_history", False)])
def test_parameters_cannot_change_after_the_first_frame(name, value, movie):
    points, ids = movie.frame(0)
    segmenter = OnlineMotionSegmenter(random_state=np.random.RandomState(0))
    segmenter.update(points, ids)
    old = segmenter.get_params()
    segmenter.set_params(**{name: value})
    words = rf"{name} was {old[name]!r} and is {value!r}: clone\(segmenter\) starts"
    with pytest.raises(ValueError, match=words):
        segmenter.update(points, ids)
    assert segmenter.n_frames_ == 1
    # As they were, it goes on, be it somewhere else.
    segmenter = pickle.loads(pickle.dumps(segmenter.set_params(**{name: old[name]})))
    segmenter.update(points, ids)
    segmenter.random_state = np.random.RandomState(0)  # another one
    with pytest.raises(ValueError, match="random_state was"):
        segmenter.update(points, ids)
    clone(segmenter.set_params(keep_history=False)).update(points, ids)


def test_identities_last(movie, played):
    table, events, segmenter = played
    assert kinds(events) == ["start"]
    later = table[10:]
    right = (later == movie.things) | (later == -2)
    assert right.mean() > 0.99
    assert segmenter.n_motions_ == 2
    assert_array_equal(segmenter.motions_, [0, 1])
    assert segmenter.background_ == 0
    assert segmenter.n_frames_ == movie.n_frames


def test_newest_frame_is_kept(movie, played):
    table, _, segmenter = played
    last = movie.n_frames - 1
    _, ids = movie.frame(last)
    assert_array_equal(segmenter.track_ids_, ids)
    assert_array_equal(segmenter.labels_, table[last, ids])
    assert_array_equal(segmenter.label_reasons_ == "assigned", table[last, ids] >= 0)


def test_reasons_say_why_a_track_has_no_motion(movie, searched):
    segmenter = OnlineMotionSegmenter(random_state=0)
    play(movie, segmenter, range(9))
    assert set(segmenter.label_reasons_) == {"no motions yet"}
    points, seen, _ = movie
    lost = np.flatnonzero(seen[:, 16:26].all(axis=1))[0]
    points = points.copy()
    points[lost, 22:] += 40  # the tracker has gone to something else
    segmenter = pickle.loads(searched)
    play(movie._replace(points=points), segmenter, range(22, 26))
    (at,) = np.flatnonzero(segmenter.track_ids_ == lost)
    assert segmenter.labels_[at] == -1
    assert segmenter.label_reasons_[at] == "outlier"
    assert (segmenter.label_reasons_ == "assigned").mean() > 0.95


def test_each_track_has_one_reason():
    labels = np.array([0, -1, -1, -1, 2])
    outlying = np.array([False, True, False, False, False])
    candidates = np.array([False, False, True, False, True])
    reasons = stream_reasons(labels, outlying, candidates, any_motion=True)
    expected = ["assigned", "outlier", "candidate", "too short", "assigned"]
    assert reasons.tolist() == expected
    reasons = stream_reasons(np.full(5, -1), outlying, candidates, any_motion=False)
    assert set(reasons) == {"no motions yet"}


def test_result_has_all_tracks(movie, played):
    table, _, segmenter = played
    found = segmenter.result()
    seen = np.flatnonzero(movie.seen.any(axis=1))
    assert_array_equal(found.track_ids, seen)
    assert found.n_motions == 2
    long = movie.seen[seen].sum(axis=1) >= 5
    assert misclassification_error(movie.things[seen[long]], found.labels[long]) < 0.03
    last = np.array([table[table[:, track] > -2, track][-1] for track in seen])
    started = movie.seen[seen, 10:].any(axis=1)
    assert_array_equal(found.labels[started], last[started])


@pytest.mark.parametrize(
    "n_frames, pieces",
    [(17, range(17)), pytest.param(25, (3, 9, 10, 23), marks=pytest.mark.long)],
)
def test_pickled_pieces_in_any_order_give_the_same_labels(
    movie, halves, n_frames, pieces
):
    """Whether it is pickled changes nothing, nor in which order tracks come."""
    (all_labels, all_events, _), pickles = halves
    order = np.random.default_rng(0)
    table, events, segmenter = play(
        movie, frames=range(n_frames), shuffle=order, pieces=pieces
    )
    assert_array_equal(table[:n_frames], all_labels[:n_frames])
    assert events == [event for event in all_events if event.frame < n_frames]
    assert segmenter._stream.scale == pickle.loads(pickles[n_frames])._stream.scale


@pytest.fixture(scope="module")
def come_and_gone():
    """A film of a thing that stops, and of one that enters; its labels and events."""
    films = [
        film(49, n_static=45, n_moving=18, path=path, seed=seed)
        for seed, path in enumerate([stop_and_go, enter])
    ]
    movie = together(*films)
    table, events, _ = play(movie)
    return movie, table, events


def test_what_enters_gets_a_new_number_within_a_second(come_and_gone):
    movie, table, events = come_and_gone
    thing = movie.things == 2
    shown = table[45, thing & movie.seen[:, 45]]
    assert (shown == 2).mean() > 0.9
    assert kinds(events) == ["start", "new"]
    entered = np.flatnonzero(movie.seen[thing].sum(axis=0) >= 6)[0]
    assert entered < events[1].frame <= entered + 25
    assert (table[10:, ~thing] <= 1).all()


def test_what_stops_keeps_its_number(come_and_gone):
    movie, table, events = come_and_gone
    assert kinds(events) == ["start", "new"]  # and that is what enters
    thing = movie.things == 1
    for frame in (11, 25, 40, 48):
        shown = table[frame, thing & movie.seen[:, frame]]
        assert (shown == 1).mean() > 0.9, frame
    assert (table[10:, movie.things == 0] <= 0).all()


def test_no_more_numbers_than_motions():
    movie = film(40, n_static=45, n_moving=18, path=enter)
    table, events, _ = play(movie, OnlineMotionSegmenter(1, random_state=0))
    assert kinds(events) == ["start"]
    assert table.max() == 0


def gone_for_a_while():
    """A film of a thing that is gone longer than what is in view is remembered."""
    movie = film(n_frames=32)
    seen = movie.seen.copy()
    seen[movie.things == 1, 16:30] = False
    return movie._replace(seen=seen)


def test_track_that_comes_back_is_the_same(started_by_graph):
    movie = gone_for_a_while()
    _, seen, things = movie
    table, events, _ = play(movie)
    before, back = seen[:, 11:16].any(axis=1), seen[:, 30:].all(axis=1)
    back &= before & (things == 1)
    assert back.sum() >= 3
    assert (table[31:, back] == 1).mean() > 0.9
    assert "hidden" in kinds(events)


def test_without_history_only_what_is_in_view_is_known(movie, started_by_graph):
    segmenter = OnlineMotionSegmenter(keep_history=False, random_state=0)
    _, _, segmenter = play(movie, segmenter, range(14))
    lately = movie.seen[:, 2:14].any(axis=1)
    assert (movie.seen[:, :2].any(axis=1) & ~lately).any()
    assert_array_equal(segmenter.result().track_ids, np.flatnonzero(lately))


def test_empty_frames_are_survived(movie, half):
    _, seen, things = movie
    seen = seen.copy()
    seen[:, [4, 20, 21]] = False
    gappy = movie._replace(seen=seen)
    table, events, _ = play(gappy, frames=range(13))
    assert kinds(events) == ["empty", "start"]
    assert "no track is seen" in str(events[0])
    assert ((table[11:13] == things) | (table[11:13] == -2)).mean() > 0.97
    table, events, _ = play(gappy, pickle.loads(half), range(20, movie.n_frames))
    assert kinds(events) == ["empty", "empty"]
    assert ((table[22:] == things) | (table[22:] == -2)).mean() > 0.97


def test_frame_out_of_nowhere_is_survived(movie, half):
    segmenter = pickle.loads(half)
    stray, ids = np.random.default_rng(1).uniform(0, 400, (50, 2)), np.arange(50) + 9000
    labels = segmenter.update(stray, ids)
    assert (labels == -1).all()
    assert set(segmenter.label_reasons_) == {"too short"}
    assert kinds(segmenter.events_) == ["break"]
    table, events, _ = play(movie, segmenter, range(20, movie.n_frames))
    assert kinds(events) == ["resumed"]
    assert ((table == movie.things) | (table == -2)).mean() > 0.97


def test_after_a_cut_numbers_are_new_but_that_of_the_scene(searched):
    segmenter = pickle.loads(searched)
    other = film(n_frames=12, seed=5)
    labels, events = [], []
    for frame in range(12):
        points, ids = other.frame(frame)
        labels.append(segmenter.update(points, ids + 1000))
        events += segmenter.events_
    assert kinds(events) == ["break", "cut", "start"]
    assert set(labels[-1]) == {0, 2}
    _, ids = other.frame(11)
    assert_array_equal(labels[-1] > 0, other.things[ids] == 1)


def test_after_a_cut_there_are_as_many_motions_again(movie, started_by_graph):
    _, _, segmenter = play(movie, OnlineMotionSegmenter(2, random_state=0), range(12))
    other = film(n_frames=12, seed=5)
    for frame in range(12):
        points, ids = other.frame(frame)
        labels = segmenter.update(points, ids + 1000)
    assert set(labels) == {0, 2}
    assert_array_equal(labels > 0, other.things[ids] == 1)


BAD = {
    "one needs shape": (ValueError, "must have shape", [1.0, 2.0], [0]),
    "too few ids": (ValueError, "need one track id each", [[1.0, 2.0]] * 2, [0]),
    "too many ids": (ValueError, "need one track id each", [[1.0, 2.0]], [0, 1]),
    "id twice": (ValueError, "each come once", [[1.0, 2.0]] * 3, [4, 7, 7]),
    "infinite": (ValueError, "must be finite", [[1.0, np.inf]], [0]),
    "unseen": (ValueError, "leave out tracks", [[np.nan, 1.0]], [0]),
    "words": (TypeError, "real numbers", [["a", "b"]], [0]),
    "ids that are no whole numbers": (TypeError, "whole", [[1.0, 2.0]], [0.5]),
    "large ids": (ValueError, "below 2", [[1.0, 2.0]], np.array([2**63], np.uint64)),
    "masked ids": (ValueError, "masked", [[1.0, 2.0]], np.ma.MaskedArray([0], True)),
    "complex": (TypeError, "real numbers", [[1j, 2.0]], [0]),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_changes_nothing(movie, case):
    error, words, points, ids = BAD[case]
    segmenter = OnlineMotionSegmenter(random_state=0)
    play(movie, segmenter, range(3))
    before = pickle.dumps(segmenter)
    with pytest.raises(error, match=words):
        segmenter.update(points, ids)
    assert pickle.dumps(segmenter) == before


def test_parameters_are_checked_before_the_first_frame():
    with pytest.raises(ValueError, match="n_motions"):
        OnlineMotionSegmenter(0).update([[1.0, 2.0]], [0])
    segmenter = OnlineMotionSegmenter(3, random_state=1)
    assert clone(segmenter).get_params() == segmenter.get_params()
    with pytest.raises(NotFittedError, match="no frame"):
        segmenter.result()


def test_stream_of_nothing():
    segmenter = OnlineMotionSegmenter(random_state=0)
    for _ in range(15):
        labels = segmenter.update([], [])
    assert labels.shape == (0,)
    assert (segmenter.n_motions_, segmenter.background_) == (0, -1)
    assert len(segmenter.result().labels) == 0


def test_too_few_tracks_to_begin_with_are_of_no_motion():
    segmenter = OnlineMotionSegmenter(random_state=0)
    for frame in range(25):
        labels = segmenter.update([[10.0 + frame, 20.0], [30.0, 40.0 + frame]], [1, 2])
    assert_array_equal(labels, [-1, -1])


@pytest.mark.slow
def test_memory_does_not_depend_on_the_number_of_frames(started_by_graph):
    """Once the first fifty frames, which are kept to be searched again, are gone."""
    movie = film(n_frames=120, n_static=150, n_moving=60, life=22)
    segmenter, sizes = OnlineMotionSegmenter(random_state=0), []
    for frame in range(120):
        segmenter.update(*movie.frame(frame))
        in_view = len(segmenter._stream.buffer.ids)
        sizes.append(len(pickle.dumps(segmenter)) / in_view)
    assert segmenter.n_motions_ == 2
    assert np.mean(sizes[100:]) < 1.1 * np.mean(sizes[52:72])


@pytest.mark.parametrize(
    ("probabilities", "n_living", "expected"),
    [
        ([0.7, 0.2, 0.1], 2, 2),  # 30 % that there are two or more
        ([0.7, 0.2, 0.1], 3, 1),
        ([0.9, 0.1, 0.0], 2, 1),
        ([0.3, 0.1, 0.6], 3, 3),
        ([0.7, 0.2, 0.1], 0, 1),
        ([0.6, 0.1, 0.3], 9, 3),  # no more were tried
        ([np.nan, np.nan, np.nan], 2, 1),
    ],
)
def test_a_search_has_no_fewer_motions_than_live_unless_it_is_sure(
    probabilities, n_living, expected
):
    segmenter = SimpleNamespace(
        candidate_labels_=[np.full(4, n) for n in (1, 2, 3)],
        count_probabilities_=np.array(probabilities),
        best_index_=int(np.argmax(probabilities)),
    )
    segmenter.labels_ = segmenter.candidate_labels_[segmenter.best_index_]
    assert_array_equal(_with_living(segmenter, n_living), expected)


def test_masked_and_absurd_points_are_refused(movie):
    hidden = np.ma.MaskedArray([[5.0, 5.0]], mask=True)
    lowest = np.array([[np.iinfo(np.int64).min, 5]])  # has no absolute value
    for points in (hidden, [[1e200, 5.0]], lowest):
        segmenter = OnlineMotionSegmenter()
        with pytest.raises(ValueError, match=r"must be (finite|in pixels)"):
            segmenter.update(points, [0])
        assert not hasattr(segmenter, "labels_")


def test_points_may_be_a_data_frame():
    pandas = pytest.importorskip("pandas")
    segmenter = OnlineMotionSegmenter()
    points = pandas.DataFrame({"x": [1, 2], "y": [3, 4]}, dtype="Int64")
    assert_array_equal(segmenter.update(points, pandas.Index([7, 9])), [-1, -1])
    points.loc[0, "x"] = pandas.NA
    with pytest.raises(ValueError, match="for track 7"):
        segmenter.update(points, [7, 9])


@pytest.mark.parametrize("dtype", [np.float16, np.float32, np.int8, np.uint16])
def test_points_may_be_of_any_precision(dtype):
    points = np.array([[1, 2], [3, 4]], dtype=dtype)
    assert_array_equal(OnlineMotionSegmenter().update(points, [7, 9]), [-1, -1])


def test_numbers_of_labels_are_of_motions_in_view(started_by_graph):
    """Also while tracks that were seen before are back, and their motion is not yet."""
    movie, segmenter = gone_for_a_while(), OnlineMotionSegmenter(random_state=0)
    back = set()
    for frame in range(movie.n_frames):
        labels = segmenter.update(*movie.frame(frame))
        assert set(labels[labels >= 0]) <= set(segmenter.motions_)
        assert segmenter.n_motions_ == len(segmenter.motions_)
        if frame >= 30:
            back |= set(labels[labels > 0])
    assert back
