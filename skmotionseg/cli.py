"""The ``skmotionseg`` command."""

from __future__ import annotations

import argparse
import os
import sys
import warnings
from collections.abc import Sequence
from contextlib import contextmanager

from ._commands.bench import add_bench
from ._commands.demo import add_demo
from ._commands.segment import add_segment
from ._version import __version__

__all__ = ["main"]

# For joblib's process that tidies up after workers that were interrupted: it names what
# it removed, after all that this command has to say.
TIDIES_IN_SILENCE = "ignore:resource_tracker:UserWarning"


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command.

    Parameters
    ----------
    argv : list of str, optional
        Arguments; those of the process by default.

    Returns
    -------
    int
        0, or 2 if the input or the installation is at fault, or 130 after Ctrl-C.

    Raises
    ------
    SystemExit
        By the parser: with 2 if it does not take the arguments, with 0 after
        ``--help`` and ``--version``.

    Examples
    --------
    >>> from skmotionseg.cli import main
    >>> main(["segment", "nowhere.csv"])
    2
    """
    arguments = _parser().parse_args(argv)
    try:
        with warnings.catch_warnings(), _tidied_in_silence(), _printed_all_the_same():
            warnings.showwarning = _print_warning
            return arguments.run(arguments) or 0
    except (ImportError, OSError, ValueError, TypeError) as error:
        print(f"skmotionseg: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("skmotionseg: interrupted", file=sys.stderr)
        return 130  # as shells have it


def _print_warning(message, *where, **file):
    print(f"skmotionseg: warning: {message}", file=sys.stderr)


@contextmanager
def _tidied_in_silence():
    """Processes that are started within this say nothing of what they tidy up."""
    name = "PYTHONWARNINGS"
    before = os.environ.get(name)
    os.environ[name] = ",".join(filter(None, [before, TIDIES_IN_SILENCE]))
    try:
        yield
    finally:
        if before is None:
            del os.environ[name]
        else:
            os.environ[name] = before


@contextmanager
def _printed_all_the_same():
    """What standard output has no sign for is printed as "?", and is no error."""
    stream = sys.stdout
    if not hasattr(stream, "reconfigure"):
        yield
        return
    before = stream.errors
    stream.reconfigure(errors="replace")
    try:
        yield
    finally:
        stream.reconfigure(errors=before)


def _parser():
    parser = argparse.ArgumentParser(
        prog="skmotionseg",
        description="Motion segmentation: which point tracks of a moving camera move "
        "together.",
    )
    parser.add_argument("--version", action="version", version=__version__)
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    add_demo(commands)
    add_segment(commands)
    add_bench(commands)
    return parser


if __name__ == "__main__":
    sys.exit(main())
