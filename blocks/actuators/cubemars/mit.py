"""CubeMars AK in MIT mode, board generations V1 and V2."""

from __future__ import annotations

from typing import Any

from blocks.actuators.cubemars import models
from blocks.actuators.cubemars.emulator import EmulatedCubeMars
from blocks.actuators.cubemars.frames import CODE, ERRORS, FAULTS, MASK, MASKED_FAULTS, REPLIES, WARM, WARM_FROM
from blocks.actuators.cubemars.own_timeout import DeclaredTimeout
from blocks.actuators.joint import Joint
from blocks.actuators.mit_frames import ENABLE, StopInMitMode
from cext.kernels.devices.cubemars import mit as kernels
from graph import Actuator, Memory, Param


class CubeMars(DeclaredTimeout, StopInMitMode, Joint, Actuator):
    """CubeMars AK actuator in MIT mode: τ = K (θ₀ − θ) + B (ω₀ − ω) + τ_ff, closed in the drive.

    (AK Series Module Driver Manual V1.0.18, pages 64 to 68.) Feedback is from the previous tick; commands are sent at
    the end of a tick. Without stiffness and damping, the drive outputs `torque_command` only; with them, the whole law
    stays within `limit` while the acceleration of the joint is at most `max_acceleration`. Replies of 7 or 6 bytes
    contain neither temperature nor error: `temperature` is NaN, and `fault` is always 0.
    """

    reply = Param(
        8,
        "1",
        "bytes of the drive's replies: 8, or 7 or 6 of Katz firmware and early boards",
        choices=REPLIES,
        fixed=True,
    )

    errors = Param(
        "",
        "1",
        "meaning of the drive's error byte: a code, or a mask of bits of which 2 alone is a warning above 80 °C; the "
        "model's by default",
        choices=("", *ERRORS),
        fixed=True,
        kernel=False,
    )
    masks = Memory(0.0, "1 if the error byte is a mask")

    timeout_entry = (
        "  disable the drive, and open its serial terminal in the vendor's tool (R-Link, 921600 baud). Type",
        "      set_can_time_out 4000",
        "  in cycles of its control loop, assumed to last 25 µs as in the original Katz firmware; 0 disables it",
    )
    unread_settings = ("mode", "current limit", "time-out")
    hardware = (*Joint.hardware, "reply", "errors", "drive_timeout")
    find = staticmethod(models.find)
    decode = kernels.decode
    encode = kernels.encode

    def configure(self) -> None:
        super().configure()
        self.own_timeout = self.drive_timeout
        self.masks = float((self.errors or self.spec.errors) == MASK)

    def prepare(self, dt: float | None) -> None:
        self.check_timeout(dt)

    def fault_in_words(self, code: int) -> str:
        if self.reply != 8 and not code:
            return "not reported"
        if code == 2 and not self.masks:
            return WARM
        return (MASKED_FAULTS if self.masks else FAULTS).get(code, f"code {code}, not listed in the manual")

    def other_errors(self, fault: str, temperature: float) -> str:
        """Return the meaning of the error byte that a reported fault contradicts: CODE, MASK or "" for neither.

        fault : of a graph.family.Answer; temperature : °C
        """
        if not self.masks:
            return MASK if fault == WARM and temperature > WARM_FROM else ""
        return CODE if fault in (FAULTS[4], FAULTS[6]) and temperature < WARM_FROM else ""

    def malformed_in_words(self, lengths: dict[int, int], first_byte: int) -> str:
        return "; ".join(self.rejected_in_words(length, frames, first_byte) for length, frames in lengths.items())

    def rejected_in_words(self, length: int, frames: int, first_byte: int) -> str:
        """Describe replies that `decode` rejected. length : bytes; frames : number of them"""
        replies = f"{frames} repl{'y' if frames == 1 else 'ies'}"
        if length == self.reply:
            return (
                f"{replies} from id {self.can_id} with id {first_byte} in byte 0: the drive is configured to "
                "answer with another id, or "
                f"another controller commands it"
            )
        if length in REPLIES:
            return f"{replies} of {length} bytes from id {self.can_id}: set reply={length}"
        return (
            f"{frames} frame{'s' * (frames != 1)} of {length} bytes from id {self.can_id}, which no drive in MIT "
            "mode sends"
        )

    def traffic(self) -> list[tuple[int, bool]]:
        return [(8, False), (self.reply, False)]

    def addresses(self) -> list[tuple[int, bool]]:
        return [(self.can_id, False)]

    def acceptance_filters(self) -> list[tuple[int, int, bool]]:
        return [(self.can_id, 0x7FF, False), (0, 0x7FF, False)]  # replies come from the drive's id, or from 0

    def reply_frames(self) -> list[tuple[int, int, bool, bytes]]:
        """Return its replies."""
        return [(*pattern, bytes([self.can_id])) for pattern in self.acceptance_filters()]

    def enable_frames(self) -> list[tuple[int, bool, bytes]]:
        return [(self.can_id, False, ENABLE)]

    def emulator(self, **parameters: Any) -> EmulatedCubeMars:
        return EmulatedCubeMars.of(self, **parameters)
