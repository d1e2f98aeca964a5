"""Packing of tracks, frame pairs and normalised coordinates."""

from __future__ import annotations

import numpy as np
import pytest
from helpers import textbook
from numpy.testing import assert_allclose, assert_array_equal

from skmotionseg import pack_tracks, unpack_tracks
from skmotionseg._core.geometry.tracks import (
    LAYOUTS,
    apply_similarity,
    covered,
    covisible_pairs,
    frame_pairs,
    normalization,
    shots,
    similarity,
    working_coordinates,
)

NAN, INF = np.nan, np.inf


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def random_tracks(rng, n_tracks=7, n_frames=4):
    points = rng.uniform(0, 640, size=(n_tracks, n_frames, 2))
    return points, rng.uniform(size=(n_tracks, n_frames)) < 0.7


# --------------------------------------------------------------------------- packing


@pytest.mark.parametrize("away", [1e4, -1e6])
def test_what_points_cover_leaves_out_those_astray(rng, away):
    points = rng.uniform([0, 0], [640, 480], (500, 2))
    usual = np.array([points.min(axis=0), points.max(axis=0)])
    points[7] = 320, away
    assert_array_equal(covered(np.delete(points, 7, axis=0)), usual)
    assert_array_equal(covered(points), usual)
    points[7] = 320, 700  # beyond the others, as the end of a street may be
    assert covered(points)[1][1] == 700
    few = points[:200].reshape(20, 10, 2)
    usual = few.min(axis=(0, 1)), few.max(axis=(0, 1))
    few = np.concatenate([few, few[:1] + away, np.full((200, 10, 2), np.nan)])
    assert_array_equal(covered(few, np.isfinite(few[..., 0])), usual)
    # Of ten tracks, they may be a motion.
    few = few[:21].reshape(-1, 2)
    assert_array_equal(covered(few), [few.min(axis=0), few.max(axis=0)])
    assert_array_equal(covered(points[:0]), np.zeros((2, 2)))
    assert_array_equal(
        covered(np.array([[1.0, 2.0]] * 99 + [[5, 2]])), [[1, 2], [5, 2]]
    )


def test_columns_are_x_and_y_frame_by_frame():
    packed = pack_tracks([[[1.0, 2.0], [3.0, 4.0]], [[5.0, 6.0], [7.0, 8.0]]])
    assert_array_equal(packed, [[1, 2, 3, 4], [5, 6, 7, 8]])


def test_unpacking_undoes_packing(rng):
    points, visibility = random_tracks(rng)
    unpacked, seen = unpack_tracks(pack_tracks(points, visibility))
    assert_array_equal(seen, visibility)
    assert_array_equal(unpacked[seen], points[visibility])
    assert np.isnan(unpacked[~seen]).all()


def test_packing_undoes_unpacking(rng):
    X = pack_tracks(*random_tracks(rng))
    assert_array_equal(pack_tracks(*unpack_tracks(X)), X)
    assert_array_equal(pack_tracks(unpack_tracks(X)[0]), X)


@pytest.mark.parametrize("missing", [[NAN, NAN], [NAN, 4.0], [3.0, NAN]])
def test_half_a_point_is_no_point(missing):
    X = pack_tracks([[[1.0, 2.0], missing]])
    assert_array_equal(X, [[1, 2, NAN, NAN]])
    points, visibility = unpack_tracks([[1.0, 2.0, *missing]])
    assert_array_equal(visibility, [[True, False]])
    assert_array_equal(points, [[[1, 2], [NAN, NAN]]])


@pytest.mark.parametrize("value", [INF, -INF, NAN, 1e300])
def test_a_point_marked_as_unseen_can_be_anything(value):
    X = pack_tracks([[[1.0, 2.0], [value, 4.0]]], visibility=[[True, False]])
    assert_array_equal(X, [[1, 2, NAN, NAN]])


@pytest.mark.parametrize("visibility", [
    [[True, False]], [[1, 0]], [[1.0, 0.0]], np.array([[1, 0]], dtype=np.uint8),
])  # fmt: skip
def test_visibility_is_boolean_or_zeros_and_ones(visibility):
    X = pack_tracks([[[1.0, 2.0], [3.0, 4.0]]], visibility)
    assert_array_equal(X, [[1, 2, NAN, NAN]])


