"""Tracks, residuals and affinities of every kind, as strategies of hypothesis.

Each strategy draws a recipe: a few names and numbers, and the seed of the generator
that fills in the rest. A recipe prints in a few lines, shrinks to the plainest that
still fails, and makes the same arrays every time.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass

import numpy as np
import pandas as pd
from hypothesis import strategies as st

# ------------------------------------------------------------------------------ tracks

SHAPES = ("cloud", "grid", "line", "row", "spot", "two spots")
MOTIONS = ("still", "shift", "affine", "general", "planar", "pan", "walk", "jumps")
MISSING = (
    "nothing",
    "scattered",
    "rows",
    "frames",
    "blocks",
    "half points",
    "births",
    "halves",
    "all but one common frame",
    "everything",
)
FLOATS = ("float64", "float32", "float16")
INTEGERS = ("int64", "int32", "int16", "uint8")
CONTAINERS = (
    "array",
    "fortran",
    "strided",
    "big-endian",
    "read-only memory map",
    "data frame",
    "lists",
    "masked array",
)


@dataclass(frozen=True)
class Tracks:
    """A recipe for tracks.

    Attributes
    ----------
    n_tracks, n_frames, n_motions : int
    shape : str
        Where the points are in the first frame.
    motion : str
        How each motion moves its points.
    missing : str
        Which points are not seen.
    n_copies : int
        Tracks that repeat others.
    noise : float
        Relative to the size of the image.
    scale, offset : float
        Size of the image, and its distance from the origin, in pixels.
    dtype, container : str
    seed : int
    """

    n_tracks: int
    n_frames: int
    n_motions: int
    shape: str
    motion: str
    missing: str
    n_copies: int
    noise: float
    scale: float
    offset: float
    dtype: str
    container: str
    seed: int

    def matrix(self):
        """The tracks as they are, (n_tracks, 2 * n_frames), float64."""
        rng = np.random.default_rng(self.seed)
        points = self.scale * _scene(self, rng) + self.offset
        X = points.reshape(self.n_tracks, -1)
        X = _as_type(X, self.dtype).astype(float)
        if self.dtype in FLOATS:
            X[~_seen(self, rng).reshape(X.shape)] = np.nan
        X[self.n_tracks - self.n_copies :] = X[: self.n_copies]
        return X

    def given(self):
        """What the estimator gets: the same numbers in another container."""
        X = self.matrix()
        with np.errstate(over="ignore"):
            return _put_into(self.container, X.astype(self.dtype))


def _scene(recipe, rng):
    """Points (n_tracks, n_frames, 2) of an image about 1 wide."""
    start = _start(recipe.shape, recipe.n_tracks, rng)
    time = np.linspace(0, 1, recipe.n_frames)
    group = rng.integers(recipe.n_motions, size=recipe.n_tracks)
    points = np.empty((recipe.n_tracks, recipe.n_frames, 2))
    for motion in range(recipe.n_motions):
        members = group == motion
        points[members] = _move(recipe.motion, start[members], time, rng)
    return points + recipe.noise * rng.standard_normal(points.shape)


def _start(shape, n, rng):
    """Points (n, 2)."""
    cloud = rng.uniform(-0.5, 0.5, (n, 2))
    along = cloud[:, :1]
    return {
        "cloud": cloud,
        "grid": np.round(4 * cloud) / 4,
        "line": along * [1, 0.3] + [0, 0.1],
        "row": along * [1, 0],
        "spot": np.zeros((n, 2)) + cloud[0],
        "two spots": np.where(along > 0, [0.3, 0.1], [-0.2, 0.4]),
    }[shape]


def _move(motion, start, time, rng):
    """Points (n, 2) through time (n_frames,): (n, n_frames, 2)."""
    n, t = len(start), time[None, :, None]
    x = start[:, None] + 0 * t
    if motion == "still":
        return x
    if motion == "shift":
        return x + t * rng.normal(size=2)
    if motion == "affine":
        return x + t * (x @ rng.normal(0, 0.5, (2, 2)) + rng.normal(size=2))
    if motion == "walk":
        return x + np.cumsum(rng.normal(0, 0.05, (n, len(time), 2)), axis=1)
    if motion == "jumps":
        return rng.uniform(-1, 1, (n, len(time), 2))
    return _through_camera(motion, start, time, rng)


def _through_camera(motion, start, time, rng):
    """A rigid scene, a plane, or a rigid scene before a camera that only turns."""
    flat = motion == "planar"
    depth = 4 + (start @ rng.normal(size=2) if flat else rng.uniform(-1, 1, len(start)))
    scene = np.column_stack([start * depth[:, None], depth])
    axis, path = rng.normal(0, 0.3, 3), rng.normal(0, 0.5, 3)
    if motion == "pan":
        path[:] = 0
    a, b, c = axis
    turn = np.array([[0, -c, b], [c, 0, -a], [-b, a, 0]])
    points = np.empty((len(start), len(time), 2))
    for frame, t in enumerate(time):
        seen = scene @ (np.eye(3) + t * turn).T + t * path
        points[:, frame] = seen[:, :2] / np.maximum(seen[:, 2:], 0.5)
    return points


def _seen(recipe, rng):
    """Which numbers are there: bool, (n_tracks, n_frames, 2)."""
    n, n_frames = recipe.n_tracks, recipe.n_frames
    seen = np.ones((n, n_frames, 2), dtype=bool)
    share = rng.uniform(0, 1)
    if recipe.missing == "scattered":
        seen &= rng.uniform(size=(n, n_frames, 1)) > share
    elif recipe.missing == "rows":
        seen[rng.uniform(size=n) < share] = False
    elif recipe.missing == "frames":
        seen[:, rng.uniform(size=n_frames) < share] = False
    elif recipe.missing == "blocks":
        rows, frames = (
            np.sort(rng.integers(size + 1, size=2)) for size in (n, n_frames)
        )
        seen[slice(*rows), slice(*frames)] = False
    elif recipe.missing == "half points":
        seen &= rng.uniform(size=seen.shape) > share / 2
    elif recipe.missing == "births":
        birth, life = rng.integers(n_frames, size=n), 1 + int(share * n_frames)
        age = np.arange(n_frames) - birth[:, None]
        seen &= ((age >= 0) & (age < life))[..., None]
    elif recipe.missing == "halves":
        seen[: n // 2, : n_frames // 2] = False
        seen[n // 2 :, n_frames // 2 :] = False
    elif recipe.missing == "all but one common frame":
        common = rng.integers(n_frames)
        early = rng.uniform(size=n) < share
        seen[early, common + 1 :] = False
        seen[~early, :common] = False
    elif recipe.missing == "everything":
        seen[:] = False
    return seen


def _as_type(X, dtype):
    """Numbers of that type: rounded and clipped if whole, infinite if too large."""
    if dtype in INTEGERS:
        limits = np.iinfo(dtype)
        return np.clip(np.round(X), limits.min, limits.max).astype(dtype)
    with np.errstate(over="ignore"):
        return X.astype(dtype)


def _put_into(container, X):
    if container == "fortran":
        return np.asfortranarray(X)
    if container == "strided":
        wide = np.repeat(np.repeat(X, 2, axis=0), 3, axis=1)
        return wide[::2, ::3]
    if container == "big-endian":
        return X.astype(X.dtype.newbyteorder(">"))
    if container == "read-only memory map":
        with tempfile.TemporaryFile() as file:
            file.write(X.tobytes())
            file.flush()
            return np.memmap(file, dtype=X.dtype, mode="r", shape=X.shape)
    if container == "data frame":
        names = [f"{axis}_{f}" for f in range(X.shape[1] // 2) for axis in "xy"]
        return pd.DataFrame(X, columns=names)
    if container == "lists":
        return X.tolist()
    if container == "masked array" and X.dtype.kind == "f":
        return np.ma.array(
            np.nan_to_num(X, posinf=np.inf, neginf=-np.inf), mask=np.isnan(X)
        )
    return X


def mostly(usual, *others):
    """One in sixteen is of each other kind."""
    kinds = [usual] * (16 - len(others)) + list(others)
    # A method's hash is its address, and hypothesis makes cases by it: a function's is
    # of its source.
    return st.sampled_from(range(16)).flatmap(lambda kind: kinds[kind])


SEEDS = st.integers(0, 2**32 - 1)


@st.composite
def tracks(draw):
    few, many = st.integers(1, 12), st.integers(60, 300)
    n_tracks = draw(mostly(st.integers(12, 60), few, few, few, many))
    n_frames = draw(mostly(st.integers(3, 8), st.just(2), st.integers(8, 24)))
    scale = 10.0 ** draw(st.integers(-6, 7))
    return Tracks(
        n_tracks=n_tracks,
        n_frames=n_frames,
        n_motions=draw(st.integers(1, 4)),
        shape=draw(st.sampled_from(SHAPES)),
        motion=draw(st.sampled_from(MOTIONS)),
        missing=draw(mostly(st.sampled_from(MISSING[:-1]), st.just(MISSING[-1]))),
        n_copies=draw(st.sampled_from((0, 0, n_tracks // 3, n_tracks // 2))),
        noise=draw(st.sampled_from((0.0, 1e-9, 1e-6, 1e-3))),
        scale=scale,
        offset=draw(st.sampled_from((0.0, scale, min(1e3 * scale, 1e7)))),
        dtype=draw(mostly(st.sampled_from(FLOATS), st.sampled_from(INTEGERS))),
        container=draw(st.sampled_from(CONTAINERS)),
        seed=draw(SEEDS),
    )


# ---------------------------------------------------------- two images and photographs


@dataclass(frozen=True)
class Matches:
    """A recipe for correspondences of images, some of which are mismatches.

    Attributes
    ----------
    points : Tracks
        What is there to be matched.
    mismatches : float
        Share of the tracks that are elsewhere in the last image.
    sights : int
        Images that see a track, drawn for each; 0 if all do that the tracks say.
    seed : int
    """

    points: Tracks
    mismatches: float
    sights: int
    seed: int

    n_copies = 0

    def matrix(self):
        rng = np.random.default_rng(self.seed)
        X = self.points.matrix()
        wrong = np.flatnonzero(rng.uniform(size=len(X)) < self.mismatches)
        X[wrong, -2:] = X[rng.permutation(wrong), -2:]
        if self.sights:
            order = rng.uniform(size=(len(X), X.shape[1] // 2)).argsort(axis=1)
            X[np.repeat(order >= self.sights, 2, axis=1)] = np.nan
        return X

    def given(self):
        return self.matrix()


@st.composite
def matches(draw, n_frames):
    """Of two images both see all points; of more, two or three see each."""
    many = n_frames > 2
    n_tracks = st.integers(60, 120) if many else st.integers(16, 60)
    points = Tracks(
        n_tracks=draw(mostly(n_tracks, st.integers(1, 15))),
        n_frames=n_frames,
        n_motions=draw(st.integers(1, 3)),
        shape=draw(st.sampled_from(SHAPES)),
        motion=draw(st.sampled_from(MOTIONS)),
        missing=draw(mostly(st.just("nothing"), st.just("scattered"))),
        n_copies=0,
        noise=draw(st.sampled_from((0.0, 1e-6, 1e-3))),
        scale=10.0 ** draw(mostly(st.integers(2, 4), st.integers(-6, 7))),
        offset=draw(st.sampled_from((0.0, 1e3, 1e7))),
        dtype=draw(mostly(st.just("float64"), st.just("float32"))),
        container="array",
        seed=draw(SEEDS),
    )
    return Matches(
        points,
        mismatches=draw(st.sampled_from((0.0, 0.3, 0.6, 1.0))),
        sights=draw(mostly(st.just(2), st.just(3))) if many else 0,
        seed=draw(SEEDS),
    )


# --------------------------------------------------------------------------- residuals

RESIDUALS = ("random", "ties", "constant", "zeros", "wide", "one group")
UNSEEN = ("nothing", "scattered", "groups", "rows", "everything", "halves")


@dataclass(frozen=True)
class Residuals:
    """A recipe for residuals (n_tracks, n_pairs * n_hypotheses), pair-major."""

    n_tracks: int
    n_pairs: int
    n_hypotheses: int
    kind: str
    unseen: str
    dtype: str
    container: str
    seed: int

    def matrix(self):
        rng = np.random.default_rng(self.seed)
        shape = (self.n_tracks, self.n_pairs, self.n_hypotheses)
        R = {
            "random": rng.chisquare(1, shape),
            "ties": rng.integers(3, size=shape).astype(float),
            "constant": np.full(shape, 0.7),
            "zeros": np.zeros(shape),
            "wide": 10.0 ** rng.uniform(-38, 38, shape),
            "one group": np.broadcast_to(rng.uniform(size=shape[1:]), shape).copy(),
        }[self.kind]
        share = rng.uniform()
        if self.unseen == "scattered":
            R[rng.uniform(size=shape) < share / self.n_hypotheses] = np.nan
        elif self.unseen == "groups":
            R[rng.uniform(size=shape[:2]) < share] = np.nan
        elif self.unseen == "rows":
            R[rng.uniform(size=self.n_tracks) < share] = np.nan
        elif self.unseen == "halves":
            R[: self.n_tracks // 2, : self.n_pairs // 2] = np.nan
            R[self.n_tracks // 2 :, self.n_pairs // 2 :] = np.nan
        elif self.unseen == "everything":
            R[:] = np.nan
        return R.reshape(self.n_tracks, -1)

    def given(self):
        return _put_into(self.container, self.matrix().astype(self.dtype))


@st.composite
def residuals(draw):
    return Residuals(
        n_tracks=draw(mostly(st.integers(1, 30), st.integers(30, 200))),
        n_pairs=draw(st.integers(1, 6)),
        n_hypotheses=draw(mostly(st.integers(1, 20), st.integers(20, 120))),
        kind=draw(st.sampled_from(RESIDUALS)),
        unseen=draw(st.sampled_from(UNSEEN)),
        dtype=draw(st.sampled_from(("float32", "float64"))),
        container=draw(st.sampled_from(("array", "fortran", "strided", "lists"))),
        seed=draw(SEEDS),
    )


# -------------------------------------------------------------------------- affinities

GRAPHS = (
    "random",
    "components",
    "ones",
    "path",
    "star",
    "bipartite",
    "copies",
    "wide",
    "counts",
    "zeros",
    "identity",
)
FLAWS = ("none", "rounding", "lopsided", "negative", "not a number", "a column short")


@dataclass(frozen=True)
class Affinities:
    """A recipe for stacked affinities (n, n_views * n)."""

    n: int
    graphs: tuple[str, ...]
    n_zero_rows: int
    scale: float
    flaw: str
    dtype: str
    seed: int

    def views(self):
        """The views (n_views, n, n) without the flaw."""
        rng = np.random.default_rng(self.seed)
        views = np.stack([_graph(name, self.n, rng) for name in self.graphs])
        unseen = rng.permutation(self.n)[: self.n_zero_rows]
        views[:, unseen] = views[:, :, unseen] = 0
        return (self.scale * views).astype(self.dtype).astype(float)

    def given(self):
        X = np.hstack(self.views())
        if self.flaw == "rounding":
            X *= 1 + 1e-7 * np.sin(np.arange(X.size)).reshape(X.shape)
        elif self.flaw == "lopsided" and self.n > 1:
            X[0, -1] += max(1.0, 2 * X.max())
        elif self.flaw == "negative":
            X[0, -1] = -1
        elif self.flaw == "not a number":
            X[0, -1] = np.nan
        elif self.flaw == "a column short":
            X = X[:, 1:]
        return X.astype(self.dtype)


def _graph(name, n, rng):
    K = rng.uniform(size=(n, n))
    group = rng.integers(1 + n // 4, size=n)
    step = np.subtract.outer(np.arange(n), np.arange(n))
    return {
        "random": (K + K.T) / 2,
        "components": (group[:, None] == group).astype(float),
        "ones": np.ones((n, n)),
        "zeros": np.zeros((n, n)),
        "identity": np.eye(n),
        "path": (np.abs(step) <= 1).astype(float),
        "star": ((np.arange(n) == 0)[:, None] | (np.arange(n) == 0)).astype(float),
        "bipartite": (step % 2 == 1).astype(float),
        "copies": ((K + K.T) / 2)[np.ix_(group, group)],
        "wide": 10 ** np.minimum(0, -40 * (K + K.T)),
        "counts": np.floor(3 * (K @ K.T) / n),
    }[name]


@st.composite
def affinities(draw):
    few, many = st.integers(1, 4), st.integers(25, 120)
    n = draw(mostly(st.integers(4, 25), few, few, many))
    graphs = mostly(st.sampled_from(GRAPHS[:-2]), st.sampled_from(GRAPHS[-2:]))
    dtype = draw(st.sampled_from(("float32", "float64")))
    most = 12 if dtype == "float32" else 300
    return Affinities(
        n=n,
        graphs=tuple(draw(st.lists(graphs, min_size=1, max_size=4))),
        n_zero_rows=draw(mostly(st.sampled_from((0, 1, n // 2)), st.just(n - 1))),
        scale=10.0 ** draw(mostly(st.integers(-12, 12), st.integers(-most, most))),
        flaw=draw(mostly(st.sampled_from(FLAWS[:2]), st.sampled_from(FLAWS))),
        dtype=dtype,
        seed=draw(SEEDS),
    )
