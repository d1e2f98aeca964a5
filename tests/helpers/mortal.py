"""Estimators for tests of other processes, which import them from here."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path
from threading import Thread

import numpy as np
from sklearn.base import BaseEstimator, ClusterMixin, clone
from threadpoolctl import threadpool_info, threadpool_limits


def pool_sizes():
    return [pool["num_threads"] for pool in threadpool_info()]


def set_pool_sizes(size):
    """Set them for good, in a thread that does not stay to keep others from it."""
    thread = Thread(target=threadpool_limits, args=(size,), kwargs={"user_api": "blas"})
    thread.start()
    thread.join()


def says_its_process(folder, name):
    """Write the number of this process to a file, and take long."""
    unfinished = Path(folder, f"{name}.part")
    unfinished.write_text(f"{os.getpid()}\n")
    unfinished.rename(Path(folder, f"{name}.pid"))
    time.sleep(600)


class Dies(ClusterMixin, BaseEstimator):
    """Segments, but kills its process when it gets so many tracks.

    If ``once`` is a path, a file there says that this has happened and will not again.
    """

    def __init__(self, estimator, n_tracks, once=None):
        self.estimator = estimator
        self.n_tracks = n_tracks
        self.once = once

    def fit(self, X, y=None):
        if len(X) == self.n_tracks and self._is_due():
            time.sleep(0.3)  # until the worker holds no other task
            os.kill(os.getpid(), signal.SIGKILL)
        self.labels_ = clone(self.estimator).fit_predict(X)
        return self

    def _is_due(self):
        if self.once is None:
            return True
        try:
            Path(self.once).touch(exist_ok=False)
        except FileExistsError:
            return False
        return True


class ReportsPoolSizes(ClusterMixin, BaseEstimator):
    """Its labels are the sizes of the native thread pools, and say where it ran."""

    def fit(self, X, y=None):
        self.labels_ = np.array([os.getpid(), *pool_sizes()])
        return self


class StaysHere(ClusterMixin, BaseEstimator):
    """Cannot be read in another process."""

    def fit(self, X, y=None):
        self.labels_ = np.zeros(len(X), dtype=int)
        return self

    def __reduce__(self):
        return refuse, (os.getpid(),)


def refuse(pid):
    if os.getpid() != pid:
        raise LookupError("this estimator stays where it is")
    return StaysHere()
