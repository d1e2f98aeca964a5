"""What the displays share: axes, legends, fitted labels and checks."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from sklearn.base import BaseEstimator
from sklearn.pipeline import Pipeline
from sklearn.utils.validation import check_is_fitted

from .._utils.optional import require
from .._utils.validation import check_symmetric, split_views

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def require_pyplot() -> Any:
    """matplotlib's pyplot, or an ImportError that names the extra."""
    return require("matplotlib.pyplot", extra="plot")


def figure_and_ax(
    ax: Axes | None, figsize: tuple[float, float], layout: str = "constrained"
) -> tuple[Any, Axes]:
    """The figure of the axes given, or a new one of that size in inches."""
    if ax is not None:
        return figure_of(ax), ax
    return require_pyplot().subplots(figsize=figsize, layout=layout)


def figure_of(ax: Axes) -> Any:
    """The whole figure of some axes, which may be in a part of it."""
    figure: Any = ax.figure
    return figure.figure or figure  # a SubFigure knows that it is in


def legend_below(ax: Axes, n_columns: int) -> Any:
    """A legend under the axis label, as far from it on high axes as on low ones."""
    transforms = require("matplotlib.transforms", extra="plot")
    # Room for the tick labels and the axis label, in points, whatever their size.
    tick_size: Any = ax.xaxis.get_major_ticks()[0].label1.get_fontsize()
    label_size: Any = ax.xaxis.label.get_fontsize()
    room = 10 + 1.2 * (tick_size + label_size)
    down = transforms.ScaledTranslation(0, -room / 72, ax.figure.dpi_scale_trans)
    return ax.legend(
        *ax.get_legend_handles_labels(),  # which may be none
        loc="upper center",
        bbox_to_anchor=(0.5, 0),
        bbox_transform=ax.transAxes + down,
        borderaxespad=0,
        ncols=max(1, n_columns),
        frameon=False,
        fontsize="small",
    )


def last_step(estimator: BaseEstimator) -> Any:
    """The fitted estimator that holds the labels: the last of a pipeline."""
    check_is_fitted(estimator)
    return estimator[-1] if isinstance(estimator, Pipeline) else estimator


def refuse_windows(segmenter: Any) -> None:
    """Refuse a clip that was segmented in windows: there are no costs of all of it.

    Raises
    ------
    ValueError
    """
    if hasattr(segmenter, "windows_"):
        raise ValueError(
            "a clip of more than 100 frames is segmented in windows, which have no "
            "costs and affinities in common; draw it by MotionDisplay, or a part of it"
        )


def check_names(
    names: Sequence[str] | None, count: int, what: str, default: Any
) -> list[str]:
    """Names as a list of str, one each.

    Raises
    ------
    ValueError
        If there are more or fewer.
    """
    names = default if names is None else [str(name) for name in names]
    if len(names) != count:
        raise ValueError(f"{count} {what} need a name each; got {len(names)} names")
    return names


def read_stacked(affinities: npt.ArrayLike) -> npt.NDArray[np.floating]:
    """Stacked affinities (n, n_views * n) as views (n_views, n, n).

    Raises
    ------
    ValueError
        If they are of another shape, empty, or none that an estimator takes.
    """
    affinities = np.asarray(affinities, dtype=float)
    shape = affinities.shape
    if len(shape) != 2 or not affinities.size or shape[1] % shape[0]:
        raise ValueError(f"stacked affinities need shape (n, n_views * n); got {shape}")
    views = split_views(affinities, shape[1] // shape[0])
    check_affinities(views)
    return views


def check_affinities(views: npt.NDArray[np.floating]) -> None:
    """Refuse affinities (n_views, n, n) that no estimator takes.

    Raises
    ------
    ValueError
        If they are not finite, negative, or not symmetric.
    """
    if not np.isfinite(views).all() or views.min() < 0:
        raise ValueError("affinities must be finite and not negative")
    check_symmetric(views)


def count_motions(labels: npt.ArrayLike) -> int:
    """Motions among the labels; -1 is none."""
    labels = np.asarray(labels)
    return len(np.unique(labels[labels >= 0]))
