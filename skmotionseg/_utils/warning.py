"""Warnings that point at the code of the user."""

from __future__ import annotations

import sys
import warnings

from .callers import LIBRARIES, package_of


def warn_user(message: str) -> None:
    """Warn, as from the first line of code outside of these libraries.

    How many calls lie between depends on who calls whom: a search, a pipeline, tasks,
    and what limits threads.
    """
    # From Python 3.12 on, ``skip_file_prefixes`` would do the same.
    level, frame = 2, sys._getframe(1)
    while frame.f_back is not None and package_of(frame) in LIBRARIES:
        level, frame = level + 1, frame.f_back
    warnings.warn(message, stacklevel=level)


def warn_of_unexplained(distance: float, of: str = "") -> None:
    """Warn of tracks that are so many pixels from the motions that they have."""
    warn_user(
        f"half of the tracks{of} are {distance:.2g} pixels or more from the motion "
        "that they are assigned to, so most of them may be wrong, and so may labels "
        "and their probabilities"
    )
