"""Which tracks decide on a motion, and which may follow it."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from helpers.windows import two_windows
from numpy.testing import assert_array_equal

from skmotionseg._core.stream.assignment import measure
from skmotionseg._core.stream.following import (
    are_doubtful,
    are_outliers,
    can_be_told,
    columns_of,
    fitted_groups,
    groups_of,
    may_join,
    newly_held,
)
from skmotionseg._core.stream.living import LivingMotion


def living(*numbers, **known):
    return [LivingMotion(number, None, 0, **known) for number in numbers]


def buffer_of(labels, doubtful=(), outlying=(), new=()):
    n = len(labels)
    return SimpleNamespace(
        labels=np.array(labels),
        doubtful=np.isin(np.arange(n), doubtful),
        outlying=np.isin(np.arange(n), outlying),
        held=~np.isin(np.arange(n), new),
    )


def test_outliers_are_far_from_their_motion_and_unlike_their_neighbours():
    rng = np.random.default_rng(0)
    steps = np.arange(12)[:, None] * [2.0, 0.0]
    points = rng.uniform(0, 300, (80, 1, 2)) + steps
    points += rng.normal(0, 0.1, points.shape)
    points[0] += np.arange(12)[:, None] * [0.0, 9.0]
    buffer = SimpleNamespace(points=points, seen=np.ones((80, 12), dtype=bool))
    deviations = np.where(np.arange(80) < 10, 9.0, 1.0)
    deviations[[10, 11]] = np.nan, 2.9
    assert np.flatnonzero(are_outliers(buffer, deviations)).tolist() == [0]
    assert not are_outliers(buffer, np.ones(80)).any()


def test_outliers_are_in_no_group():
    buffer = buffer_of([0, 0, 1, 1, -1], outlying=[1])
    groups = groups_of(buffer, living(1, 0))
    assert [rows.tolist() for rows in groups] == [[2, 3], [0]]
    assert_array_equal(columns_of(buffer.labels, living(1, 0)), [1, 1, 0, 0, -1])


def test_a_motion_is_fitted_to_tracks_that_it_has_explained():
    buffer = buffer_of([2] * 4 + [1] * 4, doubtful=[1, 2], new=[0, 1, 6])
    groups = fitted_groups(buffer, living(2, 1))
    assert [rows.tolist() for rows in groups] == [[3], [4, 5, 7]]
    # Nothing takes the place of the static scene.
    buffer.labels[:4] = 0
    assert fitted_groups(buffer, living(0))[0].tolist() == [0, 3]


def newly(number, n_old, n_new, doubtful=(), judged=True):
    """Of new tracks, that come after the old ones, how many are held."""
    new = np.arange(n_old, n_old + n_new)
    buffer = buffer_of([number] * (n_old + n_new) + [-1], doubtful, new=new)
    held = newly_held(buffer, living(0, 1), np.full(n_old + n_new + 1, judged))
    assert not held[-1]
    return int(held[new].sum())


def test_tracks_that_a_motion_explains_are_held():
    assert newly(1, 12, 8) == 8
    assert newly(1, 12, 8, doubtful=[13, 14]) == 6
    assert newly(1, 12, 8, judged=False) == 0


def test_more_tracks_than_a_motion_has_left_do_not_take_its_place():
    assert newly(1, 5, 5) == 5
    assert newly(1, 5, 6) == 0
    assert newly(1, 3, 2) == 0
    assert newly(1, 10, 60) == 60  # so many determine it


def test_what_a_motion_that_is_bent_does_not_explain_says_nothing():
    bent = range(4)
    assert newly(1, 6, 3, doubtful=[*bent, 6, 7]) == 3
    assert newly(1, 8, 3, doubtful=[*bent, 8, 9]) == 1


def test_most_tracks_are_the_static_scene():
    assert newly(0, 3, 30) == 30
    assert newly(0, 0, 30) == 30


def test_doubtful_tracks_do_not_bend_a_motion_unless_they_are_most_of_it():
    labels = [0] * 6 + [1] * 3
    some = fitted_groups(buffer_of(labels, doubtful=[0, 1, 2, 6]), living(0, 1))
    assert [rows.tolist() for rows in some] == [[3, 4, 5], [7, 8]]
    most = fitted_groups(buffer_of(labels, doubtful=[0, 1, 2, 3, 6, 7]), living(0, 1))
    assert [rows.tolist() for rows in most] == [[0, 1, 2, 3, 4, 5], [6, 7, 8]]


@pytest.fixture(scope="module")
def measured():
    """A window, the tracks of each thing in view, and residuals from both motions."""
    (window, _), groups = two_windows()
    residuals = measure(window, window.fit(groups), window.camera.noise)
    return window, [rows[window.freedom[rows] >= 5] for rows in groups], residuals


def test_tracks_of_another_motion_are_doubtful(measured):
    window, (scene, thing), residuals = measured
    deviations = residuals.deviations()
    assert are_doubtful(window, deviations[:, 0])[scene].mean() < 0.05
    assert are_doubtful(window, deviations[:, 0])[thing].mean() > 0.9
    assert are_doubtful(window, deviations[:, 1])[thing].mean() < 0.05
    unknown = np.full(len(deviations), np.nan)
    assert not are_doubtful(window, unknown).any()
    young = SimpleNamespace(freedom=np.full(len(deviations), 3))
    assert not are_doubtful(young, deviations[:, 0]).any()


def test_motions_that_are_closed_take_what_nothing_else_explains(measured):
    _, (scene, thing), residuals = measured
    columns = np.full(len(residuals.nats), -1)
    columns[scene[:5]] = 1
    assert may_join(residuals, columns, living(0, 1)).all()
    assert may_join(residuals, columns, living(-9, -8)).all()
    allowed = may_join(residuals, columns, living(0, -9))  # the second a candidate
    assert allowed[:, 0].all()
    assert allowed[thing, 1].mean() > 0.9
    assert allowed[scene[:5], 1].all()
    assert allowed[scene[5:], 1].mean() < 0.05


def test_what_cannot_be_told(measured):
    window, (scene, thing), residuals = measured
    n = len(residuals.nats)
    columns, shares = np.full(n, -1), np.zeros((n, 2))
    told = can_be_told(window, residuals, columns, columns, shares)
    assert_array_equal(told, window.freedom > 0)
    young = SimpleNamespace(freedom=np.zeros(n))
    assert not can_be_told(young, residuals, columns, columns, shares).any()
    shares[3, 1] = 0.5
    told = can_be_told(young, residuals, columns, columns, shares)
    assert_array_equal(np.flatnonzero(told), [3])
    hidden = np.full(n, 7)  # a number that no living motion has
    only_scene = measured[2].without(1)
    told = can_be_told(window, only_scene, hidden, columns, shares[:, :1])
    assert told[scene].mean() > 0.9
    assert told[thing].mean() < 0.1
