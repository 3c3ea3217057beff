"""Process that subscribes to a topic of ROS 2, and passes its messages to the loop as lines of text.

    line    sequence number modulo 256, the numbers, time of publication on the sender's clock

Zenoh has threads of its own: none of that is in the control process. If this process ends, no lines arrive, and the
block becomes stale.
"""

from __future__ import annotations

import json
import math
import os
import select
import socket
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from struct import Struct

from runtime.host.ending import ignore_signals
from runtime.host.errors import BadInput
from runtime.host.ros2_messages import JOINT_STATE, NUMBERS, decode
from runtime.host.ros2_node import Node, topic_of
from runtime.host.run_mark import remove_mark
from runtime.host.system import name_process
from runtime.robot.rig.line import text_of

TYPES = {"Float64MultiArray": NUMBERS, "JointState": JOINT_STATE}
QUANTITIES = ("position", "velocity", "effort")  # fields of a JointState after its header and names
SOURCE = Struct("<qq")  # of an attachment: sequence number, ns since 1970; the rest is the publisher's ID
SILENCE = 1.0  # s, after which another publisher is taken
WINDOW = 10.0  # s, in one or two of which the shortest transit is sought


def main(answers: int, control: int, passed: int) -> None:
    """Run the process until the control process ends. The arguments are file descriptors."""
    ignore_signals()
    remove_mark()
    name_process("tickwork-ros2")
    wanted = json.loads(sys.stdin.readline() or "{}")
    topic, line, subscription = topic_of("", wanted["topic"]), socket.socket(fileno=passed), None
    try:
        node = Node(f"tickwork_{wanted['path']}", wanted["router"], wanted["domain"])
        if node.connected():
            messages = Messages(line, wanted["message"], wanted["labels"], wanted["max_delay"])
            subscription = node.subscribe(topic, messages.kind, messages.take)
            answer = {"topic": topic}
        else:
            hint = "start the router: ros2 run rmw_zenoh_cpp rmw_zenohd"
            answer = {"problem": f"no Zenoh router at {wanted['router']}", "hint": hint}
    except (BadInput, OSError) as error:
        answer = {"problem": getattr(error, "strerror", None) or str(error), "hint": "see docs/how_to/ros2.md"}
    os.write(answers, json.dumps(answer).encode() + b"\n")
    if subscription is not None:
        ended = select.poll()
        ended.register(control, select.POLLIN)
        ended.poll()


class Messages:
    """Messages of a topic, from one publisher at a time.

    line : socket that takes lines of text
    message : key of TYPES
    labels : as many names as a Float64MultiArray has elements, or quantities of joints such as "left_knee.effort"
    max_delay : s
    """

    def __init__(self, line: socket.socket, message: str, labels: Sequence[str], max_delay: float) -> None:
        line.setblocking(False)
        self.line, self.kind, self.max_delay = line, TYPES[message], max_delay
        self.width, self.wanted = len(labels), [label.rpartition(".") for label in labels]
        self.publisher, self.came = b"", -math.inf
        self.began = time.time_ns()  # a double resolves the time since then, in ns
        self.transits, self.window = [math.inf, math.inf], -math.inf  # shortest ones of this window and of the last, s

    def take(self, data: bytes, attachment: bytes) -> None:
        """Pass a message on. A thread of Zenoh calls it."""
        now = time.monotonic()
        if len(attachment) < SOURCE.size:
            return
        publisher = attachment[SOURCE.size :]
        if publisher != self.publisher:
            if now - self.came < SILENCE:
                return
            self.publisher, self.transits, self.window = publisher, [math.inf, math.inf], now
        number, stamp = SOURCE.unpack_from(attachment)
        self.came, stamp = now, (stamp - self.began) * 1e-9
        if self.delay(now, now - stamp) > self.max_delay:
            return
        with suppress(ValueError, BlockingIOError):
            numbers = text_of(self.values(decode(self.kind, data)))
            self.line.send(f"{number % 256},{numbers},{stamp:.9f}\n".encode())

    def delay(self, now: float, transit: float) -> float:
        """Return by how much a transit exceeds the shortest one, in s. transit : s, plus a constant of both clocks"""
        if now - self.window > WINDOW:
            self.transits, self.window = [math.inf, self.transits[0]], now
        self.transits[0] = min(self.transits[0], transit)
        return transit - min(self.transits)

    def values(self, message: Sequence) -> Sequence[float]:
        """Return the numbers of a message. Raises ValueError if one is missing, or if there are others."""
        if self.kind == NUMBERS:
            if len(message[1]) != self.width:
                raise ValueError
            return message[1]
        names, found = message[1], []
        for joint, _, quantity in self.wanted:
            numbers, place = message[2 + QUANTITIES.index(quantity)], names.index(joint)
            if place >= len(numbers):
                raise ValueError
            found.append(numbers[place])
        return found
