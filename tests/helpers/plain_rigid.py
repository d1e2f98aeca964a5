"""Rigid motions fitted one at a time, written as the formulas are.

One problem, one start and one direction of translation after another, with plain least
squares, all unknowns in one matrix, and no padding: what
:mod:`skmotionseg._core.geometry.rigid_motion` does for many at once must agree with.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from skmotionseg._core.geometry import resection, rigid_motion, starts
from skmotionseg._core.geometry.poses import NEAREST

FREEDOM = rigid_motion.FREEDOM


def lower_median(values):
    return np.sort(values)[(len(values) - 1) // 2]


def image_of(ray, depth, R, t):
    """The image of a point, its turned ray, and its distance."""
    turned = R @ ray
    point = turned + depth * t
    distance = point[2]
    if abs(distance) < NEAREST:
        distance = -NEAREST if distance < 0 else NEAREST
    return point[:2] / distance, turned, distance


def derivatives(image, turned, depth, distance):
    """Of an image by a rotation vector and a translation: (2, 6)."""
    across = np.array([[1, 0, -image[0]], [0, 1, -image[1]]]) / distance
    a, b, c = turned
    cross = np.array([[0, -c, b], [c, 0, -a], [-b, a, 0]])
    return np.hstack([-across @ cross, depth * across])


class Clip:
    """Tracks (n, L, 2) of one group, those that are seen in the reference frame."""

    def __init__(self, x, seen, floor, reference):
        self.x, self.seen, self.floor = x, seen, floor
        self.others = [k for k in range(x.shape[1]) if k != reference]
        self.reference = reference
        self.rays = np.column_stack([x[:, reference], np.ones(len(x))])
        self.times = seen[:, self.others].sum(axis=1)
        self.freedom = np.maximum(2 * self.times - 1, 1)

    def squares(self, poses, depths):
        """Squared residuals of each track, summed over frames."""
        total = np.zeros(len(self.x))
        for i, k in np.argwhere(self.seen):
            if k in poses:
                image, _, _ = image_of(self.rays[i], depths[i], *poses[k])
                total[i] += ((self.x[i, k] - image) ** 2).sum()
        return total

    def scale(self, squares):
        usual = lower_median((squares / self.freedom)[self.times > 0])
        return max(self.floor, rigid_motion.SCALE_OF_MEDIAN * np.sqrt(usual))

    def cost(self, squares, scale):
        weights = FREEDOM + self.freedom
        return (weights * np.log1p(squares / (FREEDOM * scale**2))).sum()


def fit(x, seen, floor, reference):
    """Rotations (L, 3, 3) and translations (L, 3) of one group, from several starts."""
    clip = Clip(x, seen, floor, reference)
    found = [
        minimised(clip, *start, rigid_motion.FIRST_ITERATIONS)
        for start in map(in_front, starting_motions(clip))
    ]
    squares = [clip.squares(*each) for each in found]
    scale = min(map(clip.scale, squares))
    best = found[int(np.argmin([clip.cost(each, scale) for each in squares]))]
    poses, _ = minimised(clip, *best, rigid_motion.LAST_ITERATIONS)
    poses[reference] = np.eye(3), np.zeros(3)
    R, t = zip(*(poses[k] for k in range(x.shape[1])), strict=True)
    return np.array(R), np.array(t)


def in_front(start):
    """No track behind the camera: those that are, are infinitely far."""
    poses, depths = start
    return poses, np.maximum(depths, 0)


def minimised(clip, poses, depths, iterations):
    """Levenberg-Marquardt with all poses and depths in one system."""
    damping = 1e-2
    for _ in range(iterations):
        squares = clip.squares(poses, depths)
        scale = clip.scale(squares)
        new = stepped(clip, poses, depths, squares, scale, damping)
        change = clip.cost(clip.squares(*new), scale) - clip.cost(squares, scale)
        damping = np.clip((0.2 if change < 0 else 8) * damping, 1e-9, 1e6)
        if change < 0:
            poses, depths = new
        if abs(change) < rigid_motion.CONVERGED:
            break
    return poses, depths


def stepped(clip, poses, depths, squares, scale, damping):
    n, L = len(depths), len(clip.others)
    normal, right = np.zeros((6 * L + n,) * 2), np.zeros(6 * L + n)
    weights = (FREEDOM + clip.freedom) / (FREEDOM * scale**2 + squares)
    for i in range(n):
        for place, k in enumerate(clip.others):
            if clip.seen[i, k]:
                R, t = poses[k]
                image, turned, distance = image_of(clip.rays[i], depths[i], R, t)
                row = np.zeros((2, 6 * L + n))
                row[:, 6 * place : 6 * place + 6] = derivatives(
                    image, turned, depths[i], distance
                )
                row[:, 6 * L + i] = (t[:2] - image * t[2]) / distance
                normal += weights[i] * row.T @ row
                right += weights[i] * row.T @ (clip.x[i, k] - image)
    normal += np.diag(damped(normal, 6 * L, damping))
    for i in np.flatnonzero((depths <= 0) & (right[6 * L :] < 0)):
        normal[6 * L + i], normal[:, 6 * L + i], right[6 * L + i] = 0, 0, 0
        normal[6 * L + i, 6 * L + i] = 1  # it stays at infinity
    change = np.linalg.solve(normal, right)
    moved = {}
    for place, k in enumerate(clip.others):
        vector, shift = np.split(change[6 * place : 6 * place + 6], 2)
        R, t = poses[k]
        moved[k] = Rotation.from_rotvec(vector).as_matrix() @ R, t + shift
    return moved, np.maximum(depths + change[6 * L :], 0)


def damped(normal, n_poses, damping):
    """What is added to the diagonal."""
    of_poses, of_depths = np.split(np.diag(normal), [n_poses])
    more = damping * of_depths + 1e-9 * ((1 + damping) * of_depths).max() + 1e-30
    return np.append(damping * of_poses + 1e-7 * of_poses.mean() + 1e-30, more)


def starting_motions(clip):
    """Poses and depths to start from: a few by the farthest frame and by the next."""
    last = clip.x.shape[1] - 1
    following = clip.reference + (1 if clip.reference < last else -1)
    far = last if clip.reference <= (last + 1) // 2 else 0
    for frame in (far, following):
        if clip.seen[:, frame].sum() < min(6, len(clip.x)):
            frame = following
        for turn, translation, depths in instantaneous(clip, frame):
            poses = {}
            for k in clip.others:
                speed = (k - clip.reference) / (frame - clip.reference)
                R = Rotation.from_rotvec(speed * turn).as_matrix()
                poses[k] = resected(clip, k, depths, R, speed * translation)
            yield poses, depths


def instantaneous(clip, frame):
    """Rotation vector, translation and depths of the best directions that differ."""
    both = clip.seen[:, frame]
    x, y = clip.rays[:, :2], np.where(both[:, None], clip.x[:, frame], 0)
    points = list(zip((x + y) / 2, y - x, strict=True))
    coarse = starts._directions(starts.N_DIRECTIONS)
    scores = np.array([turn_for(d, points, both)[1] for d in coarse])
    taken, chosen = np.zeros(len(coarse), dtype=int), []
    apart = np.cos(np.radians(starts.DEGREES_APART))
    for _ in range(starts.STARTS_PER_KIND):
        chosen.append(np.lexsort((scores, taken))[0])
        taken += np.abs(coarse @ coarse[chosen[-1]]) > apart
    for direction in coarse[chosen]:
        for degrees in starts.NEIGHBOURING:
            near = starts._around(direction[None, None], degrees)[0, 0]
            found = [turn_for(d, points, both)[1] for d in near]
            direction = near[int(np.argmin(found))]
        turn = turn_for(direction, points, both)[0]
        yield turn, *translation_of(direction, turn, points, both)


def flow_matrices(a, b):
    """What takes rotation, and translation over depth, to flow at (a, b)."""
    turning = np.array([[-a * b, 1 + a**2, -b], [-(1 + b**2), a * b, a]])
    return turning, np.array([[1, 0, -a], [0, 1, -b]])


def turn_for(direction, points, both):
    """The rotation vector for a direction of translation, and the median error."""
    rows, left = [], []
    for middle, flow in points:
        turning, moving = flow_matrices(*middle)
        u, v = moving @ direction
        across = np.array([-v, u]) / (np.hypot(u, v) + 1e-3)
        rows.append(across @ turning)
        left.append(across @ flow)
    rows, left, weights = np.array(rows), np.array(left), both.astype(float)
    for _ in range(starts.SWEEPS):
        weighted = rows * weights[:, None]
        turn = np.linalg.solve(weighted.T @ rows + 1e-9 * np.eye(3), weighted.T @ left)
        errors = np.abs(left - rows @ turn)
        median = lower_median(errors[both])
        weights = both / (1 + (errors / (2 * max(median, 1e-5))) ** 2)
    return turn, median


def translation_of(direction, turn, points, both):
    """Translation and depths, whose median is one and most of which are positive."""
    depths = np.zeros(len(points))
    for i, (middle, flow) in enumerate(points):
        turning, moving = flow_matrices(*middle)
        along = moving @ direction
        depths[i] = (flow - turning @ turn) @ along / (along @ along + 1e-4)
    sign = np.sign(depths[both].sum()) or 1
    size = max(lower_median(np.abs(depths[both])), 1e-6)
    depths = np.where(both, sign * depths / size, 1).clip(-3, 10)
    return sign * size * direction, depths


def resected(clip, frame, depths, R, t):
    """The pose in a frame, the depths being known."""
    some = np.flatnonzero(clip.seen[:, frame])
    for _ in range(starts.STEPS):
        found = [image_of(clip.rays[i], depths[i], R, t) for i in some]
        residuals = [clip.x[i, frame] - f[0] for i, f in zip(some, found, strict=True)]
        sizes = np.linalg.norm(residuals, axis=1)
        scale = resection.MEDIANS * max(lower_median(sizes), clip.floor)
        normal, right = np.zeros((6, 6)), np.zeros(6)
        for i, seen, residual, size in zip(some, found, residuals, sizes, strict=True):
            image, turned, distance = seen
            J = derivatives(image, turned, depths[i], distance)
            weight = 1 / (1 + (size / scale) ** 2)
            normal += weight * J.T @ J
            right += weight * J.T @ residual
        diagonal = np.diag(normal)
        more = resection.DAMPING * (diagonal + diagonal.mean()) + 1e-12
        change = np.linalg.solve(normal + np.diag(more), right)
        R = Rotation.from_rotvec(change[:3]).as_matrix() @ R
        t = t + change[3:]
    return R, t


def squared_residual(x, seen, R, t):
    """Of one track (L, 2) from a motion, its ray free, and its depth if positive."""
    M = np.concatenate([R[..., :2], t[..., None]], axis=-1)[seen]  # (L, 3, 3)
    r, x = R[seen][..., 2], x[seen]
    rows = np.concatenate([x[:, [k]] * M[:, 2] - M[:, k] for k in (0, 1)])
    left = np.concatenate([r[:, k] - x[:, k] * r[:, 2] for k in (0, 1)])
    normal = rows.T @ rows
    more = (1e-11 * np.trace(normal) + 1e-14) * np.eye(3)
    point = np.linalg.solve(normal + more, rows.T @ left)
    totals = []
    for first in (True, False):
        p = M @ point + r
        distance = np.where(
            np.abs(p[:, 2]) < NEAREST, np.where(p[:, 2] < 0, -NEAREST, NEAREST), p[:, 2]
        )
        image = p[:, :2] / distance[:, None]
        residuals = (x - image).T.ravel()
        totals.append((residuals**2).sum())
        rows = np.concatenate(
            [(M[:, k] - image[:, [k]] * M[:, 2]) / distance[:, None] for k in (0, 1)]
        )
        normal = rows.T @ rows
        more = (1e-9 * np.trace(normal) + 1e-14) * np.eye(3)
        point = point + np.linalg.solve(normal + more, rows.T @ residuals)
        if first:
            place, curvature = point, normal
    if (place[2] * (M @ place + r)[:, 2]).sum() >= 0:  # before those who see it
        return min(totals)
    others = np.linalg.solve(curvature[:2, :2], curvature[:2, 2])
    return min(totals) + place[2] ** 2 * (curvature[2, 2] - curvature[2, :2] @ others)


def residuals_of(x, seen, R, t):
    """What a ray and an inverse depth leave of one track: a function of the three."""

    def residuals(place):
        points = R[seen] @ [*place[:2], 1] + place[2] * t[seen]
        return (points[:, :2] / points[:, 2:] - x[seen]).ravel()

    return residuals


def least_square(x, seen, R, t):
    """Least sum of squares of one track over its ray and a positive inverse depth."""
    start = [*x[seen].mean(axis=0), 0.1]
    bounds = [-np.inf, -np.inf, 0], np.inf
    close = {"bounds": bounds, "xtol": 1e-12, "ftol": 1e-12}
    return 2 * least_squares(residuals_of(x, seen, R, t), start, **close).cost
