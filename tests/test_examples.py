"""The examples run as a user runs them, warnings being errors."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = sorted((Path(__file__).parents[1] / "examples").glob("*.py"))


def run(path, *arguments):
    command = [sys.executable, "-W", "error", str(path), *arguments]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
    assert result.stderr == ""
    return result.stdout


def table_after(title, printed):
    """The first table of that title: its header, and its cells by the value swept."""
    _, *lines = printed[printed.index(title) :].splitlines()
    header, *rows = lines[: lines.index("")] if "" in lines else lines
    cells = [re.split(r"\s{2,}", row.strip()) for row in rows]
    return header.split(), {row[0]: row[1:] for row in cells if len(row) == 4}


@pytest.fixture(scope="module")
def sweep():
    (path,) = (path for path in EXAMPLES if path.stem == "sweep")
    return run(path, "--quick")


@pytest.mark.parametrize("title", ["lambda, ", "gamma, ", "delta, "])
def test_sweep_prints_each_parameter_by_model_subset(sweep, title):
    header, rows = table_after(title, sweep)
    assert header == ["A+H", "H+F", "A+H+F"]
    assert len(rows) == 2
    assert all(cell.endswith("%") for row in rows.values() for cell in row)


@pytest.mark.parametrize("title", ["lambda, ", "gamma, ", "delta, "])
def test_both_ways_to_sweep_give_the_same_numbers(sweep, title):
    _, by_pipeline, by_segmenter = re.split(r"^[12]\. .*$", sweep, flags=re.M)
    assert table_after(title, by_pipeline) == table_after(title, by_segmenter)


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
