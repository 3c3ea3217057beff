"""All robots of diagrams/, in virtual time: proof, positive work on different walkers, and a stop when a device falls
silent.
"""

import os
import tempfile
from collections import Counter
from itertools import product
from pathlib import Path

import numpy as np
import pytest

import runtime
from blocks.actuators import CubeMars
from blocks.clock import Clock
from blocks.logic import Compare
from blocks.safety import EStopHeartbeat
from blocks.wearer import Walker
from cext.fused import library
from graph import Actuator, Device, Diagram, compile
from runtime.host.errors import OK
from runtime.robot.loading.file import build_plant, load
from tests.blocks.running import run
from tests.diagrams import energy, gallery, motions, pages
from tests.diagrams.robots import CLAIMS, IN_MOTION, ROBOTS, SUITS, path
from tests.runtime.robot.emulation.test_emulate import read_until
from tests.runtime.runs import Files, finished, started
from tests.shared import shared
from tests.soaking import soaked

WALKERS = [(50, 1.6), (110, 0.8), (70, 1.2)]  # kg, m/s
SILENCE_BEGINS = 0.5  # s
CODE_OF_TORQUE = 0.05  # N·m, a code of the coarsest drive and more
SIDES = ("left", "right")


@pytest.mark.parametrize("robot", ROBOTS)
def test_robot_is_native_and_proved_without_warning(robot):
    _, diagram = load(path(robot))
    schedule = compile(diagram)
    assert schedule.warnings == [] and schedule.gil_sections == 0
    actuators = {block.path for block in diagram if isinstance(block, Actuator)}
    assert {proof.path for proof in schedule.proofs if proof.port == "torque_command" and proof.holds} == actuators


@pytest.mark.parametrize("robot", soaked(["hip_exo", "knee_exo", *ROBOTS], but=[1, 5, 8, 12, 14]))
def test_machine_code_and_calls_of_the_kernels_compute_the_same_bits(robot, monkeypatch):
    """In the drivers, the emulated devices and the wearer too."""
    fused = runtime.run(path(robot), 3.0, plant_signals="*")
    with monkeypatch.context() as patch:
        patch.setattr(library, "open_library", lambda: (None, "not in this test"))
        called = runtime.run(path(robot), 3.0, plant_signals="*")
    assert list(fused.signals) == list(called.signals)
    differ = [name for name in fused.signals if fused[name].tobytes() != called[name].tobytes()]
    assert differ == [] and any(name.startswith("plant/") for name in fused.signals)


@pytest.mark.parametrize("robot, walker", soaked(list(product(CLAIMS, WALKERS)), but=[9, 13, 18, 29]))
def test_assistance_does_positive_work_in_the_phases_that_it_claims_and_ends_with_walking(robot, walker):
    mass, speed = walker
    schedule = f"0:0 0.5:0 2:{speed} 16:{speed} 17:0"
    trial = runtime.run(
        path(robot), 18.0, settings={"mass": mass, "speed": schedule, "seed": mass, **IN_MOTION.get(robot, {})}
    )
    assert trial.fault is None
    steady, standing = (trial.time > 10.0) & (trial.time < 16.0), trial.time > 17.4
    names = [f"{side}/gait_phase.phase" for side in SIDES]
    for name in [name for name in names if name in trial.signals]:
        side, phase = name.partition("/")[0], trial[name][steady]
        for joint, intervals in CLAIMS[robot].items():
            power = (trial[f"{side}/{joint}.torque"] * trial[f"{side}/{joint}.velocity"])[steady]
            for begin, end in intervals:
                assert power[(phase > begin) & (phase < end)].mean() > 0.5, (side, joint, begin)  # W
            assert power.clip(max=0.0).sum() > -0.1 * power.clip(min=0.0).sum(), (side, joint)
            assert np.abs(trial[f"{side}/{joint}.torque_sent"][standing]).max() < CODE_OF_TORQUE


