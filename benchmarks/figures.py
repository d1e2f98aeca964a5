"""Rewrite the figures of README and pages from what was measured, or say what differs.

The commands:

    python -m benchmarks.figures                    rewrite all pages from docs/*.json
    python -m benchmarks.figures --check            only say where they differ
    python -m benchmarks.figures --bench FILE ...   take over records first, of
                                                    skmotionseg bench --json FILE
    python -m benchmarks.figures --paper FILE ...   and of skmotionseg bench --paper

``docs/accuracy.json`` holds errors, ``docs/speed.json`` times,
``docs/sensitivity.json`` what hangs on each constant and ``docs/long_videos.json`` long
videos. A test fails where a page and these files differ.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import numpy as np

from benchmarks import (
    growth,
    online_bench,
    photographs,
    reliability,
    report,
    search_gap,
    sensitivity,
    static_scenes,
    two_view_peers,
    wrong_tracks,
)
from benchmarks.__main__ import sections_of_speed
from skmotionseg import __version__
from skmotionseg._commands.paper_runs import RULES, summarize_paper
from skmotionseg._commands.paper_tables import PARTS, paper_sections
from skmotionseg._commands.runs import (
    PAPER,
    PAPER_FUSIONS,
    PAPER_MODELS,
    summarize,
)
from skmotionseg._commands.video_runs import summarize_videos
from skmotionseg._utils.words import counted

ROOT = Path(__file__).parents[1]
RECORDS = {
    name: ROOT / "docs" / f"{name}.json"
    for name in ("accuracy", "speed", "sensitivity", "long_videos")
}
DATASETS = ("KT3DMoSeg", "Hopkins155", "MTPV62", "Hopkins12")
# Seeds of a row that says nothing of them.
USUAL_SEEDS = 3
NAMES = {
    "kernel_addition": "kernel addition",
    "coreg": "co-regularisation",
    "subset": "subset constraint",
    "self_tuning": "self-tuning",
    "default": "`MotionSegmenter()`",
    "default by frame pairs": "`MotionSegmenter()` 0.1.0, frame pairs alone",
}
DEFAULTS = ("default", "default by frame pairs")
NOTHING = "-"
LONG_NAMES = {
    "online": "`OnlineMotionSegmenter()`",
    "known": "`MotionSegmenter(4)`",
    "unknown": "`MotionSegmenter()`",
}
# Sections of the page of results that are the rows of a benchmark as they are.
MEASURED = {
    "reliability": reliability.COLUMNS,
    "two_view_peers": two_view_peers.COLUMNS,
    "photographs": photographs.COLUMNS,
    "search_gap": search_gap.COLUMNS,
    "static_scenes": static_scenes.COLUMNS,
    "streams": online_bench.COLUMNS,
    "wrong_tracks": wrong_tracks.COLUMNS,
}


# ------------------------------------------------------------------------------- cells


def row_of(record, dataset, method):
    """The stored figures of a method on a dataset, or None."""
    rows = {row["row"]: row for row in record["bench"]}
    return rows.get(f"{dataset} {method}")


def error_cell(row, figure="error_known"):
    """``3.33 ± 0.39 (5 seeds)``."""
    if row is None or figure not in row:
        return NOTHING
    cell = " ± ".join(f"{number:.2f}" for number in row[figure])
    n_seeds = row["n_seeds"]
    if n_seeds == USUAL_SEEDS:
        return cell
    return f"{cell} ({counted(n_seeds, 'seed')})"


def count_cell(row, suffix=""):
    """``3.17 / 73``: misclassified, and numbers of motions right."""
    if row is None or f"correct{suffix}" not in row:
        return NOTHING
    return f"{row[f'error_unknown{suffix}'][0]:.2f} / {row[f'correct{suffix}'][0]:.0f}"


def lines_of(title, rows):
    """A Markdown table with a column per dataset; rows of nothing are left out."""
    lines = [f"| {title} | {' | '.join(DATASETS)} |", "|---" * 5 + "|"]
    for name, cells in rows:
        if set(cells) != {NOTHING}:
            lines.append(f"| {name} | {' | '.join(cells)} |")
    return "\n".join(lines)


def cells_of(record, method, cell, *arguments):
    return [cell(row_of(record, d, method), *arguments) for d in DATASETS]


def shown_defaults(record):
    """The default as it is, and as it was where it is not measured everywhere."""
    complete = all(row_of(record, dataset, "default") for dataset in DATASETS)
    return DEFAULTS[:1] if complete else DEFAULTS


# --------------------------------------------------------------------------- accuracy


def known_table(record):
    methods = (*PAPER_MODELS, *PAPER_FUSIONS, *shown_defaults(record))
    rows = [(NAMES.get(m, m), cells_of(record, m, error_cell)) for m in methods]
    best = [f"{min(PAPER[d][m][0] for m in PAPER_FUSIONS):.2f}" for d in DATASETS]
    rows.append(("the paper's best fusion, all sequences, tuned by data set", best))
    return lines_of("", rows)


def unknown_table(record):
    rows = []
    for start, suffix in (("from 1", ""), ("from 2", "_from_2")):
        for method in (
            *PAPER_FUSIONS,
            "eigengap",
            "self_tuning",
            *shown_defaults(record),
        ):
            name = f"{start}: {NAMES.get(method, method)}"
            if method in PAPER_FUSIONS:
                name += ", NCRE"
            rows.append((name, cells_of(record, method, count_cell, suffix)))
    return lines_of("", rows)


def two_images_table(record):
    """Errors and right counts between two images."""
    row = row_of(record, "AdelaideRMF", "default")
    return (
        "| AdelaideRMF | number known | unknown: error / right |\n"
        "|---|---|---|\n"
        f"| {NAMES['default']} | {error_cell(row)} | {count_cell(row)} |"
    )


def halves_table(record):
    """Known error, then error and right counts from 1, of every other sequence."""
    rows = []
    for method in shown_defaults(record):
        for position, half in enumerate(("even", "odd")):
            cells = []
            for dataset in DATASETS:
                halves = (row_of(record, dataset, method) or {}).get("halves")
                text = "{:.1f}, {:.1f} / {:.0f}"
                cells.append(text.format(*halves[position]) if halves else NOTHING)
            rows.append((f"{NAMES[method]}, {half}", cells))
    return lines_of("", rows)


def readme_table(record):
    fusions = [
        [row_of(record, d, method) for method in PAPER_FUSIONS] for d in DATASETS
    ]
    best = [f"{min(row['error_known'][0] for row in rows):.2f}" for rows in fusions]
    paper = [f"{min(PAPER[d][m][0] for m in PAPER_FUSIONS):.2f}" for d in DATASETS]
    rows = [
        (f"**number known:** {NAMES[method]}", cells_of(record, method, error_cell))
        for method in shown_defaults(record)
    ]
    rows += [
        ("the paper's fusions in this package, best of three", best),
        ("the paper's best figure (all sequences, tuned by data set)", paper),
    ]
    rows += [
        (f"**number unknown:** {NAMES[method]}", cells_of(record, method, count_cell))
        for method in shown_defaults(record)
    ]
    addition = cells_of(record, "kernel_addition", count_cell)
    rows.append(("the paper's method in this package, kernel addition", addition))
    return lines_of("", rows)


def comparison_table(record):
    """Each method of the paper: its figures, and ours."""
    rows = []
    for method in (*PAPER_MODELS, *PAPER_FUSIONS):
        name = NAMES.get(method, method)
        theirs = [PAPER[d][method] for d in DATASETS]
        cells = [f"{known:.2f} / {right:.0f}" for known, _, _, right, *_ in theirs]
        rows.append((f"{name}, the paper", cells))
        rows.append((f"{name}, here", cells_of(record, method, both_cell)))
    rows.extend(
        (NAMES[method], cells_of(record, method, both_cell))
        for method in shown_defaults(record)
    )
    return lines_of("", rows)


def both_cell(row):
    """``3.33 / 73``: the number of motions known, and how often it is right."""
    if row is None or "error_known" not in row:
        return NOTHING
    known = f"{row['error_known'][0]:.2f}"
    return f"{known} / {row['correct'][0]:.0f}" if "correct" in row else known


def sequence_list(record):
    """Which sequences were measured."""
    lines = [
        f"- **{row['row']}** ({len(row['names'])}): {', '.join(row['names'])}"
        for row in record["sequences"]
    ]
    return "\n".join(lines)


def video_table(record):
    lines = [
        "| data set | what is scored | percent | measured with |",
        "|---" * 4 + "|",
    ]
    for row in record.get("videos", ()):
        videos = f"{row['dataset']}, {counted(row['n_sequences'], 'video')}"
        lines.append(
            f"| {videos}, {counted(row['n_seeds'], 'seed')} | {row['what']} | "
            f"{row['figure']:.1f} | {row['version']} |"
        )
    return "\n".join(lines)


def paper_table(record):
    """What ``bench --paper`` found beside the paper's figures, a part per dataset."""
    rows = {row["row"]: row for row in record.get("paper", ())}
    parts = []
    for dataset in DATASETS:
        found = [
            (method, rows[f"{dataset} {method}"], figures)
            for section in paper_sections(dataset)
            for method, figures in section
            if f"{dataset} {method}" in rows
        ]
        if found:
            parts.append(_paper_part(dataset, found))
    return "\n\n".join(parts)


