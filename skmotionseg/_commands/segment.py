"""``skmotionseg segment``: a track file or a video in, motions out."""

from __future__ import annotations

import time
from functools import partial
from itertools import product
from os.path import realpath
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from sklearn.utils import Bunch

from .._segmenter.long_clips import LONG_CLIP
from .._utils.validation import check_each_once, check_ids
from .._utils.writing import (
    check_apart,
    check_kept,
    check_output,
    check_output_folder,
    check_stale,
    motion_file,
)
from ..video._frames import PICTURE_ENDINGS, SMALLEST_SIDE, VIDEO_ENDINGS, is_video
from .console import PICTURES, console_of_findings, count, progress_console
from .findings import print_findings
from .label_files import LABEL_ENDINGS, write_labels
from .live import segment_live
from .long_videos import WINDOWS, segment_stored
from .mask_files import add_mask_options, check_mask_names, check_mask_options
from .method_options import (
    add_method_options,
    check_method_options,
    file_options,
    method_parameters,
    option_name,
)
from .pictures import draw
from .video_tracks import (
    expected_length,
    folder_of,
    goes_in_blocks,
    longest_whole,
    open_video,
    track_at_once,
    track_to,
)

# Options that name what is written, each a file or a folder of its own.
OUTPUTS = (
    "out",
    "split_dir",
    "render",
    "report",
    "masks",
    "static_masks",
    "prompts",
    "viewer",
    "resume",
)
OPTIONS: dict[str, dict[str, Any]] = {
    "--out": {
        "type": Path,
        "help": "write the labels: .npz, with the tracks; or .csv, for videos with one "
        "row per observation",
    },
    "--confidence": {
        "action": "store_true",
        "help": "with --out: write the confidence of each label, from 0 to 1",
    },
    "--split-dir": {
        "type": Path,
        "help": "folder to write one track file per motion to, in place of those of an "
        "earlier run, which must not have been more",
    },
    "--render": {
        "type": Path,
        "help": "draw the motions of a track file: .png, .pdf, .svg or .jpg; or the "
        "moving objects of a video: .mp4, or .png for a contact sheet of frames. With "
        "--live, the motions: .mp4",
    },
    "--report": {
        "type": Path,
        "help": "draw the motions, the models that explain them and the cost of each "
        f"number of motions, of clips of up to {LONG_CLIP} frames: .png, .pdf, .svg or "
        ".jpg",
    },
}
VIDEO_OPTIONS: dict[str, dict[str, Any]] = {
    "--grid": {
        "type": partial(count, least=2),
        "help": "distance between tracks in pixels (default: 8; 5 to 7 for small "
        "frames)",
    },
    "--stride": {
        "type": count,
        "default": 1,
        "help": "use only every STRIDE-th frame (default: 1); labels count the frames "
        "that are used, masks are named after those of the video",
    },
    "--max-frames": {
        "type": partial(count, least=2),
        "help": "number of frames to read (default: all)",
    },
    "--resume": {
        "type": Path,
        "metavar": "DIR",
        "help": "folder for tracks and labels of windows: after an interruption, the "
        "same command continues from there",
    },
    "--max-side": {
        "type": partial(count, least=SMALLEST_SIDE),
        "help": "before tracking, shrink larger frames to this length of the longer "
        "side, in pixels (default: never)",
    },
}


def add_segment(commands):
    """Add the command to a parser's."""
    segment = commands.add_parser(
        "segment",
        help="segment a track file or a video",
        description="Segment the tracks of a .npz, .npy, .mat, .csv or .dat file, or "
        f"track and segment a video ({', '.join(VIDEO_ENDINGS)}) or a folder of frames "
        "(.png, .jpg).",
    )
    segment.add_argument("file", type=Path, metavar="INPUT")
    for name, options in OPTIONS.items():
        segment.add_argument(name, **options)
    add_method_options(segment)
    videos = segment.add_argument_group("videos")
    for name, options in VIDEO_OPTIONS.items():
        videos.add_argument(name, **options)
    videos.add_argument(
        "--live",
        action="store_true",
        help="segment frame by frame, for a camera (INPUT is its number) or a video; "
        "memory does not grow with the video. Draws in a window, if there is a display "
        "that OpenCV can use, and to --render .mp4; labels are written to --out .csv "
        "continuously. Ctrl-C ends it and completes the files",
    )
    videos.add_argument(
        "--no-window", action="store_true", help="with --live: open no window"
    )
    add_mask_options(videos)
    segment.set_defaults(run=_segment)


class _Run(NamedTuple):
    """What goes through the command: its options, what segments, what is printed to."""

    arguments: Any
    segmenter: Any
    console: Any
    progress: Any
    started: float


def _segment(arguments):
    from ..segmentation import MotionSegmenter

    if arguments.live:
        segment_live(arguments)
        return
    video = is_video(arguments.file)
    _check_options(arguments, video)
    segmenter = MotionSegmenter(**method_parameters(arguments))
    segmenter._check_parameters()  # not only once a video is tracked
    run = _Run(
        arguments,
        segmenter,
        # Whoever lacks both extras is told so at once.
        console_of_findings("cli,video" if video else "cli"),
        progress_console(),
        time.perf_counter(),
    )
    if video:
        _segment_video(run)
    else:
        _segment_tracks(run, _load_tracks(arguments))


