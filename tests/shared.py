"""The shared room beside the checkout: measured data and frames of other implementations, which are not part of the
project's tree.
"""

import json
import os
from pathlib import Path

import pytest

SHARED = Path(os.environ.get("TICKWORK_SHARED") or Path(__file__).resolve().parents[2] / "shared")


def shared(name):
    """Path of a shared file; skips the test, or the module that asks while it is imported, where it is absent."""
    path = SHARED / name
    if not path.exists():
        pytest.skip(f"needs {name} of the shared room, ../shared or $TICKWORK_SHARED", allow_module_level=True)
    return path


def entries(name):
    """The entries of one file of test vectors."""
    return json.loads(shared(f"vectors/{name}.json").read_text())["entries"]


def specifications(section):
    """One section of the table of actuators."""
    return json.loads(shared("actuator_specs.json").read_text())[section]
