"""Static scenes, with something that moves or without, that look like several motions.

    python -m benchmarks.static_scenes [--scenes 6] [--jobs 2] [--json FILE]

Two images of a street, whose ground and houses have displacements that are continued
by no common affine map; a room before a camera that shakes and reads its frames row by
row; and a scene before a camera that stands still or turns, where one rigid motion also
explains what goes straight on. A scene is right if each motion is found and fewer than
one track in twenty is wrong.
"""

from __future__ import annotations

import argparse
import warnings
from functools import partial
from pathlib import Path

import numpy as np
from joblib import Parallel, delayed
from scipy.spatial.transform import Rotation

from skmotionseg import MotionSegmenter
from skmotionseg.metrics import misclassification_error

from . import report
from .measuring import show_progress

# Pixels: of two images, and of a video.
PAIR_SIZE, PAIR_FOCAL = np.array([640.0, 480.0]), 600.0
TURNED_FOCAL = 550.0
VIDEO_SIZE, VIDEO_FOCAL = np.array([1280.0, 720.0]), 1000.0
# Of the tracks, in a scene that is right.
MOST_WRONG = 0.05
N_MOVING = 40
# The label of the thing that moves, beside those of the three surfaces of a street.
MOVING = 3
COLUMNS = {
    "scene": lambda row: row["row"],
    "scenes": lambda row: str(row["n_scenes"]),
    "static: right": report.number("static_right", "{:.0f}"),
    "motions found": report.number("static_found"),
    "error %": report.number("static_error"),
    "one moving: right": report.number("moving_right", "{:.0f}"),
    "found": report.number("moving_found"),
    "its error %": report.number("moving_error"),
}


def street(n_tracks=300, *, n_moving=0, noise=0.5, seed=0):
    """Two images of a street from beside, which goes away from the camera.

    Parameters
    ----------
    n_tracks : int
        A third each of the ground and of the houses on both sides.
    n_moving : int
        Tracks of a thing on the street that goes up and turns.
    noise : float
        Pixels.
    seed : int

    Returns
    -------
    X : ndarray of shape (n, 4)
    surfaces : ndarray of int, shape (n,)
        0 to 2 for the street, 3 for the thing.
    """
    rng = np.random.default_rng(seed)
    n = n_tracks // 3
    away = rng.uniform(6, 25, 3 * n)
    side, up = rng.uniform(-1, 1, n), rng.uniform(-1, 1, 2 * n)
    ground = np.column_stack([4 * side, np.full(n, 1.6), away[:n]])
    sides = np.repeat([-4.0, 4.0], n)
    houses = np.column_stack([sides, 1.5 * up, away[n:]])
    thing = rng.uniform(-1, 1, (n_moving, 3)) * [0.8, 0.6, 0.4] + [0, 0.5, 9]
    turned = Rotation.from_rotvec([0.02, 0.25, 0.1]).apply(thing - [0, 0.5, 9])
    turned += [0.1, 0.1, 8.8]
    points = np.concatenate([ground, houses, thing])
    moved = np.concatenate([ground, houses, turned])
    camera = np.array([0.7, 0.05, 0.1])
    seen = Rotation.from_rotvec([0.01, 0.03, 0.02]).inv().apply(moved - camera)
    X = np.hstack([_pixels(each, PAIR_FOCAL, PAIR_SIZE) for each in (points, seen)])
    X = X + noise * rng.standard_normal(X.shape)
    surfaces = np.repeat(np.arange(MOVING + 1), [n, n, n, n_moving])
    inside = ((X >= 0) & (np.tile(PAIR_SIZE, 2) >= X)).all(axis=1)
    return X[inside], surfaces[inside]


def shaken(readout, *, n_tracks=150, n_moving=0, n_frames=24, shake=0.02, seed=0):
    """Tracks of a room, and of a thing that drives across it.

    Parameters
    ----------
    readout : float
        Frames that it takes to read the rows of a frame, the middle one at its time.
    n_tracks, n_moving : int
    n_frames : int
    shake : float
        Radians by which the camera turns to and fro.
    seed : int

    Returns
    -------
    X : ndarray of shape (n, 2 * n_frames)
    y : ndarray of int, shape (n,)
    """
    rng = np.random.default_rng(seed)
    away = rng.uniform(4, 30, n_tracks)
    spread = rng.uniform([-0.65, -0.36], [0.65, 0.36], (n_tracks, 2))
    room = np.column_stack([spread, np.ones(n_tracks)]) * away[:, None]
    thing = rng.uniform(-1, 1, (n_moving, 3)) * [1, 0.7, 0.7] + [-3, 0.5, 9]
    points = np.concatenate([room, thing])
    y = np.repeat([0, 1], [n_tracks, n_moving])
    rates, phases = rng.uniform(0.3, 1, (5, 3)), rng.uniform(0, 2 * np.pi, (5, 3))
    sizes = shake / np.sqrt(5) * rng.standard_normal((5, 3))

    def seen(times):
        """Images of the points at a time each."""
        angles = (sizes * np.sin(rates * times[:, None, None] + phases)).sum(axis=1)
        moved = points + np.outer(times, [0.02, 0, 0.02])
        moved += np.outer(times * y, [0.25, 0, 0.03])
        turned = Rotation.from_rotvec(angles).apply(moved)
        return _pixels(turned, VIDEO_FOCAL, VIDEO_SIZE)

    frames = []
    for frame in range(n_frames):
        times = np.full(len(points), float(frame))
        for _ in range(4):  # what is seen when its own row is read
            image = seen(times)
            times = frame + readout * (image[:, 1] / VIDEO_SIZE[1] - 0.5)
        frames.append(image)
    tracks = np.stack(frames, axis=1)
    tracks += 0.2 * rng.standard_normal(tracks.shape)
    return _often_inside(tracks, y, VIDEO_SIZE)


