"""Pictures and videos for tests of what reads them."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter


def plaster(rng, shape):
    """A grey picture, uint8, with texture everywhere."""
    noise = gaussian_filter(rng.normal(size=shape), 1.5)
    return np.uint8(np.clip(128 + 320 * noise, 0, 255))


def write_video(path, frames, codec="mp4v", fps=12.5):
    """Write grey or BGR frames, and give the path back."""
    import cv2  # tests that need it are skipped where it is not

    height, width = frames[0].shape[:2]
    fourcc = cv2.VideoWriter_fourcc(*codec)
    writer = cv2.VideoWriter(str(path), fourcc, fps, (width, height))
    assert writer.isOpened()
    for frame in frames:
        grey = frame.ndim == 2
        writer.write(cv2.cvtColor(frame, cv2.COLOR_GRAY2BGR) if grey else frame)
    writer.release()
    return path
