"""`python -m runtime doctor`: text output, JSON output and exit code."""

import json
import re

import pytest

from runtime.host.errors import CHECK_FAILED, OK
from runtime.host.machine.realtime import PRIORITY, PRIORITY_LIMIT, SPIN
from tests.runtime.runs import ROOT, finished
from tests.runtime.setup.doctor.machines import LAPTOP, ORIN_NANO, PI_4, can_link, ip, lay_out


@pytest.fixture
def laid_out(tmp_path):
    def laid_out(tree):
        folder = tmp_path / "machine"
        return lay_out(folder, tree)

    return laid_out


def test_most_severe_problem_is_listed_first_with_remedy(command_line, laid_out, golden):
    code, out, err = command_line("doctor", "--root", laid_out(ORIN_NANO))
    lines = out.splitlines()
    assert (code, err) == (CHECK_FAILED, "")
    assert lines[2].startswith("bad    can0 ") and lines[4].split()[0] == "→"
    marks = [line.split()[0] for line in lines[2:-1] if line and not line.startswith(" ")]
    assert marks == sorted(marks, key=["bad", "worse", "?", "ok"].index)
    counts = [f"{marks.count(mark)} {mark}" for mark in ("bad", "worse", "ok")]
    assert lines[-1].startswith(", ".join(counts)) and lines[-1].endswith("doctor --script")
    here = {"python": r"(?m)(?<=^ok     Python).*(\n  +.*)*", "free": r"[\d.]+ GiB free in .*"}
    golden("doctor_orin_nano", out, **here)


def test_a_finding_of_worse_is_not_a_failure(command_line, laid_out):
    code, out, _ = command_line("doctor", "--root", laid_out(PI_4))
    assert code == OK and "\nworse  governor" in out and "\nbad" not in out


def test_doctor_output_in_a_pipe_has_no_control_characters(command_line, laid_out):
    assert "\x1b" not in command_line("doctor", "--root", laid_out(PI_4))[1]


def test_doctor_json_has_verdict_and_findings(command_line, laid_out):
    code, out, err = command_line("doctor", "--json", "--root", laid_out(LAPTOP))
    data = json.loads(out)
    assert (data["ok"], code) == (False, CHECK_FAILED)  # nobody has let ada use the serial port of this session
    assert (data["kind"], data["user"], data["kernel"]) == ("other", "ada", "6.8.0-45-generic")
    [latency] = [finding for finding in data["findings"] if finding["name"] == "serial latency"]
    assert (latency["verdict"], latency["found"], latency["part"]) == ("worse", "16 ms on ttyUSB0", "ftdi")


def test_requested_bitrate_is_an_option(command_line, laid_out):
    folder = laid_out(
        {**LAPTOP, "/commands/ip -details -json link": ip(can_link("can0", bitrate=500_000, restart=100, queue=128))}
    )
    assert "bad    can0             500 kbit/s, not 1 Mbit/s" in command_line("doctor", "--root", folder)[1]
    assert (
        "ok     can0             500 kbit/s, ERROR-ACTIVE"
        in command_line("doctor", "--root", folder, "--bitrate", "500000")[1]
    )


def test_the_script_is_printed_and_nothing_else(command_line, laid_out):
    code, out, err = command_line("doctor", "--script", "--user", "ada", "--root", laid_out(ORIN_NANO))
    assert (code, err) == (OK, "")
    assert out.startswith("#!/bin/sh\n# NVIDIA Jetson Orin Nano") and "\nset -eu\n\nuser=ada\n" in out


@pytest.mark.parametrize(
    "words, said",
    [
        (["--bitrate", "0"], "--bitrate 0: expected a whole number, 1 or more"),
        (["--data-bitrate", "500000"], "--data-bitrate 500000: at least that of --bitrate, 1000000"),
        (["--bitrate", "5000000"], "--bitrate 5000000: at most 1000000"),
        (
            ["--overlay", "x; rm"],
            "--overlay x; rm: expected the value of dtoverlay=, as in mcp2515-can0,oscillator=12000000,interrupt=25",
        ),
        (["--user", "a b"], "--user a b: expected a user name"),
        (
            ["--script", "--hotspot", "a b"],
            "--hotspot a b: expected 1 to 32 letters, digits, dots, hyphens and underscores",
        ),
        (["--overlay", "i2c-gpio"], "--overlay, --hotspot and --remote-desktop are parts of the script: add --script"),
        (["--hotspot", "leg"], "--overlay, --hotspot and --remote-desktop are parts of the script: add --script"),
        (["--remote-desktop"], "--overlay, --hotspot and --remote-desktop are parts of the script: add --script"),
        (["--root", "nowhere"], "--root nowhere: no such folder"),
    ],
)
def test_doctor_rejects_invalid_options_in_one_line(command_line, words, said):
    assert command_line.refused("doctor", *words) == said


def test_overlay_is_refused_where_there_is_no_config_txt(command_line, laid_out):
    said = command_line.refused("doctor", "--script", "--overlay", "i2c-gpio", "--root", laid_out(ORIN_NANO))
    assert said.startswith("--overlay is for a Raspberry Pi, and this machine is NVIDIA Jetson Orin Nano")


def test_json_and_script_exclude_each_other(command_line):
    assert "not allowed with" in command_line.refused("doctor", "--json", "--script")


def test_machine_is_examined_in_separate_process(tmp_path):
    process = finished("doctor", cwd=tmp_path)
    assert process.returncode in (OK, CHECK_FAILED) and process.stderr == ""
    assert "\nok     Python" in process.stdout and "check failed:" not in process.stdout
    assert list(tmp_path.iterdir()) == []


def test_run_as_root_prints_warning_that_results_apply_to_root(command_line, laid_out):
    folder = laid_out({**PI_4, "/commands/id": "uid=0(root) gid=0(root) groups=0(root)"})
    assert (
        command_line("doctor", "--root", folder)[1]
        .splitlines()[0]
        .endswith(", user root: run this command as the user that runs the robot")
    )


def test_the_page_matches_the_command(command_line):
    """Its numbers are the program's, and its options exist."""
    page = "".join((ROOT / "docs" / name / "realtime.md").read_text() for name in ("explanation", "how_to"))
    assert (
        f"priority {PRIORITY} (`--priority`, {PRIORITY_LIMIT} at most)" in page
        and SPIN == 0.5
        and "half a second without a sleep" in page
    )
    offered = ""
    for command in ("run", "doctor"):
        with pytest.raises(SystemExit):
            command_line(command, "--help")
        offered += command_line.capsys.readouterr().out
    ours = [
        line
        for line in page.splitlines()
        if "docker" not in line and "container" not in line and "powerprofilesctl" not in line
    ]
    assert {option for option in re.findall(r"(?<![\w-])--[a-z]+", "\n".join(ours))} <= set(
        re.findall(r"--[a-z]+", offered)
    )