@pytest.mark.parametrize("robot", soaked(CLAIMS, but=[3, 6, 7, 9]))
def test_a_recorded_walk_is_assisted_and_squats_are_not(robot):
    """Of two recorded adults; the networks were trained on neither."""
    chosen = IN_MOTION.get(robot, {})
    walk = runtime.run(path(robot), 11.0, settings={"recording": str(shared("gait/healthy_young.csv")), **chosen})
    squats = runtime.run(
        path(robot), 8.0, settings={"recording": str(shared("gait/series_squat_opencap.csv")), **chosen}
    )
    assert walk.fault is None and squats.fault is None
    for drive in [name for name in walk.signals if name.endswith(".torque_sent")]:
        device = drive.removesuffix(".torque_sent")
        power = (walk[f"{device}.torque"] * walk[f"{device}.velocity"])[walk.time > 8.0]
        if device.partition("/")[2] in CLAIMS[robot]:
            assert power.mean() > 0.5 and power.clip(max=0.0).sum() > -0.1 * power.clip(min=0.0).sum(), device  # W
        assert np.abs(squats[drive]).max() < 0.05, device  # N·m


@pytest.fixture(scope="module")
def other_motions(tmp_path_factory):
    return motions.write(tmp_path_factory.mktemp("motions"))


# One robot for each way to know the direction: thighs with a filter or a network, shanks with a network, hips and
# knees, the shank of one leg, and knees alone.
DIRECTIONS = ("hip_exo_bilateral", "hip_exo_metamobility", "hip_knee_exo", "m_blue", "knee_exo_cybergear", "knee_exo")


@pytest.mark.hazard("H12e")
@pytest.mark.parametrize(
    "robot",
    [
        *DIRECTIONS,
        *(pytest.param(name, marks=pytest.mark.soak) for name in ("hip_exo", *CLAIMS) if name not in DIRECTIONS),
    ],
)
def test_only_walking_forward_is_assisted(robot, other_motions):
    for motion, (time, _, given, taken) in motions.measure(robot, *other_motions, IN_MOTION.get(robot, {})).items():
        if motion in ("stumbling", "walking forward, 0.8 m/s"):
            assert 0.5 < time < (3.6 if motion == "stumbling" else 6.0) and given > 10.0 * taken, motion
        else:
            assert time < 0.3 and taken < 0.3, motion  # s, J


@pytest.mark.soak
def test_energy_of_m_blue_agrees_with_the_muscles_and_gives_back_what_it_takes(other_motions):
    """Its weights are those of the fit, and so of a potential: a motion under constant load does no work."""
    m_blue = load(path("m_blue"))[0].module
    assert np.abs(energy.fit() - (m_blue.STANCE, m_blue.SWING)).max() < 0.01
    for mass, speed in WALKERS:
        settings = {"mass": mass, "speed": speed, "seed": mass}
        trial = runtime.run(path("m_blue"), 14.0, settings=settings, plant_signals="walker.*_torque")
        assert trial.fault is None
        for joint, agreement in (("hip", 0.8), ("knee", 0.65)):
            robot, muscles = trial[f"left/{joint}.torque"], trial[f"plant/walker.left_{joint}_torque"]
            steady = trial.time > 8.0
            assert similarity(robot[steady], muscles[steady]) > agreement, (joint, speed)
            assert np.abs(robot[trial.time < 3.0]).max() < CODE_OF_TORQUE  # before the wearer has walked
    rows = motions.measure("m_blue", *other_motions)
    for motion, (time, _, given, taken) in rows.items():
        assert time > 4.0 and (motion == "hopping" or abs(given - taken) < 2.0 * time), motion  # W, of four drives
    assert rows["hopping"][0] < 4.5  # s of 6: in flight no torque acts
    assert abs(given - taken) < 0.05 * given, "sitting down, standing up"


def similarity(a, b):
    """Return the cosine of the angle between two arrays."""
    return a @ b / np.sqrt((a @ a) * (b @ b))


@pytest.mark.parametrize("robot", soaked(CLAIMS, but=[3, 4, 6]))
def test_a_leg_that_swings_beside_one_that_stands_is_not_assisted(robot, tmp_path):
    """The phase of a network advances in both legs when one thigh swings."""
    time = np.arange(0.0, 10.0, 0.01)
    swing = np.column_stack([20.0 * np.sin(1.6 * np.pi * time), 15.0 + 10.0 * np.sin(1.6 * np.pi * time + 1.0)])
    names = [f"{joint}_{side}_deg" for side in ("lt", "rt") for joint in ("hip_flexion", "knee_flexion")]
    names += ["ankle_dorsiflexion_lt_deg", "ankle_dorsiflexion_rt_deg", "pelvis_tilt_deg"]
    still = np.tile([2.0, 4.0, 3.0, 3.0, 0.0, 0.0, 1.0], (len(time), 1))
    recording = tmp_path / "swing.csv"
    header = ",".join(("time", *names, "grf_vertical_lt_bw", "grf_vertical_rt_bw"))
    np.savetxt(recording, np.column_stack([time, swing, still]), delimiter=",", header=header, comments="")
    trial = runtime.run(path(robot), 9.0, settings={"recording": str(recording)})
    assert trial.fault is None
    for torque in [name for name in trial.signals if name.endswith(".torque_sent")]:
        assert np.abs(trial[torque][trial.time > 3.0]).max() < 0.05, torque  # N·m


