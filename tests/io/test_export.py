"""Masks of the static scene, and a file per motion."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from skmotionseg import save_motions, static_mask, unpack_tracks
from skmotionseg.datasets import load_tracks, make_rigid_motions


@pytest.fixture(scope="module")
def scene():
    return make_rigid_motions(60, 6, outliers=0.1, random_state=0)


# ------------------------------------------------------------------------------ masks


def test_the_mask_is_of_seen_points_of_the_largest_motion(scene):
    X, y = scene
    mask = static_mask(X, y)
    assert mask.shape == (60, 6)
    assert mask.dtype == bool
    assert_array_equal(mask[y == 0], unpack_tracks(X[y == 0])[1])
    assert not mask[y != 0].any()


def test_the_largest_motion_may_have_any_label(scene):
    X, y = scene
    renamed = np.where(y >= 0, np.array([7, 3, 0])[y], -1)
    assert_array_equal(static_mask(X, renamed), static_mask(X, y))
    lost = np.where(np.arange(60) % 4 > 0, -1, y)  # most belong to no motion
    assert_array_equal(static_mask(X, lost).any(axis=1), lost == 0)


@pytest.mark.parametrize("background", [0, 1, 2])
def test_the_background_can_be_told(scene, background):
    X, y = scene
    mask = static_mask(X, y, background=background)
    assert_array_equal(mask.any(axis=1), y == background)


@pytest.mark.parametrize(
    "labels, background, words",
    [
        ([0], None, r"2 tracks need one label each; got labels of shape \(1,\)"),
        ([0.0, 1.0], None, "labels must be whole numbers; got dtype float64"),
        ([-1, -1], None, "none of the tracks belongs to a motion"),
        ([-1, 1], -1, r"background must be .*; got -1, where there are \[-1, 1\]"),
        ([0, 1], 2, r"background must be .*; got 2, where there are \[0, 1\]"),
        ([0, 1], "0", r"background must be .*; got '0', where there are \[0, 1\]"),
    ],
)
def test_bad_labels(labels, background, words):
    with pytest.raises(ValueError, match=words):
        static_mask(np.zeros((2, 4)), labels, background=background)


# ------------------------------------------------------------------------------ files


def test_a_file_a_motion(scene, tmp_path):
    X, y = scene
    ids = np.arange(60) * 3
    files = save_motions(tmp_path / "motions", X, y, track_ids=ids)
    names = ["motion_0.npz", "motion_1.npz", "motion_2.npz", "no_motion.npz"]
    assert [path.name for path in files] == names
    assert sorted(path.name for path in (tmp_path / "motions").iterdir()) == names
    for path, motion in zip(files, (0, 1, 2, -1), strict=True):
        clip = load_tracks(path)
        assert_array_equal(clip.data, X[y == motion])
        assert_array_equal(clip.target, y[y == motion])
        with np.load(path) as arrays:
            assert_array_equal(arrays["track_ids"], ids[y == motion])


def as_pandas(ids):
    return pytest.importorskip("pandas").Index(ids)


def as_nullable(ids):
    return pytest.importorskip("pandas").array(ids, dtype="Int64")


@pytest.mark.parametrize(
    "kind",
    [list, np.uint64, as_pandas, as_nullable, np.float64, lambda a: a.astype("O")],
)
def test_ids_of_any_kind_that_are_whole(scene, tmp_path, kind):
    X, y = scene
    ids = 2**50 + np.arange(60)
    for path in save_motions(tmp_path, X, y, track_ids=kind(ids)):
        clip = load_tracks(path)
        assert clip.track_ids.dtype.kind in "iu"
        assert_array_equal(clip.track_ids, ids[y == clip.target[0]])


def test_large_ids_that_are_objects(scene, tmp_path):
    X, y = scene
    ids = np.array([*range(59), 2**60 + 1], dtype=object)
    files = save_motions(tmp_path, X, y, track_ids=ids)
    assert 2**60 + 1 in [k for path in files for k in load_tracks(path).track_ids]


@pytest.mark.parametrize(
    "name, words",
    [
        ("a0", r"fit in 64 bits; got 'a0' \(dtype object\)"),
        (0.5, "must be whole numbers that fit in 64 bits; got 0.5"),
        (np.nan, "got nan"),
        (None, r"got None \(dtype object\)"),
        (2**63, "got 9223372036854775808"),
    ],
)
def test_ids_that_could_not_be_read_come_before_any_file(scene, tmp_path, name, words):
    X, y = scene
    folder = tmp_path / "motions"
    with pytest.raises(ValueError, match=words):
        save_motions(folder, X, y, track_ids=np.array([*range(59), name], dtype="O"))
    words = r"got 'a0' \(dtype <U3\)"
    with pytest.raises(ValueError, match=words):
        save_motions(folder, X, y, track_ids=[f"a{k}" for k in range(60)])
    assert not folder.exists()


def test_files_are_replaced(scene, tmp_path):
    X, y = scene
    save_motions(str(tmp_path), X, y)
    before = load_tracks(tmp_path / "motion_0.npz").data
    save_motions(tmp_path, X + 1, y)
    assert_array_equal(load_tracks(tmp_path / "motion_0.npz").data, before + 1)


def test_files_of_another_segmentation_are_an_error(scene, tmp_path):
    X, y = scene
    files = save_motions(tmp_path, X, y)
    content = [path.read_bytes() for path in files]
    with pytest.raises(
        FileExistsError, match=r"motion_2.npz, no_motion.npz of another"
    ):
        save_motions(tmp_path, X, np.clip(y, 0, 1))
    assert [path.read_bytes() for path in files] == content


def test_a_folder_by_the_name_of_a_file_is_an_error_before_any_is_replaced(
    scene, tmp_path
):
    X, y = scene
    files = save_motions(tmp_path, X, y)
    files[1].unlink()
    files[1].mkdir()
    others = [files[0], *files[2:]]
    content = [path.read_bytes() for path in others]
    with pytest.raises(ValueError, match=r"motion_1\.npz is not a file that"):
        save_motions(tmp_path, X + 1, y)
    assert [path.read_bytes() for path in others] == content


def test_a_file_is_whole_or_not_there(scene, tmp_path, monkeypatch):
    X, y = scene

    def half(file, **arrays):
        file.write(b"half")
        raise OSError("no space left")

    monkeypatch.setattr(np, "savez_compressed", half)
    with pytest.raises(OSError, match="no space left"):
        save_motions(tmp_path, X, y)
    assert not list(tmp_path.glob("*.npz"))


def test_bad_motions_come_before_any_file(scene, tmp_path):
    X, y = scene
    folder = tmp_path / "motions"
    for bad, words in (
        ((X, y[:-1]), "60 tracks need one label each"),
        ((np.full_like(X, np.inf), y), "must be finite"),
    ):
        with pytest.raises(ValueError, match=words):
            save_motions(folder, *bad)
    with pytest.raises(ValueError, match="60 tracks need an id each"):
        save_motions(folder, X, y, track_ids=[1])
    with pytest.raises(FileNotFoundError):
        save_motions(folder / "deeper", X, y)
    assert not folder.exists()
