"""Rigid motions over the last frames of a stream."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.windows import two_windows

from skmotionseg._core.stream.assignment import measure


@pytest.fixture(scope="module")
def windows():
    return two_windows()


def medians(window, fits, groups):
    scale = window.camera.noise
    return [
        np.nanmedian(measure(window, [fit], scale, rows).deviations())
        for fit, rows in zip(fits, groups, strict=True)
    ]


def test_motions_explain_their_tracks_and_go_on(windows):
    (first, second), groups = windows
    fits = first.fit(groups)
    assert max(medians(first, fits, groups)) < 0.6
    later = second.advance(groups, fits)
    assert not later[0].valid[-1]
    refined = second.fit(groups, later)
    assert refined[0].valid[-1]
    assert max(medians(second, refined, groups)) < 0.6


def test_group_of_few_tracks_has_no_motion(windows):
    (first, _), groups = windows
    assert first.fit([groups[0][:3]]) == [None]


def test_residuals_of_few_tracks_are_corrected_the_most(windows):
    (first, _), groups = windows
    (fit,) = first.fit(groups[:1])
    few, some = (first.inflation(groups[0][:n], fit) for n in (5, 20))
    assert few > 3 > some > 1
    assert first.inflation(groups[0][:1], fit) < np.inf
