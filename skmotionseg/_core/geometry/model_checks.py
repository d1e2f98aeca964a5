"""Whether the functions of a motion model give what is asked of them.

They are tried on a few points before any work is done: an error that comes up later, in
the middle of a batch, names neither the function nor what it should have given.
"""

from __future__ import annotations

import numpy as np

# Minimal sets, and correspondences, that a model is tried on.
N_SETS, N_POINTS = 4, 5


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
        If one gives an array of another shape, or squared errors below 0.
    """
    rng = np.random.RandomState(0)
    sets = rng.standard_normal((2, N_SETS, model.minimal_size, 2))
    points = rng.standard_normal((2, N_POINTS, 2)).astype(np.float32)
    maps = np.diag([2.0, 2.0, 1.0])[None, None]
    models = N_SETS, 3, 3
    fitted = _tried(model, "fit", sets, models)
    _tried(model, "from_translation", [sets[1, :, 0]], models)
    moved = _tried(
        model, "change_coordinates", [fitted[None], maps, maps], (1, *models)
    )
    given = [moved[0].astype(np.float32), *points]
    errors = _tried(model, "residuals", given, (N_POINTS, N_SETS))
    if (errors < 0).any():
        raise ValueError(
            f"residuals of the {model.name} model must give squared errors; got "
            f"{np.nanmin(errors):.3g}"
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
