"""The command `optimise`: a run in real time with an optimiser process beside it, and the same in virtual time."""

import json
import os
import signal

import pytest

from runtime.cli.optimise import outcome
from runtime.experiments.optimisation.optimisers import make_optimiser
from runtime.experiments.optimisation.parameters import Parameter
from runtime.host.live.running import shared_state_of
from tests.runtime.experiments.optimisation.diagrams import profiles
from tests.runtime.runs import Files, descendant, started
from tests.runtime.terminals import Terminal, patient

OVER = ("--over", "profile.peak=4:12", "--over", "profile.timing=0.4:0.6")
COST = ("--cost", "signal:wearer.power")
SHORT = ("--settle", "0.1", "--measure", "0.2", "--optimiser", "random", "--population", "2", "--reference", "0")


STATE = """{"finished": false, "errors": [0.1], "validated": [], "found": {"a": 1.0}, "intervals": {},
"optimiser": {"population": 2, "told": [[1, {"a": 1.0}, 3.0]],
"parameters": [{"name": "a", "low": 0.0, "high": 2.0}]}}"""


class Recording(Files):
    """Files of an optimisation."""

    @property
    def state(self):
        return json.loads(self.one(".optimisation.json").read_text())

    @property
    def events(self):
        [path] = [path for path in self.folder.glob("*.json") if ".optimisation" not in path.name]
        return json.loads(path.read_text())["events"]

    def steps(self):
        return [event["step"] for event in self.events if event["event"] == "optimise"]


def optimiser_of(process):
    """ID of the optimiser process of a run."""
    return patient(lambda: descendant(process.pid, "runtime.experiments.optimisation.process"))


def peaks(shared):
    """Targets of the peak of both legs."""
    return [target for _, target in shared.live_values()[0:6:3]]


@pytest.mark.hazard("H16e")
def test_operator_confirms_skips_pauses_and_stops_while_optimiser_hangs(tmp_path):
    profiles(tmp_path)
    with Terminal() as terminal:
        terminal.run("optimise", "profiles.py", *OVER, *COST, *SHORT, "--generations", "3", cwd=tmp_path)
        terminal.wait_for(r"initial parameters: profile.peak 6 N·m, profile.timing 0.44")
        terminal.wait_for("begin y applies, n skips")  # in the status line
        shared = patient(lambda: shared_state_of(terminal.process.pid))
        terminal.answer(b"y", "proposal 1 of 6: profile.peak 6 N·m to ")
        assert peaks(shared) == [6.0, 6.0]
        terminal.wait_for("1/6 y applies, n skips")
        terminal.answer(b"y", r"evaluation 1 of 6: [0-9.]+ .*W; lowest ")
        assert peaks(shared)[0] == peaks(shared)[1] != 6.0
        accepted = peaks(shared)
        terminal.wait_for("2/6 y applies, n skips")
        terminal.answer(b"n", "2/6 skipped: the accepted parameters are restored")
        terminal.wait_for("proposal 2 of 6: ")
        os.kill(optimiser_of(terminal.process), signal.SIGSTOP)
        terminal.press(b" ")
        assert terminal.end() == 0
        assert "picture: recordings/" in terminal.look()
    files = Recording(tmp_path / "recordings")
    steps = [step for step in files.steps() if step != "ignored"]
    assert steps == ["begin", "proposal", "change", "measurement", "proposal", "skipped", "proposal"]
    [(_, values, cost)] = files.state["optimiser"]["told"]
    [measurement] = [event for event in files.events if event.get("step") == "measurement"]
    assert (measurement["values"], measurement["cost"]) == (values, cost) and values == files.state["accepted"]
    changes = [event for event in files.events if event["event"] == "set" and event["path"].endswith("peak")]
    assert [(event["path"], event["value"]) for event in changes] == [
        ("left/profile.peak", accepted[0]),
        ("right/profile.peak", accepted[0]),
    ]
    last = files.events[-1]
    assert (last["event"], last["by"]) == ("stop", "keys")
    assert files.one(".optimisation.png").stat().st_size > 5000
    assert {path.stat().st_mode & 0o077 for path in files.folder.iterdir()} == {0}  # personal data


