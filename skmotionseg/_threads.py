"""BLAS and OpenMP at one thread, where results must not depend on their number."""

from __future__ import annotations

from functools import lru_cache, wraps

from threadpoolctl import ThreadpoolController


@lru_cache(maxsize=1)
def _controller():
    return ThreadpoolController()  # looks through the loaded libraries: done once


def single_threaded(function):
    """Run a function with all native thread pools at one thread.

    The many small factorisations run faster so, parallel branches do not fight over
    cores, and no sum depends on how many threads shared it. Parallelism comes from
    joblib, above; an outer function that starts threads is limited itself, for the
    number of BLAS threads belongs to the process.
    """

    @wraps(function)
    def limited(*args, **kwargs):
        with _controller().limit(limits=1):
            return function(*args, **kwargs)

    return limited
