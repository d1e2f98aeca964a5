"""Tracks of a video in a folder: tracking goes on where it was interrupted."""

from __future__ import annotations

import json
import zlib
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from .._core.geometry.tracks import covered, first_after_cuts, pack_tracks
from .._core.stream.joining import FEWEST_SEEN, Part, window_ends
from .._segmenter.long_clips import FEWEST_AT_CUT, extent_of
from .._utils.writing import replacing
from ..video._looks import SLIDING, without_sliding
from ..video._tracking import PointTracker, TrackerState

# Frames of a file: what is lost at most.
BLOCK = 20
SETTINGS = "run.json"
# What a file holds of its frames one after the other, and how many of each frame.
COUNTS = {"ids": "counts", "points": "counts", "slid": "slid_counts"}


class StoredTracks:
    """Tracks of a video in files of some frames each.

    A file is there whole or not at all, and holds all that tracking goes on from.

    Parameters
    ----------
    folder : Path
        Made if it is not there.
    settings : dict of str to str, number or None
        What the tracks depend on.

    Attributes
    ----------
    n_frames : int
        Frames that are stored.
    is_whole : bool
        Whether the video ended after them.

    Raises
    ------
    ValueError
        If the folder holds something else, files that are damaged, or tracks of other
        settings.
    """

    def __init__(self, folder, settings):
        self.folder, self._settings = Path(folder), settings
        self.folder.mkdir(exist_ok=True)
        self.n_frames, self.is_whole = 0, False
        path = self.folder / SETTINGS
        if not path.exists():
            if any(self.folder.iterdir()):
                raise ValueError(f"{folder} holds no run that could be resumed")
            self._note(None)
            return
        known, n_frames = _noted(path)
        for name, value in settings.items():
            if known.get(name) != value:
                raise ValueError(
                    f"{folder} is of another run: its {name} is "
                    f"{known.get(name)!r}, and this one's {value!r}"
                )
        while self._path(self.n_frames).exists():
            self.n_frames += len(_read(self._path(self.n_frames))["counts"])
        self.is_whole = n_frames == self.n_frames

    def append(self, tracked, state, size):
        """Store frames.

        Parameters
        ----------
        tracked : list of (ids, points, slid)
            As :func:`~skmotionseg.video._looks.without_sliding` takes them.
        state : TrackerState
            After the last of them.
        size : tuple of (int, int)
            Width and height.
        """
        ids, points, slid = zip(*tracked, strict=True)
        with replacing(self._path(self.n_frames)) as file:
            np.savez(
                file,
                counts=list(map(len, ids)),
                ids=np.concatenate(ids).astype(np.int32),
                points=np.concatenate(points, dtype="f4"),
                slid_counts=list(map(len, slid)),
                slid=np.concatenate(slid).astype(np.int32),
                size=size,
                last_points=state.points,
                last_ids=state.ids,
                last_numbers=[state.n_born, state.spacing, state.n_frames],
                last_patches=state.patches,
                last_places=state.places,
            )
        self.n_frames += len(tracked)

    def end(self):
        """Note that the video has no more frames."""
        self._note(self.n_frames)
        self.is_whole = True

    @property
    def size(self):
        """Width and height of a frame."""
        return tuple(map(int, self._last()["size"]))

    @property
    def state(self):
        """The state of the tracker after the last frame; None before the first."""
        if not self.n_frames:
            return None
        last = self._last()
        n_born, spacing, n_frames = map(int, last["last_numbers"])
        points, ids, patches, places = (
            last[f"last_{name}"] for name in ("points", "ids", "patches", "places")
        )
        return TrackerState(points, ids, n_born, spacing, patches, places, n_frames)

    def frames(self, start=0, stop=None):
        """Yield ids, int32, and points (n, 2), float32, of some frames."""
        stop = self.n_frames if stop is None else stop
        tracked = self._tracked(start, min(stop + SLIDING, self.n_frames))
        yield from islice(without_sliding(tracked), stop - start)

    def _tracked(self, start, stop):
        """Yield ids, points, and the ids of what has slid, of some frames."""
        for first in range(start - start % BLOCK, stop, BLOCK):
            block = _read(self._path(first))
            parts = [
                np.split(block[name], np.cumsum(block[counts])[:-1])
                for name, counts in COUNTS.items()
            ]
            wanted = slice(max(start - first, 0), stop - first)
            yield from islice(zip(*parts, strict=True), wanted.start, wanted.stop)

    def _last(self):
        return _read(self._path((self.n_frames - 1) // BLOCK * BLOCK))

    def _path(self, first):
        return self.folder / f"tracks-{first:09d}.npz"

    def _note(self, n_frames):
        with replacing(self.folder / SETTINGS) as file:
            noted = {"settings": self._settings, "n_frames": n_frames}
            file.write(json.dumps(noted, indent=1).encode())


def _noted(path):
    """The settings that a run has noted, and the frames of its video, if it is done."""
    with _named_if_damaged(path):
        known = json.loads(path.read_text())
        return {**known["settings"]}, known["n_frames"]


def _read(path):
    with _named_if_damaged(path), np.load(path) as file:
        return dict(file)


@contextmanager
def _named_if_damaged(path):
    """Name a file that cannot be read as what it is."""
    try:
        yield
    except (BadZipFile, EOFError, KeyError, TypeError, ValueError, zlib.error) as error:
        raise ValueError(
            f"{path} is damaged: remove {path.parent} to begin anew"
        ) from error


def track_into(stored, frames, options, max_frames, report):
    """Track the frames of a video that are not stored yet.

    Parameters
    ----------
    stored : StoredTracks
    frames : Frames
    options : dict
        Of :class:`PointTracker`.
    max_frames : int or None
    report : callable
        Called after each frame with the number done.
    """
    if stored.is_whole:
        return
    iterator = islice(frames, max_frames)
    last = None
    if stored.n_frames:
        last = next(islice(iterator, stored.n_frames - 1, None))
    tracker = PointTracker(**options, state=stored.state, last=last)
    tracked: list = []
    size = (0, 0)
    for frame in iterator:
        each = tracker.step(frame)
        size = frame.shape[1], frame.shape[0]
        tracked.append((each.ids, each.points, tracker.slid))
        if len(tracked) == BLOCK:
            stored.append(tracked, tracker.state, size)
            tracked = []
        report(stored.n_frames + len(tracked))
    if tracked:
        stored.append(tracked, tracker.state, size)
    stored.end()


class StoredClip:
    """Stored tracks as a long clip, of which a window at a time is in memory.

    Parameters
    ----------
    stored : StoredTracks
    shortest : int
        Frames of a track that is kept, not fewer than a window must see of it.

    Attributes
    ----------
    n_tracks, n_frames : int
        Tracks that are kept, and frames.
    times : ndarray of int, shape (n_tracks,)
        How many frames see each of them.
    rows : ndarray of int, shape (n_ids,)
        Which of them an id is; -1 of those that are too short.
    extent, parts, cuts
        As of :class:`~skmotionseg._segmenter.long_clips.LongClip`.
    """

    def __init__(self, stored, shortest):
        self._stored, self.n_frames = stored, stored.n_frames
        state = stored.state
        n_born = 0 if state is None else state.n_born
        times, first, last = np.zeros((3, n_born), dtype=np.int32)
        for number, (ids, _) in enumerate(stored.frames()):
            first[ids[times[ids] == 0]] = number
            last[ids] = number
            times[ids] += 1
        kept = times >= shortest
        self.cuts = first_after_cuts(
            first[kept], last[kept], stored.n_frames, FEWEST_AT_CUT
        )
        self.rows = np.where(kept, np.cumsum(kept) - 1, -1).astype(np.int32)
        self.n_tracks, self.times = int(kept.sum()), times[kept]
        corners = [
            corner
            for ids, points in stored.frames()
            if kept[ids].any()
            for corner in covered(points[kept[ids]])
        ]
        self.extent = extent_of(corners)
        self.parts = [self.part(*ends) for ends in window_ends(stored.n_frames)]

    @property
    def size(self):
        """Width and height of a frame."""
        return self._stored.size

    def frames(self):
        """Yield rows and points of each frame, of the tracks that are kept."""
        for ids, points in self._stored.frames():
            rows = self.rows[ids]
            yield rows[rows >= 0], points[rows >= 0]

    def window(self, part):
        """Points (n, L, 2) and visibility (n, L) of the tracks of a window."""
        points = np.full((len(part.tracks), part.stop - part.start, 2), np.nan)
        frames = self._stored.frames(part.start, part.stop)
        for frame, (ids, where) in enumerate(frames):
            rows = self.rows[ids]
            _, here, there = np.intersect1d(part.tracks, rows, return_indices=True)
            points[here, frame] = where[there]
        return points, np.isfinite(points).all(axis=2)

    def ends(self, part):
        """First and last frame of a window."""
        return [part.start, part.stop - 1]

    def matrix(self):
        """All tracks as one matrix, float32, which may be large."""
        shape = self.n_tracks, self.n_frames, 2
        points = np.full(shape, np.nan, dtype=np.float32)
        for frame, (rows, where) in enumerate(self.frames()):
            points[rows, frame] = where
        return pack_tracks(points, layout="tracks_first")

    def part(self, start, stop):
        """Some frames, and the tracks that are seen often enough in them."""
        seen = [ids for ids, _ in self._stored.frames(start, stop)]
        ids, times = np.unique(np.concatenate(seen), return_counts=True)
        rows = self.rows[ids[times >= FEWEST_SEEN]]
        return Part(start, stop, rows[rows >= 0])
