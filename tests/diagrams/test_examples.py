"""The examples that a newcomer reads first: short, without a warning, and each moves a joint."""

import numpy as np
import pytest

import runtime
from graph import compile
from runtime.robot.loading.file import load
from tests.checkout import ROOT

FOLDER = ROOT / "diagrams" / "examples"
# joints, and from s on: their angle from peak to peak, rad
MOTION = {
    "position": (["motor"], 1.0),
    "impedance": (["motor"], 0.6),
    "imu_to_actuator": (["motor"], 1.0),
    "imu_to_torque": (["motor"], 0.8),
    "streaming": (["left", "right"], 1.0),
    "position_with_visualisation": (["left/hip", "left/knee"], 1.0),
}


@pytest.mark.parametrize("name", MOTION)
def test_example_is_short_and_moves_its_joints_from_their_zero(name):
    path = FOLDER / f"{name}.py"
    assert len(path.read_text().splitlines()) <= 20
    assert not compile(load(path)[1]).warnings
    trial = runtime.run(path, 6.0)
    joints, span = MOTION[name]
    assert trial.end["end"]["status"] == "ok"
    for joint in joints:
        position = np.asarray(trial[f"{joint}.position"])
        assert abs(position[0]) < 1e-3  # the zero that was set during arming
        assert np.ptp(position[trial.time >= 2.0]) == pytest.approx(span, rel=0.25)


def test_every_example_is_on_the_page():
    page = (ROOT / "docs" / "how_to" / "examples.md").read_text()
    assert all(f"{name}.py" in page for name in MOTION)
    assert sorted(path.stem for path in FOLDER.glob("*.py")) == sorted([*MOTION, "hand", "mujoco_elbow", "mujoco_leg"])