@pytest.mark.parametrize(
    ("given", "packed"),
    [("f2", "f4"), ("f4", "f4"), ("f8", "f8"), ("g", "f8"), ("i4", "f8"), ("i8", "f8")],
)
def test_tracks_are_double_and_float32_stays(given, packed):
    X = pack_tracks(np.ones((3, 2, 2), dtype=given))
    assert X.dtype == packed
    assert unpack_tracks(X)[0].dtype == packed
    assert unpack_tracks(np.ones((3, 4), dtype=given))[0].dtype == packed


def test_packing_and_unpacking_leave_their_input_alone(rng):
    points, visibility = random_tracks(rng)
    points[0, 0, 0] = NAN
    before = points.copy()
    X = pack_tracks(points, visibility)
    assert_array_equal(points, before)
    half = np.array([[1.0, NAN, 3.0, 4.0]])
    unpack_tracks(half)
    assert_array_equal(half, [[1, NAN, 3, 4]])
    unpack_tracks(X)[0][:] = 0
    assert np.nanmax(X) > 0


@pytest.mark.parametrize("number", [INF, -INF])
def test_infinite_tracks_are_an_error(number):
    with pytest.raises(ValueError, match=r"finite where they are seen.*1 infinite"):
        unpack_tracks([[1.0, 2.0, number, 4.0]])


@pytest.mark.parametrize("X", [[["a", "b"]], [["1.5", "2"]], [[1j, 2]], [[None, {}]]])
def test_tracks_that_are_no_numbers_are_an_error(X):
    with pytest.raises(TypeError, match="tracks must be real numbers; got dtype"):
        unpack_tracks(X)


def test_infinite_points_that_are_seen_are_an_error():
    points = [[[1.0, 2.0], [INF, 4.0]], [[-INF, NAN], [3.0, 4.0]]]
    with pytest.raises(ValueError, match=r"finite where they are seen.*2 infinite"):
        pack_tracks(points)


@pytest.mark.parametrize("shape", [(4, 2), (3, 4, 3), (2, 3, 4, 2)])
def test_points_of_another_shape_are_an_error(shape):
    with pytest.raises(ValueError, match=r"\(n_tracks, n_frames, 2\); got \("):
        pack_tracks(np.zeros(shape))


def test_visibility_of_another_shape_is_an_error():
    with pytest.raises(ValueError, match=r"= \(3, 2\); got \(2, 3\)"):
        pack_tracks(np.zeros((3, 2, 2)), np.ones((2, 3), dtype=bool))


@pytest.mark.parametrize("visibility", [[[1, 2]], [[0.5, 1]], [["yes", "no"]]])
def test_visibility_of_other_values_is_an_error(visibility):
    with pytest.raises(ValueError, match="visibility must be boolean"):
        pack_tracks([[[1.0, 2.0], [3.0, 4.0]]], visibility)


@pytest.mark.parametrize("points", [[[["a", "b"]]], [[[1j, 2]]]])
def test_points_that_are_no_numbers_are_an_error(points):
    with pytest.raises(TypeError, match="points must be real numbers"):
        pack_tracks(points)


# ------------------------------------------------------- what point trackers give


@pytest.mark.parametrize("dtype", [float, np.float32, int, np.uint8])
def test_masked_points_are_unseen(dtype):
    values = np.array([[[1, 2], [3, 4], [5, 6]]], dtype=dtype)
    mask = np.array([[[False, False], [True, True], [False, True]]])
    points = np.ma.array(values, mask=mask)
    expected = [[1, 2, NAN, NAN, NAN, NAN]]
    assert_array_equal(pack_tracks(points), expected)
    assert_array_equal(pack_tracks(list(points)), expected)
    packed, seen = unpack_tracks(points.reshape(1, 6))
    assert_array_equal(seen, [[True, False, False]])
    assert_array_equal(packed.reshape(1, 6), expected)
    assert_array_equal(points.data, values)
    assert_array_equal(points.mask, mask)


