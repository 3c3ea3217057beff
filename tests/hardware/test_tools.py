"""The tools for real buses on real SocketCAN: every interface is looked at, and what the controller tells of the wire
is told.
"""

import json
import threading
import time

import pytest

from tests.hardware.vcan import ERROR, Node, ip, needs_own_kernel, needs_vcan
from tests.runtime.runs import finished
from tests.runtime.setup.commissioning.nodes import DISABLE, Mit, Nodes, OpenImu, Private

pytestmark = [needs_vcan, pytest.mark.soak]


def test_without_a_rig_every_interface_is_scanned_and_nothing_is_armed(tmp_path):
    drive = Mit(3, position=0.5)
    with Nodes("vcan0", drive, Private(9), OpenImu()):
        process = finished("scan", "--json", "--listen", "0.3", "--ids", "1-20", cwd=tmp_path)
    assert process.returncode == 0, process.stdout + process.stderr
    [report] = [bus for bus in json.loads(process.stdout)["buses"] if bus["channel"] == "vcan0"]
    assert [(found["can_id"], found["family"]) for found in report["drives"]] == [
        (3, "CubeMars in MIT mode"),
        (9, "RobStride"),
    ]
    assert [(node["address"], node["manufacturer"]) for node in report["nodes"]] == [(128, 823)]
    assert (report["bus"], report["interface"]) == ("vcan0", "socketcan")
    standard = [(identifier, data) for identifier, extended, data in drive.heard if not extended]
    assert standard == [(can_id, DISABLE) for can_id in range(1, 21)] and not drive.enabled
    sent = [(frame["id"], frame["extended"], bytes.fromhex(frame["data"])) for frame in report["sent"]]
    assert [frame for frame in drive.heard if frame in sent] == sent


def test_error_frames_and_silence_are_reported_as_the_bitrate(tmp_path):
    """A controller at another bitrate reports errors, and hears nobody."""
    done = threading.Event()

    def babble():
        with Node() as node:
            while not done.is_set():
                node.send(ERROR | 0x04, bytes([0, 0x10, 0, 0, 0, 0, 0, 0]))  # error-passive
                time.sleep(0.05)

    thread = threading.Thread(target=babble)
    thread.start()
    try:
        process = finished("scan", "--channel", "vcan0", "--listen", "0.3", "--ids", "1-3", cwd=tmp_path)
    finally:
        done.set()
        thread.join()
    assert (
        process.returncode == 1
        and "! no valid frames (" in process.stdout
        and "The most likely cause is the bitrate" in process.stdout
    )
    assert "sudo ip link set vcan0 type can bitrate 250000" in process.stdout


@needs_own_kernel
def test_an_interface_that_is_down_is_reported_with_its_remedy(tmp_path):
    ip("set", "vcan0", "down")
    try:
        process = finished("scan", "--channel", "vcan0", cwd=tmp_path)
    finally:
        ip("set", "vcan0", "up")
    assert (
        process.returncode == 1
        and ("error TW114 interface down: [bus.vcan0] vcan0 is down\n    sudo ip link set vcan0 up") in process.stderr
    )


def test_an_id_is_set_and_a_drive_is_watched(tmp_path):
    drive = Private(127)
    with Nodes("vcan0", drive):
        process = finished("configure", "127", "--channel", "vcan0", "--set-id", "9", "--yes", cwd=tmp_path)
        assert process.returncode == 0 and "done: id 127 is now 9" in process.stdout, process.stderr
        process = finished(
            "stream", "actuator", "9", "--channel", "vcan0", "--duration", "0.3", "--rate", "50", cwd=tmp_path
        )
        assert process.returncode == 0 and "0.250 rad" in process.stdout, process.stderr


def test_an_actuator_is_moved(tmp_path):
    drive = Mit(3)
    with Nodes("vcan0", drive):
        process = finished(
            "move",
            "3",
            "--channel",
            "vcan0",
            "--model",
            "AK80-9",
            "--torque",
            "0.5",
            "--rate",
            "50",
            "--duration",
            "1",
            "--yes",
            "--no-record",
            cwd=tmp_path,
        )
    assert process.returncode == 0 and "confirmed by actuator" in process.stdout, process.stdout + process.stderr
    assert drive.heard[-1] == (3, False, DISABLE)
