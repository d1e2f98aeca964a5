"""Things that come back after a while, known by how they look."""

from __future__ import annotations

from collections import deque
from typing import Any, NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter
from scipy.spatial import KDTree
from scipy.special import betaincc, betaln

from .._core.partition.reappearing import LEAST_TRACKS, hardly_together
from .._utils.optional import require
from ._checks import make_reporter
from ._frames import first_frames, open_frames
from ._pixels import at_scale, nearest_pixels

# Frames between those that are looked at; how many of these are compared of a thing
# before it goes, and of one that comes. Longer sides of pictures are shrunk.
EVERY, FRAMES_BEFORE, FRAMES_AFTER, MAX_SIDE = 5, 5, 6, 960
# A keypoint is of a thing if so many tracks around it are, the nearest within so many
# pixels; so many of a thing tell how it looks, and so many others are to be told from.
TRACKS_AROUND, REACH, LEAST_POINTS, LEAST_OTHERS = 3, 8.0, 20, 50
# Of a thing before it goes; and the ratio of distances below which a match is no chance
# (Lowe, "Distinctive Image Features from Scale-Invariant Keypoints", IJCV 2004).
MOST_POINTS, RATIO = 1500, 0.8
# Blur of the picture of which colours are taken, pixels; bins of lightness and of each
# of both colour axes, levels of one of these, and how far bins are blurred.
BLUR, LIGHTNESS_BINS, COLOUR_BINS, COLOUR_LEVELS = 1.5, 6, 16, 4
BINS_BLURRED = (0.5, 0.7, 0.7)
# Log odds that two things are one: the most that matches tell, in nats, their weight,
# that of the overlap of colours, and a constant. They are of things as they are found;
# true masks of things (``python -m benchmarks.looks``) would allow for more certainty.
# Those above SURE are one: of things that are not, none was.
MOST_MATCHES, MATCHES_WORTH, COLOURS_WORTH, PRIOR, SURE = 10.0, 0.27, 20.7, -16.9, 3.0


class Look(NamedTuple):
    """How a thing looks in some frames.

    Attributes
    ----------
    descriptors : ndarray of uint8, shape (n_points, 128)
        SIFT descriptors of keypoints.
    colours : ndarray of uint8, shape (n_places, 3)
        CIELAB colours at tracks.
    """

    descriptors: np.ndarray
    colours: np.ndarray


def known_again(source, tracked, things, size, progress=None):
    """Give things that were out of view the numbers that they had before.

    A thing that begins when another has gone may be that one. The keypoints of the one
    that has gone are matched to those of all that is seen then; and colours are
    compared.

    Parameters
    ----------
    source : path or iterable of arrays
        The video.
    tracked : callable
        Gives an iterator of (rows, points) of each frame, as for ``paint_masks``.
    things : ndarray of int, shape (n_tracks,)
        0 for the static scene, 1, 2, ... for things, -1 for none.
    size : tuple of (width, height)
        Of the frames that the tracks are of.
    progress : callable, optional
        Called after each frame with the number done and the number there will be.

    Returns
    -------
    ndarray of int, shape (n_tracks,)
    """
    counts, n_frames = _counts(tracked(), things)
    pairs = _that_may_be_one(counts)
    if not pairs:  # no frame is read
        return things
    report = make_reporter(progress, n_frames)
    frames = first_frames(open_frames(source), n_frames, report)
    found: dict[tuple[int, int], float] = {}
    witness = _Witness(pairs, counts)
    shown = zip(frames, tracked(), strict=True)
    for number, (frame, (rows, points)) in enumerate(shown):
        if number == 0 and frame.shape[1::-1] != tuple(size):
            raise ValueError(
                f"tracks are of frames of {size[0]} x {size[1]} pixels; those of the "
                f"video are {frame.shape[1]} x {frame.shape[0]}"
            )
        look, between = divmod(number, EVERY)
        if not between and witness.needed[look]:
            found |= witness.look(look, seen_in(frame, points, things[rows]))
    was = _joined(found, counts)
    return np.where(things > 0, was[things], things)


def _counts(tracked, things):
    """Tracks of each thing (n_things + 1, n_looked) in frames looked at; frames."""
    n_things = int(things.max(initial=0))
    counts, number = [], -1
    for number, (rows, _) in enumerate(tracked):
        if number % EVERY == 0:
            own = things[rows]
            counts.append(np.bincount(own[own > 0], minlength=n_things + 1))
    return np.array(counts, dtype=np.int32).reshape(-1, n_things + 1).T, number + 1


