"""The script of the doctor: only what was found wanting, good shell, and the same when it is run again."""

import os
import re
import shutil
import subprocess

import pytest

from runtime.host.machine.finding import Wants
from runtime.host.machine.probe import Machine
from runtime.setup.doctor import examine
from runtime.setup.doctor.script import PARTS, script
from tests.runtime.setup.doctor.machines import LAPTOP, ORIN_NANO, PI_4, can_link, ip, lay_out
from tests.soaking import soaked

NO_CAN_ON_PI = {
    **{name: content for name, content in PI_4.items() if "can0" not in name},
    "/commands/ip -details -json link": ip(),
}
FIRST_BUS = can_link("can0", restart=100, queue=128)
ONE_BUS_ON_PI = {**PI_4, "/sys/class/net/can0/tx_queue_len": "128\n", "/commands/ip -details -json link": ip(FIRST_BUS)}
NO_CAN_ON_JETSON = {name: content for name, content in ORIN_NANO.items() if "can0" not in name}
OUTSIDE = {
    **LAPTOP,
    "/etc/group": "dialout:x:20:\n",
    "/commands/ls -l _dev": (
        "crw------- 1 root root 89, 1 Nov 21 09:12 i2c-1\ncrw------- 1 root root 153, 0 Nov 21 09:12 spidev0.0\n"
        "crw------- 1 root root 188, 0 Nov 21 10:40 ttyUSB0\n"
    ),
}
SLEEPY = {**LAPTOP, "/proc/sys/kernel/sched_rt_runtime_us": "0\n"}
MACHINES = {
    "pi": PI_4,
    "pi without can": NO_CAN_ON_PI,
    "pi with a bus": ONE_BUS_ON_PI,
    "jetson": ORIN_NANO,
    "jetson without can": NO_CAN_ON_JETSON,
    "laptop": LAPTOP,
    "outside": OUTSIDE,
    "sleepy": SLEEPY,
    "nothing": {},
}


@pytest.fixture
def written(tmp_path):
    """The script for a machine, as a file and as text."""

    def written(tree, **wants):
        wants = Wants(**wants)
        machine = Machine(lay_out(tmp_path / "machine", tree))
        path = tmp_path / "doctor.sh"
        path.write_text("\n".join(script(machine, wants, examine(machine, wants), "tickwork")) + "\n")
        return path, path.read_text()

    (tmp_path / "machine").mkdir()
    return written


def attempt(path, folder, typed=""):
    """Run the script with its files below a folder and what is typed. Returns the process."""
    environment = {**os.environ, "DESTDIR": str(folder)}
    return subprocess.run(["sh", path], env=environment, input=typed, capture_output=True, text=True, timeout=10)


def look(path, folder, typed="", asked=""):
    """Run the script with its files below a folder. Returns its output."""
    process = attempt(path, folder, typed)
    assert (process.returncode, process.stderr) == (0, asked), process
    return process.stdout.splitlines()


def files(folder):
    return {str(path.relative_to(folder)): path.read_text() for path in sorted(folder.rglob("*")) if path.is_file()}


@pytest.mark.parametrize("name", soaked(MACHINES, but=[0, 3, 7]))
def test_doctor_script_is_valid_shell_and_idempotent(written, tmp_path, name):
    path, text = written(MACHINES[name], overlays=["mcp251xfd,spi0-0,interrupt=25"])
    for shell in ("sh", "bash"):
        if shutil.which(shell):
            assert subprocess.run([shell, "-n", path], capture_output=True, timeout=10).stderr == b""
    if shutil.which("shellcheck"):
        checked = subprocess.run(["shellcheck", path], capture_output=True, text=True, timeout=30)
        assert checked.returncode == 0, checked.stdout
    (tmp_path / "into").mkdir()
    first = look(path, tmp_path / "into")
    left = files(tmp_path / "into")
    again = look(path, tmp_path / "into")
    assert files(tmp_path / "into") == left
    assert not [line for line in again if line.startswith(("wrote ", "added "))]
    assert {line[6:] for line in first if line.startswith("wrote ")} == {
        f"/{name}" for name in left if not name.endswith("config.txt")
    }
    assert "sudo" not in "".join(line for line in text.splitlines() if not line.lstrip().startswith(("#", "echo")))


def test_each_part_is_needed_by_a_machine(tmp_path):
    asked = set()
    for name, tree in MACHINES.items():
        machine = Machine(lay_out(tmp_path / name, {"/proc/x": "", **tree}))
        asked |= {finding.part for finding in examine(machine, Wants())}
    assert asked - {""} == set(PARTS)


def test_script_has_only_the_missing_parts(written):
    path, text = written(LAPTOP)
    assert "latency_timer" in text and "scaling_governor" in text and "ID_MM_PORT_IGNORE" in text
    for absent in ("nvpmodel", "mttcan", "config.txt", "sched_rt_runtime_us", "80-tickwork-can", "hotspot", "xrdp"):
        assert absent not in text


