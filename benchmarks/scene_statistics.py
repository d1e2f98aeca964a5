"""Noise and motion of real tracks beside those of simulated scenes.

    python -m benchmarks.scene_statistics --data DIR [--scenes N] [--frames L]

``DIR`` holds KT3DMoSeg, Hopkins155, MTPV62, AdelaideRMF and Arrigoni; what is not there
is left out. Each true motion is fitted by a perspective camera over windows of frames
(two-view geometry where the frames have no order), and what is left is described:

residual
    Median over tracks of the root mean square over the window, pixels.
spread
    Of its logarithm over tracks: the quartiles' distance over 1.35.
correlation
    From frame to frame, of residuals divided by their track's scale.
growth
    Residuals of the last frame over those of the second.
neighbour
    Correlation with the residual of the nearest track in the first frame.
unseen, tracks, frames, motions, smallest, outliers
    Shares of entries and tracks in percent, and numbers.
length
    Mean number of frames a track is seen in.
step, fast
    Median and 95th percentile of displacements from frame to frame, percent of the
    image width.

Each figure is the median over sequences, with the 10th and 90th percentiles.
"""

from __future__ import annotations

import argparse
import json
import warnings
from itertools import groupby
from pathlib import Path

import numpy as np
import scipy.io
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from skmotionseg import datasets, pack_tracks

COLUMNS = (
    *("residual", "spread", "correlation", "growth", "neighbour", "unseen", "tracks"),
    *("frames", "motions", "smallest", "outliers", "length", "step", "fast"),
)
FOCALS = (0.6, 1.0, 1.8)  # image widths
MOST_TRACKS = 100  # of a group and window
FEWEST_TRACKS = 20
WINDOWS = 2  # per group


# ------------------------------------------------------------------ perspective windows


def fit_window(rays, n_rounds=12):
    """Rigid motion over a window, each track anchored where it is seen first.

    Parameters
    ----------
    rays : ndarray of shape (n_tracks, n_frames, 2)
        Coordinates in focal lengths about the middle of the image.

    Returns
    -------
    residuals : ndarray of shape (n_tracks, n_frames - 1, 2)
        Of the later frames, in focal lengths.
    cost : float
    """
    n_frames = rays.shape[1] - 1
    flow = np.median(np.linalg.norm(rays[:, -1] - rays[:, 0], axis=1)) + 1e-6
    best = None
    for start in ([0, 0, 0], [0, 0, -1], [0, 0, 1], [1, 0, 0], [0, 1, 0]):
        way = np.arange(1, n_frames + 1)[:, None] / n_frames * flow * np.array(start)
        fitted = _gauss_newton(rays, way + 1e-9, n_rounds)
        if best is None or fitted[1] < best[1]:
            best = fitted
    return best


def _gauss_newton(rays, translations, n_rounds):
    first, later = rays[:, 0], rays[:, 1:]
    n_tracks, n_frames = later.shape[:2]
    points = np.column_stack([first, np.ones(n_tracks)])
    rotations = np.tile(np.eye(3), (n_frames, 1, 1))
    inverse = np.ones(n_tracks)
    damping, best = 1e-3, None
    state = rotations, translations, inverse
    for _ in range(n_rounds):
        residuals, jacobians = _linearise(points, later, *state)
        scale = np.median(np.abs(residuals)) / 0.67 + 1e-12
        cost = np.log1p((residuals**2).sum(axis=2) / (3 * scale) ** 2).sum()
        cost += 2 * residuals[..., 0].size * np.log(scale)
        if best is None or cost < best[0]:
            best, damping = (cost, residuals, state), max(damping / 4, 1e-9)
        else:
            damping *= 8
            residuals, jacobians = _linearise(points, later, *best[2])
        weights = 1 / (1 + (residuals**2).sum(axis=2) / (3 * scale) ** 2)
        state = _step(residuals, jacobians, weights, damping, *best[2])
    return best[1], best[0]


