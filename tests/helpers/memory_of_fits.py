"""What many fits leave behind; ``python memory_of_fits.py COUNT`` prints it.

MiB that the process holds, and objects of the package's classes: before and after.
"""

from __future__ import annotations

import gc
import os
import sys
from pathlib import Path

from skmotionseg import MotionSegmenter
from skmotionseg.datasets import make_rigid_motions

WARM_UP = 4  # pools and caches of the libraries fill once


def resident():
    """Memory that this process holds, bytes."""
    pages = Path("/proc/self/statm").read_text().split()[1]
    return int(pages) * os.sysconf("SC_PAGE_SIZE")


def n_objects():
    """Objects of the package's classes, all but functions and the like."""
    gc.collect()
    modules = (str(type(each).__module__) for each in gc.get_objects())
    return sum(module.startswith("skmotionseg") for module in modules)


def fit(seed):
    n_tracks = 200 + seed % 7  # sizes that nothing can keep an array for
    X, _ = make_rigid_motions(n_tracks, 3, 2, random_state=seed)
    params = {"n_hypotheses": 60, "n_landmarks": 60, "max_motions": 3}
    MotionSegmenter(**params, n_jobs=2, random_state=seed).fit(X).predict(X)


def main(count):
    for seed in range(WARM_UP):
        fit(seed)
    start, before = resident(), n_objects()
    for seed in range(count):
        fit(seed)
    print(start / 2**20, resident() / 2**20, before, n_objects())


if __name__ == "__main__":
    main(int(sys.argv[1]))
