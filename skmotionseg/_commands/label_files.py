"""Files of labels that ``skmotionseg segment`` writes."""

from __future__ import annotations

import numpy as np

from .._core.geometry.tracks import unpack_tracks
from .._utils.writing import replacing

LABEL_ENDINGS = (".npz", ".csv")
# Columns of a table with a row per observation, and how they are written.
OBSERVATIONS = "track,frame,x,y,label", "%d,%d,%.3f,%.3f,%d"
TRACKS = "track,label", "%d,%d"
# Ids that are no whole numbers, as a table may have them.
NAMED = "track,label", "%.15g,%d"


def write_labels(path, sequence, labels, probabilities=None):
    """Write labels: .npz, with the tracks; .csv, of a video with its observations.

    Parameters
    ----------
    path : Path
    sequence : Bunch
        Tracks with their ``track_ids``; ``video`` is empty if they are of a file.
    labels : ndarray of int, shape (n_tracks,)
    probabilities : ndarray of shape (n_tracks,), optional
        Written beside them.
    """
    with replacing(path) as file:
        if path.suffix.lower() == ".npz":
            sure = {} if probabilities is None else {"probabilities": probabilities}
            np.savez_compressed(
                file,
                X=sequence.data,
                labels=labels,
                track_ids=sequence.track_ids,
                **sure,
                **sequence.video,
            )
            return
        kind = TRACKS if sequence.track_ids.dtype.kind in "iu" else NAMED
        columns = [sequence.track_ids, labels]
        if sequence.video:  # nobody else has these tracks
            kind = OBSERVATIONS
            track, columns = _observations(sequence, labels)
        if probabilities is not None:
            columns.append(probabilities[track] if sequence.video else probabilities)
        header, form = _columns(kind, probabilities is not None)
        table = np.rec.fromarrays(columns)  # a matrix would round large ids
        np.savetxt(file, table, fmt=form, header=header, comments="")


def _columns(kind, sure):
    """Names and format of the columns of a table, perhaps with probabilities."""
    header, form = kind
    return (f"{header},probability", f"{form},%.3f") if sure else kind


def _observations(sequence, labels):
    """The track, and track, frame, x, y and label, each time that a track is seen."""
    points, visibility = unpack_tracks(sequence.data)
    track, frame = np.nonzero(visibility)
    names = sequence.track_ids[track]
    return track, [names, frame, *points[track, frame].T, labels[track]]


def write_labels_by_frame(path, clip, labels, probabilities=None):
    """Write a row per observation, frame by frame, of tracks that are in files.

    Parameters
    ----------
    path : Path
    clip : StoredClip
    labels : ndarray of int, shape (n_tracks,)
    probabilities : ndarray of shape (n_tracks,), optional
        Written beside them.
    """
    with replacing(path) as file:
        begin_observations(file, probabilities is not None)
        for number, (rows, points) in enumerate(clip.frames()):
            sure = None if probabilities is None else probabilities[rows]
            write_frame(file, number, rows, points, labels[rows], sure)


def begin_observations(file, sure=False):
    """Write the names of the columns of a table with a row per observation."""
    header, _ = _columns(OBSERVATIONS, sure)
    file.write(f"{header}\n".encode())


def write_frame(file, number, ids, points, labels, probabilities=None):
    """Write a row per track that is seen in a frame.

    Parameters
    ----------
    file : binary file
        After :func:`begin_observations`.
    number : int
        Of the frame.
    ids, labels : ndarray of int, shape (n,)
    points : ndarray of shape (n, 2)
    probabilities : ndarray of shape (n,), optional
    """
    _, form = _columns(OBSERVATIONS, probabilities is not None)
    columns = [ids, np.full(len(ids), number), points, labels]
    if probabilities is not None:
        columns.append(probabilities)
    np.savetxt(file, np.column_stack(columns), fmt=form)
