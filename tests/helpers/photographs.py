"""Photographs of two things that moved between them, with mismatches."""

from __future__ import annotations

from skmotionseg.datasets import make_scene


def photographs(seed=4, **settings):
    """A simulated scene, as of ``make_scene``."""
    usual = {"n_tracks": 160, "n_frames": 4, "n_motions": 2, "outliers": 0.2}
    return make_scene("photographs", random_state=seed, **(usual | settings))
