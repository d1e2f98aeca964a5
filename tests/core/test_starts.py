"""Where fits of rigid motions start."""

from __future__ import annotations

import numpy as np
from numpy.testing import assert_allclose

from skmotionseg._core.geometry.poses import images_of, rotations_of
from skmotionseg._core.geometry.rigid_motion import observed
from skmotionseg._core.geometry.starts import (
    DEGREES_APART,
    N_DIRECTIONS,
    N_STARTS,
    _around,
    _best_apart,
    _directions,
    starting_motions,
)

MIRROR = np.array([-1.0, 1, 1])


def same_axes(one, other):
    """Whether two sets of directions (n, 3) are the same, but for signs."""
    return np.abs(one @ other.T).max(axis=1).min() > 1 - 1e-9


def test_directions_are_unit_vectors_and_one_is_straight_ahead():
    directions = _directions(N_DIRECTIONS)
    assert_allclose(np.linalg.norm(directions, axis=1), 1)
    assert (np.abs(directions @ [0, 0, 1]) > 1 - 1e-9).any()


def test_directions_and_their_neighbours_are_the_same_in_a_mirror():
    directions = _directions(N_DIRECTIONS)
    assert same_axes(directions * MIRROR, directions)
    near = _around(directions[None], 8.0)[0]
    mirrored = _around(directions[None] * MIRROR, 8.0)[0]
    for one, other in zip(near, mirrored, strict=True):
        assert same_axes(one * MIRROR, other)
    cosines = np.einsum("dj,dnj->dn", directions, near[:, 1:])
    assert_allclose(cosines, np.cos(np.radians(8)))


def test_the_best_directions_differ():
    directions = _directions(N_DIRECTIONS)
    scores = 1 - np.abs(directions @ [0.6, 0, 0.8])[None]
    best = directions[_best_apart(scores, directions, 3)[0]]
    assert_allclose(abs(best[0] @ [0.6, 0, 0.8]), 1 - scores.min())
    cosines = np.abs(best @ best.T)[np.triu_indices(3, 1)]
    assert cosines.max() < np.cos(np.radians(DEGREES_APART))


def test_driving_ahead_starts_near_the_truth_at_any_speed():
    rng = np.random.RandomState(0)
    rays = np.column_stack([rng.uniform(-0.5, 0.5, (40, 2)), np.ones(40)])
    depths = rng.uniform(0.1, 1, 40)
    way = np.array([-0.2, -0.15, 0, 0.01, 0.02, 0.1])  # brakes, and goes on
    points = rays[:, None] + depths[:, None, None] * way[:, None] * [0.05, 0, 1]
    points = points @ rotations_of(np.array([0, 0.02, 0])).T  # in all frames but one
    points[:, 2] = rays
    x = (points[..., :2] / points[..., 2:])[None]
    seen = np.ones(x.shape[:3], dtype=bool)
    problems = observed(x, seen, np.ones((1, 40)), np.full(1, 1e-4), 2)
    repeated = problems.of(np.zeros(N_STARTS, dtype=int))
    rotations, translations, depths = starting_motions(problems, repeated)
    images, _, _ = images_of(repeated.rays, depths, rotations, translations)
    errors = np.abs(images - repeated.x)  # (2, L, S, n)
    assert np.median(errors, axis=(0, 1, 3)).min() < 2e-3