@pytest.mark.hazard("H16e")
def test_killed_optimiser_restores_accepted_parameters_and_can_be_resumed(tmp_path):
    profiles(tmp_path)
    words = ("optimise", "profiles.py", *OVER, *COST, *SHORT, "--generations", "1", "--no-confirm", "--measure")
    with started(*words, "60", cwd=tmp_path) as run:
        shared = patient(lambda: shared_state_of(run.pid))
        patient(lambda: peaks(shared)[0] not in (0.0, 6.0))
        os.kill(optimiser_of(run), signal.SIGKILL)
        patient(lambda: peaks(shared) == [6.0, 6.0])  # the initial ones: no cost was measured
        ticks = shared.statistics()["ticks"]
        patient(lambda: shared.statistics()["ticks"] > ticks + 10)
        assert shared.state == "running"
        run.send_signal(signal.SIGINT)
        out, err = run.communicate(timeout=30)
    assert run.returncode == 130 and ".optimisation.json continues" in out
    assert "ended before the run; its last accepted parameters are restored. The run continues" in err
    killed = Recording(tmp_path / "recordings")
    assert "companion" in [event["event"] for event in killed.events] and killed.state["optimiser"]["told"] == []

    path = killed.one(".optimisation.json")
    content = json.loads(path.read_text())
    content["about"]["measure"] = 0.3
    path.write_text(json.dumps(content))
    with started(*words, "0.3", "--record", "resumed", "--resume", path, cwd=tmp_path) as run:
        patient(lambda: json.loads(path.read_text())["finished"])
        run.send_signal(signal.SIGTERM)
        run.communicate(timeout=30)
    optimiser = make_optimiser("random", [Parameter(**each) for each in content["about"]["over"]], 0, 2)
    told = json.loads(path.read_text())["optimiser"]["told"]
    assert [values for _, values, _ in told] == [optimiser.ask(), optimiser.ask()] and run.returncode == 143


@pytest.mark.soak
def test_hidden_optimum_is_found_on_simulated_wearer(tmp_path, command_line):
    profiles(tmp_path, rate=5, time_constant=42.0)
    words = ("profiles.py", "--fast", *OVER, *COST, "--time-constant", 42, "--set", "noise=0.3", "--population", 6)
    code, out, err = command_line("optimise", *words, "--generations", 5, "--validate", 1, "--zero", "*/profile.on=no")
    assert code == 0, err
    state = Recording(tmp_path / "recordings").state
    assert len(state["optimiser"]["told"]) == 30 and state["finished"]
    assert abs(state["found"]["profile.peak"] - 9.0) < 0.8 and abs(state["found"]["profile.timing"] - 0.52) < 0.02
    results = {name: cost for name, (cost, _, _) in state["validated"]}
    assert results == pytest.approx({"found": 300.0, "initial": 420.0, "zero": 380.0}, abs=12.0)
    assert "picture: recordings/" in out and "tickwork:   zero: " in err
    path = Recording(tmp_path / "recordings").one(".optimisation.json")
    code, out, _ = command_line(
        "optimise", *words, "--generations", 5, "--validate", 1, "--zero", "*/profile.on=no", "--resume", path
    )
    assert code == 0 and json.loads(path.read_text())["optimiser"]["told"] == state["optimiser"]["told"]
    said = command_line.refused("optimise", *words, "--settle", 10, "--resume", path)
    assert "it was made with settle 60.0, now 10.0; zero [['*/profile.on', 'no']], now []" in said


@pytest.mark.soak
def test_plan_prints_duration_and_forecast_without_a_run(tmp_path, command_line):
    profiles(tmp_path)
    words = ("optimise", "profiles.py", *OVER, "--plan", "--validate", 2, "--rest-every", 30, "--generations", 2)
    code, out, err = command_line(*words, "--cost", "metabolic.tsv", "--population", 4)
    assert (code, err) == (0, "") and out.splitlines()[0] == (
        "15 measurements of 180 s: 45 min of walking, and 1 rest break of 5 min"
    )
    assert "forecast, for a noise of 2.6 % in each measurement:\n  within 5 % of the lowest cost for " in out
    assert "  2 validation trials of each condition resolve a difference of 5.1 %\n" in out
    code, out, _ = command_line(*words, *COST, "--noise", 30, "--population", 4)
    assert code == 0 and out.endswith("  measure longer, add generations, or vary fewer parameters\n")
    assert not (tmp_path / "recordings").exists()


