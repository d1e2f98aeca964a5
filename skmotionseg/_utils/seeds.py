"""Where estimators hold their seeds."""

from __future__ import annotations


def seed_names(estimator):
    """Parameters of an estimator, and of those that it holds, that are seeds.

    Returns
    -------
    list of str
        Such as ``["random_state", "selection__random_state"]``.
    """
    names = estimator.get_params()
    return [name for name in names if name.rpartition("__")[2] == "random_state"]
