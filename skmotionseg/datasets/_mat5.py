"""MATLAB's files of version 5 and 7, looked through before scipy reads them.

scipy believes what a file says of its sizes, and follows what lies in what as deep as
it goes. Here each part must fit into the part that it lies in. The format is described
in MathWorks' "MAT-File Format" (R2019b), from which the numbers below are.
"""

from __future__ import annotations

import math
import struct
import zlib

import scipy.io

from ._sizes import check_claim, most_bytes

HEADER = 128
MATRIX, COMPRESSED = 14, 15
# Bytes of a number, by what it is stored as.
NUMBERS = {1: 1, 2: 1, 3: 2, 4: 2, 5: 4, 6: 4, 7: 4, 9: 8, 12: 8, 13: 8}
TEXTS = {1: 1, 2: 1, 3: 2, 4: 2, 16: 1, 17: 1, 18: 1}  # at least so many a character
CELL, STRUCT, CHAR, SPARSE = 1, 2, 4, 5
NUMERIC = range(6, 16)
COMPLEX = 1 << 11
# A struct of arrays is two deep.
MOST_DEEP = 8
# Flags, shape and name of a variable, of which at most 63 characters are its name.
START_BYTES = 4096


def read_mat5(path, names):
    """Variables of a file, of those named, and the names of all.

    Parameters
    ----------
    path : Path
    names : sequence of str

    Returns
    -------
    content : dict
        As of :func:`scipy.io.loadmat`; structs have attributes.
    found : list of str
        Names of all variables in the file.

    Raises
    ------
    ValueError
        If the file is of another version, or its parts do not fit into one another.
    """
    content = memoryview(path.read_bytes())
    order = _byte_order(content)
    found, matrix, payload = [], None, None
    for kind, payload in _parts(content[HEADER:], order, padded=False):
        matrix, whole = _matrix(kind, payload, order, START_BYTES, len(content))
        name = _name(matrix, order)
        found.append(name)
        if name in names:
            if not whole:
                matrix, _ = _matrix(kind, payload, order, None, len(content))
            _check_matrix(matrix, order, repr(name), 0)
    del matrix, payload, content
    wanted = [name for name in names if name in found]
    return (
        scipy.io.loadmat(
            path,
            variable_names=wanted,
            squeeze_me=True,
            struct_as_record=False,
        ),
        sorted(name for name in found if name and not name.startswith("__")),
    )


def _byte_order(content):
    """Of the numbers, as in :mod:`struct`."""
    start = bytes(content[:HEADER])
    if len(start) < HEADER:
        raise ValueError(f"its header has {HEADER} bytes; got {len(start)}")
    order = {b"IM": "<", b"MI": ">"}.get(start[126:128])
    version = start[124:126] if order == ">" else start[125:123:-1]
    if 0 in start[:4] or order is None or version != b"\x01\x00":
        raise ValueError(
            "it is not of version 5 or 7: save it with -v7, or scipy.io.savemat"
        )
    return order


