"""What is kept in memory is found again by the code that it was computed with."""

from __future__ import annotations

import functools
import importlib
import pickle
import sys
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from sklearn.base import clone

from skmotionseg import (
    HypothesisSampler,
    MotionModel,
    MotionSegmenter,
    ORKKernel,
    PerSequence,
    make_motion_pipeline,
)
from skmotionseg._utils import caching
from skmotionseg._utils.own_code import code_of
from skmotionseg.datasets import make_rigid_motions

CODE = '''
import functools

import numpy as np
from skmotionseg import EigengapModelSelector, MotionModel

SHIFT = 0.0
AFFINE = MotionModel.built_in("affine")


def half(x, y):
    return (y - x)[..., 0, :] + SHIFT


def fit(x, y, size=1.0):
    """By one track."""
    return AFFINE.from_translation(size * half(x, y))


def fusion(views, n_clusters, power=2):
    mean = views.mean(axis=0) ** power
    return np.stack([np.linalg.eigh(mean)[1][:, -n_clusters:]] * len(views))


@functools.cache
def double(number):
    return 2 * number


class Selector(EigengapModelSelector):
    def fit(self, X, y=None):
        return super().fit(X, y)
'''
EDITS = {
    "fit": ("size * half(x, y)", "0.5 * size * half(x, y)"),
    "a default": ("size=1.0", "size=0.5"),
    "a helper": ("[..., 0, :] + SHIFT", "[..., 0, :] * 0.5"),
    "a constant": ("SHIFT = 0.0", "SHIFT = 40.0"),
}


@pytest.fixture
def written(tmp_path, monkeypatch):
    """Writes a module of one's own, and imports it anew."""
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(sys, "dont_write_bytecode", True)

    def write(old="", new=""):
        (tmp_path / "own_functions.py").write_text(CODE.replace(old, new))
        sys.modules.pop("own_functions", None)
        importlib.invalidate_caches()
        return importlib.import_module("own_functions")

    yield write
    sys.modules.pop("own_functions", None)


def model_of(own):
    affine = MotionModel.built_in("affine")
    return replace(affine, name="mine", minimal_size=1, fit=own.fit)


@pytest.mark.parametrize("edit", EDITS)
def test_the_code_of_a_function_is_what_it_does_and_uses(written, edit):
    first = code_of(model_of(written()))
    assert first
    assert code_of(model_of(written())) == first
    assert code_of(model_of(written("import numpy", "\n\nimport numpy"))) == first
    assert code_of(model_of(written(*EDITS[edit]))) != first
    assert code_of(model_of(written("power=2", "power=3"))) == first


def test_the_code_of_a_class_is_that_of_its_methods(written):
    first = code_of(written().Selector())
    assert first
    assert code_of(written("super().fit(X, y)", "super().fit(X)").Selector()) != first
    cached = code_of(written("2 * number", "3 * number").double)
    assert cached != code_of(written().double)
    partial = functools.partial(written().fusion, power=2)
    edited = functools.partial(written("power=2", "power=3").fusion, power=2)
    assert code_of(partial) != code_of(edited)


@pytest.mark.parametrize("value", [None, 3, "affine", MotionSegmenter(), np.median])
def test_there_is_no_code_of_ones_own_in_what_is_of_libraries(value):
    assert code_of(value) == ""
    assert code_of(value, lambda: 0) == ""  # cannot be pickled


def segmenter(own, folder):
    models = model_of(own), "homography"
    return MotionSegmenter(
        2, models=models, selection="ncre", random_state=0, memory=folder
    )


def pipeline(own, folder):
    models = model_of(own), "homography"
    return make_motion_pipeline(models, 2, random_state=0, memory=folder)


def sequences(own, folder):
    each = MotionSegmenter(2, fusion=own.fusion, selection="ncre", random_state=0)
    return PerSequence(each, memory=folder)


def kept_part(estimator, X):
    """What is kept of an estimator fitted to tracks, or what follows from it."""
    if isinstance(estimator, MotionSegmenter):
        sampler, _ = estimator.fit(X).views_["mine"]
        return sampler.hypotheses_
    return estimator.fit(X)[:-1].transform(X)


@pytest.mark.parametrize("make", [segmenter, pipeline])
@pytest.mark.parametrize("edit", ["fit", "a helper"])
def test_an_edited_model_is_not_found_in_memory(written, tmp_path, make, edit):
    X, _ = make_rigid_motions(n_tracks=60, n_frames=4, random_state=0)
    first = kept_part(make(written(), tmp_path / "kept"), X)
    own = written(*EDITS[edit])
    edited = kept_part(make(own, tmp_path / "kept"), X)
    assert_array_equal(edited, kept_part(make(own, None), X))
    assert not np.array_equal(edited, first)


def test_an_edited_fusion_is_not_found_in_memory(written, tmp_path):
    X, _ = make_rigid_motions(n_tracks=60, n_frames=4, random_state=0)
    (first,) = sequences(written(), tmp_path / "kept").fit([X]).predict([X])
    own = written("mean = views.mean(axis=0) ** power", "mean = np.diag(views[0, 0])")
    (edited,) = sequences(own, tmp_path / "kept").fit([X]).predict([X])
    (expected,) = sequences(own, None).fit([X]).predict([X])
    assert_array_equal(edited, expected)
    assert not np.array_equal(edited, first)


@pytest.mark.parametrize("estimator", [HypothesisSampler(), ORKKernel()])
def test_pickles_say_the_version_and_are_read_without_it(estimator, monkeypatch):
    before = pickle.dumps(estimator)
    again = pickle.loads(before)
    assert again.__dict__ == estimator.__dict__
    assert pickle.dumps(again) == before
    assert clone(again).get_params() == estimator.get_params()
    monkeypatch.setattr(caching, "__version__", "another")
    assert pickle.dumps(estimator) != before
