"""Files that are there whole or not at all."""

from __future__ import annotations

import os
from contextlib import contextmanager


@contextmanager
def replacing(path):
    """A binary file beside the target, put in its place once it is whole."""
    part = path.with_name(path.name + ".part")
    with part.open("wb") as file:
        yield file
    os.replace(part, path)
