"""Rigid motions before a camera: paths, surfaces, projection and what fits a motion."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

NEAREST = 0.2  # depth below which nothing is seen
RIDGE = 1e-12  # keeps the inverse depth finite where there is no parallax
PATCH_SIZES = 0.12, 0.6  # image widths from one patch of texture to the next
N_WAVES = 8  # that make patches
N_REDRAWS = 40  # of points that are where no texture is
MOST_TILTED = np.radians(60)  # flat pieces, about each axis, from facing the camera
DEPTH_RANGE = 3.0  # of a flat piece: over the depth of its middle, or under
N_TEXTURE_PROBES = 256  # points that say how much of the view has texture


class Camera(NamedTuple):
    """Where a camera is in each frame, and what it does to points."""

    rotations: np.ndarray  # (n_frames, 3, 3), camera to world
    positions: np.ndarray  # (n_frames, 3)
    focal: float  # pixels
    size: np.ndarray  # (2,): width and height, pixels


class Motion(NamedTuple):
    """A rigid motion as the camera sees it: ``rotations @ point + translations``."""

    rotations: np.ndarray  # (n_frames, 3, 3)
    translations: np.ndarray  # (n_frames, 3)


# points (n, 3) in the coordinates of the thing, drawn for the frames (n,) in which
# their tracks begin: surface(frames, rng)
Surface = Callable[[np.ndarray, np.random.RandomState], np.ndarray]


# ------------------------------------------------------------------------------- paths


def rotation_matrices(vectors):
    """Matrices (n, 3, 3) of rotation vectors (n, 3), radians."""
    return Rotation.from_rotvec(vectors).as_matrix()


def direction(rng):
    """A random unit vector (3,)."""
    vector = rng.standard_normal(3)
    return vector / np.linalg.norm(vector)


def smooth(n_frames, rng, n_columns=3, period=40.0):
    """Smooth random functions of time (n_frames, n_columns), of variance about 1."""
    frames = np.arange(n_frames)[:, None, None]
    periods = period * rng.uniform(0.5, 2.0, size=(1, n_columns, 3))
    phases = rng.uniform(0, 2 * np.pi, size=(1, n_columns, 3))
    waves = np.sin(2 * np.pi * frames / periods + phases)
    return np.sqrt(2 / 3) * waves.sum(axis=2)


def seen_from(camera, rotations, positions):
    """The motion of a thing with this path in the world, as the camera sees it."""
    to_camera = camera.rotations.transpose(0, 2, 1)
    offsets = (positions - camera.positions)[:, :, None]
    return Motion(to_camera @ rotations, (to_camera @ offsets)[:, :, 0])


def background_motion(camera):
    """The motion of what stands still in the world."""
    n_frames = len(camera.positions)
    return seen_from(camera, np.eye(3)[None], np.zeros((n_frames, 3)))


# ---------------------------------------------------------------------------- surfaces


def in_view(camera, depth_of):
    """Static points along rays through the image in the frames their tracks begin.

    Parameters
    ----------
    camera : Camera
    depth_of : callable
        Of rays (n, 2), in focal lengths, their frames (n,) and a generator; gives
        depths (n,).
    """

    def surface(frames, rng):
        rays = (rng.uniform(size=(len(frames), 2)) - 0.5) * camera.size / camera.focal
        depths = depth_of(rays, frames, rng)
        local = np.column_stack([rays, np.ones(len(rays))]) * depths[:, None]
        turned = np.einsum("nij,nj->ni", camera.rotations[frames], local)
        return turned + camera.positions[frames]

    return surface


def _before(camera, frame, points):
    """Points of the world in the axes of a camera in one frame."""
    return (points - camera.positions[frame]) @ camera.rotations[frame]


def in_patches(surface, share, camera, rng):
    """Static points of which only patches of the world have any.

    Parameters
    ----------
    surface : Surface
        Where there might be some.
    share : float
        Of what is seen in the middle of the scene that is in patches.
    camera : Camera
    rng : numpy.random.RandomState

    Returns
    -------
    Surface
    """
    middle = len(camera.positions) // 2
    probes = surface(np.full(N_TEXTURE_PROBES, middle), rng)
    width = (
        np.median(_before(camera, middle, probes)[:, 2]) * camera.size[0] / camera.focal
    )
    period = width * np.exp(rng.uniform(*np.log(PATCH_SIZES)))
    waves = 2 * np.pi / period * rng.standard_normal((3, N_WAVES)) / np.sqrt(3)
    phases = rng.uniform(0, 2 * np.pi, N_WAVES)

    def texture(points):
        return np.sin(points @ waves + phases).sum(axis=1)

    least = np.quantile(texture(probes), 1 - share)

    def patches(frames, rng):
        points = surface(frames, rng)
        for _ in range(N_REDRAWS):
            plain = np.flatnonzero(texture(points) < least)
            if len(plain) == 0:
                break
            points[plain] = surface(frames[plain], rng)
        return points

    return patches


def in_facets(surface, n_facets, camera, rng):
    """Static points on flat pieces: walls and boards rather than relief.

    Parameters
    ----------
    surface : Surface
        The middles of the pieces are some of its points.
    n_facets : int
        In the view in the middle of the scene.
    camera : Camera
    rng : numpy.random.RandomState

    Returns
    -------
    Surface
    """
    middle = len(camera.positions) // 2
    centres = _before(camera, middle, surface(np.full(n_facets, middle), rng))
    tilts = np.tan(MOST_TILTED * rng.uniform(-1, 1, size=(n_facets, 2)))
    normals = np.column_stack([tilts, np.ones(n_facets)])
    offsets = (normals * centres).sum(axis=1)
    tree = KDTree(centres[:, :2] / centres[:, 2:])

    def facets(frames, rng):
        points = _before(camera, middle, surface(frames, rng))
        rays = points / points[:, 2:]
        facet = tree.query(rays[:, :2])[1]
        towards = (normals[facet] * rays).sum(axis=1)
        depths = offsets[facet] / np.where(np.abs(towards) < 1e-6, 1e-6, towards)
        beside = depths / centres[facet, 2]  # a steep piece does not go on for ever
        hit = (points[:, 2] > 0) & (beside > 1 / DEPTH_RANGE) & (beside < DEPTH_RANGE)
        points = np.where(hit[:, None], rays * depths[:, None], points)
        return points @ camera.rotations[middle].T + camera.positions[middle]

    return facets


def box(sides, eye):
    """Points on faces of a box about the origin, as many as ``eye`` sees of each."""
    sides = np.asarray(sides, dtype=float)
    areas = np.abs(eye) * sides.prod() / sides

    def surface(frames, rng):
        n = len(frames)
        points = rng.uniform(-0.5, 0.5, size=(n, 3))
        axes = rng.choice(3, size=n, p=areas / areas.sum())
        # The face of the two that looks this way.
        points[np.arange(n), axes] = np.where(eye[axes] > 0, 0.5, -0.5)
        return points * sides

    return surface


def blob(radii, eye):
    """Points on and below the skin of an ellipsoid, of the half that faces ``eye``."""

    def surface(frames, rng):
        points = rng.standard_normal((len(frames), 3))
        points /= np.linalg.norm(points, axis=1, keepdims=True)
        points = points * rng.uniform(0.7, 1.0, size=(len(frames), 1)) * radii
        return np.where((points @ eye < 0)[:, None], -points, points)

    return surface


def turned_to(surface, eye, towards):
    """What faces ``eye`` faces ``towards`` instead, both (3,) of length 1.

    It is seen in a mirror between the two, which is as good: shapes are drawn anyway.
    """
    gap = eye - towards
    across = gap / max(np.linalg.norm(gap), 1e-12)

    def turned(frames, rng):
        points = surface(frames, rng)
        return points - 2 * (points @ across)[:, None] * across

    return turned


def sheet(width, height):
    """Points of a rectangle about the origin, in the plane of x and y."""

    def surface(frames, rng):
        points = rng.uniform(-0.5, 0.5, size=(len(frames), 3))
        return points * [width, height, 0.0]

    return surface


# -------------------------------------------------------------------------- projection


def project(points, motion, camera):
    """Pixels (n, n_frames, 2) and depths (n, n_frames) of points (n, 3) that move."""
    n_frames = len(motion.translations)
    flat = motion.rotations.reshape(3 * n_frames, 3)
    seen = points @ flat.T + motion.translations.reshape(-1)
    seen = seen.reshape(len(points), n_frames, 3)
    depths = seen[..., 2]
    pixels = camera.focal * seen[..., :2] / np.maximum(depths, NEAREST)[..., None]
    return pixels + camera.size / 2, depths


def misfits(points, seen, motions, camera, n_rounds=3):
    """How far tracks are from what each motion can explain with the best depth.

    A track is the image of some point under the motion: two numbers for its place in
    one frame and its inverse depth there, found by least squares, each equation
    weighted by the depth of the round before.

    Parameters
    ----------
    points : ndarray of shape (n_tracks, n_frames, 2)
        Pixels; any number where unseen.
    seen : ndarray of bool, shape (n_tracks, n_frames)
        In one frame at least.
    motions : sequence of Motion
    camera : Camera
    n_rounds : int

    Returns
    -------
    misfits : ndarray of shape (n_motions, n_tracks)
        Root of the mean squared distance over the frames seen, pixels.
    """
    seen = np.asarray(seen, dtype=float)
    rays = np.where(seen[..., None] > 0, points - camera.size / 2, 0) / camera.focal
    count = seen.sum(axis=1)
    # The frame in the middle of those in which the track is seen.
    reference = (seen.cumsum(axis=1) < (count[:, None] + 1) / 2).sum(axis=1)
    fitted = _squared_misfits(rays, seen, reference, _rescaled(motions), n_rounds)
    return camera.focal * np.sqrt(fitted / count)


def _rescaled(motions):
    """The same motions with coordinates that begin in the middle frame, of size 1."""
    rotations = np.array([motion.rotations for motion in motions])
    translations = np.array([motion.translations for motion in motions])
    middle = translations.shape[1] // 2
    rotations = rotations @ rotations[:, [middle]].transpose(0, 1, 3, 2)
    start = translations[:, [middle], :, None]
    offsets = translations - (rotations @ start)[..., 0]
    sizes = np.sqrt((offsets**2).mean(axis=(1, 2), keepdims=True))
    return Motion(rotations, offsets * (sizes > 1e-9) / np.maximum(sizes, 1e-9))


def _squared_misfits(rays, seen, reference, motions, n_rounds):
    n_tracks, n_frames = seen.shape
    cameras = np.concatenate(
        [motions.rotations, motions.translations[..., None]], axis=3
    )  # (n_motions, n_frames, 3, 4)
    first, second, third = np.moveaxis(cameras, 2, 0)
    # Sums over frames of outer products, as matrix products.
    square, with_x, with_y, rest = (
        each.reshape(-1, n_frames, 16)
        for each in (
            _outer(third, third),
            _outer(third, first) + _outer(first, third),
            _outer(third, second) + _outer(second, third),
            _outer(first, first) + _outer(second, second),
        )
    )
    basis, start = _point_basis(rays, reference, motions)
    x, y = rays[..., 0], rays[..., 1]
    all_cameras = cameras.reshape(len(cameras), -1, 4).transpose(0, 2, 1)
    depths = np.ones((len(cameras), n_tracks, n_frames))
    for _ in range(n_rounds):
        weights = seen / np.maximum(np.abs(depths), 1e-2) ** 2
        normal = (weights * (x**2 + y**2)) @ square + weights @ rest
        normal -= (weights * x) @ with_x + (weights * y) @ with_y
        normal = normal.reshape(-1, n_tracks, 4, 4)
        sided = basis.swapaxes(-1, -2) @ normal  # (n_motions, n_tracks, 3, 4)
        left = sided @ basis
        trace = np.trace(left, axis1=-2, axis2=-1)[..., None, None]
        left += (RIDGE * trace + 1e-300) * np.eye(3)
        solved = np.linalg.solve(left, -sided @ start[..., None])
        homogeneous = start + (basis @ solved)[..., 0]  # (n_motions, n_tracks, 4)
        images = homogeneous @ all_cameras
        images = images.reshape(-1, n_tracks, n_frames, 3)
        depths = images[..., 2]
    divisor = np.where(np.abs(depths) < 1e-2, 1e-2, depths)
    gaps_x, gaps_y = images[..., 0] / divisor - x, images[..., 1] / divisor - y
    return (seen * (gaps_x**2 + gaps_y**2)).sum(axis=2)


def _outer(a, b):
    return a[..., :, None] * b[..., None, :]


def _point_basis(rays, reference, motions):
    """Homogeneous points on the rays near that of the reference frame.

    Returns
    -------
    basis : ndarray of shape (n_motions, n_tracks, 4, 3)
        What one more unit of x, y and inverse depth in the reference frame changes.
    start : ndarray of shape (n_motions, n_tracks, 4)
        The point at infinity on the ray.
    """
    n_tracks = len(rays)
    back = motions.rotations[:, reference].swapaxes(-1, -2)
    basis = np.zeros((*back.shape[:2], 4, 3))
    basis[..., :3, :2] = back[..., :2]
    offsets = motions.translations[:, reference][..., None]
    basis[..., :3, 2] = -(back @ offsets)[..., 0]
    basis[..., 3, 2] = 1
    ray = np.column_stack([rays[np.arange(n_tracks), reference], np.ones(n_tracks)])
    start = np.zeros((*back.shape[:2], 4))
    start[..., :3] = (back @ ray[..., None])[..., 0]
    return basis, start
