"""``skmotionseg bench``: errors and times on real sequences, in the paper's tables."""

from __future__ import annotations

import json
from contextlib import closing
from pathlib import Path

from .._utils.optional import require
from .._utils.words import counted
from .._utils.writing import check_apart, check_output, replacing
from .console import (
    console_of_findings,
    count,
    jobs,
    progress_console,
    with_progress,
)

METHODS_HELP = (
    "methods to run (default: all): those of the paper, which choose the number of "
    "motions by NCRE; eigengap and self_tuning, which choose it by other rules, with "
    "all models or, as in the paper's comparison, with homographies; and 'default', "
    "the default of MotionSegmenter"
)
PAPER_HELP = (
    "repeat the paper's tables by its authors' protocol: the exponent of the "
    "epsilon-neighbourhood is swept on the sequences that are tested on, delta is set "
    "for each data set, and single models, fusions, subsets of the models and other "
    "rules for the number of motions are printed beside the paper's figures; for "
    "Hopkins155, Hopkins12, MTPV62 and KT3DMoSeg"
)
RESUME_HELP = (
    "checkpoint file, made if there is none: each run is added when it ends, and runs "
    "that are in it already, with the same tracks, method, parameters, seed and code "
    "of this package, are not repeated"
)


def add_bench(commands):
    from .runs import LOADERS, METHODS

    bench = commands.add_parser(
        "bench",
        help="measure errors and times on real sequences",
        description="Run methods on every sequence under DIR/<dataset>/ and print "
        "tables laid out as the paper's, with its figures beside ours. With --resume "
        "FILE, an interrupted run continues: the same command again runs what is not "
        "in the file yet. With --paper, the protocol is that of the paper's authors.",
    )
    bench.add_argument("--data", type=Path, required=True, metavar="DIR")
    bench.add_argument(
        "--datasets",
        nargs="+",
        choices=list(LOADERS),
        help="data sets to run (default: all that are found in DIR)",
    )
    methods = list(METHODS)
    bench.add_argument("--methods", nargs="+", choices=methods, help=METHODS_HELP)
    _add_paper(bench)
    _add_amounts(bench)
    bench.add_argument("--json", type=Path, metavar="FILE", help="write all records")
    bench.add_argument("--resume", type=Path, metavar="FILE", help=RESUME_HELP)
    bench.set_defaults(run=_run_bench)


def _add_amounts(bench):
    bench.add_argument(
        "--every",
        type=count,
        default=1,
        metavar="N",
        help="run only every N-th sequence of a data set, from its first (default: 1)",
    )
    bench.add_argument(
        "--seeds",
        type=count,
        default=3,
        help="random seeds per method and sequence (default: 3)",
    )
    bench.add_argument(
        "--jobs",
        type=jobs,
        default=-1,
        help="sequences to run in parallel; -1 is all processors (default: -1)",
    )


def _add_paper(bench):
    from .paper_runs import EXPONENTS

    bench.add_argument("--paper", action="store_true", help=PAPER_HELP)
    bench.add_argument(
        "--exponents",
        type=count,
        nargs=2,
        metavar=("FIRST", "LAST"),
        help="exponents of the epsilon-neighbourhood that --paper sweeps (default: "
        f"{EXPONENTS[0]} {EXPONENTS[-1]})",
    )


def _run_bench(arguments):
    from .checkpoints import Journal
    from .runs import METHODS, find_sequences, run

    console = console_of_findings()
    check_output(arguments.json)
    check_output(arguments.resume)
    written = {"--resume": arguments.resume, "--json": arguments.json}
    check_apart(arguments.data, written)
    journal = None if arguments.resume is None else Journal(arguments.resume)
    if arguments.paper:
        _run_paper(arguments, console, journal)
        return
    if arguments.exponents is not None:
        raise ValueError("--exponents is for --paper")
    methods = list(dict.fromkeys(arguments.methods or METHODS))
    sequences = find_sequences(arguments.data, arguments.datasets, arguments.every)
    batches = run(sequences, methods, arguments.seeds, arguments.jobs, journal)
    records = _collect(arguments, sequences, batches)
    _print_tables(console, records, methods)


def _run_paper(arguments, console, journal):
    """The paper's tables by the protocol of its authors."""
    from .paper_runs import DELTAS, EXPONENTS, run_paper, summarize_paper
    from .paper_tables import WARNING, paper_tables
    from .runs import datasets_in, find_sequences

    if arguments.methods is not None:
        raise ValueError("--paper has its own methods; omit --methods")
    first, last = arguments.exponents or (EXPONENTS[0], EXPONENTS[-1])
    if first > last:
        raise ValueError(f"--exponents must be in ascending order; got {first} {last}")
    datasets = arguments.datasets or datasets_in(arguments.data, DELTAS)
    sequences = find_sequences(arguments.data, datasets, arguments.every)
    batches = run_paper(
        sequences,
        arguments.seeds,
        arguments.jobs,
        tuple(range(first, last + 1)),
        journal,
    )
    records = _collect(arguments, sequences, batches)
    for table in paper_tables(summarize_paper(records)):
        console.print(table)
    console.print(WARNING)


def _collect(arguments, sequences, batches):
    """All records, in order; written to a file if one is asked for."""
    with closing(batches):  # and whoever works on them
        shown = with_progress(
            batches,
            len(sequences) * arguments.seeds,
            _amount(len(sequences), arguments.seeds),
            progress_console(),
        )
        names = ("dataset", "method", "sequence", "seed", "exponent")
        records = sorted(
            (record for batch in shown for record in batch),
            key=lambda r: [r[name] for name in names if name in r],
        )
    if arguments.json is not None:
        with replacing(arguments.json) as file:
            file.write(json.dumps(records, indent=1).encode())
    return records


