"""Labels of tracks that are out of view."""

from __future__ import annotations

import numpy as np
from numpy.testing import assert_array_equal

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
