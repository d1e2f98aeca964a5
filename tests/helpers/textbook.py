"""The method once more, as the paper writes it: loops, and nothing clever.

The tests hold the package against this. Everything here is written from the equations
of Xu, Cheong and Li (2021), of Hartley and Zisserman (2004) and of those named below,
for one track, one hypothesis or one pair of tracks at a time, and calls nothing of the
package.
"""

from __future__ import annotations

import math

import numpy as np

# ------------------------------------------------- hypotheses (sec. 3.1 of the paper)


def normalization(points):
    """Hartley's map to centroid 0 and mean distance sqrt(2), for points (n, 2)."""
    n = len(points)
    cx = sum(px for px, _ in points) / n
    cy = sum(py for _, py in points) / n
    distance = sum(math.hypot(px - cx, py - cy) for px, py in points) / n
    s = math.sqrt(2) / distance
    return np.array([[s, 0, -s * cx], [0, s, -s * cy], [0, 0, 1]])


def transform(T, point):
    """A point (2,) through a 3x3 map."""
    u, v, w = T @ np.array([point[0], point[1], 1.0])
    return np.array([u / w, v / w])


def null_vector(rows):
    """The right singular vector of the smallest singular value."""
    return np.linalg.svd(np.array(rows))[2][-1]


def fit_affine(x, y):
    """DLT: ``s y = A x`` with the last row of A equal to (0, 0, s)."""
    rows = []
    for (x0, x1), (y0, y1) in zip(x, y, strict=True):
        rows.append([x0, x1, 1, 0, 0, 0, -y0])
        rows.append([0, 0, 0, x0, x1, 1, -y1])
    a = null_vector(rows)
    return np.array([a[0:3], a[3:6], [0, 0, a[6]]]) / a[6]


def fit_homography(x, y):
    """DLT: the first two components of ``y x (H x) = 0``."""
    rows = []
    for (x0, x1), (y0, y1) in zip(x, y, strict=True):
        rows.append([0, 0, 0, -x0, -x1, -1, y1 * x0, y1 * x1, y1])
        rows.append([x0, x1, 1, 0, 0, 0, -y0 * x0, -y0 * x1, -y0])
    return null_vector(rows).reshape(3, 3)


def fit_fundamental(x, y):
    """DLT: ``y^T F x = 0``, then the nearest F of rank 2."""
    rows = [
        [y0 * x0, y0 * x1, y0, y1 * x0, y1 * x1, y1, x0, x1, 1]
        for (x0, x1), (y0, y1) in zip(x, y, strict=True)
    ]
    U, s, Vt = np.linalg.svd(null_vector(rows).reshape(3, 3))
    return U @ np.diag([s[0], s[1], 0]) @ Vt


FITS = {
    "affine": fit_affine,
    "homography": fit_homography,
    "fundamental": fit_fundamental,
}


def hypothesis(name, x, y, chosen):
    """The model of pixels through the chosen tracks.

    ``x`` and ``y`` (n, 2) are all points that both frames see: they set the normalised
    coordinates.
    """
    S, T = normalization(x), normalization(y)
    M = FITS[name](
        [transform(S, x[i]) for i in chosen], [transform(T, y[i]) for i in chosen]
    )
    if name == "fundamental":
        return T.T @ M @ S
    return np.linalg.inv(T) @ M @ S


# -------------------------------------------------- squared Sampson errors (sec. 3.2)


def sampson(C, J):
    """``C^T (J J^T)^-1 C`` for constraints C with Jacobian J (HZ eq. 4.12)."""
    return C @ np.linalg.inv(J @ J.T) @ C


def sampson_affine(A, x, y):
    (x0, x1), (y0, y1) = x, y
    C = np.array(
        [
            A[0, 0] * x0 + A[0, 1] * x1 + A[0, 2] - y0,
            A[1, 0] * x0 + A[1, 1] * x1 + A[1, 2] - y1,
        ]
    )
    J = np.array(  # derivatives by x0, x1, y0, y1
        [
            [A[0, 0], A[0, 1], -1, 0],
            [A[1, 0], A[1, 1], 0, -1],
        ]
    )
    return sampson(C, J)


