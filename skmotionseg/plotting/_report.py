"""What a segmenter found, and why, in one picture."""

from __future__ import annotations

from typing import Any, Self

import numpy as np
import numpy.typing as npt
from sklearn.base import BaseEstimator

from .._segmenter.report import pixels
from ._counts import CountDisplay
from ._drawing import figure_of, last_step, legend_below, refuse_windows, require_pyplot
from ._tracks import MotionDisplay

# Inches: both parts side by side, the tracks the wider one.
FIGURE_SIZE = (12, 5)
WIDTHS = (3, 2)
# Points squared: colours in the legend, larger than those of the tracks.
LEGEND_SIZE = 36


class ReportDisplay:
    """The motions with the models that explain them, and what their number cost.

    On the left, tracks in one frame; beside the colour of each motion, the model that
    explains it and the median distance of its tracks from this model. On the right, the
    costs of the numbers of motions that were tried. Make it by :meth:`from_estimator`.

    Parameters
    ----------
    report : SegmentationReport
    X : array-like of shape (n_tracks, 2 * n_frames)
        Tracks in pixels; NaN where unseen.
    labels : array-like of int, shape (n_tracks,)
        Motion of each track, as in the report; -1 is no motion.
    frame, image, trail
        As for :class:`MotionDisplay`.

    Attributes
    ----------
    motions_ : MotionDisplay
    counts_ : CountDisplay
    axes_ : ndarray of matplotlib axes, shape (2,)
    figure_ : matplotlib figure

    See Also
    --------
    skmotionseg.MotionSegmenter.report : The same as a table.

    Examples
    --------
    >>> from skmotionseg import MotionSegmenter
    >>> from skmotionseg.datasets import make_rigid_motions
    >>> from skmotionseg.plotting import ReportDisplay
    >>> X, _ = make_rigid_motions(n_tracks=70, n_frames=6, random_state=0)
    >>> segmenter = MotionSegmenter(max_motions=4, random_state=0).fit(X)
    >>> display = ReportDisplay.from_estimator(segmenter, X)
    >>> display.counts_.chosen == segmenter.n_motions_
    True
    """

    def __init__(
        self,
        report: Any,
        X: npt.ArrayLike,
        labels: npt.ArrayLike,
        *,
        frame: int | None = None,
        image: npt.ArrayLike | None = None,
        trail: int = 5,
    ) -> None:
        self.report = report
        self.X: Any = X
        self.labels: Any = labels
        self.frame = frame
        self.image: Any = image
        self.trail = trail

    @classmethod
    def from_estimator(
        cls,
        segmenter: BaseEstimator,
        X: npt.ArrayLike,
        *,
        frame: int | None = None,
        image: npt.ArrayLike | None = None,
        trail: int = 5,
        axes: Any = None,
    ) -> Self:
        """Draw what a fitted segmenter found, and why.

        Parameters
        ----------
        segmenter : MotionSegmenter or Pipeline
            Fitted; alone or last in a pipeline that leaves tracks as they are.
        X : array-like of shape (n_tracks, 2 * n_frames)
            The tracks that were fitted.
        frame, image, trail
            As for :class:`MotionDisplay`.
        axes : pair of matplotlib axes, optional

        Returns
        -------
        ReportDisplay

        Raises
        ------
        NotFittedError, ValueError
            If it is not fitted, was fitted to another number of tracks, gives no
            report, or as :meth:`plot` has it.
        """
        require_pyplot()
        last = last_step(segmenter)
        refuse_windows(last)
        if not hasattr(last, "report"):
            raise ValueError(
                f"{type(last).__name__} gives no report; give a MotionSegmenter"
            )
        display = cls(
            last.report(X), X, last.labels_, frame=frame, image=image, trail=trail
        )
        return display.plot(axes=axes)

    def plot(self, *, axes: Any = None) -> Self:
        """Draw.

        Parameters
        ----------
        axes : pair of matplotlib axes, optional
            By default those of a new figure.

        Returns
        -------
        ReportDisplay

        Raises
        ------
        ImportError
            If matplotlib is missing.
        TypeError, ValueError
            If there are not two axes, or as :meth:`MotionDisplay.plot` has it.
        """
        plt = require_pyplot()
        axes = None if axes is None else np.array(axes, dtype=object).ravel()
        if axes is not None and len(axes) != 2:
            raise ValueError(f"a report needs 2 axes; got {len(axes)}")
        motions = MotionDisplay(
            self.X, self.labels, frame=self.frame, image=self.image, trail=self.trail
        )
        motions._read()  # before there is a figure
        made_here = axes is None
        if made_here:
            _, axes = plt.subplots(
                1, 2, figsize=FIGURE_SIZE, width_ratios=WIDTHS, layout="constrained"
            )
        self.axes_, self.figure_ = axes, figure_of(axes[0])
        self.motions_ = motions.plot(ax=axes[0])
        self._name_motions()
        self.counts_ = _count_display(self.report).plot(ax=axes[1])
        if made_here:
            # Axes of equal aspect next to others need a second layout; after the first,
            # the title is outside of the figure.
            self.figure_.draw_without_rendering()
        return self

    def _name_motions(self):
        """Say in the legend what explains each motion."""
        points = self.motions_.points_
        for motion in self.report.motions:
            if motion.label in points:
                points[motion.label].set_label(
                    f"motion {motion.label} ({motion.n_tracks}): {_explanation(motion)}"
                )
        legend = legend_below(self.motions_.ax_, min(2, len(points)))
        for handle in legend.legend_handles:
            handle.set_sizes([LEGEND_SIZE])
        self.motions_.legend_ = legend


def _explanation(motion):
    if motion.model is None:
        return "too few tracks"
    return f"{motion.model}, {pixels(motion.residual)}"


def _count_display(report):
    (chosen,) = (count.n_motions for count in report.counts if count.chosen)
    return CountDisplay(
        [count.n_motions for count in report.counts],
        [[*count.terms, count.total] for count in report.counts],
        chosen,
        weights=report.weights,
        term_names=report.term_names,
        passed_over=[count.gainless_pair is not None for count in report.counts],
    )
