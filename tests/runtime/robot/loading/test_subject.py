"""Subject files: their errors, the limits that they put on a diagram, the end of a session."""

import dataclasses
import json
import math
import re

import numpy as np
import pytest

import runtime
from blocks.actuators import Actuator
from blocks.limiters import TorqueLimiter
from blocks.sources import Constant
from graph import Caps, Diagram, DiagramError, Live, compile
from runtime.host.errors import BadInput
from runtime.record.storage.format import Frame
from runtime.robot.guardian import plan, with_flags
from runtime.robot.guardian.stop import decoded
from runtime.robot.guardian.torque import TorqueCaps
from runtime.robot.loading.file import load
from runtime.robot.loading.subject import FADE_OUT, of_recording, read
from tests.runtime.runs import KNEE_EXO, finished, write

SIGNED = 'version = 1\nid = "S03"\nsigned_by = "A. Investigator"\ndate = 2026-11-27\nreason = "first session"\n'


def subject(folder, text, name="subject.toml"):
    return write(folder, SIGNED + text, name)


def robot(torque=9.0, model="AK80-9", **options):
    """A knee that is told to give a torque, and its limiter, which a live change can raise."""
    with Diagram("knee", rate=200) as diagram:
        knee = Actuator(model, can_id=1, name="knee", **options)
        limiter = TorqueLimiter(limit=Live(9.0, max=9.0), slew=math.inf, name="limiter")
        knee(torque_command=limiter(Constant(torque, unit="N·m", name="wish")()))
    return diagram


def test_check_lists_the_limits_of_a_subject_and_reports_what_they_contradict(tmp_path, command_line):
    caps = subject(tmp_path, '[joint."left/knee"]\ntorque = 3\n')
    code, out, _ = command_line("check", KNEE_EXO, "--subject", caps)
    assert code == 0 and re.search(r"limits of the subject\n(?s:.*)left/knee: 3 N·m", out)
    assert not json.loads(command_line("check", KNEE_EXO, "--json")[1])["subject"]
    assert runtime.check(KNEE_EXO, subject=caps)["subject"][1] == "left/knee: 3 N·m"
    with pytest.raises(BadInput, match="and subject would change the Diagram"):
        runtime.check(robot(), subject=caps)
    code, _, err = command_line(
        "check", KNEE_EXO, "--subject", subject(tmp_path, '[joint."kne"]\ntorque = 3', "2.toml")
    )
    assert code == 2 and "has no such actuator" in err


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('[joint."knee"]\ntorque = "8 N"', "torque = '8 N': N does not convert to N·m"),
        ('[joint."knee"]\ntorque = -1', "expected a finite number above 0"),
        ('[joint."knee"]\nrange = [-5, 90]', 'more than a turn: did you mean ["-5 deg", ...]?'),
        ('[joint."knee"]\nrange = ["90 deg", "-5 deg"]', "expected two angles in ascending order"),
        ('[joint."knee"]\ntorqe = 3', "torqe: no such key; did you mean 'torque'?"),
        ("[joint.left.knee]\ntorque = 3", 'quote the path: [joint."left/knee"]'),
        ("[session]\nduration = 0", "[session] duration = 0: expected a finite number above 0"),
        ("", "it limits nothing"),
        ('[joint."kne"]\ntorque = 3', "has no such actuator; did you mean 'knee'?; its joints are knee"),
        ('[assistance]\n"limiter.limt" = 3', "no such parameter; did you mean 'limit'?"),
        ('[assistance]\n"*.limt" = 3', "[assistance] *.limt: knee has no parameter that matches"),
        ('[joint."knee"]\nrange = [1, 2]', "have no angle in common"),
    ],
)
def test_an_error_names_the_file_the_place_and_the_remedy(tmp_path, text, words):
    with pytest.raises(BadInput, match=r"subject\.toml") as error:
        runtime.run(robot(range=(-0.5, 0.5)), 0.1, subject=subject(tmp_path, text))
    assert words in str(error.value)


def test_no_second_file_takes_the_place_of_the_first(tmp_path, command_line):
    small, large = (subject(tmp_path, f'[joint."*"]\ntorque = {cap}\n', f"{cap}.toml") for cap in (3, 9))
    for command in (["check", KNEE_EXO], [KNEE_EXO, "--fast"], ["study", "study.toml"]):
        code, _, err = command_line(*command, "--subject", small, "--subject", large)
        assert code == 2 and "--subject was given twice" in err and "3.toml and" in err, err
    study = f'diagram = "{KNEE_EXO}"\nduration = 1\nsubject = "{small}"\n[grid]\nassistance = [1.0]\n'
    study += '[objectives]\nwork = { function = "positive_work", leg = "left" }\n'
    code, _, err = command_line("study", write(tmp_path, study, "study.toml"), "--subject", large)
    assert code == 2 and "has a subject file already" in err, err


