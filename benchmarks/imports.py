"""How long the import takes on top of what scikit-learn takes.

    python -m benchmarks.imports [--repeats 9]

Each repeat is a process of its own, which imports what this package uses of
scikit-learn, SciPy and joblib, and then the package. Times are of the processor, so
that what else runs on the machine hardly matters.
"""

from __future__ import annotations

import argparse
import subprocess
import sys

import numpy as np

TIMED = """
import time
started = time.process_time()
import joblib, sklearn.base, sklearn.pipeline, sklearn.utils, threadpoolctl
import scipy.linalg, scipy.optimize, scipy.spatial, scipy.special
before = time.process_time()
import skmotionseg
print(before - started, time.process_time() - before)
"""


def import_seconds(repeats):
    """CPU seconds of libraries and package, (repeats, 2); one more warms up."""
    command = [sys.executable, "-c", TIMED]
    printed = [
        subprocess.run(command, capture_output=True, text=True, check=True).stdout
        for _ in range(repeats + 1)
    ]
    return np.array([list(map(float, line.split())) for line in printed[1:]])


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--repeats", type=int, default=9)
    seconds = 1000 * import_seconds(parser.parse_args().repeats)
    for name, column in zip(("libraries", "this package"), seconds.T, strict=True):
        low, middle, high = np.percentile(column, (0, 50, 100))
        print(f"{name:13} {middle:7.0f} ms ({low:.0f}-{high:.0f})")


if __name__ == "__main__":
    main()
