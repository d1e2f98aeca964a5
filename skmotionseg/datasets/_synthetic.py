"""Synthetic perspective scenes with known motions."""

from __future__ import annotations

from collections.abc import Sequence
from numbers import Integral, Real

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation
from sklearn.utils import check_random_state, shuffle

from .._core.geometry.tracks import pack_tracks

IMAGE_SIZE = np.array([1280.0, 720.0])  # pixels
FOCAL_LENGTH = 1000.0  # pixels: 65 degrees across
SHAPES = ("general", "planar")
CAMERAS = ("general", "rotation", "still")


def make_rigid_motions(
    n_tracks: int = 400,
    n_frames: int = 20,
    n_motions: int = 3,
    *,
    shapes: str | Sequence[str] = ("general", "planar", "general"),
    camera: str = "general",
    missing: float = 0.25,
    noise: float = 0.5,
    outliers: float = 0.0,
    random_state: int | np.random.RandomState | None = None,
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.intp]]:
    """Generate tracks of rigid objects seen by a moving perspective camera.

    The first motion is the static background, at five to forty metres; the others are
    objects of two to three metres, at six to fourteen metres, each with its own
    velocity and rotation. Each motion has half as many tracks as the one before.

    Parameters
    ----------
    n_tracks : int, default=400
        Including outliers.
    n_frames : int, default=20
    n_motions : int, default=3
        Background included.
    shapes : str or sequence of str, default=("general", "planar", "general")
        "general" (points in a volume) or "planar", for each motion in turn; repeated
        if there are more motions.
    camera : {"general", "rotation", "still"}, default="general"
        "general" turns and drives mostly forward.
    missing : float, default=0.25
        Share of missing entries, in [0, 0.9]. A track starts late or ends early but is
        seen in at least two frames, so at most ``1 - 2 / n_frames`` are missing. Points
        outside of the image are not hidden.
    noise : float, default=0.5
        Standard deviation of each coordinate, in pixels.
    outliers : float, default=0.0
        Share of tracks that move at random, in [0, 1).
    random_state : int, RandomState instance or None, default=None

    Returns
    -------
    X : ndarray of shape (n_tracks, 2 * n_frames)
        Pixels, in an image of 1280 x 720; NaN where unseen.
    y : ndarray of int, shape (n_tracks,)
        0 for the background, 1, 2, ... for the objects, -1 for outliers.

    Raises
    ------
    TypeError, ValueError
        If a number is none or out of range, or a name unknown.

    Examples
    --------
    >>> from skmotionseg.datasets import make_rigid_motions
    >>> X, y = make_rigid_motions(n_tracks=70, n_frames=10, random_state=0)
    >>> X.shape
    (70, 20)
    >>> [int((y == motion).sum()) for motion in range(3)]
    [40, 20, 10]
    """
    shapes = _as_tuple(shapes)
    _check_types(Integral, n_tracks=n_tracks, n_frames=n_frames, n_motions=n_motions)
    _check_types(Real, missing=missing, noise=noise, outliers=outliers)
    _check_scene(n_frames, n_motions, shapes, camera)
    _check_shares(missing, noise, outliers)
    rng = check_random_state(random_state)
    n_outliers = round(outliers * n_tracks)
    sizes = _group_sizes(n_tracks - n_outliers, n_motions)
    steps = np.arange(n_frames) - (n_frames - 1) / 2  # all is set up for mid-clip
    camera_path = _camera_path(steps, camera, rng)
    groups = []
    for motion, size in enumerate(sizes):
        shape = shapes[motion % len(shapes)]
        if motion == 0:
            world = np.repeat(_background(size, shape, rng)[:, None], n_frames, axis=1)
        else:
            world = _moving_object(size, shape, steps, rng)
        groups.append(_project(world, *camera_path))
    groups.append(_wandering(n_outliers, n_frames, rng))
    points = np.concatenate(groups)  # (n_tracks, n_frames, 2)
    points = points + noise * rng.standard_normal(points.shape)
    y = np.repeat([*range(n_motions), -1], [*sizes, n_outliers])
    visibility = _lifetimes(n_tracks, n_frames, missing, rng)
    return tuple(
        shuffle(
            pack_tracks(points, visibility, layout="tracks_first"), y, random_state=rng
        )
    )


def _as_tuple(shapes):
    """Of one shape or of several."""
    alone = isinstance(shapes, str) or not np.iterable(shapes)
    return (shapes,) if alone else tuple(shapes)


def _check_types(kind, **numbers):
    """Refuse what is no number of this kind."""
    expected = "a whole number" if kind is Integral else "a number"
    for name, value in numbers.items():
        if not isinstance(value, kind):
            raise TypeError(f"{name} must be {expected}; got {value!r}")


def _check_scene(n_frames, n_motions, shapes, camera):
    if n_frames < 2 or n_motions < 1:
        raise ValueError(
            "a scene needs at least 2 frames and 1 motion; got "
            f"n_frames={n_frames} and n_motions={n_motions}"
        )
    known = all(shape in SHAPES for shape in shapes)
    if not known or not shapes or camera not in CAMERAS:
        raise ValueError(
            f"shapes must be of {SHAPES} and camera of {CAMERAS}; got {shapes} and "
            f"{camera!r}"
        )


