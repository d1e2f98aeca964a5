"""Errors, time and memory on long simulated videos.

    python -m benchmarks.long_bench --frames 200 400 --seeds 0 2 --how online known

Scenes are of the family "long": 400 tracks per frame that live 25 frames, four motions,
all told apart by their true matrices, no outliers. ``known`` and ``unknown`` are
``MotionSegmenter`` on the whole clip, ``online`` is ``OnlineMotionSegmenter`` frame by
frame, its error that of each track's most frequent label, or, of a track that was gone
before there were motions, that of the result. Even seeds are for setting
constants, odd ones for reports. ``--json docs/long_videos.json`` keeps the figures, and
``python -m benchmarks.figures`` writes them to the page of results.

Each row is measured in a process of its own, which reads the tracks from a file.
Seconds are of the processor, so that others on the machine count little; memory is the
most that the process took, the tracks included, and for ``online`` also what the
pickled estimator takes in the end.
"""

from __future__ import annotations

import argparse
import pickle
import tempfile
import time
from pathlib import Path

import numpy as np
from sklearn.utils import Bunch

from skmotionseg import MotionSegmenter, OnlineMotionSegmenter
from skmotionseg.datasets import make_scene
from skmotionseg.metrics import misclassification_error

from . import report
from .measuring import in_fresh_process, peak_memory

HOW = ("known", "unknown", "online")
TRACKS_PER_FRAME, LIFE, N_MOTIONS = 400, 25, 4
# The mean number of frames in which a track of such a life is seen.
SEEN = 24


def long_scene(n_frames, seed):
    """A scene with 400 tracks per frame."""
    return make_scene(
        "long",
        n_tracks=TRACKS_PER_FRAME * n_frames // SEEN,
        n_frames=n_frames,
        n_motions=N_MOTIONS,
        life=LIFE,
        outliers=0,
        focal=(0.7, 1.4),
        texture=1,
        facets=0,
        motion_noise=0,
        bending=0,
        random_state=seed,
    )


def write_scene(n_frames, seed, path):
    """Simulate a scene, which takes more memory than to segment it."""
    scene = long_scene(n_frames, seed)
    with path.open("wb") as file:
        np.savez(file, data=scene.data, target=scene.target)


def measure(path, n_frames, seed, how):
    """A row: ``error``, ``seconds`` and ``peak``, and more if online."""
    with np.load(path) as file:
        scene = Bunch(data=file["data"], target=file["target"], n_motions=N_MOTIONS)
    started = time.process_time()
    if how == "online":
        row = _stream(scene)
    else:
        n_motions = scene.n_motions if how == "known" else "auto"
        segmenter = MotionSegmenter(n_motions, random_state=0)
        row = {"labels": segmenter.fit_predict(scene.data)}
    row["seconds"] = time.process_time() - started
    labels = row.pop("labels")
    row["error"] = float(misclassification_error(scene.target, labels))
    row["found"] = len(np.unique(labels[labels >= 0]))
    row["peak"] = peak_memory()
    return row | {"n_frames": n_frames, "seed": seed, "how": how}


def _stream(scene):
    n_frames = scene.data.shape[1] // 2
    segmenter, seconds = OnlineMotionSegmenter(random_state=0), []
    numbers = np.full((len(scene.data), n_frames), -1, dtype=np.int16)
    for frame in range(n_frames):
        points = scene.data[:, 2 * frame : 2 * frame + 2]
        ids = np.flatnonzero(np.isfinite(points).all(axis=1))
        points = points[ids]
        started = time.process_time()
        numbers[ids, frame] = segmenter.update(points, ids)
        seconds.append(time.process_time() - started)
    votes = np.stack(
        [(numbers == number).sum(axis=1) for number in range(numbers.max() + 1)]
    )
    # What was gone before there were motions has a label in the result only.
    last = np.full(len(numbers), -1)
    result = segmenter.result()
    last[result.track_ids] = result.labels
    return {
        "labels": np.where(votes.any(axis=0), votes.argmax(axis=0), last),
        "switches": _switches(numbers, scene),
        "state": len(pickle.dumps(segmenter)),
        "median": float(np.median(seconds)),
        "late": float(np.quantile(seconds, 0.95)),
    }


def _switches(numbers, scene):
    """Times that most tracks of a motion change their number, per 100 frames of it."""
    changes, frames = 0, 0
    for motion in range(scene.n_motions):
        own = numbers[scene.target == motion]
        known = [column[column >= 0] for column in own.T]
        most = [np.bincount(column).argmax() for column in known if len(column) >= 5]
        changes += int((np.diff(most) != 0).sum())
        frames += len(most)
    return 100 * changes / max(frames, 1)


def measured(n_frames, seed, how):
    """The row of a scene that another process has simulated."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "scene.npz")
        in_fresh_process(write_scene, n_frames, seed, path)
        return in_fresh_process(measure, path, n_frames, seed, how)


def show(row):
    """Print a row."""
    text = (
        f"{row['n_frames']:6d} {row['seed']:4d} {row['how']:8s} {row['error']:7.2%} "
        f"{row['found']:3d} {row['seconds']:8.1f} s "
        f"{1e3 * row['seconds'] / row['n_frames']:5.0f} ms/frame "
        f"{row['peak'] / 2**20:7.0f} MiB"
    )
    if "late" in row:
        text += (
            f"  {1e3 * row['median']:.0f} / {1e3 * row['late']:.0f} ms, "
            f"{row['state'] / 2**10:.0f} KiB, {row['switches']:.2f} switches"
        )
    print(text, flush=True)


def stored(rows):
    """What is kept of the rows of some seeds: a list of each figure."""
    first, *_ = rows
    name = f"{first['how']}-{first['n_frames']}"
    same = {"row": name, "how": first["how"], "n_frames": first["n_frames"]}
    others = [key for key in first if key not in same]
    return same | {key: [row[key] for row in rows] for key in others}


def main(arguments=None):
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.long_bench",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--frames", type=int, nargs="+", default=[200, 400])
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 3, 5])
    parser.add_argument("--how", nargs="+", choices=HOW, default=list(HOW))
    parser.add_argument("--json", type=Path, metavar="FILE", help="add the figures")
    arguments = parser.parse_args(arguments)
    print(
        "frames seed how        error  found  seconds  per frame  peak  "
        "(median / 95 % latency)"
    )
    for n_frames in arguments.frames:
        for how in arguments.how:
            rows = []
            for seed in arguments.seeds:
                rows.append(measured(n_frames, seed, how))
                show(rows[-1])
                report.save(arguments.json, "long", [stored(rows)])
            mean = np.mean([row["error"] for row in rows])
            print(f"{n_frames:6d} mean {how:8s} {mean:7.2%}", flush=True)


if __name__ == "__main__":
    main()
