"""Seconds the whole method takes on a clip, beside a plain implementation of it.

    python benchmarks/clip_seconds.py --data DIR [--repeats 5] [--jobs 2]

Each KT3DMoSeg clip under DIR/KT3DMoSeg is segmented with all three models, by every
fusion with the number of motions known and by the default with it unknown, in one warm
process; the median of the repeats is taken a clip, and their mean over the clips is
printed. A plain hypothesis stage (one SVD an 8-point set, as a textbook has it) runs
in the same minute, so that the ratio means something on a busy machine.
"""

from __future__ import annotations

import argparse
import time
from functools import partial
from pathlib import Path

import numpy as np

from skmotionseg import MotionSegmenter
from skmotionseg._core.motion_models import MOTION_MODELS
from skmotionseg.datasets import load_kt3dmoseg

PAPER = {"selection": "ncre"}  # one clustering for each count
SETTINGS = {
    "kernel_addition, count known": {**PAPER, "known": True},
    "coreg, count known": {**PAPER, "fusion": "coreg", "known": True},
    "subset, count known": {**PAPER, "fusion": "subset", "known": True},
    "coreg, count unknown": {**PAPER, "fusion": "coreg", "known": False},
    "default, count known": {"known": True},
    "default, count unknown": {"known": False},
}


def plain_fundamental(x, y):
    """Eight-point fits by one full SVD each, as written in a textbook."""
    models = np.empty((len(x), 3, 3))
    for i, (a, b) in enumerate(zip(x, y, strict=True)):
        a, b = np.column_stack([a, np.ones(8)]), np.column_stack([b, np.ones(8)])
        rows = (b[:, :, None] * a[:, None, :]).reshape(8, 9)
        U, s, Vt = np.linalg.svd(np.linalg.svd(rows)[2][-1].reshape(3, 3))
        models[i] = U @ np.diag([s[0], s[1], 0]) @ Vt
    return models


def timed(function, repeats):
    """Median seconds of a call, after one that is not counted."""
    function()
    seconds = []
    for _ in range(repeats):
        started = time.perf_counter()
        function()
        seconds.append(time.perf_counter() - started)
    return float(np.median(seconds))


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--jobs", type=int, default=2)
    arguments = parser.parse_args()
    clips = load_kt3dmoseg(arguments.data / "KT3DMoSeg")
    rng = np.random.default_rng(0)
    sets = rng.standard_normal((2, 2000, 8, 2))
    fit = MOTION_MODELS["fundamental"].fit
    fast = timed(lambda: fit(*sets), arguments.repeats)
    plain = timed(lambda: plain_fundamental(*sets), arguments.repeats)
    print(f"8-point fits, plain / ours: {plain / fast:.1f} x")
    for name, setting in SETTINGS.items():
        setting = dict(setting)
        known = setting.pop("known")
        seconds = []
        for clip in clips:
            n_motions = len(np.unique(clip.target)) if known else "auto"
            segmenter = MotionSegmenter(
                n_motions, n_jobs=arguments.jobs, random_state=0, **setting
            )
            seconds.append(timed(partial(segmenter.fit, clip.data), arguments.repeats))
        print(
            f"{name:32s} mean {np.mean(seconds):.3f} s a clip "
            f"(fastest {min(seconds):.3f}, slowest {max(seconds):.3f})",
            flush=True,
        )


if __name__ == "__main__":
    main()
