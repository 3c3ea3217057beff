"""Recorded curves that repeat."""

from __future__ import annotations

import numpy as np

from blocks.wearer.mechanics import Real


def end_of(angles: Real, seam: int) -> int:
    """Return the number of samples after which the angles best continue with their beginning."""
    last = len(angles) - seam
    first = max(last // 2, last - 4 * 2 * seam)
    misfit = [np.sum((angles[k : k + seam] - angles[:seam]) ** 2) for k in range(first, last + 1)]
    return first + int(np.argmin(misfit))


def closed(curve: np.ndarray, cut: int, seam: int) -> np.ndarray:
    """Return a curve that ends at `cut` and is faded into its beginning over `seam` samples."""
    x = np.arange(seam) / seam
    fade = (x**3 * (10.0 - 15.0 * x + 6.0 * x**2)).reshape(seam, *[1] * (curve.ndim - 1))
    return np.concatenate([(1.0 - fade) * curve[cut : cut + seam] + fade * curve[:seam], curve[seam:cut]])


def smooth(curve: Real, dt: float, cutoff: float) -> tuple[Real, Real]:
    """Return (values, rates) of a curve that repeats, below a frequency in Hz."""
    frequencies = np.fft.rfftfreq(len(curve), dt)
    waves = np.fft.rfft(curve) / (1.0 + (frequencies / cutoff) ** 8)
    return np.fft.irfft(waves, len(curve)), np.fft.irfft(2j * np.pi * frequencies * waves, len(curve))


def integral(rate: Real, dt: float) -> Real:
    """Return the integral of a rate that repeats, less its mean, without a mean."""
    frequencies = np.fft.rfftfreq(len(rate), dt)
    waves = np.fft.rfft(rate)
    waves[0] = 0.0
    waves[1:] /= 2j * np.pi * frequencies[1:]
    return np.fft.irfft(waves, len(rate))


def moving_average(curve: Real, width: int) -> Real:
    """Return the average over `width` samples of a curve that repeats."""
    width = max(1, width)
    padded = np.pad(curve, width, mode="wrap")
    return np.convolve(padded, np.full(width, 1.0 / width), mode="same")[width:-width]
