"""`draw` writes pictures."""

import re
from functools import partial

import pytest
import resvg_py
from matplotlib import image

from runtime.host.errors import OK, BadInput
from runtime.robot.loading.draw import choose, rasterise
from tests.runtime.runs import KNEE_EXO, knee


def test_without_a_name_the_drawing_is_an_svg_named_after_the_diagram(command_line):
    code, out, err = command_line("draw", KNEE_EXO)
    assert (code, err) == (OK, "") and out.startswith("knee_exo.svg: 19 blocks, ")
    assert (command_line.folder / "knee_exo.svg").read_text().startswith("<svg ")


@pytest.mark.parametrize(
    "name, form, file, begins",
    [
        ("a.svg", None, "a.svg", "<svg "),
        ("a.html", None, "a.html", "<!doctype html>"),
        ("a.mmd", None, "a.mmd", "flowchart LR"),
        ("a", "html", "a.html", "<!doctype html>"),
        ("a.txt", "mermaid", "a.txt", "flowchart LR"),
        ("a", None, "a.svg", "<svg "),
    ],
)
def test_the_format_is_the_requested_one_or_that_of_the_name(command_line, name, form, file, begins):
    code, out, err = command_line("draw", KNEE_EXO, "-o", name, *(["--format", form] if form else []))
    assert (code, err) == (OK, "") and out.startswith(f"{file}: 19 blocks")
    assert (command_line.folder / file).read_text().startswith(begins)


def test_a_drawing_can_be_written_to_standard_output(command_line):
    code, out, err = command_line("draw", KNEE_EXO, "-o", "-", "--format", "mermaid")
    assert (code, err) == (OK, "") and out.startswith("flowchart LR\n") and list(command_line.folder.iterdir()) == []
    assert command_line.refused("draw", KNEE_EXO, "-o", "-", "--format", "png") == (
        "a PNG cannot be written to standard output: name a file with -o"
    )


def test_an_unsuitable_name_is_converted_to_a_file_name():
    assert choose(None, None, "left/leg & co")[1].name == "left_leg___co.svg"
    with pytest.raises(BadInput, match="unknown format .pdf"):
        choose(None, "a.pdf", "d")


@pytest.mark.soak
def test_a_folder_that_does_not_exist_is_reported_in_one_line(command_line):
    for name in ("no/such/a.svg", "no/such/a.png"):
        assert command_line.refused("draw", KNEE_EXO, "-o", name) == f"cannot write {name}: No such file or directory"


def test_a_diagram_with_errors_is_drawn_with_a_remark(command_line):
    code, out, err = command_line("draw", KNEE_EXO, "--set", "left/torque_limiter.limit=30", "-o", "a.svg")
    assert (
        code == OK
        and out.startswith("a.svg")
        and err == (f"1 error drawn in red: python -m runtime check {KNEE_EXO} lists them\n")
    )
    assert 'class="box actuator wrong" data-path="left/knee=command"' in (command_line.folder / "a.svg").read_text()


def test_options_show_all_ports_and_another_rate(command_line):
    assert ">temperature<" not in command_line("draw", KNEE_EXO, "-o", "-")[1]
    out = command_line("draw", KNEE_EXO, "-o", "-", "--all-ports", "--rate", "500")[1]
    assert ">temperature<" in out and ">knee_exo, 500 Hz<" in out


def test_no_drawing_contains_an_absolute_path(command_line):
    knee(command_line.folder)
    for form in ("svg", "html", "mermaid"):
        assert str(command_line.folder) not in command_line("draw", "robot.py", "-o", "-", "--format", form)[1]
    assert '"made": "robot.py:' in command_line("draw", "robot.py", "-o", "-", "--format", "html")[1]


@pytest.mark.soak
def test_a_png_has_twice_the_pixels_of_the_drawing_and_its_text(command_line, monkeypatch):
    """Also where the system has no fonts."""
    monkeypatch.setattr(resvg_py, "svg_to_bytes", partial(resvg_py.svg_to_bytes, skip_system_fonts=True))
    assert command_line("draw", KNEE_EXO, "-o", "a.png") == (OK, "a.png: 19 blocks, 1635 × 689 px\n", "")
    pixels = image.imread(command_line.folder / "a.png")
    text = command_line("draw", KNEE_EXO, "-o", "-")[1]
    width, height = (float(text.split(f'{side}="', 1)[1].split('"')[0]) for side in ("width", "height"))
    assert pixels.shape[:2] == (round(2 * height), round(2 * width))
    rasterise(re.sub("<text.*?</text>", "", text), command_line.folder / "b.png")
    inked = (pixels != image.imread(command_line.folder / "b.png")).any(axis=2)
    assert 0.01 < inked.mean() < 0.1  # of the area is text
