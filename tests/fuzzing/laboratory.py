"""A copy of the tree whose parsers are built for the fuzzer, and runs of it: `python -m tests.fuzzing.laboratory [SECONDS [TARGET ...]]`.

libFuzzer and the sanitizers are clang's. They come into an ordinary Python in front of everything else, and the process ends with them.
"""

import os
import platform
import re
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from dataclasses import dataclass
from pathlib import Path

from tests.house import ROOT, copy_rooms
from tests.mutation.laboratory import build_of
from tests.fuzzing.targets import TARGETS, seeds

CORPUS = ROOT / "build" / "fuzzing"             # what earlier runs have found, and what they have failed at
CHECKS = "address,undefined,float-cast-overflow"
NATIVE = ("streams", "socketcan")               # of cext, beside the kernels
OPTIONS = ("-max_len=1500", "-timeout=5", "-rss_limit_mb=3000", "-detect_leaks=0", "-print_final_stats=1", "-print_coverage=1", "-print_pcs=1", "-reload=0")


@dataclass(frozen=True)
class Run:
    """executions : of the harness. edges, of_edges : in the functions of the target's module. said : what the fuzzer wrote, failure : where it found one"""

    target: str
    executions: int
    per_second: int
    edges: int
    of_edges: int
    failure: str
    said: str

    def in_words(self):
        return (f"{self.target:22} {self.executions:10} executions, {self.per_second:6} a second, {self.edges} of {self.of_edges} edges"
                f"{', FAILED: ' + self.failure if self.failure else ''}")


def why_not():
    """In words, why nothing can be fuzzed here; "" where it can."""
    if not sys.platform.startswith("linux"):
        return "fuzzing wants Linux"
    if shutil.which("clang") is None:
        return "fuzzing wants clang: sudo apt install clang"
    missing = [name for name in ("fuzzer_no_main", "asan") if runtime(name) is None]
    return f"fuzzing wants clang's runtime ({', '.join(missing)}): sudo apt install clang libclang-rt-dev" if missing else ""


def runtime(name):
    """Path of one of clang's own libraries, None where it is not there."""
    ending = "so" if name == "asan" else "a"
    asked = subprocess.run(["clang", "-print-resource-dir"], capture_output=True, text=True).stdout.strip()
    found = sorted(Path(asked).glob(f"lib/*/libclang_rt.{name}*{ending}"))
    own = [path for path in found if path.name == f"libclang_rt.{name}-{platform.machine()}.{ending}" or path.parent.name.startswith(platform.machine())]
    return own[0] if own else None


class Laboratory:
    """The copy, built. `fuzzed(target, seconds)`: a Run."""

    def __init__(self, folder):
        self.folder = copy_rooms(Path(folder), rooms=("cext", "graph", "blocks", "runtime", "tests"))
        self.build_of = build_of()
        kernels = sorted({target.module for target in TARGETS.values() if target.module})
        for module in [f"cext/kernels/{name}" for name in kernels] + [f"cext/{name}" for name in NATIVE]:
            self.build(module, ["-fsanitize=fuzzer-no-link," + CHECKS])
        self.build("tests/fuzzing/harness", [])
        self.engine = self.folder / "engine.so"
        self.compile(["-x", "none", "-Wl,--whole-archive", str(runtime("fuzzer_no_main")), "-Wl,--no-whole-archive", "-lstdc++", "-lpthread"], self.engine)

    def build(self, module, flags):
        code = self.folder / f"{module}.c"
        directives = [word for name, value in self.build_of.DIRECTIVES.items() for word in ("-X", f"{name}={value}")]
        translate = [sys.executable, "-m", "cython", "-3", "--line-directives", *directives, f"{module}.pyx", "-o", str(code)]
        subprocess.run(translate, cwd=self.folder, check=True, capture_output=True)
        include = [f"-I{sysconfig.get_path('include')}", f"-I{sys.prefix}/include"]
        kept = [flag for flag in self.build_of.FLAGS if not flag.startswith(("-O", "-falign"))]
        self.compile([*kept, *flags, *include, str(code), "-lm"], self.folder / f"{module}{sysconfig.get_config_var('EXT_SUFFIX')}")

    def compile(self, words, out):
        out.unlink(missing_ok=True)
        made = subprocess.run(
            ["clang", "-shared", "-fPIC", "-O1", "-g1", "-w", "-fno-sanitize-recover=all", *words, "-o", str(out)], cwd=self.folder,
            capture_output=True, text=True)
        if made.returncode != 0:
            raise RuntimeError(made.stderr)

    def fuzzed(self, name, seconds):
        kept, failures = CORPUS / name, CORPUS / "failures"
        kept.mkdir(parents=True, exist_ok=True)
        failures.mkdir(parents=True, exist_ok=True)
        for number, seed in enumerate(seeds(TARGETS[name]) if name in TARGETS else ()):
            (kept / f"seed{number}").write_bytes(seed)
        process = self.start(name, f"-max_total_time={round(seconds)}", f"-artifact_prefix={failures}/{name}-", *OPTIONS, str(kept))
        said = process.stdout
        numbers = {key: int(value) for key, value in re.findall(r"stat::(\w+):\s+(\d+)", said)}
        module = TARGETS[name].module if name in TARGETS else name
        edges = [tuple(map(int, pair)) for pair in re.findall(r"COVERED_FUNC: hits: \d+ edges: (\d+)/(\d+) __pyx_f_\S+ .*%s\.p[yx]" % module, said)]
        failure = re.search(r"tickwork: (.*)|(\S+: runtime error: .*)|ERROR: (AddressSanitizer.*|libFuzzer.*)", said)
        return Run(
            name, numbers.get("number_of_executed_units", 0), numbers.get("average_exec_per_sec", 0), sum(a for a, _ in edges), sum(b for _, b in edges),
            "" if process.returncode == 0 else next(filter(None, failure.groups())) if failure else f"code {process.returncode}", said)

    def start(self, name, *words):
        environment = {**os.environ, "LD_PRELOAD": f"{self.engine} {runtime('asan')}", "PYTHONMALLOC": "malloc",
                       "ASAN_OPTIONS": "verify_asan_link_order=0:detect_leaks=0:allocator_may_return_null=1:handle_segv=1",
                       "UBSAN_OPTIONS": "print_stacktrace=1"}
        return subprocess.run(
            [sys.executable, "-m", "tests.fuzzing.one", name, *words], cwd=self.folder, env=environment, stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace")


def main():
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 10.0
    with tempfile.TemporaryDirectory() as folder:
        laboratory = Laboratory(Path(folder) / "copy")
        for name in sys.argv[2:] or TARGETS:
            run = laboratory.fuzzed(name, seconds)
            print(run.in_words(), flush=True)
            if run.failure:
                print(run.said[-6000:])


if __name__ == "__main__":
    main()