def _linearise(points, later, rotations, translations, inverse):
    turned = np.einsum("fij,nj->nfi", rotations, points)
    seen = turned + inverse[:, None, None] * translations
    depth = np.where(np.abs(seen[..., 2]) < 0.05, 0.05, seen[..., 2])
    image = seen[..., :2] / depth[..., None]
    to_image = np.zeros((*depth.shape, 2, 3))
    to_image[..., 0, 0] = to_image[..., 1, 1] = 1 / depth
    to_image[..., :, 2] = -image / depth[..., None]
    cross = np.zeros((*depth.shape, 3, 3))  # minus the cross product with `turned`
    x, y, z = np.moveaxis(turned, -1, 0)
    cross[..., 0, 1], cross[..., 0, 2], cross[..., 1, 2] = z, -y, x
    cross -= np.swapaxes(cross, -1, -2)
    by_pose = np.concatenate(
        [to_image @ cross, inverse[:, None, None, None] * to_image], axis=-1
    )  # (n_tracks, n_frames, 2, 6)
    by_depth = (to_image @ translations[..., None])[..., 0]
    return image - later, (by_pose, by_depth)


def _step(residuals, jacobians, weights, damping, rotations, translations, inverse):
    by_pose, by_depth = jacobians
    n_tracks, n_frames = weights.shape
    pose = np.einsum("nf,nfki,nfkj->fij", weights, by_pose, by_pose)
    mixed = np.einsum("nf,nfki,nfk->nfi", weights, by_pose, by_depth)
    mixed = mixed.reshape(n_tracks, -1)
    depth = np.einsum("nf,nfk,nfk->n", weights, by_depth, by_depth)
    right = -np.einsum("nf,nfki,nfk->fi", weights, by_pose, residuals).ravel()
    right_depth = -np.einsum("nf,nfk,nfk->n", weights, by_depth, residuals)
    left = np.zeros((n_frames, 6, n_frames, 6))
    left[np.arange(n_frames), :, np.arange(n_frames)] = pose
    left = left.reshape(6 * n_frames, -1)
    left += damping * np.diag(np.diag(left)) + 1e-9 * np.trace(left) * np.eye(len(left))
    depth = depth * (1 + damping) + 1e-9 * depth.mean() + 1e-12
    left -= mixed.T @ (mixed / depth[:, None])
    step = np.linalg.lstsq(left, right - mixed.T @ (right_depth / depth), rcond=1e-10)
    step = step[0]
    inverse = inverse + (right_depth - mixed @ step) / depth
    step = step.reshape(n_frames, 6)
    rotations = Rotation.from_rotvec(step[:, :3]).as_matrix() @ rotations
    return rotations, translations + step[:, 3:], inverse


def window_statistics(points, target, length, rng):
    """Rows of (residual, spread, correlation, growth, neighbour), one per window."""
    n_frames = points.shape[1]
    length = min(length, n_frames)
    rows = []
    width = np.nanmax(points[..., 0])
    for motion in range(target.max() + 1):
        group = points[target == motion]
        starts = rng.permutation(n_frames - length + 1)
        done = 0
        for start in starts[:12]:
            window = group[:, start : start + length]
            window = window[np.isfinite(window).all(axis=(1, 2))]
            if len(window) < FEWEST_TRACKS:
                continue
            if len(window) > MOST_TRACKS:
                window = window[rng.permutation(len(window))[:MOST_TRACKS]]
            rows.append(_describe_window(window, width))
            done += 1
            if done == WINDOWS:
                break
    return rows


