"""What the commands share: numbers they take, tables and progress they print."""

from __future__ import annotations

import argparse
import time
from contextlib import contextmanager

import numpy as np

from .._utils.optional import require
from .._utils.writing import replacing_path

PICTURES = (".png", ".pdf", ".svg", ".jpg")


def count(text, or_else="", *, least=1):
    """A whole number of so many or more, of a command line."""
    number = _integer(text)
    if number is None or number < least:
        raise argparse.ArgumentTypeError(
            f"expected a whole number, {least} or more{or_else}; got {text!r}"
        )
    return number


def seed(text):
    """A whole number that random numbers may start from, of a command line."""
    number = _integer(text)
    if number is None or not 0 <= number < 2**32:
        raise argparse.ArgumentTypeError(
            f"expected a whole number from 0 to {2**32 - 1}; got {text!r}"
        )
    return number


def jobs(text):
    """How many jobs run in parallel, of a command line: -1 is one per processor."""
    number = _integer(text)
    if not number:
        raise argparse.ArgumentTypeError(
            f"expected 1 or more, or -1 for all processors; got {text!r}"
        )
    return number


def _integer(text):
    """A whole number, or None if a text is none."""
    try:
        return int(text)
    except ValueError:
        return None


def positive(text):
    """A number above 0, of a command line."""
    number = _number(text)
    if not 0 < number < np.inf:
        raise argparse.ArgumentTypeError(f"expected a number above 0; got {text!r}")
    return number


def threshold(text):
    """What probabilities may be above, of a command line."""
    number = _number(text)
    if not 0 <= number < 1:
        raise argparse.ArgumentTypeError(
            f"expected a number of 0 or more and less than 1; got {text!r}"
        )
    return number


def _number(text):
    """A number, or NaN if a text is none."""
    try:
        return float(text)
    except ValueError:
        return np.nan


def console_of_findings(extra="cli"):
    """A console on standard output, for what is found."""
    return _console(extra)


def progress_console():
    """A console on standard error, which leaves standard output to what is found."""
    return _console("cli", stderr=True)


def _console(extra, **options):
    """A console that prints names of files as they are, whatever signs are in them."""
    plain = {"markup": False, "emoji": False, "highlight": False}
    return require("rich.console", extra=extra).Console(**plain, **options)


def pyplot():
    require("matplotlib", extra="cli").use("Agg")
    return require("matplotlib.pyplot", extra="cli")


def save_figure(figure, path):
    """Write a figure, and close it."""
    with replacing_path(path) as part:
        figure.savefig(part, dpi=130, bbox_inches="tight")
    pyplot().close(figure)


def facts_table(title, facts):
    table = require("rich.table", extra="cli").Table(
        title=title, show_header=False, title_justify="left"
    )
    table.add_column(style="dim")
    table.add_column(justify="right")
    for name, value in facts:
        table.add_row(name, value)
    return table


def track_facts(X):
    unseen = np.isnan(X).mean()
    return [
        ("tracks", str(len(X))),
        ("frames", str(X.shape[1] // 2)),
        ("unseen", f"{unseen:.1%}"),
    ]


def seconds_facts(seconds):
    return [(f"seconds {stage}", f"{each:.3f}") for stage, each in seconds.items()]


def print_files(console, files):
    """Print a line per file that was written: what is in it, and where it is.

    Parameters
    ----------
    console : rich.console.Console
    files : dict of str to path-like or None
        None where no such file was asked for.
    """
    for content, path in files.items():
        if path is not None:
            # On one line, however long: paths are copied.
            console.print(f"{content}: {path}", soft_wrap=True)


def with_progress(items, total, description, console):
    """Pass items on under a progress bar, or, in a log file, a line every tenth."""
    with reporting(description, console) as report:
        for done, item in enumerate(items, start=1):
            yield item
            report(done, total)


@contextmanager
def reporting(description, console):
    """A function of the number done and the total (or None), which shows them.

    On a terminal it moves a bar; in a log file it prints a line every tenth.
    """
    if not console.is_terminal:
        yield lambda done, total: _print_tenth(description, done, total, console)
        return
    with require("rich.progress", extra="cli").Progress(console=console) as bars:
        bar = bars.add_task(description, total=None)
        yield lambda done, total: bars.update(bar, completed=done, total=total)


@contextmanager
def timed_stage(name, sequence, console):
    """As :func:`reporting`; keeps the seconds in those of a sequence."""
    started = time.perf_counter()
    with reporting(name, console) as report:
        yield report
    sequence.seconds[name] = time.perf_counter() - started


def _print_tenth(description, done, total, console):
    if total and done * 10 // total > (done - 1) * 10 // total:
        console.print(f"{description}: {done} of {total} done")
