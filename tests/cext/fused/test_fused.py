"""Fused schedules compute the same bits as calls of their kernels, name the failed step, and fall back to calls."""

import ctypes
import faulthandler
import os
import shutil
import signal
import subprocess
import sys
import time

import msgspec
import numpy as np
import pytest

from blocks.mathematics import Gain
from blocks.sources import Sine
from blocks.tables import LookupTable1D
from blocks.trigonometry import Cos
from blocks.vectors import Concatenate, Norm
from cext.clock.stopwatch import names
from cext.fused import join, library
from cext.fused.__main__ import UNFUSED, kernels, module_of, stencils, tables
from cext.fused.compile import HEADER, TARGETS
from cext.fused.sources import hash_of
from cext.fused.text import text_of
from cext.kernel import Kernel
from cext.memory.shared_state import SharedState
from cext.schedule.executor import Executor
from cext.schedule.program import Program
from graph import Block, Diagram, Input, Output, compile
from tests.cext.clock.test_signals import ENVIRONMENT, ROOT
from tests.cext.rigs import Rig
from tests.cext.spinning import needs_compiler
from tests.forking import exit_code, fork
from tests.peers import netlists
from tests.peers.tickwork import Tap, diagram_of, native_block

RATE = 1000.0
TICKS = (1, 2, 3, 257, 2000)


@pytest.fixture
def fused():
    """The library for this processor."""
    found, reason = library.open_library()
    if found is None:
        pytest.skip(reason)
    return found


def both(schedule, monkeypatch):
    """Return (program, executor) of a schedule twice: fused, and with calls."""
    one = Program(schedule)
    with monkeypatch.context() as patch:
        patch.setattr(library, "open_library", lambda: (None, ""))
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


def test_machine_code_calls_the_functions_of_the_c_library():
    """A build may link others of these names, such as a compiler's own sin, whose last bit differs."""
    with open("/proc/self/maps") as maps:
        mapped = [line.split() for line in maps if line.count("/")]
    for name, address in join.FUNCTIONS.items():
        places = [
            fields[-1]
            for fields in mapped
            if int(fields[0].split("-")[0], 16) <= address < int(fields[0].split("-")[1], 16)
        ]
        assert places and places[0] != join.__file__, name


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


class Abort(Block):
    """A kernel that ends the process."""

    u, y = Input("any"), Output("any")
    kernel = Kernel(ctypes.CDLL(None).abort, "u y")


ENDLESS = """
int recursion(double *arena, const int *slots, const int *sizes)
{
    volatile char room[1000];
    room[0] = 1;
    return recursion(arena, slots, sizes) + room[0];
}
"""


def block_in_c(folder, name, text):
    """Return a block whose kernel is a C function."""
    (folder / "kernel.c").write_text(text)
    subprocess.run(["cc", "-O0", "-shared", "-fPIC", "-o", folder / "kernel.so", folder / "kernel.c"], check=True)

    class InC(Block):
        u, y = Input("any"), Output("any")
        kernel = Kernel(ctypes.CDLL(str(folder / "kernel.so"))[name], "u y")

    return InC


def chain_of(kind):
    """A diagram with a block `middle` of a class between others."""
    with Diagram("chain", RATE) as diagram:
        Tap(name="end")(Gain(2.0)(kind(name="middle")(Gain(1.5)(Sine()()))))
    return diagram


def crashed(diagram):
    """Return the signal that ends a process with a diagram, and the name of the step that the shared state blames."""
    rig = Rig(diagram)

    def work():
        faulthandler.disable()
        rig.run(1)

    end = -exit_code(fork(work))
    assert rig.shared.fenced and rig.shared.crashed == end and rig.shared.hung is not None
    return end, names(rig.schedule)[rig.shared.hung]


@pytest.mark.parametrize("end", [signal.SIGABRT, pytest.param(signal.SIGSEGV, marks=needs_compiler)])
def test_a_crash_names_the_called_kernel_in_the_middle_of_a_run(fused, end, tmp_path):
    kind = Abort if end == signal.SIGABRT else block_in_c(tmp_path, "recursion", ENDLESS)
    assert crashed(chain_of(kind)) == (end, "middle")


ROOMY = """
int roomy(double *arena, const int *slots, const int *sizes)
{
    volatile char room[4096];
    room[0] = 1;
    *(volatile int *)8 = 1;
    return room[0];
}
"""


