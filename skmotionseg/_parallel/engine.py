"""Tasks in parallel, with whatever engine joblib is told to use."""

from __future__ import annotations

import sys

from joblib import Parallel, delayed, register_parallel_backend
from joblib.parallel import get_active_backend

from .._utils.optional import require

# By this name, joblib finds the engine for dask clusters that answers for every task.
DASK = "skmotionseg-dask"


def register_dask():
    """Let ``joblib.parallel_config(backend="skmotionseg-dask")`` be said."""

    def make(**options):
        require("distributed", extra="dask")
        from .dask import AnsweringBackend

        return AnsweringBackend(**options)

    register_parallel_backend(DASK, make)


def run_tasks(tasks, *, n_jobs=None, prefer=None, done=None):
    """Run tasks with the engine that joblib is told to use.

    Parameters
    ----------
    tasks : iterable of Task
    n_jobs : int or None
        Tasks at a time, as in joblib.
    prefer : {"threads", "processes"} or None
        The engine if ``joblib.parallel_config`` asks for no other.
    done : callable, optional
        Called with the number of tasks that are done, as they are; on a dask cluster,
        where joblib hands over no result before the last, once.

    Returns
    -------
    list
        Their results, in order.

    Raises
    ------
    Exception
        What a task raised, or dask for a task that it gave up on, with a note that
        says which it was.
    """
    options = _dask_options()
    one_by_one = done is not None and not options
    if one_by_one:
        options = {"return_as": "generator"}
    parallel = Parallel(n_jobs=n_jobs, prefer=prefer, **options)
    results = []
    for result in parallel(delayed(task)() for task in tasks):
        results.append(result)
        if one_by_one:
            done(len(results))
    if done is not None and not one_by_one:
        done(len(results))
    return results


def thread_map(n_jobs):
    """A :func:`map` in so many threads, for large arrays and work that frees Python.

    Threads whatever the engine: to send the arrays elsewhere would take longer.
    """
    parallel = Parallel(n_jobs=n_jobs, require="sharedmem")
    return lambda function, items: parallel(delayed(function)(item) for item in items)


def _dask_options():
    """Options of joblib for dask clusters, if that is where tasks are to run."""
    # Whoever asked for dask has had joblib import this; others need not.
    joblib_dask = sys.modules.get("joblib._dask")
    active, _ = get_active_backend()
    if joblib_dask is None or not isinstance(
        active, joblib_dask.DaskDistributedBackend
    ):
        return {}
    from .dask import TaskBackend

    backend = TaskBackend(
        client=active.client,
        wait_for_workers_timeout=active.wait_for_workers_timeout,
        **active.submit_kwargs,
    )
    # A worker that dies takes along the tasks that it holds: one at a time is enough.
    return {"backend": backend, "batch_size": 1, "pre_dispatch": "n_jobs"}
