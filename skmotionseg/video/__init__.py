"""From video to tracks, and from labels of tracks back to pixels.

Needs OpenCV, which the extra ``video`` installs.
"""

from ._masks import dense_masks
from ._objects import find_objects
from ._prompts import prompt_points
from ._rendering import render_segmentation
from ._tracking import TrackedFrame, VideoTracks, follow_points, track_video
from ._viewer import write_viewer

__all__ = [
    "TrackedFrame",
    "VideoTracks",
    "dense_masks",
    "find_objects",
    "follow_points",
    "prompt_points",
    "render_segmentation",
    "track_video",
    "write_viewer",
]
