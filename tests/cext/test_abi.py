"""Kernels from outside: ctypes function pointers, capsules by their C signature, cfuncs by their address; and what is
refused.
"""

import ctypes
import re
import shutil
import subprocess
from pathlib import Path
from sysconfig import get_path

import numpy as np
import pytest

from blocks.recorders import CsvRecorder
from blocks.sources import Sine
from cext.kernels import mathematics
from cext.kernels.devices.cubemars import mit
from cext.schedule.executor import Executor
from cext.schedule.kernel_table import address, call_kernel
from cext.schedule.program import Program
from graph import Block, Diagram, Input, Kernel, Memory, Output, Param, compile
from graph.arena_layout import KernelTable
from tests.cext.rigs import Rig
from tests.soaking import soaked

KERNEL = ctypes.CFUNCTYPE(
    ctypes.c_int, ctypes.POINTER(ctypes.c_double), ctypes.POINTER(ctypes.c_int32), ctypes.POINTER(ctypes.c_int32)
)
ITEMS = "u[...] y[...] leak held[...]"
CEXT = Path(__file__).resolve().parents[2] / "cext"
SIGNATURE = b"int (double *, int32_t const *, int32_t const *)"
OTHER_SIGNATURE = b"double (double)"  # a capsule keeps the address of its name, not the name

new_capsule = ctypes.pythonapi.PyCapsule_New
new_capsule.restype, new_capsule.argtypes = ctypes.py_object, (ctypes.c_void_p, ctypes.c_char_p, ctypes.c_void_p)


@KERNEL
def leaky(arena, slots, sizes):
    """y = held = held + leak (u - held), of the items u, y, leak, held."""
    for i in range(sizes[1]):
        held = arena[slots[3] + i]
        arena[slots[3] + i] = arena[slots[1] + i] = held + arena[slots[2]] * (arena[slots[0] + i] - held)
    return 0


@KERNEL
def refuses(arena, slots, sizes):
    """A status of its own at the tenth tick."""
    return 77 if arena[1] == 10.0 else 0


class Leaky(Block):
    """Someone else's low-pass."""

    leak = Param(0.25, "1", "share of the difference")

    u = Input("any", "input", shape=...)
    y = Output("any", "filtered", shape=...)
    held = Memory(0.0, "output of the tick before")

    kernel = Kernel(leaky, ITEMS)

    def prepare(self, dt):
        self.held = [0.0] * self.width


def run(diagram, ticks):
    rig = Rig(diagram)
    return rig.run(ticks), rig


def expected(values, leak=0.25):
    held, out = 0.0, []
    for value in values:
        held = held + leak * (value - held)
        out.append(held)
    return out


@pytest.mark.parametrize(
    "kernel", [leaky, new_capsule(ctypes.cast(leaky, ctypes.c_void_p), SIGNATURE, None)], ids=["ctypes", "capsule"]
)
def test_an_external_kernel_runs_in_a_diagram(kernel):
    class Foreign(Leaky):
        """The same, by each way of handing it over."""

    Foreign.kernel = Kernel(kernel, ITEMS)
    with Diagram("d", rate=100) as diagram:
        Foreign(name="f")(Sine(frequency=3.0, name="s").y)
    outcome, rig = run(diagram, 50)
    assert outcome.status == "ok" and rig["f.y"].tolist() == expected(rig["s.y"].tolist())


def test_an_external_kernel_runs_in_a_single_step():
    leak = Leaky(0.5)
    assert [leak.step(1.0) for _ in range(3)] == [0.5, 0.75, 0.875]
    leak.reset()
    assert leak.step([1.0, 2.0]).tolist() == [0.5, 1.0]


@KERNEL
def total(arena, slots, sizes):
    """y = gain times the sum of all inputs, of the items y, *inputs, gain: a number and an index in the table."""
    first = slots[2]
    arena[slots[0]] = arena[slots[3]] * sum(arena[slots[first + k]] * sizes[first + k] for k in range(slots[1]))
    return 0


def test_an_external_kernel_accepts_any_number_of_inputs():
    class Total(Block):
        """The weighted sum of the elements that stand first."""

        gain = Param(2.0, "1", "factor")
        a = Input("any", "scalar")
        b = Input("any", "vector", shape=(3,))
        y = Output("any", "sum")
        kernel = Kernel(total, "y *inputs gain")

    assert Total().step(1.0, [10.0, 0.0, 0.0]) == 2.0 * (1.0 + 3 * 10.0)


def test_cfunc_is_identified_by_address():
    class Cfunc:
        address = ctypes.cast(leaky, ctypes.c_void_p).value

    assert address(Cfunc()) == address(leaky) == Cfunc.address


