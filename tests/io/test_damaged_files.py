"""Files that are cut short, changed, or claim what they do not hold."""

from __future__ import annotations

import io
import json
import pickle
import re
import struct
import zipfile
import zlib
from contextlib import suppress

import numpy as np
import pytest
import scipy.io
import scipy.sparse
from helpers.moseg_files import definition_text, write_tracks
from helpers.scripts import run_limited
from helpers.track_files import (
    TRACKER_FILES,
    homogeneous_pixels,
    observations,
    write_struct,
)

from skmotionseg import unpack_tracks
from skmotionseg.datasets import load_tracks, make_rigid_motions
from skmotionseg.datasets._mat5 import read_mat5
from skmotionseg.video._frames import open_frames

resource = pytest.importorskip("resource", reason="limits of memory are POSIX's")

X, Y = make_rigid_motions(30, 6, 2, missing=0.2, random_state=0)
POINTS, SEEN = unpack_tracks(X)


# ------------------------------------------------------------------- cuts and flips


def write_track_files(folder):
    np.savez(folder / "stored.npz", points=POINTS, visibility=SEEN, labels=Y)
    np.savez_compressed(folder / "packed.npz", X=X, labels=Y)
    for number, (name, arrays) in enumerate(TRACKER_FILES.items()):
        if name in ("CoTracker", "TAPIR, both logits", "TAP-Vid"):
            clip = {name: POINTS[:5, :4], "seen": SEEN[:5, :4]}
            arrays = arrays(np.nan_to_num(clip[name]), clip["seen"])
            arrays.pop("video", None)
            np.savez(folder / f"tracker{number}.npz", **arrays)
    write_struct(folder / "struct.mat", X, Y, dense=(X, np.arange(30)))
    scipy.io.savemat(
        folder / "packed.mat",
        {"y": homogeneous_pixels(POINTS), "s": Y[:, None] + 1, "K": np.eye(3)},
        do_compression=True,
    )
    np.save(folder / "rows.npy", X)
    np.savetxt(folder / "rows.csv", X, delimiter=",")
    (folder / "observations.csv").write_text(observations(X, Y, ids=range(30)))
    write_tracks(folder / "moseg.dat", X, Y)


def write_masks(folder):
    """What FBMS-59 has beside tracks."""
    Image = pytest.importorskip("PIL.Image", reason="needs Pillow")
    regions = (POINTS[:30, :, 0].repeat(4, axis=1) > 600).astype(np.uint8) * 255
    Image.fromarray(regions).save(folder / "grey.pgm")
    Image.fromarray(np.dstack([regions, regions, 255 - regions])).save(folder / "c.ppm")
    Image.fromarray(regions).save(folder / "really_png.pgm", format="PNG")
    text = definition_text([255, 40, 90], 4, [(0, "cars9_01.pgm"), (2, "cars9_03.pgm")])
    (folder / "cars9Def.dat").write_text(text)


def write_videos(folder):
    cv2 = pytest.importorskip("cv2", reason="needs opencv-python-headless")
    rng = np.random.default_rng(0)
    frames = rng.integers(0, 255, (6, 8, 12, 3), dtype=np.uint8)
    frames = [cv2.resize(f, (96, 64), interpolation=cv2.INTER_CUBIC) for f in frames]
    for name, codec in (("v.mp4", "mp4v"), ("v.avi", "MJPG"), ("v.mkv", "mp4v")):
        fourcc = cv2.VideoWriter_fourcc(*codec)
        writer = cv2.VideoWriter(str(folder / name), fourcc, 10, (96, 64))
        for frame in frames:
            writer.write(frame)
        writer.release()
    for ending in ("png", "jpg"):
        (folder / ending).mkdir()
        assert cv2.imwrite(str(folder / ending / f"0.{ending}"), frames[0])