def _that_may_be_one(counts):
    """Of each thing that comes when others have gone, which those are."""
    there = counts >= LEAST_TRACKS
    begins = np.where(there.any(axis=1), there.argmax(axis=1), -1)
    known = np.flatnonzero(begins >= 0)
    pairs = {
        new: [
            old
            for old in known
            if begins[old] < begins[new] and hardly_together(counts[old], counts[new])
        ]
        for new in known
    }
    return {new: olds for new, olds in pairs.items() if olds}


def _joined(found, counts):
    """Which label each one was at first, the pairs that are likeliest joined first.

    Parameters
    ----------
    found : dict of (old, new) to float
        Log odds that they are one.
    counts : ndarray of shape (n_things + 1, n_looked)

    Returns
    -------
    ndarray of int, shape (n_things + 1,)
    """
    was, counts = np.arange(len(counts)), counts.copy()
    for old, new in sorted(found, key=lambda pair: (-found[pair], pair)):
        first, second = np.sort(was[[old, new]])
        if found[old, new] <= SURE or first == second:
            continue
        if hardly_together(counts[first], counts[second]):
            was[was == second] = first
            counts[first] += counts[second]
    return was


class _Witness:
    """Compares what comes with what has gone, frame by frame.

    Parameters
    ----------
    pairs : dict of int to list of int
        Things that come, and those that each may be.
    counts : ndarray of shape (n_things + 1, n_looked)

    Attributes
    ----------
    needed : ndarray of bool, shape (n_looked,)
        Which of the frames are compared.
    """

    def __init__(self, pairs, counts):
        self._pairs, self._there = pairs, counts >= LEAST_TRACKS
        self._begins = {new: int(self._there[new].argmax()) for new in pairs}
        asked = np.unique([old for olds in pairs.values() for old in olds])
        self._last: Any = {old: deque(maxlen=FRAMES_BEFORE) for old in asked}
        self._recent: Any = deque(maxlen=FRAMES_AFTER)
        self._open: Any = {}  # what comes, and the looks of those that it may be
        self.needed = np.zeros(counts.shape[1], dtype=bool)
        for new, begin in self._begins.items():
            self.needed[begin : self._end(begin)] = True
            for there in self._there[pairs[new], : begin + 1]:
                self.needed[np.flatnonzero(there)[-FRAMES_BEFORE:]] = True

    def _end(self, begin):
        """The frame before which a thing that begins is compared, not after."""
        return min(begin + FRAMES_AFTER, self._there.shape[1])

    def look(self, number, seen):
        """Log odds of the pairs that can be judged after what a needed frame shows."""
        self._recent.append(seen)
        for old, looks in self._last.items():
            if self._there[old, number]:
                looks.append(seen.of(old))
        found: dict[tuple[int, int], float] = {}
        for new, begin in self._begins.items():
            if begin == number:
                olds = self._pairs[new]
                self._open[new] = {old: together(self._last[old]) for old in olds}
            if self._end(begin) == number + 1:
                after = list(self._recent)[begin - number - 1 :]
                found |= self._judged(new, after)
        return found

    def _judged(self, new, after):
        own = together([seen.of(new) for seen in after])
        return {
            (old, new): log_odds(
                look, own, np.concatenate([seen.but(old, new) for seen in after])
            )
            for old, look in self._open.pop(new).items()
        }


class _Seen(NamedTuple):
    """What a frame shows: keypoints and the thing of each, colours and theirs."""

    descriptors: np.ndarray
    things: np.ndarray
    colours: np.ndarray
    coloured: np.ndarray

    def of(self, thing):
        """How a thing looks."""
        return Look(
            self.descriptors[self.things == thing],
            self.colours[self.coloured == thing],
        )

    def but(self, *these):
        """Descriptors of all else that is known."""
        others = (self.things >= 0) & ~np.isin(self.things, these)
        return self.descriptors[others]


def seen_in(frame, points, things):
    """What a frame shows.

    Parameters
    ----------
    frame : ndarray of uint8, shape (height, width, 3)
    points : ndarray of shape (n, 2)
        Of tracks.
    things : ndarray of int, shape (n,)

    Returns
    -------
    _Seen
    """
    cv2 = require("cv2", extra="video")
    scale = min(1.0, MAX_SIDE / max(frame.shape[:2]))
    if scale < 1:
        frame = cv2.resize(
            frame, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA
        )
    places = at_scale(points, scale)
    keypoints, descriptors = cv2.SIFT_create().detectAndCompute(
        cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY), None
    )
    owners = np.empty(0, dtype=int)
    if descriptors is None:
        descriptors = np.empty((0, 128))
    else:
        owners = _owners([point.pt for point in keypoints], places, things)
    soft = cv2.cvtColor(cv2.GaussianBlur(frame, (0, 0), BLUR), cv2.COLOR_BGR2LAB)
    colours = soft[nearest_pixels(places, soft.shape)]
    return _Seen(descriptors.astype(np.uint8), owners, colours, things)


