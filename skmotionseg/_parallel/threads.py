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
    Both steps may be cut short by Ctrl-C: `leave` undoes what was done of `enter`, and
    can be called again.
    """

    def __init__(self):
        self._lock = Lock()
        self._users: set[object] = set()
        self._originals: Any = None

    def enter(self, user: object):
        with self._lock:
            self._users.add(user)
            if self._originals is None:
                openmp, blas = _controllers()
                # threadpoolctl lets no other thread set BLAS until the outermost
                # `with` of this one ends. Another thread may be the last to leave.
                with openmp.limit(limits=None):
                    self._originals = blas.limit(limits=None)
                    blas.limit(limits=1)

    def leave(self, user: object):
        with self._lock:
            self._users.discard(user)
            if not self._users and self._originals is not None:
                openmp, _ = _controllers()
                with openmp.limit(limits=None):
                    self._originals.restore_original_limits()
                self._originals = None


_one_blas_thread = _SharedLimit()


def single_threaded(function: Callable[P, R]) -> Callable[P, R]:
    """Run a function with all native thread pools at one thread.

    The many small factorisations run faster so, parallel views do not fight over
    cores, and no sum depends on how many threads shared it. Parallelism comes from
    joblib, above.
    """

    @wraps(function)
    def limited(*args: P.args, **kwargs: P.kwargs) -> R:
        user = object()
        try:
            try:
                _one_blas_thread.enter(user)
                # The number of OpenMP threads belongs to the thread that sets it.
                openmp, _ = _controllers()
                with openmp.limit(limits=1):
                    return function(*args, **kwargs)
            finally:
                _one_blas_thread.leave(user)
        finally:  # Ctrl-C may have come in the midst of that
            _one_blas_thread.leave(user)

    return limited
