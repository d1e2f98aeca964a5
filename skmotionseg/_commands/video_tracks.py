"""Tracks of a video for ``skmotionseg segment``: in memory, or in files if long."""

from __future__ import annotations

import hashlib
import os
import tempfile
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from .._segmenter.long_clips import LONG_CLIP
from .._version import __version__
from ..video._frames import open_frames
from ..video._tracking import MAX_ERROR, MIN_TEXTURE
from .console import reporting
from .mask_files import wants_masks
from .stored_tracks import StoredClip, StoredTracks, track_into

# Outputs for which all tracks are needed at once, in memory; and frames of the longest
# video whose tracks are for masks, longer ones being taken in blocks.
WHOLE = ("render", "report", "split_dir", "prompts", "viewer")
LONGEST_WHOLE = 500
# Pieces of a video, and their bytes, by which one is told from another: all of it, if
# it is small.
PIECES, PIECE = 256, 2**16
# Tracks of one homography, without which nothing is said.
FEWEST_TRACKS = 4


def open_video(source, stride):
    """The frames of a video, or of a camera, that are to be read."""
    # What OpenCV prints of a damaged video, the error says in one line. Once it has
    # been imported, it would not heed this.
    os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")
    return open_frames(source, cameras=True).every(stride)


def goes_in_blocks(arguments, frames):
    """Whether the tracks of a video are kept in files: it is long, or may go on."""
    length = expected_length(arguments, frames)
    is_long = length is None or length > longest_whole(arguments)
    return arguments.resume is not None or is_long


def expected_length(arguments, frames):
    """Frames that there should be; None if nobody says."""
    some = [n for n in (frames.n_announced, arguments.max_frames) if n is not None]
    return min(some, default=None)


def longest_whole(arguments):
    """Frames of the longest video whose tracks are taken into memory at once."""
    as_matrix = arguments.out is not None and arguments.out.suffix.lower() == ".npz"
    if as_matrix or any(getattr(arguments, name) is not None for name in WHOLE):
        return np.inf
    return LONGEST_WHOLE if wants_masks(arguments) else LONG_CLIP


def track_at_once(arguments, frames, console):
    """Track a video in memory.

    Returns
    -------
    tracks : ndarray of shape (n_tracks, 2 * n_frames)
        Those that are long enough.
    size : tuple of (int, int)
        Width and height of the frames.
    """
    from ..preprocessing import select_long_tracks
    from ..video import track_video

    with reporting("tracking", console) as progress:
        video = track_video(
            frames,
            grid_spacing=arguments.grid,
            max_frames=arguments.max_frames,
            max_side=arguments.max_side,
            progress=progress,
        )
    kept = np.zeros(len(video.tracks), dtype=bool)
    if len(kept):
        kept = select_long_tracks(video.tracks, shortest_track(video.n_frames))
    _check_kept(arguments, kept.sum(), video.n_frames)
    return video.tracks[kept], (video.width, video.height)


@contextmanager
def folder_of(arguments):
    """The folder of a run: that to resume, or one that is removed in the end."""
    if arguments.resume is not None:
        yield arguments.resume
        return
    with tempfile.TemporaryDirectory(prefix="skmotionseg-") as folder:
        yield Path(folder)


def track_to(folder, arguments, frames, console):
    """Track a video into a folder, or go on with it there.

    Returns
    -------
    StoredClip
        Of the tracks that are long enough.
    """
    stored = StoredTracks(folder, _settings(arguments, frames))
    options = {
        "grid_spacing": arguments.grid,
        "max_error": MAX_ERROR,
        "min_texture": MIN_TEXTURE,
        "max_side": arguments.max_side,
    }
    expected = expected_length(arguments, frames)
    with reporting("tracking", console) as report:
        track_into(
            stored,
            frames,
            options,
            arguments.max_frames,
            lambda done: report(done, expected),
        )
    if stored.n_frames < 2:
        raise ValueError(
            f"tracks need two frames or more; {frames.name} has {stored.n_frames}"
        )
    clip = StoredClip(stored, shortest_track(stored.n_frames))
    _check_kept(arguments, clip.n_tracks, stored.n_frames)
    return clip


def _settings(arguments, frames):
    """What the tracks depend on; of those that differ, the first is named."""
    path = arguments.file.resolve()
    files = [path] if frames.names is None else [path / n for n in frames.names]
    return {
        "file": str(path),
        "grid": arguments.grid,
        "stride": arguments.stride,
        "max-frames": arguments.max_frames,
        "max-side": arguments.max_side,
        # Of the frames that are used, which depends on the stride.
        "content": None if arguments.resume is None else _content(files),
        "version": __version__,
    }


def _content(files):
    """A digest of the names and sizes of some files, and of pieces of what they hold.

    Another video may have the same place, length and size.
    """
    digest = hashlib.sha256()
    n_pieces = max(1, PIECES // len(files))
    for file in files:
        size = file.stat().st_size
        digest.update(f"{file.name} {size}\n".encode())
        with file.open("rb") as stream:
            for start in np.linspace(0, max(0, size - PIECE), n_pieces, dtype=int):
                stream.seek(start)
                digest.update(stream.read(PIECE))
    return digest.hexdigest()[:16]


def _check_kept(arguments, n_kept, n_frames):
    if n_kept >= FEWEST_TRACKS:
        return
    far_apart = "" if arguments.grid is None else f", or --grid {arguments.grid} is far"
    points = f"{n_kept} points" if n_kept > 1 else f"{n_kept or 'no'} point"
    raise ValueError(
        f"{points} of {arguments.file} could be followed for "
        f"{shortest_track(n_frames)} frames: there is too little texture{far_apart}"
    )


def shortest_track(n_frames):
    """Five frames, or all of fewer; up to ten of many: short tracks say little."""
    return min(n_frames, int(np.clip(n_frames // 8, 5, 10)))
