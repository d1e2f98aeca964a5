"""Local search: partitions near another, and the way down to one of lower cost."""

from __future__ import annotations

import numpy as np

from ..labels import groups_of

# Changes that are made at most; two or three are usual.
MOST_CHANGES = 20


def refine(labels, cost, changes):
    """Change a partition as long as its cost falls.

    Parameters
    ----------
    labels : ndarray of int, shape (n,)
        ``0..M - 1``, none empty.
    cost : callable
        Takes labels to a number.
    changes : callable
        Takes labels to an iterable of other labels, also ``0..M' - 1`` without gaps.

    Returns
    -------
    ndarray of int, shape (n,)
        Whose cost is not above that of ``labels``.
    """
    least = cost(labels)
    for _ in range(MOST_CHANGES):
        for changed in changes(labels):
            changed_cost = cost(changed)
            if changed_cost < least:
                labels, least = changed, changed_cost
                break
        else:
            break
    return labels


def moved(labels, relative):
    """Partitions in which tracks go to the motion that explains them.

    Parameters
    ----------
    labels : ndarray of int, shape (n,)
    relative : ndarray of shape (M, n)
        Distances from the motions, in units of what each explains; NaN if unknown.

    Yields
    ------
    ndarray of int, shape (n,)
        With all tracks moved that their own motion does not explain and another does;
        with those of one motion only; none that leaves a motion empty.
    """
    relative = np.where(np.isnan(relative), np.inf, relative)
    nearest = relative.argmin(axis=0)
    leave = (labels >= 0) & (relative[labels, np.arange(len(labels))] > 1)
    leave &= relative.min(axis=0) <= 1
    for some in (leave, *(leave & (labels == m) for m in range(len(relative)))):
        changed = np.where(some, nearest, labels)
        if some.any() and len(np.unique(changed[changed >= 0])) == len(relative):
            yield changed


def merged(labels):
    """Partitions in which two groups are one.

    Parameters
    ----------
    labels : ndarray of int, shape (n,)

    Yields
    ------
    ndarray of int, shape (n,)
    """
    for i in range(labels.max() + 1):
        for j in range(i):
            joined = np.where(labels == i, j, labels)
            yield joined - (joined > i)


def split(labels, bisect):
    """Partitions in which a group is two.

    Parameters
    ----------
    labels : ndarray of int, shape (n,)
    bisect : callable
        Takes the positions of a group to booleans, or to None if it cannot be parted.

    Yields
    ------
    ndarray of int, shape (n,)
    """
    for group in groups_of(labels):
        part = bisect(group)
        if part is not None and part.any() and not part.all():
            changed = labels.copy()
            changed[group[part]] = labels.max() + 1
            yield changed
