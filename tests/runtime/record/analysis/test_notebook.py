"""What a notebook shows of a Trial, its pictures, a Diagram and the report of check."""

import re
import xml.etree.ElementTree as ElementTree
from base64 import b64decode

import pytest

import runtime
from blocks.recorders import CsvRecorder
from blocks.sources import Sine
from graph import Diagram
from runtime.host.errors import BadInput
from tests.runtime.runs import KNEE_EXO, knee


@pytest.fixture(scope="module")
def trial():
    return runtime.run(KNEE_EXO, 12, settings={"assistance": 0.5})


def text_of(html):
    """The text of HTML that is well-formed."""
    return " ".join(" ".join(ElementTree.fromstring(f"<div>{html}</div>").itertext()).split())


def test_a_trial_shows_its_run_and_its_signals(trial):
    text = text_of(trial._repr_html_())
    assert "knee_exo ticks 2400 at 200 Hz, 12 s robot simulated, in virtual time settings assistance=0.5" in text
    assert "ended ok" in text and "left/knee.position rad" in text and f"{len(trial.names)} signals" in text


def test_a_mistake_in_a_cell_is_shown_as_its_line_and_the_remedy(trial, capsys):
    shell = pytest.importorskip("IPython.core.interactiveshell").InteractiveShell()
    shell.user_ns["trial"] = trial
    for cell, said in (
        ("import runtime\ntrial['left/knee.positon']", "knee_exo has no signal 'left/knee.positon': did you mean "),
        ("import runtime\nruntime.run('none.py', 1)", "file none.py does not exist"),
    ):
        shell.run_cell(cell)
        first, second = capsys.readouterr().out.splitlines()
        assert first == f"line 2: {cell.splitlines()[1]}" and second.partition(": ")[2].startswith(said)


def test_a_trial_with_a_fault_shows_the_report_and_escapes_it(tmp_path):
    failed = runtime.run(knee(tmp_path, 'raise ValueError("a < b & c")'), 1)
    assert "FAULT at law, tick 0" in text_of(failed._repr_html_()) and "a < b & c" in text_of(failed._repr_html_())


def test_plots_over_the_gait_cycle_are_shown(trial):
    pictures = trial.plot("left/knee.torque", strides=True, between=("1", "end"))
    assert list(pictures.draws) == ["strides"] and "save('NAME.png')" in repr(pictures)
    [(kind, picture)] = pictures._repr_mimebundle_().items()
    assert kind == "image/png" and b64decode(picture).startswith(b"\x89PNG")
    assert list(trial.plot(strides=True, last=2).draws) == ["strides"]


def test_plots_over_time_are_saved(trial, tmp_path):
    [path] = trial.plot("left/knee.position", "left/knee.torque").save(tmp_path / "knee.svg")
    assert path == tmp_path / "knee.svg" and ElementTree.parse(path).getroot().tag.endswith("svg")


@pytest.mark.soak
def test_a_plot_without_names_has_a_picture_for_each_subsystem(trial):
    pictures = trial.plot()
    assert list(pictures.draws) == ["left", "right", "knee_exo"]
    picture = r'<img alt="\w+" style="max-width: 100%" src="data:image/png;base64,iVBOR[\w+/=]+">'
    [(kind, text)] = pictures._repr_mimebundle_().items()
    assert kind == "text/html" and re.fullmatch(f"({picture}){{3}}", text)


def test_a_plot_that_cannot_be_drawn_is_refused(trial, tmp_path):
    with pytest.raises(KeyError, match="did you mean 'left/knee.position'"):
        trial.plot("left/knee.positoin")
    with pytest.raises(BadInput, match="add strides=True"):
        trial.plot(last=3)
    with pytest.raises(BadInput, match="must end in .png, .svg or .pdf"):
        trial.plot("left/knee.position").save(tmp_path / "knee.jpg")


def test_a_diagram_shows_its_drawing_and_check_its_report():
    with Diagram("sine", rate=100) as diagram:
        Sine(name="source")()
        CsvRecorder()
    drawing = ElementTree.fromstring(diagram._repr_svg_())
    assert drawing.tag.endswith("svg") and "source" in " ".join(drawing.itertext())
    report = runtime.check(diagram)
    assert report["ok"] and report["diagram"] == "sine" and str(report).startswith("sine  sine: 100 Hz, 2 blocks")
    assert text_of(report._repr_html_()) == " ".join(str(report).split())
    folded = re.findall("<details><summary>(.*?)</summary>", report._repr_html_())
    assert [title.split()[0] for title in folded] == ["ports", "schedule"]
    with pytest.raises(BadInput, match="would change the Diagram"):
        runtime.check(diagram, rate=50)


def test_check_takes_settings_and_reports_errors():
    report = runtime.check(KNEE_EXO, settings={"left/torque_limiter.limit": 30.0})
    assert not report["ok"] and [error["code"] for error in report["errors"]] == ["TW007"] and "TW007" in repr(report)
