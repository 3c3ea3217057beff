"""A node of ROS 2 beside a busy processor."""

import os
import subprocess
import sys
import time
from functools import partial

import pytest

from tests.runtime.ros2 import IMU, JOINT_STATE, router

MESSAGES = f"""
import sys, time
from runtime.host.ros2_node import Node

node = Node("node", sys.argv[1], 7)
topics = ("/joints", {JOINT_STATE!r}), ("/thigh", {IMU!r}), ("/shank", {IMU!r})
publishers = [node.publisher(*topic) for topic in topics]
assert node.connected()
for tick in range(100):
    for publisher in publishers:
        publisher.put(b"%d" % tick)
    time.sleep(0.005)
time.sleep(0.5)
node.close()
"""


@pytest.mark.paced
def test_no_message_is_lost_on_a_busy_processor():
    alone = partial(os.sched_setaffinity, 0, {min(os.sched_getaffinity(0))})
    with router() as ros:
        taken = []
        subscription = ros.session.declare_subscriber("7/**", lambda sample: taken.append(bytes(sample.payload)))
        busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"], preexec_fn=alone) for _ in range(4)]
        try:
            subprocess.run([sys.executable, "-c", MESSAGES, ros.place], preexec_fn=alone, check=True, timeout=30)
        finally:
            for each in busy:
                each.kill()
                each.wait()
        deadline = time.monotonic() + 5.0
        while len(taken) < 300 and time.monotonic() < deadline:
            time.sleep(0.01)
        subscription.undeclare()
    assert sorted(map(int, taken)) == sorted(3 * list(range(100)))
