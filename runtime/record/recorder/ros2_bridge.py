"""The process that publishes a run to ROS 2. Its service in the recorder starts it, and it ends with the recorder.

It answers with {"ready": text} or {"error": text}, and at the end with {"done": {"messages": number}}. It looks for a
new row just before each is due, and then every 0.2 ms.
"""

from __future__ import annotations

import json
import os
import socket
import sys
import time
from collections.abc import Callable, Sequence
from struct import Struct
from typing import Any

from cext.memory.shared_state import SharedState
from cext.recording.newest_row import NewestRow
from runtime.host.ending import ignore_signals
from runtime.host.errors import BadInput
from runtime.host.ros2_messages import DIAGNOSTICS, IMU, JOINT_STATE
from runtime.host.ros2_node import Node, named, topic_of
from runtime.host.system import name_process
from runtime.record.storage.messages import split

LOOK_PERIOD = 0.0002  # s
EARLY, BEHIND = 0.0005, 0.002  # s before the next row is due, and if the last one was found late
IDLE_PERIOD = 0.005  # s, before the first row
DIAGNOSTICS_PERIOD = 1.0  # s
OK, ERROR = 0, 2  # levels of diagnostic_msgs
UNKNOWN = (-1.0,) + (0.0,) * 8  # covariance of a quantity that is not measured
UNCERTAIN = (0.0,) * 9  # covariance of which nothing is known
EVENT_BYTES = 1 << 16


def main(answers: int, control: int, shared: int, events: int) -> None:
    """Run the process.

    answers : file descriptor of the pipe to the recorder
    control : pidfd of the recorder
    shared : file descriptor of the shared state
    events : socket with the events, which ends with the recorder
    """
    ignore_signals()
    name_process("tickwork-ros2")
    plan = json.loads(sys.stdin.readline())

    def answer(message: dict[str, Any]) -> None:
        os.write(answers, json.dumps(message).encode() + b"\n")

    try:
        bridge = Bridge(plan, SharedState(fd=shared), socket.socket(fileno=events))
    except (BadInput, OSError) as error:
        answer({"error": getattr(error, "strerror", None) or str(error)})
        return
    connected = bridge.node.connected(0.5)
    reached = f"by the router {plan['router']}" if connected else f"as soon as a router runs at {plan['router']}"
    answer({"ready": f"{len(bridge.topics) + 1} topics in domain {plan['domain']}, {reached}"})
    bridge.run()
    answer({"done": {"messages": bridge.messages}})


