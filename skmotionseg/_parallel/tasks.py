"""Calls that any process can make, and that say what they are about when they fail."""

from __future__ import annotations

import os
import time
from contextlib import contextmanager
from functools import cache
from threading import Thread

from .threads import single_threaded

# Seconds between two looks of a worker at whether its parent is still there.
LOOKS = 1.0


class Task:
    """A call that any process can make, and what it is about, in words.

    The arguments travel inside the task. Beside it, large ones would be put on one
    machine of a dask cluster, for all tasks to fetch, and be lost with that machine.

    Parameters
    ----------
    words : str
        Such as "segmenting sequence 3": noted on the error if the call fails.
    function : callable
    *arguments
        Its arguments.
    """

    def __init__(self, words, function, *arguments):
        self.words = words
        self.function = function
        self.arguments = arguments
        self.caller = os.getpid()

    @single_threaded
    def __call__(self):
        if os.getppid() == self.caller:
            _end_with(self.caller)
        with noting(self.words):
            return self.function(*self.arguments)


@cache
def _end_with(parent):
    """End this process once its parent is gone, which alone waits for its results.

    A worker would otherwise notice after its task, which may take minutes.
    """

    def watch():
        while os.getppid() == parent:
            time.sleep(LOOKS)
        os._exit(1)

    Thread(target=watch, daemon=True).start()


@contextmanager
def noting(words):
    """Say in a note on errors what was being done."""
    try:
        yield
    except Exception as error:
        error.add_note(f"while {words}")
        raise
