"""What a robot is attached to: limbs, and the people who move them. These stand in a plant."""

import csv
import math
from textwrap import shorten

import numpy as np

from cext.kernels import models as kernels
from graph import Block, Input, Memory, Output, Param

# Knee flexion in degrees at every 5 % of an average stride of an adult at natural cadence, from heel strike.
# (Winter, The Biomechanics and Motor Control of Human Gait, 2nd ed. 1991, read off and rounded.)
KNEE_FLEXION = (4, 9, 15, 18, 17, 14, 11, 8, 6, 7, 12, 21, 35, 50, 60, 62, 56, 42, 24, 9)


class Limb(Block):
    """A joint moved by its wearer and by a drive: I (α − α₀) = τ + K (θ₀ − θ) + B (ω₀ − ω) − d (ω − ω₀).

    The wearer means to move along θ₀, ω₀, α₀ and holds to it like a spring with a damper; τ is what the drive adds.
    With no wearer (stiffness and reflex 0) it is a free inertia. Below `lower` the ligaments pull back with `ligament`,
    a straight knee's end of motion. Semi-implicit Euler; no direct feedthrough.
    """

    inertia = Param(0.35, "kg·m²", "of shank and foot about the knee", above=0.0)
    damping = Param(1.0, "N·m·s/rad", "of the tissue, d", min=0.0)
    stiffness = Param(120.0, "N·m/rad", "of the wearer, K", min=0.0)
    reflex = Param(8.0, "N·m·s/rad", "of the wearer, B", min=0.0)
    start = Param(0.0, "rad", "angle at the start", fixed=True)
    lower = Param(-math.inf, "rad", "where the ligaments begin to pull")
    ligament = Param(500.0, "N·m/rad", "how stiff they are", min=0.0)

    torque = Input("N·m", "of the drive", default=0.0)
    angle = Input("rad", "where the wearer means to be, θ₀", default=0.0)
    rate = Input("rad/s", "its derivative, ω₀", default=0.0)
    acceleration = Input("rad/s²", "and the next, α₀", default=0.0)
    position = Output("rad", "joint angle θ")
    velocity = Output("rad/s", "joint velocity ω")
    state = Memory((0.0, 0.0), "θ and ω")

    kernel = kernels.limb
    update_kernel = kernels.limb_next
    feedthrough = ()

    def configure(self):
        self.state = (self.start, 0.0)


class WalkingKnee(Block):
    """The knee of an average adult who walks: a Fourier series over the stride, with its derivatives. `at_start` is the
    angle at t = 0.
    """

    stride_time = Param(1.1, "s", "duration of a stride", above=0.0)
    start = Param(0.0, "1", "gait phase at t = 0: 0 for one leg, 0.5 for the other")
    harmonics = Param(6, "1", "of the stride frequency", min=1, max=9, fixed=True)

    angle = Output("rad", "knee flexion")
    velocity = Output("rad/s", "its derivative")
    acceleration = Output("rad/s²", "and the next")
    mean = Memory(0.0, "mean angle")
    cosines = Memory(0.0, "of each harmonic")
    sines = Memory(0.0, "of each harmonic")

    kernel = kernels.fourier

    def configure(self):
        spectrum = np.fft.rfft(np.radians(KNEE_FLEXION)) / len(KNEE_FLEXION)
        self.mean = spectrum[0].real
        self.cosines = 2.0 * spectrum[1 : self.harmonics + 1].real
        self.sines = -2.0 * spectrum[1 : self.harmonics + 1].imag
        turn = 2.0 * np.pi * self.start * np.arange(1, self.harmonics + 1)
        self.at_start = float(self.mean + self.cosines @ np.cos(turn) + self.sines @ np.sin(turn))


class RecordedKnee(Block):
    """A recorded knee, played as the wearer's intention, over and over: a column in degrees of a CSV file with a `time`
    column in s.

    Linear between samples. Its last two seconds are cut where it goes on most as its beginning does, so that it repeats
    stride after stride, with a small step at the seam; one of less than four seconds is played whole. `at_start` is the
    angle at t = 0.
    """

    file = Param("", "1", "path of the CSV file", required=True, dtype=str, file=True)
    column = Param("", "1", "name of its column, in degrees", required=True, dtype=str)

    angle = Output("rad", "knee flexion")
    velocity = Output("rad/s", "its derivative")
    acceleration = Output("rad/s²", "and the next")
    rate = Memory(0.0, "samples a second")
    angles = Memory(0.0, "every sample")
    velocities = Memory(0.0, "every sample")
    accelerations = Memory(0.0, "every sample")

    kernel = kernels.playback

    def configure(self):
        times, angles = read_column(self.file, self.column)
        self.rate = (len(times) - 1) / (times[-1] - times[0])
        velocities = np.gradient(angles, 1.0 / self.rate)
        end = seam(angles, int(self.rate))
        self.angles, self.velocities = angles[:end], velocities[:end]
        self.accelerations = np.gradient(velocities, 1.0 / self.rate)[:end]
        self.at_start = float(angles[0])


def read_column(file, column):
    """(times in s, angles in rad) of a CSV file of at least 100 evenly spaced samples. ValueError or OSError saying
    what it lacks.
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
            raise ValueError(f"{file}, line {line}: a number is missing in column 'time' or {column!r}")
        samples.append(sample)
    if len(samples) < 100:
        raise ValueError(f"{file} has {len(samples)} samples, and at least 100 are needed")
    times, angles = np.array(samples).T
    steps = np.diff(times)
    # Half a step either way is what rounding to three decimals makes of some hundred hertz; a lost sample is a whole
    # one.
    wrong = np.flatnonzero((steps <= 0.0) | (np.abs(steps - np.median(steps)) > 0.5 * np.median(steps)))
    if len(wrong):
        before, after = times[wrong[0] : wrong[0] + 2]
        raise ValueError(
            f"{file}: the samples must be evenly spaced in time, and {before:g} s is followed by {after:g} s"
        )
    return times, np.radians(angles)


def seam(angles, window):
    """Where to cut a recording so that it repeats: after the sample of its last two windows that goes on most as the
    beginning does.
    """
    if len(angles) < 4 * window:
        return len(angles)
    beginning = angles[: window // 2]
    first = len(angles) - 2 * window
    going_on = np.lib.stride_tricks.sliding_window_view(angles[first:], len(beginning))
    return first + int(np.argmin(np.sum((going_on - beginning) ** 2, axis=1))) + 1
