"""The static scene of made-up clips."""

from __future__ import annotations

import numpy as np
from helpers.rooms import BOX, SIZE, clip, ground_and_wall, seen_at, tracks

from skmotionseg._core.geometry.windows import Windows
from skmotionseg._core.partition.static_scene import fit_static_scene, view_of


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
