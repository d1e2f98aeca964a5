"""Names of the columns of tables of tracks."""

from __future__ import annotations

import re
from itertools import pairwise

TRACK_NAMES = ("track", "track_id", "id")
INDEX_NAMES = ("", "unnamed: 0", "index", *TRACK_NAMES)
LABEL_NAMES = ("label", "labels", "target")
# Names that end in the number of a frame: no dates, and nothing that may have a sign.
NUMBERED = re.compile(r"[a-z_. ]*?(\d+(?:\.\d+)?)")
# Names of coordinates as nearly all tables have them.
COORDINATE = re.compile(r"[xy](?![a-z]).*")


def initials(names):
    """The first letters of names, as one word."""
    return "".join(name[:1] for name in names)


def check_columns(names):
    """Refuse columns that are not x and y of each frame, as far as names tell it.

    Parameters
    ----------
    names : list of str
        In lower case.

    Raises
    ------
    ValueError
        If some are no coordinates, or are in another order than ours.
    """
    _check_coordinates(names)
    _check_order(names)


def _check_coordinates(names):
    """Refuse columns that are no coordinates, as far as their names tell it."""
    others = [name for name in names if not COORDINATE.fullmatch(name)]
    if len(others) == len(names):  # named in a way of their own
        others = [name for name in names if name in (*INDEX_NAMES[1:], *LABEL_NAMES)]
    if others:
        raise ValueError(
            "columns must be x and y of each frame, perhaps after track and label; got "
            f"{', '.join(map(repr, others[:4]))} among them"
        )
    if not names:
        raise ValueError("there must be columns of x and y of each frame; got none")


def _check_order(names):
    """Refuse columns in another order than ours, as far as their names tell it."""
    if len(names) % 2:
        return
    begin = initials(names)
    if set(begin) == {"x", "y"} and begin != "xy" * (len(names) // 2):
        raise ValueError(
            "columns must be x and y of the first frame, x and y of the second, and "
            f"so on; got {', '.join(names[:4])}, ..."
        )
    numbered = [found for name in names if (found := NUMBERED.fullmatch(name))]
    for one, other in pairwise(numbered if len(numbered) == len(names) else ()):
        if float(one[1]) > float(other[1]):
            raise ValueError(
                "columns must be in the order of their frames, by the numbers in their "
                f"names; got {one[0]} before {other[0]}"
            )
