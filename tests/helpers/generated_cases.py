"""Cases that hypothesis makes, from fixed seeds, and what came of them."""

from __future__ import annotations

from collections import Counter
from unittest import mock

from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis.internal.conjecture import providers

# Of a long run, so that it comes in pieces.
CASES_A_TEST = 250
# Hypothesis draws some numbers from the source of what happens to be imported, which
# is another in each worker, and after each change: a seed would be no seed.
OF_SOURCES = "_get_local_constants"
NO_SOURCES = providers._local_constants


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
    with mock.patch.object(providers, OF_SOURCES, lambda: NO_SOURCES):
        check()
    return dict(outcomes)