def _owners(keypoints, places, things):
    """Thing of each keypoint, that of the tracks around it; -1 where they differ."""
    if len(places) < TRACKS_AROUND:
        return np.full(len(keypoints), -1)
    distance, near = KDTree(places).query(keypoints, TRACKS_AROUND)
    around = things[near]
    one = (around == around[:, :1]).all(axis=1) & (distance[:, 0] < REACH)
    return np.where(one, around[:, 0], -1)


def together(looks):
    """Looks of some frames as one."""
    if not len(looks):
        return Look(np.empty((0, 128), np.uint8), np.empty((0, 3), np.uint8))
    return Look(*map(np.concatenate, zip(*looks, strict=True)))


# --------------------------------------------------------------------------- evidence


def log_odds(before, after, others):
    """Log odds that what has gone, and what has come, are one thing.

    Parameters
    ----------
    before, after : Look
        Of the thing that has gone, and of that which has come.
    others : ndarray of uint8, shape (n_others, 128)
        Descriptors of all else that was seen after.

    Returns
    -------
    float
        -inf if there is too little of one to tell.
    """
    if too_little(before, after, others):
        return -np.inf
    alike = overlap(before.colours, after.colours)
    if weighed(MOST_MATCHES, alike) <= SURE:  # whatever matches
        return weighed(-MOST_MATCHES, alike)
    matches = match_evidence(before.descriptors, after.descriptors, others)
    return weighed(matches, alike)


def too_little(before, after, others):
    """Whether there are too few keypoints, as of :func:`log_odds`, to tell."""
    few = min(len(before.descriptors), len(after.descriptors)) < LEAST_POINTS
    return few or len(others) < LEAST_OTHERS


def weighed(matches, alike):
    """Log odds by the evidence of matches and the overlap of colours."""
    return COLOURS_WORTH * alike + PRIOR + MATCHES_WORTH * matches


def match_evidence(before, after, others):
    """Log likelihood ratio of matches, of one thing and of two, within MOST_MATCHES.

    Keypoints of what has gone that have a match are counted, of what has come and of
    the others. If what has come is something else, they are shared by the number of
    keypoints; if it is the same, any larger share is as likely as another.

    Parameters
    ----------
    before, after, others : ndarray of uint8, shape (n, 128)

    Returns
    -------
    float
    """
    if len(before) > MOST_POINTS:
        spread = np.linspace(0, len(before) - 1, MOST_POINTS)
        before = before[spread.astype(int)]
    before, after, others = map(_root_sift, (before, after, others))
    near, far = (
        np.sqrt(np.maximum(2 - 2 * (before @ them.T).max(axis=1), 1e-9))
        for them in (after, others)
    )
    own = int((near < RATIO * far).sum())
    strange = int((far < RATIO * near).sum())
    share = len(after) / (len(after) + len(others))
    ways = own + 1, strange + 1
    same = betaln(*ways) + np.log(max(betaincc(*ways, share), 1e-300))
    chance = own * np.log(share) + strange * np.log1p(-share)
    ratio = same - np.log1p(-share) - chance
    return float(np.clip(ratio, -MOST_MATCHES, MOST_MATCHES))


def _root_sift(descriptors):
    """Of length 1, compared by Hellinger's kernel (Arandjelovic, Zisserman 2012)."""
    values = descriptors.astype(np.float32)
    return np.sqrt(values / np.maximum(values.sum(axis=1, keepdims=True), 1))


def overlap(first, second):
    """Overlap of the distributions of colours: Bhattacharyya's, 0 to 1.

    Parameters
    ----------
    first, second : ndarray of uint8, shape (n, 3)
        CIELAB, as OpenCV has it.

    Returns
    -------
    float
    """
    return float(np.sqrt(_distribution(first) * _distribution(second)).sum())


def _distribution(colours):
    middle = COLOUR_BINS // 2
    lightness = colours[:, 0].astype(int) * LIGHTNESS_BINS // 256
    axes = (colours[:, 1:].astype(int) - 128) // COLOUR_LEVELS + middle
    counts = np.zeros((LIGHTNESS_BINS, COLOUR_BINS, COLOUR_BINS))
    np.add.at(counts, (lightness, *axes.clip(0, COLOUR_BINS - 1).T), 1)
    counts = gaussian_filter(counts, BINS_BLURRED)
    return counts / counts.sum()
