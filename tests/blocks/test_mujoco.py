"""MujocoBody against MuJoCo's own mj_step, as a plant of a robot, and its errors."""

import math
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread
from PIL import Image, ImageSequence

import runtime
from blocks.inverse_dynamics import InverseDynamics
from blocks.mujoco import MujocoBody
from blocks.sources import Sine
from cext.kernels.mujoco import IN_USE, UNSTABLE
from graph import Diagram
from tests.blocks.running import run
from tests.checkout import ROOT
from tests.graph.complaints import refusal
from tests.optional import Library

mujoco = Library("mujoco")

EXAMPLE = ROOT / "diagrams" / "examples" / "mujoco_leg.py"
TICKS, STEPS = 300, 4

MODEL = """
<mujoco>
  <option timestep="0.00125"/>
  <worldbody>
    <body name="cart">
      <joint name="rail" type="slide" axis="1 0 0"/>
      <geom size="0.1" mass="2"/>
      <body pos="0 0 -0.1">
        <joint name="pole/hinge" axis="0 1 0" damping="0.1"/>
        <geom type="capsule" fromto="0 0 0 0 0 -0.5" size="0.02" mass="1"/>
        <site name="tip" pos="0 0 -0.5"/>
        <body pos="0 0 -0.5"><joint name="wrist" type="ball"/><geom size="0.03" pos="0 0.02 0" mass="0.2"/></body>
      </body>
    </body>
    <body pos="0 2 0.2"><freejoint name="box"/><geom type="box" size="0.1 0.1 0.1"/></body>
    <geom type="plane" size="5 5 1" pos="0 0 -2"/>
  </worldbody>
  <actuator>
    <motor name="push" joint="rail"/>
    <motor name="lambda" joint="pole/hinge"/>
    <position name="hold" joint="pole/hinge" kp="5"/>
    <velocity name="brake" joint="rail" kv="0.1"/>
    <general name="own" joint="rail" gainprm="2"/>
    <motor joint="rail"/>
  </actuator>
  <sensor>
    <accelerometer name="tip" site="tip"/>
    <jointpos name="push" joint="pole/hinge"/>
    <actuatorfrc name="effort" actuator="push"/>
    <framequat name="turn" objtype="site" objname="tip"/>
  </sensor>
  <keyframe><key name="aside" qpos="0.3 0.5 1 0 0 0 0 2 0.2 1 0 0 0"/></keyframe>
</mujoco>
"""


@pytest.fixture
def model(tmp_path):
    mujoco.MjModel  # skips without the library
    path = tmp_path / "model.xml"
    path.write_text(MODEL)
    return str(path)


def body(model, rate=1.0 / (STEPS * 0.00125), **parameters):
    """A diagram of the body, whose cart is pushed and whose pole is turned."""
    with Diagram("test", rate=rate) as diagram:
        block = MujocoBody(model, name="body", **parameters)
        block(push=Sine(amplitude=3.0, frequency=2.0, name="push")(), pole_hinge_torque=Sine(name="turn")())
    return diagram


def test_ports_and_units_follow_from_the_model(model):
    block = MujocoBody(model)
    assert {name: port.unit for name, port in block.inputs.items()} == {
        "rail_force": "N",
        "pole_hinge_torque": "N·m",
        "push": "N",
        "lambda_actuator": "N·m",  # a word of Python
        "hold": "rad",
        "brake": "m/s",
        "own": "1",
    }
    assert {name: (port.unit, port.shape) for name, port in block.outputs.items()} == {
        "rail_position": ("m", ()),
        "rail_velocity": ("m/s", ()),
        "pole_hinge_position": ("rad", ()),
        "pole_hinge_velocity": ("rad/s", ()),
        "wrist_orientation": ("1", (4,)),
        "wrist_velocity": ("rad/s", (3,)),
        "box_position": ("m", (3,)),
        "box_orientation": ("1", (4,)),
        "box_velocity": ("m/s", (3,)),
        "box_rate": ("rad/s", (3,)),
        "tip": ("m/s²", (3,)),
        "push_sensor": ("rad", ()),  # an actuator has the name
        "effort": ("N", ()),
        "turn": ("1", (4,)),
    }


