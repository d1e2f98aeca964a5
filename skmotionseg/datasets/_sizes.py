"""Numbers in a file that say how much there is: how much to believe."""

from __future__ import annotations

import numpy as np

# What any file may ask for, and how many times its own size one may ask for beyond
# that. Tracks shrink to a half, or, where most are unseen most of the time, to a few
# hundredths; a file of zeros, made to fill a machine, shrinks to a thousandth.
FREE_BYTES = 2**26
MOST_TIMES = 100


def most_bytes(file_size):
    """How much a file of so many bytes may ask for."""
    return max(FREE_BYTES, MOST_TIMES * file_size)


def check_claim(what, n_bytes, file_size):
    """Refuse what a file would take in memory, if that is out of all proportion.

    Parameters
    ----------
    what : str
        What takes it, for the error.
    n_bytes, file_size : int

    Raises
    ------
    ValueError
        If it is.
    """
    if n_bytes > most_bytes(file_size):
        raise ValueError(
            f"{what} would take {n_bytes} bytes, out of a file of {file_size}: "
            f"expected {most_bytes(file_size)} at most"
        )


def check_table(n_tracks, n_frames, file_size):
    """As :func:`check_claim`, for tracks (16 bytes an entry) that a text lists."""
    most = most_bytes(file_size) // 16
    if n_tracks * n_frames > most:
        raise ValueError(
            f"{n_tracks} tracks in {n_frames} frames are more than {most} entries, the "
            f"most that are expected of a file of {file_size} bytes"
        )


def whole_numbers(numbers, name):
    """Numbers as integers, if that is what they are."""
    numbers = np.asarray(numbers)
    if (
        numbers.dtype.kind not in "fiub"
        or not (
            (np.abs(numbers.astype(float)) < 2**53) & (numbers == np.round(numbers))
        ).all()
    ):
        raise ValueError(f"{name} must be whole numbers; got others")
    return numbers.astype(int)
