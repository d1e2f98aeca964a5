"""The examples run as a user runs them, warnings being errors."""

from __future__ import annotations

import csv
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from helpers.moseg_files import write_definition, write_tracks

from skmotionseg import MotionSegmenter, unpack_tracks
from skmotionseg.datasets import load_tracks, make_rigid_motions
from skmotionseg.metrics import misclassification_error

EXAMPLES = Path(__file__).parents[2] / "examples"
SEVERAL = Path(__file__).parents[1] / "helpers" / "several_scripts.py"


def run(name, *arguments):
    """What an example prints."""
    return run_script(EXAMPLES / f"{name}.py", *arguments)


def run_several(*commands):
    """What each of some examples prints, all of them in one interpreter."""
    commands = [
        [str(EXAMPLES / f"{name}.py"), *map(str, arguments)]
        for name, *arguments in commands
    ]
    return json.loads(run_script(SEVERAL, given=json.dumps(commands)))


def run_script(path, *arguments, given=None):
    command = [sys.executable, "-W", "error", str(path), *arguments]
    result = subprocess.run(
        command,
        input=given,
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "MPLBACKEND": "Agg"},
    )
    assert result.returncode == 0, result.stderr
    assert result.stderr == ""
    return result.stdout


def table_after(title, printed):
    """The first table of that title: its header, and its cells by the value swept."""
    _, *lines = printed[printed.index(title) :].splitlines()
    header, *rows = lines[: lines.index("")] if "" in lines else lines
    cells = [re.split(r"\s{2,}", row.strip()) for row in rows]
    return header.split(), {row[0]: row[1:] for row in cells if len(row) == 4}


run_once = pytest.mark.xdist_group("examples")  # by one of the workers


def write_regions(data):
    """Clips of regions whose masks are the truth around each point of frame 0."""
    for part, seed in (("Trainingset", 0), ("Trainingset", 1), ("Testset", 2)):
        X, y = make_rigid_motions(60, 6, 2, missing=0, random_state=seed)
        home = data / "FBMS59" / part / f"scene{seed}"
        image = np.full((720, 1280), 255, dtype=np.uint8)
        for (column, row), label in zip(X[:, :2].astype(int), y, strict=True):
            image[row - 2 : row + 3, column - 2 : column + 3] = (255, 40)[label]
        write_definition(home, [255, 40], 6, {0: ("first.pgm", image)})
        write_tracks(home / "Tracks6.dat", X, y)


def write_tracks_of_cotracker(path):
    """A file of CoTracker's names, written by someone else."""
    X, _ = make_rigid_motions(38, 7, 2, missing=0, random_state=1)
    points, visibility = unpack_tracks(X)
    np.savez(path, pred_tracks=points.swapaxes(0, 1), pred_visibility=visibility.T)


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """Where the runs of examples write to, and what they are given."""
    names = ("data", "scenes", "regions", "all", "one", "trackers")
    folders = {name: tmp_path_factory.mktemp(name) for name in names}
    write_regions(folders["data"])
    write_tracks_of_cotracker(folders["trackers"] / "mine.npz")
    return folders


@pytest.fixture(scope="module")
def printed(folders):
    """What the examples print, by a name of the run."""
    motions, mine = (folders["trackers"] / name for name in ("motions", "mine.npz"))
    only = ("--only", "method-costs")
    commands = {
        "sweep": ("sweep", "--quick"),
        "scenes": ("tune", "--quick", "--out", folders["scenes"]),
        "regions": (
            *("tune", "--quick", "--out", folders["regions"]),
            *("--data", folders["data"]),
        ),
        "all": ("figures", "--quick", "--out", folders["all"]),
        "one": ("figures", "--quick", "--out", folders["one"], *only),
        "cotracker": ("cotracker", "--out", motions),
        "tapir": ("tapir",),
        "mine": ("cotracker", mine),
    }
    return dict(zip(commands, run_several(*commands.values()), strict=True))


@pytest.fixture
def sweep(printed):
    return printed["sweep"]


@run_once
@pytest.mark.parametrize("title", ["lambda, ", "gamma, ", "delta, "])
def test_sweep_prints_each_parameter_by_model_subset(sweep, title):
    header, rows = table_after(title, sweep)
    assert header == ["A+H", "H+F", "A+H+F"]
    assert len(rows) == 2
    assert all(cell.endswith("%") for row in rows.values() for cell in row)


@run_once
@pytest.mark.parametrize("title", ["lambda, ", "gamma, ", "delta, "])
def test_both_ways_to_sweep_give_the_same_numbers(sweep, title):
    _, by_pipeline, by_segmenter = re.split(r"^[12]\. .*$", sweep, flags=re.M)
    assert table_after(title, by_pipeline) == table_after(title, by_segmenter)


