"""Streams of every kind, as a strategy of hypothesis; see track_strategies.py."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from hypothesis import strategies as st

from .track_strategies import SEEDS, Tracks, mostly

LIVES = ("as long as the film", "short", "gaps", "single frames", "half at a time")
SCENES = ("rigid", "planar", "pan", "shift", "still", "walk", "jumps")
EVENTS = (
    "nothing",
    "an empty frame",
    "empty frames",
    "a cut",
    "a frame from elsewhere",
    "all stops",
    "a leap",
    "all in one place",
    "frames twice",
)
IDS = ("small", "large", "negative", "used again")


@dataclass(frozen=True)
class Streams:
    """A recipe for the frames of a stream.

    Attributes
    ----------
    n_tracks, n_frames, n_motions : int
    scene : str
        How each motion moves its points.
    lives : str
        In which frames a track is seen.
    event : str
        What happens in the middle.
    ids : str
    outliers, noise : float
        Share of the tracks that jump; and noise relative to the size of the image.
    scale, offset : float
        Size of the image, and its distance from the origin, in pixels.
    dtype : str
    seed : int
    """

    n_tracks: int
    n_frames: int
    n_motions: int
    scene: str
    lives: str
    event: str
    ids: str
    outliers: float
    noise: float
    scale: float
    offset: float
    dtype: str
    seed: int

    def frames(self):
        """A list of points (n_seen, 2) and ids (n_seen,) per frame."""
        rng = np.random.default_rng(self.seed)
        points = self._points(rng)
        seen = self._seen(rng)
        names = self._names(rng)
        middle = self.n_frames // 2
        self._happen(points, seen, middle, rng)
        frames = []
        for frame in range(self.n_frames):
            rows = rng.permutation(np.flatnonzero(seen[:, frame]))
            ids = names[rows]
            if self.event == "a cut" and frame >= middle:
                ids = ids + 5000
            frames.append((points[rows, frame].astype(self.dtype), ids))
        if self.event == "frames twice":
            return [frame for frame in frames[: middle + 1] for _ in range(2)]
        return frames

    def _points(self, rng):
        points = np.empty((self.n_tracks, self.n_frames, 2))
        for start in range(0, self.n_frames, 40):  # at most as Tracks has
            length = min(40, self.n_frames - start)
            part = Tracks(
                n_tracks=self.n_tracks,
                n_frames=length,
                n_motions=self.n_motions,
                shape="cloud",
                motion="general" if self.scene == "rigid" else self.scene,
                missing="nothing",
                n_copies=0,
                noise=self.noise,
                scale=self.scale,
                offset=self.offset,
                dtype="float64",
                container="array",
                seed=self.seed,
            )
            matrix = part.matrix().reshape(self.n_tracks, length, 2)
            points[:, start : start + length] = matrix
        stray = rng.uniform(size=self.n_tracks) < self.outliers
        size = stray.sum(), self.n_frames, 2
        points[stray] = self.offset + self.scale * rng.uniform(-0.5, 0.5, size)
        return points

    def _seen(self, rng):
        n, n_frames = self.n_tracks, self.n_frames
        frames = np.arange(n_frames)
        if self.lives == "short":
            birth = rng.integers(-4, n_frames, size=(n, 1))
            return (frames >= birth) & (frames < birth + rng.integers(1, 15, (n, 1)))
        if self.lives == "gaps":
            return rng.uniform(size=(n, n_frames)) > rng.uniform(0, 0.6, size=(n, 1))
        if self.lives == "single frames":
            return frames == rng.integers(n_frames, size=(n, 1))
        if self.lives == "half at a time":
            return (np.arange(n)[:, None] % 2 == 0) ^ (frames >= n_frames // 2)
        return np.ones((n, n_frames), dtype=bool)

    def _names(self, rng):
        names = rng.permutation(self.n_tracks)
        if self.ids == "large":
            return names + 2**62
        if self.ids == "negative":
            return -names - 1
        return names

    def _happen(self, points, seen, middle, rng):
        """Change points and sight from the middle on, in place."""
        after = points[:, middle:]
        if self.event == "an empty frame":
            seen[:, middle] = False
        elif self.event == "empty frames":
            seen[:, middle : middle + 14] = False
        elif self.event == "a frame from elsewhere":
            points[:, middle] = self.offset + self.scale * rng.uniform(
                size=(len(points), 2)
            )
        elif self.event == "all stops":
            after[:] = after[:, :1]
        elif self.event == "a leap":
            after += 3 * self.scale
        elif self.event == "all in one place":
            after[:] = after[:1, :1]
        if self.ids == "used again":  # by other points, after a while
            points[:, middle + 3 :] = points[::-1, middle + 3 :].copy()
            seen[:, middle : middle + 3] = False


@st.composite
def streams(draw):
    return Streams(
        n_tracks=draw(
            mostly(st.integers(16, 32), st.integers(1, 15), st.integers(33, 50))
        ),
        n_frames=draw(mostly(st.integers(12, 24), st.integers(1, 11))),
        n_motions=draw(st.integers(1, 3)),
        scene=draw(st.sampled_from(SCENES)),
        lives=draw(mostly(st.sampled_from(LIVES), *[st.just(LIVES[0])] * 4)),
        event=draw(st.sampled_from(EVENTS)),
        ids=draw(st.sampled_from(IDS)),
        outliers=draw(st.sampled_from((0.0, 0.1, 0.5))),
        noise=draw(st.sampled_from((0.0, 1e-6, 1e-3))),
        scale=10.0 ** draw(mostly(st.integers(2, 4), st.integers(-6, 7))),
        offset=draw(st.sampled_from((0.0, 1e3, 1e7))),
        dtype=draw(mostly(st.just("float64"), st.just("float32"), st.just("int64"))),
        seed=draw(SEEDS),
    )
