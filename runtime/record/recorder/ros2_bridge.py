"""The process that publishes a run to ROS 2. Its service in the recorder starts it, and it ends with the recorder.

It answers with {"ready": text} or {"error": text}, and at the end with {"done": {"messages": number}}. It looks for a
new row when each is due, and then every 0.1 ms: the loop does not wake it, which would cost a system call per tick.
"""

from __future__ import annotations

import gc
import json
import os
import socket
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from operator import itemgetter
from struct import Struct
from typing import Any

from cext.clock import realtime
from cext.memory.shared_state import SharedState
from cext.recording.newest_row import NewestRow
from runtime.host.ending import ignore_signals
from runtime.host.errors import BadInput
from runtime.host.ros2_messages import DIAGNOSTICS, IMU, JOINT_STATE, Template, encode
from runtime.host.ros2_node import Node, named, topic_of
from runtime.host.system import name_process
from runtime.record.storage.messages import split

LOOK_PERIOD = 0.0001  # s
IDLE_PERIOD = 0.005  # s, before the first row, and while none comes
OVERDUE = 0.1  # s, after which none comes
SLICE = 1_000_000  # ns, of a processor: less than the usual 3 ms, and more than that of the loop
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
    wake_soon()
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
    gc.collect()
    gc.freeze()  # a collection of all objects that exist now takes longer than a tick
    bridge.run()
    answer({"done": {"messages": bridge.messages}})


def wake_soon() -> None:
    """Let this thread, and those of Zenoh that it starts, run soon after they are due. No privilege is needed."""
    realtime.set_timer_slack(1)
    with suppress(OSError):  # a sandbox forbids the call
        realtime.set_slice(SLICE)


class Bridge:
    """Publishers of one run.

    topics : [(publisher, template of its messages, function from a row to their numbers without the stamp)]
    """

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
            self.add_joint_states()
        for path in self.blocks:
            self.add_imu(path)
        self.diagnostics = self.node.publisher("/diagnostics", DIAGNOSTICS)
        self.messages, self.last, self.told = 0, None, 0.0
        self.level, self.text = OK, ""

    def add(
        self, path: str, kind: str, fixed: tuple[Any, ...], numbers: Callable[[Sequence[float]], Sequence[float]]
    ) -> None:
        """Add a topic. fixed : one of its messages, whose strings and lengths are those of all"""
        publisher = self.node.publisher(topic_of(self.plan["namespace"], path), kind)
        self.topics.append((publisher, Template(kind, fixed), numbers))

    def elements(self, signal: str, count: int, unit: str) -> list[int] | None:
        """Return the places of the elements of a signal in a row; None if it is not recorded in this unit."""
        paths = [f"{signal}[{number}]" for number in range(count)]
        known = all(self.units.get(path) == unit for path in paths)
        return [2 + self.places[path] for path in paths] if known else None

    def add_joint_states(self) -> None:
        """Add the topic of the joints: positions, and where all joints have them, velocities and torques."""
        groups = []
        for port in ("position", "velocity", "torque"):
            places = [self.places.get(f"{path}.{port}") for path in self.joints]
            groups.append([2 + place for place in places if place is not None] if None not in places else [])
        names, taken = [named(path) for path in self.joints], sum(groups, [])
        fixed = (((0, 0), ""), names, *groups)
        self.add("joint_states", JOINT_STATE, fixed, lambda row: [row[place] for place in taken])

    def add_imu(self, path: str) -> None:
        """Add the topic of a block that is an inertial sensor."""
        gyro, accel = self.elements(f"{path}.gyro", 3, "rad/s"), self.elements(f"{path}.accel", 3, "m/s²")
        if gyro is None or accel is None:
            return
        attitude = self.elements(f"{path}.quaternion", 4, "1")
        angular, linear = itemgetter(*gyro), itemgetter(*accel)
        turned = itemgetter(*attitude[1:], attitude[0]) if attitude else lambda row: (0.0, 0.0, 0.0, 1.0)

        def numbers(row: Sequence[float]) -> tuple[float, ...]:
            xyzw = turned(row)
            known = UNCERTAIN if attitude and xyzw[3] == xyzw[3] else UNKNOWN  # NaN: the sensor has sent none
            return (*xyzw, *known, *angular(row), *UNCERTAIN, *linear(row), *UNCERTAIN)

        zeros = (0.0,) * 3
        fixed = (((0, 0), named(path)), (0.0,) * 4, UNCERTAIN, zeros, UNCERTAIN, zeros, UNCERTAIN)
        self.add(path, IMU, fixed, numbers)

    def run(self) -> None:
        """Publish until the recorder has ended, and then the rows that were written meanwhile."""
        decimation, wait, recorded = self.plan["decimation"], IDLE_PERIOD, True
        while recorded:
            recorded = self.take_events(wait)
            if self.newest.look():
                for data in self.newest.rows:
                    row = self.unpack(data)
                    if int(row[0]) // decimation != self.last:
                        self.last = int(row[0]) // decimation
                        self.publish(row)
            wait = self.wait((self.last + 1) * decimation) if self.last is not None else IDLE_PERIOD
        if self.last is not None:
            self.tell()
        self.node.close()

    def wait(self, tick: int) -> float:
        """Return the time until the next look, in s. tick : the next one that is published"""
        since = time.monotonic_ns() - self.shared.began - self.shared.first_tick  # tick 0, ns
        late = since * 1e-9 - tick / self.plan["rate"]
        if late > OVERDUE or self.shared.state != "running":
            return IDLE_PERIOD
        return max(-late, LOOK_PERIOD)

    def publish(self, row: Sequence[float]) -> None:
        """Publish one row."""
        self.row = row
        when = (self.shared.wall + self.shared.first_tick) + round(row[0] / self.plan["rate"] * 1e9)
        self.stamp = divmod(when, 1_000_000_000)
        for publisher, template, numbers in self.topics:
            publisher.put(template.encode((*self.stamp, *numbers(row))))
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
        self.diagnostics.put(encode(DIAGNOSTICS, ((self.stamp, ""), listed)))
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
