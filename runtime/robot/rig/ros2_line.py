"""Lines from topics of ROS 2, which a process of its own receives.

Keys of `opening`:

    topic, message  topic, and name of its type
    router, domain  endpoint of the Zenoh router, and ROS_DOMAIN_ID
    labels          name of each element, or the quantity of a joint
    max_delay       s
"""

from __future__ import annotations

import os
import socket
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from runtime.robot.rig.errors import Refused, RigProblem
from runtime.robot.rig.line import Opened, one_by_one
from runtime.robot.rig.lsl_line import Receiver

if TYPE_CHECKING:
    from graph import StreamDevice


def open_lines(devices: Iterable[StreamDevice]) -> dict[StreamDevice, Opened | RigProblem]:
    """Open the lines of `devices`. Returns {device: Opened or RigProblem}."""
    return one_by_one(devices, lambda device: open_line(device.path, **device.opening()))


def open_line(path: str, topic: str, router: str, **options: Any) -> Opened:
    """Subscribe to a topic. path : device named in messages. Raises Refused."""
    name = f'[device."{path}"] topic = "{topic}"'
    if not topic.strip("/"):
        hint = f'write in the rig file: [device."{path}"] topic = "/NAME"'
        raise Refused(RigProblem("TW102", f"{path} has no name of a topic", hint))
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    ours.setblocking(False)
    with ours, theirs:
        wanted = {"path": path, "topic": topic, "router": router, **options}
        receiver = Receiver("runtime.robot.rig.ros2_receiver", theirs, wanted)
        try:
            answer = receiver.answer()
            if "problem" in answer:
                raise Refused(RigProblem("TW128", f"{name}: {answer['problem']}", answer.get("hint", "start it again")))
        except BaseException:
            receiver.close()
            raise
        return Opened(os.dup(ours.fileno()), f"{answer['topic']} by {router}", close=receiver.close)
