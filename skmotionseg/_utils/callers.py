"""Whose code calls."""

from __future__ import annotations

from types import FrameType

# Whose calls may lie between the code of a user and this package.
LIBRARIES = ("skmotionseg", "sklearn", "joblib")


def package_of(frame: FrameType) -> str:
    """The package in which a call is made; empty if that is not known."""
    return frame.f_globals.get("__name__", "").partition(".")[0]
