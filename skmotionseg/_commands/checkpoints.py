"""A journal of finished runs, so that what was interrupted can go on."""

from __future__ import annotations

import json
import os
from pathlib import Path

START = b'{"run": '


class Journal:
    """Records of finished runs in a file, a line of JSON each.

    A line is written at once, and on the disk before :meth:`append` returns; several
    processes may do so. A line that was cut short is not read, and its run is done
    again.

    Parameters
    ----------
    path : Path
        Need not be there.

    Raises
    ------
    ValueError
        If the file is of another kind, which lines would spoil.
    """

    def __init__(self, path):
        self.path = Path(path).absolute()  # workers may be elsewhere
        if self.path.exists():
            with self.path.open("rb") as file:
                start = file.read(len(START)).split(b"\n")[0]  # perhaps cut short
            if not START.startswith(start):
                raise ValueError(
                    f"{path} is not a journal: expected lines that start with "
                    f"{START.decode()}; got {start!r}"
                )

    def read(self):
        """Records by what :func:`run_key` makes of their runs."""
        records: dict = {}
        if not self.path.exists():
            return records
        for line in self.path.read_bytes().splitlines():
            try:
                entry = json.loads(line)
                records[run_key(entry["run"])] = dict(entry["record"])
            except (ValueError, TypeError, KeyError):  # cut short, or damaged
                continue
        return records

    def append(self, run, record):
        """Add a record.

        Parameters
        ----------
        run : dict
            What was run: whatever its result depends on.
        record : dict
        """
        line = json.dumps({"run": run, "record": record}).encode() + b"\n"
        flags = os.O_RDWR | os.O_CREAT | os.O_APPEND | getattr(os, "O_BINARY", 0)
        descriptor = os.open(self.path, flags, 0o666)
        try:
            size = os.lseek(descriptor, 0, os.SEEK_END)
            if size:
                os.lseek(descriptor, size - 1, os.SEEK_SET)
                if os.read(descriptor, 1) != b"\n":  # after a line that was cut short
                    line = b"\n" + line
            while line:
                line = line[os.write(descriptor, line) :]
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def run_key(run):
    """A run as text that can be compared."""
    return json.dumps(run, sort_keys=True)