def test_a_file_without_a_signature_or_of_another_version_is_refused(tmp_path):
    path = write(tmp_path, 'version = 2\nid = "S03"\ndate = 2026-11-27\n[joint."*"]\ntorque = 3\n', "subject.toml")
    with pytest.raises(BadInput) as error:
        read(path)
    for words in ("expected version = 1", "signed_by is missing", "reason is missing"):
        assert words in str(error.value)
    with pytest.raises(BadInput, match="No such file"):
        read(tmp_path / "none.toml")


@pytest.mark.hazard("H1l")
def test_a_diagram_keeps_its_own_limits_after_a_run_with_smaller_ones(tmp_path):
    diagram = robot()
    path = subject(
        tmp_path, '[joint."*"]\ntorque = 2\nspeed = 20\nrange = [-2, 2]\n[assistance]\n"limiter.limit" = 4\n'
    )
    with runtime.simulate(diagram, subject=path) as sim:
        with pytest.raises(BadInput, match="limiter.limit"):
            sim["limiter.limit"] = 5.0
        for _ in range(100):
            sim.step()
            assert abs(sim["knee.torque_sent"]) <= 2.0 and sim["limiter.limited"] <= 4.0
        assert (diagram["knee"].max_velocity, tuple(diagram["knee"].range)) == (20.0, (-2.0, 2.0))
        assert sim["knee.torque_sent"] > 1.9 and sim.schedule.torque_bounds["knee"].limit == 2.0
    assert max(runtime.run(diagram, 0.6)["knee.torque_sent"]) > 8.9 and diagram["limiter"].limit == 9.0


@pytest.mark.hazard("H1l")
def test_the_power_is_limited_at_the_measured_speed(tmp_path):
    trial = runtime.run(robot(), 0.6, subject=subject(tmp_path, '[joint."knee"]\npower = 10\n'))
    power = np.abs(trial["knee.torque_sent"] * trial["knee.velocity"])
    code = np.abs(trial["knee.velocity"]) * 36.0 / 4095  # of a torque
    assert (power <= 10.0 + code).all() and power.max() > 9.9
    free = runtime.run(robot(), 0.6)
    assert np.abs(free["knee.torque_sent"] * free["knee.velocity"]).max() > 20.0


@pytest.mark.hazard("H1l")
def test_a_range_of_the_wire_that_may_be_too_small_lowers_the_cap(tmp_path):
    """If the table is right, an AK80-9 gives twice of what is commanded here."""
    path = subject(tmp_path, '[joint."knee"]\ntorque = 2\n')
    trial = runtime.run(robot(limit=9.0, wire_torque=9.0), 0.5, subject=path)
    assert 0.95 < trial["knee.torque_sent"].max() <= 1.0


@pytest.mark.hazard("H1l")
@pytest.mark.parametrize(
    ("knee", "words"),
    [
        ({"model": "RS03", "mode": "csp"}, "nothing that it sends bounds its torque"),
        ({"model": "AK80-9-servo", "mode": "velocity"}, "nothing that it sends bounds its torque"),
        ({"model": "AK80-9-servo", "safe_stop": "brake", "stop_current": 5.0}, "lower the current or the damping"),
        ({"model": "RobStride03-mit"}, "ranges: if that is correct"),
    ],
)
def test_a_cap_that_cannot_hold_is_refused(tmp_path, knee, words):
    with Diagram("knee", rate=200) as diagram:
        joint = Actuator(knee.pop("model"), can_id=1, name="knee", **knee)
        joint(**{next(iter(joint.inputs)): 0.0})
    with pytest.raises((BadInput, DiagramError), match="TW036") as error:
        runtime.run(diagram, 0.1, subject=subject(tmp_path, '[joint."knee"]\ntorque = 2\n'))
    assert words in str(error.value) and "subject S03 (subject.toml)" in str(error.value)


