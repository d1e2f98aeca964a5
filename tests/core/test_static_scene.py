"""The static scene of made-up clips, and the parts that move before it."""

from __future__ import annotations

import numpy as np
import pytest

from skmotionseg._core.geometry.windows import Windows
from skmotionseg._core.partition.moving_parts import (
    least_cut,
    moving_parts,
    track_graph,
)
from skmotionseg._core.partition.static_scene import fit_static_scene, view_of

SIZE = np.array([640, 480])
FOCAL = 640.0
N_FRAMES = 12


def pixels(X):
    """Images of points (..., 3) before the camera."""
    return FOCAL * X[..., :2] / X[..., 2:] + SIZE / 2


def seen_at(spacing, box=((0, 0), (640, 480))):
    """Places (n, 2) on a grid inside a box of the first image."""
    (left, top), (right, bottom) = box
    x, y = np.meshgrid(
        np.arange(left + 4, right, spacing), np.arange(top + 4, bottom, spacing)
    )
    return np.column_stack([x.ravel(), y.ravel()]).astype(float)


def tracks(places, depth, steps, turn=0.0, noise=0.05, seed=0):
    """Tracks (n, N_FRAMES, 2) of points at depths, which move by steps (3,)."""
    rays = np.column_stack([(places - SIZE / 2) / FOCAL, np.ones(len(places))])
    X = rays * np.broadcast_to(depth, len(places))[:, None]
    frames = np.arange(N_FRAMES)
    X = X[:, None] + frames[:, None] * np.asarray(steps)
    angle = turn * frames
    x = np.cos(angle) * X[..., 0] + np.sin(angle) * X[..., 2]
    z = np.cos(angle) * X[..., 2] - np.sin(angle) * X[..., 0]
    points = pixels(np.stack([x, X[..., 1], z], axis=-1))
    rng = np.random.default_rng(seed)
    return points + noise * rng.standard_normal(points.shape)


def ground_and_wall(places):
    """Depths of a room: far above the horizon, nearer below it, and continuous."""
    return np.where(places[:, 1] < 280, 12.0, 12.0 / (1 + (places[:, 1] - 280) / 200))


def clip(box, steps, camera=(-0.03, 0, 0), turn=0.004, spacing=12, depth=6.0):
    """A room, a thing in a box of the image that moves, and which tracks are of it."""
    places = seen_at(spacing)
    (left, top), (right, bottom) = box
    inside = (places > (left, top)).all(axis=1) & (places < (right, bottom)).all(axis=1)
    room = tracks(places[~inside], ground_and_wall(places[~inside]), camera, turn)
    own = np.add(camera, steps)
    thing = tracks(seen_at(spacing, box), depth, own, turn, seed=1)
    points = np.concatenate([room, thing])
    visibility = ((points >= 0) & (points < SIZE)).all(axis=2)
    points = np.where(visibility[..., None], points, np.nan)
    return points, visibility, np.arange(len(points)) >= len(room)


BOX = ((260, 200), (400, 340))


def found(points, visibility, labels=None):
    if labels is None:
        labels = np.zeros(len(points), dtype=int)
    return moving_parts(points, visibility, labels, 0, tuple(SIZE))


@pytest.mark.parametrize(
    "steps",
    [(0.02, 0.05, 0), (0.06, 0, 0), (0, 0.06, 0.1)],
    ids=["across", "as the camera moves", "away"],
)
def test_what_moves_before_a_room_is_found(steps):
    points, visibility, moves = clip(BOX, steps)
    parts = found(points, visibility)
    assert (parts[moves] == 0).mean() > 0.95
    assert (parts[~moves] == -1).mean() > 0.99


def test_a_room_alone_has_no_moving_parts():
    points, visibility, moves = clip(BOX, (0, 0, 0))
    parts = found(points[~moves], visibility[~moves])
    assert (parts == -1).all()


def test_what_stands_on_the_ground_is_still():
    """A box at the depth of the ground that it stands on, before the far wall."""
    points, visibility, _ = clip(((260, 200), (400, 380)), (0, 0, 0), depth=8.0)
    assert (found(points, visibility) == -1).mean() > 0.98


def test_a_thing_that_has_most_tracks_is_not_the_scene():
    points, visibility, moves = clip(((100, 80), (560, 420)), (0.02, 0.05, 0))
    assert moves.mean() > 0.45
    parts = found(points, visibility)
    assert (parts[moves] == 0).mean() > 0.95
    assert (parts[~moves] == -1).mean() > 0.99