@needs_compiler
def test_a_crash_names_the_called_kernel_over_old_addresses_in_its_stack(fused, tmp_path):
    # The stack of the kernel has the return addresses of the cosines of the step before, which are never overwritten.
    kind = block_in_c(tmp_path, "roomy", ROOMY)
    with Diagram("chain", RATE) as diagram:
        signals = [Sine(name=f"sine_{index}")() for index in range(3)]
        norm = Norm()(Cos(name="cosines")(Concatenate((1, 1, 1))(*signals)))
        Tap(name="end")(Gain(2.0)(kind(name="middle")(norm)))
    assert crashed(diagram) == (signal.SIGSEGV, "middle")


HANG = f"""
import signal, sys
from {__name__} import endless_chain
from cext.memory.shared_state import SharedState
from tests.cext.clock.test_signals import ENVIRONMENT, ROOT
from tests.cext.rigs import Rig

if sys.argv[2:]:
    signal.pthread_sigmask(signal.SIG_BLOCK, {{signal.SIGRTMIN}})
diagram = endless_chain()
Rig(diagram, shared=SharedState(fd=int(sys.argv[1])), virtual=False, guard=60.0).run(10_000)  # the first may be missed
"""


def endless_chain():
    """A diagram whose step `middle` jumps to itself in machine code, in every Program of this process."""
    real = library.stencil_of
    endless = {"x86_64": b"\xeb\xfe", "aarch64": b"\x00\x00\x00\x14"}[library.TARGET]

    def stencil_of(kernel, sizes):
        stencil = real(kernel, sizes)
        return msgspec.structs.replace(stencil, code=endless, holes=b"") if kernel is Cos.kernel else stencil

    library.stencil_of = stencil_of
    return chain_of(Cos)


