"""A subscription to ROS 2 on a rig: messages that rosbags encodes come through a Zenoh router."""

import math
import socket
import threading
import time

import numpy as np
import pytest

import runtime
from blocks.sensors import Ros2Subscription
from runtime.host.ros2_messages import JOINT_STATE, encode
from runtime.robot.rig.errors import Refused
from runtime.robot.rig.ros2_line import open_line
from runtime.robot.rig.ros2_receiver import Messages
from tests.graph.complaints import refusal
from tests.runtime.ros2 import NUMBERS, attachment, router
from tests.runtime.runs import write

DIAGRAM = """
from blocks.recorders import CsvRecorder
from blocks.sensors import Ros2Subscription
from graph import Diagram

with Diagram("commanded", rate=200) as diagram:
    channels = (("left", "N·m"), ("count", "1"))
    Ros2Subscription(channels=channels, timeout=0.3, name="command")
    Ros2Subscription(channels=channels, timeout=0.0, name="held")
    CsvRecorder()
"""


@pytest.mark.paced
def test_commands_arrive_with_their_age_and_a_stale_command_ends_the_run_or_is_held(tmp_path):
    folder, sent = tmp_path / "recordings", []

    def publish(ros):
        publisher = ros.session.declare_publisher(ros.key(5, "exo/command", NUMBERS))
        while not any(path.stat().st_size > 30_000 for path in folder.glob("*.csv")):
            sent.append(time.time_ns())
            data = ros.numbers([0.5 * len(sent), len(sent)])
            publisher.put(data, attachment=attachment(len(sent), stamp=sent[-1]))
            time.sleep(0.01)

    with router() as ros:
        sender = threading.Thread(target=publish, args=(ros,), daemon=True)
        sender.start()
        robot = write(tmp_path, DIAGRAM)
        device = f'topic = "/exo/command"\nrouter = "{ros.place}"\ndomain = 5\n'
        rig = write(tmp_path, f"[device.command]\n{device}\n[device.held]\n{device}", "lab.toml")
        trial = runtime.run(robot, 30.0, rig=rig, yes=True, record=str(folder))
        sender.join()
    count, age = trial["command.count"], trial["command.age"]
    assert np.array_equal(trial["command.left"], 0.5 * count) and np.all(np.diff(count) >= 0.0)
    assert count[-1] == len(sent) and np.unique(count).size > 30
    steps = np.diff(np.array(sent))[count[1:].astype(int) - 2] * 1e-9  # of the clock of the sender
    fresh = np.flatnonzero(np.diff(count) == 1.0)
    assert np.allclose(np.diff(trial["command.stamp"])[fresh], steps[fresh], rtol=0.0, atol=1e-6)
    assert trial.fault is not None and "command" in str(trial.fault) and age[-1] > 0.29
    assert trial["held.left"][-1] == trial["command.left"][-1] and trial["held.age"][-1] > 0.29


def test_a_missing_router_is_refused_with_the_command_that_starts_it():
    options = {"message": "JointState", "labels": ["knee.effort"], "max_delay": 0.1, "domain": 0}
    with pytest.raises(Refused, match="no Zenoh router at tcp/localhost:9") as refused:
        open_line("command", "/command", "tcp/localhost:9", **options)
    assert "rmw_zenohd" in str(refused.value.problem.hint)
    with pytest.raises(Refused, match="command has no name of a topic"):
        open_line("command", "", "tcp/localhost:9", **options)


@pytest.fixture
def lines():
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    ours.setblocking(False)
    with ours, theirs:
        yield theirs, lambda: received(ours)


def received(ours):
    """(counter, numbers) of the lines since the last time."""
    found = []
    while True:
        try:
            counter, *numbers, _ = map(float, ours.recv(1024).split(b","))
        except BlockingIOError:
            return found
        found.append((int(counter), numbers))


def test_only_the_first_publisher_is_used_and_late_or_malformed_messages_are_dropped(lines, monkeypatch):
    line, passed = lines
    clock = [100.0]
    monkeypatch.setattr(time, "monotonic", lambda: clock[0])
    messages = Messages(line, "Float64MultiArray", ["left", "right"], 0.05)
    started = messages.began

    def send(number, values=(1.0, 2.0), publisher=b"a", after=0.0, late=0.0):
        clock[0] += after
        stamp = started + round((clock[0] - 100.0 - late) * 1e9)
        data = encode(messages.kind, (((), 0), values))
        messages.take(data, attachment(number, publisher, stamp))
        return passed()

    assert send(1) == [(1, [1.0, 2.0])]
    assert send(2, publisher=b"b", after=0.5) == []  # another one while the first is alive
    assert send(257, (3.0, -4.5), after=0.4) == [(1, [3.0, -4.5])]
    assert send(258, (1.0, 2.0, 3.0), after=0.01) == [] == send(259, (1.0,))  # other widths
    assert send(260, after=0.01, late=0.06) == []  # has waited in the network
    assert send(261, after=0.01, late=0.04) == [(5, [1.0, 2.0])]
    [(_, numbers)] = send(262, (math.nan, 1795903895.123456), after=0.01)
    assert math.isnan(numbers[0]) and numbers[1] == 1795903895.123456
    messages.take(b"\x00\x01\x00\x00" + b"\xff" * 40, attachment(263, stamp=started + round((clock[0] - 100.0) * 1e9)))
    messages.take(b"", b"short")
    assert passed() == []
    assert send(7, publisher=b"b", after=1.5, late=3.0) == [(7, [1.0, 2.0])]  # the first one has gone; another clock
    assert send(8, publisher=b"b", after=0.01, late=3.0) == [(8, [1.0, 2.0])]


def test_quantities_of_a_joint_state_are_selected_by_the_name_of_the_joint(lines):
    line, passed = lines
    messages = Messages(line, "JointState", ["knee.effort", "left.hip.position"], 10.0)
    header = ((0, 0), "")
    messages.take(encode(JOINT_STATE, (header, ["left.hip", "knee"], [1.0, 2.0], [], [3.0, 4.0])), attachment(1))
    messages.take(encode(JOINT_STATE, (header, ["left.hip"], [1.0], [], [3.0])), attachment(2))
    messages.take(encode(JOINT_STATE, (header, ["left.hip", "knee"], [1.0, 2.0], [], [3.0])), attachment(3))
    assert passed() == [(1, [4.0, 1.0])]


def test_a_single_channel_without_its_comma_is_an_error_with_an_example():
    found = str(refusal(Ros2Subscription, channels=("torque", "N·m")))
    assert "channel 1 must be (name, unit) or" in found
    assert 'channels=(("emg", "mV"),) with a comma after a single one, got \'torque\'' in found