def test_two_things_are_two_parts():
    left, visibility, moves = clip(((80, 100), (200, 220)), (0.02, 0.05, 0))
    right, seen, moves_too = clip(((420, 100), (540, 220)), (0, -0.06, 0))
    thing = right[moves_too]
    points = np.concatenate([left, thing])
    visibility = np.concatenate([visibility, seen[moves_too]])
    parts = found(points, visibility)
    first, second = parts[: len(left)][moves], parts[len(left) :]
    assert len(set(first[first >= 0])) == len(set(second[second >= 0])) == 1
    assert set(first) != set(second)


def test_a_small_part_inside_another_is_of_it():
    """A head, or a hand, of what moves."""
    points, visibility, moves = clip(BOX, (0.02, 0.05, 0))
    middle = np.nanmean(points, axis=1)
    inner = moves & (np.abs(middle - np.nanmean(middle[moves], axis=0)) < 20).all(
        axis=1
    )
    points[inner] += np.multiply.outer(np.arange(N_FRAMES), [0.0, -1.0])
    parts = found(points, visibility)
    assert inner.sum() >= 12
    assert (parts[moves] == 0).mean() > 0.9


def test_a_crowd_of_noise_is_no_part():
    """Water: tracks that move, but neither as one nor as those around them."""
    points, visibility, moves = clip(BOX, (0, 0, 0))
    rng = np.random.default_rng(0)
    walk = rng.normal(scale=2.0, size=points[moves].shape).cumsum(axis=1)
    points[moves] += walk
    assert (found(points, visibility) == -1).mean() > 0.98


def test_labels_may_help_and_do_not_hurt():
    points, visibility, moves = clip(BOX, (0.02, 0.05, 0))
    parts = found(points, visibility, moves.astype(int))
    assert (parts[moves] == 0).mean() > 0.95
    assert (parts[~moves] == -1).mean() > 0.99


def test_what_is_too_short_or_too_few_is_not_judged():
    points, visibility, _ = clip(BOX, (0.02, 0.05, 0))
    assert found(points[:, :2], visibility[:, :2]) is None
    assert found(points[:8], visibility[:8]) is None


def test_the_scene_is_as_far_off_as_the_noise():
    points, visibility, moves = clip(BOX, (0.02, 0.05, 0))
    scene = fit_static_scene(Windows(points, visibility), SIZE)
    assert np.nanmedian(scene.deviations[~moves]) < 0.1
    assert np.nanmedian(scene.deviations[moves]) > 1
    assert scene.members[~moves].mean() > 0.95
    assert not scene.members[moves].any()


def test_depths_and_their_shifts_are_those_of_the_scene():
    places = seen_at(40)
    depth = ground_and_wall(places)
    points = tracks(places, depth, (-0.03, 0, 0), noise=0)
    visibility = np.ones(points.shape[:2], dtype=bool)
    windows = Windows(points, visibility)
    motion = windows.fit([np.arange(len(points))])[0]
    view = view_of(windows, 0, np.arange(len(points)), motion.poses[0])
    assert view.deviations.max() < 0.02
    assert np.corrcoef(view.depths, 1 / depth)[0, 1] > 0.999
    assert (view.shifts > 0).all()


def test_the_least_cut_is_the_least():
    rng = np.random.default_rng(0)
    odds = rng.normal(size=8)
    pairs = np.array([(i, j) for i in range(8) for j in range(i + 1, 8)])
    links = rng.uniform(0, 0.6, size=len(pairs))
    every = np.array([[bool(k >> i & 1) for i in range(8)] for k in range(256)])
    parted = every[:, pairs[:, 0]] != every[:, pairs[:, 1]]
    costs = parted @ links - every @ odds
    np.testing.assert_array_equal(least_cut(odds, pairs, links), every[costs.argmin()])


def test_neighbours_are_near_and_apart_by_how_they_move():
    points, visibility, moves = clip(BOX, (0.02, 0.05, 0))
    graph = track_graph(points, visibility, 1.0)
    crossing = moves[graph.pairs[:, 0]] != moves[graph.pairs[:, 1]]
    assert np.median(graph.apart[crossing]) > 5 * np.median(graph.apart[~crossing])
    assert len(np.unique(graph.pairs, axis=0)) == len(graph.pairs)


def test_tracks_on_a_line_have_no_triangulation():
    line = np.column_stack([np.arange(5.0), np.zeros(5)])[:, None].repeat(4, axis=1)
    graph = track_graph(line, np.ones((5, 4), dtype=bool), 1.0)
    assert graph.pairs.shape == (0, 2)
