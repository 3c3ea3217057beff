"""OpenIMU sensors on CAN, as a device family."""

from typing import Any

from blocks.imus.openimu.frames import ACCELERATION, ANGULAR_RATE, MAGNETIC_FIELD, SENDS_FIELD, SLOPE, SLOPE_1
from blocks.imus.openimu.imu import OpenImu
from graph.family import Family, Node

ACEINNA = 823  # manufacturer in a NAME
GROUPS = {
    SLOPE: "slope",
    ANGULAR_RATE: "angular rate",
    ACCELERATION: "acceleration",
    MAGNETIC_FIELD: "magnetic field",
    SLOPE_1: "slope",
}


def channels(imu: Any) -> Any:
    """Return the outputs that a unit with these settings measures."""
    field, slope = ["mag"] * bool(imu.types & SENDS_FIELD), ["roll", "pitch"] * imu.slope
    return ["accel", "gyro", *field, *slope]


class OpenImuFamily(Family):
    """Device family of ACEINNA's OpenIMU."""

    name = "OpenIMU"
    bus_hint = "an OpenIMU has 250 kbit/s as delivered"
    nodes = (
        Node(
            OpenImu,
            "OpenIMU",
            ACEINNA,
            GROUPS,
            {
                "model": ("model", "model of the unit"),
                "axes": ("axes", "frame of the outputs"),
                "keep-settings": ("write_settings", "write no settings, and keep the present axes of the unit"),
            },
            channels,
            OpenImu.enable_frames,
            silent="Pass --keep-settings to read it with its present settings",
        ),
    )


FAMILY = OpenImuFamily()
