"""Scenes with a graph, and searches among their rigid motions."""

from __future__ import annotations

import numpy as np

from skmotionseg import unpack_tracks
from skmotionseg._core.geometry.windows import Windows
from skmotionseg._core.labels import canonical_labels
from skmotionseg._core.partition.rigid_search import RigidSearch
from skmotionseg.datasets import make_rigid_motions, make_scene


def linked_scene():
    """Tracks, true labels, and a graph of neighbours in place and displacement."""
    X, y = make_rigid_motions(n_tracks=160, n_frames=12, random_state=1)
    points, visibility = unpack_tracks(X)
    place = np.nanmean(points, axis=1)
    moved = 20 * np.nanmean(np.diff(points, axis=1), axis=1)
    features = np.column_stack([place, np.nan_to_num(moved)])
    distance = np.linalg.norm(features[:, None] - features, axis=2)
    affinity = np.exp(-((distance / np.partition(distance, 8, axis=1)[:, 8:9]) ** 2))
    affinity[affinity < 0.1] = 0
    return points, visibility, affinity + affinity.T, canonical_labels(y)


def exact_street():
    """Tracks of a scene without much noise, their labels, and its focal length."""
    exact = {"outliers": 0.0, "noise": 0.1, "drift": 0.0, "distortion": 0.0}
    exact |= {"motion_noise": 0.0, "texture": 1, "focal": 0.7}
    simulated = make_scene(
        "street", n_tracks=300, n_frames=12, life=100, random_state=1, **exact
    )
    points, visibility = unpack_tracks(simulated.data)
    true = simulated.focal / np.nanmax(np.ptp(points[visibility], axis=0))
    return points, visibility, canonical_labels(simulated.target), true


def done(search, what):
    """What one search returns."""
    (found,) = search.run(what)
    return found


def search_of(scene):
    points, visibility, affinity, _ = scene
    return RigidSearch(Windows(points, visibility), affinity)


def before_a_still_camera(rng, n_tracks=120, n_frames=8, begins=0):
    """What stands still, and something that moves off along a straight line."""
    points = rng.uniform(0, 640, size=(n_tracks, 1, 2)) + np.zeros((n_frames, 2))
    y = (np.arange(n_tracks) < n_tracks // 4).astype(int)
    depth = rng.uniform(0.9, 1.1, size=(n_tracks, 1))
    way = np.maximum(np.arange(n_frames) - begins, 0)
    points[y == 1, :, 0] += 3 * way * depth[y == 1]
    points += 0.1 * rng.standard_normal(points.shape)
    visibility = np.ones((n_tracks, n_frames), dtype=bool)
    affinity = np.where(y[:, None] == y, 1.0, 0.05)
    return points, visibility, affinity, y


def before_a_camera_that_drives(rng, n_tracks=120, n_frames=8):
    """What stands still, and something that drives away faster, straight ahead."""
    y = (np.arange(n_tracks) < n_tracks // 4).astype(int)
    depth = np.where(y == 1, rng.uniform(2, 2.5, n_tracks), rng.uniform(3, 9, n_tracks))
    way = 0.2 * np.arange(n_frames) * np.where(y == 1, 1, -1)[:, None]
    middle = np.where(y == 1, 0.15, 0.5)[:, None] * rng.uniform(-1, 1, (n_tracks, 2))
    points = middle[:, None] * (depth[:, None] / (depth[:, None] + way))[..., None]
    points = 640 * points + 320 + 0.1 * rng.standard_normal(points.shape)
    visibility = np.ones((n_tracks, n_frames), dtype=bool)
    return points, visibility, np.where(y[:, None] == y, 1.0, 0.02), y


def turned_slowly(rng, n_tracks=120, n_frames=30):
    """What turns about an axis, and something inside of it that turns faster."""
    y = (np.arange(n_tracks) < n_tracks // 3).astype(int)
    world = rng.uniform(-1, 1, (n_tracks, 3)) * np.where(y == 1, 0.3, 1)[:, None]
    angles = np.arange(n_frames)[:, None] * np.where(y == 1, 0.05, 0.01)
    x, height, z = world.T
    sine, cosine = np.sin(angles), np.cos(angles)
    x, z = cosine * x + sine * z, cosine * z - sine * x + 4
    points = 320 + 640 * np.stack([x / z, height / z], axis=-1).swapaxes(0, 1)
    points += 0.1 * rng.standard_normal(points.shape)
    visibility = np.ones((n_tracks, n_frames), dtype=bool)
    return points, visibility, np.where(y[:, None] == y, 1.0, 0.05), y
