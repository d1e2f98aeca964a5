"""Things that move in a long video, found in blocks of frames and joined."""

from __future__ import annotations

import numpy as np
from scipy.optimize import linear_sum_assignment

from .._core.geometry.tracks import pack_tracks
from ..video import find_objects
from ..video._masks import MOST_LABELS

# Frames of a block, and those that it has in common with the next.
BLOCK_FRAMES, COMMON_FRAMES = 300, 100
# Numbers of things that a mask has room for: 0 is the static scene.
MOST_NUMBERS = MOST_LABELS - 1


def find_objects_in_blocks(clip, labels, report=None):
    """As :func:`skmotionseg.video.find_objects`, with a block of frames in memory.

    A thing most of whose tracks were of one thing in the block before, is that. Where
    there are more than a mask has numbers for, those that were not seen for longest are
    given again; where one block has more, its smallest count as static.

    Parameters
    ----------
    clip : StoredClip
    labels : ndarray of int, shape (n_tracks,)
        Rigid motion of each track, as for :func:`find_objects`.
    report : callable, optional
        Called after each block with the number done and the number there will be.

    Returns
    -------
    ndarray of int, shape (n_tracks,)
        0 for the static scene; 1, 2, ... for things; -1 for tracks of none.
    """
    width, height = clip.size
    objects = np.full(clip.n_tracks, -1)
    times = np.zeros(clip.n_tracks, dtype=int)  # in the block that an object is of
    last_seen = np.full(MOST_NUMBERS + 1, -1)  # block, by number
    blocks = block_ends(clip.n_frames)
    for number, ends in enumerate(blocks):
        part = clip.part(*ends)
        points, seen = clip.window(part)
        found = find_objects(
            pack_tracks(points, layout="tracks_first"),
            labels[part.tracks],
            width=width,
            height=height,
        )
        before = objects[part.tracks]
        found = np.where(found > 0, _numbers(found, before, last_seen)[found], found)
        last_seen[np.unique(found[found > 0])] = number
        here = seen.sum(axis=1)
        longer = here > times[part.tracks]
        objects[part.tracks[longer]] = found[longer]
        times[part.tracks[longer]] = here[longer]
        if report is not None:
            report(number + 1, len(blocks))
    return objects


def block_ends(n_frames):
    """First frames of blocks and those after their last: [(start, stop), ...]."""
    step = BLOCK_FRAMES - COMMON_FRAMES
    n_blocks = 1 + max(0, -(-(n_frames - BLOCK_FRAMES) // step))
    ends = [(k * step, k * step + BLOCK_FRAMES) for k in range(n_blocks)]
    return [(start, min(stop, n_frames)) for start, stop in ends]


def _numbers(found, before, last_seen):
    """The number of each thing of a block: that of the thing before, or a new one.

    Parameters
    ----------
    found, before : ndarray of int, shape (n,)
        Things of a block's tracks, and what the blocks before have said of these.
    last_seen : ndarray of int, shape (MOST_NUMBERS + 1,)

    Returns
    -------
    ndarray of int, shape (n_things + 1,)
        By thing; that of 0 is 0.
    """
    judged = (found > 0) & (before >= 0)
    shared = np.zeros((found.max(initial=0) + 1, MOST_NUMBERS + 1), dtype=int)
    np.add.at(shared, (found[judged], before[judged]), 1)
    things, old = (1 + k for k in linear_sum_assignment(-shared[1:, 1:]))
    most = 2 * shared[things, old] > shared[things].sum(axis=1)
    numbers = np.zeros(len(shared), dtype=int)
    numbers[things[most]] = old[most]
    last_seen = last_seen.copy()
    last_seen[[0, *numbers]] = np.iinfo(last_seen.dtype).max
    for thing in np.flatnonzero(numbers[1:] == 0) + 1:
        numbers[thing] = last_seen.argmin()  # the first that never was, if there is one
        last_seen[numbers[thing]] = np.iinfo(last_seen.dtype).max
    return numbers
