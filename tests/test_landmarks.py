"""Many tracks: the choice of those that are fitted, and the placing of the others."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from skmotionseg import MotionSegmenter, _scale, unpack_tracks
from skmotionseg._branches import PAIRS_TO_PLACE
from skmotionseg._core import landmarks
from skmotionseg._core.landmarks import (
    NEVER_MET,
    _channels,
    _distance_to,
    choose_landmarks,
    draw_evenly,
)
from skmotionseg._scale import number_of_landmarks
from skmotionseg.datasets import make_rigid_motions
from skmotionseg.metrics import misclassification_error


def choose(X, n_landmarks, seed=0):
    return choose_landmarks(*unpack_tracks(X), n_landmarks, np.random.RandomState(seed))


@pytest.fixture(scope="module")
def scene():
    """1,500 tracks: a background and two motions."""
    return make_rigid_motions(1500, 8, 3, missing=0.1, random_state=0)


@pytest.fixture(scope="module")
def fitted(scene):
    return MotionSegmenter(3, n_landmarks=300, n_hypotheses=200, random_state=0).fit(
        scene[0]
    )


# ------------------------------------------------------------------------ the choice


@pytest.mark.parametrize("n_landmarks", [1, 2, 15, 16, 17, 333, 1499, 1500])
def test_as_many_landmarks_as_asked_for(scene, n_landmarks):
    chosen = choose(scene[0], n_landmarks)
    assert_array_equal(chosen, np.unique(chosen))
    assert len(chosen) == n_landmarks


def test_the_choice_depends_on_the_seed_alone(scene):
    assert_array_equal(choose(scene[0], 100), choose(scene[0], 100))
    assert (choose(scene[0], 100) != choose(scene[0], 100, seed=1)).any()


def test_the_choice_does_not_depend_on_the_batch(scene, monkeypatch):
    whole = choose(scene[0], 200)
    monkeypatch.setattr(landmarks, "TRACKS_A_BATCH", 100)
    assert np.isin(choose(scene[0], 200), whole).mean() > 0.99  # but for rounding


def test_a_small_motion_gets_more_landmarks_than_by_chance():
    X, y = make_rigid_motions(4000, 8, 2, missing=0, random_state=1)
    small = np.r_[np.flatnonzero(y == 0)[:1960], np.flatnonzero(y == 1)[:40]]
    shares = [np.isin(choose(X[small], 200, s), np.arange(1960, 2000)) for s in (0, 1)]
    assert np.mean(shares) > 1.5 * 40 / 2000


def test_landmarks_cover_all_frames():
    """Half of the tracks live in the first frames, a fiftieth in the last."""
    X, _ = make_rigid_motions(1000, 20, 1, missing=0, random_state=0)
    points = X.reshape(1000, 20, 2)
    points[:980, 10:] = np.nan
    points[980:, :10] = np.nan
    chosen = choose(points.reshape(1000, -1), 100)
    assert np.isin(chosen, np.arange(980, 1000)).sum() >= 8


def test_tracks_seen_in_no_two_frames_in_a_row_come_last(scene):
    X = scene[0][:100].copy()
    X[:50, 2:] = np.nan
    assert choose(X, 50).min() == 50
    assert len(choose(X, 70)) == 70


def test_equal_tracks_can_be_chosen_among(scene):
    X = np.repeat(scene[0][:1], 50, axis=0)
    assert len(choose(X, 20)) == 20


def test_frames_that_see_nothing_do_not_change_how_many_are_fitted():
    seen = np.random.default_rng(0).uniform(size=(4000, 10)) < 0.3
    longer = np.pad(seen, [(0, 0), (3, 5)])
    enough = number_of_landmarks("auto", seen, 3)
    assert 600 < enough < 1500
    assert number_of_landmarks("auto", longer, 3) == enough


def test_groups_give_as_many_or_all_they_have():
    labels = np.repeat([0, 1, 2, -1], [100, 50, 3, 30])
    drawn = draw_evenly(labels, 60, np.random.RandomState(0))
    assert_array_equal(drawn, np.unique(drawn))
    counts = [np.sum(labels[drawn] == group) for group in (0, 1, 2, -1)]
    assert counts == [19, 19, 3, 19]


@pytest.mark.parametrize("seed", range(3))
def test_distances_are_those_of_a_loop(seed):
    """Mean squares over common frames, of places and of steps, in median spreads."""
    X, _ = make_rigid_motions(30, 6, 2, missing=0.3, random_state=seed)
    points, visibility = unpack_tracks(X)
    visibility[0, np.flatnonzero(visibility[0])[1:]] = False  # never moves
    drawn = np.array([3, 9, 20])
    found = _distance_to(_channels(points, visibility), drawn)
    steps, moving = np.diff(points, axis=1), visibility[:, 1:] & visibility[:, :-1]
    total = np.zeros((30, 3))
    for values, seen in ((points, visibility), (steps, moving)):
        centred = np.full(values.shape, np.nan)
        for f in range(values.shape[1]):
            inside = seen[:, f]
            centred[inside, f] = values[inside, f] - values[inside, f].mean(axis=0)
        centred /= np.median(np.abs(centred[seen]))
        for i, (k, j) in product(range(30), enumerate(drawn)):
            common = [f for f in range(values.shape[1]) if seen[i, f] and seen[j, f]]
            squares = [np.sum((centred[i, f] - centred[j, f]) ** 2) for f in common]
            total[i, k] += np.mean(squares) if common else np.inf
    expected = total.min(axis=1)
    met = np.isfinite(expected)
    assert not met[0]
    most = np.quantile(expected[met], 0.9)
    expected = np.where(met, np.minimum(expected, most), NEVER_MET)
    assert_allclose(found, expected, rtol=1e-3, atol=1e-4)


@pytest.mark.parametrize("n_frames", [1, 2])
def test_still_tracks_are_at_no_distance(n_frames):
    points = np.full((5, n_frames, 2), 3.0)
    visibility = np.ones((5, n_frames), dtype=bool)
    found = _distance_to(_channels(points, visibility), np.array([0]))
    assert_array_equal(found, 0 if n_frames > 1 else NEVER_MET)


def test_spreads_below_one_count():
    """Tracks in millimetres or in metres are as far from one another."""
    X, _ = make_rigid_motions(30, 6, 2, random_state=0)
    points, visibility = unpack_tracks(X)
    distances = [
        _distance_to(_channels(scale * points, visibility), np.array([0, 5]))
        for scale in (1, 1e-3)
    ]
    assert_allclose(*distances, rtol=1e-3, atol=1e-4)
    assert all(
        part.dtype == np.float32 for c in _channels(points, visibility) for part in c
    )


def test_a_small_motion_in_a_dense_scene_is_found():
    X, y = make_rigid_motions(6000, 10, 2, missing=0, random_state=0)
    small = np.r_[np.flatnonzero(y == 0)[:2940], np.flatnonzero(y == 1)[:60]]
    labels = MotionSegmenter(2, random_state=0).fit_predict(X[small])
    assert misclassification_error(y[small], labels) < 0.002


# ------------------------------------------------------------------------ the number


@pytest.mark.parametrize(
    ("n_tracks", "seen", "expected"),
    [
        (1200, 20, 1200),
        (1201, 20, 600),
        (50_000, 20, 600),
        (3000, 1, 3000),
        (3001, 1, 1500),
    ],
)
def test_few_tracks_are_all_fitted_and_many_by_landmarks(n_tracks, seen, expected):
    age = np.arange(20) - np.arange(n_tracks)[:, None]
    visibility = age % 20 < seen
    assert number_of_landmarks("auto", visibility, 3) == expected


def test_all_tracks_are_fitted_where_that_is_asked_for():
    assert number_of_landmarks(None, np.ones((2000, 3), dtype=bool), 3) == 2000


def test_of_a_long_clip_every_so_many_frame_pairs_place_the_others():
    """Of 48 frame pairs, every fourth."""
    X, y = make_rigid_motions(160, 49, 2, missing=0.1, random_state=0)
    segmenter = MotionSegmenter(2, n_hypotheses=50, random_state=0).fit(X[:80])
    for _, kernel in segmenter.branches_.values():
        assert_array_equal(kernel._spread_pairs(PAIRS_TO_PLACE), range(0, 48, 4))
    assert misclassification_error(y[80:], segmenter.predict(X[80:])) < 0.05


def test_too_many_tracks_for_the_memory_are_an_error_before_any_work():
    with pytest.raises(MemoryError, match=r"takes about .* GiB .*n_landmarks='auto'"):
        number_of_landmarks(None, np.ones((10_000_000, 1), dtype=bool), 3)


def test_much_memory_is_announced(monkeypatch):
    monkeypatch.setattr(_scale, "SMALL_BYTES", 10**6)
    with pytest.warns(UserWarning, match="takes about 0.0 GiB"):
        number_of_landmarks(None, np.ones((100, 3), dtype=bool), 3)


@pytest.mark.parametrize("content", [None, "MemTotal: 9 kB\n", "MemAvailable: much\n"])
def test_what_is_free_is_asked_of_the_system_in_two_ways(
    content, tmp_path, monkeypatch
):
    """Linux says it in a file; others count their pages, or do not say."""
    meminfo = tmp_path / "meminfo"
    if content is not None:
        meminfo.write_text(content)
    monkeypatch.setattr(
        _scale, "open", lambda _, **kw: meminfo.open(**kw), raising=False
    )
    pages = {"SC_AVPHYS_PAGES": 1000, "SC_PAGE_SIZE": 4096}
    monkeypatch.setattr(_scale.os, "sysconf", pages.__getitem__, raising=False)
    assert _scale._free_bytes() == 4096000
    meminfo.write_text("MemTotal: 9 kB\nMemAvailable:   7 kB\n")
    assert _scale._free_bytes() == 7168
    meminfo.unlink()
    monkeypatch.delattr(_scale.os, "sysconf")
    assert _scale._free_bytes() is None


def test_where_the_system_does_not_say_what_is_free_it_is_tried(monkeypatch):
    monkeypatch.setattr(_scale, "_free_bytes", lambda: None)
    with pytest.warns(UserWarning):
        assert number_of_landmarks(None, np.ones((10**6, 1), dtype=bool), 3) == 10**6


@pytest.mark.parametrize("name", ["n_landmarks", "batch_size"])
@pytest.mark.parametrize("value", [0, -1, 1501, 2.5, "all"])
def test_bad_numbers_are_errors(scene, name, value):
    segmenter = MotionSegmenter(**{name: value})
    with pytest.raises(ValueError, match=rf"{name}.*{value}"):
        segmenter.fit(scene[0])


def test_landmarks_that_share_no_frame_are_named_in_the_error():
    """Ten tracks in each two frames of a long video: fewer are too few."""
    points = np.full((4000, 801, 2), np.nan)
    for pair in range(400):
        place = np.random.default_rng(pair).uniform(0, 500, size=(10, 1, 2))
        points[10 * pair : 10 * pair + 10, 2 * pair : 2 * pair + 2] = place
    segmenter = MotionSegmenter(2, models="fundamental", n_landmarks=20, random_state=0)
    with pytest.raises(ValueError, match="needs 8 tracks") as caught:
        segmenter.fit(points.reshape(4000, -1))
    assert "looking at 600 tracks of 4000; n_landmarks" in "".join(
        caught.value.__notes__
    )


# ------------------------------------------------------------------------- the placing


def test_tracks_that_are_not_fitted_are_placed(scene, fitted):
    X, y = scene
    assert len(fitted.landmarks_) == 300
    assert fitted.labels_.shape == y.shape
    assert misclassification_error(y, fitted.labels_) < 0.02
    assert fitted.candidate_labels_.shape == (1, len(X))


def test_the_largest_motion_comes_first(fitted):
    assert (np.diff(np.bincount(fitted.labels_)) <= 0).all()


def test_tracks_are_placed_by_predict_where_fit_put_them(scene, fitted):
    X, _ = scene
    others = np.setdiff1d(np.arange(len(X)), fitted.landmarks_)
    assert_array_equal(fitted.predict(X[others]), fitted.labels_[others])


@pytest.mark.parametrize("batch_size", [1, 63, 64, 1000])
def test_labels_do_not_depend_on_the_batch(scene, fitted, batch_size):
    few = MotionSegmenter(**{**fitted.get_params(), "batch_size": batch_size})
    X = scene[0] if batch_size > 1 else scene[0][:330]
    expected = (
        fitted if batch_size > 1 else MotionSegmenter(**fitted.get_params()).fit(X)
    )
    assert_array_equal(few.fit(X).labels_, expected.labels_)


@pytest.mark.parametrize("n_jobs", [2, -1])
def test_labels_do_not_depend_on_the_jobs(scene, fitted, n_jobs):
    many = MotionSegmenter(**{**fitted.get_params(), "n_jobs": n_jobs})
    assert_array_equal(many.fit(scene[0]).labels_, fitted.labels_)


def test_all_tracks_as_landmarks_are_the_exact_fit(scene):
    X = scene[0][:200]
    exact, all_of_them = (
        MotionSegmenter(3, n_landmarks=n, n_hypotheses=100, random_state=0).fit(X)
        for n in (None, 200)
    )
    assert_array_equal(exact.labels_, all_of_them.labels_)
    assert_array_equal(exact.landmarks_, np.arange(200))


def test_a_track_seen_once_is_placed_nowhere(scene):
    X = scene[0].copy()
    X[7, 2:] = np.nan
    segmenter = MotionSegmenter(3, n_landmarks=300, n_hypotheses=100, random_state=0)
    assert segmenter.fit(X).labels_[7] == -1
