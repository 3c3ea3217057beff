"""`emulate` plays the drives of a rig in one process, and an ordinary run with --rig in another is none the wiser."""

import os
import pty
import re
import signal
import subprocess

import pytest

from blocks.actuators import EmulatedCubeMars
from cext.bus.memory_bus import MemoryBus
from cext.memory.shared_state import SharedState
from graph import Diagram, compile
from runtime.host.errors import OK
from runtime.robot.emulation.buses import PlantBuses
from runtime.robot.emulation.serving import Service, line
from runtime.robot.rig.errors import RigError
from runtime.robot.rig.file import read
from tests.runtime.runs import Files, finished, knee, started, write

pytestmark = pytest.mark.paced


@pytest.fixture
def rig(tmp_path):
    channel = f"239.{10 + os.getpid() % 200}.{os.getpid() // 200 % 250}.77"
    return write(tmp_path, f'[bus.legs]\ninterface = "udp_multicast"\nchannel = "{channel}"\n', "lab.toml")


def test_the_status_line_before_the_first_step_has_no_lateness():
    statistics = SharedState(1 << 16).statistics()
    shown = "emulating 0.0 s · 0 frames/s received, 0 sent · missed 0 · Ctrl-C to end"
    assert line(statistics, statistics, 1000.0) == shown


def read_until(stream, words):
    """Lines up to the first that holds the words."""
    lines = []
    while not lines or words not in lines[-1]:
        lines.append(stream.readline())
        assert lines[-1], f"it ended before {words!r}: {lines}"
    return lines


def test_a_plant_in_another_process_replies_to_a_robot(rig, tmp_path):
    robot = knee(tmp_path, "return 2.0")
    plant = started("emulate", robot, "--rig", rig, cwd=tmp_path)
    try:
        told = "".join(read_until(plant.stdout, "Ctrl-C ends it"))
        assert re.search(r"legs +udp_multicast 239\.", told) and "knee/emulated_cube_mars  AK10-9-V2.0  id 1" in told
        second = finished("emulate", robot, "--rig", rig, cwd=tmp_path)
        assert second.returncode == 2 and "TW107 bus emulated by another process: [bus.legs] 239" in second.stderr
        assert f"process {plant.pid} (" in second.stderr
        run = finished(
            robot,
            "--rig",
            rig,
            "--yes",
            "--duration",
            "1",
            "--record",
            "out",
            "--set",
            "knee.timeout=0.5",
            cwd=tmp_path,
        )
        assert run.returncode == OK, run.stderr
        assert "zero torque, then disable: confirmed by knee" in run.stdout
        table = Files(tmp_path / "out").table
        assert table["knee.velocity [rad/s]"][-1] > 2.0  # 2 N·m, faded in, on 0.1 kg·m² for a second
        assert plant.poll() is None  # it outlives the run, for the next
        plant.send_signal(signal.SIGINT)
        out, err = plant.communicate(timeout=10)
    finally:
        plant.kill()
        plant.communicate()
    assert (plant.returncode, err) == (130, "stopped by SIGINT (Ctrl-C)\n")
    heard, said = map(int, re.search(r"(\d+) frames received, (\d+) sent", out).groups())
    assert heard == said >= 200  # each command was answered


def test_at_a_bitrate_replies_arrive_after_their_transmission_time():
    """125 and some bits there, and as many back, at 10 kbit/s: 25 ms."""
    with Diagram("drive", rate=1000) as drive:
        EmulatedCubeMars("AK80-9", bus="can", can_id=1)(position=0.0, velocity=0.0)
    for seconds, answers in ((0.015, 0), (0.1, 1)):
        bus = MemoryBus()
        bus.host.send(1, bytes.fromhex("7fff7ff0000007ff"))
        assert Service(compile(drive), [bus.device], 10e3).run(seconds).status == "ok"
        assert len(bus.host.receive()) == answers


def test_a_simulated_bus_can_be_too_slow(command_line, tmp_path):
    """Two frames of about 125 bits, 200 times a second, are 50 kbit/s."""
    words = (knee(tmp_path), "--fast", "--duration", "1", "--no-record")
    assert command_line(*words, "--bitrate", "1e6")[0] == OK
    code, _, err = command_line(*words, "--bitrate", "20e3")
    assert code == 3 and "knee" in err
    assert "exclude each other" in command_line.refused(*words[:1], "--bitrate", "1e6", "--rig", "lab.toml")


def test_real_can_bus_needs_confirmation_that_no_real_drive_is_connected(tmp_path):
    master, port = pty.openpty()
    try:
        rig = write(tmp_path, f'[bus.legs]\ninterface = "slcan"\nchannel = "{os.ttyname(port)}"\n', "real.toml")
        os.close(port)
        process = finished("emulate", knee(tmp_path), "--rig", rig, cwd=tmp_path)
    finally:
        os.close(master)
    assert process.returncode == 2
    assert "cannot ask whether real drives are connected" in process.stderr and "--yes" in process.stderr


def test_a_robot_without_devices_and_a_command_without_a_rig_are_refused(command_line, rig, tmp_path):
    assert "--rig" in command_line.refused("emulate", knee(tmp_path))
    wave = write(
        tmp_path,
        "from blocks.sources import Sine\nfrom graph import Diagram\n"
        "with Diagram('wave', rate=100) as diagram:\n    Sine()\n",
    )
    empty = write(tmp_path, "", "empty.toml")
    assert "no device on a bus that can be emulated" in command_line.refused("emulate", wave, "--rig", empty)


def test_single_process_and_missing_interfaces_are_reported_with_a_remedy(tmp_path):
    for interface, channel, code in (
        ("virtual", "a", "TW105"),
        ("slcan", "/dev/ttyNONE9", "TW125"),
        ("udp_multicast", "10.0.0.1", "TW119"),
    ):
        path = write(tmp_path, f'[bus.legs]\ninterface = "{interface}"\nchannel = "{channel}"\n', "bad.toml")
        with pytest.raises(RigError, match=code):
            PlantBuses(read(path), ["legs"])
    leftovers = subprocess.run(["pgrep", "-P", str(os.getpid()), "tickwork-plant"], capture_output=True, text=True)
    assert leftovers.stdout == ""
