"""Subscription to a topic of ROS 2: numbers of another program, such as commands, with their age."""

from __future__ import annotations

from typing import Any

from blocks.sensors.received import ReceivedStream
from graph import Param

TYPES = ("Float64MultiArray", "JointState")
QUANTITIES = ("position", "velocity", "effort")


class Ros2Subscription(ReceivedStream):
    """Numbers of a topic of ROS 2, such as commands, each in an output of its declared unit.

    A Float64MultiArray gives its elements in order. A JointState gives the quantity of a joint that the label names:
    ("torque", "N·m", "left_knee.effort").

    A process receives the messages by Zenoh, as rmw_zenoh does, and passes each to the loop, which uses the newest. A
    message with another number of elements, or without a named joint, is dropped and counted in `lost`, as is one whose
    transit takes `max_delay` longer than the shortest one. Of several publishers only the first is used, until it has
    been silent for a second. `stamp` is the time of publication on the sender's clock, less the start of this receiver.

    Without messages for `timeout` the run ends in the safe stop. With `timeout=0` the outputs keep their last values,
    and `age` increases.

    Requires eclipse-zenoh: `pip install 'tickwork[ros2]'`.
    """

    topic = Param("", "1", "topic, such as /exo/command; set in the diagram or in the rig file", dtype=str)
    message = Param("Float64MultiArray", "1", "type of its messages", choices=TYPES)
    router = Param("tcp/localhost:7447", "1", "endpoint of the Zenoh router, `rmw_zenohd` of ROS 2", dtype=str)
    domain = Param(0, "1", "ROS_DOMAIN_ID of the nodes", min=0, max=232, fixed=True, kernel=False)
    max_delay = Param(
        0.05,
        "s",
        "time by which the transit of a message may exceed the shortest one; it is dropped after a longer one",
        above=0.0,
        fixed=True,
        kernel=False,
    )

    clocks = (("stamp", "float64", "s"),)
    line = "ros2"
    hardware = ("topic", "router", "domain")
    examples = (
        {"channels": (("left", "N·m"), ("right", "N·m")), "topic": "/command"},
        {"channels": (("left", "N·m", "left_knee.effort"),), "message": "JointState"},
    )

    def configure(self) -> None:
        super().configure()
        for name, unit, *label in self.channels:
            joint, _, quantity = (label[0] if label else "").rpartition(".")
            if self.message == "JointState" and not (joint and quantity in QUANTITIES):
                example = f'("{name}", "{unit}", "left_knee.effort")'
                raise ValueError(f"channel {name} needs the quantity of a joint of the JointState, as in {example}")

    def opening(self) -> dict[str, Any]:
        return {
            "topic": self.topic,
            "message": self.message,
            "router": self.router,
            "domain": self.domain,
            "labels": [label[0] if label else name for name, _, *label in self.channels],
            "max_delay": self.max_delay,
        }