def _check_shares(missing, noise, outliers):
    if not 0 <= missing <= 0.9 or not 0 <= outliers < 1:
        raise ValueError(
            "missing must be in [0, 0.9] and outliers in [0, 1); got "
            f"{missing} and {outliers}"
        )
    if not 0 <= noise < np.inf:
        raise ValueError(f"noise must be 0 or more pixels; got {noise}")


def _group_sizes(n_tracks, n_motions):
    """Each motion half the size of the one before, none empty and none larger."""
    if n_tracks < n_motions:
        raise ValueError(
            f"{n_motions} motions need a track each; got n_tracks={n_tracks} beside "
            "the outliers"
        )
    shares = 0.5 ** np.arange(n_motions)
    sizes = np.floor(shares / shares.sum() * n_tracks).astype(int)
    sizes = np.maximum(sizes, 1)
    for _ in range(sizes.sum() - n_tracks):
        sizes[np.flatnonzero(sizes == sizes[0])[-1]] -= 1
    sizes[0] += n_tracks - sizes.sum()
    return sizes


def _direction(rng):
    direction = rng.standard_normal(3)
    return direction / np.linalg.norm(direction)


def _camera_path(steps, camera, rng):
    """Orientations and positions of the camera in each frame."""
    turn = _direction(rng) * np.radians(rng.uniform(0.2, 0.5))  # a frame
    drive = np.array([*rng.uniform(-0.06, 0.06, size=2), rng.uniform(0.1, 0.2)])
    if camera == "still":
        turn = 0 * turn
    if camera != "general":
        drive = 0 * drive
    return Rotation.from_rotvec(steps[:, None] * turn), steps[:, None] * drive


def _background(size, shape, rng):
    """Static points (size, 3): spread over the image, at depths of a street scene."""
    spread = (rng.uniform(size=(size, 2)) - 0.5) * IMAGE_SIZE / FOCAL_LENGTH
    if shape == "planar":  # a wall, seen at an angle
        slope = rng.uniform(0.3, 0.8) * rng.choice([-1, 1])
        depth = 12 / (1 - slope * spread[:, 0])
    else:
        depth = 1 / rng.uniform(1 / 40, 1 / 5, size=size)
    return np.column_stack([spread, np.ones(size)]) * depth[:, None]


def _moving_object(size, shape, steps, rng):
    """Points (size, n_frames, 3) of an object that flies and spins."""
    local = rng.uniform(-1, 1, size=(size, 3)) * rng.uniform(1, 1.5)
    if shape == "planar":
        local[:, 2] = 0
        local = Rotation.from_rotvec(_direction(rng) * np.radians(35)).apply(local)
    depth = rng.uniform(6, 14)
    offset = rng.uniform(-0.35, 0.35, size=2) * IMAGE_SIZE / FOCAL_LENGTH
    centre = np.array([*offset, 1.0]) * depth
    # 15 pixels per frame or more across the image, and some along the line of sight.
    speed = rng.uniform(0.015, 0.025) * depth
    angle = rng.uniform(0, 2 * np.pi)
    velocity = speed * np.array([np.cos(angle), np.sin(angle), rng.uniform(-1, 1)])
    spin = _direction(rng) * np.radians(rng.uniform(0.5, 1.5))
    turned = np.stack(
        [Rotation.from_rotvec(step * spin).apply(local) for step in steps], axis=1
    )
    return turned + centre + steps[:, None] * velocity


def _project(world, orientations, positions):
    """Pixels (n, n_frames, 2) of points (n, n_frames, 3)."""
    seen = world - positions
    seen = np.einsum("fji,nfj->nfi", orientations.as_matrix(), seen)
    depth = np.maximum(seen[..., 2:], 0.5)  # nothing flies through the camera
    return FOCAL_LENGTH * seen[..., :2] / depth + IMAGE_SIZE / 2


def _wandering(size, n_frames, rng):
    """Random walks with steps of about 10 pixels."""
    start = rng.uniform(size=(size, 1, 2)) * IMAGE_SIZE
    walk = 10 * rng.standard_normal((size, n_frames, 2))
    return start + walk.cumsum(axis=1)


def _lifetimes(n_tracks, n_frames, missing, rng):
    """Visibility (n_tracks, n_frames): one run of frames per track, of two at least."""
    longest = n_frames - 2
    # The mean of u ** power is 1 / (power + 1): the share lost of what can be lost.
    share = missing * n_frames / max(longest, 1)
    power = max(1 / max(share, 1e-9) - 1, 0)
    lost = longest * rng.uniform(size=n_tracks) ** power
    lost *= missing * n_frames * n_tracks / max(lost.sum(), 1e-9)
    lost = np.floor(lost + rng.uniform(size=n_tracks))  # right in the mean
    lost = np.clip(lost, 0, longest).astype(int)
    first = np.where(rng.uniform(size=n_tracks) < 0.5, lost, 0)
    frames = np.arange(n_frames)
    start, end = first[:, None], (first + n_frames - lost)[:, None]
    return (frames >= start) & (frames < end)
