"""BMS-26 and DAVIS 2016: their folders, and scores from the frames alone."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest
from helpers.moseg_files import definition_text, write_image
from scipy.ndimage import gaussian_filter

from skmotionseg.cli import main
from skmotionseg.datasets import load_bms26, load_davis16
from skmotionseg.datasets._videos import read_video_mask

N_FRAMES, HEIGHT, WIDTH = 7, 96, 128


def pictures():
    """Frames before which a camera moves to the left, and masks of a falling square.

    What is lower is nearer and moves faster to the right: ground, along which the
    square's way down is no parallax. Before a wall it could be.
    """
    rng = np.random.default_rng(0)
    far, near = (
        128 + 250 * gaussian_filter(rng.normal(size=(160, 200)), 1.5) for _ in range(2)
    )
    for frame in range(N_FRAMES):
        ground = np.array([[1, 0.02 * frame, frame - 40], [0, 1, -20]], dtype=float)
        picture = cv2.warpAffine(far, ground, (WIDTH, HEIGHT))
        mask = np.zeros((HEIGHT, WIDTH), dtype=np.uint8)
        square = np.s_[20 + 2 * frame : 56 + 2 * frame, 46:82]
        picture[square] = near[30:66, 30:66]
        mask[square] = 255
        yield picture.clip(0, 255).astype(np.uint8), mask


@pytest.fixture(scope="module")
def davis(tmp_path_factory):
    folder = tmp_path_factory.mktemp("data") / "DAVIS16"
    images, masks = folder / "JPEGImages" / "square", folder / "Annotations" / "square"
    images.mkdir(parents=True)
    masks.mkdir(parents=True)
    for number, (picture, mask) in enumerate(pictures()):
        cv2.imwrite(str(images / f"{number:05d}.jpg"), picture)
        cv2.imwrite(str(masks / f"{number:05d}.png"), mask)
    return folder


@pytest.fixture(scope="module")
def bms(tmp_path_factory):
    """Masks of the first and the sixth frame: 255 the scene, 90 the square."""
    home = tmp_path_factory.mktemp("data") / "BMS26" / "square"
    home.mkdir(parents=True)
    for number, (picture, mask) in enumerate(pictures()):
        cv2.imwrite(str(home / f"square_{number + 1:02d}.jpg"), picture)
        if number in (0, 5):
            name = f"square_{number + 1:02d}.pgm"
            write_image(home / name, np.where(mask, 90, 255))
    masks = [(0, "square_01.pgm"), (5, "square_06.pgm")]
    (home / "squareDef.dat").write_text(definition_text([255, 90], N_FRAMES, masks))
    return home.parent


def test_a_video_of_davis_has_a_mask_per_frame(davis):
    (video,) = load_davis16(davis)
    assert video.name == "square" and video.binary
    np.testing.assert_array_equal(video.mask_frames, np.arange(N_FRAMES))
    mask = read_video_mask(video, 4)
    assert mask.shape == (HEIGHT, WIDTH)
    assert mask.sum() == 36 * 36 and set(np.unique(mask)) == {0, 1}


def test_davis_may_lie_in_a_folder_of_its_resolution(davis, tmp_path):
    for part in ("JPEGImages", "Annotations"):
        (tmp_path / part).mkdir()
        (tmp_path / part / "480p").symlink_to(davis / part)
    (video,) = load_davis16(tmp_path)
    assert len(video.mask_paths) == N_FRAMES


def test_a_missing_mask_is_named(davis, tmp_path):
    (tmp_path / "JPEGImages").symlink_to(davis / "JPEGImages")
    with pytest.raises(FileNotFoundError, match=r"square: no mask at .*00000\.png"):
        load_davis16(tmp_path)


def test_a_video_of_bms_has_regions_in_some_frames(bms):
    (video,) = load_bms26(bms)
    assert video.name == "square" and not video.binary
    np.testing.assert_array_equal(video.mask_frames, [0, 5])
    mask = read_video_mask(video, 1)
    assert (mask == 1).sum() == 36 * 36 and set(np.unique(mask)) == {0, 1}


def test_colours_of_no_region_are_the_first(bms):
    (video,) = load_bms26(bms)
    video.mask_scales = np.array([255, 17])
    assert not read_video_mask(video, 0).any()


@pytest.mark.parametrize("load", [load_bms26, load_davis16])
def test_folders_without_videos_are_refused(load, tmp_path):
    with pytest.raises(FileNotFoundError, match="no file"):
        load(tmp_path)


@pytest.mark.slow
def test_bench_scores_videos_from_their_frames_alone(davis, bms, tmp_path, capsys):
    data, out = tmp_path / "data", tmp_path / "records.json"
    data.mkdir()
    (data / "DAVIS16").symlink_to(davis)
    (data / "BMS26").symlink_to(bms)
    options = ["--data", str(data), "--methods", "homography", "--jobs", "1"]
    options += ["--datasets", "DAVIS16", "BMS26", "--seeds", "1", "--json", str(out)]
    assert main(["bench", *options]) == 0
    printed = capsys.readouterr().out
    assert "DAVIS16" in printed and "BMS26" in printed
    records = json.loads(out.read_text())
    binary = [each for each in records if each["binary"]]
    regions = [each for each in records if not each["binary"]]
    assert len(binary) == len(regions) == 1
    assert all(0.85 < each["region"] <= 1 for each in binary)
    assert all(0 < each["boundary"] <= 1 for each in binary)
    for each in regions:
        assert each["f_measure"] > 0.8 and each["points_f_measure"] > 0.8
        assert each["visible"] == each["points_extracted"] == 1
    assert any(each["extracted"] for each in regions)
