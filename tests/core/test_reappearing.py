"""Things that go behind others."""

from __future__ import annotations

import numpy as np
import pytest

from skmotionseg._core.partition.reappearing import reappeared
from skmotionseg._core.partition.scene import moving_objects

N_FRAMES = 40


def grid(x, y, spacing=5.0):
    x, y = np.meshgrid(np.arange(*x, spacing), np.arange(*y, spacing))
    return np.column_stack([x.ravel(), y.ravel()])


def clip(step, pan=-1.0, then=None):
    """A scene, and a thing that a post, x from 150 to 200, hides part by part.

    Its tracks end at the post, and new ones begin beyond, which move by another step
    where ``then`` says.
    """
    frames = np.arange(N_FRAMES)[:, None]
    camera = frames * [pan, 0.0]
    scene = grid((0, 400), (0, 200), 20.0)[:, None] + camera
    start = grid((60, 130), (80, 120))[:, None]
    before = start + frames * step
    after = before if then is None else start + frames * then
    left, right = 150.0, 200.0
    points = np.concatenate([scene, before + camera, after + camera])
    x = np.concatenate([scene, before, after])[..., 0]
    kind = np.repeat([0, 1, 2], [len(scene), len(before), len(after)])
    visibility = np.ones(points.shape[:2], dtype=bool)
    visibility[kind == 1] = x[kind == 1] < left
    visibility[kind == 2] = x[kind == 2] > right
    return np.where(visibility[..., None], points, np.nan), visibility, kind


def test_what_comes_out_is_what_went_in():
    points, visibility, kind = clip((4.0, 0.0))
    np.testing.assert_array_equal(reappeared(points, visibility, kind), [0, 1, 1])
    objects = moving_objects(points, visibility, kind, 0)
    np.testing.assert_array_equal(objects, kind > 0)


def test_a_scene_of_few_tracks_tells_enough():
    points, visibility, kind = clip((4.0, 0.0))
    scene = np.flatnonzero(kind == 0)
    few = np.isin(np.arange(len(kind)), scene[:: len(scene) // 25][:25])
    kept = few | (kind > 0)
    found = reappeared(points[kept], visibility[kept], kind[kept])
    np.testing.assert_array_equal(found, [0, 1, 1])


def test_the_numbers_do_not_say_which_was_first():
    points, visibility, kind = clip((4.0, 0.0))
    swapped = np.array([0, 2, 1])[kind]
    np.testing.assert_array_equal(reappeared(points, visibility, swapped), [0, 2, 2])


@pytest.mark.parametrize("then", [(4.0, 6.0), (9.0, 0.0)], ids=["elsewhere", "sooner"])
def test_what_moves_otherwise_is_another(then):
    points, visibility, kind = clip((4.0, 0.0), then=then)
    np.testing.assert_array_equal(reappeared(points, visibility, kind), [0, 1, 2])


def test_what_is_hidden_for_long_is_not_expected():
    points, visibility, kind = clip((4.0, 0.0))
    begins = visibility[kind == 2].any(axis=0).argmax()
    visibility[kind == 1, begins - 13 :] = False
    np.testing.assert_array_equal(reappeared(points, visibility, kind), [0, 1, 2])


def test_a_clip_without_things_or_scene_has_none():
    points, visibility, kind = clip((4.0, 0.0))
    assert reappeared(points, visibility, np.zeros_like(kind)).tolist() == [0]
    alone = kind > 0
    was = reappeared(points[alone], visibility[alone], kind[alone])
    np.testing.assert_array_equal(was, [0, 1, 2])


def test_where_the_scene_is_not_seen_nothing_is_expected():
    points, visibility, kind = clip((4.0, 0.0))
    ends = visibility[kind == 1].any(axis=0).sum()
    visibility[np.ix_(kind == 0, range(ends - 2, ends + 8))] = False
    points[~visibility] = np.nan
    np.testing.assert_array_equal(reappeared(points, visibility, kind), [0, 1, 2])


@pytest.mark.parametrize("kind_seen_now_and_then", [1, 2])
def test_without_a_movement_nothing_is_expected(kind_seen_now_and_then):
    points, visibility, kind = clip((4.0, 0.0))
    visibility = visibility.copy()
    for frame in range(N_FRAMES):  # no two frames that are a step apart
        if frame % 6 in (1, 2, 3) and kind_seen_now_and_then == 1:
            visibility[kind == 1, frame] = False
        if frame % 6 in (1, 2, 3) and kind_seen_now_and_then == 2:
            visibility[kind == 2, frame] = False
    np.testing.assert_array_equal(reappeared(points, visibility, kind), [0, 1, 2])
