"""What a program can request of a drive during a run: a new zero, and to be taken out of the run."""

from __future__ import annotations

import math
from typing import Any

from graph import Input, Output, Param, Zeroing


class Requests:
    """Inputs `zero` and `disable`, and the parameters that do the same."""

    zero_at_arming = Param(
        False,
        "1",
        "whether arming makes the present position the drive's zero; the joint then reads -offset",
        fixed=True,
        kernel=False,
    )
    disabled = Param(
        False,
        "1",
        "whether the drive is taken out of the run; false arms it again, and its commands fade in",
        min=0,
        max=1,
        live=True,
        kernel=False,
    )

    zero = Input(
        "1",
        "rising edge: the present position becomes the drive's zero; refused under torque and in motion",
        default=False,
        dtype=bool,
    )
    disable = Input("1", "true takes the drive out of the run, by setting `disabled`", default=False, dtype=bool)
    active = Output("1", "whether its commands are sent; false while it is taken out", dtype=bool, kernel=False)

    offset: Any
    range: Any
    wire: Any

    def check_zero(self) -> None:
        """Raise ValueError if arming would set the zero of a joint to an angle outside its range."""
        low, high = self.range or (-math.inf, math.inf)
        if self.zero_at_arming and not low <= -self.offset <= high:
            raise ValueError(
                f"zero_at_arming sets the joint to -offset, {-self.offset:g} rad, which is outside its range of "
                f"{low:g} to {high:g} rad: correct offset or range"
            )

    def set_zero_frame(self) -> tuple[int, bool, bytes] | None:
        """Return the frame that makes the present position of the drive its zero, or None."""
        return None

    def zeroing(self) -> Zeroing | None:
        """Return the Zeroing of the drive, or None if its protocol has no such frame."""
        frame = self.set_zero_frame()
        return frame and Zeroing(frame, self.offset, 1.01 * self.wire[4] / 0xFFF, self.zero_at_arming)
