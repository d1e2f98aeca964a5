"""The table: seconds, memory and error of the whole method, on clips and at scale."""

from __future__ import annotations

from fnmatch import fnmatch
from functools import partial
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from skmotionseg import MotionSegmenter
from skmotionseg.datasets import load_hopkins155, load_kt3dmoseg
from skmotionseg.metrics import misclassification_error

from . import plain, report, scale
from .measuring import in_fresh_process, interleave, show_progress, spread
from .scenes import CLIP_SIZES, clip_like

METHODS = {
    "coreg": {"fusion": "coreg", "selection": "ncre"},
    "kernel_addition": {"fusion": "kernel_addition", "selection": "ncre"},
    "subset": {"fusion": "subset", "selection": "ncre"},
    "default": {},
    "thinned": {},  # the default on a clip's thinned tracks, beside its dense ones
}
COUNTS = range(1, 11)  # where the number of motions is unknown

# Rows over sequences are called SOURCE-METHOD-COUNT. "plain" is co-regularisation in
# plain NumPy; "dense" are all tracks of a clip, judged on those that have labels.
SEQUENCE_ROWS = {
    "clips": (
        "coreg-known",
        "coreg-unknown",
        "kernel_addition-known",
        "subset-known",
        "default-known",
        "default-unknown",
        "plain-known",
        "plain-unknown",
    ),
    "hopkins": ("coreg-known", "coreg-unknown", "default-known", "default-unknown"),
    "dense": (
        "default-known",
        "thinned-known",
        "default-unknown",
        "thinned-unknown",
    ),
}

COLUMNS = {
    "row": lambda row: row["row"],
    "tracks": report.number("n_tracks", "{:.0f}"),
    "frames": report.number("n_frames", "{:.4g}"),
    "seconds": report.seconds,
    "CPU s": report.number("cpu_seconds", "{:.3g}"),
    "plain / this": report.number("plain_ratio"),
    "error %": report.number("error", "{:.2f}"),
    "count right %": report.number("count_right", "{:.0f}"),
    "peak MB": report.megabytes,
    "CPU s x": report.number("cpu_growth", "{:.2f}"),
    "peak x": report.number("peak_growth", "{:.2f}"),
    "version": report.version,
}


def make_table(data, patterns, repeats, n_jobs, tracks, frames, quick=False):
    """Measure the rows whose names match, and yield them as they are done.

    Parameters
    ----------
    data : path-like or None
        Holds ``KT3DMoSeg`` and ``Hopkins155``. Without it the clips are synthetic, and
        rows over other sequences are left out.
    patterns : sequence of str
        As of a shell, ``clips-*`` say.
    repeats : int
        Each with another seed.
    n_jobs : int or None
    tracks, frames : sequence of (int, int)
        Numbers of tracks and frames of the scale rows, each to measure by itself.
    quick : bool
        Take but the smallest two sequences of each source.

    Yields
    ------
    dict
    """

    def wanted(row):
        return any(fnmatch(row, pattern) for pattern in patterns)

    for source, names in SEQUENCE_ROWS.items():
        names = [name for name in names if wanted(f"{source}-{name}")]
        sequences = _load(source, data) if names else []
        if quick:
            sequences = sorted(sequences, key=lambda each: len(each.data))[:2]
        if sequences:
            yield from _sequence_rows(source, names, sequences, repeats, n_jobs)
    for scene, sizes in (("tracks", tracks), ("frames", frames)):
        sizes = [size for size in sizes if wanted(_scale_name(scene, size))]
        yield from _scale_rows(scene, sizes, repeats, n_jobs)


def _load(source, data):
    if data is None:
        return [clip_like(*size) for size in CLIP_SIZES] if source == "clips" else []
    if source == "hopkins":
        return load_hopkins155(Path(data) / "Hopkins155")
    return load_kt3dmoseg(Path(data) / "KT3DMoSeg")


# ------------------------------------------------------------------ rows over sequences


