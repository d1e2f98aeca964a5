"""Why so many motions: what each number of them costs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Self

import numpy as np
import numpy.typing as npt
from sklearn.base import BaseEstimator

from .._core.graph.cuts import partition_costs
from .._core.labels import canonical_labels
from .._utils.colours import series_colour
from .._utils.optional import require
from .._utils.validation import check_label_each
from ..model_selection import NCREModelSelector
from ._drawing import (
    count_motions,
    figure_and_ax,
    last_step,
    legend_below,
    read_stacked,
    refuse_windows,
    require_pyplot,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MARKERS = ("o", "s", "D")


class CountDisplay:
    """What each number of motions costs, and the one that was chosen.

    Two terms, each times its weight, and their sum. Make it by :meth:`from_estimator`
    or :meth:`from_predictions`.

    Parameters
    ----------
    counts : array-like of int, shape (n_counts,)
    costs : array-like of shape (n_counts, 3)
        The terms as they are, and the total.
    chosen : int
        One of ``counts``.
    weights : (float, float), default=(1, 1)
        Of the two terms in the total.
    term_names : (str, str), default=("normalised cut", "reconstruction error")
    passed_over : array-like of bool, shape (n_counts,), optional
        Counts two of whose motions gain too little from being apart, which is why they
        were passed over: hollow on the curve of the total.

    Attributes
    ----------
    lines_ : list of matplotlib Line2D
        Both weighted terms and the total, over ``counts``.
    chosen_line_ : matplotlib Line2D
        Vertical, at the chosen count.
    passed_over_line_ : matplotlib Line2D or None
        The hollow marks, if there are any.
    legend_ : matplotlib Legend
    ax_ : matplotlib axes
    figure_ : matplotlib figure

    References
    ----------
    .. [1] X. Xu, L.-F. Cheong and Z. Li, "3D Rigid Motion Segmentation with Mixed and
       Unknown Number of Models", IEEE TPAMI 43(1), 2021: panel i of the figure of
       its section on model selection.
       https://doi.org/10.1109/TPAMI.2019.2929146

    Examples
    --------
    >>> import numpy as np
    >>> from skmotionseg import NCREModelSelector
    >>> from skmotionseg.plotting import CountDisplay
    >>> block = np.kron(np.eye(3), np.ones((4, 4))) + 0.01
    >>> selector = NCREModelSelector(random_state=0, max_clusters=5).fit(block)
    >>> display = CountDisplay.from_estimator(selector)
    >>> display.lines_[2].get_xdata()
    array([1, 2, 3, 4, 5])
    >>> display.chosen
    3
    """

    def __init__(
        self,
        counts: npt.ArrayLike,
        costs: npt.ArrayLike,
        chosen: int,
        *,
        weights: tuple[float, float] = (1, 1),
        term_names: tuple[str, str] = ("normalised cut", "reconstruction error"),
        passed_over: npt.ArrayLike | None = None,
    ) -> None:
        self.counts: Any = counts
        self.costs: Any = costs
        self.chosen = chosen
        self.weights = weights
        self.term_names = term_names
        self.passed_over = passed_over

    @classmethod
    def from_estimator(
        cls, estimator: BaseEstimator, *, ax: Axes | None = None
    ) -> Self:
        """Draw what the counts that a fitted estimator tried cost.

        Parameters
        ----------
        estimator : fitted estimator or Pipeline
            :class:`~skmotionseg.NCREModelSelector` or another selector, alone or last
            in a pipeline, or :class:`~skmotionseg.MotionSegmenter`.
        ax : matplotlib axes, optional

        Returns
        -------
        CountDisplay

        Raises
        ------
        NotFittedError, ValueError
            If it is not fitted, or does not compare numbers of motions.
        """
        require_pyplot()
        last = last_step(estimator)
        refuse_windows(last)
        if not hasattr(last, "costs_"):
            raise ValueError(
                f"{type(last).__name__} does not compare numbers of motions; give an "
                "NCREModelSelector or a MotionSegmenter"
            )
        display = cls(
            last.counts_,
            last.costs_,
            int(last.counts_[last.best_index_]),
            weights=getattr(last, "cost_weights_", (1, 1)),
            term_names=getattr(last, "cost_names_", ("first term", "second term")),
            passed_over=_passed_over(last),
        )
        return display.plot(ax=ax)

    @classmethod
    def from_predictions(
        cls,
        affinities: npt.ArrayLike,
        partitions: Sequence[npt.ArrayLike],
        *,
        delta: float | None = None,
        ax: Axes | None = None,
    ) -> Self:
        """Draw what partitions that are at hand cost by NCRE, the paper's choice.

        Parameters
        ----------
        affinities : array-like of shape (n, n_views * n)
            Of the views, side by side: symmetric and not negative.
        partitions : array-like of int, shape (n_partitions, n)
            One for each number of motions.
        delta : float, optional
            Weight of the reconstruction error; by default that of
            :class:`~skmotionseg.NCREModelSelector`.
        ax : matplotlib axes, optional

        Returns
        -------
        CountDisplay

        Raises
        ------
        ValueError
            If affinities are not made of square, symmetric, finite blocks that are not
            negative, partitions do not fit them or have one number of motions twice, or
            ``delta`` is negative or not finite.
        """
        views = read_stacked(affinities)
        n = views.shape[1]
        checked = [check_label_each(p, n, "a partition") for p in partitions]
        labellings = sorted(map(canonical_labels, checked), key=count_motions)
        counts = np.array([count_motions(p) for p in labellings])
        if not len(counts) or len(set(counts)) < len(counts):
            raise ValueError(
                "there must be one partition per number of motions; got some of "
                f"{counts.tolist()}"
            )
        delta = NCREModelSelector().delta if delta is None else float(delta)
        if not 0 <= delta < np.inf:
            raise ValueError(f"delta must be a number of 0 or more; got {delta}")
        costs = np.stack([partition_costs(views, p, delta) for p in labellings])
        chosen = int(counts[costs[:, 2].argmin()])
        return cls(counts, costs, chosen, weights=(1, delta)).plot(ax=ax)

    def plot(self, *, ax: Axes | None = None) -> Self:
        """Draw.

        Parameters
        ----------
        ax : matplotlib axes, optional
            By default those of a new figure.

        Returns
        -------
        CountDisplay

        Raises
        ------
        ImportError
            If matplotlib is missing.
        ValueError
            If there are not three costs per count, ``chosen`` is none of the counts, or
            ``passed_over`` does not say so of each. Nothing is drawn then.
        """
        counts, costs = np.asarray(self.counts), np.asarray(self.costs, dtype=float)
        if counts.ndim != 1 or not len(counts) or costs.shape != (len(counts), 3):
            raise ValueError(
                f"counts of shape {counts.shape} need costs of shape (n_counts, 3); "
                f"got {costs.shape}"
            )
        if self.chosen not in counts:
            raise ValueError(f"chosen must be one of {counts}; got {self.chosen}")
        passed_over = _check_passed_over(self.passed_over, counts)
        ticker = require("matplotlib.ticker", extra="plot")
        self.figure_, self.ax_ = figure_and_ax(ax, (5.2, 3.8))
        weights = (*self.weights, 1)
        names = [
            name if weight == 1 else rf"{weight:g} $\times$ {name}"
            for name, weight in zip((*self.term_names, "total"), weights, strict=True)
        ]
        self.chosen_line_ = self.ax_.axvline(
            self.chosen,
            color="0.6",
            linestyle=":",
            zorder=1,
            label=f"chosen: {self.chosen}",
        )
        self.lines_ = [
            self._draw_curve(counts, weight * cost, position, name)
            for position, (cost, weight, name) in enumerate(
                zip(costs.T, weights, names, strict=True)
            )
        ]
        self.passed_over_line_ = None
        if passed_over.any():
            self.passed_over_line_ = self._draw_hollow(counts, costs[:, 2], passed_over)
        self.ax_.set(xlabel="number of motions", ylabel="cost")
        self.ax_.xaxis.set_major_locator(
            ticker.MaxNLocator(integer=True, min_n_ticks=1)
        )
        self.legend_ = legend_below(self.ax_, 2)
        return self

    def _draw_curve(self, counts, values, position, name):
        return self.ax_.plot(
            counts,
            values,
            color=series_colour(position),
            marker=MARKERS[position],
            markersize=4,
            linewidth=2 if position == 2 else 1.2,
            label=name,
        )[0]

    def _draw_hollow(self, counts, totals, hollow):
        return self.ax_.plot(
            counts[hollow],
            totals[hollow],
            linestyle="none",
            marker=MARKERS[2],
            markersize=6,
            markerfacecolor="white",
            markeredgecolor=series_colour(2),
            label="two of the motions are one",
        )[0]


def _passed_over(estimator):
    """Which counts have motions that gain too little; None if nobody asked."""
    pairs = getattr(estimator, "gainless_pairs_", None)
    return None if pairs is None else (pairs >= 0).all(axis=1)


def _check_passed_over(passed_over, counts):
    if passed_over is None:
        return np.zeros(len(counts), dtype=bool)
    passed_over = np.asarray(passed_over)
    if passed_over.shape != counts.shape or passed_over.dtype != bool:
        raise ValueError(
            f"{len(counts)} counts need a bool each in passed_over; got shape "
            f"{passed_over.shape} and dtype {passed_over.dtype}"
        )
    return passed_over
