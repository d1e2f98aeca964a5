"""Affinities, and what partitions make of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Self

import numpy as np
import numpy.typing as npt
from sklearn.base import BaseEstimator
from sklearn.pipeline import FeatureUnion, Pipeline

from .._core.graph.cuts import reconstruction_error
from .._core.labels import indicator
from .._utils.colours import AFFINITY_MAP, OUTLINE_COLOUR
from .._utils.optional import require
from .._utils.validation import check_label_each
from .._utils.words import counted
from ..pipelines import ModelUnion
from ._drawing import (
    check_affinities,
    check_names,
    count_motions,
    figure_of,
    last_step,
    read_stacked,
    refuse_windows,
    require_pyplot,
)

if TYPE_CHECKING:
    pass

# Inches per matrix, and matrices per row where there is one view.
PANEL, COLUMNS = 2.3, 4
# Share of the affinities between different tracks that the colours tell apart; those
# above are all of the brightest colour.
BRIGHTEST = 0.9


class AffinityDisplay:
    """The affinities of each view, sorted by motion, and their reconstructions.

    A partition reconstructs an affinity ``K`` by ``X X^T``, one within motions and
    zero between them, scaled to the norm of ``K``. Where the two look alike, the
    partition describes the data. High affinities are bright. Make it by
    :meth:`from_estimator` or :meth:`from_predictions`.

    Parameters
    ----------
    affinities : array-like of shape (n_views, n, n)
        Symmetric and not negative.
    partitions : array-like of int, shape (n_partitions, n)
        Labels to reconstruct the affinities from; -1 is in no motion.
    labels : array-like of int, shape (n,), optional
        The motions that rows are sorted by, before they are by the partitions, and that
        are outlined, such as the true ones. By default the first partition. -1 comes
        last, without outline.
    view_names : sequence of str, optional

    Attributes
    ----------
    images_ : ndarray of matplotlib AxesImage, shape (n_views, 1 + n_partitions)
        Of each view, the affinity and its reconstructions.
    outlines_ : list of matplotlib Rectangle
        Around the motions, in every matrix.
    order_ : ndarray of int, shape (n,)
        The rows, as they are sorted.
    axes_ : ndarray of matplotlib axes, shape (n_views, 1 + n_partitions)
    figure_ : matplotlib figure

    References
    ----------
    .. [1] X. Xu, L.-F. Cheong and Z. Li, "3D Rigid Motion Segmentation with Mixed and
       Unknown Number of Models", IEEE TPAMI 43(1), 2021, eq. 9, and panels a to h
       of the figure of its section on model selection.
       https://doi.org/10.1109/TPAMI.2019.2929146

    Examples
    --------
    >>> import numpy as np
    >>> from skmotionseg.plotting import AffinityDisplay
    >>> block = np.kron(np.eye(2), np.ones((3, 3)))
    >>> one, two = np.zeros(6, int), np.repeat([0, 1], 3)
    >>> display = AffinityDisplay.from_predictions([block], [one, two], labels=two)
    >>> [axes.get_title().replace("\\n", ", ") for axes in display.axes_[0][1:]]
    ['1 motion, reconstruction error 0.59', '2 motions, reconstruction error 0.00']
    """

    def __init__(
        self,
        affinities: npt.ArrayLike,
        partitions: Sequence[npt.ArrayLike],
        *,
        labels: npt.ArrayLike | None = None,
        view_names: Sequence[str] | None = None,
    ) -> None:
        self.affinities: Any = affinities
        self.partitions: Any = partitions
        self.labels: Any = labels
        self.view_names = view_names

    @classmethod
    def from_estimator(
        cls,
        estimator: BaseEstimator,
        X: Any,
        *,
        counts: npt.ArrayLike | None = None,
        labels: npt.ArrayLike | None = None,
        axes: Any = None,
        colorbar: bool = True,
    ) -> Self:
        """Draw the affinities that a fitted estimator clustered.

        Parameters
        ----------
        estimator : fitted estimator or Pipeline
            :class:`~skmotionseg.MotionSegmenter`, alone or last in a pipeline, or the
            pipeline of :func:`~skmotionseg.make_motion_pipeline`, which take tracks, or
            :class:`~skmotionseg.NCREModelSelector` or
            :class:`~skmotionseg.MultiModelSpectralClustering`, which take stacked
            affinities.
        X : array-like
            What it was fitted to. Of a segmenter with landmarks, their affinities are
            drawn.
        counts : sequence of int, optional
            Numbers of motions whose partitions reconstruct the affinities, of those
            that were tried. By default the one that was chosen.
        labels : array-like of int, shape (n,), optional
            A label for each row of ``X`` to sort by, such as the true one; by default
            those that were found.
        axes, colorbar
            As for :meth:`plot`.

        Returns
        -------
        AffinityDisplay

        Raises
        ------
        NotFittedError, ValueError
            If it is not fitted, or to something else, a count was not tried, or as
            :meth:`plot` has it.
        """
        require_pyplot()
        last = last_step(estimator)
        refuse_windows(last)
        if len(X) != len(last.labels_):
            raise ValueError(
                f"the estimator was fitted to {len(last.labels_)} rows; got {len(X)}"
            )
        partitions = _partitions(last, counts)
        labels = last.labels_ if labels is None else check_label_each(labels, len(X))
        affinities, names = _views_and_names(estimator, X)
        if hasattr(last, "landmarks_"):
            partitions, labels = partitions[:, last.landmarks_], labels[last.landmarks_]
        display = cls(affinities, partitions, labels=labels, view_names=names)
        return display.plot(axes=axes, colorbar=colorbar)

    @classmethod
    def from_predictions(
        cls,
        affinities: npt.ArrayLike,
        partitions: Sequence[npt.ArrayLike],
        *,
        labels: npt.ArrayLike | None = None,
        view_names: Sequence[str] | None = None,
        axes: Any = None,
        colorbar: bool = True,
    ) -> Self:
        """Draw affinities and partitions that are at hand.

        Parameters
        ----------
        affinities, partitions, labels, view_names
            As for :class:`AffinityDisplay`.
        axes, colorbar
            As for :meth:`plot`.

        Returns
        -------
        AffinityDisplay

        Raises
        ------
        ValueError
            As :meth:`plot` has it.
        """
        display = cls(affinities, partitions, labels=labels, view_names=view_names)
        return display.plot(axes=axes, colorbar=colorbar)

    def plot(self, *, axes: Any = None, colorbar: bool = True) -> Self:
        """Draw a row of matrices per view: the affinity, then its reconstructions.

        Parameters
        ----------
        axes : array-like of matplotlib axes, optional
            One per matrix, view after view. By default those of a new figure; a single
            view is broken into rows of four.
        colorbar : bool, default=True
            One per view.

        Returns
        -------
        AffinityDisplay

        Raises
        ------
        ImportError
            If matplotlib is missing.
        ValueError
            If the affinities are not square, symmetric, finite and not negative,
            partitions and labels do not fit them, or the number of axes is not that of
            the matrices. Nothing is drawn then.
        """
        views, partitions, labels, names = self._checked()
        shape = len(views), 1 + len(partitions)
        axes = _check_axes(axes, shape)
        self.figure_, self.axes_ = (
            _new_axes(shape) if axes is None else (figure_of(axes[0, 0]), axes)
        )
        self.order_ = _order(labels, partitions)
        self.images_ = np.empty(shape, dtype=object)
        self.outlines_: list[Any] = []
        for row, (view, name) in enumerate(zip(views, names, strict=True)):
            matrices = [view, *(reconstruction(view, p) for p in partitions)]
            titles = [name, *(_title(view, p) for p in partitions)]
            brightest = _brightest(matrices)
            for column, (matrix, title) in enumerate(
                zip(matrices, titles, strict=True)
            ):
                ax = self.axes_[row, column]
                self.images_[row, column] = ax.imshow(
                    matrix[np.ix_(self.order_, self.order_)],
                    cmap=AFFINITY_MAP,
                    vmin=0,
                    vmax=brightest,
                    interpolation="nearest",
                )
                ax.set_title(title, fontsize="small")
                ax.set(xticks=[], yticks=[])
                self._outline(ax, np.bincount(labels[labels >= 0]))
            if colorbar:
                bar = self.figure_.colorbar(
                    self.images_[row, 0],
                    ax=list(self.axes_[row]),
                    extend="max",
                    fraction=0.05,
                    aspect=25,
                    pad=0.02,
                )
                bar.set_label("affinity")
                bar.ax.locator_params(nbins=4)
        return self

    def _outline(self, ax, sizes):
        patches = require("matplotlib.patches", extra="plot")
        starts = np.cumsum(sizes) - sizes
        for start, size in zip(starts - 0.5, sizes, strict=True):
            square = patches.Rectangle(
                (start, start),
                size,
                size,
                fill=False,
                edgecolor=OUTLINE_COLOUR,
                linewidth=1.2,
                clip_on=False,
            )
            self.outlines_.append(ax.add_patch(square))

    def _checked(self):
        views = np.asarray(self.affinities, dtype=float)
        if views.ndim != 3 or views.shape[1] != views.shape[2] or not views.size:
            raise ValueError(
                f"affinities need shape (n_views, n, n); got {views.shape}"
            )
        check_affinities(views)
        n = views.shape[1]
        partitions = [_in_turn(p, n, "a partition") for p in self.partitions]
        if self.labels is None and not partitions:
            raise ValueError("there must be labels or a partition to sort by; got none")
        given = self.labels is not None
        labels = _in_turn(self.labels, n, "labels") if given else partitions[0]
        default = [f"view {v}" for v in range(len(views))]
        names = check_names(self.view_names, len(views), "views", default)
        return views, partitions, labels, names


def _in_turn(labels, n_rows, name):
    """Labels, checked, as ``0..M - 1`` in their order; -1 where they are negative."""
    labels = check_label_each(labels, n_rows, name)
    inside = labels >= 0
    found = np.full(n_rows, -1)
    found[inside] = np.unique(labels[inside], return_inverse=True)[1]
    return found


def _order(labels, partitions):
    """Rows by motion, and within it by the partitions; those of no motion last."""
    keys = [labels, *partitions]
    last = [np.where(key < 0, np.iinfo(int).max, key) for key in keys]
    return np.lexsort(last[::-1])


def reconstruction(
    affinity: npt.ArrayLike, labels: npt.ArrayLike
) -> npt.NDArray[np.floating]:
    """What a partition makes of an affinity: ``X X^T`` at the norm of ``K``.

    Parameters
    ----------
    affinity : ndarray of shape (n, n)
    labels : ndarray of int, shape (n,)

    Returns
    -------
    ndarray of shape (n, n)
        ``|K|_F X X^T / |X X^T|_F``: its squared distance from ``K``, over ``|K|_F^2``,
        is the reconstruction error (Xu, Cheong and Li 2021, eq. 9).
    """
    X = indicator(labels)
    joined = X @ X.T
    norm = np.linalg.norm(joined)
    return joined * (np.linalg.norm(affinity) / norm) if norm > 0 else joined


def _title(view, partition):
    error = reconstruction_error(view, partition)
    motions = counted(count_motions(partition), "motion")
    return f"{motions}\nreconstruction error {abs(error):.2f}"


def _brightest(matrices):
    """The affinity drawn brightest: nearly the largest, and all reconstructions'."""
    affinity, *reconstructed = matrices
    positive = affinity[(affinity > 0) & ~np.eye(len(affinity), dtype=bool)]
    largest = np.quantile(positive, BRIGHTEST) if positive.size else 1.0
    return max(largest, *(m.max() for m in reconstructed), 0)