@pytest.mark.timing
@pytest.mark.parametrize("options", [[], ["blocked"]], ids=["answers", "does-not-answer"])
def test_a_hang_in_machine_code_is_never_attributed_to_another_step(fused, options):
    """options : whether the thread of the loop can be asked for its step"""
    shared = SharedState(1 << 20)
    shared.look_after(time.monotonic_ns())
    process = subprocess.Popen(
        [sys.executable, "-X", "faulthandler", "-c", HANG, str(shared.fd), *options],
        cwd=ROOT,
        env=ENVIRONMENT,
        pass_fds=[shared.fd],
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        found, end = None, time.monotonic() + 30.0
        while found in (None, *[-1] * (not options)) and process.poll() is None and time.monotonic() < end:
            found = shared.hung
            time.sleep(0.001)
    finally:
        process.send_signal(signal.SIGABRT)  # which writes its stack
        error = process.communicate()[1]
    assert found is not None, error
    assert found == -1 if options else names(Rig(chain_of(Cos)).schedule)[found] == "middle"


def test_programs_are_fused_by_default(fused, monkeypatch):
    opened = library.open_library.__wrapped__  # without its cache
    monkeypatch.delenv("TICKWORK_FUSED", raising=False)
    found, reason = opened()
    assert found is not None and found.target == library.TARGET and reason == ""
    monkeypatch.setenv("TICKWORK_FUSED", "0")
    assert opened() == (None, "TICKWORK_FUSED=0 in the environment")
    monkeypatch.delenv("TICKWORK_FUSED")
    monkeypatch.setattr(library, "TARGET", "")
    assert opened() == (None, f"no machine code for the processor {library.platform.machine()}")


def test_the_reason_why_a_step_is_not_fused_is_reported(fused, monkeypatch):
    gain = next(kernel for _, key, kernel in kernels() if key.endswith("gain_kernel"))
    assert library.obstacle(gain, (1, 1, 1)) == ""
    assert library.obstacle(gain, (1, 1)) == "no machine code for these numbers of elements"
    assert library.obstacle(Abort.kernel, (1, 1)) == "kernel of another package"
    network = next(kernel for path, _, kernel in kernels() if module_of(path) == "networks/worker")
    assert library.obstacle(network, (1,)) == "kernel calls another library"
    key_of = library.key_of
    monkeypatch.setattr(library, "key_of", lambda kernel: "0123456789abcdef " + key_of(kernel).split()[1])
    assert library.obstacle(gain, (1, 1, 1)) == "kernel changed since `make stencils`"


def cut(content):
    return content[: len(content) // 2]


def flipped(content):
    return content[:100_000] + bytes([content[100_000] ^ 4]) + content[100_001:]


def of_another_version(content):
    return bytes([content[0] + 1]) + content[1:]


@pytest.mark.parametrize("change", [cut, flipped, of_another_version, lambda content: b""])
def test_a_damaged_or_foreign_file_of_stencils_is_not_used(fused, monkeypatch, tmp_path, change):
    damaged = tmp_path / library.FILE.name
    damaged.write_bytes(change(library.FILE.read_bytes()))
    monkeypatch.setattr(library, "FILE", damaged)
    reason = "is of another version" if change is of_another_version else "is damaged"
    found = library.open_library.__wrapped__()
    assert found[0] is None and f"{damaged.name} {reason}" in found[1]


def test_programs_run_without_executable_memory():
    script = (
        "import ctypes, sys\n"
        "if ctypes.CDLL(None).prctl(65, 1, 0, 0, 0) != 0:\n    sys.exit(77)\n"  # PR_SET_MDWE
        "from blocks.sources import Constant\nfrom graph import Diagram, compile\n"
        "from cext.fused import library\nfrom cext.schedule.program import Program\n"
        "with Diagram('d', 100.0) as diagram:\n    Constant(1.0)()\n"
        "program = Program(compile(diagram))\n"
        "assert program.fused == 0 and 'executable memory' in library.open_library()[1]\n"
    )
    environment = {name: value for name, value in os.environ.items() if name != "TICKWORK_FUSED"}
    done = subprocess.run([sys.executable, "-c", script], env=environment, capture_output=True, text=True)
    if done.returncode == 77:
        pytest.skip("this kernel has no PR_SET_MDWE")
    assert done.returncode == 0, done.stderr


def test_the_text_of_every_kernel_can_be_taken():
    taken = [text_of(path.with_suffix(".c"), key.split()[1]) for path, key, _ in kernels()]
    assert len(taken) > 160 and all("Py" not in text for text in taken)


def test_the_hash_of_sources_changes_with_code_and_directives_and_not_with_comments(tmp_path):
    head = "# cython: freethreading_compatible=True"

    def hash_with(text):
        (tmp_path / "kernel.pyx").write_text(text)
        return hash_of(tmp_path / "kernel.pyx")

    plain = hash_with(f"{head}\ny = a / b\n")
    assert plain == hash_with(f"{head}\n# a comment\n\ny = a / b    # another\n")
    others = (
        f"{head}\ny = b / a\n",
        f"{head}, cdivision=False\ny = a / b\n",
        f"#cython: cdivision=False\n{head}\ny = a / b\n",
    )
    assert len({plain, *map(hash_with, others)}) == 4


@pytest.mark.parametrize("target", TARGETS)
def test_every_kernel_has_stencils_of_the_present_sources(target):
    stale = sorted({path.name for path, key, _ in kernels() if key.split()[0] != hash_of(path)})
    assert stale == [], "built from other sources: run make build"
    found = library.read(library.FILE)[target]
    assert set(found.kernels) | set(found.unfused) == {key for _, key, _ in kernels()}, "run make stencils"
    assert {key for path, key, _ in kernels() if module_of(path) in UNFUSED} == set(found.unfused)


@pytest.mark.soak
@pytest.mark.skipif(shutil.which("clang-19") is None, reason="no clang-19")
@pytest.mark.parametrize("target", TARGETS)
def test_the_stencils_are_those_that_clang_makes(target, monkeypatch):
    found = library.read(library.FILE)[target]
    for path, key, kernel in kernels():
        if key not in found.unfused:
            made = [one for table in tables(kernel.items) for one in stencils(target, path, key, *table)]
            assert library.unpack(found.kernels[key]) == tuple(made), key


@pytest.mark.soak
@pytest.mark.skipif(shutil.which("gcc") is None, reason="no C compiler")
def test_the_text_of_every_fused_kernel_is_plain_c(tmp_path):
    for path, key, _ in kernels():
        if module_of(path) in UNFUSED:  # the text lacks what it calls in another module
            continue
        source = tmp_path / "kernel.c"
        source.write_text(HEADER + text_of(path.with_suffix(".c"), key.split()[1]))
        subprocess.run(["gcc", "-fsyntax-only", "-Werror=implicit-function-declaration", source], check=True)
