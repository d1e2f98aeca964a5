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
        ({"number": 3, "alike": 11, "apart": 3}, 9, "merged"),
        ({"number": 3, "alike": 10, "apart": 3}, 9, None),
        ({"number": 3, "alike": 11, "apart": 30}, 9, None),
        ({"number": 1, "alike": 11, "apart": 30}, 9, "continued"),
        ({"number": 0, "alike": 11}, 9, "continued"),
        ({"number": 3, "together": 3}, 9, "joined"),
        ({"number": 0, "together": 3}, 9, None),
    ],
)
def test_what_becomes_of_motions(known, n_tracks, expected):
    motion = LivingMotion(fit=None, refitted=0, **known)
    alike = LivingMotion(2, fit=None, refitted=0) if motion.alike else None
    assert verdict(motion, n_tracks, alike) == expected


def test_what_is_one_of_its_own_is_no_part_that_came_later():
    motion = LivingMotion(1, fit=None, refitted=0, alike=11, apart=30)
    alike = LivingMotion(2, fit=None, refitted=0, apart=30)
    assert verdict(motion, 9, alike) is None
