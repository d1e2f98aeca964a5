"""Files that are there whole or not at all, and could be written at all."""

from __future__ import annotations

import os
from contextlib import contextmanager


def check_output(path, endings=None):
    """Refuse a file that could not be written, before any work.

    Parameters
    ----------
    path : Path or None
    endings : sequence of str, optional
        Those it may have.

    Raises
    ------
    ValueError
        If it has another ending.
    FileNotFoundError
        If its folder does not exist.
    """
    if path is None:
        return
    if endings is not None and path.suffix.lower() not in endings:
        raise ValueError(f"output files end in {' or '.join(endings)}; got {path.name}")
    if not path.absolute().parent.is_dir():
        raise FileNotFoundError(f"there is no folder to write {path} to")


@contextmanager
def replacing(path):
    """A binary file beside the target, put in its place once it is whole."""
    with replacing_path(path) as part, part.open("wb") as file:
        yield file


@contextmanager
def replacing_path(path):
    """As :func:`replacing`, for writers that open a file themselves.

    The path has the target's ending, which tells such writers the format. If writing
    fails, it is removed and the target stays what it was.

    Parameters
    ----------
    path : Path
    """
    part = path.with_name(f"{path.stem}.part{path.suffix}")
    try:
        yield part
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)
