"""A copy of the tree in which one mutant at a time is built and tried: `python -m tests.mutation.laboratory [SECONDS
[SEED [WORD]]]`.
"""

import importlib.util
import os
import random
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

TEST_TIME_LIMIT = 120.0  # s that the tests of a mutant may take, for one that hangs
WORKERS = 2


def build_of():
    """setup.py as a module: its flags and directives."""
    specification = importlib.util.spec_from_file_location("build_of_tickwork", ROOT / "setup.py")
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module


class Laboratory:
    """A copy in a folder. `tried(target, mutant)`: "killed", "survived", or "no program" where it does not compile."""

    def __init__(self, folder):
        self.folder = copy_packages(Path(folder), packages=("cext", "graph", "blocks", "runtime", "diagrams", "tests"))
        for name in ("setup.py", "pyproject.toml"):
            (self.folder / name).write_bytes((ROOT / name).read_bytes())
        self.suffix = sysconfig.get_config_var("EXT_SUFFIX")
        self.build_of = build_of()

    def tried(self, target, mutant):
        path = self.folder / target.file
        original = path.read_text()
        built = {extension: extension.read_bytes() for extension in map(self.extension, target.modules)}
        path.write_text(mutant.text)
        try:
            if not all(map(self.build, target.modules)):
                return "no program"
            return "survived" if self.passes(target.tests, TEST_TIME_LIMIT, bool(target.modules)) else "killed"
        finally:
            path.write_text(original)
            for extension, data in built.items():
                extension.unlink(missing_ok=True)
                extension.write_bytes(data)

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
        """remembers : whether Python may keep its bytecode, which it tells from another by no more than time and size
        of the source
        """
        words = [
            sys.executable,
            "-m",
            "pytest",
            "-x",
            "-q",
            "-p",
            "no:cacheprovider",
            "--basetemp",
            str(self.folder / "pytest"),
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
            return process.returncode == 0
        except subprocess.TimeoutExpired:
            process.kill()
            self.said, _ = process.communicate()
            return False


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
    unmutated = sorted({target.tests for target, _ in waiting})
    verdicts, survivors, lock = Counter(made=len(waiting)), [], threading.Lock()

    def work():
        with tempfile.TemporaryDirectory(prefix="mutants") as folder:
            laboratory = Laboratory(folder)
            while unmutated:  # each list of tests passes without a mutant, or killing one means nothing
                with lock:
                    tests = unmutated.pop() if unmutated else None
                if tests is not None and not laboratory.passes(tests, 5.0 * TEST_TIME_LIMIT, True):
                    waiting.clear()
                    raise AssertionError(f"{tests} fail without any mutant:\n{laboratory.said}")
            while time.monotonic() < deadline:
                with lock:
                    if not waiting:
                        return
                    target, mutant = waiting.pop(0)
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
