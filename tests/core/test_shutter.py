"""A rolling shutter: how tracks move, where they were at one time, and its readout."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from benchmarks.static_scenes import shaken
from skmotionseg import unpack_tracks
from skmotionseg._core.geometry.shutter import Shutter, find_shutter, velocities


def plain_velocity(track, seen, frame):
    """The slope in a frame of a polynomial through its neighbours that are seen."""
    before = [k for k in (frame - 1, frame + 1) if 0 <= k < len(track) and seen[k]]
    if not seen[frame] or not before:
        return np.zeros(2)
    near = before
    if len(near) == 1:
        beyond = 2 * near[0] - frame
        if 0 <= beyond < len(track) and seen[beyond]:
            near = [near[0], beyond]
    frames = np.array([frame, *near])
    fits = [
        np.polyfit(frames - frame, track[frames, axis], len(near)) for axis in (0, 1)
    ]
    return np.array([fit[-2] for fit in fits])


def test_velocities_are_slopes_of_parabolas():
    rng = np.random.default_rng(0)
    points = rng.uniform(0, 100, size=(60, 7, 2))
    visibility = rng.random((60, 7)) < 0.6
    expected = [
        [plain_velocity(track, seen, frame) for frame in range(7)]
        for track, seen in zip(points, visibility, strict=True)
    ]
    assert_allclose(velocities(points, visibility), expected, atol=1e-9)


def test_what_moves_evenly_is_put_where_it_was_at_the_time_of_the_frame():
    rng = np.random.default_rng(0)
    start, speed = rng.uniform(0, 100, (30, 1, 2)), rng.uniform(-5, 5, (30, 1, 2))
    shutter = Shutter(
        np.array([50.0, 50.0]), np.array([100.0, 100.0]), np.array([0, 0.5])
    )
    frames = np.arange(8)[:, None]
    times = frames + np.zeros((30, 1, 1))
    for _ in range(30):
        observed = start + speed * times
        times = frames + 0.5 * (observed[..., 1:] - 50) / 100
    visibility = rng.random((30, 8)) < 0.8
    found = shutter.at_once(
        np.where(visibility[..., None], observed, np.nan), visibility
    )
    assert np.isnan(found[~visibility]).all()
    together = visibility[:, 1:] & visibility[:, :-1]
    told = visibility & (
        np.pad(together, ((0, 0), (0, 1))) | np.pad(together, ((0, 0), (1, 0)))
    )
    # Speed is per frame, and a track is seen a little more or less often than that.
    assert_allclose(found[told], (start + speed * frames)[told], atol=0.15)
    assert abs(observed - (start + speed * frames))[told].max() > 1


def test_a_shutter_that_reads_at_once_leaves_the_points_themselves():
    points = np.zeros((3, 4, 2))
    shutter = Shutter(np.zeros(2), np.ones(2), np.zeros(2))
    assert shutter.at_once(points, np.ones((3, 4), dtype=bool)) is points


@pytest.mark.parametrize("n_moving", [0, 30])
@pytest.mark.parametrize("readout", [0.35, 0.7, -0.7])
def test_the_readout_is_found(readout, n_moving):
    X, _ = shaken(readout, n_moving=n_moving, seed=3)
    found = find_shutter(*unpack_tracks(X)).readout
    assert found[0] == 0
    assert_allclose(found[1], readout, atol=0.15)


def test_a_video_on_its_side_is_read_from_left_to_right():
    X, _ = shaken(0.7, seed=3)
    points, visibility = unpack_tracks(X)
    found = find_shutter(points[..., ::-1], visibility).readout
    assert found[1] == 0
    assert_allclose(found[0], 0.7, atol=0.15)


@pytest.mark.parametrize("seed", range(4))
def test_no_readout_is_found_where_there_is_none(seed):
    X, _ = shaken(0, n_moving=30 * (seed % 2), seed=seed)
    assert_array_equal(find_shutter(*unpack_tracks(X)).readout, 0)


def test_no_readout_is_found_in_few_tracks_or_frames():
    points, visibility = unpack_tracks(shaken(0.7, seed=3)[0])
    for some in (np.s_[:11], np.s_[:, :5], np.s_[:0]):
        assert_array_equal(find_shutter(points[some], visibility[some]).readout, 0)


def test_some_of_many_tracks_tell_the_same():
    points, visibility = unpack_tracks(shaken(0.7, n_tracks=1500, seed=1)[0])
    assert_allclose(find_shutter(points, visibility).readout, [0, 0.7], atol=0.15)
