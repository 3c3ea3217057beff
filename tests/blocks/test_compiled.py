"""Compiled controllers: real libraries that the C compiler makes, among them one in the style of Simulink Coder."""

import math
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from blocks.compiled import Compiled
from blocks.sources import Constant, Sine
from cext.kernels.compiled import FAILED, IN_USE, OUTSIDE
from graph import Diagram, Input, Output, compile
from tests.blocks.running import run
from tests.checkout import ROOT, RUN, python
from tests.graph.complaints import refusal
from tests.runtime.robot.guardian.bus import Bus
from tests.runtime.runs import started, write
from tests.soaking import soaked

pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")

PAGE = (ROOT / "docs" / "how_to" / "compiled_controllers.md").read_text()
SPRING = (ROOT / "diagrams" / "examples" / "spring.c").read_text()
PORTS = {"takes": {"angle": "rad", "velocity": "rad/s"}, "gives": {"torque": ("N·m", -40.0, 40.0)}}

# mode 0: the sum of all inputs in both outputs
MODES = """
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include "tickwork.h"
static volatile int nothing;
static int starts;
int tickwork_sizes(int *inputs, int *outputs) { *inputs = 3; *outputs = 3; return TICKWORK_VERSION; }
int tickwork_init(double period) { starts++; return period > 1.0 ? 7 : 0; }
int tickwork_step(const double *in, double *out, double dt) {
    int mode = (int)in[2];
    out[0] = in[0], out[1] = mode == 1 ? NAN : mode == 2 ? INFINITY : mode == 3 ? 1e3 : in[1];
    out[2] = mode == 4 ? 0.5 : starts;
    if (mode == 5) return 3;
    if (mode == 6) nothing = mode / nothing;
    if (mode == 7) *(volatile int *)0 = 1;
    if (mode == 8) for (puts("hanging"), fflush(stdout);;) ;
    if (mode == 9) exit(0);
    return 0;
}
"""

# As Simulink Coder (embedded C, ert.tlc) generates a model with a discrete integrator and a gain.
GENERATED = """
typedef double real_T;
typedef struct { real_T DiscreteTimeIntegrator_DSTATE; } DW_knee_T;
typedef struct { real_T angle; real_T setpoint[2]; } ExtU_knee_T;
typedef struct { real_T torque; real_T error; } ExtY_knee_T;
DW_knee_T knee_DW;
ExtU_knee_T knee_U;
ExtY_knee_T knee_Y;
void knee_step(void) {
    knee_Y.error = (knee_U.setpoint[0] + knee_U.setpoint[1]) - knee_U.angle;
    knee_Y.torque = 12.0 * knee_Y.error + knee_DW.DiscreteTimeIntegrator_DSTATE;
    knee_DW.DiscreteTimeIntegrator_DSTATE += 0.005 * knee_Y.error;
}
void knee_initialize(void) { knee_DW.DiscreteTimeIntegrator_DSTATE = 0.25; }
void knee_terminate(void) { }
"""


def library(folder, source, name="spring", *options, language="c"):
    """The library of a source. Returns its path."""
    path = folder / f"{name}.{language}"
    path.write_text(source)
    include = ["-Wall", "-fPIC", "-shared", f"-I{ROOT / 'cext'}", f"-I{folder}"]
    subprocess.run(["cc", "-O2", *include, *options, "-o", path.with_suffix(".so"), path], check=True)
    return str(path.with_suffix(".so"))


def springs(file, count=1):
    with Diagram("springs", rate=500) as diagram:
        angle = Sine(amplitude=0.7, frequency=2.0, unit="rad", name="angle")()
        velocity = Sine(amplitude=3.0, frequency=7.0, unit="rad/s", name="velocity")()
        for number in range(count):
            Compiled(file, name=f"spring{number}", **PORTS)(angle, velocity=velocity)
    return diagram


