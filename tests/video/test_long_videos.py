"""Long videos on the command line: in little memory, and again after a crash."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from itertools import islice

import numpy as np
import pytest
from helpers.pictures import film_of_a_thing, write_video
from numpy.testing import assert_array_equal

from skmotionseg import MotionSegmenter, unpack_tracks
from skmotionseg._commands import long_objects, stored_tracks, video_tracks
from skmotionseg._commands.long_objects import (
    MOST_NUMBERS,
    block_ends,
    find_objects_in_blocks,
)
from skmotionseg._commands.stored_tracks import StoredClip, StoredTracks, track_into
from skmotionseg.cli import main
from skmotionseg.preprocessing import select_long_tracks
from skmotionseg.video import find_objects, track_video
from skmotionseg.video._tracking import MAX_ERROR, MIN_TEXTURE

cv2 = pytest.importorskip("cv2", reason="needs opencv-python-headless")
pytestmark = pytest.mark.xdist_group("long video")  # tracked once for all

WIDTH, HEIGHT, N_FRAMES, GRID = 128, 96, 106, 12
OPTIONS = {
    "grid_spacing": GRID,
    "max_error": MAX_ERROR,
    "min_texture": MIN_TEXTURE,
}
QUICK = ("--motions", "2", "--models", "affine", "--selection", "ncre", "--jobs", "1")
COMMAND = "import sys; from skmotionseg.cli import main; sys.exit(main())"


@pytest.fixture(scope="module")
def frames():
    """A wall that sways, and a thing before it that sways otherwise."""
    places = (
        (
            np.int64(30 + 28 * np.sin([f / 23, f / 17])),
            np.int64([23, 39] + 20 * np.cos([f / 13, f / 16])),
        )
        for f in range(N_FRAMES)
    )
    return film_of_a_thing((HEIGHT, WIDTH), (50, 50), places)


@pytest.fixture(scope="module")
def file(frames, tmp_path_factory):
    path = tmp_path_factory.mktemp("video") / "long.avi"
    return write_video(path, frames, "MJPG", 20.0)


def segment(file, *options):
    options = ("--grid", GRID, *QUICK, *options)
    return [str(option) for option in ("segment", file, *options)]


@pytest.fixture(scope="module")
def table(file, tmp_path_factory):
    """What the command writes if nothing comes between."""
    out = tmp_path_factory.mktemp("table") / "labels.csv"
    assert main(segment(file, "--out", out)) == 0
    return out.read_bytes()


# -------------------------------------------------------------------------- the tracks


def stored_in(folder, frames, options=None):
    stored = StoredTracks(folder, {"file": "arrays"})
    options = options or {**OPTIONS, "max_side": None}
    track_into(stored, frames, options, None, lambda done: None)
    return stored


@pytest.mark.parametrize("max_side", [None, 90])
def test_tracking_goes_on_as_if_nothing_had_been(frames, tmp_path, max_side):
    frames, options = frames[:50], {**OPTIONS, "max_side": max_side}

    def torn(n_frames):
        yield from islice(frames, n_frames)
        raise KeyboardInterrupt

    for n_frames, n_kept in ((7, 0), (45, 40), (41, 40)):
        with pytest.raises(KeyboardInterrupt):
            stored_in(tmp_path / "run", torn(n_frames), options)
        stored = StoredTracks(tmp_path / "run", {"file": "arrays"})
        assert (stored.n_frames, stored.is_whole) == (n_kept, False)
    stored = stored_in(tmp_path / "run", frames, options)
    assert (stored.n_frames, stored.is_whole) == (50, True)
    assert stored.size == (WIDTH, HEIGHT)
    whole = track_video(frames, grid_spacing=GRID, max_side=max_side)
    assert_array_equal(StoredClip(stored, 5).matrix(), whole.tracks)
    stored_in(tmp_path / "run", iter([]), options)  # which reads no frame


def test_windows_of_stored_tracks_are_those_of_the_matrix(frames, tmp_path):
    from skmotionseg._segmenter.long_clips import LongClip

    stored = stored_in(tmp_path / "run", frames[:64])
    clip = StoredClip(stored, 10)
    whole = LongClip(clip.matrix().astype(float), 2)
    assert_array_equal(clip.extent, whole.extent)
    assert clip.cuts == whole.cuts
    assert clip.n_tracks == whole.n_tracks
    for part, other in zip(clip.parts, whole.parts, strict=True):
        assert part[:2] == other[:2]
        assert_array_equal(part.tracks, other.tracks)
        for mine, its in zip(clip.window(part), whole.window(other), strict=True):
            assert_array_equal(mine, its)


def test_cuts_of_stored_tracks_are_those_of_the_matrix(frames, tmp_path):
    from skmotionseg._segmenter.long_clips import LongClip

    turned = [np.rot90(frame, 2).copy() for frame in frames[:20]]
    stored = stored_in(tmp_path / "run", [*frames[:24], *turned])
    clip = StoredClip(stored, 10)
    assert clip.cuts == [24]
    assert LongClip(clip.matrix().astype(float), 2).cuts == [24]


def test_half_of_a_file_is_none(frames, tmp_path, monkeypatch):
    def half(file, **arrays):
        file.write(b"half")
        raise OSError("no space left")

    with monkeypatch.context() as patched:
        patched.setattr(stored_tracks.np, "savez", half)
        with pytest.raises(OSError, match="no space left"):
            stored_in(tmp_path / "run", frames[:25])
    assert [path.name for path in (tmp_path / "run").iterdir()] == ["run.json"]


def test_folder_of_something_else_is_refused(tmp_path):
    (tmp_path / "photo.png").write_bytes(b"")
    with pytest.raises(ValueError, match="holds no run that could be resumed"):
        StoredTracks(tmp_path, {})
    StoredTracks(tmp_path / "run", {"grid": 8})
    with pytest.raises(ValueError, match="its grid is 8, and this one's 5"):
        StoredTracks(tmp_path / "run", {"grid": 5})


DAMAGED = {
    "settings that are none": ("run.json", b'{"settings": 3}'),
    "a list": ("run.json", b"[]"),
    "half of the notes": ("run.json", b"{"),
    "half of the tracks": ("tracks-000000000.npz", b"PK" + bytes(90)),
    "no tracks": ("tracks-000000000.npz", b""),
}


@pytest.mark.parametrize("case", DAMAGED)
def test_a_damaged_file_is_named(frames, tmp_path, case):
    name, content = DAMAGED[case]
    stored_in(tmp_path, frames[:6])
    (tmp_path / name).write_bytes(content)
    words = f"{name} is damaged: remove .* to begin anew"
    with pytest.raises(ValueError, match=words):
        StoredTracks(tmp_path, {"file": "arrays"})


# ------------------------------------------------------------------------- the objects


@pytest.mark.parametrize("n_frames", [2, 300, 301, 500, 501, 12345])
def test_blocks_overlap_and_leave_no_frame_out(n_frames):
    starts, stops = np.transpose(block_ends(n_frames))
    assert (starts[0], stops[-1]) == (0, n_frames)
    assert (stops[:-1] - starts[1:] == long_objects.COMMON_FRAMES).all()
    assert (stops[:-1] - starts[:-1] == long_objects.BLOCK_FRAMES).all()
    assert stops[-1] - starts[-1] <= long_objects.BLOCK_FRAMES
    assert len(starts) == 1 or stops[-1] > stops[-2]


def test_a_thing_has_one_number_in_all_blocks(frames, tmp_path, monkeypatch):
    clip = StoredClip(stored_in(tmp_path / "run", frames), 8)
    labels = np.zeros(clip.n_tracks, dtype=int)
    tracks = clip.matrix()
    whole = find_objects(tracks, labels, width=WIDTH, height=HEIGHT)
    assert_array_equal(find_objects_in_blocks(clip, labels), whole)
    assert whole.max() == 1  # found by geometry, as the labels do not tell
    monkeypatch.setattr(long_objects, "BLOCK_FRAMES", 45)
    monkeypatch.setattr(long_objects, "COMMON_FRAMES", 15)
    done = []
    parted = find_objects_in_blocks(clip, labels, lambda *each: done.append(each))
    assert done == [(k, 4) for k in (1, 2, 3, 4)]
    assert (parted == whole).mean() > 0.95
    assert set(np.unique(parted)) <= {-1, 0, 1}


def test_numbers_of_things_go_on_and_are_given_again_late():
    last_seen = np.full(MOST_NUMBERS + 1, -1)
    found = np.repeat([0, 1, 2, 3], 9)
    before = np.where(found == 3, 7, -1)
    before[found == 0] = 0
    last_seen[7] = 0
    assert_array_equal(long_objects._numbers(found, before, last_seen), [0, 1, 2, 7])
    before[found == 3] = [7] * 4 + [0] * 5  # most of both have gone apart
    before[found == 0] = [7] * 5 + [0] * 4
    assert_array_equal(long_objects._numbers(found, before, last_seen), [0, 1, 2, 3])
    last_seen[1:] = 5
    last_seen[[30, 40, 50]] = 3, 2, 4
    assert_array_equal(long_objects._numbers(found, before, last_seen), [0, 40, 30, 50])


# ------------------------------------------------------------------------- the command


@pytest.mark.slow
def test_labels_are_those_of_the_estimator(file, table, capsys):
    tracks = track_video(file, grid_spacing=GRID).tracks
    tracks = tracks[select_long_tracks(tracks, 10)]
    segmenter = MotionSegmenter(2, models="affine", selection="ncre", random_state=0)
    labels = segmenter.fit_predict(tracks)
    rows = np.loadtxt(table.decode().splitlines(), delimiter=",", skiprows=1)
    assert set(rows[:, 1]) == set(range(N_FRAMES))
    track, frame = rows[:, :2].astype(int).T
    points, visibility = unpack_tracks(tracks)
    assert visibility[track, frame].all() and len(rows) == visibility.sum()
    assert np.abs(points[track, frame] - rows[:, 2:4]).max() < 1e-3
    assert_array_equal(rows[:, 4], labels[track])
    assert len(np.unique(labels[labels >= 0])) == 2


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="needs signals")
def test_a_killed_run_goes_on(file, table, tmp_path, monkeypatch, capsys):
    run, out = tmp_path / "run", tmp_path / "labels.csv"
    arguments = segment(file, "--resume", run, "--out", out)
    process = subprocess.Popen(
        [sys.executable, "-c", COMMAND, *arguments],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        start_new_session=True,
    )
    for _ in range(30000):
        if len(list(run.rglob("output.pkl"))) >= 2:
            break
        assert process.poll() is None, process.stderr.read()
        time.sleep(0.01)
    os.killpg(process.pid, signal.SIGKILL)
    process.communicate()
    finished = {path: path.stat().st_mtime_ns for path in run.rglob("output.pkl")}
    assert 2 <= len(finished) < 5
    assert not out.exists()
    monkeypatch.setattr("skmotionseg.video._tracking.PointTracker.step", None)
    assert main(arguments) == 0
    assert out.read_bytes() == table
    assert len(list(run.rglob("output.pkl"))) == 5
    assert {path: path.stat().st_mtime_ns for path in finished} == finished
    printed = capsys.readouterr()
    assert "motions found" in printed.out
    assert "windows: 5 of 5 done" in printed.err
    shutil.rmtree(run / "windows")  # the tracks are enough
    assert main(segment(file, "--resume", run, "--max-frames", 104)) == 2
    assert "its max-frames is None, and this one's 104" in capsys.readouterr().err


@pytest.mark.slow
def test_masks_of_a_long_video_are_those_of_the_whole(
    file, tmp_path, monkeypatch, capsys
):
    written = {}
    for name, longest in (("whole", 500), ("blocks", 50)):
        monkeypatch.setattr(video_tracks, "LONGEST_WHOLE", longest)
        masks, static = tmp_path / name, tmp_path / f"{name} static"
        options = ("--masks", masks, "--static-masks", static, "--max-frames", 60)
        with monkeypatch.context() as patched:
            if name == "blocks":
                patched.setattr(StoredClip, "matrix", None)  # nothing of its size
            assert main(segment(file, *options)) == 0
        printed = capsys.readouterr().out.splitlines()
        contents = [line.split(": ")[0] for line in printed[-2:]]
        assert contents == ["masks", "static masks"]
        written[name] = [
            [path.read_bytes() for path in sorted(folder.iterdir())]
            for folder in (masks, static)
        ]
        assert [len(files) for files in written[name]] == [60, 60]
    assert written["whole"] == written["blocks"]


def test_labels_are_there_before_masks(file, table, tmp_path, monkeypatch):
    monkeypatch.setattr(video_tracks, "LONGEST_WHOLE", 50)

    def stopped(*arguments, **options):
        raise KeyboardInterrupt

    monkeypatch.setattr("skmotionseg._commands.long_videos._write_masks", stopped)
    out = tmp_path / "labels.csv"
    assert main(segment(file, "--out", out, "--masks", tmp_path / "masks")) == 130
    assert out.read_bytes() == table


@pytest.mark.slow
def test_objects_that_became_one_leave_no_gap(file, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(video_tracks, "LONGEST_WHOLE", 50)

    def known_again(frames, tracked, things, *options):
        return np.where(things > 0, things + 6, things)  # as if others were these

    monkeypatch.setattr("skmotionseg.video._recognition.known_again", known_again)
    options = ("--masks", tmp_path / "masks", "--max-frames", 60)
    assert main(segment(file, *options)) == 0
    row = [line for line in capsys.readouterr().out.splitlines() if "objects" in line]
    assert row[0].strip("│ ").split() == ["moving", "objects", "│", "1"]
    masks = [
        cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        for path in (tmp_path / "masks").iterdir()
    ]
    assert len(np.unique(masks)) == 2


def test_another_video_in_the_same_place_is_refused(frames, tmp_path, capsys):
    film = tmp_path / "film"
    film.mkdir()
    for shown, code in ((frames[:12], 0), (frames[40:52], 2)):
        for number, frame in enumerate(shown):
            cv2.imwrite(str(film / f"{number}.png"), frame)
        assert main(segment(film, "--resume", tmp_path / "run")) == code
    assert "its content is" in capsys.readouterr().err
    again = segment(film, "--resume", tmp_path / "run", "--stride", 2)
    assert main(again) == 2  # which are other frames, too
    assert "its stride is 1, and this one's 2" in capsys.readouterr().err


def test_a_byte_makes_another_video(tmp_path):
    path, content = tmp_path / "film.avi", bytearray(10**6)
    digests = set()
    for _ in range(3):
        path.write_bytes(content)
        digests.add(video_tracks._content([path]))
        content[len(digests) * 234567] = 1
    assert len(digests) == 3
    assert video_tracks._content([path]) == video_tracks._content([path])


def test_track_files_are_not_resumed(tmp_path, capsys):
    path = tmp_path / "tracks.npz"
    np.savez(path, X=np.zeros((9, 8)))
    assert main(["segment", str(path), "--resume", str(tmp_path / "run")]) == 2
    assert "--resume is for videos" in capsys.readouterr().err
