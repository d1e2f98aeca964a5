"""Whether the functions of a motion model give what is asked of them.

They are tried on a few points before any work is done: an error that comes up later, in
the middle of a batch, names neither the function nor what it should have given.
"""

from __future__ import annotations

import numpy as np

# Minimal sets, pairs of frames, and correspondences that a model is tried on.
N_SETS, N_PAIRS, N_POINTS = 4, 2, 5
# How far points move, where their mean distance from the middle is about 1.
MOTION = 0.1


def check_functions(model):
    """Refuse a motion model whose functions do not give what they should.

    Parameters
    ----------
    model : MotionModel

    Raises
    ------
    TypeError
        If one does not give an array of real numbers.
    ValueError
        If one gives an array of another shape, or squared errors that are below 0 or
        unknown.
    """
    rng = np.random.RandomState(0)
    x = rng.standard_normal((N_SETS, model.minimal_size, 2))
    y = x + MOTION * rng.standard_normal(x.shape)
    models = N_SETS, 3, 3
    _tried(model, "fit", [x, y], models)
    # Fits may be NaN; shifts are of any model.
    shifts = _tried(model, "from_translation", [y[:, 0] - x[:, 0]], models)
    of_pairs = np.stack([shifts] * N_PAIRS)
    maps = np.stack([np.diag([size, size, 1.0]) for size in range(1, 1 + N_PAIRS)])
    given = [of_pairs, maps[:, None], maps[:, None]]
    _tried(model, "change_coordinates", given, (N_PAIRS, *models))
    local = _tried(model, "change_coordinates", [shifts, maps[0], maps[0]], models)
    points = rng.standard_normal((2, N_PAIRS, N_POINTS, 2)).astype(np.float32)
    given = [local.astype(np.float32), *points]
    errors = _tried(model, "residuals", given, (N_PAIRS, N_POINTS, N_SETS))
    if not (errors >= 0).all():
        raise ValueError(
            f"residuals of the {model.name} model must give squared errors of 0 or "
            f"more for models that are finite; got {errors.min():.3g}"
        )


def _tried(model, part, given, shape):
    """What a function of a model gives, an array of a shape."""
    with np.errstate(all="ignore"):  # points may be degenerate for it
        found = getattr(model, part)(*given)
    expected = (
        f"{part} of the {model.name} model must give an array of real numbers of shape "
        f"{shape} for arrays of shapes {', '.join(str(each.shape) for each in given)}"
    )
    if not isinstance(found, np.ndarray) or found.dtype.kind not in "fiu":
        kind = getattr(found, "dtype", type(found).__name__)
        raise TypeError(f"{expected}; got {kind}")
    if found.shape != shape:
        raise ValueError(f"{expected}; got shape {found.shape}")
    return found
