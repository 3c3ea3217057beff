"""Plant models: limbs and their wearers."""

from __future__ import annotations

import csv
import math
from textwrap import shorten

import numpy as np

from cext.kernels import models as kernels
from graph import Block, Input, Memory, Output, Param

# Knee flexion in degrees at every 5 % of an average stride of an adult at natural cadence, from heel strike.
# (Winter, The Biomechanics and Motor Control of Human Gait, 2nd ed. 1991, digitised and rounded.)
KNEE_FLEXION = (4, 9, 15, 18, 17, 14, 11, 8, 6, 7, 12, 21, 35, 50, 60, 62, 56, 42, 24, 9)


class Limb(Block):
    """Joint moved by its wearer and a drive: I (α − α₀) = τ + K (θ₀ − θ) + B (ω₀ − ω) − d (ω − ω₀).

    The wearer follows the intended motion θ₀, ω₀, α₀ with a spring and a damper; τ is the torque of the drive. Without
    a wearer (stiffness and reflex 0) the joint is a free inertia. Below `lower`, ligaments of stiffness `ligament`
    limit the motion, as in a straight knee. Semi-implicit Euler; no direct feedthrough.
    """

    inertia = Param(0.35, "kg·m²", "moment of inertia I; the default is shank and foot about the knee", above=0.0)
    damping = Param(1.0, "N·m·s/rad", "damping d of the tissue", min=0.0)
    stiffness = Param(120.0, "N·m/rad", "stiffness K of the wearer", min=0.0)
    reflex = Param(8.0, "N·m·s/rad", "damping B of the wearer's reflexes", min=0.0)
    start = Param(0.0, "rad", "initial angle", fixed=True)
    lower = Param(-math.inf, "rad", "angle below which the ligaments pull")
    ligament = Param(500.0, "N·m/rad", "stiffness of the ligaments", min=0.0)

    torque = Input("N·m", "torque of the drive", default=0.0)
    angle = Input("rad", "intended angle θ₀ of the wearer", default=0.0)
    rate = Input("rad/s", "intended velocity ω₀ of the wearer", default=0.0)
    acceleration = Input("rad/s²", "intended acceleration α₀ of the wearer", default=0.0)
    position = Output("rad", "joint angle θ")
    velocity = Output("rad/s", "joint velocity ω")
    state = Memory((0.0, 0.0), "angle θ and velocity ω")

    kernel = kernels.limb
    update_kernel = kernels.limb_next
    feedthrough = ()

    def configure(self) -> None:
        self.state = (self.start, 0.0)


class WalkingKnee(Block):
    """Knee flexion of an average walking adult, a Fourier series over the stride.   (Winter 1991)

    The attribute `at_start` is the angle at t = 0 in rad. No state.
    """

    stride_time = Param(1.1, "s", "duration of a stride", above=0.0)
    start = Param(0.0, "1", "gait phase at t = 0: 0 for one leg, 0.5 for the other")
    harmonics = Param(6, "1", "number of harmonics of the stride frequency", min=1, max=9, fixed=True)

    angle = Output("rad", "knee flexion")
    velocity = Output("rad/s", "knee flexion velocity")
    acceleration = Output("rad/s²", "knee flexion acceleration")
    mean = Memory(0.0, "mean angle")
    cosines = Memory(0.0, "cosine coefficient of each harmonic")
    sines = Memory(0.0, "sine coefficient of each harmonic")

    kernel = kernels.fourier

    def configure(self) -> None:
        spectrum = np.fft.rfft(np.radians(KNEE_FLEXION)) / len(KNEE_FLEXION)
        self.mean = spectrum[0].real
        self.cosines = 2.0 * spectrum[1 : self.harmonics + 1].real
        self.sines = -2.0 * spectrum[1 : self.harmonics + 1].imag
        turn = 2.0 * np.pi * self.start * np.arange(1, self.harmonics + 1)
        self.at_start = float(self.mean + self.cosines @ np.cos(turn) + self.sines @ np.sin(turn))


