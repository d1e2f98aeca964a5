"""Frame by frame from a camera, or from a file played as if it were one."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.pictures import film_of_a_thing, write_video
from numpy.testing import assert_array_equal

from skmotionseg import unpack_tracks
from skmotionseg._commands import live
from skmotionseg.cli import main
from skmotionseg.video import follow_points, track_video

cv2 = pytest.importorskip("cv2", reason="needs opencv-python-headless")

WIDTH, HEIGHT, N_FRAMES = 240, 180, 16


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
    points, seen = unpack_tracks(track_video(frames, min_length=1).tracks)
    for number, each in enumerate(follow_points(frames)):
        assert_array_equal(np.flatnonzero(seen[:, number]), np.sort(each.ids))
        assert_array_equal(each.points.astype(np.float32), points[each.ids, number])
        assert each.frame.shape == (HEIGHT, WIDTH, 3)
    assert number == N_FRAMES - 1


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


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--out", "labels.npz"], "end in .csv; got labels.npz"),
        (["--render", "sheet.png"], "end in .mp4; got sheet.png"),
        (["--masks", "masks"], "--masks needs the whole video"),
        (["--report", "report.png"], "--report needs the whole video"),
    ],
)
def test_what_needs_the_whole_video_is_refused(options, words, file, capsys):
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
