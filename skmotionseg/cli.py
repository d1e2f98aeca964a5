"""The ``skmotionseg`` command."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import numpy as np

from . import __version__
from ._extras import require
from ._writing import replacing

PICTURES = (".png", ".pdf", ".svg", ".jpg")


def main(argv=None):
    """Run the command.

    Parameters
    ----------
    argv : list of str, optional
        Arguments; those of the process by default.

    Returns
    -------
    int
        0, or 2 if the input or the installation is at fault.

    Examples
    --------
    >>> from skmotionseg.cli import main
    >>> main(["segment", "nowhere.csv"])
    2
    """
    arguments = _parser().parse_args(argv)
    try:
        return arguments.run(arguments) or 0
    except (ImportError, OSError, ValueError, TypeError) as error:
        print(f"skmotionseg: {error}", file=sys.stderr)
        return 2


def _parser():
    parser = argparse.ArgumentParser(
        prog="skmotionseg",
        description="Say which point tracks of a moving camera move together.",
    )
    parser.add_argument("--version", action="version", version=__version__)
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    _add_demo(commands)
    _add_segment(commands)
    _add_bench(commands)
    return parser


def _count(text):
    number = int(text)
    if number < 1:
        raise argparse.ArgumentTypeError(f"expected 1 or more; got {text}")
    return number


def _motions(text):
    return text if text == "auto" else _count(text)


# -------------------------------------------------------------------------- demo


def _add_demo(commands):
    demo = commands.add_parser(
        "demo",
        help="segment a built-in scene of three motions",
        description="Segment a synthetic scene of three motions, their number unknown, "
        "and draw what was found beside the truth.",
    )
    demo.add_argument(
        "--out", type=Path, default=Path("demo.png"), help="picture (demo.png)"
    )
    demo.add_argument("--seed", type=int, default=0, help="scene and method (0)")
    demo.set_defaults(run=_demo)


def _demo(arguments):
    console = require("rich.console", extra="cli").Console()
    pyplot = _pyplot()
    _check_output(arguments.out, PICTURES)
    from .datasets import make_rigid_motions
    from .metrics import misclassification_error
    from .segmentation import MotionSegmenter

    X, y = make_rigid_motions(random_state=arguments.seed)
    with console.status("segmenting ..."):
        segmenter = MotionSegmenter(random_state=arguments.seed).fit(X)
    error = misclassification_error(y, segmenter.labels_)
    console.print(
        _facts_table(
            "skmotionseg demo",
            [
                *_track_facts(X),
                ("motions found", str(segmenter.n_motions_)),
                ("motions true", str(len(np.unique(y[y >= 0])))),
                ("misclassification", f"{error:.2%}"),
                *_stage_facts(segmenter),
            ],
        )
    )
    _draw_comparison(pyplot, X, y, segmenter.labels_, arguments.out)
    console.print(f"picture: {arguments.out}", highlight=False)


def _pyplot():
    require("matplotlib", extra="cli").use("Agg")
    return require("matplotlib.pyplot", extra="cli")


def _draw_comparison(pyplot, X, true, found, path):
    from .plotting import plot_motions

    figure, axes = pyplot.subplots(
        1, 2, figsize=(11, 4), sharex=True, sharey=True, layout="constrained"
    )
    plot_motions(X, true, ax=axes[0], title="true motions")
    plot_motions(X, found, ax=axes[1], title="found motions")
    axes[1].set_ylabel("")
    figure.savefig(path, dpi=130, bbox_inches="tight")
    pyplot.close(figure)


def _facts_table(title, facts):
    table = require("rich.table", extra="cli").Table(
        title=title, show_header=False, title_justify="left"
    )
    table.add_column(style="dim")
    table.add_column(justify="right")
    for name, value in facts:
        table.add_row(name, value)
    return table


def _track_facts(X):
    unseen = np.isnan(X).mean()
    return [
        ("tracks", str(len(X))),
        ("frames", str(X.shape[1] // 2)),
        ("unseen", f"{unseen:.1%}"),
    ]


def _stage_facts(segmenter):
    return [
        (f"seconds {stage}", f"{seconds:.3f}")
        for stage, seconds in segmenter.stage_seconds_.items()
    ]


# ----------------------------------------------------------------------- segment


def _add_segment(commands):
    segment = commands.add_parser(
        "segment",
        help="segment a track file",
        description="Segment the tracks of a .npz, .mat, .csv or .dat file.",
    )
    segment.add_argument("file", type=Path, metavar="FILE")
    segment.add_argument(
        "--motions", type=_motions, default="auto", help="their number, or auto (auto)"
    )
    segment.add_argument("--seed", type=int, default=0, help="of the method (0)")
    segment.add_argument("--out", type=Path, help="labels: .npz or .csv")
    segment.add_argument("--split-dir", type=Path, help="folder: a file a motion")
    segment.add_argument("--render", type=Path, help="picture of the motions: .png")
    segment.set_defaults(run=_segment)


def _segment(arguments):
    from .datasets import load_tracks
    from .export import save_motions
    from .metrics import misclassification_error
    from .segmentation import MotionSegmenter

    _check_output(arguments.out, (".npz", ".csv"))
    _check_output(arguments.render, PICTURES)
    _check_output(arguments.split_dir)
    sequence = load_tracks(arguments.file)
    console = require("rich.console", extra="cli").Console()
    with console.status("segmenting ..."):
        segmenter = MotionSegmenter(arguments.motions, random_state=arguments.seed).fit(
            sequence.data
        )
    labels = segmenter.labels_
    facts = [
        *_track_facts(sequence.data),
        ("motions found", str(segmenter.n_motions_)),
        *(
            (f"tracks of motion {motion}", str((labels == motion).sum()))
            for motion in range(segmenter.n_motions_)
        ),
        ("tracks of no motion", str((labels < 0).sum())),
    ]
    if sequence.target is not None and (sequence.target >= 0).any():
        error = misclassification_error(sequence.target, labels)
        facts.append(("misclassification", f"{error:.2%}"))
    console.print(_facts_table(arguments.file.name, [*facts, *_stage_facts(segmenter)]))
    track_ids = sequence.get("track_ids", np.arange(len(labels)))
    if arguments.split_dir is not None:
        files = save_motions(
            arguments.split_dir, sequence.data, labels, track_ids=track_ids
        )
        console.print(f"motions: {len(files)} files in {arguments.split_dir}")
    if arguments.out is not None:
        _write_labels(arguments.out, sequence.data, labels, track_ids)
        console.print(f"labels: {arguments.out}", highlight=False)
    if arguments.render is not None:
        _draw_motions(sequence.data, labels, arguments.render)
        console.print(f"picture: {arguments.render}", highlight=False)


def _check_output(path, endings=None):
    """Refuse a file that could not be written, before any work."""
    if path is None:
        return
    if endings is not None and path.suffix.lower() not in endings:
        raise ValueError(f"output files end in {' or '.join(endings)}; got {path.name}")
    if not path.absolute().parent.is_dir():
        raise FileNotFoundError(f"there is no folder to write {path} to")


def _write_labels(path, X, labels, track_ids):
    with replacing(path) as file:
        if path.suffix.lower() == ".npz":
            np.savez_compressed(file, X=X, labels=labels, track_ids=track_ids)
        else:
            table = np.column_stack([track_ids, labels])
            np.savetxt(file, table, fmt="%.15g,%d", header="track,label", comments="")


def _draw_motions(X, labels, path):
    from .plotting import plot_motions

    pyplot = _pyplot()
    figure, ax = pyplot.subplots(figsize=(8, 5), layout="constrained")
    plot_motions(X, labels, ax=ax)
    figure.savefig(path, dpi=130, bbox_inches="tight")
    pyplot.close(figure)


# ------------------------------------------------------------------------- bench


def _add_bench(commands):
    from ._bench import LOADERS, METHODS

    bench = commands.add_parser(
        "bench",
        help="measure errors and times on real sequences",
        description="Run methods on every sequence under DIR/<dataset>/ and print "
        "tables laid out as the paper's, with its figures beside ours.",
    )
    bench.add_argument("--data", type=Path, required=True, metavar="DIR")
    bench.add_argument(
        "--datasets", nargs="+", choices=list(LOADERS), help="those found in DIR"
    )
    bench.add_argument(
        "--methods", nargs="+", choices=list(METHODS), default=list(METHODS)
    )
    bench.add_argument("--seeds", type=_count, default=3, help="runs of each (3)")
    bench.add_argument("--json", type=Path, metavar="FILE", help="every record")
    bench.add_argument("--jobs", type=int, default=-1, help="sequences at a time (all)")
    bench.set_defaults(run=_run_bench)


def _run_bench(arguments):
    from ._bench import find_sequences, run, summarize
    from ._bench_regions import summarize_regions

    console = require("rich.console", extra="cli").Console()
    _check_output(arguments.json)
    sequences = find_sequences(arguments.data, arguments.datasets)
    batches = run(sequences, arguments.methods, arguments.seeds, arguments.jobs)
    batches = _with_progress(
        batches,
        len(sequences) * arguments.seeds,
        f"{len(sequences)} sequences, {arguments.seeds} seeds",
        console,
    )
    records = sorted(
        (record for batch in batches for record in batch),
        key=lambda r: (r["dataset"], r["method"], r["sequence"], r["seed"]),
    )
    if arguments.json is not None:
        with replacing(arguments.json) as file:
            file.write(json.dumps(records, indent=1).encode())
    counted = [record for record in records if "error_known" in record]
    if counted:
        for table in _bench_tables(summarize(counted), arguments.methods):
            console.print(table)
    regions = summarize_regions([r for r in records if "error_known" not in r])
    for part in dict.fromkeys(key[:2] for key in regions):
        console.print(_region_table(regions, part, arguments.methods))


def _with_progress(items, total, description, console):
    """Pass items on under a progress bar, or, in a log file, a line every tenth."""
    if console.is_terminal:
        track = require("rich.progress", extra="cli").track
        yield from track(items, description, total=total, console=console)
        return
    for done, item in enumerate(items, start=1):
        if done * 10 // total > (done - 1) * 10 // total:
            console.print(f"{description}: {done} of {total} done", highlight=False)
        yield item


def _bench_tables(summary, methods):
    """Three tables: number known, number unknown, seconds."""
    datasets = list(dict.fromkeys(dataset for dataset, _ in summary))
    return [
        *(_error_table(summary, dataset, methods) for dataset in datasets),
        _time_table(summary, datasets, methods),
    ]


def _error_table(summary, dataset, methods):
    """One dataset: a row a method, the paper's figures in brackets."""
    from ._bench import PAPER

    first = summary[dataset, methods[0]]
    table = _figure_table(
        f"{dataset}: {first['n_sequences']} sequences, {first['n_seeds']} seeds; "
        "percent, ± over seeds (the paper's figure)"
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
        paper = PAPER[dataset].get(method, (None,) * len(figures))
        cells = zip(figures, paper, strict=True)
        table.add_row(method, *(_figure(*ours[name], theirs) for name, theirs in cells))
    return table


def _region_table(summary, part, methods):
    """One set of sequences that are scored by regions: a row a method."""
    from ._bench_regions import REGION_PAPER

    first = summary[*part, methods[0]]
    table = _figure_table(
        f"{' '.join(part).strip()}: {first['n_sequences']} sequences, "
        f"{first['n_seeds']} seeds; number of motions unknown; percent, ± over seeds "
        "(the paper's figure)"
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
            *(_figure(*ours[name], theirs) for name, theirs in cells),
            _figure(*ours["extracted"], None),
            f"{ours['seconds']:.2f}",
        )
    return table


def _figure(mean, spread, theirs):
    paper = "" if theirs is None else f"\n({theirs:.2f})"
    return f"{mean:.2f}\n±{spread:.2f}{paper}"


def _time_table(summary, datasets, methods):
    table = _figure_table("mean seconds a sequence, number of motions known")
    table.add_column("dataset")
    for stage in ("hypotheses", "kernel", "clustering", "total"):
        table.add_column(stage, justify="right")
    for method in methods:
        for dataset in datasets:
            seconds = summary[dataset, method]["seconds"].values()
            table.add_row(method, dataset, *(f"{second:.2f}" for second in seconds))
        table.add_section()
    return table


def _figure_table(title):
    table = require("rich.table", extra="cli").Table(title=title, title_justify="left")
    table.add_column("method", no_wrap=True)
    return table


if __name__ == "__main__":
    sys.exit(main())
