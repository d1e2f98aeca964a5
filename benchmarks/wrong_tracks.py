"""Real sequences among whose tracks many have gone wrong, number of motions unknown.

    python -m benchmarks.wrong_tracks --data DIR [--shares 0 0.3] [--every 6]
        [--seeds 0 1 2] [--jobs N] [--json FILE]

To the tracks of KT3DMoSeg and of every sixth sequence of Hopkins155, walks are added,
which begin anywhere and are seen in all frames: each has a drift and steps of its own,
of about the size by which the tracks of the sequence move from frame to frame. They
have no true motion. Errors are those of the other tracks, in percent.
"""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path

import numpy as np
from joblib import Parallel, delayed

from skmotionseg import MotionSegmenter, pack_tracks, unpack_tracks
from skmotionseg.datasets import load_hopkins155, load_kt3dmoseg
from skmotionseg.metrics import misclassification_error

from . import report
from .measuring import show_progress

LOADERS = {"KT3DMoSeg": load_kt3dmoseg, "Hopkins155": load_hopkins155}
# Steps of walks, over the usual one of the tracks; their drifts, over their own steps;
# and the least usual step, pixels.
STEPS, MOST_DRIFT, LEAST_STEP = (0.3, 1.5), 1.5, 0.5
COLUMNS = {
    "": lambda row: row["row"],
    "sequences": lambda row: str(row["n_sequences"]),
    "error %": report.number("error", "{:.2f}"),
    "number right %": report.number("right", "{:.0f}"),
    "wrong tracks found %": report.number("found", "{:.0f}"),
    "others rejected %": report.number("lost", "{:.2f}"),
}


def with_walks(X, y, share, seed):
    """Tracks, and so many walks that they are that share of all.

    Parameters
    ----------
    X : ndarray of shape (n_tracks, 2 * n_frames)
    y : ndarray of int, shape (n_tracks,)
    share : float
    seed : int

    Returns
    -------
    X : ndarray of shape (n_tracks + n_walks, 2 * n_frames)
    y : ndarray of int, shape (n_tracks + n_walks,)
        Walks have -1.
    """
    points, seen = unpack_tracks(X)
    rng = np.random.RandomState(seed)
    n, n_frames = seen.shape
    n_walks = round(share * n / (1 - share))
    moves = np.diff(points, axis=1)[seen[:, 1:] & seen[:, :-1]]
    usual = max(LEAST_STEP, float(np.median(np.linalg.norm(moves, axis=1))))
    shape = n_walks, 1, 1
    size = usual * rng.uniform(*STEPS, shape)
    drift = rng.uniform(0, MOST_DRIFT, shape) * rng.standard_normal((n_walks, 1, 2))
    steps = size * (rng.standard_normal((n_walks, n_frames, 2)) + drift)
    low, high = points[seen].min(axis=0), points[seen].max(axis=0)
    walks = rng.uniform(low, high, (n_walks, 1, 2)) + steps.cumsum(axis=1)
    everywhere = np.ones((n_walks, n_frames), dtype=bool)
    return (
        pack_tracks(
            np.concatenate([points, walks]), np.concatenate([seen, everywhere])
        ),
        np.concatenate([y, np.full(n_walks, -1)]),
    )


def judged(clip, share, seed):
    """Error, whether the number is right, and shares of walks and others rejected."""
    X, y = with_walks(clip.data, clip.target, share, seed)
    segmenter = MotionSegmenter(random_state=seed).fit(X)
    rejected, walks = segmenter.labels_ < 0, np.arange(len(y)) >= len(clip.target)
    return (
        misclassification_error(y[~walks], segmenter.labels_[~walks]),
        segmenter.n_motions_ == len(np.unique(clip.target[clip.target >= 0])),
        rejected[walks].mean() if walks.any() else np.nan,
        rejected[~walks].mean(),
    )


def measure(name, clips, share, seeds, n_jobs=None):
    """A row of a data set, means over clips and seeds, in percent.

    Parameters
    ----------
    name : str
    clips : sequence of Bunch
    share : float
        Of walks among all tracks.
    seeds : sequence of int
    n_jobs : int, optional

    Returns
    -------
    dict
    """
    one = partial(delayed(judged), share=share)
    found = Parallel(n_jobs)(one(clip, seed=seed) for seed in seeds for clip in clips)
    means = 100 * np.array(found, dtype=float).mean(axis=0)
    row = {"row": f"{name}, {share:.0%} wrong tracks", "n_sequences": len(clips)}
    names = "error", "right", "found", "lost"
    return row | {
        key: None if np.isnan(value) else float(value)
        for key, value in zip(names, means, strict=True)
    }


def main(arguments=None):
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.wrong_tracks",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--data", type=Path, required=True, metavar="DIR")
    parser.add_argument("--shares", type=float, nargs="+", default=[0.0, 0.3])
    parser.add_argument("--every", type=int, default=6, help="of Hopkins155")
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2])
    parser.add_argument("--jobs", type=int)
    parser.add_argument("--json", type=Path, metavar="FILE")
    arguments = parser.parse_args(arguments)
    rows = []
    for name, load in LOADERS.items():
        clips = load(arguments.data / name)
        if name == "Hopkins155":
            clips = clips[:: arguments.every]
        for share in arguments.shares:
            show_progress(f"wrong tracks: {name}, {share:.0%}")
            rows.append(measure(name, clips, share, arguments.seeds, arguments.jobs))
            report.save(arguments.json, "wrong_tracks", rows[-1:])
    show_progress("")
    report.show(rows, COLUMNS)


if __name__ == "__main__":
    main()
