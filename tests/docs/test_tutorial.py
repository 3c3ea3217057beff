"""The tutorial, followed to the letter: its commands and cells print what it shows, and its pictures are theirs."""

import os
import re
import signal
import time

import pytest

from tests.docs import notebook, readme
from tests.docs.fences import agree, fences, same_text, texts
from tests.docs.tutorial import CHANNEL, IMAGES, TUTORIAL, Reader, pages, plain
from tests.runtime.runs import finished
from tests.runtime.terminals import Terminal

RIG = "4_rig.md"
OF_THE_MACHINE = re.compile(r"^  (?:speed|fused) .*\n(?:    .*\n)*", re.M)  # lines of `check`
MISTAKES = {"TW002": ("(knee.velocity)", "(knee.position)"), "TW007": ("TorqueLimiter(limit=9.0)(torque)", "torque")}


def assert_shown(shown, printed, in_virtual_time=True):
    """Check that lines of a page are printed, in this order. "..." stands for any text.

    In virtual time the numbers must agree, too.
    """
    rest = iter(printed)
    for line in shown:
        start = line.removesuffix(" ...")
        if line != "...":
            found = next((text for text in rest if same_text(line, text)), None)
            assert found is not None, "\n".join([line, "is missing in:", *printed])
            assert start != line or not in_virtual_time or agree(line, found), (line, found)


def test_commands_print_what_the_tutorial_shows_and_draw_its_pictures(tmp_path):
    reader = Reader(tmp_path)
    for page in pages():
        if page != RIG:
            for shown, printed in reader.follow(page):
                assert_shown(shown, printed)
    (tmp_path / readme.NAME).write_text(readme.draw(tmp_path / "assist", (tmp_path / "exo.svg").read_text()))
    stored = {picture.name: picture for picture in IMAGES.glob("*.svg") if picture.name != "rig.svg"}
    assert len(stored) >= 8
    for name, picture in stored.items():
        assert texts(picture) == texts(tmp_path / name) != set(), name


def test_mistakes_are_reported_as_the_tutorial_shows(tmp_path):
    files = {fence.file: fence.text for page in pages()[:2] for fence in fences(TUTORIAL / page) if fence.file}
    reports = [fence.text for fence in fences(TUTORIAL / "2_block.md") if "error TW" in fence.text]
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    for report, (code, (right, wrong)) in zip(reports, MISTAKES.items(), strict=True):
        assert right in files["exo.py"] and code in report
        (tmp_path / "exo.py").write_text(files["exo.py"].replace(right, wrong))
        assert finished("exo.py", "--fast", "--duration", "1", cwd=tmp_path).stderr == report


def outputs(notebook):
    """Return [(cell number, kind of an output, its text)] of a notebook."""
    found = []
    for number, cell in enumerate(notebook.cells):
        for output in cell.get("outputs", ()):
            data = output.get("data", {"text/plain": output.get("text")})
            html = re.sub("<[^>]*>", "\n", data.get("text/html", ""))
            text = OF_THE_MACHINE.sub("", f"{data['text/plain']}\n{html}\n")
            found.append((number, sorted(data), " ".join(text.split())))
    return found


@pytest.mark.soak
def test_the_notebook_runs_and_has_the_outputs_that_are_stored_in_it(tmp_path):
    files = {fence.file: fence.text for page in pages() for fence in fences(TUTORIAL / page) if fence.file}
    stored = notebook.stored()
    written = [cell.source.partition("\n") for cell in stored.cells if cell.source.startswith("%%writefile")]
    assert len(written) == 2 and all(files[first.split()[1]] == text + "\n" for first, _, text in written)
    for (*cell, text), (*executed, printed) in zip(outputs(stored), outputs(notebook.executed(tmp_path)), strict=True):
        assert cell == executed and agree(text, printed), f"{text}\n{printed}: run python -m tests.docs.notebook"


def channel():
    """Return a multicast group of this process."""
    return f"239.{10 + os.getpid() % 200}.{os.getpid() // 200 % 250}.78"


@pytest.mark.soak
@pytest.mark.timing
def test_a_run_on_the_emulated_rig_is_armed_tuned_and_stopped(tmp_path):
    with Reader(tmp_path, channel(), pause=0.4, options=("--set", "knee.timeout=0.5")) as reader:
        for fence in [fence for page in pages()[:4] for fence in fences(TUTORIAL / page) if fence.file]:
            (tmp_path / fence.file).write_text(fence.text)
        for shown, printed in reader.follow(RIG):
            assert_shown([line for line in shown if " strides of " not in line], printed, in_virtual_time=False)
    assert texts(tmp_path / "rig.svg") == texts(IMAGES / "rig.svg")


@pytest.mark.paced
def test_a_silent_drive_ends_the_run_and_the_operator_the_stop(tmp_path):
    for fence in [fence for page in pages()[:4] for fence in fences(TUTORIAL / page) if fence.file]:
        (tmp_path / fence.file).write_text(fence.text.replace(CHANNEL, channel()))
    section = (TUTORIAL / RIG).read_text().split("## Provoke a fault")[1]
    guardian, report = re.findall(r"```none\n(.*?)```", section, re.DOTALL)
    with Reader(tmp_path) as reader, Terminal() as terminal:
        reader.command("emulate", "exo.py", "--rig", "lab.toml")
        patient = ("--set", "knee.timeout=0.5")  # a busy machine may hold up the emulator for the time of the page
        terminal.run("exo.py", "--rig", "lab.toml", "--record", "fault", *patient, cwd=tmp_path)
        terminal.wait_for(r"press Enter to arm[^\r]*[\r\n]+.*ready")
        time.sleep(0.4)  # a key before the table has been shown arms nothing
        terminal.answer(b"\n", "running")
        reader.emulator.send_signal(signal.SIGINT)
        terminal.wait_for("Ctrl-C ends them")
        printed = plain(terminal.look())
        terminal.press(b"\x03")
        assert terminal.end() == 3
        printed += plain(terminal.look())
    assert_shown(guardian.splitlines(), printed.splitlines(), in_virtual_time=False)
    assert_shown(report.splitlines(), printed.splitlines(), in_virtual_time=False)