def sampson_homography(H, x, y):
    (x0, x1), (y0, y1) = x, y
    u = H[0, 0] * x0 + H[0, 1] * x1 + H[0, 2]
    v = H[1, 0] * x0 + H[1, 1] * x1 + H[1, 2]
    w = H[2, 0] * x0 + H[2, 1] * x1 + H[2, 2]
    C = np.array([u - y0 * w, v - y1 * w])
    J = np.array(  # derivatives by x0, x1, y0, y1
        [
            [H[0, 0] - y0 * H[2, 0], H[0, 1] - y0 * H[2, 1], -w, 0],
            [H[1, 0] - y1 * H[2, 0], H[1, 1] - y1 * H[2, 1], 0, -w],
        ]
    )
    return sampson(C, J)


def sampson_fundamental(F, x, y):
    """HZ eq. 11.9."""
    x, y = np.array([*x, 1.0]), np.array([*y, 1.0])
    Fx, Fty = F @ x, F.T @ y
    return (y @ F @ x) ** 2 / (Fx[0] ** 2 + Fx[1] ** 2 + Fty[0] ** 2 + Fty[1] ** 2)


SAMPSON = {
    "affine": sampson_affine,
    "homography": sampson_homography,
    "fundamental": sampson_fundamental,
}


def residuals(name, models, x, y):
    """All tracks to all models: (K, 3, 3), (n, 2), (n, 2) -> (n, K)."""
    return np.array(
        [[SAMPSON[name](M, a, b) for M in models] for a, b in zip(x, y, strict=True)]
    )


# ----------------------------------------------- the ordered residual kernel (sec. 3.2)


def top_hypotheses(group, n_top):
    """Positions of the ``n_top`` smallest residuals of a frame pair; ties by position.

    None where the track is unseen.
    """
    if any(math.isnan(r) for r in group):
        return None
    order = sorted(range(len(group)), key=lambda k: (group[k], k))
    return set(order[:n_top])


def ordered_residual_kernel(R, n_hypotheses, n_top, prior):
    """``k_ij / (n_top (c_ij + prior))``: hypotheses and frame pairs i and j share."""
    n, n_pairs = len(R), R.shape[1] // n_hypotheses
    tops = [
        [
            top_hypotheses(row[p * n_hypotheses : (p + 1) * n_hypotheses], n_top)
            for p in range(n_pairs)
        ]
        for row in R.tolist()
    ]
    K = np.zeros((n, n))
    for i in range(n):
        for j in range(n):
            shared, pairs = 0, 0
            for p in range(n_pairs):
                if tops[i][p] is not None and tops[j][p] is not None:
                    shared += len(tops[i][p] & tops[j][p])
                    pairs += 1
            if pairs > 0:
                K[i, j] = shared / (n_top * (pairs + prior))
    return K


# ---------------------------------------- the epsilon-neighbourhood (Lai et al. 2017)


def neighbours(row, own, alpha):
    """Which entries of a row stay: those with ``log p_j < sum_k p_k log p_k``.

    ``own`` is the track's affinity to itself, the largest of the row. A constant row,
    0/0 in the equations, keeps all.
    """
    s = [own**alpha - a**alpha for a in row]
    if sum(s) == 0:
        return [True] * len(row)
    p = [s_j / sum(s) for s_j in s]
    level = sum(p_k * math.log(p_k) for p_k in p if p_k > 0)
    return [p_j == 0 or math.log(p_j) < level for p_j in p]


def epsilon_neighbourhood(K, alpha):
    """The affinities times the average of the mask and its transpose."""
    mask = [neighbours(row, row[i], alpha) for i, row in enumerate(K.tolist())]
    sparse = np.zeros_like(K)
    for i in range(len(K)):
        for j in range(len(K)):
            sparse[i, j] = K[i, j] * (mask[i][j] + mask[j][i]) / 2
    return sparse


# ------------------------------------------------- fusions (sec. 3.3): one U for a view


def laplacian(K):
    """``I - D^-1/2 K D^-1/2``; a row without affinity has no neighbour in it."""
    n = len(K)
    degree = [sum(K[i]) for i in range(n)]
    L = np.eye(n)
    for i in range(n):
        for j in range(n):
            if degree[i] > 0 and degree[j] > 0:
                L[i, j] -= K[i, j] / math.sqrt(degree[i] * degree[j])
    return L


def first_eigenvectors(L, n_clusters):
    return np.linalg.eigh(L)[1][:, :n_clusters]


def kernel_addition(kernels, n_clusters):
    """Eq. 2: one embedding for the sum of the Laplacians."""
    U = first_eigenvectors(sum(laplacian(K) for K in kernels), n_clusters)
    return [U for _ in kernels]


