"""Track files of several kinds, read into one form."""

from __future__ import annotations

import csv
import os
from functools import partial
from pathlib import Path
from textwrap import shorten

import numpy as np
from sklearn.utils import Bunch

from .._core.geometry.tracks import pack_tracks, unpack_tracks
from .._utils.column_names import (
    INDEX_NAMES,
    LABEL_NAMES,
    TRACK_NAMES,
    check_columns,
    initials,
)
from ._mat5 import read_mat5
from ._moseg import read_moseg_tracks
from ._sizes import check_table, whole_numbers
from ._trackers import (
    in_pixels,
    read_npz,
    usual_layout,
    warn_if_normalized,
    warn_if_swapped,
)

KINDS = {
    ".npz": "an archive of numpy.savez with points or X",
    ".npy": "an array of numpy.save, points or X",
    ".mat": "a MATLAB file of version 5 or 7",
    ".csv": "one row per track, or columns track,frame,x,y",
    ".dat": "the text that MoSeg writes",
}
# Which options a kind of file takes.
OPTIONS = {
    ".npz": ("layout", "image_size", "visible_above"),
    ".npy": ("layout", "image_size"),
    ".csv": ("image_size",),
}
# Names of the columns of a table with one row per observation.
OBSERVATION_NAMES = {
    "track": (*TRACK_NAMES, "point", "point_id", "trajectory"),
    "frame": ("frame", "frame_id", "t", "time", "image"),
    "x": ("x",),
    "y": ("y",),
    "label": LABEL_NAMES,
    "visible": ("visible", "visibility"),
    "occluded": ("occluded",),
}
NEEDED = ("track", "frame", "x", "y")
# Correlation, along both axes, of points with where they were a frame before.
ALONG = 0.9
# Share of the rows of a table that go on from the one above, if it is in order.
MOST_ROWS = 0.5
# Columns that may hold truth values, and what an observation has there.
SEEN = {"visible": True, "occluded": False}
TRUTH = {"true": 1.0, "false": 0.0}
PICKLES = (".pkl", ".pickle", ".pt", ".pth")


