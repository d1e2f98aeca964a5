"""Errors over the values of parameters."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import compress
from numbers import Real
from pickle import PicklingError
from typing import TYPE_CHECKING, Any, Self

import joblib
import numpy as np
import numpy.typing as npt
from sklearn.base import BaseEstimator, clone
from sklearn.utils import check_random_state
from sklearn.utils.validation import check_is_fitted

from .._core.geometry.motion_models import MOTION_MODELS
from .._core.graph.kmeans import kmeans
from .._core.graph.spectral import cluster_features
from .._core.labels import canonical_labels
from .._parallel.threads import single_threaded
from .._utils.colours import ERROR_MAP, series_colour
from .._utils.validation import check_label_each
from ..metrics import misclassification_error
from ._drawing import (
    check_names,
    count_motions,
    figure_and_ax,
    legend_below,
    require_pyplot,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# The weight of each fusion that has one: its parameter, and how it is written.
WEIGHTS = {"coreg": ("lam", r"$\lambda$"), "subset": ("gamma", r"$\gamma$")}
# Letters of a value that fits beside its neighbours below an axis.
LONGEST_UPRIGHT = 8
MARKERS = ("o", "s", "D", "^", "v", "P")


class FusionWeightDisplay:
    """Error against the weight of a fusion: of all views together, and of each.

    Each view's error is that of k-means on its own embedding after fusion, which shows
    what the views learn from each other. Make it by :meth:`from_estimator` or
    :meth:`from_predictions`.

    Parameters
    ----------
    values : array-like of shape (n_values,)
        Of the weight; positive.
    errors : array-like of shape (n_values,) or (n_values, n_sequences)
        Of the fused result, in 0 to 1; the mean over sequences is drawn, in percent.
    view_errors : array-like of shape (n_views, n_values) or \
