"""Residual matrices that say how many columns each frame pair has."""

from __future__ import annotations

import re
from typing import Any

import numpy as np

COLUMN = re.compile(r"pair(\d+)_hypothesis(\d+)")


class Residuals(np.ndarray):
    """Residuals (n_tracks, n_pairs * n_hypotheses) with ``n_hypotheses`` beside them.

    An array like any other, but for the attribute, which rows and pickles keep. What
    reads the residuals then need not be told what drew the hypotheses.
    """

    n_hypotheses: int | None

    @classmethod
    def of_groups(cls, matrix, n_hypotheses):
        """A view of a matrix whose columns come in groups of so many."""
        residuals = matrix.view(cls)
        residuals.n_hypotheses = n_hypotheses
        return residuals

    def __array_finalize__(self, source):
        self.n_hypotheses = getattr(source, "n_hypotheses", None)

    def __reduce__(self):
        state: Any = super().__reduce__()
        return state[0], state[1], (state[2], self.n_hypotheses)

    def __setstate__(self, state):
        array_state, self.n_hypotheses = state
        super().__setstate__(array_state)


def column_names(n_pairs, n_hypotheses):
    """Names of residual columns; object, (n_pairs * n_hypotheses,)."""
    return np.array(
        [
            f"pair{pair}_hypothesis{hypothesis}"
            for pair in range(n_pairs)
            for hypothesis in range(n_hypotheses)
        ],
        dtype=object,
    )


def sent_group_size(X):
    """Hypotheses per frame pair that residuals say they have; None if they do not.

    Parameters
    ----------
    X : array-like
        :class:`Residuals`, or a data frame whose columns have :func:`column_names`.

    Returns
    -------
    int or None
    """
    if isinstance(X, Residuals):
        return X.n_hypotheses
    columns = getattr(X, "columns", None)
    if columns is None or not len(columns):
        return None
    last = COLUMN.fullmatch(str(columns[-1]))
    return None if last is None else int(last[2]) + 1
