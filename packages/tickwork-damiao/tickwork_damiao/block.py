"""Damiao drives in MIT mode."""

from __future__ import annotations

import struct
from typing import Any

from msgspec.structs import replace

from blocks.actuators.joint import Joint
from blocks.actuators.mit_frames import ENABLE, StopInMitMode
from graph import Actuator, CommandReplies, Interval, Memory, Param, ReplyField, StopReply
from tickwork_damiao import kernels, models, protocol
from tickwork_damiao.emulator import EmulatedDamiao

# (register, type) that arming compares: 0 float, 4 integer of 32 bits, of cext/kernels/devices/robstride/settings.pxd
COMPARED = ((protocol.TIMEOUT, 4), (protocol.CTRL_MODE, 4), (protocol.PMAX, 0), (protocol.VMAX, 0), (protocol.TMAX, 0))
SETTINGS_SIZE = 25
DIFFERENT = 32  # bit of `fault`: a register differs; then the lower ones are its value, and its place follows


class Damiao(StopInMitMode, Joint, Actuator):
    """Damiao drive in MIT mode: τ = K (θ₀ − θ) + B (ω₀ − ω) + τ_ff, closed in the drive.

    Every reply reports whether the drive is enabled, and its error. Arming writes the time-out and the mode, reads them
    and the encoded ranges PMAX, VMAX and TMAX, which are settings of each unit, and enables the drive only if they are
    those of this block. Its replies come from `master_id` (register MST_ID), which must not be 0.
    """

    can_id = Param(1, "1", "CAN id set in the drive, ESC_ID", min=1, max=15, fixed=True)
    master_id = Param(0, "1", "CAN id of its replies, MST_ID; 0: can_id + 16", min=0, max=0x7FE, fixed=True)
    can_timeout = Param(
        0.1,
        "s",
        "time without a command after which the drive stops itself, TIMEOUT; 0 for never",
        min=0.0,
        max=5.0,
        fixed=True,
        kernel=False,
    )

    talk = Memory((0.0,) * 5, "registers read back: cext/kernels/devices/robstride/settings.pxd")
    settings = Memory((0.0,) * SETTINGS_SIZE, "number of compared registers; index, type, value of each")

    examples = ({"model": "DM-J4310"}, {"model": "DM-J8009", "limit": 20.0, "gear_ratio": 2.0, "invert": True})
    hardware = (*Joint.hardware, "master_id")
    reports_enabled = True
    ready = "talk"
    find = staticmethod(models.find)
    decode = kernels.decode
    encode = kernels.encode

    def configure(self) -> None:
        super().configure()
        if not self.master_id:
            self.master_id = self.can_id + 16
        if self.master_id == self.can_id:
            raise ValueError(f"can_id and master_id are both {self.can_id}: the drive and its host need different ids")
        self.own_timeout = self.can_timeout if self.can_timeout > 0.0 else None
        values = [number for (index, kind), value in zip(COMPARED, self.compared()) for number in (index, kind, value)]
        self.settings = (float(len(COMPARED)), *values, *[0.0] * (SETTINGS_SIZE - 1 - len(values)))

    def compared(self) -> list[float]:
        """Return the values of the COMPARED registers that this block requires."""
        ratio = self.gear_ratio
        ranges = (self.wire[0] * ratio, self.wire[1] * ratio, self.wire[4] / ratio)
        counts = max(round(self.can_timeout * protocol.TIMEOUT_COUNTS), int(self.can_timeout > 0.0))
        return [float(counts), float(protocol.MIT), *(struct.unpack("<f", struct.pack("<f", x))[0] for x in ranges)]

    def prepare(self, dt: float | None) -> None:
        if dt is not None and 0.0 < self.can_timeout < 3.0 * dt:
            raise ValueError(
                f"can_timeout {self.can_timeout:g} s is shorter than three ticks of {dt:g} s: the drive would stop "
                "itself between two commands"
            )

    def settings_read(self) -> int:
        """Return the number of registers that arming reads back."""
        return len(COMPARED)

    def output_range(self, **commands: Interval) -> dict[str, Interval]:
        return super().output_range() | {"temperature": Interval(0.0, 255.0), "fault": Interval(0.0, 2.0**37)}

    def addresses(self) -> list[tuple[int, bool]]:
        """Return the ids of its commands and of its replies: no other drive may have either."""
        return [(self.can_id, False), (self.master_id, False)]

    def acceptance_filters(self) -> list[tuple[int, int, bool]]:
        """Return the filters of its replies, of commands to it, and of register frames of other programs."""
        return [(identifier, 0x7FF, False) for identifier in (self.master_id, self.can_id, protocol.BROADCAST)]

    def reply_frames(self) -> list[tuple[int, int, bool, bytes]]:
        """Return its replies."""
        return [(self.master_id, 0x7FF, False, b"")]

    def stop_reply(self) -> StopReply:
        """Return what confirms a safe stop: a torque near zero, and a status other than 1.

        In two's complement the status of a fault, from 8 on, is below 0.
        """
        status = ReplyField(tuple(self.reply_frames()), first=0, bits=4, low=-8.0, high=7.0, signed=True)
        return replace(super().stop_reply(), enabled=status)

    def command_replies(self) -> CommandReplies:
        """Return how the drive answers commands: registers without a sample."""
        return CommandReplies(self.max_transit, to_set_up=1)

    def set_up_frames(self) -> list[tuple[int, bool, bytes]]:
        """Return frames that disable the drive, write its time-out and mode, and read what is compared."""
        wanted = [(index, value) for (index, _), value in zip(COMPARED, self.compared())]
        return [
            *self.disable_frames(),
            *(protocol.write(index, value, self.can_id) for index, value in wanted[:2]),
            *(protocol.read(index, self.can_id) for index, _ in wanted),
        ]

    def enable_frames(self) -> list[tuple[int, bool, bytes]]:
        return [(self.can_id, False, ENABLE)]

    def fault_in_words(self, code: float) -> str:
        place = int(code) >> DIFFERENT + 1
        if int(code) >> DIFFERENT & 1 and 1 <= place <= len(COMPARED):
            index = COMPARED[place - 1][0]
            [value] = struct.unpack(protocol.layout(index), (int(code) & 0xFFFFFFFF).to_bytes(4, "little"))
            return (
                f"{protocol.NAMES[index]} (register {index}) reads {value:g}, {self.compared()[place - 1]:g} is "
                f"expected; {self.remedy(index, value)}"
            )
        status = protocol.STATUS.get(int(code), f"status {int(code)}, not listed in the manual")
        return f"{status}. Clear it with `configure {self.can_id} --write clear=1`" if code else "none"

    def remedy(self, index: int, value: float) -> str:
        """Return what to do about a register that differs."""
        if index in (protocol.TIMEOUT, protocol.CTRL_MODE):
            return "check which program writes to the drive"
        name = {protocol.PMAX: "wire_position", protocol.VMAX: "wire_velocity", protocol.TMAX: "wire_torque"}[index]
        return f"set {name} = {value:g} in the rig if this unit has that range, or write {protocol.NAMES[index]} to it"

    def unready_in_words(self) -> str:
        names = ", ".join(protocol.NAMES[index] for index, _ in COMPARED)
        return f"it answers, but not every read of its registers (0x7FF: {names}): its firmware may be too old"

    def emulator(self, **parameters: Any) -> EmulatedDamiao:
        return EmulatedDamiao.of(self, **{"master_id": self.master_id} | parameters)
