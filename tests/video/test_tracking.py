"""Videos made on the fly, whose points are known to be where."""

from __future__ import annotations

import re
import sys
import weakref

import numpy as np
import pytest
from helpers.pictures import write_video
from helpers.progress_lines import without_progress
from scipy.ndimage import gaussian_filter, map_coordinates

from skmotionseg import MotionSegmenter, unpack_tracks
from skmotionseg._utils.colours import COLOURS
from skmotionseg.cli import main
from skmotionseg.datasets import load_tracks
from skmotionseg.preprocessing import (
    select_balanced_tracks,
    select_inliers,
    select_long_tracks,
)
from skmotionseg.video import follow_points, render_segmentation, track_video
from skmotionseg.video._frames import open_frames
from skmotionseg.video._grid import (
    CLEARANCE,
    TrackLog,
    field_gradient,
    is_inside,
    sample_field,
    seed_points,
    stands_out,
)

cv2 = pytest.importorskip("cv2", reason="needs opencv-python-headless")

WIDTH, HEIGHT, N_FRAMES = 160, 120, 12
PAN = np.array([1.3, -0.7])  # pixels a frame, of the background
SQUARE_START, SQUARE_SIDE = np.array([30.0, 40.0]), 50
SQUARE_STEP = np.array([4.0, 0.0])


def texture(seed, size=400):
    noise = gaussian_filter(np.random.default_rng(seed).normal(size=(size, size)), 1.5)
    return 128 + 60 * noise / noise.std()


def looked_at(scene, shift):
    """A scene that has moved by so many pixels, seen through the frame."""
    y, x = np.mgrid[:HEIGHT, :WIDTH] + 100.0
    values = map_coordinates(scene, [y - shift[1], x - shift[0]], order=3)
    return np.clip(np.rint(values), 0, 255).astype(np.uint8)


@pytest.fixture(scope="module")
def panned():
    scene = texture(0)
    return [looked_at(scene, f * PAN) for f in range(N_FRAMES)]


@pytest.fixture(scope="module")
def crossed(panned):
    """The same with a square of another texture that crosses it."""
    square, frames = texture(1)[:SQUARE_SIDE, :SQUARE_SIDE].clip(0, 255), []
    for f, background in enumerate(panned):
        frame = background.copy()
        x, y = (SQUARE_START + f * SQUARE_STEP).astype(int)
        frame[y : y + SQUARE_SIDE, x : x + SQUARE_SIDE] = square
        frames.append(frame)
    return frames


@pytest.fixture(scope="module")
def turned(panned):
    """The same with a square that turns as it crosses, which no shift explains."""
    square, frames, middle = texture(1), [], (SQUARE_SIDE - 1) / 2
    for f, background in enumerate(panned):
        y, x = np.mgrid[:HEIGHT, :WIDTH]
        x, y = (
            np.array([x, y]) - (SQUARE_START + f * SQUARE_STEP + middle)[:, None, None]
        )
        angle = 0.06 * f
        u = np.cos(angle) * x + np.sin(angle) * y
        v = np.cos(angle) * y - np.sin(angle) * x
        inside = np.maximum(abs(u), abs(v)) <= middle
        seen = map_coordinates(square, [v + middle, u + middle], order=3).clip(0, 255)
        frames.append(np.where(inside, seen, background).astype(np.uint8))
    return frames


def read_video(path):
    capture, frames = cv2.VideoCapture(str(path)), []
    while True:
        good, frame = capture.read()
        if not good:
            return np.array(frames), capture.get(cv2.CAP_PROP_FPS)
        frames.append(frame)


def steps(tracks):
    """Displacements of all tracks between consecutive frames that see them: (n, 2)."""
    points, _ = unpack_tracks(tracks)
    moved = np.diff(points, axis=1).reshape(-1, 2)
    return moved[np.isfinite(moved).all(axis=1)]


def on_square(points, frame, margin=0.0):
    place = points - (SQUARE_START + frame * SQUARE_STEP)
    return ((place >= -margin) & (place <= SQUARE_SIDE - 1 + margin)).all(axis=-1)


# --------------------------------------------------------------------------- tracking


def test_tracks_are_exact_to_a_fraction_of_a_pixel(panned):
    result = track_video(panned)
    assert (result.n_frames, result.width, result.height) == (N_FRAMES, WIDTH, HEIGHT)
    points, seen = unpack_tracks(result.tracks)
    birth = seen.argmax(axis=1)
    start = points[np.arange(len(points)), birth]
    expected = start[:, None] + (np.arange(N_FRAMES) - birth[:, None])[..., None] * PAN
    drift = np.hypot(*(points - expected)[seen].T)
    assert np.median(drift) < 0.05
    assert np.quantile(drift, 0.99) < 0.5  # drift adds up over twelve frames


def test_shrunk_frames_give_tracks_in_pixels_of_the_video(panned):
    result = track_video(panned, max_side=100)
    assert (result.width, result.height) == (WIDTH, HEIGHT)
    np.testing.assert_allclose(np.median(steps(result.tracks), axis=0), PAN, atol=0.05)
    whole, _ = unpack_tracks(track_video(panned).tracks)
    shrunk, _ = unpack_tracks(result.tracks)
    assert np.nanmax(shrunk[..., 0]) > 0.95 * np.nanmax(whole[..., 0])


