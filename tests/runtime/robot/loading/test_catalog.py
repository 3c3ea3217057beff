"""`blocks` lists what is installed."""

import os
import subprocess
import sys

import pytest

from blocks.actuators.cubemars import models_v3
from blocks.actuators.cubemars.models import MODELS
from blocks.actuators.robstride import models as robstride
from graph.drawing.cards import summary
from runtime.host.console.styles import Console, length
from runtime.host.errors import OK
from runtime.robot.loading.catalog import describe, libraries, listing
from tests.runtime.runs import ROOT, write


@pytest.fixture(scope="module")
def homes():
    return {kind: home for library in libraries() for kind, home in library.homes.items()}


@pytest.fixture(scope="module")
def kinds(homes):
    return {kind.__name__: kind for kind in homes}


def test_every_built_in_block_is_listed_in_one_line_with_its_summary(command_line, kinds):
    code, out, err = command_line("blocks")
    assert (code, err) == (OK, "")
    rows = [line.split(maxsplit=1) for line in out.splitlines() if line.startswith("    ")]
    assert [name for name, _ in rows] == list(kinds) and {
        "CubeMars",
        "Butterworth",
        "TorqueLimiter",
        "CsvRecorder",
    } <= set(kinds)
    assert dict(rows)["TorqueLimiter"] == "Limiter of a torque and its rate of change: |τ| <= limit, |dτ/dt| <= slew."
    assert all(text == summary(kinds[name]) for name, text in rows)
    assert "  limiters  from blocks.limiters" in out and "  actuators  from blocks.actuators" in out


def test_every_block_has_a_docstring_with_a_one_sentence_summary(kinds):
    for name, kind in kinds.items():
        assert 10 < len(summary(kind)) < 200, name


def test_a_list_on_a_terminal_is_cut_at_its_edge():
    lines = listing(libraries(), Console(width=80), described=False)
    assert max(length(line) for line in lines if line.startswith("    ")) <= 80 and any(
        line.endswith("…") for line in lines
    )


def test_a_block_name_prints_docstring_ports_and_parameters(command_line):
    code, out, err = command_line("blocks", "Impedance")
    assert (code, err) == (OK, "")
    lines = out.splitlines()
    assert lines[0] == "Impedance  from blocks.controllers import Impedance" and lines[1].startswith(
        "native; blocks.controllers.joint, line "
    )
    assert "  Virtual spring and damper about an equilibrium: τ = K (θ₀ − θ) − B ω. (Hogan 1985)" in lines
    row = {line.split()[0]: line.split(maxsplit=1)[1] for line in lines if line.startswith("  ")}
    assert row["equilibrium"].split(maxsplit=1) == ["rad", "equilibrium angle θ₀; default 0 rad"]
    assert row["stiffness"].split(maxsplit=1) == ["N·m/rad", "stiffness K; default 30 N·m/rad; 0 to 150; live"]
    assert row["torque"].startswith("N·m")


def test_a_parameter_declares_whether_it_may_change_during_the_run(command_line):
    limit = next(
        line for line in command_line("blocks", "TorqueLimiter")[1].splitlines() if line.startswith("  limit  ")
    )
    frequency = next(
        line for line in command_line("blocks", "Notch")[1].splitlines() if line.startswith("  frequency  ")
    )
    assert limit.endswith("required; at least 0; may be Live") and frequency.endswith("default 50 Hz; above 0")


@pytest.mark.parametrize(
    "name",
    ["TorqueLimiter", "torque_limiter", "torquelimiter", "limiters.TorqueLimiter", "blocks.limiters:TorqueLimiter"],
)
def test_a_name_may_be_written_in_many_ways(command_line, name):
    assert command_line("blocks", name)[1].startswith("TorqueLimiter  from blocks.limiters import TorqueLimiter")


def test_the_name_of_a_topic_lists_its_blocks(command_line, kinds):
    out = command_line("blocks", "limiters")[1]
    assert [line.split()[0] for line in out.splitlines()] == [
        name for name, kind in kinds.items() if kind.__module__ == "blocks.limiters"
    ]


