"""Labels of tracks that are long out of view, in little memory."""

from __future__ import annotations

import zlib
from typing import NamedTuple

import numpy as np

# Tracks that are kept as they are, and blocks of one size that become one.
TRACKS_PER_BLOCK, BLOCKS_PER_LEVEL = 128, 8


class History:
    """Labels by id, compressed in blocks: about a bit or two per track.

    A tracker numbers its tracks one after another, so ids tell little. An id that is
    added again has its last label.
    """

    def __init__(self):
        self._blocks = []
        self._ids, self._labels = [], []
        self._n_open = 0

    def add(self, ids, labels):
        """Add tracks.

        Parameters
        ----------
        ids, labels : ndarray of int, shape (n,)
        """
        if len(ids) == 0:
            return
        self._ids.append(ids)
        self._labels.append(labels)
        self._n_open += len(ids)
        if self._n_open >= TRACKS_PER_BLOCK:
            self._close()

    def labels_of(self, ids):
        """Labels of ids, -1 for those that are not there."""
        labels = np.full(len(ids), -1)
        for found, known in self._parts(ids):
            _, here, there = np.intersect1d(ids, found, return_indices=True)
            labels[here] = known[there]
        return labels

    def everything(self, ids, labels):
        """Ids, ascending, and labels of all tracks: of these, and of what was added."""
        parts = [*self._parts(), (ids, labels)]
        return _last(*map(np.concatenate, zip(*parts, strict=True)))

    def _parts(self, wanted=None):
        """Blocks of ids, each once, and labels, the oldest first."""
        for block in self._blocks:
            inside = wanted is None or (wanted >= block.least) & (wanted <= block.most)
            if np.any(inside):
                yield _unpacked(block.packed)
        if self._ids:
            yield _last(np.concatenate(self._ids), np.concatenate(self._labels))

    def _close(self):
        """Compress what was added, and join blocks of one size."""
        self._blocks.append(_block(self._ids, self._labels, 0))
        self._ids, self._labels, self._n_open = [], [], 0
        while True:
            last = self._blocks[-BLOCKS_PER_LEVEL:]
            level = last[-1].level
            if len(last) < BLOCKS_PER_LEVEL or last[0].level != level:
                return
            del self._blocks[-BLOCKS_PER_LEVEL:]
            ids, labels = zip(*(_unpacked(block.packed) for block in last), strict=True)
            self._blocks.append(_block(ids, labels, level + 1))


class _Block(NamedTuple):
    """Compressed ids and labels, and how often the block was joined."""

    least: int
    most: int
    packed: bytes
    level: int


def _block(ids, labels, level):
    ids, labels = _last(np.concatenate(ids), np.concatenate(labels))
    return _Block(int(ids[0]), int(ids[-1]), _packed(ids, labels), level)


def _last(ids, labels):
    """Ids, ascending and each once, with their last labels."""
    ids, first = np.unique(ids[::-1], return_index=True)
    return ids, labels[::-1][first]


def _packed(ids, labels):
    both = np.stack([np.diff(ids, prepend=0), labels])
    # Bytes of one significance beside each other: most are alike.
    planes = np.ascontiguousarray(both.astype("<i8")).view(np.uint8)
    return zlib.compress(planes.reshape(-1, 8).T.tobytes())


def _unpacked(packed):
    planes = np.frombuffer(zlib.decompress(packed), np.uint8).reshape(8, -1)
    steps, labels = np.ascontiguousarray(planes.T).view("<i8").reshape(2, -1)
    return steps.cumsum(), labels.astype(np.int64)
