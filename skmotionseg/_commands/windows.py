"""A window on the screen, where there is one."""

from __future__ import annotations

import os
import sys
from contextlib import suppress

from .._utils.optional import require

# Keys that end it: q and Esc.
ENDING = (ord("q"), 27)
# Milliseconds in which a window is drawn and keys are taken in.
PAUSE = 1


class Window:
    """A window that shows one picture after another, until a key or a click ends it.

    Parameters
    ----------
    title : str

    Attributes
    ----------
    reason : str
        Why there is none, or "".
    """

    def __init__(self, title):
        self._title = title
        self.reason = _no_display() or self._open()

    def show(self, picture):
        """Show a picture; False once somebody has ended it.

        Parameters
        ----------
        picture : ndarray of shape (height, width, 3), uint8
            Blue, green, red.

        Returns
        -------
        bool
        """
        if self.reason:
            return True
        cv2 = require("cv2", extra="video")
        cv2.imshow(self._title, picture)
        if cv2.waitKey(PAUSE) & 0xFF in ENDING:
            return False
        return cv2.getWindowProperty(self._title, cv2.WND_PROP_VISIBLE) >= 1

    def close(self):
        """Take it from the screen."""
        if not self.reason:
            cv2 = require("cv2", extra="video")
            with suppress(cv2.error):  # somebody may have closed it already
                cv2.destroyWindow(self._title)
            self.reason = "it was closed"

    def _open(self):
        cv2 = require("cv2", extra="video")
        try:
            cv2.namedWindow(self._title, cv2.WINDOW_NORMAL | cv2.WINDOW_KEEPRATIO)
        except cv2.error:
            return (
                "this OpenCV shows no pictures (opencv-python does, instead of "
                "opencv-python-headless)"
            )
        return ""


def _no_display():
    """Said before OpenCV is asked, which may end the process where there is none."""
    if not sys.platform.startswith("linux"):
        return ""
    known = any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY"))
    return "" if known else "there is no display"
