"""What ``skmotionseg bench`` runs: every method on every sequence, several seeds."""

from __future__ import annotations

import hashlib
import tempfile
from collections import defaultdict
from contextlib import closing
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from joblib import Memory, Parallel, delayed

from .._parallel.tasks import Task
from .._version import __version__
from ..datasets import (
    load_adelaide,
    load_arrigoni,
    load_hopkins12,
    load_hopkins155,
    load_kt3dmoseg,
    load_mtpv62,
)
from ..metrics import misclassification_error
from ..segmentation import MotionSegmenter
from .checkpoints import run_key
from .region_runs import REGION_LOADERS, has_regions, measure_regions
from .video_runs import VIDEO_LOADERS, has_frames, measure_video

PACKAGE = Path(__file__).parents[1]

LOADERS = {
    "Hopkins155": load_hopkins155,
    "Hopkins12": load_hopkins12,
    "MTPV62": load_mtpv62,
    **REGION_LOADERS,
    "KT3DMoSeg": load_kt3dmoseg,
    "AdelaideRMF": load_adelaide,
    "Arrigoni": load_arrigoni,
    **VIDEO_LOADERS,
}

# Motion models and fusions of the paper, whatever others there are.
PAPER_MODELS = ("affine", "homography", "fundamental")
PAPER_FUSIONS = ("kernel_addition", "coreg", "subset")
# The paper's methods choose the number of motions as the paper does; then those that it
# compares with, on the affinity of homographies as there, and on that of all models.
METHODS: dict[str, dict[str, Any]] = {
    **{model: {"models": (model,), "selection": "ncre"} for model in PAPER_MODELS},
    **{f: {"fusion": f, "selection": "ncre"} for f in PAPER_FUSIONS},
    **{
        f"homography_{rule}": {"models": ("homography",), "selection": rule}
        for rule in ("eigengap", "self_tuning")
    },
    **{rule: {"selection": rule} for rule in ("eigengap", "self_tuning")},
    "default": {},
}


def find_sequences(folder, datasets, every=1):
    """Read every sequence under ``folder/<dataset>/``.

    Parameters
    ----------
    folder : path-like
    datasets : sequence of str or None
        None takes those that are there.
    every : int
        Of each dataset, only every such sequence is taken, from the first.

    Returns
    -------
    list of (str, Bunch)
        Dataset and sequence.

    Raises
    ------
    FileNotFoundError
        If a named dataset, or any at all, is not there.
    """
    folder = Path(folder)
    if datasets is None:
        datasets = datasets_in(folder, LOADERS)
    return [
        (dataset, sequence)
        for dataset in dict.fromkeys(datasets)
        for sequence in list(LOADERS[dataset](folder / dataset))[::every]
    ]


def datasets_in(folder, names):
    """Those of the names that are folders there.

    Raises
    ------
    FileNotFoundError
        If none is.
    """
    found = [name for name in names if (folder / name).is_dir()]
    if not found:
        message = f"none of the folders {', '.join(names)} is in {folder}"
        if folder.resolve().name in names:
            message += f"; is it --data {folder.resolve().parent}?"
        raise FileNotFoundError(message)
    return found


def run(sequences, methods, seeds, n_jobs, journal=None):
    """Yield the records of one sequence and seed after another, as they finish.

    Parameters
    ----------
    sequences : list of (str, Bunch)
    methods : sequence of str
    seeds : int
    n_jobs : int or None
    journal : Journal, optional
        Runs that are in it are not done again; others are added as each ends.

    Yields
    ------
    list of dict
        A record per method.
    """
    known = {} if journal is None else journal.read()
    waiting = []
    for seed in range(seeds):
        for dataset, sequence in sequences:
            runs = [describe_run(dataset, sequence, m, seed) for m in methods]
            done = [known[run_key(r)] for r in runs if run_key(r) in known]
            runs = [r for r in runs if run_key(r) not in known]
            if runs:
                waiting.append((sequence, runs, done))
            else:
                yield done
    # Workers that are stopped remove nothing: what they cache lies in a folder of ours.
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        tasks = (
            Task(f"segmenting {one[0].name}", bench_sequence, *one, folder, journal)
            for one in waiting
        )
        parallel = Parallel(n_jobs=n_jobs, return_as="generator_unordered")
        with closing(parallel(delayed(task)() for task in tasks)) as batches:
            yield from batches