def _print_tables(console, records, methods):
    """A table per dataset and kind of truth: labels, regions or the masks of videos."""
    from .region_runs import summarize_regions
    from .runs import summarize
    from .video_runs import summarize_videos

    videos = summarize_videos([r for r in records if "video" in r])
    records = [record for record in records if "video" not in record]
    known = [record for record in records if "error_known" in record]
    if known:
        for table in _bench_tables(summarize(known), methods):
            console.print(table)
    regions = summarize_regions([r for r in records if "error_known" not in r])
    for part in dict.fromkeys(key[:2] for key in regions):
        console.print(_region_table(regions, part, methods))
    for dataset in dict.fromkeys(key[0] for key in videos):
        console.print(_video_table(videos, dataset, methods))


def _bench_tables(summary, methods):
    """Three tables: number known, number unknown, seconds."""
    datasets = list(dict.fromkeys(dataset for dataset, _ in summary))
    return [
        *(_error_table(summary, dataset, methods) for dataset in datasets),
        _time_table(summary, datasets, methods),
    ]


def _error_table(summary, dataset, methods):
    """One dataset: a row per method, the paper's figures in brackets."""
    from .runs import PAPER

    first = summary[dataset, methods[0]]
    table = _figure_table(
        f"{dataset}: {_amount_of(first)}; percent, ± over seeds (the paper's figure)"
    )
    figures = {
        "error_known": "known: error",
        "median_known": "median",
        "error_unknown": "from 1: error",
        "correct": "count right",
        "error_unknown_from_2": "from 2: error",
        "correct_from_2": "count right",
    }
    for title in figures.values():
        table.add_column(title, justify="right")
    for method in methods:
        ours = summary[dataset, method]
        paper = PAPER.get(dataset, {}).get(method, (None,) * len(figures))
        cells = zip(figures, paper, strict=True)
        table.add_row(method, *(_figure(ours[name], theirs) for name, theirs in cells))
    return table


def _region_table(summary, part, methods):
    """One set of sequences that are scored by regions: a row per method."""
    from .region_runs import REGION_PAPER

    first = summary[*part, methods[0]]
    table = _figure_table(
        f"{' '.join(part).strip()}: {_amount_of(first)}; number of motions unknown; "
        "percent, ± over seeds (the paper's figure)"
    )
    figures = ("density", "precision", "recall", "f_measure")
    for title in ("density", "precision", "recall", "F"):
        table.add_column(title, justify="right")
    table.add_column(f"objects of {first['visible']}", justify="right")
    table.add_column("seconds", justify="right")
    for method in methods:
        ours = summary[*part, method]
        paper = REGION_PAPER[part].get(method, (None,) * len(figures))
        cells = zip(figures, paper, strict=True)
        table.add_row(
            method,
            *(_figure(ours[name], theirs) for name, theirs in cells),
            _figure(ours["extracted"], None),
            f"{ours['seconds']:.2f}",
        )
    return table


def _video_table(summary, dataset, methods):
    """One dataset of videos: a row per figure, a column per method."""
    from .video_runs import BINARY_FIGURES, REGION_FIGURES

    first = summary[dataset, methods[0]]
    figures = dict(BINARY_FIGURES if first["binary"] else REGION_FIGURES)
    for name in figures:
        if name.endswith("extracted"):
            n_objects = first[name.replace("extracted", "visible")][0]
            figures[name] += f" of {n_objects:.0f}"
    table = _figure_table(
        f"{dataset}: {_amount_of(first, 'video')}, from the frames alone; percent, ± "
        "over seeds",
        rows_of="",
    )
    for method in methods:
        table.add_column(method, justify="right")
    results = [summary[dataset, method] for method in methods]
    for name, title in figures.items():
        table.add_row(
            title, *(f"{m:.2f} ±{s:.2f}" for m, s in (r[name] for r in results))
        )
    table.add_section()
    for stage in first["seconds"]:
        cells = (f"{ours['seconds'][stage]:.2f}" for ours in results)
        table.add_row(f"seconds per frame: {stage}", *cells)
    return table


def _amount(n_sequences, n_seeds, kind="sequence"):
    """``4 sequences, 1 seed``."""
    return f"{counted(n_sequences, kind)}, {counted(n_seeds, 'seed')}"


def _amount_of(summary, kind="sequence"):
    return _amount(summary["n_sequences"], summary["n_seeds"], kind)


def _figure(ours, theirs):
    mean, spread = ours
    paper = "" if theirs is None else f"\n({theirs:.2f})"
    return f"{mean:.2f}\n±{spread:.2f}{paper}"


def _time_table(summary, datasets, methods):
    table = _figure_table("mean seconds per sequence, number of motions known")
    table.add_column("dataset")
    for stage in ("hypotheses", "kernel", "clustering", "total"):
        table.add_column(stage, justify="right")
    for method in methods:
        for dataset in datasets:
            seconds = summary[dataset, method]["seconds"].values()
            table.add_row(method, dataset, *(f"{second:.2f}" for second in seconds))
        table.add_section()
    return table


def _figure_table(title, rows_of="method"):
    table = require("rich.table", extra="cli").Table(title=title, title_justify="left")
    table.add_column(rows_of, no_wrap=True)
    return table
