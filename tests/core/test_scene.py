"""Points of made-up scenes, whose static part and moving things are known."""

from __future__ import annotations

import numpy as np
import pytest

from skmotionseg._core.partition.scene import (
    LEAST_TRACKS,
    TOUCH,
    _Joints,
    _margins,
    _reach,
    background_motion,
    moving_objects,
)

SIZE = (320, 240)


def grid(left, top, right, bottom, spacing=8.0):
    x, y = np.meshgrid(np.arange(left, right, spacing), np.arange(top, bottom, spacing))
    return np.column_stack([x.ravel(), y.ravel()])


def moved(start, step, n_frames=12):
    """Tracks (n, n_frames, 2) that move by a step per frame."""
    return start[:, None] + np.multiply.outer(np.arange(n_frames), np.asarray(step))


def put_together(*parts):
    """Points, visibility and labels of (label, tracks)."""
    points = np.concatenate([tracks for _, tracks in parts])
    labels = np.concatenate([np.full(len(tracks), label) for label, tracks in parts])
    inside = ((points >= 0) & (points < SIZE)).all(axis=2)
    return points, inside, labels


@pytest.fixture
def bus():
    """A scene of few tracks around a thing that has most of them and of the frame."""
    scene = grid(2, 2, 320, 240, 24)
    thing = grid(40, 40, 270, 220, 6)
    return put_together((1, moved(scene, (1, 0))), (0, moved(thing, (-2, 0.5))))


def test_what_frames_the_picture_is_the_scene(bus):
    points, visibility, labels = bus
    assert (labels == 0).sum() > 5 * (labels == 1).sum()
    assert background_motion(points, visibility, labels, SIZE) == 1


def test_the_scene_encloses_what_is_followed_even_where_that_takes_more_of_the_frame():
    """A van in a follow shot: it stays, and reaches both sides of the picture."""
    scene = np.vstack([grid(10, 4, 310, 20, 60), grid(10, 225, 310, 240, 290)])
    van = grid(2, 48, 320, 224, 8)
    points, visibility, labels = put_together(
        (1, moved(scene, (2, 0))), (0, moved(van, (0, 0)))
    )
    shares = _margins(points[:, 0], labels, 2, np.array(SIZE))
    assert shares[0] > 2 * shares[1]
    assert background_motion(points, visibility, labels, SIZE) == 1


def test_without_labels_there_is_no_scene(bus):
    points, visibility, labels = bus
    assert background_motion(points, visibility, -np.ones_like(labels), SIZE) == -1


def test_the_scene_may_have_any_label_and_points_on_a_line(bus):
    points, visibility, labels = bus
    line = moved(np.column_stack([np.arange(40.0, 60), np.full(20, 90.0)]), (3, 0))
    points = np.concatenate([points, line])
    visibility = np.concatenate([visibility, np.ones(line.shape[:2], bool)])
    labels = np.concatenate([labels + 3, np.full(20, 9)])
    assert background_motion(points, visibility, labels, SIZE) == 4


def parts_of_a_body(leg_step=(3.2, 0.4)):
    """A torso, and a leg below it, that go together before a still scene."""
    return put_together(
        (0, moved(grid(2, 2, 320, 240, 8), (0, 0))),
        (1, moved(grid(60, 60, 100, 120, 6), (3, 0))),
        (2, moved(grid(70, 122, 90, 170, 6), leg_step)),
    )


def test_limbs_and_torso_are_one_thing():
    objects = moving_objects(*parts_of_a_body(), 0)
    labels = parts_of_a_body()[2]
    assert set(objects[labels > 0]) == {1}
    assert set(objects[labels == 0]) == {0}


def swung(start, joint, angles):
    """Tracks (n, n_frames, 2) of what turns about a joint by angles, radians."""
    from_joint = start - joint
    turn = np.array(
        [[np.cos(angles), -np.sin(angles)], [np.sin(angles), np.cos(angles)]]
    )
    return joint + np.einsum("ijf,nj->nfi", turn, from_joint)


@pytest.mark.parametrize("period", [8, 14, 30])
def test_a_leg_that_swings_as_the_torso_goes_is_of_it(period):
    """The leg's movement on the whole is unlike the torso's, but not at the hip."""
    frames = np.arange(12)
    angles = 0.5 * np.sin(2 * np.pi * frames / period)
    way = np.multiply.outer(frames, [2.0, 0.0])
    points, visibility, labels = put_together(
        (0, moved(grid(2, 2, 320, 240, 8), (0, 0))),
        (1, moved(grid(60, 60, 120, 110, 6), (2, 0))),
        (2, swung(grid(80, 108, 98, 180, 6), np.array([89, 108]), angles) + way),
    )
    objects = moving_objects(points, visibility, labels, 0)
    assert set(objects[labels > 0]) == {1}