def _paper_part(dataset, found):
    _, first, _ = found[0]
    lines = [
        f"{dataset}, {counted(first['n_sequences'], 'sequence')} ({PARTS[dataset]}), "
        f"{counted(first['n_seeds'], 'seed')}:",
        "",
        "| method | known | the paper | from 1 | the paper | from 2 | the paper |",
        "|---" * 7 + "|",
    ]
    for method, row, (error, median, *unknown) in found:
        known = "{error:.2f} ({median:.2f}) [{exponent}]".format(**row["known"])
        known = "" if method in RULES else known  # which choose the number alone
        cells = [known, _both("{:.2f}", error, " ({:.2f})", median)]
        for case, theirs in zip(
            ("from_1", "from_2"), (unknown[:2], unknown[2:]), strict=True
        ):
            cells.append("{error:.2f} / {correct:.0f} [{exponent}]".format(**row[case]))
            cells.append(_both("{:.2f}", theirs[0], " / {:.0f}", theirs[1]))
        name = NAMES.get(method, method).replace("_", " ")
        lines.append(f"| {name} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _both(*pairs):
    """Numbers in their forms, without those that are None."""
    given = zip(pairs[::2], pairs[1::2], strict=True)
    return "".join(form.format(n) for form, n in given if n is not None)


# ------------------------------------------------------------------------------- speed


def speed_sentence(record):
    """How long a clip and many tracks take, and of what version that is."""
    rows = {row["row"]: row for row in record["table"]}
    known, unknown = (rows[f"clips-default-{n}"] for n in ("known", "unknown"))
    many = rows["tracks-50000"]
    versions = {report.version(row) for row in (known, unknown, many)}
    return (
        f"A KT3DMoSeg clip ({known['n_tracks']:.0f} tracks, filmed in 1.75 s) takes "
        f"{_time_of(known)} with the number of motions known and {_time_of(unknown)} "
        f"with it unknown; {many['n_tracks']:,} tracks in {many['n_frames']:.0f} "
        f"frames take {_time_of(many)} (version {' and '.join(sorted(versions))}; "
        f"{known['machine'].partition(';')[0]})."
    )


def _time_of(row):
    """Seconds of the processor, which others on the machine change least."""
    if "cpu_seconds" in row:
        return f"{row['cpu_seconds']:.2g} CPU seconds"
    return f"{row['seconds'][0]:.2g} s"


def dense_table(record):
    """All tracks of the clips beside those of the thinned benchmark."""
    rows = {row["row"]: row for row in record["table"]}
    lines = [
        "| KT3DMoSeg | tracks per clip | number known | unknown: error / right |",
        "|---" * 4 + "|",
    ]
    for name, title in (("default", "all tracks"), ("thinned", "thinned")):
        known, unknown = (rows[f"dense-{name}-{n}"] for n in ("known", "unknown"))
        lines.append(
            f"| {title} | {known['n_tracks']:.0f} | {known['error']:.2f} | "
            f"{unknown['error']:.2f} / {unknown['count_right']:.0f} |"
        )
    version = report.version(rows["dense-default-known"])
    return "\n".join([*lines, "", f"Measured with version {version}."])


def long_table(record):
    """A row per number of frames and way to segment them, over seeds."""
    rows = sorted(record["long"], key=lambda row: (row["how"], row["n_frames"]))
    columns = {
        "": lambda row: LONG_NAMES[row["how"]],
        "frames": report.number("n_frames", "{:,}"),
        "seeds": lambda row: str(len(row["error"])),
        "error %": lambda row: _with_range([100 * each for each in row["error"]]),
        "motions found": lambda row: ", ".join(map(str, row["found"])),
        "CPU ms per frame": _of_frames,
        "update, 95th percentile, CPU ms": lambda row: _with_range(
            [1e3 * each for each in row.get("late", ())], "{:.0f}"
        ),
        "switches": lambda row: _with_range(row.get("switches", ())),
        "state, KiB": lambda row: _with_range(
            [each / 2**10 for each in row.get("state", ())], "{:.0f}"
        ),
        "peak, MiB": lambda row: f"{np.mean(row['peak']) / 2**20:.0f}",
    }
    return report.figures(rows, columns)


def _of_frames(row):
    return f"{1e3 * np.mean(row['seconds']) / row['n_frames']:.0f}"


def _with_range(values, form="{:.2f}"):
    """``0.38 (0.12-0.83)``: the mean, the least and the most."""
    if len(values) == 0:
        return ""
    mean, low, high = (form.format(f(values)) for f in (np.mean, min, max))
    return f"{mean} ({low}-{high})"


# ------------------------------------------------------------------------------- pages


def pages():
    """For each page, the record behind each section and what makes its text."""
    accuracy = {
        "README.md": {"results": readme_table},
        "docs/results.md": {
            "pairs": two_images_table,
            "known": known_table,
            "unknown": unknown_table,
            "halves": halves_table,
            "sequences": sequence_list,
            **{
                name: lambda r, name=name, columns=columns: report.figures(
                    r.get(name), columns
                )
                for name, columns in MEASURED.items()
            },
            "videos": video_table,
            "paper": paper_table,
        },
        "docs/method.md": {"comparison": comparison_table},
    }
    # Drawn by python -m benchmarks --write docs/speed.md.
    picture = {"growth": lambda _: growth.SHOWN}
    speed = {
        "README.md": {"time": speed_sentence},
        "docs/results.md": {"time": speed_sentence, "dense": dense_table},
        "docs/speed.md": {**sections_of_speed(ROOT / "docs" / "speed.md"), **picture},
    }
    of_record = {
        "accuracy": accuracy,
        "speed": speed,
        "sensitivity": {"docs/sensitivity.md": sensitivity.sections_of_page()},
        "long_videos": {"docs/results.md": {"long": long_table}},
    }
    sections: dict = {}
    for record, by_page in of_record.items():
        for page, makers in by_page.items():
            for name, make in makers.items():
                sections.setdefault(page, {})[name] = record, make
    return sections


def rewritten(page, sections):
    """The text of a page with its figures as they are stored."""
    records = {name: json.loads(path.read_text()) for name, path in RECORDS.items()}
    makers = {
        name: lambda _, make=make, record=record: make(records[record])
        for name, (record, make) in sections.items()
    }
    return report.fill(page.read_text(), None, makers, page)


def differences():
    """Pages whose figures are not those that are stored, and the first such line."""
    found = {}
    for name, sections in pages().items():
        page = ROOT / name
        stored = rewritten(page, sections).splitlines()
        there = page.read_text().splitlines()
        for line, (new, old) in enumerate(zip(stored, there, strict=False), start=1):
            if new != old:
                found[name] = f"line {line}: {old!r} should be {new!r}"
                break
        else:
            if len(stored) != len(there):
                found[name] = f"{len(there)} lines should be {len(stored)}"
    return found


# -------------------------------------------------------------------------- new records


def take_over(files):
    """Put what ``skmotionseg bench --json`` wrote into the stored accuracy."""
    records = [each for path in files for each in json.loads(Path(path).read_text())]
    known = [record for record in records if "error_known" in record]
    for (dataset, method), found in summarize(known).items():
        mine = [
            record
            for record in known
            if (record["dataset"], record["method"]) == (dataset, method)
        ]
        row = {"row": f"{dataset} {method}", "dataset": dataset, "method": method}
        row |= {**found, "version": __version__, "halves": halves_of(mine)}
        report.save(RECORDS["accuracy"], "bench", [row])
        names = sorted({record["sequence"] for record in mine})
        report.save(
            RECORDS["accuracy"], "sequences", [{"row": dataset, "names": names}]
        )
    videos = summarize_videos([record for record in records if "video" in record])
    for (dataset, method), found in videos.items():
        report.save(RECORDS["accuracy"], "videos", video_rows(dataset, method, found))


def halves_of(records):
    """Known error, error and right counts from 1 of every other sequence; percent."""
    names = sorted({record["sequence"] for record in records})
    halves = []
    for start in (0, 1):
        half = [record for record in records if record["sequence"] in names[start::2]]
        figures = [
            (
                r["error_known"],
                r["error_unknown"],
                r["n_motions_found"] == r["n_motions"],
            )
            for r in half
        ]
        halves.append((100 * np.mean(figures, axis=0)).tolist() if figures else None)
    return halves if None not in halves else None


def video_rows(dataset, method, found):
    """A row per figure of videos."""
    names = {
        "region": "region similarity J",
        "boundary": "boundary F-measure",
        "f_measure": "pixels; F-measure",
        "points_f_measure": "first 10 frames, points; F-measure",
    }
    return [
        {
            "row": f"{dataset} {method}, {name}",
            "dataset": dataset,
            "n_sequences": found["n_sequences"],
            "n_seeds": found["n_seeds"],
            "version": __version__,
            "what": title,
            "figure": found[name][0],
        }
        for name, title in names.items()
        if name in found
    ]


def take_over_paper(files):
    """Put what ``skmotionseg bench --paper --json`` wrote into the stored accuracy."""
    records = [each for path in files for each in json.loads(Path(path).read_text())]
    rows = [
        {"row": f"{dataset} {method}", **found, "version": __version__}
        for (dataset, method), found in summarize_paper(records).items()
    ]
    report.save(RECORDS["accuracy"], "paper", rows)


def main(arguments=None):
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.figures",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--bench", nargs="+", default=[], metavar="FILE")
    parser.add_argument("--paper", nargs="+", default=[], metavar="FILE")
    parser.add_argument("--check", action="store_true", help="rewrite nothing")
    arguments = parser.parse_args(arguments)
    if arguments.check:
        found = differences()
        print("\n".join(f"{page}, {what}" for page, what in found.items()))
        return bool(found)
    if arguments.bench:
        take_over(arguments.bench)
    if arguments.paper:
        take_over_paper(arguments.paper)
    for name, sections in pages().items():
        page = ROOT / name
        page.write_text(rewritten(page, sections))
    return 0


if __name__ == "__main__":
    sys.exit(main())
