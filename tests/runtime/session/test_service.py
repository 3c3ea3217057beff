"""Robots that start with the computer: the systemd unit, and the signal that arms without a terminal."""

import configparser
import shutil
import subprocess
import sys

import pytest

from runtime.host.errors import OK
from runtime.session.service_unit import quoted
from tests.checkout import ROOT
from tests.docs.fences import fences

PAGE = ROOT / "docs" / "how_to" / "start_at_boot.md"


@pytest.fixture
def robot(tmp_path):
    """Options that name the files of the robot of the page."""
    for fence in fences(PAGE):
        for language, name in (("python", "knee.py"), ("toml", "lab.toml")):
            if fence.language == language:
                (tmp_path / name).write_text(fence.text)
    return "knee.py", "--rig", "lab.toml"


def test_unit_runs_the_robot_in_this_folder_and_waits_for_the_button(robot, command_line, tmp_path):
    code, out, err = command_line("service", *robot, "--arm-on", "button.on", "--set", "knee.limit=5.0", "--rearm")
    assert code == OK, err
    unit = configparser.ConfigParser(interpolation=None, strict=False)
    unit.optionxform = str
    unit.read_string(out)
    run = "run knee.py --rig lab.toml --arm-on button.on --set knee.limit=5.0 --rearm"
    assert unit["Service"]["ExecStart"] == f"{sys.executable} -m runtime {run}"
    assert unit["Service"]["WorkingDirectory"] == str(tmp_path) and unit["Service"]["KillMode"] == "process"
    assert unit["Unit"]["After"] == "sys-subsystem-net-devices-can0.device"
    assert "/etc/systemd/system/knee.service" in err
    if shutil.which("systemd-analyze"):
        (tmp_path / "knee.service").write_text(out)
        done = subprocess.run(
            ["systemd-analyze", "verify", "--man=no", tmp_path / "knee.service"], capture_output=True, text=True
        )
        assert "knee.service" not in done.stderr, done.stderr


@pytest.mark.parametrize(
    "options, message",
    [
        ((), "a service needs --rig FILE and --arm-on SIGNAL"),
        (
            ("--arm-on", "button.onn"),
            "--arm-on button.onn: expected a bool output of a device, such as the button of a "
            "GpioInput; did you mean 'button.on'?",
        ),
        (("--arm-on", "knee.position"), "--arm-on knee.position: expected a bool output of a device"),
        (("--arm-on", "button.on", "--yes"), "--arm-on needs --rig, and excludes --yes"),
    ],
)
def test_robot_that_no_button_arms_is_reported(options, message, robot, command_line):
    assert command_line.refused("service", *robot, *options).startswith(message)


def test_words_are_quoted_as_systemd_reads_them():
    assert [quoted(word) for word in ("knee.py", "my knee.py", "100%", "$HOME", 'a"b', "")] == [
        "knee.py",
        '"my knee.py"',
        "100%%",
        "$$HOME",
        '"a\\"b"',
        '""',
    ]
