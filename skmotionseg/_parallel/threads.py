"""BLAS and OpenMP at one thread, where results must not depend on their number."""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import lru_cache, wraps
from threading import Lock
from typing import Any, ParamSpec, TypeVar

from threadpoolctl import ThreadpoolController

P = ParamSpec("P")
R = TypeVar("R")


def _controllers():
    """Those of OpenMP and of BLAS; each leaves the other alone."""
    # Looking through the loaded libraries takes milliseconds. What is imported later
    # may bring libraries of its own, as OpenCV does.
    return _controllers_of(len(sys.modules))


@lru_cache(maxsize=1)
def _controllers_of(n_modules):
    every = ThreadpoolController()
    return every.select(user_api="openmp"), every.select(user_api="blas")


class _SharedLimit:
    """BLAS at one thread for all who ask, in whatever thread: the last lifts it.

    The number of BLAS threads belongs to the process. If each set it and set it back,
    the first to go would lift the limit of others, and the last restore a limit.
    """

    def __init__(self):
        self._lock = Lock()
        self._n_users = 0
        self._limiter: Any = None

    def __enter__(self):
        with self._lock:
            if self._n_users == 0:
                _, blas = _controllers()
                self._limiter = blas.limit(limits=1)
            self._n_users += 1

    def __exit__(self, *error):
        with self._lock:
            self._n_users -= 1
            if self._n_users == 0:
                self._limiter.restore_original_limits()


_one_blas_thread = _SharedLimit()


def single_threaded(function: Callable[P, R]) -> Callable[P, R]:
    """Run a function with all native thread pools at one thread.

    The many small factorisations run faster so, parallel views do not fight over
    cores, and no sum depends on how many threads shared it. Parallelism comes from
    joblib, above.
    """

    @wraps(function)
    def limited(*args: P.args, **kwargs: P.kwargs) -> R:
        openmp, _ = _controllers()
        # The number of OpenMP threads belongs to the thread that sets it. This comes
        # first because threadpoolctl lets one thread at a time set that of BLAS, from
        # there to the end of its outermost `with`.
        with openmp.limit(limits=1), _one_blas_thread:
            return function(*args, **kwargs)

    return limited
