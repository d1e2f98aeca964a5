"""Pictures of segmentations. Needs matplotlib: ``pip install "skmotionseg[plot]"``."""

from __future__ import annotations

import numpy as np

from ._core.tracks import unpack_tracks
from ._extras import require
from ._palette import motion_colour


def plot_motions(X, labels, *, frames=None, ax=None, title=None):
    """Draw tracks between two frames, coloured by motion.

    Parameters
    ----------
    X : array-like of shape (n_tracks, 2 * n_frames)
        Tracks in pixels; NaN where unseen.
    labels : array-like of int, shape (n_tracks,)
        Motion of each track; -1 is drawn as a grey cross.
    frames : (int, int), optional
        A line goes from the position in the first to a dot in the second. By default
        the two that most tracks share, of those a quarter of the clip apart.
    ax : matplotlib axes, optional
    title : str, optional

    Returns
    -------
    matplotlib axes

    Raises
    ------
    ImportError
        If matplotlib is missing.
    ValueError
        If there is not a label a track.

    Examples
    --------
    >>> from skmotionseg.datasets import make_rigid_motions
    >>> from skmotionseg.plotting import plot_motions
    >>> X, y = make_rigid_motions(n_tracks=70, n_frames=6, random_state=0)
    >>> ax = plot_motions(X, y)
    >>> ax.get_xlabel()
    'x (pixels)'
    """
    plt = require("matplotlib.pyplot", extra="plot")
    points, visibility = unpack_tracks(X)
    labels = np.asarray(labels)
    if labels.shape != (len(points),):
        raise ValueError(
            f"{len(points)} tracks need a label each; got shape {labels.shape}"
        )
    first, second = frames if frames is not None else _shared_frames(visibility)
    shared = visibility[:, first] & visibility[:, second]
    ax = plt.subplots(figsize=(6.4, 4))[1] if ax is None else ax
    for label in np.unique(labels):
        rows = shared & (labels == label)
        start, end = points[rows, first], points[rows, second]
        outlier = label < 0
        colour = motion_colour(label)
        ax.plot(
            *np.stack([start, end]).T[..., ::1].swapaxes(1, 2), color=colour, lw=0.8
        )
        name = "no motion" if outlier else f"motion {label}"
        ax.scatter(
            *end.T,
            s=14 if outlier else 7,
            color=colour,
            marker="x" if outlier else "o",
            linewidths=0.8 if outlier else 0,
            label=f"{name} ({int((labels == label).sum())})",
            zorder=3,
        )
    ax.set(xlabel="x (pixels)", ylabel="y (pixels)", aspect="equal", title=title or "")
    if not ax.yaxis_inverted():
        ax.invert_yaxis()
    ax.legend(
        loc="upper center",
        bbox_to_anchor=(0.5, -0.16),
        ncols=4,
        frameon=False,
        fontsize="small",
    )
    return ax


def _shared_frames(visibility):
    """The frames a quarter of the clip apart that see most tracks in both."""
    n_frames = visibility.shape[1]
    gap = max(1, n_frames // 4)
    both = (visibility[:, :-gap] & visibility[:, gap:]).sum(axis=0)
    first = int(both.argmax())
    return first, first + gap
