"""The part of ``skmotionseg bench`` that has nothing but the frames of videos."""

from __future__ import annotations

import time
from collections import defaultdict
from dataclasses import replace
from typing import Any

import numpy as np

from .._core.geometry.tracks import unpack_tracks
from ..datasets import load_bms26, load_davis16
from ..datasets._videos import read_video_mask
from ..metrics import (
    FBMSScores,
    boundary_f_measure,
    fbms_mean,
    fbms_objects,
    fbms_scores,
    region_similarity,
)
from ..preprocessing import select_long_tracks
from ..segmentation import MotionSegmenter
from .video_tracks import shortest_track

VIDEO_LOADERS = {"BMS26": load_bms26, "DAVIS16": load_davis16}
# Frames whose tracks are scored as points, as the papers do.
POINT_FRAMES = 10
# Columns of the tables: of videos with one object, and with several regions.
BINARY_FIGURES = {"region": "region similarity J", "boundary": "boundary F"}
REGION_FIGURES = {
    "precision": "pixels: precision",
    "recall": "pixels: recall",
    "f_measure": "pixels: F",
    "extracted": "pixels: objects",
    "points_precision": "points: precision",
    "points_recall": "points: recall",
    "points_f_measure": "points: F",
    "points_extracted": "points: objects",
}


def has_frames(sequence):
    """Whether a sequence is a video."""
    return "mask_paths" in sequence


def measure_video(sequence, params, seed):
    """Scores of masks, and of points in the first frames, from the frames alone."""
    video, segmenter, objects, seconds = _segment(sequence, params, seed)
    scores = _score_masks(sequence, video, objects, seconds)
    if not sequence.binary:
        scores |= _score_points(sequence, params, seed)
    return {
        "video": True,
        "binary": sequence.binary,
        "n_tracks": len(objects),
        "n_frames": video.n_frames,
        "n_motions_found": segmenter.n_motions_,
        **scores,
        "seconds": {name: value / video.n_frames for name, value in seconds.items()},
    }


def _segment(sequence, params, seed, max_frames=None):
    """Tracks, the fitted segmenter, an object for each track, and seconds."""
    from ..video import find_objects, track_video

    started = time.perf_counter()
    video = track_video(sequence.frames, max_frames=max_frames)
    kept = select_long_tracks(video.tracks, shortest_track(video.n_frames))
    tracks = video.tracks[kept]
    tracked = time.perf_counter()
    segmenter = MotionSegmenter(random_state=seed, **params).fit(tracks)
    objects = find_objects(
        tracks,
        segmenter.labels_,
        width=video.width,
        height=video.height,
        source=sequence.frames,
    )
    seconds = {"tracking": tracked - started, "motions": time.perf_counter() - tracked}
    return replace(video, tracks=tracks), segmenter, objects, seconds


def _score_masks(sequence, video, objects, seconds):
    from ..video import dense_masks

    started = time.perf_counter()
    wanted = {int(frame): n for n, frame in enumerate(sequence.mask_frames)}
    pairs = []
    for frame, mask in enumerate(dense_masks(sequence.frames, video.tracks, objects)):
        if frame in wanted:
            pairs.append((read_video_mask(sequence, wanted[frame]), mask))
    seconds["masks"] = time.perf_counter() - started
    if sequence.binary:  # the first and last frames are not scored, as by the benchmark
        judged = [(true > 0, found > 0) for true, found in pairs[1:-1]]
        return {
            "region": float(np.mean([region_similarity(*pair) for pair in judged])),
            "boundary": float(np.mean([boundary_f_measure(*pair) for pair in judged])),
        }
    true, found = (np.concatenate([p[i].ravel() for p in pairs]) for i in (0, 1))
    return {
        **fbms_scores(true, found)._asdict(),
        **fbms_objects(true, found)._asdict(),
    }


def _score_points(sequence, params, seed):
    """Scores of the tracks of the first frames, where those have masks."""
    from ..video._pixels import nearest_pixels

    video, _, objects, _ = _segment(sequence, params, seed, POINT_FRAMES)
    points, seen = unpack_tracks(video.tracks)
    parts, sizes = [], []
    for number, frame in enumerate(sequence.mask_frames):
        if frame >= video.n_frames:
            continue
        region = read_video_mask(sequence, number)
        rows = np.flatnonzero(seen[:, frame])
        pixels = nearest_pixels(points[rows, frame], region.shape)
        parts.append((region[pixels], objects[rows]))
        sizes.append(np.bincount(region.ravel(), minlength=len(sequence.mask_scales)))
    true, found = (np.concatenate(part) for part in zip(*parts, strict=True))
    sizes = np.sum(sizes, axis=0)
    scores = fbms_scores(true, found, region_sizes=sizes)._asdict()
    scores |= fbms_objects(true, found, region_sizes=sizes)._asdict()
    return {f"points_{name}": value for name, value in scores.items()}


def summarize_videos(records):
    """Mean scores of each dataset and method, and their mean and spread over seeds.

    Parameters
    ----------
    records : list of dict

    Returns
    -------
    dict of (dataset, method) to dict
        ``n_sequences``, ``n_seeds``, ``binary``; (mean, standard deviation over seeds)
        of each figure, percent; of objects ``extracted`` and ``points_extracted``,
        their number, and how many are ``visible`` and ``points_visible``; and mean
        ``seconds`` per frame of each stage.
    """
    groups: Any = defaultdict(lambda: defaultdict(list))
    for record in records:
        groups[record["dataset"], record["method"]][record["seed"]].append(record)
    return {key: _summarize(list(seeds.values())) for key, seeds in groups.items()}


def _summarize(seeds):
    everything = [record for records in seeds for record in records]
    binary = everything[0]["binary"]
    each = [(_binary_means if binary else _region_means)(records) for records in seeds]
    stages = everything[0]["seconds"]
    return {
        "n_sequences": len(seeds[0]),
        "n_seeds": len(seeds),
        "binary": binary,
        **{
            name: (
                float(np.mean([one[name] for one in each])),
                float(np.std([one[name] for one in each])),
            )
            for name in each[0]
        },
        "seconds": {
            s: float(np.mean([r["seconds"][s] for r in everything])) for s in stages
        },
    }


def _binary_means(records):
    return {
        name: 100 * float(np.mean([r[name] for r in records]))
        for name in BINARY_FIGURES
    }


def _region_means(records):
    means = {}
    for prefix in ("", "points_"):
        scores = fbms_mean(
            [
                FBMSScores(*(r[prefix + name] for name in FBMSScores._fields))
                for r in records
            ]
        )
        for name, value in scores._asdict().items():
            means[prefix + name] = 100 * value
        for name in ("extracted", "visible"):
            means[prefix + name] = sum(r[prefix + name] for r in records)
    return means
