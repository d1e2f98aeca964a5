"""Archives of arrays, read no further than they are asked for and can be believed."""

from __future__ import annotations

import io
import math
import zipfile
from collections.abc import Mapping

import numpy as np

from ._sizes import check_claim

# Longer headers than this are of arrays with thousands of named fields.
HEADER_BYTES = 2**14
HEADER_READERS = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}


class NpzArrays(Mapping):
    """The arrays of a .npz file by name, each read when it is asked for.

    Before one is read, its header is: objects, which are pickles, are refused, and so
    is a shape that the file does not hold.

    Parameters
    ----------
    path : Path

    Raises
    ------
    ValueError
        If the file is no such archive; on access, if an array is not whole.
    """

    def __init__(self, path):
        self._file_size = path.stat().st_size
        try:
            self._zip = zipfile.ZipFile(path)
        except Exception as error:  # whatever a broken list of contents leads to
            raise ValueError(f"not an archive, or truncated ({error})") from error
        self._members = {
            member.filename.removesuffix(".npy"): member
            for member in self._zip.infolist()
        }

    def __enter__(self):
        return self

    def __exit__(self, *error):
        self._zip.close()

    def __iter__(self):
        return iter(self._members)

    def __len__(self):
        return len(self._members)

    def __contains__(self, name):  # without reading it, as Mapping would
        return name in self._members

    def __getitem__(self, name):
        member = self._members[name]
        shape, dtype, start = self._header(name)
        if dtype.hasobject:
            raise ValueError(
                f"{name!r} holds Python objects, which are pickles and not read "
                "(allow_pickle=False)"
            )
        n_bytes = math.prod(shape) * dtype.itemsize
        if min(shape, default=0) < 0 or n_bytes != member.file_size - start:
            raise ValueError(
                f"{name!r} claims the shape {shape} of {dtype}, {n_bytes} bytes, but "
                f"holds {member.file_size - start}"
            )
        check_claim(f"{name!r} of shape {shape}", n_bytes, self._file_size)
        with self._open(name) as file:
            array = np.lib.format.read_array(file, allow_pickle=False)
            file.read(1)  # the end, where the checksum is looked at
        return array

    def shape(self, name):
        """An array's shape, without reading the array."""
        return self._header(name)[0]

    def _header(self, name):
        """Shape, dtype, and where the numbers start."""
        with self._open(name) as file:
            header = io.BytesIO(file.read(HEADER_BYTES))
        version = np.lib.format.read_magic(header)
        if version not in HEADER_READERS:
            raise ValueError(f"{name!r} is of an unknown version, {version}")
        shape, _, dtype = HEADER_READERS[version](header)
        return shape, dtype, header.tell()

    def _open(self, name):
        return self._zip.open(self._members[name])
