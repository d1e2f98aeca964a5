"""Surfaces of one motion between two images."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.two_images import two_images
from numpy.testing import assert_allclose, assert_array_equal

from benchmarks.static_scenes import street
from skmotionseg._core.geometry.two_views import (
    MAP_UNKNOWNS,
    cost_of_surfaces,
    fit_common_geometry,
    fit_two_view_motions,
    two_views,
)
from skmotionseg._core.partition.two_view_energy import (
    NATS_OF_MOTION,
    settle,
    two_view_scene,
)
from skmotionseg._core.partition.two_view_surfaces import with_fewer_motions


def scene_of(X):
    points = X.reshape(-1, 2, 2)
    x, y = ((points - points.mean(axis=0)) / 100).swapaxes(0, 1)
    return two_view_scene(two_views(x, y), 60)


def segmented(X, y):
    """The scene, and the segmentation into the groups of labels."""
    scene = scene_of(X)
    shares = np.stack([*(y == k for k in range(y.max() + 1)), y < 0]).astype(float)
    return scene, settle(scene, None, 0.98 * shares + 0.02 / len(shares))


@pytest.fixture(scope="module")
def street_in_parts():
    return segmented(*street(seed=1))


def test_surfaces_pay_for_their_geometry_once(street_in_parts):
    scene, found = street_in_parts
    views, shares = scene.views, found.shares[:-1]
    joint = fit_common_geometry(views, shares, found.motions, 6)
    assert (joint.fundamental == joint.fundamental[0]).all()
    assert (joint.noise == joint.noise[0]).all()
    free = views.side / np.sqrt(2 * np.pi * np.e)
    expected = joint.n_unknowns[0] * np.log(free / joint.noise[0])
    expected += MAP_UNKNOWNS * np.log(free / joint.parallax).sum()
    expected -= (shares * joint.log_densities(views)).sum()
    assert_allclose(cost_of_surfaces(views, shares, joint), expected)


def test_one_surface_is_fitted_as_a_motion():
    X, _ = two_images([80])
    views = scene_of(X).views
    motion = None
    for _ in range(8):
        motion = fit_two_view_motions(views, np.ones((1, 80)), motion, False)
    alone = fit_common_geometry(views, np.ones((1, 80)), motion, 8)
    assert_allclose(
        cost_of_surfaces(views, np.ones((1, 80)), alone),
        (motion.costs(views) - motion.log_densities(views).sum(axis=1))[0],
        rtol=0.01,
    )


def test_ground_and_houses_are_one_motion(street_in_parts):
    scene, found = street_in_parts
    assert len(found.motions) == 3
    steps = list(with_fewer_motions(scene, found))
    assert [step.n_motions for step in steps] == [3, 2, 1]
    assert (np.diff([step.cost for step in steps]) < 0).all()
    assert steps[0].cost == found.cost
    last = steps[-1]
    assert_array_equal(last.motion_of, 0)
    assert (last.motions.fundamental == last.motions.fundamental[0]).all()
    assert_array_equal(last.labels, found.labels)
    assert_allclose(last.shares_of_motions[0], 1 - last.shares[-1])
    # Two motions less, and what their places cost more or less.
    views, shares = scene.views, found.shares[:-1]
    apart = (found.motions.costs(views) + NATS_OF_MOTION).sum()
    apart -= (shares * found.motions.log_densities(views)).sum()
    together = cost_of_surfaces(views, shares, last.motions) + NATS_OF_MOTION
    assert_allclose(found.cost - last.cost, apart - together)


def test_a_thing_on_the_street_stays_apart():
    X, surfaces = street(n_moving=40, seed=1)
    *_, last = with_fewer_motions(*segmented(X, surfaces))
    assert last.n_motions == 2
    motions = np.append(last.motion_of, -1)[last.labels]
    assert len(set(motions[surfaces == 3])) == 1
    assert not set(motions[surfaces == 3]) & set(motions[surfaces < 3])


def test_things_side_by_side_stay_apart():
    scene, found = segmented(*two_images([40, 30, 30], 20))
    (only,) = with_fewer_motions(scene, found)
    assert only.n_motions == len(found.motions) == 3
