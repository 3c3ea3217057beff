"""Commands, data and base rates of MicroStrain's sensor generations, for the emulator. Real sensors are queried.

Source: MicroStrain's data communications protocols of the 3DM-GX5-25 and the 3DM-CV7-AHRS; layouts of the settings:
commands_3dm.h and commands_filter.h of the MIP SDK 4.0. A command with a setting stores it; of the settings, only the
rotation changes the data.
"""

from __future__ import annotations

import struct

from msgspec import Struct

from graph.names import suggestion


class Setting(Struct, frozen=True):
    """A setting that a sensor stores. command, reply : set and descriptor in one number; factory : its value"""

    command: int
    reply: int
    factory: bytes


def vector(*values: float) -> bytes:
    """Return numbers as on the wire."""
    return struct.pack(f">{len(values)}f", *values)


NONE, UNIT = vector(0.0, 0.0, 0.0), vector(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
GYRO_BIAS, HARD_IRON, SOFT_IRON = Setting(0x0C38, 0x9B, NONE), Setting(0x0C3A, 0x9C, NONE), Setting(0x0C3B, 0x9D, UNIT)
COMPLEMENTARY = Setting(0x0C51, 0x97, b"\1\1" + vector(10.0, 10.0))
FIXED = b"\1" + vector(0.0, -1.0, 1.0, 1.0, 1.0, 0.1)  # an adaptive measurement
OLDER_SETTINGS = (
    Setting(0x0C37, 0x9A, NONE),  # bias of the accelerometer
    GYRO_BIAS,
    HARD_IRON,
    SOFT_IRON,
    Setting(0x0C3E, 0x9E, b"\1"),  # coning and sculling
    Setting(0x0C40, 0x87, struct.pack(">I", 115200)),  # baud rate
    COMPLEMENTARY,
    Setting(0x0D11, 0x81, NONE),  # sensor to vehicle
    Setting(0x0D14, 0x84, b"\0\1"),  # what the filter estimates
    Setting(0x0D19, 0x88, b"\1"),  # automatic initialisation
    Setting(0x0D1A, 0x89, vector(0.02, 0.02, 0.02)),  # noise: accelerometer, gyroscope and its bias
    Setting(0x0D1B, 0x8A, vector(1e-4, 1e-4, 1e-4)),
    Setting(0x0D1D, 0x8C, NONE + vector(1e-6, 1e-6, 1e-6)),
    Setting(0x0D20, 0x8E, b"\0" + vector(0.01)),  # update at zero angular rate
    Setting(0x0D28, 0x93, vector(0.01, 0.01, 0.01)),  # noise: gravity, iron, magnetometer
    Setting(0x0D2B, 0x96, NONE),
    Setting(0x0D2C, 0x97, vector(*[0.0] * 9)),
    Setting(0x0D42, 0xB1, vector(0.1, 0.1, 0.1)),
    Setting(0x0D43, 0xB2, b"\1" + vector(0.0)),  # declination
    Setting(0x0D44, 0xB3, FIXED),  # adaptive: gravity, magnetic field, dip angle
    Setting(0x0D45, 0xB4, FIXED),
    Setting(0x0D46, 0xB5, b"\1" + vector(0.0, 1.0, 1.0, 0.1)),
)
NEWER_SETTINGS = (
    Setting(0x0C31, 0xB1, NONE),  # sensor to vehicle
    GYRO_BIAS,
    HARD_IRON,
    SOFT_IRON,
    COMPLEMENTARY,
    Setting(0x0D20, 0x8E, b"\0" + vector(0.01)),
    Setting(0x0D52, 0xD2, b"\0\0\2" + vector(*[0.0] * 9) + b"\2"),  # initialisation
)
ROTATION = {False: 0x0D11, True: 0x0C31}  # sensor to vehicle, by whether the model is newer

BASE = (0x0101, 0x0102, 0x0103, 0x0104, 0x0105, 0x0106, 0x0107, 0x017E)
CAPTURE_BIAS, RESET_FILTER, INITIAL_ATTITUDE, INITIAL_HEADING, TARE = 0x0C39, 0x0D01, 0x0D02, 0x0D03, 0x0D21
COMMANDS = (0x0C11, 0x0C30, CAPTURE_BIAS, RESET_FILTER, INITIAL_HEADING, TARE)
POLL_SENSOR, POLL_FILTER, POLL, STATUS, GPS_TIME = 0x0C01, 0x0C03, 0x0C0D, 0x0C64, 0x0172
OLDER = (
    *BASE,
    *COMMANDS,
    POLL_SENSOR,
    POLL_FILTER,
    STATUS,
    GPS_TIME,
    INITIAL_ATTITUDE,
    0x0C06,
    0x0C08,
    0x0C0A,
    0x0C0B,
    0x0C50,
    0x0D18,
)
NEWER = (*BASE, *COMMANDS, POLL, 0x0C0E, 0x0C0F, 0x0C54, 0x0D50)
SENSOR = (0x8004, 0x8005, 0x8007, 0x8008, 0x8009, 0x800A, 0x800C, 0x8014, 0x8017)
FILTER = (0x8203, 0x8204, 0x8205, 0x8206, 0x820D, 0x820E, 0x8210, 0x8213, 0x821C)
MAGNETOMETER = (0x8006, 0x8010)


class Model(Struct, frozen=True):
    """A MicroStrain model.

    name, number : name and number of the model
    newer : whether it is of the newer generation
    base_rate : Hz, of both sets
    commands, data : supported, each as set and descriptor in one number
    """

    name: str
    number: str
    newer: bool
    base_rate: float
    commands: tuple[int, ...]
    data: tuple[int, ...]

    @property
    def settings(self) -> tuple[Setting, ...]:
        """Return the settings that it stores."""
        return NEWER_SETTINGS if self.newer else OLDER_SETTINGS

    @property
    def known(self) -> tuple[int, ...]:
        """Return the commands and data in ascending order, as the sensor lists them."""
        return tuple(sorted({*self.commands, *(setting.command for setting in self.settings), *self.data}))


MODELS = {
    model.name: model
    for model in (
        Model(
            "3DM-GX5-25", "6253-4220", False, 1000.0, OLDER, (*SENSOR, *MAGNETOMETER, 0x8011, 0x8012, *FILTER, 0x8211)
        ),
        Model("3DM-CV5-10", "6259-4220", False, 1000.0, OLDER, (*SENSOR, 0x8012, *FILTER, 0x8211)),
        Model(
            "3DM-CV7-AHRS",
            "6286-9956",
            True,
            1000.0,
            NEWER,
            (*SENSOR, *MAGNETOMETER, 0x80D3, 0x80D4, 0x80D5, *FILTER, 0x82D3, 0x82D4, 0x82D5),
        ),
    )
}


def find(name: str) -> Model:
    """Return the Model of a name. Raises ValueError for an unknown name."""
    if name not in MODELS:
        raise ValueError(suggestion(name, MODELS) or f"expected one of {', '.join(MODELS)}, got {name!r}")
    return MODELS[name]
