"""What a motion at a time leaves open: then the last frames are searched anew."""

from __future__ import annotations

import numpy as np

from .births import FEWEST_MEMBERS, nearest_in_picture

# Frames after a search until there is another, at least, and if more than so many found
# nothing; and frames in which what it found is settled.
FRAMES_PER_SEARCH, MOST_FRAMES, PATIENCE, SETTLED = 6, 24, 2, 2
# Frames that see a track which may have come in, and frames at the start of the window
# that do not. A search tells things apart by so many; in later ones they are followed
# as one for long.
FEWEST_SEEN, BEFORE = 6, 2


class Doubts:
    """Whether a search of the last frames is to say what moves apart.

    A joint motion of two things is often found as long as both are seen for a short
    time. A search asks what their own explain of each other, too, and which tracks are
    linked.

    Attributes
    ----------
    is_open : bool
    searched : int
        Frame of the last search.
    idle : int
        How many have found nothing in succession.
    """

    def __init__(self):
        self.is_open, self.searched, self.idle = False, -MOST_FRAMES, 0

    def is_due(self, frame):
        """Whether there is a search in a frame: ever more rarely if none finds any."""
        pause = FRAMES_PER_SEARCH * 2 ** max(self.idle - PATIENCE, 0)
        return self.is_open and frame - self.searched >= min(pause, MOST_FRAMES)

    def close(self, frame, found):
        """Note that a search has been made, and whether it has found a motion.

        So it has, as far as this matters, if it was due in any case.
        """
        if found or frame - self.searched > MOST_FRAMES:
            self.idle = 0
        self.idle += not found
        self.is_open, self.searched = False, frame

    def weighed(self, decision, motion, n_tracks, frame):
        """A verdict on a motion; None as long as a search may say otherwise.

        Parameters
        ----------
        decision : str or None
            As of :func:`.living.verdict`.
        motion : LivingMotion
        n_tracks : int
            Of its tracks, in the newest frame.
        frame : int

        Returns
        -------
        str or None
            What a joint motion explains is joined only if a search has left it so. A
            candidate is dropped; a search may find it again.
        """
        if decision == "joined" and frame - self.searched > SETTLED:
            self.is_open = True
            return None
        if decision == "dropped" and motion.is_part and motion.is_apart:
            self.is_open |= n_tracks >= FEWEST_MEMBERS
        return decision

    def ask_of_entered(self, buffer, motions):
        """Note whether what has come in may be taken for a motion that was in view.

        Motions of things that move are looked at: the static scene has tracks enough
        not to follow what is new.

        Parameters
        ----------
        buffer : TrackBuffer
        motions : list of LivingMotion
        """
        numbers = [motion.number for motion in motions if motion.number > 0]
        self.is_open |= any(_have_entered(buffer, number) for number in numbers)


def _have_entered(buffer, number):
    """Whether enough new tracks of a motion are in a place where it had none."""
    seen, now = buffer.seen, buffer.seen[:, -1]
    own = now & (buffer.labels == number) & (seen.sum(axis=1) >= FEWEST_SEEN)
    before = seen[:, :BEFORE].any(axis=1)
    new, known = own & ~before, own & before
    if new.sum() < FEWEST_MEMBERS or not known.any():
        return False
    names = np.cumsum(now) - 1
    near = nearest_in_picture(buffer.points[now, -1], names[new])
    return (~known[now][near]).all(axis=1).sum() >= FEWEST_MEMBERS
