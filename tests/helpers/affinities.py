"""Affinities that know the motions."""

from __future__ import annotations

import numpy as np


def linked(y, within=1.0, across=0.02):
    """An affinity that knows the motions; rubbish is linked to all alike."""
    affinity = np.where(y[:, None] == y, within, across)
    affinity[y < 0] = affinity[:, y < 0] = 0.2
    return affinity