def test_assistance_limits_parameters_of_the_diagram_and_of_its_function(tmp_path):
    def build(assistance=0.8):
        return robot(torque=9.0 * assistance)

    path = subject(tmp_path, "[assistance]\nassistance = 0.5\n")
    for given in ({}, {"assistance": "0.9"}):
        assert runtime.run(build, 0.1, settings=given, subject=path)["wish.y"].max() == 4.5
    assert runtime.run(build, 0.1, settings={"assistance": 0.1}, subject=path)["wish.y"].max() == pytest.approx(0.9)


@pytest.mark.hazard("H1n")
def test_a_session_ends_with_a_ramp_and_names_its_limit(tmp_path):
    path = subject(tmp_path, '[session]\nduration = "0.1 min"\n')
    rows = runtime.run(robot(torque=0.5), 60.0, subject=path)["knee.torque_sent"]
    assert len(rows) == 1200
    ramp = rows[-round(FADE_OUT * 200) :]
    assert rows[-len(ramp) - 1] > 0.48 and ramp[-1] < 0.02 and (np.diff(ramp) <= 0.0).all()
    with runtime.simulate(robot(torque=0.0), subject=path) as sim:
        sim.step(100.0)
        assert sim.tick == 1200
    run = finished(KNEE_EXO, "--fast", "--duration", "9", "--subject", path, "--record", "here", cwd=tmp_path)
    assert "the session ended after 6 s: subject S03 (subject.toml) allows no more" in run.stderr, run
    [recording] = (tmp_path / "here").glob("*.mcap")
    [about] = (json.loads(each.read_text()) for each in (tmp_path / "here").glob("*.json"))
    assert of_recording(about["metadata"]["subject"]) == dataclasses.replace(read(path), file="subject.toml")
    replayed = finished("replay", recording, cwd=tmp_path)
    assert replayed.returncode == 0 and "bit for bit" in replayed.stdout, replayed


@pytest.mark.hazard("H1m")
@pytest.mark.parametrize("model", ["AK80-9", "AK80-9-V3.0", "AK80-9-servo", "RS02", "RS02-mit"])
def test_the_guardian_reads_the_torque_of_every_family(tmp_path, model):
    """In the frames of a run whose commands reach 2 N·m, and in those of the drive, which measures as much."""
    command = (
        "current_command=2.0 / 0.945" if model.endswith("servo") else "torque_command=TorqueLimiter(limit=2.0)(wish)"
    )
    text = f"""
from blocks.actuators import Actuator
from blocks.limiters import TorqueLimiter
from blocks.recorders import CsvRecorder
from blocks.sources import Constant
from graph import Diagram

with Diagram("knee", rate=200) as diagram:
    wish = Constant(2.0, unit="N·m")()
    knee = Actuator({model!r}, can_id=1, name="knee"{", ranges='private'" if model == "RS02-mit" else ""})
    knee({command})
    CsvRecorder()
"""
    path = write(tmp_path, text)
    run = finished(path, "--fast", "--duration", "1", "--record", "here", cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    recorded = runtime.load(next((tmp_path / "here").glob("*.mcap"))).frames
    frames = [Frame.unpack(frame.payload) for frame in recorded]
    said = [(with_flags(frame.id, frame.extended), frame.data) for frame in frames]
    sent = [words for words, frame in zip(said, frames) if frame.sent]
    received = [(*words, frame.time) for words, frame in zip(said, frames) if not frame.sent]
    for cap, permitted in ((2.1, True), (1.8, False)):
        caps = caps_of(path, cap)
        assert all(caps.permits(0, *frame) for frame in sent) is permitted, cap
        caps.excess = None
        for frame in received:
            caps.measure(0, *frame)
        assert (caps.excess is None) is permitted, caps.excess


def caps_of(path, cap):
    """TorqueCaps of the guardian for the knee of a diagram file, whose drive measures exactly."""
    _, diagram = load(path)
    diagram.caps = {"knee": Caps(torque=cap, source="a test")}
    guarded = plan([], compile(diagram), None)["devices"]
    guarded[0]["cap"]["accuracy"] = 0.0
    return TorqueCaps([decoded(device) for device in guarded])


@pytest.mark.hazard("H1l")
def test_no_trial_of_a_study_exceeds_a_cap(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = subject(tmp_path, '[joint."knee"]\ntorque = 2\n')
    result = runtime.study(
        lambda wish: robot(wish),
        0.6,
        {"torque": lambda trial: trial["knee.torque_sent"].max()},
        grid={"wish": [1.0, 9.0]},
        subject=path,
        workers=0,
    )
    assert list(result["torque"]) == pytest.approx([1.0, 2.0], abs=0.01) and max(result["torque"]) <= 2.0