def load_tracks(
    path: str | os.PathLike[str],
    *,
    layout: str | None = None,
    image_size: tuple[int, int] | None = None,
    visible_above: float | None = None,
) -> Bunch:
    """Read tracks from a file.

    Parameters
    ----------
    path : str or path-like
        ``.npz``: ``points`` (n_tracks, n_frames, 2) and, if some are unseen,
        ``visibility`` (n_tracks, n_frames); or ``X`` (n_tracks, 2 * n_frames). A
        ``labels`` array is optional. Or what point trackers give, under their names for
        it (of two axes, it is taken as ``X``, too, as are such ``points``):

        - CoTracker: ``pred_tracks`` (1, n_frames, n_tracks, 2), ``pred_visibility``
          (1, n_frames, n_tracks);
        - TAPIR: ``tracks`` (n_tracks, n_frames, 2) with ``visibles`` or ``occluded``,
          or with the logits ``occlusion`` and, if any, ``expected_dist``, all
          (n_tracks, n_frames);
        - TAP-Vid: ``points`` (n_tracks, n_frames, 2), each coordinate a share of the
          image's size, with ``occluded`` (n_tracks, n_frames) and ``video``
          (n_frames, height, width, 3), of which the shape alone is read.

        All with or without the batch axis of one video. ``tracks`` (1, n_frames,
        n_tracks, 2) with ``visibility`` are taken as CoTracker's; without the batch
        axis they come in either order of axes, which ``layout`` must tell.

        ``.npy``: one array, ``X`` (n_tracks, 2 * n_frames) or points (n_tracks,
        n_frames, 2), NaN where unseen.

        ``.mat``: a benchmark's file, with a struct ``Data`` (KT3DMoSeg, MTPV62,
        Hopkins12), with ``y`` and ``s`` (Hopkins155), or with ``data`` and ``label``
        (AdelaideRMF, two images).

        ``.csv``: with a header ``track,frame,x,y`` (also ``id`` or ``t``; and, if
        known, ``label``, that of the last frame with one counting for a track, and
        ``visible`` or ``occluded``), one row per observation, frames counted from any
        number; or one row per track and two columns per frame, in the order of frames,
        empty where unseen, with or without a header. Under a header, a first column
        that holds the index, as pandas writes it, becomes ``track_ids``, and a column
        ``label`` becomes ``target``. Columns may also be separated by semicolons
        (commas are decimal then), tabs or, if none is empty, blanks.

        ``.dat``: text of MoSeg, the program of Brox, Malik and Ochs.
    layout : {"tracks_first", "frames_first"}, optional
        Order of the axes in a .npz or .npy file, where its names do not tell it or
        tell it wrong.
    image_size : (int, int), optional
        Width and height of the video, to make pixels of shares of them, in a .npz,
        .npy or .csv file.
    visible_above : float, optional
        What probabilities of being visible count as seen, in a .npz file.

    Returns
    -------
    Bunch
        ``data`` (n_tracks, 2 * n_frames): pixels, NaN where unseen; ``target``
        (n_tracks,): labels from 0, or as a .npz or .csv file has them, -1 for outliers,
        or None; ``name``: the file's name without its ending. KT3DMoSeg files also give
        ``dense_data``, all tracks before thinning, and ``dense_index``, where in them
        the labelled ones are; a .csv of observations or with an index, and a .npz that
        has them, give ``track_ids``, the name of each row; a .dat gives
        ``track_labels``, the motions that its writer found.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ValueError
        If the file is not one of these. Pickles, as of PyTorch and TAP-Vid, are not
        read: loading one runs what code it holds.

    Warns
    -----
    UserWarning
        If all coordinates, of eight tracks or more, are at most 2, so that they cannot
        be pixels; or if tracks and frames seem to be in each other's place.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> from skmotionseg.datasets import load_tracks
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "two.csv")
    ...     _ = path.write_text("0,0,1,0\\n5,5,,\\n")
    ...     load_tracks(path).data
    array([[ 0.,  0.,  1.,  0.],
           [ 5.,  5., nan, nan]])
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"no track file at {path}")
    read = _reader(path, layout, image_size, visible_above)
    try:
        fields = read(path)
        size = fields.pop("image_size", None)
        _check_fields(fields, size if image_size is None else image_size)
    except Exception as error:  # whatever a reader meets in a broken file
        raise ValueError(
            f"{path} is not a track file: {_in_words(error)} (expected "
            f"{KINDS[path.suffix.lower()]})"
        ) from error
    warn_if_normalized(fields["data"], path.name)
    if layout is None and "layout" in OPTIONS.get(path.suffix.lower(), ()):
        warn_if_swapped(fields["data"], path.name)
    return Bunch(**{"target": None, "name": path.stem, **fields})


def _in_words(error):
    """What an error says, in one line; some say nothing but their name."""
    words = shorten(str(error), width=300, placeholder=" ...")
    if isinstance(error, MemoryError):
        words = f"there is not enough memory for it {words}".rstrip()
    return words or type(error).__name__


def _reader(path, layout, image_size, visible_above):
    """The reader for the file's ending."""
    options = {
        "layout": layout,
        "image_size": image_size,
        "visible_above": visible_above,
    }
    readers = {
        ".npz": partial(
            read_npz,
            layout=layout,
            visible_above=visible_above,
            size_known=image_size is not None,
        ),
        ".npy": partial(_read_npy, layout=layout),
        ".mat": _read_mat,
        ".csv": _read_csv,
        ".dat": read_moseg_tracks,
    }
    ending = path.suffix.lower()
    if ending in PICKLES:
        raise ValueError(
            f"{path.name!r} is a pickle, which runs what code it holds when it is "
            "loaded: load it yourself if you trust it, and write its arrays with "
            "numpy.savez under the same names"
        )
    if ending not in readers:
        raise ValueError(
            f"track files end in .npz, .npy, .mat or .csv; got {path.name!r} (the .dat "
            "of MoSeg is read, too; skmotionseg.video.track_video makes tracks of a "
            "video)"
        )
    for name, value in options.items():
        if value is not None and name not in OPTIONS.get(ending, ()):
            kinds = " and ".join(kind for kind in OPTIONS if name in OPTIONS[kind])
            raise ValueError(f"{name} is for {kinds} files; got {path.name!r}")
    return readers[ending]


