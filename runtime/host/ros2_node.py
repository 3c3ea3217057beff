"""A node of ROS 2 as rmw_zenoh makes it, by eclipse-zenoh and without ROS (rmw_zenoh, docs/design.md).

message     key expression DOMAIN/TOPIC/TYPE/HASH; its attachment has sequence number, time and publisher
node        liveliness token @ros2_lv/DOMAIN/SESSION/0/0/NN/%/%/NAME
endpoint    liveliness token @ros2_lv/DOMAIN/SESSION/0/NUMBER/MP or MS/%/%/NAME/TOPIC/TYPE/HASH/QOS, by which
            `ros2 topic list` finds it
"""

from __future__ import annotations

import hashlib
import json
import re
import time
from collections.abc import Callable
from struct import Struct
from typing import Any

from runtime.host.optional_dependencies import need
from runtime.host.ros2_messages import type_hash

QOS = "::,10:,:,:,,"  # reliable, volatile, the last 10, without deadline, lifespan and lease
ATTACHMENT = Struct("<qqB16s")  # sequence number, ns since 1970, length and bytes of the publisher's ID
ROUTER_TIMEOUT = 2.0  # s
QUEUE = 16  # messages that wait for the sending thread, by default 2, which one tick fills; more are dropped


def named(text: str) -> str:
    """Return a text as part of a name in ROS: letters, digits and underscores."""
    name = re.sub(r"\W", "_", text, flags=re.ASCII)
    return f"_{name}" if name[:1].isdigit() else name


def topic_of(namespace: str, path: str) -> str:
    """Return a topic, such as /exo/left/thigh_imu, from a namespace and a path. A path from / on ignores it."""
    parts = path.split("/") if path.startswith("/") else [*namespace.split("/"), *path.split("/")]
    return "/" + "/".join(named(part) for part in parts if part)


class Node:
    """Node in the graph of ROS 2.

    name : name of the node
    router : endpoint of the Zenoh router, such as tcp/localhost:7447, which may start later
    domain : ROS_DOMAIN_ID

    Raises MissingExtra, or OSError for an endpoint that Zenoh rejects.
    """

    def __init__(self, name: str, router: str, domain: int) -> None:
        self.zenoh = zenoh = need("zenoh", "ROS 2")
        settings = {
            "mode": "peer",
            "connect/endpoints": [router],
            "connect/timeout_ms": 0,
            "connect/exit_on_failure": False,
            "connect/retry": {"period_init_ms": 200, "period_max_ms": 1000, "period_increase_factor": 2},
            "listen/endpoints": ["tcp/localhost:0"],
            "scouting/multicast/enabled": False,
            "transport/link/tx/queue/size/data": QUEUE,
        }
        config = zenoh.Config()
        try:
            for key, value in settings.items():
                config.insert_json5(key, json.dumps(value))
            self.session = zenoh.open(config)
        except zenoh.ZError as error:
            raise OSError(0, f"Zenoh rejects {router!r}: {str(error).partition(' at ')[0]}") from None
        self.name, self.domain, self.count = named(name), domain, 0
        self.tokens = [self.token(0, "NN")]

    def token(self, number: int, kind: str, *rest: str) -> Any:
        """Declare and return a liveliness token."""
        parts = ("@ros2_lv", self.domain, self.session.zid(), 0, number, kind, "%", "%", self.name, *rest)
        return self.session.liveliness().declare_token("/".join(map(str, parts)))

    def declare(self, kind: str, topic: str, message: str) -> tuple[str, str]:
        """Declare an endpoint. Returns its key expression and token. kind : MP or MS; message : type"""
        self.count += 1
        package, _, name = message.split("/")
        typed = f"{package}::msg::dds_::{name}_/{type_hash(message)}"
        token = self.token(self.count, kind, topic.replace("/", "%"), typed, QOS)
        self.tokens.append(token)
        return f"{self.domain}{topic}/{typed}", f"{self.session.zid()} {self.count}"

    def publisher(self, topic: str, message: str) -> Publisher:
        """Return a publisher. topic : such as /joint_states; message : type, such as sensor_msgs/msg/Imu"""
        return Publisher(self, topic, message)

    def subscribe(self, topic: str, message: str, take: Callable[[bytes, bytes], None]) -> Any:
        """Return a subscription, which exists as long as the object.

        take : is called by a thread of Zenoh with the bytes of a message and those of its attachment
        """
        key, _ = self.declare("MS", topic, message)

        def received(sample: Any) -> None:
            take(bytes(sample.payload), bytes(sample.attachment) if sample.attachment is not None else b"")

        return self.session.declare_subscriber(key, received)

    def connected(self, timeout: float = ROUTER_TIMEOUT) -> bool:
        """Return whether a router is connected; wait up to `timeout` s for one."""
        until = time.monotonic() + timeout
        while not (found := bool(self.session.info.routers_zid())) and time.monotonic() < until:
            time.sleep(0.02)
        return found

    def close(self) -> None:
        """Leave the graph."""
        self.session.close()


class Publisher:
    """Publisher of a node. It never waits: a message that the network does not take is dropped."""

    def __init__(self, node: Node, topic: str, message: str) -> None:
        self.number = 0
        key, name = node.declare("MP", topic, message)
        self.id = hashlib.sha256(name.encode()).digest()[:16]
        zenoh = node.zenoh
        self.publisher = node.session.declare_publisher(
            key, encoding=zenoh.Encoding.APPLICATION_CDR, congestion_control=zenoh.CongestionControl.DROP, express=True
        )

    def put(self, data: bytes) -> None:
        """Publish a message, as runtime.host.ros2_messages encodes it."""
        self.number += 1
        self.publisher.put(data, attachment=ATTACHMENT.pack(self.number, time.time_ns(), 16, self.id))
