"""Provenance of a recording: its diagram and settings, versions, the user's repository, and the machine."""

from __future__ import annotations

import json
import os
import platform
import subprocess
from collections.abc import Callable, Mapping
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, TypeVar

T = TypeVar("T")
PACKAGES = ("tickwork", "numpy", "networkx", "python-can", "onnxruntime", "onnxruntime-gpu")
GIT_TIMEOUT = 2.0  # s, for a repository on a slow disk


def gather(plan: Mapping[str, Any]) -> dict[str, Any]:
    """Return the provenance of a run for JSON; None for what cannot be had. plan : plan of the recorder"""
    metadata = plan.get("metadata", {})
    return {
        "name": plan["name"],
        "rate": plan["rate"],
        "virtual": plan["virtual"],
        "simulated": plan["simulated"],
        "buses": plan["buses"],
        "media": plan.get("media", ["can"] * len(plan["buses"])),
        "part": plan.get("part", 1),
        "limits": plan.get("limits", {}),
        "states": plan.get("states", {}),
        "metadata": metadata,
        "hash": json.loads(diagram)["hash"] if (diagram := plan.get("diagram_json")) else None,
        "versions": optional(versions),
        "repository": optional(repository, metadata.get("diagram_file")),
        "machine": optional(machine),
    }


def optional(function: Callable[..., T], *arguments: Any) -> T | None:
    """Return the result of a function, None if it raises: no recording fails for want of its description."""
    try:
        return function(*arguments)
    except Exception:
        return None


def versions() -> dict[str, str]:
    """Return the versions of Python and of the installed packages in PACKAGES."""
    numbers = {"python": platform.python_version()}
    for package in PACKAGES:
        with suppress(PackageNotFoundError):
            numbers[package] = version(package)
    return numbers


def machine() -> dict[str, Any]:
    """Return the name, the system and the processor of this machine."""
    return {
        "node": platform.node(),
        "system": f"{platform.system()} {platform.release()}",
        "architecture": platform.machine(),
        "processor": processor(),
        "processors": os.cpu_count(),
    }


def processor() -> str | None:
    """Return the model of the board or of the processor; None if unknown."""
    board = Path("/proc/device-tree/model")
    try:
        if board.exists():
            return board.read_text().strip("\0\n ")
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        return next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), None)
    except OSError:
        return None


def repository(file: str | None) -> dict[str, Any] | None:
    """Return the state of the git repository of a file; None without one.

    revision : revision of the last commit
    dirty : whether tracked files have uncommitted changes; None if unknown
    tracked : whether the file is tracked
    """
    if not file:
        return None
    folder = os.path.dirname(os.path.abspath(file))
    revision = git(folder, "rev-parse", "HEAD")
    if revision is None:
        return None
    changes = git(folder, "status", "--porcelain", "--untracked-files=no")
    tracked = git(folder, "ls-files", "--error-unmatch", os.path.abspath(file)) is not None
    return {
        "revision": revision.strip(),
        "dirty": None if changes is None else bool(changes.strip()),
        "tracked": tracked,
    }


def git(folder: str, *words: str) -> str | None:
    """Return the output of a git command; None if it fails."""
    environment = {**os.environ, "GIT_OPTIONAL_LOCKS": "0", "LC_ALL": "C"}
    try:
        done = subprocess.run(
            ["git", "-C", folder, *words],
            capture_output=True,
            text=True,
            timeout=GIT_TIMEOUT,
            env=environment,
            stdin=subprocess.DEVNULL,
        )
    except (OSError, subprocess.TimeoutExpired):
        return None
    return done.stdout if done.returncode == 0 else None