def test_a_run_equals_mj_step_bit_for_bit_and_repeats(model):
    diagram = body(model, keyframe="aside", pose=(("rail", 0.25),), spread=0.1, seed=7)
    first = run(diagram, TICKS)
    second = run(diagram, TICKS)  # of the same block: it starts again
    bare = mujoco.MjModel.from_xml_path(model)
    data = mujoco.MjData(bare)
    mujoco.mj_resetDataKeyframe(bare, data, 0)
    data.qpos[0] = 0.25
    data.qpos[:2] += np.random.default_rng(7).normal(scale=0.1, size=2)
    mujoco.mj_forward(bare, data)
    for k in range(TICKS):
        expected = [*data.qpos, *data.qvel, *data.sensordata]
        names = [
            "rail_position",
            "pole_hinge_position",
            *elements("wrist_orientation", 4),
            *elements("box_position", 3),
        ]
        names += [*elements("box_orientation", 4), "rail_velocity", "pole_hinge_velocity"]
        names += [*elements("wrist_velocity", 3), *elements("box_velocity", 3), *elements("box_rate", 3)]
        names += [*elements("tip", 3), "push_sensor", "effort", *elements("turn", 4)]
        assert [first[f"body.{name}"][k] for name in names] == expected
        data.ctrl[0], data.qfrc_applied[1] = first["push.y"][k], first["turn.y"][k]
        for _ in range(STEPS):
            mujoco.mj_step(bare, data)
    assert np.ptp(first["body.rail_position"]) > 0.05
    for name, values in first.signals.items():
        assert np.array_equal(values, second[name]), name


def elements(name, count):
    return [f"{name}[{k}]" for k in range(count)]


def test_the_seed_moves_the_start(model):
    starts = [run(body(model, spread=0.1, seed=seed), 1)["body.pole_hinge_position"][0] for seed in (1, 1, 2)]
    assert starts[0] == starts[1] != starts[2]


def test_the_drive_of_a_robot_moves_a_leg_and_a_replay_repeats_it(tmp_path, monkeypatch):
    mujoco.MjModel
    monkeypatch.chdir(tmp_path)
    trial = runtime.run(EXAMPLE, 4.0)
    assert trial.end["end"]["status"] == "ok"
    assert np.ptp(trial["knee.position"]) > 0.5
    again = runtime.run(EXAMPLE, 4.0)
    assert np.array_equal(trial["knee.position"], again["knee.position"])


@pytest.mark.parametrize("torque", [math.nan, 1e30])
def test_a_body_that_diverges_is_a_fault_that_names_a_joint(model, tmp_path, monkeypatch, torque):
    monkeypatch.chdir(tmp_path)
    with Diagram("test", rate=200) as diagram:
        block = MujocoBody(model, name="body")
        block(pole_hinge_torque=torque)
    assert run(diagram, 20).outcome.status == f"kernel status {UNSTABLE}"
    assert "the acceleration of joint rail is NaN, infinite or beyond MuJoCo's bounds" in block.fault_text(UNSTABLE)
    assert not Path("MUJOCO_LOG.TXT").exists()


