"""Outliers go where none of their neighbours goes."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from skmotionseg import unpack_tracks
from skmotionseg._core.geometry.isolation import (
    COMPANIONS,
    LEAST_USUAL,
    NEIGHBOURS,
    SPAN,
    isolation,
)
from skmotionseg._segmenter.landmarks import ISOLATED
from skmotionseg.datasets import make_scene


@pytest.fixture(scope="module")
def scene():
    """3,000 tracks: a background, two small things, and a quarter of outliers."""
    return make_scene(
        "dense_small", n_tracks=3000, n_motions=3, outliers=0.25, random_state=0
    )


def textbook(points, visibility):
    """One track and one pair of frames at a time."""
    largest = np.ones(len(points))
    last = visibility.shape[1] - 1
    for first in range(0, last, SPAN):
        then = min(first + SPAN, last)
        seen = np.flatnonzero(visibility[:, first] & visibility[:, then])
        if len(seen) <= NEIGHBOURS:
            continue
        x = points[seen, first]
        moved = points[seen, then] - x
        apart, companions = np.empty(len(seen)), []
        for i in range(len(seen)):
            near = np.argsort(np.linalg.norm(x - x[i], axis=1))[1 : NEIGHBOURS + 1]
            different = np.linalg.norm(moved[near] - moved[i], axis=1)
            order = np.argsort(different)[:COMPANIONS]
            apart[i] = different[order[-1]]
            companions.append(near[order])
        least = LEAST_USUAL * np.median(apart)
        for i, track in enumerate(seen):
            usual = max(np.median(apart[companions[i]]), least)
            largest[track] = max(largest[track], apart[i] / usual)
    return largest


def test_it_is_that_of_the_textbook():
    scene = make_scene("hand_held", n_tracks=150, n_frames=9, random_state=1)
    tracks = unpack_tracks(scene.data)
    assert_allclose(isolation(*tracks), textbook(*tracks))


def test_outliers_are_isolated_and_others_are_not(scene):
    isolated = isolation(*unpack_tracks(scene.data)) > ISOLATED
    small = np.isin(scene.target, np.argsort(np.bincount(scene.target + 1)[1:])[:2])
    assert isolated[scene.target < 0].mean() > 0.75
    assert isolated[scene.target >= 0].mean() < 0.1
    assert isolated[small].mean() < 0.25


def test_units_do_not_matter(scene):
    points, visibility = unpack_tracks(scene.data[:500])
    expected = isolation(points, visibility)
    assert_allclose(isolation(8 * points - 100, visibility), expected, rtol=1e-6)


def test_tracks_with_few_others_are_not_isolated(scene):
    points, visibility = unpack_tracks(scene.data[:NEIGHBOURS])
    assert_array_equal(isolation(points, visibility), 1)


def test_tracks_that_are_seen_too_briefly_are_not_isolated(scene):
    points, visibility = unpack_tracks(scene.data[:200])
    visibility = visibility.copy()
    visibility[0], visibility[0, 3] = False, True
    assert isolation(points, visibility)[0] == 1


def test_what_stands_still_is_not_isolated():
    points = np.random.default_rng(0).uniform(0, 500, size=(100, 1, 2))
    still = np.repeat(points, 6, axis=1)
    assert_array_equal(isolation(still, np.ones((100, 6), dtype=bool)), 1)


@pytest.mark.parametrize("n_frames", [2, 6])
def test_what_leaps_among_points_that_stand_still_is_isolated(n_frames):
    points = np.random.default_rng(0).uniform(0, 500, size=(100, 1, 2))
    points = np.repeat(points, n_frames, axis=1)
    points[:30] = points[:1]  # all in one place: they have no distance
    points[7, -1] += 1e7
    found = isolation(points, np.ones((100, n_frames), dtype=bool))
    assert np.isfinite(found).all()
    assert found[7] > 1e6 and (found[8:30] == 1).all()


@pytest.mark.parametrize("share", [0.2, 0.5])
def test_mismatches_of_two_images_are_isolated_and_small_things_are_not(share):
    rng = np.random.default_rng(0)
    x = rng.uniform(0, 1000, (1500, 2))
    thing = rng.uniform(400, 480, (25, 2))
    here = np.concatenate([x, thing])
    there = here + np.repeat([[20, 5], [60, -30]], [1500, 25], axis=0)
    there += rng.standard_normal(there.shape)
    n = int(share / (1 - share) * len(here))
    astray = rng.uniform(0, 1000, (2, n, 2))
    points = np.stack([here, there], axis=1)
    points = np.concatenate([points, astray.swapaxes(0, 1)])
    found = isolation(points, np.ones((len(points), 2), dtype=bool)) > 4
    assert found[:1500].mean() < 0.01
    assert found[1500:1525].mean() < 0.1
    assert found[1525:].mean() > 0.5
