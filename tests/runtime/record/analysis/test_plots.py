"""Plots of recordings: their content, read from the SVG, and their paths."""

import copy
import json
import math
import re
import sys
import warnings
from xml.etree import ElementTree

import numpy as np
import pytest

import runtime
from cext.memory.shared_state import RECORD_EVENT
from runtime.host.errors import CHECK_FAILED, FAULT, OK, BadInput
from runtime.record.analysis import plots
from runtime.record.analysis.legs import legs
from runtime.record.analysis.picture import short
from tests.runtime.record.analysis.test_recorded_trial import SIGNALS, walk
from tests.runtime.record.recorder.running import CSV, columns, plan, record, row, sink
from tests.runtime.runs import KNEE_EXO, knee


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    folder = tmp_path_factory.mktemp("walk")
    record(
        plan(folder, sink(CSV, "csv", columns(*SIGNALS)), stem="walk"), [row(*values) for values in walk(range(1000))]
    )
    return folder / "walk.mcap"


def drawn(path):
    """The texts of an SVG."""
    return {text.text for text in ElementTree.parse(path).iter("{http://www.w3.org/2000/svg}text")}


def test_signals_are_drawn_with_their_units_on_the_axes(command_line, recording):
    code, out, err = command_line("plot", recording, "left/knee.position", "left/gait.phase", "-o", "a.svg")
    assert (code, out, err) == (OK, "a.svg\n", "")
    assert {"[rad]", "time [s]", "left/knee.position", "left/gait.phase"} <= drawn("a.svg")  # which leg, too


