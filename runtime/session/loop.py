"""Margins of a loop that is opened at an input of a block, with a picture."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from functools import cached_property
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np

from graph import Device, Diagram, Signal
from runtime.host.errors import BadInput
from runtime.host.optional_dependencies import need
from runtime.robot.loading.file import build, source
from runtime.session.excitation import START, measure
from runtime.session.linearise import linearise

if TYPE_CHECKING:
    import os

    from matplotlib.axes import Axes

    from runtime.robot.loading.overrides import Settings

FREQUENCIES = 4000  # from a 1e5th of the Nyquist frequency to that frequency
LONGEST = 5000  # ticks of the step response
QUICK = 0.5  # |z| of a pole that decays within a few ticks, whose damping is not counted
ANGLES = np.linspace(-np.pi, np.pi, 2001)  # of the unit circle, with z = 1


class Loop:
    """A loop of a diagram, opened at an input: L(z), from the input to minus the signal that is connected there.

    A diagram with devices is not linearised: L is measured in its simulation, with the time of buses and drives.

    system : control.StateSpace, L; None if it was measured
    error : error of 1 + L as a share of it, at the frequencies; 0 if it was linearised
    name, source : input at which it is opened, and the signal that is connected there
    """

    def __init__(
        self,
        given: str | os.PathLike[str] | Diagram | Callable[..., Diagram],
        name: str,
        at: float = 0.0,
        settings: Settings = (),
        amplitude: float | None = None,
        plant: Diagram | Callable[..., Diagram] | None = None,
    ) -> None:
        file = source(given, plant)
        diagram = build(file, settings)
        sources = {
            f"{wire.block.path}.{wire.port}": wire.source.path
            for wire in diagram.wires
            if isinstance(wire.source, Signal)
        }
        if name not in sources:
            raise BadInput(f"no signal is connected to {name!r}: choose one of {', '.join(sorted(sources)) or 'none'}")
        self.name, self.source, self.at, self.title = name, sources[name], at, diagram.name
        self.rate = float(diagram.rate)
        self.system, self.error = None, np.zeros(1)
        if any(isinstance(block, Device) for block in diagram):
            self.at = at or START
            self.frequencies, self.response, self.error = measure(file, diagram, name, self.at, amplitude)
        else:
            self.system = -linearise(diagram, [name], [self.source], at)

    @cached_property
    def frequencies(self) -> np.ndarray:
        """Frequencies in Hz."""
        return np.geomspace(self.rate / 2e5, self.rate / 2.0, FREQUENCIES)[:-1]

    @cached_property
    def response(self) -> np.ndarray:
        """L at the frequencies, complex."""
        assert self.system is not None
        system, z = self.system, np.exp(2j * np.pi * self.frequencies / self.rate)
        parts = [  # C (z I - A)⁻¹ B + D, 100 frequencies at once
            system.C @ np.linalg.solve(part[:, None, None] * np.eye(system.nstates) - system.A, system.B) + system.D
            for part in np.array_split(z, len(z) // 100)
        ]
        return np.concatenate(parts).ravel()

    @cached_property
    def closed(self) -> Any:
        """The closed loop, L / (1 + L), as a control.StateSpace."""
        return need("control", "analysis").feedback(self.system, 1)

    @cached_property
    def pole(self) -> float:
        """Largest |z| of the poles of the closed loop; 0 if it was measured."""
        return float(np.abs(self.closed.poles()).max(initial=0.0)) if self.system is not None else 0.0

    @cached_property
    def damping(self) -> float:
        """Damping ratio ζ of the closed loop: at most 1/√2, of a second-order system with the same maximum of |T|.

        T = L / (1 + L), with the maximum 1 / (2 ζ √(1 - ζ²)). If it was linearised, also at most that of each pole.
        """
        peak = max(1.0, float(np.abs(self.response / (1.0 + self.response)).max()))
        poles = self.closed.poles() if self.system is not None else np.zeros(0)
        poles = np.log(poles[np.abs(poles) > QUICK].astype(complex))
        ratios = -np.real(poles) / np.maximum(np.abs(poles), 1e-12)
        return float(ratios.min(initial=math.sqrt((1.0 - math.sqrt(1.0 - peak**-2)) / 2.0)))

    @cached_property
    def margins(self) -> dict[str, float]:
        """Margins by name; infinite where the response has no such crossing, NaN for its frequency.

        gain (1), gain_frequency (Hz), phase (rad), phase_frequency (Hz), delay (s), distance (1): the least |1 + L|,
        distance_frequency (Hz), damping (1), pole (1): the largest |z| of the closed loop, 0 if it was measured
        """
        control = need("control", "analysis")
        data = control.frd(self.response, 2.0 * np.pi * self.frequencies)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            gain, phase, distance, at_gain, at_phase, at_distance = control.stability_margins(data)
        return {
            "gain": float(gain),
            "gain_frequency": float(at_gain) / (2.0 * math.pi),
            "phase": math.radians(phase),
            "phase_frequency": float(at_phase) / (2.0 * math.pi),
            "delay": math.radians(phase % 360.0) / float(at_phase) if math.isfinite(at_phase) else math.inf,
            "distance": float(distance),
            "distance_frequency": float(at_distance) / (2.0 * math.pi),
            "damping": self.damping,
            "pole": self.pole,
        }

    @property
    def linear(self) -> bool:
        """Whether the error of the response is smaller than its distance from -1, at every frequency."""
        return bool(self.error.max() < 1.0)

    def lines(self) -> list[str]:
        """Return the table of margins."""
        margins = self.margins
        stable = margins["pole"] < 1.0
        rows = [
            ("gain margin", "gain_frequency", f"{20.0 * math.log10(margins['gain']):.1f} dB"),
            ("phase margin", "phase_frequency", f"{math.degrees(margins['phase']):.1f}°"),
            ("delay margin", "phase_frequency", f"{1e3 * margins['delay']:.1f} ms"),
            ("least |1 + L|", "distance_frequency", f"{margins['distance']:.3f}"),
        ]
        lines = [f"{self.title}: loop opened at {self.name}, after {self.source}, at {self.at:g} s, {self.rate:g} Hz"]
        for title, where, text in rows if self.linear else ():
            found = math.isfinite(margins[where])
            lines.append(f"  {title:<16}{text if found else 'none':<10}" + f"at {margins[where]:.3g} Hz" * found)
        if self.linear:
            lines.append(f"  {'damping ratio':<16}{margins['damping']:.2f}")
        if self.system is None:
            largest = int(np.abs(self.response).argmax())
            rows = ("largest |L|", self.response, largest), ("error of 1 + L", self.error, int(self.error.argmax()))
            for title, values, index in rows:
                lines.append(f"  {title:<16}{abs(values[index]):<10.3g}at {self.frequencies[index]:.3g} Hz")
            if not self.linear:
                lines.append(
                    "  margins: none, because the loop does not respond linearly, with this amplitude at this time"
                )
            return [*lines, f"  measured in simulation at {len(self.frequencies)} frequencies, with bus and drive"]
        state = "stable" if stable else "unstable: the margins have no meaning"
        return [*lines, f"  {'closed loop':<16}{state}, largest pole |z| = {margins['pole']:.5f}"]

    def draw(self, file: BinaryIO, kind: str = "png") -> None:
        """Write the picture: Bode, Nyquist, poles and zeros, step response of the closed loop, or its sensitivity.

        kind : as of picture.save
        """
        from runtime.record.analysis import picture

        rows: list[Any] = [["size", "nyquist"], ["phase", "step"]]
        if self.system is not None:
            rows = [["size", "nyquist"], ["phase", "poles"], ["step", "near"]]
        figure = picture.figure(9.0, 3.0 * len(rows))
        axes = figure.subplot_mosaic(rows)
        for axis in axes.values():
            picture.frame(axis)
        size, nyquist, phase, step = (axes[name] for name in ("size", "nyquist", "phase", "step"))
        f, L = self.frequencies, self.response
        size.semilogx(f, 20.0 * np.log10(np.abs(L)), color=picture.BLUE)
        size.set_ylabel("|L| [dB]")
        phase.semilogx(f, np.degrees(np.unwrap(np.angle(L))), color=picture.BLUE)
        phase.set_ylabel("arg L [deg]")
        phase.set_xlabel("frequency [Hz]")
        self._crossings(size, phase)
        near = L[np.abs(L) < 5.0]
        nyquist.plot(np.real(near), np.imag(near), color=picture.BLUE)
        nyquist.plot([-1.0], [0.0], "+", color=picture.ORANGE)
        nyquist.set(xlabel="Re L", ylabel="Im L", xlim=(-2.5, 1.5), ylim=(-2.0, 2.0), aspect="equal")
        if self.system is None:
            step.semilogx(f, 1.0 / np.abs(1.0 + L), color=picture.GREEN)
            step.set(xlabel="frequency [Hz]", ylabel="sensitivity |1 / (1 + L)|")
        else:
            t, y = self.step_response()
            step.step(t, y, where="post", color=picture.GREEN)
            step.set(xlabel="time [s]", ylabel="closed loop, unit step")
            self._poles(axes["poles"], axes["near"])
        figure.suptitle(picture.plain(f"{self.title}: {self.name} at {self.at:g} s"), fontsize=10)
        picture.save(figure, file, kind)

    def _poles(self, all_of_them: Axes, near: Axes) -> None:
        """Draw poles and zeros of L and the poles of the closed loop, with the unit circle, and those near z = 1."""
        from runtime.record.analysis import picture

        assert self.system is not None
        poles, closed = self.system.poles(), self.closed.poles()
        for axis in (all_of_them, near):
            axis.plot(np.cos(ANGLES), np.sin(ANGLES), color="#AAAAAA", linewidth=0.8)
            for values, mark, colour, label in (
                (poles, "x", picture.BLUE, "poles of L"),
                (self.system.zeros(), "o", picture.BLUE, "zeros of L"),
                (closed, "x", picture.GREEN, "closed loop"),
            ):
                axis.plot(values.real, values.imag, mark, color=colour, fillstyle="none", label=label)
        distances = np.abs(np.concatenate([poles, closed]) - 1.0)
        around = 1.3 * distances[distances < 0.2].max(initial=0.01)
        radius = 1.1 * np.abs(closed).max(initial=1.0)
        for axis, middle, half in ((all_of_them, 0.0, radius), (near, 1.0, around)):
            axis.set(xlim=(middle - half, middle + half), ylim=(-half, half), aspect="equal")
            axis.set(xlabel="Re z", ylabel="Im z")
        near.set_ylabel("Im z, near z = 1")
        all_of_them.legend(fontsize=8, frameon=False, loc="upper left", bbox_to_anchor=(1.0, 1.0))

    def _crossings(self, size: Axes, phase: Axes) -> None:
        for axis, name, level in ((size, "phase_frequency", 0.0), (phase, "gain_frequency", -180.0)):
            axis.axhline(level, color="#AAAAAA", linewidth=0.8)
            if math.isfinite(self.margins[name]):
                for each in (size, phase):
                    each.axvline(self.margins[name], color="#AAAAAA", linewidth=0.8, linestyle=":")

    def step_response(self) -> tuple[np.ndarray, np.ndarray]:
        """Return (time in s, output) of the closed loop, until it has settled."""
        pole = self.margins["pole"]
        ticks = LONGEST if not 0.0 < pole < 1.0 else min(LONGEST, 20 + math.ceil(math.log(0.005) / math.log(pole)))
        times = np.arange(ticks) / self.rate
        made = need("control", "analysis").step_response(self.closed, times)
        return times, np.ravel(made.outputs)