def run_in_parallel(jobs, measure, n_jobs, journal=None):
    """Yield runs and their records, as they finish.

    Parameters
    ----------
    jobs : list of (str, dict, tuple)
        What to say of it if it fails; the run, which is what its result depends on; and
        the arguments of ``measure``.
    measure : callable
        Gives a list of dicts.
    n_jobs : int or None
    journal : Journal, optional
        Runs that are in it are not done again; others are added as each ends.

    Yields
    ------
    (dict, list of dict)
        The run, and what was measured.
    """
    known = {} if journal is None else journal.read()
    waiting = []
    for name, run, arguments in jobs:
        if run_key(run) in known:
            yield run, known[run_key(run)]["records"]
        else:
            waiting.append(Task(name, _measure_run, run, measure, arguments, journal))
    parallel = Parallel(n_jobs=n_jobs, return_as="generator_unordered")
    with closing(parallel(delayed(task)() for task in waiting)) as finished:
        yield from finished


def _measure_run(run, measure, arguments, journal):
    records = measure(*arguments)
    if journal is not None:
        journal.append(run, {"records": records})
    return run, records


def describe_run(dataset, sequence, method, seed):
    """What the result of a run depends on, as JSON can hold it."""
    params = MotionSegmenter(**METHODS[method]).get_params()
    return {
        "dataset": dataset,
        "sequence": sequence.name,
        "method": method,
        "seed": seed,
        "params": {
            name: list(value) if isinstance(value, tuple) else value
            for name, value in params.items()
            if name not in ("memory", "n_jobs", "random_state")
        },
        "tracks": digest_of(sequence),
        "version": __version__,
        "code": code_digest(),
    }


def digest_of(sequence):
    """A name for the arrays of a sequence, which tells whether they have changed."""
    digest = hashlib.blake2b(digest_size=16)
    for name, value in sorted(sequence.items()):
        if isinstance(value, np.ndarray):
            digest.update(f"{name} {value.dtype.str} {value.shape} ".encode())
            digest.update(np.ascontiguousarray(value).tobytes())
    return digest.hexdigest()


