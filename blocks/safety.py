"""Emergency stops and re-arming, in software. They never replace a switch that cuts the power of the motors."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from cext.kernels import safety as kernels
from graph import Block, Device, Input, Interval, Memory, Output, Param

if TYPE_CHECKING:
    from graph.device import Sequence


class EmergencyStop(Block):
    """Emergency stop: ends the run in the safe stop when its input is true. NaN counts as pressed.

    No command of that tick is sent. A diagram may contain several; a vector counts as pressed if any element is. The
    block runs in every tick, so it cannot be part of a slower or disabled subsystem. The run ends with exit code 3,
    or waits for the operator to arm it again (`--rearm`); it is never armed again automatically.
    """

    pressed = Input("1", "true ends the run", shape=..., dtype=bool)

    kernel = kernels.emergency_stop
    always = True


class Rearm(Block):
    """Re-arming after a fault: the run waits in its safe stop and is armed again when `request` rises.

    Connect a button of the operator. Arming also requires a tick without any fault. Only a rising edge while the run
    waits counts: an input that is constantly true, or rose before, has no effect. The block does not reset an emergency
    stop, and does not arm a robot at the start of a run.
    """

    request = Input("1", "rising edge arms the robot again", dtype=bool)

    kernel = kernels.rearm


class EStopHeartbeat(Device):
    """Emergency-stop button that repeatedly sends "released" over a bus, wired or wireless.

    Frame: standard id `can_id`, two bytes. Byte 0 is a counter that increases by one (modulo 256) in every frame. Byte
    1 is 5A (hex) while the button is released; any other value means pressed. The sender should repeat it every 20 ms,
    and immediately when pressed.

    A press ends the run in the same tick: no command of that tick is sent. Silence for `timeout` also ends it. Only
    frames with rising numbers count: a constant counter and a recorded stream are silence, and two senders of one id,
    which would hide each other's death, end the run. Frames of another length are counted and ignored. A press is
    latched: the run ends even if the button is released within the tick, and also during arming. Several buttons, such
    as those of the operator and the wearer, have an id each. Any node on the bus can send "released".
    """

    bus = Param("estop", "1", "logical name of the bus", dtype=str)
    can_id = Param(0x100, "1", "id of the button's frames", min=1, max=0x7FF, fixed=True)
    timeout = Param(
        0.1, "s", "time without a frame after which the run ends in the safe stop", above=0.0, max=2.0, fixed=True
    )

    pressed = Output("1", 'true unless the newest frame is "released"', dtype=bool)
    age = Output("s", "time since the newest frame")
    count = Output("1", "number of frames since the start of arming", dtype=int)
    state = Memory((0.0,) * 4, "newest counter + 1; 1 once pressed; time of the newest frame in ns; disorder in frames")

    decode = kernels.estop_decode
    encode = kernels.estop_encode
    hardware = ("can_id", "timeout")

    def fault_text(self, status: int) -> str:
        """Return the text of the fault of frames that are not one rising sequence."""
        return (
            f"the numbers of its frames are not one rising sequence: another sender uses id 0x{self.can_id:X}, or "
            "frames are repeated. Each button needs an id of its own"
        )

    def output_range(self) -> dict[str, Interval]:
        return {"pressed": Interval(0.0, 1.0), "age": Interval(0.0), "count": Interval(0.0)}

    def addresses(self) -> Sequence[tuple[Any, bool]]:
        return [(self.can_id, False)]

    def acceptance_filters(self) -> list[tuple[int, int, bool]]:
        return [(self.can_id, 0x7FF, False)]

    def traffic(self) -> Sequence[tuple[int, bool]]:
        return []

    def emulator(self, **parameters: Any) -> Any:
        return EmulatedEStop.of(self, **parameters)


class EmulatedEStop(Device):
    """Emulated emergency-stop button of an EStopHeartbeat."""

    bus = Param("estop", "1", "logical name of the bus", dtype=str)
    can_id = Param(0x100, "1", "id of the button's frames", min=1, max=0x7FF, fixed=True)
    period = Param(0.02, "s", "period of the frames", above=0.0, fixed=True)

    pressed = Input("1", "true while pressed; NaN counts as pressed", default=False, dtype=bool)
    silent = Input("1", "true stops sending; NaN counts as true", default=False, dtype=bool)
    state = Memory((0.0,) * 2, "next counter; time in s of the next frame")

    decode = kernels.button_decode
    encode = kernels.button_encode

    @classmethod
    def of(cls, button: Any, **parameters: Any) -> Any:
        """Return the emulator of one EStopHeartbeat. parameters : override those of the button"""
        return cls(bus=button.bus, can_id=button.can_id, **parameters)

    def addresses(self) -> Sequence[tuple[Any, bool]]:
        return [(self.can_id, False)]
