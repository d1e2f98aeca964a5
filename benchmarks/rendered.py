"""Masks of rendered videos whose every pixel's motion is known.

    python -m benchmarks.rendered --videos 24 --jobs 2

A camera moves over a wall of patches, of which some are plain and some are not; before
it go things of patches of their own, some with a shadow that darkens the wall. What is
plain gets few tracks, as roads, walls and the sides of cars do. Tracks are those of
:func:`track_video`, and their labels those of the motions that they follow: what is
measured is the step from tracks to pixels alone.
"""

from __future__ import annotations

import argparse
from typing import NamedTuple

import numpy as np
from joblib import Parallel, delayed
from scipy.ndimage import gaussian_filter
from scipy.spatial import KDTree

from skmotionseg._core.geometry.tracks import unpack_tracks
from skmotionseg.metrics import boundary_f_measure, region_similarity
from skmotionseg.video import dense_masks, track_video

HEIGHT, WIDTH, N_FRAMES = 270, 480, 12
# Patches of a wall and of a thing, and standard deviations (low, high) of their
# texture, in grey levels: logarithms are uniform.
PATCHES, TEXTURE = {"wall": 14, "thing": 5}, (2.0, 60.0)
# Shares of the picture (low, high) that a thing takes, and how far its outline is from
# round.
SIZES, ROUGHNESS = (0.01, 0.2), 0.25
# Pixels per frame of the camera and of things, degrees per frame, and zoom per frame.
CAMERA_SPEED, SPEED, TURNS, ZOOM = 8.0, (1.0, 8.0), 1.0, 0.006
# By how much a shadow darkens, and standard deviation of the noise, grey levels.
SHADOW, NOISE = 0.6, 2.0
# Things of fewer pixels in a frame are not judged; boundaries are, every few frames.
LEAST_PIXELS, FRAMES_BETWEEN = 100, 4
# Standard deviations of the brightness of patches, and of their colour channels about
# it, grey levels; quality with which frames are compressed, 0 to 100.
BRIGHTNESS, COLOUR, QUALITY = 20.0, 6.0, 60


class RenderedVideo(NamedTuple):
    """A video and its truth.

    Attributes
    ----------
    frames : list of ndarray of uint8, shape (HEIGHT, WIDTH, 3)
    masks : ndarray of int, shape (N_FRAMES, HEIGHT, WIDTH)
        0 for the wall, 1, 2, ... for things.
    layers : list
        The wall and the things, whose ``places(points, frame)`` are those of points of
        a frame on the plane.
    """

    frames: list
    masks: np.ndarray
    layers: list


def render_video(seed: int) -> RenderedVideo:
    """A video of one to three things.

    Parameters
    ----------
    seed : int

    Returns
    -------
    RenderedVideo
    """
    rng = np.random.default_rng(seed)
    wall = _Layer(rng, PATCHES["wall"], CAMERA_SPEED * rng.uniform(0, 1), None)
    things = [
        _Layer(rng, PATCHES["thing"], rng.uniform(*SPEED), rng.uniform(*SIZES))
        for _ in range(rng.integers(1, 4))
    ]
    frames, masks = [], []
    for number in range(N_FRAMES):
        picture, _ = wall.seen(number)
        mask = np.zeros((HEIGHT, WIDTH), dtype=int)
        for label, thing in enumerate(things, 1):
            own, inside = thing.seen(number)
            if thing.shadow is not None:
                dark = np.roll(inside, thing.shadow, axis=(0, 1)).astype(float)
                dark = gaussian_filter(dark, 4)[..., None]
                picture = picture * (1 - (1 - SHADOW) * dark)
            picture = np.where(inside[..., None], own, picture)
            mask[inside] = label
        noisy = gaussian_filter(picture, (0.6, 0.6, 0))
        noisy = noisy + rng.normal(scale=NOISE, size=noisy.shape)
        frames.append(_compressed(noisy.clip(0, 255).astype(np.uint8)))
        masks.append(mask)
    return RenderedVideo(frames, np.array(masks), [wall, *things])


def _compressed(frame):
    """A frame as it is after JPEG, which blurs faint texture."""
    import cv2  # only here: the module is read where OpenCV is not installed, too

    quality = [cv2.IMWRITE_JPEG_QUALITY, QUALITY]
    return cv2.imdecode(cv2.imencode(".jpg", frame, quality)[1], cv2.IMREAD_COLOR)


