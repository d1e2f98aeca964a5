"""Partitions of photographs: which those are, their motions, and whom they place."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.photographs import photographs
from helpers.two_images import assert_places_and_rejects
from numpy.testing import assert_allclose, assert_array_equal

from skmotionseg import MotionSegmenter, pack_tracks, unpack_tracks
from skmotionseg._core.partition.photograph_partitions import (
    are_photographs,
    photograph_partitions,
)
from skmotionseg._core.partition.two_view_partitions import TEMPERATURE
from skmotionseg.datasets import make_scene, scene_families
from skmotionseg.metrics import misclassification_error


@pytest.fixture(scope="module")
def found():
    scene = photographs()
    points, seen = unpack_tracks(scene.data)
    rng = np.random.RandomState(0)
    partitions = photograph_partitions(points, seen, np.arange(1, 5), rng)
    return points, seen, scene.target, partitions


@pytest.mark.parametrize("family", scene_families())
def test_photographs_are_told_from_videos(family):
    limits = {} if family in ("long", "two_images") else {"n_frames": (5, 12)}
    for seed in range(3):
        scene = make_scene(family, n_tracks=120, random_state=seed, **limits)
        assert are_photographs(*unpack_tracks(scene.data)) == (family == "photographs")


def test_videos_with_gaps_are_no_photographs():
    rng = np.random.default_rng(0)
    points, seen = unpack_tracks(
        make_scene("street", n_tracks=100, n_frames=12, random_state=0).data
    )
    seen = seen & (rng.uniform(size=seen.shape) < 0.7)
    assert not are_photographs(np.where(seen[..., None], points, np.nan), seen)
    some = unpack_tracks(photographs().data)
    assert are_photographs(*some)
    many = [np.tile(each, (1, 9, *[1] * (each.ndim - 2))) for each in some]
    assert not are_photographs(*many)
    everything = np.ones_like(some[1])
    assert not are_photographs(np.nan_to_num(some[0]), everything)


def test_motions_and_mismatches_are_found(found):
    _, _, true, partitions = found
    assert partitions.chosen == 2
    for count, (cost, labels) in partitions.best.items():
        sizes = np.bincount(labels)
        assert len(sizes) == count and (np.diff(sizes) <= 0).all()
        assert_allclose(cost.cut + cost.length, cost.total)
    labels = np.where(partitions.outliers, -1, partitions.best[2][1])
    assert misclassification_error(true, labels) < 0.05
    assert partitions.outliers[true < 0].mean() > 0.5
    costs = {count: cost.total for count, (cost, _) in partitions.best.items()}
    expected = len(true) * (costs[1] - costs[2]) / TEMPERATURE
    assert_allclose(partitions.log_odds[2], expected)


def test_tracks_are_placed_and_rejected_by_the_motions_in_their_order(found):
    points, seen, _, partitions = found
    assert_places_and_rejects(partitions, points, seen)
    explanation, labels = partitions.explanation, partitions.best[2][1]
    nobody = np.full(len(labels), -1)
    once = seen & (np.cumsum(seen, axis=1) == 1)
    assert (explanation.nearest(points, once, nobody) == -1).all()
    assert_array_equal(explanation.reject(points, once, labels), labels)
    one = explanation.reordered([0])
    assert set(one.nearest(points, seen, nobody)) <= {-1, 0}
    assert len(one.motions.noise) == 1


def test_numbers_may_be_given(found):
    points, seen = found[:2]
    rng = np.random.RandomState(0)
    one = photograph_partitions(points[:60], seen[:60], np.array([1]), rng)
    assert list(one.best) == [one.chosen] == [1]
    some = points[:30], seen[:30]
    assert photograph_partitions(*some, np.array([25]), rng) is None
    assert photograph_partitions(points[:10], seen[:10], np.arange(1, 4), rng) is None


def test_a_track_is_placed_whatever_others_there_are(found):
    points, seen, _, partitions = found
    explanation, nobody = partitions.explanation, np.full(len(points), -1)
    every = explanation.nearest(points, seen, nobody)
    assert_array_equal(
        explanation.nearest(points[:30], seen[:30], nobody[:30]), every[:30]
    )


def test_the_default_parts_photographs():
    errors, rejected = [], []
    for seed in (4, 16, 26):
        scene = photographs(seed)
        segmenter = MotionSegmenter(max_motions=3, random_state=0).fit(scene.data)
        assert segmenter.n_motions_ == 2
        errors.append(misclassification_error(scene.target, segmenter.labels_))
        rejected.append((segmenter.labels_[scene.target < 0] < 0).mean())
    assert max(errors) < 0.1 and np.mean(errors) < 0.04
    assert min(rejected) > 0.4 and np.mean(rejected) > 0.5
    points, seen = unpack_tracks(scene.data)
    again = segmenter.predict(pack_tracks(points + 0.01, seen))
    inside = segmenter.labels_ >= 0
    assert (again == segmenter.labels_)[inside].mean() > 0.9


@pytest.mark.filterwarnings("ignore:half of the tracks are:UserWarning")
def test_photographs_of_junk_have_a_motion_as_any_clip_of_it():
    rng = np.random.RandomState(4)
    points, seen = rng.uniform(0, 500, (30, 4, 2)), rng.uniform(size=(30, 4)) < 0.8
    seen[:, :2] = True
    points[~seen] = np.nan
    assert are_photographs(points, seen)
    X = pack_tracks(points, seen)
    for n_motions in (1, "auto"):
        segmenter = MotionSegmenter(n_motions, random_state=0).fit(X)
        assert segmenter.n_motions_ == 1
        assert_array_equal(segmenter.predict(X), segmenter.labels_)