def test_missing_matplotlib_is_reported_with_install_command(command_line, recording, monkeypatch):
    for name in [name for name in sys.modules if name.partition(".")[0] == "matplotlib"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    assert command_line.refused("plot", recording, "left/knee.position") == (
        "a picture needs matplotlib: pip install matplotlib"
    )


@pytest.mark.soak
def test_without_names_each_subsystem_has_a_plot(command_line, tmp_path):
    assert command_line(KNEE_EXO, "--fast", "--duration", "5", "--record", tmp_path / "run")[0] == OK
    [path] = (tmp_path / "run").glob("*.mcap")
    code, out, err = command_line("plot", path, "--svg")
    left, right, state = out.split()
    assert (code, err) == (OK, "") and left.endswith("_left.svg") and right.endswith("_right.svg")
    assert {"[rad]", "[N·m]", "knee.torque", "knee.position", "limit"} <= drawn(left)
    png, again = (command_line("plot", path, "left/knee.torque")[1].strip() for _ in range(2))
    assert again == png.replace(".png", "-2.png")  # nothing is overwritten
    assert png.endswith("_plot.png") and open(png, "rb").read(8) == b"\x89PNG\r\n\x1a\n"


MACHINE = """
from blocks.actuators import CubeMars
from blocks.limiters import TorqueLimiter
from blocks.sources import Sine
from blocks.states import StateMachine
from graph import Diagram

with Diagram("machine", rate=200) as diagram:
    knee = CubeMars("AK80-9", name="knee")
    gait = StateMachine(
        takes={"u": "1"},
        gives={"torque": "N·m"},
        states={"stance": {"torque": 2.0}, "swing": {"torque": -1.0}},
        transitions=[("stance", "swing", "u > 0.5"), ("swing", "stance", "u < -0.5")],
        name="gait",
    )(u=Sine(frequency=1.0)())
    knee(torque_command=TorqueLimiter(limit=4.0)(gait.torque))
"""


@pytest.mark.soak
def test_trials_are_drawn_over_each_other_with_their_proved_limit_and_states_have_names(command_line, tmp_path):
    (tmp_path / "machine.py").write_text(MACHINE)
    for name, options in {"weak": (), "strong": ("--set", "torque_limiter.limit=1.5")}.items():
        words = ("--fast", "--duration", "2", "--record", tmp_path / name, "--trial", f"condition={name}")
        assert command_line(tmp_path / "machine.py", *words, *options)[0] == OK
    weak, strong = (runtime.load(tmp_path / name) for name in ("weak", "strong"))
    assert weak.about["limits"]["knee.torque"] == [-4.0, 4.0]  # not the 9 N·m of the drive
    assert strong.about["limits"]["knee.torque_sent"] == [-1.5, 1.5]
    assert weak.about["states"] == {"gait.state": ["stance", "swing"]}
    assert command_line("plot", tmp_path / "weak", "-o", "machine.svg")[0] == OK
    assert {"stance", "swing", "limit"} <= drawn("machine.svg")

    assert command_line("plot", tmp_path / "weak", tmp_path / "strong", "-o", "both.svg")[0] == OK
    assert {"weak over strong", "weak", "strong", "knee.position", "knee.torque", "time [s]"} <= drawn("both.svg")
    assert "limit" not in drawn("both.svg")  # each has another
    assert command_line("plot", tmp_path / "weak", tmp_path / "strong", "gait.state", "-o", "state.svg")[0] == OK
    assert {"gait.state", "stance", "swing", "weak", "strong"} <= drawn("state.svg")
    refusal = command_line.refused("plot", tmp_path / "weak", tmp_path / "strong", "knee.torqe")
    assert "did you mean 'knee.torque" in refusal

    code, out, _ = command_line("diff", tmp_path / "weak", tmp_path / "strong", "-o", "diff.svg")
    assert code == CHECK_FAILED and out.startswith("weak and strong: 400 ticks in both\n")
    assert {"weak", "strong", "knee.torque", "[N·m]", "[rad]"} <= drawn("diff.svg")
    names = [line.split()[0] for line in out.splitlines()[2:]]
    knee = [place for place, name in enumerate(names) if name.startswith("knee.")]
    assert len(knee) > 3 and knee == list(range(knee[0], knee[-1] + 1))  # one joint, one group


def test_plot_shows_fault_and_mark(command_line, tmp_path):
    path = knee(tmp_path, "return 1.0 if tick < 150 else math.nan")
    assert command_line(path, "--fast", "--duration", "2", "--record", tmp_path / "run")[0] == FAULT
    [file] = (tmp_path / "run").glob("*.mcap")
    command_line("plot", file, "knee.torque", "-o", "fault.svg")
    assert any(text.startswith("fault: ") and "at knee" in text for text in drawn("fault.svg"))
    [(at, words, colour)] = plots.moments(runtime.load(file))
    assert at == 0.75 and colour == plots.FAULT


def test_intervals_of_fault_code_are_detected():
    assert plots.spells(np.array([0, 1, 1, 0, 0, 1], dtype=bool)) == [(1, 2), (5, 5)]
    assert plots.spells(np.zeros(3, dtype=bool)) == []


@pytest.mark.soak
def test_summary_picture_and_plot_have_the_same_figures_of_the_same_signals(command_line, tmp_path):
    code, summary, _ = command_line(KNEE_EXO, "--fast", "--duration", "10", "--record", tmp_path / "run")
    [path] = (tmp_path / "run").glob("*.mcap")
    command_line("plot", path, "--strides", "-o", "strides.svg")
    command_line("plot", path, "--strides", "-o", "strides.png")
    texts = drawn("strides.svg")
    assert {"knee flexion (°)", "knee torque (N·m)", "knee power (W)", "gait cycle (%)"} <= texts
    about = (tmp_path / "strides.svg").read_text()
    assert "work of knee.torque and butterworth.y; angle knee.position, phase gait_phase.phase" in about
    found, told = legs(runtime.load(path)), sidecar(path)["strides"]
    assert found == told and [leg["title"] for leg in found] == ["left", "right"]
    for leg in found:
        assert leg["signals"]["velocity"] == f"{leg['title']}/butterworth.y"
        assert (
            f"positive work {leg['positive_work']:.2f} J per stride, negative {leg['negative_work']:.2f} J" in summary
        )
        assert f"work per stride {leg['positive_work']:+.2f} J and −{-leg['negative_work']:.2f} J" in about
        assert f"{leg['title']}, N = {leg['strides']} strides" in texts
    assert open("strides.png", "rb").read() == path.with_suffix(".png").read_bytes()
    assert "work of knee.torque and butterworth.y, angle knee.position, phase gait_phase.phase; not used: " in summary


def test_joints_without_report_are_plotted_from_their_signals(crowded):
    [leg] = legs(runtime.load(crowded))
    assert leg["signals"] == {
        "angle": "left/knee/motor.position",
        "velocity": "left/knee/motor.velocity",
        "torque": "left/knee/motor.torque",
        "phase": "left/gait.phase",
        "walking": "left/gait.walking",
    }
    assert leg["left_out_because"] == {"with a value that is not finite": 1}


@pytest.mark.parametrize("events", ["left/gait.phase", [1.0, 2.0, 3.0, 4.0]])
def test_strides_begin_at_given_events_and_are_the_same(crowded, events):
    trial = runtime.load(crowded)
    [leg], [given, spare] = legs(trial), legs(trial, events)
    assert spare["path"] == "spare/motor"  # which has no gait of its own
    assert given["strides"] == leg["strides"] == 2 and given["positive_work"] == pytest.approx(
        leg["positive_work"], rel=1e-12
    )
    assert given["stride_time"] == 1.0 and np.allclose(
        given["curves"]["torque"]["mean"], leg["curves"]["torque"]["mean"], atol=0.02
    )


def sidecar(path):
    return json.loads(path.with_suffix(".json").read_text())


def test_one_signal_over_the_gait_cycle(command_line, recording):
    code, out, err = command_line("plot", recording, "--strides", "left/knee.position", "-o", "one.svg")
    assert (code, err) == (OK, "") and {"knee position (°)", "gait cycle (%)"} <= drawn("one.svg")
    assert any(re.fullmatch(r"left, N = \d strides", text) for text in drawn("one.svg"))


def test_undrawable_selection_is_reported_in_one_line(command_line, recording, tmp_path):
    assert "has no signal 'left/knee.posiion': did you mean 'left/knee.position'?" in command_line.refused(
        "plot", recording, "left/knee.posiion"
    )
    assert "No such file" in command_line.refused("plot", recording, "b.mcap")
    assert command_line.refused("plot", recording, "b").endswith("has no signal 'b', nor is there such a recording")
    assert (
        command_line.refused("plot", recording, "-o", "a.jpg")
        == "-o a.jpg: the name of a picture must end in .png, .svg or .pdf"
    )
    refusal = command_line.refused("plot", recording, "--strides")
    assert "has no complete stride of a joint" in refusal and "name signals" in refusal
    assert command_line.refused("plot", recording, "--events", "x") == "--events needs --strides"
    assert "No such file" in command_line.refused("plot", recording, "-o", tmp_path / "nowhere" / "a.png")
    assert "has 4 elements: name one" in command_line.refused("plot", recording, "--strides", "left/imu.quaternion")


JOINTS = (
    "knee/motor.position rad",
    "knee/motor.velocity rad/s",
    "knee/motor.torque N·m",
    "knee/motor.fault 1 int",
    "gait.phase 1",
    "gait.walking 1 bool",
)
CROWD = tuple(f"crowd.x{number} A" for number in range(14))
ALONE = (
    "spare/motor.position rad",
    "spare/motor.velocity rad/s",
    "spare/motor.torque N·m",
    "left/odd.huge m",
    "left/odd.nothing s",
    "left/odd.on 1 bool",
)


@pytest.fixture(scope="module")
def crowded(tmp_path_factory):
    """Strides of 1 s, of which one holds what is no number; a joint outside the gait; 14 signals of a unit; faults and
    marks.
    """
    folder = tmp_path_factory.mktemp("crowd")

    def values(tick):
        phase = tick % 200 / 200
        torque = math.nan if tick == 500 else math.sin(2.0 * math.pi * phase)
        joint = (phase * (1.0 - phase), 1.0 - 2.0 * phase, torque, 3 if 300 <= tick < 320 else 0, phase, True)
        return (*joint, *range(14), 0.0, 0.0, 0.0, 1.7e308 * (-1) ** tick, math.nan, tick % 2)

    def event(kind, tick, **words):
        return RECORD_EVENT, json.dumps({"event": kind, "tick": tick, **words}).encode()

    marks = [event("mark", 45 * number, number=number) for number in range(1, 22)]
    faults = [
        event("fault", 700, status="a silent device", culprit="knee/motor"),
        event("fault", 705, status="another", culprit="spare/motor"),
    ]
    signals = columns(*(f"left/{text}" for text in (*JOINTS, *CROWD)), *ALONE)
    record(
        plan(folder, sink(CSV, "csv", signals), stem="crowd"),
        [*(row(tick, *values(tick)) for tick in range(1000)), *marks, *faults],
    )
    return folder / "crowd.mcap"


def test_a_named_block_or_subsystem_is_drawn_completely(command_line, crowded):
    trial = runtime.load(crowded)
    rows = plots.rows_of(trial, ["left/crowd", "left/knee", "left/crowd.x3"])
    assert [path for paths in rows for path in paths] == [f"left/{text.split()[0]}" for text in (*CROWD, *JOINTS[:4])]
    assert sorted(map(len, rows)) == [1, 1, 1, 1, 2, 12]  # a plot a unit, and no plot too full
    with pytest.raises(BadInput, match="need 102 plots, more than 100: select fewer"):
        plots.rows_of(many(trial, 1213), ["many"])
    told = command_line.refused("plot", crowded, "left/crow")
    assert told.startswith("crowd.mcap has no signal 'left/crow': did you mean 'left/crowd.x")


@pytest.mark.soak
def test_differences_of_huge_values_are_drawn_without_them(command_line, tmp_path):
    """A simulation that diverges passes through them before its values are infinite."""
    for name, sign in (("a", 1.0), ("b", -1.0)):
        huge = [row(tick, 1.0 + sign, sign * 1.7e308, sign * 1e160 if tick == 3 else 0.0) for tick in range(9)]
        record(plan(tmp_path, sink(CSV, "csv", columns("u.x m", "u.y m", "u.z m")), stem=name), huge)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        code, out, err = command_line("diff", tmp_path / "a.mcap", tmp_path / "b.mcap", "-o", "diff.svg")
    assert (code, err) == (CHECK_FAILED, "") and {"u.x", "u.y", "u.z"} <= drawn("diff.svg")
    differences = {words[0]: words[2:] for line in out.splitlines()[2:5] for words in [line.split()]}
    assert differences == {
        "u.x": ["0", "9", "2", "2"],
        "u.y": ["0", "9", "inf", "inf"],
        "u.z": ["3", "1", "2e+160", "inf"],
    }


def many(trial, count):
    """A trial of so many signals in a unit."""
    made = copy.copy(trial)
    made.about = {
        **trial.about,
        "signals": [{"path": f"many.x{number}", "unit": "m", "dtype": "float"} for number in range(count)],
    }
    made.signals = {signal["path"]: signal for signal in made.about["signals"]}
    made.places = {path: place for place, path in enumerate(made.signals)}
    return made


@pytest.mark.soak
def test_plot_reports_omitted_signals_and_skips_undrawable_ones(command_line, crowded):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        pictures_of = plots.overview(runtime.load(crowded))
        code, out, err = command_line("plot", crowded, "left/odd", "-o", "odd.svg")
    assert (code, out, err) == (OK, "odd.svg\n", "")
    rows, share = pictures_of["left"]
    assert (
        share == "17 of 19 signals" and sorted(map(len, rows)) == [1, 1, 1, 2, 12] and pictures_of["left/knee"][1] == ""
    )
    assert {"no number", "true", "false"} <= drawn("odd.svg")


def test_labels_of_faults_and_marks_do_not_overlap(crowded):
    trial = runtime.load(crowded)
    figure, axes = plots.sheet(1, "words")
    axes[0].set_xlim(trial.time[0], trial.time[-1])
    plots.name_troubles(axes[0], {"crowd": trial})
    figure.canvas.draw()
    said = [text.get_text() for text in axes[0].texts]
    assert {"left/knee/motor.fault: 3", "fault: a silent device at knee/motor", "fault: another at spare/motor"} <= set(
        said
    ) and len(said) > 15
    boxes = [text.get_window_extent() for text in axes[0].texts]
    assert not [said[i] for i, one in enumerate(boxes) for other in boxes[:i] if one.overlaps(other)]


def test_strides_with_nan_and_joints_without_gait_phase_are_omitted(command_line, crowded):
    trial = runtime.load(crowded)
    [leg] = legs(trial)
    # of four that begin and end in it, less the torn one and the last
    assert (leg["path"], leg["strides"]) == ("left/knee/motor", 2)
    assert np.allclose(leg["curves"]["torque"]["mean"], np.sin(2.0 * np.pi * np.linspace(0.0, 1.0, 101)), atol=0.05)
    assert np.isnan(trial.strides("left/knee/motor.torque")).any(axis=1).tolist() == [False, True, False]
    command_line("plot", crowded, "--strides", "left/knee/motor.torque", "-o", "two.svg")
    assert {"knee motor torque (N·m)", "left, N = 2 strides"} <= drawn("two.svg")
    assert plots.alone(trial, "left/knee") == [f"left/{text.split()[0]}" for text in JOINTS[:4]]


def test_one_tick_is_a_dot_in_the_middle(command_line, tmp_path):
    record(plan(tmp_path, sink(CSV, "csv", columns("a.x m")), stem="one"), [row(7, 1.5)])
    code, out, err = command_line("plot", tmp_path / "one.mcap", "-o", "one.svg")
    assert (code, out, err) == (OK, "one.svg\n", "") and "a.x" in drawn("one.svg")


def test_names_may_have_any_letters(command_line, tmp_path):
    """A name that begins with _ matplotlib would leave out, one between dollars it would set as a formula; and no font
    has all letters.
    """
    names = ("_hidden.y", "a$b$.z", "a$\\frac.z", "膝.x", "x^{2}.y")
    record(
        plan(tmp_path, sink(CSV, "csv", columns(*(f"{name} m" for name in names))), stem="ta$k$"),
        [row(tick, *range(5)) for tick in range(300)],
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        code, out, err = command_line("plot", tmp_path / "ta$k$.mcap", "-o", "any.svg")
    assert (code, out, err) == (OK, "any.svg\n", "") and {*names, "ta$k$: bench"} <= drawn("any.svg")


def test_a_long_name_keeps_its_end_and_leaves_room_for_the_plot():
    assert short("left/knee.torque", 16) == "left/knee.torque"
    assert short("left/leg/knee_motor.torque", 16) == "left/…tor.torque" and len(short("x" * 99, 44)) == 44