def _segment_video(run):
    """Track a video; segment its tracks at once, or those of a long one in windows."""
    arguments, segmenter, _, progress, started = run
    frames = open_video(arguments.file, arguments.stride)
    check_mask_names(arguments, frames)
    _check_length(arguments, expected_length(arguments, frames))
    if not goes_in_blocks(arguments, frames):
        tracks, size = track_at_once(arguments, frames, progress)
    else:
        with folder_of(arguments) as folder:
            clip = track_to(folder, arguments, frames, progress)
            if arguments.resume is not None:
                segmenter.set_params(memory=folder / WINDOWS)
            if clip.n_frames > longest_whole(arguments):
                segment_stored(run, clip, frames)
                return
            tracks, size = clip.matrix(), clip.size
    sequence = _sequence(arguments, frames, tracks, size)
    sequence.seconds["tracking"] = time.perf_counter() - started
    _segment_tracks(run, sequence)


def _segment_tracks(run, sequence):
    """Segment tracks that are in memory; draw, write and print what is found."""
    arguments, segmenter, console, progress, started = run
    _check_length(arguments, sequence.data.shape[1] // 2)
    with progress.status("segmenting ..."):
        segmenter.fit(sequence.data)
    sequence.seconds |= segmenter.stage_seconds_
    sequence.seconds["segmenting"] = sequence.seconds.pop("total")
    if arguments.out is not None:
        sure = segmenter.probabilities_ if arguments.confidence else None
        write_labels(arguments.out, sequence, segmenter.labels_, sure)
    if arguments.split_dir is not None:
        sequence.n_files = _split(arguments, sequence, segmenter.labels_)
    draw(arguments, sequence, segmenter, progress)
    sequence.seconds["total"] = time.perf_counter() - started
    print_findings(console, arguments, sequence, segmenter)


def _split(arguments, sequence, labels):
    """Write a file per motion; how many there are."""
    from ..export import save_motions

    files = save_motions(
        arguments.split_dir, sequence.data, labels, track_ids=sequence.track_ids
    )
    return len(files)


def _check_options(arguments, video):
    """Refuse options that do not go together, and files that cannot be written."""
    check_output(arguments.out, LABEL_ENDINGS)
    _check_split(arguments)
    check_output(arguments.render, (".mp4", ".png") if video else PICTURES)
    check_output(arguments.report, PICTURES)
    check_mask_options(arguments, video)
    check_method_options(arguments, video)
    check_output_folder(arguments.resume)
    check_apart(
        arguments.file, {option_name(n): getattr(arguments, n) for n in OUTPUTS}
    )
    _check_pictures(arguments)
    if not video:
        _check_no_video_options(arguments)
    if arguments.confidence and arguments.out is None:
        raise ValueError("--confidence is written with the labels: add --out FILE")


def _check_split(arguments):
    """Refuse a folder with files that would be lost, or that would stay.

    That is with what is read or written otherwise, or with more motions, of an earlier
    run, than there can be.
    """
    check_output_folder(arguments.split_dir)
    if arguments.split_dir is None:
        return
    check_kept(
        arguments.split_dir, {"the input": arguments.file, "--out": arguments.out}
    )
    auto = arguments.motions == "auto"
    most = arguments.max_motions if auto else arguments.motions
    if most is not None:
        check_stale(arguments.split_dir, [*map(motion_file, range(-1, most))])


def _check_no_video_options(arguments):
    """Refuse options on how videos are tracked, where tracks are given."""
    options = {**VIDEO_OPTIONS, "--no-window": {"default": False}}
    for option, settings in options.items():
        given = getattr(arguments, option.removeprefix("--").replace("-", "_"))
        if given != settings.get("default"):
            raise ValueError(
                f"{option} is for videos; {arguments.file} is a file of tracks"
            )


def _check_pictures(arguments):
    """Refuse pictures among the frames of a folder, or masks: they would be some."""
    folders = {
        "frames": arguments.file if arguments.file.is_dir() else None,
        "masks": arguments.masks,
        "static masks": arguments.static_masks,
    }
    pictures = [
        path
        for path in (arguments.render, arguments.report)
        if path is not None and path.suffix.lower() in PICTURE_ENDINGS
    ]
    for path, (kind, folder) in product(pictures, folders.items()):
        if folder is not None and realpath(path.absolute().parent) == realpath(folder):
            raise ValueError(
                f"{path} would be one of the {kind} in {folder}: write it to another "
                "folder"
            )


def _check_length(arguments, n_frames):
    """Refuse a report of a clip that is taken in windows, if its length is known."""
    if arguments.report is not None and n_frames and n_frames > LONG_CLIP:
        fewer = " (--max-frames takes the first)" if is_video(arguments.file) else ""
        raise ValueError(
            f"--report is for clips of up to {LONG_CLIP} frames; {arguments.file} has "
            f"{n_frames}{fewer}"
        )


def _load_tracks(arguments):
    from ..datasets import load_tracks

    sequence = load_tracks(arguments.file, **file_options(arguments))
    sequence.setdefault("track_ids", np.arange(len(sequence.data)))
    if arguments.split_dir is not None:  # not only once they are segmented
        check_ids(sequence.track_ids, len(sequence.data))
    elif arguments.out is not None:
        check_each_once(sequence.track_ids)
    return Bunch(**sequence, video={}, seconds={}, objects=None)


def _sequence(arguments, frames, tracks, size):
    """Tracks of a video as :func:`skmotionseg.datasets.load_tracks` gives a file's."""
    width, height = size
    fps = np.nan if frames.fps is None else frames.fps
    return Bunch(
        data=tracks,
        target=None,
        name=arguments.file.stem,
        track_ids=np.arange(len(tracks)),
        frames=frames,
        video={"width": width, "height": height, "fps": fps},
        seconds={},
        objects=None,
    )