@run_once
def test_sweep_finds_one_setting_for_many_sequences(sweep):
    many = sweep[sweep.index("3. One setting for many sequences") :]
    best = re.search(r"best: (\S+), delta (\S+), lambda \S+: error (\S+%)", many)
    subset, delta, error = best.groups()
    header, rows = table_after("delta, ", many)
    assert rows[delta][header.index(subset)] == error
    assert float(error[:-1]) == min(
        float(cell[:-1]) for row in rows.values() for cell in row
    )
    assert "." * 12 in many  # one a fold and setting
    assert re.search(r"^on the others: error \S+%$", many, flags=re.M)


# ---------------------------------------------------------------- tuning and figures


def read_settings(folder):
    with (folder / "settings.csv").open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


@run_once
def test_tuning_chooses_on_some_sequences_and_judges_on_others(printed, folders):
    printed, folder = printed["scenes"], folders["scenes"]
    assert "4 sequences to choose on, 2 to judge on" in printed
    rows = read_settings(folder)
    errors = [float(row["error (%)"]) for row in rows]
    assert len(rows) == 4
    assert errors == sorted(errors)
    best = re.search(r"best: delta (\S+), lam (\S+), models (\S+); error", printed)
    assert best.groups() == tuple(rows[0][name] for name in ("delta", "lam", "models"))
    assert re.search(r"on the test sequences: error \S+%", printed)
    assert (folder / "errors.png").stat().st_size > 5000


@run_once
def test_tuning_scores_regions_by_the_f_measure(printed, folders):
    assert "2 sequences to choose on, 1 to judge on" in printed["regions"]
    # Two rigid motions without noise of the tracker: nearly nothing is missed.
    assert float(read_settings(folders["regions"])[0]["error (%)"]) < 10


@run_once
def test_figures_are_drawn(printed, folders):
    names = re.findall(r"^wrote .*?([\w-]+)\.png$", printed["all"], flags=re.M)
    assert names == [
        "method-motions",
        "method-costs",
        "motions",
        "costs-description-length",
        "affinities",
        "costs-ncre",
        "affinities-homography",
        "weights-coreg",
        "weights-subset",
        "errors",
    ]
    assert all((folders["all"] / f"{n}.png").stat().st_size > 5000 for n in names)


@run_once
def test_single_figures_are_drawn(printed, folders):
    names = re.findall(r"([\w-]+)\.png$", printed["one"], flags=re.M)
    assert names == ["method-costs"]
    assert [path.name for path in folders["one"].iterdir()] == ["method-costs.png"]


# --------------------------------------------------------------------- point trackers


@run_once
@pytest.mark.parametrize("tracker", ["cotracker", "tapir"])
def test_files_of_trackers_are_segmented(tracker, printed):
    printed = printed[tracker]
    assert "120 tracks in 8 frames" in printed
    sizes = [int(n) for n in re.findall(r"^motion \d: (\d+) tracks$", printed, re.M)]
    assert len(sizes) == 3
    assert sum(sizes) == 120
    assert sizes == sorted(sizes, reverse=True)


@run_once
def test_the_tracks_of_cotracker_come_back_by_motion(printed, folders):
    printed, folder = printed["cotracker"], folders["trackers"] / "motions"
    paths = [Path(path) for path in re.findall(r"^wrote (.*)$", printed, flags=re.M)]
    assert paths == [folder / f"motion_{m}.npz" for m in range(3)]
    sizes = [len(load_tracks(path).data) for path in paths]
    assert sizes == [int(n) for n in re.findall(r"motion \d: (\d+)", printed)]


@run_once
def test_a_file_of_ones_own(printed):
    assert "38 tracks in 7 frames" in printed["mine"]


@pytest.mark.xdist_group("dask")
def test_many_sequences_are_segmented_on_a_cluster():
    pytest.importorskip("distributed", reason="dask's distributed is not installed")
    printed = run("many_sequences_dask", "--scenes", "2")
    assert "2 workers, 2 sequences at a time" in printed
    assert re.search(r"Done +2 out of +2", printed)
    _, header, *rows = printed[printed.index("\n\n") :].split("\n")[1:5]
    assert header.split() == ["tracks", "motions", "found", "error"]
    for seed, row in enumerate(rows):
        X, y = make_rigid_motions(80, 6, 2 + seed % 3, random_state=seed)
        labels = MotionSegmenter(random_state=0).fit_predict(X)
        error = f"{misclassification_error(y, labels):.1%}"
        counts = [str(len(X)), str(y.max() + 1), str(labels.max() + 1)]
        assert row.split() == ["scene", str(seed), *counts, error]
