"""Synthetic scenes, and files as their authors write them."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
import scipy.io
from helpers.track_files import (
    TRACKER_FILES,
    cell,
    homogeneous_pixels,
    observations,
    write_struct,
)
from numpy.testing import assert_allclose, assert_array_equal
from sklearn.utils import Bunch

from skmotionseg import pack_tracks, unpack_tracks
from skmotionseg.datasets import (
    load_adelaide,
    load_arrigoni,
    load_hopkins12,
    load_hopkins155,
    load_kt3dmoseg,
    load_mtpv62,
    load_tracks,
    make_rigid_motions,
)

# ------------------------------------------------------------------- synthetic scenes


@pytest.mark.parametrize(
    "n_tracks, n_motions, outliers, sizes, n_outliers",
    [
        (70, 3, 0, [40, 20, 10], 0),
        (63, 6, 0, [32, 16, 8, 4, 2, 1], 0),
        (4, 4, 0, [1, 1, 1, 1], 0),
        (50, 1, 0, [50], 0),
        (100, 2, 0.1, [60, 30], 10),
        (71, 3, 0, [41, 20, 10], 0),
        (8, 8, 0, [1] * 8, 0),
        (20, 12, 0, [5, 4, 2, *[1] * 9], 0),
    ],
)
def test_shapes_and_sizes(n_tracks, n_motions, outliers, sizes, n_outliers):
    X, y = make_rigid_motions(
        n_tracks, 7, n_motions, outliers=outliers, missing=0, random_state=0
    )
    assert X.shape == (n_tracks, 14)
    assert X.dtype == np.float64
    assert y.dtype.kind == "i"
    assert np.bincount(y[y >= 0]).tolist() == sizes
    assert (y == -1).sum() == n_outliers


def test_motions_are_shuffled():
    _, y = make_rigid_motions(random_state=0)
    assert (np.diff(y) != 0).mean() > 0.3


def test_a_seed_gives_its_scene():
    (X, y), (again, y_again), (other, _) = (
        make_rigid_motions(outliers=0.1, random_state=seed) for seed in (0, 0, 1)
    )
    assert_array_equal(X, again)
    assert_array_equal(y, y_again)
    assert not np.allclose(X, other, equal_nan=True)


@pytest.mark.parametrize(
    "n_frames, missing",
    [
        (n_frames, missing)
        for n_frames in (3, 5, 10, 20, 40)
        for missing in (0, 0.1, 0.25, 0.5, 0.75, 0.9)
        if missing <= 1 - 2 / n_frames  # each track is seen twice
    ],
)
@pytest.mark.parametrize("seed", range(3))
def test_the_share_that_is_missing(n_frames, missing, seed):
    X, _ = make_rigid_motions(400, n_frames, missing=missing, random_state=seed)
    assert abs(np.isnan(X).mean() - missing) < 0.02


@pytest.mark.parametrize("missing", [0, 0.25, 0.9])
@pytest.mark.parametrize("n_frames", [2, 3, 10])
def test_a_track_is_seen_in_one_run_of_two_frames_or_more(n_frames, missing):
    X, _ = make_rigid_motions(
        200, n_frames, missing=missing, outliers=0.2, random_state=0
    )
    _, seen = unpack_tracks(X)
    runs = np.diff(np.pad(seen, ((0, 0), (1, 1))).astype(int), axis=1)
    assert (seen.sum(axis=1) >= 2).all()
    assert ((runs == 1).sum(axis=1) == 1).all()
    if missing and n_frames > 2:  # tracks come late, and others go early
        assert not seen[:, 0].all()
        assert not seen[:, -1].all()


def two_frames(X, rows, frames=(0, -1)):
    points, _ = unpack_tracks(X)
    return points[rows][:, list(frames)].transpose(1, 0, 2)


def homogeneous(x):
    """Points normalised to centroid 0 and unit scale, as (n, 3)."""
    x = (x - x.mean(axis=0)) / x.std()
    return np.column_stack([x, np.ones(len(x))])


def smallest_singular_value(rows):
    """How far the rows are from one model that all obey; 0 is exact."""
    singular = np.linalg.svd(rows, compute_uv=False)
    return singular[-1] / singular[0]


def homography_misfit(x, y):
    """Of the DLT system (Hartley and Zisserman 2004, eq. 4.1)."""
    x, y = homogeneous(x), homogeneous(y)
    zero = np.zeros_like(x)
    return smallest_singular_value(
        np.vstack(
            [
                np.hstack([zero, -x, y[:, 1:2] * x]),
                np.hstack([x, zero, -y[:, :1] * x]),
            ]
        )
    )


def fundamental_misfit(x, y):
    """Of the eight-point system (Hartley and Zisserman 2004, eq. 11.3)."""
    x, y = homogeneous(x), homogeneous(y)
    return smallest_singular_value((y[:, :, None] * x[:, None]).reshape(len(x), 9))


EXACT, CLEAR = 1e-12, 1e-5


def exact_scene(motion, **scene):
    X, y = make_rigid_motions(100, 5, 2, missing=0, noise=0, random_state=0, **scene)
    return two_frames(X, y == motion)


@pytest.mark.parametrize("motion", [0, 1])
@pytest.mark.parametrize("camera", ["general", "rotation", "still"])
def test_a_plane_obeys_one_homography(motion, camera):
    scene = exact_scene(motion, shapes="planar", camera=camera)
    assert homography_misfit(*scene) < EXACT


@pytest.mark.parametrize("motion", [0, 1])
def test_a_volume_obeys_one_fundamental_matrix_and_no_homography(motion):
    scene = exact_scene(motion, shapes="general")
    assert fundamental_misfit(*scene) < EXACT
    assert homography_misfit(*scene) > CLEAR


def test_two_motions_obey_no_common_fundamental_matrix():
    X, _ = make_rigid_motions(100, 5, 2, missing=0, noise=0, random_state=0)
    assert fundamental_misfit(*two_frames(X, slice(None))) > CLEAR


def test_the_background_of_a_turning_camera_obeys_one_homography():
    background, thing = (
        exact_scene(motion, shapes="general", camera="rotation") for motion in (0, 1)
    )
    assert homography_misfit(*background) < EXACT
    assert homography_misfit(*thing) > CLEAR


def test_the_background_of_a_still_camera_stands_still():
    x, y = exact_scene(0, camera="still")
    assert_allclose(x, y, atol=1e-9)
    x, y = exact_scene(1, camera="still")
    assert np.abs(x - y).max() > 10


@pytest.mark.parametrize("noise", [0.1, 0.5, 3.0])
def test_noise_is_the_standard_deviation_of_a_coordinate(noise):
    X, y = make_rigid_motions(
        400, 20, camera="still", missing=0, noise=noise, random_state=0
    )
    still = X[y == 0].reshape(-1, 20, 2)
    assert_allclose(still.std(axis=1, ddof=1).mean(), noise, rtol=0.03)


def test_outliers_obey_no_model():
    X, y = make_rigid_motions(
        200, 4, 1, shapes="planar", missing=0, noise=0, outliers=0.2, random_state=0
    )
    assert homography_misfit(*two_frames(X, y == 0)) < EXACT
    assert fundamental_misfit(*two_frames(X, y == -1)) > CLEAR


def test_the_background_is_in_the_image_in_mid_clip():
    X, y = make_rigid_motions(n_frames=5, missing=0, noise=0, random_state=0)
    points = X[y == 0].reshape(-1, 5, 2)
    assert ((points[:, 2] >= 0) & (points[:, 2] <= [1280, 720])).all()
    assert (points[:, [0, 4]] != points[:, [2]]).all()


# --------------------------------------------------------------- files of one's own


@pytest.fixture
def tracks():
    """Five tracks in four frames, some unseen: (points, visibility, X)."""
    rng = np.random.default_rng(0)
    points = rng.uniform(0, 500, size=(5, 4, 2))
    visibility = np.ones((5, 4), dtype=bool)
    visibility[[0, 1, 4], [0, 3, 2]] = False
    return points, visibility, pack_tracks(points, visibility)


LABELS = np.array([0, 1, -1, 0, 2])


def test_npz_of_points_and_visibility(tracks, tmp_path):
    points, visibility, X = tracks
    path = tmp_path / "clip.npz"
    np.savez(path, points=points, visibility=visibility, labels=LABELS)
    loaded = load_tracks(path)
    assert isinstance(loaded, Bunch)
    assert loaded.name == "clip"
    assert_array_equal(loaded.data, X)
    assert_array_equal(loaded.target, LABELS)


def test_npz_of_points_with_nan(tracks, tmp_path):
    *_, X = tracks
    path = tmp_path / "clip.npz"
    np.savez_compressed(path, points=X.reshape(5, 4, 2).astype(np.float32))
    loaded = load_tracks(str(path))
    assert_allclose(loaded.data, X, rtol=1e-6)
    assert loaded.target is None


def test_npz_of_tracks(tracks, tmp_path):
    *_, X = tracks
    path = tmp_path / "clip.NPZ"
    with path.open("wb") as file:
        np.savez(file, X=X, labels=LABELS.astype(float))
    loaded = load_tracks(path)
    assert_array_equal(loaded.data, X)
    assert_array_equal(loaded.target, LABELS)
    assert loaded.target.dtype.kind == "i"


# By name: the arrays of a file, made of points and visibility with tracks first.


@pytest.mark.parametrize("tracker", TRACKER_FILES)
def test_npz_of_trackers(tracks, tracker, tmp_path):
    points, visibility, X = tracks
    path = tmp_path / "clip.npz"
    np.savez(path, **TRACKER_FILES[tracker](points, visibility), labels=LABELS)
    given = {"layout": "tracks_first"} if tracker == "with a layout" else {}
    loaded = load_tracks(path, **given)
    assert_allclose(loaded.data, X)
    assert_array_equal(loaded.target, LABELS)


def test_both_logits_of_tapir_count_as_its_authors_have_it(tmp_path):
    """(1 - sigmoid(occlusion)) (1 - sigmoid(expected_dist)) > 0.5"""
    path = tmp_path / "clip.npz"
    occlusion, expected_dist = np.array([[-0.9, -0.8, -9.0], [-0.9, -0.8, 0.1]])[
        :, None
    ]
    arrays = {"tracks": np.ones((1, 3, 2)), "occlusion": occlusion}
    np.savez(path, **arrays, expected_dist=expected_dist)
    seen = unpack_tracks(load_tracks(path).data)[1]
    assert_array_equal(seen, [[True, False, False]])  # 0.5055, 0.4755, 0.4749
    np.savez(path, **arrays)
    assert unpack_tracks(load_tracks(path).data)[1].all()
    seen = unpack_tracks(load_tracks(path, visible_above=0.7).data)[1]
    assert_array_equal(seen, [[True, False, True]])  # 0.711, 0.690, 1.000


def test_names_that_do_not_tell_the_layout(tracks, tmp_path):
    points, visibility, X = tracks
    path = tmp_path / "clip.npz"
    np.savez(path, tracks=points.swapaxes(0, 1), visibility=visibility.T)
    with pytest.raises(ValueError, match=r"'tracks' of shape \(4, 5, 2\).* layout="):
        load_tracks(path)
    assert_array_equal(load_tracks(path, layout="frames_first").data, X)


def test_probabilities_in_a_file(tracks, tmp_path):
    points, visibility, X = tracks
    path = tmp_path / "clip.npz"
    probability = np.where(visibility, 0.95, 0.85).T
    np.savez(path, pred_tracks=points.swapaxes(0, 1), pred_visibility=probability)
    with pytest.raises(ValueError, match="visible_above"):
        load_tracks(path)
    assert_array_equal(load_tracks(path, visible_above=0.9).data, X)


FLAGS = {
    "visible": lambda seen: seen,
    "vis": lambda seen: seen.astype(float),
    "pred_visibilities": lambda seen: seen,
    "occlusion": lambda seen: ~seen,
    "occlusions": lambda seen: 1.0 - seen,
}


@pytest.mark.parametrize("name", FLAGS)
@pytest.mark.parametrize("points_name", ["points", "X"])
def test_what_is_unseen_has_many_names(tracks, name, points_name, tmp_path):
    """And is flags as well as logits, which are not all 0 or 1."""
    points, visibility, X = tracks
    path = tmp_path / "clip.npz"
    given = points if points_name == "points" else points.reshape(len(X), -1)
    np.savez(path, **{points_name: given, name: FLAGS[name](visibility)})
    assert_allclose(load_tracks(path).data, X)


def test_a_matrix_has_no_layout(tracks, tmp_path):
    path = tmp_path / "clip.npz"
    np.savez(path, X=tracks[-1])
    with pytest.raises(ValueError, match="layout is for points of three"):
        load_tracks(path, layout="tracks_first")
    with pytest.raises(ValueError, match="visible_above is about visibility"):
        load_tracks(path, visible_above=0.5)


@pytest.mark.parametrize("ids", [[7, 2**60, 1, 3, 4], np.arange(5.0)])
def test_ids_of_an_archive(tracks, ids, tmp_path):
    path = tmp_path / "clip.npz"
    np.savez(path, X=tracks[-1], track_ids=ids)
    assert_array_equal(load_tracks(path).track_ids, ids)
    np.savez(path, X=tracks[-1], track_ids=ids[:4])
    with pytest.raises(ValueError, match="'track_ids' must be one per track"):
        load_tracks(path)


def test_shares_of_an_image_of_unknown_size(tracks, tmp_path):
    points, visibility, X = tracks
    path = tmp_path / "clip.npz"
    np.savez(path, points=points / [640, 512], occluded=~visibility)
    with pytest.raises(ValueError, match=r"in \[0, 1\].*image_size=\(width, height\)"):
        load_tracks(path)
    assert_allclose(load_tracks(path, image_size=(640, 512)).data, X)
    for size in ((640,), 640, "hd", ("a", "b"), (0, 512), (np.nan, 512), (640, 1j)):
        with pytest.raises(ValueError, match="image_size must be width and height"):
            load_tracks(path, image_size=size)
    np.savez(path, points=points, visibility=visibility)
    with pytest.raises(ValueError, match="image_size is for points that are shares"):
        load_tracks(path, image_size=(640, 512))


def test_the_video_of_a_file_is_not_read(tracks, tmp_path):
    """Zeros are small in a file and large in memory."""
    points, visibility, X = tracks
    path = tmp_path / "clip.npz"
    video = np.zeros((4, 512, 640, 3), np.uint8)
    arrays = {"points": points / [640, 512], "occluded": ~visibility, "video": video}
    np.savez_compressed(path, **arrays)
    tracemalloc.start()
    assert_allclose(load_tracks(path).data, X)
    assert tracemalloc.get_traced_memory()[1] < video.nbytes / 2
    tracemalloc.stop()


@pytest.mark.parametrize("ending", ["pkl", "pickle", "pt", "PTH"])
def test_pickles_are_not_read(ending, tmp_path):
    path = tmp_path / f"tapvid_davis.{ending}"
    path.write_bytes(b"cos\nsystem\n(S'exit 1'\ntR.")
    with pytest.raises(ValueError, match=r"is a pickle, .*numpy.savez"):
        load_tracks(path)


def test_options_are_of_the_kinds_of_files_that_take_them(tmp_path):
    path = tmp_path / "clip.csv"
    path.write_text("0,0,1,1\n")
    words = r"layout is for .npz and .npy files; got 'clip.csv'"
    with pytest.raises(ValueError, match=words):
        load_tracks(path, layout="frames_first")
    with pytest.raises(ValueError, match=r"visible_above is for .npz files"):
        load_tracks(path, visible_above=0.5)


@pytest.fixture
def tracked():
    """A scene's tracks, as of a tracker: (points, visibility, X)."""
    X, _ = make_rigid_motions(n_tracks=40, n_frames=6, random_state=0)
    return *unpack_tracks(X), X