@pytest.mark.parametrize(
    "robot, chosen",
    soaked(
        [
            ("hip_exo_bilateral", {"model": "AK10-9-V2.0"}),
            ("hip_exo_bilateral", {"model": "AK10-9-V3.0"}),
            ("ankle_exo", {"model": "CyberGear"}),
            ("ankle_exo", {"model": "AK80-9", "right_model": "CyberGear"}),
        ],
        but=[0, 1, 3],
    ),
)
def test_robot_assists_with_other_actuators(robot, chosen):
    assert not compile(load(path(robot), list(chosen.items()))[1]).warnings
    trial = runtime.run(path(robot), 13.0, settings=chosen)
    assert trial.fault is None
    [joint] = CLAIMS[robot]
    models = {block["path"]: block.get("parameters", {}).get("model") for block in trial.diagram["blocks"]}
    for side in SIDES:
        assert models[f"{side}/{joint}"] == chosen.get(f"{side}_model", chosen["model"])
        power = (trial[f"{side}/{joint}.torque"] * trial[f"{side}/{joint}.velocity"])[trial.time > 8.0]
        assert power.mean() > 0.5


@pytest.mark.parametrize("robot", soaked(ROBOTS, but=[4, 6, 10, 11]))
def test_a_silent_device_ends_the_run_safely(robot):
    """Each device of a leg, in one of the legs in turn: both are made by the same function."""
    devices = {}
    for block in load(path(robot))[1]:
        if isinstance(block, Device):
            devices.setdefault(block.path.rpartition("/")[2], []).append(block.path)
    for number, places in enumerate(devices.values()):
        device = places[number % len(places)]
        file, diagram = load(path(robot))
        plant = build_plant(file, diagram)
        with plant:
            plant[device](silent=Compare(">")(Clock()().time, SILENCE_BEGINS))
        ended = run(diagram, round(1.5 * diagram.rate), plant=plant, substeps=5).outcome
        assert (ended.status, ended.culprit) == ("silent", device)
        assert SILENCE_BEGINS < ended.tick / diagram.rate < SILENCE_BEGINS + 0.12
        assert set(ended.unconfirmed) <= {device}, device


@pytest.mark.parametrize("suit, joints", SUITS.items())
def test_a_suit_measures_the_joints_of_its_wearer(suit, joints):
    """Its sensors sample at 200 Hz; the best of the delays up to two ticks leaves less than half a degree. The network
    of a torque leaves less than 5 % of the variance.
    """
    file, diagram = load(path(suit), [("speed", "1.6")])
    plant = build_plant(file, diagram)
    worn = next(block for block in plant if isinstance(block, Walker))
    with Diagram("truth", rate=plant.rate) as truth:
        Walker(worn.speed, seed=worn.seed, name="walker")()
    measured, true = run(diagram, 1600, plant=plant, substeps=5), run(truth, 8000)
    for side in SIDES:
        assert measured[f"{side}/events.strides"][-1] >= 2
        for joint in joints:
            angles = true[f"walker.{side}_{joint}_angle"]
            errors = [
                np.abs(measured[f"{side}/{joint}_angle.y"][5:] - angles[25 - k : 8000 - k : 5]) for k in range(11)
            ]
            assert np.degrees(np.ptp(angles)) > 20.0
            assert np.degrees(min(error.max() for error in errors)) < 0.5
            if f"{side}/{joint}_torque.y" in measured.signals:
                # of its samples, which are one network's sample, two ticks, old
                torque = true[f"walker.{side}_{joint}_torque"][::5][798:-2]
                assert np.var(measured[f"{side}/{joint}_torque.y"][800:] - torque) < 0.05 * np.var(torque)