(n_views, n_values, n_sequences), optional
        Of each view's own embedding.
    view_names : sequence of str, optional
    weight_name : str, default="weight"
        Of the axis.

    Attributes
    ----------
    line_ : matplotlib Line2D
        Of the fused result.
    view_lines_ : list of matplotlib Line2D
    legend_ : matplotlib Legend
    ax_ : matplotlib axes
    figure_ : matplotlib figure

    References
    ----------
    .. [1] X. Xu, L.-F. Cheong and Z. Li, "3D Rigid Motion Segmentation with Mixed and
       Unknown Number of Models", IEEE TPAMI 43(1), 2021, the figure of its results
       on KT3DMoSeg, b and c.
       https://doi.org/10.1109/TPAMI.2019.2929146

    Examples
    --------
    >>> import numpy as np
    >>> from skmotionseg import MultiModelSpectralClustering
    >>> from skmotionseg.plotting import FusionWeightDisplay
    >>> block = np.kron(np.eye(2), np.ones((3, 3)))
    >>> views, y = np.hstack([block, block + 0.1]), np.repeat([0, 1], 3)
    >>> clusterer = MultiModelSpectralClustering(fusion="coreg", random_state=0)
    >>> display = FusionWeightDisplay.from_estimator(
    ...     clusterer, [views], [y], values=[0.01, 0.1]
    ... )
    >>> display.line_.get_ydata()
    array([0., 0.])
    >>> len(display.view_lines_)
    2
    """

    def __init__(
        self,
        values: npt.ArrayLike,
        errors: npt.ArrayLike,
        view_errors: npt.ArrayLike = (),
        *,
        view_names: Sequence[str] | None = None,
        weight_name: str = "weight",
    ) -> None:
        self.values: Any = values
        self.errors: Any = errors
        self.view_errors: Any = view_errors
        self.view_names = view_names
        self.weight_name = weight_name

    @classmethod
    def from_estimator(
        cls,
        clusterer: BaseEstimator,
        X: Sequence[Any],
        y: Sequence[Any],
        *,
        values: npt.ArrayLike,
        view_names: Sequence[str] | None = None,
        ax: Axes | None = None,
    ) -> Self:
        """Cluster sequences with each weight and draw the errors.

        Parameters
        ----------
        clusterer : MultiModelSpectralClustering
            With ``fusion`` "coreg", whose ``lam`` is varied, or "subset", whose
            ``gamma`` is. Its ``n_clusters`` is set to the true number of motions.
        X : list of array-like, each of shape (n, n_views * n)
            Stacked affinities of each sequence.
        y : list of array-like of int, each of shape (n,)
            True labels; those of -1 are not judged.
        values : array-like of shape (n_values,)
            Of the weight; positive.
        view_names : sequence of str, optional
        ax : matplotlib axes, optional

        Returns
        -------
        FusionWeightDisplay

        Raises
        ------
        ValueError
            If the fusion has no weight, a value is not positive, or the sequences and
            labels do not fit.
        """
        require_pyplot()
        parameter, symbol = _weight_of(clusterer.fusion)
        weights = _check_values(values)
        errors = _errors_by_weight(
            clusterer, parameter, weights, _check_sequences(X, y)
        )
        return cls(
            weights,
            errors[..., 0],
            np.moveaxis(errors[..., 1:], 2, 0),
            view_names=view_names,
            weight_name=f"{symbol} ({parameter})",
        ).plot(ax=ax)

    @classmethod
    def from_predictions(
        cls,
        values: npt.ArrayLike,
        errors: npt.ArrayLike,
        view_errors: npt.ArrayLike = (),
        *,
        view_names: Sequence[str] | None = None,
        weight_name: str = "weight",
        ax: Axes | None = None,
    ) -> Self:
        """Draw errors that are at hand.

        Parameters
        ----------
        values, errors, view_errors, view_names, weight_name
            As for :class:`FusionWeightDisplay`.
        ax : matplotlib axes, optional

        Returns
        -------
        FusionWeightDisplay

        Raises
        ------
        ValueError
            As :meth:`plot` has it.
        """
        display = cls(
            values,
            errors,
            view_errors,
            view_names=view_names,
            weight_name=weight_name,
        )
        return display.plot(ax=ax)

    def plot(self, *, ax: Axes | None = None) -> Self:
        """Draw.

        Parameters
        ----------
        ax : matplotlib axes, optional
            By default those of a new figure.

        Returns
        -------
        FusionWeightDisplay

        Raises
        ------
        ImportError
            If matplotlib is missing.
        ValueError
            If a value is not positive, or errors or names do not fit. Nothing is drawn
            then.
        """
        values = _check_values(self.values)
        fused = _mean_errors(self.errors, len(values), "errors")
        views = [
            _mean_errors(errors, len(values), f"the errors of view {v}")
            for v, errors in enumerate(self.view_errors)
        ]
        default = [f"view {v}" for v in range(len(views))]
        names = check_names(self.view_names, len(views), "views", default)
        self.figure_, self.ax_ = figure_and_ax(ax, (5, 3.9))
        self.view_lines_ = [
            self._line(values, errors, position, name, linewidth=1.2, linestyle="--")
            for position, (errors, name) in enumerate(
                zip(views, names, strict=True), start=1
            )
        ]
        self.line_ = self._line(values, fused, 0, "fused", linewidth=2)
        self.ax_.set(
            xscale="log", xlabel=self.weight_name, ylabel="misclassified tracks (%)"
        )
        # Room for the markers of errors of zero.
        self.ax_.set_ylim(bottom=-0.03 * self.ax_.get_ylim()[1])
        self.legend_ = legend_below(self.ax_, 2)
        return self

    def _line(self, values, errors, position, name, **style):
        order = np.argsort(values)
        (line,) = self.ax_.plot(
            values[order],
            errors[order],
            color=series_colour(position),
            marker=MARKERS[position % len(MARKERS)],
            markersize=4,
            label=name,
            **style,
        )
        return line


def _weight_of(fusion):
    """The parameter that is a fusion's weight, and how it is written."""
    if fusion not in WEIGHTS:
        raise ValueError(
            f"fusion must be one of {list(WEIGHTS)}, which have a weight; got "
            f"{fusion!r}"
        )
    return WEIGHTS[fusion]


