"""Co-simulation FMUs: real ones, which the C compiler makes, compared with FMPy's own simulation of them."""

import gc
import math
import re
import shutil
import signal
import tempfile
import zipfile
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from blocks._plumbing import fmu_archive
from blocks.fmu import Fmu
from blocks.sources import Constant, Sine
from graph import Diagram, Interval, compile, stack
from tests.blocks import fmus
from tests.blocks.fmus import FMI1, FMI2, FMI3, fmpy
from tests.blocks.running import run
from tests.checkout import ROOT, RUN, python
from tests.graph.complaints import refusal
from tests.runtime.robot.guardian.bus import Bus
from tests.runtime.runs import write
from tests.soaking import soaked

pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")

NUMBERS = {"torque": "N·m", "error": "rad"}  # the outputs that can be NaN


@pytest.fixture(scope="module")
def spring(tmp_path_factory):
    return fmus.make(tmp_path_factory.mktemp("fmi2"))


@pytest.fixture(scope="module")
def vectors(tmp_path_factory):
    return fmus.make(tmp_path_factory.mktemp("fmi3"), FMI3)


def moved(rate=200):
    """A diagram with the motion of a knee. Returns it, and the signals of angle and velocity."""
    with Diagram("springs", rate=rate) as diagram:
        angle = Sine(amplitude=0.7, frequency=2.0, unit="rad", name="angle")()
        return diagram, angle, Sine(amplitude=3.0, frequency=7.0, unit="rad/s", name="velocity")()


def test_ports_have_the_names_units_ranges_and_feedthrough_of_the_file(spring, vectors):
    block = Fmu(spring, gives={"torque": ("N*m", -100.0, 30.0), "negative": "1"}, start={"velocity": 1.5})
    assert {name: (port.unit, port.dtype, port.default) for name, port in block.inputs.items()} == {
        "knee_angle": ("rad", "float", 0.0),
        "velocity": ("rad/s", "float", 1.5),
        "mode": ("1", "int", 0.0),
    }
    assert block.inputs["knee_angle"].description == "angle of the knee" and block.step_inputs() == []
    assert [(port.unit, port.dtype, port.range) for port in block.outputs.values()] == [
        ("N·m", "float", Interval(-40.0, 30.0)),
        ("1", "bool", None),
    ]
    assert list(Fmu(spring).outputs) == ["torque", "error", "negative", "instances"]
    assert Fmu(spring).step_inputs() == ["knee_angle"] and Fmu(spring, delayed=True).step_inputs() == []
    assert list(Fmu(spring, takes={"velocity": "rad/s"}).inputs) == ["velocity"]
    block = Fmu(vectors, start={"motion": [0.1, 0.2]}, step_time=0.01)
    assert block.inputs["motion"].default == [0.1, 0.2] and block.allowance == 0.01
    assert block.inputs["motion"].shape == block.outputs["results"].shape == (2,)


