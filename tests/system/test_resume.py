"""What was interrupted goes on from what it had finished."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from helpers.track_files import write_struct
from joblib import parallel_config
from sklearn.model_selection import GridSearchCV, KFold

import skmotionseg
from skmotionseg import MotionSegmenter, ORKKernel, PerSequence, cli
from skmotionseg._commands import runs
from skmotionseg._commands.checkpoints import Journal, run_key
from skmotionseg.datasets import make_rigid_motions

METHODS = ("affine", "kernel_addition")
SEQUENCES, SEEDS = 2, 2
N_RUNS = len(METHODS) * SEQUENCES * SEEDS
# Ctrl-C is not ignored, as it is by what a script starts in the background.
COMMAND = """
import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)
from skmotionseg.cli import main
sys.exit(main())
"""
LEAVES_WORKERS = """
import sys
from helpers.mortal import says_its_process
from skmotionseg._parallel.engine import run_tasks
from skmotionseg._parallel.tasks import Task
tasks = [Task("waiting", says_its_process, sys.argv[1], k) for k in range(2)]
run_tasks(tasks, n_jobs=2, prefer="processes")
"""
LEAVES_A_FOLDER = """
import sys
from joblib.externals.loky.backend import resource_tracker
from skmotionseg.cli import _tidied_in_silence
with _tidied_in_silence():
    resource_tracker.register(sys.argv[1], "folder")