def test_custom_status_is_a_fault_that_names_the_block():
    class Refuses(Leaky):
        """Refuses to go on."""

        kernel = Kernel(refuses, "")

    with Diagram("d", rate=100) as diagram:
        Refuses(name="stubborn")(1.0)
    outcome, rig = run(diagram, 50)
    assert (outcome.status, outcome.culprit, outcome.tick) == ("kernel status 77", "stubborn", 10) and rig.tick[-1] == 9
    with pytest.raises(RuntimeError, match="stubborn"):
        Executor(Program(compile(diagram)), 100.0).spin(50)


@pytest.mark.parametrize(
    "kernel, complaint",
    [
        (new_capsule(ctypes.cast(leaky, ctypes.c_void_p), OTHER_SIGNATURE, None), "must be named"),
        (new_capsule(ctypes.cast(leaky, ctypes.c_void_p), None, None), "must be named"),
        (mit.decode.function, "must be named"),
        (leaky.__call__, "a native kernel must be a PyCapsule, a ctypes function or a Numba cfunc"),
        (lambda arena, slots, sizes: 0, "a native kernel must be a PyCapsule"),
        (140_000_000_000, "a native kernel must be a PyCapsule"),
        (b"kernel", "a native kernel must be a PyCapsule"),
        ("gain", "a native kernel must be a PyCapsule"),
        (object(), "a native kernel must be a PyCapsule"),
        (ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_double)(lambda x: 0), "takes 3 arguments, but .* takes 1"),
        (KERNEL(), "cannot be a null pointer"),
    ],
)
def test_invalid_kernel_is_refused_before_run(kernel, complaint):
    class Odd(Leaky):
        """Names something else as its kernel."""

    Odd.kernel = Kernel(kernel, ITEMS)
    with Diagram("d", rate=100) as diagram:
        Odd()(1.0)
        CsvRecorder()
    with pytest.raises(TypeError, match=complaint):
        Program(compile(diagram))


def test_a_kernel_is_not_accepted_as_a_decoder():
    with pytest.raises(TypeError, match="a native decode must be named"):
        address(mathematics.gain, "decode")
    with pytest.raises(TypeError, match="a native encode takes 4 arguments"):
        address(leaky, "encode")


def test_direct_call_returns_status():
    arena = np.array([0.0] * 8 + [3.0, 0.0, 2.0])
    table = KernelTable((8, 9, 10), (1, 1, 1))
    assert call_kernel(mathematics.gain, arena, table) == 0 and arena[9] == 6.0


SOURCE = """
#include <stdint.h>
int twice(double *arena, const int32_t *slots, const int32_t *sizes) {
    for (int i = 0; i < sizes[1]; i++) arena[slots[1] + i] = 2.0 * arena[slots[0] + i];
    return 0;
}
"""


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
def test_a_kernel_written_in_c_and_loaded_with_ctypes_runs(tmp_path):
    (tmp_path / "twice.c").write_text(SOURCE)
    subprocess.run(["cc", "-shared", "-fPIC", "-o", tmp_path / "twice.so", tmp_path / "twice.c"], check=True)

    class Twice(Block):
        """y = 2 u."""

        u = Input("any")
        y = Output("any")
        kernel = Kernel(ctypes.CDLL(str(tmp_path / "twice.so")).twice, "u y")

    with Diagram("d", rate=100) as diagram:
        Twice(name="t")(Sine(name="s").y)
    outcome, rig = run(diagram, 20)
    assert outcome.status == "ok" and rig["t.y"].tolist() == [2.0 * value for value in rig["s.y"]]


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
@pytest.mark.parametrize("path", soaked(sorted(path.with_suffix(".c") for path in CEXT.rglob("*.pyx")), but=[0]))
def test_generated_c_is_valid_in_the_standard_of_newer_compilers(path):
    """GCC 15 and newer take C for C23, in which Cython's macro is an attribute: valid in fewer places."""
    if not path.exists():
        pytest.skip("compiled elsewhere")
    words = ["cc", "-std=gnu2x", "-DCYTHON_UNUSED=[[maybe_unused]]", "-fsyntax-only", f"-I{get_path('include')}", path]
    done = subprocess.run(words, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_every_status_has_its_own_number():
    abi, others = ((CEXT / name).read_text() for name in ("abi.pxd", "status.pxd"))
    of_kernels = abi.split("return values of a kernel")[1].split("cdef enum")[0]
    numbers = [int(number) for number in re.findall(r"^    [A-Z_]+ = (\d+)", of_kernels + others, re.MULTILINE)]
    assert len(numbers) > 20 and len(numbers) == len(set(numbers))
