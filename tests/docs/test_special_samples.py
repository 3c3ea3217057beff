"""Samples of pages that need files, sockets or processes: each is run, here or by the test that SAMPLES names."""

import importlib
import os
import re
import socket
import subprocess
import sys
import textwrap
from types import SimpleNamespace

import pytest

import runtime
from blocks.actuators import CubeMars
from graph import dialogue, family
from runtime.host.signed_datagrams import Receiver
from tests.checkout import ROOT
from tests.docs.fences import agree, fences
from tests.docs.pages import NAMES
from tests.docs.tutorial import plain
from tests.runtime.robot.emulation.test_emulate import read_until
from tests.runtime.runs import finished, started
from tests.runtime.terminals import Terminal
from tests.runtime.test_documents import shown_after

DOCS = ROOT / "docs"
SAMPLES = {  # page: tests of its Python samples that are marked `notest`, in their order
    "docs/how_to/compiled_controllers.md": (
        "blocks.test_compiled.test_a_range_proves_the_command_and_a_replay_has_the_same_bits",
        "blocks.test_compiled.test_the_page_compiles_a_controller_as_simulink_coder_generates_it",
    ),
    "docs/how_to/device_families.md": (
        "runtime.test_actuators_page.test_the_driver_board_of_the_page_compiles_runs_and_is_proved",
        "docs.test_special_samples.test_the_device_family_of_the_page_is_accepted",
        "docs.test_special_samples.test_the_dialogue_of_the_page_asks_for_a_confirmation",
    ),
    "docs/how_to/fmus.md": ("blocks.test_fmu.test_a_range_proves_the_command_and_a_replay_has_the_same_bits",),
    "docs/how_to/analysis.md": ("docs.test_special_samples.test_the_loop_of_the_page_has_its_margins",) * 2,
    "docs/how_to/motion_capture.md": (
        "runtime.record.analysis.test_clocks.test_the_clock_of_a_microcontroller_agrees_with_an_edge_on_a_line",
    )
    * 2,
    "docs/how_to/mujoco.md": ("blocks.test_mujoco.test_the_video_of_the_page_shows_the_moving_leg",),
    "docs/how_to/native_blocks.md": (
        "runtime.test_documents.test_the_native_block_of_the_page_compiles_and_runs",
        "runtime.test_documents.test_the_kernel_in_c_of_the_page_compiles_and_runs",
    ),
    "docs/how_to/lsl.md": (
        "runtime.record.export.test_convert."
        "test_xdf_is_read_by_pyxdf_and_a_file_of_the_laboratory_has_the_time_axis_of_the_trial",
    ),
    "docs/how_to/notebooks.md": ("docs.test_special_samples.test_a_notebook_runs_a_file_in_real_time",),
    "docs/how_to/optimisation.md": ("docs.test_special_samples.test_the_optimisation_from_python_has_an_optimum",),
    "docs/how_to/ros2.md": ("runtime.robot.loading.test_urdf.test_the_urdf_of_the_page_walks_in_rerun",),
    "docs/reference/emergency_stop.md": (
        "runtime.robot.rig.test_page.test_sender_of_the_page_reads_as_released_button",
        "docs.test_special_samples.test_the_signed_sender_of_the_page_is_accepted",
    ),
    "docs/reference/rate.md": (
        "runtime.robot.emulation.test_gpio_server.test_the_emergency_stop_of_the_page_is_pressed_by_its_program",
    ),
    "docs/reference/recordings.md": (
        "runtime.test_documents.test_examples_of_the_recordings_page_have_the_documented_output",
    ),
    "docs/reference/running.md": ("runtime.test_documents.test_commands_of_the_pages_run",) * 2,
}
SPECIAL = re.compile(r"^ *```python notest\n(.*?)^ *```", re.DOTALL | re.MULTILINE)


def samples(page):
    """Return the Python samples of a page that are marked `notest`, without their indentation."""
    found = []
    for text in SPECIAL.findall((ROOT / page).read_text()):
        indent = re.match(" *", text)[0]
        found.append(re.sub(f"^{indent}", "", text, flags=re.MULTILINE))
    return found


def test_every_special_sample_has_a_test():
    assert {name: len(samples(name)) for name in NAMES if samples(name)} == {
        name: len(tests) for name, tests in SAMPLES.items()
    }
    for tests in SAMPLES.values():
        for test in tests:
            module, _, name = test.rpartition(".")
            assert callable(getattr(importlib.import_module(f"tests.{module}"), name)), test


def test_the_device_family_of_the_page_is_accepted():
    text = samples("docs/how_to/device_families.md")[1]
    names = {**vars(family), "GaitDrive": CubeMars, "models": SimpleNamespace(find=str, MODELS={})}
    names |= dict.fromkeys(("disable", "answers", "wire", "reader"), lambda *arguments: None)
    exec(text, names)
    own = names["FAMILY"]
    assert own.drives[0].block is CubeMars and own.queries[0].why
    assert isinstance(own.stop_query(SimpleNamespace(can_id=1)), family.StopQuery)


