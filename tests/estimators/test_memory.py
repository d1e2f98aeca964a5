"""How many tracks are fitted, and what memory that takes."""

from __future__ import annotations

import numpy as np
import pytest

from skmotionseg._segmenter import memory
from skmotionseg._segmenter.memory import number_of_landmarks


def test_frames_that_see_nothing_do_not_change_how_many_are_fitted():
    seen = np.random.default_rng(0).uniform(size=(4000, 10)) < 0.4
    longer = np.pad(seen, [(0, 0), (3, 5)])
    enough = number_of_landmarks("auto", seen, 3)
    assert 1000 < enough < 1500
    assert number_of_landmarks("auto", longer, 3) == enough


# ------------------------------------------------------------------------ the number


@pytest.mark.parametrize(
    ("n_tracks", "seen", "expected"),
    [
        (1500, 20, 1500),
        (1501, 20, 1000),
        (50_000, 20, 1000),
        (2250, 1, 2250),
        (2251, 1, 1500),
    ],
)
def test_few_tracks_are_all_fitted_and_many_by_landmarks(n_tracks, seen, expected):
    age = np.arange(20) - np.arange(n_tracks)[:, None]
    visibility = age % 20 < seen
    assert number_of_landmarks("auto", visibility, 3) == expected


def test_too_many_tracks_for_the_memory_are_an_error_before_any_work():
    with pytest.raises(MemoryError, match=r"takes about .* GiB .*n_landmarks='auto'"):
        number_of_landmarks(None, np.ones((10_000_000, 1), dtype=bool), 3)


def test_much_memory_is_announced(monkeypatch):
    monkeypatch.setattr(memory, "SMALL_BYTES", 10**6)
    with pytest.warns(UserWarning, match="takes about 0.0 GiB"):
        number_of_landmarks(None, np.ones((100, 3), dtype=bool), 3)


@pytest.mark.parametrize("content", [None, "MemTotal: 9 kB\n", "MemAvailable: much\n"])
def test_what_is_free_is_asked_of_the_system_in_two_ways(
    content, tmp_path, monkeypatch
):
    """Linux says it in a file; others count their pages, or do not say."""
    meminfo = tmp_path / "meminfo"
    if content is not None:
        meminfo.write_text(content)
    monkeypatch.setattr(
        memory, "open", lambda _, **kw: meminfo.open(**kw), raising=False
    )
    pages = {"SC_AVPHYS_PAGES": 1000, "SC_PAGE_SIZE": 4096}
    monkeypatch.setattr(memory.os, "sysconf", pages.__getitem__, raising=False)
    assert memory._free_bytes() == 4096000
    meminfo.write_text("MemTotal: 9 kB\nMemAvailable:   7 kB\n")
    assert memory._free_bytes() == 7168
    meminfo.unlink()
    monkeypatch.delattr(memory.os, "sysconf")
    assert memory._free_bytes() is None


def test_where_the_system_does_not_say_what_is_free_it_is_tried(monkeypatch):
    monkeypatch.setattr(memory, "_free_bytes", lambda: None)
    with pytest.warns(UserWarning):
        assert number_of_landmarks(None, np.ones((10**6, 1), dtype=bool), 3) == 10**6
