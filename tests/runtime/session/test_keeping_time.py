"""A run by the clock, with the machine for itself."""

import pytest

from tests.runtime.runs import KNEE_EXO, Files, finished

pytestmark = pytest.mark.timing


def test_the_rate_is_held(tmp_path):
    """200 Hz on this machine, whatever else it does: a lost grid point in ten would be a broken clock, not a busy
    machine.
    """
    finished(KNEE_EXO, "--duration", "1.5", cwd=tmp_path)
    sidecar = Files(tmp_path / "recordings").sidecar
    assert sidecar["missed"] <= 30
    assert sidecar["statistics"]["lateness"]["p50"] < 0.0025
