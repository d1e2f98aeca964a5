"""BLAS and OpenMP at one thread, where results must not depend on their number."""

from __future__ import annotations

from functools import lru_cache, wraps
from threading import Lock

from threadpoolctl import ThreadpoolController


@lru_cache(maxsize=1)
def _controller():
    return ThreadpoolController()  # looks through the loaded libraries: done once


# The number of BLAS threads belongs to the process. Whoever holds this sets it and sets
# it back; others leave it alone, or the last to go would restore what it found.
_blas_owner = Lock()


def single_threaded(function):
    """Run a function with all native thread pools at one thread.

    The many small factorisations run faster so, parallel branches do not fight over
    cores, and no sum depends on how many threads shared it. Parallelism comes from
    joblib, above; an outer function that starts threads is limited itself.
    """

    @wraps(function)
    def limited(*args, **kwargs):
        with _controller().limit(limits=1, user_api="openmp"):  # that of this thread
            if not _blas_owner.acquire(blocking=False):
                return function(*args, **kwargs)
            try:
                with _controller().limit(limits=1, user_api="blas"):
                    return function(*args, **kwargs)
            finally:
                _blas_owner.release()

    return limited
