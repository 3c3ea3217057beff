"""RobStride actuators set to the vendor's MIT protocol, on standard frames."""

from __future__ import annotations

import struct
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from blocks.actuators.emulated import Emulated
from blocks.actuators.joint import Joint
from blocks.actuators.mit_frames import DISABLE, ENABLE, StopInMitMode
from blocks.actuators.robstride import frames, models, queries
from blocks.actuators.robstride.emulator import ignored_of
from blocks.actuators.robstride.models import TEMPERATURE
from blocks.actuators.robstride.parameters import PARAMETERS
from blocks.actuators.robstride.read_back import ReadBack
from blocks.actuators.sources import MANUAL, WIRES, RangeSet, Source, of
from cext.kernels.devices.robstride import mit as kernels
from graph import Actuator, CommandReplies, Device, Interval, Memory, Param

if TYPE_CHECKING:
    from blocks.actuators.robstride.models import Model
    from graph.dialogue import Dialogue

CLEAR_FAULT = b"\xff\xff\xff\xff\xff\xff\xff\xfb"
FAULTS = b"\xff\xff\xff\xff\xff\xff\x00\xfb"  # query of the faults
READ_AGAIN = 1.0  # s, when faults are read again
OPERATION = b"\xff\xff\xff\xff\xff\xff\x00\xfc"  # of the modes: MIT 0, position 1, velocity 2


SECTION_6 = "section 6 of the user manual of 2026-04-28"
SECTION_4 = "section 4 of the user manual, the private protocol"
# half ranges of position and velocity, stiffness and damping where section 6 differs from section 4
DIFFERENT = {"RS02": (12.57, 33.0, 500.0, 5.0), "RS03": (12.57, 33.0, 500.0, 5.0), "RS04": (15.0, 33.0, 500.0, 5.0)}


def find(name: str) -> Model:
    """Return a model by its name, with the ranges of the MIT protocol.

    Section 6 of the manuals prints the ranges of an RS00 for velocity, stiffness and damping of larger models; lerobot
    has them too, and an RS04's position of ± 12.57 rad. So `ranges` is "mit" if that section holds for a drive, and
    "private" if it has the ranges of its private protocol.

    Raises ValueError for models without a known MIT protocol.
    """
    found = models.find(name)
    if found.is_cybergear:
        raise ValueError("the CyberGear has no MIT protocol: use RobStride")
    if found.name not in models.MIT_FIRMWARE:
        raise ValueError(f"the ranges of {found.name} in the MIT protocol are not known: use RobStride")
    if found.name not in DIFFERENT:
        return replace(found, sources=of(WIRES, MANUAL, f"{SECTION_6}, as in section 4"))
    sets = (
        RangeSet("mit", (*DIFFERENT[found.name], found.wire_torque), Source(MANUAL, SECTION_6)),
        RangeSet("private", tuple(getattr(found, wire) for wire in WIRES), Source(MANUAL, SECTION_4)),
    )
    ranges = dict(zip(WIRES, sets[0].values))
    return replace(found, range_sets=sets, sources=of(WIRES, MANUAL, f"{SECTION_6}; section 4 differs"), **ranges)


