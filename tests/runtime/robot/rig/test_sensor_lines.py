"""Sensors with lines of their own on a rig: a run reads a pseudo-terminal and a socket; their pages are correct."""

import csv
import os
import re
import runpy
import socket
import struct
import threading
import time
import tty

import pytest

from blocks.sensors import Insole
from graph import Diagram, compile
from runtime.host.errors import BAD_INPUT, OK
from runtime.robot.emulation.priority import take_priority
from runtime.robot.rig.file import read
from runtime.robot.rig.overrides import override
from tests.blocks.actuators.wire import TAKEN, Wired
from tests.blocks.sensors.test_insole import free_port
from tests.blocks.sensors.test_microcontroller import packet
from tests.runtime.runs import ROOT, finished, write

PAGES = "\n".join((ROOT / "docs" / "reference" / f"{name}.md").read_text() for name in ("imus", "inputs"))
SECTIONS = {
    section.splitlines()[0]: section
    for section in re.split(r"^## ", PAGES, flags=re.MULTILINE)[1:]
    if re.match(r"OpenIMU|Orientation|A microcontroller|Pressure|Switches|A game", section)
}


def blocks_of(section, kind):
    return re.findall(rf"^```{kind}\n(.*?)^```", section, re.DOTALL | re.MULTILINE)


def names_of(section):
    """What the Python of a section leaves behind."""
    names = {}
    for text in blocks_of(section, "python"):
        exec(text, names)
    return names


@pytest.mark.parametrize("title", SECTIONS)
def test_the_diagrams_of_the_pages_compile_and_its_rigs_fit_them(title, tmp_path):
    diagram = names_of(SECTIONS[title])["diagram"]
    assert isinstance(diagram, Diagram) and compile(diagram).devices
    for text in blocks_of(SECTIONS[title], "toml"):
        override(read(write(tmp_path, text, "lab.toml")), diagram)


def test_the_pages_have_six_such_sections():
    assert len(SECTIONS) == 6


def insole_frame():
    """The function of the program that the page shows."""
    return runpy.run_path(str(ROOT / "docs" / "sketches" / "xsensor_bridge.py"))["frame"]


def test_the_frame_of_the_bridge_is_read_by_the_block():
    pressures = [[10_000.0] * 9 for _ in range(31)]
    pressures[0][0], pressures[0][1] = float("nan"), -1.0
    wired, sent = Wired(Insole, side="right"), insole_frame()(7, pressures, "right", 0.5)
    assert TAKEN in [wired.hear(0, sent[at : at + 64]) for at in range(0, len(sent), 64)]
    assert wired["force"] == pytest.approx(10_000.0 * 0.27 * 0.09 * 277 / 279) and wired["dead"] == 2.0


DIAGRAM = """
from blocks.recorders import CsvRecorder
from blocks.sensors import Insole, Microcontroller
from graph import Diagram

with Diagram("walk", rate=200) as diagram:
    Insole(name="sole", timeout=1.0)  # the sender shares its interpreter with the test, and a busy machine stops both
    Microcontroller(fields=(("load", "int24", "N", 0.01),), name="teensy", timeout=1.0)
    CsvRecorder()
"""


@pytest.fixture
def lab(tmp_path):
    """A diagram, a rig, and the devices at the other ends, which send until silenced."""
    master, slave = os.openpty()
    tty.setraw(slave)
    port, frame, speaks = free_port(socket.SOCK_DGRAM), insole_frame(), threading.Event()
    speaks.set()

    def speak():
        take_priority()
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as bridge:
            number = 0
            while speaks.is_set():
                os.write(master, packet(number & 255, struct.pack("<i", 1000 + number)[:3]))
                bridge.sendto(frame(number, [[1e4] * 9] * 31, "left", 0.01 * number), ("127.0.0.1", port))
                number += 1
                time.sleep(0.01)

    speaker = threading.Thread(target=speak)
    speaker.start()
    write(tmp_path, DIAGRAM, "walk.py")
    write(
        tmp_path,
        f'[device.teensy]\nport = "{os.ttyname(slave)}"\n\n[device.sole]\naddress = "127.0.0.1:{port}"\n',
        "lab.toml",
    )
    yield tmp_path, speaks
    speaks.clear()
    speaker.join()
    os.close(master)
    os.close(slave)


@pytest.mark.paced
def test_a_run_on_a_rig_reads_a_serial_port_and_a_socket(lab):
    folder, _ = lab
    process = finished("walk.py", "--rig", "lab.toml", "--duration", "0.5", "--yes", cwd=folder)
    assert process.returncode == OK, process.stderr + process.stdout
    [file] = (folder / "recordings").glob("*.csv")
    rows = list(csv.DictReader(file.read_text().splitlines()))
    last = rows[-1]
    assert float(last["sole.force [N]"]) == pytest.approx(1e4 * 0.27 * 0.09, rel=1e-6)
    assert int(last["sole.received"]) > int(rows[0]["sole.received"])
    assert float(last["teensy.load [N]"]) > float(rows[0]["teensy.load [N]"]) >= 10.0
    assert [last[f"{name}.{count}"] for name in ("sole", "teensy") for count in ("lost", "corrupt")] == ["0"] * 4
    assert min(float(row["sole.age [s]"]) for row in rows) < 0.02


def test_missing_and_busy_ports_are_reported_together(lab):
    folder, _ = lab
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        number = taken.getsockname()[1]
        write(
            folder,
            f'[device.teensy]\nport = "/dev/ttyNothing"\n\n[device.sole]\naddress = "127.0.0.1:{number}"\n',
            "lab.toml",
        )
        process = finished("walk.py", "--rig", "lab.toml", "--duration", "0.5", "--yes", cwd=folder)
    assert process.returncode == BAD_INPUT
    assert (
        '[device."teensy"] /dev/ttyNothing: no such port' in process.stderr
        and f"UDP port {number} is in use by another program" in process.stderr
    )