class _Layer:
    """A plane with patches on it that moves over the picture."""

    def __init__(self, rng, n_patches, speed, size):
        reach = 3 * WIDTH  # of the plane, in every direction, half of it unseen
        self._sites = rng.uniform(-reach / 2, reach / 2, (9 * n_patches, 2))
        self._centre, self._radii = np.zeros(2), None
        self.shadow = None
        if size is not None:
            radius = np.sqrt(size * HEIGHT * WIDTH / np.pi)
            self._sites = rng.normal(scale=radius, size=(n_patches, 2))
            waves = rng.normal(size=(4, 2)) * ROUGHNESS / np.arange(1, 5)[:, None]
            self._radii = radius, waves
            self._centre = (rng.uniform(-0.3, 0.3, 2)) * (WIDTH, HEIGHT)
            if rng.uniform() < 0.5:
                self.shadow = int(0.3 * radius), int(rng.uniform(-0.5, 0.5) * radius)
        n = len(self._sites)
        grey = rng.normal(120, BRIGHTNESS, (n, 1))
        self._colours = grey + rng.normal(scale=COLOUR, size=(n, 3))
        self._levels = np.exp(rng.uniform(*np.log(TEXTURE), n))
        noise = rng.normal(size=(512, 512))
        fine, coarse = (gaussian_filter(noise, s, mode="wrap") for s in (1.2, 3.0))
        self._noise = (fine / fine.std() + coarse / coarse.std()) / np.sqrt(2)
        way = rng.uniform(0, 2 * np.pi)
        self._speed = speed * np.array([np.cos(way), np.sin(way)])
        self._turn, self._zoom = rng.normal(scale=(np.radians(TURNS), ZOOM))

    def places(self, points, number):
        """Where points (..., 2) of the picture are on the plane in a frame."""
        after = number - (N_FRAMES - 1) / 2
        middle = np.array([WIDTH, HEIGHT]) / 2 + self._centre + after * self._speed
        x, y = np.moveaxis(points - middle, -1, 0)
        scale, angle = np.exp(-self._zoom * after), self._turn * after
        cos, sin = scale * np.cos(angle), scale * np.sin(angle)
        return np.stack([cos * x + sin * y, cos * y - sin * x], axis=-1)

    def seen(self, number):
        """Its colours (HEIGHT, WIDTH, 3) in a frame, and where it is: bool."""
        y, x = np.mgrid[:HEIGHT, :WIDTH]
        at = self.places(np.stack([x, y], axis=2), number)
        patch = KDTree(self._sites).query(at)[1]
        texture = self._levels[patch] * _between(self._noise, at)
        return self._colours[patch] + texture[..., None], self._inside(at)

    def _inside(self, at):
        if self._radii is None:
            return np.ones(at.shape[:2], dtype=bool)
        radius, waves = self._radii
        angle = np.arctan2(at[..., 1], at[..., 0])
        rough = sum(
            a * np.cos(k * angle) + b * np.sin(k * angle)
            for k, (a, b) in enumerate(waves, 2)
        )
        return np.hypot(*np.moveaxis(at, 2, 0)) < radius * (1 + rough)


def _between(noise, at):
    """Values of periodic noise between its pixels."""
    n = len(noise)
    low = np.floor(at).astype(int)
    right, down = np.moveaxis(at - low, 2, 0)
    x, y = np.moveaxis(low, 2, 0) % n
    after, below = (x + 1) % n, (y + 1) % n
    top = noise[y, x] * (1 - right) + noise[y, after] * right
    bottom = noise[below, x] * (1 - right) + noise[below, after] * right
    return top * (1 - down) + bottom * down


def true_labels(tracks, layers):
    """The motion that each track follows: in a shadow, that of what casts it.

    Parameters
    ----------
    tracks : ndarray of shape (n_tracks, 2 * n_frames)
    layers : list
        As of :class:`RenderedVideo`.

    Returns
    -------
    ndarray of int, shape (n_tracks,)
        Of the plane on which its places are most alike.
    """
    points, seen = unpack_tracks(tracks)
    points = np.where(seen[..., None], points, np.nan)
    spread = []
    for layer in layers:
        places = [layer.places(points[:, n], n) for n in range(points.shape[1])]
        spread.append(np.nanvar(places, axis=0).sum(axis=1))
    return np.argmin(spread, axis=0)


def measure(seed: int) -> dict | None:
    """Scores of the masks of one video.

    Parameters
    ----------
    seed : int

    Returns
    -------
    dict of str to float, or None
        Region similarity ``J``, ``precision`` and ``recall``, means over things and
        frames, and the ``boundary`` F-measure of all things together; None where no
        thing is large enough in all frames.
    """
    video = render_video(seed)
    tracks = track_video(video.frames).tracks
    labels = true_labels(tracks, video.layers)
    found = np.array(list(dense_masks(video.frames, tracks, labels)))
    rows = []
    for label in np.unique(video.masks)[1:]:
        true, own = video.masks == label, found == label
        if true.sum(axis=(1, 2)).min() >= LEAST_PIXELS:
            both = (true & own).sum()
            rows.append((both / max(own.sum(), 1), both / true.sum()))
            rows[-1] += (np.mean(list(map(region_similarity, true, own))),)
    if not rows:
        return None
    pairs = zip(video.masks[::FRAMES_BETWEEN], found[::FRAMES_BETWEEN], strict=True)
    boundary = np.mean([boundary_f_measure(true > 0, own > 0) for true, own in pairs])
    precision, recall, region = np.mean(rows, axis=0)
    scores = {"J": region, "precision": precision, "recall": recall}
    return {name: float(each) for name, each in scores.items()} | {
        "boundary": float(boundary)
    }


def main(argv=None):
    """Print the mean scores of some videos, and their standard errors."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--videos", type=int, default=24)
    parser.add_argument("--jobs", type=int, default=1)
    options = parser.parse_args(argv)
    jobs = (delayed(measure)(seed) for seed in range(options.videos))
    rows = [row for row in Parallel(options.jobs, verbose=1)(jobs) if row is not None]
    print(f"{len(rows)} videos with things that are large enough")
    for name in rows[0]:
        values = 100 * np.array([row[name] for row in rows])
        error = values.std() / np.sqrt(len(values))
        print(f"{name:<10} {values.mean():5.1f} +- {error:.1f} %")


if __name__ == "__main__":
    main()
