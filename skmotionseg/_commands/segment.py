"""``skmotionseg segment``: a track file or a video in, motions out."""

from __future__ import annotations

import os
import time
from itertools import islice
from pathlib import Path
from textwrap import fill
from typing import Any

import numpy as np
from sklearn.utils import Bunch

from .._core.geometry.tracks import unpack_tracks
from .._segmenter.long_clips import LONG_CLIP
from .._segmenter.report import how_sure, pixels
from .._utils.colours import motion_colour
from .._utils.optional import require
from .._utils.writing import check_folder_of, check_output, replacing
from ..video._frames import is_video, open_frames
from .console import (
    PICTURES,
    count,
    facts_table,
    progress_console,
    pyplot,
    reporting,
    save_figure,
    stage_facts,
    track_facts,
)
from .live import segment_live
from .long_videos import (
    WINDOWS,
    folder_of,
    goes_in_blocks,
    needs_whole,
    segment_stored,
    track_to,
)
from .mask_files import add_mask_options, check_mask_options, write_masks
from .method_options import (
    add_method_options,
    check_method_options,
    file_options,
    method_parameters,
)
from .stored_tracks import StoredClip

LABEL_ENDINGS = (".npz", ".csv")


OPTIONS: dict[str, dict[str, Any]] = {
    "--out": {
        "type": Path,
        "help": "write the labels: .npz, with the tracks; or .csv, for videos with one "
        "row per observation",
    },
    "--confidence": {
        "action": "store_true",
        "help": "write with each label how sure it is, from 0 to 1",
    },
    "--split-dir": {
        "type": Path,
        "help": "folder to write one track file per motion to",
    },
    "--render": {
        "type": Path,
        "help": "draw the motions: .png; for videos .mp4, or .png for a sheet of some "
        "frames",
    },
    "--report": {
        "type": Path,
        "help": "draw the motions, the models that explain them and the cost of each "
        "number of motions: .png, .pdf, .svg or .jpg",
    },
}
VIDEO_OPTIONS: dict[str, dict[str, Any]] = {
    "--grid": {
        "type": count,
        "help": "distance between tracks in pixels (default: 8; 5 to 7 for small "
        "frames)",
    },
    "--stride": {
        "type": count,
        "default": 1,
        "help": "read every so many frames (default: 1)",
    },
    "--max-frames": {
        "type": count,
        "help": "number of frames to read (default: all)",
    },
    "--resume": {
        "type": Path,
        "metavar": "DIR",
        "help": "folder that keeps tracks and windows: the same command goes on there "
        "after an interruption",
    },
    "--max-side": {
        "type": count,
        "help": "shrink frames with a longer side to so many pixels before tracking "
        "(default: never)",
    },
}


def add_segment(commands):
    """Add the command to a parser's."""
    segment = commands.add_parser(
        "segment",
        help="segment a track file or a video",
        description="Segment the tracks of a .npz, .npy, .mat, .csv or .dat file, or "
        "track and segment a video (.mp4, .avi, .mov, .mkv) or a folder of frames "
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
        help="segment frame by frame, as for a camera, which is INPUT if that is a "
        "number; memory does not grow with the video, and Ctrl-C ends it well. Draws "
        "to --render .mp4 and writes to --out .csv as it goes",
    )
    add_mask_options(videos)
    segment.set_defaults(run=_segment)


