"""Points that slide onto what passes are told by what is around them."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.pictures import plaster
from scipy.ndimage import map_coordinates

from skmotionseg import unpack_tracks
from skmotionseg.video import _looks, track_video
from skmotionseg.video._looks import (
    MOST_ROWS,
    NOISE_OF_GREY,
    RENEWED,
    WINDOW,
    Looks,
    alike,
    patches_around,
)

pytest.importorskip("cv2", reason="needs opencv-python-headless")

HALF = WINDOW // 2


@pytest.fixture(scope="module")
def picture():
    return plaster(np.random.default_rng(0), (60, 80))


def followed(n):
    return np.ones(n, dtype=bool)


def test_patches_are_what_is_around_a_point(picture):
    points = np.array([[20.0, 30.0], [33.25, 41.5]])
    found = patches_around(picture, points).reshape(2, WINDOW, WINDOW)
    rows, columns = slice(30 - HALF, 31 + HALF), slice(20 - HALF, 21 + HALF)
    np.testing.assert_array_equal(found[0], picture[rows, columns])
    y, x = np.mgrid[-HALF : HALF + 1, -HALF : HALF + 1]
    between = map_coordinates(picture.astype(float), [y + 41.5, x + 33.25], order=1)
    np.testing.assert_allclose(found[1], between, atol=1)


def test_a_picture_goes_on_beyond_its_edges(picture):
    corner = patches_around(picture, np.zeros((1, 2))).reshape(WINDOW, WINDOW)
    assert (corner[:HALF, :HALF] == picture[0, 0]).all()


def test_there_may_be_more_points_than_opencv_takes_at_once(picture):
    points = np.random.default_rng(1).uniform([0, 0], [79, 59], (MOST_ROWS + 3, 2))
    found = patches_around(picture, points)
    np.testing.assert_array_equal(found[-3:], patches_around(picture, points[-3:]))
    assert patches_around(picture, np.empty((0, 2))).shape == (0, WINDOW**2)


def test_light_and_noise_do_not_count(picture):
    rng = np.random.default_rng(2)
    patches = patches_around(picture, rng.uniform([8, 8], [70, 50], (50, 2)))
    brighter = np.uint8((0.8 * patches.astype(float) + 30).clip(0, 255))
    assert alike(patches, brighter).all()
    plain = np.full_like(patches, 128)
    noisy = np.uint8(128 + rng.normal(0, NOISE_OF_GREY / 2, plain.shape))
    assert alike(plain, noisy).all()


def test_what_fills_half_of_the_window_counts(picture):
    rng = np.random.default_rng(3)
    patches, others = (
        patches_around(picture, rng.uniform([8, 8], [70, 50], (200, 2)))
        for _ in range(2)
    )
    mixed = patches.copy()
    mixed[:, : WINDOW**2 // 2] = others[:, : WINDOW**2 // 2]
    assert alike(patches, mixed).mean() < 0.2


def test_points_are_compared_with_what_was_frames_ago(picture):
    """What slides by little in each frame is lost in the end, and what stays is not."""
    looks, places = Looks(), np.array([[20.0, 30.0], [50.0, 30.0]])
    looks.begin(picture, places)
    for _ in range(3):
        places += [[0.3, 0.0], [0.0, 0.0]]
        assert looks.follow(picture, places, followed(2)).all()
    for _ in range(2 * RENEWED):
        places[0] += [0.3, 0.0]
        if len(looks.ages) == 2:
            same = looks.follow(picture, places, followed(2))
        else:
            assert looks.follow(picture, places[1:], followed(1)).all()
    np.testing.assert_array_equal(same, [False, True])
    assert looks.ages.tolist() == [3 + 2 * RENEWED]


def test_slow_change_is_no_slide(picture):
    """What changes over more frames than points are compared, as by zoom, may."""
    rng = np.random.default_rng(4)
    first, last = (plaster(rng, (60, 80)).astype(float) for _ in range(2))
    looks, point, n_frames = Looks(), np.array([[40.0, 30.0]]), 20 * RENEWED
    looks.begin(np.uint8(first), point)
    for share in np.linspace(0, 1, n_frames):
        now = np.uint8((1 - share) * first + share * last)
        assert looks.follow(now, point, followed(1)).all()


def passing(n_frames=30):
    """A wall, and a thing that passes before it by a pixel in three frames."""
    rng = np.random.default_rng(5)
    wall, thing = plaster(rng, (90, 120)), plaster(rng, (50, 40))
    y, x = np.mgrid[:90, :120]
    frames = []
    for frame in range(n_frames):
        left = 30 + frame / 3
        share = np.clip(x - left + 0.5, 0, 1) * np.clip(left + 40 - x + 0.5, 0, 1)
        share *= (y >= 20) & (y < 70)
        moved = map_coordinates(
            thing.astype(float), [y - 20, x - left], order=1, mode="nearest"
        )
        frames.append(np.uint8(share * moved + (1 - share) * wall))
    return frames


def taken_along(frames):
    """Observations of what began on the wall, two pixels or more from there."""
    points, seen = unpack_tracks(track_video(frames).tracks)
    start = points[np.arange(len(points)), seen.argmax(axis=1)]
    left = 30 + seen.argmax(axis=1) / 3
    beside = (start[:, 0] < left - 1) | (start[:, 0] > left + 41)
    apart = np.hypot(*np.moveaxis(points - start[:, None], 2, 0))
    return (seen & (apart > 2))[beside].sum(), seen.sum()


def test_what_passes_slowly_takes_few_points_along(monkeypatch):
    frames = passing()
    with_looks, n_with = taken_along(frames)
    monkeypatch.setattr(_looks, "LEAST_ALIKE", -1.0)
    without, n_without = taken_along(frames)
    assert with_looks < without / 2
    assert n_with > 0.9 * n_without