def test_a_block_with_the_name_of_its_topic_is_described(command_line):
    assert "path of the library" in command_line("blocks", "Compiled")[1]


def test_arithmetic_blocks_are_listed_in_their_public_module(command_line):
    assert command_line("blocks", "Sum")[1].startswith("Sum  from blocks.mathematics import Sum\n")
    assert command_line("blocks")[1].count(" Sum ") == 1


def test_a_misspelt_name_gets_a_suggestion(command_line):
    assert command_line.refused("blocks", "TorqueLimter") == (
        "no installed block has the name 'TorqueLimter'; did you mean TorqueLimiter?"
    )
    assert (
        command_line.refused("blocks", "buterworth")
        == "no installed block has the name 'buterworth'; did you mean Butterworth?"
    )
    assert command_line.refused("blocks", "xyzzy") == (
        "no installed block has the name 'xyzzy'; list all blocks: python -m runtime blocks"
    )


def test_every_block_can_be_described_within_a_terminal(homes):
    for kind, home in homes.items():
        for line in describe(kind, home, Console(width=100)):
            assert length(line) <= 100 or line.startswith("   "), line  # code in a docstring stays as it is


def test_ports_that_parameters_make_are_shown_by_an_example(command_line):
    out = command_line("blocks", "Sum")[1]
    assert "inputs  of an example: they depend on the parameters" in out and "  u1" in out and "any, any shape" in out


def test_a_recorder_takes_any_number_of_signals(command_line):
    assert "inputs  any number of signals; without connections, all ports" in command_line("blocks", "CsvRecorder")[1]


def told(value, spec="g"):
    return "-" if value is None else format(value, spec)


def test_listed_actuator_models_equal_the_table(command_line):
    code, out, err = command_line("blocks", "--actuators")
    assert (code, err) == (OK, "")
    rows = {
        words[0]: words[1:] for line in out.splitlines() if len(words := line.split()) == 10 and words[1].endswith(":1")
    }
    wire = ("wire_torque", "wire_velocity", "wire_position", "wire_stiffness", "wire_damping")
    assert rows == {
        name: [
            f"{model.gear:g}:1",
            *(told(getattr(model, value)) for value in ("rated", "peak", *wire)),
            told(model.torque_constant, ".3g"),
        ]
        for name, model in (MODELS | models_v3.MODELS | robstride.MODELS).items()
    }
    assert rows["AK80-8-V3.0"][:3] == ["8:1", "-", "-"] and "CubeMarsServo in servo mode" in out
    assert rows["RS03"] == ["9:1", "20", "60", "60", "20", "12.57", "5000", "100", "1.67"]
    assert rows["AK80-9"] == ["9:1", "9", "18", "18", "50", "12.5", "500", "5", "0.945"]


def test_an_unknown_library_is_reported(command_line):
    error = command_line.refused("blocks", "--from", "tikwork")
    assert error == "no installed library 'tikwork' contains blocks; did you mean 'tickwork'?"


def run(folder, *arguments, site):
    return subprocess.run(
        [sys.executable, "-m", "runtime", "blocks", *arguments],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=120,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(site), str(ROOT)])},
    )


@pytest.mark.soak
def test_a_library_that_cannot_be_imported_is_reported_and_the_others_are_listed(tmp_path):
    write(tmp_path, "import no_such_module\n", "brokenlab.py")
    info = tmp_path / "brokenlab-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: brokenlab\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[tickwork.blocks]\nbrokenlab = brokenlab\n")
    done = run(tmp_path, site=tmp_path)
    assert (
        done.returncode == OK
        and ("brokenlab cannot be imported: ModuleNotFoundError: No module named 'no_such_module'") in done.stdout
    )
    assert "TorqueLimiter" in done.stdout


@pytest.mark.soak
def test_blocks_works_in_a_pipe_that_is_closed_early(tmp_path):
    shell = f'"{sys.executable}" -m runtime blocks | head -1'
    done = subprocess.run(
        ["bash", "-c", shell],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=60,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    assert done.stdout.startswith("tickwork") and done.stderr == ""