def _parts(content, order, *, padded=True):
    """Pairs of kind and payload, one after the other."""
    at = 0
    while at < len(content):
        if len(content) - at < 8:
            raise ValueError("it ends within the header of a part")
        kind, size = struct.unpack_from(order + "II", content, at)
        if kind >> 16 and padded:  # both in one word, and up to four bytes in the other
            kind, size = kind & 0xFFFF, kind >> 16
            payload, step = content[at + 4 : at + 8][:size], 8
        else:
            payload = content[at + 8 : at + 8 + size]
            step = 8 + (-(-size // 8) * 8 if padded else size)
        if len(payload) < size:
            raise ValueError(
                f"a part claims {size} bytes, but there are {len(payload)}"
            )
        yield kind, payload
        at += step


def _matrix(kind, payload, order, n_bytes, file_size):
    """The inside of a variable, and whether that is all of it."""
    if kind == MATRIX:
        return payload, True
    if kind != COMPRESSED:
        raise ValueError(f"expected a variable; got a part of kind {kind}")
    limit = most_bytes(file_size) + 8
    unpacked = zlib.decompressobj().decompress(payload, n_bytes or limit + 1)
    if len(unpacked) < 8:
        raise ValueError("a compressed variable has no header")
    kind, size = struct.unpack_from(order + "II", unpacked)
    if kind != MATRIX:
        raise ValueError(f"expected a variable; got a part of kind {kind}")
    whole = len(unpacked) >= 8 + size
    if n_bytes is None:
        check_claim("a variable", max(size, len(unpacked) - 8), file_size)
        if not whole:
            raise ValueError(
                f"a variable claims {size} bytes, but there are {len(unpacked) - 8}"
            )
    return memoryview(unpacked)[8 : 8 + size], whole


def _start(parts, order):
    """Class, whether it is complex, shape and name of a matrix."""
    (_, flags), (_, shape), (_, name) = next(parts), next(parts), next(parts)
    if len(flags) < 8 or len(shape) % 4 or not 8 <= len(shape) <= 4 * 32:
        raise ValueError("a variable has no class or no shape")
    word = struct.unpack_from(order + "I", flags)[0]
    shape = struct.unpack(f"{order}{len(shape) // 4}i", shape)
    if min(shape) < 0:
        raise ValueError(f"a variable claims the shape {shape}")
    return word & 0xFF, bool(word & COMPLEX), shape, bytes(name)


def _name(matrix, order):
    try:
        return _start(_parts(matrix, order), order)[3].decode("latin1")
    except StopIteration:
        raise ValueError("a variable has no class, shape or name") from None


def _check_matrix(matrix, order, name, depth):
    """Raise unless everything in a matrix is there, as often as it says."""
    if depth > MOST_DEEP:
        raise ValueError(f"{name} holds more than {MOST_DEEP} things in one another")
    if len(matrix) == 0:  # scipy reads this as an empty array
        return
    parts = _parts(matrix, order)
    try:
        kind, is_complex, shape, _ = _start(parts, order)
    except StopIteration:
        raise ValueError(f"{name} has no class, shape or name") from None
    size = math.prod(shape)
    if kind in NUMERIC:
        for stored, payload in _next(parts, 1 + is_complex, name):
            _check_numbers(name, shape, size, NUMBERS.get(stored), len(payload))
    elif kind == CHAR:
        ((stored, payload),) = _next(parts, 1, name)
        if size * TEXTS.get(stored, len(payload) + 1) > len(payload):
            raise ValueError(
                f"{name} claims the shape {shape} of text, but holds {len(payload)} "
                "bytes"
            )
    elif kind in (CELL, STRUCT):
        fields = 1 if kind == CELL else _number_of_fields(parts, order, name)
        if size * max(fields, 1) * 8 > len(matrix):  # an empty part has eight bytes
            raise ValueError(
                f"{name} claims the shape {shape}, but holds {len(matrix)} bytes"
            )
        for part, payload in _next(parts, size * fields, name):
            if part != MATRIX:
                raise ValueError(f"{name} holds a part of kind {part}")
            _check_matrix(payload, order, f"a field of {name}", depth + 1)
    elif kind == SPARSE:
        for stored, payload in _next(parts, 3 + is_complex, name):
            if stored not in NUMBERS or len(payload) % NUMBERS[stored]:
                raise ValueError(f"{name} holds what are no numbers")
    else:
        raise ValueError(f"{name} is of MATLAB's class {kind}, which is not read")


def _next(parts, count, name):
    """So many parts, or an error."""
    for _ in range(count):
        try:
            yield next(parts)
        except StopIteration:
            raise ValueError(f"{name} ends before its last part") from None


def _check_numbers(name, shape, size, itemsize, n_bytes):
    if itemsize is None or size * itemsize != n_bytes:
        raise ValueError(
            f"{name} claims the shape {shape}, {size} numbers, but holds {n_bytes} "
            "bytes"
        )


def _number_of_fields(parts, order, name):
    (_, length), (_, names) = _next(parts, 2, name)
    if len(length) != 4:
        raise ValueError(f"{name} does not say how long the names of its fields are")
    length = struct.unpack(order + "i", length)[0]
    if length < 1 or len(names) % length:
        raise ValueError(f"{name} claims fields with names of {length} bytes")
    return len(names) // length
