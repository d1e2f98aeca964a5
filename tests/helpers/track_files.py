"""Files of tracks as trackers and benchmarks write them."""

from __future__ import annotations

import numpy as np
import scipy.io

from skmotionseg import unpack_tracks


def logit(visibility):
    return np.where(visibility, 6.0, -6.0).astype(np.float32)


def cell(number):
    return "" if np.isnan(number) else repr(float(number))


TRACKER_FILES = {
    "CoTracker": lambda p, v: {
        "pred_tracks": p.swapaxes(0, 1)[None],
        "pred_visibility": v.T[None],
    },
    "CoTracker, no batch": lambda p, v: {
        "pred_tracks": p.swapaxes(0, 1),
        "pred_visibility": v.T.astype(np.float32)[..., None],
    },
    "TAPIR": lambda p, v: {"tracks": p, "visibles": v},
    "TAPIR, occluded": lambda p, v: {"tracks": p[None], "occluded": ~v[None]},
    "TAPIR, logits": lambda p, v: {"tracks": p[None], "occlusion": -logit(v)[None]},
    "TAPIR, both logits": lambda p, v: {
        "tracks": p,
        "occlusion": -logit(v | (np.arange(4) % 2 == 0)),
        "expected_dist": -logit(v | (np.arange(4) % 2 == 1)),
    },
    "TAP-Vid": lambda p, v: {
        "points": p / [640, 512],
        "occluded": ~v,
        "video": np.zeros((4, 512, 640, 3), np.uint8),
    },
    "TAP-Vid, in pixels": lambda p, v: {"points": p[None], "occluded": ~v[None]},
    "with a layout": lambda p, v: {"points": p[None], "visibility": v[None]},
}


def observations(X, labels, *, shuffled=False, first_frame=0, ids=range(100, 0, -7)):
    points, visibility = unpack_tracks(X)
    rows = [
        f"{x},{ids[i]},{y},{frame + first_frame},{labels[i]}"
        for i, frame in zip(*np.nonzero(visibility), strict=True)
        for x, y in [map(cell, points[i, frame])]
    ]
    if shuffled:
        np.random.default_rng(0).shuffle(rows)
    return "\n".join([" x,Track , y,frame,label", *rows])


def write_struct(path, X, labels, *, visibility=True, dense=None):
    """A file of KT3DMoSeg (dense), MTPV62 or Hopkins12 (no visibility).

    Unseen points hold numbers, as theirs do.
    """
    points, seen = unpack_tracks(X)
    n_tracks, n_frames = seen.shape
    data = {
        "ySparse": homogeneous_pixels(points),
        "GtLabel": np.asarray(labels, dtype=np.uint8)[:, None] + 1,
        "nFrames": n_frames,
        "nSparsePoints": n_tracks,
    }
    if visibility:
        data["visibleSparse"] = seen.astype(np.uint8)
    if dense is not None:
        X_dense, index = dense
        points, seen = unpack_tracks(X_dense)
        data |= {
            "nAllPoints": len(X_dense),
            "yAll": homogeneous_pixels(points),
            "visibleAll": seen.astype(np.uint8),
            "SparseIndex": index[None] + 1,
        }
    scipy.io.savemat(path, {"Data": data})


def homogeneous_pixels(points):
    """Points (n, n_frames, 2) as (3, n, n_frames), 0 where unseen."""
    ones = np.ones((*points.shape[:2], 1))
    return np.concatenate([np.nan_to_num(points), ones], axis=2).transpose(2, 0, 1)
