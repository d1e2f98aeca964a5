"""Draw what a segmentation looks like, and why it came out so, into a folder.

Each picture is a line of :mod:`skmotionseg.plotting`: the motions, the affinities of
each model beside what partitions make of them, the cost of each number of motions, the
errors of several methods sequence by sequence, and what the weights of the fusions do
to the fused result and to each model's own embedding.

Run it on synthetic scenes, or on the clips of KT3DMoSeg under ``DIR/KT3DMoSeg``::

    python examples/figures.py --out figures
    python examples/figures.py --out figures --data DIR     # some minutes

The two pictures of the page on the method::

    python examples/figures.py --out docs/images --data DIR --sequence Seq005_Clip01 \
        --only method-motions method-costs
"""

from __future__ import annotations

import argparse
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from skmotionseg import (
    MotionSegmenter,
    MultiModelSpectralClustering,
    make_motion_pipeline,
)
from skmotionseg.datasets import load_kt3dmoseg, make_rigid_motions
from skmotionseg.metrics import misclassification_error
from skmotionseg.plotting import (
    AffinityDisplay,
    CountDisplay,
    FusionWeightDisplay,
    MotionDisplay,
    SequenceErrorDisplay,
)

MODELS = ("affine", "homography", "fundamental")


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--data", type=Path, metavar="DIR", help="holds KT3DMoSeg/")
    parser.add_argument("--out", type=Path, default=Path("figures"), metavar="DIR")
    parser.add_argument("--clips", type=int, help="use so many sequences only")
    parser.add_argument("--sequence", metavar="NAME", help="draw this one first")
    parser.add_argument("--only", nargs="+", metavar="PICTURE", help="such as motions")
    parser.add_argument("--quick", action="store_true", help="fewer of everything")
    arguments = parser.parse_args(argv)
    arguments.out.mkdir(parents=True, exist_ok=True)
    names, tracks, labels = read_sequences(arguments)
    n_hypotheses = 100 if arguments.quick else 500
    waiting = set(arguments.only or ())
    for name, display in draw_all(names, tracks, labels, n_hypotheses):
        if arguments.only is None or name in waiting:
            path = arguments.out / f"{name}.png"
            display.figure_.savefig(path, dpi=120)
            print(f"wrote {path}", flush=True)
        plt.close(display.figure_)
        waiting.discard(name)
        if arguments.only is not None and not waiting:
            return
    if waiting:
        raise SystemExit(f"there is no picture {', '.join(sorted(waiting))}")


def read_sequences(arguments):
    """Lists of names, tracks and true labels."""
    n_clips = 2 if arguments.quick else arguments.clips
    size = (60, 3) if arguments.quick else (160, 8)
    if arguments.data is not None:
        clips = load_kt3dmoseg(arguments.data / "KT3DMoSeg")
        clips.sort(key=lambda clip: clip.name != arguments.sequence)
        sequences = [(clip.name, clip.data, clip.target) for clip in clips[:n_clips]]
    else:
        sequences = [
            (
                f"scene {seed}",
                *make_rigid_motions(
                    *size, 2 + seed % 3, missing=0.3, noise=1.0, random_state=seed
                ),
            )
            for seed in range(n_clips or 6)
        ]
    return map(list, zip(*sequences, strict=True))


def draw_all(*arguments):
    """Yield names and pictures."""
    for draw in (
        draw_method,
        draw_one_sequence,
        draw_fusion_weights,
        draw_sequence_errors,
    ):
        yield from draw(*arguments)


def draw_method(names, tracks, labels, n_hypotheses):
    """Yield the motions of the first sequence, and what each number of them costs."""
    segmenter = MotionSegmenter(n_hypotheses=n_hypotheses, random_state=0)
    segmenter.fit(tracks[0])
    error = misclassification_error(labels[0], segmenter.labels_)
    title = f"{names[0]}: {segmenter.n_motions_} motions, {error:.1%} misclassified"
    yield (
        "method-motions",
        MotionDisplay.from_estimator(segmenter, tracks[0], title=title),
    )
    display = CountDisplay.from_estimator(segmenter)
    plt.close(display.figure_)
    # Lengths lie far from 0, and would make the cut look like nothing.
    display.costs = segmenter.costs_ - segmenter.costs_[0]
    display.plot().ax_.set_ylabel("cost, less that of one motion")
    yield "method-costs", display


def draw_one_sequence(names, tracks, labels, n_hypotheses):
    """Yield the motions, the affinities and the costs of the first sequence."""
    X, y = tracks[0], labels[0]
    common = {"n_hypotheses": n_hypotheses, "max_motions": 7, "random_state": 0}
    segmenter = MotionSegmenter(**common).fit(X)
    title = f"{names[0]}, {segmenter.n_motions_} motions found"
    yield "motions", MotionDisplay.from_estimator(segmenter, X, title=title)
    yield "costs-description-length", CountDisplay.from_estimator(segmenter)

    ncre = MotionSegmenter(selection="ncre", **common).fit(X)
    yield (
        "affinities",
        AffinityDisplay.from_estimator(ncre, X, counts=[2, 3, 4], labels=y),
    )
    yield "costs-ncre", CountDisplay.from_estimator(ncre)
    # As in the paper: one view, and all numbers of motions.
    one = ncre.set_params(models="homography").fit(X)
    counts = range(1, 8)
    yield (
        "affinities-homography",
        AffinityDisplay.from_estimator(one, X, counts=counts, labels=y),
    )


def draw_fusion_weights(names, tracks, labels, n_hypotheses):
    """Yield errors over lambda and gamma, all on the same affinities."""
    stacked = [
        make_motion_pipeline(MODELS, n_hypotheses=n_hypotheses, random_state=0)
        .named_steps["affinity"]
        .fit_transform(X)
        for X in tracks
    ]
    for fusion in ("coreg", "subset"):
        display = FusionWeightDisplay.from_estimator(
            MultiModelSpectralClustering(fusion=fusion, random_state=0),
            stacked,
            labels,
            values=np.logspace(-4, 1, 6),
            view_names=MODELS,
        )
        yield f"weights-{fusion}", display


def draw_sequence_errors(names, tracks, labels, n_hypotheses):
    """Yield the errors of three methods on every sequence, the count unknown."""
    common = {"n_hypotheses": n_hypotheses, "random_state": 0}
    methods = {
        "homography, NCRE": {"selection": "ncre", "models": "homography"},
        "co-regularisation, NCRE": {"selection": "ncre", "fusion": "coreg"},
        "as it comes": {},
    }
    display = SequenceErrorDisplay.from_estimator(
        {name: MotionSegmenter(**common, **own) for name, own in methods.items()},
        tracks,
        labels,
        seeds=[0, 1],
        sequence_names=names,
    )
    yield "errors", display


if __name__ == "__main__":
    main()
