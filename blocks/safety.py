"""Emergency stops, and arming again. What ends here is software: it never replaces a switch that cuts the power of the
motors.
"""

from cext.kernels import safety as kernels
from graph import Block, Device, Input, Interval, Memory, Output, Param


class EmergencyStop(Block):
    """Ends the run, in the safe stop, as soon as its input is true: no command of that tick is sent. NaN counts as
    pressed.

    A diagram may have any number of them; a vector is pressed where any of its elements is. It runs in every tick, so
    it stands in no subsystem that is slower or may be disabled. Nothing re-enables by itself: the run is over, with
    exit code 3, unless a person may arm it again.
    """

    pressed = Input("1", "whether to stop", shape=..., dtype=bool)

    kernel = kernels.emergency_stop
    always = True


class Rearm(Block):
    """Lets a run survive a fault: after its safe stop the run waits, and is armed again when `request` rises and
    nothing stands in the way.

    For a button in somebody's hand. Only a rising edge counts, and only while the run waits: an input that is held, or
    rose before, asks for nothing. It resets no emergency stop, and arms nothing at the start of a run.
    """

    request = Input("1", "rises when a person wants the robot armed again", dtype=bool)

    kernel = kernels.rearm


class EStopHeartbeat(Device):
    """An emergency-stop button, wired or wireless, that tells over a bus again and again that it is not pressed.

    Its frame: the standard id `can_id`, two bytes. Byte 0 is a counter, one more (modulo 256) in every frame; byte 1 is
    5A (hex) as long as the button is released, and anything else means pressed. A good sender repeats it every 20 ms,
    and at once when it is pressed.

    Pressed ends the run in the same tick: no command of that tick is sent. Silence for `timeout`, a counter that stands
    still and frames of another length, which are counted and ignored, end it too. A press is latched: a run that has
    seen one ends, even if it was let go within the tick, and even while it was still being armed. Who
    can send on its bus can say that it is released.
    """

    bus = Param("estop", "1", "logical name of its bus", dtype=str)
    can_id = Param(0x100, "1", "id of its frames", min=1, max=0x7FF, fixed=True)
    timeout = Param(0.1, "s", "silence after which the run ends in the safe stop", above=0.0, max=2.0, fixed=True)

    pressed = Output("1", "whether the newest frame says anything but released", dtype=bool)
    age = Output("s", "since the newest frame was heard")
    count = Output("1", "frames heard, since arming began", dtype=int)
    state = Memory((0.0,) * 2, "newest counter + 1; whether it has been pressed")

    decode = kernels.estop_decode
    encode = kernels.estop_encode
    hardware = ("can_id", "timeout")

    def output_range(self):
        return {"pressed": Interval(0.0, 1.0), "age": Interval(0.0), "count": Interval(0.0)}

    def addresses(self):
        return [(self.can_id, False)]

    def hears(self):
        return [(self.can_id, 0x7FF, False)]

    def traffic(self):
        return []

    def emulator(self, **parameters):
        return EmulatedEStop.of(self, **parameters)


class EmulatedEStop(Device):
    """The button of an EStopHeartbeat that is not there: it sends the same frames, for a plant."""

    bus = Param("estop", "1", "logical name of its bus", dtype=str)
    can_id = Param(0x100, "1", "id of its frames", min=1, max=0x7FF, fixed=True)
    period = Param(0.02, "s", "between its frames", above=0.0, fixed=True)

    pressed = Input("1", "whether it is pressed; NaN is pressed", default=False, dtype=bool)
    silent = Input("1", "whether it says nothing; NaN is silence", default=False, dtype=bool)
    state = Memory((0.0,) * 2, "next counter; s, when the next frame is due")

    decode = kernels.button_decode
    encode = kernels.button_encode

    @classmethod
    def of(cls, button, **parameters):
        """The emulator of one EStopHeartbeat of a robot."""
        return cls(bus=button.bus, can_id=button.can_id, **parameters)

    def addresses(self):
        return [(self.can_id, False)]
