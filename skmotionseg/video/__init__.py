"""From video to tracks, and from labels of tracks back to pixels.

Needs OpenCV: ``pip install "skmotionseg[video]"``.
"""

from ._masks import dense_masks
from ._rendering import render_segmentation
from ._tracking import VideoTracks, track_video

__all__ = ["VideoTracks", "dense_masks", "render_segmentation", "track_video"]