def test_doctor_script_without_findings_changes_nothing(written, tmp_path):
    path, text = written({})
    assert text.endswith("# `tickwork doctor --script` found nothing that a script can change.\n")
    (tmp_path / "into").mkdir()
    assert look(path, tmp_path / "into") == [] and files(tmp_path / "into") == {}


def test_every_part_states_its_reason(written):
    path, text = written(ORIN_NANO)
    assert (
        "# rtprio: the limit of jetson is 0; without real-time priority, any busy program delays the loop by "
        "milliseconds.\n"
    ) in text
    assert "# power mode: 15W; MAXN_SUPER is available; " in text


def test_limits_are_for_a_group_that_the_user_joins(written, tmp_path):
    path, text = written(PI_4, user="ada")
    said = look(path, tmp_path / "into")
    assert "user=ada\n" in text and "not run: usermod -aG realtime ada" in said
    left = files(tmp_path / "into")
    assert left["etc/security/limits.d/90-tickwork.conf"] == "@realtime - rtprio 90\n@realtime - memlock unlimited\n"
    assert left["etc/udev/rules.d/90-tickwork-idle.rules"] == (
        'KERNEL=="cpu_dma_latency", GROUP="realtime", MODE="0660"\n'
    )
    assert said[-1] == "done; groups and limits are in effect from the next login on"


def test_a_can_interface_gets_a_unit_and_a_queue(written, tmp_path):
    path, _ = written(PI_4, bitrate=500_000)
    said = look(path, tmp_path / "into")
    left = files(tmp_path / "into")
    assert left["etc/systemd/network/80-tickwork-can.network"] == (
        "[Match]\nName=can*\n\n[Link]\nRequiredForOnline=no\n\n[CAN]\nBitRate=500000\nRestartSec=100ms\n"
    )
    assert left["etc/udev/rules.d/90-tickwork-can.rules"] == (
        'SUBSYSTEM=="net", ACTION=="add|change", KERNEL=="can*", ATTR{tx_queue_len}="128"\n'
    )
    assert "not run: ip link set can0 down" in said and said.index("not run: ip link set can0 down") < said.index(
        "not run: systemctl restart systemd-networkd"
    )


def test_an_interface_of_can_fd_gets_the_bitrate_of_its_data(written, tmp_path):
    path, _ = written(PI_4, data_bitrate=5_000_000)
    look(path, tmp_path / "into")
    unit = files(tmp_path / "into")["etc/systemd/network/80-tickwork-can.network"]
    assert unit.endswith("[CAN]\nBitRate=1000000\nDataBitRate=5000000\nFDMode=yes\nRestartSec=100ms\n")


def test_hat_overlay_is_added_to_config_txt_once_for_every_model(written, tmp_path):
    path, _ = written(NO_CAN_ON_PI, overlays=["mcp251xfd,spi0-0,interrupt=25"])
    config = tmp_path / "into" / "boot" / "firmware" / "config.txt"
    config.parent.mkdir(parents=True)
    config.write_text(PI_4["/boot/firmware/config.txt"] + "[cm5]\nx=1\n")
    said = look(path, tmp_path / "into")
    assert "restart for the changes in config.txt" not in look(path, tmp_path / "into")
    assert config.read_text() == PI_4["/boot/firmware/config.txt"] + (
        "[cm5]\nx=1\n\n[all]\ndtparam=spi=on\n\n[all]\ndtoverlay=mcp251xfd,spi0-0,interrupt=25\n\n[all]\ndtparam=i2c_arm_baudrate=400000\n"
    )
    assert "restart for the changes in config.txt" in said


def test_requested_overlay_is_added_where_another_interface_exists(written, tmp_path):
    """It is the second of a hat, or a hat beside an adapter."""
    path, text = written(ONE_BUS_ON_PI, overlays=["mcp2515-can1,oscillator=16000000,interrupt=25"])
    said = look(path, tmp_path / "into")
    left = files(tmp_path / "into")
    assert "dtoverlay=mcp2515-can1,oscillator=16000000,interrupt=25" in left["boot/firmware/config.txt"].split("\n")
    assert "restart for the changes in config.txt" in said and "80-tickwork-can" not in text


def test_script_of_a_second_interface_leaves_the_first_one_configured(written, tmp_path):
    leg = {"/sys/class/net/leg/type": "280\n", "/commands/ip -details -json link": ip(FIRST_BUS, can_link("leg"))}
    path, _ = written({**ONE_BUS_ON_PI, **leg})
    look(path, tmp_path / "into")
    assert "Name=can* leg\n" in files(tmp_path / "into")["etc/systemd/network/80-tickwork-can.network"]


def test_without_the_hats_overlay_its_line_is_a_comment(written, tmp_path):
    path, text = written(NO_CAN_ON_PI)
    look(path, tmp_path / "into")
    assert "# config_line 'dtoverlay=mcp2515-can0,oscillator=12000000,interrupt=25'" in text
    assert "dtoverlay" not in files(tmp_path / "into")["boot/firmware/config.txt"]


