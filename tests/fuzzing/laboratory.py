"""A copy of the tree whose parsers are built for the fuzzer, and runs of it: `python -m tests.fuzzing.laboratory
[SECONDS [TARGET ...]]`.

libFuzzer and the sanitizers are clang's. They come into an ordinary Python in front of everything else, and the process
ends with them.
"""

import os
import platform
import re
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from tests.checkout import ROOT, copy_packages
from tests.fuzzing.targets import EVERYTHING, modules_of, seeds_of
from tests.mutation.laboratory import build_of

CORPUS = ROOT / "build" / "fuzzing"  # what earlier runs have found, and in `failures` what they have failed at
CHECKS = "address,undefined,float-cast-overflow"
# Cython adds nothing to NULL where a call has no arguments, and calls methods through a pointer of another type.
BUT = "-fno-sanitize=pointer-overflow,function"
CLANG = next(filter(shutil.which, ("clang-19", "clang")), "clang-19")
SYMBOLIZER = shutil.which("llvm-symbolizer-19") or shutil.which("llvm-symbolizer")  # names the covered functions
OPTIONS = (
    "-max_len=1500",
    "-timeout=5",
    "-rss_limit_mb=3000",
    "-detect_leaks=0",
    "-print_final_stats=1",
    "-print_coverage=1",
    "-reload=0",
)


@dataclass(frozen=True)
class Run:
    """executions : of the harness. edges, of_edges : in the functions that it came to, of the target's module; missed :
    the others.

    failure : what it found, in words, or ""; said : all that the fuzzer wrote
    """

    target: str
    executions: int
    per_second: int
    edges: int
    of_edges: int
    missed: tuple
    failure: str
    said: str

    def in_words(self):
        return (
            f"{self.target:22} {self.executions:10} executions, {self.per_second:6} a second, {self.edges} of "
            f"{self.of_edges} edges"
            f"{', FAILED: ' + self.failure if self.failure else ''}"
        )


def why_not():
    """In words, why nothing can be fuzzed here; "" where it can."""
    if not sys.platform.startswith("linux"):
        return "fuzzing wants Linux"
    if shutil.which(CLANG) is None:
        return "fuzzing wants clang: sudo apt install clang-19 libclang-rt-19-dev llvm-19"
    if SYMBOLIZER is None:
        return "fuzzing wants llvm-symbolizer: sudo apt install llvm-19"
    missing = [name for name in ("fuzzer_no_main", "asan") if runtime(name) is None]
    return (
        f"fuzzing wants clang's own libraries ({', '.join(missing)}): sudo apt install libclang-rt-19-dev"
        if missing
        else ""
    )


def runtime(name):
    """Path of one of clang's own libraries, None where it is not there."""
    ending = "so" if name == "asan" else "a"
    asked = subprocess.run([CLANG, "-print-resource-dir"], capture_output=True, text=True).stdout.strip()
    for path in sorted(Path(asked).glob(f"lib/*/libclang_rt.{name}*.{ending}")):
        if path.name == f"libclang_rt.{name}-{platform.machine()}.{ending}" or path.parent.name.startswith(
            platform.machine()
        ):
            return path
    return None


def symbols_of(module):
    """Prefix of the names that Cython gives to the functions of a module."""
    return "__pyx_f_" + "".join(f"{len(part)}{part}_" for part in module.split("/"))


