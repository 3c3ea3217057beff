"""Thresholds of the monitors of an actuator: RMS torque, temperature and motion."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from cext.safety.thresholds import SCALE_TOLERANCE, STOP_REST_TORQUE, TORQUE_ACCURACY
from graph import Motion, Param, Watch


class Watched:
    """Parameters of the monitors, and the thresholds that follow from them and from the model."""

    timeout = Param(
        0.1, "s", "time without a reply after which the run ends in the safe stop; 0 for never", min=0.0, fixed=True
    )
    rms_mode = Param(
        "saturate",
        "1",
        "action when the RMS torque exceeds the rated torque",
        choices=("silent", "warn", "saturate", "throttle", "disable"),
    )
    rms_window = Param(20.0, "s", "window of the RMS torque", above=0.0, max=3600.0, fixed=True, kernel=False)
    warning_temperature = Param(
        70.0, "°C", "temperature above which the drive is reported as warm", fixed=True, kernel=False
    )
    derating_temperature = Param(
        80.0, "°C", "temperature above which the torque limit decreases", fixed=True, kernel=False
    )
    fault_temperature = Param(
        100.0, "°C", "temperature at which the torque limit is zero and the run ends", fixed=True, kernel=False
    )
    max_velocity = Param(
        0.0,
        "rad/s",
        "joint speed above which the run ends; 0: the model's no-load speed if published, else the end of the encoded "
        "range",
        min=0.0,
        fixed=True,
        kernel=False,
    )

    law_limit: Any
    hot: float | None
    spec: Any
    gear_ratio: Any
    wire: Any
    range: Any
    offset: Any
    torque_limit: Any
    motion: Callable[[], Motion]

    def check_temperatures(self) -> None:
        """Raise ValueError unless the temperature thresholds are in ascending order."""
        self.hot = self.warning_temperature
        if not self.warning_temperature <= self.derating_temperature < self.fault_temperature:
            raise ValueError(
                "warning_temperature, derating_temperature and fault_temperature must be in ascending order, got "
                f"{self.warning_temperature:g}, {self.derating_temperature:g} and {self.fault_temperature:g} °C"
            )

    def watched(self) -> Watch:
        """Return the thresholds of the drive monitor."""
        return Watch(
            rated=self.rated_torque(),
            limit=self.torque_limit,
            mode=self.rms_mode,
            window=self.rms_window,
            warm=self.warning_temperature,
            derate=self.derating_temperature,
            hot=self.fault_temperature,
            law_limit=self.law_limit,
            motion=self.motion(),
        )

    def motion_of_any_mode(self) -> dict[str, Any]:
        """Return the fields of `Motion` that do not depend on the mode of the drive."""
        position, velocity = self.feedback_ends()
        return {
            "range": self.range,
            "fastest": self.fastest(velocity),
            "limit": self.torque_limit,
            "accuracy": self.torque_accuracy(),
            "offset": self.offset,
            "position_code": 2.0 * self.wire[0] / 0xFFFF,
            "position_end": position,
            "velocity_end": velocity,
            "velocity_tolerance": 1e-2 * SCALE_TOLERANCE,
        }

    def feedback_ends(self) -> tuple[float, ...]:
        """Return the ends of the feedback's range at the joint, rad and rad/s."""
        return self.wire[:2]

    def fastest(self, end: float) -> float:
        """Return the overspeed limit in rad/s: below the end of the feedback's range if the speed is not published."""
        no_load = getattr(self.spec, "no_load", math.inf) * math.pi / 30.0 / self.gear_ratio
        return min(self.max_velocity or min(no_load, 0.995 * self.wire[1]), 0.995 * end)

    def torque_accuracy(self) -> float:
        """Return the accuracy of the measured torque, N·m.

        No vendor publishes it; torque constants measured by users deviate by 4 to 12 % from the published ones.
        """
        peak = self.wire[4] if self.spec.peak is None else self.spec.peak * self.gear_ratio
        return 1e-2 * TORQUE_ACCURACY * peak

    def rated_torque(self) -> float:
        """Return the rated torque at the joint, N·m; the given limit where no rating is published."""
        return self.torque_limit if self.spec.rated is None else self.spec.rated * self.gear_ratio

    def rest_torque(self, code: float) -> float:
        """Return the largest measured torque of the drive at rest, N·m. code : resolution of the measurement, N·m"""
        return 1e-3 * STOP_REST_TORQUE * self.rated_torque() + code