def test_a_run_equals_the_same_law_in_python_bit_for_bit_and_each_block_has_its_own_state(tmp_path):
    diagram = springs(library(tmp_path, SPRING), 2)
    first, second = run(diagram, 400), run(diagram, 400)  # of the same blocks: they start again
    filtered, dt = 0.0, 1 / 500
    for k in range(400):
        filtered += dt / (dt + 0.01) * (first["velocity.y"][k] - filtered)
        assert first["spring0.torque"][k] == -20.0 * first["angle.y"][k] - 1.5 * filtered
    assert np.ptp(first["spring0.torque"]) > 20.0
    for name in ("spring0.torque", "spring1.torque"):
        assert np.array_equal(first[name], first["spring0.torque"]) and np.array_equal(first[name], second[name])


def test_the_page_compiles_a_controller_as_simulink_coder_generates_it(tmp_path):
    (tmp_path / "knee.h").write_text(GENERATED)
    shim = re.search(r"```c\n(#include \"knee.h\".*?)```", PAGE, re.S)[1]

    scope = {"Compiled": Compiled, "Input": Input, "Output": Output}
    exec(re.search(r"```python notest\n(class.*?)```", PAGE, re.S)[1], scope)
    with Diagram("knee", rate=200) as diagram:
        scope["Knee"](library(tmp_path, shim, "shim"), name="knee")(Sine(unit="rad", name="angle")(), [0.5, 0.125])
    recording = run(diagram, 200)
    held = 0.25
    for k in range(200):
        error = 0.625 - recording["angle.y"][k]
        assert recording["knee.error"][k] == error and recording["knee.torque"][k] == 12.0 * error + held
        held += 0.005 * error


@pytest.mark.skipif(shutil.which("rustc") is None, reason="no Rust compiler")
def test_the_rust_of_the_page_is_a_controller(tmp_path):
    (tmp_path / "spring.rs").write_text(re.search(r"```rust\n(.*?)```", PAGE, re.S)[1])
    subprocess.run(["rustc", "-O", "--crate-type=cdylib", "-o", "spring.so", "spring.rs"], cwd=tmp_path, check=True)
    block = Compiled(str(tmp_path / "spring.so"), **PORTS)
    block.dt = 0.01
    assert block.step(0.5, 3.0) == -10.0 - 1.5 * 1.5


class Modes(Compiled):
    """Library with mistakes."""

    u = Input("N·m", "two numbers", shape=(2,))
    mode = Input("1", "mistake")
    y = Output("N·m", "two numbers", shape=(2,), range=(-10.0, 10.0))
    starts = Output("1", "number of calls of tickwork_init", dtype=int)


@pytest.fixture
def modes(tmp_path):
    return library(tmp_path, MODES, "modes")


FAULTS = {
    1: (OUTSIDE + 1, "its library computed y[1] = nan N·m, not a finite number from -10 to 10"),
    2: (OUTSIDE + 1, "its library computed y[1] = inf N·m, not a finite number from -10 to 10"),
    3: (OUTSIDE + 1, "its library computed y[1] = 1000 N·m, not a finite number from -10 to 10"),
    4: (OUTSIDE + 2, "its library computed starts = 0.5, not a whole number"),
    5: (FAILED, "tickwork_step returned 3"),
}


@pytest.mark.hazard("H8c")
@pytest.mark.parametrize("mode", FAULTS)
def test_a_result_that_is_not_as_declared_ends_the_run(modes, mode):
    status, text = FAULTS[mode]
    with Diagram("modes", rate=200) as diagram:
        block = Modes(modes, name="modes")
        block([1.0, 2.0], Constant(mode, name="mode")())
    outcome = run(diagram, 10).outcome
    assert outcome.status == f"kernel status {status}" and block.fault_text(status) == text


def test_nan_at_an_input_makes_every_output_nan_and_leaves_the_state(tmp_path):
    block, other = (Compiled(library(tmp_path, SPRING), **PORTS) for _ in range(2))
    block.dt = other.dt = 0.01
    for values in ((0.1, 3.0), (math.nan, 0.0), (0.0, -math.inf), (0.2, 1.0)):
        result = block.step(*values)
        if all(map(math.isfinite, values)):
            assert result == other.step(*values)
        else:
            assert math.isnan(result)


