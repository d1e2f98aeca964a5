"""Groups of tracks that pairs of images agree on."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from skmotionseg._core.partition.pair_agreement import (
    FEWEST_TRACKS,
    MOST_MERGED,
    VOTES,
    agreed_groups,
)


def plainly_merged(n_tracks, parted, least):
    """The same groups by counting all votes again for each two of them."""
    told = [dict(zip(*map(np.ndarray.tolist, each), strict=True)) for each in parted]

    def agreement(first, second):
        votes = [
            1 if labels[a] == labels[b] else -1
            for labels in told
            for a in first
            for b in second
            if labels.get(a, -1) >= 0 and labels.get(b, -1) >= 0
        ]
        surely = 1 - np.exp(-len(votes) / VOTES)
        return sum(votes) / max(len(votes), 1) * surely

    groups = [[k] for k in range(n_tracks)]
    while True:
        every = [
            (agreement(groups[i], groups[j]), -i, -j)
            for i in range(len(groups))
            for j in range(i + 1, len(groups))
        ]
        best, i, j = max(every)
        if best <= least:
            return groups
        groups[-i] += groups.pop(-j)


def parted_by_chance(rng, n_tracks, n_pairs, wrong):
    true = np.arange(n_tracks) % 3
    parted = []
    for _ in range(n_pairs):
        tracks = np.flatnonzero(rng.uniform(size=n_tracks) < 0.7)
        labels = np.where(rng.uniform(size=len(tracks)) < wrong, -1, true[tracks])
        if rng.uniform() < 0.4:
            labels = np.minimum(labels, 1)  # two of the motions are taken for one
        parted.append((tracks, labels))
    return parted


@pytest.mark.parametrize("least", [0.0, 0.3, 0.6])
def test_groups_are_those_of_counting_all_votes(least):
    for seed in range(4):
        parted = parted_by_chance(np.random.default_rng(seed), 24, 5, 0.2)
        groups = plainly_merged(24, parted, least)
        expected = np.full(24, -1)
        large = [group for group in groups if len(group) >= FEWEST_TRACKS]
        for label, group in enumerate(sorted(large, key=len, reverse=True)):
            expected[group] = label
        told = np.unique(np.concatenate([t[labels >= 0] for t, labels in parted]))
        found = agreed_groups(24, parted, least)
        assert (found[np.setdiff1d(np.arange(24), told)] == -1).all()
        together = found[told, None] == found[told]
        assert_array_equal(together, expected[told, None] == expected[told])


def test_what_most_pairs_part_is_parted_although_some_do_not():
    tracks, true = np.arange(30), np.repeat([0, 1], [18, 12])
    one = np.zeros(30, dtype=int)
    assert_array_equal(agreed_groups(30, [(tracks, true)] * 3), true)
    assert_array_equal(agreed_groups(30, [(tracks, true)] * 3 + [(tracks, one)]), true)
    assert_array_equal(agreed_groups(30, [(tracks, true)] + [(tracks, one)] * 3), one)


def test_motions_are_found_in_pairs_that_see_other_tracks():
    true = np.arange(40) % 2
    halves = np.arange(30), np.arange(10, 40)
    parted = [(tracks, true[tracks] ^ k) for k, tracks in enumerate(halves)]
    assert_array_equal(agreed_groups(40, parted), true)


def test_tracks_without_a_motion_have_no_group():
    true = np.repeat([0, -1, 1], [10, 5, FEWEST_TRACKS - 1])
    labels = agreed_groups(len(true), [(np.arange(len(true)), true)] * 2)
    assert_array_equal(labels, np.where(true == 0, 0, -1))
    nobody = agreed_groups(3, [(np.arange(3), np.full(3, -1))])
    assert_array_equal(nobody, [-1, -1, -1])


def test_of_many_tracks_those_that_most_pairs_know_are_merged():
    n = MOST_MERGED + 50
    true = np.arange(n) % 2
    some = np.arange(50, n)
    labels = agreed_groups(n, [(np.arange(n), true), (some, true[some])])
    assert (labels[:50] == -1).all()
    assert_array_equal(labels[50:] == labels[50], true[50:] == true[50])
