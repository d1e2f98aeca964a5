"""Writers that are killed, or interrupted, at one line of theirs after another.

``python killed_writers.py FOLDER`` prints as JSON what it found, for each writer.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib
import io
import json
import linecache
import os
import signal
import sys
import traceback
from pathlib import Path

import matplotlib
import matplotlib.pyplot  # which a child should not have to import
import numpy as np
from matplotlib.figure import Figure
from sklearn.utils import Bunch

import skmotionseg
from skmotionseg import save_motions
from skmotionseg._commands import label_files
from skmotionseg._commands.console import save_figure
from skmotionseg._utils import writing as _writing

matplotlib.use("Agg")
PACKAGE = str(Path(skmotionseg.__file__).parent)
MOST_OTHERS = 2  # lines outside of _writing.py at which a writer is killed
X = np.arange(240.0).reshape(20, 12) % 97


def write_labels(path, version):
    sequence = Bunch(data=X + version, track_ids=np.arange(20), video={})
    label_files.write_labels(path, sequence, np.full(20, version))


def write_motions(path, version):
    save_motions(path.parent, X + version, np.repeat([0, 1], 10))


def write_picture(path, version):
    figure = Figure(figsize=(1, 1))
    figure.add_subplot().plot([0, version], [0, 1])
    save_figure(figure, path)


def write_video(path, version):
    from skmotionseg.video import render_segmentation

    frames = np.full((2, 48, 64), 60 + 40 * version, np.uint8)
    render_segmentation(frames, X[:, :4], np.arange(20) % 3, path)


WRITERS = {
    "labels.npz": write_labels,
    "motion_0.npz": write_motions,
    "picture.png": write_picture,
    "video.mp4": write_video,
}


def in_child(work):
    """Do work in a process of its own; its exit status."""
    child = os.fork()
    if child == 0:
        try:
            work()
        except KeyboardInterrupt:
            os._exit(1)
        except BaseException:
            traceback.print_exc()
            os._exit(2)
        os._exit(0)
    return os.waitpid(child, 0)[1]


def tracing(act):
    """Call ``act`` with the number of each line of the package that is run."""
    done = 0

    def trace(frame, event, argument):
        nonlocal done
        if not frame.f_code.co_filename.startswith(PACKAGE):
            return None
        if event == "line":
            act(done, frame)
            done += 1
        return trace

    sys.settrace(trace)


def lines_of(write, path):
    """For each line that a writer runs, whether it is of _writing.py, and which."""
    list_of_lines = path.with_name("lines")

    def work():
        with list_of_lines.open("w") as file:

            def note(number, frame):
                ours = frame.f_code.co_filename == _writing.__file__
                line = linecache.getline(frame.f_code.co_filename, frame.f_lineno)
                file.write(json.dumps([ours, line.strip()]) + "\n")

            tracing(note)
            write(path, 2)
            sys.settrace(None)

    assert in_child(work) == 0
    lines = [json.loads(line) for line in list_of_lines.read_text().splitlines()]
    list_of_lines.unlink()
    return lines


def chosen(lines):
    """Numbers of all lines of _writing.py, and of some others."""
    ours = [number for number, (is_ours, _) in enumerate(lines) if is_ours]
    others = [number for number, (is_ours, _) in enumerate(lines) if not is_ours]
    return sorted({*ours, *others[:: -(-len(others) // MOST_OTHERS)]})


def stop_at(number, how, write, path):
    def act(line, frame):
        if line == number:
            sys.settrace(None)
            if how == "kill":
                os.kill(os.getpid(), signal.SIGKILL)
            raise KeyboardInterrupt

    def work():
        tracing(act)
        write(path, 2)

    return in_child(work)


def content(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def try_writer(name, write, folder):
    """What was wrong after which line, and how often the old or new file was there."""
    path = folder / name
    assert in_child(lambda: write(path, 1)) == 0
    old = content(folder)
    lines = lines_of(write, path)
    new = content(folder)
    wrong, outcomes = [], {"old": 0, "new": 0}
    # What an exception does is the same for all; several files have most to undo.
    for how in ("kill", "interrupt") if write is write_motions else ("kill",):
        for number in chosen(lines):
            if how == "interrupt" and "unlink" in lines[number][1]:
                continue  # nothing removes what is being removed
            for left in folder.iterdir():
                left.unlink()
            for file, data in old.items():
                (folder / file).write_bytes(data)
            status = stop_at(number, how, write, path)
            found = content(folder)
            stopped = os.WIFSIGNALED(status) if how == "kill" else status != 0
            whole = all(found.get(f) in (old[f], new[f]) for f in old)
            strays = set(found) - set(old)
            if not stopped or not whole or (how == "interrupt" and strays):
                wrong.append([how, lines[number][1], sorted(strays), stopped, whole])
            outcomes["new" if found.get(name) == new[name] else "old"] += 1
    return {"same": old == new, "wrong": wrong, **outcomes}


def warm_up():
    """Import here what each child would have to import for itself."""
    figure = Figure(figsize=(1, 1))
    figure.add_subplot().plot([0, 1], [0, 1])
    figure.savefig(io.BytesIO())
    with contextlib.suppress(ImportError):  # which is said of the writer that needs it
        importlib.import_module("cv2")
        importlib.import_module("skmotionseg.video")


def main(folder):
    found = {}
    warm_up()
    for name, write in WRITERS.items():
        home = folder / name.replace(".", "_")
        home.mkdir()
        try:
            found[name] = try_writer(name, write, home)
        except ImportError as error:
            found[name] = {"missing": str(error)}
    print(json.dumps(found))


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    main(parser.parse_args().folder)
