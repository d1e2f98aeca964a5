"""How many tracks are fitted, and what memory that takes."""

from __future__ import annotations

import os

import numpy as np

from .._utils.warning import warn_user

# Landmarks for tracks that are seen in every frame. Where each is seen in fewer, there
# are more, for as many in a frame, up to the largest number.
TRACKS_PER_FRAME = 500
LEAST_LANDMARKS, MOST_LANDMARKS = 1000, 1500
# So many times the landmarks are still fitted as they are: to choose among them would
# lose more than it saves.
WORTH_CHOOSING = 1.5
# Tracks placed at a time.
TRACKS_PER_BATCH = 2048
# Bytes that an affinity between two tracks takes at the worst moment of a fit, per
# model: as it is, sparsified twice and normalised for two sets of models.
BYTES_PER_AFFINITY = 80
# Memory that is taken without a word.
SMALL_BYTES = 4 * 2**30


def number_of_landmarks(n_landmarks, visibility, n_models):
    """How many of the tracks are to be fitted.

    Parameters
    ----------
    n_landmarks : int, "auto" or None
        As given to the segmenter; None is all tracks.
    visibility : ndarray of bool, shape (n_tracks, n_frames)
    n_models : int

    Returns
    -------
    int

    Raises
    ------
    ValueError
        If more are asked for than there are tracks.
    MemoryError
        If so many do not fit into the memory of this machine.
    """
    n_tracks = len(visibility)
    if n_landmarks is None:
        _check_memory(n_tracks, n_models)
        return n_tracks
    if n_landmarks == "auto":
        filled = visibility[:, visibility.any(axis=0)]  # empty frames have no say
        enough = TRACKS_PER_FRAME / (filled.mean() if filled.size else 1)
        enough = int(np.clip(enough, LEAST_LANDMARKS, MOST_LANDMARKS))
        return enough if n_tracks > WORTH_CHOOSING * enough else n_tracks
    if n_landmarks > n_tracks:
        raise ValueError(
            f"n_landmarks={n_landmarks} is more than the tracks "
            f"(n_samples={n_tracks}); 'auto' takes all of them where they are few"
        )
    _check_memory(n_landmarks, n_models)
    return n_landmarks


def _check_memory(n_fitted, n_models):
    needed = BYTES_PER_AFFINITY * n_models * n_fitted**2
    free = _free_bytes()
    if free is not None and needed > free:
        raise MemoryError(
            f"fitting {n_fitted} tracks with {n_models} models takes about "
            f"{_gibibytes(needed)} of memory, and {_gibibytes(free)} are free; "
            "n_landmarks='auto', or a smaller number, fits some tracks and places the "
            "others"
        )
    if needed > SMALL_BYTES:
        warn_user(
            f"fitting {n_fitted} tracks takes about {_gibibytes(needed)} of memory; "
            "n_landmarks='auto' takes far less",
        )


def _gibibytes(n_bytes):
    return f"{n_bytes / 2**30:.1f} GiB"


def _free_bytes():
    """Memory that can be had without swapping; None where the system does not say."""
    try:
        with open("/proc/meminfo", encoding="ascii") as lines:
            for line in lines:
                if line.startswith("MemAvailable:"):
                    return 1024 * int(line.split()[1])
    except (OSError, ValueError, IndexError):
        pass
    try:
        return os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, OSError, ValueError):
        return None
