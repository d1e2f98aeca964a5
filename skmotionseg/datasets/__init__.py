"""Sequences to segment: synthetic scenes and readers of benchmarks and track files."""

from ._benchmarks import (
    load_adelaide,
    load_arrigoni,
    load_hopkins12,
    load_hopkins155,
    load_kt3dmoseg,
    load_mtpv62,
)
from ._files import load_tracks
from ._regions import load_complex_background, load_fbms59
from ._scenes import make_scene, scene_families
from ._synthetic import make_rigid_motions
from ._videos import load_bms26, load_davis16

__all__ = [
    "load_adelaide",
    "load_arrigoni",
    "load_bms26",
    "load_complex_background",
    "load_davis16",
    "load_fbms59",
    "load_hopkins12",
    "load_hopkins155",
    "load_kt3dmoseg",
    "load_mtpv62",
    "load_tracks",
    "make_rigid_motions",
    "make_scene",
    "scene_families",
]
