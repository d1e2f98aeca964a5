"""The benchmarks run; what they measure is not judged here."""

from __future__ import annotations

import json
import time

import numpy as np
import pytest
from scipy import optimize
from sklearn.utils import Bunch
from threadpoolctl import threadpool_limits

from benchmarks import (
    apartness,
    entering,
    floor,
    growth,
    imports,
    measuring,
    online_bench,
    peers,
    photographs,
    plain,
    reliability,
    rendered,
    report,
    runner,
    scenes,
    search_gap,
    sensitivity,
    static_scenes,
    table,
    two_view_peers,
    wrong_tracks,
)
from benchmarks.__main__ import main, sections_of_speed
from benchmarks.watching import rigid_searches
from skmotionseg import MotionSegmenter, unpack_tracks
from skmotionseg._core.geometry import description_length, epipolar
from skmotionseg._core.partition import cost
from skmotionseg._core.partition.rigid_search import Step
from skmotionseg.datasets import make_rigid_motions, make_scene
from skmotionseg.metrics import misclassification_error

TINY = {
    "n_tracks": 38,
    "n_fitted": 38,
    "n_new": 20,
    "n_frames": 3,
    "n_hypotheses": 20,
}
BENCHMARKS = {
    f"{b.kind.__name__}.{b.method}": b._replace(
        values=tuple(
            TINY.get(name, value)
            for name, value in zip(b.kind.param_names, b.values, strict=True)
        )
    )
    for b in runner.discover(quick=True)
}


@pytest.fixture(autouse=True)
def one_thread():
    """Test processes do not fight over cores."""
    with threadpool_limits(1):
        yield


@pytest.fixture(scope="module")
def clips():
    """So few frames that there is one window of them: what takes longest, once."""
    return [scenes.clip_like(38, 3, random_state=seed) for seed in range(2)]


def test_every_class_is_discovered():
    kinds = {name.partition(".")[0] for name in BENCHMARKS}
    assert kinds == {
        *("View", "Fusion", "Selection"),
        *("Segmenter", "Placing", "ManyTracks", "ManyFrames"),
    }


@pytest.mark.parametrize("name", BENCHMARKS)
def test_benchmark_sets_up_and_runs(name):
    benchmark = BENCHMARKS[name]
    benchmark.make_ready()(*benchmark.values)


def test_runner_gives_median_least_and_most():
    median, least, most = runner.run(BENCHMARKS["Fusion.time_fusion"], 3)["seconds"]
    assert 0 < least <= median <= most


def test_peak_memory_is_that_of_a_fresh_process():
    held = np.ones(2**25)
    row = runner.run(BENCHMARKS["View.peakmem_view"], 1)
    ours = measuring.peak_memory()
    assert 10e6 < row["peak"] < ours - held.nbytes / 2


def test_interleaved_calls_take_turns():
    seen = []
    calls = {name: lambda seed, name=name: seen.append((name, seed)) for name in "ab"}
    runs = measuring.interleave(calls, 2)
    assert seen == [(name, seed) for seed in (0, 0, 1) for name in "ab"]
    assert [len(each.seconds) for each in runs.values()] == [2, 2]
    assert [len(each.cpu_seconds) for each in runs.values()] == [2, 2]


def test_seconds_of_the_processor_are_those_of_work_alone():
    seconds, cpu_seconds, result = measuring.clock(time.sleep, 0.2)
    assert result is None
    assert cpu_seconds < 0.1 < seconds


def test_rows_tell_the_version_that_they_are_of():
    machine = "AMD, 2 cores; Python 3.11.7, NumPy 2.4.6 (blis 1.0), skmotionseg 0.1.0"
    assert report.version({"machine": machine}) == "0.1.0"
    assert report.version({}) == ""


@pytest.mark.parametrize("fusion", ["coreg", "kernel_addition"])
def test_plain_version_segments(scene, fusion):
    X, y = scene
    labels = plain.segment(X, [3], fusion=fusion)
    assert misclassification_error(y, labels) < 0.1