def _check_sequences(X, y):
    """Affinities and labels of each sequence."""
    if not len(X) or len(X) != len(y):
        raise ValueError(f"got {len(X)} stacked affinities and {len(y)} label arrays")
    return [
        (x, check_label_each(labels, len(x))) for x, labels in zip(X, y, strict=True)
    ]


def _errors_by_weight(clusterer, parameter, weights, sequences):
    """Errors (n_values, n_sequences, 1 + n_views) of the fused result and each view."""

    def errors_of(value, affinities, labels):
        params = {parameter: value, "n_clusters": count_motions(labels)}
        weighted = clone(clusterer).set_params(**params)
        return _fused_and_view_errors(weighted, affinities, labels)

    return np.array(
        [[errors_of(value, *pair) for pair in sequences] for value in weights]
    )


@single_threaded
def _fused_and_view_errors(clusterer, affinities, y):
    """The error of the fused result, then that of each view's own embedding."""
    clusterer.fit(affinities)
    connected = clusterer.labels_ >= 0
    errors = [misclassification_error(y, clusterer.labels_)]
    for embedding in clusterer.view_embeddings_[:, connected]:
        labels = np.full(len(y), -1)
        labels[connected] = kmeans(
            cluster_features([embedding]),
            clusterer.n_clusters,
            clusterer.n_init,
            check_random_state(clusterer.random_state),
        )[0]
        errors.append(misclassification_error(y, canonical_labels(labels)))
    return errors


def _check_values(values):
    values = np.asarray(values, dtype=float)
    fit = (values > 0) & np.isfinite(values)
    if values.ndim != 1 or not values.size or not fit.all():
        raise ValueError(
            f"values must be positive and finite, for a log axis; got {values}"
        )
    return values


def _mean_errors(errors, n_values, name):
    """Percent, the mean over sequences, one per value."""
    errors = np.asarray(errors, dtype=float)
    if errors.ndim not in (1, 2) or len(errors) != n_values:
        raise ValueError(
            f"{name} must have shape ({n_values},) or ({n_values}, n_sequences); got "
            f"{errors.shape}"
        )
    if not ((errors >= 0) & (errors <= 1)).all():
        raise ValueError(
            f"{name} must be in 0 to 1; got {errors.min():g} to {errors.max():g}"
        )
    return 100 * errors.reshape(n_values, -1).mean(axis=1)


