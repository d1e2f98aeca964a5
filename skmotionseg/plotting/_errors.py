"""Errors of methods, sequence by sequence."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from textwrap import shorten
from typing import TYPE_CHECKING, Any, Self

import numpy as np
import numpy.typing as npt
from sklearn.base import BaseEstimator, clone

from .._utils.colours import series_colour
from .._utils.seeds import seed_names
from ..metrics import misclassification_error
from ._drawing import check_names, figure_and_ax, legend_below, require_pyplot

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Inches a bar, and between the bars of two sequences.
BAR, GAP = 0.13, 0.1
# What each record says of itself, beside its errors.
RECORD_KEYS = {"dataset", "method", "sequence", "seed"}


class SequenceErrorDisplay:
    """The error of each method on each sequence: mean and spread over seeds.

    Make it by :meth:`from_records`, :meth:`from_estimator` or
    :meth:`from_predictions`.

    Parameters
    ----------
    errors : array-like of shape (n_methods, n_sequences, n_seeds)
        In 0 to 1; they are drawn in percent.
    method_names, sequence_names : sequence of str, optional

    Attributes
    ----------
    bars_ : list of matplotlib BarContainer
        Of each method, a bar per sequence: the mean over seeds, with a line of one
        standard deviation to either side if there are several.
    legend_ : matplotlib Legend
        The methods and their means over all sequences.
    ax_ : matplotlib axes
    figure_ : matplotlib figure

    Examples
    --------
    >>> from skmotionseg.plotting import SequenceErrorDisplay
    >>> errors = [[[0.1, 0.3], [0.0, 0.0]]]  # one method, two sequences, two seeds
    >>> display = SequenceErrorDisplay(errors, ["coreg"], ["car", "truck"]).plot()
    >>> [float(round(bar.get_width(), 6)) for bar in display.bars_[0]]
    [20.0, 0.0]
    >>> display.legend_.get_texts()[0].get_text()
    'coreg (mean 10.0 %)'
    """

    def __init__(
        self,
        errors: npt.ArrayLike,
        method_names: Sequence[str] | None = None,
        sequence_names: Sequence[str] | None = None,
    ) -> None:
        self.errors: Any = errors
        self.method_names = method_names
        self.sequence_names = sequence_names

    @classmethod
    def from_records(
        cls,
        records: Sequence[dict[str, Any]],
        *,
        dataset: str | None = None,
        methods: Sequence[str] | None = None,
        value: str = "error_known",
        ax: Axes | None = None,
    ) -> Self:
        """Draw what ``skmotionseg bench --json FILE`` wrote.

        Parameters
        ----------
        records : path or list of dict
            The file, or its records.
        dataset : str, optional
            Needed if there are several.
        methods : sequence of str, optional
            The methods to draw, in this order; by default all.
        value : str, default="error_known"
            The field to draw: "error_known", "error_unknown" or
            "error_unknown_from_2".
        ax : matplotlib axes, optional

        Returns
        -------
        SequenceErrorDisplay

        Raises
        ------
        OSError, ValueError
            If the file cannot be read, or there is not a record for each method,
            sequence and seed.
        """
        require_pyplot()
        if isinstance(records, str | os.PathLike):
            records = _read_records(Path(records))
        errors, methods, sequences = _table_of_records(records, dataset, methods, value)
        return cls(errors, methods, sequences).plot(ax=ax)

    @classmethod
    def from_estimator(
        cls,
        estimators: dict[str, BaseEstimator],
        X: Sequence[Any],
        y: Sequence[Any],
        *,
        seeds: Any = None,
        sequence_names: Sequence[str] | None = None,
        ax: Axes | None = None,
    ) -> Self:
        """Fit estimators to sequences, one by one, and draw their errors.

        Parameters
        ----------
        estimators : estimator or dict of str to estimator
            With ``fit_predict``; clones of it are fitted.
        X : list of array-like, each of shape (n_tracks, 2 * n_frames)
        y : list of array-like of int, each of shape (n_tracks,)
            True labels; tracks of label -1 are ignored.
        seeds : sequence of int, optional
            Values of ``random_state``, one after another; by default the estimator's.
        sequence_names : sequence of str, optional
        ax : matplotlib axes, optional

        Returns
        -------
        SequenceErrorDisplay

        Raises
        ------
        ValueError
            If there is not a label array per sequence, or no sequence.
        """
        require_pyplot()
        if isinstance(X, np.ndarray) and X.ndim < 3:
            raise ValueError(
                "X must be a list of tracks, an array for each sequence; got one array "
                f"of shape {X.shape}"
            )
        _check_lengths(X, y)
        check_names(sequence_names, len(X), "sequences", X)
        if not isinstance(estimators, Mapping):
            estimators = {type(estimators).__name__: estimators}
        errors = [
            [
                [
                    misclassification_error(labels, _segment(estimator, tracks, seed))
                    for seed in ([None] if seeds is None else seeds)
                ]
                for tracks, labels in zip(X, y, strict=True)
            ]
            for estimator in estimators.values()
        ]
        return cls(errors, list(estimators), sequence_names).plot(ax=ax)

    @classmethod
    def from_predictions(
        cls,
        y_true: Sequence[npt.ArrayLike],
        y_pred: dict[str, Any],
        *,
        sequence_names: Sequence[str] | None = None,
        ax: Axes | None = None,
    ) -> Self:
        """Draw the errors of labels that are at hand.

        Parameters
        ----------
        y_true : list of array-like of int, each of shape (n_tracks,)
            True labels of each sequence; tracks of label -1 are not judged.
        y_pred : list of array-like of int, or dict of str to such a list
            Labels of each sequence, or those of several methods.
        sequence_names : sequence of str, optional
        ax : matplotlib axes, optional

        Returns
        -------
        SequenceErrorDisplay

        Raises
        ------
        ValueError
            If they do not fit each other.
        """
        methods = y_pred if isinstance(y_pred, Mapping) else {"error": y_pred}
        for labels in methods.values():
            _check_lengths(labels, y_true)
        errors = [
            [
                [misclassification_error(*pair)]
                for pair in zip(y_true, found, strict=True)
            ]
            for found in methods.values()
        ]
        return cls(errors, list(methods), sequence_names).plot(ax=ax)

    def plot(self, *, ax: Axes | None = None) -> Self:
        """Draw a group of bars per sequence, the first on top.

        Parameters
        ----------
        ax : matplotlib axes, optional
            By default those of a new figure, which is as high as the bars need.

        Returns
        -------
        SequenceErrorDisplay

        Raises
        ------
        ImportError
            If matplotlib is missing.
        ValueError
            If errors are not as described, or the names do not fit. Nothing is drawn
            then.
        """
        errors = np.asarray(self.errors, dtype=float)
        if errors.ndim != 3 or not errors.size:
            raise ValueError(
                "errors need shape (n_methods, n_sequences, n_seeds); got "
                f"{errors.shape}"
            )
        if not ((errors >= 0) & (errors <= 1)).all():
            raise ValueError("errors must be in 0 to 1; they are drawn in percent")
        n_methods, n_sequences, _ = errors.shape
        methods = check_names(
            self.method_names,
            n_methods,
            "methods",
            [f"method {i}" for i in range(n_methods)],
        )
        sequences = check_names(
            self.sequence_names,
            n_sequences,
            "sequences",
            [f"sequence {i}" for i in range(n_sequences)],
        )
        group = n_methods * BAR + GAP
        self.figure_, self.ax_ = figure_and_ax(ax, (6.4, 1.3 + n_sequences * group))
        self.bars_ = [
            self._draw_bars(100 * values, name, i, i - (n_methods - 1) / 2, group)
            for i, (values, name) in enumerate(zip(errors, methods, strict=True))
        ]
        self.ax_.set(xlabel="misclassified tracks (%)", ylim=(n_sequences - 0.5, -0.5))
        self.ax_.set_yticks(np.arange(n_sequences), sequences, fontsize="small")
        self.ax_.tick_params(axis="y", length=0)
        self.ax_.grid(axis="x", color="0.9", zorder=0)
        self.ax_.set_axisbelow(True)
        # Where an error bar would reach below zero, there is nothing.
        self.ax_.set_xlim(left=0)
        self.legend_ = legend_below(self.ax_, min(2, n_methods))
        return self

    def _draw_bars(self, percent, name, position, offset, group):
        """One method's bars, (n_sequences, n_seeds), beside those of the others."""
        n_sequences, n_seeds = percent.shape
        return self.ax_.barh(
            np.arange(n_sequences) + offset * BAR / group,
            percent.mean(axis=1),
            height=BAR / group,
            xerr=percent.std(axis=1) if n_seeds > 1 else None,
            error_kw={"elinewidth": 0.9, "ecolor": "0.35"},
            color=series_colour(position),
            label=f"{name} (mean {percent.mean():.1f} %)",
        )


