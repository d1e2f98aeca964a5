"""PNG files of labels, with a palette."""

from __future__ import annotations

import struct
import zlib

import numpy as np

SIGNATURE = b"\x89PNG\r\n\x1a\n"


def davis_palette():
    """The 256 colours (256, 3), uint8, of the masks of DAVIS and PASCAL VOC.

    Bits 0, 3 and 6 of a label are the highest ones of its red, bits 1, 4 and 7 those of
    its green, and bits 2 and 5 those of its blue.

    Returns
    -------
    ndarray of uint8, shape (256, 3)
    """
    labels = np.arange(256)[:, None]
    colours = np.zeros((256, 3), dtype=int)
    for place in range(3):
        bits = labels >> (3 * place + np.arange(3)) & 1
        colours |= bits << (7 - place)
    return colours.astype(np.uint8)


def encode_labels(labels):
    """An 8-bit PNG of labels, in the colours of DAVIS.

    Parameters
    ----------
    labels : ndarray of uint8, shape (height, width)

    Returns
    -------
    bytes
    """
    height, width = labels.shape
    header = struct.pack(">IIBBBBB", width, height, 8, 3, 0, 0, 0)
    return _encode(labels, header, _chunk(b"PLTE", davis_palette().tobytes()))


def encode_grey(values):
    """An 8-bit grey PNG of values, uint8 of shape (height, width): bytes."""
    height, width = values.shape
    return _encode(values, struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0))


def _encode(values, header, palette=b""):
    # Each row starts with the number of its filter: 0, none.
    rows = np.column_stack([np.zeros(len(values), np.uint8), values]).tobytes()
    return b"".join(
        [
            SIGNATURE,
            _chunk(b"IHDR", header),
            palette,
            _chunk(b"IDAT", zlib.compress(rows, 6)),
            _chunk(b"IEND", b""),
        ]
    )


def _chunk(name, content):
    check = zlib.crc32(name + content)
    return struct.pack(">I", len(content)) + name + content + struct.pack(">I", check)
