"""What simulated scenes are made of: cameras, surfaces and things of each family."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ._scene_geometry import (
    Camera,
    Motion,
    Surface,
    blob,
    box,
    direction,
    in_view,
    rotation_matrices,
    seen_from,
    sheet,
    smooth,
    turned_to,
)


class Thing(NamedTuple):
    """A motion and what moves with it."""

    motion: Motion
    surface: Surface
    rotations: np.ndarray  # (n_frames, 3, 3): the path in the world
    positions: np.ndarray  # (n_frames, 3)
    radius: float


class Family(NamedTuple):
    """What is drawn for a scene: ranges are (low, high)."""

    build: Callable  # (settings, rng) -> camera, background surface or None, drawing
    n_tracks: tuple
    n_frames: tuple
    n_motions: tuple
    background: tuple | None = (0.4, 0.9)  # share of the tracks
    outliers: tuple = (0.0, 0.4)
    kinds: tuple = (0.35, 0.35, 0.3, 0.0)  # wander, jump, slide, mismatch
    noise: tuple = (0.04, 0.2)  # pixels, a frame after the beginning
    drift: tuple = (0.3, 1.0)  # share of the noise that adds up
    inertia: tuple = (0.0, 0.8)  # correlation of a step of the drift with the next
    spread: tuple = (0.3, 0.8)
    shared: tuple = (0.3, 0.9)  # share of the noise that neighbours have in common
    motion_noise: tuple = (0.0, 0.012)  # pixels, per pixel and frame of motion
    late: tuple = (0.1, 0.5)  # share of the tracks that begin after the first frame
    life: tuple | None = (8, 80)  # mean, in frames; None: as long as the scene
    whole: bool = False  # only tracks that are seen in all frames
    seen: tuple | None = None  # share of the frames a point is found in, unordered
    gaps: tuple = (0.0, 0.0)  # share of the tracks
    focal: tuple = (0.5, 1.4)  # image widths
    distortion: tuple = (-0.05, 0.01)  # by which the lens moves the image's corners
    texture: tuple = (0.08, 0.5)  # share of what stands still, or all in half of scenes
    bending: tuple = (0.1, 1.0)  # pixels per frame by which what moves is not rigid
    facets: tuple = (4, 40)  # flat pieces of what stands still; none in a quarter
    sizes: tuple = ((640, 480), (720, 576), (854, 480), (1280, 720))


# ---------------------------------------------------------------------- small helpers


def _log_uniform(rng, low, high):
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _camera(settings, steps, turns):
    """A camera that moves by ``steps`` (n_frames, 3), in its own axes, and turns.

    ``turns`` (n_frames, 3) are rotation vectors of the whole way since the start.
    """
    rotations = rotation_matrices(turns)
    steps = np.einsum("fij,fj->fi", rotations, steps)
    return Camera(rotations, steps.cumsum(axis=0), settings.focal, settings.image_size)


def _still_camera(settings):
    nowhere = np.zeros((settings.n_frames, 3))
    return _camera(settings, nowhere, nowhere)


def _hand_held_camera(settings, rng, depth=1.0, flow=None):
    """Sways and shakes; things at ``depth`` move by about ``flow`` widths per frame."""
    n_frames = settings.n_frames
    flow = _log_uniform(rng, 0.001, 0.008) if flow is None else flow
    unit = flow * settings.image_size[0] / settings.focal
    drift = direction(rng) * [1, 0.4, 0.7] * rng.uniform(0.3, 1)
    steps = unit * depth * (0.6 * smooth(n_frames, rng, period=30) + drift)
    turns = unit * 0.5 * smooth(n_frames, rng, period=25).cumsum(axis=0)
    turns += unit * 0.2 * rng.uniform() * rng.standard_normal((n_frames, 3))
    return _camera(settings, steps, turns)


def _orbiting_camera(settings, rng, depth, angle, astray):
    """Looks at a spot from directions that differ by about ``angle`` radians.

    ``astray`` is by how much it misses the spot, radians.
    """
    n_frames = settings.n_frames
    rotations = rotation_matrices(angle * rng.standard_normal((n_frames, 3)) * 0.7)
    back = rotations[:, :, 2] * depth * rng.uniform(0.9, 1.1, size=(n_frames, 1))
    positions = [0, 0, depth] - back
    positions = positions + 0.03 * depth * rng.standard_normal((n_frames, 3))
    aim = astray * rng.standard_normal((n_frames, 3)) * [0.5, 1.0, 0.0]
    rotations = rotations @ rotation_matrices(aim)
    return Camera(rotations, positions, settings.focal, settings.image_size)


def _clutter(near, far, rng):
    """Depths that vary smoothly over the image, with things before and behind."""
    waves = 3 * rng.standard_normal((2, 4))
    phases = rng.uniform(0, 2 * np.pi, size=4)
    roughness = rng.uniform(0.05, 0.4)

    def depth_of(rays, frames, rng):
        level = 0.5 + 0.25 * np.sin(rays @ waves + phases).sum(axis=1)
        level += roughness * rng.standard_normal(len(rays))
        return near * (far / near) ** np.clip(level, 0, 1)

    return depth_of


def _plane(camera, normal, distance):
    """Depths of the plane ``normal @ point = distance`` of the world."""

    def depth_of(rays, frames, rng):
        rays = np.column_stack([rays, np.ones(len(rays))])
        towards = np.einsum("nij,nj->ni", camera.rotations[frames], rays) @ normal
        ahead = distance - camera.positions[frames] @ normal
        depth = ahead / np.where(np.abs(towards) < 1e-6, 1e-6, towards)
        return np.where((depth > 0) & (depth < 30 * abs(distance)), depth, -1.0)

    return depth_of


def _road(rng, height=1.65):
    """Depths of a road with houses and what stands before them, metres."""
    left, right = rng.uniform(4, 15, size=2)
    far = rng.uniform(40, 90)
    clutter = rng.uniform(0.1, 0.4)

    def depth_of(rays, frames, rng):
        x, y = rays.T
        ground = height / np.maximum(y, 1e-3)
        wall = np.where(x < 0, left, right) / np.maximum(np.abs(x), 1e-3)
        wall = wall * rng.uniform(1, 1.3, size=len(x))
        depth = np.minimum(np.minimum(ground, wall), far)
        stands = rng.uniform(size=len(x)) < clutter
        return np.where(stands, depth * rng.uniform(0.4, 1, size=len(x)), depth)

    return depth_of


def _thing(
    settings,
    camera,
    rng,
    depth=(0.8, 1.6),
    extent=(0.05, 0.2),
    flow=(0.002, 0.012),
    spin=(0.0, 2.0),
    along=0.7,
    sway=False,
    shape=None,
):
    """An object somewhere in the image that goes its way.

    Parameters
    ----------
    depth : (low, high)
    extent : (low, high)
        Its radius, in image widths.
    flow : (low, high)
        Speed, in image widths per frame.
    spin : (low, high)
        Degrees per frame.
    along : float
        Largest speed along the line of sight, as a multiple of that across it.
    sway : bool
        To and fro before the camera, however long the scene is.
    """
    n_frames = settings.n_frames
    middle = n_frames // 2 if not sway else 0
    steps = np.arange(n_frames) - middle
    z = _log_uniform(rng, *depth)
    unit = z * settings.image_size[0] / settings.focal  # an image width over there
    radius = _log_uniform(rng, *extent) * unit
    corner = 0.38 * settings.image_size / settings.focal
    centre = np.array([*rng.uniform(-corner, corner), 1.0]) * z
    turn = direction(rng) * np.radians(_log_uniform(rng, max(spin[0], 0.02), spin[1]))
    if sway:
        reach = rng.uniform(0.05, 0.2) * unit * np.array([1, 0.6, along])
        rotations, positions = _to_and_fro(camera, centre, reach, rng)
    else:
        speed = min(_log_uniform(rng, *flow), 0.6 / n_frames) * unit
        heading = rng.uniform(0, 2 * np.pi)
        velocity = speed * np.array(
            [np.cos(heading), 0.6 * np.sin(heading), along * rng.uniform(-1, 1)]
        )
        local = centre + steps[:, None] * velocity
        wobble = smooth(n_frames, rng, period=max(n_frames, 20))
        local += speed * rng.uniform(0, 2) * (wobble - wobble[middle])
        positions = local @ camera.rotations[middle].T + camera.positions[middle]
        rotations = camera.rotations[middle] @ rotation_matrices(steps[:, None] * turn)
    eye = _eye(camera, rotations, positions)
    surface = _surface(rng, radius, eye, shape)
    return _as_thing(camera, rotations, positions, surface, radius)


def _to_and_fro(camera, centre, reach, rng):
    """A path about a point that goes along with the camera."""
    n_frames = len(camera.positions)
    local = centre + reach * smooth(n_frames, rng, period=60)
    turned = rotation_matrices(
        np.radians(25) * rng.uniform(0.2, 1) * smooth(n_frames, rng, period=60)
    )
    positions = np.einsum("fij,fj->fi", camera.rotations, local) + camera.positions
    return camera.rotations @ turned, positions


def _eye(camera, rotations, positions):
    """Where the camera is in the middle of the scene, as seen from a thing."""
    middle = len(positions) // 2
    eye = rotations[middle].T @ (camera.positions[middle] - positions[middle])
    return eye / np.linalg.norm(eye)


def _surface(rng, radius, eye, shape=None):
    """Of a thing, what can be seen from ``eye``."""
    shape = rng.choice(["box", "blob"]) if shape is None else shape
    if shape == "box":
        facing = direction(rng)
        sides = 2 * radius * rng.uniform(0.4, 1, size=3)
        return turned_to(box(sides, facing), facing, eye)
    if shape == "sheet":
        return _sheet(rng, radius)
    return blob(radius * rng.uniform(0.5, 1, size=3), eye)


def _sheet(rng, radius):
    return sheet(2 * radius * rng.uniform(0.6, 1), 2 * radius)


def _as_thing(camera, rotations, positions, surface, radius):
    motion = seen_from(camera, rotations, positions)
    return Thing(motion, surface, rotations, positions, radius)


# ------------------------------------------------------------------------ the families
# Each gives the camera, the surface of the background (None: there is none) and a
# function of the things that are there already which draws the next.


def _street(settings, rng):
    n_frames = settings.n_frames
    speed = 0.05 if rng.uniform() < 0.1 else _log_uniform(rng, 0.06, 0.8)  # m per frame
    pace = speed * (1 + 0.15 * smooth(n_frames, rng, 1))
    steps = pace * [[0.0, 0.0, 1.0]]
    steps[:, :2] += 0.005 * rng.standard_normal((n_frames, 2))
    yaw = np.radians(rng.normal(0, 0.6) + 0.3 * smooth(n_frames, rng, 1)).cumsum()
    turns = np.radians(rng.uniform(0, 0.12)) * rng.standard_normal((n_frames, 3))
    turns[:, 1] += yaw - yaw[n_frames // 2]
    camera = _camera(settings, steps, turns)

    def draw(placed):
        return _car(settings, camera, rng, speed)

    return camera, in_view(camera, _road(rng)), draw


def _car(settings, camera, rng, speed):
    n_frames, middle = settings.n_frames, settings.n_frames // 2
    walker = rng.uniform() < 0.2
    sides = np.array([0.7, 1.75, 0.6] if walker else [1.8, 1.5, 4.2])
    sides = sides * rng.uniform(0.85, 1.3, size=3)
    z = _log_uniform(rng, 6, 35)
    x = rng.uniform(-0.4, 0.4) * settings.image_size[0] / settings.focal * z
    local = np.array([np.clip(x, -12, 12), 1.65 - sides[1] / 2, z])
    yaw = camera.rotations[middle]
    kind = rng.choice(
        ["with", "against", "across", "turning"], p=[0.4, 0.25, 0.2, 0.15]
    )
    heading = {"with": 0.0, "against": np.pi, "across": np.pi / 2, "turning": 0.5}[kind]
    heading = rng.choice([-1, 1]) * heading + np.radians(rng.normal(0, 8))
    pace = rng.uniform(0.05, 0.2) if walker else rng.uniform(0.15, 1.4)
    if kind == "with" and not walker:
        pace = speed * rng.uniform(0.4, 1.4) + rng.uniform(0, 0.3)
    rate = np.radians(rng.normal(0, 3 if kind == "turning" else 0.4))
    headings = heading + rate * (np.arange(n_frames) - middle)
    paces = pace * (1 + 0.15 * smooth(n_frames, rng, 1)[:, 0])
    way = np.zeros((n_frames, 3))
    way[:, 0] = (paces * np.sin(headings)).cumsum()
    way[:, 2] = (paces * np.cos(headings)).cumsum()
    way[:, 1] = 0.01 * smooth(n_frames, rng, 1, period=12)[:, 0]  # springs
    local = local + way - way[middle]
    positions = local @ yaw.T + camera.positions[middle]
    up = np.array([[0.0, 1.0, 0.0]])
    rotations = yaw @ rotation_matrices(headings[:, None] * up)
    surface = box(sides, _eye(camera, rotations, positions))
    return _as_thing(camera, rotations, positions, surface, sides.max() / 2)


def _still(settings, rng):
    camera = _still_camera(settings)
    extent = (0.02, 0.12)

    def draw(placed):
        return _thing(settings, camera, rng, (0.5, 1.5), extent, (0.001, 0.015))

    return camera, in_view(camera, _clutter(0.6, rng.uniform(1.5, 8), rng)), draw


def _table(settings, rng):
    moves = rng.uniform() < 0.75
    flow = _log_uniform(rng, 0.003, 0.018)
    if moves:
        camera = _hand_held_camera(settings, rng, 1.0, flow)
    else:
        camera = _still_camera(settings)
    depth = rng.uniform(0.15, 0.6)

    def draw(placed):
        return _thing(
            settings,
            camera,
            rng,
            depth=(0.8, 1.1),
            extent=(0.08, 0.2),
            flow=(0.0015, 0.015),
            spin=(0.1, 3.0),
            along=0.4,
            shape="box",
        )

    return camera, in_view(camera, _clutter(1.0, 1.0 + depth, rng)), draw


def _hand_held(settings, rng):
    camera = _hand_held_camera(settings, rng, rng.uniform(1, 3))

    def draw(placed):
        return _thing(
            settings, camera, rng, (0.8, 3), (0.02, 0.1), (0.001, 0.01), (0, 1.0)
        )

    return camera, in_view(camera, _clutter(1.0, rng.uniform(3, 15), rng)), draw


def _planar(settings, rng):
    tilt = np.radians(rng.uniform(10, 55))
    turned = rotation_matrices(
        np.array([[0, 0, rng.uniform(0, 2 * np.pi)], [tilt, 0, 0]])
    )
    axes = turned[0] @ turned[1]  # of the plane: the last is its normal
    normal, distance = axes[:, 2], axes[2, 2]  # one away from the camera
    camera = _hand_held_camera(settings, rng, 1.0)
    n_frames = settings.n_frames
    steps = np.arange(n_frames) - n_frames // 2
    unit = settings.image_size[0] / settings.focal

    def draw(placed):
        radius = rng.uniform(0.06, 0.2) * unit
        rays = rng.uniform(-0.35, 0.35, size=2) * settings.image_size / settings.focal
        start = np.array([*rays, 1.0])
        start = start * distance / (start @ normal)
        speed = min(_log_uniform(rng, 0.002, 0.012), 0.5 / n_frames) * unit
        angle = rng.uniform(0, 2 * np.pi)
        velocity = speed * (np.cos(angle) * axes[:, 0] + np.sin(angle) * axes[:, 1])
        wobble = smooth(n_frames, rng, 2, period=max(n_frames, 20))
        wobble = speed * rng.uniform(0, 2) * wobble @ axes[:, :2].T
        positions = start + steps[:, None] * velocity + wobble
        rate = np.radians(rng.normal(0, 1.0))
        spin = rotation_matrices(steps[:, None] * np.array([[0, 0, rate]]))
        surface = _sheet(rng, radius)
        return _as_thing(camera, axes @ spin, positions, surface, radius)

    return camera, in_view(camera, _plane(camera, normal, distance)), draw


def _rotation(settings, rng):
    n_frames = settings.n_frames
    rate = np.radians(_log_uniform(rng, 0.05, 0.8))
    turns = rate * (direction(rng) + 0.5 * smooth(n_frames, rng)).cumsum(axis=0)
    turns -= turns[n_frames // 2]
    camera = _camera(settings, np.zeros((n_frames, 3)), turns)

    def draw(placed):
        return _thing(settings, camera, rng, (0.5, 2), (0.03, 0.15), (0.002, 0.012))

    return camera, in_view(camera, _clutter(1.0, 6.0, rng)), draw


def _articulated(settings, rng):
    camera = _hand_held_camera(settings, rng, 1.5)
    n_frames = settings.n_frames

    def draw(placed):
        if len(placed) % 2 == 1:  # after the background: a body, then its limb
            return _thing(
                settings, camera, rng, (0.8, 1.4), (0.07, 0.15), (0.001, 0.008), (0, 1)
            )
        body = placed[-1]
        side = direction(rng)
        length = body.radius * rng.uniform(0.7, 1.5)
        # A hinge has one axis, a joint three.
        if rng.uniform() < 0.5:
            swing = smooth(n_frames, rng, 1, period=30) * direction(rng)
        else:
            swing = smooth(n_frames, rng, 3, period=30)
        angles = np.radians(rng.uniform(8, 35)) * (swing - swing[n_frames // 2])
        rotations = body.rotations @ rotation_matrices(angles)
        joint = body.positions + body.rotations @ (0.9 * body.radius * side)
        limb = _surface(rng, length / 2, _eye(camera, rotations, joint))

        def surface(frames, rng):
            return limb(frames, rng) + side * length / 2

        return _as_thing(camera, rotations, joint, surface, length)

    return camera, in_view(camera, _clutter(1.0, 5.0, rng)), draw


def _crowd(settings, rng):
    camera = (
        _still_camera(settings)
        if rng.uniform() < 0.3
        else _hand_held_camera(settings, rng, 1.5)
    )

    def draw(placed):
        return _thing(
            settings, camera, rng, (0.7, 2.5), (0.05, 0.13), (0.002, 0.012), (0, 1.5)
        )

    return camera, in_view(camera, _clutter(1.0, 6.0, rng)), draw


def _moved_about(settings, rng, angle, shift, astray):
    """Things that somebody puts somewhere else between one picture and the next."""
    turn = np.radians(rng.uniform(2, angle))
    camera = _orbiting_camera(settings, rng, 1.0, turn, astray)
    n_frames = settings.n_frames

    def draw(placed):
        unit = settings.image_size[0] / settings.focal
        radius = rng.uniform(0.06, 0.16) * unit
        corner = 0.33 * settings.image_size / settings.focal
        start = np.array([*rng.uniform(-corner, corner), rng.uniform(0.85, 1.1)])
        moves = shift * unit * rng.uniform(0.2, 1) * rng.standard_normal((n_frames, 3))
        moves *= [1, 0.7, 0.7]
        turns = np.radians(rng.uniform(3, angle)) * rng.standard_normal((n_frames, 3))
        shape = rng.choice(["box", "blob", "sheet"])
        rotations, positions = rotation_matrices(turns), start + moves
        eye = _eye(camera, rotations, positions)
        surface = _surface(rng, radius, eye, shape)
        return _as_thing(camera, rotations, positions, surface, radius)

    return camera, draw


def _two_images(settings, rng):
    camera, draw = _moved_about(settings, rng, 30, 0.35, 0.15)
    surface = in_view(camera, _clutter(1.0, 1.6, rng))
    return camera, surface if rng.uniform() < 0.4 else None, draw


def _photographs(settings, rng):
    camera, draw = _moved_about(settings, rng, 25, 0.12, 0.04)
    return camera, in_view(camera, _clutter(0.9, 1.6, rng)), draw


def _long(settings, rng):
    camera = _hand_held_camera(settings, rng, 1.5)

    def draw(placed):
        return _thing(settings, camera, rng, (0.8, 2), (0.06, 0.16), sway=True)

    return camera, in_view(camera, _clutter(1.0, 6.0, rng)), draw


def _one_motion(settings, rng):
    build = [_street, _still, _table, _hand_held, _planar, _rotation][rng.randint(6)]
    return build(settings, rng)


def _dense(settings, rng):
    if rng.uniform() < 0.4:
        camera, surface, _ = _street(settings, rng)
        depth = (8.0, 20.0)
    else:
        camera, surface, _ = _hand_held(settings, rng)
        depth = (0.8, 3.0)

    def draw(placed):
        return _thing(
            settings, camera, rng, depth, (0.03, 0.08), (0.001, 0.012), (0, 1.0)
        )

    return camera, surface, draw


_KITTI = ((1242, 375), (1226, 370), (1280, 720))

FAMILIES = {
    "street": Family(
        _street,
        (100, 3000),
        (8, 30),
        (2, 6),
        noise=(0.04, 0.2),
        drift=(0.6, 1.0),
        inertia=(0.5, 0.85),
        spread=(0.4, 0.8),
        late=(0.15, 0.5),
        life=(15, 100),
        focal=(0.5, 1.2),
        sizes=_KITTI,
    ),
    "still_camera": Family(_still, (60, 2000), (8, 60), (2, 5), (0.3, 0.9)),
    "table": Family(
        _table,
        (50, 600),
        (12, 60),
        (2, 4),
        (0.3, 0.7),
        outliers=(0.0, 0.1),
        noise=(0.02, 0.12),
        drift=(0.4, 1.0),
        inertia=(0.2, 0.8),
        spread=(0.3, 0.7),
        whole=True,
        focal=(1.0, 2.0),
        sizes=((640, 480),),
    ),
    "hand_held": Family(
        _hand_held,
        (80, 2000),
        (10, 80),
        (2, 5),
        noise=(0.08, 0.5),
        drift=(0.2, 0.8),
        inertia=(0.0, 0.8),
        spread=(0.2, 0.6),
        life=(20, 200),
        gaps=(0.0, 0.15),
    ),
    "planar": Family(_planar, (60, 1000), (8, 40), (2, 5), (0.3, 0.8), facets=(0, 0)),
    "rotation": Family(_rotation, (60, 1500), (8, 40), (2, 5)),
    "articulated": Family(_articulated, (80, 1500), (12, 50), (3, 5), (0.3, 0.8)),
    "crowd": Family(
        _crowd, (200, 3000), (10, 40), (6, 8), (0.2, 0.6), gaps=(0.0, 0.15)
    ),
    "two_images": Family(
        _two_images,
        (80, 800),
        (2, 2),
        (2, 6),
        (0.2, 0.5),
        outliers=(0.0, 0.75),
        kinds=(0.0, 0.0, 0.0, 1.0),
        noise=(0.5, 2.0),
        drift=(0.0, 0.0),
        shared=(0.0, 0.2),
        motion_noise=(0.0, 0.0),
        bending=(0.0, 0.0),
        life=None,
        sizes=((640, 480), (720, 576)),
    ),
    "photographs": Family(
        _photographs,
        (300, 3000),
        (5, 7),
        (2, 4),
        (0.3, 0.7),
        outliers=(0.0, 0.4),
        kinds=(0.0, 0.2, 0.0, 0.8),
        noise=(1.2, 6.0),
        drift=(0.0, 0.0),
        shared=(0.0, 0.2),
        motion_noise=(0.0, 0.0),
        bending=(0.0, 0.0),
        life=None,
        seen=(0.15, 0.4),
        sizes=((1280, 960), (1600, 1200), (3000, 2000)),
    ),
    "long": Family(
        _long,
        (200, 3000),
        (60, 200),
        (2, 5),
        outliers=(0.0, 0.3),
        drift=(0.2, 0.8),
        inertia=(0.0, 0.8),
        spread=(0.2, 0.6),
        late=(0.8, 0.95),
        life=(20, 40),
        gaps=(0.0, 0.15),
    ),
    "one_motion": Family(
        _one_motion,
        (30, 2000),
        (2, 40),
        (1, 1),
        outliers=(0.0, 0.75),
        drift=(0.2, 1.0),
        kinds=(0.3, 0.2, 0.2, 0.3),
    ),
    "dense_small": Family(
        _dense,
        (2000, 20000),
        (6, 20),
        (2, 6),
        (0.85, 0.97),
        sizes=((854, 480), (1280, 720), (1242, 375)),
    ),
}
