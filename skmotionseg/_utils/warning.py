"""Warnings that point at the code of the user."""

from __future__ import annotations

import sys
import warnings

# Whose frames lie between the code of a user and what warns.
LIBRARIES = ("skmotionseg", "sklearn", "joblib")


def warn_user(message: str) -> None:
    """Warn, as from the first line of code outside of these libraries.

    How many calls lie between depends on who calls whom: a search, a pipeline, tasks,
    and what limits threads.
    """
    # From Python 3.12 on, ``skip_file_prefixes`` would do the same.
    level, frame = 2, sys._getframe(1)
    while frame.f_back is not None and _in_library(frame):
        level, frame = level + 1, frame.f_back
    warnings.warn(message, stacklevel=level)


def _in_library(frame):
    return frame.f_globals.get("__name__", "").partition(".")[0] in LIBRARIES
