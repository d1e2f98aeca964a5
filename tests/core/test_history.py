"""Labels of tracks that are out of view."""

from __future__ import annotations

import numpy as np
from numpy.testing import assert_array_equal

from skmotionseg._core.stream import history as module
from skmotionseg._core.stream.history import TRACKS_PER_BLOCK, History


def test_history_has_the_last_label_of_each_track():
    rng, history, expected = np.random.default_rng(0), History(), {}
    for _ in range(60):
        ids = rng.choice(20_000, size=400, replace=False) - 5000
        labels = rng.integers(-1, 5, size=400)
        history.add(ids, labels)
        expected |= dict(zip(ids.tolist(), labels.tolist(), strict=True))
    ids, labels = history.everything(np.array([3, 1]), np.array([8, 9]))
    expected |= {3: 8, 1: 9}
    assert dict(zip(ids.tolist(), labels.tolist(), strict=True)) == expected
    assert (np.diff(ids) > 0).all()
    del expected[3], expected[1]
    some = np.array([*expected, 99_999])
    assert_array_equal(history.labels_of(some), [*expected.values(), -1])


def test_history_takes_a_few_bits_per_track():
    history, rng = History(), np.random.default_rng(0)
    n = 256 * TRACKS_PER_BLOCK
    labels = (rng.uniform(size=n) < 0.1).astype(int)
    for start in range(0, n, 100):
        ids = np.arange(start, min(start + 100, n))
        history.add(ids, labels[ids])
    assert sum(len(block.packed) for block in history._blocks) < n
    assert len(history._blocks) < 24


def test_only_blocks_that_may_hold_an_id_are_unpacked(monkeypatch):
    history, unpacked = History(), []
    for start in (0, 1000, 2000):
        ids = start + np.arange(TRACKS_PER_BLOCK)
        history.add(ids, ids % 7)
    plain = module._unpacked
    monkeypatch.setattr(
        module, "_unpacked", lambda packed: unpacked.append(packed) or plain(packed)
    )
    assert_array_equal(history.labels_of(np.array([1003, 1127, 1500])), [2, 0, -1])
    assert unpacked == [history._blocks[1].packed]
    assert_array_equal(history.labels_of(np.array([-1, 500])), [-1, -1])
    assert len(unpacked) == 1