class RobStrideMIT(StopInMitMode, ReadBack, Joint, Actuator):
    """RobStride actuator set to its MIT protocol: τ = K (θ₀ − θ) + B (ω₀ − ω) + τ_ff, closed in the drive.

    (RobStride user manuals of 2026-04-28, section 6.) As RobStride in operation control, with two drawbacks: replies
    report neither faults nor whether the drive is enabled. Faults are read during arming and once per second, in a tick
    with a request instead of a command: the drive holds its last command for one more period. Arming also writes
    `can_timeout` and the torque limit to the drive, selects operation control, and reads all three back; it enables the
    drive only if they are as written. Firmware older than `models.MIT_FIRMWARE` has no parameters: with can_timeout=0
    nothing is read back.
    """

    can_id = Param(127, "1", "CAN id set in the drive", min=1, max=127, fixed=True)
    host_id = Param(0xFD, "1", "CAN id of the drive's replies", min=0, max=255, fixed=True)
    can_timeout = Param(
        0.1,
        "s",
        "time without a command after which the drive stops itself; 0 for never, and for firmware without it",
        min=0.0,
        max=5.0,
        fixed=True,
    )

    talk = Memory(
        (0.0,) * 11, "settings read back, last faults, expected replies: cext/kernels/devices/robstride/mit.pyx"
    )
    settings = Memory((0.0,) * 25, "number of the settings that arming writes; index, type and value of each")

    arrival = Memory(0.0, "arrival of its newest frame in s")

    hardware = (*Joint.hardware, "host_id")
    find = staticmethod(find)
    decode = kernels.decode
    encode = kernels.encode

    def configure(self) -> None:
        super().configure()
        if self.can_id == self.host_id:
            raise ValueError(f"can_id and host_id are both {self.can_id}: the drive and its host need different ids")
        self.own_timeout = self.can_timeout if self.can_timeout > 0.0 else None
        self.ready = "talk" if self.own_timeout is not None else None
        self.compared = (frames.MECH_POS, frames.MECH_VEL) if self.verify_ranges and self.ready else ()
        self.unread_settings = () if self.ready else ("mode", "torque limit", "time-out")
        self.talk = (*[0.0] * 7, READ_AGAIN, *[0.0] * 3)
        self.settings = frames.settings_of(self.written_settings())

    def written_settings(self) -> list[tuple[int, float]]:
        """Return (index, value) of the settings that arming writes and reads back; none if the firmware cannot.

        The torque limit, at the motor, is a second layer, which no proof uses.
        """
        if not self.ready:
            return []
        return [
            (frames.CAN_TIMEOUT, frames.timeout_counts(self.can_timeout)),
            (frames.LIMIT_TORQUE, self.torque_limit / self.gear_ratio),
            (frames.RUN_MODE, 0.0),
        ]

    def prepare(self, dt: float | None) -> None:
        if dt is not None and 0.0 < self.can_timeout < 3.0 * dt:
            raise ValueError(
                f"can_timeout {self.can_timeout:g} s is shorter than three ticks of {dt:g} s: the drive would stop "
                "itself between two commands"
            )

    def output_range(self, **commands: Interval) -> dict[str, Interval]:
        return super().output_range() | {"temperature": TEMPERATURE, "fault": Interval(0.0, 2.0**37)}

    def addresses(self) -> list[tuple[int, bool]]:
        return [(self.can_id, False)]

    def acceptance_filters(self) -> list[tuple[int, int, bool]]:
        """Return the filters of the frames from the drive and to it."""
        return [(self.host_id, 0x7FF, False), (self.can_id, 0x7FF, False)] + [
            (kind | self.can_id, 0x7FF, False) for kind in (frames.READ_IN_MIT_MODE, frames.WRITE_IN_MIT_MODE)
        ]

    def reply_frames(self) -> list[tuple[int, int, bool, bytes]]:
        """Return its replies."""
        return [(self.host_id, 0x7FF, False, bytes([self.can_id]))]

    def command_replies(self) -> CommandReplies:
        """Return how the drive answers commands: parameters without a sample."""
        parameters = len(self.write_frames()) + len(self.read_frames())
        return CommandReplies(self.max_transit, to_set_up=len(self.set_up_frames()) - parameters)

    def set_up_frames(self) -> list[tuple[int, bool, bytes]]:
        """Return frames that stop the drive, write its settings, and read them back and the faults."""
        return [
            *[(self.can_id, False, data) for data in (DISABLE, OPERATION)],
            *self.write_frames(),
            *self.read_frames(),
            *[(self.can_id, False, FAULTS)] * bool(self.ready),
        ]

    def write_frames(self) -> list[tuple[int, bool, bytes]]:
        """Return the frames that write the settings other than the mode; none if the firmware cannot."""
        return [
            (
                frames.WRITE_IN_MIT_MODE | self.can_id,
                False,
                struct.pack("<HH", index, 0) + struct.pack(frames.WHOLE.get(index, "<f"), value),
            )
            for index, value in self.written_settings()
            if index != frames.RUN_MODE
        ]

    def read_frames(self) -> list[tuple[int, bool, bytes]]:
        """Return the reads of what is compared, and of the settings."""
        read = (*self.compared, *(index for index, _ in self.written_settings()))
        return [frames.read_in_mit_mode(index, self.can_id) for index in read]

    def read_parameter(self, name: str) -> Dialogue:
        return queries.value_in_mit_mode(self.can_id, PARAMETERS[name])

    def enable_frames(self) -> list[tuple[int, bool, bytes]]:
        return [(self.can_id, False, ENABLE)]

    def fault_in_words(self, code: float) -> str:
        if not code and self.ready is None:
            return "not read before the start"
        place, value = int(code) >> 33, int(code) & 0xFFFFFFFF
        if int(code) >> 32 & 1 and place in frames.COMPARED:
            return frames.disagreement(self, place, value)
        if int(code) >> 32 & 1:
            return f"{frames.difference(self.written_settings(), place, value)}; {self.remedy()}"
        return frames.word_in_words(value)

    def unready_in_words(self) -> str:
        names = ", ".join(f"{frames.NAMES[index]} 0x{index:04X}" for index, _ in self.written_settings())
        read = frames.READ_IN_MIT_MODE | self.can_id
        return f"it answers, but not every read of its settings (0x{read:03X}: {names}); {self.remedy()}"

    def remedy(self) -> str:
        """Return what to do about a drive that does not keep what was written to it."""
        return (
            f"{self.spec.name} has these parameters in MIT mode from firmware {models.MIT_FIRMWARE[self.spec.name]} on"
            ". Check which program writes to the drive, and update the firmware; or set can_timeout=0 and rely on the "
            f"guardian alone (can_timeout is {self.can_timeout:g} s)"
        )

    def emulator(self, **parameters: Any) -> EmulatedRobStrideMIT:
        return EmulatedRobStrideMIT.of(self, **{"host_id": self.host_id} | parameters)


