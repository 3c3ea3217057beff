"""Fused schedules compute the same bits as calls of their kernels, name the failed step, and fall back to calls."""

import shutil
import subprocess
import sys

import numpy as np
import pytest

from blocks.mathematics import Gain
from blocks.sources import Sine
from blocks.tables import LookupTable1D
from cext.fused import library
from cext.fused.__main__ import kernels
from cext.fused.compile import HEADER
from cext.fused.sources import hash_of
from cext.fused.text import text_of
from cext.schedule.executor import Executor
from cext.schedule.program import Program
from graph import Block, Diagram, Input, Output, compile
from tests.peers import netlists
from tests.peers.tickwork import Tap, diagram_of, native_block

RATE = 1000.0
UNFUSED = {"walker.pyx"}  # on x86-64 its stencils would need absolute addresses of constants
TICKS = (1, 2, 3, 257, 2000)


@pytest.fixture
def fused(monkeypatch):
    """Programs are fused, if this processor has a library."""
    path = library.FOLDER / f"{library.platform.machine()}.stencils"
    if not path.is_file():
        pytest.skip("no stencils for this processor")
    stencils = library.read(path)
    variants = library.variants
    monkeypatch.setattr(library, "library", lambda: stencils)
    variants.cache_clear()
    yield stencils
    variants.cache_clear()


def both(schedule, monkeypatch):
    """Return (program, executor) of a schedule twice: fused, and with calls."""
    one = Program(schedule)
    with monkeypatch.context() as patch:
        patch.setattr(library, "library", lambda: None)
        other = Program(schedule)
    assert other.fused == 0
    return (one, Executor(one, RATE)), (other, Executor(other, RATE))


@pytest.mark.parametrize("name", ["knee", "wide", "wide6"])
def test_machine_code_computes_the_bits_of_the_kernels(fused, monkeypatch, name):
    schedule = compile(diagram_of(getattr(netlists, name)(), native_block))
    (one, first), (other, second) = both(schedule, monkeypatch)
    assert one.fused >= 0.95 * (len(schedule.output) + len(schedule.update))
    for ticks in TICKS:
        first.spin(ticks)
        second.spin(ticks)
        assert np.array_equal(one.values.view(np.int64), other.values.view(np.int64)), ticks


class Twice(Block):
    """A block in Python between native ones."""

    u, y = Input("any"), Output("any")

    def step(self, u):
        return 2.0 * u


def chain():
    with Diagram("chain", RATE) as diagram:
        signal = Sine(amplitude=2.0, frequency=3.0)()
        for index in range(3):
            signal = Gain(1.5, name=f"gain_{index}")(signal)
        signal = LookupTable1D((-5.0, 5.0), (-1.0, 1.0), beyond="error", name="table")(Twice()(signal))
        Tap(name="end")(Gain(2.0, name="after")(signal))
    return compile(diagram)


def test_the_failed_step_is_named_in_the_middle_of_a_run(fused, monkeypatch):
    results = []
    for program, executor in both(chain(), monkeypatch):
        with pytest.raises(Exception) as caught:
            executor.spin(1000)
        results.append((str(caught.value), program.culprit))
    assert results[0] == results[1] and results[0][1] == "table"


def test_kernels_without_a_stencil_are_called(fused, monkeypatch):
    real = library.variants
    monkeypatch.setattr(library, "variants", lambda key: () if "gain_kernel" in key else real(key))
    schedule = compile(diagram_of(netlists.knee(), native_block))
    (one, first), (other, second) = both(schedule, monkeypatch)
    assert 0 < one.fused < len(schedule.output) + len(schedule.update)
    first.spin(500)
    second.spin(500)
    assert np.array_equal(one.values.view(np.int64), other.values.view(np.int64))


def test_programs_run_without_executable_memory():
    script = (
        "import ctypes, sys\n"
        "if ctypes.CDLL(None).prctl(65, 1, 0, 0, 0) != 0:\n    sys.exit(77)\n"  # PR_SET_MDWE
        "from blocks.sources import Constant\nfrom graph import Diagram, compile\n"
        "from cext.schedule.program import Program\n"
        "with Diagram('d', 100.0) as diagram:\n    Constant(1.0)()\n"
        "program = Program(compile(diagram))\nassert program.fused == 0\n"
    )
    done = subprocess.run([sys.executable, "-c", script], env={"TICKWORK_FUSED": "1"}, capture_output=True, text=True)
    if done.returncode == 77:
        pytest.skip("this kernel has no PR_SET_MDWE")
    assert done.returncode == 0, done.stderr


def test_the_text_of_every_kernel_can_be_taken():
    taken = [text_of(path.with_suffix(".c"), key.split()[1]) for path, key, _ in kernels()]
    assert len(taken) > 140 and all("Py" not in text for text in taken)


def test_the_stencils_are_of_the_present_sources(fused):
    stale = sorted({path.name for path, key, _ in kernels() if key.split()[0] != hash_of(path)})
    assert stale == [], "built from other sources: run make build"
    hashes = {key.split()[0] for key in fused.kernels}
    missing = sorted({path.name for path, key, _ in kernels() if key.split()[0] not in hashes})
    assert set(missing) <= UNFUSED, "run make stencils"


@pytest.mark.soak
@pytest.mark.skipif(shutil.which("gcc") is None, reason="no C compiler")
def test_the_text_of_every_kernel_is_plain_c(tmp_path):
    for path, key, _ in kernels():
        source = tmp_path / "kernel.c"
        source.write_text(HEADER + text_of(path.with_suffix(".c"), key.split()[1]))
        subprocess.run(["gcc", "-fsyntax-only", "-Werror=implicit-function-declaration", source], check=True)