def test_ankle_exo_repeats_the_published_peak_and_its_load_cells_measure_it():
    """80 samples per second with a delay of one, of a fall that lasts 0.1 s."""
    trial = runtime.run(path("ankle_exo"), 12.0)
    steady = trial.time > 8.0
    for side in SIDES:
        names = ("ankle.torque", "measured_torque.y", "gait_phase.phase")
        torque, measured, phase = (trial[f"{side}/{name}"][steady] for name in names)
        assert torque.max() < CODE_OF_TORQUE and torque.min() == pytest.approx(-0.54 * 70.0, abs=0.1)
        assert measured.min() == pytest.approx(-37.8, abs=1.5)
        assert 0.51 < phase[torque < -37.5].mean() < 0.55
        assert np.sqrt(np.mean(torque**2)) < 0.6 * 3.0 * 9.0  # N·m, rated torque of an AK80-9 behind 3 : 1
        assert np.sqrt(np.mean((measured[2:] - torque[:-2]) ** 2)) < 1.5


@pytest.mark.parametrize("robot", ROBOTS)
def test_page_describes_the_diagram(robot):
    assert (pages.FOLDER / f"{robot}.md").read_text().startswith(pages.head(robot))
    assert f"({robot}.md)" in (pages.FOLDER / "README.md").read_text()


@pytest.mark.parametrize("robot", ["hip_exo_teensy", "hip_exo_bilateral"])
def test_the_margins_on_a_page_are_those_of_its_simulation(robot):
    pytest.importorskip("control")
    assert pages.margins(robot) in (pages.FOLDER / f"{robot}.md").read_text(), "run python -m tests.diagrams.pages"


@pytest.mark.parametrize("robot", ROBOTS)
def test_drawing_shows_the_devices_of_the_diagram_where_they_are_worn(robot):
    _, diagram = load(path(robot))
    stored = (pages.FOLDER / "images" / f"{robot}_person.svg").read_text()
    drawn, *_ = stored.partition("<text")
    assert drawn == gallery.draw(diagram, robot, []).removesuffix("</svg>\n"), "run python -m tests.diagrams.pages"
    kinds = Counter(gallery.symbol(block)[0] for block in gallery.devices(diagram))
    assert drawn.count('r="9"') == kinds["drive"] == sum(isinstance(block, Actuator) for block in diagram)
    assert drawn.count('width="6.4"') == kinds["imu"]


def test_a_device_without_a_place_or_a_symbol_is_refused():
    with Diagram("odd", rate=200) as diagram:
        CubeMars("AK80-9", bus="legs", can_id=1, name="elbow")
        EStopHeartbeat(bus="legs", name="stop")
    elbow, stop = diagram
    with pytest.raises(ValueError, match="elbow: no place on the body"):
        gallery.place(elbow)
    with pytest.raises(ValueError, match="stop: no symbol for EStopHeartbeat"):
        gallery.symbol(stop)


@pytest.mark.soak
def test_eight_sensors_and_two_networks_hold_the_rate_in_real_time():
    """Against emulated devices in another process, on pseudo-terminals, I2C and CAN frames over UDP."""
    robot = path("hip_exo_2dof")
    with tempfile.TemporaryDirectory(prefix="tickwork") as name:  # the path of a socket has 107 bytes at most
        folder = Path(name)
        rig = folder / "lab.toml"
        text = (pages.FOLDER / "hip_exo_2dof_emulated.toml").read_text().replace("/tmp/feet", f"{folder}/feet")
        rig.write_text(text.replace("239.74.163.2", f"239.74.163.{os.getpid() % 250 + 3}"))
        plant = started("emulate", robot, "--rig", rig, "--lines", folder, cwd=folder)
        try:
            read_until(plant.stdout, "Ctrl-C ends it")
            ports = {"TICKWORK_PORTS": str(folder / "tty*")}
            ended = finished(
                robot, "--rig", rig, "--yes", "--duration", "30", "--record", "out", cwd=folder, timeout=120, **ports
            )
        finally:
            plant.kill()
            plant.communicate()
        assert ended.returncode == OK, ended.stderr
        trial = runtime.load(Files(folder / "out").one(".mcap"))
        assert len(trial) > 0.99 * 30.0 * 200.0
        for side in SIDES:
            assert (trial[f"{side}/hip.torque"] * trial[f"{side}/hip.velocity"])[trial.time > 10.0].mean() > 3.0  # W
