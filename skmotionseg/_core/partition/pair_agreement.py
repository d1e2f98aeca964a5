"""Groups of tracks that pairs of images agree on.

Each pair of images is parted by itself, and says of each two tracks that it sees
whether they move together. No pair sees all tracks, a small motion is missed in one and
a large one parted in another, but most are right about most tracks (compare Arrigoni
and Pajdla [1]_). So tracks are merged for as long as more pairs say that they are one
motion than that they are not.

References
----------
.. [1] F. Arrigoni and T. Pajdla, "Robust motion segmentation from pairwise matches",
   ICCV 2019. https://doi.org/10.1109/ICCV.2019.00076
"""

from __future__ import annotations

import numpy as np

# Tracks that are merged, those that most pairs have a motion for.
MOST_MERGED = 600
# Tracks of the smallest group.
FEWEST_TRACKS = 5
# Votes that convince: of groups with fewer between them, little is known.
VOTES = 2.0
# Agreement of a group with itself, and of what was merged into another.
GONE = -2.0


def agreed_groups(n_tracks, parted, least=0.0):
    """Merge tracks for as long as pairs of images agree that they move together.

    Parameters
    ----------
    n_tracks : int
    parted : list of (tracks, labels)
        Of each pair of images, positions of the tracks that it sees, and their labels
        there; -1 for mismatches.
    least : float, default=0.0
        Agreement, from -1 to 1, above which groups are merged.

    Returns
    -------
    ndarray of int, shape (n_tracks,)
        The largest group first; -1 for tracks of no group of at least
        ``FEWEST_TRACKS``, among them all but ``MOST_MERGED``.
    """
    labels = np.full(n_tracks, -1)
    some = _told_most(n_tracks, parted)
    together, apart = _votes(n_tracks, parted, some)
    groups = _merged(together, apart, least)
    groups = [group for group in groups if len(group) >= FEWEST_TRACKS]
    for label, group in enumerate(sorted(groups, key=len, reverse=True)):
        labels[some[group]] = label
    return labels


def _told_most(n_tracks, parted):
    """Positions of the tracks that most pairs have a motion for."""
    n_told = np.zeros(n_tracks, dtype=int)
    for tracks, labels in parted:
        n_told[tracks[labels >= 0]] += 1
    order = np.argsort(-n_told, kind="stable")[:MOST_MERGED]
    return np.sort(order[n_told[order] > 0])


def _votes(n_tracks, parted, some):
    """Pairs (m, m) by which two of some tracks are one motion, and are not."""
    place = np.full(n_tracks, -1)
    place[some] = np.arange(len(some))
    together, apart = np.zeros((2, len(some), len(some)))
    for tracks, labels in parted:
        told = (labels >= 0) & (place[tracks] >= 0)
        rows, of_motion = place[tracks[told]], labels[told]
        same = of_motion[:, None] == of_motion
        together[np.ix_(rows, rows)] += same
        apart[np.ix_(rows, rows)] += ~same
    for each in (together, apart):
        np.fill_diagonal(each, 0)
    return together, apart


def _merged(together, apart, least):
    """Groups of positions, after those that agree most are merged, two at a time.

    Both matrices are changed.
    """
    groups = [[k] for k in range(len(together))]
    agreement = _agreement(together, apart)
    np.fill_diagonal(agreement, GONE)
    while len(groups) > 1:
        i, j = divmod(int(agreement.argmax()), len(groups))
        if not agreement[i, j] > least:
            break
        for votes in (together, apart):
            votes[i] += votes[j]
            votes[:, i] = votes[i]
            votes[i, i] = 0
        groups[i], groups[j] = groups[i] + groups[j], []
        row = _agreement(together[i], apart[i])
        row[agreement[i] == GONE] = GONE
        agreement[i] = agreement[:, i] = row
        agreement[j] = agreement[:, j] = GONE
    return [group for group in groups if group]


def _agreement(together, apart):
    """From -1 to 1; 0 where nothing is known."""
    votes = together + apart
    surely = 1 - np.exp(-votes / VOTES)
    return (together - apart) / np.maximum(votes, 1) * surely
