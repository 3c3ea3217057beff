"""A router of Zenoh, and what ROS 2 nodes with rmw_zenoh would do there, by zenoh and rosbags alone."""

import json
import socket
import struct
import time
from collections import defaultdict
from contextlib import contextmanager

from tests.optional import Library

zenoh = Library("zenoh")
typesys = Library("rosbags.typesys")

JOINT_STATE, IMU = "sensor_msgs/msg/JointState", "sensor_msgs/msg/Imu"
DIAGNOSTICS, NUMBERS = "diagnostic_msgs/msg/DiagnosticArray", "std_msgs/msg/Float64MultiArray"


class Router:
    """A router, as rmw_zenohd is. place : its endpoint; received : {key expression: [(time, message, attachment)]}"""

    def __init__(self, session, place):
        self.session, self.place, self.received = session, place, defaultdict(list)
        self.store = typesys.get_typestore(typesys.Stores.ROS2_JAZZY)

    def key(self, domain, topic, kind):
        package, _, name = kind.split("/")
        return f"{domain}/{topic}/{package}::msg::dds_::{name}_/{self.store.hash_rihs01(kind)}"

    def listen(self, domain):
        def take(sample):
            kind = "/msg/".join(str(sample.key_expr).split("/")[-2].split("::msg::dds_::"))[:-1]
            message = self.store.deserialize_cdr(bytes(sample.payload), kind)
            attachment = struct.unpack("<qqB16s", bytes(sample.attachment))
            self.received[str(sample.key_expr)].append((time.time_ns(), message, attachment))

        self.subscription = self.session.declare_subscriber(f"{domain}/**", take)

    def tokens(self):
        """The liveliness tokens of all nodes and endpoints, without the ID of their session."""
        found = [str(reply.ok.key_expr).split("/") for reply in self.session.liveliness().get("@ros2_lv/**")]
        return {"/".join(parts[:2] + parts[3:]) for parts in found}

    def numbers(self, values):
        """A Float64MultiArray as CDR."""
        types = self.store.types
        layout = types["std_msgs/msg/MultiArrayLayout"]([], 0)
        import numpy as np

        return bytes(self.store.serialize_cdr(types[NUMBERS](layout, np.array(values, float)), NUMBERS))


def attachment(number, publisher=b"a", stamp=None):
    """An attachment of rmw_zenoh. stamp : ns, by default now"""
    return struct.pack("<qqB16s", number, time.time_ns() if stamp is None else stamp, 16, publisher * 16)


@contextmanager
def router():
    with socket.socket() as free:
        free.bind(("localhost", 0))
        place = f"tcp/localhost:{free.getsockname()[1]}"
    config = zenoh.Config()
    for key, value in (("mode", "router"), ("listen/endpoints", [place]), ("scouting/multicast/enabled", False)):
        config.insert_json5(key, json.dumps(value))
    session = zenoh.open(config)
    try:
        yield Router(session, place)
    finally:
        session.close()