def test_tracks_have_one_unbroken_life(crossed):
    _, seen = unpack_tracks(track_video(crossed).tracks)
    changes = np.abs(np.diff(seen.astype(int), axis=1)).sum(axis=1)
    lives = seen[:, 0].astype(int) + seen[:, -1] + changes
    assert set(lives) == {2}


def test_tracks_end_where_they_are_covered(crossed):
    """Those of the background before the square; those behind it start anew."""
    first, *_, last = follow_points(crossed)
    truth = first.points + PAN * (N_FRAMES - 1)
    ahead = ~on_square(first.points, 0, margin=10)
    covered = ahead & on_square(truth, N_FRAMES - 1, margin=-8)
    assert covered.sum() >= 8
    assert np.isin(first.ids[covered], last.ids).mean() < 0.3


def passed(panned, step):
    """A square that hardly moves faster than what it passes."""
    square, frames = texture(1)[:60, :60].clip(0, 255), []
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    for f, background in enumerate(panned):
        left, top = SQUARE_START + f * step
        own = map_coordinates(square, [y - top, x - left], order=3, cval=np.nan)
        frames.append(np.uint8(np.where(np.isnan(own), background, own).clip(0, 255)))
    return frames


@pytest.mark.parametrize("over", [[1.5, 0.5], [2.5, 0.5]])
def test_outlines_take_few_tracks_along(panned, over):
    ways = PAN, PAN + np.array(over)
    points, _ = unpack_tracks(track_video(passed(panned, ways[1])).tracks)
    steps = np.nanmedian(np.diff(points, axis=1), axis=1)
    apart = np.min([np.hypot(*(steps - each).T) for each in ways], axis=0)
    assert len(points) > 600
    assert (apart > 0.15).mean() < 0.05


@pytest.mark.slow
def test_outlines_are_no_motion(panned):
    """What goes along between a thing and the scene would be one more."""
    tracks = track_video(passed(panned, PAN + np.array([2.5, 0.5]))).tracks
    for seed in range(3):
        segmenter = MotionSegmenter(random_state=seed).fit(tracks)
        assert segmenter.n_motions_ == 2
        assert segmenter.count_probabilities_[1] > 0.6


def test_all_tracks_end_at_a_cut(panned):
    other = [looked_at(texture(5), -f * PAN) for f in range(N_FRAMES)]
    _, seen = unpack_tracks(track_video(panned + other).tracks)
    before, after = seen[:, :N_FRAMES].any(axis=1), seen[:, N_FRAMES:].any(axis=1)
    assert not (before & after).any()
    assert min(before.sum(), after.sum()) > 300


def test_what_passes_close_before_the_camera_is_no_cut(panned):
    """A dark coat that no point can be followed on; what it does not hide goes on."""
    hidden, frames = [0.0, 0.0, 0.6, *[0.9] * (N_FRAMES - 3)], []
    for f, share in enumerate(hidden):
        frame, width = panned[0].copy(), int(share * WIDTH)
        coat = 40 + (texture(20 + f)[:HEIGHT, :width] - 128) / 12
        frame[:, :width] = coat
        frames.append(frame)
    points, seen = unpack_tracks(track_video(frames).tracks)
    beside = points[:, 0, 0] > 0.92 * WIDTH
    assert beside.sum() > 20
    assert seen[beside].all(axis=1).mean() > 0.8


def test_empty_places_get_new_tracks(crossed):
    points, seen = unpack_tracks(track_video(crossed).tracks)
    origin = points[:, -1] - (N_FRAMES - 1) * PAN
    uncovered = on_square(origin, 0, margin=-4)
    uncovered &= ~on_square(points[:, -1], N_FRAMES - 1, margin=8)
    assert uncovered.sum() >= 5
    assert seen[uncovered, 0].mean() < 0.3  # one may slip off the square's edge
    entered = points[:, -1, 0] < PAN[0] * (N_FRAMES - 1) - 4  # the pan brings them in
    assert entered.any()
    assert not seen[entered, 0].any()


def test_the_square_moves_by_itself(crossed):
    points, seen = unpack_tracks(track_video(crossed).tracks)
    whole = seen.all(axis=1) & on_square(points[:, 0], 0, margin=-6)
    assert whole.sum() > 10
    moved = (points[whole, -1] - points[whole, 0]) / (N_FRAMES - 1)
    np.testing.assert_allclose(np.median(moved, axis=0), SQUARE_STEP, atol=0.02)


def test_tracks_stay_in_the_picture(panned):
    points, seen = unpack_tracks(track_video(panned, min_length=1).tracks)
    x, y = points[seen].T
    assert x.min() >= 0 and y.min() >= 0
    assert x.max() <= WIDTH - 1 and y.max() <= HEIGHT - 1


