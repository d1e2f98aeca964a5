"""How the default's results move when one constant is halved or doubled.

    python -m benchmarks.sensitivity --data DIR [--half first] [--rows '*'] [--write]

The constants are those that are neither derived nor taken from a source, and
parameters of the estimator that were set likewise. ``--write`` keeps the figures in
``docs/sensitivity.json`` and puts them into ``docs/sensitivity.md``; without ``--data``
it rewrites the page from the figures that there are.

The benchmarks under ``DIR`` are used as a whole, but of Hopkins155 every fourth
sequence. ``--half`` takes every second sequence of each, by name, the first or the
second of each two: what was set on one half can be judged on the other.
"""

from __future__ import annotations

import argparse
import hashlib
import importlib
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack, contextmanager, nullcontext
from dataclasses import dataclass
from fnmatch import fnmatch
from pathlib import Path
from unittest.mock import patch

import numpy as np
from joblib import Memory, Parallel, delayed

from skmotionseg import MotionSegmenter, ORKKernel
from skmotionseg._core.geometry import epipolar
from skmotionseg.datasets import (
    load_hopkins12,
    load_hopkins155,
    load_kt3dmoseg,
    load_mtpv62,
)
from skmotionseg.metrics import misclassification_error

from . import report
from .measuring import show_progress

LOADERS = {
    "KT3DMoSeg": load_kt3dmoseg,
    "Hopkins155": load_hopkins155,
    "MTPV62": load_mtpv62,
    "Hopkins12": load_hopkins12,
}
THINNING = {"Hopkins155": 4}  # one sequence in so many; else all
HALVES = {"first": (0,), "second": (1,), "both": (0, 1)}
PAGE = Path("docs/sensitivity.md")
SCALES = {"halved": 0.5, "doubled": 2}
MEASURES = ("error_known", "error_unknown", "count_right")

# ------------------------------------------------------------------------ the constants


def scaled(value, scale):
    """A number, or each of several, times a scale; whole ones stay so, and above 0."""
    if isinstance(value, tuple):
        return tuple(scaled(each, scale) for each in value)
    if isinstance(value, int):
        return max(1, int(value * scale))
    return value * scale


def last_scaled(value, scale):
    """Of frame gaps the last: the first are neighbours, whatever the others."""
    return (*value[:-1], scaled(value[-1], scale))


@dataclass(frozen=True)
class Constant:
    """A number that could be another.

    Attributes
    ----------
    module : str or None
        Of the package, without its name; None is a parameter of the estimator.
    name : str
    change : callable
        Gives the value times a scale.
    """

    module: str | None
    name: str
    change: Callable = scaled

    @property
    def of_kernel(self):
        """Whether it is a parameter of the segmenter's kernel, and not its own."""
        own, of_kernel = MotionSegmenter().get_params(), ORKKernel().get_params()
        return self.module is None and self.name in of_kernel and self.name not in own

    @property
    def value(self):
        if self.module is None:
            return getattr(
                ORKKernel() if self.of_kernel else MotionSegmenter(), self.name
            )
        module = importlib.import_module(f"skmotionseg.{self.module}")
        return getattr(module, self.name)


CONSTANTS = (
    Constant("_core.partition.apartness", "GAIN_WEIGHT"),
    Constant("_core.partition.apartness", "LINK_WEIGHT"),
    Constant("_core.partition.apartness", "FAR_WEIGHT"),
    Constant("_core.partition.apartness", "CROSS_WEIGHT"),
    Constant("_core.partition.apartness", "PRIOR"),
    Constant("_core.partition.rigid_search", "NATS_OF_LINKS"),
    Constant("_core.partition.apartness", "MERGING_WEIGHTS"),
    Constant("_core.partition.apartness", "MERGING_PRIOR"),
    Constant("_core.partition.rigid_partitions", "NATS_OF_ODDS"),
    Constant("_core.partition.rigid_search", "NATS_OF_LABELS"),
    Constant("_core.partition.cost", "CUT_WEIGHT"),
    Constant("_core.partition.cost", "GAIN_OF_CUT"),
    Constant("_core.partition.search", "SPARSITIES"),
    Constant("_core.partition.clip", "OVERSEGMENTATION"),
    Constant("_core.geometry.description_length", "FRAME_GAPS", last_scaled),
    Constant("_core.geometry.description_length", "MAX_PAIRS"),
    Constant("_core.geometry.description_length", "NOISE_LEVELS"),
    Constant("_core.geometry.epipolar", "ROBUST_SCALE"),
    Constant("_core.geometry.epipolar", "ROBUST_SWEEPS"),
    Constant("_core.partition.motions", "INLIER_THRESHOLD"),
    Constant("_core.partition.motions", "CONCENTRATIONS"),
    Constant("_core.partition.motions", "USUAL_NOISE"),
    Constant(None, "n_hypotheses"),
    Constant(None, "top"),
    Constant(None, "covisibility_prior"),
)


