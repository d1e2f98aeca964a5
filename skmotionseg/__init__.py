"""Motion segmentation of point tracks, as scikit-learn estimators."""

from ._core.tracks import pack_tracks, unpack_tracks
from ._report import SegmentationReport
from .cluster import MultiModelSpectralClustering
from .export import save_motions, static_mask
from .kernels import ORKKernel
from .model_selection import (
    EigengapModelSelector,
    NCREModelSelector,
    PerSequence,
    SelfTuningModelSelector,
)
from .sampling import HypothesisSampler
from .segmentation import MotionSegmenter, make_motion_pipeline

__version__ = "0.1.0"

__all__ = [
    "EigengapModelSelector",
    "HypothesisSampler",
    "MotionSegmenter",
    "MultiModelSpectralClustering",
    "NCREModelSelector",
    "ORKKernel",
    "PerSequence",
    "SegmentationReport",
    "SelfTuningModelSelector",
    "make_motion_pipeline",
    "pack_tracks",
    "save_motions",
    "static_mask",
    "unpack_tracks",
]
