"""A copy of the tree whose native modules are compiled with a sanitizer, and tests in it:
`python -m tests.sanitizing.laboratory KIND [ARGUMENTS OF PYTEST ...]`, with KIND one of

    address    AddressSanitizer and UndefinedBehaviorSanitizer, with conversions that are out of range
    thread     ThreadSanitizer

The copies are in build/sanitizing, and later calls compile only what has changed. Reports of all processes, also of
those that a test starts, are collected in a folder. Any report, and any failed test, ends with code 1.
"""

import os
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from tests.checkout import ROOT

FOLDER = ROOT / "build" / "sanitizing"
PARTS = ("blocks", "cext", "diagrams", "docs", "graph", "runtime", "tests", "pyproject.toml", "setup.py")
PARTS += ("tickwork_command.py", "Makefile", "README.md", "CITATION.cff", "MANIFEST.in", "LICENSE")
BUILT = (".so", ".c")
# Crashes belong to the handlers of the tested process.
COMMON = "detect_leaks=0:handle_segv=0:handle_sigbus=0:handle_sigfpe=0:handle_sigill=0:handle_abort=0"


@dataclass(frozen=True)
class Kind:
    """checks : of -fsanitize. library : that is loaded before Python. variable, options : of its runtime"""

    checks: str
    library: str
    variable: str
    options: str
    tests: tuple


KINDS = {
    "address": Kind(
        "address,undefined,float-cast-overflow",
        "libasan.so",
        "ASAN_OPTIONS",
        f"{COMMON}:detect_stack_use_after_return=0:alloc_dealloc_mismatch=0",
        ("-m", "not soak and not paced and not timing", "tests/cext", "tests/blocks"),
    ),
    "thread": Kind(
        "thread",
        "libtsan.so",
        "TSAN_OPTIONS",
        f"{COMMON}:report_signal_unsafe=0:report_mutex_bugs=0:report_thread_leaks=0:exitcode=0:history_size=4"
        f":die_after_fork=0:suppressions={Path(__file__).parent / 'thread.suppressions'}",
        (
            "-m",
            "not soak",
            # not test_watchdog.py: ThreadSanitizer delivers a signal only at the next system call of the thread
            "tests/cext/schedule/test_two_owners.py",
            "tests/cext/schedule/test_life_cycle.py",
            "tests/cext/schedule/test_mailbox.py",
            "tests/cext/schedule/test_live.py",
            "tests/cext/lines",
            "tests/cext/ring",
            "tests/blocks/networks/test_worker.py",
            # ThreadSanitizer makes a tick late
            "--deselect=tests/blocks/networks/test_worker.py::test_an_inference_of_many_periods_makes_no_tick_late",
        ),
    ),
}


def compiler():
    return os.environ.get("CC", "gcc").split()


def path_of(name):
    """Path of a library of the compiler. Ends the program if it has none."""
    try:
        found = subprocess.run(
            [*compiler(), f"-print-file-name={name}"], capture_output=True, text=True, check=True
        ).stdout.strip()
    except (OSError, subprocess.CalledProcessError) as error:
        sys.exit(f"no compiler: {error}. Install gcc with its sanitizers: sudo apt install gcc libc6-dev")
    if not os.path.isabs(found):
        sys.exit(f"{' '.join(compiler())} has no {name}. Install the sanitizers of gcc: sudo apt install gcc g++")
    return found


def synchronize(target):
    """Copy what has changed, and remove what is no longer there. The results of earlier builds remain."""
    target.mkdir(parents=True, exist_ok=True)
    wanted = set()
    for part in PARTS:
        files = [ROOT / part] if (ROOT / part).is_file() else (ROOT / part).rglob("*")
        for path in files:
            if not path.is_file() or path.suffix in BUILT or "__pycache__" in path.parts:
                continue
            copy = target / path.relative_to(ROOT)
            wanted.add(copy)
            if not copy.exists() or copy.read_bytes() != path.read_bytes():
                copy.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(path, copy)
    for path in list(target.rglob("*")):
        if path.is_file() and path not in wanted and "build" not in path.relative_to(target).parts:
            name = path.name.split(".")[0]
            made = path.with_name(f"{name}.pyx") in wanted or name == "cython_shared"
            if path.suffix not in BUILT or not made:
                path.unlink()


def build(kind, target):
    """Compile the modules of the copy with the sanitizer."""
    flags = f"-O1 -g1 -fno-omit-frame-pointer -w -fsanitize={KINDS[kind].checks}"
    environment = {**os.environ, "CFLAGS": flags, "CC": " ".join(compiler())}
    made = subprocess.run(
        [sys.executable, "setup.py", "-q", "build_ext", "--inplace"],
        cwd=target,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    if made.returncode != 0:
        sys.exit(made.stdout[-6000:])


def environment_of(kind, reports):
    """Environment of a process with the sanitizer. reports : folder of its reports"""
    found = KINDS[kind]
    return {
        **os.environ,
        # and that of C++, whose exceptions the sanitizer looks for at the start
        "LD_PRELOAD": f"{path_of(KINDS[kind].library)} {path_of('libstdc++.so.6')}",
        "PYTHONMALLOC": "malloc",
        "SANITIZER": kind,
        found.variable: f"{found.options}:log_path={reports}/report",
        "UBSAN_OPTIONS": f"print_stacktrace=1:log_path={reports}/report",
    }


def run(kind, arguments):
    """Build, and run tests in the copy. Returns an exit code."""
    target, reports = FOLDER / kind, FOLDER / f"{kind}_reports"
    path_of(KINDS[kind].library)
    synchronize(target)
    build(kind, target)
    shutil.rmtree(reports, ignore_errors=True)
    reports.mkdir()
    # The address space of a process with ThreadSanitizer may not be random.
    words = ["setarch", "-R"] if kind == "thread" else []
    words += [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", *(arguments or KINDS[kind].tests)]
    code = subprocess.run(words, cwd=target, env=environment_of(kind, reports)).returncode
    found = sorted(reports.iterdir())
    for path in found[:20]:
        print(f"\n{path.name}\n{path.read_text(errors='replace')[:4000]}")
    print(f"{kind}: {len(found)} processes with reports, in {reports}" if found else f"{kind}: no report")
    return 1 if code != 0 or found else 0


if __name__ == "__main__":
    if len(sys.argv) < 2 or sys.argv[1] not in KINDS:
        sys.exit(f"name a sanitizer: {', '.join(KINDS)}")
    sys.exit(run(sys.argv[1], sys.argv[2:]))
