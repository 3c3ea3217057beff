"""CubeMars AK in MIT mode, board generations V1 and V2."""

from blocks.actuators.cubemars import models
from blocks.actuators.joint import Joint
from blocks.actuators.mit_frames import ENABLE, StopInMitMode
from cext.kernels import cubemars as kernels
from graph import Actuator


FAULTS = {
    0: "none", 1: "motor too hot", 2: "over-current", 3: "over-voltage", 4: "under-voltage", 5: "encoder", 6: "transistors too hot",
    7: "stalled",
}


class CubeMars(StopInMitMode, Joint, Actuator):
    """A CubeMars AK actuator in MIT mode: τ = K (θ₀ − θ) + B (ω₀ − ω) + τ_ff, closed in the drive.

    (AK Series Module Driver Manual V1.0.18, pages 64 to 68.) Feedback is of the last tick; commands go out at its end. Without
    stiffness and damping the drive gives `torque_command` alone; with them both are scaled so that the whole law, over every position that
    the joint can reach before the next frame, stays inside `limit`, and are zero where the feedback is older than two ticks.
    """

    find = staticmethod(models.find)
    decode = kernels.decode
    encode = kernels.encode

    def fault_in_words(self, code):
        return FAULTS.get(code, f"code {code}, which the manual does not know")

    def addresses(self):
        return [(self.can_id, False)]

    def hears(self):
        return [(self.can_id, 0x7FF, False), (0, 0x7FF, False)]         # replies come from the drive's id, or from 0

    def replies(self):
        return [(*pattern, bytes([self.can_id])) for pattern in self.hears()]

    def enable_frames(self):
        return [(self.can_id, False, ENABLE)]

    def emulator(self, **parameters):
        from blocks.actuators.cubemars.emulator import EmulatedCubeMars

        return EmulatedCubeMars.of(self, **parameters)
