"""Real photographs: tables whose things are moved in between, and matched features.

    pip install opencv-python-headless
    python -m benchmarks.photographs --data DIR [--seeds 3] [--json FILE]

The truth of these tables (Arrigoni and Pajdla 2019) is a region of each image. So a
track whose features are matched wrongly within one thing has a label, too, but no
motion explains it, and it is rejected. Errors are therefore of the tracks that are
given a motion. Beside the share that is given one stands the share that could be: of
labelled tracks, those that are, in the usual pair of photographs, near the epipolar
lines of MAGSAC++ (Barath et al. 2020), fitted to the tracks of their label.
"""

from __future__ import annotations

import argparse
from itertools import combinations
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from skmotionseg import MotionSegmenter, unpack_tracks
from skmotionseg._core.geometry.motion_models import homogeneous
from skmotionseg._core.partition.motions import sampson_distances
from skmotionseg.datasets import load_arrigoni
from skmotionseg.metrics import misclassification_error

from . import report
from .measuring import show_progress

# Pixels from an epipolar line, in photographs 3,000 pixels wide, and the tracks of a
# motion that one is fitted to at least.
NEAR, FEWEST = 5.0, 15


def _mean_and_spread(name):
    return lambda row: f"{np.mean(row[name]):.1f} ± {np.std(row[name]):.1f}"


COLUMNS = {
    "table": lambda row: row["row"],
    "tracks": report.number("n_tracks", "{:,}"),
    "explained by their true motion %": report.number("explained", "{:.0f}"),
    "number known: given a motion %": report.number("given_known", "{:.0f}"),
    "error of these %": _mean_and_spread("error_known"),
    "number unknown: motions": lambda row: ", ".join(map(str, row["found"])),
    "given one %": report.number("given_unknown", "{:.0f}"),
    "their error %": _mean_and_spread("error_unknown"),
    "mismatches rejected %": report.number("rejected", "{:.0f}"),
}


def explained(table):
    """Labelled tracks that a motion of their own label explains.

    Parameters
    ----------
    table : Bunch

    Returns
    -------
    ndarray of bool, shape (n_labelled,)
    """
    points, seen = unpack_tracks(table.data)
    pairs = list(combinations(range(seen.shape[1]), 2))
    distances = np.full((len(pairs), len(points)), np.nan)
    for motion in range(table.target.max() + 1):
        of_motion = table.target == motion
        for row, (a, b) in enumerate(pairs):
            tracks = np.flatnonzero(of_motion & seen[:, a] & seen[:, b])
            if len(tracks) >= FEWEST:
                x, y = points[tracks][:, [a, b]].transpose(1, 0, 2)
                distances[row, tracks] = _from_epipolar_lines(x, y)
    told = ~np.isnan(distances).all(axis=0)
    near = np.zeros(len(points), dtype=bool)
    near[told] = np.nanmedian(distances[:, told], axis=0) <= NEAR
    return near[table.target >= 0]


def _from_epipolar_lines(x, y):
    """Sampson distances of correspondences (n,) from what most of them agree on."""
    import cv2

    cv2.setRNGSeed(0)
    F, _ = cv2.findFundamentalMat(x, y, cv2.USAC_MAGSAC, NEAR, 0.9999, 20_000)
    if F is None:
        return np.full(len(x), np.inf)
    return sampson_distances(F, homogeneous(x), homogeneous(y))


def judge(table, labels):
    """What labels are worth, in percent.

    Parameters
    ----------
    table : Bunch
    labels : ndarray of int, shape (n,)

    Returns
    -------
    given, error, rejected : float
        Labelled tracks that are given a motion; of these, the misclassified; and
        mismatches that are given none.
    """
    labelled, given = table.target >= 0, labels >= 0
    both = labelled & given
    error = misclassification_error(table.target[both], labels[both])
    shares = both.sum() / labelled.sum(), error, 1 - given[~labelled].mean()
    return tuple(100 * float(share) for share in shares)


def measure(table, seeds):
    """A row of a table.

    Parameters
    ----------
    table : Bunch
    seeds : sequence of int

    Returns
    -------
    dict
    """
    known, unknown, found = [], [], []
    for seed in seeds:
        show_progress(f"{table.name}: seed {seed}")
        told = MotionSegmenter(int(table.target.max()) + 1, random_state=seed)
        known.append(judge(table, told.fit_predict(table.data)))
        free = MotionSegmenter(random_state=seed)
        unknown.append(judge(table, free.fit_predict(table.data)))
        found.append(free.n_motions_)
    show_progress("")
    given_known, error_known, _ = np.transpose(known).tolist()
    given_unknown, error_unknown, rejected = np.transpose(unknown).tolist()
    return {
        "row": table.name,
        "n_tracks": len(table.data),
        "explained": 100 * float(explained(table).mean()),
        "given_known": np.mean(given_known),
        "error_known": error_known,
        "found": found,
        "given_unknown": np.mean(given_unknown),
        "error_unknown": error_unknown,
        "rejected": np.mean(rejected),
    }


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args(arguments)
    tables = load_arrigoni(arguments.data / "Arrigoni")
    with threadpool_limits(1):
        rows = [measure(table, range(arguments.seeds)) for table in tables]
    report.show(rows, COLUMNS)
    report.save(arguments.json, "photographs", rows)


if __name__ == "__main__":
    main()