class Laboratory:
    """The copy, built. checks : of clang's sanitizers, besides those of the harness; "" for coverage alone"""

    def __init__(self, folder, checks=CHECKS):
        self.folder = copy_packages(Path(folder), packages=("cext", "graph", "blocks", "runtime", "tests"))
        self.build_of = build_of()
        self.engine = self.folder / "engine.so"
        self.instrumented = ["-fsanitize=" + ",".join(filter(None, ("fuzzer-no-link", checks)))]
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            modules = {module for name in EVERYTHING for module in modules_of(name)}
            list(pool.map(self.build, modules | {"tests/fuzzing/harness", "tests/fuzzing/lines"}))
        whole = "-Wl,--whole-archive", str(runtime("fuzzer_no_main")), "-Wl,--no-whole-archive"
        self.compile([*whole, "-lstdc++", "-lpthread"], self.engine)

    def build(self, module):
        flags = self.instrumented if module.startswith("cext") else []
        code = self.folder / f"{module}.c"
        directives = [word for name, value in self.build_of.DIRECTIVES.items() for word in ("-X", f"{name}={value}")]
        translate = [
            sys.executable,
            "-m",
            "cython",
            "-3",
            "--line-directives",
            *directives,
            f"{module}.pyx",
            "-o",
            str(code),
        ]
        subprocess.run(translate, cwd=self.folder, check=True, capture_output=True)
        include = [f"-I{sysconfig.get_path('include')}", f"-I{sys.prefix}/include"]
        kept = [flag for flag in self.build_of.FLAGS if not flag.startswith(("-O", "-falign"))]
        self.compile(
            [*kept, *flags, *include, str(code), "-lm"],
            self.folder / f"{module}{sysconfig.get_config_var('EXT_SUFFIX')}",
        )

    def compile(self, words, out):
        out.unlink(missing_ok=True)
        made = subprocess.run(
            [CLANG, "-shared", "-fPIC", "-O1", "-g1", "-w", "-fno-sanitize-recover=all", *words, BUT, "-o", str(out)],
            cwd=self.folder,
            capture_output=True,
            text=True,
        )
        if made.returncode != 0:
            raise RuntimeError(made.stderr)

    def with_error(self, file, before, after, name, seconds):
        """A Run of a parser into whose source an error was put; it is taken out again."""
        path, corpus = self.folder / file, self.folder / "corpus"
        text = path.read_text()
        if text.count(before) != 1:
            raise ValueError(f"{file} has {before!r} {text.count(before)} times")
        path.write_text(text.replace(before, after))
        try:
            for module in modules_of(name):
                self.build(module)
            return self.fuzzed(name, seconds, corpus)
        finally:
            path.write_text(text)
            for module in modules_of(name):
                self.build(module)

    def fuzzed(self, name, seconds, corpus=CORPUS):
        """A Run of so many seconds; of none, what is kept from earlier ones alone. It begins with that and the
        seeds.
        """
        kept, failures = corpus / name, corpus / "failures"
        kept.mkdir(parents=True, exist_ok=True)
        failures.mkdir(parents=True, exist_ok=True)
        for number, seed in enumerate(seeds_of(name)):
            (kept / f"seed{number}").write_bytes(seed)
        length = f"-max_total_time={round(seconds)}" if seconds else "-runs=0"
        code, said = self.start(name, length, f"-artifact_prefix={failures}/{name}-", *OPTIONS, str(kept))
        numbers = {key: int(value) for key, value in re.findall(r"stat::(\w+):\s+(\d+)", said)}
        prefixes = "|".join(map(symbols_of, modules_of(name)))
        functions = re.findall(rf"COVERED_FUNC: hits: (\d+) edges: (\d+)/(\d+) (?:{prefixes})(\S+) ", said)
        entered = [(int(some), int(all_)) for hits, some, all_, _ in functions if int(hits)]
        failure = re.search(r"tickwork: (.*)|(\S+: runtime error: .*)|ERROR: (AddressSanitizer.*|libFuzzer.*)", said)
        return Run(
            name,
            numbers.get("number_of_executed_units", 0),
            numbers.get("average_exec_per_sec", 0),
            *map(sum, zip((0, 0), *entered)),
            tuple(function for hits, _, _, function in functions if not int(hits)),
            "" if code == 0 else next(filter(None, failure.groups())) if failure else f"code {code}",
            said,
        )

    def start(self, name, *words):
        """(exit code, what it wrote)"""
        environment = {
            **os.environ,
            "LD_PRELOAD": f"{self.engine} {runtime('asan')}",
            "PYTHONMALLOC": "malloc",
            "ASAN_SYMBOLIZER_PATH": SYMBOLIZER,
            "ASAN_OPTIONS": "verify_asan_link_order=0:detect_leaks=0:handle_segv=1",
            "UBSAN_OPTIONS": "print_stacktrace=1",
        }
        process = subprocess.run(
            [sys.executable, "-m", "tests.fuzzing.one", name, *words],
            cwd=self.folder,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
        )
        return process.returncode, process.stdout


def main():
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 10.0
    if why_not():
        sys.exit(why_not())
    with tempfile.TemporaryDirectory() as folder:
        laboratory = Laboratory(Path(folder) / "checked")
        counting = Laboratory(Path(folder) / "counted", checks="")
        for name in sys.argv[2:] or EVERYTHING:
            run = laboratory.fuzzed(name, seconds)
            # the checks' own branches lead to a failure, and are none of the parser's
            counted = counting.fuzzed(name, 0)
            print(
                f"{run.in_words()}; {counted.edges} of {counted.of_edges} without the checks', missed: "
                f"{counted.missed or 'none'}"
            )
            if run.failure:
                print(run.said[-6000:])


if __name__ == "__main__":
    main()