"""
RUN = {"sequence": "one", "seed": 0}

kills = pytest.mark.skipif(
    os.name != "posix" or shutil.which("ps") is None, reason="needs signals and ps"
)


# ---------------------------------------------------------------------------- journal


def test_records_come_back(tmp_path):
    journal = Journal(tmp_path / "journal")
    assert journal.read() == {}
    journal.append(RUN, {"error": 0.1})
    journal.append({**RUN, "seed": 1}, {"error": 1 / 3})
    expected = {
        run_key(RUN): {"error": 0.1},
        run_key({**RUN, "seed": 1}): {"error": 1 / 3},
    }
    assert Journal(tmp_path / "journal").read() == expected
    assert run_key({"seed": 0, "sequence": "one"}) == run_key(RUN)


def test_a_line_cut_anywhere_costs_that_line_alone(tmp_path):
    path = tmp_path / "journal"
    for seed in range(2):
        Journal(path).append({**RUN, "seed": seed}, {"error": seed})
    whole = path.read_bytes()
    first = whole.index(b"\n") + 1
    for length in range(len(whole)):
        path.write_bytes(whole[:length])
        Journal(path).append({**RUN, "seed": 2}, {"error": 2})
        errors = [record["error"] for record in Journal(path).read().values()]
        # A line that lacks its end alone is whole.
        before = (
            [0, 1] if length == len(whole) - 1 else [0] if length >= first - 1 else []
        )
        assert errors == [*before, 2]


@pytest.mark.parametrize("content", [b"[1]", b"\x00\x00", b"track,label\n0,0\n"])
def test_a_file_of_another_kind_is_not_spoiled(tmp_path, content):
    path = tmp_path / "journal"
    path.write_bytes(content)
    with pytest.raises(ValueError, match="is not a journal: expected lines that start"):
        Journal(path)
    assert path.read_bytes() == content


def test_a_record_is_on_the_disk_before_the_next_run(tmp_path, monkeypatch):
    synced = []
    monkeypatch.setattr(os, "fsync", synced.append)
    Journal(tmp_path / "journal").append(RUN, {})
    assert len(synced) == 1


# ------------------------------------------------------------------------------ bench


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    folder = tmp_path_factory.mktemp("data")
    (folder / "KT3DMoSeg").mkdir()
    for seed in range(SEQUENCES):
        X, y = make_rigid_motions(40, 4, 2, random_state=seed)
        write_struct(folder / "KT3DMoSeg" / f"Seq{seed}_Tracks.mat", X, y)
    return folder


def bench_options(data, journal, *options, jobs=1):
    options = ("--methods", *METHODS, "--seeds", SEEDS, "--jobs", jobs, *options)
    return [str(o) for o in ("bench", "--data", data, "--resume", journal, *options)]


def start(options, code=COMMAND, **environment):
    """The command, or other code, in a process group of its own."""
    return subprocess.Popen(
        [sys.executable, "-c", code, *options],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1", **environment},
    )


def wait_for_lines(journal, count, process):
    for _ in range(6000):
        if journal.exists() and journal.read_bytes().count(b"\n") >= count:
            return
        assert process.poll() is None, process.communicate()
        time.sleep(0.01)
    pytest.fail("nothing was finished in a minute")


def without_seconds(records):
    return [{k: v for k, v in r.items() if k != "seconds"} for r in records]


@pytest.fixture
def counted(monkeypatch):
    """What is measured in this process: (sequence, method's models, seed)."""
    calls = []
    measure = runs._measure

    def count(sequence, params, seed):
        calls.append((sequence.name, params.get("models"), seed))
        return measure(sequence, params, seed)

    monkeypatch.setattr(runs, "_measure", count)
    return calls


@kills
def test_a_killed_bench_goes_on(data, tmp_path, counted):
    journal, out = tmp_path / "journal", tmp_path / "records.json"
    process = start(bench_options(data, journal))
    wait_for_lines(journal, 3, process)
    os.killpg(process.pid, signal.SIGKILL)
    process.communicate()
    finished = journal.read_bytes().splitlines(keepends=True)
    torn = b"".join(finished[:2]) + finished[2][: len(finished[2]) // 2]
    journal.write_bytes(torn)
    assert cli.main(bench_options(data, journal, "--json", out)) == 0
    assert len(counted) == N_RUNS - 2
    resumed = json.loads(out.read_text())
    kept = [json.loads(line)["record"] for line in finished[:2]]
    assert all(record in resumed for record in kept)  # with the seconds they took
    counted.clear()
    fresh = tmp_path / "fresh"
    assert cli.main(bench_options(data, fresh, "--json", out)) == 0
    assert len(counted) == N_RUNS
    assert without_seconds(json.loads(out.read_text())) == without_seconds(resumed)
    counted.clear()
    assert cli.main(bench_options(data, fresh)) == 0  # the tables, and no work
    assert counted == []


class OneMotion(MotionSegmenter):
    """Finds one motion at once."""

    def fit(self, X, y=None):
        self.labels_, self.n_motions_ = np.zeros(len(X), dtype=int), 1
        stages = ("hypotheses", "kernel", "clustering", "total")
        self.stage_seconds_ = dict.fromkeys(stages, 0.0)
        return self


def test_what_has_changed_is_run_again(data, tmp_path, counted, monkeypatch):
    monkeypatch.setattr(runs, "MotionSegmenter", OneMotion)
    journal = tmp_path / "journal"
    options = bench_options(data, journal, "--seeds", 1)
    n_runs = N_RUNS // SEEDS
    assert cli.main(options) == 0
    counted.clear()
    with monkeypatch.context() as patch:
        patch.setattr(runs, "METHODS", {**runs.METHODS, "affine": {"n_hypotheses": 99}})
        assert cli.main(options) == 0
    assert len(counted) == n_runs / 2  # of the method that has changed
    for name, value in (("__version__", "9"), ("code_digest", lambda: "other")):
        counted.clear()
        with monkeypatch.context() as patch:
            patch.setattr(runs, name, value)
            assert cli.main(options) == 0
        assert len(counted) == n_runs
    counted.clear()
    X, y = make_rigid_motions(41, 4, 2, random_state=9)
    changed = data / "KT3DMoSeg" / "Seq0_Tracks.mat"
    before = changed.read_bytes()
    try:
        write_struct(changed, X, y)
        assert cli.main(options) == 0
    finally:
        changed.write_bytes(before)
    assert {name for name, *_ in counted} == {"Seq0"}
    counted.clear()
    assert cli.main(options) == 0
    assert counted == []


def test_any_code_of_the_package_that_changes_is_noticed(tmp_path, monkeypatch):
    package = Path(skmotionseg.__file__).parent
    assert package == runs.PACKAGE
    copy = tmp_path / "skmotionseg"
    shutil.copytree(package, copy, ignore=shutil.ignore_patterns("__pycache__"))
    digest = runs.code_digest.__wrapped__  # which keeps nothing
    as_it_is = digest()
    monkeypatch.setattr(runs, "PACKAGE", copy)
    assert digest() == as_it_is
    for name in ("segmentation.py", "_core/geometry/epipolar.py", "_commands/runs.py"):
        path = copy / name
        before = path.read_bytes()
        path.write_bytes(before + b"\n")
        assert digest() != as_it_is
        path.write_bytes(before)
        path.rename(path.with_name("moved.py"))
        assert digest() != as_it_is
        path.with_name("moved.py").rename(path)
    assert digest() == as_it_is


@kills
def test_an_interrupted_bench_leaves_no_process_and_no_folder(data, tmp_path):
    journal, scratch = tmp_path / "journal", tmp_path / "scratch"
    scratch.mkdir()
    places = {"TMPDIR": str(scratch), "JOBLIB_TEMP_FOLDER": str(scratch)}
    process = start(bench_options(data, journal, "--seeds", 50, jobs=2), **places)
    wait_for_lines(journal, 2, process)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does
    _, errors = process.communicate(timeout=60)
    wait_until_gone(process.pid)
    assert process.returncode == 130
    assert errors.splitlines()[-1] == "skmotionseg: interrupted"
    assert list(scratch.iterdir()) == []
    assert all(json.loads(line) for line in journal.read_bytes().splitlines())


@kills
def test_what_an_interrupted_worker_leaves_is_removed_without_a_word(tmp_path):
    left = tmp_path / "left"
    left.mkdir()
    _, errors = start([str(left)], LEAVES_A_FOLDER).communicate(timeout=60)
    assert not errors and not left.exists()


@kills
def test_workers_end_with_their_parent(tmp_path):
    tests = str(Path(__file__).parents[1])
    process = start([str(tmp_path)], LEAVES_WORKERS, PYTHONPATH=tests)
    for k in range(2):
        wait_for_lines(tmp_path / f"{k}.pid", 1, process)
    workers = {int(path.read_text()) for path in tmp_path.glob("*.pid")}
    assert len(workers) == 2 and process.pid not in workers
    assert workers <= {int(row[1]) for row in living(process.pid)}
    process.kill()
    process.communicate(timeout=60)
    wait_until_gone(process.pid)


def wait_until_gone(group):
    """Wait for the last process of a group; fail if there is one that stays."""
    for _ in range(3000):
        if not living(group):
            return
        time.sleep(0.01)
    pytest.fail(f"still running: {living(group)}")


def living(group):
    """Processes of a group, but for those that are dead and not yet buried."""
    listed = subprocess.run(
        ["ps", "-e", "-o", "pgid=,pid=,stat=,args="], capture_output=True, text=True
    ).stdout
    rows = [line.split(None, 3) for line in listed.splitlines()]
    return [row for row in rows if int(row[0]) == group and not row[2].startswith("Z")]


# ----------------------------------------------------------------------- grid searches


class Interrupted(MotionSegmenter):
    """Stands for Ctrl-C, after so many fits."""

    left = 10**9
    n_fits = 0

    def fit(self, X, y=None):
        if Interrupted.left == 0:
            raise KeyboardInterrupt
        Interrupted.left -= 1
        Interrupted.n_fits += 1
        return super().fit(X)


def test_an_interrupted_search_goes_on(tmp_path, monkeypatch):
    scenes = [make_rigid_motions(40, 4, 2, random_state=seed) for seed in range(4)]
    X, y = map(list, zip(*scenes, strict=True))
    settings = {"n_hypotheses": 40, "selection": "ncre", "random_state": 0}

    def search(**memory):
        segmenter = Interrupted(2, **settings)
        return GridSearchCV(
            PerSequence(segmenter, **memory),
            {"estimator__kernel": [ORKKernel(sparsity=3.0), ORKKernel(sparsity=6.0)]},
            cv=KFold(2),
            refit=False,
        )

    monkeypatch.setattr(Interrupted, "left", 3)
    with pytest.raises(KeyboardInterrupt):
        search(memory=tmp_path).fit(X, y)
    monkeypatch.setattr(Interrupted, "left", 10**9)
    monkeypatch.setattr(Interrupted, "n_fits", 0)
    resumed = search(memory=tmp_path).fit(X, y)
    assert Interrupted.n_fits == 2 * len(X) - 3
    plain = search().fit(X, y)
    for name in ("mean_test_score", "std_test_score"):
        np.testing.assert_array_equal(
            resumed.cv_results_[name], plain.cv_results_[name]
        )


def test_labels_are_kept_for_other_processes(tmp_path, monkeypatch):
    """Large tracks reach workers as maps of files, and are the same tracks."""
    X, _ = make_rigid_motions(40, 4, 2, random_state=0)
    settings = {"n_hypotheses": 20, "selection": "ncre", "random_state": 0}
    segmenter = MotionSegmenter(2, **settings)
    sequences = PerSequence(segmenter, n_jobs=2, memory=str(tmp_path)).fit([X, X + 1])
    with parallel_config(backend="loky", max_nbytes=100):  # map all that are larger
        labels = sequences.predict([X, X + 1])
    monkeypatch.setattr(MotionSegmenter, "fit", lambda *_: pytest.fail("fitted again"))
    again = sequences.set_params(n_jobs=None).predict([X, X + 1])
    for one, other in zip(labels, again, strict=True):
        np.testing.assert_array_equal(one, other)


@kills
@pytest.mark.long
def test_killed_tuning_goes_on(tmp_path):
    """The example, which the guide sends people to."""
    script = Path(__file__).parents[2] / "examples" / "tune.py"
    cache = tmp_path / "cache"
    command = [sys.executable, script, "--quick", "--cache", cache, "--out", tmp_path]
    environment = {**os.environ, "MPLBACKEND": "Agg", "OPENBLAS_NUM_THREADS": "1"}
    process = subprocess.Popen(
        [*map(str, command)],
        env=environment,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )

    def kept():
        return set(cache.rglob("_segment/*/output.pkl"))

    while len(kept()) < 5:
        assert process.poll() is None
        time.sleep(0.01)
    process.kill()
    process.wait()
    before = {path: path.stat().st_mtime_ns for path in kept()}
    done = subprocess.run([*map(str, command)], env=environment, capture_output=True)
    assert done.returncode == 0, done.stderr
    assert len(kept()) > len(before)
    assert {path: path.stat().st_mtime_ns for path in before} == before
