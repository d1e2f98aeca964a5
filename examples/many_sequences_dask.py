"""Segment many sequences on a cluster of machines.

``PerSequence`` takes each sequence for a task and hands the tasks to joblib, which
gives them to the engine that ``joblib.parallel_config`` names: here a dask cluster. The
labels are those of a single process, and a machine that dies costs time, not results.

Run it with a cluster of processes on this machine, or the address of a scheduler whose
workers have this package installed, on synthetic scenes or on the clips of KT3DMoSeg
under ``DIR/KT3DMoSeg``::

    python examples/many_sequences_dask.py
    python examples/many_sequences_dask.py --scheduler tcp://192.0.2.1:8786 --data DIR

It needs Dask, which the extra ``dask`` installs.
"""

from __future__ import annotations

import argparse
import time
from contextlib import nullcontext
from pathlib import Path

import numpy as np
from dask.distributed import Client, LocalCluster
from joblib import parallel_config

from skmotionseg import MotionSegmenter, PerSequence
from skmotionseg.datasets import load_kt3dmoseg, make_rigid_motions
from skmotionseg.metrics import misclassification_error


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--scheduler", metavar="ADDRESS", help="of a running cluster")
    parser.add_argument(
        "--workers", type=int, default=2, help="processes, without --scheduler"
    )
    parser.add_argument("--data", type=Path, metavar="DIR", help="holds KT3DMoSeg/")
    parser.add_argument(
        "--scenes", type=int, default=12, help="synthetic ones, without --data"
    )
    arguments = parser.parse_args(argv)
    names, X, y = read_sequences(arguments)
    print(f"{len(X)} sequences of {sum(map(len, X))} tracks")
    with open_cluster(arguments) as cluster, Client(cluster) as client:
        client.wait_for_workers(1)
        n_threads = sum(client.nthreads().values())
        print(f"{len(client.nthreads())} workers, {n_threads} sequences at a time")
        started = time.perf_counter()
        labels = segment(X)
        seconds = time.perf_counter() - started
    print_table(names, y, labels)
    print(f"{seconds:.1f} s")


def read_sequences(arguments):
    """Names, tracks and labels of the sequences."""
    if arguments.data is not None:
        clips = load_kt3dmoseg(arguments.data / "KT3DMoSeg")
        sequences = [(clip.name, clip.data, clip.target) for clip in clips]
    else:
        sequences = [
            (
                f"scene {seed}",
                *make_rigid_motions(80, 6, 2 + seed % 3, random_state=seed),
            )
            for seed in range(arguments.scenes)
        ]
    return map(list, zip(*sequences, strict=True))


def open_cluster(arguments):
    """A cluster that is closed in the end, or the address of one that is not."""
    if arguments.scheduler is not None:
        return nullcontext(arguments.scheduler)
    # Any free port will do.
    return LocalCluster(
        n_workers=arguments.workers, threads_per_worker=1, dashboard_address=":0"
    )


def segment(X):
    """Labels of each sequence, from the cluster of the client that is open."""
    segmenter = PerSequence(MotionSegmenter(random_state=0)).fit(X)
    with parallel_config(backend="dask", verbose=51):  # above 50, to stdout
        return segmenter.predict(X)


def print_table(names, y, labels):
    """Print motions and errors of each sequence, and the mean."""
    width = max(map(len, names))
    print(f"\n{'':{width}}  tracks  motions  found   error")
    errors = []
    for name, true, found in zip(names, y, labels, strict=True):
        errors.append(misclassification_error(true, found))
        print(
            f"{name:{width}}  {len(true):6}  {true.max() + 1:7}  {found.max() + 1:5}"
            f"  {errors[-1]:6.1%}"
        )
    print(f"{'mean':{width}}  {'':6}  {'':7}  {'':5}  {np.mean(errors):6.1%}\n")


if __name__ == "__main__":
    main()
