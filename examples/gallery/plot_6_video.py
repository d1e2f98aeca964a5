"""
From a video to masks of what moves
===================================

:func:`~skmotionseg.video.track_video` follows points through a video, or a folder of
frames, and :func:`~skmotionseg.video.render_segmentation` draws their motions on it.
:func:`~skmotionseg.video.find_objects` finds what moves before the static scene, and
:func:`~skmotionseg.video.dense_masks` gives every pixel of every frame its label. They
need OpenCV: ``pip install "skmotionseg[video]"``. The video here is made up: a
textured wall, seen by a camera that turns, and two textured squares before it.
"""

import tempfile
from pathlib import Path

import cv2
import matplotlib.pyplot as plt
import numpy as np
from scipy.ndimage import gaussian_filter

from skmotionseg import MotionSegmenter
from skmotionseg.video import (
    dense_masks,
    find_objects,
    render_segmentation,
    track_video,
)

rng = np.random.default_rng(0)


def texture(side):
    noise = gaussian_filter(rng.standard_normal((side, side)), 2.5)
    return np.uint8(np.clip(128 + 350 * noise, 0, 255))


def paste(frame, picture, centre, angle, scale):
    """Draw a picture, turned by some degrees and scaled, about a point of a frame."""
    middle = (len(picture) / 2, len(picture) / 2)
    move = cv2.getRotationMatrix2D(middle, angle, scale)
    move[:, 2] += np.subtract(centre, middle)
    size = frame.shape[::-1]
    mask = cv2.warpAffine(np.full_like(picture, 255), move, size)
    return np.where(mask > 127, cv2.warpAffine(picture, move, size), frame)


wall, first, second = texture(480), texture(70), texture(60)
frames = []
for f in range(14):
    frame = np.zeros((192, 288), np.uint8)
    frame = paste(frame, wall, (150 - f, 96), 0.3 * f, 1 + 0.004 * f)
    frame = paste(frame, first, (60 + 4 * f, 60 + f), 4 * f, 1)
    frame = paste(frame, second, (230 - 3 * f, 130), -2 * f, 1 + 0.02 * f)
    frames.append(frame)

# %%
# The tracks are what the estimators take.

video = track_video(frames)
print(
    f"{len(video.tracks)} tracks in {video.n_frames} frames of "
    f"{video.width} x {video.height} pixels"
)
segmenter = MotionSegmenter(random_state=0).fit(video.tracks)
explained = segmenter.labels_[segmenter.labels_ >= 0]
print(f"{segmenter.n_motions_} motions of {np.bincount(explained)} tracks")

# %%
# A name that ends in ``.mp4`` makes a video; ``.png`` makes a sheet of up to nine
# frames.


def draw_sheet(labels, **options):
    with tempfile.TemporaryDirectory() as folder:
        sheet = Path(folder, "motions.png")
        render_segmentation(frames, video.tracks, labels, sheet, **options)
        picture = plt.imread(sheet)
    _, ax = plt.subplots(figsize=(9, 6), layout="constrained")
    ax.imshow(picture)
    ax.set_axis_off()
    plt.show()


draw_sheet(segmenter.labels_)

# %%
# Which motion is the static scene, and what moves before it: 0 is the scene.

objects = find_objects(
    video.tracks, segmenter.labels_, width=video.width, height=video.height
)
print(f"the static scene is motion {segmenter.background_}")
print(f"{objects.max()} things of {np.bincount(objects[objects > 0])[1:]} tracks")

# %%
# Masks come one frame at a time. Drawn, they leave the image to be seen.

draw_sheet(objects, masks=dense_masks(frames, video.tracks, objects))
