"""Functions of a motion model of one's own are tried before they are used."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from skmotionseg import (
    HypothesisSampler,
    MotionModel,
    MotionSegmenter,
    make_motion_pipeline,
)
from skmotionseg._core.geometry.model_checks import check_functions
from skmotionseg._core.geometry.motion_models import MOTION_MODELS
from skmotionseg.datasets import make_rigid_motions

AFFINE = MotionModel.built_in("affine")


@pytest.mark.parametrize("name", MOTION_MODELS)
def test_the_built_in_models_pass(name):
    check_functions(MOTION_MODELS[name])


def minus(function):
    return lambda *given: -function(*given)


def unknown(M, x, y):
    return np.full((*x.shape[:-1], len(M)), np.nan)


def for_one_pair(M, S, T):
    """Not for several, nor for maps that are not of pairs."""
    return AFFINE.change_coordinates(M, S[0], T[0])


@pytest.mark.parametrize(
    "part, function, error, words",
    [
        ("fit", lambda x, y: None, TypeError, r"\(4, 3, 3\) for .*; got NoneType"),
        (
            "fit",
            lambda x, y: np.eye(3),
            ValueError,
            r"fit of the .* got shape \(3, 3\)",
        ),
        ("from_translation", lambda t: [np.eye(3)] * 4, TypeError, "got list"),
        ("change_coordinates", lambda M, S, T: M + 0j, TypeError, "got complex128"),
        ("change_coordinates", lambda M, S, T: M[0], ValueError, r"shape \(4, 3, 3\)$"),
        ("change_coordinates", for_one_pair, np.linalg.LinAlgError, "dimensional"),
        ("residuals", lambda M, x, y: x, ValueError, r"\(2, 5, 4\) .* \(2, 5, 2\)$"),
        ("residuals", minus(AFFINE.residuals), ValueError, "squared errors .* got -"),
        ("residuals", unknown, ValueError, "squared errors .* got nan"),
    ],
)
def test_a_function_that_gives_something_else_is_refused(part, function, error, words):
    """Before any work, by all that take a model, and in words."""
    model = dataclasses.replace(AFFINE, name="mine", **{part: function})
    X, _ = make_rigid_motions(n_tracks=20, n_frames=4, random_state=0)
    with pytest.raises(error, match=words):
        HypothesisSampler(model).fit(X)
    with pytest.raises(error, match=words):
        MotionSegmenter(models=(model, "homography")).fit(X)
    with pytest.raises(error, match=words):
        make_motion_pipeline((model, "homography"))


def test_what_determines_no_model_is_none_to_refuse():
    """Nor are residuals, of models that are not finite, asked for."""

    def residuals(M, x, y):
        np.linalg.svd(M)  # an error where these are NaN
        return AFFINE.residuals(M, x, y)

    nothing = dataclasses.replace(
        AFFINE,
        name="mine",
        fit=lambda x, y: np.full((*x.shape[:-2], 3, 3), np.nan),
        residuals=residuals,
    )
    check_functions(nothing)


def test_residuals_may_be_whole_numbers_that_cannot_be_written_to():
    def residuals(M, x, y):
        found = np.round(AFFINE.residuals(M, x, y)).astype(int)
        found.setflags(write=False)
        return found

    X, _ = make_rigid_motions(n_tracks=20, n_frames=4, random_state=0)
    model = dataclasses.replace(AFFINE, name="mine", residuals=residuals)
    found = HypothesisSampler(model, n_hypotheses=10, random_state=0).fit_transform(X)
    assert np.nanmin(found) == 0
    assert np.nanmax(found) > 0