def test_long_scene_is_seen_as_promised():
    X, y = scenes.many_frames(200, 300, n_seen=20)
    seen = np.isfinite(X[:, ::2]).sum(axis=1)
    assert np.median(seen) == 20
    assert seen.max() == 200
    assert set(y) == {0, 1, 2}


def test_table_has_rows_of_sequences_and_of_sizes(monkeypatch, clips, capsys, tmp_path):
    monkeypatch.setattr(table, "_load", lambda source, data: clips[:1])
    monkeypatch.setattr(
        table, "in_fresh_process", lambda function, *arguments: function(*arguments)
    )
    path = tmp_path / "speed.json"
    rows = ["clips-coreg-known", "clips-plain-known", "tracks-*", "frames-*"]
    sizes = ["--tracks", "34", "38", "--frames", "4", "--tracks-of-frames", "38"]
    main(["--table", "--quick", "--rows", *rows, *sizes, "--json", str(path)])
    printed = capsys.readouterr().out
    record = {row["row"]: row for row in json.loads(path.read_text())["table"]}
    assert list(record) == [*rows[:2], "tracks-34", "tracks-38", "frames-4"]
    assert all(row in printed for row in record)
    assert record["clips-plain-known"]["plain_ratio"] == 1
    assert record["clips-coreg-known"]["plain_ratio"] > 0
    assert record["tracks-38"]["cpu_growth"] > 0
    assert all(row["cpu_seconds"] > 0 for row in record.values())


def test_growth_is_drawn_of_two_sizes_or_more(tmp_path):
    rows = [
        {
            "n_tracks": n,
            "n_frames": n,
            "cpu_seconds": n,
            "peak": n,
            "row": f"{s}-{n}",
        }
        for s in growth.SCENES
        for n in (10, 20)
    ]
    growth.draw_growth(rows, tmp_path / "growth.png")
    assert (tmp_path / "growth.png").stat().st_size > 0
    with pytest.raises(ValueError, match=r"growth needs two rows frames-\* or more"):
        growth.draw_growth(rows[:3], tmp_path / "growth.png")


def test_dense_tracks_are_judged_where_they_have_labels(clips):
    clip = clips[0]
    clip.dense_data, clip.dense_index = np.vstack([clip.data, clip.data]), np.arange(38)
    (row, thinned) = table._sequence_rows(
        "dense", ["default-known", "thinned-known"], [clip], 1, None
    )
    assert (row["n_tracks"], thinned["n_tracks"]) == (76, 38)


def test_right_labels_are_those_that_the_best_assignment_confirms():
    target = np.array([1, 1, 1, 0, 0, -1, 0])
    labels = np.array([0, 0, 2, 1, 1, 1, -1])
    right = reliability.right_labels(target, labels)
    assert right.tolist() == [True, True, False, True, True, False, False]


def test_labels_are_counted_by_their_confidence():
    confidence = np.array([0.2, 0.92, 0.93, 1.0])
    rows = reliability.rows_of(confidence, np.array([False, True, False, True]))
    assert [row["row"] for row in rows] == ["0 to 0.5", "0.9 to 0.95", "0.99 to 1"]
    assert [row["right"] for row in rows] == [0, 50, 100]
    assert rows[1]["confidence"] == pytest.approx(92.5)


def test_reliability_of_sequences_is_measured_and_drawn(clips, tmp_path):
    rows = reliability.measure([("clips", clip) for clip in clips], 1, None)
    n_labels = sum((clip.target >= 0).sum() for clip in clips)
    assert 0.5 * n_labels < sum(row["n_labels"] for row in rows) <= n_labels
    reliability.draw(rows, tmp_path / "diagram.png")
    assert (tmp_path / "diagram.png").read_bytes().startswith(b"\x89PNG")


