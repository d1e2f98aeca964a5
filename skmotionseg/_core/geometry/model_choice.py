"""The simplest motion model that explains a group of tracks.

The models compete by description length. A point map, affine or homography, says where
a track goes; a fundamental matrix leaves it a line, and the place along it has to be
told for each track. What a map saves in tracks it may lose in residuals, and each model
is paid for by its parameters.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .description_length import NOISE_LEVELS, shortest_length, track_medians
from .epipolar import (
    MINIMAL_SIZE,
    ROBUST_SCALE,
    ROBUST_SWEEPS,
    cheapest_rank_two,
    normalize_pairs,
    robust_fits,
)
from .motion_models import MOTION_MODELS

# Of two models that describe a group alike the first is taken: name, constraints per
# track, parameters.
EXPLAINING_MODELS = (("affine", 2, 6), ("homography", 2, 8), ("fundamental", 1, 7))
# Where tracks move by little more than their noise, a free coordinate would cost no
# more than a constrained one, and any model would do. So it costs at least a range well
# above the noise: about 6 pixels in a video of 640 x 480.
LEAST_RANGE = 20 * NOISE_LEVELS[-1]
# Directions in which tracks spread less than this share of their spread are none: a
# line of tracks leaves open what happens beside it.
FLAT = 1e-12


@dataclass(frozen=True)
class ModelChoice:
    """The simplest model that explains a group of tracks.

    Attributes
    ----------
    model : str or None
        "affine", "homography" or "fundamental"; None if no frame pair sees eight of
        the tracks.
    lengths : dict of str to float
        Nats per observation to describe the group by each model, in pairs that see
        eight tracks; empty if there is none.
    residuals : ndarray of shape (n_judged,)
        Distance of each track that such a pair sees from the model, lower median over
        the pairs, in pixels.
    """

    model: str | None
    lengths: dict[str, float]
    residuals: np.ndarray


def choose_model(geometry, members):
    """Find the model that describes a group of tracks in the fewest nats.

    Parameters
    ----------
    geometry : ClipGeometry
    members : ndarray of int
        Tracks of the group, ascending.

    Returns
    -------
    ModelChoice
    """
    log_range = np.maximum(geometry.log_range, np.log(LEAST_RANGE))
    geometry = replace(geometry, log_range=log_range)
    x, y, packed = geometry.of_group(members)
    modelled = packed.sum(axis=1) >= MINIMAL_SIZE
    if not modelled.any():
        return ModelChoice(None, {}, np.zeros(0))
    packed &= modelled[:, None]
    errors, lengths = {}, {}
    for name, n_constraints, n_parameters in EXPLAINING_MODELS:
        errors[name] = robust_errors(name, x, y, packed)
        length = shortest_length(
            geometry, errors[name], packed, n_constraints, n_parameters
        )
        lengths[name] = float(length.total / packed.sum())
    model = min(lengths, key=lambda name: lengths[name])
    seen = geometry.seen[:, members] & modelled[:, None]
    distances = geometry.frames.scale * np.sqrt(errors[model][packed])
    medians = track_medians(seen, distances)
    return ModelChoice(model, lengths, medians[seen.any(axis=0)])


def robust_errors(name, x, y, seen):
    """Squared Sampson errors to a model fitted robustly to each pair.

    Parameters
    ----------
    name : {"affine", "homography", "fundamental"}
    x, y : ndarray of shape (n_pairs, n, 2)
    seen : ndarray of bool, shape (n_pairs, n)

    Returns
    -------
    ndarray of shape (n_pairs, n)
        In the unit of the points, squared; infinite in pairs that see fewer than eight.
    """
    if name == "fundamental":
        return robust_fits(x, y, seen, cheapest_rank_two)[1]
    return _robust_map_errors(name, x, y, seen)


def _robust_map_errors(name, x, y, seen):
    """As :func:`~skmotionseg._core.geometry.epipolar.robust_fits`, for point maps.

    Iteratively reweighted least squares with the same weights.
    """
    fit, residuals = MAP_FITS[name], MOTION_MODELS[name].residuals
    found = np.full(seen.shape, np.inf)
    pairs = np.flatnonzero(seen.sum(axis=1) >= MINIMAL_SIZE)
    if len(pairs) == 0:
        return found
    seen = seen[pairs]
    x, y, _, spread = normalize_pairs(x[pairs], y[pairs], seen)
    weights = seen.astype(float)
    for _ in range(ROBUST_SWEEPS):
        maps = fit(x, y, weights)  # (P, 3, 3)
        errors = np.stack(
            [
                residuals(each[None], start[:, :2], end[:, :2])[:, 0]
                for each, start, end in zip(maps, x, y, strict=True)
            ]
        )  # (P, n)
        weights = seen / (1 + errors * (spread / ROBUST_SCALE) ** 2)
        # Equations of a homography are as large as its third coordinate.
        size = (x @ maps[:, 2, :, None])[..., 0] ** 2
        size = np.maximum(size, 1e-9 * size.max(axis=1, keepdims=True))
        weights /= np.maximum(size, np.finfo(float).tiny)
        weights /= weights.max(axis=1, keepdims=True)
    found[pairs] = errors * spread**2
    return found


def _fit_affine_maps(x, y, weights):
    """Affine maps (P, 3, 3) of least squares, of homogeneous points (P, n, 3).

    The one of least norm where tracks leave some of it open.
    """
    weighted = (x * weights[..., None]).swapaxes(1, 2)  # (P, 3, n)
    inverse = np.linalg.pinv(weighted @ x, rcond=FLAT, hermitian=True)
    maps = (inverse @ (weighted @ y)).swapaxes(1, 2)
    maps[:, 2] = 0, 0, 1
    return maps


def _fit_homographies(x, y, weights):
    """Homographies (P, 3, 3) of least algebraic error, of unit norm, by DLT."""
    rows = np.zeros((2, *x.shape[:2], 3, 3))  # u - y0 w and v - y1 w
    for i in (0, 1):
        rows[i, :, :, i] = x
        rows[i, :, :, 2] = -y[..., i, None] * x
    rows = rows.reshape(2, *x.shape[:2], 9)
    moments = ((rows * weights[..., None]).swapaxes(2, 3) @ rows).sum(axis=0)
    return np.linalg.eigh(moments)[1][..., 0].reshape(-1, 3, 3)


MAP_FITS = {"affine": _fit_affine_maps, "homography": _fit_homographies}
