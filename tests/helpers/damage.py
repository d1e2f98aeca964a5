"""Reads damaged files in a process that may not grow.

``python damage.py FOLDER PERCENT FLIPS``: each file of the folder is cut short at every
so many percent, and has so many random bits flipped. ``python damage.py FOLDER``: each
is read as it is. What came of it is printed as JSON.
"""

from __future__ import annotations

import json
import os
import re
import signal
import sys
import warnings
from pathlib import Path

import numpy as np

from skmotionseg.datasets import load_tracks
from skmotionseg.datasets._moseg import read_definition
from skmotionseg.datasets._regions import read_mask
from skmotionseg.video._frames import VIDEO_ENDINGS, open_frames

MOST_BYTES = 2**30
MOST_SECONDS = 20


def limit_memory():
    """Refuse this process more memory; a bug then fails here, not on the machine."""
    import resource  # of POSIX alone

    resource.setrlimit(resource.RLIMIT_AS, (MOST_BYTES, MOST_BYTES))


def read(path):
    if path.is_dir() or path.suffix in VIDEO_ENDINGS:
        return sum(1 for _ in open_frames(path))
    if path.name.endswith("Def.dat"):
        return read_definition(path)
    if path.suffix in (".pgm", ".ppm"):
        return read_mask(path)
    return load_tracks(path)


def outcome(path):
    """None if a file was read, or refused in words; else what happened."""
    signal.alarm(MOST_SECONDS)
    try:
        read(path)
    except (ValueError, OSError) as error:
        words = str(error)
        if path.name not in words or "\n" in words or len(words) > 600:
            return f"{type(error).__name__}: {words[:300]}"
    except BaseException as error:
        return f"{type(error).__name__}: {error}"[:300]
    finally:
        signal.alarm(0)
    return None


def cuts(content, every_percent):
    for percent in range(0, 100, every_percent):
        yield f"cut at {percent} %", content[: len(content) * percent // 100]


def flips(content, count, seed):
    """One to eight bits, anywhere or, every other time, near the start or the end."""
    rng = np.random.default_rng(seed)
    for number in range(count):
        array = np.frombuffer(content, np.uint8).copy()
        ends = np.r_[0 : min(400, len(array)), max(0, len(array) - 400) : len(array)]
        places = ends if number % 2 else np.arange(len(array))
        for place in rng.choice(places, rng.integers(1, 9)):
            array[place] ^= 1 << rng.integers(8)
        yield f"flip {number}", array.tobytes()


def damaged(content, every_percent, n_flips, seed):
    yield from cuts(content, every_percent)
    yield from flips(content, n_flips, seed)


def try_all(source, folder, every_percent, n_flips):
    """Number of variants of one file, and what was wrong with which."""
    wrong, count = {}, 0
    inside = source.is_dir()  # a folder of frames: its first is damaged
    original = next(source.iterdir()) if inside else source
    content = original.read_bytes()
    target = folder / source.name
    if inside:
        target.mkdir()
    path = target / original.name if inside else target
    for name, bad in damaged(content, every_percent, n_flips, seed=0):
        path.write_bytes(bad)
        (folder / "current").write_text(f"{source.name}: {name}")
        said = outcome(target)
        if said is not None:
            wrong[f"{source.name}: {name}"] = said
        count += 1
    return count, wrong


def refusals(folder):
    """What is said of each file."""
    said = {}
    for path in sorted(folder.iterdir()):
        signal.alarm(MOST_SECONDS)
        try:
            read(path)
            said[path.name] = "was read"
        except (ValueError, OSError) as error:
            said[path.name] = str(error)
        except BaseException as error:
            said[path.name] = f"failed with {type(error).__name__}"
        finally:
            signal.alarm(0)
    return said


def peak():
    """Most memory that this process had, bytes."""
    import resource

    status = Path("/proc/self/status")
    if status.exists():  # what follows counts the process that started this one, too
        return int(re.search(r"VmHWM:\s+(\d+)", status.read_text()).group(1)) * 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def try_folder(folder, every_percent, n_flips):
    work = folder / "damaged"
    work.mkdir()
    counts, wrong = {}, {}
    for source in sorted(p for p in folder.iterdir() if p.name != "damaged"):
        counts[source.name], bad = try_all(source, work, every_percent, n_flips)
        wrong |= bad
    return {"counts": counts, "wrong": wrong}


if __name__ == "__main__":
    os.environ["OPENCV_FFMPEG_LOGLEVEL"] = "-8"
    os.environ["OPENCV_LOG_LEVEL"] = "SILENT"
    signal.signal(signal.SIGALRM, signal.default_int_handler)
    warnings.simplefilter("ignore")
    limit_memory()
    source, *numbers = sys.argv[1:]
    run = try_folder if numbers else refusals
    found = run(Path(source), *map(int, numbers))
    print(json.dumps({"found": found, "peak": peak()}))