def turned(turn, *, n_tracks=100, n_moving=0, n_frames=12, step=0.1, seed=0):
    """Tracks of a scene before a camera that only turns, and of what goes straight on.

    Parameters
    ----------
    turn : float
        Radians per frame; 0 before a camera that stands still.
    n_tracks, n_moving : int
    n_frames : int
    step : float
        By which the thing goes to the side, per frame, in a sixth of its distance.
    seed : int

    Returns
    -------
    X : ndarray of shape (n, 2 * n_frames)
    y : ndarray of int, shape (n,)
    """
    rng = np.random.default_rng(seed)
    scene = rng.uniform([-8, -5, 8], [8, 5, 20], (n_tracks, 3))
    thing = rng.uniform(-1, 1, (n_moving, 3)) * [0.7, 0.5, 0.4] + [-1.5, 0.4, 6]
    frames = []
    for frame in range(n_frames):
        points = np.concatenate([scene, thing + np.array([step * frame, 0, 0])])
        seen = Rotation.from_rotvec([0, turn * frame, 0]).apply(points)
        frames.append(_pixels(seen, TURNED_FOCAL, PAIR_SIZE))
    tracks = np.stack(frames, axis=1)
    tracks += 0.15 * rng.standard_normal(tracks.shape)
    y = np.repeat([0, 1], [n_tracks, n_moving])
    return _often_inside(tracks, y, PAIR_SIZE)


def _often_inside(tracks, y, size):
    """What such an image shows of tracks that it shows three times, or always."""
    inside = ((tracks >= 0) & (tracks < size)).all(axis=2)
    tracks = np.where(inside[..., None], tracks, np.nan)
    often = inside.sum(axis=1) >= min(3, tracks.shape[1])
    return tracks[often].reshape(often.sum(), -1), y[often]


def _pixels(points, focal, size):
    """Images (n, 2) of points (n, 3) before the camera."""
    return focal * points[:, :2] / points[:, 2:] + size / 2


def scenes():
    """What is measured: name to ``(n_moving, seed) -> (X, y)``."""

    def pair(n_tracks, mismatches):
        def make(n_moving, seed):
            X, surfaces = street(n_tracks, n_moving=n_moving, seed=seed)
            rng = np.random.default_rng(seed)
            n = int(mismatches / (1 - mismatches) * len(X))
            astray = rng.uniform(0, 1, (n, 4)) * np.tile(PAIR_SIZE, 2)
            y = np.append((surfaces == MOVING).astype(int), np.full(n, -1))
            return np.concatenate([X, astray]), y

        return make

    def video(readout):
        def make(n_moving, seed):
            return shaken(readout, n_moving=n_moving, seed=seed)

        return make

    pairs = {
        f"street, two images, {n} tracks, {100 * share:.0f} % mismatches": pair(
            n, share
        )
        for n, share in ((150, 0), (300, 0), (300, 0.5), (900, 0))
    }
    videos = {
        f"room, shaken, read in {readout:g} frames": video(readout)
        for readout in (0, 0.35, 0.7)
    }
    return pairs | videos | _of_straight_things()


def _of_straight_things():
    """Scenes before which a thing goes straight on, by name."""

    def make(turn, n_moving, seed, **options):
        return turned(turn, n_moving=n_moving, seed=seed, **options)

    pairs = {
        f"still camera, two images, {n} tracks": partial(
            make, 0.0, n_tracks=n, n_frames=2, step=0.5
        )
        for n in (70, 400)
    }
    return pairs | {"camera that pans, 12 frames": partial(make, 0.01)}


def judged(X, y, seed=0):
    """Whether a scene is right, and its error."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        labels = MotionSegmenter(random_state=seed).fit_predict(X)
    judged = y >= 0
    error = misclassification_error(y[judged], labels[judged])
    found = len(np.unique(labels[labels >= 0]))
    return found == y.max() + 1 and error < MOST_WRONG, found, error


def measure(n_scenes, n_jobs=None):
    """A row per kind of scene, with something that moves and without.

    Parameters
    ----------
    n_scenes : int
    n_jobs : int, optional

    Returns
    -------
    list of dict
        In percent.
    """
    rows = []
    with Parallel(n_jobs=n_jobs) as parallel:
        for name, make in scenes().items():
            show_progress(f"static scenes: {name}")
            row = {"row": name, "n_scenes": n_scenes}
            for key, n_moving in (("static", 0), ("moving", N_MOVING)):
                found = parallel(
                    delayed(judged)(*make(n_moving, seed)) for seed in range(n_scenes)
                )
                right, numbers, errors = map(np.array, zip(*found, strict=True))
                row[f"{key}_right"] = int(right.sum())
                row[f"{key}_found"] = float(numbers.mean())
                row[f"{key}_error"] = float(100 * errors.mean())
            rows.append(row)
    show_progress("")
    return rows


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--scenes", type=int, default=6, help="per kind")
    parser.add_argument("--jobs", type=int)
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    rows = measure(arguments.scenes, arguments.jobs)
    report.show(rows, COLUMNS)
    report.save(arguments.json, "static_scenes", rows)


if __name__ == "__main__":
    main()