class GridDisplay:
    """The error of a grid search over two parameters, as a map of colours.

    Make it by :meth:`from_estimator` or :meth:`from_cv_results`.

    Parameters
    ----------
    errors : array-like of shape (n_y_values, n_x_values)
        In 0 to 1, NaN where there is none; they are drawn in percent.
    x_values, y_values : sequence
        Values of the parameters: numbers, strings, or tuples of names.
    x_name, y_name : str, default="x" and "y"

    Attributes
    ----------
    image_ : matplotlib AxesImage
    texts_ : ndarray of matplotlib Text, shape (n_y_values, n_x_values)
        The errors; the least is set in bold.
    colorbar_ : matplotlib Colorbar or None
    ax_ : matplotlib axes
    figure_ : matplotlib figure

    Examples
    --------
    >>> from skmotionseg.plotting import GridDisplay
    >>> display = GridDisplay(
    ...     [[0.1, 0.2], [0.3, 0.05]],
    ...     x_values=[0.01, 0.1],
    ...     y_values=[("affine", "homography"), ("homography", "fundamental")],
    ...     x_name="delta",
    ...     y_name="models",
    ... ).plot()
    >>> [label.get_text() for label in display.ax_.get_yticklabels()]
    ['A+H', 'H+F']
    >>> display.texts_[1, 1].get_text()
    '5.0'
    """

    def __init__(
        self,
        errors: npt.ArrayLike,
        x_values: Sequence[Any],
        y_values: Sequence[Any],
        *,
        x_name: str = "x",
        y_name: str = "y",
    ) -> None:
        self.errors: Any = errors
        self.x_values: Any = x_values
        self.y_values: Any = y_values
        self.x_name = x_name
        self.y_name = y_name

    @classmethod
    def from_estimator(
        cls,
        search: BaseEstimator,
        *,
        x: str | None = None,
        y: str | None = None,
        negated: bool = False,
        ax: Axes | None = None,
        colorbar: bool = True,
    ) -> Self:
        """Draw a fitted search.

        Parameters
        ----------
        search : fitted GridSearchCV
            Over whole grids; settings that a search left out have no colour. Of one
            with several metrics, the one that it was refitted by is drawn.
        x, y : str, optional
            Parameters of the axes, by their names in the grid. Needed if more than two
            were varied; the others are held at the best setting's.
        negated, ax, colorbar
            As for :meth:`from_cv_results`.

        Returns
        -------
        GridDisplay

        Raises
        ------
        NotFittedError, ValueError
            If it is not fitted, or as :meth:`from_cv_results` has it.
        """
        check_is_fitted(search, "cv_results_")
        results = search.cv_results_
        if isinstance(search.refit, str) and f"mean_test_{search.refit}" in results:
            score = results[f"mean_test_{search.refit}"]
            results = results | {"mean_test_score": score}
        return cls.from_cv_results(
            results, x=x, y=y, negated=negated, ax=ax, colorbar=colorbar
        )

    @classmethod
    def from_cv_results(
        cls,
        cv_results: dict[str, Any],
        *,
        x: str | None = None,
        y: str | None = None,
        negated: bool = False,
        ax: Axes | None = None,
        colorbar: bool = True,
    ) -> Self:
        """Draw the results of a search.

        Parameters
        ----------
        cv_results : dict
            The ``cv_results_`` of a search, with its ``mean_test_score``.
        x, y : str, optional
            As for :meth:`from_estimator`.
        negated : bool, default=False
            Whether a score is an error times -1, as with
            ``make_scorer(misclassification_error, greater_is_better=False)``. If not,
            one minus the score is the error, as with ``PerSequence.score``.
        ax : matplotlib axes, optional
        colorbar : bool, default=True

        Returns
        -------
        GridDisplay

        Raises
        ------
        ValueError
            If it is not said which two parameters to draw, a score is not what
            ``negated`` says, or there are several.
        """
        if "mean_test_score" not in cv_results:
            prefix = "mean_test_"
            metrics = [name for name in cv_results if name.startswith(prefix)]
            raise ValueError(
                "cv_results needs a mean_test_score; of several metrics, refit=NAME "
                f"says which is drawn; got {', '.join(metrics) or 'no scores'}"
            )
        scores = np.asarray(cv_results["mean_test_score"], dtype=float)
        errors = -scores if negated else 1 - scores
        _check_some_score(errors)
        if np.nanmin(errors) < 0 or np.nanmax(errors) > 1:
            raise ValueError(
                f"scores must be in {'-1 to 0' if negated else '0 to 1'} for "
                f"negated={negated}; got {np.nanmin(scores):g} to {np.nanmax(scores):g}"
            )
        x, y = _check_axes_of_grid(cv_results["params"], x, y)
        # Of a list of grids, some may not have both.
        drawn = [x in setting and y in setting for setting in cv_results["params"]]
        settings, errors = [*compress(cv_results["params"], drawn)], errors[drawn]
        _check_some_score(errors)
        best = settings[int(np.nanargmin(errors))]
        columns, rows = _values_of(settings, x), _values_of(settings, y)
        grid = np.full((len(rows), len(columns)), np.nan)
        for setting, error in zip(settings, errors, strict=True):
            if _others(setting, x, y) == _others(best, x, y):
                at = _position(rows, setting[y]), _position(columns, setting[x])
                grid[at] = error
        names = {"x_name": _short(x), "y_name": _short(y)}
        display = cls(grid, [*columns.values()], [*rows.values()], **names)
        return display.plot(ax=ax, colorbar=colorbar)

    def plot(self, *, ax: Axes | None = None, colorbar: bool = True) -> Self:
        """Draw.

        Parameters
        ----------
        ax : matplotlib axes, optional
            By default those of a new figure.
        colorbar : bool, default=True

        Returns
        -------
        GridDisplay

        Raises
        ------
        ImportError
            If matplotlib is missing.
        ValueError
            If there is not one error per pair of values. Nothing is drawn then.
        """
        errors = 100 * np.asarray(self.errors, dtype=float)
        shape = len(self.y_values), len(self.x_values)
        if errors.shape != shape or not errors.size:
            raise ValueError(
                f"{shape[0]} values of {self.y_name} and {shape[1]} of {self.x_name} "
                f"need errors of shape {shape}; got {errors.shape}"
            )
        size = 1.9 + 0.75 * shape[1], 1.1 + 0.5 * shape[0]
        self.figure_, self.ax_ = figure_and_ax(ax, size)
        self.image_ = self.ax_.imshow(errors, cmap=ERROR_MAP, aspect="auto")
        self.texts_ = np.empty(shape, dtype=object)
        finite = np.isfinite(errors)
        least = errors[finite].min() if finite.any() else None
        for at, error in np.ndenumerate(errors):
            row, column = at
            self.texts_[at] = self.ax_.text(
                column,
                row,
                f"{error:.1f}" if np.isfinite(error) else "-",
                ha="center",
                va="center",
                color=_readable_on(self.image_, error),
                fontweight="bold" if error == least else "normal",
            )
        self.ax_.set(xlabel=self.x_name, ylabel=self.y_name)
        names = [*map(_value_name, self.x_values)]
        aside = max(map(len, names)) > LONGEST_UPRIGHT
        turned: dict[str, Any] = {"rotation": 25, "ha": "right"} if aside else {}
        self.ax_.set_xticks(range(shape[1]), names, **turned)
        self.ax_.set_yticks(range(shape[0]), map(_value_name, self.y_values))
        self.colorbar_ = None
        if colorbar:
            self.colorbar_ = self.figure_.colorbar(self.image_, ax=self.ax_)
            self.colorbar_.set_label("error (%)")
            self.colorbar_.ax.locator_params(nbins=4)
        return self


