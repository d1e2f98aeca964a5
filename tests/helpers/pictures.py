"""Pictures and videos for tests of what reads them."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter


def plaster(rng, shape):
    """A grey picture, uint8, with texture everywhere."""
    noise = gaussian_filter(rng.normal(size=shape), 1.5)
    return np.uint8(np.clip(128 + 320 * noise, 0, 255))


def film_of_a_thing(size, shape, places):
    """BGR frames of a wall, and of a thing before it.

    Parameters
    ----------
    size, shape : (int, int)
        Height and width of a frame, and of the thing.
    places : iterable of ((int, int), (int, int))
        Row and column, per frame, of the wall where the frame begins, 60 at most, and
        of the frame where the thing does.
    """
    rng = np.random.default_rng(0)
    wall, thing = plaster(rng, (size[0] + 60, size[1] + 60)), plaster(rng, shape)
    frames = []
    for (top, left), (y, x) in places:
        shown = wall[top : top + size[0], left : left + size[1]].copy()
        shown[y : y + shape[0], x : x + shape[1]] = thing
        frames.append(np.repeat(shown[..., None], 3, axis=2))
    return frames


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
