"""Videos with tracks and labels of every kind, as a strategy of hypothesis."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from hypothesis import strategies as st

from .track_strategies import MISSING, MOTIONS, SEEDS, SHAPES, Tracks, mostly

PICTURES = ("texture", "noise", "black", "white", "stripes", "changing", "colours")
LABELS = ("random", "halves", "one", "mostly none", "high", "each its own")


@dataclass(frozen=True)
class Films:
    """A recipe for a small video, tracks in it, and their labels.

    Attributes
    ----------
    tracks_in : Tracks
        Tracks in an image about 1 wide.
    width, height : int
    margin : float
        How far tracks reach out of the frames, in widths; negative if they do not.
    picture, labelled : str
    seed : int
    """

    tracks_in: Tracks
    width: int
    height: int
    margin: float
    picture: str
    labelled: str
    seed: int

    @property
    def n_frames(self):
        return self.tracks_in.n_frames

    def tracks(self):
        """Tracks in pixels of the frames, (n_tracks, 2 * n_frames)."""
        unit = self.tracks_in.matrix().reshape(self.tracks_in.n_tracks, -1, 2)
        size = np.array([self.width, self.height])
        points = (0.5 + (1 + 2 * self.margin) * unit) * size
        return points.reshape(len(points), -1)

    def labels(self):
        rng, n = np.random.default_rng(self.seed), self.tracks_in.n_tracks
        return {
            "random": rng.integers(-1, 4, n),
            "halves": np.arange(n) * 2 // n,
            "one": np.zeros(n, dtype=int),
            "mostly none": np.where(rng.uniform(size=n) < 0.9, -1, 2),
            "high": rng.choice([0, 253, 254], n),
            "each its own": np.arange(n) % 255,
        }[self.labelled]

    def frames(self):
        """A list of arrays of uint8, (height, width) or (height, width, 3)."""
        rng = np.random.default_rng(self.seed)
        size = self.n_frames, self.height, self.width
        pictures = {
            "texture": lambda: np.repeat(
                [rng.integers(256, size=size[1:])], size[0], 0
            ),
            "noise": lambda: rng.integers(256, size=size),
            "black": lambda: np.zeros(size),
            "white": lambda: np.full(size, 255),
            "stripes": lambda: np.zeros(size) + 255 * (np.arange(size[2]) // 4 % 2),
            "changing": lambda: (
                np.zeros(size) + rng.integers(256, size=(size[0], 1, 1))
            ),
            "colours": lambda: rng.integers(256, size=(*size, 3)),
        }
        return list(pictures[self.picture]().astype(np.uint8))


@st.composite
def films(draw):
    n_frames = draw(mostly(st.integers(3, 8), st.just(2), st.integers(9, 20)))
    tracks = Tracks(
        n_tracks=draw(mostly(st.integers(8, 60), st.integers(1, 7))),
        n_frames=n_frames,
        n_motions=draw(st.integers(1, 3)),
        shape=draw(st.sampled_from(SHAPES)),
        motion=draw(st.sampled_from(MOTIONS)),
        missing=draw(st.sampled_from(MISSING)),
        n_copies=0,
        noise=draw(st.sampled_from((0.0, 1e-3))),
        scale=1.0,
        offset=0.0,
        dtype=draw(mostly(st.just("float64"), st.just("float32"))),
        container="array",
        seed=draw(SEEDS),
    )
    return Films(
        tracks,
        width=draw(mostly(st.integers(24, 64), st.integers(16, 23))),
        height=draw(mostly(st.integers(24, 48), st.integers(16, 23))),
        margin=draw(st.sampled_from((-0.2, 0.0, 1.0, 100.0))),
        picture=draw(st.sampled_from(PICTURES)),
        labelled=draw(st.sampled_from(LABELS)),
        seed=draw(SEEDS),
    )
