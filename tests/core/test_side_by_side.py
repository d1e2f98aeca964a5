"""Searches that run side by side."""

from __future__ import annotations

import pytest

from skmotionseg._core.partition.side_by_side import run, side_by_side


def doubling(number, times):
    """A search that asks for the double of its last answer."""
    for _ in range(times):
        (number,) = yield [number]
    return number


def answering(rounds):
    def answer(requests):
        rounds.append(list(requests))
        return [2 * request for request in requests]

    return answer


def test_requests_of_a_round_are_answered_together():
    rounds = []
    found = run(
        side_by_side([doubling(1, 3), doubling(5, 1), doubling(7, 0)]),
        answering(rounds),
    )
    assert found == [8, 10, 7]
    assert rounds == [[1, 5], [2], [4]]


def test_searches_may_run_others_side_by_side():
    def outer():
        one, other = yield from side_by_side([doubling(1, 2), doubling(3, 1)])
        (total,) = yield [one + other]
        return total

    rounds = []
    assert run(side_by_side([outer(), doubling(9, 3)]), answering(rounds)) == [20, 72]
    assert rounds == [[1, 3, 9], [2, 18], [10, 36]]


def test_a_search_may_ask_for_several_things_or_none():
    def many():
        a, b = yield [1, 2]
        nothing = yield []
        return a, b, nothing

    assert run(side_by_side([many(), doubling(4, 2)]), answering([])) == [
        (2, 4, []),
        16,
    ]
    assert run(side_by_side([]), answering([])) == []


def test_errors_are_those_of_the_search():
    def broken():
        yield [1]
        raise ValueError("no such motion")

    with pytest.raises(ValueError, match="no such motion"):
        run(side_by_side([broken()]), answering([]))
