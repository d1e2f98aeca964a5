"""``skmotionseg segment`` on a long video: its tracks in files, windows one by one."""

from __future__ import annotations

import time

from sklearn.utils import check_random_state

from .._segmenter.long_clips import segment_in_windows
from .console import facts_table, reporting
from .label_files import write_labels_by_frame

# Folder of what windows have given, within that of a run.
WINDOWS = "windows"


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
        ("motions per window", f"{found.counts.min()} to {found.counts.max()}"),
        ("seconds segmenting", f"{time.perf_counter() - started:.3f}"),
    ]
    if arguments.out is not None:
        sure = found.shares if arguments.confidence else None
        write_labels_by_frame(arguments.out, clip, found.labels, sure)
    console.print(facts_table(arguments.file.name, facts))
    if arguments.out is not None:
        console.print(f"labels: {arguments.out}", highlight=False)