def _segment(arguments):
    from ..export import save_motions
    from ..segmentation import MotionSegmenter

    if arguments.live:
        segment_live(arguments)
        return
    video = is_video(arguments.file)
    _check_options(arguments, video)
    console = require("rich.console", extra="cli").Console()
    progress = progress_console()
    segmenter = MotionSegmenter(**method_parameters(arguments))
    if video:
        sequence = _track_video(arguments, segmenter, console, progress)
        if sequence is None:
            return
    else:
        sequence = _load_tracks(arguments)
    _check_length(arguments, sequence.data.shape[1] // 2)
    with progress.status("segmenting ..."):
        segmenter.fit(sequence.data)
    labels = segmenter.labels_
    if video:
        _write_pictures(arguments, sequence, segmenter, progress)
    elif arguments.render is not None:
        _draw_tracks(arguments, sequence, labels)
    if arguments.report is not None:
        _draw_report(arguments, sequence, segmenter)
    if arguments.out is not None:
        sure = segmenter.probabilities_ if arguments.confidence else None
        _write_labels(arguments.out, sequence, labels, sure)
    _print_findings(console, arguments, sequence, segmenter)
    if arguments.split_dir is not None:
        files = save_motions(
            arguments.split_dir, sequence.data, labels, track_ids=sequence.track_ids
        )
        console.print(f"motions: {len(files)} files in {arguments.split_dir}")


def _check_options(arguments, video):
    """Refuse options that do not go together, and files that cannot be written."""
    check_output(arguments.out, LABEL_ENDINGS)
    check_folder_of(arguments.split_dir)
    check_output(arguments.render, (".mp4", ".png") if video else PICTURES)
    check_output(arguments.report, PICTURES)
    check_mask_options(arguments, video)
    check_method_options(arguments, video)
    check_folder_of(arguments.resume)
    if arguments.resume is not None and not video:
        raise ValueError(
            f"--resume is for videos; {arguments.file} is a file of tracks"
        )
    if arguments.confidence and arguments.out is None:
        raise ValueError("--confidence is written with the labels: say --out FILE")


def _check_length(arguments, n_frames):
    """Refuse a report of a clip that is taken in windows, before any work."""
    if arguments.report is not None and n_frames > LONG_CLIP:
        raise ValueError(
            f"--report is for clips of up to {LONG_CLIP} frames; {arguments.file} has "
            f"{n_frames} (--max-frames takes the first)"
        )


def _load_tracks(arguments):
    from ..datasets import load_tracks

    sequence = load_tracks(arguments.file, **file_options(arguments))
    return Bunch(
        **{"track_ids": np.arange(len(sequence.data)), **sequence, "video": {}}
    )


def _track_video(arguments, segmenter, console, progress):
    """Tracks of a video as :func:`skmotionseg.datasets.load_tracks` gives a file's.

    None of a long one of which only labels are wanted: it is segmented and written
    here, as its tracks need not be in memory for that.
    """
    # What OpenCV and FFmpeg print of a damaged video, the error says in one line.
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")
    started = time.perf_counter()
    frames = open_frames(arguments.file).every(arguments.stride)
    if goes_in_blocks(arguments, frames):
        with folder_of(arguments) as folder:
            stored = track_to(folder, arguments, frames, progress)
            clip = StoredClip(stored, _shortest_track(stored.n_frames))
            _check_kept(arguments, clip.n_tracks, stored.n_frames)
            if arguments.resume is not None:
                segmenter.set_params(memory=folder / WINDOWS)
            if clip.n_frames > LONG_CLIP and not needs_whole(arguments):
                segment_stored(segmenter, clip, arguments, console, progress)
                return None
            (width, height), tracks = stored.size, clip.matrix()
    else:
        tracks, width, height = _track_at_once(arguments, frames, progress)
    return Bunch(
        data=tracks,
        target=None,
        name=arguments.file.stem,
        track_ids=np.arange(len(tracks)),
        frames=frames,
        video={
            "width": width,
            "height": height,
            "fps": np.nan if frames.fps is None else frames.fps,
        },
        seconds={"tracking": time.perf_counter() - started},
    )


def _track_at_once(arguments, frames, console):
    """Tracks that are long enough, and width and height of the frames."""
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
        kept = select_long_tracks(video.tracks, _shortest_track(video.n_frames))
    _check_kept(arguments, kept.sum(), video.n_frames)
    return video.tracks[kept], video.width, video.height


def _check_kept(arguments, n_kept, n_frames):
    if not n_kept:
        raise ValueError(
            f"no point of {arguments.file} could be followed for "
            f"{_shortest_track(n_frames)} frames: there is too little texture"
        )


def _shortest_track(n_frames):
    """Five frames; up to ten in longer clips, where short tracks say little."""
    return int(np.clip(n_frames // 8, 5, 10))


# --------------------------------------------------------------------------- printing


def _print_findings(console, arguments, sequence, segmenter):
    from ..metrics import misclassification_error

    labels = segmenter.labels_
    facts = [
        *track_facts(sequence.data),
        ("motions found", str(segmenter.n_motions_)),
    ]
    if sequence.target is not None and (sequence.target >= 0).any():
        error = misclassification_error(sequence.target, labels)
        facts.append(("misclassification", f"{error:.2%}"))
    facts += stage_facts(segmenter)
    for stage, seconds in sequence.get("seconds", {}).items():
        facts.append((f"seconds {stage}", f"{seconds:.3f}"))
    console.print(facts_table(arguments.file.name, facts))
    if not hasattr(segmenter, "windows_"):
        report = segmenter.report(sequence.data)
        console.print(_motion_table(report))
        if len(report.counts) > 1:
            console.print(_count_table(report))
    files = {
        "labels": arguments.out,
        "picture": arguments.render,
        "masks": arguments.masks,
        "static masks": arguments.static_masks,
        "prompts": arguments.prompts,
        "viewer": arguments.viewer,
        "report": arguments.report,
    }
    for name, path in files.items():
        if path is not None:
            console.print(f"{name}: {path}", highlight=False)


def _motion_table(report):
    """A row per motion, and one for the tracks of none."""
    table = require("rich.table", extra="cli").Table()
    for title in ("motion", "tracks", "share", "frames", "colour"):
        table.add_column(title, justify="right")
    table.add_column("model")
    table.add_column("residual", justify="right")
    for motion in report.motions:
        table.add_row(
            str(motion.label),
            str(motion.n_tracks),
            f"{motion.share:.1%}",
            f"{len(motion.frames)} of {report.n_frames}",
            _colour(motion.label),
            motion.model or "too few",
            pixels(motion.residual),
        )
    if report.n_outliers:
        share = f"{report.n_outliers / report.n_tracks:.1%}"
        table.add_row("none", str(report.n_outliers), share, "", _colour(-1))
    return table


def _colour(motion):
    colour = motion_colour(motion)
    return f"[{colour}]●[/] {colour}"


def _count_table(report):
    """A row per number of motions: its costs, and why it was chosen or not."""
    table = require("rich.table", extra="cli").Table(caption=how_sure(report) or None)
    for title in ("motions", *report.term_names, "total"):
        # Broken here, so that narrow screens leave the width to the verdicts.
        table.add_column(fill(title, 12, break_long_words=False), justify="right")
    table.add_column("")
    for each in report.counts:
        table.add_row(
            str(each.n_motions),
            *(f"{cost:.4f}" for cost in (*each.terms, each.total)),
            each.verdict,
            style="bold" if each.chosen else "",
        )
    return table


# ---------------------------------------------------------------------------- writing


def _write_labels(path, sequence, labels, probabilities=None):
    with replacing(path) as file:
        if path.suffix.lower() == ".npz":
            sure = {} if probabilities is None else {"probabilities": probabilities}
            np.savez_compressed(
                file,
                X=sequence.data,
                labels=labels,
                track_ids=sequence.track_ids,
                **sure,
                **sequence.video,
            )
            return
        header, form = "track,label", "%.15g,%d"
        columns = [sequence.track_ids, labels]
        if sequence.video:  # nobody else has these tracks
            header, form = "track,frame,x,y,label", "%d,%d,%.3f,%.3f,%d"
            track, columns = _observations(sequence, labels)
        if probabilities is not None:
            header, form = f"{header},probability", f"{form},%.3f"
            columns.append(probabilities[track] if sequence.video else probabilities)
        table = np.column_stack(columns)
        np.savetxt(file, table, fmt=form, header=header, comments="")


def _observations(sequence, labels):
    """The track, and track, frame, x, y and label, each time that a track is seen."""
    points, visibility = unpack_tracks(sequence.data)
    track, frame = np.nonzero(visibility)
    names = sequence.track_ids[track]
    return track, [names, frame, *points[track, frame].T, labels[track]]


def _draw_tracks(arguments, sequence, labels):
    from ..plotting import plot_motions

    plt = pyplot()
    figure, ax = plt.subplots(figsize=(8, 5), layout="constrained")
    plot_motions(sequence.data, labels, ax=ax)
    save_figure(figure, arguments.render)


def _draw_report(arguments, sequence, segmenter):
    from ..plotting import ReportDisplay

    pyplot()
    under = _frame_under(sequence) if sequence.video else {}
    display = ReportDisplay.from_estimator(segmenter, sequence.data, **under)
    save_figure(display.figure_, arguments.report)


def _frame_under(sequence):
    """The frame of a video that sees most tracks, and its number, for a report."""
    _, visibility = unpack_tracks(sequence.data)
    number = int(visibility.sum(axis=0).argmax())
    frame = next(islice(iter(sequence.frames), number, None))
    return {"frame": number, "image": frame[..., ::-1]}


def _write_pictures(arguments, sequence, segmenter, console):
    """Masks, prompts and pictures of a video, as far as they are asked for."""
    from ..video import find_objects, render_segmentation, write_viewer

    size = {side: sequence.video[side] for side in ("width", "height")}
    objects = find_objects(sequence.data, segmenter.labels_, **size)
    masks = write_masks(arguments, sequence.frames, sequence, objects, console)
    video = sequence.frames, sequence.data
    if arguments.render is not None:
        started = time.perf_counter()
        with reporting("rendering", console) as progress:
            render_segmentation(
                *video, objects, arguments.render, masks=masks(), progress=progress
            )
        sequence.seconds["rendering"] = time.perf_counter() - started
    if arguments.viewer is not None:
        with reporting("viewer", console) as progress:
            write_viewer(
                *video,
                objects,
                arguments.viewer,
                masks=masks(),
                probabilities=getattr(segmenter, "probabilities_", None),
                progress=progress,
            )
