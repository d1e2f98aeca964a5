"""Motion segmentation of point tracks, as scikit-learn estimators."""

from ._core.geometry.motion_models import MotionModel
from ._core.geometry.tracks import pack_tracks, unpack_tracks
from ._segmenter.report import SegmentationReport
from ._version import __version__ as __version__
from .cluster import MultiModelSpectralClustering
from .export import save_motions, static_mask
from .kernels import ORKKernel
from .model_selection import (
    EigengapModelSelector,
    NCREModelSelector,
    SelfTuningModelSelector,
)
from .online import OnlineMotionSegmenter
from .pipelines import make_motion_pipeline
from .sampling import HypothesisSampler
from .segmentation import MotionSegmenter
from .sequences import PerSequence

__all__ = [
    "EigengapModelSelector",
    "HypothesisSampler",
    "MotionModel",
    "MotionSegmenter",
    "MultiModelSpectralClustering",
    "NCREModelSelector",
    "ORKKernel",
    "OnlineMotionSegmenter",
    "PerSequence",
    "SegmentationReport",
    "SelfTuningModelSelector",
    "make_motion_pipeline",
    "pack_tracks",
    "save_motions",
    "static_mask",
    "unpack_tracks",
]
