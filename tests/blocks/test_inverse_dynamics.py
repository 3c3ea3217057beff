"""Inverse dynamics against MuJoCo's reader of URDF and its mj_inverse, on random trees, and its errors."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from blocks.inverse_dynamics import InverseDynamics
from graph import Diagram, Interval, compile
from tests.blocks.playing import made
from tests.blocks.proofs import keeps_its_range
from tests.checkout import ROOT
from tests.graph.complaints import refusal
from tests.optional import Library

mujoco = Library("mujoco")

LEG = str(ROOT / "diagrams" / "examples" / "leg.urdf")


def row(values):
    return " ".join(repr(float(value)) for value in values)


def inertial(dice):
    """Mass properties of a random body, as URDF and as MJCF."""
    turn = np.linalg.qr(dice.normal(size=(3, 3)))[0]
    parts = dice.uniform(0.01, 0.2, 3)
    tensor = turn @ np.diag(parts.sum() - parts) @ turn.T
    mass, centre, rpy = dice.uniform(0.2, 5.0), dice.normal(scale=0.2, size=3), dice.uniform(-3.0, 3.0, 3)
    entries = {"ixx": (0, 0), "iyy": (1, 1), "izz": (2, 2), "ixy": (0, 1), "ixz": (0, 2), "iyz": (1, 2)}
    moments = " ".join(f'{key}="{tensor[place]!r}"' for key, place in entries.items()).replace("np.float64(", "")
    full = row(tensor[place] for place in entries.values())
    return (
        f'<inertial><origin xyz="{row(centre)}" rpy="{row(rpy)}"/><mass value="{mass!r}"/>'
        f"<inertia {moments.replace(')', '')}/></inertial>",
        f'<inertial pos="{row(centre)}" mass="{mass!r}" fullinertia="{full}"/>',
    )


def random_urdf(dice, count=8):
    """A random tree of links, with fixed joints in it."""
    text = ['<link name="base"><inertial><mass value="9"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>']
    text.append("</inertial></link>")
    for k in range(count):
        parent = dice.integers(-1, k) if k else -1
        kind = ("revolute", "continuous", "prismatic", "fixed")[dice.integers(4)] if k else "revolute"
        limit = '<limit lower="-9" upper="9" effort="1" velocity="1"/>' * (kind != "fixed")
        text.append(
            f'<link name="l{k}">{inertial(dice)[0]}</link><joint name="j{k}" type="{kind}">'
            f'<parent link="{"base" if parent < 0 else f"l{parent}"}"/><child link="l{k}"/>'
            f'<origin xyz="{row(dice.normal(scale=0.3, size=3))}" rpy="{row(dice.uniform(-3, 3, 3))}"/>'
            f'<axis xyz="{row(dice.normal(size=3))}"/>{limit}</joint>'
        )
    extension = '<mujoco><compiler fusestatic="false" angle="radian"/></mujoco>'
    return f'<robot name="r">{extension}{"".join(text)}</robot>'


def random_mjcf(dice, depth=4):
    """A random tree of bodies with several joints each, references, armatures, and fixed bodies."""

    def body(level):
        joints = "".join(
            f'<joint name="{level}.{dice.integers(1 << 40)}" type="{("hinge", "slide")[dice.integers(2)]}" '
            f'pos="{row(dice.normal(scale=0.1, size=3))}" axis="{row(dice.normal(size=3))}" '
            f'ref="{dice.normal()}" armature="{dice.uniform(0, 0.1)}" damping="3"/>'
            for _ in range(dice.integers(0 if level < depth else 1, 4))
        )
        inner = "".join(body(level - 1) for _ in range(dice.integers(1, 3))) if level else ""
        place = f'pos="{row(dice.normal(scale=0.3, size=3))}" quat="{row(dice.normal(size=4))}"'
        return f"<body {place}>{joints}{inertial(dice)[1]}{inner}</body>"

    return f'<mujoco><compiler angle="radian"/><worldbody>{body(depth)}</worldbody></mujoco>'


def port_stem(joint):
    return ("x" * joint[0].isdigit() + joint).replace(".", "_")


def wanted(model, block, gravity, position, velocity, acceleration):
    """Torques by mj_inverse, by output, without the damping. Each motion by the name of the joint."""
    model.opt.gravity = gravity
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT.value
    model.dof_damping[:] = 0.0
    data = mujoco.MjData(model)
    for target, motion in ((data.qpos, position), (data.qvel, velocity), (data.qacc, acceleration)):
        target[:] = [motion[model.joint(k).name] for k in range(model.njnt)]
    mujoco.mj_inverse(model, data)
    found = {port_stem(model.joint(k).name): data.qfrc_inverse[k] for k in range(model.njnt)}
    return [found[name.rsplit("_", 1)[0]] for name in block.outputs]


@pytest.mark.parametrize("kind", [random_urdf, random_mjcf])
@pytest.mark.parametrize("seed", range(12))
def test_random_trees_equal_mujoco(tmp_path, kind, seed):
    """Within 1e-10 of the largest torque, at full motion and with the base tilted; MuJoCo reads the same file."""
    dice = np.random.default_rng(seed)
    path = tmp_path / "robot.xml"
    path.write_text(kind(dice))
    model = mujoco.MjModel.from_xml_path(str(path))
    names = [model.joint(k).name for k in range(model.njnt)]
    block = InverseDynamics(str(path), joints=tuple(dice.permutation(names).tolist()))
    for _ in range(20):
        motion = [dict(zip(names, dice.normal(scale=scale, size=len(names)))) for scale in (2.0, 5.0, 30.0)]
        quaternion, turn = dice.normal(size=4), np.zeros(9)
        mujoco.mju_quat2Mat(turn, quaternion / np.linalg.norm(quaternion))
        inputs = {
            f"{port_stem(name)}_{word}": values[name]
            for word, values in zip(("position", "velocity", "acceleration"), motion)
            for name in names
        }
        found = np.ravel(block.step(**inputs, orientation=quaternion))
        expected = np.array(wanted(model, block, turn.reshape(3, 3).T @ (0.0, 0.0, -9.80665), *motion))
        assert np.abs(found - expected).max() < 1e-10 * max(1.0, np.abs(expected).max())


def test_unlisted_joints_are_held_and_fixed_ones_merged(tmp_path):
    """The torques of the listed joints are those of all joints, with the others at 0."""
    path = tmp_path / "robot.urdf"
    path.write_text(random_urdf(np.random.default_rng(5), 12))
    whole = InverseDynamics(str(path))
    names = [name.rsplit("_", 1)[0] for name in whole.outputs]
    chosen = names[1::2]
    part = InverseDynamics(str(path), joints=tuple(chosen))
    inputs = {name: 0.1 * k for k, name in enumerate(part.inputs) if name != "orientation"}
    found = dict(zip(part.outputs, part.step(**inputs)))
    rest = dict.fromkeys((name for name in whole.inputs if name != "orientation"), 0.0)
    expected = dict(zip(whole.outputs, whole.step(**(rest | inputs))))
    assert len(found) == len(chosen) > 2
    assert found == pytest.approx({name: expected[name] for name in found}, rel=1e-12)


def test_a_leg_in_closed_form():
    """Hip and knee flexed by positions alone: weights times levers; the ranges are those of the stretched leg."""
    block = InverseDynamics(LEG, joints=("knee", "hip"))
    assert list(block.outputs) == ["knee_torque", "hip_torque"] and block.outputs["hip_torque"].unit == "N·m"
    assert list(block.inputs)[:3] == ["knee_position", "hip_position", "knee_velocity"]
    hip, knee, g = 0.4, 0.9, 9.80665
    shank = (3.0 * 0.18 + 1.0 * 0.43) * g
    knee_torque, hip_torque = block.step(knee_position=knee, hip_position=hip)
    assert knee_torque == pytest.approx(-shank * math.sin(hip - knee), rel=1e-12)
    thigh = (7.0 * 0.17 + 4.0 * 0.42) * g
    assert hip_torque == pytest.approx(thigh * math.sin(hip) + shank * math.sin(hip - knee), rel=1e-12)
    still = {name: Interval.point(0.0) for name in block.inputs if "_velocity" in name or "_acceleration" in name}
    ranges = block.output_range(
        **still, knee_position=Interval(), hip_position=Interval(), orientation=Interval(-1.0, 1.0)
    )
    assert ranges["knee_torque"].high == pytest.approx(shank, rel=1e-8)
    assert ranges["hip_torque"].high == pytest.approx(thigh + shank, rel=1e-8)


@settings(max_examples=60)
@given(data=st.data(), seed=st.integers(0, 30))
def test_no_torque_leaves_its_range(data, seed, tmp_path_factory):
    path = tmp_path_factory.getbasetemp() / f"ranges{seed}.urdf"
    path.write_text(random_urdf(np.random.default_rng(seed), 5))
    with np.errstate(all="ignore"):
        keeps_its_range(data, made(InverseDynamics, str(path)), nan=True, ticks=12)


def test_a_range_is_near_the_largest_torque_that_a_search_finds():
    """In the plane, a bound by lengths is at most twice the torque of the worst motion, here of 4,000 random ones."""
    block = InverseDynamics(LEG)
    limits = {"position": 3.2, "velocity": 6.0, "acceleration": 40.0, "orientation": 1.0}
    spans = {name: Interval(-limits[name.split("_")[-1]], limits[name.split("_")[-1]]) for name in block.inputs}
    ranges, dice = block.output_range(**spans), np.random.default_rng(3)
    largest = dict.fromkeys(block.outputs, 0.0)
    for _ in range(4000):
        inputs = {name: dice.choice((-1.0, 1.0, dice.uniform(-1.0, 1.0))) * span.high for name, span in spans.items()}
        inputs["orientation"] = dice.normal(size=4)
        for name, torque in zip(block.outputs, block.step(**inputs)):
            assert torque in ranges[name]
            largest[name] = max(largest[name], abs(torque))
    for name, span in ranges.items():
        assert span.high < 2.0 * largest[name]


def test_nan_passes_to_every_joint_that_depends_on_it():
    block = InverseDynamics(LEG)
    still = dict.fromkeys((name for name in block.inputs if name != "orientation"), 0.0)
    for name in still:
        torques = block.step(**(still | {name: math.nan}))
        assert all(map(math.isnan, torques)) or name == "hip_position"
        assert math.isnan(torques[0])
    assert all(map(math.isnan, block.step(**still, orientation=(0.0, 0.0, 0.0, 0.0))))
    assert all(map(math.isnan, block.step(**still, orientation=(1.0, math.nan, 0.0, 0.0))))


GOOD = Path(LEG).read_text()


@pytest.mark.parametrize(
    "before, after, words",
    [
        ("</robot>", "", "not XML"),
        ("robot", "machine", "its root element is <machine>: use a URDF file, with <robot>, or an MJCF file"),
        ('child link="shank"', 'child link="shin"', "joint 'knee' refers to the link 'shin', which does not exist"),
        ('parent link="thigh"', 'parent link="foot"', "its joints form a loop"),
        ('child link="foot"', 'child link="shank"', "'knee' and 'ankle' both carry the link 'shank'"),
        ('<link name="pelvis"/>', '<link name="pelvis"/><link name="cuff"/>', "and has 2: pelvis, cuff"),
        ('axis xyz="0 -1 0"', 'axis xyz="0 0 0"', "joint 'hip': the axis must not be 0 0 0"),
        ('axis xyz="0 -1 0"', 'axis xyz="0 -1"', "joint 'hip': xyz of <axis> must be 3 finite numbers, got '0 -1'"),
        ('mass value="7"', 'mass value="heavy"', "link 'thigh': value of <mass> must be a finite number, got 'heavy'"),
        ('<mass value="7"/>', "", "link 'thigh' has no <mass>"),
        ('mass value="7"', 'mass value="-7"', "link 'thigh': mass and principal moments of inertia must not be"),
        ('name="knee"', 'name="hip"', "each <joint> must have a name of its own, and one has 'hip'"),
        ('"knee" type="revolute"', '"knee" type="floating"', "'knee' is not a revolute or prismatic joint of the file"),
    ],
)
def test_mistakes_in_a_file(tmp_path, before, after, words):
    assert before in GOOD
    path = tmp_path / "leg.urdf"
    path.write_text(GOOD.replace(before, after))
    found = str(refusal(InverseDynamics, str(path), ("hip", "knee")))
    assert f"{path}: " in found and words in found


def test_mistakes_in_the_joints(tmp_path, monkeypatch):
    assert "'elbow' is not a revolute or prismatic joint of the file, which has hip, knee" in str(
        refusal(InverseDynamics, LEG, ("elbow",))
    )
    assert "'hip' occurs twice" in str(refusal(InverseDynamics, LEG, ("hip", "hip")))
    changed = tmp_path / "changed.urdf"
    changed.write_text(GOOD.replace("inertial>", "visual>"))
    assert "joint 'knee' moves no mass: add masses and inertias" in str(refusal(InverseDynamics, str(changed)))
    changed.write_text(GOOD.replace('<child link="shank"/>', '<child link="shank"/><mimic joint="hip"/>'))
    assert "'knee' follows 'hip' (<mimic>): list it too" in str(refusal(InverseDynamics, str(changed), ("hip",)))
    assert len(InverseDynamics(str(changed)).outputs) == 2
    with Diagram("loose", rate=100) as diagram:
        InverseDynamics(LEG)(hip_position=0.0)
    assert "knee_position" in str(refusal(compile, diagram))
    leg = str(ROOT / "diagrams" / "examples" / "leg.xml")
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    assert InverseDynamics(LEG).files_of("file") == [Path(LEG)]
    assert "pip install 'tickwork[mujoco]'" in str(refusal(InverseDynamics, leg))