@pytest.mark.parametrize(
    "every_percent, n_flips, seconds",
    [(10, 60, 240), pytest.param(1, 2000, 5400, marks=pytest.mark.long)],
)
def test_damaged_files_are_read_or_refused_in_words(
    every_percent, n_flips, seconds, tmp_path
):
    write_track_files(tmp_path)
    for write in (write_masks, write_videos):
        with suppress(pytest.skip.Exception):  # by what is not installed
            write(tmp_path)
    done = run_limited("damage.py", tmp_path, every_percent, n_flips, seconds=seconds)
    last = (tmp_path / "damaged" / "current").read_text()
    assert done.returncode == 0, f"at {last}: {done.stderr[-2000:]}"
    result = json.loads(done.stdout)
    assert result["found"]["wrong"] == {}
    counts = result["found"]["counts"].values()
    assert set(counts) == {100 // every_percent + n_flips}
    assert result["peak"] < 2**30


# --------------------------------------------------------------------------- claims


def npy_header(shape, dtype="<f8"):
    header = repr({"descr": dtype, "fortran_order": False, "shape": shape}).encode()
    header += b" " * (-(len(header) + 11) % 64) + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header


def npz_of(path, content, name="X.npy"):
    """A .npz of one member; content in parts, for what is larger than memory."""
    with (
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive,
        archive.open(name, "w", force_zip64=True) as file,
    ):
        for part in content:
            file.write(part)


ZEROS = bytes(2**20)


def npz_claim(path):
    npz_of(path, [npy_header((10**12,)), bytes(80)])


def npz_claim_beyond_integers(path):
    npz_of(path, [npy_header((10**15, 10**15)), bytes(80)])


def npz_negative(path):
    npz_of(path, [npy_header((-2, -5)), bytes(80)])


def npz_bomb(path):
    npz_of(path, [npy_header((2**10, 2**15)), *[ZEROS] * 2**8])


def npz_long_header(path):
    npz_of(path, [b"\x93NUMPY\x02\x00\xff\xff\xff\xff", *[ZEROS] * 2**8])


def npz_that_lies_of_its_size(path):
    """The list of contents says that 2**40 bytes are in a member."""
    content = io.BytesIO()
    n_bytes = 2**31
    npz_of(content, [npy_header((n_bytes // 8,)), bytes(800)])
    data = content.getvalue()
    start = data.rindex(b"PK\x01\x02")
    size = struct.pack("<I", len(npy_header((n_bytes // 8,))) + n_bytes)
    path.write_bytes(data[: start + 24] + size + data[start + 28 :])


def npz_of_objects(path):
    trap = path.parent / "sprung"
    bomb = pickle.dumps(Touches(str(trap)))
    npz_of(path, [npy_header((1,), "|O"), bomb])


class Touches:
    """Makes a file when it is read by pickle."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return open, (self.path, "w")


def element(kind, payload):
    payload += bytes(-len(payload) % 8)
    return struct.pack("<II", kind, len(payload)) + payload


def matrix(kind, shape, *parts, name=b""):
    name = struct.pack("<II", 1, len(name)) + name + bytes(-len(name) % 8)
    flags = element(6, struct.pack("<II", kind, 0))
    shape = struct.pack("<II", 5, 4 * len(shape)) + struct.pack(
        f"<{len(shape)}i", *shape
    )
    inside = flags + shape + bytes(-len(shape) % 8) + name + b"".join(parts)
    return element(14, inside)


def mat(*variables):
    header = b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM"
    return lambda path: path.write_bytes(header + b"".join(variables))


def packed(variable):
    data = zlib.compress(variable)
    return struct.pack("<II", 15, len(data)) + data


def mat_bomb(path):
    """A quarter of a gibibyte of zeros, compressed."""
    start = matrix(6, (2**25, 1), name=b"y")[8:]
    head = struct.pack("<II", 14, len(start) + 8 + 2**28)
    packer = zlib.compressobj(1)
    data = packer.compress(head + start + struct.pack("<II", 9, 2**28))
    data += b"".join(packer.compress(ZEROS) for _ in range(2**8)) + packer.flush()
    mat(struct.pack("<II", 15, len(data)) + data)(path)


def nested(depth):
    """Cells in cells; linear in depth, as sizes are known from outside in."""
    inner = matrix(6, (1, 1), element(9, bytes(8)), name=b"y")
    shell = len(matrix(1, (1, 1)))
    heads = []
    for level in range(depth, 0, -1):
        size = shell - 8 + (level - 1) * shell + len(inner)
        heads.append(struct.pack("<II", 14, size) + matrix(1, (1, 1))[8:])
    name = matrix(1, (1, 1), name=b"Data")
    outer = (
        struct.pack("<II", 14, len(name) - 8 + depth * shell + len(inner)) + name[8:]
    )
    return outer + b"".join(heads) + inner


def fields(*names):
    text = b"".join(name.ljust(32, b"\x00") for name in names)
    return struct.pack("<HHi", 5, 4, 32) + element(1, text)


HUGE = 2**31 - 1
EIGHT = element(9, bytes(8))
MAT4 = struct.pack("<5i", 0, HUGE, HUGE, 0, 2) + b"y\x00"
CLAIMS = {
    "shape.npz": (npz_claim, r"'X' claims the shape \(1000000000000,\) of float64"),
    "product.npz": (npz_claim_beyond_integers, "claims the shape"),
    "negative.npz": (npz_negative, "claims the shape"),
    "bomb.npz": (npz_bomb, "would take 268435456 bytes, out of a file of"),
    "header.npz": (npz_long_header, "header"),
    "lies.npz": (npz_that_lies_of_its_size, "would take 2147483648 bytes"),
    "objects.npz": (npz_of_objects, r"Python objects.*allow_pickle=False"),
    "shape.mat": (
        mat(matrix(6, (3, HUGE, HUGE), EIGHT, name=b"y")),
        "'y' claims the shape .* but holds 8 bytes",
    ),
    "packed.mat": (
        mat(packed(matrix(6, (3, HUGE, HUGE), EIGHT, name=b"y"))),
        "'y' claims the shape .* but holds 8 bytes",
    ),
    "element.mat": (
        mat(matrix(6, (1, 1), struct.pack("<II", 9, 2**32 - 8) + bytes(8), name=b"y")),
        "a part claims 4294967288 bytes",
    ),
    "cells.mat": (mat(matrix(1, (HUGE, 1), name=b"Data")), "'Data' claims the shape"),
    "structs.mat": (
        mat(matrix(2, (HUGE, 1), fields(b"ySparse"), name=b"Data")),
        "'Data' claims the shape",
    ),
    "structs_of_nothing.mat": (
        mat(matrix(2, (HUGE, 1), fields(), name=b"Data")),
        "'Data' claims the shape",
    ),
    "text.mat": (
        mat(matrix(4, (1, HUGE), element(16, b""), name=b"Data")),
        "'Data' claims the shape .* of text",
    ),
    "function.mat": (
        mat(matrix(16, (1, 1), matrix(6, (1, 1), EIGHT), name=b"Data")),
        "'Data' is of MATLAB's class 16",
    ),
    "nested.mat": (mat(nested(50_000)), "more than 8 things in one another"),
    "bomb.mat": (mat_bomb, "would take .* bytes, out of a file of"),
    "version4.mat": (lambda path: path.write_bytes(MAT4 * 20), "version 5 or 7"),
    "far.csv": (
        lambda p: p.write_text("track,frame,x,y\n0,0,1,2\n0,90000000,3,4\n"),
        "1 tracks in 90000001 frames are more than",
    ),
    "infinite.csv": (
        lambda p: p.write_text("track,frame,x,y\n0,0,1,2\n0,1e300,3,4\n"),
        "'frame' must be whole numbers",
    ),
    "many.dat": (
        lambda p: p.write_text("9000\n9000\n" + "-1 1\n1 1 0\n" * 9000),
        "9000 tracks in 9000 frames are more than",
    ),
}


def test_claims_are_checked_before_anything_is_read(tmp_path):
    folder = tmp_path / "claims"
    folder.mkdir()
    for name, (write, _) in CLAIMS.items():
        write(folder / name)
    done = run_limited("damage.py", folder, seconds=120)
    assert done.returncode == 0, done.stderr[-2000:]
    result = json.loads(done.stdout)
    for name, (_, words) in CLAIMS.items():
        assert result["found"][name].startswith(f"{folder / name} is not a track file")
        assert re.search(words, result["found"][name])
    assert result["peak"] < 2**29
    assert not (folder / "sprung").exists()


def named(kind, *parts, shape=(1, 1), name=b"Data"):
    return mat(matrix(kind, shape, *parts, name=name))


def cell_of(*parts):
    return named(1, *parts, shape=(len(parts), 1))


def struct_of(length, names):
    return named(2, length, element(1, names))


FLAGS, SHAPE = element(6, struct.pack("<II", 6, 0)), element(5, bytes(8))
NOT_FITTING = {
    "a head cut off": (
        mat(matrix(6, (1, 1), EIGHT, name=b"y"), b"1234"),
        "it ends within the header of a part",
    ),
    "no variable": (mat(EIGHT), "expected a variable; got a part of kind 9"),
    "packed, no variable": (mat(packed(EIGHT)), "a variable; got a part of kind 9"),
    "packed, four bytes": (mat(packed(b"1234")), "compressed variable has no header"),
    "packed, cut off": (
        mat(packed(matrix(6, (8, 9), element(9, bytes(576)), name=b"y")[:-8])),
        "a variable claims 632 bytes, but there are 624",
    ),
    "no name": (mat(element(14, FLAGS + SHAPE)), "no class, shape or name"),
    "no class": (
        mat(element(14, element(6, b"") + SHAPE + element(1, b"y"))),
        "a variable has no class or no shape",
    ),
    "one axis": (named(6, EIGHT, shape=(1,)), "has no class or no shape"),
    "negative": (named(6, EIGHT, shape=(-1, -1)), r"claims the shape \(-1, -1\)"),
    "few numbers": (
        named(6, EIGHT, shape=(3, 5)),
        r"'Data' claims the shape \(3, 5\), 15 numbers, but holds 8 bytes",
    ),
    "text for numbers": (
        named(6, element(16, bytes(8))),
        "'Data' claims .* 1 numbers, but holds 8 bytes",
    ),
    "no numbers": (named(6), "'Data' ends before its last part"),
    "short text": (
        named(4, element(16, bytes(8)), shape=(1, 9)),
        r"'Data' claims the shape \(1, 9\) of text, but holds 8 bytes",
    ),
    "numbers for text": (named(4, EIGHT), r"shape \(1, 1\) of text, but holds 8 bytes"),
    "few cells": (
        named(1, element(14, b""), shape=(90, 1)),
        r"'Data' claims the shape \(90, 1\), but holds 56 bytes",
    ),
    "a cell of no variable": (cell_of(EIGHT), "'Data' holds a part of kind 9"),
    "a cell without a name": (
        cell_of(element(14, FLAGS + SHAPE)),
        "a field of 'Data' has no class, shape or name",
    ),
    "nested": (mat(nested(12)), "'Data' holds more than 8 things in one another"),
    "sparse of text": (
        named(5, EIGHT, element(16, bytes(8)), EIGHT),
        "'Data' holds what are no numbers",
    ),
    "sparse of halves": (
        named(5, EIGHT, struct.pack("<II", 9, 4) + bytes(8), EIGHT),
        "'Data' holds what are no numbers",
    ),
    "sparse without its numbers": (named(5, EIGHT, EIGHT), "before its last part"),
    "an object": (named(3, EIGHT), "'Data' is of MATLAB's class 3, which is not read"),
    "names of unknown length": (
        struct_of(element(5, bytes(8)), b"ySparse\0"),
        "'Data' does not say how long the names of its fields are",
    ),
    "names of no length": (
        struct_of(struct.pack("<HHi", 5, 4, 0), b"ySparse\0"),
        "'Data' claims fields with names of 0 bytes",
    ),
    "names of another length": (
        struct_of(struct.pack("<HHi", 5, 4, 5), b"ySparse\0"),
        "'Data' claims fields with names of 5 bytes",
    ),
}


@pytest.mark.parametrize("name", NOT_FITTING)
def test_mat_files_whose_parts_do_not_fit(name, tmp_path):
    write, words = NOT_FITTING[name]
    path = tmp_path / "clip.mat"
    write(path)
    with pytest.raises(ValueError, match=words) as error:
        load_tracks(path)
    assert str(error.value).startswith(f"{path} is not a track file: ")


@pytest.mark.parametrize("do_compression", [False, True])
def test_a_struct_may_hold_other_things_beside_tracks(do_compression, tmp_path):
    data = {
        "ySparse": homogeneous_pixels(POINTS),
        "visibleSparse": SEEN,
        "GtLabel": Y[:, None] + 1,
        "note": "taken by hand",
        "names": np.array(["left", np.zeros((0, 0)), "right"], dtype=object),
        "near": scipy.sparse.eye(30, format="csc"),
        "turn": scipy.sparse.eye(3, format="csc") * 1j,
        "camera": {"K": np.eye(3), "nothing": {}},
    }
    path = tmp_path / "clip.mat"
    scipy.io.savemat(path, {"Data": data}, do_compression=do_compression)
    loaded = load_tracks(path)
    np.testing.assert_array_equal(loaded.data, X)
    np.testing.assert_array_equal(loaded.target, Y)


def test_an_empty_cell_of_no_bytes_is_read_as_scipy_reads_it(tmp_path):
    path = tmp_path / "clip.mat"
    cell_of(element(14, b""), element(14, b""))(path)
    content, names = read_mat5(path, ["Data"])
    assert names == ["Data"]
    assert [part.size for part in content["Data"]] == [0, 0]


@pytest.mark.parametrize("name", ["zeros.npz", "zeros.mat"])
def test_zeros_that_would_take_far_more_than_their_file(name, tmp_path, monkeypatch):
    monkeypatch.setattr("skmotionseg.datasets._sizes.FREE_BYTES", 0)
    path, zeros = tmp_path / name, np.zeros((1000, 800))
    if path.suffix == ".npz":
        np.savez_compressed(path, X=zeros)
    else:
        scipy.io.savemat(path, {"y": zeros}, do_compression=True)
    most = 100 * path.stat().st_size
    words = rf"would take 64\d+ bytes, out of a file of .*: expected {most} at most"
    with pytest.raises(ValueError, match=words):
        load_tracks(path)


@pytest.mark.parametrize(
    "content, words",
    [
        (npy_header((3, 4)), r"claims the shape \(3, 4\) .*96 bytes, but holds 16"),
        (npy_header((-2, -1)), r"claims the shape \(-2, -1\)"),
        (b"\x93NUMPY\x07\x00" + npy_header((2, 1))[8:], r"version, \(7, 0\)"),
    ],
    ids=["too few", "negative", "version"],
)
def test_arrays_that_are_not_what_they_claim(content, words, tmp_path):
    npz_of(tmp_path / "clip.npz", [content, bytes(16)])
    with pytest.raises(ValueError, match=f"'X' .*{words}"):
        load_tracks(tmp_path / "clip.npz")


def test_what_is_small_and_honest_is_read(tmp_path, monkeypatch):
    """Tracks seen throughout, which packs to a thousandth; a text that is sparse."""
    monkeypatch.setattr("skmotionseg.datasets._sizes.FREE_BYTES", 0)
    n_tracks, n_frames = 300, 400
    points = np.random.default_rng(0).normal(size=(n_tracks, n_frames, 2))
    seen = np.ones((n_tracks, n_frames), dtype=bool)
    np.savez_compressed(tmp_path / "seen.npz", points=points, visibility=seen)
    assert load_tracks(tmp_path / "seen.npz").data.shape == (n_tracks, 2 * n_frames)
    rows = [f"{t},{f},1.25,2.75" for t in range(300) for f in range(t, t + 6)]
    (tmp_path / "sparse.csv").write_text("\n".join(["track,frame,x,y", *rows]))
    assert load_tracks(tmp_path / "sparse.csv").data.shape == (300, 610)


def png_claim(width, height):
    def chunk(name, data):
        body = name + data
        return struct.pack(">I", len(data)) + body + struct.pack(">I", zlib.crc32(body))

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    pixels = zlib.compress(bytes(10**6))
    return (
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", header)
        + chunk(b"IDAT", pixels)
        + chunk(b"IEND", b"")
    )


def jpeg_claim(cv2, width, height):
    content = cv2.imencode(".jpg", np.zeros((8, 8, 3), np.uint8))[1].tobytes()
    start = content.index(b"\xff\xc0") + 5
    size = struct.pack(">HH", height, width)
    return content[:start] + size + content[start + 4 :]


@pytest.mark.parametrize(
    "between, is_read",
    [
        (b"", True),
        (b"\xff\xff", True),  # padding
        (b"\xff\x01", True),  # a marker that nothing follows
        (b"\x00\x00", False),  # no marker
        (b"\xff\xe0\xff\xff", False),  # a segment that goes on after the end
    ],
)
def test_what_comes_before_the_size_of_a_jpeg(between, is_read, tmp_path):
    cv2 = pytest.importorskip("cv2", reason="needs opencv-python-headless")
    content = cv2.imencode(".jpg", np.zeros((16, 24, 3), np.uint8))[1].tobytes()
    (tmp_path / "0.jpg").write_bytes(content[:2] + between + content[2:])
    if is_read:
        (frame,) = open_frames(tmp_path)
        assert frame.shape == (16, 24, 3)
    else:
        with pytest.raises(ValueError, match=r"0.jpg is not a picture .* whole .png"):
            list(open_frames(tmp_path))


def test_frames_that_claim_to_be_huge(tmp_path):
    cv2 = pytest.importorskip("cv2", reason="needs opencv-python-headless")
    claims = {"png": png_claim(40_000, 30_000), "jpg": jpeg_claim(cv2, 60_000, 50_000)}
    for ending, content in claims.items():
        folder = tmp_path / ending
        folder.mkdir()
        (folder / f"0.{ending}").write_bytes(content)
        with pytest.raises(ValueError, match=rf"0.{ending} claims frames of .0000 x "):
            list(open_frames(folder))
    (tmp_path / "jpg" / "0.jpg").write_bytes(b"BM" + bytes(60))
    with pytest.raises(ValueError, match="expected a whole "):
        list(open_frames(tmp_path / "jpg"))
