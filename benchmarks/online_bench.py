"""Streams against whole clips, at their last frame, on real sequences.

    python -m benchmarks.online_bench --data DIR --datasets KT3DMoSeg MTPV62

The number of motions is unknown. A row per sequence: the error of
``OnlineMotionSegmenter``, frame by frame, among the tracks of the last frame, and that
of ``MotionSegmenter``, which has seen the whole clip, among the same tracks; means over
seeds, in percent.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from skmotionseg import MotionSegmenter, OnlineMotionSegmenter, unpack_tracks
from skmotionseg.datasets import load_kt3dmoseg, load_mtpv62
from skmotionseg.metrics import misclassification_error

LOADERS = {"KT3DMoSeg": load_kt3dmoseg, "MTPV62": load_mtpv62}


def errors_at_last_frame(X, y, seed):
    """Errors of a stream and of the whole clip, among the tracks of the last frame."""
    points, seen = unpack_tracks(X)
    stream = OnlineMotionSegmenter(random_state=seed)
    for frame in range(points.shape[1]):
        ids = np.flatnonzero(seen[:, frame])
        labels = stream.update(points[ids, frame], ids)
    whole = MotionSegmenter(random_state=seed).fit_predict(X)[ids]
    return [misclassification_error(y[ids], found) for found in (labels, whole)]


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
    arguments = parser.parse_args(arguments)
    for name in arguments.datasets:
        rows = []
        for clip in LOADERS[name](arguments.data / name):
            found = [
                errors_at_last_frame(clip.data, clip.target, seed)
                for seed in arguments.seeds
            ]
            rows.append(100 * np.array(found))  # (n_seeds, 2)
            stream, whole = rows[-1].mean(axis=0)
            print(f"{clip.name:32s} {stream:6.2f} {whole:6.2f}", flush=True)
        by_seed = np.mean(rows, axis=0)
        for title, found in zip(("stream", "whole clip"), by_seed.T, strict=True):
            seeds = ", ".join(f"{error:.2f}" for error in found)
            print(f"{name}: {title} {found.mean():.2f} (by seed {seeds})", flush=True)


if __name__ == "__main__":
    main()
