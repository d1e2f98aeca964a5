"""``skmotionseg segment`` on a long video: its tracks in files, windows one by one."""

from __future__ import annotations

import time

from sklearn.utils import check_random_state

from .._core.partition.scene import ranked
from .._segmenter.long_clips import segment_in_windows
from .console import facts_table, print_files, reporting
from .label_files import write_labels_by_frame
from .long_objects import find_objects_in_blocks
from .mask_files import make_folders, wants_masks, warn_of_others, write_mask

# Folder of what windows have given, within that of a run.
WINDOWS = "windows"


def segment_stored(run, clip, frames):
    """Segment a long video whose tracks are stored, and write its labels and masks.

    Parameters
    ----------
    run : tuple
        Arguments, what segments, consoles for what is found and for how far it is, and
        when all of it began.
        The labels are those that the segmenter would give to the matrix of the tracks
        if each frame sees some.
    clip : StoredClip
    frames : Frames
        Of the video.
    """
    arguments, segmenter, console, progress, begun = run
    started = time.perf_counter()
    rng = check_random_state(segmenter.random_state)
    with reporting("windows", progress) as report:
        found = segment_in_windows(clip, segmenter, rng, report)
    facts = [
        ("tracks", str(clip.n_tracks)),
        ("frames", str(clip.n_frames)),
        ("windows", str(len(clip.parts))),
        ("motions found", str(found.n_motions)),
        ("motions per window", f"{found.counts.min()} to {found.counts.max()}"),
        ("seconds segmenting", f"{time.perf_counter() - started:.3f}"),
    ]
    if arguments.out is not None:
        sure = found.shares if arguments.confidence else None
        write_labels_by_frame(arguments.out, clip, found.labels, sure)
    if wants_masks(arguments):
        masked = time.perf_counter()
        objects = _write_masks(arguments, frames, clip, found.labels, progress)
        facts.append(("moving objects", str(objects.max(initial=0))))
        facts.append(("seconds for masks", f"{time.perf_counter() - masked:.3f}"))
    facts.append(("seconds total", f"{time.perf_counter() - begun:.3f}"))
    console.print(facts_table(arguments.file.name, facts))
    files = {
        "labels": arguments.out,
        "masks": arguments.masks,
        "static masks": arguments.static_masks,
    }
    print_files(console, files)


def _write_masks(arguments, frames, clip, labels, console):
    """Write masks of things that are found in blocks of frames; give these."""
    from ..video._masks import paint_masks
    from ..video._recognition import known_again

    with reporting("objects", console) as report:
        objects = find_objects_in_blocks(clip, labels, report)
    with reporting("what comes back", console) as report:
        objects = known_again(frames, clip.frames, objects, clip.size, report)
    objects = ranked(objects, clip.times)
    make_folders(arguments)
    tracked, n_frames = clip.frames(), clip.n_frames
    with reporting("masks", console) as progress:
        masks = paint_masks(frames, n_frames, tracked, objects, progress=progress)
        for number, mask in enumerate(masks):
            write_mask(arguments, frames.name_of(number), mask)
    warn_of_others(arguments, map(frames.name_of, range(n_frames)))
    return objects