def test_the_dialogue_of_the_page_asks_for_a_confirmation():
    text = samples("docs/how_to/device_families.md")[2]
    frame = (0x1, b"\0" * 8)
    names = {
        **vars(dialogue),
        "disable": lambda can_id: frame,
        "zero": lambda can_id: frame,
        "reader": lambda can_id: str,
    }
    exec(text, names)
    talk = names["set_up"](None, SimpleNamespace(can_id=1))
    asked = talk.send(None)
    while not isinstance(asked, dialogue.Confirm):
        asked = talk.send("reply" if not isinstance(asked, dialogue.Send) else None)
    assert isinstance(talk.send(True), dialogue.Send) and isinstance(talk.send(None), dialogue.Listen)
    with pytest.raises(StopIteration) as ended:
        talk.send([])
    assert ended.value.value is True


def test_the_signed_sender_of_the_page_is_accepted(tmp_path):
    key = bytes(range(32))
    (tmp_path / "estop.key").write_text(key.hex())
    receiver, accepted = Receiver(key), []
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as line:
        line.bind(("127.0.0.1", 0))
        line.settimeout(10.0)
        script = samples("docs/reference/emergency_stop.md")[1].replace("9871", str(line.getsockname()[1]))
        sender = subprocess.Popen([sys.executable, "-c", script], cwd=tmp_path)
        try:
            while len(accepted) < 3:
                datagram, address = line.recvfrom(100)
                frame, reply = receiver.frame(datagram)
                if reply:
                    line.sendto(reply, address)
                if frame:
                    accepted.append(frame)
        finally:
            sender.kill()
            sender.wait()
    assert all(frame[:6] == bytes([0, 1, 0, 0, 2, 0]) and frame[9] == 0x5A for frame in accepted)


@pytest.mark.soak
def test_a_notebook_runs_a_file_in_real_time(tmp_path, monkeypatch):
    simulation, robot = samples("docs/how_to/notebooks.md")[0].splitlines()
    monkeypatch.chdir(tmp_path)
    [definition] = [text for text in python_samples("docs/how_to/notebooks.md") if "def build(" in text]
    (tmp_path / "knee.py").write_text(definition[: definition.index("\n\nbuild()")])
    names = {"runtime": runtime}
    exec(simulation.replace("60", "0.2"), names)
    assert len(names["trial"]) > 0
    with pytest.raises(Exception, match="lab.toml"):  # there is none: its options are accepted
        exec(robot, names)


def python_samples(page):
    return re.findall(r"^```python\n(.*?)^```", (ROOT / page).read_text(), re.DOTALL | re.MULTILINE)


@pytest.fixture
def study(tmp_path):
    """Folder with the files of the page about optimisation."""
    page = DOCS / "how_to" / "optimisation.md"
    os.symlink(ROOT / "diagrams", tmp_path / "diagrams")
    (tmp_path / "costs.py").write_text(next(fence.text for fence in fences(page) if "def loss" in fence.text))
    (tmp_path / "ankle.toml").write_text(next(fence.text for fence in fences(page) if fence.language == "toml"))
    return tmp_path


def output_after(words):
    """Return the lines of the first output on the page about optimisation that contains these words."""
    page = DOCS / "how_to" / "optimisation.md"
    return next(
        [line.strip() for line in text.splitlines()]
        for text in re.findall(r"^ *```text\n(.*?)^ *```", page.read_text(), re.DOTALL | re.MULTILINE)
        if words in text
    )


@pytest.mark.soak
def test_the_study_of_the_page_prints_what_it_shows(study):
    pytest.importorskip("cma")
    printed = finished("study", "ankle.toml", cwd=study, timeout=600).stdout.splitlines()
    shown = output_after("evaluations of 3 runs")
    assert len(shown) == len(printed)
    assert all(agree(line, text.strip()) for line, text in zip(shown, printed)), printed


@pytest.mark.soak
def test_the_optimisation_from_python_has_an_optimum(study, monkeypatch):
    pytest.importorskip("cma")
    pytest.importorskip("pyarrow")
    monkeypatch.chdir(study)
    monkeypatch.syspath_prepend(study)
    monkeypatch.delitem(sys.modules, "costs", raising=False)  # of another test
    call, *uses = re.split(r"^(?=result\.)", samples("docs/how_to/optimisation.md")[0], flags=re.MULTILINE)
    names = {"runtime": runtime}
    for long, short in (("duration=20", "duration=10"), ("[1, 2, 3]", "[1]"), ("output=", "generations=1, output=")):
        call = call.replace(long, short)
    exec(call, names)
    assert set(names["result"].optimum) == {"peak_torque", "peak_time", "push_off.rise"}
    for use in uses:
        exec(use.replace("run(324)", "run(1)"), names)


