"""Clocks, peak memory, and what machine they were read on."""

from __future__ import annotations

import multiprocessing
import os
import platform
import resource
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import NamedTuple

import numpy as np
from threadpoolctl import threadpool_info

import skmotionseg

CPUINFO = Path("/proc/cpuinfo")
STATUS = Path("/proc/self/status")


class Runs(NamedTuple):
    """What the repeats of one call took and gave."""

    seconds: np.ndarray  # (repeats,)
    cpu_seconds: np.ndarray  # (repeats,), of all threads of this process
    results: list


def clock(function, *arguments):
    """Seconds of a call, those of the processor, and what it gave."""
    started, cpu_started = time.perf_counter(), time.process_time()
    result = function(*arguments)
    return time.perf_counter() - started, time.process_time() - cpu_started, result


def interleave(calls, repeats, *, warm=True):
    """Time calls in turns, A B C A B C, so that a noisy machine hits all alike.

    Parameters
    ----------
    calls : dict of str to callable
        Each is given the number of the repeat, to seed itself with.
    repeats : int
    warm : bool
        Whether to run each once before the clock counts.

    Returns
    -------
    dict of str to Runs
    """
    if warm:
        for call in calls.values():
            call(0)
    rounds = [
        {name: clock(call, repeat) for name, call in calls.items()}
        for repeat in range(repeats)
    ]
    return {
        name: Runs(
            np.array([each[name][0] for each in rounds]),
            np.array([each[name][1] for each in rounds]),
            [each[name][2] for each in rounds],
        )
        for name in calls
    }


def spread(values):
    """Median, smallest and largest of the repeats."""
    return [float(f(values)) for f in (np.median, np.min, np.max)]


def in_fresh_process(function, *arguments):
    """Call a function of a module in a new interpreter."""
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(max_workers=1, mp_context=context) as executor:
        return executor.submit(function, *arguments).result()


def peak_memory():
    """Most bytes that were ever resident in this process."""
    if STATUS.exists():
        # Linux hands ru_maxrss of a large parent down to its children.
        for line in STATUS.read_text().splitlines():
            if line.startswith("VmHWM:"):
                return 1024 * int(line.split()[1])
    unit = 1 if sys.platform == "darwin" else 1024
    return unit * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def machine():
    """What the figures depend on, as one line of text."""
    cpu = platform.processor() or platform.machine()
    if CPUINFO.exists():
        models = [
            line.partition(":")[2].strip()
            for line in CPUINFO.read_text().splitlines()
            if line.startswith("model name")
        ]
        cpu = models[0] if models else cpu
    blas = {
        # Kernels of other processors round differently.
        " ".join(
            filter(None, map(pool.get, ("internal_api", "version", "architecture")))
        )
        for pool in threadpool_info()
        if pool["user_api"] == "blas"
    }
    return (
        f"{cpu}, {os.cpu_count()} cores; Python {platform.python_version()}, "
        f"NumPy {np.__version__} ({', '.join(sorted(blas))}), "
        f"skmotionseg {skmotionseg.__version__}"
    )


def show_progress(text):
    """Say where a run is; on a terminal, over the line before. "" ends it."""
    if sys.stderr.isatty():
        print(f"\r\033[K{text}", end="", file=sys.stderr, flush=True)
    elif text:
        print(text, file=sys.stderr, flush=True)
