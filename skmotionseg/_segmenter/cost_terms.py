"""What the columns of ``costs_`` are, by the rule that chose the number of motions."""

from __future__ import annotations

from .._core.graph.eigenvector_rules import ALIGNMENT_TOLERANCE
from .._core.partition.cost import CUT_WEIGHT
from ..model_selection import EigengapModelSelector, SelfTuningModelSelector

# Totals that differ by less are equal.
ROUNDING = 1e-9


def cost_terms(estimator):
    """Weights and names of the two terms of a fitted estimator's costs.

    Parameters
    ----------
    estimator : MotionSegmenter or a selector

    Returns
    -------
    weights : (float, float)
        The first term and the second, each times its weight, add up to the total.
    names : (str, str)
    """
    rule = getattr(estimator, "selection", None)
    if rule == "description_length":
        return (CUT_WEIGHT, 1), ("normalised cut", "nats an observation")
    if rule == "eigengap" or isinstance(estimator, EigengapModelSelector):
        return (1, -1), ("eigenvalue", "next eigenvalue")
    if _is_self_tuning(estimator):
        return (1, -1), ("alignment cost", "its least value")
    return (1, estimator.delta), ("normalised cut", "reconstruction error")


def cost_tolerance(estimator):
    """Totals that differ by no more are equal to the rule."""
    return ALIGNMENT_TOLERANCE if _is_self_tuning(estimator) else ROUNDING


def _is_self_tuning(estimator):
    rule = getattr(estimator, "selection", None)
    return rule == "self_tuning" or isinstance(estimator, SelfTuningModelSelector)
