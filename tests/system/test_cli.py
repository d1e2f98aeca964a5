"""The command, called as a function: what it prints, writes and returns."""

from __future__ import annotations

import io
import json
import os
import re
import subprocess
import sys
from contextlib import redirect_stdout
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import scipy.io
from helpers.moseg_files import write_definition, write_tracks
from helpers.track_files import write_struct
from helpers.two_images import two_images
from numpy.testing import assert_array_equal
from rich.console import Console
from sklearn.utils import Bunch

from skmotionseg import MotionSegmenter, __version__, unpack_tracks
from skmotionseg._commands import label_files, runs
from skmotionseg._commands.console import with_progress
from skmotionseg.cli import main
from skmotionseg.datasets import load_fbms59, load_tracks, make_rigid_motions
from skmotionseg.metrics import (
    fbms_objects,
    fbms_scores,
    misclassification_error,
)

PNG = b"\x89PNG\r\n\x1a\n"
METHODS = ("affine", "homography", "fundamental", "kernel_addition", "coreg", "subset")
COMPARED = tuple(
    models + rule
    for models in ("homography_", "")
    for rule in ("eigengap", "self_tuning")
)
STAGES = ["hypotheses", "kernel", "clustering"]
RECORD = {
    "dataset",
    "method",
    "sequence",
    "seed",
    "n_tracks",
    "n_frames",
    "n_motions",
    "error_known",
    "n_motions_found",
    "error_unknown",
    "n_motions_found_from_2",
    "error_unknown_from_2",
    "seconds",
}