def _describe_window(window, width):
    middle = np.array([width, window[..., 1].max() + window[..., 1].min()]) / 2
    fits = []
    for focal in FOCALS:
        residuals, cost = fit_window((window - middle) / (focal * width))
        # In pixels, whatever the focal length is.
        cost += 2 * residuals[..., 0].size * np.log(focal * width)
        fits.append((cost, focal * width * residuals))
    residuals = min(fits, key=lambda fit: fit[0])[1]
    sizes = np.sqrt((residuals**2).sum(axis=2).mean(axis=1) / 2) + 1e-9
    kept = sizes < 6 * np.median(sizes)
    residuals, sizes, first = residuals[kept], sizes[kept], window[kept, 0]
    unit = residuals / sizes[:, None, None]
    quartiles = np.percentile(np.log(sizes), [25, 75])
    energy = (unit**2).sum(axis=(0, 2))
    products = (unit[:, :-1] * unit[:, 1:]).sum(axis=(0, 2))
    _, nearest = cKDTree(first).query(first, k=2)
    return (
        np.median(sizes),
        np.ptp(quartiles) / 1.35,
        np.mean(products / np.sqrt(energy[:-1] * energy[1:])),
        np.sqrt(energy[-1] / energy[0]),
        (unit * unit[nearest[:, 1]]).sum() / energy.sum(),
    )


# --------------------------------------------------------------------------- two images


def pair_statistics(points, target, rng):
    """Rows of (residual, spread, nan, nan, nan), one per motion and pair of frames."""
    n_frames = points.shape[1]
    pairs = [(i, j) for i in range(n_frames) for j in range(i + 1, n_frames)]
    pairs = [pairs[k] for k in rng.permutation(len(pairs))[:6]]
    rows = []
    for motion in range(target.max() + 1):
        group = points[target == motion]
        for i, j in pairs:
            pair = group[:, [i, j]]
            pair = pair[np.isfinite(pair).all(axis=(1, 2))]
            if len(pair) >= FEWEST_TRACKS:
                sizes = _sampson(pair) + 1e-9
                sizes = sizes[sizes < 6 * np.median(sizes)]
                quartiles = np.percentile(np.log(sizes), [25, 75])
                row = np.median(sizes), np.ptp(quartiles) / 1.35
                rows.append((*row, *[np.nan] * 3))
    return rows


def _sampson(pair):
    """Distances (n,) to the fundamental matrix of most of the matches, pixels."""
    middle = pair.mean(axis=(0, 1))
    scale = np.abs(pair - middle).mean()
    a, b = (
        np.column_stack([(pair[:, k] - middle) / scale, np.ones(len(pair))])
        for k in (0, 1)
    )
    weights = np.ones(len(pair))
    for _ in range(6):
        design = (b[:, :, None] * a[:, None, :]).reshape(-1, 9) * weights[:, None]
        matrix = np.linalg.svd(design)[2][-1].reshape(3, 3)
        u, s, vh = np.linalg.svd(matrix)
        matrix = (u * [s[0], s[1], 0]) @ vh
        in_b, in_a = a @ matrix.T, b @ matrix
        steepness = np.sqrt(
            (in_b[:, :2] ** 2).sum(axis=1) + (in_a[:, :2] ** 2).sum(axis=1)
        )
        distances = np.abs((b * in_b).sum(axis=1)) / (steepness + 1e-12)
        weights = 1 / (1 + (distances / (3 * np.median(distances) + 1e-9)) ** 2)
        weights = weights / (steepness + 1e-12) * np.median(steepness)
    return scale * distances


# ----------------------------------------------------------------------------- the rest


def describe(X, target, length, ordered=True, seed=0):
    """All figures of a sequence, in the order of ``COLUMNS``."""
    rng = np.random.RandomState(seed)
    points = np.asarray(X, dtype=float).reshape(len(X), -1, 2)
    ordered = ordered and points.shape[1] > 2
    if ordered:
        rows = window_statistics(points, target, length, rng)
    else:
        rows = pair_statistics(points, target, rng)
    noise = np.median(rows, axis=0) if rows else [np.nan] * 5
    sizes = np.bincount(target[target >= 0])
    sizes = sizes[sizes > 0]
    width = np.nanmax(points[..., 0])
    steps = np.linalg.norm(np.diff(points[target >= 0], axis=1), axis=2) / width
    steps = steps[np.isfinite(steps)]
    return (
        *noise,
        100 * np.isnan(points[..., 0]).mean(),
        len(points),
        points.shape[1],
        len(sizes),
        100 * sizes.min() / sizes.sum(),
        100 * np.mean(target < 0),
        np.isfinite(points[..., 0]).sum(axis=1).mean(),
        100 * np.median(steps),
        100 * np.percentile(steps, 95),
    )


