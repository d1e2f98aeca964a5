"""Two images with mismatches: ours beside sequential MAGSAC++ of OpenCV.

    pip install opencv-python-headless
    python -m benchmarks.two_view_peers --data DIR [--seeds 3] [--json FILE]

Sequential MAGSAC++ (Barath et al. 2020) is told the number of motions: it fits a
fundamental matrix to what is left, takes its inliers away, and so on; what is left in
the end are the mismatches. Its threshold is the one of those tried that is best on
these very images. Errors count mismatches as a motion that must be found.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from skmotionseg import MotionSegmenter, unpack_tracks
from skmotionseg.datasets import load_adelaide
from skmotionseg.metrics import misclassification_error

from . import report
from .measuring import show_progress

THRESHOLDS = (1.0, 2.0, 4.0)  # pixels
FEWEST = 8  # correspondences that a fundamental matrix is fitted to
COLUMNS = {
    "method": lambda row: row["row"],
    "error %, mean": report.number("mean_error", "{:.2f}"),
    "median": report.number("median_error", "{:.2f}"),
    "spread over seeds": report.number("spread", "{:.2f}"),
    "number right %": report.number("right", "{:.0f}"),
    "CPU seconds per pair": report.number("seconds", "{:.2f}"),
}


def sequential_magsac(points, n_motions, threshold, seed):
    """Labels of correspondences by fundamental matrices, one after the other.

    Parameters
    ----------
    points : ndarray of shape (n, 2, 2)
        Pixels in two images.
    n_motions : int
    threshold : float
        Pixels.
    seed : int
        Of the order of the correspondences, which is what the samples depend on.

    Returns
    -------
    ndarray of int, shape (n,)
        -1 for what no matrix explains.
    """
    import cv2

    labels = np.full(len(points), -1)
    left = np.random.default_rng(seed).permutation(len(points))
    for motion in range(n_motions):
        if len(left) < FEWEST:
            break
        x, y = points[left].transpose(1, 0, 2)
        _, inside = cv2.findFundamentalMat(
            x, y, cv2.USAC_MAGSAC, threshold, 0.999, 10_000
        )
        if inside is None:
            break
        inside = inside.ravel().astype(bool)
        labels[left[inside]] = motion
        left = left[~inside]
    return labels


def methods():
    """What is measured: name to ``(pair, seed) -> labels``."""

    def known(pair, seed):
        return MotionSegmenter(_number(pair), random_state=seed).fit_predict(pair.data)

    def unknown(pair, seed):
        return MotionSegmenter(random_state=seed).fit_predict(pair.data)

    def magsac(threshold):
        def segment(pair, seed):
            points = unpack_tracks(pair.data)[0]
            return sequential_magsac(points, _number(pair), threshold, seed)

        return segment

    return {
        "MotionSegmenter(), number known": known,
        "MotionSegmenter(), number unknown": unknown,
        **{
            f"sequential MAGSAC++, {t:g} px, number known": magsac(t)
            for t in THRESHOLDS
        },
    }


def measure(pairs, seeds):
    """A row per method.

    Parameters
    ----------
    pairs : list of Bunch
    seeds : int

    Returns
    -------
    list of dict
    """
    rows = []
    for name, segment in methods().items():
        errors, numbers, seconds = np.empty((3, seeds, len(pairs)))
        for p, pair in enumerate(pairs):
            show_progress(f"{name}: {pair.name}, {p + 1} of {len(pairs)}")
            for seed in range(seeds):
                begin = time.process_time()
                labels = segment(pair, seed)
                seconds[seed, p] = time.process_time() - begin
                errors[seed, p] = _error(pair, labels)
                numbers[seed, p] = labels.max() + 1 == _number(pair)
        by_seed = 100 * errors.mean(axis=1)
        rows.append(
            {
                "row": name,
                "mean_error": float(by_seed.mean()),
                "median_error": 100 * float(np.median(errors)),
                "spread": float(by_seed.std()),
                "right": 100 * float(numbers.mean()),
                "seconds": float(np.median(seconds)),
            }
        )
    show_progress("")
    return rows


def _number(pair):
    return int(pair.target.max()) + 1


def _error(pair, labels):
    """Misclassified correspondences, mismatches being one more motion."""
    return misclassification_error(pair.target + 1, labels + 1)


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    pairs = load_adelaide(arguments.data / "AdelaideRMF")
    with threadpool_limits(1):
        rows = measure(pairs, arguments.seeds)
    report.show(rows, COLUMNS)
    report.save(arguments.json, "two_view_peers", rows)


if __name__ == "__main__":
    main()