def test_a_run_equals_the_simulation_of_fmpy_and_each_block_and_run_has_its_own_state(spring, vectors):
    diagram, angle, velocity = moved()
    with diagram:
        for name, stiffness in (("soft", 5.0), ("first", 20.0), ("second", 20.0)):
            Fmu(spring, start={"stiffness": stiffness}, name=name)(angle, velocity)
        Fmu(spring, delayed=True, name="delayed")(angle, velocity)
        Fmu(vectors, name="vectors")(stack(*(Sine(*each)() for each in ((0.7, 2.0), (3.0, 7.0)))))
    first, second = run(diagram, 200), run(diagram, 200)
    times = np.arange(200) / 200
    rows = list(zip(times, first["angle.y"], first["velocity.y"]))
    signals = np.array(rows, dtype=[(name, float) for name in ("time", "knee.angle", "velocity")])
    for name, stiffness in (("soft", 5.0), ("first", 20.0), ("second", 20.0)):
        expected = fmpy.simulate_fmu(
            spring,
            stop_time=1.0,
            output_interval=1 / 200,
            start_values={"stiffness": stiffness},
            input=signals,
            output=["torque", "error"],
        )
        assert np.ptp(expected["torque"]) > 5.0
        np.testing.assert_allclose(first[f"{name}.torque"], expected["torque"][:200], rtol=0.0, atol=1e-12)
        assert np.array_equal(first[f"{name}.error"], 0.25 - first["angle.y"])  # of the same tick
        assert np.array_equal(first[f"{name}.torque"], second[f"{name}.torque"])
        assert np.all(first[f"{name}.instances"] == 1)
        assert np.array_equal(first[f"{name}.negative"][1:], first[f"{name}.torque"][1:] < 0.0)
    assert np.array_equal(first["vectors.results[0]"], first["first.torque"])
    assert np.array_equal(first["delayed.torque"], first["first.torque"])
    np.testing.assert_allclose(first["delayed.error"], expected["error"][:200], rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("name", ["self", "dt", "step"])
def test_a_variable_may_have_the_name_of_an_argument_or_a_method(spring, tmp_path, name):
    file = fmus.repack(spring, tmp_path / "named.fmu", FMI2.replace('name="velocity"', f'name="{name}"'))
    with Diagram("named", rate=200) as diagram:
        Fmu(file, name="fmu")(**{f"{name}_port": Sine(unit="rad/s", name="velocity")()})
    recording = run(diagram, 20)
    assert recording.outcome.status == "ok" and np.ptp(recording["fmu.torque"]) > 0.0


FAULTS = {
    2: r"modes\.torque is inf, outside its declared range \[-40, 40\]",
    3: r"fmi2DoStep returned error: no solution at 0\.01 s",
}


@pytest.mark.hazard("H8c")
@pytest.mark.parametrize("mode", FAULTS)
def test_a_result_outside_its_range_and_a_status_of_error_end_the_run(spring, mode):
    with Diagram("modes", rate=200) as diagram:
        Fmu(spring, name="modes")(mode=Constant(mode, name="mode")())
    outcome = run(diagram, 10).outcome
    assert (outcome.status, outcome.culprit) == ("exception", "modes")
    assert re.search(FAULTS[mode].replace("0\\.01", "0"), str(outcome.error))


def test_a_status_of_fmi_3_ends_the_run(vectors):
    for mode, words in ((3, "fmi3DoStep returned error: no solution"), (4, "the FMU ended its simulation at 0 s")):
        with Diagram("modes", rate=200) as diagram:
            Fmu(vectors, name="modes")(mode=Constant(mode, name="mode")())
        assert words in str(run(diagram, 10).outcome.error)


def test_an_fmu_that_has_failed_is_not_called_before_a_reset(spring):
    block = Fmu(spring)
    for mode, words in ((3, "fmi2DoStep returned error: no solution"), (0, "the FMU has failed before: no solution")):
        with pytest.raises(RuntimeError, match=words):
            block.update(0.005, 0.0, 0.0, mode)
    block.reset()
    block.update(0.005, 0.1, 0.0, 0)
    assert block.step(0.0)[0] == -2.0


def test_nan_passes_and_nan_infinity_and_numbers_beyond_a_type_do_not_reach_the_fmu(spring):
    block, other = Fmu(spring, gives=NUMBERS), Fmu(spring, gives=NUMBERS)
    outputs = []
    for angle, velocity, mode in (
        (0.1, 3.0, 0),
        (math.nan, 0.0, 0),
        (0.0, -math.inf, 0),
        (0.0, 0.0, 2**40),
        (0.2, 1.0, 0),
        (0.3, 0.0, 1),
        (0.4, 0.0, 0),
    ):
        outputs.append(block.step(angle))
        block.update(0.005, angle, velocity, mode)
    for angle, velocity in ((0.1, 3.0), (0.2, 1.0)):
        other.update(0.005, angle, velocity, 0)
    lost = [math.nan, math.nan]
    kept = other.step(0.3)
    np.testing.assert_array_equal(outputs, [[0.0, 0.15], lost, lost, lost, lost, kept, [math.nan, 0.25 - 0.4]])
    with pytest.raises(ArithmeticError, match="beyond its type, and negative, instances cannot be NaN"):
        Fmu(spring).step(math.nan)


COUPLING = '<CoSimulation modelIdentifier="spring" canHandleVariableCommunicationStepSize="true"/>'
REFUSED = {
    "it is of FMI 1: export it as a co-simulation FMU of FMI 2 or 3": (FMI2, FMI1),
    "it is not for co-simulation": (COUPLING, '<ModelExchange modelIdentifier="spring"/>'),
    "it is not an FMU that can be read: Failed to validate modelDescription.xml": ("<Real", "<Reel"),
    "torque has the unit 'bar', which Tickwork does not have": ('N.m"', 'bar"'),
    "torque has the unit 'C', which Tickwork does not have": ('N.m"', 'C"'),
    "torque has the unit 'N.m', which Tickwork does not have": ('m="2" s="-2"/', 'm="2" s="-2" factor="1000"/'),
    "it has no library for this computer, ": ('modelIdentifier="spring"', 'modelIdentifier="other"'),
    "it cannot be started: Failed to instantiate model": ('guid="a1"', 'guid="b1"'),
}


@pytest.mark.parametrize("words", REFUSED)
def test_an_fmu_that_cannot_be_used_is_refused(tmp_path, spring, words):
    description = FMI2.replace(*REFUSED[words])
    file = fmus.repack(spring, tmp_path / "other.fmu", description)
    assert words in str(refusal(Fmu, file)) and description != FMI2


MISTAKES = {
    "takes: it has no variable 'knee.angel'. did you mean 'knee.angle'?": {"takes": {"knee.angel": "rad"}},
    "takes: torque is a continuous output of the type Real, and cannot be an input": {"takes": {"torque": "N·m"}},
    "gives: text is a discrete output of the type String, and cannot be an output": {"gives": {"text": "1"}},
    "gives: torque must be a unit, or (unit, lowest, highest value), got 3": {"gives": {"torque": 3}},
    "torque has the unit N·m in the FMU, and N is stated": {"gives": {"torque": "N"}},
    "start: it has no variable 'stiffnes'. did you mean 'stiffness'?": {"start": {"stiffnes": 1.0}},
    "start: stiffness must be from 0 to 100, got 200": {"start": {"stiffness": 200}},
    "start: stiffness must be a number, got 'soft'": {"start": {"stiffness": "soft"}},
    "start: torque cannot be set, it is a continuous output": {"start": {"torque": 1.0}},
    "knee.angle has the unit rad in the FMU, and deg is stated": {"takes": {"knee.angle": "deg"}},
    "start: mode must be from -2.14748e+09 to 2.14748e+09, got 4294967296": {"start": {"mode": 2**32}},
}


def padded(file, other, name, size, entries=1):
    """The same FMU with zeros in `entries` files of a name. Returns its path."""
    with zipfile.ZipFile(file) as source, zipfile.ZipFile(other, "w", zipfile.ZIP_DEFLATED) as archive:
        for each in source.namelist():
            if each != name:
                archive.writestr(each, source.read(each))
        for number in range(entries):
            archive.writestr(name.format(number), bytes(size))
    return str(other)


def test_an_fmu_that_unpacks_to_too_much_is_refused_before_it_is_unpacked(tmp_path, spring, monkeypatch):
    folder, large = tmp_path / "unpacked", tmp_path / "large.fmu"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    monkeypatch.setattr(fmpy, "extract", lambda *words: pytest.fail("it was unpacked"))
    monkeypatch.setattr(fmu_archive, "SIZE_LIMIT", 2 << 20)
    monkeypatch.setattr(fmu_archive, "DESCRIPTION_LIMIT", 1 << 20)
    text = str(refusal(Fmu, padded(spring, large, "resources/map.bin", 5 << 20)))
    assert "large.fmu: it unpacks to 5 MiB, above the limit of 2 MiB: export it without the files" in text
    assert "the largest is resources/map.bin of 5 MiB" in text
    text = str(refusal(Fmu, padded(spring, large, "modelDescription.xml", 2 << 20)))
    assert "modelDescription.xml unpacks to 2 MiB, above the limit of 1 MiB: export the FMU with fewer var" in text
    text = str(refusal(Fmu, padded(spring, large, "resources/{}", 0, 10_001)))
    assert "it has 10003 files, above the limit of 10000" in text
    monkeypatch.setattr(shutil, "disk_usage", lambda place: SimpleNamespace(free=1 << 20))
    text = str(refusal(Fmu, padded(spring, large, "resources/map.bin", (2 << 20) - 100_000)))
    assert f"it unpacks to 2 MiB, and {folder} has 1 MiB left: free space there, or set" in text
    gc.collect()
    assert list(folder.iterdir()) == []


def test_a_file_larger_than_its_size_in_the_archive_is_not_unpacked_beyond_it(tmp_path, spring, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    file = Path(padded(spring, tmp_path / "forged.fmu", "resources/map.bin", 5 << 20))
    file.write_bytes(file.read_bytes().replace((5 << 20).to_bytes(4, "little"), (1 << 20).to_bytes(4, "little")))
    written = []
    monkeypatch.setattr(zipfile.ZipFile, "_extract_member", noting(written, zipfile.ZipFile._extract_member))
    assert "it is not an FMU that can be read: Bad CRC-32 for file 'resources/map.bin'" in str(refusal(Fmu, str(file)))
    assert 0 < max(written) <= 1 << 20


def noting(sizes, extract):
    """`extract` that notes the size of resources/map.bin, also if it fails."""

    def noted(self, member, target, password):
        try:
            return extract(self, member, target, password)
        finally:
            path = Path(target, "resources/map.bin")
            sizes.append(path.stat().st_size if path.exists() else 0)

    return noted


def test_a_large_array_of_an_fmu_is_no_port(tmp_path, vectors):
    large = FMI3.replace('unit="rad"><Dimension start="2"', 'unit="rad"><Dimension start="300000000"')
    file = fmus.repack(vectors, tmp_path / "large.fmu", large)
    text = str(refusal(Fmu, file))
    assert "results is an array of the shape (300000000,), and a port has at most 10000 elements" in text
    assert "list other outputs in gives" in text


@pytest.mark.parametrize("words", MISTAKES)
def test_a_mistake_in_a_parameter_is_refused(spring, words):
    assert words in str(refusal(lambda: Fmu(spring, **MISTAKES[words])))


def test_other_files_computers_and_steps_are_refused_and_a_fixed_step_stays(tmp_path, spring, vectors):
    (tmp_path / "text.fmu").write_text("no FMU")
    assert "it is not an FMU that can be read: File is not a zip file" in str(refusal(Fmu, str(tmp_path / "text.fmu")))
    assert "there is no none.fmu" in str(refusal(Fmu, "none.fmu"))
    with zipfile.ZipFile(tmp_path / "windows.fmu", "w") as archive:
        archive.writestr("modelDescription.xml", FMI3)
        archive.writestr("binaries/x86_64-windows/spring.dll", "-")
    words = f"no library for this computer, {fmpy.platform_tuple}/spring.so, but x86_64-windows/spring.dll: export it"
    assert words in str(refusal(Fmu, str(tmp_path / "windows.fmu")))
    fixed = FMI3.replace('canHandleVariableCommunicationStepSize="true"', 'fixedInternalStepSize="0.002"')
    file = fmus.repack(vectors, tmp_path / "fixed.fmu", fixed)
    with Diagram("fixed", rate=200):
        assert "fixed.fmu, 0.002 s, does not divide the tick of the block, 0.005 s" in str(refusal(Fmu, file))
    with Diagram("steps", rate=250):
        for block, time in ((Fmu(file), 0.004), (Fmu(vectors), 0.008)):
            block.update(0.008, np.zeros(2), 0)  # after a tick that was skipped
            assert block.slave.time == time


def test_fast_mathematics_of_an_fmu_does_not_change_the_results_of_others(tmp_path):
    file = fmus.make(tmp_path, FMI2, "fast", "-ffast-math")
    code = f"""
import ctypes
from blocks.fmu import Fmu
half = float("0.5")
block = Fmu({file!r})
print(1e-310 * half > 0.0)
ctypes.CDLL({str(tmp_path / "fast.so")!r})
print(1e-310 * half > 0.0)
"""
    kept, flushed = python("-c", code, cwd=ROOT).stdout.split()
    assert kept == "True"
    if flushed == "True":
        pytest.skip("this compiler's -ffast-math leaves denormals as they are")


PAGE = (ROOT / "docs" / "how_to" / "fmus.md").read_text()
ROBOT = PAGE.split("```python notest\n")[1].split("```")[0]


def test_a_range_proves_the_command_and_a_replay_has_the_same_bits(tmp_path, spring):
    shutil.copy(spring, tmp_path)
    robot = write(tmp_path, ROBOT)
    made = python(*RUN, robot, "--fast", "--duration", "2", "--record", "out", cwd=tmp_path)
    assert made.returncode == 0, made.stderr
    [file] = (tmp_path / "out").glob("*.mcap")
    assert "sent frames are the same, bit for bit" in python(*RUN, "replay", file, cwd=tmp_path).stdout
    fmus.make(tmp_path, source=fmus.SOURCE.replace("20.0", "21.0"))  # another controller of the same name
    assert python(*RUN, "replay", file, cwd=tmp_path).returncode != 0
    scope = {}
    exec(ROBOT.replace("spring.fmu", spring).replace("-12.0, 12.0", "-100.0, 100.0"), scope)
    assert "[-40, 40]" in str(refusal(compile, scope["build"]()))


@pytest.mark.paced
@pytest.mark.hazard("H8c")
@pytest.mark.parametrize("mode", soaked([7, 8, 9], but=[0]))
def test_the_motors_stop_and_the_report_names_the_block_if_its_fmu_crashes_hangs_or_exits(tmp_path, spring, mode):
    more = f"""with subsystem("model"):
            late = Switch()(law.late, {mode}.0, 0.0)
            Fmu({spring!r}, name="controller")(mode=Round()(late))"""
    blocks = "from blocks.fmu import Fmu\nfrom blocks.logic import Switch\nfrom blocks.mathematics import Round"
    with Bus(tmp_path) as bus:
        process = bus.start("--no-record", "--priority", "10", blocks=blocks, more=more)
        bus.await_torque()
        assert bus.listen(5.0, lambda frame: frame.data == "FF" * 7 + "FD"), process.communicate(timeout=10)
        bus.listen(0.3)
        bus.stopped_after(0.0)
        if mode == 8:
            process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=10)
    if mode == 8:
        assert "model/controller hangs: " in err and process.returncode == 3
    elif mode == 9:
        assert "tickwork: a library called exit() in model/controller\n" in err and process.returncode == 3
    else:
        assert "the control process died of SIGSEGV in model/controller after tick " in err
        assert process.returncode == -signal.SIGSEGV
    assert "zero torque, then disable: confirmed by left/knee, right/knee" in err
