"""Synthetic walking: the built-in walk of `bench gait`, and the force under a foot."""

import numpy as np

RATE = 200.0


def vertical_force(stride_times, rate=RATE):
    """(force in N, times of the strikes): two humps of 750 N during 62 % of each stride."""
    ends = np.cumsum(stride_times)
    time = np.arange(0.0, ends[-1], 1.0 / rate)
    begins = np.concatenate(([0.0], ends))
    stride = np.searchsorted(begins, time, side="right") - 1
    stance = (time - begins[stride]) / (begins[stride + 1] - begins[stride]) / 0.62
    shape = np.sin(np.pi * stance) + 0.35 * np.sin(3.0 * np.pi * stance)
    return np.where(stance < 1.0, 750.0 * np.maximum(shape, 0.0), 0.0), begins[1:-1]
