"""A seed gives the same labels, costs and affinities, bit for bit, in any process."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.xdist_group("determinism")  # computed once for all

# Threads of the native libraries, and what the process hashes text with.
PROCESSES = [("1", "0"), ("2", "1")]


def run(folder, threads, hash_seed):
    names = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
    environment = {**dict.fromkeys(names, threads), "PYTHONHASHSEED": hash_seed}
    script = Path(__file__).parents[1] / "helpers" / "determinism.py"
    done = subprocess.run(
        [sys.executable, script, folder],
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    return json.loads(done.stdout)


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    """By group, all that was found under any setting in any process."""
    folder = tmp_path_factory.mktemp("pickles")
    groups = {}
    for threads, hash_seed in PROCESSES:
        for group, settings in run(folder, threads, hash_seed).items():
            for setting, digests in settings.items():
                name = f"{setting}, {threads} threads, hash seed {hash_seed}"
                groups.setdefault(group, {})[name] = digests
    return groups


def test_every_setting_was_tried(found):
    assert len(found) == 6
    for group, settings in found.items():
        engines = 2 if group == "description_length, n_landmarks=30" else 0
        first, second = 3 + 1 + engines, 2 + 1
        if group in ("pipeline", "sequences"):
            first, second = 3, 1
        assert len(settings) == first + second


def test_a_seed_gives_the_same_bits(found):
    for group, settings in found.items():
        first = next(iter(settings.values()))
        different = {name for name, digests in settings.items() if digests != first}
        assert not different, f"{group}: {different}"


def test_digests_tell_apart(found):
    """Two rules, and fitting all or some, do not come to the same."""
    costs = [next(iter(s.values())).get("costs") for s in found.values()]
    assert len(set(filter(None, costs))) == 4
