"""What ``skmotionseg segment`` prints: facts, motions, and why there are so many."""

from __future__ import annotations

from textwrap import fill

from .._core.geometry.tracks import unpack_tracks
from .._segmenter.report import how_sure, pixels, window_lines
from .._utils.colours import motion_colour
from .._utils.optional import require
from .._utils.words import counted
from .console import facts_table, print_files, seconds_facts, track_facts


def print_findings(console, arguments, sequence, segmenter):
    """Print what was found in tracks, and where it was written.

    Parameters
    ----------
    console : rich.console.Console
    arguments : argparse.Namespace
        Of ``skmotionseg segment``.
    sequence : Bunch
        Tracks, true labels or None, the moving objects of which pictures were drawn or
        None, and ``seconds`` of each stage, in order.
    segmenter : MotionSegmenter
        Fitted to the tracks.
    """
    from ..metrics import misclassification_error

    labels = segmenter.labels_
    facts = [
        *track_facts(sequence.data),
        ("motions found", str(segmenter.n_motions_)),
    ]
    if sequence.target is not None and (sequence.target >= 0).any():
        error = misclassification_error(sequence.target, labels)
        facts.append(("misclassification", f"{error:.2%}"))
        # Which may be what an earlier run found, and wrote there.
        facts.append(("taken as true", "labels in the file"))
    if sequence.objects is not None:
        facts.append(("moving objects", str(sequence.objects.max(initial=0))))
    facts += seconds_facts(sequence.seconds)
    console.print(facts_table(arguments.file.name, facts))
    report = segmenter.report(sequence.data)
    # Pictures that show objects have the colours of these.
    console.print(_motion_table(report, coloured=sequence.objects is None))
    if sequence.objects is not None:
        console.print(_object_table(sequence))
    if len(report.counts) > 1:
        console.print(_count_table(report))
    if report.windows:
        console.print(window_lines(report))
    files = {
        "labels": arguments.out,
        "picture": arguments.render,
        "masks": arguments.masks,
        "static masks": arguments.static_masks,
        "prompts": arguments.prompts,
        "viewer": arguments.viewer,
        "report": arguments.report,
        "motions": arguments.split_dir and _files_in(arguments.split_dir, sequence),
    }
    print_files(console, files)


def _files_in(folder, sequence):
    return f"{counted(sequence.n_files, 'file')} in {folder}"


def _motion_table(report, *, coloured):
    """A row per motion, and one for the tracks of none; with their colours, or not."""
    table = require("rich.table", extra="cli").Table()
    for title in ("motion", "tracks", "share", "frames", *["colour"] * coloured):
        table.add_column(title, justify="right")
    table.add_column("model")
    table.add_column("residual", justify="right")
    for motion in report.motions:
        table.add_row(
            str(motion.label),
            str(motion.n_tracks),
            f"{motion.share:.1%}",
            f"{len(motion.frames)} of {report.n_frames}",
            *[_colour(motion.label)] * coloured,
            motion.model or "too few",
            pixels(motion.residual),
        )
    if report.n_outliers:
        share = f"{report.n_outliers / report.n_tracks:.1%}"
        colour = [_colour(-1)] * coloured
        table.add_row("none", str(report.n_outliers), share, "", *colour)
    return table


def _object_table(sequence):
    """A row per moving object as masks and pictures number and colour it."""
    table = require("rich.table", extra="cli").Table()
    for title in ("in masks and pictures", "tracks", "frames", "colour"):
        table.add_column(title, justify="right")
    _, visibility = unpack_tracks(sequence.data)
    for number in range(sequence.objects.max(initial=0) + 1):
        own = sequence.objects == number
        table.add_row(
            f"object {number}" if number else "static scene 0",
            str(own.sum()),
            f"{visibility[own].any(axis=0).sum()} of {visibility.shape[1]}",
            _colour(number),
        )
    return table


def _colour(motion):
    colour = motion_colour(motion)
    text = require("rich.text", extra="cli").Text
    return text.assemble(("●", colour), f" {colour}")


def _count_table(report):
    """A row per number of motions: its costs, and why it was chosen or not."""
    table = require("rich.table", extra="cli").Table(caption=how_sure(report) or None)
    for title in ("motions", *report.term_names, "total"):
        # Broken here, so that narrow screens leave the width to the verdicts.
        table.add_column(fill(title, 12, break_long_words=False), justify="right")
    table.add_column("verdict")
    for each in report.counts:
        table.add_row(
            str(each.n_motions),
            *(f"{cost:.4f}" for cost in (*each.terms, each.total)),
            each.verdict,
            style="bold" if each.chosen else "",
        )
    return table
