"""Emulated OpenIMU: it sends the same bytes, for a plant."""

from __future__ import annotations

from typing import Any

from blocks.imus.openimu import frames
from cext.kernels.devices.openimu import emulator as kernels
from graph import Device, Input, Memory, Param

G = 9.80665


class EmulatedOpenImu(Device):
    """An OpenIMU on the in-memory bus: it takes settings, returns them on request, and sends what its firmware
    would, truncated as there.

    Its inputs are in the axes printed on its case (x forward, y right, z down); unwired, it lies still and level. It
    begins as it is sold: 100 Hz, angular rate, acceleration and magnetic field, in axes that do not fit together.
    Filters and orientation are kept, and have no effect. `EmulatedOpenImu.of(robot["shank_imu"])` plays the unit of a
    robot's block.
    """

    bus = Param("can", "1", "logical name of its CAN bus", dtype=str)
    address = Param(128, "1", "its source address", min=128, max=247, fixed=True)
    model = Param(
        "300RI", "1", "which one it is; the 335RI has no magnetometer, and rounds", choices=("300RI", "335RI")
    )
    rounds = Param(False, "1", "whether codes are rounded rather than truncated: as its model does", fixed=True)

    accel = Input("m/s²", "specific force", shape=(3,), default=(0.0, 0.0, -G))
    gyro = Input("rad/s", "angular rate", shape=(3,), default=(0.0, 0.0, 0.0))
    mag = Input("µT", "magnetic field", shape=(3,), default=(20.0, 0.0, 43.0))
    roll = Input("rad", "about x", default=0.0)
    pitch = Input("rad", "about y", default=0.0)
    silent = Input("1", "whether it obeys without sending", default=False, dtype=bool)
    dropped = Input("1", "share of the frames to and from it that get lost, 0 to 1", default=0.0)
    power_lost = Input("1", "it is dead; when power is back it is as it was sold", default=False, dtype=bool)
    stored = Memory((0.0,) * 6, "divider, packets, behaviour, orientation, filters at power on")
    state = Memory(
        (0.0,) * 11,
        "the same now; answers owed, time of the next packets, luck of frames, whether it is dead, serial number",
    )

    kernel = kernels.unit
    decode = kernels.unit_decode
    encode = kernels.unit_encode

    @classmethod
    def of(cls, imu: Device, **parameters: Any) -> EmulatedOpenImu:
        """The emulator of one OpenImu of a robot."""
        return cls(**{name: getattr(imu, name) for name in ("bus", "address", "model")} | parameters)

    def configure(self) -> None:
        self.rounds = self.model == "335RI"
        types = frames.SENDS_SLOPE if self.rounds else frames.SENDS_FIELD
        types |= frames.SENDS_RATE | frames.SENDS_ACCELERATION
        self.stored = (1.0, types, frames.STOCK, 0.0, 25.0, 25.0)
        self.state = (*self.stored, 0.0, 0.0, 0.0, 0.0, 1000.0 + self.address)

    def addresses(self) -> list[tuple[int, bool]]:
        return [(self.address, True)]