def _sequence_rows(source, names, sequences, repeats, n_jobs):
    """A row a name: means over the sequences, and their spread over the repeats."""
    seconds = np.empty((len(names), len(sequences), repeats))
    cpu_seconds, errors, right = (np.empty_like(seconds) for _ in range(3))
    sizes = []  # tracks and frames of each sequence
    for s, sequence in enumerate(sequences):
        show_progress(f"{source}: {sequence.name}, {s + 1} of {len(sequences)}")
        dense = source == "dense"
        X = sequence.dense_data if dense else sequence.data
        sizes.append((len(X), X.shape[1] // 2))
        calls = {
            name: partial(_segment, name, sequence, dense, n_jobs) for name in names
        }
        for i, runs in enumerate(interleave(calls, repeats, warm=s == 0).values()):
            seconds[i, s], cpu_seconds[i, s] = runs.seconds, runs.cpu_seconds
            judged = [_judge(sequence, labels) for labels in runs.results]
            errors[i, s], right[i, s] = zip(*judged, strict=True)
    show_progress("")
    over_sequences = dict(zip(names, seconds.mean(axis=1), strict=True))
    n_tracks, n_frames = np.mean(sizes, axis=0)
    rows = []
    for i, name in enumerate(names):
        count = name.rpartition("-")[2]
        row = {"row": f"{source}-{name}", "seconds": spread(over_sequences[name])}
        row["cpu_seconds"] = float(np.median(cpu_seconds[i].mean(axis=0)))
        if not name.startswith("thinned"):
            row |= {"n_tracks": float(n_tracks), "n_frames": float(n_frames)}
        else:
            row |= {"n_tracks": float(np.mean([len(each.data) for each in sequences]))}
        row["error"] = 100 * float(errors[i].mean())
        if count == "unknown":
            row["count_right"] = 100 * float(right[i].mean())
        plain_seconds = over_sequences.get(f"plain-{count}")
        if plain_seconds is not None:
            row["plain_ratio"] = float(np.median(plain_seconds / over_sequences[name]))
        rows.append(row)
    return rows


def _segment(name, sequence, dense, n_jobs, seed):
    """Labels of the tracks of a sequence that have a true label."""
    method, _, count = name.rpartition("-")
    n_motions = _n_motions(sequence.target)
    if method == "plain":
        # At its fastest: BLAS threads cost more than they bring on matrices this small.
        with threadpool_limits(1):
            counts = [n_motions] if count == "known" else COUNTS
            return plain.segment(sequence.data, counts, seed)
    segmenter = MotionSegmenter(
        n_motions if count == "known" else "auto",
        min_motions=COUNTS[0],
        max_motions=COUNTS[-1],
        n_jobs=n_jobs,
        random_state=seed,
        **METHODS[method],
    )
    if dense and method != "thinned":
        return segmenter.fit(sequence.dense_data).labels_[sequence.dense_index]
    return segmenter.fit(sequence.data).labels_


def _judge(sequence, labels):
    """Share of tracks misclassified, and whether the count is right."""
    right = _n_motions(labels) == _n_motions(sequence.target)
    return misclassification_error(sequence.target, labels), right


def _n_motions(labels):
    return len(np.unique(labels[labels >= 0]))


# ----------------------------------------------------------------------- rows at scale


def _scale_name(scene, size):
    return f"{scene}-{size[scene == 'frames']}"


def _scale_rows(scene, sizes, repeats, n_jobs):
    """A row a size, each from a process of its own, and its growth from the last."""
    last = None
    for n_tracks, n_frames in sizes:
        name = _scale_name(scene, (n_tracks, n_frames))
        show_progress(name)
        measured = in_fresh_process(
            scale.measure, scene, n_tracks, n_frames, repeats, n_jobs
        )
        row = {
            "row": name,
            "n_tracks": n_tracks,
            "n_frames": n_frames,
            "seconds": spread(measured["seconds"]),
            "cpu_seconds": float(np.median(measured["cpu_seconds"])),
            "error": 100 * float(np.mean(measured["errors"])),
            "peak": measured["peak"],
        }
        if last:
            row["cpu_growth"] = row["cpu_seconds"] / last["cpu_seconds"]
            row["peak_growth"] = row["peak"] / last["peak"]
        yield (last := row)
    show_progress("")