@pytest.mark.parametrize("step", [(-2, 0), (0, 2), (5, 0), (0.5, 1.5)])
def test_tracks_dragged_at_an_edge_are_no_joint(step):
    """Of two things, each has tracks of the other where they touch."""
    points, visibility, labels = put_together(
        (0, moved(grid(2, 2, 320, 240, 8), (0, 0))),
        (1, moved(grid(120, 60, 170, 120, 6), (2, 0))),
        (2, moved(grid(120, 122, 170, 180, 6), step)),
    )
    middle = points[:, 0, 1]
    edge = (labels > 0) & (np.abs(middle - 121) < 8) & (np.arange(len(labels)) % 8 == 0)
    assert edge.any()
    true = labels.copy()
    labels[edge] = 3 - labels[edge]
    objects = moving_objects(points, visibility, labels, 0)
    first, second = (set(objects[(true == k) & ~edge]) for k in (1, 2))
    assert len(first) == len(second) == 1 and first != second


def test_things_that_touch_but_part_are_two():
    points, visibility, labels = parts_of_a_body(leg_step=(-3, 0))
    objects = moving_objects(points, visibility, labels, 0)
    assert set(objects[labels == 1]) == {1}  # seen more than the other
    assert set(objects[labels == 2]) == {2}


def test_things_far_apart_are_two_though_they_move_alike():
    points, visibility, labels = put_together(
        (0, moved(grid(2, 2, 320, 240, 8), (0, 0))),
        (1, moved(grid(20, 60, 60, 120, 6), (3, 0))),
        (2, moved(grid(200, 60, 240, 100, 6), (3, 0))),
    )
    objects = moving_objects(points, visibility, labels, 0)
    assert set(objects[labels == 1]) == {1}
    assert set(objects[labels == 2]) == {2}


def test_rejected_tracks_that_move_together_are_a_thing():
    points, visibility, labels = parts_of_a_body()
    objects = moving_objects(points, visibility, np.where(labels > 0, -1, 0), 0)
    assert (objects[labels > 0] == 1).mean() > 0.95


def test_rejected_tracks_join_the_thing_that_they_are_on():
    points, visibility, labels = parts_of_a_body()
    objects = moving_objects(points, visibility, np.where(labels == 2, -1, labels), 0)
    assert (objects[labels == 2] == 1).mean() > 0.95


def test_rejected_tracks_of_the_scene_and_lone_ones_stay_rejected():
    points, visibility, labels = parts_of_a_body()
    scene = np.flatnonzero(labels == 0)[::5]
    labels[scene] = -1
    lone = np.concatenate([scene[:1], scene[-1:]])
    points[lone] += np.multiply.outer(np.arange(12), [0.0, 4.0])
    objects = moving_objects(points, visibility, labels, 0)
    assert set(objects[scene]) == {-1}


@pytest.mark.parametrize("n_frames", [1, 2, 3])
def test_short_clips_are_survived(n_frames):
    points, visibility, labels = parts_of_a_body()
    objects = moving_objects(points[:, :n_frames], visibility[:, :n_frames], labels, 0)
    assert set(objects[labels == 0]) == {0}
    assert (objects[labels > 0] > 0).all()


def test_without_things_all_is_scene():
    points, visibility, labels = parts_of_a_body()
    static = labels == 0
    objects = moving_objects(points[static], visibility[static], labels[static], 0)
    assert set(objects) == {0}


def test_the_order_of_tracks_does_not_matter():
    points, visibility, labels = parts_of_a_body((-3, 0))
    order = np.random.default_rng(0).permutation(len(labels))
    objects = moving_objects(points, visibility, labels, 0)
    again = moving_objects(points[order], visibility[order], labels[order], 0)
    np.testing.assert_array_equal(again, objects[order])


def test_tracks_outside_of_the_picture_are_at_its_margin():
    points = np.array([[-900.0, 50.0], [4.0, 50.0], [2000.0, 50.0], [50.0, 50.0]])
    shares = _margins(points, np.array([0, 1, 0, 1]), 2, np.array([100.0, 100.0]))
    np.testing.assert_allclose(shares, [0.75, 0.25])


def test_what_is_outside_is_at_the_side_where_it_left():
    """Not at the other one."""
    points = np.array([[-900.0, -50.0], [99.0, 99.0], [1.0, 1.0], [-20.0, 50.0]])
    shares = _margins(points, np.array([0, 1, 1, 0]), 2, np.array([100.0, 100.0]))
    # Of three cells of the margin, one is shared.
    np.testing.assert_allclose(shares, [1.5 / 3, 1.5 / 3])


def test_a_single_track_touches_nothing():
    assert _reach(np.zeros((1, 2))) == 0
    line = np.array([[0.0, 0.0], [3.0, 0.0], [9.0, 0.0]])
    np.testing.assert_allclose(_reach(line), TOUCH * 3)


@pytest.mark.parametrize("n_tracks", [LEAST_TRACKS - 1, 40])
def test_a_part_carries_places_as_its_tracks_turn(n_tracks):
    """Or, of few tracks, as most of them go."""
    rng = np.random.default_rng(0)
    places = rng.uniform(0, 100, size=(n_tracks, 2))
    turn = np.array([[0.0, 0.1], [-0.1, 0.0]])
    steps = places @ turn + [3.0, 1.0]
    joints = _Joints(places, np.zeros(n_tracks, dtype=int), steps, steps, None)
    asked = np.array([[0.0, 0.0], [50.0, 200.0]])
    expected = asked @ turn + [3.0, 1.0]
    if n_tracks < LEAST_TRACKS:
        expected = np.tile(np.median(steps, axis=0), (2, 1))
    np.testing.assert_allclose(joints._carry(0, asked), expected)
