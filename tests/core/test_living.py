"""What becomes of motions."""

from __future__ import annotations

import pytest

from skmotionseg._core.stream.living import LivingMotion, verdict


@pytest.mark.parametrize(
    ("known", "n_tracks", "expected"),
    [
        ({"number": -9, "age": 2}, 9, None),
        ({"number": -9, "age": 5, "is_apart": True}, 9, "confirmed"),
        ({"number": -9, "age": 5, "is_apart": True}, 5, None),
        ({"number": -9, "age": 10}, 9, "dropped"),
        ({"number": -9, "age": 1}, 3, "dropped"),
        ({"number": 1, "unseen": 9}, 0, "hidden"),
        ({"number": 1, "alike": 11, "apart": 3}, 9, "merged"),
        ({"number": 1, "alike": 11, "apart": 30}, 9, None),
        ({"number": 0, "alike": 11}, 9, None),
    ],
)
def test_what_becomes_of_motions(known, n_tracks, expected):
    motion = LivingMotion(fit=None, refitted=0, **known)
    assert verdict(motion, n_tracks) == expected
