"""Run scripts one after the other in one interpreter, as if each were run by itself.

Commands, lists of a path and its arguments, are read as JSON; what each of them prints
is printed as JSON.
"""

from __future__ import annotations

import io
import json
import runpy
import sys
from contextlib import redirect_stdout


def main():
    printed = []
    for command in json.load(sys.stdin):
        sys.argv = command
        with redirect_stdout(io.StringIO()) as out:
            runpy.run_path(command[0], run_name="__main__")
        printed.append(out.getvalue())
    json.dump(printed, sys.stdout)


if __name__ == "__main__":
    main()
