"""Probe whose torque is a script: a generator that yields the torque of each tick, and reads the joint meanwhile."""

from __future__ import annotations

from typing import TYPE_CHECKING

from graph import Input, Param
from runtime.setup.commissioning.guided.bench import Result
from runtime.setup.commissioning.guided.probes import Probe

if TYPE_CHECKING:
    from collections.abc import Iterator

REST_TIME = 0.8  # s
RESTLESS = 0.05  # rad, motion without torque of a joint that does not rest
SPEED_WINDOW = 5  # ticks over which a speed is derived from the position


class Found(Exception):
    """A fault that ends a script. Its arguments are its name, and what was measured."""


class Open(Exception):
    """Why a script ends without a measurement."""


class ScriptedProbe(Probe):
    """Torque of `sequence`, which a subclass defines; the run ends with it.

    `at`, `rate` : position and velocity of this tick; `rows` : (position, velocity, torque sent before) of each tick
    `found` : (name, text) of the fault that ended it, or None; `left_open` : why nothing was measured, or ""
    """

    speed = Param(1.0, "rad/s", "largest speed, beyond which the run ends", above=0.0)

    torque_sent = Input("N·m", "torque of the frame before", default=0.0)
    current_sent = Input("A", "current of the frame before", default=0.0)

    def reset(self):
        self.script: Iterator[float] = self.sequence()
        self.rows, self.found, self.left_open, self.ended = [], None, "", False

    def step(self, position, velocity, torque_sent, current_sent):
        self.rows.append((position, velocity, torque_sent + current_sent * self.constant))
        self.at, self.rate = position, velocity
        command = 0.0
        try:
            self.watch()
            command = max(-self.largest, min(self.largest, next(self.script)))
        except StopIteration:
            self.ended = True
        except Found as fault:
            self.found, self.ended = fault.args, True
        except Open as reason:
            self.left_open, self.ended = str(reason), True
        return command, command / self.constant, self.ended

    def without_measurement(self) -> Result | None:
        """Return the Result of a script that ended by a fault or without a measurement, or None."""
        if self.left_open:
            return Result([self.left_open], done=False)
        if not self.found:
            return None
        result = Result()
        result.find(*self.found)
        return result

    def watch(self) -> None:
        """Raise Found if the joint is too fast, by its velocity or by its position."""
        recent = self.rows[-SPEED_WINDOW - 1 :]
        derived = abs(recent[-1][0] - recent[0][0]) / max(1, len(recent) - 1) / self.dt
        if max(abs(self.rate), derived) > self.speed:
            raise Found(
                "runaway",
                f"the joint reached {max(abs(self.rate), derived):.2f} rad/s, and the limit is {self.speed:.2f} rad/s",
            )

    def sequence(self) -> Iterator[float]:
        """Yield the torque of each tick. Raises Found or Open to end the run."""
        raise NotImplementedError

    def rest(self) -> Iterator[float]:
        """Yield no torque for REST_TIME. Raises Open if the joint does not rest."""
        for _ in range(round(REST_TIME / self.dt)):
            yield 0.0
        turned = self.at - self.rows[0][0]
        if abs(turned) > RESTLESS:
            raise Open(f"without torque the joint turned by {turned:.3f} rad: support it, or turn it to where it rests")
