"""Track files of several kinds, read into one form."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import scipy.io
from sklearn.utils import Bunch

from .._core.tracks import pack_tracks, unpack_tracks


def load_tracks(path):
    """Read tracks from a file.

    Parameters
    ----------
    path : str or path-like
        ``.npz``: ``points`` (n_tracks, n_frames, 2) and, if some are unseen,
        ``visibility`` (n_tracks, n_frames); or ``X`` (n_tracks, 2 * n_frames). A
        ``labels`` array is optional.

        ``.mat``: a benchmark's file, with a struct ``Data`` (KT3DMoSeg, MTPV62,
        Hopkins12) or with ``y`` and ``s`` (Hopkins155).

        ``.csv``: with a header ``track,frame,x,y`` (and ``label``, if known), one row
        an observation, frames counted from any number; or without a header, one row a
        track and two columns a frame, empty where unseen.

    Returns
    -------
    Bunch
        ``data`` (n_tracks, 2 * n_frames): pixels, NaN where unseen; ``target``
        (n_tracks,): labels from 0, -1 for outliers, or None; ``name``: the file's name
        without its ending. KT3DMoSeg files also give ``dense_data``, all tracks before
        thinning, and ``dense_index``, where in them the labelled ones are; a .csv of
        observations gives ``track_ids``, what it calls each row.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ValueError
        If the file is not one of these.

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
    readers = {".npz": _read_npz, ".mat": _read_mat, ".csv": _read_csv}
    if path.suffix.lower() not in readers:
        raise ValueError(f"track files end in .npz, .mat or .csv; got {path.name!r}")
    try:
        fields = readers[path.suffix.lower()](path)
        _check_fields(fields)
    except Exception as error:  # whatever a reader meets in a broken file
        raise ValueError(f"{path} is not a track file: {error}") from error
    return Bunch(**{"target": None, "name": path.stem, **fields})


def _check_fields(fields):
    """Raise unless there are finite tracks and, if any, a label for each."""
    if np.isinf(fields["data"]).any():
        raise ValueError("tracks must be finite where they are seen; it has infinities")
    fields["data"] = pack_tracks(unpack_tracks(fields["data"])[0])
    labels = fields.get("target")
    if labels is not None and labels.shape != (len(fields["data"]),):
        raise ValueError(
            f"{len(fields['data'])} tracks need as many labels; got {labels.shape}"
        )


def _read_npz(path):
    with path.open("rb") as file, np.load(file, allow_pickle=False) as arrays:
        if "points" in arrays:
            data = pack_tracks(arrays["points"], arrays.get("visibility"))
        elif "X" in arrays:
            data = np.asarray(arrays["X"], dtype=float)
        else:
            raise ValueError(
                f"expected the array 'points' or 'X'; got {sorted(arrays)}"
            )
        labels = arrays["labels"].astype(int) if "labels" in arrays else None
    return {"data": data, "target": labels}


def _read_mat(path):
    content = scipy.io.loadmat(path, squeeze_me=True, struct_as_record=False)
    if "Data" in content:
        return _read_struct(content["Data"])
    if "y" in content and "s" in content:
        return {
            "data": _pack_homogeneous(content["y"], None, "y"),
            "target": _labels_from_one(content["s"]),
        }
    found = sorted(name for name in content if not name.startswith("__"))
    raise ValueError(f"expected a struct 'Data' or the arrays 'y' and 's'; got {found}")


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
        fields["dense_index"] = np.asarray(data.SparseIndex, dtype=int) - 1
    return fields


def _pack_homogeneous(points, visibility, name):
    """Tracks from homogeneous pixels (3, n_tracks, n_frames)."""
    points = np.asarray(points)
    if points.ndim != 3 or points.shape[0] != 3:
        raise ValueError(
            f"{name!r} must have shape (3, n_tracks, n_frames); got {points.shape}"
        )
    return pack_tracks(np.moveaxis(points[:2], 0, 2).astype(float), visibility)


def _labels_from_one(labels):
    return np.atleast_1d(np.asarray(labels, dtype=int)) - 1


def _read_csv(path):
    with path.open(newline="") as file:
        rows = [row for row in csv.reader(file) if row]
    if not rows:
        raise ValueError("it is empty")
    header = [name.strip().lower() for name in rows[0]]
    observations = {"track", "frame", "x", "y"} <= set(header)
    widths = {len(row) for row in rows}
    if len(widths) > 1:
        raise ValueError(f"rows differ in length: {sorted(widths)}")
    if observations:
        return _read_observations(header, rows[1:])
    return {"data": np.array([[_number(cell) for cell in row] for row in rows])}


def _read_observations(header, rows):
    """Tracks from one row an observation."""
    if not rows:
        raise ValueError("there are no observations under its header")
    columns = {
        name: np.array([_number(row[i]) for row in rows])
        for i, name in enumerate(header)
        if name in ("track", "frame", "x", "y", "label")
    }
    tracks, row = np.unique(columns["track"], return_inverse=True)
    frame = _whole(columns["frame"], "frame")
    frame -= frame.min()
    if len(set(zip(row, frame, strict=True))) < len(row):
        raise ValueError("a track is seen twice in the same frame")
    points = np.full((len(tracks), frame.max() + 1, 2), np.nan)
    points[row, frame, 0], points[row, frame, 1] = columns["x"], columns["y"]
    labels = None
    if "label" in columns:
        labels = np.empty(len(tracks), dtype=int)
        labels[row] = _whole(np.nan_to_num(columns["label"], nan=-1), "label")
    fields = {"data": pack_tracks(points), "target": labels, "track_ids": tracks}
    return fields


def _whole(numbers, name):
    """Numbers as integers, if that is what they are."""
    if not np.array_equal(numbers, np.round(numbers)):
        raise ValueError(f"the column {name!r} must hold whole numbers")
    return numbers.astype(int)


def _number(cell):
    return float(cell) if cell.strip() else np.nan
