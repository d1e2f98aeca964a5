"""What happens inside of a fit: its searches among rigid motions, and their tracks."""

from __future__ import annotations

from contextlib import contextmanager
from unittest.mock import patch

import numpy as np

from skmotionseg._core.partition import rigid_partitions, search, two_view_partitions

# Families of scenes whose motions are not compared over windows of frames.
WITHOUT_WINDOWS = ("two_images", "photographs")


@contextmanager
def rigid_searches(instead=None):
    """Keep the rigid searches of fits that are made within the context.

    Parameters
    ----------
    instead : callable, optional
        Called instead of ``rigid_partitions``, with its arguments; the fit goes on as
        if nothing had been found.

    Yields
    ------
    list of (RigidSearch, object)
        One per search, and what was returned.
    """
    kept = []
    call = instead or search.rigid_partitions

    def watched(found, *arguments):
        result = call(found, *arguments)
        kept.append((found, result))
        return result if instead is None else None

    with patch.object(search, "rigid_partitions", watched):
        yield kept


@contextmanager
def compared_steps():
    """Keep the partitions that rigid searches compare with others into as many.

    Yields
    ------
    list of (RigidSearch, Step)
    """
    kept = []
    with_odds = rigid_partitions.with_odds

    def watched(one, step):
        found = yield from with_odds(one, step)
        kept.append((one, found))
        return found

    with patch.object(rigid_partitions, "with_odds", watched):
        yield kept


@contextmanager
def two_view_searches():
    """Keep the searches between two images of fits that are made within the context.

    Yields
    ------
    list of TwoViewSearch
        Of those that found something.
    """
    kept = []
    call = two_view_partitions.search_two_views

    def watched(*arguments, **named):
        found = call(*arguments, **named)
        if found is not None:
            kept.append(found)
        return found

    with patch.object(two_view_partitions, "search_two_views", watched):
        yield kept


def true_labels(found, X, target):
    """True labels of the tracks that a rigid search has.

    Parameters
    ----------
    found : RigidSearch
    X : ndarray of shape (n_tracks, 2 * n_frames)
    target : ndarray of int, shape (n_tracks,)

    Returns
    -------
    ndarray of int, shape (n,)
    """
    labels = {_seen(row): y for row, y in zip(X, target, strict=True)}
    return np.array([labels[_seen(track)] for track in found.windows.points])


def _seen(track):
    return track[np.isfinite(track)].tobytes()
