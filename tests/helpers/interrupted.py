"""Ctrl-C in the midst of each stage: ``python interrupted.py FOLDER``.

What is found wrong is printed as JSON, by stage: nothing should be.
"""

from __future__ import annotations

import contextlib
import io
import json
import multiprocessing
import os
import re
import signal
import sys
import threading
from pathlib import Path
from unittest import mock

import numpy as np
from threadpoolctl import threadpool_info

from skmotionseg import MotionSegmenter, cli
from skmotionseg.datasets import make_rigid_motions

X, Y = make_rigid_motions(40, 4, 2, missing=0.1, random_state=0)
SMALL = {"n_hypotheses": 40, "n_landmarks": 30, "max_motions": 3, "random_state": 0}
# Stage: what is called in its midst.
FITS = {
    "hypotheses": "skmotionseg.sampling.draw_hypotheses",
    "kernel": "skmotionseg.kernels.ORKKernel._fit_blocks",
    "clustering": "skmotionseg._core.graph.spectral.leading_eigenvectors",
    "placing": "skmotionseg._core.labels._winners",
}
TRACKED = ("segment", "{video}", "--motions", "2", "--grid", "12", "--jobs", "2")
SEGMENT = ("segment", "{tracks}", "--motions", "2", "--selection", "ncre")
BENCH = (
    "bench",
    "--data",
    "{data}",
    "--methods",
    "affine",
    "homography",
    "--jobs",
    "1",
)
COMMANDS = {
    "tracking": ("skmotionseg.video._tracking._refine", TRACKED),
    "writing a video": (
        "skmotionseg.video._rendering._Brush.draw",
        (*TRACKED, "--render", "{out}/motions.mp4"),
    ),
    "writing labels": (
        "numpy.savez_compressed",
        (*SEGMENT, "--out", "{out}/labels.npz"),
    ),
    "writing motions": (
        "numpy.savez_compressed",
        (*SEGMENT, "--split-dir", "{out}"),
    ),
    "writing a picture": (
        "matplotlib.figure.Figure.savefig",
        (*SEGMENT, "--render", "{out}/motions.png"),
    ),
    "bench": (
        "skmotionseg._commands.runs._measure",
        (*BENCH, "--json", "{out}/records.json"),
    ),
}


def interrupting(target):
    """Send SIGINT when the target is called the second time, and let it go on.

    What writes a file is interrupted the first time, when half of a file is there.
    """
    module, _, name = target.rpartition(".")
    owner = _import(module)
    original = getattr(owner, name)
    calls = []

    def call(*args, **kwargs):
        calls.append(name)
        writes = begin(args[-1] if name == "savefig" else args[0])
        if writes or len(calls) == 2:
            os.kill(os.getpid(), signal.SIGINT)
        return original(*args, **kwargs)

    return mock.patch.object(owner, name, call), calls


def begin(file):
    """Write to an open file or to a path, if it is either; whether it is."""
    if isinstance(file, Path):
        file.write_bytes(b"half of a file")
    elif hasattr(file, "write"):
        file.write(b"half of a file")
    return isinstance(file, Path) or hasattr(file, "write")


def _import(path):
    """A module, or a class in one."""
    try:
        return __import__(path, fromlist=["_"])
    except ImportError:
        module, _, name = path.rpartition(".")
        return getattr(_import(module), name)


def pools():
    """Threads of each native library."""
    return {pool["filepath"]: pool["num_threads"] for pool in threadpool_info()}


def left_over(scratch, before):
    """What should not be there once a stage was interrupted."""
    wrong = [f"temporary {path.name}" for path in scratch.iterdir()]
    for _ in range(500):  # threads that were at work may end what they were at
        if threading.active_count() == 1:
            break
        threading.Event().wait(0.01)
    wrong += [f"thread {t.name}" for t in threading.enumerate()[1:]]
    wrong += [f"process {child.name}" for child in multiprocessing.active_children()]
    limited = {path for path, n in pools().items() if n != before.get(path, n)}
    return wrong + [f"limited {Path(path).name}" for path in limited]


def interrupt_fit(target, scratch, expected):
    patch, calls = interrupting(target)
    wrong, before = [], pools()
    with patch:
        try:
            MotionSegmenter(n_jobs=2, **SMALL).fit(X)
            wrong.append("it went on")
        except KeyboardInterrupt:
            pass
    if len(calls) < 1:
        wrong.append("it was never there")
    wrong += left_over(scratch, before)
    labels = MotionSegmenter(n_jobs=2, **SMALL).fit(X).labels_
    if not np.array_equal(labels, expected):
        wrong.append("the next fit gives other labels")
    return wrong


def interrupt_command(target, arguments, scratch, out, places):
    out.mkdir()
    before = pools()
    patch, calls = interrupting(target)
    said = io.StringIO()
    quiet = contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(said)
    with patch, quiet[0], quiet[1]:
        code = cli.main([part.format(out=out, **places) for part in arguments])
    wrong = [] if code == 130 and calls else [f"exit code {code}: {said.getvalue()}"]
    *progress, last = said.getvalue().splitlines() or [""]
    if last != "skmotionseg: interrupted" or not all(
        re.fullmatch(r"[a-z ]+: \d+ of \d+ done", line) for line in progress
    ):
        wrong.append(f"said {said.getvalue()!r}")
    wrong += [f"file {path.name}" for path in out.rglob("*")]
    return wrong + left_over(scratch, before)


def make_places(folder):
    """Files to work on."""
    import cv2
    from track_files import write_struct

    np.savez(folder / "tracks.npz", X=X, labels=Y)
    home = folder / "data" / "KT3DMoSeg"
    home.mkdir(parents=True)
    for seed in range(2):
        write_struct(home / f"Seq{seed}_Tracks.mat", X, Y)
    rng = np.random.default_rng(0)
    picture = cv2.resize(rng.integers(0, 255, (30, 40), np.uint8), (320, 240))
    video = folder / "video.avi"
    writer = cv2.VideoWriter(str(video), cv2.VideoWriter_fourcc(*"MJPG"), 10, (128, 96))
    for f in range(8):
        writer.write(
            cv2.merge([picture[20 + f : 116 + f, 30 + 2 * f : 158 + 2 * f]] * 3)
        )
    writer.release()
    return {
        "video": str(video),
        "tracks": str(folder / "tracks.npz"),
        "data": str(folder / "data"),
    }


def main(folder):
    scratch = folder / "scratch"
    scratch.mkdir()
    os.environ["TMPDIR"] = str(scratch)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    places = make_places(folder)
    labels = MotionSegmenter(n_jobs=2, **SMALL).fit(X).labels_
    found = {
        stage: interrupt_fit(target, scratch, labels) for stage, target in FITS.items()
    }
    for stage, (target, arguments) in COMMANDS.items():
        out = folder / stage.replace(" ", "_")
        found[stage] = interrupt_command(target, arguments, scratch, out, places)
    print(json.dumps(found))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
