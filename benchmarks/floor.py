"""How far hypotheses and kernels are from what this machine could do at best.

    python -m benchmarks.floor [--data DIR] [--repeats 5] [--json FILE]

The floor of one model is the time of the kernel's product, a symmetric rank-k update of
``n_tracks^2 * n_pairs * n_hypotheses`` operations, at the rate of a float32 matrix
product of that shape, and of one write and one read of the residuals, ``n_tracks *
n_pairs * n_hypotheses * 4`` bytes, at the rate of a copy. Rates and our own time are
measured clip by clip in turns, so all meet the same machine.
"""

from __future__ import annotations

import argparse
import os
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from skmotionseg import MotionSegmenter
from skmotionseg.datasets import load_kt3dmoseg

from . import report
from .measuring import interleave, show_progress, spread
from .scenes import CLIP_SIZES, clip_like
from .stages import MODELS

N_HYPOTHESES = 500
COPIED = 1 << 26  # floats: far more than a cache holds

COLUMNS = {
    "models": lambda row: row["row"],
    "threads": report.number("n_threads", "{:d}"),
    "GFLOP/s": report.number("flops"),
    "GB/s": report.number("bandwidth"),
    "product s": report.number("product", "{:.4f}"),
    "residuals s": report.number("memory", "{:.4f}"),
    "floor s": report.number("floor", "{:.4f}"),
    "ours, seconds": report.seconds,
    "ours / floor": report.number("ratio"),
}


def multiply(a, b, n_threads, _):
    with threadpool_limits(n_threads, user_api="blas"):
        return a @ b


def copy(source, target, n_threads, _):
    parts = zip(
        np.array_split(target, n_threads),
        np.array_split(source, n_threads),
        strict=True,
    )
    with ThreadPoolExecutor(n_threads) as executor:
        list(executor.map(lambda part: np.copyto(*part), parts))


def affinity_seconds(X, models, n_jobs, seed):
    """Seconds of a fit until the affinities are there."""
    segmenter = MotionSegmenter(
        2,
        models=models,
        n_hypotheses=N_HYPOTHESES,
        selection="ncre",
        n_jobs=n_jobs,
        random_state=seed,
    ).fit(X)
    stages = segmenter.stage_seconds_
    return stages["total"] - stages["clustering"]


def make_floor(clips, repeats, n_threads=None):
    """Rows of each model with one thread, and of the three with one and with all."""
    n_threads = n_threads or os.cpu_count()
    settings = {f"{model}-1": ((model,), 1) for model in MODELS}
    settings |= {f"all three-{k}": (MODELS, k) for k in dict.fromkeys([1, n_threads])}
    source, target = np.ones(COPIED, np.float32), np.empty(COPIED, np.float32)
    measured = {name: [] for name in settings}
    for c, clip in enumerate(clips):
        show_progress(f"floor: {clip.name}, {c + 1} of {len(clips)}")
        n, n_columns = len(clip.data), (clip.data.shape[1] // 2 - 1) * N_HYPOTHESES
        rng = np.random.default_rng(0)
        a = rng.random((n, n_columns), dtype=np.float32)
        b = rng.random((n_columns, n), dtype=np.float32)
        calls = {}
        for k in dict.fromkeys([1, n_threads]):
            calls[f"product-{k}"] = partial(multiply, a, b, k)
            calls[f"copy-{k}"] = partial(copy, source, target, k)
        for name, (models, k) in settings.items():
            calls[name] = partial(affinity_seconds, clip.data, models, k)
        runs = interleave(calls, repeats)
        for name, (models, k) in settings.items():
            # Of the rates with one thread and with all the better: it is a floor.
            product_seconds, copy_seconds = (
                min(runs[f"{what}-{each}"].seconds.min() for each in {1, k})
                for what in ("product", "copy")
            )
            flops = 2 * n**2 * n_columns / product_seconds
            bandwidth = 2 * source.nbytes / copy_seconds
            product = len(models) * n**2 * n_columns / flops
            memory = len(models) * 2 * n * n_columns * 4 / bandwidth
            measured[name].append(
                (flops, bandwidth, product, memory, *runs[name].results)
            )
    show_progress("")
    return [
        _row(name, settings[name][1], np.mean(each, axis=0))
        for name, each in measured.items()
    ]


def _row(name, n_threads, means):
    flops, bandwidth, product, memory, *ours = map(float, means)
    return {
        "row": name.rpartition("-")[0] + (f", {n_threads} threads" * (n_threads > 1)),
        "n_threads": n_threads,
        "flops": flops / 1e9,
        "bandwidth": bandwidth / 1e9,
        "product": product,
        "memory": memory,
        "floor": product + memory,
        "seconds": spread(ours),
        "ratio": float(np.median(ours)) / (product + memory),
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--data", type=Path, help="without it, synthetic clips")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    if arguments.data is None:
        clips = [clip_like(*size) for size in CLIP_SIZES]
    else:
        clips = load_kt3dmoseg(arguments.data / "KT3DMoSeg")
    rows = make_floor(clips, arguments.repeats)
    report.show(rows, COLUMNS)
    report.save(arguments.json, "floor", rows)


if __name__ == "__main__":
    main()