def _check_some_score(errors):
    if not np.isfinite(errors).any():
        raise ValueError("no setting has a score; see what its fits raised")


def _check_axes_of_grid(settings, x, y):
    """The two parameters to draw."""
    names = list(dict.fromkeys(name for setting in settings for name in setting))
    for name in (x, y):
        if name is not None and name not in names:
            raise ValueError(f"x and y must be of the grid, {names}; got {name!r}")
    varied = [name for name in names if len(_values_of(settings, name)) > 1]
    left = [name for name in varied if name not in (x, y)]
    if (x is None) + (y is None) != len(left) and None in (x, y):
        raise ValueError(
            f"two parameters can be drawn; x and y must say which of {varied}"
        )
    x = left.pop(0) if x is None else x
    y = left.pop(0) if y is None else y
    if x == y:
        raise ValueError(f"x and y must differ; got {x!r} for both")
    return x, y


def _values_of(settings, name):
    """The values of a parameter, by what tells them apart, in the order of the grid."""
    return {_key(each[name]): each[name] for each in settings if name in each}


def _position(values, value):
    return [*values].index(_key(value))


def _others(setting, x, y):
    """What is held where two parameters are varied: of all others, names and values."""
    return {name: _key(value) for name, value in setting.items() if name not in (x, y)}


def _key(value):
    """What only equal values share, arrays as well; True is not 1, but 1.0 is."""
    if isinstance(value, Real) and not isinstance(value, bool):
        return value
    try:
        return joblib.hash(value)
    except (PicklingError, AttributeError, TypeError):  # as of a lambda
        return type(value), id(value)


def _short(name):
    """``lam`` for ``estimator__lam``."""
    return name.rpartition("__")[2]


def _value_name(value):
    """A number in few digits; models, ``A+H+F``; else as it is."""
    if isinstance(value, Real) and not isinstance(value, bool):
        return f"{value:g}"
    if isinstance(value, str) or not isinstance(value, list | tuple):
        return str(value)
    known = all(name in MOTION_MODELS for name in value)
    return "+".join(name[0].upper() if known else str(name) for name in value)


def _readable_on(image, error):
    """Black on light colours, white on dark ones."""
    if not np.isfinite(error):
        return "black"
    red, green, blue, _ = image.cmap(image.norm(error))
    return "black" if 0.3 * red + 0.59 * green + 0.11 * blue > 0.5 else "white"
