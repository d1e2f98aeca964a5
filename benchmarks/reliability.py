"""How often labels of some confidence are right, on benchmarks.

    python -m benchmarks.reliability --data DIR [--datasets KT3DMoSeg ...] [--seeds 1]
        [--json FILE] [--picture FILE]

The number of motions is unknown. A label is right if the best assignment of labels to
true motions says so; tracks that are labelled -1 or that have no true motion are left
out. If ``probabilities_`` were probabilities, of the labels with 0.9 nine in ten would
be right.
"""

from __future__ import annotations

import argparse
from itertools import pairwise
from pathlib import Path

import numpy as np
from joblib import Parallel, delayed
from scipy.optimize import linear_sum_assignment

from skmotionseg import MotionSegmenter
from skmotionseg._commands.runs import find_sequences

from . import report
from .measuring import show_progress

DATASETS = ("KT3DMoSeg", "Hopkins155", "MTPV62", "Hopkins12", "AdelaideRMF")
EDGES = np.array([0, 0.5, 0.7, 0.8, 0.9, 0.95, 0.99, 1])
COLUMNS = {
    "confidence": lambda row: row["row"],
    "labels": lambda row: f"{row['n_labels']:,}",
    "mean confidence %": report.number("confidence"),
    "right %": report.number("right"),
}


def right_labels(target, labels):
    """Which labels the best assignment to true motions confirms.

    Parameters
    ----------
    target, labels : ndarray of int, shape (n,)
        -1 is neither right nor a motion.

    Returns
    -------
    ndarray of bool, shape (n,)
    """
    judged = (target >= 0) & (labels >= 0)
    meets = np.zeros((target.max(initial=0) + 1, labels.max(initial=0) + 1), dtype=int)
    np.add.at(meets, (target[judged], labels[judged]), 1)
    assigned = np.full(meets.shape[1], -1)
    motions, found = linear_sum_assignment(meets, maximize=True)
    assigned[found] = motions
    return judged & (assigned[labels] == target)


def confidences(sequence, seed):
    """Confidence of the labels of a sequence that can be judged, and which are right.

    Returns
    -------
    ndarray of shape (n_judged,), ndarray of bool, shape (n_judged,)
    """
    segmenter = MotionSegmenter(random_state=seed).fit(sequence.data)
    judged = (sequence.target >= 0) & (segmenter.labels_ >= 0)
    right = right_labels(sequence.target, segmenter.labels_)
    return segmenter.probabilities_[judged], right[judged]


def rows_of(confidence, right):
    """A row per range of confidence.

    Parameters
    ----------
    confidence : ndarray of shape (n,)
    right : ndarray of bool, shape (n,)

    Returns
    -------
    list of dict
        Without ranges in which there is no label.
    """
    ranges = np.clip(np.searchsorted(EDGES, confidence, "right") - 1, 0, len(EDGES) - 2)
    rows = []
    for k, (low, high) in enumerate(pairwise(EDGES)):
        some = ranges == k
        if some.any():
            rows.append(
                {
                    "row": f"{low:g} to {high:g}",
                    "n_labels": int(some.sum()),
                    "confidence": 100 * float(confidence[some].mean()),
                    "right": 100 * float(right[some].mean()),
                }
            )
    return rows


def measure(sequences, seeds, n_jobs):
    """Rows of all sequences and seeds together."""
    jobs = [(sequence, seed) for seed in range(seeds) for _, sequence in sequences]
    parallel = Parallel(n_jobs=n_jobs, return_as="generator")
    found = []
    for one in parallel(delayed(confidences)(*job) for job in jobs):
        found.append(one)
        show_progress(f"reliability: {len(found)} of {len(jobs)}")
    show_progress("")
    return rows_of(*map(np.concatenate, zip(*found, strict=True)))


def draw(rows, path):
    """A reliability diagram: how often labels are right against their confidence."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(4.5, 4.5), layout="constrained")
    axes = figure.subplots()
    axes.plot([0, 100], [0, 100], color="0.7", linewidth=1, label="as often as said")
    confidence, right = (
        [row[name] for row in rows] for name in ("confidence", "right")
    )
    axes.plot(confidence, right, "o-", label="benchmarks")
    axes.set(
        xlabel="mean confidence of labels (%)",
        ylabel="labels that are right (%)",
        aspect="equal",
    )
    axes.legend(loc="upper left", frameon=False)
    figure.savefig(path, dpi=120)


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--datasets", nargs="+", default=DATASETS)
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--jobs", type=int)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--picture", type=Path)
    arguments = parser.parse_args()
    sequences = find_sequences(arguments.data, arguments.datasets)
    rows = measure(sequences, arguments.seeds, arguments.jobs)
    report.show(rows, COLUMNS)
    report.save(arguments.json, "reliability", rows)
    if arguments.picture is not None:
        draw(rows, arguments.picture)


if __name__ == "__main__":
    main()