def test_masked_numbers_can_be_anything():
    points = np.ma.masked_invalid([[[1.0, 2.0], [INF, NAN]]])
    assert_array_equal(pack_tracks(points), [[1, 2, NAN, NAN]])


@pytest.mark.parametrize("values", [[[True, True]], [[1, 1]]])
def test_masked_visibility_is_unseen(values):
    visibility = np.ma.array(values, mask=[[False, True]])
    X = pack_tracks([[[1.0, 2.0], [3.0, 4.0]]], visibility)
    assert_array_equal(X, [[1, 2, NAN, NAN]])


class Tensor:
    """What of a tensor on another device, with a gradient, a conversion needs."""

    def __init__(self, values):
        self.values = np.asarray(values)

    def __array__(self, dtype=None, copy=None):
        raise TypeError("can't convert cuda:0 device type tensor to numpy")

    def detach(self):
        return self

    cpu = detach

    def numpy(self):
        return self.values


@pytest.mark.parametrize("wrap", [np.asarray, Tensor])
@pytest.mark.parametrize("batch", [False, True])
@pytest.mark.parametrize("kind", [bool, float, np.uint8])
@pytest.mark.parametrize("last_axis", [False, True])
def test_frames_first(rng, wrap, batch, kind, last_axis):
    """CoTracker's (1, n_frames, n_tracks, 2), and its visibility, in one call."""
    points, visibility = random_tracks(rng)
    pred_tracks = points.swapaxes(0, 1)
    pred_visibility = visibility.T.astype(kind)
    if batch:
        pred_tracks, pred_visibility = pred_tracks[None], pred_visibility[None]
    if last_axis:
        pred_visibility = pred_visibility[..., None]
    X = pack_tracks(wrap(pred_tracks), wrap(pred_visibility), layout="frames_first")
    assert_array_equal(X, pack_tracks(points, visibility))


@pytest.mark.parametrize("batch", [False, True])
def test_tracks_first(rng, batch):
    """TAPIR's ([1, ]n_tracks, n_frames, 2)."""
    points, visibility = random_tracks(rng)
    tracks, visibles = (
        (points[None], visibility[None]) if batch else (points, visibility)
    )
    X = pack_tracks(tracks, visibles, layout="tracks_first")
    assert_array_equal(X, pack_tracks(points, visibility))
    assert_array_equal(pack_tracks(tracks, visibility, layout="tracks_first"), X)


@pytest.mark.parametrize("shape", [(1, 1), (1, 5), (5, 1)])
def test_axes_of_length_one_are_not_taken_for_a_batch(rng, shape):
    points, visibility = random_tracks(rng, *shape)
    X = pack_tracks(points, visibility)
    assert X.shape == (shape[0], 2 * shape[1])
    args = points.swapaxes(0, 1)[None], visibility.T[None]
    assert_array_equal(pack_tracks(*args, layout="frames_first"), X)


def test_points_that_look_like_frames_first_are_warned_of(rng):
    """Unless it is said, they fit, or there are too few to cover anything."""
    across = 300 * rng.random((40, 1, 2)) + np.arange(12)[:, None]  # as tracks move
    seen = np.ones((40, 12), dtype=bool)
    swapped = across.swapaxes(0, 1), seen.T
    with pytest.warns(UserWarning, match="the 12 tracks of 40 frames .*frames_first"):
        as_they_are = pack_tracks(*swapped)
    assert as_they_are.shape == (12, 80)
    for layout in LAYOUTS:
        pack_tracks(*swapped, layout=layout)
    pack_tracks(across, seen)
    pack_tracks(across[:10], seen[:10])  # fewer tracks than frames
    pack_tracks(swapped[0][:2], swapped[1][:2])