def _check_lengths(X, y):
    if not len(y) or len(X) != len(y):
        raise ValueError(
            f"each sequence needs true labels; got {len(X)} sequences and {len(y)} "
            "label arrays"
        )


def _segment(estimator, tracks, seed):
    estimator = clone(estimator)
    if seed is not None:
        names = seed_names(estimator)
        if "random_state" in names:  # those that it holds get theirs from it
            names = ["random_state"]
        estimator.set_params(**dict.fromkeys(names, seed))
    return estimator.fit_predict(tracks)


def _read_records(path):
    try:
        return json.loads(path.read_text())
    except ValueError as error:
        raise ValueError(
            f"{path} is not what skmotionseg bench --json writes: {error}"
        ) from error


def _table_of_records(records, dataset, methods, value):
    """Errors (n_methods, n_sequences, n_seeds), and the names of both."""
    if not records:
        raise ValueError("there are no records of errors to draw")
    for record in records:
        if not isinstance(record, Mapping) or not set(record) >= RECORD_KEYS:
            raise ValueError(
                f"a record is a dict with {', '.join(sorted(RECORD_KEYS))}; got "
                f"{shorten(repr(record), 100)}"
            )
    there = list(dict.fromkeys(record["dataset"] for record in records))
    if dataset is None and len(there) != 1:
        raise ValueError(f"dataset must be one of {there}; got None")
    dataset = there[0] if dataset is None else dataset
    records = [record for record in records if record["dataset"] == dataset]
    if not records:
        raise ValueError(f"dataset must be one of {there}; got {dataset!r}")
    table = {
        (r["method"], r["sequence"], r["seed"]): r[value] for r in records if value in r
    }
    if not table:
        raise ValueError(f"the records of {dataset} have no field {value!r}")
    all_methods, sequences, seeds = (
        list(dict.fromkeys(key[i] for key in table)) for i in range(3)
    )
    methods = all_methods if methods is None else list(methods)
    missing = [
        (method, sequence, seed)
        for method in methods
        for sequence in sequences
        for seed in seeds
        if (method, sequence, seed) not in table
    ]
    if missing:
        raise ValueError(
            "there must be a record for each method, sequence and seed; "
            f"{len(missing)} are missing, the first {missing[0]}"
        )
    sequences = sorted(sequences)
    errors = [[[table[m, s, r] for r in seeds] for s in sequences] for m in methods]
    return errors, methods, sequences
