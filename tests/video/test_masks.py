"""Masks of videos made on the fly, whose moving parts are known."""

from __future__ import annotations

import io
import json
import re
import shutil
import weakref

import numpy as np
import pytest
from helpers.progress_lines import without_progress
from numpy.testing import assert_array_equal
from scipy.ndimage import gaussian_filter

from skmotionseg import pack_tracks
from skmotionseg._utils.png import davis_palette, encode_grey, encode_labels
from skmotionseg.cli import main
from skmotionseg.metrics import boundary_f_measure, region_similarity
from skmotionseg.video import (
    _random_walk,
    dense_masks,
    find_objects,
    prompt_points,
    render_segmentation,
    track_video,
)
from skmotionseg.video._evidence import (
    MOST_DISTANCE,
    MOST_EXTENT,
    NEAR,
    REACH,
    TRACK_WINDOW,
    ColourGrid,
    appearance,
    distance_evidence,
    extent_evidence,
    fill,
    fit_affine,
    gradient_energy,
    motion_field,
    motion_fields,
    texture_centres,
    track_counts,
    track_hulls,
)
from skmotionseg.video._grid import sample_field
from skmotionseg.video._random_walk import edge_weights, random_walk

cv2 = pytest.importorskip("cv2", reason="needs opencv-python-headless")

WIDTH, HEIGHT, N_FRAMES = 160, 120, 10
# In which nothing moves, where a film begins so.
N_RESTING = 8


def textured(seed, size):
    noise = np.random.default_rng(seed).normal(size=(*size, 3))
    noise = gaussian_filter(noise, (1.5, 1.5, 0))
    return (110 + 35 * seed + 45 * noise / noise.std()).clip(0, 255).astype(np.uint8)


