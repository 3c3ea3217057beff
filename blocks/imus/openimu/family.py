"""OpenIMU sensors on CAN, as a device family."""

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


def channels(imu):
    """Return the outputs that a unit with these settings measures."""
    field, slope = ["mag"] * bool(imu.types & SENDS_FIELD), ["roll", "pitch"] * imu.slope
    return ["accel", "gyro", *field, *slope]


def set_up(imu):
    """Return the frames that set a unit up and ask for its settings; none where it is read as it is."""
    return imu.enable_frames() if imu.told else []


class OpenImuFamily(Family):
    name = "OpenIMU"
    bus_hint = "an OpenIMU as it is sold has 250 kbit/s"
    nodes = (
        Node(
            OpenImu,
            "OpenIMU",
            ACEINNA,
            GROUPS,
            {
                "model": ("model", "which unit it is"),
                "axes": ("axes", "frame of what is shown"),
                "untold": ("told", "set nothing, and read it in the axes in which it sends"),
            },
            channels,
            set_up,
            silent="--untold reads it as it is",
        ),
    )


FAMILY = OpenImuFamily()
