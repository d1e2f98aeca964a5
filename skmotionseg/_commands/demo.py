"""``skmotionseg demo``: a synthetic scene, what is found in it, and the truth."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from .._utils.writing import check_output
from .console import (
    PICTURES,
    console_of_findings,
    facts_table,
    print_files,
    progress_console,
    pyplot,
    save_figure,
    seconds_facts,
    seed,
    track_facts,
)


def add_demo(commands):
    demo = commands.add_parser(
        "demo",
        help="segment a built-in scene of three motions",
        description="Segment a synthetic scene of three motions, their number unknown, "
        "and draw what was found beside the truth.",
    )
    demo.add_argument(
        "--out",
        type=Path,
        default=Path("demo.png"),
        help="picture to write (default: demo.png)",
    )
    demo.add_argument(
        "--seed",
        type=seed,
        default=0,
        help="random seed of scene and method (default: 0)",
    )
    demo.set_defaults(run=_demo)


def _demo(arguments):
    console = console_of_findings()
    plt = pyplot()
    check_output(arguments.out, PICTURES)
    from ..datasets import make_rigid_motions
    from ..metrics import misclassification_error
    from ..segmentation import MotionSegmenter

    X, y = make_rigid_motions(random_state=arguments.seed)
    with progress_console().status("segmenting ..."):
        segmenter = MotionSegmenter(random_state=arguments.seed).fit(X)
    error = misclassification_error(y, segmenter.labels_)
    console.print(
        facts_table(
            "skmotionseg demo",
            [
                *track_facts(X),
                ("motions found", str(segmenter.n_motions_)),
                ("motions true", str(len(np.unique(y[y >= 0])))),
                ("misclassification", f"{error:.2%}"),
                *seconds_facts(segmenter.stage_seconds_),
            ],
        )
    )
    _draw_comparison(plt, X, y, segmenter.labels_, arguments.out)
    print_files(console, {"picture": arguments.out})


def _draw_comparison(plt, X, true, found, path):
    from ..plotting import plot_motions

    figure, axes = plt.subplots(
        1, 2, figsize=(11, 4), sharex=True, sharey=True, layout="constrained"
    )
    plot_motions(X, true, ax=axes[0], title="true motions")
    plot_motions(X, found, ax=axes[1], title="found motions")
    axes[1].set_ylabel("")
    save_figure(figure, path)
