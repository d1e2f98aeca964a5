"""The part of ``skmotionseg bench`` whose truth are regions of images."""

from __future__ import annotations

from collections import defaultdict
from typing import Any

import numpy as np

from ..datasets import load_complex_background, load_fbms59
from ..metrics import FBMSScores, fbms_mean, fbms_objects, fbms_scores
from ..segmentation import MotionSegmenter

REGION_LOADERS = {
    "FBMS59": load_fbms59,
    "ComplexBackground": load_complex_background,
}

# Xu, Cheong and Li (2021), first ten frames, number of motions unknown: density,
# precision, recall and F-measure in percent.
REGION_PAPER = {
    ("FBMS59", "Trainingset"): {"subset": (0.89, 90.35, 73.57, 81.10)},
    ("FBMS59", "Testset"): {"subset": (0.90, 84.41, 72.87, 78.22)},
    ("ComplexBackground", ""): {"subset": (0.90, 90.03, 59.67, 71.77)},
}


def has_regions(sequence):
    """Whether a sequence is scored by regions of images."""
    return "region_sizes" in sequence


def measure_regions(sequence, params, seed):
    """Scores of one method, the number of motions unknown."""
    found = MotionSegmenter(random_state=seed, **params).fit(sequence.data)
    stages = {
        stage: found.stage_seconds_[stage]
        for stage in ("hypotheses", "kernel", "clustering")
    }
    points = {
        "y_true": sequence.point_target,
        "y_pred": found.labels_[sequence.point_track],
        "sample_weight": sequence.point_weight,
        "region_sizes": sequence.region_sizes,
    }
    return {
        "set": sequence.set,
        "n_tracks": len(sequence.data),
        "n_frames": sequence.data.shape[1] // 2,
        "n_motions_found": found.n_motions_,
        **fbms_scores(**points)._asdict(),
        **fbms_objects(**points)._asdict(),
        "seconds": {
            **stages,
            # Not that of the fit, which takes what a method before it has computed.
            "total": sum(stages.values()),
        },
    }


def summarize_regions(records):
    """Scores of each set, and their mean and spread over seeds.

    Parameters
    ----------
    records : list of dict

    Returns
    -------
    dict of (dataset, set, method) to dict
        ``n_sequences``, ``n_seeds``; mean and standard deviation over seeds of
        ``density``, ``precision``, ``recall`` and ``f_measure`` (percent, of the means
        over sequences, as :func:`fbms_mean` has them) and of the number of objects
        ``extracted``; the number ``visible``, and the mean ``seconds``.
    """
    groups: Any = defaultdict(lambda: defaultdict(list))
    for record in records:
        key = record["dataset"], record["set"], record["method"]
        groups[key][record["seed"]].append(record)
    return {key: _summarize(list(seeds.values())) for key, seeds in groups.items()}


def _summarize(seeds):
    names = FBMSScores._fields
    scores = 100 * np.array(
        [
            fbms_mean([FBMSScores(*(r[name] for name in names)) for r in records])
            for records in seeds
        ]
    )
    extracted = [sum(record["extracted"] for record in records) for records in seeds]
    everything = [record for records in seeds for record in records]
    return {
        "n_sequences": len(seeds[0]),
        "n_seeds": len(seeds),
        **{
            name: (float(column.mean()), float(column.std()))
            for name, column in zip(names, scores.T, strict=True)
        },
        "extracted": (float(np.mean(extracted)), float(np.std(extracted))),
        "visible": sum(record["visible"] for record in seeds[0]),
        "seconds": float(np.mean([r["seconds"]["total"] for r in everything])),
    }
