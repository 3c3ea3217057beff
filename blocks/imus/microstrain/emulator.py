"""Emulated MicroStrain sensor: it exchanges the same bytes, for a plant or on a pseudo-terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from blocks.imus.microstrain import models
from blocks.imus.microstrain.descriptors import BY_NAME, FILTER, SENSOR, STANDARD_GRAVITY, wanted
from cext.kernels.devices.microstrain import emulator as kernels
from graph import Device, Input, Interval, Memory, Output, Param

if TYPE_CHECKING:
    pass

FIELD_LIMIT = 16  # fields of a format, of cext/kernels/devices/microstrain/emulator.pyx
INFO = 16  # characters of each text in the device information


class EmulatedMicroStrain(Device):
    """A MicroStrain sensor on an in-memory line or behind a descriptor: it takes the commands of MIP, and answers and
    streams byte for byte.

    `EmulatedMicroStrain.of(robot["left/shank_imu"])` plays the sensor of a robot's block: it streams from the start as
    that would have set it up. With streaming=False it waits to be set up, as one does that has just been plugged in. A
    line that is disconnected reports that, and after its return the sensor is as it was saved. Every input of a fault
    at zero is a healthy sensor. In a tick of the plant it sends 256 bytes at most.
    """

    bus = Param("imu", "1", "logical name of its line", dtype=str)
    model = Param("3DM-GX5-25", "1", f"one of {', '.join(models.MODELS)}", dtype=str)
    serial = Param("133931", "1", "its serial number", dtype=str)
    rate = Param(200.0, "Hz", "of its samples", above=0.0, max=1000.0, fixed=True)
    channels = Param(("accel", "gyro", "mag", "quaternion", "temperature"), "1", "as for the sensor", dtype=tuple)
    attitude = Param("filter", "1", "as for the sensor", dtype=str, choices=("filter", "sensor"))
    streaming_at_start = Param(True, "1", "whether it streams before it is set up", fixed=True)
    clock_error = Param(
        0.0, "1", "by how much its clock is slower than the computer's", min=-0.01, max=0.01, fixed=True
    )
    clock_start = Param(1000.0, "s", "time of its clock at the start", min=0.0, fixed=True)
    seed = Param(1, "1", "of what gets lost and spoilt", min=1, max=1_000_000, fixed=True)

    accel = Input("m/s²", "specific force", shape=(3,), default=(0.0, 0.0, -STANDARD_GRAVITY))
    gyro = Input("rad/s", "angular rate", shape=(3,), default=(0.0, 0.0, 0.0))
    mag = Input("µT", "magnetic field", shape=(3,), default=(20.0, 0.0, 45.0))
    quaternion = Input("1", "attitude against north, east, down, w first", shape=(4,), default=(1.0, 0.0, 0.0, 0.0))
    temperature = Input("°C", "of the sensor", default=30.0)
    silent = Input("1", "whether it sends nothing", default=False, dtype=bool)
    garbage = Input("1", "bytes of garbage in front of a packet, on the mean", default=0.0)
    dropped = Input("1", "share of its bytes that get lost, 0 to 1", default=0.0)
    flipped = Input("1", "share of its packets with a wrong bit, 0 to 1", default=0.0)
    skipped = Input("1", "share of its packets that never leave, 0 to 1", default=0.0)
    not_a_number = Input("1", "its values are NaN", default=False, dtype=bool)
    uninitialised = Input("1", "its filter calls nothing valid", default=False, dtype=bool)
    disconnected = Input("1", "its cable is out", default=False, dtype=bool)
    streaming = Output("1", "whether it streams", dtype=bool)
    heading = Output("1", "what its filter takes the heading from: 0 nothing, 1 its magnetometer", dtype=int)
    cutoff = Output("Hz", "what its low-pass was set to")
    sent = Output("1", "packets of data that it made", dtype=int)

    about = Memory(0.0, "bytes of its device information")
    known = Memory(0.0, "its commands and its data")
    settings = Memory((0.0,) * 5, "base rate, generation, error and start of its clock, seed")
    power_on = Memory(0.0, "its formats, and whether it streams")
    state = Memory((0.0,) * kernels.state_doubles, "its settings, and bytes that wait to be sent")

    medium = "stream"
    decode = kernels.decode
    encode = kernels.encode
    sent_outputs = ("streaming", "heading", "cutoff", "sent")

    @classmethod
    def of(cls, sensor: Any, **parameters: Any) -> EmulatedMicroStrain:
        """The emulator of one block of a robot."""
        same = {name: getattr(sensor, name) for name in ("bus", "rate", "channels", "attitude")}
        if sensor.serial:
            same["serial"] = sensor.serial
        return cls(**same | parameters)

    def configure(self) -> None:
        spec = self.spec = models.find(self.model)
        divided = spec.base_rate / self.rate
        if abs(divided - round(divided)) > 1e-6:
            raise ValueError(f"rate must be {spec.base_rate:g} Hz divided by a whole number, got {self.rate:g} Hz")
        texts = (spec.name, spec.number, f"{spec.number[:4]}.{self.serial}", "", "5g, 300dps")
        data = (1106).to_bytes(2, "big") + b"".join(text[:INFO].rjust(INFO).encode("ascii") for text in texts)
        self.about, self.known = tuple(map(float, data)), tuple(map(float, spec.known))
        self.settings = (spec.base_rate, float(spec.newer), self.clock_error, self.clock_start, float(self.seed))
        self.power_on = (*self.saved(SENSOR, round(divided)), *self.saved(FILTER, round(divided)))

    def saved(self, descriptor_set: int, decimation: int) -> tuple[float, ...]:
        """The format of one set as it is at power on, and whether it streams."""
        time = (
            0xD5
            if self.spec.newer
            else BY_NAME["sensor_time" if descriptor_set == SENSOR else "filter_time"].descriptor
        )
        fields = [field.descriptor for field in wanted(self.channels, self.attitude) if field.set == descriptor_set]
        fields = [descriptor for descriptor in fields if descriptor_set << 8 | descriptor in self.spec.known]
        numbers = [
            float(number) for descriptor in ([time, *fields] if fields else []) for number in (descriptor, decimation)
        ]
        return (
            len(numbers) / 2,
            *numbers,
            *[0.0] * (2 * FIELD_LIMIT - len(numbers)),
            float(bool(fields) and self.streaming_at_start),
        )

    def output_range(self, **inputs: Interval) -> dict[str, Interval]:
        return {"streaming": Interval(0.0, 1.0), "heading": Interval(0.0, 255.0), "sent": Interval(0.0)}