def test_picture_that_cannot_be_written_does_not_hide_the_state_file(tmp_path):
    path = tmp_path / "a.optimisation.json"
    path.write_text(STATE)
    (tmp_path / "a.optimisation.png").mkdir()
    assert outcome(str(path)) == [f"optimisation: {path}; --resume {path} continues", "no picture: Is a directory"]


def test_measurements_that_are_missing_end_virtual_optimisation(tmp_path, command_line):
    profiles(tmp_path, rate=5)
    words = ("profiles.py", "--fast", *OVER, *COST, *SHORT, "--generations", 1, "--strides", "left/profile.phase")
    code, _, err = command_line("optimise", *words)
    assert code == 2 and "1/2: wearer.power: no complete stride in the measurement; the accepted parameters are" in err
    assert "tickwork: optimisation ended: a confirmation is needed" in err and "the optimisation has no result" in err


REFUSED = {
    ("--over", "profile.peak=4:20"): "--over profile.peak=4:20: the live range of left/profile.peak, for which the "
    "commands are proved, is 0 to 12 N·m. Choose bounds within it, or change Live(...) in the diagram",
    (
        "--over",
        "profile.paek=4:12",
    ): "--over profile.paek: profiles has no live parameter 'profile.paek'; did you mean ",
    ("--over", "profile.on=0:1"): "--over profile.on: left/profile.on is of type bool; only numbers of type float",
    ("--over", "profile.peak=4:12", "--over", "left/profile.peak=4:12"): "--over: two names match left/profile.peak",
    (*OVER, "--largest-step", "peak=1"): "--largest-step peak=1: --over has profile.peak, profile.timing",
    (*OVER, "--largest-step", "profile.peak=x"): "--largest-step profile.peak=x: expected a number above 0",
    (*OVER, "--cost", "signal:wearer.powr"): "--cost signal:wearer.powr: there is no recorded signal 'wearer.powr'",
    (*OVER, "--strides", "left/profile.phase", "--time-constant", "42"): "--strides and --time-constant exclude each",
    (*OVER, "--cost", "metabolic.tsv", "--measure", "5"): "--measure 5: too short to estimate the steady state of a "
    "response with a time constant of 42 s: measure for 42 s or longer",
    (*OVER, "--cost", "metabolic.tsv", "--strides", "left/profile.phase"): "--strides applies to --cost signal:NAME",
    (*OVER, "--cost", "typed"): "--cost typed needs a terminal: standard input is not a terminal",
    (*OVER, "--zero", "*/profile.on=no"): "--zero needs --validate N: it is a condition of the validation trials",
    (*OVER, "--resume", "none.json"): "--resume none.json: No such file or directory",
    (*OVER, "--resume", "profiles.py"): "--resume profiles.py: this is not the state of an optimisation",
    (*OVER, "--fast", "--duration", "5"): "--duration and --fast exclude each other here",
    (*OVER, "--fast", "--cost", "metabolic.tsv"): "--fast needs --cost signal:NAME",
}


@pytest.mark.parametrize("words", REFUSED)
@pytest.mark.hazard("H16a")
def test_optimisation_that_cannot_begin_is_reported(tmp_path, command_line, words):
    profiles(tmp_path)
    cost = () if "--cost" in words else COST
    said = command_line.refused("optimise", "profiles.py", "--no-confirm", *cost, *words)
    assert REFUSED[words] in said, said
    assert not (tmp_path / "recordings").exists()


def test_confirmation_needs_a_terminal(tmp_path, command_line):
    profiles(tmp_path)
    said = command_line.refused("optimise", "profiles.py", *OVER, *COST)
    assert said.startswith("cannot ask for a confirmation of each proposal: standard input is not a terminal. Pass")


def test_cart_that_cannot_be_read_ends_run_before_it_is_armed(tmp_path, command_line):
    profiles(tmp_path)
    (tmp_path / "metabolic.tsv").write_text("time\tVO2 (mL/min)\n")
    said = command_line.refused("optimise", "profiles.py", "--no-confirm", *OVER, "--cost", "metabolic.tsv")
    assert said.startswith("metabolic.tsv, line 1: the header 'time\\tVO2 (mL/min)' has neither a power nor both")
    assert not (tmp_path / "recordings").exists()
