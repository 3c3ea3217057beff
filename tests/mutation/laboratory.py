"""A copy of the tree in which one mutant at a time is built and tried: `python -m tests.mutation.laboratory [SECONDS
[SEED [WORD]]]`.
"""

import importlib.util
import os
import random
import re
import subprocess
import sys
import sysconfig
import tempfile
import threading
import time
from collections import Counter
from pathlib import Path

from tests.checkout import ROOT, copy_packages
from tests.mutation.equivalent import EQUIVALENT
from tests.mutation.mutants import mutants
from tests.mutation.targets import TARGETS

TEST_TIME_LIMIT = 300.0  # s that the tests of a mutant may take, for one that hangs
ATTEMPTS = 3  # to have the same test fail twice
FAILED = re.compile(r"^FAILED (.+?)(?: - .*)?$", re.MULTILINE)
WORKERS = int(os.environ.get("TICKWORK_MUTATION_WORKERS", 2))


def build_of():
    """setup.py as a module: its flags and directives."""
    specification = importlib.util.spec_from_file_location("build_of_tickwork", ROOT / "setup.py")
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module


class Laboratory:
    """A copy in a folder. `tried(target, mutant)`: "killed", "survived", "no answer" where its tests last too long, or
    "no program" where it does not compile.
    """

    def __init__(self, folder):
        self.folder = copy_packages(Path(folder), packages=("cext", "graph", "blocks", "runtime", "diagrams", "tests"))
        for name in ("setup.py", "pyproject.toml"):
            (self.folder / name).write_bytes((ROOT / name).read_bytes())
        self.suffix = sysconfig.get_config_var("EXT_SUFFIX")
        self.build_of = build_of()
        self.left_out = []  # tests that fail without a mutant

    def prove(self, tests):
        """Leave out what fails without a mutant, as tests in real time do on a busy machine. Returns its names."""
        self.ended(tests, TEST_TIME_LIMIT, True, stops=False)
        failed = [name for name in FAILED.findall(self.said) if name not in self.left_out]
        self.left_out += failed
        return failed

    def tried(self, target, mutant):
        path = self.folder / target.file
        original = path.read_text()
        built = {extension: extension.read_bytes() for extension in map(self.extension, target.modules)}
        path.write_text(mutant.text)
        try:
            if not all(map(self.build, target.modules)):
                return "no program"
            return self.judged(target.tests, bool(target.modules))
        finally:
            path.write_text(original)
            for extension, data in built.items():
                extension.unlink(missing_ok=True)
                extension.write_bytes(data)

    def judged(self, tests, remembers):
        """Return the verdict of tests. The one that fails has to fail twice: a busy machine fails one at times."""
        for _ in range(ATTEMPTS):
            code = self.ended(tests, TEST_TIME_LIMIT, remembers)
            if code == 0:
                return "survived"
            if code is None:
                return "no answer"
            failed = FAILED.findall(self.said)
            if not failed or self.ended(failed, TEST_TIME_LIMIT, remembers) != 0:
                return "killed"
        return "no answer"

    def extension(self, module):
        return self.folder / f"{module}{self.suffix}"

    def build(self, module):
        """One extension, as setup.py builds it, but with less care for its speed. False where it cannot be."""
        directives = [word for name, value in self.build_of.DIRECTIVES.items() for word in ("-X", f"{name}={value}")]
        out = self.extension(module)
        out.unlink()
        code = self.folder / "mutant.c"
        translate = [sys.executable, "-m", "cython", "-3", *directives, f"{module}.pyx", "-o", str(code)]
        compiler = sysconfig.get_config_var("CC").split()
        flags = [flag for flag in self.build_of.FLAGS if not flag.startswith("-O")]
        include = [f"-I{sysconfig.get_path('include')}", f"-I{sys.prefix}/include"]
        compile = [*compiler, "-shared", "-fPIC", "-O1", "-w", *flags, *include, str(code), "-o", str(out), "-lm"]
        return all(
            subprocess.run(words, cwd=self.folder, capture_output=True).returncode == 0
            for words in (translate, compile)
        )

    def passes(self, tests, longest, remembers):
        """Return whether tests pass. Arguments as of `ended`"""
        return self.ended(tests, longest, remembers) == 0

    def ended(self, tests, longest, remembers, stops=True):
        """Return the exit code of tests, None if they last too long.

        longest : s; remembers : whether Python may keep its bytecode, which it tells from another by no more than time
            and size of the source; stops : at the first that fails
        """
        words = [
            sys.executable,
            "-m",
            "pytest",
            *["-x"] * stops,
            "-q",
            "-p",
            "no:cacheprovider",
            "--basetemp",
            str(self.folder / "pytest"),
            *(f"--deselect={name}" for name in self.left_out),
            *tests,
        ]
        environment = os.environ if remembers else {**os.environ, "PYTHONDONTWRITEBYTECODE": "1"}
        process = subprocess.Popen(
            words,
            cwd=self.folder,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        try:
            self.said, _ = process.communicate(timeout=longest)
            return process.returncode
        except subprocess.TimeoutExpired:
            process.kill()
            self.said, _ = process.communicate()
            return None


def all_mutants():
    """(target, mutant) of all there are, without those that are known to be no different."""
    return [
        (target, mutant)
        for target in TARGETS
        for mutant in mutants(target.file, (ROOT / target.file).read_text(), target.functions)
        if mutant.name not in EQUIVALENT
    ]


def sampled(seed, word=""):
    """All of them in an order of chance, of each target in turn."""
    chosen = [pair for pair in all_mutants() if word in pair[1].file]
    random.Random(seed).shuffle(chosen)
    seen = Counter()
    return sorted(chosen, key=lambda pair: seen.update([pair[0].file]) or seen[pair[0].file])


def experiment(seconds, seed, word="", say=lambda line: None):
    """Try as many as time permits. Returns ({verdict: how many}, the mutants that survived)."""
    waiting = sampled(seed, word)
    deadline = time.monotonic() + seconds
    verdicts, survivors, lock = Counter(made=len(waiting)), [], threading.Lock()

    def work():
        proved = set()
        with tempfile.TemporaryDirectory(prefix="mutants") as folder:
            laboratory = Laboratory(folder)
            while time.monotonic() < deadline:
                with lock:
                    if not waiting:
                        return
                    target, mutant = waiting.pop(0)
                for test in {*target.tests} - proved:  # killing a mutant means nothing otherwise
                    proved.add(test)
                    for failed in laboratory.prove([test]):
                        say(f"left out, as it fails without a mutant: {failed}")
                        verdicts["left out"] += 1
                verdict = laboratory.tried(target, mutant)
                say(f"{verdict} {mutant.line}: {mutant.name}")
                with lock:
                    verdicts.update([verdict])
                    if verdict == "survived":
                        survivors.append(mutant)

    threads = [threading.Thread(target=work) for _ in range(WORKERS)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return verdicts, survivors


if __name__ == "__main__":
    seconds, seed, word = [*sys.argv[1:], *("600", "1", "")[len(sys.argv) - 1 :]]
    print(dict(experiment(float(seconds), int(seed), word, lambda line: print(line, flush=True))[0]))
