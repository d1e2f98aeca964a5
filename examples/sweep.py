"""Sweep lambda, gamma, delta and the motion models without computing anything twice.

Hypotheses and affinities take most of the time and depend on none of these, so they
are computed once for each model and kept in a cache. Three ways to sweep:

1. one sequence, through the plain pipeline, with its key ``affinity__models``;
2. the same through ``MotionSegmenter(models=..., selection="ncre")``, which gives the
   same numbers;
3. one setting for many sequences, which ``GridSearchCV`` finds with ``PerSequence``,
   beside ``MotionSegmenter`` as it comes, which needs no labels to be set up.

Run it on synthetic scenes, or on the clips of KT3DMoSeg under ``DIR/KT3DMoSeg``::

    python examples/sweep.py
    python examples/sweep.py --data DIR     # some minutes
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np
from sklearn.base import clone
from sklearn.model_selection import GridSearchCV, KFold

from skmotionseg import MotionSegmenter, PerSequence, make_motion_pipeline
from skmotionseg.datasets import load_kt3dmoseg, make_rigid_motions
from skmotionseg.metrics import misclassification_error

ALL_MODELS = ("affine", "homography", "fundamental")
SUBSETS = {"A+H": ALL_MODELS[:2], "H+F": ALL_MODELS[1:], "A+H+F": ALL_MODELS}

# Few frames, noise, and up to half of the entries unseen: hard enough to tell settings
# apart. A tenth of the tracks wander at random.
SCENES = [
    {"n_tracks": 200, "n_frames": 10, "n_motions": 4, "missing": 0.5, "noise": 1.0},
    {"n_tracks": 160, "n_frames": 8, "n_motions": 3, "missing": 0.3, "noise": 1.5},
    {"n_tracks": 120, "n_frames": 12, "n_motions": 2, "missing": 0.4, "noise": 1.0},
    {"n_tracks": 200, "n_frames": 12, "n_motions": 4, "missing": 0.4, "noise": 0.5},
    {"n_tracks": 180, "n_frames": 8, "n_motions": 3, "missing": 0.4, "noise": 1.0},
    {"n_tracks": 100, "n_frames": 10, "n_motions": 2, "missing": 0.5, "noise": 1.5},
    {"n_tracks": 160, "n_frames": 10, "n_motions": 3, "missing": 0.4, "noise": 1.0},
    {"n_tracks": 140, "n_frames": 12, "n_motions": 2, "missing": 0.5, "noise": 1.0},
]
FULL = {
    "lam": [1e-3, 1e-2, 1e-1, 1],
    "gamma": [1e-3, 1e-2, 1e-1, 1],
    "delta": [0.1, 0.3, 1, 3],
}
QUICK = {"lam": [1e-2, 1], "gamma": [1e-2, 1], "delta": [0.3, 3]}


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--data", type=Path, metavar="DIR", help="holds KT3DMoSeg/")
    parser.add_argument("--quick", action="store_true", help="fewer of everything")
    arguments = parser.parse_args(argv)
    sequences = read_sequences(arguments)
    values = QUICK if arguments.quick else FULL
    common = {"n_hypotheses": 200 if arguments.quick else 500}
    with tempfile.TemporaryDirectory() as cache:
        common |= {"memory": cache, "random_state": 0}
        name, X, y = sequences[0]
        print(f"{name}: {len(X)} tracks, {X.shape[1] // 2} frames, {count(y)} motions")
        for heading, segment in (
            ("1. The pipeline", segment_by_pipeline),
            ("2. MotionSegmenter", segment_by_segmenter),
        ):
            started = time.perf_counter()
            print(f"\n{heading}")
            sweep_one_sequence(X, y, segment, values, common)
            print(f"{time.perf_counter() - started:.1f} s")
        print("\n3. One setting for many sequences")
        sweep_many_sequences(sequences, values, common)


def read_sequences(arguments):
    """Triples of name, tracks and labels."""
    if arguments.data is not None:
        clips = load_kt3dmoseg(arguments.data / "KT3DMoSeg")
        sequences = [(clip.name, clip.data, clip.target) for clip in clips]
    else:
        sequences = [
            (f"scene {i}", *make_rigid_motions(**s, outliers=0.1, random_state=i))
            for i, s in enumerate(SCENES)
        ]
    if not arguments.quick:
        return sequences
    small = sorted(sequences, key=lambda sequence: sequence[1].size)[:3]
    # Every other track, in six frames.
    return [(name, X[::2, :12], y[::2]) for name, X, y in small]


def count(labels):
    return len(np.unique(labels[labels >= 0]))


# ------------------------------------------------------------------------ one sequence


def sweep_one_sequence(X, y, segment, values, common):
    """Three tables: parameter by model subset."""

    def error(labels):
        return f"{misclassification_error(y, labels):.1%}"

    def with_lam(lam, subset):
        return error(segment(X, SUBSETS[subset], count(y), common, "coreg", lam=lam))

    def with_gamma(gamma, subset):
        labels = segment(X, SUBSETS[subset], count(y), common, "subset", gamma=gamma)
        return error(labels)

    def with_delta(delta, subset):
        params = common, "kernel_addition"
        labels = segment(X, SUBSETS[subset], "auto", *params, delta=delta)
        return f"{count(labels)}: {error(labels)}"

    print_table("lambda, co-regularisation: error", values["lam"], with_lam)
    print_table("gamma, subset constraint: error", values["gamma"], with_gamma)
    print_table("delta, motions found: error", values["delta"], with_delta)


def segment_by_pipeline(X, models, n_motions, common, fusion, **weight):
    """Labels from the pipeline of all models, of which some take part.

    ``memory`` is in the views, so a view that was fitted once is read back, whatever
    takes part beside it and is set in the last step.
    """
    pipeline = make_motion_pipeline(n_clusters=n_motions, fusion=fusion, **common)
    weight = {f"cluster__{name}": value for name, value in weight.items()}
    pipeline = clone(pipeline).set_params(affinity__models=models, **weight)
    return pipeline.fit_predict(X)


def segment_by_segmenter(X, models, n_motions, common, fusion, **weight):
    """Labels from the one estimator; its ``memory`` works by model, too."""
    segmenter = MotionSegmenter(n_motions, selection="ncre", fusion=fusion, **common)
    return segmenter.set_params(models=models, **weight).fit_predict(X)


def print_table(title, values, cell):
    """Print a table of values by model subsets, each cell as soon as it is known."""
    print(f"\n{title}\n{'':8}" + "".join(f"{subset:>12}" for subset in SUBSETS))
    for value in values:
        print(f"{value:>8g}", end="", flush=True)
        for subset in SUBSETS:
            print(f"{cell(value, subset):>12}", end="", flush=True)
        print()


# ---------------------------------------------------------------------- many sequences


def sweep_many_sequences(sequences, values, common):
    """Choose models, lambda and delta on most sequences; judge them on the others.

    The number of motions is unknown. ``PerSequence`` learns nothing from one sequence
    for another, so each setting's score is its mean over all folds; what the best of
    them is worth is seen on sequences that had no part in choosing it.
    """
    _, X, y = map(list, zip(*sequences, strict=True))
    n_train = -(-2 * len(X) // 3)
    segmenter = MotionSegmenter(
        selection="ncre", fusion="coreg", max_motions=6, **common
    )
    grid = {
        "estimator__models": list(SUBSETS.values()),
        "estimator__delta": values["delta"],
        "estimator__lam": values["lam"][1:3],
    }
    search = GridSearchCV(
        PerSequence(segmenter), grid, cv=KFold(min(3, n_train)), scoring=score_aloud
    )
    print(f"{n_train} sequences to choose on, {len(X) - n_train} to judge on: ", end="")
    search.fit(X[:n_train], y[:n_train])
    print()
    scores = {
        (p["estimator__delta"], p["estimator__lam"], p["estimator__models"]): score
        for p, score in zip(
            search.cv_results_["params"],
            search.cv_results_["mean_test_score"],
            strict=True,
        )
    }
    for lam in grid["estimator__lam"]:

        def error(delta, subset, lam=lam):
            return f"{1 - scores[delta, lam, SUBSETS[subset]]:.1%}"

        title = f"delta, number of motions unknown, lambda {lam:g}: error"
        print_table(title, values["delta"], error)
    best = search.best_params_
    subset = next(s for s, m in SUBSETS.items() if m == best["estimator__models"])
    print(
        f"\nbest: {subset}, delta {best['estimator__delta']:g}, lambda "
        f"{best['estimator__lam']:g}: error {1 - search.best_score_:.1%}"
    )
    others = X[n_train:], y[n_train:]
    as_it_comes = PerSequence(MotionSegmenter(random_state=0)).fit(*others)
    print(f"on the others: error {1 - search.best_estimator_.score(*others):.1%}")
    print(f"on the others, as it comes: error {1 - as_it_comes.score(*others):.1%}")


def score_aloud(estimator, X, y):
    """The score of an estimator, and a dot to show that it goes on."""
    score = estimator.score(X, y)
    print(".", end="", flush=True)
    return score


if __name__ == "__main__":
    main()