class Bridge:
    """Publishers of one run. topics : [(publisher, function from a row to a message without its header)]"""

    def __init__(self, plan: dict[str, Any], shared: SharedState, events: socket.socket) -> None:
        self.plan, self.shared, self.events = plan, shared, events
        self.newest = NewestRow(shared, plan["width"])
        self.newest.keeps = True
        self.unpack = Struct(f"<{2 + plan['width']}d").unpack
        self.node = Node(f"tickwork_{plan['name']}", plan["router"], plan["domain"])
        self.places = {column["path"]: column["index"] for column in plan["columns"]}
        self.units = {column["path"]: column["unit"] for column in plan["columns"]}
        self.blocks = dict.fromkeys(path.rpartition(".")[0] for path in self.places)
        self.joints = [path for path in self.blocks if self.units.get(f"{path}.position") in ("rad", "m")]
        self.topics = []
        if self.joints:
            self.add("joint_states", JOINT_STATE, "", self.joint_states())
        for path in self.blocks:
            if make := self.imu(path):
                self.add(path, IMU, named(path), make)
        self.diagnostics = self.node.publisher("/diagnostics", DIAGNOSTICS)
        self.messages, self.last, self.told = 0, None, 0.0
        self.level, self.text = OK, ""

    def add(self, path: str, kind: str, frame: str, make: Callable[[Sequence[float]], tuple[Any, ...]]) -> None:
        """Add a topic. frame : frame_id of its messages"""
        self.topics.append((self.node.publisher(topic_of(self.plan["namespace"], path), kind), frame, make))

    def elements(self, signal: str, count: int, unit: str) -> list[int] | None:
        """Return the places of the elements of a signal in a row; None if it is not recorded in this unit."""
        paths = [f"{signal}[{number}]" for number in range(count)]
        known = all(self.units.get(path) == unit for path in paths)
        return [2 + self.places[path] for path in paths] if known else None

    def joint_states(self) -> Callable[[Sequence[float]], tuple[Any, ...]]:
        """Return the function that makes a JointState: positions, and where all joints have them, the others."""
        names = [named(path) for path in self.joints]
        groups = []
        for port in ("position", "velocity", "torque"):
            places = [self.places.get(f"{path}.{port}") for path in self.joints]
            groups.append([2 + place for place in places if place is not None] if None not in places else [])
        return lambda row: (names, *([row[place] for place in group] for group in groups))

    def imu(self, path: str) -> Callable[[Sequence[float]], tuple[Any, ...]] | None:
        """Return the function that makes an Imu; None for a block that is not an inertial sensor."""
        gyro, accel = self.elements(f"{path}.gyro", 3, "rad/s"), self.elements(f"{path}.accel", 3, "m/s²")
        attitude = self.elements(f"{path}.quaternion", 4, "1")
        if gyro is None or accel is None:
            return None

        def make(row: Sequence[float]) -> tuple[Any, ...]:
            w, x, y, z = (row[place] for place in attitude) if attitude else (1.0, 0.0, 0.0, 0.0)
            angular, linear = tuple(row[place] for place in gyro), tuple(row[place] for place in accel)
            known = UNCERTAIN if attitude and w == w else UNKNOWN  # NaN: the sensor has sent none
            return (x, y, z, w), known, angular, UNCERTAIN, linear, UNCERTAIN

        return make

    def run(self) -> None:
        """Publish until the recorder has ended."""
        decimation, period = self.plan["decimation"], self.plan["decimation"] / self.plan["rate"]
        wait, looks = IDLE_PERIOD, 0  # looks without a new row
        while self.take_events(wait):
            looks += 1
            if not self.newest.look():
                wait = LOOK_PERIOD if self.last is not None and self.shared.state == "running" else IDLE_PERIOD
                continue
            # a row that was there already may have waited for long: the next look is earlier
            wait, looks = max(period - (EARLY if looks > 1 else BEHIND), LOOK_PERIOD), 0
            for data in self.newest.rows:
                row = self.unpack(data)
                if int(row[0]) // decimation == self.last:
                    continue
                self.last = int(row[0]) // decimation
                self.publish(row)
        if self.last is not None:
            self.tell()
        self.node.close()

    def publish(self, row: Sequence[float]) -> None:
        """Publish one row."""
        self.row = row
        when = (self.shared.wall + self.shared.first_tick) + round(row[0] / self.plan["rate"] * 1e9)
        self.stamp = divmod(when, 1_000_000_000)
        for publisher, frame, make in self.topics:
            publisher.put(((self.stamp, frame), *make(row)))
        self.messages += len(self.topics)
        if when * 1e-9 - self.told > DIAGNOSTICS_PERIOD:
            self.told = when * 1e-9
            self.tell()

    def tell(self) -> None:
        """Publish the diagnostics: one status of the run, and one of each actuator."""
        counts = self.shared.statistics()
        values = [(name, str(counts[name])) for name in ("ticks", "missed", "dropped")]
        name, host = self.plan["name"], socket.gethostname()
        listed = [(self.level, f"{name}: run", self.text or self.shared.state, host, values)]
        for path in self.joints:
            own = {
                split(signal)[2]: self.row[2 + place]
                for signal, place in self.places.items()
                if signal.rpartition(".")[0] == path
            }
            fault = own.get("fault", 0.0)
            level, text = (ERROR, f"fault {fault:g}") if fault else (OK, "")
            listed.append((level, f"{name}: {path}", text, host, [(key, f"{own[key]:g}") for key in own]))
        self.diagnostics.put(((self.stamp, ""), listed))
        self.messages += 1

    def take_events(self, wait: float) -> bool:
        """Wait, and take the events of the recording. Returns False once the recorder has ended."""
        time.sleep(wait)
        while True:
            try:
                message = self.events.recv(EVENT_BYTES, socket.MSG_DONTWAIT)
            except BlockingIOError:
                return True
            except OSError:
                return False
            if not message:
                return False
            event = json.loads(message)
            self.text, self.told = event["text"], 0.0  # with the next row
            self.level = event["level"]
