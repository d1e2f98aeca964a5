"""The textbook once more, in fifty digits: what there is left to see is the package's.

Numbers go in as the doubles they are. Only what double precision can get wrong is here:
fits of nearly degenerate sets, errors of distances, ranks, and sums of many magnitudes.
"""

from __future__ import annotations

import mpmath as mp
import numpy as np

DIGITS = 50


def exact(array):
    """A matrix of the doubles as they are."""
    return mp.matrix(np.asarray(array, dtype=float).tolist())


def to_double(matrix):
    return np.array(matrix.tolist(), dtype=float)


def null_vector(rows):
    """The right singular vector of the least singular value of a wide matrix.

    Returns
    -------
    vector : mpmath.matrix of shape (n, 1)
    condition : float
        Largest over least singular value that is not that of the null space.
    """
    with mp.workdps(DIGITS):
        n = rows.cols
        square = mp.matrix(n, n)  # zero rows change neither vector nor values
        for i in range(rows.rows):
            square[i, :] = rows[i, :]
        _, values, right = mp.svd_r(square)
        return right[n - 1, :].T, float(values[0] / values[n - 2])


def _rows(name, x, y):
    """The equations of the direct linear transform, as in the textbook."""
    rows = []
    for (x0, x1), (y0, y1) in zip(x.tolist(), y.tolist(), strict=True):
        x0, x1, y0, y1 = map(mp.mpf, (x0, x1, y0, y1))
        if name == "affine":
            rows.append([x0, x1, 1, 0, 0, 0, -y0])
            rows.append([0, 0, 0, x0, x1, 1, -y1])
        elif name == "homography":
            rows.append([0, 0, 0, -x0, -x1, -1, y1 * x0, y1 * x1, y1])
            rows.append([x0, x1, 1, 0, 0, 0, -y0 * x0, -y0 * x1, -y0])
        else:
            rows.append([y0 * x0, y0 * x1, y0, y1 * x0, y1 * x1, y1, x0, x1, 1])
    return mp.matrix(rows)


def fit(name, x, y):
    """The model (3, 3) through a minimal set, unit norm, and how ill-conditioned it is.

    A fundamental matrix comes as the equations have it, before its rank is two.
    """
    with mp.workdps(DIGITS):
        vector, condition = null_vector(_rows(name, x, y))
        if name == "affine":
            vector = mp.matrix([*vector[:6], 0, 0, vector[6]])
        model = to_double(vector).reshape(3, 3)
    return model / np.linalg.norm(model), condition


def rank_two(F):
    """The nearest matrix of rank 2, at unit norm."""
    with mp.workdps(DIGITS):
        U, values, Vt = mp.svd_r(exact(F))
        nearest = to_double(U * mp.diag([values[0], values[1], 0]) * Vt)
    return nearest / np.linalg.norm(nearest)


def sampson_distance(name, M, x, y):
    """The root of the squared Sampson error of one track, (2,) and (2,)."""
    with mp.workdps(DIGITS):
        M = exact(M)
        X, Y = mp.matrix([*x.tolist(), 1]), mp.matrix([*y.tolist(), 1])
        MX = M * X
        if name == "fundamental":
            back = M.T * Y
            squared = MX[0] ** 2 + MX[1] ** 2 + back[0] ** 2 + back[1] ** 2
            return float(abs((Y.T * MX)[0]) / mp.sqrt(squared))
        if name == "affine":
            J = mp.matrix([[M[0, 0], M[0, 1], -1, 0], [M[1, 0], M[1, 1], 0, -1]])
        else:
            J = mp.matrix(2, 4)
            for i in (0, 1):
                for j in (0, 1):
                    J[i, j] = M[i, j] - Y[i] * M[2, j]
                J[i, 2 + i] = -MX[2]
        C = mp.matrix([MX[i] - Y[i] * MX[2] for i in (0, 1)])
        return float(mp.sqrt((C.T * mp.inverse(J * J.T) * C)[0]))


def kept_neighbours(row, own, alpha):
    """How far each entry of a row is above the level of the epsilon-neighbourhood.

    ``level - log p_j``: an entry stays where that is positive. None where nothing in
    the row differs from ``own``.
    """
    with mp.workdps(DIGITS):
        s = [mp.mpf(own) ** alpha - mp.mpf(a) ** alpha for a in row.tolist()]
        total = mp.fsum(s)
        if total == 0:
            return None
        p = [s_j / total for s_j in s]
        level = mp.fsum(p_k * mp.log(p_k) for p_k in p if p_k > 0)
        return np.array(
            [float(level - mp.log(p_j)) if p_j > 0 else np.inf for p_j in p]
        )


def normalized_cut(K, labels):
    """``sum_m cut(A_m, rest) / vol(A_m)``."""
    with mp.workdps(DIGITS):
        cost, K = mp.mpf(0), exact(K)
        everyone = range(K.rows)
        for m in range(max(labels) + 1):
            rows = [i for i in everyone if labels[i] == m]
            volume = mp.fsum(K[i, j] for i in rows for j in everyone)
            cut = mp.fsum(K[i, j] for i in rows for j in everyone if labels[j] != m)
            cost += cut / volume if volume > 0 else 0
        return float(cost)


def reconstruction_error(K, labels):
    """``|W / |W| - K / |K||^2``, ``W = X X^T``."""
    with mp.workdps(DIGITS):
        K, n = exact(K), len(labels)
        together = {
            (i, j) for i in range(n) for j in range(n) if labels[i] == labels[j] >= 0
        }
        K_norm = mp.sqrt(mp.fsum(K[i, j] ** 2 for i in range(n) for j in range(n)))
        W_norm = mp.sqrt(len(together))
        return float(
            mp.fsum(
                (((i, j) in together) / W_norm - K[i, j] / K_norm) ** 2
                for i in range(n)
                for j in range(n)
            )
        )


def leading_projection(K, n_vectors):
    """``U U^T`` of the leading eigenvectors of the normalised affinity, and its values.

    Returns
    -------
    projection : ndarray of shape (n, n)
    values : ndarray of shape (n,)
        All eigenvalues, the largest first.
    """
    with mp.workdps(DIGITS):
        K, n = exact(K), len(K)
        degrees = [mp.fsum(K[i, j] for j in range(n)) for i in range(n)]
        N = mp.matrix(n, n)
        for i in range(n):
            for j in range(n):
                if degrees[i] > 0 and degrees[j] > 0:
                    N[i, j] = K[i, j] / mp.sqrt(degrees[i] * degrees[j])
        values, vectors = mp.eigsy(N)
        U = vectors[:, n - n_vectors : n]
        return to_double(U * U.T), to_double(values)[::-1].ravel()