def test_imports_are_timed():
    assert (imports.import_seconds(1) > 0).all()


def test_floor_is_below_our_time(monkeypatch, clips):
    monkeypatch.setattr(floor, "COPIED", 1 << 22)
    rows = floor.make_floor(clips[:1], repeats=1, n_threads=2)
    assert [row["n_threads"] for row in rows] == [1, 1, 1, 1, 2]
    assert all(row["floor"] == row["product"] + row["memory"] > 0 for row in rows)


def test_peers_that_are_missing_are_named_and_not_guessed(monkeypatch):
    def missing():
        raise ModuleNotFoundError("No module named 'mvlearn'", name="mvlearn")

    name = "mvlearn MultiviewCoRegSpectralClustering"
    monkeypatch.setitem(peers.METHODS, name, (missing, "coreg"))
    clip = scenes.clip_like(38, 5, random_state=0)
    rows = {row["row"]: row for row in peers.make_peers([clip], ["*"], 1)}
    assert list(rows) == list(peers.METHODS)
    problem = "not installed: pip install --no-deps mvlearn"
    assert rows[name] == {"row": name, "problem": problem}
    assert problem in report.as_table(rows.values(), peers.COLUMNS)
    assert rows["ours, coreg"]["ratio"] == 1
    assert rows["textbook, coreg"]["ratio"] > 0


def test_sequential_magsac_takes_one_motion_after_the_other():
    pytest.importorskip("cv2")
    pair = make_scene("two_images", n_tracks=300, n_motions=2, random_state=2)
    points = unpack_tracks(pair.data)[0]
    labels = two_view_peers.sequential_magsac(points, 2, 1.0, 0)
    assert set(labels) == {-1, 0, 1}
    assert misclassification_error(pair.target, labels) < 0.5
    assert (labels[pair.target < 0] == -1).mean() > (labels == -1).mean()
    assert (two_view_peers.sequential_magsac(points[:5], 2, 1.0, 0) == -1).all()


def test_mismatches_are_a_group_that_peers_must_find():
    pair = Bunch(target=np.array([0, 0, 1, 1, -1, -1]))
    assert two_view_peers._error(pair, pair.target) == 0
    one_kept = np.array([0, 0, 1, 1, 1, -1])
    assert two_view_peers._error(pair, one_kept) == pytest.approx(1 / 6)


def test_photographs_are_judged_by_the_tracks_that_are_given_a_motion():
    table = Bunch(target=np.array([0, 0, 1, 1, -1, -1, -1, -1]))
    given, error, rejected = photographs.judge(
        table, np.array([1, 1, 0, -1, -1, -1, -1, 0])
    )
    assert (given, error, rejected) == (75, 0, 75)
    _, error, _ = photographs.judge(table, np.array([0, 0, 0, 1, -1, -1, -1, -1]))
    assert error == 25


def test_photographs_are_measured_beside_what_could_be_explained(monkeypatch, tmp_path):
    """Of tracks that have a label and no motion, few are explained."""
    pytest.importorskip("cv2")
    scene = make_scene(
        "photographs", n_tracks=60, n_frames=3, outliers=0.2, random_state=0
    )
    labels = np.where(scene.target < 0, 0, scene.target)
    labels[np.flatnonzero(scene.target < 0)[:4]] = -1
    table = Bunch(name="table", data=scene.data, target=labels)
    near, of_motion = photographs.explained(table), scene.target[labels >= 0] >= 0
    assert near[of_motion].mean() > 2 * near[~of_motion].mean()
    monkeypatch.setattr(photographs, "load_arrigoni", lambda folder: [table])
    record = tmp_path / "accuracy.json"
    photographs.main(["--data", "here", "--seeds", "1", "--json", str(record)])
    (row,) = json.loads(record.read_text())["photographs"]
    assert (row["row"], row["n_tracks"]) == ("table", 60)
    assert row["explained"] == pytest.approx(100 * near.mean())
    assert len(row["found"]) == len(row["error_known"]) == 1
    cells = [cell(row) for cell in photographs.COLUMNS.values()]
    assert cells[4] == f"{row['error_known'][0]:.1f} ± 0.0"


