"""Compiled solutions of small linear systems, for kernels that cannot call LAPACK at a cost that small systems bear."""

from __future__ import annotations

import math

import numpy as np

from humanoid.support.compiled import jit


@jit
def solve_definite(A, rows, n, floor, L, x):  # type: ignore[no-untyped-def]
    """Solve B y = x by Cholesky, in place of x: B is A at the leading n of `rows` and of the columns of the same names.

    A (N, N), rows (N,) int, rising where L is A, x (n,). Only the lower triangle of B is read; L (N, N), n x n at
    least, is filled with its factor, and may be A itself. A pivot (a square of a diagonal entry of the factor) below
    `floor` becomes `floor`. With a floor of 0 the matrix has to be positive definite: False, with x as it was, where it
    is not.
    """
    if not _factor_block(A, rows, n, floor, L):
        return False
    _solve_forward(L, 0, x[:n])
    for a in range(n - 1, -1, -1):
        t = x[a]
        for b in range(a + 1, n):
            t -= L[b, a] * x[b]
        x[a] = t / L[a, a]
    return True


@jit
def inverse_entries(M, some, m, L, Y, S):  # type: ignore[no-untyped-def]
    """Fill the leading m x m of S (m, m) with the entries of M^-1 at m rows and columns `some` (m,), by M (n, n)'s
    Cholesky factor; False where M is not positive definite. L (n, n), Y (m, n): overwritten."""
    n = M.shape[0]
    if not _factor_block(M, np.arange(n), n, 0.0, L):
        return False
    for k in range(m):  # L^-1 e_k, zero before row k
        Y[k] = 0.0
        Y[k, some[k]] = 1.0
        _solve_forward(L, some[k], Y[k])
    for a in range(m):
        for b in range(m):
            t = 0.0
            for i in range(n):
                t += Y[a, i] * Y[b, i]
            S[a, b] = t
    return True


@jit
def invert_definite(A, rows, n, L, X, inverse):  # type: ignore[no-untyped-def]
    """Fill the entries of `inverse` (N, N) at the leading n of `rows` (N,) and of the columns of the same names with
    the inverse of A (N, N) there; False, with nothing filled, where that block is not positive definite.

    L, X (N, N): overwritten with the block's Cholesky factor and the inverse of that, row by row, along many numbers.
    """
    if not _factor_block(A, rows, n, 0.0, L):
        return False
    for a in range(n):
        row = X[a]
        row[:n] = 0.0
        for c in range(a):
            f, other = L[a, c], X[c]
            for k in range(c + 1):
                row[k] -= f * other[k]
        for k in range(a):
            row[k] /= L[a, a]
        row[a] = 1.0 / L[a, a]
    for a in range(n):  # the factor is done with: its room takes the product X' X
        L[a][: a + 1] = 0.0
    for r in range(n):
        row = X[r]
        for a in range(r + 1):
            f, target = row[a], L[a]
            for k in range(a + 1):
                target[k] += f * row[k]
    for a in range(n):
        for b in range(a + 1):
            inverse[rows[a], rows[b]] = inverse[rows[b], rows[a]] = L[a, b]
    return True


@jit
def _factor_block(A, rows, n, floor, L):  # type: ignore[no-untyped-def]
    """Fill the lower triangle of the leading n x n of L (N, N) with the factor of A (N, N) at the leading n of rows
    (N,) and of the columns of the same names; see `solve_definite`."""
    for a in range(n):
        i = rows[a]
        for b in range(a + 1):
            L[a, b] = A[i, rows[b]]
    return _factor(L, n, floor)


@jit
def _solve_forward(L, first, x):  # type: ignore[no-untyped-def]
    """Replace x (n,), zero before `first`, by L^-1 x, L (N, N) lower triangular."""
    for a in range(first, x.shape[0]):
        t = x[a]
        for b in range(first, a):
            t -= L[a, b] * x[b]
        x[a] = t / L[a, a]


@jit
def _factor(L, n, floor):  # type: ignore[no-untyped-def]
    """Replace the lower triangle of the leading n x n of L (N, N) by its Cholesky factor; see `solve_definite`.

    Two columns of four rows at a time: eight sums that do not wait for each other, each in the order in which a single
    one would be taken, so that the factor is the same to the bit.
    """
    for b in range(0, n - 1, 2):
        left, right = L[b], L[b + 1]
        own, side, beyond = left[b], right[b], right[b + 1]
        for c in range(b):
            own -= left[c] * left[c]
            side -= right[c] * left[c]
            beyond -= right[c] * right[c]
        first = _pivot(own, floor)
        side /= first
        second = _pivot(beyond - side * side, floor)
        if first == 0.0 or second == 0.0:
            return False
        left[b], right[b], right[b + 1] = first, side, second
        a = b + 2
        while a + 4 <= n:
            r0, r1, r2, r3 = L[a], L[a + 1], L[a + 2], L[a + 3]
            t0, t1, t2, t3 = r0[b], r1[b], r2[b], r3[b]
            u0, u1, u2, u3 = r0[b + 1], r1[b + 1], r2[b + 1], r3[b + 1]
            for c in range(b):
                f, g = left[c], right[c]
                x0, x1, x2, x3 = r0[c], r1[c], r2[c], r3[c]
                t0, t1, t2, t3 = t0 - x0 * f, t1 - x1 * f, t2 - x2 * f, t3 - x3 * f
                u0, u1, u2, u3 = u0 - x0 * g, u1 - x1 * g, u2 - x2 * g, u3 - x3 * g
            t0, t1, t2, t3 = t0 / first, t1 / first, t2 / first, t3 / first
            r0[b], r1[b], r2[b], r3[b] = t0, t1, t2, t3
            r0[b + 1], r1[b + 1] = (u0 - t0 * side) / second, (u1 - t1 * side) / second
            r2[b + 1], r3[b + 1] = (u2 - t2 * side) / second, (u3 - t3 * side) / second
            a += 4
        for d in range(a, n):
            row = L[d]
            t, u = row[b], row[b + 1]
            for c in range(b):
                t -= row[c] * left[c]
                u -= row[c] * right[c]
            t /= first
            row[b], row[b + 1] = t, (u - t * side) / second
    if n % 2:
        last = L[n - 1]
        own = last[n - 1]
        for c in range(n - 1):
            own -= last[c] * last[c]
        last[n - 1] = _pivot(own, floor)
        return last[n - 1] != 0.0
    return True


@jit
def _pivot(square, floor):  # type: ignore[no-untyped-def]
    """A diagonal entry of the factor; 0 where it has none."""
    return math.sqrt(floor if square <= floor else square)


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