def inside(frame):
    """The disk of a frame, bool (height, width)."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    return (x - 50 - 4 * frame) ** 2 + (y - 60) ** 2 < 26**2


@pytest.fixture(scope="module")
def frames():
    """A disk that moves over a scene that moves, too."""
    scene, thing = textured(0, (140, 200)), textured(1, (HEIGHT, WIDTH + 60))
    made = []
    for f in range(N_FRAMES):
        picture = scene[f : f + HEIGHT, f : f + WIDTH].copy()
        shown = thing[:, 50 - 4 * f : 50 - 4 * f + WIDTH]
        picture[inside(f)] = shown[inside(f)]
        made.append(picture)
    return made


@pytest.fixture(scope="module")
def tracked(frames):
    """Tracks, and the truth about them."""
    X = track_video(frames).tracks
    points = X.reshape(len(X), -1, 2)
    first = np.isfinite(points[..., 0]).argmax(axis=1)
    start = np.rint(points[np.arange(len(X)), first]).astype(int)
    masks = np.stack([inside(f) for f in range(N_FRAMES)])
    return X, masks[first, start[:, 1], start[:, 0]].astype(int)


# ------------------------------------------------------------------------------ masks


def test_masks_are_the_moving_thing(frames, tracked):
    masks = list(dense_masks(frames, *tracked))
    assert len(masks) == N_FRAMES
    for frame, mask in enumerate(masks):
        assert mask.dtype == np.uint8 and mask.shape == (HEIGHT, WIDTH)
        assert region_similarity(inside(frame), mask == 1) > 0.85
        assert boundary_f_measure(inside(frame), mask == 1, tolerance=0.02) > 0.8


def test_masks_of_shrunk_frames_have_the_size_of_the_frames(frames, tracked):
    for frame, mask in enumerate(dense_masks(frames, *tracked, max_side=96)):
        assert mask.shape == (HEIGHT, WIDTH)
        assert region_similarity(inside(frame), mask == 1) > 0.75


class Filled:
    """Frames that can be read again, each time into one array."""

    def __init__(self, frames):
        self.frames = frames

    def __iter__(self):
        array = np.empty_like(self.frames[0])
        for frame in self.frames:
            array[:] = frame
            yield array


@pytest.mark.parametrize("again", [False, True])
def test_an_array_may_be_filled_with_each_frame(frames, tracked, again):
    source = Filled(frames)
    masks = list(dense_masks(source if again else iter(source), *tracked))
    assert_array_equal(masks, list(dense_masks(frames, *tracked)))


def test_masks_have_the_labels_that_tracks_have(frames, tracked):
    X, labels = tracked
    plain = list(dense_masks(frames, X, labels))
    named = list(dense_masks(frames, X, np.where(labels, 7, 3)))
    for mask, other in zip(plain, named, strict=True):
        np.testing.assert_array_equal(np.where(mask, 7, 3), other)


def test_one_label_fills_the_frame(frames, tracked):
    X, _ = tracked
    for mask in dense_masks(frames, X, np.full(len(X), 4)):
        assert (mask == 4).all()


def test_rejected_tracks_do_not_count(frames, tracked):
    X, labels = tracked
    lost = np.arange(len(X)) % 3 == 0
    masks = dense_masks(frames, X, np.where(lost, -1, labels))
    alone = dense_masks(frames, X[~lost], labels[~lost])
    for mask, other in zip(masks, alone, strict=True):
        np.testing.assert_array_equal(mask, other)


def test_frames_without_tracks_go_on_as_before(frames, tracked):
    X, labels = tracked
    X = X.copy()
    X[:, 10:14] = np.nan  # frames 5 and 6
    masks = list(dense_masks(frames, X, labels))
    for frame in (5, 6):
        assert region_similarity(inside(frame), masks[frame] == 1) > 0.6


def test_frames_that_are_shown_twice_have_the_mask_of_one(frames, tracked):
    X, labels = tracked
    points = X.reshape(len(X), -1, 2)
    twice = np.repeat(np.arange(N_FRAMES), 2)
    masks = list(
        dense_masks(
            [frames[f] for f in twice], points[:, twice].reshape(len(X), -1), labels
        )
    )
    for frame, mask in zip(twice[1:], masks[1:], strict=True):
        assert region_similarity(inside(frame), mask == 1) > 0.85


@pytest.fixture(scope="module")
def starting(frames, tracked):
    """Noisy frames, and tracks, of what rests in the first ones."""
    X, labels = tracked
    rng = np.random.default_rng(0)
    held = np.append(np.zeros(N_RESTING, dtype=int), np.arange(1, N_FRAMES))
    noisy = [
        (frames[f] + rng.normal(0, 3, frames[f].shape)).clip(0, 255).astype(np.uint8)
        for f in held
    ]
    points = X.reshape(len(X), -1, 2)[:, held]
    points += rng.normal(0, 0.02, points.shape)
    return noisy, points.reshape(len(X), -1), labels


def test_what_rests_at_first_has_the_mask_that_its_movement_shows(starting):
    masks = list(dense_masks(*starting))
    assert len(masks) == N_RESTING + N_FRAMES - 1
    for mask in masks[:N_RESTING]:
        assert region_similarity(inside(0), mask == 1) > 0.9
    masks[0][:] = 9
    assert not (masks[1] == 9).any()  # each is an array of its own


def test_what_appears_while_all_rests_was_not_there_before(starting):
    frames, X, labels = starting
    X = X.copy()
    X[labels == 1, :8] = np.nan  # no track of it in four frames
    masks = list(dense_masks(frames, X, labels))
    assert not any((mask == 1).any() for mask in masks[:3])
    assert region_similarity(inside(0), masks[N_RESTING - 1] == 1) > 0.6


def test_frames_that_end_while_all_rests_are_too_few(starting):
    frames, X, labels = starting
    with pytest.raises(ValueError, match="frames, but the arrays 4"):
        list(dense_masks(frames[:4], X, labels))


def test_a_film_in_which_nothing_moves_has_a_mask_per_frame(starting):
    frames, X, labels = starting
    first = X[:, : 2 * N_RESTING]
    masks = list(dense_masks(frames[:N_RESTING], first, labels))
    assert len(masks) == N_RESTING
    assert region_similarity(inside(0), masks[0] == 1) > 0.6


def test_what_stops_keeps_its_mask(frames, tracked):
    X, labels = tracked
    rng = np.random.default_rng(0)
    held = np.append(np.arange(N_FRAMES), np.full(15, N_FRAMES - 1))
    noisy = [
        (frames[f] + rng.normal(0, 3, frames[f].shape)).clip(0, 255).astype(np.uint8)
        for f in held
    ]
    points = X.reshape(len(X), -1, 2)[:, held]
    points += rng.normal(0, 0.02, points.shape)
    masks = list(dense_masks(noisy, points.reshape(len(X), -1), labels))
    assert region_similarity(masks[N_FRAMES - 1] == 1, masks[-1] == 1) > 0.95


def test_a_motion_that_comes_late_does_not_change_what_was_before(frames, tracked):
    X, labels = tracked
    late = X[labels == 1] + 1
    late[:, :-6] = np.nan
    both = np.concatenate([X, late]), np.append(labels, np.full(len(late), 2))
    alone = list(dense_masks(frames, X, labels))
    with_it = list(dense_masks(frames, *both))
    for before, after in zip(alone[:-3], with_it[:-3], strict=True):
        np.testing.assert_array_equal(before, after)
    assert (with_it[-1] == 2).any()


def test_no_more_than_three_frames_are_held_for_masks(frames, tracked):
    alive, most = weakref.WeakSet(), 0

    class Frame(np.ndarray):
        """An array that can be kept in a set."""

        __hash__ = object.__hash__
        __eq__ = object.__eq__

        def __array_finalize__(self, other):  # of copies, too
            alive.add(self)

    def count_frames():
        nonlocal most
        for picture in frames:
            frame = picture.copy().view(Frame)
            most = max(most, len(alive))
            yield frame
            del frame

    assert sum(1 for _ in dense_masks(count_frames(), *tracked)) == N_FRAMES
    assert 1 <= most <= 3


def test_progress_counts_the_masks(frames, tracked):
    calls = []
    list(dense_masks(frames, *tracked, progress=lambda *call: calls.append(call)))
    assert calls == [(done, N_FRAMES) for done in range(1, N_FRAMES + 1)]


@pytest.mark.parametrize(
    "labels, options, words",
    [
        ([0], {}, "need one label each"),
        (-1, {}, "one labelled track or more"),
        (255, {}, "labels must be below 255; got 255"),
        (0, {"max_side": 8}, "max_side must be an integer of 16 or more; got 8"),
    ],
)
def test_masks_that_cannot_be(frames, tracked, labels, options, words):
    X, _ = tracked
    labels = np.full(len(X), labels) if np.isscalar(labels) else labels
    with pytest.raises(ValueError, match=words):
        dense_masks(frames, X, labels, **options)


def test_tracks_have_a_frame(frames):
    nothing = np.zeros((3, 0)), [0, 0, 1]
    words = r"one frame or more; got an array of shape \(3, 0\)"
    with pytest.raises(ValueError, match=words):
        dense_masks(frames, *nothing)
    with pytest.raises(ValueError, match=words):
        find_objects(*nothing, width=9, height=9)


def test_masks_need_the_frames_of_the_tracks(frames, tracked):
    with pytest.raises(ValueError, match=f"have {N_FRAMES} frames, but the arrays 4"):
        list(dense_masks(frames[:4], *tracked))
    small = [np.zeros((8, 40), np.uint8)] * N_FRAMES
    with pytest.raises(ValueError, match="16 pixels per side or more for masks"):
        list(dense_masks(small, *tracked))


# ---------------------------------------------------------------------- random walker


def test_a_random_walk_solves_its_linear_system():
    rng = np.random.default_rng(0)
    evidence = rng.random((3, 7, 9)).astype(np.float32)
    across = rng.random((7, 8)).astype(np.float32)
    down = rng.random((6, 9)).astype(np.float32)
    number = np.arange(63).reshape(7, 9)
    matrix = np.diag(evidence.sum(axis=0).ravel()).astype(float)
    for one, other, weight in (
        (number[:, :-1], number[:, 1:], across),
        (number[:-1], number[1:], down),
    ):
        for i, j, w in zip(one.ravel(), other.ravel(), weight.ravel(), strict=True):
            matrix[i, i] += w
            matrix[j, j] += w
            matrix[i, j] -= w
            matrix[j, i] -= w
    exact = np.linalg.solve(matrix, evidence.reshape(3, -1).T).T.reshape(3, 7, 9)
    walk = random_walk(evidence, across, down, np.full_like(evidence, 1 / 3))
    np.testing.assert_allclose(walk, exact, atol=5e-3)
    np.testing.assert_allclose(walk.sum(axis=0), 1, atol=1e-5)


def test_a_random_walk_is_solved_where_a_label_may_be(monkeypatch):
    """Leaving out the rest of the picture changes hardly anything."""
    evidence = np.zeros((3, 120, 160), np.float32)
    evidence[1, 30:60, 20:70], evidence[2, 80:90, 120:140] = 0.15, 0.15
    evidence[0] = 0.15 - evidence[1:].sum(axis=0)
    across, down = np.full((120, 159), 10.0), np.full((119, 160), 10.0)
    ties = across.astype(np.float32), down.astype(np.float32)
    start = np.zeros_like(evidence)
    walk = random_walk(evidence, *ties, start)
    monkeypatch.setattr(_random_walk, "NEGLIGIBLE", -1.0)
    whole = random_walk(evidence, *ties, start)
    assert walk[1, :, 100:].max() == 0 and walk[2, :, :90].max() == 0
    np.testing.assert_allclose(walk, whole, atol=0.03)
    assert (walk.argmax(axis=0) == whole.argmax(axis=0)).mean() > 0.999


def test_edges_tie_less():
    picture = np.zeros((8, 10, 3), np.uint8)
    picture[:, 5:] = 200
    across, down = edge_weights(picture, 2.0, 0.1)
    assert across.shape == (8, 9) and down.shape == (7, 10)
    assert across[:, 4].max() < across[:, 0].min() == pytest.approx(2.2)
    np.testing.assert_allclose(down, 2.2, rtol=1e-6)


def test_points_before_a_plain_wall_go_to_the_outline_that_they_follow():
    grey = np.full((60, 80), 100, np.uint8)
    grey[:, 40:] = 180
    steps = texture_centres(gradient_energy(grey))
    np.testing.assert_allclose(steps[30, 34:46, 0], 39.5 - np.arange(34, 46), atol=0.2)
    assert np.abs(steps[30, :25]).max() < 0.5  # nothing there to go to
    moved = sample_field(steps, np.array([[35.0, 30.0], [44.0, 30.0]]))
    np.testing.assert_allclose(moved, [[4.5, 0], [-4.5, 0]], atol=0.2)


def test_a_motion_is_near_its_tracks_and_no_less_next_to_them():
    counts = np.zeros((2, 9, 200), np.float32)
    counts[0, 4, 0] = counts[1, 4, 199] = 1
    everywhere = np.ones(counts.shape, np.uint8)
    logs = distance_evidence(counts, everywhere)[:, 4]
    assert logs.max(axis=0).max() == 0
    assert logs[1, 20] < -3 and logs[0, 180] < -3
    counts[1] = 0
    counts[1, 4, int(NEAR + REACH)] = 1
    beside = distance_evidence(counts, everywhere)[:, 4]
    assert np.abs(beside[:, 8 : int(NEAR)]).max() == 0


def test_the_scene_is_not_far_where_no_thing_extends():
    counts = np.zeros((2, 60, 500), np.float32)
    counts[0, ::9, 0:40:9] = 1  # the rest of the scene is plain
    thing = np.array([[150.0, 20], [230, 20], [230, 40], [150, 40]])
    counts[(1, *thing.astype(int)[:, ::-1].T)] = 1
    hulls = track_hulls(thing, np.ones(4, int), 2, (60, 500))
    logs = distance_evidence(counts, hulls)[:, 30]
    assert logs[0, 150:230].max() == -MOST_DISTANCE  # in the thing, as it was
    assert (logs[0, 250:] == 0).all() and logs[1, 350] == -MOST_DISTANCE
    assert logs[0, 230 + TRACK_WINDOW // 2] < 0  # tracks stand within the outline


def test_what_nothing_tells_belongs_to_the_larger_motion_but_in_a_thing():
    thing = np.array([[20.0, 20], [40, 20], [40, 30], [20, 30]])
    wall = np.random.default_rng(0).uniform((0, 0), (99, 59), (45, 2))
    labels, points = np.repeat([1, 0], [4, 45]), np.concatenate([thing, wall])
    counts = track_counts(points, labels, 3, (60, 100))
    hulls = track_hulls(points, labels, 3, (60, 100))
    assert hulls[1].sum() == 21 * 11 and not hulls[2].any()
    logs = extent_evidence(counts, hulls)
    assert (logs[0] == 0).all()
    assert logs[1, 25, 30] == 0  # plain, between its tracks
    assert logs[1, 50, 80] == pytest.approx(np.log(5 / 46))
    assert (logs[2] == -MOST_EXTENT).all()  # has no tracks: log(1 / 46) is less
    alike = extent_evidence(counts[[1, 1]], 0 * hulls[:2])
    assert (alike == 0).all()


def test_a_thing_does_not_take_the_plain_wall_beside_it():
    rng = np.random.default_rng(0)
    frames = np.full((8, 120, 200, 3), 128, np.uint8)
    texture = 128 + 300 * gaussian_filter(rng.normal(size=(120, 200)), 1.5)
    grey = np.uint8(texture.clip(0, 255))
    frames[:, :, :60] = grey[None, :, :60, None]  # the rest of the wall is plain
    for number, frame in enumerate(frames):
        frame[40:70, 90 + number : 120 + number] = grey[40:70, 90:120, None]
    tracks = track_video(frames).tracks
    labels = (tracks[:, 0] > 75).astype(int)
    mask = list(dense_masks(frames, tracks, labels))[4]
    assert mask[45:65, 98:120].mean() > 0.9
    assert mask[:, 150:].mean() < 0.1


def test_gaps_of_a_field_are_filled():
    values = np.zeros((16, 16, 2), np.float32)
    values[3, 4], values[12, 12] = (2, -1), (2, -1)
    weight = (values[..., 0] != 0).astype(np.float32)
    np.testing.assert_allclose(fill(values, weight)[..., 0], 2, atol=1e-4)
    empty = fill(values * 0, weight * 0)
    np.testing.assert_array_equal(empty, 0)


def test_a_motion_field_is_that_of_its_tracks():
    rng = np.random.default_rng(0)
    points = rng.uniform([0, 0], [WIDTH, HEIGHT], (80, 2))
    steps = points @ [[0.02, 0.01], [-0.01, 0.02]] + [3, -1]
    field, distance = motion_field(points, steps, (HEIGHT, WIDTH))
    assert field.shape == (HEIGHT, WIDTH, 2) and distance.shape == (HEIGHT, WIDTH)
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    truth = np.stack([x, y], axis=2) @ [[0.02, 0.01], [-0.01, 0.02]] + [3, -1]
    assert np.median(np.abs(field - truth)) < 0.05
    assert distance.min() == 0 < distance.max() < WIDTH
    steps[:12] += 30  # outliers
    matrix = [[0.02, 0.01], [-0.01, 0.02], [3, -1]]
    np.testing.assert_allclose(fit_affine(points, steps), matrix, atol=0.05)


def test_a_picture_is_explained_by_the_motion_that_carries_it():
    """To another picture; where it is plain, by any."""
    picture = cv2.cvtColor(textured(0, (HEIGHT, WIDTH + 3)), cv2.COLOR_BGR2GRAY)
    picture[:60] = 90
    grey, other = picture[:, 3:].astype(np.float32), picture[:, :-3].astype(np.float32)
    points = np.random.default_rng(0).uniform([0, 0], [WIDTH, HEIGHT], (200, 2))
    labels = np.arange(200) % 2
    steps = np.column_stack([3.0 * labels, np.zeros(200)])
    fields = motion_fields(points, steps, labels, 3, grey.shape)
    assert fields[2] is None
    logs = appearance(grey, other, gradient_energy(grey), fields)
    textured_part, plain_part = np.s_[:, 64:, 8:-8], np.s_[:2, :52, 8:-8]
    still, moved, unknown = logs[textured_part]
    assert (moved > still).mean() > 0.97 and np.median(moved - still) > 1
    assert (moved > unknown).all()
    assert np.ptp(logs[plain_part], axis=0).max() < 0.01


def test_colours_tell_motions_apart_where_they_are():
    picture = np.full((64, 64, 3), 30, np.uint8)
    picture[:, 32:] = (20, 220, 60)
    grid = ColourGrid((64, 64))
    cells = grid.cells(grid.colours(picture))
    known = np.zeros((2, 64, 64), np.float32)
    known[0, :, :32], known[1, :, 32:] = 1, 1
    logs = grid.evidence(cells, known, cells)
    assert (logs[0, :, :32] == 0).all() and (logs[1, :, 32:] == 0).all()
    assert logs[1, :, :32].max() < -2 and logs[0, :, 32:].max() < -2
    known[:, :, :32] = 0.5  # of which nobody knows the motion, so nothing is learnt
    logs = grid.evidence(cells, known, cells)
    assert (logs[:, :, :16] == 0).all() and logs[0, :, 32:].max() < -2
    assert (grid.evidence(cells, known * 0 + 0.5, cells) == 0).all()


# -------------------------------------------------------------------- files, pictures


def test_palette_images_are_read_as_written():
    labels = np.arange(256, dtype=np.uint8).reshape(8, 32)
    image = pytest.importorskip("PIL.Image")
    with image.open(io.BytesIO(encode_labels(labels))) as read:
        assert read.mode == "P"
        np.testing.assert_array_equal(np.asarray(read), labels)
        palette = np.reshape(read.getpalette(), (-1, 3))
    np.testing.assert_array_equal(palette, davis_palette())
    assert palette[:4].tolist() == [[0, 0, 0], [128, 0, 0], [0, 128, 0], [128, 128, 0]]
    grey = cv2.imdecode(np.frombuffer(encode_grey(labels), np.uint8), -1)
    np.testing.assert_array_equal(grey, labels)


def test_masks_are_drawn_so_that_the_image_shows(tmp_path):
    frames = np.full((2, 60, 80), 100, dtype=np.uint8)
    masks = np.zeros((2, 60, 80), np.uint8)
    masks[:, 20:40, 30:60] = 1
    X = np.tile([40.0, 30], (1, 2))
    render_segmentation(frames, X, [1], tmp_path / "out.png", masks=masks)
    sheet = cv2.imread(str(tmp_path / "out.png")).astype(int)
    assert (sheet[50, 70] == 100).all()
    covered = sheet[30, 45]
    assert (covered != 100).any() and np.abs(covered - 100).max() < 60
    with pytest.raises(ValueError, match=r"frame 1 needs a mask .*60, 80.*got none"):
        render_segmentation(frames, X, [1], tmp_path / "out.png", masks=masks[:1])
    with pytest.raises(ValueError, match=r"frame 0 needs a mask .* one of shape"):
        render_segmentation(frames, X, [1], tmp_path / "out.png", masks=masks[:, 1:])


def test_prompts_lie_on_and_off_their_motion(tracked):
    X, labels = tracked
    prompts = prompt_points(X, labels, n_points=3)
    assert [prompt["frame"] for prompt in prompts] == list(range(N_FRAMES))
    for prompt in prompts:
        mask = inside(prompt["frame"])
        for points, on in ((prompt["positive"], True), (prompt["negative"], False)):
            assert len(points) == 3
            x, y = np.rint(points).astype(int).T
            assert (mask[y, x] == on).mean() > 0.6
        x, y = np.rint(prompt["positive"]).astype(int).T
        assert mask[y, x].all()
    alone = prompt_points([[1, 2, 3, 4]], [5])
    assert [p["positive"] for p in alone] == [[[1.0, 2.0]], [[3.0, 4.0]]]
    assert alone[0]["negative"] == []
    with pytest.raises(ValueError, match="n_points must be an integer of 1 or more"):
        prompt_points(X, labels, n_points=0)


def test_what_is_among_the_tracks_of_a_motion_is_not_off_it():
    """Whatever its label, which is wrong for some."""
    x, y = np.meshgrid(np.arange(0, 200, 10), np.arange(0, 200, 10))
    X = np.column_stack([x.ravel(), y.ravel()]).astype(float)
    on = ((X >= 60) & (X <= 130)).all(axis=1)
    labels = on.astype(int)
    for place in ([90, 100], [80, 70]):
        labels[(place == X).all(axis=1)] = 0
    (prompt,) = prompt_points(X, labels, n_points=8)
    negative = np.array(prompt["negative"])
    assert len(negative) == 8
    assert not ((negative >= 60) & (negative <= 130)).all(axis=1).any()
    (alone,) = prompt_points([[0, 0], [9, 9], [4, 4]], [1, 1, 0])
    assert alone["negative"] == [[4, 4]]  # rather than none


def test_objects_of_a_video(tracked):
    X, labels = tracked
    swapped = find_objects(X, 1 - labels, width=WIDTH, height=HEIGHT)
    assert (swapped[labels == 0] == 0).mean() > 0.95
    assert (swapped[labels == 1] == 1).mean() > 0.95


# ---------------------------------------------------------------------------- command


# How a partition is chosen is not what tests of files are about.
BY_GRAPH = ("--motions", 2, "--selection", "ncre")


@pytest.fixture(scope="module")
def folder(frames, tmp_path_factory):
    home = tmp_path_factory.mktemp("frames")
    for number, frame in enumerate(frames):
        cv2.imwrite(str(home / f"im{number}.png"), frame)
    return home


def test_segment_writes_masks(folder, tmp_path, capsys):
    masks, static = tmp_path / "masks", tmp_path / "static"
    prompts, sheet = tmp_path / "prompts.json", tmp_path / "sheet.png"
    options = ["--masks", masks, "--static-masks", static, "--prompts", prompts]
    options += ["--render", sheet, "--viewer", tmp_path / "page.html"]
    options += ["--report", tmp_path / "report.png"]
    options += ["--motions", 2, "--max-frames", 6, "--jobs", 1]
    code = main(["segment", str(folder), *map(str, options)])
    printed = capsys.readouterr()
    assert (code, without_progress(printed.err)) == (0, "")
    assert re.search(r"moving objects +│ +1 │", printed.out)
    assert re.search(r"object 1 │ +\d+ │ 6 of 6 │ ● #d55e00", printed.out)
    assert printed.out.count(" colour ") == 1  # of objects, which pictures show
    whole, *parts = reversed(re.findall(r"seconds (\w+) +│ +([0-9.]+)", printed.out))
    assert [name for name, _ in parts[:5]] == [
        "viewer",
        "rendering",
        "masks",
        "objects",
        "segmenting",
    ]
    assert float(whole[1]) >= sum(float(seconds) for _, seconds in parts[:5])
    report = cv2.imread(str(tmp_path / "report.png"))
    assert len(np.unique(report[::4, ::4].reshape(-1, 3), axis=0)) > 500  # an image
    names = [f"im{number}" for number in range(6)]
    assert sorted(path.name for path in masks.iterdir()) == [f"{n}.png" for n in names]
    assert sorted(p.name for p in static.iterdir()) == [f"{n}.png.png" for n in names]
    for frame, name in enumerate(names):
        grey = cv2.imread(str(static / f"{name}.png.png"), cv2.IMREAD_UNCHANGED)
        assert set(np.unique(grey)) == {0, 255}
        assert region_similarity(inside(frame), grey == 0) > 0.7
        colours = cv2.imread(str(masks / f"{name}.png"))
        np.testing.assert_array_equal((colours == 0).all(axis=2), grey == 255)
    said = json.loads(prompts.read_text())["prompts"]
    assert {prompt["image"] for prompt in said} == {f"{name}.png" for name in names}
    assert cv2.imread(str(sheet)).shape == (2 * HEIGHT, 3 * WIDTH, 3)
    assert "application/json" in (tmp_path / "page.html").read_text()


def test_a_scene_that_covers_little_of_the_picture_is_warned_of(recwarn):
    rng = np.random.default_rng(0)
    start = rng.uniform([20, 30], [60, 70], (60, 1, 2))
    X = (start + 3.0 * np.arange(12)[:, None] * [1, 0.2]).reshape(60, -1)
    size = {"width": WIDTH, "height": HEIGHT}
    with pytest.warns(UserWarning, match="covers less than 25% of the picture"):
        find_objects(X, np.zeros(60, dtype=int), **size)
    recwarn.clear()
    wide = (start - [20, 30]) * [3.5, 2.5] + np.zeros((12, 2))
    find_objects(wide.reshape(60, -1), np.zeros(60, dtype=int), **size)
    assert not recwarn.list


def test_scenes_before_and_after_a_cut_are_static():
    """Few tracks go on by chance; what moves in either is a thing of its own."""
    rng, n_frames, cut = np.random.default_rng(0), 24, 11
    frames = np.arange(n_frames)
    start, depth = rng.uniform(0, [640, 480], (900, 2)), rng.uniform(1, 2, 900)
    first, by_chance = np.arange(900) < 450, np.arange(900) % 30 == 0
    steps = np.where(first[:, None], [6.0, 1.0], [-2.0, -7.0]) / depth[:, None]
    moving = (abs(start - [320, 240]) < 60).all(axis=1)
    steps += moving[:, None] * np.where(first[:, None], [-9.0, 4.0], [8.0, 5.0])
    points = start[:, None] + steps[:, None] * (frames % cut)[None, :, None]
    points += rng.normal(scale=0.1, size=points.shape)
    seen = (frames < cut) == first[:, None]
    seen |= by_chance[:, None] & (abs(frames - cut) < 3)
    X = pack_tracks(points, seen)
    objects = find_objects(X, np.zeros(900, dtype=int), width=640, height=480)
    sure = ~by_chance
    assert (objects[sure & ~moving] == 0).mean() > 0.98
    things = [objects[sure & moving & each] for each in (first, ~first)]
    assert [np.unique(each).size for each in things] == [1, 1]
    assert {int(each[0]) for each in things} == {1, 2}


@pytest.mark.filterwarnings("default:.*more pictures than")
def test_segment_takes_every_other_frame(folder, tmp_path, capsys):
    masks = tmp_path / "masks"
    options = ["--masks", masks, "--stride", 2, *BY_GRAPH, "--jobs", 1]
    assert main(["segment", str(folder), *map(str, options)]) == 0
    names = [f"im{number}.png" for number in range(0, N_FRAMES, 2)]
    assert sorted(path.name for path in masks.iterdir()) == names
    assert "warning" not in capsys.readouterr().err
    # Those of another run stay, which is said.
    options[3] = 4
    assert main(["segment", str(folder), *map(str, options)]) == 0
    assert "more pictures than were written now, such as im2" in capsys.readouterr().err
    assert sorted(path.name for path in masks.iterdir()) == names


@pytest.mark.parametrize("option", ["--masks", "--out", "--viewer"])
def test_segment_refuses_folders_that_are_closed(
    folder, tmp_path, capsys, monkeypatch, option
):
    monkeypatch.setattr("skmotionseg._utils.writing.os.access", lambda *a: False)
    path = tmp_path / {"--out": "l.csv", "--viewer": "v.html"}.get(option, "masks")
    assert main(["segment", str(folder), option, str(path)]) == 2
    assert f"{tmp_path} may not be written to" in capsys.readouterr().err


def test_labels_are_there_if_pictures_fail(folder, tmp_path, capsys, monkeypatch):
    def broken(*arguments):
        raise OSError("no room")

    monkeypatch.setattr("skmotionseg._commands.segment.draw", broken)
    out = tmp_path / "labels.csv"
    options = ["--out", out, "--render", tmp_path / "x.png", *BY_GRAPH]
    assert main(["segment", str(folder), *map(str, options)]) == 2
    assert "no room" in capsys.readouterr().err
    assert out.exists()


@pytest.mark.parametrize(
    "option, value, words",
    [
        ("--masks", "nowhere/masks", "no folder to write"),
        ("--static-masks", "file", "not a folder that could be written to"),
        ("--prompts", "points.txt", "end in .json"),
    ],
)
def test_segment_refuses_where_masks_cannot_go(
    folder, tmp_path, capsys, option, value, words
):
    (tmp_path / "file").touch()
    assert main(["segment", str(folder), option, str(tmp_path / value)]) == 2
    assert words in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--masks", "."), "--masks and the input are the same"),
        (("--static-masks", "."), "--static-masks and the input are the same"),
        (("--masks", "../m", "--static-masks", "../m"), "and --masks are the same"),
        (("--render", "sheet.png"), "would be one of the frames in"),
        (("--masks", "../m"), "the masks of im0.jpg and im0.png would both be im0.png"),
    ],
)
def test_frames_are_not_written_over(folder, tmp_path, capsys, options, words):
    frames = tmp_path / "frames"
    shutil.copytree(folder, frames)
    shutil.copy(frames / "im0.png", frames / "im0.jpg")
    before = {path.name: path.read_bytes() for path in frames.iterdir()}
    paths = [part if part[:2] == "--" else str(frames / part) for part in options]
    assert main(["segment", str(frames), *paths]) == 2
    assert words in capsys.readouterr().err
    assert {path.name: path.read_bytes() for path in frames.iterdir()} == before
    assert [path.name for path in tmp_path.iterdir()] == ["frames"]


@pytest.mark.parametrize("option", ["--masks", "--static-masks"])
@pytest.mark.parametrize("picture", ["--render", "--report"])
def test_pictures_are_not_written_among_masks(
    folder, tmp_path, capsys, option, picture
):
    masks = tmp_path / "masks"
    masks.mkdir()
    options = [option, str(masks), picture, str(masks / "00000.png")]
    assert main(["segment", str(folder), *options]) == 2
    assert f"would be one of the {option[2:].replace('-', ' ')} in" in (
        capsys.readouterr().err
    )
    assert not [*masks.iterdir()]


def test_masks_of_tracks_without_a_video_are_refused(tmp_path, capsys):
    path = tmp_path / "tracks.npz"
    X = pack_tracks(np.random.default_rng(0).uniform(0, 90, (20, 6, 2)))
    np.savez(path, X=X)
    assert main(["segment", str(path), "--masks", str(tmp_path / "masks")]) == 2
    assert "--masks needs a video or a folder of frames" in capsys.readouterr().err
