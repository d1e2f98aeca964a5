"""Frame by frame from a camera, or from a file played as if it were one."""

from __future__ import annotations

import os
import pkgutil
import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from helpers.pictures import film_of_a_thing, write_video

from skmotionseg import unpack_tracks
from skmotionseg._commands import live
from skmotionseg.cli import main
from skmotionseg.video import follow_points, track_video
from skmotionseg.video._frames import Frames
from skmotionseg.video._rendering import write_points

cv2 = pytest.importorskip("cv2", reason="needs opencv-python-headless")

WIDTH, HEIGHT, N_FRAMES = 240, 180, 14


@pytest.fixture(autouse=True)
def interrupts_are_heard():
    """As in a terminal: what a shell starts in the background ignores Ctrl-C."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture(scope="module")
def frames():
    """A wall that goes by, and a thing before it that goes the other way."""
    places = (((f, 2 * f), (50 + f, 20 + 3 * f)) for f in range(N_FRAMES))
    return film_of_a_thing((HEIGHT, WIDTH), (80, 90), places)


@pytest.fixture(scope="module")
def file(frames, tmp_path_factory):
    path = tmp_path_factory.mktemp("video") / "camera.avi"
    return write_video(path, frames, "MJPG", 20.0)


def test_points_are_those_of_the_whole_video(frames):
    """But for those that are seen later to have slid."""
    points, seen = unpack_tracks(track_video(frames, min_length=1).tracks)
    for number, each in enumerate(follow_points(frames)):
        live = set(map(tuple, each.points.astype(np.float32).tolist()))
        whole = set(map(tuple, points[seen[:, number], number].tolist()))
        assert whole <= live
        assert len(whole) > 0.95 * len(live)
        assert each.frame.shape == (HEIGHT, WIDTH, 3)
    assert number == N_FRAMES - 1
    assert whole == live  # of the last frame, all is there


def test_points_are_handed_over_as_frames_come(frames):
    given = []

    def camera():
        for number, frame in enumerate(frames):
            given.append(number)
            yield frame

    following = follow_points(camera())
    next(following)
    next(following)
    assert given == [0, 1]


@pytest.mark.slow
def test_a_file_is_played_as_if_it_were_a_camera(file, tmp_path, capsys):
    picture, table = tmp_path / "live.mp4", tmp_path / "live.csv"
    options = ["--grid", "14", "--render", str(picture), "--out", str(table)]
    assert main(["segment", "--live", str(file), *options]) == 0
    printed = capsys.readouterr().out
    assert "frame 9: motions 0, 1" in printed
    rows = np.loadtxt(table, delimiter=",", skiprows=1)
    assert set(rows[:, 1]) == set(range(N_FRAMES))
    last = rows[rows[:, 1] == N_FRAMES - 1]
    x, y = last[:, 2] - 20 - 3 * (N_FRAMES - 1), last[:, 3] - 50 - (N_FRAMES - 1)
    inside = (x > 5) & (x < 85) & (y > 5) & (y < 75)
    outside = (x < -5) | (x > 95) | (y < -5) | (y > 85)
    assert (last[inside, 4] == 1).mean() > 0.8
    assert (last[outside, 4] == 0).mean() > 0.8
    capture = cv2.VideoCapture(str(picture))
    assert capture.get(cv2.CAP_PROP_FRAME_COUNT) == N_FRAMES
    assert round(capture.get(cv2.CAP_PROP_FPS)) == 20


@pytest.mark.slow
def test_no_codec_is_heard_of(file, tmp_path):
    """FFmpeg asks but once, when a video is first opened, whether it is to be quiet."""
    options = ["--no-window", "--max-frames", "2", "--render", str(tmp_path / "a.mp4")]
    command = [sys.executable, "-m", "skmotionseg", "segment", "--live", str(file)]
    quiet = {k: v for k, v in os.environ.items() if not k.startswith("OPENCV_")}
    ended = subprocess.run(
        command + options, env=quiet, capture_output=True, text=True, check=True
    )
    assert ended.stderr == ""


class Screen:
    """Stands for the windows of OpenCV, which are not there in tests."""

    def __init__(self, monkeypatch, key_at=None, closed_at=None):
        self.pictures, self.closed = [], []
        self.key_at, self.closed_at = key_at, closed_at
        monkeypatch.setenv("DISPLAY", ":7")
        for name in (
            "namedWindow",
            "imshow",
            "waitKey",
            "getWindowProperty",
            "destroyWindow",
        ):
            monkeypatch.setattr(cv2, name, getattr(self, name))

    def namedWindow(self, title, flags):
        self.title = title

    def imshow(self, title, picture):
        assert title == self.title
        self.pictures.append(picture)

    def waitKey(self, milliseconds):
        return ord("q") if len(self.pictures) == self.key_at else -1

    def getWindowProperty(self, title, what):
        assert what == cv2.WND_PROP_VISIBLE
        return 0.0 if len(self.pictures) == self.closed_at else 1.0

    def destroyWindow(self, title):
        self.closed.append(title)
        if len(self.pictures) == self.closed_at:
            raise cv2.error("there is no such window any more")


def test_what_is_found_is_drawn_in_a_window(file, frames, capsys, monkeypatch):
    screen = Screen(monkeypatch)
    assert main(["segment", "--live", str(file), "--grid", "30"]) == 0
    assert "q or Esc" in capsys.readouterr().out
    assert len(screen.pictures) == N_FRAMES
    assert screen.closed == [str(file)]
    for shown, frame in zip(screen.pictures, frames, strict=True):
        assert shown.shape == frame.shape
        changed = (np.abs(shown.astype(int) - frame).max(axis=2) > 60).mean()
        assert 0.001 < changed < 0.5  # points, and the frame behind them


@pytest.mark.parametrize("ended", [{"key_at": 5}, {"closed_at": 5}])
def test_a_window_that_is_ended_ends_the_stream(
    ended, file, tmp_path, capsys, monkeypatch
):
    screen = Screen(monkeypatch, **ended)
    picture, table = tmp_path / "live.mp4", tmp_path / "live.csv"
    options = ["--grid", "30", "--render", str(picture), "--out", str(table)]
    assert main(["segment", "--live", str(file), *options]) == 0
    assert "stopped" in capsys.readouterr().out
    assert len(screen.pictures) == 5
    assert screen.closed == [str(file)]
    capture = cv2.VideoCapture(str(picture))
    assert capture.get(cv2.CAP_PROP_FRAME_COUNT) == 5
    rows = np.loadtxt(table, delimiter=",", skiprows=1)
    assert set(rows[:, 1]) == set(range(5))


def without_display(monkeypatch):
    monkeypatch.setattr("sys.platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)


def without_windows(monkeypatch):
    monkeypatch.setenv("DISPLAY", ":7")

    def fails(*arguments):
        raise cv2.error("The function is not implemented")

    monkeypatch.setattr(cv2, "namedWindow", fails)


@pytest.mark.parametrize(
    ("lacking", "words"),
    [
        (without_display, "no window: there is no display"),
        (without_windows, "no window: this OpenCV shows no pictures"),
    ],
)
def test_without_a_window_the_film_is_written(
    lacking, words, file, tmp_path, capsys, monkeypatch
):
    lacking(monkeypatch)
    picture = tmp_path / "live.mp4"
    options = ["--grid", "30", "--max-frames", "6", "--render", str(picture)]
    assert main(["segment", "--live", str(file), *options]) == 0
    assert words in " ".join(capsys.readouterr().out.split())
    assert cv2.VideoCapture(str(picture)).get(cv2.CAP_PROP_FRAME_COUNT) == 6


def test_no_window_if_none_is_wanted(file, capsys, monkeypatch):
    screen = Screen(monkeypatch)
    options = ["--grid", "30", "--max-frames", "4", "--no-window"]
    assert main(["segment", "--live", str(file), *options]) == 0
    assert "window" not in capsys.readouterr().out
    assert screen.pictures == []


def test_what_is_stopped_is_written(file, tmp_path, capsys, monkeypatch):
    class Stopped:
        n_frames_, n_motions_, events_ = 0, 0, ()

        def __init__(self, *arguments, **options):
            pass

        def update(self, points, ids):
            self.n_frames_ += 1
            if self.n_frames_ == 5:
                raise KeyboardInterrupt
            return np.zeros(len(ids), dtype=int)

        def result(self):
            from sklearn.utils import Bunch

            return Bunch(labels=np.zeros(3), n_motions=1)

    monkeypatch.setattr("skmotionseg.online.OnlineMotionSegmenter", Stopped)
    table = tmp_path / "live.csv"
    assert main(["segment", "--live", str(file), "--out", str(table)]) == 0
    assert "stopped" in capsys.readouterr().out
    rows = np.loadtxt(table, delimiter=",", skiprows=1)
    assert set(rows[:, 1]) == {0, 1, 2, 3}


def test_what_was_found_stays_whatever_ends_it(frames, tmp_path, capsys):
    """A frame of another size in the middle; and a signal, as machines send one."""
    folder, table = tmp_path / "frames", tmp_path / "live.csv"
    folder.mkdir()
    for number, frame in enumerate([*frames[:12], frames[0][:-4]]):
        cv2.imwrite(str(folder / f"{number}.png"), frame)
    options = ["--grid", "14", "--no-window", "--out", str(table)]
    assert main(["segment", "--live", str(folder), *options]) == 2
    assert "frame 12 is 240 x 176" in capsys.readouterr().err
    rows = np.loadtxt(table, delimiter=",", skiprows=1)
    assert set(rows[:, 1]) == set(range(12))
    assert [path.name for path in tmp_path.iterdir() if path.is_file()] == ["live.csv"]


def test_a_signal_ends_it_as_ctrl_c_does():
    before = signal.getsignal(signal.SIGTERM)
    with pytest.raises(KeyboardInterrupt), live._ended_as_by_ctrl_c():
        os.kill(os.getpid(), signal.SIGTERM)
    assert signal.getsignal(signal.SIGTERM) == before


def signalling(monkeypatch, target, number, at):
    """Have a signal sent in the midst of some call of a function."""
    module, _, name = target.rpartition(".")
    owner = pkgutil.resolve_name(module)
    original, calls = getattr(owner, name), []

    def call(*arguments, **options):
        calls.append(name)
        if len(calls) == at:
            signal.raise_signal(number)
        return original(*arguments, **options)

    monkeypatch.setattr(owner, name, call)


def n_frames_of(picture, table):
    """Frames of the video and of the table."""
    rows = np.loadtxt(table, delimiter=",", skiprows=1)
    capture = cv2.VideoCapture(str(picture))
    return capture.get(cv2.CAP_PROP_FRAME_COUNT), len(set(rows[:, 1]))


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize(
    ("target", "n_frames"),
    [
        ("skmotionseg.video._rendering._Pen.draw", 6),
        ("skmotionseg.video._rendering._padded_to_even", 6),  # before it is encoded
        ("skmotionseg.online.OnlineMotionSegmenter.update", 6),
        ("skmotionseg._commands.live.write_frame", 6),
        ("skmotionseg.video._tracking.PointTracker.step", 5),  # with a next frame
    ],
)
def test_whenever_a_signal_comes_the_files_are_completed(
    number, target, n_frames, file, tmp_path, capsys, monkeypatch
):
    signalling(monkeypatch, target, number, at=6)
    before = signal.getsignal(number)
    picture, table = tmp_path / "live.mp4", tmp_path / "live.csv"
    options = ["--grid", "30", "--render", str(picture), "--out", str(table)]
    assert main(["segment", "--live", str(file), *options]) == 0
    assert "stopped" in capsys.readouterr().out
    assert n_frames_of(picture, table) == (n_frames, n_frames)
    assert signal.getsignal(number) == before


def test_a_signal_while_the_video_is_completed_changes_nothing(
    file, tmp_path, monkeypatch
):
    signalling(monkeypatch, "skmotionseg._utils.writing._store", signal.SIGINT, at=1)
    picture, table = tmp_path / "live.mp4", tmp_path / "live.csv"
    options = ["--grid", "30", "--render", str(picture), "--out", str(table)]
    assert main(["segment", "--live", str(file), *options]) == 0
    assert n_frames_of(picture, table) == (N_FRAMES, N_FRAMES)


def test_a_second_signal_does_not_wait():
    interrupts = live._Interrupts()
    for _ in interrupts.let_through(range(3)):
        interrupts.handle(signal.SIGINT, None)
        with pytest.raises(KeyboardInterrupt):
            interrupts.handle(signal.SIGINT, None)
        break


def test_a_signal_that_is_ignored_stays_ignored():
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with live._ended_as_by_ctrl_c():
            signal.raise_signal(signal.SIGINT)
    finally:
        signal.signal(signal.SIGINT, before)


def test_it_runs_where_signals_cannot_be_handled(file):
    arguments = ["segment", "--live", str(file), "--max-frames", "2", "--no-window"]
    with ThreadPoolExecutor() as threads:
        assert threads.submit(main, arguments).result() == 0


def test_the_video_until_a_failure_of_the_source_is_completed(frames, tmp_path, capsys):
    folder = tmp_path / "frames"
    folder.mkdir()
    for number, frame in enumerate([*frames[:10], frames[0][:-4]]):
        cv2.imwrite(str(folder / f"{number}.png"), frame)
    picture, table = tmp_path / "live.mp4", tmp_path / "live.csv"
    options = ["--grid", "30", "--render", str(picture), "--out", str(table)]
    assert main(["segment", "--live", str(folder), *options]) == 2
    assert "frame 10 is 240 x 176" in capsys.readouterr().err
    assert n_frames_of(picture, table) == (10, 10)


def camera_of(monkeypatch, make_iterator):
    """Have camera 0 deliver these frames."""
    frames = Frames("camera 0", make_iterator)
    monkeypatch.setattr("skmotionseg.video._frames._open_camera", lambda _: frames)


def interrupted_before_the_first_frame():
    signal.raise_signal(signal.SIGINT)
    yield np.zeros((HEIGHT, WIDTH, 3), np.uint8)


@pytest.mark.parametrize("options", [[], ["--grid", "30"]])
@pytest.mark.parametrize("written", [(), ("--render", "live.mp4", "--out", "live.csv")])
@pytest.mark.parametrize(
    ("make_iterator", "code", "words"),
    [
        (lambda: iter(()), 2, "camera 0 has no frames"),
        (interrupted_before_the_first_frame, 130, "interrupted"),
    ],
)
def test_without_a_frame_nothing_is_written(
    make_iterator, code, words, written, options, tmp_path, capsys, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    camera_of(monkeypatch, make_iterator)
    assert main(["segment", "--live", "0", *options, *written]) == code
    assert capsys.readouterr().err == f"skmotionseg: {words}\n"
    assert list(tmp_path.iterdir()) == []


def test_in_the_midst_of_the_first_frame_there_is_none(
    file, tmp_path, capsys, monkeypatch
):
    def interrupted(*arguments):
        raise KeyboardInterrupt

    target = "skmotionseg.online.OnlineMotionSegmenter.update"
    monkeypatch.setattr(target, interrupted)
    monkeypatch.chdir(tmp_path)
    options = ["--render", "live.mp4", "--out", "live.csv"]
    assert main(["segment", "--live", str(file), *options]) == 130
    assert capsys.readouterr().err == "skmotionseg: interrupted\n"
    assert list(tmp_path.iterdir()) == []


def test_a_video_of_no_frame_is_not_written(tmp_path):
    write_points(iter(()), tmp_path / "live.mp4", fps=25)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--out", "labels.npz"], "end in .csv; got labels.npz"),
        (["--render", "sheet.png"], "end in .mp4; got sheet.png"),
        (["--masks", "masks"], "--masks needs the whole video"),
        (["--report", "report.png"], "--report needs the whole video"),
        (["--models", "affine"], "--models is for clips"),
        (["--selection", "ncre"], "--selection is for clips"),
        (["--jobs", "1"], "--jobs is for clips"),
        (["--confidence", "--out", "labels.csv"], "--confidence needs the whole video"),
        (["--resume", "folder"], "--resume needs the whole video"),
        (["--layout", "tracks_first"], "--layout is for track files"),
        (["--image-size", "9", "9"], "--image-size is for track files"),
    ],
)
def test_what_a_stream_does_not_have_is_refused(options, words, file, capsys):
    assert main(["segment", "--live", str(file), *options]) == 2
    assert words in capsys.readouterr().err


def test_numbers_are_cameras_unless_there_is_a_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert live._source("7") == 7
    (tmp_path / "7").mkdir()
    assert live._source("7") == "7"


def test_camera_that_is_not_there(capfd):
    assert main(["segment", "--live", "99"]) == 2
    assert "there is no camera 99" in capfd.readouterr().err