@dataclass(frozen=True)
class Setting:
    """One value of one constant; without a constant, everything as it is."""

    row: str
    constant: Constant | None = None
    value: object = None

    @property
    def parameters(self):
        """What the estimator is given."""
        if self.constant is None or self.constant.module is not None:
            return {}
        given = {self.constant.name: self.value}
        return {"kernel": ORKKernel(**given)} if self.constant.of_kernel else given


AS_IT_IS = Setting("as it is")


def settings_of(constants):
    """Everything as it is, then each constant halved and doubled."""
    return [
        AS_IT_IS,
        *(
            Setting(f"{c.name}, {how}", c, c.change(c.value, scale))
            for c in constants
            for how, scale in SCALES.items()
        ),
    ]


@contextmanager
def replaced(name, before, after):
    """Put something in the place of another in every module that has it by name."""
    with ExitStack() as stack:
        for path, module in list(sys.modules.items()):
            ours = path.partition(".")[0] == "skmotionseg"
            if ours and vars(module).get(name) is before:
                stack.enter_context(patch.object(module, name, after))
        yield


def in_force(setting):
    """Give the constant its value for a while."""
    constant = setting.constant
    if constant is None or constant.module is None:
        return nullcontext()
    return replaced(constant.name, constant.value, setting.value)


# ----------------------------------------------------------------------- one sequence


class KnownFits:
    """Fundamental matrices, each fitted once for all settings that do not change it.

    Attributes
    ----------
    saved : float
        Seconds that known fits took when they were made.
    """

    def __init__(self):
        self._fit = epipolar.robust_fits
        self._known = {}
        self.saved = 0.0

    def in_use(self):
        """Take fits from those that are known, for a while."""
        return replaced("robust_fits", self._fit, self._look_up)

    def _look_up(self, x, y, seen, lower_rank=epipolar.nearest_rank_two, trusted=None):
        arrays = (x, y, seen, seen if trusted is None else trusted)
        digest = hashlib.blake2b(digest_size=16)
        for array in arrays:
            digest.update(f"{array.dtype.str} {array.shape} ".encode())
            digest.update(np.ascontiguousarray(array).tobytes())
        constants = epipolar.ROBUST_SCALE, epipolar.ROBUST_SWEEPS
        key = digest.digest(), lower_rank.__name__, *constants
        if key in self._known:
            self.saved += self._known[key][1]
        else:
            started = time.perf_counter()
            fit = self._fit(x, y, seen, lower_rank, trusted)
            self._known[key] = fit, time.perf_counter() - started
            for array in fit:
                array.flags.writeable = False  # it is for others, too
        return self._known[key][0]


def measure_sequence(benchmark, sequence, seed, settings):
    """Segment a sequence by each setting, the number of motions known and unknown.

    Constants are set here and not where the work is handed out: a process that does a
    part of it has modules of its own.

    Parameters
    ----------
    benchmark : str
    sequence : Bunch
    seed : int
    settings : list of Setting

    Returns
    -------
    list of dict
        A record per setting. Seconds are those with the number of motions unknown, as
        if nothing had been computed before.
    """
    X, y = sequence.data, sequence.target
    n_motions = len(np.unique(y[y >= 0]))
    fits = KnownFits()
    records = []
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        memory = Memory(folder, verbose=0)
        for setting in settings:
            segmenter = MotionSegmenter(
                memory=memory, random_state=seed, **setting.parameters
            )
            with in_force(setting), fits.in_use():
                known = segmenter.set_params(n_motions=n_motions).fit_predict(X)
                saved = fits.saved
                unknown = segmenter.set_params(n_motions="auto").fit_predict(X)
                saved = fits.saved - saved
            stages = segmenter.stage_seconds_
            spent = sum(stages[name] for name in stages if name != "total")
            records.append(
                {
                    "row": setting.row,
                    "benchmark": benchmark,
                    "sequence": sequence.name,
                    "seed": seed,
                    "error_known": 100 * misclassification_error(y, known),
                    "error_unknown": 100 * misclassification_error(y, unknown),
                    "count_right": 100.0 * (segmenter.n_motions_ == n_motions),
                    "seconds": float(spent + saved),
                }
            )
    return records


# ------------------------------------------------------------------------- all of them


def read_sequences(data, benchmarks, half):
    """Pairs of benchmark and sequence.

    Parameters
    ----------
    data : path-like
        Holds folders with the names of the benchmarks.
    benchmarks : sequence of str
    half : {"first", "second", "both"}
        Of each two sequences of a benchmark, by name.
    """
    chosen = []
    for benchmark in benchmarks:
        sequences = LOADERS[benchmark](Path(data) / benchmark)
        every = THINNING.get(benchmark, 1)
        for start in HALVES[half]:
            chosen += [(benchmark, each) for each in sequences[start::2][::every]]
    return chosen


