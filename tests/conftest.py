"""What several test files share: scenes, real sequences, readers for odd widths."""

from __future__ import annotations

import os
from collections import Counter, defaultdict
from contextlib import suppress
from pathlib import Path

import matplotlib
import pytest
from helpers.slow_files import SLOW

from skmotionseg.datasets import make_rigid_motions

matplotlib.use("Agg")
with suppress(ImportError):
    # It brings a BLAS of its own, and the limits on native threads are those of the
    # libraries that are there when they are first asked for.
    import cv2  # noqa: F401


@pytest.hookimpl(tryfirst=True)  # before groups become part of names
def pytest_collection_modifyitems(items):
    """Mark the tests of slow files, and whatever takes minutes.

    A slow file is of one worker, so that what its tests share is computed once; and
    slow files come first, so that no worker waits for one in the end.
    """
    here = Path(__file__).parent
    slow = {here / name for name in SLOW}
    for item in items:
        if item.path in slow or item.get_closest_marker("long"):
            item.add_marker("slow")
        if item.path in slow and not item.get_closest_marker("xdist_group"):
            name = item.path.relative_to(here).with_suffix("").as_posix()
            item.add_marker(pytest.mark.xdist_group(name))
    items.sort(key=lambda item: item.path not in slow)


@pytest.fixture(scope="session")
def scene():
    """A small scene of three motions: (X, y)."""
    return make_rigid_motions(n_tracks=140, n_frames=8, random_state=0)


@pytest.fixture(scope="session")
def real_data():
    """The folder of the benchmarks, or a skip that says where it was looked for."""
    beside = Path(__file__).parents[2] / "shared" / "data"
    folder = Path(os.environ.get("SKMOTIONSEG_DATA", beside))
    if not folder.is_dir():
        pytest.skip(
            f"no real sequences in {folder}; set SKMOTIONSEG_DATA to the folder that "
            "holds KT3DMoSeg, Hopkins155, Hopkins12 and MTPV62"
        )
    return folder


def pytest_terminal_summary(terminalreporter):
    """Say what came of the cases that hypothesis made, as tests recorded it."""
    outcomes = defaultdict(Counter)
    for report in terminalreporter.stats.get("passed", []):
        for key, value in report.user_properties:
            if key == "outcomes":
                name, counts = value
                outcomes[name].update(counts)
    if not outcomes:
        return
    n_cases = sum(sum(counts.values()) for counts in outcomes.values())
    terminalreporter.section(f"{n_cases} cases made by hypothesis")
    for name, counts in outcomes.items():
        kinds = ", ".join(f"{n} {kind}" for kind, n in counts.most_common())
        terminalreporter.line(f"{name}: {sum(counts.values())} ({kinds})")
