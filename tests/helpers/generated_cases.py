"""Cases that hypothesis makes, from fixed seeds, and what came of them."""

from __future__ import annotations

from collections import Counter

from hypothesis import HealthCheck, Phase, given, seed, settings

# Of a long run, so that it comes in pieces.
CASES_A_TEST = 250


def run_cases(strategy, outcome_of, n_cases, piece=None):
    """Check so many cases, and count what came of them.

    Parameters
    ----------
    strategy : hypothesis strategy
    outcome_of : callable
        Checks a case, and says in a word what came of it.
    n_cases : int
    piece : int, optional
        Seed of the cases.

    Returns
    -------
    dict of str to int
    """
    outcomes: Counter[str] = Counter()

    @settings(
        max_examples=n_cases,
        derandomize=piece is None,
        deadline=None,
        database=None,
        phases=(Phase.generate, Phase.shrink),
        suppress_health_check=list(HealthCheck),
    )
    @given(strategy)
    def check(case):
        outcomes[outcome_of(case)] += 1

    if piece is not None:
        check = seed(piece)(check)
    check()
    return dict(outcomes)
