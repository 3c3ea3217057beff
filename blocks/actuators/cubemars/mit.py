"""CubeMars AK in MIT mode, board generations V1 and V2."""

from numbers import Real

from blocks.actuators.cubemars import models
from cext.kernels import cubemars as kernels
from graph import Actuator, Input, Interval, Memory, Output, Param

ENABLE = b"\xff\xff\xff\xff\xff\xff\xff\xfc"
DISABLE = b"\xff\xff\xff\xff\xff\xff\xff\xfd"
SET_ZERO = b"\xff\xff\xff\xff\xff\xff\xff\xfe"
NOTHING = bytes.fromhex("7fff7ff0000007ff")         # position, velocity and torque in the middle of their ranges, no stiffness, no damping

FAULTS = {
    0: "none", 1: "motor too hot", 2: "over-current", 3: "over-voltage", 4: "under-voltage", 5: "encoder", 6: "transistors too hot",
    7: "stalled",
}


class CubeMars(Actuator):
    """A CubeMars AK actuator in MIT mode: τ = K (θ₀ − θ) + B (ω₀ − ω) + τ_ff, closed in the drive.

    (AK Series Module Driver Manual V1.0.18, pages 64 to 68.) Feedback is of the last tick; commands go out at its end. Without
    stiffness and damping the drive gives `torque_command` alone; with them both are scaled so that the whole law, over every position that the
    joint can reach before the next frame, stays inside `limit`, and are zero where the feedback is older than two ticks.
    """

    model = Param("", "1", "as the vendor writes it: AK80-9, AK10-9-V2.0", required=True, dtype=str)
    bus = Param("can", "1", "logical name of its CAN bus", dtype=str)
    can_id = Param(1, "1", "id set in the drive", min=1, max=255, fixed=True)
    limit = Param("rated", "N·m", "largest torque command: rated, peak, or a number up to the peak torque", dtype=object)
    invert = Param(False, "1", "whether the joint turns against the motor", fixed=True)
    offset = Param(
        0.0, "rad", "motor position where the joint is at zero, the way the joint turns", min=-models.POSITION, max=models.POSITION,
        fixed=True)
    timeout = Param(0.1, "s", "silence after which the run ends in the safe stop; 0 for never", min=0.0, fixed=True)
    safe_stop = Param("disable", "1", "how a safe stop treats it: disable, or damp first, where a free joint would drop its wearer",
                      choices=("disable", "damp"))
    stop_damping = Param(1.0, "N·m·s/rad", "of the joint while it is damped", above=0.0, max=models.DAMPING, fixed=True)
    stop_time = Param(1.0, "s", "for which it is damped before it is disabled", above=0.0, max=5.0, fixed=True)

    position_command = Input("rad", "θ₀", default=0.0)
    velocity_command = Input("rad/s", "ω₀", default=0.0)
    torque_command = Input("N·m", "τ_ff", default=0.0)
    stiffness_command = Input("N·m/rad", "K", default=0.0)
    damping_command = Input("N·m·s/rad", "B", default=0.0)
    position = Output("rad", "joint angle θ")
    velocity = Output("rad/s", "joint velocity ω")
    torque = Output("N·m", "of the drive, from its current")
    temperature = Output("°C", "of the drive")
    fault = Output("1", "the drive's error code, 0 for none", dtype=int)
    age = Output("s", "since the newest reply was heard")
    torque_sent = Output("N·m", "torque command after limits, fade-in and quantisation")
    limited = Output("1", "ticks in which stiffness and damping were scaled to keep the drive's law inside the limit", dtype=int)
    wire = Memory(0.0, "half ranges on the wire: position, velocity, stiffness, damping, torque")
    limits = Memory(0.0, "of the commands, in the same order, and of the drive's whole law")

    decode = kernels.decode
    encode = kernels.encode
    hardware = ("can_id", "invert", "offset")
    sent_outputs = ("torque_sent", "limited")

    def configure(self):
        found = self.found = models.find(self.model)
        self.model = found.name
        self.wire = (models.POSITION, found.wire_velocity, models.STIFFNESS, models.DAMPING, found.wire_torque)
        self.torque_limit = self.find_limit()
        self.damp_time = self.stop_time if self.safe_stop == "damp" else 0.0
        # The joint's range is the wire's, moved by the offset: what lies beyond cannot be sent.
        self.limits = (
            models.POSITION - abs(self.offset), found.wire_velocity, models.STIFFNESS, models.DAMPING, self.torque_limit, self.torque_limit)

    def find_limit(self):
        """N·m: rated or peak torque, never beyond the wire."""
        found = self.found
        named = {"rated": found.rated, "peak": found.peak}
        if isinstance(self.limit, str):
            if self.limit not in named:
                raise ValueError(f"limit must be 'rated', 'peak' or a torque in N·m, got {self.limit!r}")
            return min(named[self.limit], found.wire_torque)
        if isinstance(self.limit, bool) or not isinstance(self.limit, Real):
            raise ValueError(f"limit must be 'rated', 'peak' or a torque in N·m, got {self.limit!r}")
        limit = float(self.limit)
        if not 0.0 < limit <= found.peak:
            raise ValueError(f"limit must be above 0 and at most the peak torque of {found.name}, {found.peak:g} N·m, got {limit:g} N·m")
        return min(limit, found.wire_torque)

    def command_limits(self):
        position, velocity, stiffness, damping, torque, _ = self.limits
        return {
            "torque_command": Interval(-torque, torque),
            "position_command": Interval(-position, position),
            "velocity_command": Interval(-velocity, velocity),
            "stiffness_command": Interval(0.0, stiffness),
            "damping_command": Interval(0.0, damping),
        }

    def fault_in_words(self, code):
        return FAULTS.get(code, f"code {code}, which the manual does not know")

    def rating(self):
        source = f"{self.limit} torque" if isinstance(self.limit, str) else "its limit"
        return f"{source} and wire ranges of {self.found.name}"

    def output_range(self, **commands):
        position = models.POSITION + abs(self.offset)
        velocity, torque = self.wire[1], self.wire[4]
        return {
            "position": Interval(-position, position),
            "velocity": Interval(-velocity, velocity),
            "torque": Interval(-torque, torque),
            "torque_sent": Interval(-torque, torque),
            "limited": Interval(0.0),
            "temperature": Interval(-40.0, 215.0),
            "fault": Interval(0.0, 255.0),
            "age": Interval(0.0),
        }

    def addresses(self):
        return [(self.can_id, False)]

    def hears(self):
        return [(self.can_id, 0x7FF, False), (0, 0x7FF, False)]         # replies come from the drive's id, or from 0

    def replies(self):
        return [(*pattern, bytes([self.can_id])) for pattern in self.hears()]

    def traffic(self):
        return [(8, False), (8, False)]

    def enable_frames(self):
        return [(self.can_id, False, ENABLE)]

    def zero_frames(self):
        return [(self.can_id, False, NOTHING)]

    def disable_frames(self):
        return [(self.can_id, False, DISABLE)]

    def damp_frames(self):
        code = int(self.stop_damping * 0xFFF / models.DAMPING)
        return [(self.can_id, False, bytes([*NOTHING[:5], code >> 4, (code & 15) << 4 | NOTHING[6] & 15, NOTHING[7]]))]

    def emulator(self, **parameters):
        from blocks.actuators.cubemars.emulator import EmulatedCubeMars

        return EmulatedCubeMars.of(self, **parameters)
