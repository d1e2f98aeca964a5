"""
From a video to a coloured video
================================

:func:`~skmotionseg.video.track_video` follows points through a video, or a folder of
frames, and :func:`~skmotionseg.video.render_segmentation` draws their motions on it.
Both need OpenCV, which the extra ``video`` installs. The video is rendered from two
photographs that come with scikit-learn: a camera pans over a temple and zooms in, two
discs cut out of a flower fly before it, and the light fades.
"""

import tempfile
from pathlib import Path

import cv2
import matplotlib.pyplot as plt
import numpy as np
from sklearn.datasets import load_sample_image

from skmotionseg import MotionSegmenter
from skmotionseg.preprocessing import select_long_tracks
from skmotionseg.video import render_segmentation, track_video

WIDTH, HEIGHT = 384, 256


def warp(picture, centre, angle, scale):
    """A picture, turned by some degrees and scaled, about a point of a frame."""
    middle = (picture.shape[1] / 2, picture.shape[0] / 2)
    move = cv2.getRotationMatrix2D(middle, angle, scale)
    move[:, 2] += np.subtract(centre, middle)
    return cv2.warpAffine(picture, move, (WIDTH, HEIGHT), flags=cv2.INTER_LINEAR)


def paste(frame, picture, centre, angle, scale):
    """Draw the disc in a picture over a frame."""
    disc = np.zeros(picture.shape[:2], np.uint8)
    cv2.circle(disc, (len(disc) // 2, len(disc) // 2), len(disc) // 2 - 1, 255, -1)
    inside = warp(disc, centre, angle, scale) > 127
    return np.where(inside[..., None], warp(picture, centre, angle, scale), frame)


temple, flower = load_sample_image("china.jpg"), load_sample_image("flower.jpg")
first, second = flower[60:170, 230:340], flower[190:280, 90:180]
frames = []
for f in range(14):
    frame = warp(temple, (200 - 2 * f, 130), 0.3 * f, 0.95 + 0.004 * f)
    frame = paste(frame, first, (90 + 6 * f, 80 + f), 3 * f, 1)
    frame = paste(frame, second, (310 - 5 * f, 180), -2 * f, 1 + 0.02 * f)
    frames.append(np.uint8(frame * (1 - 0.015 * f))[..., ::-1])  # BGR, as OpenCV

# %%
# The tracks have the form that the estimators take. Short ones say little: as
# ``skmotionseg segment`` does, keep those that are seen in an eighth of the frames, and
# in at least five. No track needs to be seen in more than ten.

video = track_video(frames)
shortest = np.clip(video.n_frames // 8, 5, 10)
tracks = video.tracks[select_long_tracks(video.tracks, shortest)]
print(
    f"{len(tracks)} tracks in {video.n_frames} frames of "
    f"{video.width} x {video.height} pixels"
)
segmenter = MotionSegmenter(random_state=0).fit(tracks)
explained = segmenter.labels_[segmenter.labels_ >= 0]
print(f"{segmenter.n_motions_} motions of {np.bincount(explained)} tracks")

# %%
# A file name that ends in ``.mp4`` gives a video, ``.png`` a sheet of up to nine
# frames.

with tempfile.TemporaryDirectory() as folder:
    sheet = Path(folder, "motions.png")
    render_segmentation(frames, tracks, segmenter.labels_, sheet)
    picture = plt.imread(sheet)

figure, ax = plt.subplots(figsize=(9, 6), layout="constrained")
ax.imshow(picture)
ax.set_axis_off()
plt.show()
