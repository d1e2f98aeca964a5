"""Run the benchmarks without asv, print the table of speeds, fill in the page.

The commands:

    python -m benchmarks [--filter REGEX] [--quick]       every class, as asv would
    python -m benchmarks --table --data DIR [--rows ...]  the table
    python -m benchmarks --write docs/speed.md            its figures, from JSON
    python -m benchmarks.figures                          those of all pages, from JSON

``benchmarks.floor``, ``.peers``, ``.growth``, ``.imports`` and ``.sensitivity`` run by
themselves, with ``python -m``. With ``--json FILE`` figures are kept there, in a
section of their own; rows that were there before are replaced, others stay. Those of
the imports are printed alone, and the growth is drawn of what the table has kept.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from benchmarks import floor, growth, peers, report, runner, table

COLUMNS = {
    "stages": runner.COLUMNS,
    "table": table.COLUMNS,
    "floor": floor.COLUMNS,
    "peers": peers.COLUMNS,
}


# MotionSegmenter() of version 0.1.0 on the same sequences, number of motions known and
# unknown: how many times as fast as the plain version it was, and its error in percent;
# and its error in the video of 2,000 frames.
TIMES_AS_FAST, ERRORS = (4.0, 4.9), (3.3, 3.6)
ERROR_OF_LONGEST = 66
SIZES = {
    "tracks": [12_500, 25_000, 50_000],
    "frames": [500, 1000, 2000],
    "tracks_of_frames": 2000,
}
QUICK_SIZES = {"tracks": [250, 500], "frames": [100, 200], "tracks_of_frames": 300}


def compared_with_0_1_0(record):
    """What became slower since version 0.1.0, and what it gained."""
    rows = {row["row"]: row for row in record["table"]}
    ours, plain = (
        [rows[f"clips-{method}-{count}"] for count in ("known", "unknown")]
        for method in ("default", "plain")
    )
    known, unknown = (
        f"{before} times as fast as plain NumPy and is "
        f"{theirs['cpu_seconds'] / mine['cpu_seconds']:.1f} times as fast now"
        for before, mine, theirs in zip(TIMES_AS_FAST, ours, plain, strict=True)
    )
    errors = " and ".join(
        f"from {before} to {mine['error']:.1f} %"
        for before, mine in zip(ERRORS, ours, strict=True)
    )
    longest = rows["frames-2000"]
    return (
        "**`MotionSegmenter()` is slower than in 0.1.0.** Seconds of two machines say "
        "little, the ratio to the plain version says more (now of CPU seconds): with "
        f"the number of motions known it was {known}; with the number unknown it was "
        f"{unknown}. That is what rigid motion over many frames costs; the errors on "
        f"these clips went {errors}. In the video of {longest['n_frames']:,} frames, "
        f"where {ERROR_OF_LONGEST} % of the tracks were wrong, {longest['error']:.1f} "
        "% are now."
    )


def sections_of_speed(page):
    """What makes each section of the page from the record; draws its picture."""

    def at_scale(record):
        rows = record.get("table", [])
        return [row for scene in growth.SCENES for row in growth.of_scene(rows, scene)]

    def on_sequences(record):
        return [row for row in record.get("table", []) if row not in at_scale(record)]

    def picture(record):
        path = page.parent / "images" / "growth.png"
        try:
            growth.draw_growth(at_scale(record), path)
        except ValueError as error:
            return f"(no picture yet: {error})"
        return growth.SHOWN

    return {
        "sequences": lambda r: report.figures(on_sequences(r), table.COLUMNS),
        "scale": lambda r: report.figures(at_scale(r), table.COLUMNS),
        "growth": picture,
        "compared": compared_with_0_1_0,
        **{
            name: lambda r, name=name: report.figures(r.get(name), COLUMNS[name])
            for name in ("stages", "floor", "peers")
        },
    }


def _parser():
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("--filter", default="", metavar="REGEX", help="run what matches")
    add("--repeats", type=int, default=5)
    add("--quick", action="store_true", help="the smallest sizes, once")
    add("--json", type=Path, help="keep the figures (--write: docs/speed.json)")
    add("--table", action="store_true", help="print the table of speeds")
    add("--data", type=Path, help="holds KT3DMoSeg and Hopkins155")
    add("--rows", nargs="+", default=["*"], help="patterns such as 'clips-*'")
    add("--jobs", type=int, default=-1, help="models at a time (all cores)")
    add("--tracks", nargs="+", type=int, help="sizes of the rows tracks-*")
    add("--frames", nargs="+", type=int, help="sizes of the rows frames-*")
    add("--tracks-of-frames", type=int, help="tracks in the rows frames-*")
    add("--write", type=Path, metavar="PAGE", help="rewrite the page's tables")
    return parser


def main(arguments=None):
    arguments = _parser().parse_args(arguments)
    if arguments.write:
        record = arguments.json or Path("docs/speed.json")
        report.write_page(arguments.write, record, sections_of_speed(arguments.write))
        return
    section = "table" if arguments.table else "stages"
    repeats = 1 if arguments.quick else arguments.repeats
    sizes = QUICK_SIZES if arguments.quick else SIZES
    if arguments.table:
        n_tracks = arguments.tracks_of_frames or sizes["tracks_of_frames"]
        measured = table.make_table(
            arguments.data,
            arguments.rows,
            repeats,
            arguments.jobs,
            [(n, 20) for n in arguments.tracks or sizes["tracks"]],
            [(n_tracks, n) for n in arguments.frames or sizes["frames"]],
            arguments.quick,
        )
    else:
        measured = runner.run_all(arguments.filter, repeats, arguments.quick)
    rows = []
    for row in measured:  # kept one by one: the whole takes long
        rows.append(row)
        report.save(arguments.json, section, [row])
    if not rows:
        raise SystemExit("nothing to measure has a name that matches")
    report.show(rows, COLUMNS[section])


if __name__ == "__main__":
    main()
