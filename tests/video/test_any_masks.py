"""Any tracks and labels before any picture: objects and masks that keep the contract.

The videos are made by mask_strategies.py: noise, black frames, tracks outside of the
frames or at rest, labels of every kind.
"""

from __future__ import annotations

import numpy as np
import pytest
from helpers.generated_cases import run_cases
from helpers.mask_strategies import films

from skmotionseg.video import dense_masks, find_objects, prompt_points

pytest.importorskip("cv2", reason="needs opencv-python-headless")

CASES_A_TEST = 250
CASES = {"short": 20, "long": 2000}
PIECES = range(CASES["long"] // CASES_A_TEST)


def assert_are_objects(objects, n_tracks):
    """0 for the scene, 1, 2, ... without gaps, -1 for none."""
    assert objects.shape == (n_tracks,) and objects.dtype.kind == "i"
    numbers = np.unique(objects[objects > 0])
    assert (numbers == 1 + np.arange(len(numbers))).all()
    assert objects.min() >= -1


def assert_are_masks(recipe, X, labels):
    masks = list(dense_masks(recipe.frames(), X, labels))
    assert len(masks) == recipe.n_frames
    for mask in masks:
        assert mask.shape == (recipe.height, recipe.width)
        assert mask.dtype == np.uint8
        assert set(np.unique(mask)) <= set(labels[labels >= 0])


def check_film(recipe):
    X, labels = recipe.tracks(), recipe.labels()
    size = {"width": recipe.width, "height": recipe.height}
    objects = find_objects(X, labels, **size)
    assert_are_objects(objects, len(X))
    for prompt in prompt_points(X, objects):
        assert np.isfinite(prompt["positive"]).all()
    for given in (objects, labels):
        if (given < 0).all():
            with pytest.raises(ValueError, match="one labelled track or more"):
                dense_masks(recipe.frames(), X, given)
        else:
            assert_are_masks(recipe, X, given)
    return "objects" if objects.max() > 0 else "no object"


@pytest.mark.filterwarnings("ignore:what is taken for the static scene")
@pytest.mark.parametrize(
    "piece", [None, *(pytest.param(p, marks=pytest.mark.long) for p in PIECES)]
)
def test_any_tracks_give_masks(piece, record_property):
    n_cases = CASES["short"] if piece is None else CASES_A_TEST
    found = run_cases(films(), check_film, n_cases, piece)
    record_property("outcomes", ["find_objects and dense_masks", found])