def co_regularization(kernels, n_clusters, lam, n_sweeps):
    """Eq. 3, by its alternation (eq. 6): ``L_v - lam sum_{w != v} U_w U_w^T``."""
    L = [laplacian(K) for K in kernels]
    U = [first_eigenvectors(L_v, n_clusters) for L_v in L]
    for _ in range(n_sweeps):
        for v in range(len(L)):
            others = [U[w] @ U[w].T for w in range(len(L)) if w != v]
            U[v] = first_eigenvectors(L[v] - lam * sum(others), n_clusters)
    return U


def subset_constraint(kernels, n_clusters, gamma, n_sweeps):
    """Algorithm 1, with the constraint matrices of eq. 5."""
    L = [laplacian(K) for K in kernels]
    U = [first_eigenvectors(L_v, n_clusters) for L_v in L]
    n = len(kernels[0])
    for _ in range(n_sweeps):
        for v in range(len(L)):
            Q = np.zeros((n, n))
            if v > 0:  # what the simpler model joins
                simpler = U[v - 1] @ U[v - 1].T
                Q += (simpler > 0) * simpler
            if v < len(L) - 1:  # what the richer model keeps apart
                richer = U[v + 1] @ U[v + 1].T
                Q += (richer < 0) * richer
            U[v] = first_eigenvectors(L[v] - gamma * Q, n_clusters)
    return U


# ------------------------------------------------------------- model selection (sec. 4)


def normalized_cut(K, labels):
    """First line of eq. 11: ``sum_m cut(A_m, rest) / vol(A_m)``."""
    cost = 0.0
    for m in range(max(labels) + 1):
        cut, volume = 0.0, 0.0
        for i in range(len(K)):
            for j in range(len(K)):
                if labels[i] == m:
                    volume += K[i, j]
                    if labels[j] != m:
                        cut += K[i, j]
        cost += cut / volume
    return cost


def reconstruction_error(K, labels):
    """First line of eq. 9: ``|W / |W| - K / |K||^2`` (Frobenius), ``W = X X^T``."""
    n = len(K)
    W = [
        [1.0 if labels[i] == labels[j] >= 0 else 0.0 for j in range(n)]
        for i in range(n)
    ]
    W_norm = math.sqrt(sum(w * w for row in W for w in row))
    K_norm = math.sqrt(sum(k * k for row in K for k in row))
    return sum(
        (W[i][j] / W_norm - K[i, j] / K_norm) ** 2 for i in range(n) for j in range(n)
    )


def ncre_costs(kernels, labels, delta):
    """Eq. 13: normalised cut, reconstruction error and total, summed over views.

    The total has the reconstruction error whole; the paper's drops the constant 2.
    """
    cut = sum(normalized_cut(K, labels) for K in kernels)
    error = sum(reconstruction_error(K, labels) for K in kernels)
    return cut, error, cut + delta * error


# ------------------------------------------------------ other choices of the number


def eigengaps(kernels, counts):
    """``lambda_{k+1} - lambda_k`` of the mean Laplacian (von Luxburg 2007, 8.3)."""
    mean = sum(laplacian(K) for K in kernels) / len(kernels)
    values = sorted(np.linalg.eigvalsh(mean).tolist())
    return [values[k] - values[k - 1] for k in counts]


def alignment_cost(Z):
    """``sum_ij Z_ij^2 / M_i^2`` (Zelnik-Manor and Perona 2004, sec. 3)."""
    cost = 0.0
    for row in Z:
        greatest = max(abs(z) for z in row)
        for z in row:
            cost += z**2 / greatest**2
    return cost


def givens(n, i, j, angle):
    """Turns the plane of the axes i and j."""
    G = np.eye(n)
    G[i, i] = G[j, j] = math.cos(angle)
    G[i, j], G[j, i] = math.sin(angle), -math.sin(angle)
    return G


def least_alignment_cost(X, n_angles):
    """The least cost of all products of Givens rotations at angles of a grid."""
    n = len(X[0])
    angles = [math.pi * step / n_angles for step in range(n_angles)]
    rotated = [X]
    for i in range(n - 1):
        for j in range(i + 1, n):
            rotated = [Z @ givens(n, i, j, angle) for Z in rotated for angle in angles]
    return min(alignment_cost(Z.tolist()) for Z in rotated)