def test_tracks_with_visibility_and_a_batch_axis_are_cotrackers(tracked, tmp_path):
    points, visibility, X = tracked
    path = tmp_path / "clip.npz"
    arrays = {"tracks": points.swapaxes(0, 1)[None], "visibility": visibility.T[None]}
    np.savez(path, **arrays)
    assert_array_equal(load_tracks(path).data, X)


def test_tracks_first_with_a_batch_axis_are_not_taken_for_cotrackers(tracked, tmp_path):
    points, visibility, _ = tracked
    path = tmp_path / "clip.npz"
    np.savez(path, tracks=points[None], visibility=visibility[None])
    with pytest.raises(ValueError, match="may have tracks or frames first"):
        load_tracks(path)


@pytest.mark.parametrize("form", ["packed", "points", "frames first", "one video"])
def test_npy(tracks, tmp_path, form):
    *_, X = tracks
    points = X.reshape(5, 4, 2)
    array, given = {
        "packed": (X, {}),
        "points": (points, {}),
        "frames first": (points.swapaxes(0, 1), {"layout": "frames_first"}),
        "one video": (points[None], {"layout": "tracks_first"}),
    }[form]
    path = tmp_path / "clip.npy"
    np.save(path, array)
    loaded = load_tracks(path, **given)
    assert_array_equal(loaded.data, X)
    assert loaded.data.flags.writeable


