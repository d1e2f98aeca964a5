"""``skmotionseg segment --live``: a camera, or a video as if it were one."""

from __future__ import annotations

import signal
import threading
import time
from contextlib import ExitStack, contextmanager
from pathlib import Path

import numpy as np

from .._utils.writing import check_apart, check_output
from .console import console_of_findings, facts_table, print_files
from .label_files import begin_observations, write_frame
from .method_options import METHOD_OPTIONS, check_no_file_options, option_name
from .video_tracks import open_video
from .windows import Window

# Points that a frame has by default: a grid so coarse that a camera is kept up with.
N_POINTS = 500
# What does not go with it, as it needs the whole video.
WHOLE = (
    "split_dir",
    "report",
    "masks",
    "static_masks",
    "prompts",
    "viewer",
    "confidence",
    "resume",
)
# What ends it: Ctrl-C, and what machines send.
SIGNALS = (signal.SIGINT, signal.SIGTERM)
# Options of a segmenter of clips that the one of streams does not have.
OF_CLIPS = ("min_motions", "max_motions", "models", "selection", "jobs")


def segment_live(arguments):
    """Track and segment frame by frame, and draw and write what is found.

    Parameters
    ----------
    arguments : argparse.Namespace
        Of ``skmotionseg segment``.
    """
    from ..online import OnlineMotionSegmenter
    from ..video._rendering import write_points

    _check(arguments)
    console = console_of_findings()
    frames = open_video(_source(arguments.file), arguments.stride)
    segmenter = OnlineMotionSegmenter(
        arguments.motions,
        focal_length=arguments.focal_length,
        random_state=arguments.seed,
    )
    started = time.perf_counter()
    with ExitStack() as files:
        window = None
        interrupts = files.enter_context(_ended_as_by_ctrl_c())
        if not arguments.no_window:
            window = _window(str(arguments.file), console)
            files.callback(window.close)
        tracked = interrupts.let_through(_tracked(frames, arguments))
        labelled = _labelled(tracked, segmenter, files, arguments, console)
        if window is not None:
            labelled = _shown(labelled, window, console)
        if arguments.render is None:
            for _ in labelled:
                pass
        else:
            write_points(labelled, arguments.render, fps=frames.fps or 25)
    _print(console, arguments, segmenter, time.perf_counter() - started)


def _check(arguments):
    check_output(arguments.out, (".csv",))
    check_output(arguments.render, (".mp4",))
    for name in WHOLE:
        if getattr(arguments, name, None):
            raise ValueError(
                f"{option_name(name)} needs the whole video, and --live has a frame"
            )
    for name in OF_CLIPS:
        option = option_name(name)
        if getattr(arguments, name) != METHOD_OPTIONS[option].get("default"):
            raise ValueError(f"{option} is for clips, and --live has a stream")
    check_no_file_options(arguments)
    written = {"--out": arguments.out, "--render": arguments.render}
    check_apart(arguments.file, written)


def _source(file):
    """A number is a camera, unless there is a file of this name."""
    text = str(file)
    return int(text) if text.isdecimal() and not Path(file).exists() else file


class _Interrupts:
    """What ends the stream: at once while a frame is waited for, or after the frame.

    In the midst of a frame, or when files are completed, a KeyboardInterrupt would
    leave half of them. So the first is held back there; if another one comes, somebody
    does not want to wait.
    """

    def __init__(self):
        self._hold = self._held = False

    def handle(self, number, frame):
        """Take a signal."""
        if not self._hold or self._held:
            raise KeyboardInterrupt
        self._held = True

    def let_through(self, frames):
        """Yield frames; KeyboardInterrupt comes while one is waited for."""
        iterator = iter(frames)
        while True:
            try:
                self._hold = False
                if self._held:
                    raise KeyboardInterrupt
                each = next(iterator, None)
            finally:
                self._hold = True
            if each is None:
                return
            yield each


@contextmanager
def _ended_as_by_ctrl_c():
    """Let what ends a process do as Ctrl-C does, which completes the files."""
    interrupts = _Interrupts()
    if threading.current_thread() is not threading.main_thread():
        yield interrupts  # where signals cannot be handled
        return
    # Shells let what runs in the background ignore Ctrl-C: it is not for that.
    heeded = [n for n in SIGNALS if signal.getsignal(n) is not signal.SIG_IGN]
    before = {number: signal.signal(number, interrupts.handle) for number in heeded}
    try:
        yield interrupts
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _begin_table(path, files):
    """The table of labels, open until all files are closed; None if there is none.

    It is not written beside its place to be put there in the end: whatever ends the
    command, what was found until then is there.
    """
    if path is None:
        return None
    table = files.enter_context(path.open("wb"))
    begin_observations(table)
    return table


def _tracked(frames, arguments):
    """Frames with their points, as these come."""
    from ..video import follow_points

    frames, shape = _with_first_shape(frames)
    return follow_points(
        frames,
        grid_spacing=arguments.grid or _spacing(*shape),
        max_frames=arguments.max_frames,
        max_side=arguments.max_side,
    )


def _labelled(tracked, segmenter, files, arguments, console):
    """Yield frames with their points and labels, until the end or Ctrl-C.

    At least one: a KeyboardInterrupt before it is raised.
    """
    table, n_done = None, 0
    try:
        for each in tracked:
            points, ids = each.points, each.ids
            labels = segmenter.update(points, ids)
            for event in segmenter.events_:
                console.print(str(event))
            if n_done == 0:
                table = _begin_table(arguments.out, files)
            if table is not None:
                write_frame(table, n_done, ids, points, labels)
                table.flush()
            yield each.frame, points, labels
            n_done += 1
    except KeyboardInterrupt:  # how one ends what a camera films
        if n_done == 0:
            raise
        console.print("stopped")


def _window(title, console):
    """A window on the screen; where there is none, that is said."""
    window = Window(title)
    if window.reason:
        console.print(f"no window: {window.reason}")
    else:
        console.print("q or Esc in the window ends it")
    return window


def _shown(labelled, window, console):
    """Yield the same, each drawn in a window, until somebody ends it there."""
    from ..video._rendering import with_points

    for each in labelled:
        yield each
        if not window.reason and not window.show(with_points(*each)):
            console.print("stopped")
            return


def _with_first_shape(frames):
    """The same frames, and the height and width of the first: there must be one."""
    from ..video._frames import Frames

    iterator = iter(frames)
    first = next(iterator, None)
    if first is None:
        raise ValueError(f"{frames.name} has no frames")

    def again():
        yield first
        yield from iterator

    whole = Frames(frames.name, again, fps=frames.fps, n_announced=frames.n_announced)
    return whole, first.shape[:2]


def _spacing(height, width):
    """The distance at which a frame has as many points as it should."""
    return max(8, round(np.sqrt(height * width / N_POINTS)))


def _print(console, arguments, segmenter, seconds):
    n_frames = segmenter.n_frames_
    found = segmenter.result()
    facts = [
        ("frames", str(n_frames)),
        ("tracks", str(len(found.labels))),
        ("motions found", str(found.n_motions)),
        ("motions in view", str(segmenter.n_motions_)),
        ("frames per second", f"{n_frames / seconds:.1f}"),
    ]
    console.print(facts_table(str(arguments.file), facts))
    if not len(found.labels):
        console.print("no point could be followed: there is too little texture")
    print_files(console, {"labels": arguments.out, "picture": arguments.render})
