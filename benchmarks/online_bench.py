"""Streams against whole clips, at their last frame, on real sequences.

    python -m benchmarks.online_bench --data DIR [--datasets KT3DMoSeg MTPV62]
        [--seeds 0 1 2] [--json FILE]

The number of motions is unknown. A line per sequence: the error of
``OnlineMotionSegmenter``, frame by frame, among the tracks of the last frame, and that
of ``MotionSegmenter``, which has seen the whole clip, among the same tracks; means over
seeds, in percent. Then a table with a row per data set.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from skmotionseg import MotionSegmenter, OnlineMotionSegmenter, unpack_tracks
from skmotionseg.datasets import load_kt3dmoseg, load_mtpv62
from skmotionseg.metrics import misclassification_error

from . import report

LOADERS = {"KT3DMoSeg": load_kt3dmoseg, "MTPV62": load_mtpv62}


def _mean(name):
    return lambda row: f"{np.mean(row[name]):.1f}"


COLUMNS = {
    "": lambda row: row["row"],
    "`OnlineMotionSegmenter()`": _mean("stream"),
    "by seed": lambda row: ", ".join(f"{error:.1f}" for error in row["stream"]),
    "`MotionSegmenter()`": _mean("whole"),
}


def errors_at_last_frame(X, y, seed):
    """Errors of a stream and of the whole clip, among the tracks of the last frame."""
    points, seen = unpack_tracks(X)
    stream = OnlineMotionSegmenter(random_state=seed)
    for frame in range(points.shape[1]):
        ids = np.flatnonzero(seen[:, frame])
        labels = stream.update(points[ids, frame], ids)
    whole = MotionSegmenter(random_state=seed).fit_predict(X)[ids]
    return [misclassification_error(y[ids], found) for found in (labels, whole)]


def measure(name, clips, seeds):
    """A row of a data set, from its clips one after another.

    Parameters
    ----------
    name : str
    clips : sequence of Bunch
    seeds : sequence of int

    Returns
    -------
    dict
        Errors per seed, means over the clips, in percent.
    """
    errors = []
    for clip in clips:
        found = [errors_at_last_frame(clip.data, clip.target, seed) for seed in seeds]
        errors.append(100 * np.array(found))  # (n_seeds, 2)
        stream, whole = errors[-1].mean(axis=0)
        print(f"{clip.name:32s} {stream:6.2f} {whole:6.2f}", flush=True)
    stream, whole = np.mean(errors, axis=0).T.tolist()
    return {"row": name, "n_sequences": len(errors), "stream": stream, "whole": whole}


def main(arguments=None):
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.online_bench",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--data", type=Path, required=True, metavar="DIR")
    parser.add_argument(
        "--datasets", nargs="+", choices=list(LOADERS), default=list(LOADERS)
    )
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2])
    parser.add_argument("--json", type=Path, metavar="FILE")
    arguments = parser.parse_args(arguments)
    rows = [
        measure(name, LOADERS[name](arguments.data / name), arguments.seeds)
        for name in arguments.datasets
    ]
    report.show(rows, COLUMNS)
    report.save(arguments.json, "streams", rows)


if __name__ == "__main__":
    main()
