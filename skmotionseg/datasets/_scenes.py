"""Families of simulated scenes with known motions and the noise of real trackers."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from sklearn.utils import Bunch, check_random_state

from ._scene_geometry import (
    NEAREST,
    Camera,
    Motion,
    Surface,
    background_motion,
    blob,
    box,
    direction,
    in_facets,
    in_patches,
    in_view,
    misfits,
    project,
    rotation_matrices,
    seen_from,
    sheet,
    smooth,
    turned_to,
)
from ._scene_tracks import (
    bending,
    lifetimes,
    photographs,
    tracker_noise,
    with_gaps,
    wrong_tracks,
)

MIN_GROUP = 10  # tracks of the smallest motion
PER_MOTION = 20  # tracks: no more motions are drawn than can have as many
N_PROBES = 40  # points that stand for a motion while it is drawn
N_DRAWS = 12  # of an object, until it is seen and differs from those before
PROBES_SEEN = 0.15  # share of the probes
APART = 2.0  # misfit of the 5 % of probes that tell motions apart least, in noises
N_JUDGED = 300  # tracks whose separation is computed


class _Thing(NamedTuple):
    """A motion and what moves with it."""

    motion: Motion
    surface: Surface
    rotations: np.ndarray  # (n_frames, 3, 3): the path in the world
    positions: np.ndarray  # (n_frames, 3)
    radius: float


class _Family(NamedTuple):
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


def _camera(settings, rng, steps, turns):
    """A camera that moves by ``steps`` (n_frames, 3), in its own axes, and turns.

    ``turns`` (n_frames, 3) are rotation vectors of the whole way since the start.
    """
    rotations = rotation_matrices(turns)
    steps = np.einsum("fij,fj->fi", rotations, steps)
    return Camera(rotations, steps.cumsum(axis=0), settings.focal, settings.image_size)


def _still_camera(settings):
    nowhere = np.zeros((settings.n_frames, 3))
    return _camera(settings, None, nowhere, nowhere)


def _hand_held_camera(settings, rng, depth=1.0, flow=None):
    """Sways and shakes; things at ``depth`` move by about ``flow`` widths per frame."""
    n_frames = settings.n_frames
    flow = _log_uniform(rng, 0.001, 0.008) if flow is None else flow
    unit = flow * settings.image_size[0] / settings.focal
    drift = direction(rng) * [1, 0.4, 0.7] * rng.uniform(0.3, 1)
    steps = unit * depth * (0.6 * smooth(n_frames, rng, period=30) + drift)
    turns = unit * 0.5 * smooth(n_frames, rng, period=25).cumsum(axis=0)
    turns += unit * 0.2 * rng.uniform() * rng.standard_normal((n_frames, 3))
    return _camera(settings, rng, steps, turns)


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
    return _Thing(motion, surface, rotations, positions, radius)


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
    camera = _camera(settings, rng, steps, turns)

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
    camera = _camera(settings, rng, np.zeros((n_frames, 3)), turns)

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

_FAMILIES = {
    "street": _Family(
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
    "still_camera": _Family(_still, (60, 2000), (8, 60), (2, 5), (0.3, 0.9)),
    "table": _Family(
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
    "hand_held": _Family(
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
    "planar": _Family(_planar, (60, 1000), (8, 40), (2, 5), (0.3, 0.8), facets=(0, 0)),
    "rotation": _Family(_rotation, (60, 1500), (8, 40), (2, 5)),
    "articulated": _Family(_articulated, (80, 1500), (12, 50), (3, 5), (0.3, 0.8)),
    "crowd": _Family(
        _crowd, (200, 3000), (10, 40), (6, 8), (0.2, 0.6), gaps=(0.0, 0.15)
    ),
    "two_images": _Family(
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
    "photographs": _Family(
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
    "long": _Family(
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
    "one_motion": _Family(
        _one_motion,
        (30, 2000),
        (2, 40),
        (1, 1),
        outliers=(0.0, 0.75),
        drift=(0.2, 1.0),
        kinds=(0.3, 0.2, 0.2, 0.3),
    ),
    "dense_small": _Family(
        _dense,
        (2000, 20000),
        (6, 20),
        (2, 6),
        (0.85, 0.97),
        sizes=((854, 480), (1280, 720), (1242, 375)),
    ),
}

SCENE_FAMILIES = tuple(_FAMILIES)

_RANGES = (
    *("n_tracks", "n_frames", "n_motions", "background", "outliers", "noise"),
    *("drift", "inertia", "spread", "shared", "late", "life", "seen", "gaps", "focal"),
    *("distortion", "texture", "motion_noise", "facets", "bending"),
)
_BOUNDS = dict.fromkeys(_RANGES, (0, 1)) | {
    "n_tracks": (1, np.inf),
    "n_frames": (2, np.inf),
    "n_motions": (1, np.inf),
    "outliers": (0, 0.9),
    "noise": (0, np.inf),
    "spread": (0, np.inf),
    "motion_noise": (0, np.inf),
    "bending": (0, np.inf),
    "life": (1, np.inf),
    "focal": (0.1, np.inf),
    "distortion": (-0.3, 0.3),
    "texture": (0.01, 1),
    "facets": (0, 10000),
}
_NOISES = ("noise", "drift", "inertia", "spread", "shared", "motion_noise")
# By random numbers of their own, so that all else is as it was without them.
_DRAWN_BY = {"texture": 1, "motion_noise": 1, "facets": 2, "bending": 3}
_WHOLE_NUMBERS = ("n_tracks", "n_frames", "n_motions", "facets")
_LOGARITHMIC = ("n_tracks", "n_frames", "noise", "life", "texture", "facets")


def scene_families(n_frames: int | None = None) -> tuple[str, ...]:
    """Names of the families of simulated scenes.

    Parameters
    ----------
    n_frames : int, optional
        Only families that have scenes of this number of frames.

    Returns
    -------
    names : tuple of str

    Examples
    --------
    >>> from skmotionseg.datasets import scene_families
    >>> scene_families()[:3]
    ('street', 'still_camera', 'table')
    >>> scene_families(n_frames=2)
    ('two_images', 'one_motion')
    """
    if n_frames is None:
        return SCENE_FAMILIES
    return tuple(
        name
        for name, family in _FAMILIES.items()
        if family.n_frames[0] <= n_frames <= family.n_frames[1]
    )


def make_scene(
    family: str,
    *,
    random_state: int | np.random.RandomState | None = None,
    **overrides: Any,
) -> Bunch:
    """A simulated scene of a family, with the noise of a real tracker.

    Parameters
    ----------
    family : str
        One of :func:`scene_families`.
    random_state : int, RandomState instance or None, default=None
    **overrides : number or (low, high)
        What is not to be drawn from the range of the family, or from another
        range: ``n_tracks`` (outliers included), ``n_frames``, ``n_motions`` (of
        a range, no more than can have 20 tracks each), ``background`` (share of
        the tracks that follow a motion), ``outliers`` (share of all tracks),
        ``noise`` (standard deviation of a coordinate one frame after the track
        begins, pixels), ``drift`` (share of its variance that adds up from
        frame to frame), ``inertia`` (correlation of what is added with what was
        added the frame before), ``spread`` (standard deviation over tracks of
        the logarithm of their noise), ``shared`` (share of the noise that
        neighbours have in common), ``motion_noise`` (what is added to the
        noise, in pixels per pixel that a track moves per frame), ``late``
        (share of the tracks that begin after the first frame), ``life`` (mean
        number of frames after which a track is lost), ``seen`` (share of the
        frames a point is found in, unordered photographs only), ``gaps`` (share
        of tracks with a gap), ``focal`` (image widths) and ``distortion`` (by
        which the lens moves the corners of the image, as a share of their
        distance from its middle; negative for barrels), ``texture`` (share of
        what stands still and is seen that has tracks, in patches; 1 in every
        other scene) and ``facets`` (number of flat pieces that what stands
        still consists of; 0: relief, as in a quarter of the scenes) and ``bending``
        (pixels per frame by which what moves by itself is not rigid, for the thing
        that bends most; 0 in two images and in photographs);
        ``image_size`` is (width, height) in pixels.

    Returns
    -------
    scene : Bunch
        Tracks, and what they were made of:

        - ``data``, ndarray of shape (n_tracks, 2 * n_frames): pixels, NaN where unseen;
        - ``target``, ndarray of int, shape (n_tracks,): 0, 1, ... with the largest
          motion first, -1 for tracks of no motion;
        - ``truth``, ndarray of shape (n_tracks, 2 * n_frames): the same tracks without
          noise;
        - ``n_motions``, int;
        - ``background``, int: label of what stands still in the world, -1 if nothing
          does;
        - ``separation``, float: share of the tracks of motions that their own motion
          explains best, of all true motions, each with the depth that fits best. Of 300
          tracks if there are more; 1 if there is one motion;
        - ``separations``, ndarray of shape (n_motions,): the same within each motion;
        - ``rotations``, ndarray of shape (n_motions, n_frames, 3, 3), and
          ``translations``, ndarray of shape (n_motions, n_frames, 3): from the
          coordinates of each object to those of the camera;
        - ``focal``, float: pixels; the principal point is the middle of the image;
        - ``image_size``, ndarray of shape (2,): width and height, pixels;
        - ``family``, str;
        - ``settings``, dict: what was drawn;
        - ``DESCR``, str.

    Raises
    ------
    ValueError
        If the family or an override is unknown or out of range.

    Examples
    --------
    >>> from skmotionseg.datasets import make_scene
    >>> scene = make_scene("street", n_tracks=200, n_frames=10, random_state=0)
    >>> scene.data.shape
    (200, 20)
    >>> scene.n_motions, int(scene.target.max())
    (3, 2)
    """
    if family not in _FAMILIES:
        raise ValueError(f"family must be one of {SCENE_FAMILIES}; got {family!r}")
    rng = check_random_state(random_state)
    # Of its own, lest all families have as many tracks and motions with one seed.
    streams = rng.randint(2**31 - 1, size=len(SCENE_FAMILIES))
    own = streams[SCENE_FAMILIES.index(family)]
    rngs = [np.random.RandomState(own ^ k) for k in range(4)]
    settings = _draw_settings(family, overrides, rngs)
    rng, late_rng, facet_rng, bend_rng = rngs
    chosen = _FAMILIES[family]
    camera, surface, draw = chosen.build(settings, rng)
    if surface is not None and settings.facets:
        surface = in_facets(surface, settings.facets, camera, facet_rng)
    if surface is not None and settings.texture < 1:
        surface = in_patches(surface, settings.texture, camera, late_rng)
    things, shares = _draw_things(camera, surface, draw, settings, chosen, rng)
    filmed = camera, things, shares, surface is not None
    return _film(family, *filmed, settings, chosen, rng, bend_rng)


# --------------------------------------------------------------------------- assembling


def _draw_settings(family, overrides, rngs):
    rng, late_rng, facet_rng, _ = rngs
    chosen = _FAMILIES[family]
    unknown = set(overrides) - {*_RANGES, "image_size"}
    if unknown:
        raise ValueError(
            f"overrides must be some of {(*_RANGES, 'image_size')}; got "
            f"{sorted(unknown)}"
        )
    settings = Bunch()
    sizes = chosen.sizes
    size = overrides.get("image_size", sizes[rng.randint(len(sizes))])
    settings.image_size = _as_image_size(size)
    for name in _RANGES:
        given = overrides.get(name, getattr(chosen, name))
        settings[name] = _draw_setting(name, given, rngs[_DRAWN_BY.get(name, 0)])
    if "texture" not in overrides and late_rng.uniform() < 0.5:
        settings.texture = 1.0
    if "facets" not in overrides and facet_rng.uniform() < 0.25:
        settings.facets = 0
    if "outliers" not in overrides and rng.uniform() < 0.25:
        settings.outliers = 0.0
    n_inliers = settings.n_tracks - round(settings.outliers * settings.n_tracks)
    if np.ndim(overrides.get("n_motions", chosen.n_motions)):
        fewest = overrides.get("n_motions", chosen.n_motions)[0]
        most = max(n_inliers // PER_MOTION, fewest)
        settings.n_motions = min(settings.n_motions, most)
    if n_inliers < settings.n_motions:
        raise ValueError(
            f"{n_inliers} tracks that are no outliers are too few for "
            f"{settings.n_motions} motions"
        )
    settings.focal *= settings.image_size[0]
    if settings.n_motions > 1 and settings.background is not None:
        # Leave a hundredth at least to each of the others.
        settings.background = min(
            settings.background, 1 - 0.01 * (settings.n_motions - 1)
        )
    return settings


def _draw_setting(name, given, rng):
    uniform = rng.uniform()
    if given is None:
        return None
    low, high = _as_range(name, given)
    if name in _WHOLE_NUMBERS:
        low, high = low - 0.49, high + 0.49
    if name in _LOGARITHMIC and low > 0:
        value = low * (high / low) ** uniform
    else:
        value = low + (high - low) * uniform
    return round(value) if name in _WHOLE_NUMBERS else float(value)


def _as_range(name, given):
    least, most = _BOUNDS[name]
    try:
        low, high = map(float, given if np.ndim(given) else (given, given))
    except (TypeError, ValueError):
        low, high = np.nan, np.nan
    if not low <= high < np.inf:
        raise ValueError(f"{name} must be a number or (low, high); got {given!r}")
    if low < least or high > most:
        limits = f"{least:g} or more" if most == np.inf else f"in [{least:g}, {most:g}]"
        raise ValueError(f"{name} must be {limits}; got {given!r}")
    return low, high


def _as_image_size(given):
    size = np.asarray(given, dtype=float)
    if size.shape != (2,) or not (size > 0).all():
        raise ValueError(
            f"image_size must be (width, height), in pixels above 0; got {given!r}"
        )
    return size


def _draw_things(camera, surface, draw, settings, chosen, rng):
    """The background, if there is one, and objects that move unlike all others."""
    things, probes = [], []  # probes: points, frames seen in
    if surface is not None:
        n_frames = settings.n_frames
        still = np.tile(np.eye(3), (n_frames, 1, 1)), np.zeros((n_frames, 3))
        things.append(_Thing(background_motion(camera), surface, *still, np.inf))
        probes.append(_probe(things[0], camera, settings, chosen, rng))
    while len(things) < settings.n_motions:
        drawn: list[tuple[float, _Thing, tuple]] = []  # merit, thing, probe
        while len(drawn) < 4 * N_DRAWS:
            thing = draw(things)
            probe = _probe(thing, camera, settings, chosen, rng)
            merit = _merit(thing, probe, things, probes, camera, settings)
            drawn.append((merit, thing, probe))
            highest = max(each[0] for each in drawn)
            if highest >= (1 if len(drawn) < N_DRAWS else 0.1):  # 0.1: seen, at least
                break
        _, thing, probe = max(drawn, key=lambda each: each[0])
        things.append(thing)
        probes.append(probe)
    shares = [max(len(probe[0]) / N_PROBES, 0.05) for probe in probes]
    return things, shares


def _probe(thing, camera, settings, chosen, rng):
    points, _, _, seen = _track(thing, N_PROBES, [], camera, settings, chosen, rng)
    kept = seen.any(axis=1)
    return points[kept], seen[kept]


def _merit(thing, probe, things, probes, camera, settings):
    """1 if a thing is seen and tells itself from the others, less if it does not."""
    points, seen = probe
    share = len(points) / N_PROBES
    if share < PROBES_SEEN:
        return 0.1 * share / PROBES_SEEN
    length = seen.sum(axis=1).mean()
    growth = settings.drift * length / 6 * (1 + settings.inertia)
    noise = settings.noise * np.sqrt(1 + growth)
    apart = np.inf
    if things:
        theirs = misfits(points, seen, [other.motion for other in things], camera, 2)
        apart = np.quantile(theirs.min(axis=0), 0.05)
        points = np.concatenate([other[0] for other in probes])
        seen = np.concatenate([other[1] for other in probes])
        if len(points):
            mine = misfits(points, seen, [thing.motion], camera, 2)[0]
            apart = min(apart, np.quantile(mine, 0.05))
    return 0.1 + 0.9 * min(apart / (APART * noise), 1)


def _track(thing, n_tracks, occluders, camera, settings, chosen, rng):
    """Points of a thing: pixels, their depths, frames of birth, frames seen in."""
    n_frames = settings.n_frames
    births = np.zeros(n_tracks, dtype=int)
    if chosen.seen is not None:
        births = rng.randint(n_frames, size=n_tracks)
    elif not chosen.whole and n_frames > 3:
        latest = n_frames - _min_seen(settings)
        late = rng.uniform(size=n_tracks) < settings.late
        births = np.where(late, rng.randint(latest + 1, size=n_tracks), 0)
    if settings.life is None or chosen.whole:
        ends = np.full(n_tracks, n_frames)
    else:
        ends = births + 2 + rng.exponential(settings.life, size=n_tracks)
    surface = thing.surface(births, rng)
    points, depths = project(surface, thing.motion, camera)
    x, y = points[..., 0], points[..., 1]
    visible = (depths > NEAREST) & (x > 0) & (x < camera.size[0])
    visible &= (y > 0) & (y < camera.size[1])
    for middle, spread, depth in occluders:
        along, across = x - middle[:, 0], y - middle[:, 1]
        far = spread[:, 0, 0] * along**2 + spread[:, 1, 1] * across**2
        far += 2 * spread[:, 0, 1] * along * across
        visible &= (far > 3) | (depths < depth)
    if chosen.whole:
        seen = visible & visible.all(axis=1, keepdims=True)
    elif chosen.seen is not None:
        seen = photographs(visible, settings.seen, 2, rng)
    else:
        seen = lifetimes(visible, births, ends, _min_seen(settings))
        if settings.gaps:
            seen = with_gaps(seen, settings.gaps, _min_seen(settings), rng)
    return points, depths, births, seen


def _min_seen(settings):
    return min(4, settings.n_frames)


def _occluder(thing, camera, rng):
    """An ellipse in each frame that hides what is behind it."""
    points, depths = project(
        thing.surface(np.zeros(24, dtype=int), rng), thing.motion, camera
    )
    middle = points.mean(axis=0)
    gaps = points - middle
    covariance = np.einsum("nfi,nfj->fij", gaps, gaps) / len(points)
    spread = np.linalg.inv(covariance + 1e-3 * np.eye(2))
    return middle, spread, np.where(depths.min(axis=0) > 0.2, depths.mean(axis=0), 1e9)


def _group_sizes(n_tracks, n_motions, has_background, settings, rng):
    """Tracks of each motion: none tiny, the background as large as was drawn."""
    weights = np.exp(rng.uniform(0, np.log(rng.uniform(1, 15)), size=n_motions))
    shares = weights / weights.sum()
    if has_background and n_motions > 1:
        rest = shares[1:] / shares[1:].sum()
        shares = np.array([settings.background, *(1 - settings.background) * rest])
    smallest = min(MIN_GROUP, n_tracks // n_motions)
    sizes = np.maximum(np.floor(shares * n_tracks).astype(int), smallest)
    sizes[sizes.argmax()] += max(n_tracks - sizes.sum(), 0)
    for _ in range(sizes.sum() - n_tracks):
        sizes[sizes.argmax()] -= 1
    return sizes


def _fill(thing, size, share, occluders, camera, settings, chosen, rng):
    """``size`` tracks of a thing that are seen, fewer only if hardly any is."""
    found, n_found = [], 0
    for _ in range(30):
        n_more = int((size - n_found) / share * 1.1) + 8
        n_more = min(n_more, 20 * size + 200)
        points, _, _, seen = _track(
            thing, n_more, occluders, camera, settings, chosen, rng
        )
        kept = np.flatnonzero(seen.any(axis=1))
        share = max(len(kept) / n_more, 0.02)
        kept = kept[: size - n_found]
        found.append((points[kept], seen[kept]))
        n_found += len(kept)
        if n_found == size:
            break
    points, seen = zip(*found, strict=True)
    return np.concatenate(points), np.concatenate(seen)


def _tracks(camera, things, shares, has_background, settings, chosen, rng):
    """Points of all things, frames seen in, and motions; -1 is of those of none."""
    n_motions = len(things)
    n_outliers = round(settings.outliers * settings.n_tracks)
    n_inliers = settings.n_tracks - n_outliers
    sizes = _group_sizes(n_inliers, n_motions, has_background, settings, rng)
    extra = rng.multinomial(n_outliers, sizes / sizes.sum())
    objects = range(int(has_background), n_motions)
    discs = {motion: _occluder(things[motion], camera, rng) for motion in objects}
    parts = []
    for motion, thing in enumerate(things):
        others = [disc for other, disc in discs.items() if other != motion]
        size = sizes[motion] + extra[motion]
        share, options = shares[motion], (camera, settings, chosen, rng)
        filled = _fill(thing, size, share, others, *options)
        if len(filled[0]) < size:  # hidden: then nothing hides it
            filled = _fill(thing, size, share, [], *options)
        parts.append(filled)
    found = np.array([len(part[0]) for part in parts])
    sizes = np.minimum(sizes, found)  # where few are seen, there are fewer outliers
    target = np.concatenate(
        [
            np.where(np.arange(n) < size, motion, -1)
            for motion, (n, size) in enumerate(zip(found, sizes, strict=True))
        ]
    )
    motion_of = np.repeat(np.arange(n_motions), found)
    points, seen = map(np.concatenate, zip(*parts, strict=True))
    points, seen = _spoil(points, seen, target, motion_of, camera, chosen, rng)
    return points, seen, target


def _film(
    family, camera, things, shares, has_background, settings, chosen, rng, bend_rng
):
    points, seen, target = _tracks(
        camera, things, shares, has_background, settings, chosen, rng
    )
    target, order = _largest_first(target, len(things))
    background = int(np.flatnonzero(order == 0)[0]) if has_background else -1
    shuffled = rng.permutation(len(points))
    points, seen, target = points[shuffled], seen[shuffled], target[shuffled]
    noise = {name: settings[name] for name in _NOISES}
    errors = tracker_noise(points, seen, **noise, rng=rng)
    levels = {
        label: settings.bending * bend_rng.uniform(0.2, 1)
        for label in range(len(things))
        if label != background
    }
    errors += bending(points, seen, target, levels, bend_rng)
    motions = [things[motion].motion for motion in order]
    separations, separation = _separation(
        points + errors, seen, target, motions, camera, rng
    )
    points = _distorted(points, settings.distortion, camera.size)
    scene = Bunch(
        data=_packed(points + errors, seen),
        target=target,
        truth=_packed(points, seen),
        n_motions=len(motions),
        background=background,
        separation=separation,
        separations=separations,
        rotations=np.array([motion.rotations for motion in motions]),
        translations=np.array([motion.translations for motion in motions]),
        focal=camera.focal,
        image_size=camera.size,
        family=family,
        settings=dict(settings),
    )
    scene.DESCR = _describe(scene)
    return scene


def _distorted(points, share, size):
    """Points as a lens shows them that moves the corners of the image by a share."""
    middle = np.asarray(size) / 2
    from_middle = points - middle
    squares = (from_middle**2).sum(axis=-1, keepdims=True) / (middle**2).sum()
    return points + share * squares * from_middle


def _spoil(points, seen, target, motion_of, camera, chosen, rng):
    """Turn the tracks of label -1 into such as follow no motion."""
    wrong = np.flatnonzero(target < 0)
    if len(wrong) == 0:
        return points, seen
    # Beside what moves otherwise if there is such a thing, else what stands still.
    partners = rng.randint(len(points), size=len(wrong))
    others = points[partners]
    same = motion_of[partners] == motion_of[wrong]
    others = np.where(same[:, None, None], others[:, :1], others)
    points[wrong] = wrong_tracks(
        points[wrong], seen[wrong], others, chosen.kinds, camera.size, rng
    )
    inside = (points[wrong] > 0).all(axis=2) & (points[wrong] < camera.size).all(axis=2)
    left = seen[wrong] & inside
    enough = left.sum(axis=1) >= min(3, seen.shape[1])
    seen[wrong] = np.where(enough[:, None], left, seen[wrong])
    points[wrong] = np.clip(points[wrong], 0, camera.size)
    return points, seen


def _largest_first(target, n_motions):
    """Labels by size, and which motion each of them was."""
    sizes = np.bincount(target[target >= 0], minlength=n_motions)
    order = np.argsort(-sizes, kind="stable")
    order = order[sizes[order] > 0]
    labels = np.full(n_motions + 1, -1)
    labels[order] = np.arange(len(order))
    return labels[target], order


def _separation(points, seen, target, motions, camera, rng):
    """Shares of tracks that their own motion explains best: each motion, and all."""
    sizes = np.bincount(target[target >= 0], minlength=len(motions))
    if len(motions) == 1:
        return np.ones(1), 1.0
    # All of the small motions, and some of the large.
    quota = max(N_JUDGED // len(motions), 1)
    kept = np.concatenate(
        [np.flatnonzero(target == motion)[:quota] for motion in range(len(motions))]
    )
    gaps = misfits(points[kept], seen[kept], motions, camera, 2)
    best = gaps.argmin(axis=0) == target[kept]
    shares = np.array(
        [best[target[kept] == motion].mean() for motion in range(len(motions))]
    )
    return shares, float(shares @ sizes / sizes.sum())


def _packed(points, seen):
    return np.where(seen[..., None], points, np.nan).reshape(len(points), -1)


def _describe(scene):
    n_tracks, n_frames = len(scene.data), scene.data.shape[1] // 2
    return (
        f"{scene.family}: {scene.n_motions} motions, {n_tracks} tracks over {n_frames} "
        f"frames, {np.isnan(scene.data).mean():.0%} unseen, "
        f"{np.mean(scene.target < 0):.0%} outliers"
    )