def test_every_run_begins_with_init_once_and_two_programs_at_once_are_a_fault(modes):
    block = Modes(modes)
    block.dt = 0.01
    assert [block.step([0.0, 0.0], 0.0)[1] for _ in range(3)] == [1, 1, 1]
    block.reset()
    assert block.step([0.0, 0.0], 0.0)[1] == 2
    assert block.fault_text(IN_USE) == "two programs use its library at the same time"


REFUSED = {
    "its tickwork_sizes returns version 2: compile it with the present tickwork.h, of version 1": (
        "TICKWORK_VERSION;",
        "2;",
    ),
    "it has no function tickwork_step: define it with C linkage, as in tickwork.h": ("tickwork_step", "tickwork_steps"),
    "spring.so has 3 inputs, and 2 are declared: angle, velocity": ("*inputs = 2", "*inputs = 3"),
    "its tickwork_sizes returns 2 inputs and -1 outputs": ("*outputs = 1", "*outputs = -1"),
    "tickwork_init(0.005) returned 9": ("0.0;\n    return 0", "0.0;\n    return 9"),
    "undefined symbol: unknown": (
        "return 0;\n}\n\nint tickwork_step",
        "extern int unknown(void);\n    return unknown();}\n\nint tickwork_step",
    ),
}


@pytest.mark.parametrize("words", REFUSED)
def test_a_library_that_does_not_fit_is_refused(tmp_path, words):
    before, after = REFUSED[words]
    file = library(tmp_path, SPRING.replace(before, after, 1))
    with Diagram("refused", rate=200) as diagram:
        assert words in str(refusal(lambda: (Compiled(file, **PORTS)(0.0, velocity=0.0), compile(diagram))))