def make_sensitivity(sequences, settings, seeds, n_jobs=None):
    """A row per setting: means over sequences and seeds, by benchmark.

    Parameters
    ----------
    sequences : list of (str, Bunch)
        Benchmark and sequence.
    settings : list of Setting
    seeds : int
    n_jobs : int or None
        Sequences at a time.

    Returns
    -------
    list of dict
    """
    tasks = [
        delayed(measure_sequence)(benchmark, sequence, seed, settings)
        for seed in range(seeds)
        for benchmark, sequence in sequences
    ]
    records = []
    parallel = Parallel(n_jobs=n_jobs, return_as="generator_unordered")
    for done, each in enumerate(parallel(tasks), start=1):
        last = f"{each[0]['sequence']}, seed {each[0]['seed']}"
        show_progress(f"sensitivity: {last}, {done} of {len(tasks)}")
        records += each
    show_progress("")
    rows = []
    for setting in settings:
        mine = [record for record in records if record["row"] == setting.row]
        rows.append(_row(setting, mine, np.mean))
        if setting == AS_IT_IS and seeds > 1:
            rows.append(_row(Setting("± over seeds"), mine, np.std))
    return rows


def _row(setting, records, over_seeds):
    """Means over the sequences of each benchmark, then mean or spread over seeds."""
    row = {"row": setting.row}
    if setting.constant is not None:
        row["value"] = _written(setting.value)
    for benchmark in dict.fromkeys(record["benchmark"] for record in records):
        mine = [record for record in records if record["benchmark"] == benchmark]
        row[benchmark] = _over_seeds(mine, MEASURES, over_seeds)
        row[benchmark]["n_sequences"] = len({each["sequence"] for each in mine})
    return row | _over_seeds(records, ["seconds"], over_seeds)


def _over_seeds(records, measures, over_seeds):
    seeds = sorted({record["seed"] for record in records})
    return {
        name: float(
            over_seeds(
                [np.mean([r[name] for r in records if r["seed"] == s]) for s in seeds]
            )
        )
        for name in measures
    }


def _written(value):
    """A value as it is written in the table; of an array, its ends."""
    if isinstance(value, np.ndarray):
        return f"{value[0]:.4g} to {value[-1]:.4g}"
    if isinstance(value, tuple):
        return " and ".join(map(_written, value))
    return f"{value:.4g}"


# ------------------------------------------------------------------------------ tables


def _cell(benchmark):
    def cell(row):
        if benchmark not in row:
            return ""
        known, unknown, right = (row[benchmark][name] for name in MEASURES)
        return f"{known:.2f} / {unknown:.2f} / {right:.0f}"

    return cell


COLUMNS = {
    "": lambda row: row["row"],
    "value": lambda row: row.get("value", ""),
    **{benchmark: _cell(benchmark) for benchmark in LOADERS},
    "seconds": report.number("seconds", "{:.2f}"),
}


def sections_of_page():
    """What makes each section of the page from the record."""
    return {
        half: lambda r, h=half: report.figures(r.get(h), COLUMNS) for half in HALVES
    }


def _parser():
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.sensitivity",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("--data", type=Path, help="holds folders with the names of the benchmarks")
    add(
        "--benchmarks", nargs="+", choices=LOADERS, help="default: those that are there"
    )
    add("--half", choices=HALVES, default="both")
    add("--rows", nargs="+", default=["*"], help="patterns of names of constants")
    add("--seeds", type=int, default=3)
    add("--jobs", type=int, default=-1, help="sequences at a time (all cores)")
    add("--json", type=Path, help="keep the figures (--write: docs/sensitivity.json)")
    add("--write", action="store_true", help=f"rewrite the tables of {PAGE}")
    return parser


def main(arguments=None):
    parser = _parser()
    arguments = parser.parse_args(arguments)
    if arguments.data is None and not arguments.write:
        parser.error("give --data, or --write alone")
    record = arguments.json
    if record is None and arguments.write:
        record = PAGE.with_suffix(".json")
    if arguments.data is not None:
        benchmarks = arguments.benchmarks or [
            name for name in LOADERS if (arguments.data / name).is_dir()
        ]
        sequences = read_sequences(arguments.data, benchmarks, arguments.half)
        if not sequences:
            parser.error(f"none of {', '.join(LOADERS)} is in {arguments.data}")
        constants = [
            c for c in CONSTANTS if any(fnmatch(c.name, p) for p in arguments.rows)
        ]
        rows = make_sensitivity(
            sequences, settings_of(constants), arguments.seeds, arguments.jobs
        )
        report.show(rows, COLUMNS)
        report.save(record, arguments.half, rows)
    if arguments.write:
        report.write_page(PAGE, record, sections_of_page())


if __name__ == "__main__":
    main()