def test_the_grid_is_filled_and_not_overfilled(panned):
    for spacing in (8, 16):
        _, seen = unpack_tracks(track_video(panned, grid_spacing=spacing).tracks)
        cells = (WIDTH / spacing) * (HEIGHT / spacing)
        assert 0.6 * cells < seen[:, N_FRAMES // 2].sum() < 1.2 * cells


def test_plain_places_get_no_tracks(panned):
    frames = [frame.copy() for frame in panned]
    for frame in frames:
        frame[:, : WIDTH // 2] = 90
    points, _ = unpack_tracks(track_video(frames).tracks)
    assert len(points) > 20
    assert np.nanmin(points[..., 0]) > WIDTH // 2 - 8
    assert track_video([np.full((64, 64), 90, np.uint8)] * 6).tracks.shape == (0, 12)


@pytest.mark.parametrize("min_length", [1, 5, N_FRAMES])
def test_short_tracks_are_dropped(crossed, min_length):
    _, seen = unpack_tracks(track_video(crossed, min_length=min_length).tracks)
    assert seen.sum(axis=1).min() >= min_length


@pytest.mark.parametrize("n_frames", [2, 3, 4])
def test_the_shortest_videos_have_tracks(crossed, n_frames):
    """Of fewer frames than tracks must have by default, those seen in all."""
    tracks = track_video(crossed[:n_frames]).tracks
    assert len(tracks) > 200
    assert np.isfinite(tracks).all()


@pytest.mark.parametrize("shape", [(16, 80), (31, 120), (24, 640), (120, 16)])
def test_low_and_narrow_frames_are_tracked(shape):
    scene = texture(0, 700).clip(0, 255).astype(np.uint8)
    height, width = shape
    frames = [scene[f : height + f, 2 * f : width + 2 * f] for f in range(6)]
    tracks = track_video(frames).tracks
    whole = tracks[np.isfinite(tracks).all(axis=1)]
    assert len(whole) > 10
    moved = np.median(whole[:, -2:] - whole[:, :2], axis=0)
    np.testing.assert_allclose(moved, [-10, -5], atol=0.1)


def test_a_grid_may_be_wider_than_the_frame(crossed):
    tracks = track_video(crossed, grid_spacing=500).tracks
    assert 0 < len(tracks) < 20


def test_a_stricter_check_leaves_fewer_tracks(crossed):
    noise = np.random.default_rng(0)
    frames = [
        np.clip(frame + noise.normal(0, 15, frame.shape), 0, 255).astype(np.uint8)
        for frame in crossed
    ]
    kept = [
        len(track_video(frames, max_error=error, min_length=N_FRAMES).tracks)
        for error in (0.1, 1.0)
    ]
    assert kept[0] < kept[1]


def test_progress_counts_the_frames(panned):
    calls = []
    track_video(panned, max_frames=5, progress=lambda *call: calls.append(call))
    assert calls == [(done, 5) for done in range(1, 6)]
    calls.clear()
    track_video(iter(panned), progress=lambda *call: calls.append(call))
    assert calls[-1] == (N_FRAMES, None)


def test_no_more_than_three_frames_are_held(panned):
    alive, most = weakref.WeakSet(), 0

    class Frame(np.ndarray):
        """An array that can be kept in a set."""

        __hash__ = object.__hash__
        __eq__ = object.__eq__

    def count_frames():
        nonlocal most
        for grey in panned * 3:
            frame = np.repeat(grey[..., None], 3, axis=2).view(Frame)
            alive.add(frame)
            most = max(most, len(alive))
            yield frame
            del frame

    assert track_video(count_frames()).n_frames == 3 * N_FRAMES
    assert 1 <= most <= 3


# ---------------------------------------------------------------------------- sources


@pytest.mark.parametrize(
    "ending, codec",
    [
        (".mp4", "mp4v"),
        (".m4v", "mp4v"),
        (".mov", "mp4v"),
        (".avi", "MJPG"),
        (".mkv", "MJPG"),
        (".webm", "VP80"),
    ],
)
def test_videos_of_each_kind(panned, tmp_path, ending, codec):
    path = write_video(tmp_path / f"clip{ending}", panned, codec)
    result = track_video(path)
    assert result.n_frames == N_FRAMES
    assert result.fps == pytest.approx(12.5)
    np.testing.assert_allclose(np.median(steps(result.tracks), axis=0), PAN, atol=0.1)


def test_a_video_that_counts_no_frames_is_not_called_damaged(panned, tmp_path):
    whole = write_video(tmp_path / "clip.mkv", panned, "MJPG")
    assert open_frames(whole).n_announced is None
    content = whole.read_bytes()
    whole.write_bytes(content[: len(content) * 2 // 3])
    with pytest.warns(UserWarning, match=rf"it lasts as long as {N_FRAMES}: its sound"):
        n_read = len(list(open_frames(whole)))
    assert 1 < n_read < N_FRAMES - 1


def write_folder(folder, frames, ending=".png"):
    folder.mkdir()
    for number, frame in enumerate(frames):
        assert cv2.imwrite(str(folder / f"frame{number}{ending}"), frame)
    return folder


def test_a_folder_is_read_in_the_order_of_its_numbers(panned, tmp_path):
    folder = write_folder(tmp_path / "frames", panned)  # frame10 after frame9
    (folder / "notes.txt").write_text("no frame")
    result = track_video(str(folder))
    assert result.fps is None
    np.testing.assert_array_equal(result.tracks, track_video(panned).tracks)


def test_folders_and_hidden_files_are_no_frames(panned, tmp_path):
    folder = write_folder(tmp_path / "frames", panned[:3])
    (folder / "frame1.5.png").mkdir()
    (folder / "._frame0.png").write_bytes(b"as macOS writes it")
    frames = open_frames(folder)
    assert frames.names == ["frame0.png", "frame1.png", "frame2.png"]
    np.testing.assert_array_equal(list(frames)[2][..., 0], panned[2])
    (tmp_path / "hidden").mkdir()
    (tmp_path / "hidden" / ".0.png").touch()
    with pytest.raises(ValueError, match=r"no frames .* are in the folder"):
        open_frames(tmp_path / "hidden")


def test_superscripts_are_no_numbers_of_frames(panned, tmp_path):
    folder = write_folder(tmp_path / "frames", panned[:2])
    (folder / "frame0.png").rename(folder / "10²1.png")
    (folder / "frame1.png").rename(folder / "9²1.png")
    assert open_frames(folder).names == ["9²1.png", "10²1.png"]


def test_links_to_no_file_are_not_passed_over(panned, tmp_path):
    folder = write_folder(tmp_path / "frames", panned[:3])
    (folder / "frame1.png").unlink()
    (folder / "frame1.png").symlink_to(tmp_path / "nowhere.png")
    with pytest.raises(FileNotFoundError, match=r"frame1.png"):
        track_video(folder)


def test_max_frames(panned):
    assert track_video(panned, max_frames=6).tracks.shape[1] == 12


def test_a_cut_video_gives_what_can_be_read(panned, tmp_path):
    path = write_video(tmp_path / "clip.avi", panned, "MJPG")
    path.write_bytes(path.read_bytes()[: int(0.6 * path.stat().st_size)])
    with pytest.warns(UserWarning, match=rf"(\d+) of {N_FRAMES} frames") as caught:
        result = track_video(path)
    said = int(re.search(r"(\d+) of", str(caught[0].message)).group(1))
    assert said == result.n_frames
    assert 4 < result.n_frames < N_FRAMES
    render_segmentation(  # as many frames as there are tracks for: nothing to warn of
        path, result.tracks, np.zeros(len(result.tracks), int), tmp_path / "cut.mp4"
    )


def zeroed(avi):
    """An .avi whose frames are there, but hold nothing but zeros."""
    for start in [found.end() for found in re.finditer(b"00dc", avi)][:N_FRAMES]:
        size = int.from_bytes(avi[start : start + 4], "little")
        avi = avi[: start + 4] + bytes(size) + avi[start + 4 + size :]
    return avi


def bad_sources(tmp_path, frames):
    """Things that are no videos, by what the error says."""
    whole = write_video(tmp_path / "whole.mp4", frames)
    whole_avi = write_video(tmp_path / "whole.avi", frames, "MJPG")
    cut = tmp_path / "cut.mp4"  # without its index, which is written last
    cut.write_bytes(whole.read_bytes()[: whole.stat().st_size // 2])
    (tmp_path / "empty.mp4").touch()
    (tmp_path / "noise.avi").write_bytes(bytes(range(256)) * 40)
    (tmp_path / "notes.txt").write_text("no video")
    (tmp_path / "nothing").mkdir()
    (tmp_path / "zeros.avi").write_bytes(zeroed(whole_avi.read_bytes()))
    uneven = write_folder(tmp_path / "uneven", [*frames[:3], frames[3][:-2]])
    broken = write_folder(tmp_path / "broken", frames[:3])
    (broken / "frame1.png").write_bytes(b"no picture")
    return {
        "no video or folder of frames at": tmp_path / "nowhere.mp4",
        "cannot be read as a video": cut,
        "has no bytes": tmp_path / "empty.mp4",
        "noise.avi cannot be read": tmp_path / "noise.avi",
        f"none of the {N_FRAMES} frames of .*zeros.avi can be read": (
            tmp_path / "zeros.avi"
        ),
        "videos end in .mp4, .m4v, .mov, .avi, .mkv, .webm; got 'notes.txt'": tmp_path
        / "notes.txt",
        "no frames .* are in the folder": tmp_path / "nothing",
        "first is 160 x 120 pixels and frame 3 is 160 x 118": uneven,
        "frame1.png is not a picture": broken,
        "two frames or more; .*one.mp4 has 1": write_video(
            tmp_path / "one.mp4", frames[:1]
        ),
        "two frames or more; the arrays has 0": [],
        "frame 0 of the arrays must be uint8": [np.zeros((20, 20))],
        "not empty; got uint8 of shape": [np.zeros((0, 20), np.uint8)],
        "16 pixels a side or more .* got 20 x 8": [np.zeros((8, 20), np.uint8)] * 2,
        "expected the path of a video .* got int": 7,
    }


def test_bad_sources_are_named(panned, tmp_path):
    for words, source in bad_sources(tmp_path, panned).items():
        with pytest.raises((ValueError, TypeError, FileNotFoundError), match=words):
            track_video(source)


def test_a_picture_that_opencv_fails_on_is_named(panned, tmp_path, monkeypatch):
    def fail(*_):
        raise cv2.error("what its reader does not bear")

    folder = write_folder(tmp_path / "frames", panned[:3])
    monkeypatch.setattr(cv2, "imdecode", fail)
    with pytest.raises(ValueError, match=r"frame0.png is no.* a whole .png"):
        track_video(folder)


@pytest.mark.parametrize(
    "name, value",
    [
        ("grid_spacing", 1),
        ("grid_spacing", 8.0),
        ("max_error", -1),
        ("max_error", np.nan),
        ("min_length", 0),
        ("min_texture", "low"),
        ("max_frames", 1),
        ("max_side", 10),
    ],
)
def test_bad_parameters_are_named(panned, name, value):
    with pytest.raises((ValueError, TypeError), match=f"{name} must be .* or more"):
        track_video(panned, **{name: value})


def test_without_opencv_the_extra_is_named(panned, monkeypatch):
    monkeypatch.setitem(sys.modules, "cv2", None)
    with pytest.raises(ImportError, match=r"pip install \"skmotionseg\[video\]\""):
        track_video(panned)


# -------------------------------------------------------------------------- rendering


def bgr(colour):
    return np.array([int(colour[i : i + 2], 16) for i in (5, 3, 1)])


@pytest.mark.parametrize("width, height", [(64, 48), (65, 49)])
def test_a_rendering_has_the_frames_of_the_video(tmp_path, width, height):
    frames = np.full((7, height, width), 200, dtype=np.uint8)
    X = np.tile([20.0, 24.0], (1, 7))
    calls = []
    render_segmentation(
        frames,
        X,
        [1],
        tmp_path / "out.mp4",
        fps=10,
        progress=lambda *call: calls.append(call),
    )
    drawn, fps = read_video(tmp_path / "out.mp4")
    assert drawn.shape == (7, height + height % 2, width + width % 2, 3)
    assert fps == pytest.approx(10)
    assert calls == [(done, 7) for done in range(1, 8)]
    for frame in drawn:  # the codec blurs a little
        assert np.abs(frame[24, 20].astype(int) - bgr(COLOURS[1])).max() < 60
    assert [path.name for path in tmp_path.iterdir()] == ["out.mp4"]


def test_a_sheet_shows_points_where_they_are(tmp_path):
    frames = np.full((4, 60, 80), 200, dtype=np.uint8)
    X = np.full((3, 8), np.nan)
    X[0], X[1, :2], X[2] = np.tile([30, 40], 4), [60, 40], np.tile([45, 50], 4)
    render_segmentation(frames, X, [0, 1, -1], tmp_path / "sheet.png", trail=0)
    sheet = cv2.imread(str(tmp_path / "sheet.png"))
    assert sheet.shape == (2 * 60, 3 * 80, 3)  # four frames, three a row
    pale = sheet[40, 75]
    for row, column in ((0, 0), (0, 80), (0, 160), (60, 0)):
        tile = sheet[row : row + 60, column : column + 80]
        np.testing.assert_array_equal(tile[40, 30], bgr(COLOURS[0]))
        seen = (tile[40, 60] == bgr(COLOURS[1])).all()
        assert seen == (row == column == 0)
        np.testing.assert_array_equal(tile[50, 45], pale)  # hollow
        assert not (tile[48:53, 43:48] == pale).all()
    np.testing.assert_array_equal(sheet[60:, 80:], 255)


def test_a_sheet_of_large_frames_is_scaled(tmp_path):
    frames = np.full((2, 960, 1280), 200, dtype=np.uint8)
    render_segmentation(frames, [[800, 400] * 2], [1], tmp_path / "sheet.png")
    sheet = cv2.imread(str(tmp_path / "sheet.png"))
    assert sheet.shape == (480, 3 * 640, 3)  # two frames, and room for a third
    for left in (0, 640):
        np.testing.assert_array_equal(sheet[200, left + 400], bgr(COLOURS[1]))
    np.testing.assert_array_equal(sheet[:, 2 * 640 :], 255)


def test_a_sheet_of_tiny_frames_is_enlarged(tmp_path):
    frames = np.full((2, 24, 32), 200, dtype=np.uint8)
    render_segmentation(frames, [[20, 15] * 2], [1], tmp_path / "sheet.png")
    sheet = cv2.imread(str(tmp_path / "sheet.png"))
    assert sheet.shape == (60, 3 * 80, 3)
    left = sheet[:, :80]
    np.testing.assert_array_equal(left[39, 51], bgr(COLOURS[1]))
    assert (left[:20] != left[-1, -1]).any(axis=(1, 2)).sum() > 5  # its caption


def test_captions_have_an_outline_that_fits(tmp_path):
    """What is dark is beside something light, and what is light beside what is dark."""
    frames = np.full((1, 120, 200), 100, dtype=np.uint8)
    render_segmentation(frames, [[150, 100]], [1], tmp_path / "sheet.png")
    caption = cv2.imread(str(tmp_path / "sheet.png"))[:40, :100].mean(axis=2)
    pale = caption[-1, -1]
    light, dark = (caption > pale).astype(np.uint8), (caption < pale).astype(np.uint8)
    assert light.sum() > 30
    for inside, around in ((light, dark), (dark, light)):
        near = cv2.dilate(around, np.ones((5, 5), np.uint8))
        assert (near >= inside).all()


def test_trails_go_back(tmp_path):
    frames = np.full((2, 60, 80), 200, dtype=np.uint8)
    X = [[20, 40, 50, 40]]
    for trail in (0, 3):
        render_segmentation(frames, X, [1], tmp_path / "sheet.png", trail=trail)
        second = cv2.imread(str(tmp_path / "sheet.png"))[:, 80:160]
        assert (second[40, 35] == bgr(COLOURS[1])).all() == (trail > 0)


def test_a_failed_rendering_leaves_what_was_there(panned, tmp_path):
    out = tmp_path / "out.mp4"
    out.write_bytes(b"earlier")
    X = np.zeros((1, 2 * N_FRAMES + 2))
    with pytest.raises(ValueError, match=rf"{N_FRAMES + 1} frames, but .* {N_FRAMES}"):
        render_segmentation(panned, X, [0], out)
    assert out.read_bytes() == b"earlier"
    assert [path.name for path in tmp_path.iterdir()] == ["out.mp4"]


@pytest.mark.parametrize("out", ["out.mp4", "out.png"])
def test_tracks_of_no_frame_cannot_be_drawn(panned, tmp_path, out):
    words = r"of one frame or more; got an array of shape \(1, 0\)"
    with pytest.raises(ValueError, match=words):
        render_segmentation(panned, np.ones((1, 0)), [0], tmp_path / out)
    assert not list(tmp_path.iterdir())


def test_points_however_far_outside_are_not_seen(tmp_path):
    frames = np.full((2, 60, 80), 200, dtype=np.uint8)
    sheets = []
    for X in ([[30, 40, 30, 40], [np.nan] * 4], [[30, 40, 30, 40], [1e300, -1e12] * 2]):
        render_segmentation(frames, X, [0, 1], tmp_path / "sheet.png")
        sheets.append(cv2.imread(str(tmp_path / "sheet.png")))
    np.testing.assert_array_equal(*sheets)


def test_log_levels_of_older_opencv(panned, tmp_path, monkeypatch):
    levels = []
    monkeypatch.delattr(cv2.utils, "logging", raising=False)
    monkeypatch.setattr(cv2, "getLogLevel", lambda: 3, raising=False)
    monkeypatch.setattr(cv2, "setLogLevel", levels.append, raising=False)
    X = np.zeros((1, 2 * N_FRAMES))
    render_segmentation(panned, X, [0], tmp_path / "out.mp4", fps=10)
    assert levels == [0, 3]


def test_a_video_that_no_codec_writes(panned, tmp_path, monkeypatch):
    """Time is counted in 16 bits in MPEG-4."""
    monkeypatch.setattr("skmotionseg.video._rendering.CODECS", ("mp4v",))
    X = np.zeros((1, 2 * N_FRAMES))
    words = (
        rf"write a video of 160 x 120 pixels at 90001 frames per second to {tmp_path}"
    )
    with pytest.raises(OSError, match=words):
        render_segmentation(panned, X, [0], tmp_path / "out.mp4", fps=90001)
    assert not list(tmp_path.iterdir())


def test_a_sheet_that_cannot_be_written(panned, tmp_path, monkeypatch):
    monkeypatch.setattr(cv2, "imwrite", lambda *_: False)  # as on a full disk
    X = np.zeros((1, 2 * N_FRAMES))
    with pytest.raises(OSError, match=f"cannot write a picture to {tmp_path}"):
        render_segmentation(panned, X, [0], tmp_path / "out.png")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "fps, error",
    [
        (0, ValueError),
        (-5, ValueError),
        (np.nan, ValueError),
        (np.inf, ValueError),
        ("25", TypeError),
        (True, TypeError),
    ],
)
def test_frames_a_second_are_more_than_none(panned, tmp_path, fps, error):
    X = np.zeros((1, 2 * N_FRAMES))
    with pytest.raises(error, match=f"fps must be a number above 0; got {fps!r}"):
        render_segmentation(panned, X, [0], tmp_path / "out.mp4", fps=fps)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "labels, out, words",
    [
        ([0, 1], "out.mp4", "1 tracks need one label each"),
        ([0.5], "out.mp4", "labels must be whole numbers; got dtype float64"),
        (["car"], "out.png", "labels must be whole numbers; got dtype <U3"),
        ([0], "out.gif", "end in .mp4 or .png; got out.gif"),
        ([0], "nowhere/out.mp4", "no folder to write"),
    ],
)
def test_renderings_that_cannot_be(panned, tmp_path, labels, out, words):
    X = np.zeros((1, 2 * N_FRAMES))
    with pytest.raises((ValueError, FileNotFoundError), match=words):
        render_segmentation(panned, X, labels, tmp_path / out)
    assert not list(tmp_path.iterdir())


# ---------------------------------------------------------------------------- command


@pytest.fixture(scope="module")
def clip(turned, tmp_path_factory):
    return write_video(tmp_path_factory.mktemp("clip") / "clip.avi", turned, "MJPG")


def run(capsys, *arguments):
    code = main([str(argument) for argument in arguments])
    return code, *capsys.readouterr()


@pytest.mark.parametrize("ending, picture", [(".npz", ".mp4"), (".csv", ".png")])
def test_segment_takes_a_video(clip, tmp_path, capsys, monkeypatch, ending, picture):
    monkeypatch.setenv("COLUMNS", "120")
    out, drawn = tmp_path / f"out{ending}", tmp_path / f"out{picture}"
    options = ("--motions", 2, "--selection", "ncre", "--out", out, "--render", drawn)
    code, printed, errors = run(capsys, "segment", clip, *options)
    assert (code, without_progress(errors)) == (0, "")
    written = load_tracks(out)
    points, _ = unpack_tracks(written.data)
    assert points.shape[1] == N_FRAMES
    square = on_square(points[:, 0], 0, margin=-6)
    background = np.isfinite(points[:, 0, 0]) & ~on_square(points[:, 0], 0, margin=6)
    assert (written.target[square] == 1).mean() > 0.9
    assert (written.target[background] == 0).mean() > 0.9
    for motion in (0, 1):
        n = (written.target == motion).sum()
        row = rf"│ +{motion} │ +{n} │ +{n / len(points):.1%} │ +12 of 12 │ \w+ +│"
        assert re.search(row, printed)  # without a colour, as objects have those drawn
        row = rf"(static scene|object) {motion} │ +\d+ │ +12 of 12 │ ● "
        assert re.search(row + COLOURS[motion], printed)
    assert "tracking: 12 of 12 done" in errors
    assert "rendering: 12 of 12 done" in errors
    if picture == ".mp4":
        assert read_video(drawn)[0].shape == (N_FRAMES, HEIGHT, WIDTH, 3)
    else:
        assert cv2.imread(str(drawn)).shape == (3 * HEIGHT, 3 * WIDTH, 3)
    if ending == ".npz":
        assert np.load(out)["fps"] == pytest.approx(12.5)


@pytest.mark.filterwarnings("default")
def test_segment_says_that_a_video_is_cut(clip, tmp_path, capsys):
    cut = tmp_path / "cut.avi"
    cut.write_bytes(clip.read_bytes()[: int(0.8 * clip.stat().st_size)])
    options = ("--motions", 2, "--selection", "ncre")
    code, _, errors = run(capsys, "segment", cut, *options)
    assert code == 0
    said = without_progress(errors)
    assert re.fullmatch(r"skmotionseg: warning: .* \d+ of 12 frames .*\n", said)


@pytest.mark.parametrize(
    "name, content, words",
    [
        ("empty.mp4", b"", "has no bytes"),
        ("noise.mkv", b"noise" * 99, "cannot be read as a video"),
    ],
)
def test_segment_refuses_what_is_no_video(tmp_path, capsys, name, content, words):
    (tmp_path / name).write_bytes(content)
    code, _, errors = run(capsys, "segment", tmp_path / name)
    assert code == 2
    assert re.fullmatch(f"skmotionseg: .*{words}.*\n", errors)


@pytest.mark.parametrize(
    "n_frames, options, words",
    [
        (102, ("--report", "report.png"), "--report is for clips of up to 100 frames"),
        (6, ("--min-motions", 5, "--max-motions", 3), "--min-motions must not exceed"),
    ],
)
def test_segment_refuses_options_before_it_tracks(
    tmp_path, capsys, monkeypatch, n_frames, options, words
):
    monkeypatch.chdir(tmp_path)
    path = write_video("grey.avi", [np.full((64, 64), 90, np.uint8)] * n_frames)
    code, _, errors = run(capsys, "segment", path, *options)
    assert code == 2
    assert re.fullmatch(f"skmotionseg: {words}.*\n", errors)


def test_segment_takes_a_video_of_three_frames(crossed, tmp_path, capsys):
    path = write_video(tmp_path / "short.avi", crossed[:3], "MJPG")
    code, printed, _ = run(capsys, "segment", path, "--motions", 2)
    assert code == 0
    assert "3 of 3" in printed


def test_segment_refuses_a_video_without_texture(tmp_path, capsys):
    path = write_video(tmp_path / "grey.avi", [np.full((64, 64), 90, np.uint8)] * 6)
    code, _, errors = run(capsys, "segment", path)
    assert code == 2
    assert "too little texture" in errors


@pytest.mark.parametrize(
    ("option", "number", "message"),
    [
        ("--stride", 50, "two frames or more; .*crossed.avi, one frame of 50, has 1"),
        ("--grid", 999, "[1-3] points? of .* followed for 5 .* or --grid 999 is far"),
    ],
)
def test_segment_says_which_option_leaves_too_little(
    crossed, tmp_path, capsys, option, number, message
):
    path = write_video(tmp_path / "crossed.avi", crossed[:8], "MJPG")
    code, _, errors = run(capsys, "segment", path, option, number)
    assert code == 2
    assert re.search(message, errors)


def test_segment_needs_two_frames(capsys):
    with pytest.raises(SystemExit):
        run(capsys, "segment", "clip.mp4", "--max-frames", 1)
    assert "--max-frames: expected a whole number, 2 or" in capsys.readouterr().err


# ------------------------------------------------------------------------ preprocessing


def test_select_long_tracks():
    X = np.arange(24.0).reshape(2, 12)
    X[1, :4] = np.nan
    assert select_long_tracks(X).tolist() == [True, False]
    assert select_long_tracks(X, 4).all()
    with pytest.raises(ValueError, match="min_length must be an integer of 1"):
        select_long_tracks(X, 0)


def test_select_balanced_tracks():
    labels = np.repeat([3, 0, -1], [10, 200, 30])
    kept = select_balanced_tracks(labels, 0.25, random_state=0)
    assert kept[labels != 0].all()
    assert kept[labels == 0].sum() == 50
    again = select_balanced_tracks(labels, 0.25, random_state=0)
    np.testing.assert_array_equal(kept, again)
    assert select_balanced_tracks([-1, -1]).all()
    with pytest.raises(ValueError, match="share must be"):
        select_balanced_tracks(labels, 0)
    with pytest.raises(
        ValueError, match=r"labels must be a vector; got shape \(1, 1\)"
    ):
        select_balanced_tracks([[0.5]])
    with pytest.raises(ValueError, match="labels must be whole numbers"):
        select_balanced_tracks([0.5])
    assert select_balanced_tracks([]).shape == (0,)


def test_select_inliers(scene):
    X, y = scene
    kept = select_inliers(X, y)
    assert kept[y >= 0].mean() > 0.95
    sliding = np.flatnonzero((y == 0) & (np.isfinite(X).sum(axis=1) > 10))[:3]
    Z = X.copy()
    Z[sliding] += 15 * np.sin(np.arange(X.shape[1]) ** 2)
    assert not select_inliers(Z, y)[sliding].any()
    assert select_inliers(Z, y, whisker=1e9)[sliding].all()
    assert not select_inliers(X, np.full_like(y, -1)).any()
    assert select_inliers(X, np.arange(len(y))).all()  # nobody to compare with
    with pytest.raises(ValueError, match="tracks need one label each; got labels of"):
        select_inliers(X, y[1:])
    with pytest.raises(ValueError, match="whisker must be"):
        select_inliers(X, y, whisker=-1)


# -------------------------------------------------------------------------------- core


def test_the_log_gives_long_tracks():
    log = TrackLog()
    log.record(np.array([0, 1]), np.array([[1.0, 2], [3, 4]]))
    log.record(np.array([1, 2]), np.array([[5.0, 6], [7, 8]]))
    nan = np.nan
    expected = [[[1, 2], [nan, nan]], [[3, 4], [5, 6]], [[nan, nan], [7, 8]]]
    np.testing.assert_array_equal(log.assemble(1), expected)
    np.testing.assert_array_equal(log.assemble(2), expected[1:2])
    assert log.assemble(1).dtype == np.float32
    assert TrackLog().assemble(1).shape == (0, 0, 2)


def test_seeds_are_the_best_pixels_of_open_cells():
    score = np.zeros((20, 30))  # cells of 10, the texture in two
    score[3, 4], score[15, 28] = 1, 2
    none = np.empty((0, 2))
    assert seed_points(score, 10, 0.5, none).tolist() == [[4, 3], [28, 15]]
    assert seed_points(score, 10, 1.5, none).tolist() == [[28, 15]]
    assert seed_points(score, 10, 0.5, np.array([[9.0, 9]])).tolist() == [[28, 15]]
    near = np.array([[19.4, 15.0], [28.0 - 10 * CLEARANCE + 0.1, 15.0]])
    assert seed_points(score, 10, 0.5, near).tolist() == [[4, 3]]
    assert seed_points(score, 7, 0.5, none).tolist() == [[4, 3], [28, 15]]  # cut cells
    apart = np.array([[4 + 10 * CLEARANCE, 3.0]])
    assert seed_points(score, 10, 0.5, apart).tolist() == [[4, 3], [28, 15]]
    assert not len(seed_points(score, 10, 3, none))
    assert seed_points(score, 10, 0.5, none).dtype == float


def test_a_field_is_sampled_between_pixels():
    y, x = np.mgrid[:5, :6].astype(float)
    field = np.stack([2 * x + y, x - 3 * y], axis=2)
    points = np.array([[1.25, 2.5], [4.9, 0.1]])
    expected = np.column_stack(
        [2 * points[:, 0] + points[:, 1], points[:, 0] - 3 * points[:, 1]]
    )
    np.testing.assert_allclose(sample_field(field, points), expected)
    inside = np.array([[2.5, 2.0]])
    np.testing.assert_allclose(field_gradient(field, inside), np.sqrt(15))


def test_outside_a_field_its_edge_counts():
    field = np.random.default_rng(0).standard_normal((4, 5, 2))
    outside = np.array([[-2.0, 1], [7, 1], [3, -1], [3, 9], [-1, -1]])
    edge = field[[1, 1, 0, 3, 0], [0, 4, 3, 3, 0]]
    np.testing.assert_allclose(sample_field(field, outside), edge)


def test_what_stands_out_of_a_field():
    field = np.zeros((80, 120, 2), np.float32)
    field[..., 0] = np.linspace(0, 9, 120)  # a smooth change does not
    field[32:48, 56:72] += 3
    apart = stands_out(field, 4)
    assert apart.shape == (80, 120) and apart[34:46, 58:70].all()
    assert not apart[:24].any() and not apart[:, :44].any() and not apart[:, 84:].any()
    assert not stands_out(field * 0, 4).any()


def test_small_things_that_move_get_more_tracks(panned):
    """Half again as many as there are cells on them, and the scene does not."""
    frames = []
    for f, background in enumerate(panned):
        frame = background.copy()
        frame[50:74, 40 + 3 * f : 64 + 3 * f] = texture(1)[:24, :24].clip(0, 255)
        frames.append(frame)
    points, seen = unpack_tracks(track_video(frames, grid_spacing=8).tracks)
    points = points[seen[:, 6]]
    x, y = points[:, 6].T
    on = (np.abs(x - 69.5) < 12) & (np.abs(y - 61.5) < 12)
    steps = np.nanmedian(np.diff(points[on], axis=1), axis=1)
    of_it = (np.abs(steps - [3.0, 0.0]) < 0.25).all(axis=1)
    assert of_it.sum() > 1.5 * (24 / 8) ** 2
    assert (~of_it).sum() < 0.2 * of_it.sum()  # not with its outline over the scene
    assert (~on).sum() < 1.3 * (WIDTH / 8) * (HEIGHT / 8)


def test_small_frames_have_smaller_cells(panned):
    large = [np.kron(frame, np.ones((5, 5), np.uint8)) for frame in panned[:5]]
    for frames, spacing in ((panned[:5], 5), (large, 8)):
        tracks = track_video(frames).tracks
        same = track_video(frames, grid_spacing=spacing).tracks
        np.testing.assert_array_equal(tracks, same)


def test_a_picture_ends_at_the_centres_of_its_last_pixels():
    corners = np.array([[0.0, 0], [6, 0], [0, 4], [6, 4]])
    assert is_inside(corners, (5, 7)).all()
    beyond = np.array([[-0.1, 2], [6.1, 2], [3, -0.1], [3, 4.1]])
    assert not is_inside(beyond, (5, 7)).any()
