"""Emulated MicroStrain sensor, for a plant or on a pseudo-terminal."""

from __future__ import annotations

from typing import Any

from blocks.imus.microstrain import models, mounting
from blocks.imus.microstrain.descriptors import (
    FILTER,
    SENSOR,
    STANDARD,
    STANDARD_GRAVITY,
    UNTURNED,
    lacking,
    of_complementary_filter,
    requested,
    wanted,
)
from cext.kernels.devices.microstrain import emulator as kernels
from graph import Device, Input, Interval, Memory, Output, Param

FIELD_LIMIT = 16  # fields of a format, of cext/kernels/devices/microstrain/settings.pxd
INFO = 16  # characters of each text in the device information


class EmulatedMicroStrain(Device):
    """Emulated MicroStrain sensor with MIP on an in-memory line or a pseudo-terminal.

    `EmulatedMicroStrain.of(robot["left/shank_imu"])` emulates the sensor of a robot's block and streams from the start
    with the settings of the block. With `streaming_at_start=False`, and on a line of `emulate`, it waits for its
    set-up, as after being plugged in. After a disconnection the sensor has its saved settings. With every fault input
    at zero, the sensor is healthy. It sends at most 256 bytes per tick of the plant. Of its settings, only rate,
    formats, streams and the sensor-to-vehicle rotation change the data.
    """

    bus = Param("imu", "1", "logical name of the line", dtype=str)
    model = Param("3DM-GX5-25", "1", f"model: {', '.join(models.MODELS)}", dtype=str)
    serial = Param("133931", "1", "serial number", dtype=str)
    rate = Param(200.0, "Hz", "rate of the samples", above=0.0, max=1000.0, fixed=True)
    channels = Param(STANDARD, "1", "requested channels, as for MicroStrain", dtype=tuple)
    attitude = Param(
        "filter", "1", "source of quaternion and euler, as for MicroStrain", dtype=str, choices=("filter", "sensor")
    )
    sensor_to_vehicle = Param(
        (), "rad", "stored roll, pitch and yaw of the sensor relative to the vehicle, as for MicroStrain", dtype=tuple
    )
    streaming_at_start = Param(True, "1", "whether the sensor streams before it is configured", fixed=True)
    clock_error = Param(0.0, "1", "relative slowness of the sensor's clock", min=-0.01, max=0.01, fixed=True)
    clock_start = Param(1000.0, "s", "time of the sensor's clock at the start", min=0.0, fixed=True)
    seed = Param(1, "1", "seed of lost and corrupted data", min=1, max=1_000_000, fixed=True)

    accel = Input("m/s²", "specific force", shape=(3,), default=(0.0, 0.0, -STANDARD_GRAVITY))
    gyro = Input("rad/s", "angular rate", shape=(3,), default=(0.0, 0.0, 0.0))
    mag = Input("µT", "magnetic field", shape=(3,), default=(20.0, 0.0, 45.0))
    quaternion = Input("1", "attitude relative to north, east, down, w first", shape=(4,), default=(1.0, 0.0, 0.0, 0.0))
    temperature = Input("°C", "temperature of the sensor", default=30.0)
    silent = Input("1", "whether the sensor sends nothing", default=False, dtype=bool)
    garbage = Input("1", "mean number of random bytes before a packet", default=0.0)
    dropped = Input("1", "fraction of lost bytes, 0 to 1", default=0.0)
    flipped = Input("1", "fraction of packets with a wrong bit, 0 to 1", default=0.0)
    skipped = Input("1", "fraction of packets that are not sent, 0 to 1", default=0.0)
    not_a_number = Input("1", "whether all values are NaN", default=False, dtype=bool)
    uninitialised = Input("1", "whether the filter marks all values as invalid", default=False, dtype=bool)
    disconnected = Input("1", "whether the cable is unplugged", default=False, dtype=bool)
    streaming = Output("1", "whether the sensor streams", dtype=bool)
    heading = Output("1", "heading source of the filter: 0 none, 1 magnetometer", dtype=int)
    cutoff = Output("Hz", "cut-off of the low-pass")
    sent = Output("1", "number of data packets sent", dtype=int)

    about = Memory(0.0, "bytes of the device information")
    known = Memory(0.0, "descriptors of the supported commands and data")
    settings = Memory((0.0,) * 6, "base rate, generation, error and start of the clock, seed, model")
    power_on = Memory(0.0, "formats, and 1 for each set that streams")
    registers = Memory(0.0, "commands of further settings, their replies, lengths and factory values")
    state = Memory((0.0,) * kernels.state_doubles, "settings, and bytes to be sent")

    medium = "stream"
    decode = kernels.decode
    encode = kernels.encode
    sent_outputs = ("streaming", "heading", "cutoff", "sent")

    @classmethod
    def of(cls, sensor: Any, **parameters: Any) -> EmulatedMicroStrain:
        """Return the emulator of a robot's block."""
        names = ("bus", "rate", "channels", "attitude", "sensor_to_vehicle", *(("serial",) if sensor.serial else ()))
        same: dict[str, Any] = {name: getattr(sensor, name) for name in names}
        same["streaming_at_start"] = not sensor.on_emulated_line
        return cls(**same | parameters)

    def configure(self) -> None:
        spec = self.spec = models.find(self.model)
        divided = spec.base_rate / self.rate
        if abs(divided - round(divided)) > 1e-6:
            raise ValueError(f"rate must be {spec.base_rate:g} Hz divided by an integer, got {self.rate:g} Hz")
        _, refused = lacking(self.channels, self.attitude, spec.data)
        if refused:
            raise ValueError(f"channels: the {spec.name} has no {', '.join(refused)}")
        if any(self.sensor_to_vehicle) and not spec.newer:
            if of_complementary_filter(wanted(self.channels, self.attitude)):
                raise ValueError(f"the rotation of the {spec.name}, {'; '.join(UNTURNED)}")
        texts = (spec.name, spec.number, f"{spec.number[:4]}.{self.serial}", "", "5g, 300dps")
        data = (1106).to_bytes(2, "big") + b"".join(text[:INFO].rjust(INFO).encode("ascii") for text in texts)
        self.about, self.known = tuple(map(float, data)), tuple(map(float, spec.known))
        clock = (self.clock_error, self.clock_start)
        self.settings = (spec.base_rate, float(spec.newer), *clock, float(self.seed), float(spec.number[:4]))
        self.registers = tuple(number for setting in spec.settings for number in self.register(setting))
        self.power_on = (*self.saved(SENSOR, round(divided)), *self.saved(FILTER, round(divided)))

    def register(self, setting: models.Setting) -> tuple[float, ...]:
        """Return the row of a setting."""
        factory = setting.factory
        if setting.command == models.ROTATION[self.spec.newer] and self.sensor_to_vehicle:
            factory = models.vector(*mounting.stored_angles(self.sensor_to_vehicle, self.spec.newer))
        head = (float(setting.command), float(setting.reply), float(len(factory)))
        return *head, *map(float, factory), *[0.0] * (kernels.value_limit - len(factory))

    def saved(self, descriptor_set: int, decimation: int) -> tuple[float, ...]:
        """Return the format of one set at power-on, and whether it streams."""
        fields = requested(wanted(self.channels, self.attitude), descriptor_set, self.spec.data)
        numbers = [float(number) for descriptor in fields for number in (descriptor, decimation)]
        return (
            len(numbers) / 2,
            *numbers,
            *[0.0] * (2 * FIELD_LIMIT - len(numbers)),
            float(bool(fields) and self.streaming_at_start),
        )

    def output_range(self, **inputs: Interval) -> dict[str, Interval]:
        return {"streaming": Interval(0.0, 1.0), "heading": Interval(0.0, 255.0), "sent": Interval(0.0)}
