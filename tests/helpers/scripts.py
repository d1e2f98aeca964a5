"""Scripts of this folder, run by themselves."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path


def run_limited(script, *arguments, seconds):
    """Run a script of this folder, its native libraries with one thread each."""
    names = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "OPENCV_FOR_THREADS_NUM")
    here = Path(__file__).parent
    return subprocess.run(
        [sys.executable, here / script, *map(str, arguments)],
        env={**os.environ, **dict.fromkeys(names, "1"), "PYTHONHASHSEED": "0"},
        capture_output=True,
        text=True,
        timeout=seconds,
    )
