"""Charge pump: an output whose toggling keeps the motors' supply relay closed."""

from __future__ import annotations

import binascii
from typing import TYPE_CHECKING, Any

from blocks.gpio import GpioLine
from blocks.serial_lines import speed_of
from cext.kernels import charge_pump as kernels
from cext.safety.thresholds import LOOP_STALL_MINIMUM, LOOP_STALL_PERIODS, STOP_ROUND
from graph import Input, Interval, Memory, Output, Param, StreamDevice
from graph.budget import SERIAL_BITS_PER_BYTE

if TYPE_CHECKING:
    from graph.device import Device, Sequence

MESSAGE_BYTES = 5  # counter and checksum, stuffed
LINE_LOAD_LIMIT = 0.7  # share of the line's capacity


def message(number: Any) -> Any:
    """Encode one message to the microcontroller, like cext/kernels/charge_pump.pyx. number : 0 to 255"""
    plain = bytes([number]) + binascii.crc_hqx(bytes([number]), 0xFFFF).to_bytes(2, "little")
    return b"".join(bytes([len(part) + 1]) + part for part in plain.split(b"\0")) + b"\0"


class ChargePump(GpioLine, StreamDevice):
    """Toggling output that keeps the relay of the motors' supply closed: level(k) = not level(k − 1).

    The level changes once in every round of arming, in every tick that is sent, and in the damped part of a safe stop.
    It is constant once sending is blocked: after a fault, an emergency stop, an exception or a hung block. It is also
    constant when every process has been killed or the computer has crashed, without any process detecting that. A safe
    stop never closes a relay that may have opened.

    With `pin` the output is a GPIO line. With `port` or `serial` a microcontroller receives one message per tick and
    toggles its pin for each. The rig file selects one of them. The user provides the circuit: a retriggerable
    monostable or a missing-pulse detector that opens the relay `hold` seconds after the last edge, at either level.
    docs/reference/emergency_stop.md describes the requirements of the circuit and the sketch of the microcontroller.
    """

    protects = Param(
        (), "1", "paths or buses of the devices whose supply the relay switches; () for every device of the diagram"
    )
    hold = Param(
        0.1,
        "s",
        "hold time of the circuit: from the last level change until the relay opens",
        min=0.05,
        max=1.0,
        fixed=True,
        kernel=False,
    )
    start_up = Param(
        1.0,
        "s",
        "start of arming in which only the level is sent, while the drives behind the relay power up",
        min=0.0,
        max=30.0,
        fixed=True,
        kernel=False,
    )
    port = Param(
        "", "1", "path of the microcontroller's serial port, such as /dev/ttyACM0; set in the rig file", dtype=str
    )
    serial = Param("", "1", "last characters of the microcontroller's USB serial number, instead of `port`", dtype=str)
    baudrate = Param(
        115200,
        "1/s",
        "bitrate of the port in bit/s; ignored by USB devices that are not serial adapters",
        min=50,
        max=4_000_000,
        fixed=True,
        kernel=False,
    )

    changes = Output("1", "number of level changes, including those during arming", dtype=int)
    fault = Output("1", "1 if the line to the circuit is disconnected, 0 otherwise", dtype=int)
    messages = Memory(0.0, "1 if the level is sent as messages to a microcontroller")

    decode = kernels.decode
    encode = kernels.encode
    sent_outputs = ("changes",)
    hardware = (*GpioLine.hardware[:3], "hold", "start_up", "port", "serial", "baudrate")

    def configure(self) -> None:
        super().configure()
        if isinstance(self.protects, str):
            self.protects = (self.protects,)
        if not all(isinstance(name, str) for name in self.protects):
            raise ValueError(f"protects must be paths or buses of actuators, got {self.protects!r}")
        if self.pin and (self.port or self.serial):
            raise ValueError(
                f"pin = {self.pin!r} and port = {self.port or self.serial!r}: the output is either a GPIO line "
                "or a microcontroller. Set only one of them"
            )
        self.line = "serial" if self.port or self.serial else "gpio"
        self.messages = float(self.line == "serial")
        self.relay_time, self.start_time = self.hold, self.start_up

    def prepare(self, dt: float) -> None:
        stall = max(LOOP_STALL_PERIODS * dt, 1e-9 * LOOP_STALL_MINIMUM)
        if self.hold <= stall:
            raise ValueError(
                f"hold {self.hold:g} s: the relay must hold for longer than the {stall:g} s in which the guardian "
                "detects a stalled run"
            )
        speed, needed = (
            speed_of(self.port, self.baudrate),
            SERIAL_BITS_PER_BYTE * MESSAGE_BYTES / min(dt, 1e-9 * STOP_ROUND),
        )
        if speed and needed > LINE_LOAD_LIMIT * speed:
            raise ValueError(
                f"baudrate {self.baudrate:g}: messages of {MESSAGE_BYTES} bytes use {needed / speed:.0%} of the line, "
                f"above the limit of {LINE_LOAD_LIMIT:.0%}. Queued messages would hold the relay after the run has "
                f"died. Set baudrate to {needed / LINE_LOAD_LIMIT:.0f} or more"
            )

    def opening(self) -> Any:
        if self.line == "serial":
            return {"port": self.port, "serial": self.serial, "baudrate": self.baudrate}
        return super().opening()

    def relay_frames(self) -> Sequence[bytes]:
        return [message(0), message(1)] if self.line == "serial" else [b"\0", b"\1"]

    def holds_power_of(self, device: Device) -> bool:
        return not self.protects or device.path in self.protects or device.bus in self.protects

    def fault_in_words(self, code: int) -> str:
        """Return the text of a code of `fault`; "" for 0."""
        return "its line is disconnected, so the relay opens" if code else ""

    def output_range(self) -> dict[str, Interval]:
        return {"changes": Interval(0.0), "fault": Interval(0.0, 1.0)}

    def emulator(self, **parameters: Any) -> EmulatedChargePump:
        return EmulatedChargePump.of(self, **parameters)


class EmulatedChargePump(StreamDevice):
    """Emulated relay and circuit of a ChargePump: the relay holds for `hold` after each level change."""

    hold = Param(
        0.1, "s", "hold time: from the last level change until the relay opens", above=0.0, max=1.0, fixed=True
    )
    messages = Param(
        0, "1", "1 if the level arrives as messages to a microcontroller, 0 if on a GPIO line", min=0, max=1, fixed=True
    )

    lost = Input("1", "true while the line is disconnected", default=False, dtype=bool)
    holds = Output("1", "true while the relay is closed", dtype=bool)
    changes = Output("1", "number of level changes", dtype=int)
    state = Memory(
        (0.0,) * 4,
        "newest level or number + 1, time of the newest change in s, 1 once the loss of the "
        "line has been reported, bytes in the buffer",
    )
    buffer = Memory((0.0,) * 2, "bytes of the partial message")

    decode = kernels.relay_decode
    encode = kernels.relay_encode
    kernel = kernels.relay
    feedthrough = ()

    @classmethod
    def of(cls, pump: ChargePump, **parameters: Any) -> EmulatedChargePump:
        """Return the emulator of one ChargePump. parameters : override those of the pump"""
        same: dict[str, Any] = {"bus": pump.bus, "hold": pump.hold, "messages": int(pump.line == "serial")}
        return cls(**same | parameters)

    def output_range(self, **inputs: Interval) -> dict[str, Interval]:
        return {"holds": Interval(0.0, 1.0), "changes": Interval(0.0)}