def test_npy_that_is_something_else(tmp_path):
    path = tmp_path / "clip.npy"
    np.save(path, np.array([{}]), allow_pickle=True)
    with pytest.raises(ValueError, match=r"clip.npy is not a track file"):
        load_tracks(path)
    with path.open("wb") as file:
        np.savez(file, X=np.ones((3, 4)))
    with pytest.raises(ValueError, match="it is an archive of arrays: rename it"):
        load_tracks(path)
    path.write_text("0.5,1.5\n")
    with pytest.raises(ValueError, match="it does not start like a file that numpy"):
        load_tracks(path)


SHAPES = {
    (5, 4, 3): "three numbers instead of x and y.*points\\[..., :2\\]",
    (2, 5, 4): "x and y must be the last axis.*moveaxis\\(points, -3, -1\\)",
    (5, 2, 4): "x and y must be the last axis.*moveaxis\\(points, -2, -1\\)",
    (3, 5, 4, 2): "a batch of 3 videos",
}


@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_shapes_say_what_is_wrong(shape, tmp_path):
    path = tmp_path / "clip.npz"
    np.savez(path, points=np.full(shape, 7.0))
    with pytest.raises(ValueError, match=SHAPES[shape]):
        load_tracks(path)


def test_a_matrix_is_packed_already():
    with pytest.raises(ValueError, match="two columns per frame is already packed"):
        pack_tracks(np.full((5, 8), 7.0))


