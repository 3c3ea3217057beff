"""OpenIMU over CAN: its axes, its settings, what it does when it is lost, and the unit that is not there."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from blocks.actuators import CubeMars
from blocks.imus import EmulatedOpenImu, OpenImu
from blocks.imus.openimu import frames
from blocks.limiters import TorqueLimiter
from blocks.safety import Rearm
from graph import Diagram, DiagramError, compile
from graph.compiler import examine
from tests.blocks.actuators.wire import EXTENDED, FOREIGN, MALFORMED, NOT_FINITE, REMOTE, TAKEN, Wired
from tests.blocks.running import player, run
from tests.cext.rigs import Rig

NOTED = 2
PRIORITIES = {frames.ACCELERATION: 2, frames.ANGULAR_RATE: 3, frames.SLOPE: 3, frames.MAGNETIC_FIELD: 6}


def identifier(group, address=128):
    return EXTENDED | PRIORITIES.get(group, 6) << 26 | group << 8 | address


@pytest.fixture(scope="module")
def listener():
    """An OpenImu at an address that accepts everything without configuration."""
    made = {}

    def listener(address, **more):
        key = (address, *more.items())
        if key not in made:
            made[key] = Wired(OpenImu, address=address, write_settings=False, slope=True, **more)
        return Wired.again(made[key])

    return listener


def robot(**parameters):
    with Diagram("robot", rate=200) as diagram:
        OpenImu(name="imu", **parameters)
    return diagram


def plant(diagram, imu="imu", **inputs):
    """Its unit alone. inputs : arrays over the ticks of the plant"""
    with Diagram("plant", rate=1000) as made:
        unit = EmulatedOpenImu.of(diagram[imu], name="unit")
        for name, value in inputs.items():
            port = unit.inputs[name]
            played = np.ndim(value) > len(port.shape)
            unit(**{name: player(value, port.unit, bool if port.dtype == "bool" else float) if played else value})
    return made


def together(ticks, faults=None, **parameters):
    diagram = robot(**parameters)
    return run(diagram, ticks, plant=plant(diagram, **(faults or {})), substeps=5)


def vector(recording, port):
    return np.stack([recording[f"imu.{port}[{i}]"] for i in range(3)], axis=-1)


def test_arming_configures_axes_of_factory_unit_to_right_handed_frame():
    """Three axes in turn: what is put in comes out, and the triple product of accel, gyro and mag keeps its sign."""
    given = {"accel": (3.0, -2.0, -9.0), "gyro": (0.5, 1.5, -1.0), "mag": (20.0, -10.0, 40.0)}
    for model in ("300RI", "335RI"):
        recording = together(60, given, model=model)
        assert recording.outcome.status == "ok"
        assert vector(recording, "accel")[-1] == pytest.approx(given["accel"], abs=0.011)
        assert vector(recording, "gyro")[-1] == pytest.approx(given["gyro"], abs=math.radians(1.01 / 128))
        assert recording["imu.settings"][-1] == 31.0 if model == "300RI" else recording["imu.settings"][-1] >= 7.0
        assert recording["imu.age"].max() < 0.02 and recording["imu.invalid"][-1] == 0.0
        if model == "300RI":
            assert vector(recording, "mag")[-1] == pytest.approx(given["mag"], abs=0.026)
            handed = np.linalg.det([vector(recording, port)[-1] for port in ("accel", "gyro", "mag")])
            assert handed == pytest.approx(np.linalg.det(list(given.values())), rel=0.01)
        else:
            assert np.isnan(vector(recording, "mag")).all()


def test_the_factory_axes_are_not_one_frame():
    """The same unit, read without configuration: no rotation brings acceleration and angular rate back together."""
    unit = Wired(EmulatedOpenImu)
    sent = np.eye(3)
    seen = {"accel": [], "gyro": []}
    for axis in sent:
        unit["accel"], unit["gyro"], reader = 5.0 * axis, axis, Wired(OpenImu, write_settings=False)
        state = unit["state"]
        state[7] = 0.0
        unit["state"] = state
        for name, data in unit.say():
            reader.hear(name, data)
        seen["accel"].append(reader["accel"] / 5.0)
        seen["gyro"].append(reader["gyro"])
    turn = {port: np.round(np.array(columns).T) for port, columns in seen.items()}
    assert np.linalg.det(turn["accel"]) == pytest.approx(-1.0) and np.linalg.det(turn["gyro"]) == pytest.approx(-1.0)
    assert not np.array_equal(turn["accel"], turn["gyro"])


def test_z_up_is_the_printed_frame_turned_about_x():
    given = {"accel": (1.0, 2.0, -9.5), "gyro": (0.1, 0.2, 0.3), "mag": (20.0, 5.0, 40.0), "pitch": 0.2, "roll": -0.1}
    printed, up = (together(60, given, axes=axes, slope=True) for axes in ("printed", "z up"))
    for port in ("accel", "gyro", "mag"):
        assert vector(up, port)[-1] == pytest.approx(vector(printed, port)[-1] * (1.0, -1.0, -1.0))
    assert printed["imu.pitch"][-1] == pytest.approx(0.2, abs=1e-5) and up["imu.pitch"][-1] == pytest.approx(
        -0.2, abs=1e-5
    )
    assert printed["imu.roll"][-1] == up["imu.roll"][-1] == pytest.approx(-0.1, abs=1e-5)


def test_a_slower_rate_is_set_and_seen():
    recording = together(200, rate=20.0, timeout=0.2)
    assert recording["imu.age"].max() == pytest.approx(0.05, abs=0.006)


def test_several_by_source_address_share_a_bus():
    with Diagram("robot", rate=200) as diagram:
        OpenImu(address=130, name="shank")
        OpenImu(address=131, name="thigh")
    with Diagram("plant", rate=1000) as made:
        for name, turn in (("shank", 0.5), ("thigh", -1.5)):
            EmulatedOpenImu.of(diagram[name], name=name)(gyro=(turn, 0.0, 0.0))
    recording = run(diagram, 60, plant=made, substeps=5)
    assert recording["shank.gyro[0]"][-1] == pytest.approx(0.5, abs=2e-4) and recording["thigh.gyro[0]"][
        -1
    ] == pytest.approx(-1.5, abs=2e-4)
    with Diagram("twice", rate=200) as diagram:
        OpenImu(name="a"), OpenImu(name="b")
    with pytest.raises(DiagramError) as caught:
        compile(diagram)
    assert [d.code for d in caught.value.diagnostics] == ["TW013"]


def test_unit_that_rejects_settings_is_not_ready():
    """It speaks all the while: but in which axes?"""
    wired, unit = Wired(OpenImu), Wired(EmulatedOpenImu)
    for name, data in unit.say():
        assert wired.hear(name, data) == NOTED
    assert np.isnan(wired["accel"]).all() and np.isnan(wired["gyro"]).all()
    diagram = robot()
    recording = run(diagram, 20, plant=plant(diagram, dropped=1.0), substeps=5)
    assert recording.outcome.status == "no answer" and recording.outcome.unanswered == ("imu",)


def test_silent_unit_ends_run_after_timeout():
    silent = np.zeros(2000, bool)
    silent[700:] = True
    recording = together(200, {"silent": silent})
    assert recording.outcome.status == "silent" and recording.outcome.culprit == "imu"
    assert 0.09 < recording["imu.age"][-1] <= 0.12


def test_power_cycled_unit_gives_no_data_until_reconfigured():
    """Back, it has the axes as it was sold, for some milliseconds: none of that comes out."""
    lost = np.zeros(3000, bool)
    lost[500:600] = True
    given = {"accel": (3.0, -2.0, -9.0), "gyro": (0.5, 1.5, -1.0)}
    # arming does not wait for it: it is told while running
    recording = together(300, {"power_lost": lost, **given}, timeout=0.0)
    accel, gyro = (vector(recording, port)[20:] for port in ("accel", "gyro"))
    assert recording["imu.age"].max() >= 0.1 and recording["imu.age"][-1] < 0.02
    assert np.abs(accel - given["accel"]).max() < 0.011 and np.abs(gyro - given["gyro"]).max() < 0.0002
    assert 0.0 in recording["imu.settings"] and recording["imu.settings"][-1] == 31.0


def test_settings_are_verified_again_after_long_silence():
    """Its claim of its address may have been lost with all the rest."""
    silent = np.zeros(2000, bool)
    silent[500:570] = True
    recording = together(200, {"silent": silent}, timeout=0.2)
    told = recording["imu.settings"]
    assert recording.outcome.status == "ok" and told[90] == told[-1] == 31.0
    assert 0.0 in told[100:] and recording["imu.age"].max() < 0.12
    silent[530:] = False  # three samples late: no power is lost and back so soon
    assert (together(200, {"silent": silent})["imu.settings"] == 31.0).all()


def test_the_reset_after_a_long_arming_keeps_settings_and_samples():
    """What blocks remember is reset when it is over: that is no silence, and no first sample."""
    silent = np.zeros(2000, bool)
    silent[:400] = True
    recording = together(100, {"silent": silent, "gyro": (0.5, 0.0, 0.0)})
    assert (recording["imu.settings"] == 31.0).all() and recording["imu.age"].max() < 0.02
    assert np.isfinite(vector(recording, "accel")).all() and recording["imu.gyro[0]"] == pytest.approx(
        np.full(100, 0.5), abs=2e-4
    )


def test_drives_and_a_unit_as_delivered_on_one_bus_are_refused():
    for bitrate, codes in ((250_000.0, {"TW025"}), (1e6, set())):
        with Diagram("robot", rate=100) as diagram:
            knee = CubeMars("AK80-9", bus="legs", name="knee")
            knee(torque_command=TorqueLimiter(limit=5.0)(knee.torque))
            OpenImu(bus="legs", bitrate=bitrate, name="imu")
        assert {d.code for d in examine(diagram).errors} == codes


def test_an_incomplete_sample_does_not_count(listener):
    wired = listener(128)
    rest = bytes.fromhex("007d007d007d0000")
    answers = [
        wired.hear(identifier(group), rest)
        for group in (
            frames.ACCELERATION,
            frames.ANGULAR_RATE,
            frames.ANGULAR_RATE,
            frames.SLOPE,
            frames.MAGNETIC_FIELD,
            frames.ACCELERATION,
        )
    ]
    assert answers == [NOTED, NOTED, NOTED, NOTED, TAKEN, NOTED]


def test_values_marked_as_missing_are_counted(listener):
    wired = listener(128)
    wired.hear(identifier(frames.ANGULAR_RATE), b"\xff\xff\x00\x7d\x00\xfe\x00\x00")
    wired.hear(identifier(frames.ACCELERATION), b"\xff\xfd\x00\x7d\x00\x7d\x00\x00")
    assert wired["invalid"] == 2.0


@pytest.mark.parametrize("model, counted", [("335RI", 1.0), ("300RI", 0.0)])
@pytest.mark.parametrize("merit, is_bad", [(0, 0.0), (1, 0.0), (2, 1.0), (3, 1.0)])
def test_values_that_a_335ri_marks_as_errors_are_counted(merit, is_bad, model, counted):
    """Of each value in turn. A 300RI has no merit: its firmware sends 3, "not available", in every packet."""
    places = {frames.ACCELERATION: (48, 50, 52), frames.ANGULAR_RATE: (48, 50, 52), frames.SLOPE: (50, 54)}
    wired = Wired(OpenImu, model=model, slope=True, write_settings=False)
    for group, firsts in places.items():
        for first in firsts:
            before = wired["invalid"]
            wired.hear(identifier(group), packed((32000, 16), (32000, 16), (32000, 16), (merit << first - 48, 16)))
            assert wired["invalid"] - before == is_bad * counted


@given(name=st.integers(0, 0xFFFFFFFF), data=st.binary(max_size=64), address=st.integers(128, 247))
def test_any_frame_leaves_measurements_in_range(name, data, address, listener):
    wired = listener(address)
    before = wired.arena.copy()
    answer = wired.hear(name, data)
    ours = name & EXTENDED and not name & (REMOTE | 0x20000000) and name & 0xFF == address
    assert (answer == FOREIGN) == (not ours) or (name >> 8 & 0x3FFFF) == 0
    if answer in (FOREIGN, MALFORMED):
        assert np.array_equal(before, wired.arena, equal_nan=True)
    assert np.nanmax(np.abs(wired["accel"])) <= 336.0 and np.nanmax(np.abs(wired["gyro"])) <= math.radians(263.0)


def test_a_unit_that_keeps_its_settings_gets_no_frame():
    diagram = robot(write_settings=False)
    rig = Rig(diagram, plant(diagram, power_lost=np.arange(1000) // 100 == 5))
    assert rig.run(200).status == "ok" and not [frame for frame in rig.frames if frame.sent]


@pytest.mark.parametrize("model", ["300RI", "335RI"])
@pytest.mark.parametrize("back", [True, False])
def test_a_unit_that_has_lost_its_settings_is_configured_when_the_run_is_armed_again(model, back):
    """The run sends nothing while it waits, so that the unit gives no samples until then."""
    with Diagram("robot", rate=200) as diagram:
        OpenImu(name="imu", model=model)
        Rearm(name="again")(player(np.arange(600) == 400, "1", bool))
    rig = Rig(
        diagram, plant(diagram, power_lost=(np.arange(3000) >= 500) & (np.arange(3000) < (1500 if back else 9000)))
    )
    told, rearm = [], [rig.schedule.inputs["again"]["request"]]
    outcome = rig.run(600, arming_timeout=0.5, rearm=rearm, notify=lambda what, outcome: told.append(outcome.status))
    assert told == (["silent", "ok"] if back else ["silent", "ok", "no answer"])
    assert outcome.status == ("ok" if back else "no answer")


def test_emulated_unit_reports_diverged_plant():
    unit = Wired(EmulatedOpenImu)
    unit["gyro"] = [0.0, math.nan, 0.0]
    assert unit.say() == NOT_FINITE


def test_bus_load_includes_traffic_of_unit():
    [load] = compile(robot(slope=True)).loads
    assert (load.bitrate, load.frames) == (250_000.0, 400.0)
    assert load.typical == pytest.approx(400 * (67 + 64 + 64 / 15.6) / 250_000)


def test_a_timeout_shorter_than_its_samples_is_refused():
    with pytest.raises(
        DiagramError, match="timeout 0.1 s is shorter than 2.5 samples at 10 Hz: set timeout=0.25 or more"
    ):
        OpenImu(rate=10.0)


# What a 335RI alone sends


def packed(*fields):
    """Codes of so many bits, the least significant first: (code, bits)"""
    word, at = 0, 0
    for code, bits in fields:
        word, at = word | code << at, at + bits
    return word.to_bytes(8, "little")


FINE = {"model": "335RI", "high_resolution": True, "write_settings": False, "slope": True, "slope_sensor": 1}


@given(
    codes=st.lists(st.integers(0, 2**19 - 1), min_size=3, max_size=3),
    merits=st.lists(st.integers(0, 3), min_size=3, max_size=3),
)
def test_packets_of_high_resolution_have_three_codes_of_19_bits(codes, merits):
    wired = fine()
    for group, port, count, least in (
        (frames.FINE_ACCELERATION, "accel", 1 / 800, -320.0),
        (frames.FINE_RATE, "gyro", 1 / 1024, -250.0),
    ):
        before = wired["invalid"]
        data = packed(*((code, 19) for code in codes), *((merit, 2) for merit in merits))
        assert wired.hear(identifier(group), data) in (NOTED, TAKEN)
        expected = [code * count + least for code in codes]
        assert wired[port] == pytest.approx(expected if port == "accel" else np.radians(expected), rel=1e-12, abs=1e-12)
        assert wired["invalid"] - before == sum(merit >= 2 for merit in merits)


MADE = {}


def fine(**more):
    """A fresh one, compiled once."""
    key = tuple(more.items())
    MADE.setdefault(key, Wired(OpenImu, **FINE, **more))
    return Wired.again(MADE[key])


def test_slope_sensor_1_has_500_codes_per_degree_up_to_64_degrees():
    wired = fine()
    for pitch, roll in ((32000, 32000), (0, 64000), (42000, 12345)):
        wired.hear(
            identifier(frames.SLOPE_1),
            packed((pitch, 16), (roll, 16), (32000, 16), (0, 2), (0, 2), (2, 2), (0, 2), (5, 8)),
        )
        assert np.degrees([wired["pitch"], wired["roll"]]) == pytest.approx(
            [pitch / 500 - 64, roll / 500 - 64], abs=1e-12
        )
    assert wired["invalid"] == 0.0  # the merit of the pitch rate is another's
    wired.hear(identifier(frames.SLOPE_1), packed((0, 16), (0, 16), (0, 16), (2, 2), (3, 2), (0, 2), (0, 2), (0, 8)))
    assert wired["invalid"] == 2.0


def test_a_sample_is_complete_with_three_packets_without_the_field():
    wired = fine()
    assert (
        wired.hear(identifier(frames.FINE_RATE), bytes(8)) == wired.hear(identifier(frames.SLOPE_1), bytes(8)) == NOTED
    )
    assert (
        wired.hear(identifier(frames.MAGNETIC_FIELD), bytes(8))
        == wired.hear(identifier(frames.ACCELERATION), bytes(8))
        == NOTED
    )
    assert np.isnan(wired["mag"]).all() and wired.hear(identifier(frames.FINE_ACCELERATION), bytes(8)) == TAKEN


def test_a_unit_in_high_resolution_mode_sends_fine_codes():
    given = {"accel": (3.0011, -2.0049, -9.0), "gyro": (0.5003, 1.5, -1.0), "pitch": 0.2, "roll": -0.1}
    recording = together(60, given, model="335RI", high_resolution=True, slope=True, slope_sensor=1)
    assert recording.outcome.status == "ok" and recording["imu.settings"][-1] >= 7.0
    assert vector(recording, "accel")[-1] == pytest.approx(given["accel"], abs=0.51 / 800)
    assert vector(recording, "gyro")[-1] == pytest.approx(given["gyro"], abs=math.radians(0.51 / 1024))
    assert [recording["imu.pitch"][-1], recording["imu.roll"][-1]] == pytest.approx(
        [0.2, -0.1], abs=math.radians(0.003)
    )


def test_openimu_300ri_rejects_settings_of_the_335ri():
    for more in ({"high_resolution": True}, {"slope": True, "slope_sensor": 1}):
        with pytest.raises(DiagramError, match="require model='335RI'"):
            robot(**more)


# Temperature


def ambient(raw):
    """PGN 65269 of SAE J1939-71; SPN 171 in bytes 4 and 5, the other values not available."""
    return b"\xff" * 3 + raw.to_bytes(2, "little") + b"\xff" * 3


@pytest.mark.parametrize("raw, celsius", [(0, -273.0), (9376, 20.0), (9696, 30.0), (0xFAFF, 1734.96875)])
def test_a_temperature_in_the_ambient_conditions_is_decoded(listener, raw, celsius):
    imu = listener(128)
    assert imu.hear(identifier(65269), ambient(raw)) == NOTED and imu["temperature"] == celsius
    assert imu.hear(identifier(65269, 129), ambient(0)) == FOREIGN and imu["temperature"] == celsius
    assert imu.hear(identifier(65269), ambient(raw)[:5]) == MALFORMED


@pytest.mark.parametrize("raw", [0xFE00, 0xFFFF])
def test_a_temperature_that_is_an_error_or_not_available_is_nan(listener, raw):
    imu = listener(128)
    imu.hear(identifier(65269), ambient(9376))
    assert imu.hear(identifier(65269), ambient(raw)) == NOTED and math.isnan(imu["temperature"])


@pytest.mark.parametrize("sends", [False, True])
def test_the_temperature_is_nan_unless_the_firmware_sends_it(sends):
    diagram = robot()
    with Diagram("plant", rate=1000) as made:
        EmulatedOpenImu.of(diagram["imu"], sends_temperature=sends, name="unit")(temperature=36.5)
    walk = run(diagram, 400, plant=made, substeps=5)
    newest = walk["imu.temperature"][-1]
    assert newest == pytest.approx(36.5, abs=1 / 64) if sends else math.isnan(newest)
    assert np.isfinite(walk["imu.accel[2]"][-1])