def partition(*evidence, by_links=None, energy=0.0):
    links = np.full(len(evidence), np.nan) if by_links is None else by_links
    step = Step(energy, np.array([0, 1]), [])
    return apartness.Partition(step, np.array(evidence, dtype=float), np.array(links))


def test_a_number_is_decided_in_the_best_partition_by_those_least_apart():
    """What is surer costs less, and what is likelier one is the last."""
    weights = np.array([1.0, 0, 0, 0, 0])
    nearest, near, far = [1, 0, 0, 0, 0], [3, 2, 3, 4, 5], [4, 0, 0, 0, 0]
    one, other = partition(far, near), partition(far, far)
    for partitions in ([one, other], [other, one]):
        log_odds, known = apartness.decisive(partitions, weights, -2.0)
        assert log_odds == 2
        np.testing.assert_array_equal(known, far)
    dear = partition(far, far, energy=10.0)
    log_odds, known = apartness.decisive([one, dear], weights, -2.0)
    assert log_odds == 1
    np.testing.assert_array_equal(known, near)
    cheap = partition(far, nearest, energy=-10.0)
    assert apartness.decisive([cheap], weights, -2.0)[0] == -1
    assert apartness.decisive([cheap, dear], weights, -2.0)[0] == 2
    by_links = partition(far, far, by_links=[np.nan, -1.0])
    assert apartness.decisive([by_links], weights, -2.0) == (-1, None)
    assert apartness.decisive([], weights, -2.0) == (np.inf, None)


def test_weights_are_learnt_from_the_groups_that_decide(capsys):
    """One more motion is a part of another; where, no other pair of groups tells."""
    rng = np.random.RandomState(0)
    evidence = rng.normal(2, 1, size=(60, 4, len(apartness.NAMES)))
    evidence[:, 3] -= 4
    decisions = [([partition(*four[:1])], [partition(*four[1:])]) for four in evidence]
    decisions += [([], each[1]) for each in decisions[:10]]  # of one motion
    coefficients, prior = apartness.regression(decisions)
    assert (coefficients > 0).all()
    apartness.print_errors("these", decisions, coefficients, prior)
    assert "70; right 100.0%" in capsys.readouterr().out


