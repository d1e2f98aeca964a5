"""What moves before the static scene of made-up clips."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from helpers.rooms import BOX, N_FRAMES, SIZE, clip
from numpy.testing import assert_array_equal

from skmotionseg._core.geometry.tracks import unpack_tracks
from skmotionseg._core.geometry.windows import Windows
from skmotionseg._core.partition import moving_parts as module
from skmotionseg._core.partition.moving_parts import (
    LARGE_STEP,
    LEAST_NOISE,
    LEAST_TOUCHING,
    LEAST_TRACKS,
    ODDS_OF_LABEL,
    _Parts,
    least_cut,
    moving_odds,
    moving_parts,
    relative_noise,
    track_graph,
)
from skmotionseg._core.partition.static_scene import (
    StaticScene,
    View,
    fit_static_scene,
)
from skmotionseg.datasets import make_scene


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


def test_tracks_too_short_to_be_judged_go_with_their_motion():
    points, visibility, moves = clip(BOX, (0.02, 0.05, 0))
    short = np.flatnonzero(moves)[::4]
    visibility[short, 2:] = False
    points[short, 2:] = np.nan
    parts = found(points, visibility, moves.astype(int))
    assert (parts[moves] == 0).mean() > 0.98


def test_simulated_bodies_with_limbs_are_found_whole():
    """Boxes and blobs that turn, whose neighbouring tracks differ in depth."""
    shares = []
    for seed in (100, 104, 107):
        scene = make_scene(
            "articulated",
            random_state=seed,
            n_tracks=1200,
            n_frames=16,
            background=0.75,
            outliers=0.1,
            facets=0,  # boards that hang before a wall are taken for objects
            bending=0,
        )
        points, visibility = unpack_tracks(scene.data)
        size, target = tuple(scene.image_size), scene.target
        parts = moving_parts(points, visibility, target, scene.background, size)
        moves = (target != scene.background) & (target >= 0)
        shares.append((parts[moves] >= 0).mean())
        assert (parts[target == scene.background] == -1).mean() > 0.98
    assert np.mean(shares) > 0.9


# A thing on the far wall, which no depth tells from it.
ON_THE_WALL = ((260, 100), (400, 240))


def slow_clip(noise, step=0.004, n_frames=10):
    """A thing that moves by 0.2 pixels per frame across the image of a wall."""
    points, visibility, moves = clip(ON_THE_WALL, (0, step, 0), depth=12.0)
    rng = np.random.default_rng(3)
    points = points + noise * rng.standard_normal(points.shape)
    return points[:, :n_frames], visibility[:, :n_frames], moves


def test_a_slow_thing_is_found_in_ten_frames_which_windows_span():
    points, visibility, moves = slow_clip(0.05)
    parts = found(points, visibility)
    assert (parts[moves] == 0).mean() > 0.95
    assert (parts[~moves] == -1).mean() > 0.99


def test_a_slow_motion_is_told_by_all_of_its_tracks():
    """Each of them is within the noise of the scene."""
    points, visibility, moves = slow_clip(0.2)
    assert (found(points, visibility) == -1).all()
    parts = found(points, visibility, moves.astype(int))
    assert (parts[moves] == 0).mean() > 0.95
    assert (parts[~moves] == -1).mean() > 0.99


def test_motions_of_longer_clips_are_not_told_as_wholes(monkeypatch):
    """Their odds are those of short ones."""
    monkeypatch.setattr(module, "LONGEST_SHORT", 9)
    points, visibility, moves = slow_clip(0.2)
    assert (found(points, visibility, moves.astype(int)) == -1).all()


def test_a_piece_of_the_scene_that_has_a_label_does_not_move():
    points, visibility, piece = slow_clip(0.2, step=0.0)
    assert (found(points, visibility, piece.astype(int)) == -1).all()


def test_the_odds_of_a_motion_are_of_most_of_its_tracks():
    points, visibility, moves = slow_clip(0.2)
    windows = Windows(points, visibility)
    parts = _Parts(windows, fit_static_scene(windows, SIZE), np.empty((0, 2), int))
    thing, room = np.flatnonzero(moves), np.flatnonzero(~moves)
    assert parts.odds_of_motion(room[: len(thing)]) < -1
    slow = parts.odds_of_motion(thing)
    points, visibility, _ = slow_clip(0.2, step=0.02)
    windows = Windows(points, visibility)
    parts = _Parts(windows, fit_static_scene(windows, SIZE), np.empty((0, 2), int))
    fast = parts.odds_of_motion(thing)
    assert parts.odds_of_motion(room[: len(thing)]) < slow < fast
    assert fast > 2
    # A few tracks of others, however far, change little.
    mixed = np.append(thing, room[: len(thing) // 4])
    assert abs(parts.odds_of_motion(mixed) - fast) < 1
    assert parts.odds_of_motion(thing[: LEAST_TRACKS - 1]) == -np.inf


def numbered(pairs, rigid, bent, is_short=True, n_tracks=40):
    fake = SimpleNamespace(_pairs=np.array(pairs), _scene=np.zeros(n_tracks))
    return _Parts._numbered(fake, rigid, bent, is_short)


def test_what_bends_is_one_with_the_rigid_parts_that_it_touches():
    """A head, a body that bends, a hand; and two cars that touch."""
    head, body, hand = np.arange(5), np.arange(5, 20), np.arange(20, 25)
    car, other = np.arange(25, 33), np.arange(33, 39)
    joints = [(k, 5 + k) for k in range(LEAST_TOUCHING)]
    joints += [(15 + k, 20 + k) for k in range(LEAST_TOUCHING)]
    bumpers = [(27 + k, 33 + k) for k in range(6)]
    labels, n_parts = numbered(joints + bumpers, [head, hand, car, other], [body])
    assert n_parts == 3
    assert_array_equal(labels, np.repeat([0, 1, 2, -1], [25, 8, 6, 1]))


def test_what_has_touched_at_some_time_of_a_long_clip_is_not_one():
    """Two people who pass each other; whether they are one, their movements tell."""
    touching = [(k, 10 + k) for k in range(2 * LEAST_TOUCHING)]
    regions = [np.arange(10)], [np.arange(10, 25)]
    labels, n_parts = numbered(touching, *regions, is_short=False)
    assert n_parts == 2
    assert_array_equal(labels, np.repeat([1, 0, -1], [10, 15, 15]))
    assert numbered(touching, *regions)[1] == 1


def test_what_bends_and_touches_hardly_is_a_part_of_its_own():
    touching = [(k, 30 - k) for k in range(LEAST_TOUCHING - 1)]
    labels, n_parts = numbered(touching, [np.arange(10)], [np.arange(20, 35)])
    assert n_parts == 2
    assert_array_equal(labels, np.repeat([1, -1, 0, -1], [10, 10, 15, 5]))


def test_without_parts_no_track_is_of_one():
    labels, n_parts = numbered(np.empty((0, 2), int), [], [])
    assert n_parts == 0
    assert_array_equal(labels, np.full(40, -1))


def test_a_region_of_several_motions_comes_apart_into_them():
    """Two things that touch: each is explained once the other is taken away."""
    things = np.repeat([0, 1], LEAST_TRACKS)
    tracks = np.arange(len(things))

    class Touching(_Parts):
        def __init__(self):
            self._pairs = np.stack([tracks[:-1], tracks[1:]], axis=1)
            self._scene = np.zeros(len(things))

        def _explained(self, region, smooth=True):
            return things[region] == things[region].min()

    parts, rest = Touching()._rigid_parts(np.ones(len(things), dtype=bool))
    assert [set(things[part]) for part in parts] == [{0}, {1}]
    assert_array_equal(np.sort(np.concatenate(parts)), tracks)
    assert not rest.any()


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


def test_noise_is_told_by_jitter_and_not_by_motion():
    """Three kinds of tracks before a camera that shakes: still, noisy, moving."""
    rng = np.random.default_rng(0)
    kind = np.arange(300) % 3
    points = rng.normal(scale=np.where(kind == 1, 0.8, 0.1), size=(30, 2, 300)).T
    points = points.swapaxes(1, 2) + rng.normal(scale=2.0, size=(30, 2))
    points[kind == 2] += 0.05 * np.arange(30.0)[:, None] ** 2
    visibility = np.ones((300, 30), dtype=bool)
    visibility[::10, 3:] = False  # too briefly to tell
    noise = relative_noise(points, visibility, kind == 0)
    assert (noise[::10] == 1).all()
    still, noisy, moving = (np.median(noise[kind == k]) for k in range(3))
    assert abs(still - 1) < 0.05
    assert abs(moving - 1) < 0.05
    assert 1.7 < noisy < 2.0  # 8 to the power of 0.3


def test_four_frames_tell_noise():
    rng = np.random.default_rng(0)
    points = rng.normal(size=(60, 4, 2))
    points[40:] *= 8
    noise = relative_noise(points, np.ones((60, 4), dtype=bool), np.arange(60) < 40)
    assert 1.6 < np.median(noise[40:]) / np.median(noise[:40]) < 2.1


@pytest.mark.parametrize("n_frames", [3, 12])
def test_tracks_without_noise_are_as_usual(n_frames):
    points = np.zeros((20, n_frames, 2))
    noise = relative_noise(points, np.ones((20, n_frames), bool), np.ones(20, bool))
    assert (noise == 1).all()


def scene_of(deviations):
    """One track, so many standard deviations from the scene in some windows."""
    deviations = np.array([deviations])
    return StaticScene(
        deviations,
        np.zeros_like(deviations),
        np.ones_like(deviations),
        np.zeros(deviations.shape, dtype=bool),
    )


def test_windows_that_are_alike_tell_less_than_as_many_others():
    def odds(deviations):
        return moving_odds(scene_of(deviations))[0]

    assert odds([4.0] * 2) < odds([4.0] * 4) < 1.5 * odds([4.0] * 2)
    assert odds([4.0, np.nan]) == odds([4.0])


def test_labels_say_less_than_two_windows_at_rest():
    for n_windows in (2, 3, 10):
        at_rest = moving_odds(scene_of([0.5] * n_windows))[0]
        assert at_rest + ODDS_OF_LABEL < 0


def test_what_is_as_near_to_the_scene_as_its_noise_is_no_limb():
    """Its neighbours have the same noise: they move like it, and do not move."""
    points, visibility, moves = clip(BOX, (0.02, 0.05, 0))
    middle = np.nanmean(points, axis=1)
    cells = np.unique(middle // 120, axis=0, return_inverse=True)[1].ravel()
    rng = np.random.default_rng(0)
    shared = rng.normal(scale=0.2, size=(cells.max() + 1, N_FRAMES, 2))
    points = points + shared[cells]
    low, high = middle[moves].min(axis=0) - 30, middle[moves].max(axis=0) + 30
    around = ~moves & ((middle > low) & (middle < high)).all(axis=1)
    windows = Windows(points, visibility)
    scene = fit_static_scene(windows, SIZE)
    pairs = track_graph(points, visibility, 1.0).pairs
    labels = np.where(moves, 0, -1)
    found = _Parts(windows, scene, pairs)._with_limbs(labels, moves | around)
    assert around.sum() < moves.sum()
    assert (found[around] >= 0).mean() < 0.2


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


def test_steps_are_of_depths_to_those_around():
    parts = object.__new__(_Parts)
    parts._near = lambda rows, number: np.array([[1, 2], [0, 2], [0, 1]])
    view = View(np.zeros(3), np.array([1.0, 1.0, 3.0]), np.array([10.0, 10.0, 20.0]))
    steps = parts._steps_around(np.arange(3), 0, view)
    free = LARGE_STEP * LEAST_NOISE
    np.testing.assert_allclose(steps, np.array([10, 10, 40]) - free)
    level = view._replace(depths=np.ones(3))
    assert (parts._steps_around(np.arange(3), 0, level) == 0).all()


@pytest.mark.parametrize("n_links, absorbed", [(3, True), (2, False), (1, False)])
def test_a_part_is_of_another_that_has_more_than_half_of_its_links(n_links, absorbed):
    labels = np.repeat([0, 1, -1], [12, 2, 4])
    pairs = [[k, 12] for k in range(n_links)] + [[12, 14], [13, 15], [12, 13]]
    fake = SimpleNamespace(_pairs=np.array(pairs))
    found = _Parts._absorbed(fake, labels, 2)
    assert_array_equal(found, np.where(labels < 0, -1, 0) if absorbed else labels)
    # Not of one that is hardly larger.
    labels[:4] = -1
    assert_array_equal(_Parts._absorbed(fake, labels, 2), labels)


def test_tracks_that_no_window_sees_often_tell_nothing():
    points = np.random.default_rng(0).uniform(0, 300, size=(40, 12, 2))
    visibility = np.zeros((40, 12), dtype=bool)
    visibility[:, [0, 6]] = True
    points = np.where(visibility[..., None], points, np.nan)
    assert found(points, visibility) is None
    scene = fit_static_scene(Windows(points, visibility), SIZE)
    assert not scene.members.any() and np.isnan(scene.deviations).all()
    assert_array_equal(relative_noise(points, visibility, np.ones(40, bool)), 1)