def test_probabilities_are_seen_above_a_number():
    points, probability = np.ones((1, 4, 2)), [[0.2, 0.5, 0.51, 1.0]]
    X = pack_tracks(points, probability, visible_above=0.5)
    assert_array_equal(np.isnan(X[0, ::2]), [True, True, False, False])
    X = pack_tracks(points, np.ma.masked_greater(probability, 0.9), visible_above=0.5)
    assert_array_equal(np.isnan(X[0, ::2]), [True, True, False, True])
    with pytest.raises(ValueError, match=r"0 or 1; .*visible_above=0.5"):
        pack_tracks(points, probability)
    with pytest.raises(ValueError, match="numbers throughout; got NaN"):
        pack_tracks(points, [[0.2, 0.5, NAN, 1.0]], visible_above=0.5)
    with pytest.raises(ValueError, match="got no visibility"):
        pack_tracks(points, visible_above=0.5)
    with pytest.raises(TypeError, match="visible_above must be a number; got 'x'"):
        pack_tracks(points, np.ones((1, 4), dtype=bool), visible_above="x")


@pytest.mark.parametrize("layout", [None, "tracks_first", "frames_first"])
def test_a_batch_of_videos_is_an_error(layout):
    words = r"got \(2, 3, 4, 2\), a batch of 2 videos: pack one at a time"
    with pytest.raises(ValueError, match=words):
        pack_tracks(np.zeros((2, 3, 4, 2)), layout=layout)


def test_a_batch_does_not_tell_its_layout():
    words = r"shape \(1, 3, 4, 2\) .* TAPIR.* CoTracker.* layout=\"frames_first\""
    with pytest.raises(ValueError, match=words):
        pack_tracks(np.zeros((1, 3, 4, 2)))


def test_other_layouts_are_an_error():
    with pytest.raises(ValueError, match=r"layout must be one of .*; got 'btnc'"):
        pack_tracks(np.zeros((3, 4, 2)), layout="btnc")


@pytest.mark.parametrize("layout", ["tracks_first", "frames_first"])
def test_visibility_the_other_way_round_is_an_error(layout):
    words = r"= \(3, 4\); got \(4, 3\): one has tracks first, the other frames first"
    with pytest.raises(ValueError, match=words):
        pack_tracks(np.zeros((3, 4, 2)), np.ones((4, 3)), layout=layout)


# ------------------------------------------------------------------------- bad tracks


def test_an_odd_number_of_columns_is_an_error():
    with pytest.raises(ValueError, match="two columns per frame; got 41 columns"):
        unpack_tracks(np.zeros((3, 41)))


@pytest.mark.parametrize("shape", [(4,), (2, 3, 2)])
def test_tracks_that_are_no_matrix_are_an_error(shape):
    with pytest.raises(ValueError, match=f"got an array of {len(shape)} axes"):
        unpack_tracks(np.zeros(shape))


# ------------------------------------------------------------------------ frame pairs


@pytest.mark.parametrize(
    ("n_frames", "gap", "expected"),
    [
        (4, 1, [[0, 1], [1, 2], [2, 3]]),
        (5, 3, [[0, 3], [1, 4]]),
        (2, 1, [[0, 1]]),
    ],
)
def test_frame_pairs_are_a_gap_apart(n_frames, gap, expected):
    assert_array_equal(frame_pairs(n_frames, gap), expected)


def test_a_gap_as_long_as_the_video_leaves_no_pair():
    assert frame_pairs(3, 3).shape == (0, 2)


# --------------------------------------------------------------- normalised coordinates


def test_the_normalisation_equals_the_textbook(rng):
    points = rng.uniform(0, 640, size=(20, 2))
    assert_allclose(normalization(points), textbook.normalization(points))


def test_normalised_points_have_centroid_0_and_mean_distance_root_2(rng):
    points = rng.uniform(0, 640, size=(20, 2))
    normalized = apply_similarity(normalization(points), points)
    assert_allclose(normalized.mean(axis=0), 0, atol=1e-13)
    assert_allclose(np.linalg.norm(normalized, axis=1).mean(), np.sqrt(2))


def test_normalised_points_do_not_depend_on_scale_and_place(rng):
    points = rng.uniform(0, 640, size=(20, 2))
    other = 0.03 * points - [1000, 5]
    assert_allclose(
        apply_similarity(normalization(other), other),
        apply_similarity(normalization(points), points),
        atol=1e-9,
    )


