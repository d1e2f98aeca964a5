"""BLAS and OpenMP at one thread, where results must not depend on their number."""

from __future__ import annotations

from contextlib import contextmanager
from functools import lru_cache, wraps
from threading import Lock

from threadpoolctl import ThreadpoolController


@lru_cache(maxsize=1)
def _controller():
    return ThreadpoolController()  # looks through the loaded libraries: done once


class _SharedLimit:
    """One limit on BLAS for all who ask, in whatever thread: the last lifts it.

    The number of BLAS threads belongs to the process. (That of OpenMP belongs to the
    thread that sets it, and needs no sharing.)
    """

    def __init__(self):
        self._lock = Lock()
        self._users = 0
        self._limiter = None

    @contextmanager
    def __call__(self):
        with self._lock:
            if self._users == 0:
                self._limiter = _controller().limit(limits=1, user_api="blas")
            self._users += 1
        try:
            yield
        finally:
            with self._lock:
                self._users -= 1
                if self._users == 0:
                    self._limiter.restore_original_limits()


_one_blas_thread = _SharedLimit()


def single_threaded(function):
    """Run a function with all native thread pools at one thread.

    The many small factorisations run faster so, parallel branches do not fight over
    cores, and no sum depends on how many threads shared it. Parallelism comes from
    joblib, above.
    """

    @wraps(function)
    def limited(*args, **kwargs):
        with _one_blas_thread(), _controller().limit(limits=1, user_api="openmp"):
            return function(*args, **kwargs)

    return limited