def test_a_jetson_gets_its_power_mode_by_number_and_its_clocks_at_every_start(written, tmp_path):
    path, text = written(ORIN_NANO)
    said = look(path, tmp_path / "into")
    assert "nvpmodel -m 2" in text and "not run: nvpmodel -m 2" in said
    assert (
        "ExecStart=/usr/bin/jetson_clocks\n" in files(tmp_path / "into")["etc/systemd/system/tickwork-clocks.service"]
    )


HOTSPOT = "etc/NetworkManager/system-connections/tickwork-hotspot.nmconnection"
ASKED = "password for the access point leg-1, 8 to 63 characters:\n"


@pytest.mark.parametrize("name", ["pi", "jetson", "nothing"])
def test_access_point_and_remote_desktop_are_added_on_request(written, tmp_path, name):
    path, text = written(MACHINES[name], hotspot="leg-1", remote_desktop=True)
    if shutil.which("shellcheck"):
        checked = subprocess.run(["shellcheck", path], capture_output=True, text=True, timeout=30)
        assert checked.returncode == 0, checked.stdout
    said = look(path, tmp_path / "into", "walk the dog\n", ASKED)
    assert "not run: nmcli connection reload" in said and "walk" not in text
    desktop = "raspi-config nonint do_vnc 0" if name == "pi" else "systemctl enable --now xrdp"
    assert f"not run: {desktop}" in said
    left = files(tmp_path / "into")
    assert "\nssid=leg-1\n" in left[HOTSPOT] and "\npsk=walk\\sthe\\sdog\n" in left[HOTSPOT]
    assert (tmp_path / "into" / HOTSPOT).stat().st_mode & 0o777 == 0o600
    again = look(path, tmp_path / "into")  # no question
    assert files(tmp_path / "into") == left and "not run: nmcli connection reload" not in again


@pytest.mark.parametrize(
    "tree, desktop", [(PI_4, "raspi-config nonint do_vnc 1"), ({}, "systemctl disable --now xrdp")]
)
def test_requested_parts_state_how_to_undo_them(written, tree, desktop):
    _, text = written(tree, hotspot="leg-1", remote_desktop=True)
    assert "# Undo, also to change the password: sudo nmcli connection delete tickwork-hotspot\n" in text
    assert f"# Undo: sudo {desktop}\n" in text


@pytest.mark.parametrize("password", ["", "seven77", "é" * 9, "x" * 64, "tab\tbetween"])
def test_password_that_wpa_rejects_leaves_no_file(written, tmp_path, password):
    process = attempt(written({}, hotspot="leg-1")[0], tmp_path / "into", password + "\n")
    assert (process.returncode, process.stdout) == (1, "")
    assert process.stderr.endswith(
        "the password must have 8 to 63 letters, digits and signs of ASCII: run this again\n"
    )
    assert not (tmp_path / "into").exists()


@pytest.mark.skipif(shutil.which("nmcli") is None, reason="needs NetworkManager's nmcli")
def test_networkmanager_reads_the_access_point_and_any_password(written, tmp_path):
    password = " a\\s\\\\b$(touch x)`touch x`\"';#=[wifi] "
    look(written({}, hotspot="leg-1")[0], tmp_path / "into", password + "\n", ASKED)
    ask = ["nmcli", "--offline", "connection", "modify", "connection.zone", ""]
    with open(tmp_path / "into" / HOTSPOT) as file:
        read = subprocess.run(ask, stdin=file, capture_output=True, text=True, timeout=10)
    assert (read.returncode, read.stderr) == (0, "")
    lines = read.stdout.splitlines()
    assert {"mode=ap", "ssid=leg-1", "key-mgmt=wpa-psk", "method=shared", "interface-name=wlan0"} <= set(lines)
    [psk] = [line.removeprefix("psk=") for line in lines if line.startswith("psk=")]
    assert re.sub(r"\\(.)", lambda match: " " if match[1] == "s" else match[1], psk) == password


def test_texts_of_a_malicious_machine_remain_comments(written, tmp_path):
    evil = (
        "x\ntouch "
        + str(tmp_path / "evil")
        + "\n$(touch "
        + str(tmp_path / "evil")
        + ")`touch "
        + str(tmp_path / "evil")
        + "`"
    )
    path, _ = written(
        {
            **ORIN_NANO,
            "/proc/device-tree/model": evil,
            "/etc/os-release": f'PRETTY_NAME="{evil}"',
            "/proc/version": evil,
            "/commands/id": f"uid=1000(a'$(touch {tmp_path / 'evil'})) gid=1000(a) groups=1000(a)",
        }
    )
    (tmp_path / "into").mkdir()
    look(path, tmp_path / "into")
    assert not (tmp_path / "evil").exists()


def test_script_requires_root_and_prints_the_command(written):
    if os.geteuid() == 0:
        pytest.skip("needs somebody who is not root")
    path, _ = written(PI_4)
    process = subprocess.run(["sh", path], capture_output=True, text=True, timeout=10)
    assert (process.returncode, process.stderr) == (1, f"run this as root: sudo sh {path}\n")