def test_constraints_that_mujoco_leaves_out_for_lack_of_memory_are_a_fault(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    boxes = "".join(
        f'<body pos="0 {0.05 * k} 0.05"><freejoint/><geom type="box" size="0.1 0.1 0.1"/></body>' for k in range(12)
    )
    path = tmp_path / "boxes.xml"
    size = '<size memory="100K"/><option timestep="0.005"/>'
    path.write_text(f'<mujoco>{size}<worldbody><geom type="plane" size="9 9 1"/>{boxes}</worldbody></mujoco>')
    assert 'increase <size memory="..."/> in the MJCF file' in refusal(MujocoBody, str(path)).message
    (tmp_path / "less.xml").write_text(path.read_text().replace("100K", "10K"))
    assert '(increase <size memory="..."/>)' in refusal(MujocoBody, str(tmp_path / "less.xml")).message
    monkeypatch.setattr("mujoco.mj_forward", lambda model, data: None)  # the first step is then the first to need it
    with Diagram("test", rate=200) as diagram:
        block = MujocoBody(str(path), name="body")
    assert run(diagram, 20).outcome.status == f"kernel status {UNSTABLE}"
    assert 'increase <size memory="..."/> in the MJCF file' in block.fault_text(UNSTABLE)


def test_two_programs_cannot_share_a_simulation_at_the_same_time(model):
    with Diagram("test", rate=200) as diagram:
        block = MujocoBody(model)
    for _ in range(3):
        block.step()
        block.update()
    run(diagram, 20)  # the state is then that of another program
    with pytest.raises(ArithmeticError, match=f"status {IN_USE}"):
        block.step()
    assert block.fault_text(IN_USE) == "two programs use its simulation at the same time"


def test_the_hash_of_a_diagram_has_the_files_that_the_model_includes(model, tmp_path):
    (tmp_path / "parts").mkdir()
    part = tmp_path / "parts" / "pole.xml"
    part.write_text("<mujocoinclude><geom size='0.1'/></mujocoinclude>")
    whole = tmp_path / "whole.xml"
    whole.write_text('<mujoco><worldbody><include file="parts/pole.xml"/></worldbody></mujoco>')
    block = MujocoBody(str(whole))
    assert block.files_of("file") == [whole, part]


def test_the_hash_has_the_meshes_of_included_files_in_the_folder_that_the_first_file_names(tmp_path):
    for folder in ("parts", "meshes/sub"):
        (tmp_path / folder).mkdir(parents=True)
    mesh, part, whole = tmp_path / "meshes/sub/cube.obj", tmp_path / "parts/inner.xml", tmp_path / "whole.xml"
    mesh.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
    part.write_text("<mujocoinclude><asset><mesh name='cube' file='sub/cube.obj'/></asset></mujocoinclude>")
    whole.write_text(
        "<mujoco><compiler meshdir='meshes'/><include file='parts/inner.xml'/><worldbody>"
        "<geom type='mesh' mesh='cube'/></worldbody></mujoco>"
    )
    assert MujocoBody(str(whole)).files_of("file") == [whole, mesh, part]


def test_a_motor_on_a_free_joint_has_the_unit_of_its_axes(tmp_path):
    gears = {"lift": "0 0 1 0 0 0", "turn": "0 0 0 2 0 0", "both": "1 0 0 1 0 0"}
    motors = "".join(f'<motor name="{name}" joint="root" gear="{gear}"/>' for name, gear in gears.items())
    (tmp_path / "free.xml").write_text(
        '<mujoco><worldbody><body><freejoint name="root"/><geom size="1"/></body></worldbody>'
        f"<actuator>{motors}</actuator></mujoco>"
    )
    block = MujocoBody(str(tmp_path / "free.xml"))
    assert {name: port.unit for name, port in block.inputs.items()} == {"lift": "N", "turn": "N·m", "both": "1"}


@pytest.mark.parametrize(
    "parameters, words",
    [
        ({"pose": (("rial", 1.0),)}, "no hinge or slide 'rial', it has rail, pole/hinge"),
        ({"pose": ("rail", 1.0)}, "as in pose=((\"knee\", 0.4),) with a comma after a single one, got 'rail'"),
        ({"pose": (("rail", "1 m"),)}, "pose must be pairs of a joint and its position"),
        ({"pose": (("rail", math.nan),)}, "a position of its keyframe '' or of `pose` is not finite"),
        ({"keyframe": "up"}, "has no 'up', it has aside"),
        (
            {"rate": 1500},
            'does not divide the tick of the block, 0.000666667 s: use <option timestep="0.000666666667"/>',
        ),
    ],
)
def test_a_mistake_is_named_with_what_there_is(model, parameters, words):
    assert words in refusal(lambda: runtime.run(body(model, **parameters), 0.1)).message


def test_mistakes_in_a_file(tmp_path, monkeypatch):
    mujoco.MjModel
    assert "there is no leg.xml" in refusal(MujocoBody, "leg.xml").message
    (tmp_path / "bad.xml").write_text("<mujoco><worldbdy/></mujoco>")
    assert "worldbdy" in refusal(MujocoBody, str(tmp_path / "bad.xml")).message
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    assert "pip install 'tickwork[mujoco]'" in refusal(MujocoBody, str(tmp_path / "bad.xml")).message


def test_a_misspelled_port_is_corrected(model):
    with Diagram("test", rate=200):
        found = refusal(MujocoBody(model), pole_hinge_torqe=1.0)
    assert "did you mean 'pole_hinge_torque'?" in found.hint


def test_an_exoskeleton_flexes_an_arm_of_myosuite_further_than_its_muscles_alone():
    Library("myo_sim").__name__  # skips without the models
    mujoco.MjModel
    example = ROOT / "diagrams" / "examples" / "mujoco_elbow.py"
    alone, assisted = (runtime.run(example, 4.0, settings={"stiffness": value}) for value in (0.0, 1.0))
    angles = alone["elbow.position"], assisted["elbow.position"]
    assert 0.3 < angles[0].mean() < angles[1].mean() - 0.05 and all(np.ptp(each) > 0.5 for each in angles)
    assert assisted["elbow.torque"].max() < 4.1


@pytest.mark.soak
def test_the_video_of_the_page_shows_the_moving_leg(tmp_path):
    mujoco.MjModel
    os.symlink(ROOT / "diagrams", tmp_path / "diagrams")
    page = (ROOT / "docs" / "how_to" / "mujoco.md").read_text()
    sample = re.search(r"^```python notest\n(.*?)^```", page, re.DOTALL | re.MULTILINE)[1]
    environment = {**os.environ, "MUJOCO_GL": "egl", "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-c", sample]
    ended = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=120)
    if re.search("EGL|OpenGL|Renderer", ended.stderr):
        pytest.skip(f"MuJoCo cannot render here: {ended.stderr.splitlines()[-1]}")
    assert ended.returncode == 0, ended.stderr
    picture = imread(tmp_path / "leg.png")[..., :3]
    skin = (picture[..., 0] > 1.15 * picture[..., 2]).mean()
    drive = (picture[..., 2] > 1.5 * picture[..., 0]).mean()
    assert 0.03 < skin < 0.3 and 0.005 < drive < 0.1
    with Image.open(tmp_path / "leg.webp") as video:
        frames = [np.array(frame.convert("RGB"), float) for frame in ImageSequence.Iterator(video)]
    changes = [(np.abs(one - other).max(axis=2) > 40.0).mean() for one, other in zip(frames, frames[1:])]
    assert len(frames) in (50, 51) and 0.001 < max(changes) < 0.2  # the shank moves, the rest does not


