"""A fourth motion model, as a stranger writes it who has read the guide alone."""

from __future__ import annotations

from dataclasses import replace

from skmotionseg import MotionModel


def fit_shift(x, y):
    """(..., 1, 2), (..., 1, 2) -> (..., 3, 3)."""
    return MotionModel.built_in("affine").from_translation((y - x)[..., 0, :])


SHIFT = replace(
    MotionModel.built_in("affine"), name="shift", minimal_size=1, fit=fit_shift
)


def local_shift(by=0.0):
    """The same, of a function that no other process can import."""

    def fit(x, y):
        return fit_shift(x, y + by)

    return replace(SHIFT, fit=fit)
