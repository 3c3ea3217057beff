"""Copies of the checkout that tests may break, and Pythons that start in them."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("cext", "graph", "blocks", "runtime")
RUN = ["-m", "runtime"]


def copy_packages(target, built=True, packages=PACKAGES):
    """The packages of this checkout in another folder. built : with their compiled modules."""
    leftovers = ["__pycache__", "*.c"] + ([] if built else ["*.so"])
    for package in packages:
        shutil.copytree(ROOT / package, target / package, ignore=shutil.ignore_patterns(*leftovers))
    return target


def tracked():
    """Files of this checkout that git has or would take; skips the test where there is no git."""
    listing = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT,
        capture_output=True,
        text=True,
    )
    if listing.returncode != 0:
        pytest.skip("needs a git checkout")
    return [path for name in listing.stdout.split("\0") if name and (path := ROOT / name).is_file()]


def copy_tracked(target):
    """What a fresh clone would have, in another folder."""
    for path in tracked():
        copy = target / path.relative_to(ROOT)
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(path, copy)
    return target


def python(*arguments, cwd, path=None, executable=sys.executable, timeout=60):
    """A Python of its own, in a CompletedProcess with text. path : its PYTHONPATH, after the folder that `-m` or the
    script brings.
    """
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    if path is not None:
        environment["PYTHONPATH"] = str(path)
    return subprocess.run(
        [str(executable), *map(str, arguments)],
        cwd=cwd,
        env=environment,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=timeout,
    )


def assert_one_line(process, *parts):
    """It ended with code 2 and one line, without a traceback, that has every part."""
    assert process.returncode == 2, process.stderr
    assert process.stdout == ""
    [line] = process.stderr.splitlines()
    assert line.startswith("tickwork: ")
    for part in parts:
        assert str(part) in line