LARGE = {
    "make 90000 copies, above the limit of 10000: reduce their count": (
        '<worldbody><replicate count="300"><replicate count="300"><body><geom size="1"/></body></replicate></replicate>'
        "</worldbody>"
    ),
    "the hfield 'ground' has 900000000 points, above the limit of 10000000: reduce nrow and ncol": (
        '<asset><hfield name="ground" nrow="30000" ncol="30000" size="1 1 1 1"/></asset>'
    ),
}


@pytest.mark.parametrize("words", LARGE)
def test_a_few_lines_that_describe_a_huge_model_are_refused(tmp_path, monkeypatch, words):
    monkeypatch.setattr(mujoco.MjModel, "from_xml_path", lambda path: pytest.fail("it is compiled"))
    (tmp_path / "large.xml").write_text(f"<mujoco>{LARGE[words]}</mujoco>")
    for block in (MujocoBody, InverseDynamics):
        assert words in str(refusal(block, str(tmp_path / "large.xml")))


@pytest.mark.parametrize("words", LARGE)
def test_a_huge_part_of_a_model_is_refused_in_an_included_file_too(tmp_path, monkeypatch, words):
    monkeypatch.setattr(mujoco.MjModel, "from_xml_path", lambda path: pytest.fail("it is compiled"))
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "inner.xml").write_text(f"<mujocoinclude>{LARGE[words]}</mujocoinclude>")
    files = '<include file="outer.xml"/><include file="no.xml"/><include file="parts/inner.xml"/>'
    (tmp_path / "outer.xml").write_text(f"<mujoco>{files}</mujoco>")
    assert words in str(refusal(MujocoBody, str(tmp_path / "outer.xml")))


def test_copies_of_an_included_file_that_makes_copies_are_counted(tmp_path, monkeypatch):
    monkeypatch.setattr(mujoco.MjModel, "from_xml_path", lambda path: pytest.fail("it is compiled"))
    copies = '<replicate count="200">{}</replicate>'
    inner = copies.format("<geom size='.1'/>")
    (tmp_path / "inner.xml").write_text(f"<mujocoinclude>{inner}</mujocoinclude>")
    outer = copies.format('<include file="inner.xml"/>')
    (tmp_path / "outer.xml").write_text(f"<mujoco><worldbody>{outer}</worldbody></mujoco>")
    assert "make 40000 copies" in str(refusal(MujocoBody, str(tmp_path / "outer.xml")))


def test_copies_within_the_limit_are_compiled(tmp_path):
    (tmp_path / "small.xml").write_text(
        '<mujoco><worldbody><replicate count="3"><body><joint/><geom size="1"/></body></replicate></worldbody></mujoco>'
    )
    assert MujocoBody(str(tmp_path / "small.xml")).model.nbody == 4