def test_a_file_that_is_no_library_and_other_ports_are_refused(tmp_path):
    (tmp_path / "text.so").write_text("no library")
    assert "text.so: it is not a shared library: compile one with `gcc -shared -fPIC`" in str(
        refusal(Compiled, str(tmp_path / "text.so"), **PORTS)
    )
    whole = Path(library(tmp_path, SPRING, "cut")).read_bytes()
    for length in (100, len(whole) // 3):  # of a copy or a compilation that has not ended: dlopen raises SIGBUS
        (tmp_path / "cut.so").write_bytes(whole[:length])
        assert "cut.so: its end is missing: compile or copy it again" in str(
            refusal(Compiled, str(tmp_path / "cut.so"), **PORTS)
        )
    assert "there is no none.so" in str(refusal(Compiled, "none.so", **PORTS))
    file = library(tmp_path, SPRING)
    assert "'file' cannot be the name of a port" in str(refusal(Compiled, file, takes={"file": "1"}))
    assert "'library' cannot be the name of a port" in str(refusal(Compiled, file, takes={"library": "1"}))
    for stated in (("N·m", 1.0), ("N·m", "-1", "1"), (), 12.0):
        words = "torque must be a unit, or (unit, lowest, highest value)"
        assert words in str(refusal(Compiled, file, gives={"torque": stated}))


def test_fast_mathematics_of_a_library_does_not_change_the_results_of_others(tmp_path):
    code = f"""
import ctypes
from blocks.compiled import Compiled
half = float("0.5")
block = Compiled({library(tmp_path, SPRING, "spring", "-ffast-math")!r}, **{PORTS!r})
print(1e-310 * half > 0.0)
ctypes.CDLL(block.file)
print(1e-310 * half > 0.0)
"""
    process = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    kept, flushed = process.stdout.split()
    assert kept == "True"
    if flushed == "True":
        pytest.skip("this compiler's -ffast-math leaves denormals as they are")


ROBOT = re.search(r"```python notest\n(from blocks.actuators.*?)```", PAGE, re.S)[1]


def test_a_range_proves_the_command_and_a_replay_has_the_same_bits(tmp_path):
    assert SPRING.split("\n\n", 1)[1] in PAGE
    library(tmp_path, SPRING)
    robot = write(tmp_path, ROBOT)
    made = python(*RUN, robot, "--fast", "--duration", "2", "--record", "out", cwd=tmp_path)
    assert made.returncode == 0, made.stderr
    [file] = (tmp_path / "out").glob("*.mcap")
    assert "sent frames are the same, bit for bit" in python(*RUN, "replay", file, cwd=tmp_path).stdout
    library(tmp_path, SPRING.replace("20.0", "21.0"))  # another controller of the same name
    assert python(*RUN, "replay", file, cwd=tmp_path).returncode != 0


@pytest.mark.paced
@pytest.mark.hazard("H8c")
@pytest.mark.parametrize("mode", soaked([6, 7, 8, 9], but=[0, 2, 3]))
def test_the_motors_stop_and_the_report_names_the_block_if_its_library_crashes_hangs_or_exits(tmp_path, modes, mode):
    takes, gives = {"a": "N·m", "b": "N·m", "mode": "1"}, {"x": "N·m", "y": "N·m", "starts": "1"}
    more = f"""with subsystem("model"):
            late = Switch()(law.late, {mode}.0, 0.0)
            Compiled({modes!r}, takes={takes!r}, gives={gives!r}, name="controller")(a=law.torque, b=0.0, mode=late)"""
    blocks = "from blocks.compiled import Compiled\nfrom blocks.logic import Switch"
    with Bus(tmp_path) as bus:
        process = bus.start("--no-record", "--priority", "10", blocks=blocks, more=more)
        bus.await_torque()
        stopped = bus.listen(5.0, lambda frame: frame.data == "FF" * 7 + "FD")
        assert stopped is not None, process.communicate(timeout=10)
        bus.listen(0.3)
        bus.stopped_after(0.0)
        if mode == 8:
            process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=10)
    if mode == 8:
        assert "tickwork guardian: model/controller hangs: " in err and process.returncode == 3
    elif mode == 9:
        assert "tickwork: a library called exit() in model/controller\n" in err and process.returncode == 3
    else:
        number = signal.SIGFPE if mode == 6 else signal.SIGSEGV
        assert f"the control process died of {number.name} in model/controller after tick " in err
        assert process.returncode == -number
    assert "zero torque, then disable: confirmed by left/knee, right/knee" in err


SIMULATED = """
from blocks.compiled import Compiled
from graph import Diagram

with Diagram("simulated", rate=200) as diagram:
    ports = dict(takes=dict(a="1", b="1", mode="1"), gives=dict(x="1", y="1", n="1"))
    Compiled({file!r}, name="law", **ports)(0.0, 0.0, {mode}.0)
"""


def test_a_library_that_exits_ends_a_simulation_as_a_fault_that_names_its_block(tmp_path, modes):
    robot = write(tmp_path, SIMULATED.format(mode=9, file=modes))
    made = python(*RUN, robot, "--fast", "--duration", "1", cwd=tmp_path)
    assert made.returncode == 3 and made.stderr.endswith("tickwork: a library called exit() in law\n")


@pytest.mark.paced
def test_a_second_ctrl_c_ends_a_simulation_whose_library_hangs(tmp_path, modes):
    robot = write(tmp_path, SIMULATED.format(mode=8, file=modes))
    with started(robot, "--fast", "--duration", "1", cwd=tmp_path) as process:
        assert process.stdout.readline() == "hanging\n"
        for _ in range(2):  # at once: the run has had no time to respond
            process.send_signal(signal.SIGINT)
        with pytest.raises(subprocess.TimeoutExpired):
            process.wait(1.1)
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=5)
    assert process.returncode == 3
    assert err.endswith("tickwork: the process was ended by a second signal: the run hangs in law\n")