def test_what_decides_is_taken_from_searches():
    scene = make_scene("table", n_tracks=40, n_frames=6, outliers=0, random_state=4)
    as_many, more = apartness.decisions_of(scene.data, scene.n_motions)
    assert as_many and more
    n_pairs = [n * (n - 1) // 2 for n in (scene.n_motions, scene.n_motions + 1)]
    for partitions, most in zip((as_many, more), n_pairs, strict=True):
        for each in partitions:
            assert 1 <= len(each.evidence) == len(each.by_links) <= most
            assert np.isfinite(each.evidence).all()
    assert apartness.partitions_of(scene.data, 1) == []


def test_the_search_gap_of_a_scene_that_is_solved_is_closed():
    scene = make_scene("table", n_tracks=40, n_frames=8, outliers=0, random_state=5)
    more, error = search_gap.gap(Bunch(seed=0, **scene))
    assert more <= search_gap.TOLERANCE
    assert error < 0.05
    few = make_scene("table", n_tracks=11, n_frames=3, n_motions=1, random_state=0)
    assert search_gap.gap(Bunch(seed=0, **few)) is None


def test_the_search_gap_between_two_images_is_that_of_the_labels():
    scene = make_scene("two_images", n_tracks=120, n_motions=2, random_state=1)
    more, error = search_gap.gap(Bunch(seed=0, **scene))
    assert more <= search_gap.TOLERANCE
    assert error < 0.05
    wrong = scene.target[::-1].copy()
    scene.target = wrong
    less, error = search_gap.gap(Bunch(seed=0, **scene))
    assert error > 0.05
    assert less <= more  # what is no motion of the images costs more than what is


def test_of_a_search_with_and_one_without_outliers_the_last_is_looked_at():
    scene = make_scene(
        "planar", n_tracks=50, n_frames=5, n_motions=2, outliers=0.3, random_state=0
    )
    with rigid_searches() as searches:
        more, _ = search_gap.gap(Bunch(seed=0, **scene))
    first, last = (len(search.degrees) for search, _ in searches)
    assert last < first
    assert more <= search_gap.TOLERANCE
    assert apartness.partitions_of(scene.data, 2)


def test_search_gaps_are_summed_up():
    row = search_gap.row_of("all", [(0, 0.01), (-0.2, 0.03), (0.1, 0.4)])
    assert row["n_scenes"] == 3
    assert row["closed"] == pytest.approx(200 / 3)
    assert (row["error_closed"], row["error_open"]) == pytest.approx((2, 40))
    nothing = search_gap.row_of("none", [])
    assert nothing["n_scenes"] == 0 and nothing["closed"] is None


def test_static_scenes_are_judged(monkeypatch):
    X, surfaces = static_scenes.street(45, n_moving=15)
    assert set(surfaces) == {0, 1, 2, static_scenes.MOVING}
    right, found, error = static_scenes.judged(X, (surfaces == 3).astype(int))
    assert right and found == 2 and error < 0.05
    # As one motion it is wrong, and so is the rest as another.
    right, _, error = static_scenes.judged(X, np.zeros(len(X), dtype=int))
    assert not right and error > 0.05

    def make(n_moving, seed):
        X, surfaces = static_scenes.street(45, n_moving=n_moving // 2, seed=seed)
        return X, (surfaces == static_scenes.MOVING).astype(int)

    monkeypatch.setattr(static_scenes, "scenes", lambda: {"small": make})
    (row,) = static_scenes.measure(2)
    assert row["n_scenes"] == row["static_right"] == 2
    assert row["static_found"] == 1 and row["static_error"] < 5


def test_wrong_tracks_are_found_beside_right_ones(monkeypatch, capsys, tmp_path):
    X, y = make_rigid_motions(n_tracks=48, n_frames=8, n_motions=2, random_state=0)
    clip = Bunch(name="clip", data=X, target=y)
    more, labels = wrong_tracks.with_walks(X, y, 0.2, seed=0)
    assert len(more) == 60 and (labels[48:] == -1).all()
    np.testing.assert_array_equal(more[:48], X)
    monkeypatch.setattr(wrong_tracks, "LOADERS", {"few": lambda folder: [clip]})
    record = tmp_path / "accuracy.json"
    arguments = ["--data", "here", "--shares", "0", "0.3", "--seeds", "0"]
    wrong_tracks.main([*arguments, "--json", str(record)])
    right, wrong = json.loads(record.read_text())["wrong_tracks"]
    assert wrong["row"] == "few, 30% wrong tracks"
    assert right["found"] is None and wrong["found"] > 50
    assert max(right["error"], wrong["error"]) < 5
    assert wrong["right"] == 100
    assert "few, 30% wrong tracks" in capsys.readouterr().out


def test_page_is_rewritten_between_its_marks(tmp_path):
    record, page = tmp_path / "speed.json", tmp_path / "speed.md"
    report.save(record, "table", [{"row": "clips-coreg-known", "error": 1.0}])
    report.save(record, "table", [{"row": "clips-coreg-known", "error": 2.0}])
    page.write_text(
        "before\n<!-- begin sequences -->\nold\n<!-- end sequences -->\nafter\n"
        "<!-- begin growth -->\n<!-- end growth -->\n"
    )
    report.write_page(page, record, sections_of_speed(page))
    written = page.read_text()
    assert written.startswith("before\n") and "\nafter\n" in written
    assert "old" not in written and "1.00" not in written
    assert "| clips-coreg-known |    2.00 |" in written
    assert "no picture yet: growth needs two rows" in written
    with pytest.raises(ValueError, match="has a section 'sequences'; known are"):
        report.write_page(page, record, {})


# ------------------------------------------------------------------------- sensitivity


@pytest.mark.parametrize("constant", sensitivity.CONSTANTS, ids=lambda c: c.name)
def test_each_constant_is_halved_and_doubled_for_a_while(constant):
    _, halved, doubled = sensitivity.settings_of([constant])
    before = constant.value
    for setting in (halved, doubled):
        assert not np.array_equal(setting.value, before)
        with sensitivity.in_force(setting):
            if constant.module is None:
                ours = MotionSegmenter(**setting.parameters)
                holder = ours.kernel if constant.of_kernel else ours
                given = getattr(holder, constant.name)
            else:
                given = constant.value
            assert np.array_equal(given, setting.value)
    assert constant.value is before


def test_a_constant_changes_wherever_it_was_imported(monkeypatch):
    monkeypatch.setattr(
        description_length, "CUT_WEIGHT", cost.CUT_WEIGHT, raising=False
    )
    constant = sensitivity.Constant("_core.partition.cost", "CUT_WEIGHT")
    with sensitivity.in_force(sensitivity.Setting("", constant, 7.0)):
        assert cost.CUT_WEIGHT == description_length.CUT_WEIGHT == 7


def test_values_are_scaled_in_kind():
    assert sensitivity.scaled(3, 0.5) == 1
    assert sensitivity.scaled(1, 0.5) == 1
    assert sensitivity.scaled((4.0, 8.0), 2) == (8.0, 16.0)
    assert sensitivity.last_scaled((1, 4), 0.5) == (1, 2)


def _settings():
    """As it is; no motion is worth its while; other lengths."""
    prior = sensitivity.Constant("_core.partition.apartness", "PRIOR")
    levels = sensitivity.Constant("_core.geometry.description_length", "NOISE_LEVELS")
    return [
        sensitivity.AS_IT_IS,
        sensitivity.Setting("no gain is enough", prior, -1e9),
        sensitivity.Setting("noise", levels, 2 * levels.value),
    ]


def test_other_processes_see_the_value_too():
    X, y = make_rigid_motions(40, 4, 2, random_state=0)
    sequences = [("KT3DMoSeg", Bunch(data=X, target=y, name="scene"))]
    settings = _settings()[:2]
    rows = sensitivity.make_sensitivity(sequences, settings, seeds=1, n_jobs=2)
    right = {row["row"]: row["KT3DMoSeg"]["count_right"] for row in rows}
    assert right["as it is"] == 100
    assert right["no gain is enough"] == 0


def test_fits_that_are_known_are_those_of_the_setting():
    clip = scenes.clip_like(30, 3, random_state=0)
    together = sensitivity.measure_sequence("KT3DMoSeg", clip, 0, _settings())
    for setting, row in zip(_settings(), together, strict=True):
        (alone,) = sensitivity.measure_sequence("KT3DMoSeg", clip, 0, [setting])
        assert row.pop("seconds") > 0
        alone.pop("seconds")
        assert row == alone


def test_a_fit_is_known_only_if_nothing_has_changed(clips):
    clip = description_length.clip_geometry(*unpack_tracks(clips[0].data))
    x, y, seen = clip.of_group(np.arange(38))
    fit = epipolar.robust_fits
    scale = sensitivity.Constant("_core.geometry.epipolar", "ROBUST_SCALE")
    doubled = sensitivity.Setting("", scale, 2 * scale.value)
    arguments = [
        (x, y, seen),
        (y, x, seen),
        (x, y, seen, epipolar.cheapest_rank_two),
        (x, y, seen, epipolar.nearest_rank_two, seen & (np.arange(seen.shape[1]) < 20)),
    ]
    known = sensitivity.KnownFits()
    with known.in_use():
        assert description_length.robust_fits is epipolar.robust_fits is not fit
        for setting in (sensitivity.AS_IT_IS, doubled) * 2:
            with sensitivity.in_force(setting):
                for each in arguments:
                    found = zip(epipolar.robust_fits(*each), fit(*each), strict=True)
                    assert all(np.array_equal(*pair) for pair in found)
    assert len(known._known) == 8
    assert known.saved > 0
    assert epipolar.robust_fits is description_length.robust_fits is fit


def test_halves_of_a_benchmark_share_no_sequence(monkeypatch):
    names = [f"sequence {i:02}" for i in range(19)]
    monkeypatch.setitem(sensitivity.LOADERS, "KT3DMoSeg", lambda _: names)
    monkeypatch.setitem(sensitivity.LOADERS, "Hopkins155", lambda _: names)

    def read(half):
        return sensitivity.read_sequences(".", ["KT3DMoSeg", "Hopkins155"], half)

    first, second = read("first"), read("second")
    assert not set(first) & set(second)
    assert set(first) | set(second) == set(read("both"))
    assert ("KT3DMoSeg", names[0]) in first
    assert len(read("both")) == 19 + 3 + 3


def test_sensitivity_is_measured_and_written(monkeypatch, clips, capsys, tmp_path):
    page = tmp_path / "sensitivity.md"
    page.write_text("<!-- begin first -->\nold\n<!-- end first -->\n")
    monkeypatch.setattr(sensitivity, "PAGE", page)
    monkeypatch.setitem(sensitivity.LOADERS, "KT3DMoSeg", lambda _: clips)
    (tmp_path / "KT3DMoSeg").mkdir()
    options = ["--data", str(tmp_path), "--half", "first", "--jobs", "1", "--write"]
    sensitivity.main([*options, "--rows", "CUT_*", "--seeds", "2"])
    assert "CUT_WEIGHT, halved" in capsys.readouterr().out
    rows = json.loads((tmp_path / "sensitivity.json").read_text())["first"]
    names = ["as it is", "± over seeds", "CUT_WEIGHT, halved", "CUT_WEIGHT, doubled"]
    assert [row["row"] for row in rows] == names
    assert all(row["KT3DMoSeg"]["n_sequences"] == 1 for row in rows)
    written = page.read_text()
    assert "old" not in written
    assert all(f"| {name} " in written for name in names)
    sensitivity.main(["--write"])
    assert page.read_text() == written


def test_sensitivity_needs_data_or_a_record(capsys, tmp_path):
    with pytest.raises(SystemExit):
        sensitivity.main([])
    assert "give --data, or --write alone" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        sensitivity.main(["--data", str(tmp_path)])
    assert "none of KT3DMoSeg" in capsys.readouterr().err


def test_streams_are_measured_beside_whole_clips(monkeypatch, capsys, tmp_path):
    X, y = make_rigid_motions(45, 11, 2, random_state=0)
    clip = Bunch(name="clip", data=X, target=y)
    monkeypatch.setitem(online_bench.LOADERS, "MTPV62", lambda folder: [clip])
    record = tmp_path / "accuracy.json"
    arguments = ["--data", "here", "--datasets", "MTPV62", "--seeds", "0"]
    online_bench.main([*arguments, "--json", str(record)])
    of_clip, *_, row, _, _ = capsys.readouterr().out.splitlines()
    stream, whole = map(float, of_clip.split()[1:])
    cells = [cell.strip() for cell in row.strip("|").split("|")]
    assert cells == ["MTPV62", f"{stream:.1f}", f"{stream:.1f}", f"{whole:.1f}"]
    assert max(stream, whole) < 20
    (stored,) = json.loads(record.read_text())["streams"]
    assert (stored["row"], stored["n_sequences"]) == ("MTPV62", 1)
    errors = [*stored["stream"], *stored["whole"]]
    np.testing.assert_allclose(errors, [stream, whole], atol=0.005)  # as printed


def test_errors_of_streams_are_means_over_clips_and_seeds(monkeypatch):
    def errors(X, y, seed):
        return [0.01 * X + 0.02 * seed, 0.1]

    monkeypatch.setattr(online_bench, "errors_at_last_frame", errors)
    clips = [Bunch(name="", data=n, target=None) for n in (1, 3)]
    row = online_bench.measure("KT3DMoSeg", clips, [0, 1])
    np.testing.assert_allclose(row["stream"], [2, 4])
    np.testing.assert_allclose(row["whole"], [10, 10])
    cells = [cell(row) for cell in online_bench.COLUMNS.values()]
    assert cells == ["KT3DMoSeg", "3.0", "2.0, 4.0", "10.0"]


class Told:
    """A stream in which what enters has the label of thing 2 for four frames."""

    def __init__(self, random_state):
        self.scene, self.frame = entering.entering_scene("dolly", random_state), -1

    def update(self, points, ids):
        self.frame += 1
        target = self.scene.target[ids]
        return np.where((target == 3) & (self.frame < entering.ENTERS + 4), 2, target)


def test_labels_of_what_enters_a_stream_are_judged(monkeypatch, capsys):
    scene = entering.entering_scene("dolly", 0)
    assert np.isin(np.arange(4), scene.target).all()
    entered = scene.seen[scene.target == 3].sum(axis=0)
    assert (entered[: entering.ENTERS] == 0).all()
    assert entered[entering.ENTERS] == entering.N_MOVING
    assert ((scene.points > -1) & (scene.points < [1281, 721]))[scene.seen].all()
    monkeypatch.setattr(entering, "OnlineMotionSegmenter", Told)
    entering.main(["--seeds", "0", "--cameras", "dolly"])
    words = capsys.readouterr().out.split()
    assert words[:4] == ["dolly", "0", "first", "4"]
    assert float(words[-1]) == 1
    monkeypatch.setattr(entering, "JUDGED", 0)
    assert 0.8 < entering.measure("dolly", 0)["own"] < 1
    monkeypatch.setattr(entering, "_most", lambda labels: 0)  # whatever it is
    assert entering.measure("dolly", 0) == {"first": None, "own": 0}


def follow(layer, n_frames):
    """Where the point of a layer that is at (100, 80) in frame 0 is later."""
    wanted = layer.places(np.array([100.0, 80]), 0)
    found = [
        optimize.root(lambda at, n=n: layer.places(at, n) - wanted, [100.0, 80]).x
        for n in range(n_frames)
    ]
    np.testing.assert_allclose(found[0], [100, 80], atol=1e-6)
    return np.array(found)


def test_masks_of_a_rendered_video_are_scored(monkeypatch, capsys):
    pytest.importorskip("cv2")
    for name, value in (("N_FRAMES", 5), ("HEIGHT", 120), ("WIDTH", 214)):
        monkeypatch.setattr(rendered, name, value)
    video = rendered.render_video(0)
    assert len(video.frames) == len(video.masks) == 5
    assert video.frames[0].shape == (*video.masks[0].shape, 3)
    tracks = np.array([follow(layer, 5) for layer in video.layers])
    tracks[:, 2] = np.nan
    labels = rendered.true_labels(tracks.reshape(len(tracks), -1), video.layers)
    assert labels.tolist() == list(range(len(video.layers))) and len(labels) > 1
    rendered.main(["--videos", "1"])
    words = capsys.readouterr().out.split()
    scores = [float(words[words.index(name) + 1]) for name in ("J", "recall")]
    assert min(scores) > 50 and max(scores) <= 100
    monkeypatch.setattr(rendered, "LEAST_PIXELS", np.inf)
    assert rendered.measure(0) is None
