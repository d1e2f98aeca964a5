"""Motions that are the same in all pairs of images, and what they cost."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.photographs import photographs
from numpy.testing import assert_allclose, assert_array_equal

from skmotionseg import unpack_tracks
from skmotionseg._core.geometry.description_length import clip_geometry
from skmotionseg._core.geometry.tracks import pairs_with_most_tracks
from skmotionseg._core.partition import pair_mixture
from skmotionseg._core.partition.pair_mixture import (
    image_pairs,
    in_batches,
    log_evidence,
    settled,
)
from skmotionseg.metrics import misclassification_error


@pytest.fixture(scope="module")
def five():
    """Tracks of five photographs, their labels, and the pairs that see most of them."""
    scene = photographs(n_frames=5)
    points, seen = unpack_tracks(scene.data)
    chosen = pairs_with_most_tracks(seen, 16, 10)
    frames = replace(clip_geometry(points, seen).frames, pairs=chosen)
    return points, seen, scene.target, frames


def test_the_evidence_of_pairs_adds_up(five):
    points, seen, true, frames = five
    shares = (np.where(true < 0, 2, true) == np.arange(3)[:, None]).astype(float)
    pairs = image_pairs(frames, points, seen)
    batches = in_batches(pairs)
    mixture = settled(batches, shares, 4)
    labels = np.where(mixture.labels == 2, -1, mixture.labels)
    assert misclassification_error(true, labels) < 0.05
    assert_allclose(mixture.shares.sum(axis=0), 1)
    alone = [
        log_evidence(in_batches([pair]), mixture.models.of_pairs([k]), shares.shape)
        for k, pair in enumerate(pairs)
    ]
    together = log_evidence(batches, mixture.models, shares.shape)
    assert_allclose(together, sum(alone))
    assert (together[-1] == 0).all()
    # Partitions of the wrong motions cost more.
    wrong = shares[:, np.random.default_rng(0).permutation(len(true))]
    assert settled(batches, wrong, 4).cost > mixture.cost + 100


def test_pairs_side_by_side_are_as_alone(five, monkeypatch):
    points, seen, true, frames = five
    shares = (np.where(true < 0, 2, true) == np.arange(3)[:, None]).astype(float)
    # At first, some pairs see too few tracks of the second motion to tell of it.
    shares[1, np.flatnonzero(true == 1)[7:]] = 0
    pairs = image_pairs(frames, points, seen)
    together = settled(in_batches(pairs), shares, 4)
    assert len(in_batches(pairs)) == 1
    at_first = settled(in_batches(pairs), shares, 1).models.told
    assert (at_first[:, 1] < together.models.told[:, 1]).any()
    monkeypatch.setattr(pair_mixture, "BATCH", 1)
    batches = in_batches(pairs)
    assert sorted(batch.pairs.tolist() for batch in batches) == [
        [k] for k in range(len(pairs))
    ]
    alone = settled(batches, shares, 4)
    assert_allclose(alone.shares, together.shares, atol=1e-6)
    assert_allclose(alone.cost, together.cost)
    assert_array_equal(alone.models.told, together.models.told)


def test_places_do_not_depend_on_other_tracks(five):
    points, seen, _, frames = five
    frames = replace(frames, pairs=np.array([[0, 1]]))
    (whole,) = image_pairs(frames, points, seen)
    half = image_pairs(frames, points[::2], seen[::2], [whole.views.side])[0]
    kept = np.isin(whole.tracks, 2 * half.tracks)
    assert_array_equal(whole.views.x[kept], half.views.x)
    assert half.views.side == whole.views.side