def _check_axes(axes, shape):
    if axes is None:
        return None
    axes = np.array(axes, dtype=object)
    if axes.size != np.prod(shape):
        raise ValueError(
            f"{shape[0]} views and {shape[1] - 1} partitions need {np.prod(shape)} "
            f"axes; got {axes.size}"
        )
    return axes.reshape(shape)


def _new_axes(shape):
    """A figure and its axes; those of a single view are broken into rows."""
    plt = require_pyplot()
    n_rows, n_columns = shape
    if n_rows == 1 and n_columns > COLUMNS:
        n_rows, n_columns = -(-n_columns // COLUMNS), COLUMNS
    figure, axes = plt.subplots(
        n_rows,
        n_columns,
        figsize=(PANEL * n_columns + 0.9, (PANEL + 0.45) * n_rows),
        squeeze=False,
        layout="constrained",
    )
    used, unused = np.split(axes.ravel(), [np.prod(shape)])
    for ax in unused:
        ax.remove()
    return figure, used.reshape(shape)


def _partitions(estimator, counts):
    """Labels (n_partitions, n) for the counts, or those that were chosen."""
    if counts is None:
        return estimator.labels_[None]
    if not hasattr(estimator, "counts_"):
        raise ValueError(
            f"{type(estimator).__name__} tried one number of motions; counts must be "
            f"None, got {counts!r}"
        )
    tried = {int(count): i for i, count in enumerate(estimator.counts_)}
    unknown = [count for count in counts if count not in tried]
    if unknown:
        raise ValueError(f"counts must be of those tried, {list(tried)}; got {unknown}")
    return estimator.candidate_labels_[[tried[count] for count in counts]]


def _views_and_names(estimator, X):
    """Affinities (n_views, n, n) that were clustered, and the names of the views."""
    names = None
    if isinstance(estimator, Pipeline):
        *before, (_, last) = estimator.steps
        for _, step in before:
            if isinstance(step, FeatureUnion):
                names = _names_of_union(step)
        X = estimator[:-1].transform(X) if before else X
        estimator = last
    if hasattr(estimator, "views_"):
        affinities = estimator._fitted_affinities(X)
        return np.stack([*affinities.values()]), [*affinities]
    return read_stacked(X), names


def _names_of_union(union):
    """Names of the models that take part."""
    chosen = union._chosen() if isinstance(union, ModelUnion) else union
    return [name for name, view in chosen.transformer_list if view != "drop"]
