"""Any stream at all: labels that keep the contract in every frame.

The streams are made by stream_strategies.py: tracks that live briefly or not at all,
cuts, empty frames, frames from elsewhere, ids that are used again. Frames that are no
frames come between, and change nothing.
"""

from __future__ import annotations

import numpy as np
import pytest
from helpers.generated_cases import run_cases
from helpers.stream_strategies import streams
from helpers.track_strategies import mostly
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from skmotionseg import OnlineMotionSegmenter

CASES_A_TEST = 100
REASONS = {"assigned", "outlier", "no motions yet", "candidate", "too short"}
KINDS = {
    *("start", "new", "again", "hidden", "gone", "merged"),
    *("empty", "break", "resumed", "cut"),
}
NO_FRAMES = [
    ([[1.0, 2.0], [3.0, 4.0]], [5, 5]),
    ([[np.nan, 2.0]], [1]),
    ([[1.0, 2.0]], [1, 2]),
    ([[1.0, 2.0, 3.0]], [1]),
    ([["a", "b"]], [1]),
]


@st.composite
def segmenters(draw):
    return OnlineMotionSegmenter(
        draw(st.sampled_from(("auto", "auto", 1, 2, 3))),
        keep_history=draw(st.booleans()),
        focal_length=draw(mostly(st.none(), *map(st.just, (1e-3, 500.0, 1e9)))),
        random_state=draw(st.integers(0, 9)),
    )


def assert_frame_is_labelled(segmenter, labels, ids):
    assert labels.shape == ids.shape and labels.dtype.kind == "i"
    assert (labels >= -1).all()
    assert_array_equal(segmenter.labels_, labels)
    assert_array_equal(segmenter.track_ids_, ids)
    assert_array_equal(segmenter.label_reasons_ == "assigned", labels >= 0)
    assert set(segmenter.label_reasons_) <= REASONS
    assert len(segmenter.motions_) == segmenter.n_motions_
    assert (np.diff(segmenter.motions_) > 0).all()
    assert segmenter.background_ in (0, -1)
    for event in segmenter.events_:
        assert event.kind in KINDS and event.frame == segmenter.n_frames_ - 1


def assert_is_refused(segmenter, case):
    before = segmenter.labels_, segmenter.n_frames_
    with pytest.raises((ValueError, TypeError)):
        segmenter.update(*NO_FRAMES[case % len(NO_FRAMES)])
    assert before[0] is segmenter.labels_ and before[1] == segmenter.n_frames_


def check_stream(case):
    segmenter, recipe = case
    given, numbers = set(), set()
    frames = recipe.frames()
    for count, (points, ids) in enumerate(frames, start=1):
        labels = segmenter.update(points, ids)
        assert segmenter.n_frames_ == count
        assert_frame_is_labelled(segmenter, labels, ids)
        given |= set(ids.tolist())
        numbers |= set(segmenter.motions_.tolist())
        assert set(labels.tolist()) <= numbers | {-1}
        if count % 7 == 3:
            assert_is_refused(segmenter, count // 7)
    assert segmenter.n_motions == "auto" or len(numbers) <= segmenter.n_motions
    result = segmenter.result()
    known = set(result.track_ids.tolist())
    assert known == given if segmenter.keep_history else known <= given
    assert (np.diff(result.track_ids) > 0).all()
    assert set(result.labels.tolist()) <= numbers | {-1}
    return "motions" if numbers else "no motion"


CASES = {"short": 4, "long": 1000}
PIECES = range(CASES["long"] // CASES_A_TEST)


@pytest.mark.filterwarnings("ignore:half of the tracks are:UserWarning")
@pytest.mark.parametrize(
    "piece", [None, *(pytest.param(p, marks=pytest.mark.long) for p in PIECES)]
)
def test_any_stream_is_labelled(piece, record_property):
    n_cases = CASES["short"] if piece is None else CASES_A_TEST
    cases = st.tuples(segmenters(), streams())
    found = run_cases(cases, check_stream, n_cases, piece)
    record_property("outcomes", ["OnlineMotionSegmenter", found])
