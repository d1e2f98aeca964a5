"""Print what the default gives, with another built-in model in the table or without.

    python fourth_model.py {as it is,more}

The model is put there before anything that reads the table is imported.
"""

from __future__ import annotations

import importlib
import sys
from dataclasses import replace
from importlib.util import find_spec
from types import MappingProxyType, ModuleType


def add_a_model():
    """Put a copy of the affine map first into the table of built-in models."""
    package = ModuleType("skmotionseg")
    package.__path__ = list(find_spec("skmotionseg").submodule_search_locations)
    sys.modules["skmotionseg"] = package
    models = importlib.import_module("skmotionseg._core.geometry.motion_models")
    other = replace(models.MOTION_MODELS["affine"], name="other")
    models.MOTION_MODELS = MappingProxyType({"other": other, **models.MOTION_MODELS})
    del sys.modules["skmotionseg"]


def main(how):
    if how == "more":
        add_a_model()

    from skmotionseg import MotionSegmenter, make_motion_pipeline
    from skmotionseg.datasets import make_rigid_motions

    X, _ = make_rigid_motions(60, 5, 2, random_state=0)
    settings = {"n_hypotheses": 30, "random_state": 0}
    segmenter = MotionSegmenter(selection="ncre", max_motions=3, **settings).fit(X)
    print({name: view[0].random_state for name, view in segmenter.views_.items()})
    print(segmenter.labels_.tolist(), segmenter.costs_.tolist())
    print(make_motion_pipeline(n_clusters=2, **settings).fit_predict(X).tolist())
    with_other = MotionSegmenter(2, models=("other", "affine"), **settings)
    try:
        print(*with_other.fit(X).views_, file=sys.stderr)
    except ValueError:
        print("unknown", file=sys.stderr)


if __name__ == "__main__":
    main(sys.argv[1])
