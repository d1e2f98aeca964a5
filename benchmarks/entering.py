"""Labels of a thing that enters a stream while two others move.

    python -m benchmarks.entering --seeds 0 1 2 3 4

A line per simulated stream: 90 tracks of the static scene and 25 of each of three
things at a time, which live for 15 to 60 frames. All turn as they go, and the third
enters all at once, after the last segmentation of all frames. ``first``: frames after
which most of its tracks have a label that no other motion has. ``own``: the share of
the frames in which that is so, from the tenth on.
"""

from __future__ import annotations

import argparse

import numpy as np
from scipy.spatial.transform import Rotation
from sklearn.utils import Bunch

from skmotionseg import OnlineMotionSegmenter

SIZE, FOCAL, NOISE = np.array([1280.0, 720.0]), 700.0, 0.2
N_FRAMES, ENTERS, JUDGED = 100, 57, 10
N_STATIC, N_MOVING, LIFE = 90, 25, (15, 60)
# Of each thing: middle of its way in the image, its periods, depth, and turn per frame.
THINGS = (
    ((250, 200), (23, 19), 9.0, 0.012),
    ((1000, 200), (21, 26), 7.0, -0.015),
    ((980, 540), (20, 23), 7.0, 0.02),
)
WAY = np.array([140.0, 70.0])  # how far they go from there, pixels


def cameras(kind):
    """Rotations and places of a camera in each frame."""
    t = np.arange(N_FRAMES)
    if kind == "dolly":
        places = np.stack([0.03 * t, 0.05 * np.sin(t / 20), 0.015 * t], axis=1)
        turns = np.stack([0.02 * np.sin(t / 45), 0.1 * np.sin(t / 60)], axis=1)
    else:
        sways = 0.6 * np.sin(t / 25) + 0.2 * np.sin(t / 7)
        places = np.stack([sways, 0.2 * np.sin(t / 17), 0.4 * np.sin(t / 40)], axis=1)
        shakes = 0.08 * np.sin(t / 30) + 0.01 * np.sin(t / 5)
        turns = np.stack([0.03 * np.sin(t / 23), shakes], axis=1)
    return Rotation.from_euler("xy", turns), places


def entering_scene(kind, seed):
    """A stream in which the last thing enters.

    Parameters
    ----------
    kind : {"dolly", "handheld"}
        How the camera moves.
    seed : int

    Returns
    -------
    Bunch
        ``points`` (n, N_FRAMES, 2), pixels; ``seen`` (n, N_FRAMES); ``target`` (n,), 0
        for the static scene.
    """
    rng = np.random.default_rng(seed)
    camera, phases = cameras(kind), rng.uniform(0, 2 * np.pi, len(THINGS))
    tracks = [
        (*_track(rng, camera, motion, phases, start, stop), motion)
        for motion, n in enumerate((N_STATIC, *[N_MOVING] * len(THINGS)))
        for _ in range(n)
        for start, stop in _lives(rng, ENTERS if motion == len(THINGS) else 0)
    ]
    points, seen, target = map(np.array, zip(*tracks, strict=True))
    points = points + NOISE * rng.standard_normal(points.shape)
    return Bunch(points=points, seen=seen, target=target)


def _lives(rng, enters):
    """Frames of one track after the other."""
    start = -rng.integers(LIFE[0])
    while start < N_FRAMES:
        stop = start + rng.integers(*LIFE)
        if stop > enters:
            yield max(start, enters), min(stop, N_FRAMES)
        start = stop


def _track(rng, camera, motion, phases, start, stop):
    """A point in all frames, and in which of them it is seen."""
    rotations, places = camera
    if motion == 0:
        seen_at = rng.uniform([0, 0], SIZE)
        world = _in_space(seen_at, rng.uniform(6, 30), rotations[start], places[start])
        world = np.repeat(world[None], N_FRAMES, axis=0)
    else:
        world = _of_thing(rng, camera, phases[motion - 1], *THINGS[motion - 1])
    local = rotations.apply(world - places)
    points = FOCAL * local[:, :2] / np.maximum(local[:, 2:], 0.1) + SIZE / 2
    inside = (local[:, 2] > 0.5) & ((points >= 0) & (points < SIZE)).all(axis=1)
    frames = np.arange(N_FRAMES)
    return points, inside & (frames >= start) & (frames < stop)


def _of_thing(rng, camera, phase, middle, periods, depth, turn):
    """Where a point of a thing is in each frame."""
    t = np.arange(N_FRAMES)
    ways = np.stack([np.sin(t / periods[0] + phase), np.cos(t / periods[1] + phase)], 1)
    centres = _in_space(np.array(middle) + WAY * ways, depth, *camera)
    own = rng.uniform(-1, 1, 3) * [1.2, 0.72, 0.72]
    return centres + Rotation.from_euler("y", turn * t[:, None]).apply(own)


def _in_space(pixels, depth, rotation, place):
    """Where what is seen at some pixels, at a depth, is in space."""
    rays = (pixels - SIZE / 2) / FOCAL
    rays = np.concatenate([rays, np.ones((*rays.shape[:-1], 1))], axis=-1)
    return rotation.inv().apply(depth * rays) + place


def measure(kind, seed):
    """``first`` and ``own`` of a stream; ``first`` is None if it never has a label."""
    scene, segmenter = entering_scene(kind, seed), OnlineMotionSegmenter(random_state=0)
    is_own = np.zeros(N_FRAMES, dtype=bool)
    for frame in range(N_FRAMES):
        ids = np.flatnonzero(scene.seen[:, frame])
        labels = segmenter.update(scene.points[ids, frame], ids)
        of_tracks = scene.target[ids]
        if (of_tracks == len(THINGS)).any():
            *others, last = (
                _most(labels[of_tracks == k]) for k in range(len(THINGS) + 1)
            )
            is_own[frame] = last >= 0 and last not in others
    found = np.flatnonzero(is_own[ENTERS:])
    first = int(found[0]) if len(found) else None
    return {"first": first, "own": float(is_own[ENTERS + JUDGED :].mean())}


def _most(labels):
    names, counts = np.unique(labels, return_counts=True)
    return int(names[counts.argmax()]) if len(names) else -1


def main(arguments=None):
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.entering",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--seeds", type=int, nargs="+", default=list(range(5)))
    parser.add_argument("--cameras", nargs="+", default=["dolly", "handheld"])
    arguments = parser.parse_args(arguments)
    shares = []
    for kind in arguments.cameras:
        for seed in arguments.seeds:
            row = measure(kind, seed)
            shares.append(row["own"])
            first = "never" if row["first"] is None else row["first"]
            print(
                f"{kind:10s} {seed:4d}  first {first}  own {row['own']:.2f}", flush=True
            )
    print(f"mean of {len(shares)}: own {np.mean(shares):.3f}")


if __name__ == "__main__":
    main()
