"""``skmotionseg segment`` on a long video: tracks in files, windows one by one."""

from __future__ import annotations

import tempfile
import time
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from sklearn.utils import check_random_state

from .._segmenter.long_clips import LONG_CLIP, segment_in_windows
from .._utils.writing import replacing
from .._version import __version__
from ..video._tracking import MAX_ERROR, MIN_TEXTURE
from .console import facts_table, reporting
from .stored_tracks import StoredTracks, track_into

# Outputs for which all tracks are needed at once, in memory.
WHOLE = (
    "render",
    "report",
    "split_dir",
    "masks",
    "static_masks",
    "prompts",
    "viewer",
)
# Folder of what windows have given, within that of a run.
WINDOWS = "windows"


def goes_in_blocks(arguments, frames):
    """Whether the tracks of a video are kept in files: it is long, or may go on."""
    length = _expected(arguments, frames)
    is_long = length is None or length > LONG_CLIP
    return arguments.resume is not None or (is_long and not needs_whole(arguments))


def _expected(arguments, frames):
    """Frames that there should be; None if nobody says."""
    some = [n for n in (frames.n_announced, arguments.max_frames) if n is not None]
    return min(some, default=None)


def needs_whole(arguments):
    """Whether an output needs all tracks in memory."""
    as_matrix = arguments.out is not None and arguments.out.suffix.lower() == ".npz"
    return as_matrix or any(getattr(arguments, name) is not None for name in WHOLE)


@contextmanager
def folder_of(arguments):
    """The folder of a run: that to resume, or one that is removed in the end."""
    if arguments.resume is not None:
        yield arguments.resume
        return
    with tempfile.TemporaryDirectory(prefix="skmotionseg-") as folder:
        yield Path(folder)


def track_to(folder, arguments, frames, console):
    """Track a video into a folder.

    Returns
    -------
    StoredTracks
    """
    path = arguments.file.resolve()
    settings = {
        "file": str(path),
        "bytes": path.stat().st_size if path.is_file() else frames.n_announced,
        "grid": arguments.grid,
        "stride": arguments.stride,
        "max-frames": arguments.max_frames,
        "max-side": arguments.max_side,
        "version": __version__,
    }
    stored = StoredTracks(folder, settings)
    options = {
        "grid_spacing": arguments.grid,
        "max_error": MAX_ERROR,
        "min_texture": MIN_TEXTURE,
        "max_side": arguments.max_side,
    }
    expected = _expected(arguments, frames)
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
    return stored


def segment_stored(segmenter, clip, arguments, console, progress):
    """Segment a long video whose tracks are stored, and write its labels.

    Parameters
    ----------
    segmenter : MotionSegmenter
        Not fitted. The labels are those that it would give to the matrix of the tracks
        if each frame sees some.
    clip : StoredClip
    arguments : argparse.Namespace
    console, progress : rich.console.Console
        For what is found, and for how far it is.
    """
    started = time.perf_counter()
    rng = check_random_state(segmenter.random_state)
    with reporting("windows", progress) as report:
        found = segment_in_windows(clip, segmenter, rng, report)
    facts = [
        ("tracks", str(clip.n_tracks)),
        ("frames", str(clip.n_frames)),
        ("windows", str(len(clip.parts))),
        ("motions found", str(int(found.labels.max(initial=-1)) + 1)),
        ("seconds segmenting", f"{time.perf_counter() - started:.3f}"),
    ]
    if arguments.out is not None:
        sure = found.shares if arguments.confidence else None
        _write_table(arguments.out, clip, found.labels, sure)
    console.print(facts_table(arguments.file.name, facts))
    if arguments.out is not None:
        console.print(f"labels: {arguments.out}", highlight=False)


def _write_table(path, clip, labels, probabilities):
    """A row per observation, frame by frame."""
    header, form = "track,frame,x,y,label", "%d,%d,%.3f,%.3f,%d"
    if probabilities is not None:
        header, form = f"{header},probability", f"{form},%.3f"
    with replacing(path) as file:
        file.write(f"{header}\n".encode())
        for number, (rows, points) in enumerate(clip.frames()):
            columns = [rows, np.full(len(rows), number), points, labels[rows]]
            if probabilities is not None:
                columns.append(probabilities[rows])
            np.savetxt(file, np.column_stack(columns), fmt=form)