def _check_fields(fields, image_size):
    """Raise unless there are finite tracks and, if any, a label for each.

    Tracks that are shares of an image's size, if one is given, become pixels.
    """
    fields["data"] = pack_tracks(
        unpack_tracks(fields["data"])[0], layout="tracks_first"
    )
    if image_size is not None:
        fields["data"] = in_pixels(fields["data"], image_size)
    labels = fields.get("target")
    if labels is not None and labels.shape != (len(fields["data"]),):
        raise ValueError(
            f"{len(fields['data'])} tracks need as many labels; got {labels.shape}"
        )


def _read_npy(path, layout):
    with path.open("rb") as file:
        start = file.read(len(np.lib.format.MAGIC_PREFIX))
    if start.startswith(b"PK"):
        raise ValueError("it is an archive of arrays: rename it to end in .npz")
    if start != np.lib.format.MAGIC_PREFIX:
        raise ValueError("it does not start like a file that numpy.save has written")
    array = np.load(path, mmap_mode="r", allow_pickle=False)
    if array.ndim == 2 and layout is None:
        return {"data": array}
    return {"data": pack_tracks(array, layout=layout or usual_layout(array))}


def _read_mat(path):
    content, found = read_mat5(path, ("Data", "y", "s", "data", "label"))
    if "Data" in content:
        return _read_struct(content["Data"])
    if "y" in content and "s" in content:
        return {
            "data": _pack_homogeneous(content["y"], None, "y"),
            "target": _labels_from_one(content["s"]),
        }
    if "data" in content and "label" in content:
        return {
            "data": _pack_correspondences(content["data"]),
            "target": _labels_from_one(content["label"]),
        }
    raise ValueError(
        "expected a struct 'Data' or the arrays 'y' and 's', or 'data' and 'label'; "
        f"got {found}"
    )


def _read_struct(data):
    """The struct of KT3DMoSeg, MTPV62 and Hopkins12."""
    names = getattr(data, "_fieldnames", [])
    missing = [name for name in ("ySparse", "GtLabel") if name not in names]
    if missing:
        raise ValueError(f"struct 'Data' has no field {missing}; got {list(names)}")
    fields = {
        "data": _pack_homogeneous(
            data.ySparse, getattr(data, "visibleSparse", None), "ySparse"
        ),
        "target": _labels_from_one(data.GtLabel),
    }
    if "yAll" in names:
        for name in ("visibleAll", "SparseIndex"):
            if name not in names:
                raise ValueError(f"struct 'Data' has 'yAll' but no {name!r}")
        fields["dense_data"] = _pack_homogeneous(data.yAll, data.visibleAll, "yAll")
        fields["dense_index"] = whole_numbers(data.SparseIndex, "'SparseIndex'") - 1
    return fields


def _pack_homogeneous(points, visibility, name):
    """Tracks from homogeneous pixels (3, n_tracks, n_frames)."""
    points = np.asarray(points)
    if points.ndim != 3 or points.shape[0] != 3:
        raise ValueError(
            f"{name!r} must have shape (3, n_tracks, n_frames); got {points.shape}"
        )
    x, y, w = points.astype(float)
    unseen = np.isnan(x + y) | (x == 0) & (y == 0)
    if np.shape(visibility) == x.shape:
        unseen |= ~np.asarray(visibility).astype(bool)
    if not (unseen | (w == 1)).all():
        raise ValueError(
            f"the third coordinates of {name!r}, homogeneous pixels, must be 1 where a "
            "track is seen: divide the others by them"
        )
    return pack_tracks(np.stack([x, y], axis=2), visibility, layout="tracks_first")


def _pack_correspondences(data):
    """Tracks from homogeneous pixels of two images, (6, n_tracks)."""
    data = np.asarray(data)
    if data.dtype.kind not in "fiub":
        raise ValueError(f"'data' must be numbers; got an array of {data.dtype}")
    if data.ndim == 1:  # of a single track
        data = data[:, None]
    if data.ndim != 2 or data.shape[0] != 6:
        raise ValueError(
            "'data' must have shape (6, n_tracks), homogeneous pixels of two images; "
            f"got {data.shape}"
        )
    if not (data[[2, 5]] == 1).all():
        raise ValueError("rows 3 and 6 of 'data' must be 1: pixels are homogeneous")
    return data[[0, 1, 3, 4]].T.astype(float)


