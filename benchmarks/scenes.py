"""Tracks to measure on: synthetic scenes of any size."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation
from sklearn.utils import Bunch, check_random_state

from skmotionseg import pack_tracks
from skmotionseg.datasets import make_rigid_motions

# Tracks and frames of eleven KT3DMoSeg clips, a third of whose entries is unseen.
CLIP_SIZES = (
    *((646, 20), (454, 20), (473, 16), (557, 20), (520, 20), (242, 15)),
    *((186, 10), (643, 20), (158, 10), (1018, 20), (419, 20)),
)
PERIOD = 200  # frames in which everything of a long scene swings to and fro


def clip_like(n_tracks, n_frames, random_state=0):
    """A synthetic clip as KT3DMoSeg has them."""
    X, y = make_rigid_motions(
        n_tracks, n_frames, missing=0.34, random_state=random_state
    )
    return Bunch(data=X, target=y, name=f"synthetic {n_tracks} x {n_frames}")


def many_tracks(n_tracks, n_frames=20):
    """Five motions, a fifth of the entries unseen: (X, y)."""
    return make_rigid_motions(
        n_tracks, n_frames, n_motions=5, missing=0.2, random_state=0
    )


def many_frames(n_tracks, n_frames, n_seen=50, random_state=0):
    """A long video in which most tracks are seen briefly, and one in twenty longer.

    The camera and two objects swing, so that all stays in front of the camera however
    long the video is.

    Returns
    -------
    X : ndarray of shape (n_tracks, 2 * n_frames)
    y : ndarray of int, shape (n_tracks,)
    """
    rng = check_random_state(random_state)
    phase = 2 * np.pi * np.arange(n_frames)[:, None] / PERIOD
    y = rng.randint(3, size=n_tracks)
    depth = np.where(y == 0, rng.uniform(8, 40, n_tracks), rng.uniform(8, 11, n_tracks))
    image = rng.uniform(-0.6, 0.6, (n_tracks, 2))  # in focal lengths
    world = np.column_stack([image, np.ones(n_tracks)]) * depth[:, None]
    points = np.empty((n_tracks, n_frames, 2))
    for motion in range(3):  # as the camera sees it, the background moves too
        sway = np.sin(phase + rng.uniform(0, 2 * np.pi, 3)) * [5, 4, 3]
        turn = 0.4 * np.sin(phase + rng.uniform(0, 2 * np.pi, 3))
        turn = Rotation.from_rotvec(turn).as_matrix()
        local = world[y == motion] - [0, 0, 10]
        seen = np.einsum("fij,nj->nfi", turn, local) + sway + [0, 0, 10]
        points[y == motion] = seen[..., :2] / np.maximum(seen[..., 2:], 0.5)
    points = 1000 * points + 0.5 * rng.standard_normal(points.shape)  # pixels
    length = np.where(rng.uniform(size=n_tracks) < 0.05, 10 * n_seen, n_seen)
    length = np.minimum(length, n_frames)[:, None]
    first = (rng.uniform(size=(n_tracks, 1)) * (n_frames - length + 1)).astype(int)
    frames = np.arange(n_frames)
    return pack_tracks(points, (frames >= first) & (frames < first + length)), y
