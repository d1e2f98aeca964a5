"""Hypotheses from random minimal sets of a frame pair, and the residuals to them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from .tracks import apply_similarity, normalization, similarity

# A degenerate minimal set is drawn again at most this often. At an even chance of
# a degenerate draw, one set in a million is still degenerate at the end.
MAX_REDRAWS = 20

# Tracks below which two of them are left out of too few minimal sets of eight.
FEWEST_OTHERS = 12

# Minimal sets that are fitted at a time: what is in work then stays in the cache.
SETS_A_BATCH = 2000

# Tracks go through the matrix product in blocks of so many, the last one padded: BLAS
# rounds differently for other shapes, and a track's residuals must not depend on which
# tracks come with it.
ROWS_A_BLOCK = 64
# Blocks at a time, for the same reason.
BLOCKS_A_BATCH = 2

# Points farther from the centre than so many times the scale are moved to there before
# their errors are computed: no hypothesis explains them, and the errors of homographies
# have terms of the eighth order, which single precision would not hold.
FARTHEST = 1e5


def draw_minimal_sets(n_available, size, random_state):
    """Draw sets of distinct positions, uniformly and without a loop over sets.

    Parameters
    ----------
    n_available : ndarray of int, shape (B,)
        Each set is drawn from ``range(n_available[b])``; at least ``size``.
    size : int
    random_state : numpy.random.RandomState

    Returns
    -------
    ndarray of int, shape (B, size)
    """
    drawn = np.empty((len(n_available), 0), dtype=np.intp)  # kept sorted
    uniform = random_state.random_sample((len(n_available), size))
    for k in range(size):
        # The k-th draw is a rank among the positions left; step over those taken.
        position = (uniform[:, k] * (n_available - k)).astype(np.intp)
        for taken in drawn.T:
            position += position >= taken
        drawn = np.sort(np.column_stack([drawn, position]), axis=1)
    return drawn


def draw_hypotheses(points, visibility, pairs, model, n_hypotheses, random_state):
    """Fit a motion model to random minimal sets in each frame pair.

    Degenerate sets are drawn again; a set that stays degenerate takes the model of
    another set of its pair. A pair in which none is sound, because all its tracks
    lie on a line, say, gets the translations of single tracks instead.

    Parameters
    ----------
    points : ndarray of shape (n_tracks, n_frames, 2)
    visibility : ndarray of bool, shape (n_tracks, n_frames)
    pairs : ndarray of int, shape (n_pairs, 2)
    model : MotionModel
    n_hypotheses : int
        Models per pair.
    random_state : numpy.random.RandomState

    Returns
    -------
    hypotheses : ndarray of shape (n_pairs, n_hypotheses, 3, 3), float64
        Models of pixel coordinates; NaN for a pair in which fewer than
        ``model.minimal_size`` tracks are seen.
    minimal_sets : ndarray of int, shape (n_pairs, n_hypotheses, model.minimal_size)
        The tracks that each was fitted to, a single one perhaps repeated; -1 where
        there is no model.
    """
    seen = visibility[:, pairs].all(axis=2).T  # (n_pairs, n_tracks)
    usable = np.flatnonzero(seen.sum(axis=1) >= model.minimal_size)
    hypotheses = np.full((len(pairs), n_hypotheses, 3, 3), np.nan)
    minimal_sets = np.full((len(pairs), n_hypotheses, model.minimal_size), -1)
    if len(usable) == 0:
        return hypotheses, minimal_sets
    scenes = _NormalizedPairs.from_tracks(points, seen[usable], pairs[usable])

    def draw(scene):  # (B,) -> (B, p), (B, 3, 3)
        n_available = scenes.sizes[scene]
        sets = draw_minimal_sets(n_available, model.minimal_size, random_state)
        return sets, scenes.fit(model, scene, sets)

    scene = np.repeat(np.arange(len(usable)), n_hypotheses)
    sets, fitted = draw(scene)
    for _ in range(MAX_REDRAWS):
        degenerate = np.flatnonzero(np.isnan(fitted[:, 0, 0]))
        if len(degenerate) == 0:
            break
        sets[degenerate], fitted[degenerate] = draw(scene[degenerate])
    fitted = fitted.reshape(len(usable), n_hypotheses, 3, 3)
    fitted, sets = scenes.in_pixels(model, fitted), sets.reshape(*fitted.shape[:2], -1)
    for s in np.flatnonzero(np.isnan(fitted[:, :, 0, 0]).any(axis=1)):
        f, g = pairs[usable[s]]
        shifts = (points[:, g] - points[:, f])[seen[usable[s]]]
        fitted[s], sets[s] = _replace_degenerate(
            fitted[s], sets[s], shifts, model, random_state
        )
    hypotheses[usable] = fitted
    for pair, positions in zip(usable, sets, strict=True):
        minimal_sets[pair] = np.flatnonzero(seen[pair])[positions]
    return hypotheses, minimal_sets


@dataclass(frozen=True)
class _NormalizedPairs:
    """The points that both frames of each pair see, each frame normalised by itself.

    Attributes
    ----------
    first, second : ndarray of shape (n_points, 2)
        Those of all pairs, one pair after the other.
    sizes, offsets : ndarray of int, shape (n_pairs,)
        How many there are of each pair, and where they start.
    to_first, to_second : ndarray of shape (n_pairs, 3, 3)
        The maps that normalised them.
    """

    first: np.ndarray
    second: np.ndarray
    sizes: np.ndarray
    offsets: np.ndarray
    to_first: np.ndarray
    to_second: np.ndarray

    @classmethod
    def from_tracks(cls, points, seen, pairs):
        """Points (n_tracks, n_frames, 2), of which each pair sees some."""
        scenes = [
            _normalized_pair(points[rows][:, pair])
            for rows, pair in zip(seen, pairs, strict=True)
        ]
        sides: Any = zip(*scenes, strict=True)
        first, second, to_first, to_second = map(list, sides)
        sizes = np.array([len(x) for x in first])
        offsets = np.concatenate([[0], np.cumsum(sizes)[:-1]])
        return cls(
            np.concatenate(first),
            np.concatenate(second),
            sizes,
            offsets,
            np.stack(to_first),
            np.stack(to_second),
        )

    def fit(self, model, scene, sets):
        """Models (B, 3, 3) of normalised points, of pairs (B,) and positions (B, p)."""
        sets = sets + self.offsets[scene, None]
        batches = range(0, len(sets), SETS_A_BATCH)
        return np.concatenate(
            [
                model.fit(self.first[batch], self.second[batch])
                for batch in (sets[start : start + SETS_A_BATCH] for start in batches)
            ]
        )

    def in_pixels(self, model, fitted):
        """Models (n_pairs, K, 3, 3) of pixels, given those of normalised points."""
        return model.change_coordinates(
            fitted,
            np.linalg.inv(self.to_first)[:, None],
            np.linalg.inv(self.to_second)[:, None],
        )


def _normalized_pair(points):
    """Points (n, 2, 2) of a frame pair, each frame normalised, and the two maps."""
    maps = [normalization(points[:, side]) for side in (0, 1)]
    sides = [apply_similarity(T, points[:, side]) for side, T in enumerate(maps)]
    return *sides, *maps


def _replace_degenerate(fitted, sets, shifts, model, random_state):
    """Sound models (K, 3, 3) of a pair, and what they were fitted to (K, p)."""
    sound = np.flatnonzero(~np.isnan(fitted[:, 0, 0]))
    if len(sound):
        taken = np.arange(len(fitted))
        missing = np.isnan(fitted[:, 0, 0])
        taken[missing] = np.resize(sound, missing.sum())
        return fitted[taken], sets[taken]
    drawn = random_state.randint(len(shifts), size=len(fitted))
    sets = np.tile(drawn[:, None], sets.shape[1])
    return model.from_translation(shifts[drawn]), sets


def residual_blocks(points, visibility, pairs, hypotheses, model, centres, scale):
    """Squared Sampson errors of tracks to the hypotheses of each frame pair in turn.

    Computed in float32 in coordinates centred in each frame and scaled alike in both,
    which leaves the error what it is in pixels but for the factor ``scale ** -2``.

    Parameters
    ----------
    points : ndarray of shape (n_tracks, n_frames, 2)
    visibility : ndarray of bool, shape (n_tracks, n_frames)
    pairs : ndarray of int, shape (n_pairs, 2)
    hypotheses : ndarray of shape (n_pairs, n_hypotheses, 3, 3)
    model : MotionModel
    centres : ndarray of shape (n_frames, 2)
    scale : float

    Yields
    ------
    rows : ndarray of int, shape (n_seen,)
        Tracks that are seen in the pair; none for a pair without hypotheses.
    residuals : ndarray of shape (n_seen, n_hypotheses), float32
        In squared pixels.
    """
    unit = np.float32(scale**2)
    # Near the pole of a homography an error may be as large as single precision has it.
    largest = np.float32(np.finfo(np.float32).max / (2 * max(1.0, scale**2)))
    for (f, g), models in zip(pairs, hypotheses, strict=True):
        rows = np.flatnonzero(visibility[:, f] & visibility[:, g])
        if np.isnan(models[0, 0, 0]):
            rows = rows[:0]
        S, T = similarity(1 / scale, centres[f]), similarity(1 / scale, centres[g])
        local = model.change_coordinates(models, S, T).astype(np.float32)
        x, y = (
            _in_blocks(
                apply_similarity(T, points[rows, frame]).clip(-FARTHEST, FARTHEST)
            )
            for T, frame in ((S, f), (T, g))
        )
        residuals = np.empty((*x.shape[:2], len(models)), dtype=np.float32)
        for start in range(0, len(x), BLOCKS_A_BATCH):
            batch = slice(start, start + BLOCKS_A_BATCH)
            errors = model.residuals(local, x[batch], y[batch])
            np.minimum(errors, largest, out=residuals[batch])
            residuals[batch] *= unit
        yield rows, residuals.reshape(-1, len(models))[: len(rows)]


def of_others(blocks, minimal_sets, points, pairs):
    """Residuals of tracks to hypotheses that were fitted to others.

    A model fits its own minimal set whatever that holds: of thirty tracks, each is in a
    quarter of the sets of eight, most of them from several motions, and would prefer
    these to the few from its own motion alone.

    Parameters
    ----------
    blocks : iterable of (rows, residuals)
        As from :func:`residual_blocks`, of the tracks that hypotheses were fitted to.
    minimal_sets : ndarray of int, shape (n_pairs, n_hypotheses, p)
        As from :func:`draw_hypotheses`.
    points : ndarray of shape (n_tracks, n_frames, 2)
    pairs : ndarray of int, shape (n_pairs, 2)

    Yields
    ------
    rows, residuals
        Infinite where a track is in the minimal set, or just where one is that is; as
        they are in a pair that sees fewer than ``FEWEST_OTHERS`` tracks.
    """
    for (rows, residuals), sets, pair in zip(blocks, minimal_sets, pairs, strict=True):
        if len(rows) >= FEWEST_OTHERS:
            places = points[rows][:, pair].reshape(len(rows), -1)
            _, place = np.unique(places, axis=0, return_inverse=True)
            own = np.zeros((len(rows), len(sets)), dtype=bool)
            taken = place[np.searchsorted(rows, sets)]
            own[taken, np.arange(len(sets))[:, None]] = True
            residuals[own[place]] = np.inf
        yield rows, residuals


def residual_matrix(points, visibility, pairs, hypotheses, model, centres, scale):
    """What :func:`residual_blocks` yields, side by side.

    Returns
    -------
    ndarray of shape (n_tracks, n_pairs * n_hypotheses), float32
        Pair-major, in squared pixels; NaN where the track is unseen in the pair.
    """
    n_pairs, n_hypotheses = hypotheses.shape[:2]
    residuals = np.full((len(points), n_pairs, n_hypotheses), np.nan, dtype=np.float32)
    blocks = residual_blocks(
        points, visibility, pairs, hypotheses, model, centres, scale
    )
    for pair, (rows, block) in enumerate(blocks):
        residuals[rows, pair] = block
    return residuals.reshape(len(points), -1)


def _in_blocks(x):
    """Points (n, 2) as float32 blocks (n_blocks, ROWS_A_BLOCK, 2), zeros at the end."""
    blocks = np.zeros((-(-len(x) // ROWS_A_BLOCK), ROWS_A_BLOCK, 2), dtype=np.float32)
    blocks.reshape(-1, 2)[: len(x)] = x
    return blocks