def real_sequences(folder, every=1):
    """(benchmark, X, target, ordered) of what is in the folder."""
    folder = Path(folder)
    for name in ("KT3DMoSeg", "Hopkins155", "MTPV62"):
        if (folder / name).exists():
            load = getattr(datasets, f"load_{name.lower()}")
            for bunch in load(folder / name)[:: every if name == "Hopkins155" else 1]:
                yield name, bunch.data, bunch.target, True
    for path in sorted(folder.glob("AdelaideRMF/*.mat")):
        file = scipy.io.loadmat(path)
        data = file["data"]
        points = np.stack([data[:2].T, data[3:5].T], axis=1)
        yield (
            "AdelaideRMF",
            pack_tracks(points),
            file["label"].ravel().astype(int) - 1,
            False,
        )
    for path in sorted(folder.glob("Arrigoni/*.npz")):
        file = np.load(path)
        labels = file["labels"]
        target = np.where(labels > 0, labels - 1, -1)
        yield "Arrigoni", pack_tracks(file["points"], file["visibility"]), target, False


def simulated(n_scenes, families, **overrides):
    for family in families:
        for seed in range(n_scenes):
            scene = datasets.make_scene(family, random_state=seed, **overrides)
            ordered = family != "photographs"
            yield family, scene.data, scene.target, ordered


def table(sequences, length):
    """Print a line per benchmark or family as it is there; all figures of each."""
    rows = {}
    for name, group in groupby(sequences, key=lambda sequence: sequence[0]):
        rows[name] = np.array(
            [
                describe(X, np.asarray(target).astype(int), length, ordered)
                for _, X, target, ordered in group
            ]
        )
        show_line(name, rows[name])
    return rows


def show_line(name, values):
    low, middle, high = _percentiles(values, [10, 50, 90])
    cells = (
        f"{_short(m)} ({_short(a)}-{_short(b)})"
        for a, m, b in zip(low, middle, high, strict=True)
    )
    print(f"{name:13s}" + "".join(f"{cell:>17s}" for cell in cells), flush=True)


def _percentiles(values, shares):
    """Of each column (n_shares, n_columns), NaN where no sequence has a figure."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        return np.nanpercentile(values, shares, axis=0)


def _short(value):
    if not np.isfinite(value):
        return "-"
    return f"{value:.0f}" if abs(value) >= 10 else f"{value:.2g}"


def main(arguments=None):
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.scene_statistics",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--data", type=Path, help="the folder of real sequences")
    parser.add_argument("--scenes", type=int, default=10, help="per family")
    parser.add_argument("--families", nargs="*", default=datasets.scene_families())
    parser.add_argument("--frames", type=int, default=8, help="of a window")
    parser.add_argument("--every", type=int, default=3, help="Hopkins155 sequence")
    parser.add_argument("--json", type=Path, help="keep the medians here")
    arguments = parser.parse_args(arguments)
    print(f"{'':13s}" + "".join(f"{name:>17s}" for name in COLUMNS))
    rows = {}
    if arguments.data:
        rows = table(real_sequences(arguments.data, arguments.every), arguments.frames)
    made = simulated(arguments.scenes, arguments.families, n_tracks=(100, 800))
    rows |= table(made, arguments.frames)
    if arguments.json:
        medians = {
            name: dict(zip(COLUMNS, _percentiles(values, [50])[0], strict=True))
            for name, values in rows.items()
        }
        arguments.json.write_text(json.dumps(medians, indent=1))


if __name__ == "__main__":
    main()
