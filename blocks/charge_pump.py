"""Charge pump: an output that has to toggle for a relay to hold the power of the motors."""

import binascii

from blocks.gpio import GpioLine
from blocks.serial_lines import speed_of
from cext.kernels import charge_pump as kernels
from cext.safety.thresholds import LOOP_STALL_MINIMUM, LOOP_STALL_PERIODS, STOP_ROUND
from graph import Input, Interval, Memory, Output, Param, StreamDevice
from graph.budget import BITS_OF_A_BYTE

MESSAGE = 5  # bytes of a counter and its checksum, stuffed
WORST_LOAD = 0.7  # share of the line that messages may take


def message(number):
    """One message to the microcontroller, as cext/kernels/charge_pump.pyx has it."""
    plain = bytes([number]) + binascii.crc_hqx(bytes([number]), 0xFFFF).to_bytes(2, "little")
    return b"".join(bytes([len(part) + 1]) + part for part in plain.split(b"\0")) + b"\0"


class ChargePump(GpioLine, StreamDevice):
    """Output that toggles for a circuit to hold the relay of the motors' supply: level(k) = not level(k − 1).

    The level changes once in every round of arming, in every tick that is sent, and in the damped part of a safe stop.
    It stands still from the fence on: after a fault, an emergency stop, an exception, a hung block. It also stands
    still when every process is killed and when the computer dies, and no process has to notice that. A safe stop never
    makes a relay pull in that may have dropped.

    With `pin` the output is a GPIO line; with `port` or `serial` a microcontroller gets a message a tick and toggles
    its pin by it. The rig says which. The circuit is the user's: a retriggerable monostable or a missing-pulse detector
    that drops the relay `hold` after the last edge, whatever the level is then. docs/rigs.md has the circuit's
    requirements and the sketch of the microcontroller.
    """

    protects = Param(
        (), "1", "paths or buses of the devices whose power the relay switches; () for every device of the diagram"
    )
    hold = Param(
        0.1,
        "s",
        "time after the last change of the level after which the circuit drops the relay",
        min=0.05,
        max=1.0,
        fixed=True,
        kernel=False,
    )
    start_up = Param(
        1.0,
        "s",
        "beginning of arming in which nothing but the level is sent, so that the drives behind the relay can start",
        min=0.0,
        max=30.0,
        fixed=True,
        kernel=False,
    )
    port = Param(
        "", "1", "path of the microcontroller's serial port, such as /dev/ttyACM0; a rig says which", dtype=str
    )
    serial = Param("", "1", "last characters of the microcontroller's USB serial number, instead of a port", dtype=str)
    baudrate = Param(
        115200,
        "1/s",
        "bit/s of that port; USB ports that are no adapters do not care",
        min=50,
        max=4_000_000,
        fixed=True,
        kernel=False,
    )

    changes = Output("1", "changes of the level so far, those of arming included", dtype=int)
    fault = Output("1", "1 where the line to the circuit is gone, else 0", dtype=int)
    messages = Memory(0.0, "whether the level goes out as messages of a microcontroller")

    decode = kernels.decode
    encode = kernels.encode
    sent_outputs = ("changes",)
    hardware = (*GpioLine.hardware[:3], "hold", "start_up", "port", "serial", "baudrate")

    def configure(self):
        super().configure()
        if isinstance(self.protects, str):
            self.protects = (self.protects,)
        if self.pin and (self.port or self.serial):
            raise ValueError(
                f"pin = {self.pin!r} and port = {self.port or self.serial!r}: the output is a GPIO line "
                "or a microcontroller, give one of them"
            )
        self.line = "serial" if self.port or self.serial else "gpio"
        self.messages = float(self.line == "serial")
        self.relay_time, self.start_time = self.hold, self.start_up

    def prepare(self, dt):
        stall = max(LOOP_STALL_PERIODS * dt, 1e-9 * LOOP_STALL_MINIMUM)
        if self.hold <= stall:
            raise ValueError(
                f"hold {self.hold:g} s: the relay must hold for longer than {stall:g} s, in which the guardian "
                "notices that the run has stalled"
            )
        speed, needed = speed_of(self.port, self.baudrate), BITS_OF_A_BYTE * MESSAGE / min(dt, 1e-9 * STOP_ROUND)
        if speed and needed > WORST_LOAD * speed:
            raise ValueError(
                f"baudrate {self.baudrate:g}: messages of {MESSAGE} bytes take {needed / speed:.0%} of the line. "
                "What waits in its queue would hold the relay "
                f"after the run has died; set baudrate to {needed / WORST_LOAD:.0f} or more"
            )

    def opening(self):
        if self.line == "serial":
            return {"port": self.port, "serial": self.serial, "baudrate": self.baudrate}
        return super().opening()

    def relay_frames(self):
        return [message(0), message(1)] if self.line == "serial" else [b"\0", b"\1"]

    def holds_power_of(self, device):
        return not self.protects or device.path in self.protects or device.bus in self.protects

    def fault_in_words(self, code):
        return "its line is gone, so that the relay drops" if code else ""

    def output_range(self):
        return {"changes": Interval(0.0), "fault": Interval(0.0, 1.0)}

    def emulator(self, **parameters):
        return EmulatedChargePump.of(self, **parameters)


class EmulatedChargePump(StreamDevice):
    """Relay and circuit behind a ChargePump, for a plant: the relay holds for `hold` after a change of the level."""

    hold = Param(
        0.1, "s", "time after the last change of the level after which the relay drops", above=0.0, max=1.0, fixed=True
    )
    messages = Param(
        0,
        "1",
        "1 where the level comes as messages of a microcontroller, 0 where as a GPIO line",
        min=0,
        max=1,
        fixed=True,
    )

    lost = Input("1", "whether the line is gone", default=False, dtype=bool)
    holds = Output("1", "whether the relay holds", dtype=bool)
    changes = Output("1", "changes of the level so far", dtype=int)
    state = Memory(
        (0.0,) * 4,
        "newest level or number + 1, time of the newest change in s, whether the loss of the "
        "line was reported, bytes in the buffer",
    )
    buffer = Memory((0.0,) * 2, "bytes of the message that is coming")

    decode = kernels.relay_decode
    encode = kernels.relay_encode
    kernel = kernels.relay
    feedthrough = ()

    @classmethod
    def of(cls, pump, **parameters):
        """Return the emulator of one ChargePump of a robot."""
        return cls(**{"bus": pump.bus, "hold": pump.hold, "messages": int(pump.line == "serial")} | parameters)

    def output_range(self, **inputs):
        return {"holds": Interval(0.0, 1.0), "changes": Interval(0.0)}