def test_swapped_visibility_is_named(tracks, tmp_path):
    points, visibility, _ = tracks
    path = tmp_path / "clip.npz"
    np.savez(path, points=points, visibility=visibility.T)
    with pytest.raises(ValueError, match=r"frames first; pass visibility.T"):
        load_tracks(path)


@pytest.mark.parametrize("ending", ["npz", "npy", "csv"])
def test_normalised_coordinates_are_noticed(tracked, tmp_path, ending):
    *_, X = tracked
    size = np.tile([1280, 720], X.shape[1] // 2)
    path = tmp_path / f"clip.{ending}"
    write = {
        "npz": lambda: np.savez(path, X=X / size),
        "npy": lambda: np.save(path, X / size),
        "csv": lambda: np.savetxt(path, X / size, delimiter=","),
    }
    write[ending]()
    words = r"all coordinates in clip.* not pixels.*--image-size WIDTH HEIGHT"
    with pytest.warns(UserWarning, match=words):
        load_tracks(path)
    assert_allclose(load_tracks(path, image_size=(1280, 720)).data, X)


@pytest.mark.parametrize("index", [True, False])
@pytest.mark.parametrize("names", ["numbers", "x and y"])
def test_csv_of_pandas(tracks, tmp_path, index, names):
    pandas = pytest.importorskip("pandas")
    *_, X = tracks
    columns = [f"{axis}{frame}" for frame in range(4) for axis in "xy"]
    table = pandas.DataFrame(X, columns=None if names == "numbers" else columns)
    table.index += 100
    path = tmp_path / "clip.csv"
    table.to_csv(path, index=index)
    loaded = load_tracks(path)
    assert_array_equal(loaded.data, X)
    assert loaded.target is None
    if index:
        assert_array_equal(loaded.track_ids, 100 + np.arange(5))
    table["label"] = LABELS
    table.to_csv(path, index=index)
    loaded = load_tracks(path)
    assert_array_equal(loaded.data, X)
    assert_array_equal(loaded.target, LABELS)


HEADERS = {
    "x0,x1,y0,y1\n1,2,3,4\n": "x and y of the first frame.* got x0, x1, y0, y1",
    "x0,y0,x1\n1,2,3\n": "two columns per frame; got 3 columns",
    "x0,y0,x1,y1\n": "no tracks below its header",
    "0,1,2.5,what\n1,2,3,4\n": "could not convert string to float: 'what'",
    "particle,step,x,y\n0,0,1.5,2\n": "columns track, frame, x, y; got particle, step",
    "track_id,frame,u,v\n5,0,1.5,2\n5,1,2,2\n": (
        "row per observation needs the columns track, frame, x, y; got track_id, frame"
    ),
    "id,t,pos_x,pos_y\n5,9,1,2\n7,3,2,2\n": "x, y; got id, t, pos_x, pos_y",
    "track,frame,u,v,score\n5,0,1.5,2,0.9\n": "x, y; got track, frame, u, v, score",
    "x1,y1,x0,y0\n1,2,3,4\n": "order of their frames, .* got y1 before x0",
    "id,x0,y0,x1,y1,x10,y10,x2,y2,label\n1,2,3,4,5,6,7,8,9,0\n": "got y10 before x2",
    "u0,u1,v0,v1\n1,2,3,4\n": "got u1 before v0",
    "track,x0,y0,x1,y1,score\n1,2,3,4,5,6\n": "x and y of each frame.* got 'score'",
    "track,quality,x0,y0\n1,2,3,4\n": "got 'quality' among them",
    "x0,y0,v0,x1,y1,v1\n1,2,1,3,4,1\n": "got 'v0', 'v1' among them",
    "a,b,label,label\n1,2,3,4\n": "got 'label' among them",
    "a,id\n1,2\n": "got 'id' among them",
    "track,label\n1,2\n": "columns of x and y of each frame; got none",
    "track,label,probability\n1,2,0.5\n": "two columns per frame; got 1 column",
    "0,0,1.5,2\n0,1,1.6,2\n1,0,7,7.5\n": "begin the file with the line track,frame",
    "37,4,1.5,2\n37,5,1.6,2\n52,4,7,7.5\n52,6,7,7\n": "begin the file with the line",
    "frame_id;point;px;py\n0;0;1.5;2\n1;0;1.6;2\n0;1;7;7.5\n1;1;7;7.6\n": (
        r"two of its four columns count, .* got frame_id, point, px, py"
    ),
    "1.5 2.5  3.5\n1.5 2.5\n": r"rows differ in length: \[2, 3\]",
    "id,t,x,y,visible\n0,0,1.5,2,0.3\n": "'visible' must be 0 or 1 in each row",
    "id,t,x,y\n0,0.5,1.5,2\n": "the column 'frame'",
    "id,t,x,y\n0,0,True,2\n": "could not convert string to float: 'True'",
}


@pytest.mark.parametrize("start, step", [(0, 1), (1, 1), (40, 1), (5, 8)])
def test_points_on_whole_pixels_in_the_first_of_two_frames(tmp_path, start, step):
    """Of dense flow, or of a grid: as whole as the numbers of tracks and frames."""
    path = tmp_path / "flow.csv"
    x, y = np.meshgrid(start + step * np.arange(9), start + step * np.arange(7))
    first = np.stack([x.ravel(), y.ravel()], axis=1)
    X = np.hstack([first, first + np.array([2.25, -0.5])])
    X[::5, 2:] = np.nan
    np.savetxt(path, X, delimiter=",")
    assert_array_equal(load_tracks(path).data, X)


@pytest.mark.parametrize(
    "first_track, step, first_frame", [(0, 1, 1), (37, 1, 12), (3, 5, 0)]
)
def test_observations_without_names_are_refused(
    tmp_path, first_track, step, first_frame
):
    path = tmp_path / "tracks.csv"
    X, _ = make_rigid_motions(12, 6, 2, missing=0, random_state=0)
    track, frame = np.divmod(np.arange(72), 6)
    counters = first_track + step * track, first_frame + frame
    np.savetxt(path, np.column_stack([*counters, X.reshape(-1, 2)]), delimiter=",")
    with pytest.raises(ValueError, match="begin the file with the line track,frame"):
        load_tracks(path)


@pytest.mark.parametrize("separator", [",", ";", "\t", " ", ", "])
def test_separators(tmp_path, separator):
    path = tmp_path / "clip.csv"
    X = np.arange(12.0).reshape(3, 4) / 7
    X[1, 2:] = np.nan
    for header in ("", separator.join(["x0", "y0", "x1", "y1"])):
        np.savetxt(path, X, delimiter=separator, header=header)
        assert_array_equal(load_tracks(path).data, X)
    if separator == ";":  # of a country with decimal commas
        path.write_text(path.read_text().replace(".", ","))
        assert_array_equal(load_tracks(path).data, X)
    rows = [[0, 0, 1.5, 2], [0, 1, 1.7, 2], [1, 0, 5, 5], [1, 1, 5, 6]]
    names = separator.join(["track", "frame", "x", "y"])
    np.savetxt(path, rows, delimiter=separator, header=names)
    assert_array_equal(load_tracks(path).data, [[1.5, 2, 1.7, 2], [5, 5, 5, 6]])


@pytest.mark.parametrize("name", ["X", "points", "tracks"])
def test_matrices_under_any_name(tmp_path, name):
    path = tmp_path / "clip.npz"
    X = np.arange(12.0).reshape(3, 4)
    visibility = np.array([[1, 1], [1, 0], [1, 1]])
    np.savez(path, **{name: X, "visibility": visibility})
    X[1, 2:] = np.nan
    assert_array_equal(load_tracks(path).data, X)
    with pytest.raises(ValueError, match=f"'{name}' has a row per track and two col"):
        load_tracks(path, layout="tracks_first")


@pytest.mark.parametrize("text", HEADERS, ids=repr)
def test_headers_that_do_not_fit(text, tmp_path):
    path = tmp_path / "clip.csv"
    path.write_text(text)
    with pytest.raises(ValueError, match=HEADERS[text]):
        load_tracks(path)


@pytest.mark.parametrize("ending", [".npz", ".npy"])
def test_swapped_axes_are_suspected(tmp_path, ending, recwarn):
    X, _ = make_rigid_motions(60, 8, 2, missing=0.2, random_state=0)
    points, _ = unpack_tracks(X)
    path = tmp_path / f"clip{ending}"
    save = np.save if ending == ".npy" else lambda path, a: np.savez(path, points=a)
    save(path, points.swapaxes(0, 1))
    with pytest.warns(UserWarning, match="8 tracks of 60 frames.*--layout frames_fir"):
        load_tracks(path)
    recwarn.clear()
    assert_array_equal(load_tracks(path, layout="frames_first").data, X)
    save(path, np.concatenate([points[:20].swapaxes(0, 1)] * 3))
    with pytest.warns(UserWarning, match="24 tracks of 20 frames.*--layout frames_fir"):
        load_tracks(path)  # as many frames as tracks, or more
    recwarn.clear()
    save(path, np.concatenate([points[:7]] * 2, axis=1))  # fewer tracks than frames
    assert load_tracks(path).data.shape == (7, 32)
    assert not recwarn.list


def test_tracks_of_one_thing_that_crosses_the_image_are_not_suspected(recwarn):
    rng = np.random.default_rng(0)
    places = np.linspace(0, 600, 40)[:, None] * [1, 0.2]
    points = rng.normal(0, 10, (60, 1, 2)) + places + rng.normal(0, 0.5, (60, 40, 2))
    pack_tracks(points)
    assert not recwarn.list


@pytest.mark.parametrize("by_frame", [False, True])
def test_csv_of_whole_pixels_without_names_is_refused(tmp_path, by_frame):
    track, frame = np.divmod(np.arange(60), 6)
    x, y = np.random.default_rng(0).integers(0, 500, (2, 60))
    table = np.column_stack([track, frame, x, y])
    if by_frame:
        table = table[np.lexsort((track, frame))]
    path = tmp_path / "whole.csv"
    np.savetxt(path, table, fmt="%d", delimiter=",")
    with pytest.raises(
        ValueError, match="begin the file with the line track,frame,x,y"
    ):
        load_tracks(path)
    np.savetxt(path, table[:, [2, 3, 2, 3]], fmt="%d", delimiter=",")
    assert load_tracks(path).data.shape == (60, 4)  # points of two frames


def test_csv_of_a_row_a_track(tracks, tmp_path):
    *_, X = tracks
    path = tmp_path / "clip.csv"
    path.write_text("\n".join(",".join(map(cell, row)) for row in X) + "\n\n")
    loaded = load_tracks(path)
    assert_array_equal(loaded.data, X)
    assert loaded.target is None


@pytest.mark.parametrize("first_frame", [0, 1, 250])
@pytest.mark.parametrize("shuffled", [False, True])
def test_csv_of_a_row_an_observation(tracks, tmp_path, first_frame, shuffled):
    *_, X = tracks
    path = tmp_path / "clip.csv"
    path.write_text(observations(X, LABELS, shuffled=shuffled, first_frame=first_frame))
    loaded = load_tracks(path)
    assert_array_equal(loaded.data, X[::-1])  # in the order of their numbers
    assert_array_equal(loaded.target, LABELS[::-1])


def test_csv_of_large_ids(tmp_path):
    """As they are in the file: as float, they would be one."""
    path = tmp_path / "clip.csv"
    ids = [2**60, 2**60 + 1]
    rows = [f"{name},{f},{f},{k}" for k, name in enumerate(ids) for f in range(3)]
    path.write_text("\n".join(["track,frame,x,y", *rows]))
    assert load_tracks(path).track_ids.tolist() == ids
    wide = [f"{name},1,2,3,4" for name in ids]
    path.write_text("\n".join(["id,x0,y0,x1,y1", *wide]))
    assert load_tracks(path).track_ids.tolist() == ids
    path.write_text(f"track,frame,x,y\n{2**63},0,1,1\n0,1,2,1\n")
    with pytest.raises(ValueError, match="track ids must be below 2\\*\\*63"):
        load_tracks(path)


@pytest.mark.parametrize("header", ["track,frame,x,y\n0,0,1,2\n0,1,3,4", "1,2,3,4"])
def test_csv_of_a_spreadsheet(tmp_path, header):
    """Which begins with a byte-order mark."""
    path = tmp_path / "clip.csv"
    path.write_text(header, encoding="utf-8-sig")
    assert load_tracks(path).data.tolist() == [[1, 2, 3, 4]]


def test_csv_without_labels(tmp_path):
    path = tmp_path / "clip.csv"
    path.write_text("track,frame,x,y,score\n0,3,1.5,2,0.9\n1,4,5,6,0.8\n")
    loaded = load_tracks(path)
    assert_array_equal(loaded.data, [[1.5, 2, np.nan, np.nan], [np.nan, np.nan, 5, 6]])
    assert loaded.target is None


@pytest.mark.parametrize("names", ["id,t", "track_id,frame", "ID,Time"])
@pytest.mark.parametrize("seen", ["visible", "occluded"])
def test_csv_of_observations_under_other_names(tmp_path, names, seen):
    path = tmp_path / "clip.csv"
    yes, no = ("1", "False") if seen == "visible" else ("0", "True")
    rows = [f"7,3,1.5,2,{yes}", f"7,4,8,8,{no}", f"9,4,5,6,{yes}"]
    path.write_text("\n".join([f"{names},x,y,{seen}", *rows]))
    loaded = load_tracks(path)
    assert_array_equal(loaded.data, [[1.5, 2, np.nan, np.nan], [np.nan, np.nan, 5, 6]])
    assert_array_equal(loaded.track_ids, [7, 9])


@pytest.mark.parametrize("second", [1, 20])
def test_csv_of_two_frames_of_a_grid(tmp_path, second):
    """Two frames of four numbers are not mistaken for observations."""
    X = np.array([[0, 0, 0.5, 1], [0, second, 1, 2], [second, 0, 3, 0.5]])
    path = tmp_path / "clip.csv"
    np.savetxt(path, X, delimiter=",", header="x0,y0,x1,y1", comments="")
    assert_array_equal(load_tracks(path).data, X)
    if second > 1:  # otherwise it could be either
        np.savetxt(path, X, delimiter=",")
        assert_array_equal(load_tracks(path).data, X)


@pytest.mark.parametrize(
    "names",
    [
        "x,y,x.1,y.1",  # pandas, of columns that have the same names
        "x_9,y_9,x_10,y_10",
        "x0.5,y0.5,x1.0,y1.0",
        "x-1,y-1,x0,y0",
        "x 2024-01-31,y 2024-01-31,x 2024-02-01,y 2024-02-01",
    ],
)
def test_csv_whose_columns_are_in_order(names, tmp_path):
    path = tmp_path / "clip.csv"
    path.write_text(f"id,{names}\n4,1,2,3,4\n")
    assert_array_equal(load_tracks(path).data, [[1, 2, 3, 4]])


def test_csv_with_an_empty_label(tmp_path):
    path = tmp_path / "clip.csv"
    path.write_text("track,frame,x,y,label\n0,0,1,2,0\n1,0,5,6,\n")
    assert_array_equal(load_tracks(path).target, [0, -1])


@pytest.mark.parametrize("cells", [["2", "", ""], ["", "2", ""], ["", "2", "2"]])
def test_csv_with_a_label_in_some_rows_of_a_track(cells, tmp_path):
    path = tmp_path / "clip.csv"
    rows = [f"7,{frame},1,2,{cell}" for frame, cell in enumerate(cells)]
    path.write_text("\n".join(["track,frame,x,y,label", *rows, "9,0,5,6,"]))
    assert_array_equal(load_tracks(path).target, [2, -1])


@pytest.mark.parametrize("order", [1, -1])
def test_csv_of_a_track_whose_label_changes_has_the_last(order, tmp_path):
    """As those have that a stream has labelled."""
    path = tmp_path / "clip.csv"
    rows = ["4,0,5,6,1", "7,0,1,2,-1", "7,1,1,2,2", "7,2,1,2,"][::order]
    path.write_text("\n".join(["track,frame,x,y,label", *rows]))
    assert_array_equal(load_tracks(path).target, [1, 2])


# -------------------------------------------------------- files of the benchmarks


@pytest.fixture(scope="module")
def clip():
    X, y = make_rigid_motions(30, 6, 2, missing=0.2, random_state=0)
    return X, y


@pytest.fixture(scope="module")
def full_clip():
    return make_rigid_motions(30, 6, 2, missing=0, random_state=0)


def test_kt3dmoseg(clip, tmp_path):
    X, y = clip
    index = np.arange(0, 30, 3)
    for name in ("Seq2_Clip1", "Seq1_Clip1"):
        write_struct(
            tmp_path / f"{name}_Tracks.mat", X[index], y[index], dense=(X, index)
        )
    (tmp_path / "README.md").write_text("not a sequence")
    first, second = load_kt3dmoseg(tmp_path)
    assert (first.name, second.name) == ("Seq1_Clip1", "Seq2_Clip1")
    assert_array_equal(first.data, X[index])
    assert_array_equal(first.target, y[index])
    assert_array_equal(first.dense_data, X)
    assert_array_equal(first.dense_index, index)
    assert_array_equal(first.dense_data[first.dense_index], first.data)


def test_mtpv62(clip, tmp_path):
    X, y = clip
    y = np.where(np.arange(30) < 4, -1, y)  # label 0 in the file
    write_struct(tmp_path / "MTPV_data_Man_Tracks.mat", X, y)
    (sequence,) = load_mtpv62(str(tmp_path))
    assert sequence.name == "MTPV_data_Man"
    assert_array_equal(sequence.data, X)
    assert_array_equal(sequence.target, y)
    assert "dense_data" not in sequence


def test_hopkins12(full_clip, tmp_path):
    X, y = full_clip
    write_struct(tmp_path / "oc2R3RCRT_g12_Tracks.mat", X, y, visibility=False)
    (sequence,) = load_hopkins12(tmp_path)
    assert sequence.name == "oc2R3RCRT_g12"
    assert_array_equal(sequence.data, X)
    assert_array_equal(sequence.target, y)


def test_hopkins155(full_clip, tmp_path):
    X, y = full_clip
    pixels = homogeneous_pixels(unpack_tracks(X)[0])
    for name in ("cars2", "1R2RC"):
        (tmp_path / name).mkdir()
        content = {
            "y": pixels,
            "x": pixels / 1000,
            "s": y[:, None] + 1,
            "K": np.eye(3),
            "width": 640,
            "height": 480,
            "points": 30,
            "frames": 6,
        }
        scipy.io.savemat(tmp_path / name / f"{name}_truth.mat", content)
    first, second = load_hopkins155(tmp_path)
    assert (first.name, second.name) == ("1R2RC", "cars2")
    assert_array_equal(first.data, X)
    assert_array_equal(first.target, y)


def test_homogeneous_pixels_are_divided_by_the_third(full_clip, tmp_path):
    X, y = full_clip
    pixels = homogeneous_pixels(unpack_tracks(X)[0])
    path = tmp_path / "clip.mat"
    scipy.io.savemat(path, {"y": 2 * pixels, "s": y[:, None] + 1})
    with pytest.raises(ValueError, match=r"third coordinates of 'y'.* must be 1 where"):
        load_tracks(path)


def write_two_images(path, data, label, **more):
    images = {"img1": np.zeros((4, 6, 3), np.uint8), "score": np.ones(len(data.T))}
    content = {"data": data, "label": label, **images, **more}
    scipy.io.savemat(path, content)


def two_images(n=5):
    """Pixels (n, 4) and the homogeneous ones (6, n) of a file."""
    X = np.random.default_rng(0).uniform(0, 600, size=(n, 4))
    ones = np.ones((1, n))
    return X, np.concatenate([X[:, :2].T, ones, X[:, 2:].T, ones])


def test_adelaide(tmp_path):
    X, data = two_images()
    label = np.array([[0, 1, 2, 1, 0]], dtype=np.uint8)
    for name in ("cubes", "book"):
        write_two_images(tmp_path / f"{name}.mat", data, label)
    first, second = load_adelaide(tmp_path)
    assert (first.name, second.name) == ("book", "cubes")
    assert_array_equal(first.data, X)
    assert_array_equal(first.target, [-1, 0, 1, 0, -1])
    assert unpack_tracks(second.data)[0].shape == (5, 2, 2)


def test_two_images_with_a_single_track(tmp_path):
    """Files that leave out axes of length 1 have its six numbers in a row."""
    X, data = two_images(1)
    write_two_images(tmp_path / "book.mat", data, np.ones((1, 1)))
    (whole,) = load_adelaide(tmp_path)
    assert_array_equal(whole.data, X)


def test_photographs(tmp_path):
    rng = np.random.default_rng(0)
    points, seen = rng.uniform(0, 600, size=(5, 4, 2)), rng.uniform(size=(5, 4)) < 0.9
    labels = np.array([1, 2, -1, 2, 1])
    np.savez(tmp_path / "table.npz", points=points, visibility=seen, labels=labels)
    (table,) = load_arrigoni(tmp_path)
    assert table.name == "table"
    assert_array_equal(table.target, [0, 1, -1, 1, 0])
    assert_array_equal(unpack_tracks(table.data)[1], seen)
    np.savez(tmp_path / "table.npz", points=points, visibility=seen)
    assert load_arrigoni(tmp_path)[0].target is None


@pytest.mark.parametrize(
    "change, message",
    [
        (lambda data: data[:4], r"shape \(6, n_tracks\), .* got \(4, 5\)"),
        (lambda data: data * 2, "rows 3 and 6 of 'data' must be 1"),
        (lambda data: data[:, :4], "4 tracks need as many labels"),
        (lambda data: data.astype(str), "'data' must be numbers"),
    ],
)
def test_what_is_wrong_with_two_images_is_said(change, message, tmp_path):
    _, data = two_images()
    write_two_images(tmp_path / "book.mat", change(data), np.ones((1, 5)))
    with pytest.raises(ValueError, match=message):
        load_adelaide(tmp_path)


REAL = {
    "KT3DMoSeg": (load_kt3dmoseg, 11, "Seq005_Clip01", {2, 3, 4}),
    "Hopkins155": (load_hopkins155, 79, "1R2RC", {2, 3}),
    "MTPV62": (load_mtpv62, 6, "MTPV_data_Boat", {2, 3}),
    "Hopkins12": (load_hopkins12, 4, "oc2R3RCRT", {2, 3}),
    "AdelaideRMF": (load_adelaide, 10, "biscuit", {1, 2, 3, 4}),
    "Arrigoni": (load_arrigoni, 3, "BAG", {2}),
}


@pytest.mark.data
@pytest.mark.parametrize("dataset", REAL)
def test_real_sequences(real_data, dataset):
    load, n_sequences, first_name, counts = REAL[dataset]
    sequences = load(real_data / dataset)
    names = [sequence.name for sequence in sequences]
    assert len(set(names)) == n_sequences
    assert names == sorted(names)
    assert names[0] == first_name
    assert {len(np.unique(s.target[s.target >= 0])) for s in sequences} == counts
    for X, y in ((s.data, s.target) for s in sequences):
        points, seen = unpack_tracks(X)
        assert y.shape == (len(X),)
        assert np.unique(y[y >= 0]).tolist() == list(range(y.max() + 1))
        assert np.abs(points[seen]).max() < 5000
        assert (seen.sum(axis=1) >= 2).all()


@pytest.mark.data
def test_what_real_sequences_miss(real_data):
    for dataset in ("Hopkins155", "Hopkins12"):
        for sequence in REAL[dataset][0](real_data / dataset):
            assert np.isfinite(sequence.data).all()
    clips = load_kt3dmoseg(real_data / "KT3DMoSeg")
    unseen = np.mean([np.isnan(clip.data).mean() for clip in clips])
    assert 0.2 < unseen < 0.4
    outliers = [(s.target == -1).any() for s in load_mtpv62(real_data / "MTPV62")]
    assert any(outliers)


@pytest.mark.data
def test_real_dense_tracks_hold_the_labelled_ones(real_data):
    for clip in load_kt3dmoseg(real_data / "KT3DMoSeg"):
        assert len(clip.dense_data) > 1000
        assert_array_equal(clip.dense_data[clip.dense_index], clip.data)


def test_a_frame_number_beyond_reason_is_an_error_and_no_huge_array(tmp_path):
    path = tmp_path / "tracks.csv"
    path.write_text("track,frame,x,y\n0,0,1,2\n0,1000000000,3,4\n")
    with pytest.raises(ValueError, match="1 tracks in 1000000001 frames are more than"):
        load_tracks(path)


def test_two_images_are_not_taken_for_a_video(tmp_path):
    from scipy.io import savemat

    y = np.full((3, 6, 4), 7.0)
    y[2] = 1
    data = {"ySparse": y, "GtLabel": np.ones(6), "visibleSparse": np.ones((6, 4))}
    savemat(tmp_path / "clip.mat", {"Data": data})
    with pytest.raises(ValueError, match="clip has 4 frames, where 2 are expected"):
        load_adelaide(tmp_path)