@pytest.fixture(autouse=True)
def wide_terminal(monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")


@pytest.fixture
def run(capsys):
    """Run the command: (exit code, what it printed, what it printed to stderr)."""

    def run(*arguments):
        code = main([str(argument) for argument in arguments])
        return code, *capsys.readouterr()

    return run


@pytest.fixture(scope="module")
def scene():
    """Three motions, and next to no work: (X, y)."""
    return make_rigid_motions(n_tracks=90, n_frames=5, random_state=0)


@pytest.fixture(scope="module")
def as_it_comes(scene):
    """The scene segmented with every parameter as it comes."""
    return MotionSegmenter(random_state=0).fit(scene[0])


@pytest.fixture
def scene_file(scene, tmp_path):
    X, y = scene
    np.savez(tmp_path / "scene.npz", X=X, labels=y)
    return tmp_path / "scene.npz"


def facts(printed):
    """A table of two columns as a dict."""
    rows = [line.strip("│ ").split("│") for line in printed.splitlines()]
    return {row[0].strip(): row[1].strip() for row in rows if len(row) == 2}


# ------------------------------------------------------------------------------- demo


def test_the_demo_finds_three_motions(run, tmp_path):
    code, printed, errors = run("demo", "--out", tmp_path / "demo.png")
    assert (code, errors) == (0, "")
    table = facts(printed)
    assert table["tracks"] == "400"
    assert table["motions found"] == table["motions true"] == "3"
    assert float(table["misclassification"].rstrip("%")) < 5
    assert float(table["seconds total"]) > 0
    assert f"picture: {tmp_path / 'demo.png'}" in printed.replace("\n", " ")
    assert (tmp_path / "demo.png").read_bytes().startswith(PNG)


class LargestMotionOnly(MotionSegmenter):
    """Finds one motion at once."""

    def fit(self, X, y=None):
        self.labels_ = np.zeros(len(X), dtype=int)
        self.n_motions_ = 1
        self.stage_seconds_ = dict.fromkeys([*STAGES, "total"], 0.0)
        return self


def test_a_seed_gives_its_demo(run, tmp_path, monkeypatch):
    small = partial(make_rigid_motions, 60, 5)
    monkeypatch.setattr("skmotionseg.datasets.make_rigid_motions", small)
    monkeypatch.setattr("skmotionseg.segmentation.MotionSegmenter", LargestMotionOnly)
    pictures = [tmp_path / name for name in ("first.png", "again.png", "other.png")]
    for picture, seed in zip(pictures, (3, 3, 4), strict=True):
        run("demo", "--seed", seed, "--out", picture)
    first, again, other = (picture.read_bytes() for picture in pictures)
    assert first == again != other


# ---------------------------------------------------------------------------- segment

# How a partition is chosen is not what tests of files are about.
BY_GRAPH = ("--motions", 3, "--selection", "ncre")


def by_graph(seed=0):
    return MotionSegmenter(3, selection="ncre", random_state=seed)


def test_segment_prints_what_it_found(run, scene, scene_file):
    X, y = scene
    code, printed, errors = run("segment", scene_file, "--motions", 3)
    assert (code, errors) == (0, "")
    labels = MotionSegmenter(3, random_state=0).fit_predict(X)
    table = facts(printed)
    assert table["motions found"] == "3"
    assert table["frames"] == "5"
    assert "chosen" not in printed  # there was nothing to choose
    assert table["misclassification"] == f"{misclassification_error(y, labels):.2%}"
    assert table["taken as true"] == "labels in the file"
    for motion in range(3):
        n_tracks = (labels == motion).sum()
        row = rf"│ +{motion} │ +{n_tracks} │ +{n_tracks / len(X):.1%} │ +5 of 5 │ ● #"
        assert re.search(row, printed)


def test_segment_says_what_explains_the_motions_and_their_number(
    run, scene, scene_file, as_it_comes, tmp_path, monkeypatch
):
    monkeypatch.setenv("COLUMNS", "80")
    picture = tmp_path / "report.png"
    code, printed, errors = run("segment", scene_file, "--report", picture)
    assert (code, errors) == (0, "")
    assert picture.read_bytes().startswith(PNG)
    report = as_it_comes.report(scene[0])
    for motion in report.motions:
        row = rf"│ +{motion.label} │.*│ {motion.model} +│ +{motion.residual:.2f} px │"
        assert re.search(row, printed)
    for each in report.counts:
        verdict = re.escape(each.verdict)
        row = rf"│ +{each.n_motions} │.*│ +{each.total:.4f} │ {verdict} +│"
        assert re.search(row, printed)


@pytest.mark.parametrize("ending", [".npz", ".csv"])
def test_segment_writes_labels(run, scene, scene_file, tmp_path, ending):
    X, _ = scene
    out = tmp_path / f"labels{ending}"
    options = (*BY_GRAPH, "--seed", 5, "--out", out)
    code, printed, _ = run("segment", scene_file, *options)
    assert code == 0
    assert f"labels: {out}" in printed.replace("\n", " ")
    expected = by_graph(seed=5).fit_predict(X)
    if ending == ".npz":
        written = load_tracks(out)
        assert_array_equal(written.data, X)
        assert_array_equal(written.target, expected)
    else:
        assert out.read_text().startswith("track,label\n0,")
        table = np.loadtxt(out, delimiter=",", skiprows=1, dtype=int)
        assert_array_equal(table, np.column_stack([np.arange(len(X)), expected]))
    assert {path.name for path in tmp_path.iterdir()} == {out.name, scene_file.name}


def test_segment_reads_csv_and_draws(run, scene, tmp_path):
    X, _ = scene
    path, picture = tmp_path / "scene.csv", tmp_path / "scene.png"
    out = tmp_path / "labels.csv"
    np.savetxt(path, X, delimiter=",")
    path.write_text(path.read_text().replace("nan", ""))
    code, printed, errors = run(
        "segment", path, *BY_GRAPH, "--out", out, "--render", picture
    )
    assert (code, errors) == (0, "")
    assert "misclassification" not in printed  # there are no labels to judge by
    assert facts(printed)["unseen"] == f"{np.isnan(X).mean():.1%}"
    assert out.read_text().startswith("track,label\n")
    assert picture.read_bytes().startswith(PNG)


def test_segment_writes_a_file_a_motion(run, scene, scene_file, tmp_path):
    X, _ = scene
    folder = tmp_path / "motions"
    options = (*BY_GRAPH, "--split-dir", folder)
    code, printed, errors = run("segment", scene_file, *options)
    assert (code, errors) == (0, "")
    assert f"motions: 3 files in {folder}" in " ".join(printed.split())
    expected = by_graph().fit_predict(X)
    for motion in range(3):
        clip = load_tracks(folder / f"motion_{motion}.npz")
        assert_array_equal(clip.data, X[expected == motion])
    fewer = ("--motions", 2, "--selection", "ncre", "--split-dir", folder)
    code, _, errors = run("segment", scene_file, *fewer)
    assert code == 2
    assert "motion_2.npz of another segmentation" in errors


def test_names_of_files_are_printed_as_they_are(run, scene_file, tmp_path):
    """Also those that Rich would take for markup, or for the name of a picture."""
    folder = tmp_path / "run[" / "x]"
    folder.mkdir(parents=True)
    source, out = folder / "scene[final]:dog:.npz", folder / "labels[red].npz"
    source.write_bytes(scene_file.read_bytes())
    options = (*BY_GRAPH, "--out", out, "--split-dir", folder / "motions[b]")
    code, printed, errors = run("segment", source, *options)
    assert (code, errors) == (0, "")
    assert source.name in printed
    printed = " ".join(printed.split())
    assert f"labels: {out}" in printed
    assert f"motions: 3 files in {folder}/motions[b]" in printed


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_all_files_are_written_whether_or_not_what_is_printed_is(scene_file, tmp_path):
    command = [sys.executable, "-m", "skmotionseg", "segment", scene_file, *BY_GRAPH]
    options = ["--out", tmp_path / "labels.csv", "--split-dir", tmp_path / "motions"]
    with open("/dev/full", "w") as full:
        ended = subprocess.run(
            [*map(str, command + options)], stdout=full, stderr=subprocess.PIPE
        )
    assert ended.returncode == 2
    assert b"No space left" in ended.stderr
    assert len(list((tmp_path / "motions").iterdir())) == 3
    assert (tmp_path / "labels.csv").exists()


def test_what_the_terminal_has_no_sign_for_is_no_error(run, scene_file):
    command = [sys.executable, "-m", "skmotionseg", "segment", scene_file, *BY_GRAPH]
    ended = subprocess.run(
        [*map(str, command)],
        capture_output=True,
        env=os.environ | {"PYTHONIOENCODING": "ascii", "PYTHONUTF8": "0"},
    )
    assert (ended.returncode, ended.stderr) == (0, b"")
    assert b"? #" in ended.stdout  # the dots of the colours
    assert facts(run("segment", scene_file, *BY_GRAPH)[1])["motions found"] == "3"


@pytest.mark.parametrize("lost", ["the input", "--out"])
def test_motions_are_not_written_over_another_file(run, scene_file, tmp_path, lost):
    """As where a motion of an earlier run is parted once more."""
    source, out = tmp_path / "scene.npz", tmp_path / "labels.npz"
    if lost == "the input":
        source = tmp_path / "motion_0.npz"
    else:
        out = tmp_path / "no_motion.npz"
    source.write_bytes(scene_file.read_bytes())
    code, _, errors = run("segment", source, "--out", out, "--split-dir", tmp_path)
    assert code == 2
    assert f"motions in {tmp_path} may be written over {lost}, " in errors
    assert source.read_bytes() == scene_file.read_bytes()
    assert not out.exists()


@pytest.mark.parametrize(
    "options, stale",
    [
        (("--motions", 1), "motion_1.npz, motion_2.npz"),
        (("--motions", 2), "motion_2.npz"),
        (("--max-motions", 2), "motion_2.npz"),
        (("--motions", 3), None),
        ((), None),
    ],
)
def test_motions_that_would_stay_are_refused_before_any_work(
    run, scene_file, tmp_path, monkeypatch, options, stale
):
    def fit(*_):
        raise RuntimeError("at work")

    monkeypatch.setattr(MotionSegmenter, "fit", fit)
    names = ["motion_0.npz", "motion_1.npz", "motion_2.npz", "no_motion.npz"]
    for name in names:
        (tmp_path / name).touch()
    command = "segment", scene_file, *options, "--split-dir", tmp_path
    if stale is None:
        with pytest.raises(RuntimeError, match="at work"):
            run(*command)
    else:
        code, _, errors = run(*command)
        assert code == 2
        assert f"{tmp_path} holds {stale} of another segmentation: remove it" in errors
    assert all((tmp_path / name).read_bytes() == b"" for name in names)


def test_segment_chooses_the_count_by_default(run, scene_file, as_it_comes):
    _, printed, _ = run("segment", scene_file, "--motions", "auto")
    assert facts(printed)["motions found"] == str(as_it_comes.n_motions_)
    assert as_it_comes.n_motions_ > 1


def test_segment_passes_its_options_on(run, scene, scene_file, tmp_path):
    out = tmp_path / "labels.npz"
    options = ("--models", "homography,affine", "--selection", "ncre", "--seed", 4)
    counts = ("--min-motions", 2, "--max-motions", 4, "--out", out)
    code, _, errors = run("segment", scene_file, *options, *counts)
    assert (code, errors) == (0, "")
    segmenter = MotionSegmenter(
        models=["affine", "homography"],
        selection="ncre",
        min_motions=2,
        max_motions=4,
        random_state=4,
    )
    assert_array_equal(load_tracks(out).target, segmenter.fit_predict(scene[0]))


def test_segment_takes_a_focal_length(run, scene, scene_file, tmp_path):
    out = tmp_path / "labels.npz"
    code, _, errors = run("segment", scene_file, "--focal-length", 640, "--out", out)
    assert (code, errors) == (0, "")
    segmenter = MotionSegmenter(focal_length=640, random_state=0)
    assert_array_equal(load_tracks(out).target, segmenter.fit_predict(scene[0]))


QUICK = ("--models", "homography", "--selection", "ncre", "--motions", 3)


@pytest.mark.parametrize("ending", [".npz", ".csv"])
def test_segment_writes_how_sure_it_is(run, scene, scene_file, tmp_path, ending):
    out = tmp_path / f"labels{ending}"
    code, _, _ = run("segment", scene_file, *QUICK, "--out", out, "--confidence")
    assert code == 0
    segmenter = MotionSegmenter(
        3, models=["homography"], selection="ncre", random_state=0
    )
    expected = segmenter.fit(scene[0]).probabilities_
    if ending == ".npz":
        with np.load(out) as written:
            assert_array_equal(written["probabilities"], expected)
    else:
        assert out.read_text().startswith("track,label,probability\n0,")
        table = np.loadtxt(out, delimiter=",", skiprows=1)
        np.testing.assert_allclose(table[:, 2], expected, atol=5e-4)


def test_a_frame_is_written_with_what_its_labels_are_sure_of():
    file = io.BytesIO()
    label_files.begin_observations(file, sure=True)
    points = np.array([[10.25, 20.5], [3.0, 4.0]])
    label_files.write_frame(file, 7, [4, 9], points, [1, -1], np.array([0.875, 0.5]))
    assert file.getvalue().decode().splitlines() == [
        "track,frame,x,y,label,probability",
        "4,7,10.250,20.500,1,0.875",
        "9,7,3.000,4.000,-1,0.500",
    ]


@pytest.mark.parametrize("axes", ["CoTracker", "either", "npy", "shares"])
def test_segment_is_told_how_a_file_is_laid_out(run, scene, tmp_path, axes):
    points, seen = unpack_tracks(scene[0])
    swapped = points.swapaxes(0, 1)
    path, told = tmp_path / "clip.npz", ("--layout", "frames_first")
    if axes == "CoTracker":
        np.savez(path, tracks=swapped[None], visibility=seen.T[None])
        told = ()
    elif axes == "either":
        probability = np.where(seen.T, 0.9, 0.6)
        np.savez(path, tracks=swapped, visibility=probability)
        told = (*told, "--visible-above", 0.8)
    elif axes == "npy":
        path = tmp_path / "clip.npy"
        np.save(path, swapped)
    else:
        np.savez(path, points=points / [1280, 720])
        told = ("--image-size", 1280, 720)
    code, printed, errors = run("segment", path, *QUICK, *told)
    assert (code, errors) == (0, "")
    assert facts(printed)["tracks"] == "90"
    assert facts(printed)["frames"] == "5"


@pytest.mark.filterwarnings("always:all coordinates")
def test_segment_says_that_coordinates_are_no_pixels(run, scene, tmp_path):
    np.savez(tmp_path / "clip.npz", X=scene[0] / 1280)
    code, _, errors = run("segment", tmp_path / "clip.npz", *QUICK)
    assert code == 0
    assert errors.startswith("skmotionseg: warning: all coordinates in clip.npz")


# ------------------------------------------------------------------------------ bench


@pytest.fixture(scope="module")
def benchmarks(tmp_path_factory):
    """A folder that holds made-up sequences: two of KT3DMoSeg, one of Hopkins12."""
    data = tmp_path_factory.mktemp("data")
    for dataset in ("KT3DMoSeg", "Hopkins12"):
        (data / dataset).mkdir()
    for seed in range(2):
        X, y = make_rigid_motions(24 + seed, 3, 2, random_state=seed)
        write_struct(data / "KT3DMoSeg" / f"Seq{seed}_Tracks.mat", X, y)
    X, y = make_rigid_motions(36, 4, 2, missing=0, random_state=0)
    write_struct(data / "Hopkins12" / "small_Tracks.mat", X, y, visibility=False)
    return data


measured_once = pytest.mark.xdist_group("bench")  # by one of the workers


def bench(data, *options):
    return ["bench", "--data", str(data), "--jobs", "1", *options]


@pytest.fixture(scope="module")
def measured(benchmarks, tmp_path_factory):
    """Records and tables of two methods and two seeds on KT3DMoSeg."""
    out = tmp_path_factory.mktemp("out") / "records.json"
    options = ("--datasets", "KT3DMoSeg", "--seeds", "2", "--json", str(out))
    printed = io.StringIO()
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(printed):
        patch.setenv("COLUMNS", "200")
        methods = ("--methods", "kernel_addition", "default")
        assert main(bench(benchmarks, *options, *methods)) == 0
    return json.loads(out.read_text()), printed.getvalue()


@measured_once
def test_bench_writes_a_record_a_run(measured):
    records, _ = measured
    runs = [(r["dataset"], r["method"], r["sequence"], r["seed"]) for r in records]
    assert runs == [
        ("KT3DMoSeg", method, sequence, seed)
        for method in ("default", "kernel_addition")
        for sequence in ("Seq0", "Seq1")
        for seed in (0, 1)
    ]
    for record in records:
        assert set(record) == RECORD
        assert list(record["seconds"]) == [*STAGES, "total"]
        *stages, total = record["seconds"].values()
        assert total == pytest.approx(sum(stages))
        assert min(stages) > 0
        assert record["n_tracks"] == 24 + int(record["sequence"][-1])
        assert (record["n_frames"], record["n_motions"]) == (3, 2)


@measured_once
def test_bench_measures_the_segmenter(measured, benchmarks):
    records, _ = measured
    for record in records:
        of = record["method"], record["sequence"], record["seed"]
        if of != ("default", "Seq1", 1):
            continue
        path = benchmarks / "KT3DMoSeg" / f"{record['sequence']}_Tracks.mat"
        clip = load_tracks(path)
        known, unknown, from_2 = (
            MotionSegmenter(random_state=1, **params).fit(clip.data)
            for params in ({"n_motions": 2}, {}, {"min_motions": 2})
        )
        assert record["n_motions_found"] == unknown.n_motions_
        assert record["n_motions_found_from_2"] == from_2.n_motions_
        for name, segmenter in (
            ("error_known", known),
            ("error_unknown", unknown),
            ("error_unknown_from_2", from_2),
        ):
            error = misclassification_error(clip.target, segmenter.labels_)
            assert record[name] == error


def test_bench_takes_every_other_sequence(run, benchmarks, tmp_path):
    out = tmp_path / "records.json"
    options = ["--methods", "affine", "--seeds", "1", "--jobs", "1", "--every", "2"]
    code, printed, _ = run("bench", "--data", benchmarks, *options, "--json", out)
    assert code == 0
    names = [record["sequence"] for record in json.loads(out.read_text())]
    assert names == ["small", "Seq0"]
    assert "KT3DMoSeg: 1 sequence, 1 seed;" in printed


def bench_table(printed):
    """The cells of the table of errors, by method; a cell may take several lines."""
    cells, _ = printed.split("mean seconds")
    lines = [line.strip("│").split("│") for line in cells.splitlines()]
    table, method = {}, ""
    for name, *row in lines:
        if len(row) == 6:
            method = name.strip() or method
            parts = zip(table.get(method, [""] * 6), row, strict=True)
            table[method] = [f"{known} {new}".strip() for known, new in parts]
    return {method: [" ".join(c.split()) for c in row] for method, row in table.items()}


@measured_once
def test_bench_prints_means_over_sequences_and_seeds(measured):
    records, printed = measured
    assert "KT3DMoSeg: 2 sequences, 2 seeds" in printed
    for method, (known, *_) in bench_table(printed).items():
        errors = [r["error_known"] for r in records if r["method"] == method]
        assert known.startswith(f"{100 * np.mean(errors):.2f} ±")


@measured_once
def test_bench_prints_the_papers_figures(measured):
    _, printed = measured
    ours = bench_table(printed)
    assert set(ours) == {"kernel_addition", "default"}
    figures = ["8.31", "1.02", "10.21", "50.00", "7.51", "68.18"]
    for cell, paper in zip(ours["kernel_addition"], figures, strict=True):
        assert cell.endswith(f"({paper})")
    assert not any("(" in cell for cell in ours["default"])  # the paper has no such


def test_bench_names_the_methods_where_the_terminal_is_narrow(
    run, benchmarks, monkeypatch
):
    monkeypatch.setenv("COLUMNS", "80")
    options = ("--datasets", "KT3DMoSeg", "--seeds", 1, "--methods", "kernel_addition")
    _, printed, _ = run(*bench(benchmarks, *options))
    errors, seconds = printed.split("mean seconds")
    assert "kernel_addition" in errors
    assert "kernel_addition" in seconds
    assert "8.31" in errors


def test_bench_takes_what_it_finds_and_knows(run, benchmarks, monkeypatch):
    monkeypatch.setattr("skmotionseg._commands.runs.MotionSegmenter", LargestMotionOnly)
    _, printed, _ = run(*bench(benchmarks, "--seeds", 1))
    for dataset in ("Hopkins12: 1 sequence,", "KT3DMoSeg: 2 sequences"):
        assert dataset in printed
    errors, seconds = printed.split("mean seconds")
    for name in (*METHODS, *COMPARED, "default"):
        assert errors.count(f"│ {name} ") == 2  # one in the table of each dataset
        assert f"│ {name} " in seconds
    for dataset in ("Hopkins155", "MTPV62"):
        assert dataset not in printed


def test_bench_takes_pairs_of_images_which_the_paper_does_not(
    run, tmp_path, monkeypatch
):
    monkeypatch.setattr("skmotionseg._commands.runs.MotionSegmenter", LargestMotionOnly)
    X, y = two_images([20, 15], 10)
    data = np.insert(X, [2, 4], 1, axis=1).T
    (tmp_path / "AdelaideRMF").mkdir()
    path = tmp_path / "AdelaideRMF" / "book.mat"
    scipy.io.savemat(path, {"data": data, "label": y[None] + 1})
    _, printed, _ = run(*bench(tmp_path, "--seeds", 1, "--methods", "default"))
    assert "AdelaideRMF: 1 sequence," in printed


@pytest.fixture
def fbms(tmp_path):
    """Two small sequences of FBMS-59, one of each set: points of regions, each."""
    for part, seed in (("Trainingset", 0), ("Testset", 1)):
        X, y = make_rigid_motions(38, 4, 2, missing=0, random_state=seed)
        home = tmp_path / "FBMS59" / part / f"scene{seed}"
        masks = {}
        for frame in (0, 3):
            image = np.zeros((720, 1280))
            column, row = np.floor(X[:, 2 * frame : 2 * frame + 2].T + 0.5).astype(int)
            inside = (row >= 0) & (row < 720) & (column >= 0) & (column < 1280)
            image[row[inside], column[inside]] = y[inside]
            masks[frame] = (f"{frame:04}_gt.pgm", image)
        write_definition(home, [0, 1], 4, masks)
        write_tracks(home / "Tracks4.dat", X, y)
    return tmp_path


def test_bench_scores_regions(run, fbms, tmp_path):
    out = tmp_path / "records.json"
    methods = ("--methods", "homography", "affine", "--seeds", 2)
    bench = ("bench", "--data", fbms, "--jobs", 1, *methods, "--json", out)
    code, printed, errors = run(*bench, "--datasets", "FBMS59")
    assert code == 0
    assert errors.endswith("2 sequences, 2 seeds: 4 of 4 done\n")
    for part in ("Trainingset", "Testset"):
        title = rf"FBMS59 {part}: 1 sequence, 2 seeds; number of motions unknown"
        assert len(re.findall(title, " ".join(printed.split()))) == 1
    assert "mean seconds" not in printed  # with the number of motions known
    records = json.loads(out.read_text())
    assert len(records) == 8
    for record in records:
        clip = next(c for c in load_fbms59(fbms / "FBMS59") if c.set == record["set"])
        assert clip.name == record["sequence"]
        params = runs.METHODS[record["method"]]
        found = MotionSegmenter(random_state=record["seed"], **params).fit(clip.data)
        points = (clip.point_target, found.labels_[clip.point_track])
        given = {"sample_weight": clip.point_weight, "region_sizes": clip.region_sizes}
        scores = fbms_scores(*points, **given)
        assert tuple(record[name] for name in scores._fields) == pytest.approx(scores)
        assert record["visible"] == fbms_objects(*points, **given).visible == 1
    table, _ = printed.split("FBMS59 Testset")
    for name, column in (("density", 0), ("precision", 1), ("recall", 2)):
        figures = [
            100 * record[name]
            for record in records
            if record["set"] == "Trainingset" and record["method"] == "affine"
        ]
        row = next(line for line in table.splitlines() if "│ affine " in line)
        cells = row.strip("│").split("│")
        assert cells[column + 1].strip() == f"{np.mean(figures):.2f}"


def test_bench_prints_the_papers_scores_of_regions(run, fbms, monkeypatch):
    monkeypatch.setattr(
        "skmotionseg._commands.region_runs.MotionSegmenter", LargestMotionOnly
    )
    _, printed, _ = run("bench", "--data", fbms, "--seeds", 1, "--jobs", 1)
    for figure in (
        "0.89",
        "90.35",
        "73.57",
        "81.10",
        "0.90",
        "84.41",
        "72.87",
        "78.22",
    ):
        assert f"({figure})" in printed


def test_the_papers_methods_are_the_papers():
    """They choose the count as the paper does, or as what it compares with."""
    assert set(runs.METHODS) == {*METHODS, *COMPARED, "default"}
    for name in METHODS:
        segmenter = MotionSegmenter(**runs.METHODS[name])
        assert segmenter.selection == "ncre"
    for name in COMPARED:
        segmenter = MotionSegmenter(**runs.METHODS[name])
        assert name.endswith(segmenter.selection)
        assert (segmenter.models == ("homography",)) == name.startswith("homography")
    assert MotionSegmenter(**runs.METHODS["default"]).get_params() == (
        MotionSegmenter().get_params()
    )


# ----------------------------------------------------------------------------- errors


BENCH = "bench --seeds 1 --jobs 1 --methods affine --data"
ERRORS = {
    "segment nowhere.npz": "no track file at nowhere.npz",
    "segment {notes}": "track files end in .npz, .npy, .mat or .csv; got 'n",
    "segment {other}": "other.npz is not a track file: .*'points'",
    "segment {broken}": "broken.npz is not a track file",
    "segment {scene} --motions 999": "999 .* more than the .*90",
    "segment {scene} --out labels.txt": "end in .npz or .csv; got labels.txt",
    "segment {scene} --out {scene}": "--out and the input are the same: .*scene.npz",
    "segment {scene} --render a.png --report a.png": "--report and --render are the s",
    "segment {scene} --render motions.txt": "end in .* got motions.txt",
    "segment {scene} --out nowhere/labels.npz": "nowhere",
    "segment {scene} --render nowhere/motions.png": "nowhere",
    "segment {scene} --report report.txt": "end in .* got report.txt",
    "segment {scene} --report nowhere/report.png": "nowhere",
    "segment {long} --report report.png": (
        "--report is for clips of up to 100 frames; .*long.npy has 101$"
    ),
    "segment {scene} --max-frames 3": "--max-frames is for videos; .* is a file of tr",
    "segment {scene} --stride 2": "--stride is for videos",
    "segment {scene} --no-window": "--no-window is for videos",
    "segment {scene} --split-dir {scene}": "scene.npz is not a folder that could be wr",
    "segment {scene} --split-dir {long}": "long.npy is not a folder that could be wr",
    f"{BENCH} {{data}} --exponents 5 6": "--exponents is for --paper",
    "segment {scene} --split-dir nowhere/motions": "nowhere",
    "segment {named} --split-dir motions": "must be whole numbers .*; got 0.5",
    "segment {scene} --motions 3 --min-motions 2": "--min-motions is for --motions a",
    "segment {scene} --min-motions 3 --max-motions 2": "--min-motions must not exceed",
    "segment {scene} --min-motions 11": "--max-motions; got 11 and 10",
    "segment {scene} --models affine,affine": "models must differ",
    "segment . --models affine,affine": "models must differ",  # before it is tracked
    "segment {scene} --confidence": "--confidence is written with the labels",
    "segment {notes} --layout tracks_first": "track files end in",
    "segment . --layout tracks_first": "--layout is for track files; . is a video",
    "demo --out nowhere/demo.png": "nowhere",
    "demo --out demo.txt": "end in .* got demo.txt",
    f"{BENCH} nowhere": "none of the folders Hopkins155, .* DAVIS16 is in nowhere",
    "bench --paper --data {data}/KT3DMoSeg": (
        r"folders Hopkins155, .* is in .*KT3DMoSeg; is it --data .*\?"
    ),
    f"{BENCH} {{data}}/KT3DMoSeg": "folders Hopkins155, .*; is it --data",
    f"{BENCH} {{data}} --datasets MTPV62": "no folder .*MTPV62",
    f"{BENCH} {{data}} --json nowhere/records.json": "nowhere",
    f"{BENCH} {{data}} --json a --resume a": "--json and --resume are the same: a",
}


@pytest.mark.parametrize("command", ERRORS)
def test_errors_are_one_line_and_come_first(
    command, run, scene_file, benchmarks, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    paths = {
        "notes": tmp_path / "notes.txt",
        "other": tmp_path / "other.npz",
        "broken": tmp_path / "broken.npz",
        "long": tmp_path / "long.npy",
        "named": tmp_path / "named.csv",
        "scene": scene_file,
        "data": benchmarks,
    }
    paths["notes"].write_text("not tracks")
    np.savez(paths["other"], a=np.ones(3))
    paths["named"].write_text("id,x0,y0,x1,y1\n0.5,1,2,3,4\n1,9,9,9,9\n")
    np.save(paths["long"], np.arange(202.0) + 100 * np.arange(12.0)[:, None])
    paths["broken"].write_bytes(scene_file.read_bytes()[:1000])
    before = set(tmp_path.rglob("*"))
    code, printed, errors = run(*(part.format(**paths) for part in command.split()))
    assert code == 2
    assert errors.startswith("skmotionseg: ")
    assert errors.count("\n") == 1
    assert "Traceback" not in errors
    assert re.search(ERRORS[command], errors)
    assert printed.strip() == ""
    assert set(tmp_path.rglob("*")) == before


def test_an_interrupt_is_a_line_and_the_exit_code_of_shells(
    run, scene_file, tmp_path, monkeypatch
):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(MotionSegmenter, "fit", interrupted)
    code, _, errors = run("segment", scene_file, "--out", tmp_path / "labels.csv")
    assert code == 130
    assert errors == "skmotionseg: interrupted\n"
    assert list(tmp_path.iterdir()) == [scene_file]


@pytest.mark.parametrize(
    "arguments, words",
    [
        ([], "the following arguments are required: COMMAND"),
        (["colour"], "invalid choice: 'colour'"),
        (["segment"], "the following arguments are required: INPUT"),
        (["segment", "x.npz", "--motions", "0"], 'whole number, 1 or more, or "auto"'),
        (["segment", "x.npz", "--motions", "some"], "or \"auto\"; got 'some'"),
        (["segment", "x.npz", "--models", "flow"], "some of affine,homography,fund"),
        *(
            (
                ["segment", "x.npz", "--focal-length", given],
                f"expected a number above 0; got {given!r}",
            )
            for given in ("-5", "0", "inf", "nan", "far")
        ),
        *(
            (["segment", "x.npz", "--seed", given], "a whole number from 0 to 42949672")
            for given in ("-1", "4294967296", "some")
        ),
        *(
            (
                ["segment", "x.npz", "--visible-above", given],
                f"expected a number of 0 or more and less than 1; got {given!r}",
            )
            for given in ("-0.1", "1", "nan", "far")
        ),
        (["segment", "x.mp4", "--grid", "1"], "--grid: expected a whole number, 2 or"),
        (
            ["segment", "x.mp4", "--max-side", "10"],
            "--max-side: expected a whole number",
        ),
        (["segment", "x.npz", "--jobs", "0"], "or -1 for all processors; got '0'"),
        (["segment", "x.npz", "--selection", "best"], "invalid choice: 'best'"),
        (["bench", "--data", ".", "--methods", "best"], "invalid choice: 'best'"),
        (["bench", "--data", ".", "--datasets", "MNIST"], "invalid choice: 'MNIST'"),
        (
            ["bench", "--data", ".", "--seeds", "0"],
            "expected a whole number, 1 or",
        ),
        (["bench"], "the following arguments are required: --data"),
    ],
    ids=" ".join,
)
def test_wrong_usage(arguments, words, capsys):
    with pytest.raises(SystemExit) as stop:
        main(arguments)
    printed, errors = capsys.readouterr()
    assert stop.value.code == 2
    assert printed == ""
    assert words in errors


@pytest.mark.parametrize(
    "module, command", [("rich", "segment"), ("matplotlib", "demo")]
)
def test_a_missing_extra_is_named(
    module, command, run, scene_file, tmp_path, monkeypatch
):
    for name in list(sys.modules):
        if name.partition(".")[0] == module:
            monkeypatch.setitem(sys.modules, name, None)
    monkeypatch.setitem(sys.modules, module, None)
    arguments = [scene_file] if command == "segment" else ["--out", tmp_path / "d.png"]
    code, _, errors = run(command, *arguments)
    assert code == 2
    assert f"this needs {module}, which is not installed: pip install" in errors
    assert '"skmotionseg[cli]"' in errors


@pytest.mark.parametrize("command", [[], ["demo"], ["segment"], ["bench"]])
def test_help(command, capsys):
    with pytest.raises(SystemExit) as stop:
        main([*command, "--help"])
    assert stop.value.code == 0
    assert f"usage: {' '.join(['skmotionseg', *command])}" in capsys.readouterr().out


@pytest.mark.parametrize("is_terminal", [True, False])
def test_progress_is_a_bar_on_a_terminal_and_lines_in_a_file(is_terminal):
    console = Console(file=io.StringIO(), force_terminal=is_terminal, width=100)
    items = with_progress(iter("ab" * 20), 40, "counting", console)
    assert "".join(items) == "ab" * 20
    printed = console.file.getvalue()
    assert printed.count("of 40 done\n") == (0 if is_terminal else 10)
    assert ("100%" in printed) == is_terminal
    assert "counting" in printed


def test_version(capsys):
    with pytest.raises(SystemExit) as stop:
        main(["--version"])
    assert stop.value.code == 0
    assert capsys.readouterr().out == f"{__version__}\n"


def test_package_runs_as_the_command():
    command = [sys.executable, "-m", "skmotionseg", "--version"]
    printed = subprocess.run(command, capture_output=True, text=True, check=True)
    assert printed.stdout.strip() == __version__


def test_labels_carry_the_files_own_track_names(run, tmp_path, scene):
    points, seen = unpack_tracks(scene[0])
    rows = [
        f"{2000003 - 7 * track},{frame},{x},{y}"
        for track, (path, visible) in enumerate(zip(points, seen, strict=True))
        for frame, ((x, y), here) in enumerate(zip(path, visible, strict=True))
        if here
    ]
    file = tmp_path / "clip.csv"
    file.write_text("\n".join(["track,frame,x,y", *rows]))
    code, _, _ = run("segment", file, *BY_GRAPH, "--out", tmp_path / "out.csv")
    assert code == 0
    names = np.loadtxt(tmp_path / "out.csv", delimiter=",", skiprows=1)[:, 0]
    assert_array_equal(names, np.sort(2000003 - 7 * np.arange(len(points))))


@pytest.mark.parametrize("first", [10**15, 2**60])
def test_labels_carry_whole_names_digit_by_digit(run, tmp_path, scene, first):
    names = first + np.arange(len(scene[0]))
    file, out = tmp_path / "clip.npz", tmp_path / "out.csv"
    np.savez(file, X=scene[0], track_ids=names)
    assert run("segment", file, *BY_GRAPH, "--out", out)[0] == 0
    written = np.loadtxt(out, delimiter=",", skiprows=1, dtype=np.int64)
    assert_array_equal(written[:, 0], names)


@pytest.mark.parametrize(
    "ids, words",
    [([3, 4, 3], "each come once; got 3"), ([1, np.nan, 2], "one is missing")],
)
def test_names_that_tell_no_tracks_apart_are_refused_if_written(
    run, tmp_path, ids, words
):
    file, out = tmp_path / "clip.csv", tmp_path / "labels.csv"
    columns = np.column_stack([ids, np.arange(12.0).reshape(3, 4)])
    np.savetxt(file, columns, delimiter=",", header="track,x0,y0,x1,y1")
    code, _, errors = run("segment", file, "--out", out)
    assert code == 2
    assert words in errors
    assert not out.exists()


def test_labels_carry_names_that_are_not_whole(tmp_path):
    out, ids = tmp_path / "out.csv", np.array([0.5, 2.0])
    clip = Bunch(track_ids=ids, video={})
    label_files.write_labels(out, clip, np.array([1, -1]), np.array([0.75, 0.5]))
    assert out.read_text() == "track,label,probability\n0.5,1,0.750\n2,-1,0.500\n"
