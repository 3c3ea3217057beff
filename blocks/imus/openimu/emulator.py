"""Emulated OpenIMU, for a plant."""

from __future__ import annotations

from typing import Any

from blocks.imus.openimu import frames
from cext.kernels.devices.openimu import emulator as kernels
from graph import Device, Input, Memory, Param

G = 9.80665


class EmulatedOpenImu(Device):
    """Emulated OpenIMU: accepts settings, returns them on request, and sends data truncated as by its firmware.

    Inputs are in the axes printed on its case (x forward, y right, z down); without connections, it is level and at
    rest. Its initial settings are those of delivery: 100 Hz, angular rate, acceleration and magnetic field, in
    inconsistent axes. Filters and orientation are stored and have no effect. `EmulatedOpenImu.of(robot["shank_imu"])`
    emulates the unit of a robot's block.
    """

    bus = Param("can", "1", "logical name of the CAN bus", dtype=str)
    address = Param(128, "1", "source address", min=128, max=247, fixed=True)
    model = Param("300RI", "1", "model; a 335RI has no magnetometer, and rounds codes", choices=("300RI", "335RI"))
    sends_temperature = Param(
        False, "1", "whether the firmware sends the ambient conditions of J1939 once per second", fixed=True
    )
    rounds = Param(False, "1", "whether codes are rounded instead of truncated; set by the model", fixed=True)

    accel = Input("m/s²", "specific force", shape=(3,), default=(0.0, 0.0, -G))
    gyro = Input("rad/s", "angular rate", shape=(3,), default=(0.0, 0.0, 0.0))
    mag = Input("µT", "magnetic field", shape=(3,), default=(20.0, 0.0, 43.0))
    roll = Input("rad", "angle about x", default=0.0)
    pitch = Input("rad", "angle about y", default=0.0)
    temperature = Input("°C", "temperature of the unit", default=30.0)
    silent = Input("1", "whether the unit accepts settings but sends nothing", default=False, dtype=bool)
    dropped = Input("1", "fraction of lost frames in both directions, 0 to 1", default=0.0)
    power_lost = Input(
        "1", "whether the supply is off; afterwards the unit has its factory settings", default=False, dtype=bool
    )
    stored = Memory((0.0,) * 6, "divider, packets, behaviour, orientation, filters at power-on")
    state = Memory(
        (0.0,) * 12,
        "present settings; pending replies, time of the next packets, random state, loss of power, serial number, time "
        "of the next temperature",
    )

    kernel = kernels.unit
    decode = kernels.unit_decode
    encode = kernels.unit_encode

    @classmethod
    def of(cls, imu: Device, **parameters: Any) -> EmulatedOpenImu:
        """Return the emulator of a robot's OpenImu."""
        return cls(**{name: getattr(imu, name) for name in ("bus", "address", "model")} | parameters)

    def configure(self) -> None:
        self.rounds = self.model == "335RI"
        types = frames.SENDS_SLOPE if self.rounds else frames.SENDS_FIELD
        types |= frames.SENDS_RATE | frames.SENDS_ACCELERATION
        self.stored = (1.0, types, frames.STOCK, 0.0, 25.0, 25.0)
        self.state = (*self.stored, 0.0, 0.0, 0.0, 0.0, 1000.0 + self.address, 0.0)

    def addresses(self) -> list[tuple[int, bool]]:
        return [(self.address, True)]