SPOTS = [(0.0, 0.0), (100.0, 50.0), (0.1, 0.2), (1e3 / 3, 7.7)]


@pytest.mark.parametrize("n", [1, 3, 9])
@pytest.mark.parametrize("spot", SPOTS)
def test_points_in_one_spot_are_only_shifted(spot, n):
    """The mean of equal numbers is not always that number."""
    x, y = spot
    T = normalization(np.tile(spot, (n, 1)))
    assert_allclose(T, [[1, 0, -x], [0, 1, -y], [0, 0, 1]])


def test_a_similarity_moves_its_centre_to_zero(rng):
    points = rng.normal(size=(5, 2))
    T = similarity(3.0, points[2])
    mapped = apply_similarity(T, points)
    assert_allclose(mapped, 3 * (points - points[2]), atol=1e-12)
    assert_allclose(mapped, [textbook.transform(T, point) for point in points])


# ------------------------------------------------------------------ working coordinates


def test_working_coordinates_are_those_of_the_points_seen(rng):
    points, visibility = random_tracks(rng)
    points[~visibility] = NAN
    centres, scale = working_coordinates(points, visibility)
    seen = [points[visibility[:, f], f] for f in range(4)]
    assert_allclose(centres, [p.mean(axis=0) for p in seen])
    offsets = [p - p.mean(axis=0) for p in seen]
    assert_allclose(scale, np.abs(np.concatenate(offsets)).mean())


def test_a_frame_that_sees_nothing_has_its_centre_at_zero(rng):
    points, _ = random_tracks(rng)
    visibility = np.ones((7, 4), dtype=bool)
    visibility[:, 2] = False
    centres, scale = working_coordinates(points, visibility)
    assert_array_equal(centres[2], 0)
    assert centres[[0, 1, 3]].all()
    assert scale > 1


def test_no_points_at_all_have_scale_one():
    centres, scale = working_coordinates(
        np.full((3, 2, 2), NAN), np.zeros((3, 2), bool)
    )
    assert_array_equal(centres, np.zeros((2, 2)))
    assert scale == 1


@pytest.mark.parametrize("away", [1e5, -1e9])
def test_what_is_astray_moves_no_centre(rng, away):
    points, visibility = rng.uniform(0, 500, (40, 4, 2)), np.ones((40, 4), dtype=bool)
    lost = points.copy()
    lost[3, 1] = away
    seen = visibility.copy()
    seen[3, 1] = False
    expected = working_coordinates(points, seen)
    for found, right in zip(
        working_coordinates(lost, visibility), expected, strict=True
    ):
        assert_allclose(found, right)


@pytest.mark.parametrize("n", [1, 3, 9])
@pytest.mark.parametrize("spot", SPOTS)
def test_tracks_in_one_spot_have_scale_one(spot, n):
    points = np.tile(spot, (n, 2, 1))
    centres, scale = working_coordinates(points, np.ones((n, 2), dtype=bool))
    assert_allclose(centres, [spot, spot])
    assert scale == 1


def test_pairs_of_a_video_are_the_usual_ones():
    visibility = np.ones((20, 5), dtype=bool)
    visibility[:3, 2:] = False
    usual = frame_pairs(5)
    assert covisible_pairs(visibility, usual) is usual
    assert covisible_pairs(np.eye(5, dtype=bool), usual) is usual  # none is seen twice


def test_pairs_of_photographs_see_the_same_tracks():
    usual = frame_pairs(4)
    visibility = np.zeros((30, 4), dtype=bool)
    visibility[:12, [0, 2]] = visibility[12:22, [1, 3]] = visibility[22:, :2] = True
    assert_array_equal(covisible_pairs(visibility, usual), [[0, 1], [0, 2], [1, 3]])


