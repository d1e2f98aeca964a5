"""Motions are fitted to those of their tracks that they explain."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from skmotionseg._core.geometry.description_length import clip_geometry
from skmotionseg._core.geometry.tracks import unpack_tracks
from skmotionseg._core.partition.motions import (
    Explanation,
    fit_motions,
    inliers,
    noise_of_inliers,
    usual,
)
from skmotionseg._segmenter.motions import motions_in_pixels
from skmotionseg.datasets import make_rigid_motions


def scene_with(outliers, seed=0, n_frames=12, **scene):
    X, y = make_rigid_motions(
        240, n_frames, outliers=outliers, random_state=seed, **scene
    )
    return X, y, unpack_tracks(X)


def linked(y, within=1.0, across=0.02):
    """An affinity that knows the motions; rubbish is linked to all alike."""
    affinity = np.where(y[:, None] == y, within, across)
    affinity[y < 0] = affinity[:, y < 0] = 0.2
    return affinity


@pytest.mark.parametrize("seed", range(8))
def test_tracks_of_one_place_are_near_their_motion(seed):
    """Whatever matrix they get: all are in an epipole, where rounding decides."""
    y, steps = np.repeat([0, 1], 20), np.array([0, 0.5, 1.2])[:, None]
    path = np.random.default_rng(seed).normal(size=(2, 2))
    starts = np.array([[1.3, 1.1], [0.8, 1.4]])
    points = np.float32(1e6 * (starts[y][:, None] + steps * path[y][:, None]))
    visibility = np.ones(points.shape[:2], dtype=bool)
    motions = fit_motions(clip_geometry(points.astype(float), visibility), y, linked(y))
    distances = motions.distances(points.astype(float), visibility)
    assert inliers(motions, distances)[y, np.arange(40)].all()


@pytest.mark.parametrize("shapes", ["general", "planar"])
def test_a_motion_stays_what_it_is_among_two_fifths_of_rubbish(shapes):
    _, y, tracks = scene_with(0.3, n_frames=20, shapes=shapes, n_motions=1)
    motions = fit_motions(clip_geometry(*tracks), np.zeros_like(y), linked(y))
    (distances,) = motions.distances(*tracks)
    pixels = distances * motions.frames.scale
    # Half a pixel of noise in each coordinate; rubbish takes steps of ten pixels.
    assert np.nanmedian(pixels[y == 0]) < 0.6
    assert np.nanmedian(pixels[y < 0]) > 5
    (inside,) = inliers(motions, distances[None])
    assert inside[y == 0].all()
    assert inside[y < 0].mean() < 0.1


def test_outliers_do_not_inflate_the_noise():
    rng = np.random.default_rng(0)
    distances = np.abs(rng.normal(scale=0.01, size=300))
    alone = noise_of_inliers(distances)
    assert alone == pytest.approx(0.01, rel=0.1)
    outliers = rng.uniform(0.1, 3, size=200)
    among = noise_of_inliers(np.concatenate([distances, outliers]))
    assert among == pytest.approx(alone, rel=0.02)
    assert 1.4826 * np.median([*distances, *outliers]) > 1.9 * alone
    assert noise_of_inliers(np.zeros(3)) == 0
    assert noise_of_inliers(np.zeros(0)) == 0


def test_few_frame_pairs_have_to_agree_that_a_track_is_an_inlier():
    _, y, (points, visibility) = scene_with(0, n_motions=1, missing=0)
    motions = fit_motions(clip_geometry(points, visibility), y, linked(y))
    torn, short = points.copy(), visibility.copy()
    torn[0, 2] += 50
    short[0, 3:] = False  # of its two pairs, one is right
    (distances,) = motions.distances(torn, short)
    assert inliers(motions, distances[None])[0, 1:].all()
    assert not inliers(motions, distances[None])[0, 0]


def test_what_is_an_inlier_of_no_motion_is_rejected_and_nothing_else():
    _, y, tracks = scene_with(0.1, n_motions=2)
    motions = fit_motions(clip_geometry(*tracks), np.where(y < 0, 0, y), linked(y))
    found = Explanation(motions, motions[:0]).reject(*tracks, np.maximum(y, 0))
    assert (found[y >= 0] == y[y >= 0]).all()
    assert (found[y < 0] < 0).mean() > 0.8
    # Of another motion it is one: neighbours had a say, and it stays where it is.
    swapped = np.where(y < 0, 0, 1 - y)
    inside = inliers(motions, motions.distances(*tracks))[np.abs(y), np.arange(len(y))]
    found = Explanation(motions, motions[:0]).reject(*tracks, swapped)
    assert_array_equal(found[(y >= 0) & inside], swapped[(y >= 0) & inside])


def test_distances_are_medians_over_the_pairs_that_see_a_track():
    _, y, (points, visibility) = scene_with(0, n_motions=1, missing=0)
    motions = fit_motions(clip_geometry(points, visibility), y, linked(y))
    (distances,) = motions.distances(points, visibility)
    assert np.isfinite(distances).all()
    torn = points.copy()
    torn[0, 0] += 500  # one of twelve frames is wrong
    (others,) = motions.distances(torn, visibility)
    assert others[0] < 5 * distances[0] + 0.01
    unseen = visibility.copy()
    unseen[0, 1:] = False
    assert np.isnan(motions.distances(points, unseen)[0, 0])


def test_a_motion_of_seven_tracks_judges_none():
    _, y, tracks = scene_with(0, n_motions=1)
    few = np.where(np.arange(len(y)) < 7, 0, -1)
    motions = fit_motions(clip_geometry(*tracks), few, linked(y))
    distances = motions.distances(*tracks)
    assert np.isnan(distances).all()
    assert inliers(motions, distances).all()


def test_unusual_noise_is_against_that_of_the_median_track():
    noise = np.array([0.01, 0.012, 0.05])
    of_tracks = noise[[0] * 5 + [1] * 3 + [2] * 3]
    assert usual(noise, of_tracks).tolist() == [1, 1, 0]
    assert usual(noise, noise[[2, 2, 2, 0]]).all()


@pytest.mark.filterwarnings("error")
def test_a_degenerate_matrix_has_no_residuals():
    _, y, tracks = scene_with(0.0, n_frames=3, n_motions=1, missing=0.0)
    motions = fit_motions(clip_geometry(*tracks), np.zeros_like(y), linked(y))
    # Its epipolar lines have no direction: distances are more than float32 holds.
    motions.fundamental[0, 0] = np.diag([0.0, 0.0, 1.0])
    found = motions_in_pixels(motions, *tracks, np.zeros_like(y), np.arange(3))
    assert np.isnan(found.residuals[0]).all()
    assert np.isfinite(found.residuals[1:]).all()
    assert not found.inliers[0].any()
