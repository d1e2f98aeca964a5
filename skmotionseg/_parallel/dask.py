"""joblib's engine for dask clusters, made to answer for every task."""

from __future__ import annotations

import pickle
from functools import partial

import cloudpickle
from joblib import parallel_config
from joblib._dask import DaskDistributedBackend

from .tasks import noting

# Tasks that are given up at the same time are heard of within so long.
SECONDS_FOR_OTHERS = 0.2


class AnsweringBackend(DaskDistributedBackend):
    """Ends when a task has no answer, because each worker that ran it died, say.

    joblib (1.6) is called back with the answers of tasks alone and waits for ever for a
    task that the cluster gave up on.
    """

    def __init__(self, *args, **kwargs):
        super().__init__(*args, **kwargs)
        self._lost = []  # used by the client's loop alone

    def submit(self, func, callback=None):
        future = super().submit(func, callback)
        future.add_done_callback(partial(self._note_loss, func, callback))
        return future

    def _note_loss(self, batch, callback, future):
        error = future.exception()
        if error is None:
            return
        if not self._lost:
            self.client.loop.call_later(
                SECONDS_FOR_OTHERS, self._report_losses, error, callback
            )
        self._lost += [_words(task) for task, _, _ in batch.items]

    def _report_losses(self, error, callback):
        # Dask counts the death of a worker against each task that the worker held, so
        # others may be given up together with the one that kills; it is among them.
        error.add_note("while " + " or ".join(dict.fromkeys(self._lost)))
        self._lost = []
        callback(error)


def _words(task):
    """What a task is about; the name of the function if it does not say."""
    name = getattr(task, "__name__", type(task).__name__)
    return getattr(task, "words", f"running {name}")


class TaskBackend(AnsweringBackend):
    """Also ends when a task cannot be sent, or read by workers."""

    def submit(self, func, callback=None):
        func.items = [(_SealedTask(task), (), {}) for task, _, _ in func.items]
        return super().submit(func, callback)


class _SealedTask:
    """A task that is pickled here and now, and read when it is to run."""

    def __init__(self, task):
        self.words = self.__name__ = task.words  # its name on dask's dashboard
        with noting(f"sending off for {task.words}"):
            self._pickled = cloudpickle.dumps(task)

    def __call__(self):
        with noting(self.words):
            task = pickle.loads(self._pickled)
        # The tasks are spread over the cluster; what they start stays with them, as
        # joblib has it in processes of its own. (Dask would not heed their n_jobs.)
        with parallel_config(backend="threading"):
            return task()
