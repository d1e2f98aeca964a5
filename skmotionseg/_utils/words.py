"""Words of tables and titles."""

from __future__ import annotations


def counted(count: int, noun: str) -> str:
    """``1 motion``, ``2 motions``."""
    return f"{count} {noun}" + ("" if count == 1 else "s")
