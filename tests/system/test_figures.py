"""Figures on pages are those that were measured and stored."""

from __future__ import annotations

import json
import re
import shutil

import pytest

from benchmarks import figures, long_bench, report

SCORES = {"seconds": {"total": 1.0}, "n_tracks": 9, "n_frames": 3}


def test_pages_say_what_was_measured():
    differ = figures.differences()
    assert differ == {}, "python -m benchmarks.figures rewrites them"


@pytest.fixture
def copies(tmp_path, monkeypatch):
    """Pages and stored figures, where they may be changed."""
    (tmp_path / "docs").mkdir()
    for name in ("README.md", *(f"docs/{path.name}" for path in DOCS)):
        shutil.copy(figures.ROOT / name, tmp_path / name)
    monkeypatch.setattr(figures, "ROOT", tmp_path)
    stored = {name: tmp_path / "docs" / f"{name}.json" for name in figures.RECORDS}
    monkeypatch.setattr(figures, "RECORDS", stored)
    return tmp_path


DOCS = [
    path
    for path in (figures.ROOT / "docs").iterdir()
    if path.suffix in (".md", ".json")
]


def test_a_figure_that_was_typed_is_found_and_put_right(copies, capsys):
    page = copies / "README.md"
    text = page.read_text()
    page.write_text(text.replace("8.85", "1.85"))
    assert figures.main(["--check"])
    assert "README.md, line " in capsys.readouterr().out
    assert figures.main([]) == 0
    assert page.read_text() == text
    assert not figures.main(["--check"])


def records(method, found, error):
    return [
        {
            **SCORES,
            "dataset": "Hopkins12",
            "method": method,
            "sequence": sequence,
            "seed": seed,
            "n_motions": 2,
            "n_motions_found": found,
            "n_motions_found_from_2": found,
            "error_known": error,
            "error_unknown": error,
            "error_unknown_from_2": error,
        }
        for sequence in "abc"
        for seed in range(2)
    ]


def test_new_measurements_reach_the_pages(copies, tmp_path):
    file = tmp_path / "records.json"
    file.write_text(json.dumps(records("default", 2, 0.125)))
    assert figures.main(["--bench", str(file)]) == 0
    assert "12.50 ± 0.00 (2 seeds)" in (copies / "docs" / "results.md").read_text()
    assert "12.50 / 100" in (copies / "README.md").read_text()
    accuracy = json.loads((copies / "docs" / "accuracy.json").read_text())
    rows = {row["row"]: row for row in accuracy["bench"]}
    assert rows["Hopkins12 default"]["halves"] == [[12.5, 12.5, 100]] * 2
    names = {row["row"]: row["names"] for row in accuracy["sequences"]}
    assert names["Hopkins12"] == ["a", "b", "c"]


def test_the_papers_protocol_reaches_the_pages(copies, tmp_path):
    run = {"dataset": "Hopkins12", "sequence": "a", "seed": 0, "n_motions": 2}
    found = {"found_from_1": 1, "found_from_2": 2, "error_from_1": 0.5}
    errors = {"error_known": 0.25, "error_from_2": 0.125}
    record = {**run, "method": "coreg", "exponent": 9, **found, **errors}
    file = tmp_path / "records.json"
    file.write_text(json.dumps([record]))
    assert figures.main(["--paper", str(file)]) == 0
    cells = (
        "co-regularisation",
        *("25.00 (25.00) [9]", "0.06 (0.00)"),  # ours, and the paper's
        *("50.00 / 0 [9]", "5.91 / 83"),
        *("12.50 / 100 [9]", "2.26 / 92"),
    )
    row = f"| {' | '.join(cells)} |"
    assert row in (copies / "docs" / "results.md").read_text()


def test_rows_of_long_videos_reach_the_page(copies):
    def row(seed, error):
        shared = {"how": "online", "n_frames": 400, "found": 4, "peak": 2**25}
        times = {"seconds": 20.0, "median": 0.04, "late": 0.0625 * seed}
        return {
            **shared,
            **times,
            "seed": seed,
            "error": error,
            "switches": 0.5,
            "state": 2**17,
        }

    kept = long_bench.stored([row(1, 0.125), row(3, 0.375)])
    report.save(copies / "docs" / "long_videos.json", "long", [kept])
    assert figures.main([]) == 0
    page = (copies / "docs" / "results.md").read_text()
    line = next(
        line
        for line in page.splitlines()
        if "OnlineMotionSegmenter()`" in line and " 400 " in line
    )
    cells = [cell.strip() for cell in line.strip("|").split("|")]
    assert cells[1:5] == ["400", "2", "25.00 (12.50-37.50)", "4, 4"]
    assert cells[5:7] == ["50", "125 (62-188)"]
    assert cells[-3:] == ["0.50 (0.50-0.50)", "128 (128-128)", "32"]


def test_rows_of_streams_reach_the_page(copies):
    row = {"row": "MTPV62", "n_sequences": 6, "stream": [1.25, 3.75], "whole": [0, 1]}
    report.save(copies / "docs" / "accuracy.json", "streams", [row])
    assert figures.main([]) == 0
    page = (copies / "docs" / "results.md").read_text()
    (line,) = re.findall(r"^\| MTPV62 +\|(.*)\|$", page, flags=re.MULTILINE)
    cells = [cell.strip() for cell in line.split("|")]
    assert cells == ["2.5", "1.2, 3.8", "0.5"]
