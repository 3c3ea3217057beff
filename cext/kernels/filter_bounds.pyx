# cython: freethreading_compatible=True
"""Output bounds of a linear system for the range proof: sums over its impulse response.

Runs when a diagram is compiled, not in the tick.
"""

import numpy as np

from libc.math cimport fabs


def impulse_sums(double[:, ::1] A, double[:, ::1] E, double[:, ::1] C, double share=1e-9, double work=5e8):
    """Return sums over k >= 0 of Y(k) = C A^k [I E], the impulse responses from each state and from each column of E.

    Principle: 1. X = A^k [I E] is stepped, and the positive and negative parts of C X are summed; 2. with W the sums
    of |C A^j| so far, the sums from step k on are at most (W + rest) |A^k|; once W |A^k| <= share W in every element,
    rest <= share W / (1 - share), which bounds the remainder of every column.

    Parameters
    ----------
    A, E, C : (n, n), (n, m), (p, n)
    share : upper bound of the remainder, as a fraction of the sum
    work : upper limit of the number of multiplications

    Returns
    -------
    positive, negative : (p, n + m), sums of the parts above and below zero, remainder included in both
    highest, lowest : (p, n + m), largest and smallest element of Y(k), 0 included
    states : (n, n + m), sums of |X|
    steps : number of steps taken
    None if the remainder did not become small: the system is unstable, or too slow for `work`.
    """
    cdef Py_ssize_t n = A.shape[0], m = E.shape[1], p = C.shape[0]
    cdef Py_ssize_t columns = n + m
    cdef Py_ssize_t i, j, c
    cdef long long step, most
    cdef double a, value, rest
    cdef bint small = False
    cdef double[:, ::1] x = np.hstack([np.eye(n), np.asarray(E)])
    cdef double[:, ::1] following = np.zeros((n, columns))
    cdef double[:, ::1] y = np.zeros((p, columns))
    cdef double[:, ::1] positive = np.zeros((p, columns))
    cdef double[:, ::1] negative = np.zeros((p, columns))
    cdef double[:, ::1] highest = np.zeros((p, columns))
    cdef double[:, ::1] lowest = np.zeros((p, columns))
    cdef double[:, ::1] states = np.zeros((n, columns))
    most = <long long>(work / (columns * (n * (n + p) + 1)))
    step = 0
    while step < most and not small:
        for i in range(p):
            for c in range(columns):
                y[i, c] = 0.0
            for j in range(n):
                a = C[i, j]
                if a != 0.0:
                    for c in range(columns):
                        y[i, c] += a * x[j, c]
            for c in range(columns):
                value = y[i, c]
                if value > 0.0:
                    positive[i, c] += value
                    if value > highest[i, c]:
                        highest[i, c] = value
                else:
                    negative[i, c] -= value
                    if value < lowest[i, c]:
                        lowest[i, c] = value
        for i in range(n):
            for c in range(columns):
                following[i, c] = 0.0
                states[i, c] += fabs(x[i, c])
            for j in range(n):
                a = A[i, j]
                if a != 0.0:
                    for c in range(columns):
                        following[i, c] += a * x[j, c]
        x, following = following, x
        step += 1
        if step < n or (step & 31 and step > 64):
            continue
        small = True
        for i in range(p):
            for c in range(n):
                rest = 0.0
                for j in range(n):
                    rest += (positive[i, j] + negative[i, j]) * fabs(x[j, c])
                if not rest <= share * (positive[i, c] + negative[i, c]):
                    small = False
    if not small:
        return None
    whole = np.asarray(positive)[:, :n] + np.asarray(negative)[:, :n]
    remainder = whole / (1.0 - share) @ np.abs(np.asarray(x))
    return (
        np.asarray(positive) + remainder, np.asarray(negative) + remainder, np.asarray(highest) + remainder,
        np.asarray(lowest) - remainder, np.asarray(states), step,
    )
