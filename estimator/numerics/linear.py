"""Compiled solutions of small linear systems, for kernels that cannot call LAPACK at a cost that small systems bear."""

from __future__ import annotations

import math

from humanoid.support.compiled import jit


@jit
def solve_definite(A, rows, n, floor, L, x):  # type: ignore[no-untyped-def]
    """Solve B y = x by Cholesky, in place of x: B is A at the leading n of `rows` and of the columns of the same names.

    A (N, N), rows (N,) int, x (n,). Only the lower triangle of B is read; L (N, N), n x n at least, is filled with its
    factor, and may be A itself. A pivot (a square of a diagonal entry of the factor) below `floor` becomes `floor`.
    With a floor of 0 the matrix has to be positive definite: False, with x as it was, where it is not.
    """
    for a in range(n):
        i = rows[a]
        for b in range(a + 1):
            t = A[i, rows[b]]
            for c in range(b):
                t -= L[a, c] * L[b, c]
            if a == b:
                if t <= floor:
                    if floor == 0.0:
                        return False
                    t = floor
                L[a, a] = math.sqrt(t)
            else:
                L[a, b] = t / L[b, b]
    for a in range(n):
        t = x[a]
        for b in range(a):
            t -= L[a, b] * x[b]
        x[a] = t / L[a, a]
    for a in range(n - 1, -1, -1):
        t = x[a]
        for b in range(a + 1, n):
            t -= L[b, a] * x[b]
        x[a] = t / L[a, a]
    return True


@jit
def eliminate(K, x):  # type: ignore[no-untyped-def]
    """Solve K y = x in place of x (n,), K (n, n) being used up, by Gaussian elimination with partial pivoting; False
    if K is singular."""
    n = x.shape[0]
    for k in range(n):
        p = k
        for i in range(k + 1, n):
            if abs(K[i, k]) > abs(K[p, k]):
                p = i
        if abs(K[p, k]) < 1e-300:
            return False
        if p != k:
            for j in range(n):
                K[k, j], K[p, j] = K[p, j], K[k, j]
            x[k], x[p] = x[p], x[k]
        for i in range(k + 1, n):
            w = K[i, k] / K[k, k]
            if w != 0.0:
                for j in range(k, n):
                    K[i, j] -= w * K[k, j]
                x[i] -= w * x[k]
    for k in range(n - 1, -1, -1):
        for j in range(k + 1, n):
            x[k] -= K[k, j] * x[j]
        x[k] /= K[k, k]
    return True