@cache
def code_digest():
    """A name for this package as it is, which a version is not while it is written."""
    digest = hashlib.blake2b(digest_size=16)
    for path in sorted(PACKAGE.rglob("*.py")):
        digest.update(f"{path.relative_to(PACKAGE).as_posix()}\0".encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()


def bench_sequence(sequence, runs, done, folder, journal=None):
    """Records of runs on one sequence, which share hypotheses and kernels.

    Parameters
    ----------
    sequence : Bunch
    runs : list of dict
        As of :func:`describe_run`; all of one dataset and seed.
    done : list of dict
        Records that there are; the others follow them.
    folder : path-like
        Where to cache.
    journal : Journal, optional
        Each record is added to it at once.

    Returns
    -------
    list of dict
    """
    records = list(done)
    with tempfile.TemporaryDirectory(dir=folder) as cache_folder:
        memory = Memory(cache_folder, verbose=0)
        for run in runs:
            params = {**METHODS[run["method"]], "memory": memory}
            names = ("dataset", "method", "sequence", "seed")
            record = {
                **{name: run[name] for name in names},
                **_measure(sequence, params, run["seed"]),
            }
            if journal is not None:
                journal.append(run, record)
            records.append(record)
    return records


def _measure(sequence, params, seed):
    if has_frames(sequence):
        return measure_video(sequence, params, seed)
    if has_regions(sequence):
        return measure_regions(sequence, params, seed)
    X, y = sequence.data, sequence.target
    n_motions = len(np.unique(y[y >= 0]))
    counts: list[dict[str, Any]] = [{"n_motions": n_motions}, {}, {"min_motions": 2}]
    known, unknown, from_2 = (
        MotionSegmenter(random_state=seed, **params, **count).fit(X) for count in counts
    )
    seconds = {
        stage: known.stage_seconds_[stage]
        for stage in ("hypotheses", "kernel", "clustering")
    }
    return {
        "n_tracks": len(X),
        "n_frames": X.shape[1] // 2,
        "n_motions": n_motions,
        "error_known": misclassification_error(y, known.labels_),
        "n_motions_found": unknown.n_motions_,
        "error_unknown": misclassification_error(y, unknown.labels_),
        "n_motions_found_from_2": from_2.n_motions_,
        "error_unknown_from_2": misclassification_error(y, from_2.labels_),
        "seconds": {**seconds, "total": sum(seconds.values())},
    }


# ----------------------------------------------------------------------- summary


def summarize(records):
    """Means over sequences, and their mean and spread over seeds.

    Parameters
    ----------
    records : list of dict

    Returns
    -------
    dict of (dataset, method) to dict
        ``n_sequences``, ``n_seeds``; mean and standard deviation over seeds of
        ``error_known``, ``median_known``, ``error_unknown``, ``error_unknown_from_2``,
        ``correct``, ``correct_from_2`` (all in percent); and the mean ``seconds`` of
        each stage.
    """
    groups: Any = defaultdict(lambda: defaultdict(list))
    for record in records:
        groups[record["dataset"], record["method"]][record["seed"]].append(record)
    return {
        key: _summarize_group(list(by_seed.values())) for key, by_seed in groups.items()
    }


def _summarize_group(seeds):
    def over_seeds(value, reduce=np.mean):
        each = [100 * reduce([value(record) for record in seed]) for seed in seeds]
        return float(np.mean(each)), float(np.std(each))

    everything = [record for seed in seeds for record in seed]
    return {
        "n_sequences": len(seeds[0]),
        "n_seeds": len(seeds),
        "error_known": over_seeds(lambda r: r["error_known"]),
        "median_known": over_seeds(lambda r: r["error_known"], np.median),
        "error_unknown": over_seeds(lambda r: r["error_unknown"]),
        "error_unknown_from_2": over_seeds(lambda r: r["error_unknown_from_2"]),
        "correct": over_seeds(lambda r: r["n_motions_found"] == r["n_motions"]),
        "correct_from_2": over_seeds(
            lambda r: r["n_motions_found_from_2"] == r["n_motions"]
        ),
        "seconds": {
            stage: float(np.mean([record["seconds"][stage] for record in everything]))
            for stage in everything[0]["seconds"]
        },
    }


# Xu, Cheong and Li (2021): misclassification with the number of motions known (mean,
# then median where given), and mean error / correct count with it unknown, for counts
# from 1 and from 2; percent. MTPV62 counts are of 62 clips, ours of the outdoor clips
# found.
PAPER: dict[str, dict[str, Any]] = {
    "Hopkins155": {
        "affine": (0.59, None, 4.80, 82.58, 3.06, 89.68),
        "homography": (0.71, None, 3.95, 87.10, 2.70, 92.26),
        "fundamental": (1.79, None, 12.31, 65.81, 5.08, 85.81),
        "kernel_addition": (0.36, None, 3.51, 85.81, 3.44, 89.03),
        "coreg": (0.46, None, 3.17, 87.10, 2.74, 90.32),
        "subset": (0.31, None, 3.38, 86.45, 1.83, 91.61),
        "homography_eigengap": (None, None, 8.66, 77.42, None, None),
        "homography_self_tuning": (None, None, None, None, 5.01, 81.29),
    },
    "Hopkins12": {
        "affine": (0.15, 0.10, 3.91, 83.33, 2.82, 91.67),
        "homography": (0.18, 0.10, 6.66, 75.00, 3.55, 83.33),
        "fundamental": (1.10, 0.10, 8.86, 75.00, 4.73, 83.33),
        "kernel_addition": (0.11, 0.00, 6.63, 75.00, 1.51, 91.67),
        "coreg": (0.06, 0.00, 5.91, 83.33, 2.26, 91.67),
        "subset": (0.06, 0.00, 5.46, 91.67, 4.47, 91.67),
        "homography_eigengap": (None, None, 6.16, 91.67, None, None),
        "homography_self_tuning": (None, None, None, None, 4.05, 91.67),
    },
    "MTPV62": {
        "affine": (0.82, None, 3.14, 80.65, 2.78, 85.48),
        "homography": (1.08, None, 4.34, 77.42, 3.59, 83.87),
        "fundamental": (3.97, None, 14.82, 37.10, 8.92, 69.35),
        "kernel_addition": (0.88, None, 4.49, 77.42, 4.21, 85.48),
        "coreg": (0.73, None, 3.82, 77.42, 3.67, 83.87),
        "subset": (0.65, None, 3.81, 72.58, 3.23, 83.87),
        "homography_self_tuning": (None, None, None, None, 7.15, 70.97),
    },
    "KT3DMoSeg": {
        "affine": (15.76, 11.52, 24.99, 36.36, 19.08, 54.55),
        "homography": (11.45, 7.14, 29.28, 50.00, 24.63, 54.55),
        "fundamental": (13.92, 5.09, 28.22, 54.55, 10.31, 63.64),
        "kernel_addition": (8.31, 1.02, 10.21, 50.00, 7.51, 68.18),
        "coreg": (7.92, 0.75, 14.61, 50.00, 11.33, 63.64),
        "subset": (8.08, 0.71, 11.90, 50.00, 14.74, 68.18),
        "homography_eigengap": (None, None, 31.22, 27.27, None, None),
        "homography_self_tuning": (None, None, None, None, 22.01, 50.00),
    },
}