def test_pairs_are_added_for_tracks_with_gaps():
    usual = frame_pairs(6)
    visibility = np.ones((40, 6), dtype=bool)
    visibility[:4, 1::2] = False  # seen in frames 0, 2 and 4
    visibility[4:6, [0, 2, 3, 4]] = False  # in frames 1 and 5
    visibility[6, 1:] = False  # in one frame, which is no pair
    pairs = covisible_pairs(visibility, usual)
    assert_array_equal(pairs, [*usual.tolist(), [0, 2], [1, 5]])
    # A pair that fewer than eight tracks share shows no motion.
    few = np.concatenate([visibility[:4], np.tile(np.arange(6) % 2 == 1, (60, 1))])
    assert covisible_pairs(few, np.array([[1, 3]])).tolist() == [[1, 3]]
    four_more = np.concatenate([few, visibility[:4]])
    found = covisible_pairs(four_more, np.array([[1, 3]])).tolist()
    assert found == [[1, 3], [0, 2]]


def test_pairs_of_many_photographs_are_those_with_most_in_common(rng):
    n_frames = 12
    visibility = rng.uniform(size=(400, n_frames)) < 0.15
    visibility[:, -1] = False
    visibility[:2, [0, -1]] = True  # the last is seen with the first alone
    pairs = covisible_pairs(visibility, frame_pairs(n_frames))
    assert len(pairs) <= 24 + n_frames + 24
    assert set(pairs.ravel().tolist()) == set(range(n_frames))
    assert (pairs[:, 0] < pairs[:, 1]).all()
    taken = {tuple(pair) for pair in pairs.tolist()}
    common = {
        (i, j): (visibility[:, i] & visibility[:, j]).sum()
        for i in range(n_frames)
        for j in range(i + 1, n_frames)
    }
    least = sorted(common.values())[-24]
    assert all(pair in taken for pair, n in common.items() if n > least)
    assert all(common[pair] > 0 for pair in taken)
    # Tracks that none of these sees are seen in pairs that share eight tracks or more.
    missed = visibility[visibility.sum(axis=1) > 1].copy()
    for i, j in taken:
        missed = missed[~(missed[:, i] & missed[:, j])]
    for (i, j), n in common.items():
        assert n < 8 or not (missed[:, i] & missed[:, j]).any()


# ----------------------------------------------------------------------------- shots


def seen_in(*spans, n_frames=12):
    """Tracks, so many from one frame to another each."""
    rows = [
        np.tile((np.arange(n_frames) >= start) & (np.arange(n_frames) < stop), (n, 1))
        for n, start, stop in spans
    ]
    return np.concatenate(rows)


@pytest.mark.parametrize(
    ("spans", "ends"),
    [
        ([(10, 0, 12)], [(0, 12)]),
        ([(10, 0, 5), (10, 5, 12)], [(0, 5), (5, 12)]),
        ([(10, 0, 5), (10, 5, 8), (10, 8, 12)], [(0, 5), (5, 8), (8, 12)]),
        ([(10, 0, 5), (10, 5, 12), (3, 2, 9)], [(0, 5), (5, 12)]),  # by chance
        ([(10, 0, 5), (10, 5, 12), (4, 2, 9)], [(0, 12)]),
        ([(10, 0, 12), (90, 5, 12)], [(0, 12)]),  # many that are new are no cut
        ([(90, 0, 5), (10, 0, 12)], [(0, 12)]),
        ([(10, 0, 5), (10, 7, 12)], [(0, 12)]),  # nothing is seen in between
    ],
)
def test_shots_are_parted_where_few_tracks_go_on(spans, ends):
    visibility = seen_in(*spans)
    assert shots(visibility) == ends
    assert shots(np.concatenate([visibility, np.zeros_like(visibility)])) == ends


def test_gaps_are_no_cuts():
    visibility = seen_in((10, 0, 12))
    visibility[:, 1::2] = False
    assert shots(visibility) == [(0, 12)]
    assert shots(np.zeros((3, 4), dtype=bool)) == [(0, 4)]


@pytest.mark.parametrize("visible_above", [-0.1, 1.0, 2, np.nan])
def test_what_is_seen_is_above_a_probability(visible_above):
    with pytest.raises(ValueError, match="visible_above must be a probability"):
        pack_tracks(np.ones((1, 2, 2)), [[0.9, 0.9]], visible_above=visible_above)