def _labels_from_one(labels):
    return np.atleast_1d(whole_numbers(labels, "labels")) - 1


def _read_csv(path):
    # Spreadsheets begin their files with a byte-order mark, which is no part of a name.
    with path.open(newline="", encoding="utf-8-sig") as file:
        lines = [line for line in file if line.strip()]
    if not lines:
        raise ValueError("it is empty")
    rows = _cells(lines)
    header = [name.strip().lower() for name in rows[0]]
    widths = {len(row) for row in rows}
    if len(widths) > 1:
        raise ValueError(f"rows differ in length: {sorted(widths)}")
    columns = _observation_columns(header)
    if columns.keys() >= set(NEEDED):
        return _read_observations(columns, rows[1:], path.stat().st_size)
    others = [name for name in header if name not in (*INDEX_NAMES, *LABEL_NAMES)]
    if {"x", "y"} <= set(others) and any(name[0] not in "xy" for name in others):
        raise _lack_of_columns(header)
    return _read_wide(header, rows)


def _cells(lines):
    """The cells of lines, which semicolons, tabs, commas or blanks separate.

    Beside semicolons, commas are decimal. Blanks may stand beside any of the others.
    """
    # numpy.savetxt begins a header with "# ".
    lines = [lines[0].removeprefix("#").strip(" \r\n"), *lines[1:]]
    separators = [one for one in ";\t," if one in lines[0]]
    if separators[:1] == [";"]:
        lines = [line.replace(",", ".") for line in lines]
    if not separators and " " in lines[0]:
        return [line.split() for line in lines]
    return list(csv.reader(lines, delimiter=(separators or ",")[0]))


def _observation_columns(header):
    """The place of each column that a row per observation has, by its kind."""
    places = {}
    for kind, names in OBSERVATION_NAMES.items():
        there = [name for name in names if name in header]
        if there:
            places[kind] = header.index(there[0])
    return places


def _lack_of_columns(header):
    """The error that a table of observations has other columns than are needed."""
    return ValueError(
        f"a table with one row per observation needs the columns {', '.join(NEEDED)}; "
        f"got {', '.join(header)}"
    )


def _read_wide(header, rows):
    """Tracks from one row per track."""
    if not _is_header(header):
        table = np.array([[_number(cell) for cell in row] for row in rows])
        if _counts_observations(table):
            raise ValueError(
                "its first two columns count tracks and frames, as if there were one "
                "row per observation: begin the file with the line track,frame,x,y, "
                "or with x0,y0,x1,y1 if they are the points of two frames"
            )
        return {"data": table}
    if len(rows) == 1:
        raise ValueError("there are no tracks below its header")
    table = np.array([[_number(cell) for cell in row] for row in rows[1:]])
    if _counts_observations(table) and initials(header) != "xyxy":
        raise ValueError(
            "two of its four columns count, as if there were one row per observation: "
            f"name them track, frame, x and y; got {', '.join(header)}"
        )
    if {"track", "frame"} <= _observation_columns(header).keys():
        raise _lack_of_columns(header)
    fields = {}
    columns = list(range(len(header)))
    for i in [i for i in columns if header[i] in LABEL_NAMES][:1]:
        fields["target"] = whole_numbers(table[:, i], f"the column {header[i]!r}")
        columns.remove(i)
    if columns and header[columns[0]] in INDEX_NAMES:
        place = columns.pop(0)
        fields["track_ids"] = _ids([row[place] for row in rows[1:]])
    names = [header[i] for i in columns]
    check_columns(names)
    return {"data": table[:, columns], **fields}


def _is_header(cells):
    """Whether cells are names, or count the columns from 0, as pandas does."""
    numbers = [cell for cell in cells if cell and _is_number(cell)]
    if numbers != [str(i) for i in range(len(numbers))]:
        return False
    named = len(numbers) < len([cell for cell in cells if cell])
    return named or (len(numbers) > 3 and all(cells[1:]))


