"""Calls that any process can make, and that say what they are about when they fail."""

from __future__ import annotations

from contextlib import contextmanager

from .threads import single_threaded


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

    @single_threaded
    def __call__(self):
        with noting(self.words):
            return self.function(*self.arguments)


@contextmanager
def noting(words):
    """Say in a note on errors what was being done."""
    try:
        yield
    except Exception as error:
        error.add_note(f"while {words}")
        raise
