"""What the package takes, and what it leaves behind."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from helpers.track_files import write_struct

from skmotionseg.datasets import make_rigid_motions

HERE = Path(__file__).parents[1] / "helpers"
# What the estimators need, and need not pay for.
EXTRAS = (
    *("matplotlib", "PIL", "cv2", "skimage"),
    *("rich", "dask", "distributed", "pandas"),
)
OURS = ("cli", "plotting", "video", "_commands", "_parallel.dask", "datasets")


def run(arguments, *, threads="1", **environment):
    names = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
    done = subprocess.run(
        [sys.executable, *map(str, arguments)],
        env={**os.environ, **dict.fromkeys(names, threads), **environment},
        capture_output=True,
        text=True,
        timeout=1200,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout


@pytest.mark.skipif(os.name != "posix", reason="signals are POSIX's")
def test_interrupted_stages_leave_nothing(tmp_path):
    pytest.importorskip("cv2", reason="needs opencv-python-headless")
    found = json.loads(run([HERE / "interrupted.py", tmp_path], threads="2"))
    assert len(found) == 10
    assert {stage: wrong for stage, wrong in found.items() if wrong} == {}


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")
@pytest.mark.parametrize(
    ("count", "allowed"), [(8, 10), pytest.param(200, 20, marks=pytest.mark.long)]
)
def test_fits_keep_no_memory(count, allowed):
    found = run([HERE / "memory_of_fits.py", count]).split()
    start, end, n_before, n_after = map(float, found)
    assert end - start < allowed
    assert n_after <= n_before


# ----------------------------------------------------------------------------- import

LIST_MODULES = """
import sys, threading
import joblib, sklearn.base, sklearn.pipeline, sklearn.utils, threadpoolctl
import scipy.linalg, scipy.optimize, scipy.spatial, scipy.special
before = set(sys.modules)
import skmotionseg
print(threading.active_count(), *sorted(set(sys.modules) - before))
"""


def test_the_import_starts_no_thread_and_loads_what_it_needs():
    n_threads, *modules = run(["-c", LIST_MODULES]).split()
    assert n_threads == "1"
    assert not {name.partition(".")[0] for name in modules} & set(EXTRAS)
    assert not set(modules) & {f"skmotionseg.{name}" for name in OURS}
    assert "skmotionseg.segmentation" in modules


BLOCK = f"""
import sys
class Blocked:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {EXTRAS}:
            raise ImportError(name + " is blocked")
sys.meta_path.insert(0, Blocked())
import numpy as np
from skmotionseg import MotionSegmenter, save_motions
from skmotionseg.cli import main
from skmotionseg.datasets import load_tracks, make_rigid_motions
X, y = make_rigid_motions(60, 5, 2, random_state=0)
np.savez("tracks.npz", X=X, labels=y)
clip = load_tracks("tracks.npz")
labels = MotionSegmenter(random_state=0, n_hypotheses=50).fit(X).predict(clip.data)
save_motions("motions", X, labels)
for arguments in (["demo"], ["segment", "tracks.npz"], ["segment", "clip.mp4"]):
    assert main(arguments) == 2
try:
    import skmotionseg.plotting
    skmotionseg.plotting.plot_motions(X, labels)
except ImportError as error:
    print(error)
"""


def test_without_any_extra(tmp_path):
    code = f"import os; os.chdir({str(tmp_path)!r})" + BLOCK
    printed = run(["-c", code])
    assert 'pip install "skmotionseg[plot]"' in printed


# ---------------------------------------------------------------------------- network

NO_NETWORK = """
import sys
def refuse(event, arguments):
    if event.startswith(("socket.", "urllib.", "http.")) and event != "socket.__new__":
        raise SystemExit(f"reached for the network: {event} {arguments}")
sys.addaudithook(refuse)
from skmotionseg.cli import main
def run(*arguments):
    assert main(arguments) == 0, arguments
from functools import partial
from skmotionseg import datasets
datasets.make_rigid_motions = partial(datasets.make_rigid_motions, 36, 3)  # not 400
run("demo", "--out", "demo.png")
run("segment", "tracks.npz", "--render", "motions.png", "--out", "labels.csv")
options = ("--data", "data", "--methods", "affine", "--seeds", "1", "--jobs", "1")
run("bench", *options, "--resume", "journal")
try:
    import cv2
except ImportError:
    pass
else:
    options = ("--motions", "2", "--grid", "12", "--render", "motions.mp4")
    run("segment", "frames", *options)
import socket
try:
    socket.create_connection(("127.0.0.1", 9), timeout=1)
except SystemExit:
    print("guarded")
"""


def test_nothing_reaches_for_the_network(tmp_path):
    X, y = make_rigid_motions(36, 3, 2, random_state=0)
    np.savez(tmp_path / "tracks.npz", X=X, labels=y)
    home = tmp_path / "data" / "KT3DMoSeg"
    home.mkdir(parents=True)
    write_struct(home / "Seq_Tracks.mat", X, y)
    cv2 = pytest.importorskip("cv2", reason="needs opencv-python-headless")
    (tmp_path / "frames").mkdir()
    noise = np.random.default_rng(0).integers(0, 255, (30, 40), np.uint8)
    picture = cv2.resize(noise, (320, 240))
    for f in range(7):
        frame = picture[20 + f : 116 + f, 30 + 2 * f : 158 + 2 * f]
        cv2.imwrite(str(tmp_path / "frames" / f"{f}.png"), frame)
    code = f"import os; os.chdir({str(tmp_path)!r})" + NO_NETWORK
    assert run(["-c", code]).splitlines()[-1] == "guarded"