class EmulatedRobStrideMIT(Emulated, Device):
    """Emulated RobStride drive set to its MIT protocol.

    `fault` is the word of faults that it returns on request; a fault disables it and stays until it is cleared. It
    stops itself after the written time-out.
    """

    can_id = Param(127, "1", "CAN id of the drive", min=1, max=127, fixed=True)
    host_id = Param(0xFD, "1", "CAN id of the drive's replies", min=0, max=255, fixed=True)
    parameters_known = Param(True, "1", "whether the firmware reads and writes parameters", fixed=True, kernel=False)

    left_velocity = Param(
        0.0,
        "rad/s",
        "velocity command with which another program has left the drive running in velocity mode; 0: it is disabled",
        fixed=True,
    )
    ignores = Param((), "1", 'names of parameters whose writes have no effect, as in ("run_mode",)')

    registers = Memory((0.0,) * 64, "parameters 0x7000 to 0x703F, four raw bytes each")
    ignored = Memory((0.0,) * 64, "for each parameter, 1 if writes have no effect")
    latched = Memory(0.0, "latched faults")
    too_old = Memory(0.0, "1 if the firmware has no parameters")

    find = staticmethod(find)
    kernel = kernels.drive
    decode = kernels.drive_decode
    encode = kernels.drive_encode

    def configure(self) -> None:
        super().configure()
        self.too_old = float(not self.parameters_known)
        self.ignored = ignored_of(self.ignores)
        if self.left_velocity:
            self.registers = tuple(2.0 * (0x7000 + place == frames.RUN_MODE) for place in range(64))
            self.state = (1.0, *tuple(self.state)[1:])

    def addresses(self) -> list[tuple[int, bool]]:
        return [(self.can_id, False)]
