"""Emulated RobStride drive with the private protocol."""

import re
from collections.abc import Iterable

from blocks.actuators.emulated import Emulated
from blocks.actuators.robstride import frames, models, parameters
from cext.kernels.devices.robstride import emulator as kernels
from graph import Device, Memory, Param

LOC_KP, SPD_KP, VBUS = 0x701E, 0x701F, 0x701C
POSITION_GAIN = 30.0  # 1/s, as the manual prints it
VELOCITY_GAIN = 5.0  # N·m·s/rad, assumed: the vendor's is tuned to its motor


def ignored_of(names: Iterable[str]) -> tuple[float, ...]:
    """Return 1 for each parameter from 0x7000 on whose name is given, else 0. Raises ValueError for an unknown name."""
    places = {parameters.find(name).index & 63 for name in names}
    return tuple(float(place in places) for place in range(64))


class EmulatedRobStride(Emulated, Device):
    """Emulated RobStride drive or CyberGear with the private protocol in every mode.

    Torque is the law of its run mode, up to its limits and the peak torque, and zero until it is enabled, after it is
    stopped, while it has a fault and when it has received nothing for its canTimeout. `fault`: its six bits of the
    feedback, which stay until they are cleared, and from bit 8 on those of a fault report. Its parameters can be read,
    written and, on a RobStride, saved; its id can be changed, and it reports its unique number and its firmware.
    `EmulatedRobStride.of(robot["left/knee"])` emulates the drive of a robot's block.
    """

    can_id = Param(127, "1", "CAN id of the drive", min=1, max=127, fixed=True)
    trip_temperature = Param(
        None, "°C", "temperature of the over-temperature fault; the model's by default", dtype=float, fixed=True
    )

    unique = Param("", "1", "unique number, 16 hex digits; derived from model and id by default", dtype=str)
    firmware = Param(
        "", "1", "firmware version, as in 0.3.1.41; by default the oldest with a time-out in MIT mode", dtype=str
    )
    supply = Param(
        0.0,
        "V",
        "supply voltage that it reports; 0: 48 V, or 24 V where the model bears less",
        min=0.0,
        fixed=True,
        kernel=False,
    )
    gains = Param((), "1", '(name, value) of parameters that differ from the defaults, as in (("loc_kp", 40.0),)')

    left_velocity = Param(
        0.0,
        "rad/s",
        "velocity command with which another program has left the drive running in velocity mode; 0: it is disabled",
        fixed=True,
        kernel=False,
    )
    ignores = Param((), "1", 'names of parameters whose writes have no effect, as in ("run_mode",)')

    timeout_scale = Param(
        1.0,
        "1",
        "time after which it stops by itself, as a multiple of its canTimeout; inf: it ignores that setting",
        above=0.0,
        fixed=True,
        kernel=False,
    )

    registers = Memory((0.0,) * 64, "values of the parameters 0x7000 to 0x703F")
    defaults = Memory((0.0,) * 64, "values of these parameters after power-on")
    ignored = Memory((0.0,) * 64, "for each parameter, 1 if writes have no effect")
    memory_of_drive = Memory(
        (0.0,) * 7,
        "host id, latched faults, reported faults, 1 while reporting, time of the next report, torque constant, "
        "timeout_scale",
    )

    identity = Memory((0.0,) * 14, "bytes of the unique number and of the firmware version, 1 for a CyberGear")

    find = staticmethod(models.find)
    kernel = kernels.drive
    decode = kernels.drive_decode
    encode = kernels.drive_encode

    def configure(self) -> None:
        super().configure()
        spec = self.spec
        if self.trip_temperature is None:
            self.trip_temperature = spec.too_hot
        nominal = 48.0 if spec.supply[1] > 48.0 else 24.0
        values = {
            frames.LIMIT_TORQUE: spec.peak,
            frames.LIMIT_SPD: 2.0,
            frames.LIMIT_CUR: spec.peak_current,
            VBUS: self.supply or nominal,
            LOC_KP: POSITION_GAIN,
            SPD_KP: VELOCITY_GAIN / spec.torque_constant / self.gear_ratio**2,
        }
        if not spec.is_cybergear:  # which has one speed limit, LIMIT_SPD
            values |= {frames.VEL_MAX: 10.0, frames.ACC_SET: 10.0, frames.ACC_RAD: 20.0}
        values |= self.own_gains(spec.is_cybergear)
        self.registers = self.defaults = tuple(values.get(0x7000 + place, 0.0) for place in range(64))
        self.ignored = ignored_of(self.ignores)
        if self.left_velocity:  # the defaults are those after the next power cycle
            running = values | {frames.RUN_MODE: 2.0, frames.SPD_REF: self.left_velocity}
            self.registers = tuple(running.get(0x7000 + place, 0.0) for place in range(64))
            self.state = (1.0, *tuple(self.state)[1:])
        self.memory_of_drive = (0xFD, 0.0, 0.0, 0.0, 0.0, spec.torque_constant, self.timeout_scale)

        self.identity = (*self.unique_bytes(), *self.firmware_bytes(), float(spec.is_cybergear))

    def own_gains(self, is_cybergear: bool) -> dict[int, float]:
        """Return {index: value} of `gains`.

        Raises ValueError for a parameter that the drive does not have or that is read-only.
        """
        values: dict[int, float] = {}
        for name, value in self.gains:
            parameter = parameters.find(name)
            if not parameter.writable or (is_cybergear and not parameter.cybergear):
                raise ValueError(f"gains: {parameter.name} is not a writable parameter of {self.spec.name}")
            values[parameter.index] = float(value)
        return values

    def unique_bytes(self) -> tuple[float, ...]:
        """Return the unique number as bytes, derived from model and id by default. Raises ValueError."""
        import hashlib  # 4 MB

        text = self.unique or hashlib.blake2b(f"{self.spec.name} {self.can_id}".encode(), digest_size=8).hexdigest()
        if not re.fullmatch("[0-9A-Fa-f]{16}", text):
            raise ValueError(f"unique must have 16 hex digits, got {text!r}")
        return tuple(map(float, bytes.fromhex(text)))

    def firmware_bytes(self) -> tuple[float, ...]:
        """Return the firmware version as five numbers. Raises ValueError."""
        text = self.firmware or models.MIT_FIRMWARE.get(self.spec.name, "0")
        parts = [int(part) if part.isdigit() else -1 for part in text.split(".")]
        if len(parts) > 5 or not all(0 <= part <= 255 for part in parts):
            raise ValueError(f"firmware must be at most five numbers from 0 to 255, as in 0.3.1.41, got {text!r}")
        return tuple(map(float, parts + [0] * (5 - len(parts))))

    def addresses(self) -> list[tuple[int, bool]]:
        return [(self.can_id, True)]
