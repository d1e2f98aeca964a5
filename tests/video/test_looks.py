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
    N_AROUND,
    NOISE_OF_GREY,
    RENEWED,
    SLIDING,
    WINDOW,
    Looks,
    alike,
    moved_apart,
    patches_around,
    without_sliding,
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


def test_what_is_near_a_point_counts_most(picture):
    """By an outline, what belongs to a point is nearer than what does not."""
    rng = np.random.default_rng(3)
    patches, others = (
        patches_around(picture, rng.uniform([8, 8], [70, 50], (200, 2)))
        for _ in range(2)
    )
    rows = np.arange(WINDOW**2) // WINDOW
    far, near = patches.copy(), patches.copy()
    far[:, rows < 2] = others[:, rows < 2]
    near[:, (rows >= 4) & (rows < 7)] = others[:, (rows >= 4) & (rows < 7)]
    assert alike(patches, far).mean() > 0.8
    assert alike(patches, near).mean() < 0.2


def test_what_fills_half_of_the_window_counts(picture):
    rng = np.random.default_rng(3)
    patches, others = (
        patches_around(picture, rng.uniform([8, 8], [70, 50], (200, 2)))
        for _ in range(2)
    )
    mixed = patches.copy()
    mixed[:, : WINDOW**2 // 2] = others[:, : WINDOW**2 // 2]
    assert alike(patches, mixed).mean() < 0.2


def grid_of(picture, spacing=8):
    height, width = picture.shape
    y, x = np.mgrid[8 : height - 8 : spacing, 8 : width - 8 : spacing]
    return np.column_stack([x.ravel(), y.ravel()]).astype(float)


def after(looks, picture, places, n_frames):
    """Which of the points stay, that are looked at so many times."""
    rows = np.arange(len(places))
    for _ in range(n_frames):
        same = looks.follow(picture, places[rows], followed(len(rows)))
        rows = rows[same]
        looks.begin(picture, places[rows])
    return rows


def test_what_slides_is_lost_and_what_stays_is_not(picture):
    """It leaves those that were around it, and looks different where it is now."""
    looks, places = Looks(), grid_of(picture)
    looks.begin(picture, places)
    places[20] += [4.0, 0.0]
    assert (
        after(looks, picture, places, 1).tolist()
        == np.delete(np.arange(len(places)), 20).tolist()
    )


def test_it_is_told_by_what_was_frames_ago(picture):
    """By little in each frame, as it slides."""
    looks, places = Looks(), grid_of(picture)
    looks.begin(picture, places)
    for _ in range(4):
        places[20] += [0.3, 0.0]
        assert looks.follow(picture, places, followed(len(places))).all()
        looks.begin(picture, places)
    for _ in range(2 * RENEWED):
        places[20] += [0.3, 0.0]
        same = looks.follow(picture, places, followed(len(places)))
        if not same.all():
            break
        looks.begin(picture, places)
    assert np.flatnonzero(~same).tolist() == [20]


def test_what_moves_and_looks_as_it_did_is_a_limb(picture):
    looks, places = Looks(), grid_of(picture)
    looks.begin(picture, places)
    x, y = places[20].astype(int)
    moved, own = picture.copy(), slice(y - HALF - 1, y + HALF + 2)
    moved[own, x : x + WINDOW + 2] = picture[own, x - HALF - 1 : x + HALF + 2]
    places[20] += [HALF + 1.0, 0.0]
    assert 20 in after(looks, moved, places, 1)


def test_what_changes_in_its_place_is_no_slide(picture):
    """A lamp that is lit."""
    looks, places = Looks(), grid_of(picture)
    looks.begin(picture, places)
    other = plaster(np.random.default_rng(4), picture.shape)
    assert len(after(looks, other, places, 3 * RENEWED)) == len(places)


def test_points_that_came_later_are_compared_once_all_are_looked_at(picture):
    looks, places = Looks(), grid_of(picture)
    rows = followed(len(places))
    rows[20] = False
    looks.begin(picture, places[rows])
    order = np.append(np.flatnonzero(rows), 20)  # new points come last
    looks.follow(picture, places[rows], followed(rows.sum()))
    looks.begin(picture, places[order])
    moved = places[order] + [[4.0 * (row == 20), 0.0] for row in order]
    assert looks.follow(picture, moved, followed(len(order))).all()  # unknown so far
    looks.begin(picture, moved)
    assert len(after(looks, picture, moved, RENEWED)) == len(order)
    moved[-1] -= [4.0, 0.0]
    assert len(after(looks, picture, moved, 1)) == len(order) - 1


def test_few_points_do_not_tell(picture):
    looks, places = Looks(), grid_of(picture)[:N_AROUND]
    looks.begin(picture, places)
    assert len(after(looks, picture, places + np.array([4.0, 0.0]), 1)) == N_AROUND


@pytest.mark.parametrize("growth", [0.95, 1.05])
def test_what_grows_does_not_move_apart(growth):
    places = np.random.default_rng(6).uniform(0, 100, (400, 2))
    inside = np.flatnonzero((abs(places - 50) < 35).all(axis=1))
    apart = moved_apart(places, growth * places, inside)
    assert apart.mean() < 0.05
    alone = growth * places + [[10.0, 0.0]] * (np.arange(400) == inside[0])[:, None]
    assert moved_apart(places, alone, inside[:1]).all()


def test_frames_come_late_and_without_what_was_sliding():
    n_frames, ids = 3 * SLIDING, np.array([3, 7])
    slid = {SLIDING + 2: [7], n_frames - 1: [3]}
    asked = []

    def tracked():
        for frame in range(n_frames):
            asked.append(frame)
            here = ids if frame < SLIDING + 2 else ids[:1]
            yield here, here[:, None] + [0.0, frame], np.array(slid.get(frame, []))

    for frame, (here, points) in enumerate(without_sliding(tracked())):
        assert len(asked) == min(frame + SLIDING + 1, n_frames)
        expected = [3] if frame < n_frames - 1 - SLIDING else []
        expected = [*expected, 7] if frame < 2 else expected
        # The frame in which it is seen has it no longer.
        assert here.tolist() == (expected if frame < n_frames - 1 else [3])
        np.testing.assert_array_equal(points, here[:, None] + [0.0, frame])
    assert frame == n_frames - 1


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
