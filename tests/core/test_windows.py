"""Windows of a clip, and rigid motions of groups in them."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from skmotionseg import unpack_tracks
from skmotionseg._core.geometry.camera import LEAST_NOISE, REFERENCE_WIDTH
from skmotionseg._core.geometry.windows import (
    FEWEST_TRACKS,
    NOISE_PER_MOTION,
    WINDOW_FRAMES,
    FitRequest,
    Windows,
    reaching_frames,
    spread_window_frames,
    window_frames,
)
from skmotionseg.datasets import make_rigid_motions


@pytest.fixture(scope="module")
def clip():
    X, y = make_rigid_motions(n_tracks=150, n_frames=12, random_state=0)
    points, visibility = unpack_tracks(X)
    return Windows(points, visibility), y


@pytest.mark.parametrize("n_frames", [2, 3, 6, 7, 16, 40, 101])
def test_windows_reach_from_the_first_frame_to_the_last(n_frames):
    frames = window_frames(np.ones((5, n_frames), dtype=bool))
    assert frames.min() == 0
    assert frames.max() >= n_frames - 1 - n_frames // 4
    assert frames.shape[1] == min(WINDOW_FRAMES, n_frames)
    assert (np.diff(frames, axis=1) == np.diff(frames, axis=1)[0, 0]).all()


@pytest.mark.parametrize(
    "n_frames, stride", [(6, 1), (10, 1), (11, 2), (16, 3), (40, 3)]
)
def test_frames_are_as_far_apart_as_a_clip_allows(n_frames, stride):
    frames = window_frames(np.ones((5, n_frames), dtype=bool))
    assert (np.diff(frames, axis=1) == stride).all()


def test_frames_are_as_far_apart_as_tracks_allow():
    visibility = np.arange(60) < np.full((5, 1), 12)  # five steps of two, not of three
    assert (np.diff(window_frames(visibility), axis=1) == 2).all()


@pytest.mark.parametrize("first, last", [(10, 19), (13, 16), (3, 5), (26, 29)])
@pytest.mark.parametrize("n_brief, linked", [(10, False), (9, False), (10, True)])
def test_windows_reach_what_is_seen_briefly(first, last, n_brief, linked):
    """Unless it is too few to be a motion, or its tracks are linked to others."""
    visibility = np.ones((40, 30), dtype=bool)
    visibility[:n_brief] = False
    visibility[:n_brief, first : last + 1] = True
    brief = np.arange(40) < n_brief
    affinity = np.where(brief[:, None] == brief, 1.0, 0.01) + np.eye(40)
    if linked:
        affinity[:n_brief, n_brief:] = affinity[n_brief:, :n_brief] = 1
    usual = window_frames(visibility)
    frames = reaching_frames(visibility, affinity)
    assert_array_equal(frames[: len(usual)], usual)
    times = [visibility[0, some].sum() for some in frames]
    was_missed = max(times[: len(usual)]) < 3
    if n_brief == 10 and not linked:
        assert max(times) >= 3
        assert len(frames) - len(usual) == was_missed
    else:
        assert len(frames) == len(usual)


def test_what_wanders_is_told_from_what_rests():
    rng = np.random.RandomState(0)
    points = rng.uniform(0, 640, size=(40, 1, 2)) + np.zeros((12, 1))
    points[20:, 6:, 0] += 3 * np.arange(6)
    points += 0.1 * rng.standard_normal(points.shape)
    windows = Windows(points, np.ones((40, 12), dtype=bool))
    pixels = windows.size * windows.focal_length
    rests, moves = (windows.wanders(np.arange(20) + k) * pixels for k in (0, 20))
    assert 0.05 < rests < 0.15
    plain = points[20:, windows.frames[-1]]
    plain = np.sqrt(plain.var(axis=1).mean(axis=1))
    assert moves == pytest.approx(np.median(plain))
    assert windows.wanders(np.arange(4)) == 0  # too few


@pytest.mark.parametrize(
    "n_frames, strides",
    [
        (20, None),
        (21, {4}),
        (26, {5}),
        (30, {6, 5}),  # stretched
        (34, {6, 7}),
        (35, {5}),  # two that overlap
        (60, {5, 6}),
    ],
)
def test_longer_windows_are_those_of_frames_farther_apart(n_frames, strides):
    points = np.random.RandomState(0).uniform(size=(5, n_frames, 2))
    windows = Windows(points, np.ones((5, n_frames), dtype=bool), 1.3)
    longer = windows.longer()
    if strides is None:
        assert longer is None
        return
    assert set(np.diff(longer.frames, axis=1).ravel()) == strides
    assert longer.focal_length == windows.focal_length
    assert longer.frames.min() == 0
    assert longer.frames.max() == n_frames - 1
    assert np.diff(np.unique(longer.frames)).max() <= 7
    assert longer.x.shape == (len(longer.frames), 5, WINDOW_FRAMES, 2)


def test_windows_are_no_longer_than_tracks_live():
    visibility = np.arange(60) < np.full((5, 1), 17)
    points = np.random.RandomState(0).uniform(size=(5, 60, 2))
    assert Windows(points, visibility).longer() is None


def test_windows_are_short_where_tracks_are():
    visibility = np.zeros((40, 60), dtype=bool)
    for track in range(40):
        visibility[track, track : track + 8] = True
    assert np.ptp(window_frames(visibility), axis=1).max() < 8


@pytest.mark.parametrize("n_frames", range(7, 16))
def test_windows_of_short_clips_are_spread_over_all_frames(n_frames):
    frames = spread_window_frames(np.ones((5, n_frames), dtype=bool))
    assert frames.shape == (2, WINDOW_FRAMES)
    assert (np.diff(frames, axis=1) > 0).all()
    assert_array_equal(frames[:, [0, -1]], [[0, n_frames - 2], [1, n_frames - 1]])
    if n_frames <= 11:  # others cannot all be seen, two neighbours of four can
        assert_array_equal(np.unique(frames), np.arange(n_frames))


@pytest.mark.parametrize("n_frames", [2, 3, 6, 16, 40])
def test_windows_of_other_clips_are_not_spread(n_frames):
    visibility = np.ones((5, n_frames), dtype=bool)
    assert_array_equal(spread_window_frames(visibility), window_frames(visibility))


def test_windows_are_not_spread_where_tracks_are_short():
    """They would be seen in too few frames of a window."""
    visibility = np.zeros((40, 12), dtype=bool)
    for track in range(40):
        visibility[track, track % 8 : track % 8 + 5] = True
    assert_array_equal(spread_window_frames(visibility), window_frames(visibility))
    visibility[:21, :6] = True
    frames = spread_window_frames(visibility)
    assert np.ptp(frames, axis=1).min() == 10
    windows = Windows(np.zeros((40, 12, 2)), visibility, frames=frames)
    assert windows.frames is frames


def test_tracks_are_near_their_own_motion_and_far_from_others(clip):
    windows, y = clip
    groups = [np.flatnonzero(y == m) for m in range(y.max() + 1)]
    motions = windows.fit(groups)
    for group, motion in zip(groups, motions, strict=True):
        own, _ = windows.deviations(motion, group)
        others, known = windows.deviations(
            motion, np.setdiff1d(np.arange(len(y)), group)
        )
        assert np.median(own) < np.median(others[known > 0]) / 2


def test_the_order_of_tracks_changes_nothing(clip):
    windows, y = clip
    order = np.random.RandomState(0).permutation(len(y))
    shuffled = Windows(windows.points[order], windows.visibility[order])
    group = np.flatnonzero(y == 0)
    members = np.flatnonzero(y[order] == 0)
    (one,), (other,) = windows.fit([group]), shuffled.fit([members])
    assert_allclose(one.squares[order], other.squares, rtol=1e-5, atol=1e-12)


def test_residuals_are_relative_to_how_fast_tracks_move():
    """A third is at rest, and of the others each moves by so many pixels a frame."""
    rng = np.random.RandomState(0)
    speeds = np.repeat([0.0, 4.0, 20.0], 10)
    places = rng.uniform(0, 400, size=(30, 1, 2))
    points = places + speeds[:, None, None] * np.arange(20)[:, None] * [0.6, 0.8]
    visibility = np.arange(20) != rng.randint(20, size=30)[:, None]
    windows = Windows(np.where(visibility[..., None], points, np.nan), visibility)
    noise = NOISE_PER_MOTION * speeds * REFERENCE_WIDTH / windows.size
    expected = 1 + (noise / LEAST_NOISE)[:, None] ** 2
    assert_allclose(windows.variances, expected + 0 * windows.variances)
    tracks = np.arange(30)
    (motion,) = windows.fit([tracks])
    relative, freedom = windows.deviations(motion, tracks)
    plain, _ = windows.deviations(motion, tracks, relative=False)
    known = (freedom > 0) & (plain > 0)
    assert_allclose((plain / relative)[known], np.sqrt(expected[:, 0])[known])
    squares = np.nansum(windows.relative_squares(motion), axis=1)
    assert_allclose(squares[known], (relative**2 * freedom)[known])
    assert_array_equal(
        freedom, np.where(np.isnan(motion.squares), 0, windows.freedom).sum(axis=1)
    )
    some = np.array([7, 2, 29])
    assert_array_equal(windows.deviations(motion, some)[0], relative[some])


@pytest.mark.parametrize("length", [4, 6, 20])
def test_stretches_are_windows_of_fewer_frames(clip, length):
    """The residuals of a stretch are those of tracks that no other frame sees."""
    windows, y = clip
    (motion,) = windows.fit([np.flatnonzero(y == 0)])
    found = windows.deviations_in_stretches(motion, length)
    length = min(length, windows.frames.shape[1])
    starts = range(windows.frames.shape[1] - length + 1)
    assert found.shape == (len(y), len(windows.frames) * len(starts))
    columns = iter(found.T)
    for window, frames in enumerate(windows.frames):
        for start in starts:
            here = frames[start : start + length]
            seen = np.zeros_like(windows.visibility)
            seen[:, here] = windows.visibility[:, here]
            alone = windows.of(windows.points, seen)
            (again,) = alone.motions_again([motion])
            variances = windows.variances[:, window]
            known = alone.freedom[:, window] > 0
            expected = np.full(len(y), np.nan)
            squares = again.squares[known, window] / alone.freedom[known, window]
            expected[known] = np.sqrt(squares / variances[known])
            assert_allclose(next(columns), expected)


def test_nothing_is_known_of_stretches_where_a_motion_was_not_fitted(clip):
    windows, y = clip
    (motion,) = windows.fit([np.flatnonzero(y == 0)])
    fitted = windows.deviations_in_stretches(motion, 4)
    lost = motion._replace(poses=(None, *motion.poses[1:]))
    found = windows.deviations_in_stretches(lost, 4)
    of_first = np.arange(found.shape[1]) < found.shape[1] // len(windows.frames)
    assert np.isnan(found[:, of_first]).all()
    assert_array_equal(found[:, ~of_first], fitted[:, ~of_first])


def test_too_few_tracks_have_no_motion_and_nothing_is_known_of_them(clip):
    windows, _ = clip
    (motion,) = windows.fit([np.arange(FEWEST_TRACKS - 1)])
    assert set(motion.poses) == {None}
    deviations, freedom = windows.deviations(motion, np.arange(10))
    assert_array_equal(freedom, 0)
    assert_array_equal(deviations, 0)


def test_residuals_of_fitted_tracks_are_too_small_by_the_parameters_part(clip):
    windows, y = clip
    group = np.flatnonzero(y == 0)[:14]
    (motion,) = windows.fit([group])
    # Six for each frame but the first, less the unknown scale, in each window.
    n_windows, n_frames = windows.frames.shape
    judged = (windows.freedom[group] > 0) & ~np.isnan(motion.squares[group])
    assert judged.any(axis=0).all()
    n_parameters = n_windows * (6 * (n_frames - 1) - 1)
    n_residuals = windows.freedom[group][judged].sum()
    assert n_parameters < 0.8 * n_residuals
    expected = 1 / np.sqrt(1 - n_parameters / n_residuals)
    assert_allclose(windows.shrinkage(motion, group), expected)


def test_refining_takes_the_better_of_two_starts(clip):
    windows, y = clip
    groups = [np.flatnonzero(y == m) for m in (0, 1)]
    own, other = windows.fit(groups)
    refined, poor = windows.refine([groups[0]] * 2, [[other, own], [other]])
    before, refined, poor = (
        np.median(windows.deviations(each, groups[0])[0])
        for each in (own, refined, poor)
    )
    assert refined <= poor * (1 + 1e-9)
    assert refined < 1.05 * before


def test_refining_fits_anew_where_no_start_has_poses():
    """Tracks that come to a group may be seen in windows that its others are not."""
    X, y = make_rigid_motions(n_tracks=150, n_frames=12, random_state=0)
    points, visibility = unpack_tracks(X)
    group = np.flatnonzero(y == 0)
    late = group[::2]
    visibility[late, :6] = False
    windows = Windows(points, visibility)
    (start,) = windows.fit([late])
    (refined,) = windows.refine([group], [[start]])
    (anew,) = windows.fit([group])
    has_start = [each is not None for each in start.poses]
    assert has_start == [False, True]
    assert_array_equal(refined.known, anew.known)
    assert_allclose(refined.squares[:, 0], anew.squares[:, 0], rtol=1e-6)


def test_batches_of_any_size_give_the_same_motions(clip, monkeypatch):
    windows, y = clip
    groups = [np.flatnonzero(y == m) for m in range(y.max() + 1)]
    groups += [group[:12] for group in groups]
    fits = [FitRequest(group) for group in groups]
    motions = windows.found(fits)
    fits += [FitRequest(group, (motions[0],), 20) for group in groups]
    together = windows.found(fits)
    monkeypatch.setattr("skmotionseg._core.geometry.windows.BATCH", 3)
    for one, other in zip(together, windows.found(fits), strict=True):
        assert_array_equal(one.tracks, other.tracks)
        assert_allclose(one.squares, other.squares, rtol=1e-6, atol=1e-14)
    for fit, motion in zip(fits, together, strict=True):
        (alone,) = windows.found([fit])
        assert_allclose(alone.squares, motion.squares, rtol=1e-6, atol=1e-14)


def test_residuals_are_in_pixels_of_a_video_640_wide(clip):
    windows, _ = clip
    for share in (0.5, 2.0):
        windows.set_focal_length(share)
        assert_allclose(windows.least_noise * windows.pixels, 0.15)
    windows.set_focal_length(1.0)