def _counts_observations(table):
    """Whether a table seems to have one row per observation.

    So it seems with whole numbers of several tracks and frames, of which those of one
    follow each other without a gap, and no pair of which comes twice, beside two
    columns that are not whole numbers throughout, unless the rows are in the order of
    both. Not so if these go along with them: then points were on whole pixels in the
    first of two frames.
    """
    if table.shape[1] != 4 or len(table) < 2:
        return False
    counters, points = table[:, :2], table[:, 2:]
    if not (counters == np.floor(counters)).all():
        return False
    if (points == np.floor(points)).all() and not _are_in_order(counters):
        return False
    named = [np.unique(values) for values in counters.T]
    several = min(map(len, named)) > 1
    without_gap = any((np.diff(each) == 1).all() for each in named)
    once = len(np.unique(counters, axis=0)) == len(table)
    return several and without_gap and once and not _go_along(points, counters)


def _are_in_order(counters):
    """Whether, in most rows, one of two columns goes on by one, and the other not."""
    steps = np.diff(counters, axis=0)
    return bool(
        max(np.mean((steps == step).all(axis=1)) for step in ([0, 1], [1, 0]))
        > MOST_ROWS
    )


def _go_along(points, others):
    """Whether points (n, 2), as far as they are known, are about where others are."""
    seen = np.isfinite(points).all(axis=1)
    if not seen.any():
        return False
    one, other = (each[seen] - each[seen].mean(axis=0) for each in (points, others))
    spreads = np.sqrt((one**2).sum(axis=0) * (other**2).sum(axis=0))
    return bool(((one * other).sum(axis=0) > ALONG * spreads).all())


def _is_number(cell):
    try:
        _number(cell)
    except ValueError:
        return False
    return True


def _read_observations(places, rows, file_size):
    """Tracks from one row per observation; ``places`` are of the columns, by kind."""
    if not rows:
        raise ValueError("there are no observations below its header")
    columns = {
        kind: np.array([(_truth if kind in SEEN else _number)(row[i]) for row in rows])
        for kind, i in places.items()
        if kind != "track"
    }
    ids = _ids([row[places["track"]] for row in rows])
    if not np.isfinite(ids).all():
        raise ValueError("the column 'track' must be a number in each row")
    tracks, row = np.unique(ids, return_inverse=True)
    frame = whole_numbers(columns["frame"], "the column 'frame'")
    frame -= frame.min()
    if len(set(zip(row, frame, strict=True))) < len(row):
        raise ValueError("a track is seen twice in the same frame")
    n_frames = int(frame.max()) + 1
    check_table(len(tracks), n_frames, file_size)
    points = np.full((len(tracks), n_frames, 2), np.nan)
    observed = np.column_stack([columns["x"], columns["y"]])
    points[row, frame] = np.where(_seen(columns)[:, None], observed, np.nan)
    labels = None
    if "label" in columns:
        labels = _last_labels(len(tracks), row, frame, columns["label"])
    data = pack_tracks(points, layout="tracks_first")
    fields = {"data": data, "target": labels, "track_ids": tracks}
    return fields


def _last_labels(n_tracks, row, frame, labels):
    """The label of the last frame in which each track has one; -1 if in none."""
    named = np.flatnonzero(~np.isnan(labels))
    named = named[np.argsort(frame[named], kind="stable")]
    found = np.full(n_tracks, -1)
    found[row[named]] = whole_numbers(labels[named], "the column 'label'")
    return found


def _seen(columns):
    """Whether each observation is one: visible, and not occluded."""
    seen = np.ones(len(columns["frame"]), dtype=bool)
    for kind, value in SEEN.items():
        if kind in columns:
            if not np.isin(columns[kind], (0, 1)).all():
                raise ValueError(f"the column {kind!r} must be 0 or 1 in each row")
            seen &= columns[kind] == value
    return seen


def _ids(cells):
    """Names of tracks: int64 where all are whole, and so exact; else float."""
    try:
        return np.array([int(cell) for cell in cells], dtype=np.int64)
    except OverflowError:
        raise ValueError("track ids must be below 2**63 in magnitude") from None
    except ValueError:
        return np.array([_number(cell) for cell in cells])


def _truth(cell):
    name = cell.strip().lower()
    return TRUTH[name] if name in TRUTH else _number(cell)


def _number(cell):
    return float(cell) if cell.strip() else np.nan
