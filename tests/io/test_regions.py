"""FBMS-59 and ComplexBackground: their files, and scores worked out by hand."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
from helpers.moseg_files import (
    definition_text,
    track_text,
    write_definition,
    write_image,
    write_tracks,
)
from numpy.testing import assert_allclose, assert_array_equal
from PIL import Image

from skmotionseg.datasets import (
    load_complex_background,
    load_fbms59,
    load_tracks,
    make_rigid_motions,
)
from skmotionseg.metrics import fbms_objects, fbms_scores

NAN = np.nan

# Two labelled frames of 6 x 4 pixels: the background (grey 255), one object (grey 40)
# that moves a pixel to the right in between, and one (grey 90) in the second alone.
#
#     frame 0             frame 2
#     . . . . . .         . . . . b b
#     . a a . . .         . . a a . .
#     . a a . . .         . . a a . .
#     . . . . . .         . . . . . .
FIRST = np.full((4, 6), 255)
FIRST[1:3, 1:3] = 40
LAST = np.full((4, 6), 255)
LAST[1:3, 2:4] = 40
LAST[0, 4:6] = 90

# Track by track, with the region it is on in frames 0 and 2.
TRACKS = [
    (0, [(0.2, 0.4, 0), (1, 0, 1), (2, 0, 2)]),  # background, background
    (0, [(4, 3, 0), (4, 3, 1), (4, 3, 2), (4, 3, 3)]),  # background, background
    (0, [(0, 3.4, 0), (0, 3, 1)]),  # background; it ends
    (1, [(1, 1, 0), (1.5, 1, 1), (2, 1, 2)]),  # object a, object a
    (1, [(2.4, 2.4, 0), (2.9, 2, 1), (3.4, 2, 2)]),  # object a, object a
    (1, [(2.5, 1.0, 0), (3, 1, 1)]),  # pixel 3 is nearest: background; it ends
    (2, [(5, 0, 1), (5, 0, 2)]),  # object b; it comes late
    (1, [(-1e300, 9, 0), (9, 9, 1), (9, 9, 2)]),  # outside the image
    (1, [(5, 2, 3)]),  # in no labelled frame
]


@pytest.fixture
def fbms(tmp_path):
    """A data set of one sequence of the training set."""
    home = tmp_path / "Trainingset" / "cars9"
    masks = {0: ("cars9_01.pgm", FIRST), 2: ("cars9_03.pgm", LAST)}
    write_definition(home, [255, 40, 90], 4, masks)
    (home / "Tracks4.dat").write_text(track_text(4, TRACKS))
    return tmp_path


def scores(clip, labels, score=fbms_scores):
    return score(
        clip.point_target,
        np.asarray(labels)[clip.point_track],
        sample_weight=clip.point_weight,
        region_sizes=clip.region_sizes,
    )


# --------------------------------------------------------------------------- loading


def test_what_a_sequence_is(fbms):
    (clip,) = load_fbms59(fbms)
    assert (clip.name, clip.set) == ("cars9", "Trainingset")
    assert clip.data.shape == (9, 8)
    assert_array_equal(clip.data[2], [0, 3.4, 0, 3, NAN, NAN, NAN, NAN])
    assert_array_equal(clip.data[6], [NAN, NAN, 5, 0, 5, 0, NAN, NAN])
    assert_array_equal(clip.track_labels, [0, 0, 0, 1, 1, 1, 2, 1, 1])
    assert_array_equal(clip.target, [0, 0, 0, 1, 1, 0, 2, -1, -1])
    assert_array_equal(clip.mask_frames, [0, 2])
    assert_array_equal(clip.masks[1], np.select([LAST == 40, LAST == 90], [1, 2], 0))
    assert_array_equal(clip.region_sizes, [20 + 18, 4 + 4, 0 + 2])
    assert_array_equal(clip.point_track, [0, 1, 2, 3, 4, 5, 0, 1, 3, 4, 6, 7, 8])
    assert_array_equal(clip.point_frame, [0] * 6 + [2] * 5 + [-1] * 2)
    assert_array_equal(clip.point_target, [0, 0, 0, 1, 1, 0, 0, 0, 1, 1, 2, -1, -1])
    assert_array_equal(clip.point_weight, [1] * 11 + [0] * 2)


def test_scores_by_hand(fbms):
    """The labels in the track file, against the regions.

    Points by region (rows) and group (columns), of both labelled frames:

                     0  1  2    pixels
        background   5  1  .    20 + 18
        a            .  4  .     4 +  4
        b            .  .  1     0 +  2

    Density: (6/38 + 4/8 + 1/2) / 3. Matched in this order, precision is 5/5, 4/5 and
    1/1, recall 5/6, 4/4 and 1/1, F 10/11, 8/9 and 1: all three are found.
    """
    (clip,) = load_fbms59(fbms)
    density, precision, recall, f_measure = scores(clip, clip.track_labels)
    assert_allclose(density, (6 / 38 + 4 / 8 + 1 / 2) / 3)
    assert_allclose(precision, (1 + 4 / 5 + 1) / 3)
    assert_allclose(recall, (5 / 6 + 1 + 1) / 3)
    assert_allclose(f_measure, 2 * precision * recall / (precision + recall))
    assert scores(clip, clip.track_labels, fbms_objects) == (2, 2)


def test_scores_of_one_group_by_hand(fbms):
    """All tracks one group: it is the background's, precision 6/11 and recall 1.

    The objects have no group: precision 1 and recall 0.
    """
    (clip,) = load_fbms59(fbms)
    _, precision, recall, f_measure = scores(clip, np.zeros(9, int))
    assert_allclose((precision, recall), ((6 / 11 + 2) / 3, 1 / 3))
    assert_allclose(f_measure, 2 * precision * recall / (precision + recall))
    assert scores(clip, np.zeros(9, int), fbms_objects) == (0, 2)


def test_a_group_elsewhere_takes_the_region_that_is_left(fbms):
    """As in the benchmark's program, which counts groups by the largest label.

    All tracks are of group 0 but one, which is in no labelled frame. One object is
    matched with its group, precision 0 and recall 0, and the other has none, 1 and 0.
    """
    (clip,) = load_fbms59(fbms)
    _, precision, recall, _ = scores(clip, [0] * 8 + [1])
    assert_allclose((precision, recall), ((6 / 11 + 0 + 1) / 3, 1 / 3))


def test_scores_of_tracks_without_a_group_by_hand(fbms):
    """Without tracks 0 and 3, half of the points that were on the first object."""
    labels = [-1, 0, 0, -1, 1, 1, 2, 1, 1]
    (clip,) = load_fbms59(fbms)
    density, precision, recall, _ = scores(clip, labels)
    assert_allclose(density, (4 / 38 + 2 / 8 + 1 / 2) / 3)
    assert_allclose(precision, (1 + 2 / 3 + 1) / 3)
    assert_allclose(recall, (3 / 4 + 1 + 1) / 3)


def test_the_first_frames_alone_are_read(fbms):
    (clip,) = load_fbms59(fbms, n_frames=2)
    assert clip.data.shape == (8, 4)  # the last track comes later
    assert_array_equal(clip.mask_frames, [0])
    assert_array_equal(clip.region_sizes, [20, 4, 0])
    assert_array_equal(clip.target, [0, 0, 0, 1, 1, 0, -1, -1])
    # Object b is not visible, and its group has no point: 4 background points are of
    # groups 0 (3) and 1 (1), those of a of group 1.
    density, precision, recall, _ = scores(clip, clip.track_labels)
    assert_allclose(density, (4 / 20 + 2 / 4) / 2)
    assert_allclose((precision, recall), ((1 + 2 / 3) / 2, (3 / 4 + 1) / 2))
    assert scores(clip, clip.track_labels, fbms_objects).visible == 1


def test_colours_and_weights(tmp_path):
    """A .ppm mask, its scales 65536 red + 256 green + blue, and a .pgm of weights."""
    home = tmp_path / "Testset" / "dogs01"
    image = np.full((4, 6, 3), 255)
    image[1:3, 1:3] = [200, 0, 7]
    weights = np.full((4, 6), 255)
    weights[1, 1:3] = 51  # a fifth
    write_definition(home, [16777215, 13107207], 10, {0: ("dogs01_0001_gt.ppm", image)})
    write_image(home / "GroundTruth" / "dogs01_0001_gt.pgm", weights)
    results = home.parent / "Results" / "OchsBroxMalik8_0000_0010_0000060.00"
    points = [(0, 0), (1, 1), (2, 2), (5, 3)]
    tracks = [(0, [(x, y, frame) for frame in range(10)]) for x, y in points]
    (results / "dogs01").mkdir(parents=True)
    text = track_text(10, tracks, one_line=True)
    (results / "dogs01" / "Tracks10.dat").write_text(text)

    (clip,) = load_fbms59(tmp_path)
    assert clip.set == "Testset"
    assert_array_equal(clip.target, [0, 1, 1, 0])
    assert_allclose(clip.point_weight, [1, 1 / 5, 1, 1])
    assert_allclose(clip.region_sizes, [20, 2 + 2 / 5])
    # Group 1 is the pixel of a fifth, and the background's last: 1.2 in all.
    density, precision, recall, _ = scores(clip, [0, 1, 0, 1])
    assert_allclose(density, (2 / 20 + 1.2 / 2.4) / 2)
    pairs = {  # of background and object: group 0 is a point of each
        (0, 1): ([1 / 2, 0.2 / 1.2], [1 / 2, 0.2 / 1.2]),
        (1, 0): ([1 / 1.2, 1 / 2], [1 / 2, 1 / 1.2]),
    }
    better = pairs[1, 0]  # F 0.625 twice, against 1/2 and 1/6
    assert_allclose((precision, recall), np.mean(better, axis=1))


def test_sets_come_in_order(fbms):
    for name in ("Testset/b", "Testset/a", "Trainingset/z"):
        write_definition(fbms / name, [255, 40], 4, {0: ("m.pgm", FIRST)})
        (fbms / name / "Tracks4.dat").write_text(track_text(4, TRACKS))
    clips = load_fbms59(fbms)
    assert [(clip.set, clip.name) for clip in clips] == [
        ("Trainingset", "cars9"),
        ("Trainingset", "z"),
        ("Testset", "a"),
        ("Testset", "b"),
    ]


def test_tracks_from_elsewhere(fbms, tmp_path):
    (fbms / "Trainingset" / "cars9" / "Tracks4.dat").unlink()
    with pytest.raises(
        FileNotFoundError, match=r"cars9 needs one track file .* got none"
    ):
        load_fbms59(fbms)
    folder = tmp_path / "mine"
    (folder / "cars9").mkdir(parents=True)
    for length in (10, 50):
        tracks = [*TRACKS, (0, [(0, 0, frame) for frame in range(length)])]
        path = folder / "cars9" / f"Tracks{length}.dat"
        path.write_text(track_text(length, tracks))
    assert load_fbms59(fbms, tracks=folder)[0].data.shape == (10, 20)
    assert load_fbms59(fbms, tracks=folder, n_frames=50)[0].data.shape == (10, 100)
    with pytest.raises(FileNotFoundError, match=r"got .*Tracks10.dat, .*Tracks50.dat"):
        load_fbms59(fbms, tracks=folder, n_frames=20)


def test_colours_that_are_not_defined_are_the_first_region(fbms):
    truth = fbms / "Trainingset" / "cars9" / "GroundTruth"
    image = LAST.copy()
    image[3, :3] = [41, 0, 254]
    write_image(truth / "cars9_03.pgm", image)
    with pytest.warns(UserWarning, match=r"cars9_03.pgm: 3 pixels have colours"):
        (clip,) = load_fbms59(fbms)
    assert_array_equal(clip.masks[1][3], np.zeros(6))


def test_masks_without_the_extra(fbms, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "PIL.Image", None)
    with pytest.raises(ImportError, match=r'PIL.*pip install "skmotionseg\[plot\]"'):
        load_fbms59(fbms)


def test_tracks_are_a_track_file(fbms):
    sequence = load_tracks(fbms / "Trainingset" / "cars9" / "Tracks4.dat")
    assert sequence.name == "Tracks4"
    assert_array_equal(sequence.data[2], [0, 3.4, 0, 3, NAN, NAN, NAN, NAN])
    assert_array_equal(sequence.track_labels, [0, 0, 0, 1, 1, 1, 2, 1, 1])
    assert sequence.target is None  # they are not the truth


def test_tracks_of_a_scene_come_back(tmp_path):
    X, y = make_rigid_motions(60, 10, outliers=0.1, random_state=0)
    path = tmp_path / "Tracks10.dat"
    write_tracks(path, X, y)
    sequence = load_tracks(path)
    assert_array_equal(sequence.data, X)
    assert_array_equal(sequence.track_labels, y)


# ----------------------------------------------------------------- ComplexBackground


@pytest.fixture
def complex_background(tmp_path):
    home = tmp_path / "forest"
    (home / "GroundTruth").mkdir(parents=True)
    for number, image in ((21, FIRST), (23, LAST)):
        image = 255 - image  # a black background
        path = home / "GroundTruth" / f"forest2_{number:04}_gt.png"
        Image.fromarray(np.dstack([image, image, 0 * image]).astype(np.uint8)).save(
            path
        )
    (home / "Tracks4.dat").write_text(track_text(4, TRACKS))
    return tmp_path


def test_masks_by_the_numbers_in_their_names(complex_background):
    (clip,) = load_complex_background(complex_background, first_number=21)
    assert (clip.name, clip.set) == ("forest", "")
    assert_array_equal(clip.mask_frames, [0, 2])
    assert_array_equal(clip.region_sizes, [38, 2, 8])  # by colour: 255 - 90 < 255 - 40
    assert_array_equal(clip.target, [0, 0, 0, 2, 2, 0, 1, -1, -1])
    density, precision, recall, _ = scores(clip, clip.track_labels)
    assert_allclose(density, (6 / 38 + 4 / 8 + 1 / 2) / 3)
    assert_allclose((precision, recall), ((1 + 4 / 5 + 1) / 3, (5 / 6 + 1 + 1) / 3))


def test_masks_with_a_definition(fbms):
    (clip,) = load_complex_background(fbms / "Trainingset")
    (same,) = load_fbms59(fbms)
    assert_array_equal(clip.point_target, same.point_target)
    assert_array_equal(clip.region_sizes, same.region_sizes)


def test_what_is_no_mask_is_left_aside(complex_background):
    (clip,) = load_complex_background(complex_background, first_number=21)
    truth = complex_background / "forest" / "GroundTruth"
    (truth / "notes_0022.txt").write_text("drawn by hand")
    (same,) = load_complex_background(complex_background, first_number=21)
    assert_array_equal(same.mask_frames, clip.mask_frames)
    assert_array_equal(same.point_target, clip.point_target)


def test_masks_whose_names_do_not_fit(complex_background):
    truth = complex_background / "forest" / "GroundTruth"
    with pytest.raises(ValueError, match="none of the first 4 frames has a mask"):
        load_complex_background(complex_background)
    with pytest.raises(ValueError, match=r"forest2_0021_gt.png: .* from 22 on"):
        load_complex_background(complex_background, first_number=22)
    (truth / "other_23.png").write_bytes((truth / "forest2_0023_gt.png").read_bytes())
    with pytest.raises(ValueError, match="two masks have the same number"):
        load_complex_background(complex_background, first_number=21)
    for path in truth.iterdir():
        path.unlink()
    with pytest.raises(
        FileNotFoundError, match=r"no masks .pgm, .ppm, .png in .*Truth"
    ):
        load_complex_background(complex_background)


# -------------------------------------------------------------------- malformed files

POINT = "1\n2\n0 0 0\n1 1 1\n"

BAD_TRACKS = {
    "empty": ("", "no number of frames"),
    "one number": ("4\n", "no number of frames"),
    "words": (f"2\n1\n{POINT}here", "line 7: expected a number; got 'here'"),
    "infinite": ("2\n1\n1\n2\n0 inf 0\n1 1 1\n", "line 5: .* got 'inf'"),
    "no frames": (f"0\n1\n{POINT}", "line 1: the number of frames must be .* got 0"),
    "no tracks": ("2\n0\n", "line 2: the number of tracks must be .* got 0"),
    "half a track": (f"2\n1.5\n{POINT}", "line 2: the number of tracks .* got 1.5"),
    "fewer tracks": (f"2\n2\n{POINT}", "line 6: the file ends after 1 of 2 tracks"),
    "more tracks": (f"2\n1\n{POINT}{POINT}", "line 7: the file continues after"),
    "billions of tracks": (f"2\n1000000000\n{POINT}", "ends after 1 of 1000000000"),
    "billions of frames": (f"1000000000\n1\n{POINT}", "1000000000 frames, but only 2"),
    "billions of points": (
        "2\n1\n1\n1000000000\n0 0 0\n",
        "line 4: track 1 has 1000000000 points, but the file ends after 1",
    ),
    "a number without end": (f"2\n{'9' * 400}\n{POINT}", "line 2"),
    "no points": ("2\n1\n1\n0\n", "line 4: the number of points of track 1 .* got 0"),
    "half a label": ("2\n1\n0.5\n2\n0 0 0\n1 1 1\n", "line 3: the label of track 1"),
    "a frame too late": ("2\n1\n1\n2\n0 0 0\n1 1 2\n", "line 6: .* from 0 to 1; got 2"),
    "a frame too early": ("2\n1\n1\n2\n0 0 -1\n1 1 0\n", "line 5: frames are"),
    "half a frame": ("2\n1\n1\n2\n0 0 0\n1 1 0.5\n", "line 6: frames are"),
    "a frame twice": (
        "2\n1\n1\n2\n0 0 1\n1 1 1\n",
        "line 6: .* ascending order; got 1 after 1",
    ),
    "backwards": (
        "2\n1\n1\n2\n0 0 1\n1 1 0\n",
        "line 6: .* ascending order; got 0 after 1",
    ),
    "binary": ("\xff\x00 \x01", "line 1: expected a number"),
}


@pytest.mark.parametrize("name", BAD_TRACKS)
def test_bad_tracks(name, fbms):
    text, words = BAD_TRACKS[name]
    path = fbms / "Trainingset" / "cars9" / "Tracks4.dat"
    path.write_text(text, encoding="latin-1")
    for load, argument in ((load_tracks, path), (load_fbms59, fbms)):
        tracemalloc.start()
        with pytest.raises(ValueError, match=words) as error:
            load(argument)
        assert tracemalloc.get_traced_memory()[1] < 10**7
        tracemalloc.stop()
        assert str(error.value).startswith(f"{path} is not a track file: ")
        assert "\n" not in str(error.value)


def test_a_table_too_large_is_not_made(tmp_path, monkeypatch):
    monkeypatch.setattr("skmotionseg.datasets._sizes.FREE_BYTES", 35 * 16)
    monkeypatch.setattr("skmotionseg.datasets._sizes.MOST_TIMES", 0)
    path = tmp_path / "Tracks4.dat"
    path.write_text(track_text(4, TRACKS))
    with pytest.raises(ValueError, match="9 tracks in 4 frames are more than 35"):
        load_tracks(path)


GOOD = definition_text([255, 40, 90], 4, [(0, "cars9_01.pgm"), (2, "cars9_03.pgm")])

BAD_DEFINITIONS = {
    "empty": ("", "line 0: it ends before the line 'Ground truth definition file'"),
    "something else": ("4\n2\n", "line 1: expected 'Ground truth definition file'; "),
    "no number": (GOOD.replace("regions:\n3", "regions:\nx"), "line 4: .* got 'x'"),
    "no regions": (GOOD.replace("regions:\n3", "regions:\n0"), "line 4: .* from 1"),
    "fewer regions": (GOOD.replace("regions:\n3", "regions:\n4"), "line 13: the scale"),
    "more regions": (GOOD.replace("regions:\n3", "regions:\n2"), "'Confusion'; got"),
    "billions of regions": (
        GOOD.replace("regions:\n3", "regions:\n999999999"),
        "line 13: the scale of region 3",
    ),
    "a number without end": (GOOD.replace("\n255\n", f"\n{'9' * 5000}\n"), "line 6"),
    "no colour": (GOOD.replace("\n255\n", "\n99999999\n"), "line 6: .* to 16777215"),
    "a colour twice": (GOOD.replace("\n40\n", "\n255\n"), "two regions have the same"),
    "billions of masks": (
        GOOD.replace("shot:\n2", "shot:\n999999999"),
        "it ends before the line 'Frame number'",
    ),
    "cut off": (GOOD[: GOOD.rindex("File name")], "ends before the line 'File name'"),
    "a negative frame": (GOOD.replace("\n2\nFile", "\n-2\nFile"), "the frame number"),
    "no such mask": (GOOD.replace("cars9_03", "cars9_04"), "no mask at .*cars9_04.pgm"),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD_DEFINITIONS)
def test_bad_definitions(name, fbms):
    text, words = BAD_DEFINITIONS[name]
    path = fbms / "Trainingset" / "cars9" / "GroundTruth" / "cars9Def.dat"
    path.write_text(text)
    tracemalloc.start()
    with pytest.raises((ValueError, FileNotFoundError), match=words) as error:
        load_fbms59(fbms)
    assert tracemalloc.get_traced_memory()[1] < 10**7
    tracemalloc.stop()
    assert str(path) in str(error.value) or "cars9_04.pgm" in str(error.value)
    assert "\n" not in str(error.value)


BAD_IMAGES = {
    "empty": (b"", "is not an image"),
    "text": (b"nothing of the kind", "is not an image"),
    "cut off": (b"P5\n6 4\n255\n" + bytes(5), "is not an image"),
    "too large": (b"P5\n99999 99999\n255\n" + bytes(5), "too large an image"),
    "large, but for Pillow": (
        b"P5\n9000 9000\n255\n" + bytes(5),
        "too large an image: 81000000 pixels; expected 33554432 at most",
    ),
    "large": (b"P5\n10000 10000\n255\n" + bytes(5), "too large an image"),
}


@pytest.mark.parametrize("name", BAD_IMAGES)
def test_bad_masks(name, fbms):
    content, words = BAD_IMAGES[name]
    path = fbms / "Trainingset" / "cars9" / "GroundTruth" / "cars9_01.pgm"
    path.write_bytes(content)
    with pytest.raises(ValueError, match=words) as error:
        load_fbms59(fbms)
    assert str(error.value).startswith(str(path))


def test_weights_of_another_size(tmp_path):
    home = tmp_path / "Trainingset" / "a"
    colours = np.dstack([FIRST] * 3)
    write_definition(home, [255 * 65793, 40 * 65793], 4, {0: ("m.ppm", colours)})
    write_image(home / "GroundTruth" / "m.pgm", FIRST[:2])
    (home / "Tracks4.dat").write_text(track_text(4, TRACKS))
    with pytest.raises(ValueError, match=r"m.pgm must be as large .*\(4, 6\); got \(2"):
        load_fbms59(tmp_path)


@pytest.mark.parametrize("load", [load_fbms59, load_complex_background])
def test_a_folder_without_sequences(load, tmp_path):
    with pytest.raises(FileNotFoundError, match=r"no .*GroundTruth/.* in "):
        load(tmp_path)
    with pytest.raises(ValueError, match=r"n_frames must be 2 or more.*; got 1"):
        load(tmp_path, n_frames=1)


def test_two_definitions(fbms):
    truth = fbms / "Trainingset" / "cars9" / "GroundTruth"
    (truth / "otherDef.dat").write_text(GOOD)
    with pytest.raises(ValueError, match=r"needs one \*Def.dat; got 2"):
        load_fbms59(fbms)
