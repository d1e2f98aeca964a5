"""What a segmentation of two images costs, term by term, and the way down."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.two_images import two_images
from numpy.testing import assert_allclose, assert_array_equal

from skmotionseg._core.geometry.two_views import fit_two_view_motions, two_views
from skmotionseg._core.partition.two_view_energy import (
    FEWEST_TRACKS,
    NATS_OF_MOTION,
    NATS_OF_NEIGHBOURS,
    assign,
    best_log_densities,
    judged,
    settle,
    two_view_scene,
)
from skmotionseg.metrics import misclassification_error


def scene_of(X):
    x, y = ((X.reshape(-1, 2, 2) - 300) / 100).swapaxes(0, 1)
    return two_view_scene(two_views(x, y), 60)


def shares_of(y):
    """Rows of the motions and of mismatches, 1 where the label is."""
    last = y.max() + 1
    return np.eye(last + 1)[np.where(y < 0, last, y)].T


@pytest.fixture(scope="module")
def three_things():
    X, y = two_images([40, 30, 20], 60)
    scene = scene_of(X)
    return scene, y, settle(scene, None, shares_of(y))


def test_the_cost_is_the_sum_of_its_terms(three_things):
    scene, y, found = three_things
    motions, labels = found.motions, found.labels
    shares, densities = assign(scene, motions, found.shares)
    again = judged(scene, motions, shares, densities)
    n, links = len(y), scene.links.toarray()
    labels = again.labels
    counts = [np.sum(labels == m) for m in range(4)]
    total = NATS_OF_MOTION * 3 + motions.costs(scene.views).sum()
    for i in range(n):
        total -= densities[labels[i], i]
        total -= np.log((counts[labels[i]] + 1) / (n + 4))
        for j in range(i):
            if labels[i] != labels[j]:
                total += NATS_OF_NEIGHBOURS * links[i, j]
    assert_allclose(again.cost, total)


def test_links_are_symmetric_and_of_neighbours(three_things):
    scene, _, _ = three_things
    links = scene.links.toarray()
    assert_array_equal(links, links.T)
    assert links.min() == 0 and not links.diagonal().any()
    joint = np.hstack([scene.views.x[:, :2], scene.views.y[:, :2]])
    gaps = np.linalg.norm(joint[:, None] - joint, axis=2)
    assert_array_equal(scene.nearest[:, 0], (gaps + 1e9 * np.eye(len(gaps))).argmin(0))


def test_what_settles_costs_no_more_than_before(three_things):
    scene, y, _ = three_things
    rng = np.random.default_rng(0)
    disturbed = np.where(rng.uniform(size=len(y)) < 0.3, -1, y)  # some are forgotten
    motions = fit_two_view_motions(scene.views, shares_of(disturbed)[:-1])
    before = judged(scene, motions, *assign(scene, motions))
    after = settle(scene, motions)
    assert after.cost <= before.cost
    found = np.where(after.labels == 3, -1, after.labels)
    assert misclassification_error(y, found) < 0.05


def test_motions_without_tracks_are_lost(three_things):
    scene, y, found = three_things
    far = fit_two_view_motions(scene.views, shares_of(y)[:-1])
    far.affine[2] += 100
    assert len(settle(scene, far).motions) == 2
    members = np.bincount(found.labels)[:-1]
    assert (members >= FEWEST_TRACKS).all()
    assert np.ptp(best_log_densities(scene, ())) == 0