class RecordedKnee(Block):
    """Recorded knee flexion, repeated: a column in degrees of a CSV file with a column `time` in s.

    Linear interpolation between samples. The recording is cut within its last two seconds where it best matches its
    beginning, so that it repeats stride by stride with a small step at the seam. A recording shorter than four seconds
    is repeated in full. The attribute `at_start` is the angle at t = 0 in rad.
    """

    file = Param("", "1", "path of the CSV file", required=True, dtype=str, file=True)
    column = Param("", "1", "name of the column, in degrees", required=True, dtype=str)

    angle = Output("rad", "knee flexion")
    velocity = Output("rad/s", "knee flexion velocity")
    acceleration = Output("rad/s²", "knee flexion acceleration")
    rate = Memory(0.0, "samples per second")
    angles = Memory(0.0, "angle of each sample in rad")
    velocities = Memory(0.0, "velocity of each sample in rad/s")
    accelerations = Memory(0.0, "acceleration of each sample in rad/s²")

    kernel = kernels.playback

    def configure(self) -> None:
        times, angles = read_column(self.file, self.column)
        self.rate = (len(times) - 1) / (times[-1] - times[0])
        velocities = np.gradient(angles, 1.0 / self.rate)
        end = seam(angles, int(self.rate))
        self.angles, self.velocities = angles[:end], velocities[:end]
        self.accelerations = np.gradient(velocities, 1.0 / self.rate)[:end]
        self.at_start = float(angles[0])


def read_column(file: str, column: str) -> tuple[np.ndarray, np.ndarray]:
    """Read (times in s, angles in rad) from a CSV file of at least 100 evenly spaced samples.

    ValueError or OSError if the file cannot be used.
    """
    with open(file, newline="", encoding="utf-8-sig") as stream:
        reader = csv.reader(stream)
        try:
            rows = [(reader.line_num, row) for row in reader if row]
        except (UnicodeDecodeError, csv.Error) as error:
            raise ValueError(f"{file} is not a CSV file: {error}") from None
    header = [name.strip() for name in rows[0][1]] if rows else []
    for name in ("time", column):
        if name not in header:
            raise ValueError(
                f"{file} has no column {name!r}; it has {shorten(', '.join(header), 200, placeholder=' ...') or 'none'}"
            )
    indices = header.index("time"), header.index(column)
    samples = []
    for line, row in rows[1:]:
        try:
            sample = [float(row[index]) for index in indices]
        except (ValueError, IndexError):
            sample = [math.nan]
        if not all(map(math.isfinite, sample)):
            raise ValueError(f"{file}, line {line}: column 'time' or {column!r} does not contain a number")
        samples.append(sample)
    if len(samples) < 100:
        raise ValueError(f"{file} has {len(samples)} samples; at least 100 are required")
    times, angles = np.array(samples).T
    steps = np.diff(times)
    # At several hundred hertz, rounding times to three decimals shifts them by up to half a step. A missing sample is a
    # whole step.
    wrong = np.flatnonzero((steps <= 0.0) | (np.abs(steps - np.median(steps)) > 0.5 * np.median(steps)))
    if len(wrong):
        before, after = times[wrong[0] : wrong[0] + 2]
        raise ValueError(
            f"{file}: the samples must be evenly spaced in time, but {before:g} s is followed by {after:g} s"
        )
    return times, np.radians(angles)


def seam(angles: np.ndarray, window: int) -> int:
    """Return the length to which to cut a recording so that it repeats smoothly.

    The cut follows the sample in the last two windows whose continuation best matches the beginning. angles : rad;
    window : samples
    """
    if len(angles) < 4 * window:
        return len(angles)
    beginning = angles[: window // 2]
    first = len(angles) - 2 * window
    continuations = np.lib.stride_tricks.sliding_window_view(angles[first:], len(beginning))
    return first + int(np.argmin(np.sum((continuations - beginning) ** 2, axis=1))) + 1