@pytest.mark.soak
def test_the_protocol_in_virtual_time_prints_what_the_page_shows(study):
    pytest.importorskip("cma")
    page = (DOCS / "how_to" / "optimisation.md").read_text()
    command = re.search(r"python -m runtime (optimise diagrams/ankle_exo.py --fast .*?)\n   ```", page, re.DOTALL)[1]
    process = started(*command.replace("\\\n", " ").split(), cwd=study)
    printed = [process.stderr.readline().strip() for _ in range(4)]
    process.terminate()
    process.communicate()
    shown = output_after("measurements of")
    assert all(agree(line, text) for line, text in zip(shown, printed, strict=True)), printed


@pytest.mark.soak
def test_the_loop_of_the_page_has_its_margins(tmp_path, monkeypatch):
    pytest.importorskip("control")
    page, names = (DOCS / "how_to" / "analysis.md").read_text(), {}
    (tmp_path / "swing.py").write_text(re.search("```python\n(.*?)```", page, re.DOTALL)[1])
    words = re.search("python -m runtime (analyse swing.py .*)", page)[1].split()
    assert textwrap.indent(finished(*words, cwd=tmp_path).stdout, "    ") in page
    monkeypatch.chdir(tmp_path)
    first, second = samples("docs/how_to/analysis.md")
    exec(first, names)
    assert names["system"].isdtime(strict=True) and max(abs(names["system"].poles())) < 1.0
    exec(second, names)
    assert names["point"].outputs["shank.position"] == pytest.approx(0.5) and names["system"].poles().size


@pytest.mark.soak
def test_the_rates_of_the_page_are_those_of_the_command(tmp_path):
    page = (DOCS / "reference" / "rate.md").read_text()
    table = re.findall(r"^\| (?:Tickwork's zero|`8000).*?\|((?: \d+ \|)+)$", page, re.MULTILINE)
    for row, more in zip(table, ((), ("--upper-zero",)), strict=True):
        words = ("rate", "--seconds", "0.1", "--picture", tmp_path / "rate.png", *more)
        printed = finished(*words, cwd=tmp_path).stdout.splitlines()
        full = [int(line.split()[3]) for line in printed if re.match(r" +\d+ +\d+ Hz", line)]
        assert [int(cell) for cell in re.findall(r"\d+", row)] == full
        if not more:
            shown = [line for line in shown_after(page, "## The highest rate") if " Hz " in line]
            assert all(line.split("Hz, 2 s")[0] in "\n".join(printed) for line in shown[1:]), printed


TABLE = """
from blocks.actuators import CubeMars
from graph import Diagram

with Diagram("knee", rate=200) as diagram:
    CubeMars("AK80-9", bus="legs", can_id=7, name="knee")(torque_command=0.0)


def plant(robot):
    with Diagram("bench", rate=1000) as bench:
        robot["knee"].emulator()(position=0.5, velocity=0.1)
    return bench
"""


@pytest.mark.paced
def test_the_table_before_arming_is_that_of_the_page(tmp_path):
    group = f"239.{10 + os.getpid() % 200}.{os.getpid() // 200 % 250}.79"
    bus = f'[bus.legs]\ninterface = "udp_multicast"\nchannel = "{group}"\n'
    (tmp_path / "lab.toml").write_text(bus + "[device.knee]\nrange = [0.0, 0.6]\n")
    (tmp_path / "knee.py").write_text(TABLE)
    emulator = started("emulate", "knee.py", "--rig", "lab.toml", cwd=tmp_path)
    try:
        read_until(emulator.stdout, "Ctrl-C ends it")
        with Terminal() as terminal:
            terminal.run("knee.py", "--rig", "lab.toml", "--no-record", cwd=tmp_path)
            terminal.wait_for(r"press Enter to arm[^\r]*[\r\n]+.*ready")
            printed = plain(terminal.look())
            terminal.press(b"q")
            terminal.end()  # 3 where a busy machine holds up the drive
    finally:
        emulator.terminate()
        emulator.communicate()
    page = (DOCS / "reference" / "arming.md").read_text()
    shown = shown_after(page[page.index("## Confirmation before arming") :], "enabled before you confirm")
    text = one_line(printed.replace(f"udp_multicast {group}", "socketcan can0"))
    assert "0.500 rad in [0, 0.6]" in text and len(shown) > 8
    for line in shown:
        if "guardian" not in line.split()[:1]:  # what the system grants it differs
            assert one_line(line) in text, line


def one_line(text):
    """Return a text in one line, without numbers that the machine determines."""
    return re.sub(r"\d+\.\d+ (ms|rad/s)", r"# \1", " ".join(text.split()))
