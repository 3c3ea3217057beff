"""The URDF of the robots in diagrams/, read by the parsers of Rerun and MuJoCo."""

import importlib

import numpy as np
import pytest

from blocks.actuators import CubeMars
from blocks.imus import MicroStrain
from graph import Diagram, subsystem
from runtime.host.errors import BadInput
from runtime.robot.loading.draw import draw_file
from runtime.robot.loading.urdf import urdf as made
from tests.docs.test_special_samples import samples
from tests.optional import Library
from tests.runtime.runs import ROOT, knee, write

mujoco = Library("mujoco")
urdf = Library("rerun.urdf")

ROBOTS = {  # joints
    "ankle_exo": "ankle",
    "hip_exo_2dof": "abduction hip",
    "hip_knee_exo": "hip knee",
    "knee_exo": "knee",
    "m_blue": "hip knee",
    "sensor_suit": "",
}


@pytest.mark.parametrize("robot", ROBOTS)
def test_every_joint_moves_the_segments_below_it_in_the_direction_of_its_angle(robot, tmp_path):
    target = tmp_path / "robot.urdf"
    [line], remarks = draw_file(ROOT / "diagrams" / f"{robot}.py", output=str(target))
    assert line.startswith(f"{target}: ") and not remarks
    tree = urdf.UrdfTree.from_file_path(target)
    moving = {joint.name: joint for joint in tree.joints() if joint.joint_type != "fixed"}
    assert {*moving} == {f"{side}_{joint}" for side in ("left", "right") for joint in ROBOTS[robot].split()}
    assert all(joint.limit_effort > 5.0 and joint.limit_velocity > 5.0 for joint in moving.values())
    spec = mujoco.MjSpec.from_file(str(target))
    spec.compiler.fusestatic = False  # the segments keep their names
    model = spec.compile()
    data = mujoco.MjData(model)
    assert {model.joint(number).name for number in range(model.njnt)} == {*moving}
    mujoco.mj_forward(model, data)
    straight = {side: np.array(data.body(f"{side}_foot").xpos) for side in ("left", "right")}
    assert straight["left"][1] == pytest.approx(0.09) == -straight["right"][1]
    assert straight["left"][2] == pytest.approx(-(0.245 + 0.246) * 1.75)
    for name in moving:
        side, joint = name.split("_")
        data.qpos[:] = 0.0
        data.joint(name).qpos = 0.3
        mujoco.mj_forward(model, data)
        moved = np.array(data.body(f"{side}_foot").xpos) - straight[side]
        turn = np.array(data.body(f"{side}_foot").xmat).reshape(3, 3)
        if joint == "abduction":  # outward
            assert moved[1] * straight[side][1] > 0.0
        elif joint == "ankle":  # the toes rise
            assert turn[2, 0] == pytest.approx(np.sin(0.3))
        else:
            assert moved[0] * {"hip": 1.0, "knee": -1.0}[joint] > 0.1
    if robot == "sensor_suit":
        assert {"left_thigh_imu", "right_foot_imu"} <= {joint.child_link for joint in tree.joints()}


def test_a_range_is_a_limit_and_a_robot_without_names_of_joints_is_refused(tmp_path):
    draw_file(knee(tmp_path), output=str(tmp_path / "knee.urdf"))
    joint = urdf.UrdfTree.from_file_path(tmp_path / "knee.urdf").get_joint_by_name("knee")
    assert (joint.joint_type, joint.limit_lower, joint.limit_upper) == ("revolute", -12.5, 12.5)
    text = knee(tmp_path).read_text().replace('name="knee")', 'name="winch")')
    with pytest.raises(BadInput, match="knee has no actuator with a name such as left/knee"):
        draw_file(write(tmp_path, text), output=str(tmp_path / "winch.urdf"))


def test_two_actuators_of_one_joint_are_refused_and_two_sensors_of_one_segment_are_there():
    with Diagram("robot", rate=100) as diagram:
        for number, name in enumerate(("left_thigh_imu", "left_thigh_imu_2")):
            MicroStrain(name=name, serial=f"6251.{number}")
        CubeMars("AK80-9", name="left_knee", can_id=1)
    assert all(f'<link name="{name}"' in made(diagram) for name in ("left_thigh_imu", "left_thigh_imu_2"))
    with diagram, subsystem("left"):
        CubeMars("AK80-9", name="knee", can_id=2)
    with pytest.raises(BadInput, match="left_knee and left/knee are one joint in a URDF"):
        made(diagram)


def test_the_urdf_of_the_page_walks_in_rerun(tmp_path, monkeypatch):
    [text] = samples("docs/how_to/ros2.md")
    draw_file(ROOT / "diagrams" / "hip_knee_exo.py", output=str(tmp_path / "hip_knee_exo.urdf"))
    monkeypatch.chdir(tmp_path)
    names = {}
    exec(text.replace("diagrams/", f"{ROOT}/diagrams/").replace("10.0", "2.0"), names)
    half = {}  # angles of the quaternions in the file
    for chunk in importlib.import_module("rerun.chunk").RrdReader("hip_knee_exo.rrd").stream():
        if chunk.entity_path.startswith("/joints/"):
            batch = chunk.to_record_batch()
            [column] = [name for name in batch.schema.names if name.endswith(":quaternion")]
            half.setdefault(chunk.entity_path.removeprefix("/joints/"), []).extend(batch[column].to_pylist())
    assert {*half} == {"left_hip", "left_knee", "right_hip", "right_knee"}
    for joint, rows in half.items():
        angle = names["trial"][f"{joint.replace('_', '/')}.position"]
        turn = np.array(rows)[:, 0, 1] * (1.0 if "knee" in joint else -1.0)
        assert np.ptp(angle) > 0.5 and 2.0 * np.arcsin(turn) == pytest.approx(angle, abs=1e-5)
