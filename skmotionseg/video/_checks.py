"""Checks of parameters, and reports of progress."""

from __future__ import annotations

from numbers import Integral, Real

import numpy as np


def check_number(name, value, kind, least):
    good = isinstance(value, kind) and not isinstance(value, bool)
    if not good or not least <= value < np.inf:
        noun = "an integer" if kind is Integral else "a number"
        error = ValueError if good else TypeError
        raise error(f"{name} must be {noun} of {least} or more; got {value!r}")


def check_fps(fps):
    if fps is None:
        return
    good = isinstance(fps, Real) and not isinstance(fps, bool)
    if not good or not 0 < fps < np.inf:
        error = ValueError if good else TypeError
        raise error(f"fps must be a number above 0; got {fps!r}")


def make_reporter(progress, total):
    """What is called with how much is done, of a total, by a caller's function."""
    if progress is None:
        return lambda done: None
    if not callable(progress):
        raise TypeError(
            f"progress must be a function of what is done and the total; got "
            f"{progress!r}"
        )
    return lambda done: progress(done, total)
