"""The paper's method in plain NumPy, as one would write it in an afternoon.

Whole arrays at a time, but nothing that a reader of the equations would not think of:
one SVD a hypothesis, residuals from the formulas, a full sort, a matrix of ones and
zeros times its transpose, dense eigenvectors. It calls nothing of the package, and is
what the package's speed is compared with.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg
from sklearn.cluster import KMeans

N_HYPOTHESES, N_TOP = 500, 50
PRIOR, SPARSITY, LAM, DELTA = 2, 6, 1e-2, 0.2
N_SWEEPS = 5
MINIMAL_SIZES = {"affine": 3, "homography": 4, "fundamental": 8}


def segment(X, counts, seed=0, fusion="coreg"):
    """Labels (n_tracks,) for the count among ``counts`` that costs least (eq. 13)."""
    rng = np.random.default_rng(seed)
    kernels = [affinity(X, model, rng) for model in MINIMAL_SIZES]
    graph = [scaled(K) for K in kernels]
    partitions = [cluster(graph, count, seed, fusion) for count in counts]
    costs = [sum(ncre(K, y) for K in kernels) for y in partitions]
    return partitions[int(np.argmin(costs))]


# ------------------------------------------------------------ from tracks to affinities


def affinity(X, model, rng):
    """Ordered residual kernel (n, n), sparse by the epsilon-neighbourhood."""
    points = X.reshape(len(X), -1, 2)
    seen = ~np.isnan(points).any(axis=2)
    common = seen[:, 1:] & seen[:, :-1]  # (n, n_pairs)
    marks = np.zeros((*common.shape, N_HYPOTHESES), dtype=np.float32)
    for p in range(common.shape[1]):
        rows = np.flatnonzero(common[:, p])
        if len(rows) >= MINIMAL_SIZES[model]:
            residuals = pair_residuals(points[rows, p], points[rows, p + 1], model, rng)
            best = np.argsort(residuals, axis=1)[:, :N_TOP]
            marks[rows[:, None], p, best] = 1
    marks = marks.reshape(len(X), -1)
    together = common.astype(np.float32) @ common.T.astype(np.float32)
    return neighbourhood(marks @ marks.T / (N_TOP * (together + PRIOR)))


def pair_residuals(x, y, model, rng):
    """Squared Sampson errors (n, N_HYPOTHESES) of a frame pair."""
    x, y = normalized(x), normalized(y)
    order = np.argsort(rng.random((N_HYPOTHESES, len(x))), axis=1)
    sets = order[:, : MINIMAL_SIZES[model]]
    M = fit(x[sets], y[sets], model)
    Mx = np.einsum("kij,nj->nki", M, x)
    if model == "fundamental":
        Mty = np.einsum("kji,nj->nki", M, y)
        error = np.einsum("nki,ni->nk", Mx, y) ** 2
        return error / (
            (Mx[..., :2] ** 2).sum(axis=2) + (Mty[..., :2] ** 2).sum(axis=2)
        )
    C = Mx[..., :2] - y[:, None, :2] * Mx[..., 2:]
    J = M[None, :, :2, :2] - y[:, None, :2, None] * M[None, :, 2:, :2]
    a, b, c = (  # J J^T = [[a, b], [b, c]]; the second image adds w^2 to a and c
        (J[:, :, i] * J[:, :, j]).sum(axis=2) + (i == j) * Mx[..., 2] ** 2
        for i, j in ((0, 0), (0, 1), (1, 1))
    )
    quadratic = c * C[..., 0] ** 2 - 2 * b * C[..., 0] * C[..., 1] + a * C[..., 1] ** 2
    with np.errstate(divide="ignore", invalid="ignore"):  # degenerate hypotheses
        return quadratic / (a * c - b**2)


def fit(x, y, model):
    """Direct linear transform of minimal sets (K, size, 3) -> (K, 3, 3)."""
    if model == "fundamental":
        rows = (y[..., :, None] * x[..., None, :]).reshape(len(x), -1, 9)
        U, s, Vt = np.linalg.svd(null_vectors(rows).reshape(-1, 3, 3))
        s[:, 2] = 0
        return U * s[:, None] @ Vt
    zero = np.zeros_like(x)
    first = np.concatenate([x, zero, -y[..., :1] * x], axis=2)
    second = np.concatenate([zero, x, -y[..., 1:2] * x], axis=2)
    rows = np.concatenate([first, second], axis=1)
    # The last row of an affine map is (0, 0, s).
    unknown = [0, 1, 2, 3, 4, 5, 8] if model == "affine" else range(9)
    M = np.zeros((len(x), 9))
    M[:, unknown] = null_vectors(rows[..., unknown])
    return M.reshape(-1, 3, 3)


def null_vectors(rows):
    return np.linalg.svd(rows)[2][:, -1]


def normalized(x):
    """Homogeneous coordinates (n, 3): centroid 0, mean distance sqrt(2)."""
    x = x - x.mean(axis=0)
    x = x * np.sqrt(2) / np.linalg.norm(x, axis=1).mean()
    return np.column_stack([x, np.ones(len(x))])


def neighbourhood(K):
    """The affinities times the average of the mask and its transpose."""
    s = np.maximum(np.diag(K)[:, None] ** SPARSITY - K**SPARSITY, 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        p = s / s.sum(axis=1, keepdims=True)
        log_p = np.log(p)
        level = np.where(p > 0, p * log_p, 0).sum(axis=1, keepdims=True)
    mask = ~(log_p >= level)
    return K * (mask + mask.T.astype(float)) / 2


# ------------------------------------------------------------ from affinities to labels


def scaled(K):
    """``D^-1/2 K D^-1/2``."""
    root = 1 / np.sqrt(np.maximum(K.sum(axis=1), 1e-12))
    return root[:, None] * K * root


def leading(S, count):
    n = len(S)
    return scipy.linalg.eigh(S, subset_by_index=[n - count, n - 1])[1]


def cluster(graph, count, seed, fusion):
    """Labels by kernel addition (eq. 2) or co-regularisation (eq. 6)."""
    if fusion == "kernel_addition":
        U = [leading(sum(graph), count)]
    else:
        U = [leading(S, count) for S in graph]
        for _ in range(N_SWEEPS):
            for v, S in enumerate(graph):
                others = sum(U[w] @ U[w].T for w in range(len(U)) if w != v)
                U[v] = leading(S + LAM * others, count)
    features = unit_rows(np.hstack([unit_rows(each) for each in U]))
    return KMeans(count, n_init=20, random_state=seed).fit_predict(features)


def unit_rows(U):
    return U / np.maximum(np.linalg.norm(U, axis=1, keepdims=True), 1e-12)


def ncre(K, y):
    """Normalised cut and reconstruction error of a partition (eq. 9, 11)."""
    Y = np.eye(y.max() + 1)[y]
    within, volume = np.diag(Y.T @ K @ Y), Y.T @ K.sum(axis=1)
    cut = np.sum((volume - within) / np.maximum(volume, 1e-12))
    norm = np.sqrt((Y.sum(axis=0) ** 2).sum()) * np.linalg.norm(K)
    return cut + DELTA * (2 - 2 * within.sum() / norm)
