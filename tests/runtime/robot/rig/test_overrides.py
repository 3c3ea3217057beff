"""A rig meets a diagram: hardware parameters of devices change, nothing else does, and mismatches are reported."""

import pytest

from blocks.actuators import CubeMars
from blocks.imus import ICM20948, OpenImu
from blocks.limiters import TorqueLimiter
from graph import Device, Diagram, DiagramError, Output, Param, compile, subsystem
from graph.budget import frame_bits
from runtime.robot.rig.errors import RigError
from runtime.robot.rig.file import read
from runtime.robot.rig.overrides import override

HARDWARE = f"CubeMars has {', '.join(CubeMars.hardware)}"
LEGS = '[bus.legs]\ninterface = "socketcan"\nchannel = "can0"\nbitrate = 500_000\n'


def robot():
    with Diagram("robot", rate=200) as diagram:
        for side, can_id in (("left", 1), ("right", 2)):
            with subsystem(side):
                knee = CubeMars("AK10-9-V2.0", bus="legs", can_id=can_id, name="knee")
                knee(torque_command=TorqueLimiter(limit=12.0)(knee.torque))
    return diagram


@pytest.fixture
def fitted(tmp_path):
    """A robot as a rig has it."""

    def fitted(text, diagram=None):
        path = tmp_path / "lab.toml"
        path.write_text(text)
        diagram = diagram or robot()
        override(read(path), diagram)
        return diagram

    return fitted


def troubles(fitted, text):
    with pytest.raises(RigError) as caught:
        fitted(text)
    return [(trouble.code, trouble.message, trouble.hint) for trouble in caught.value.problems]


def test_hardware_parameters_are_those_of_the_rig_and_others_stay(fitted):
    diagram = fitted(LEGS + '[device."left/knee"]\ncan_id = 3\ninvert = true\noffset = 0.5\n')
    left, right = diagram["left/knee"], diagram["right/knee"]
    assert (left.can_id, left.invert, left.offset) == (3, True, 0.5)
    # what follows from them follows: 12.5 rad less the offset
    assert left.limits[0] == 12.0 and left.addresses() == [(3, False)]
    assert (right.can_id, right.invert, right.offset) == (2, False, 0.0)
    assert [device.enable[0][0] for device in compile(diagram).devices] == [3, 2]


def test_a_number_may_carry_its_unit(fitted):
    assert fitted(LEGS + '[device."left/knee"]\noffset = "90 deg"\n')["left/knee"].offset == pytest.approx(
        1.5708, abs=1e-4
    )


def test_the_load_of_a_bus_is_that_of_the_rigs_bitrate(fitted):
    [load] = compile(fitted(LEGS)).loads
    [twice] = compile(fitted(LEGS.replace("500_000", "250_000"))).loads
    assert load.bitrate == 500_000 and twice.typical == pytest.approx(2.0 * load.typical)
    slow = fitted(LEGS.replace("500_000", "50_000"))
    with pytest.raises(DiagramError) as caught:
        compile(slow)
    assert [d.code for d in caught.value.diagnostics] == ["TW016"]


class Flexible(CubeMars):
    """Drive whose one frame of a tick has 48 bytes."""

    def traffic(self):
        return [(48, False)]


def test_frames_of_can_fd_need_a_bus_with_it_and_take_its_data_bitrate(fitted):
    diagram = robot()
    with diagram:
        Flexible("AK10-9-V2.0", bus="legs", can_id=3, name="flexible")(torque_command=0.0)
    with pytest.raises(RigError) as caught:
        fitted(LEGS, diagram)
    [trouble] = caught.value.problems
    assert (trouble.code, trouble.message) == (
        "TW103",
        "[bus.legs] carries classic CAN, but flexible exchanges frames of 48 bytes",
    )
    [slow] = compile(fitted(LEGS + "fd = true\n", diagram)).loads
    [fast] = compile(fitted(LEGS + "fd = true\ndata_bitrate = 5_000_000\n", diagram)).loads
    faster = frame_bits(48, False, 0.1)[0] - frame_bits(48, False)[0]
    assert (slow.data_bitrate, fast.data_bitrate) == (0.0, 5e6)
    assert fast.typical - slow.typical == pytest.approx(200 / 500e3 * faster)


def test_device_bitrate_that_differs_from_bus_is_reported(fitted):
    def with_imu(bitrate=250_000.0):
        diagram = robot()
        with diagram:
            OpenImu(bus="legs", bitrate=bitrate, name="imu")
        return diagram

    legs = LEGS.replace("500_000", "1_000_000")
    with pytest.raises(RigError) as caught:
        fitted(legs, with_imu())
    [trouble] = caught.value.problems
    assert trouble.code == "TW103" and trouble.message == "[bus.legs] has 1000 kbit/s, but imu is set to 250 kbit/s"
    assert trouble.hint.endswith('write [device."imu"] bitrate = 1000000')
    fitted(legs + '[device."imu"]\nbitrate = 1_000_000\n', with_imu())
    compile(fitted(LEGS.replace("500_000", "250_000"), with_imu()))


def test_compiler_reports_two_drives_with_one_id_from_rig(fitted):
    with pytest.raises(DiagramError) as caught:
        compile(fitted(LEGS + '[device."left/knee"]\ncan_id = 2\n'))
    assert caught.value.diagnostics[0].code == "TW013"


def test_a_rig_may_have_buses_that_a_diagram_does_not_use(fitted):
    fitted(LEGS + '[bus.arms]\ninterface = "socketcan"\nchannel = "can1"\n')


@pytest.mark.parametrize(
    "text, expected",
    [
        (
            "",
            (
                "TW104",
                "no interface for bus 'legs'",
                'add [bus.legs] with interface = "socketcan" and channel = "can0"',
            ),
        ),
        (
            LEGS.replace("legs", "leg"),
            (
                "TW104",
                "no interface for bus 'legs'; did you mean 'leg'?",
                'add [bus.legs] with interface = "socketcan" and channel = "can0"',
            ),
        ),
        (
            LEGS + '[device."left/kne"]\ncan_id = 3',
            ("TW103", '[device."left/kne"]: robot has no such device', "did you mean 'left/knee'?"),
        ),
        (
            LEGS + "[device.left.knee]\ncan_id = 3",
            ("TW103", '[device."left"]: robot has no such device', 'quote the whole path: [device."left/knee"]'),
        ),
        (
            LEGS + "[device.zzz]\ncan_id = 3",
            ("TW103", '[device."zzz"]: robot has no such device', "its devices are left/knee, right/knee"),
        ),
        (
            LEGS + '[device."left/torque_limiter"]\nlimit = 20.0',
            (
                "TW103",
                '[device."left/torque_limiter"] is a TorqueLimiter and not a device',
                "a rig changes hardware parameters only; for one run, "
                "--set left/torque_limiter.PARAMETER=VALUE changes any block",
            ),
        ),
        (
            LEGS + '[device."left/knee"]\nlimit = "peak"',
            ("TW102", '[device."left/knee"] limit is not a hardware parameter', f"set it in the diagram; {HARDWARE}"),
        ),
        (
            LEGS + '[device."left/knee"]\ncanid = 3',
            ("TW102", '[device."left/knee"] canid: no such parameter', "did you mean 'can_id'?"),
        ),
        (LEGS + '[device."left/knee"]\nzzz = 3', ("TW102", '[device."left/knee"] zzz: no such parameter', HARDWARE)),
        (
            LEGS + '[device."left/knee"]\ncan_id = 300',
            ("TW102", '[device."left/knee"] can_id = 300: must be at most 255, got 300', "CAN id set in the drive"),
        ),
        (
            LEGS + '[device."left/knee"]\ncan_id = 3.5',
            ("TW102", '[device."left/knee"] can_id = 3.5: expected a whole number, got 3.5', "CAN id set in the drive"),
        ),
        (
            LEGS + '[device."left/knee"]\ninvert = 1',
            (
                "TW102",
                '[device."left/knee"] invert = 1: expected True or False, got 1',
                "whether the joint turns opposite to the motor",
            ),
        ),
        (
            LEGS + '[device."left/knee"]\noffset = nan',
            (
                "TW102",
                '[device."left/knee"] offset = nan: NaN is not allowed',
                "motor position at the zero of the joint, in the units and direction of the joint",
            ),
        ),
        (
            LEGS + '[device."left/knee"]\noffset = [0.1]',
            (
                "TW102",
                '[device."left/knee"] offset = [0.1]: expected one number, got [0.1]',
                "motor position at the zero of the joint, in the units and direction of the joint",
            ),
        ),
    ],
)
def test_rig_entry_that_does_not_match_diagram_is_reported(fitted, text, expected):
    assert troubles(fitted, text) == [expected]


def sensors():
    with Diagram("robot", rate=200) as diagram:
        ICM20948(bus="trunk", name="imu")
    return diagram


TRUNK = '[bus.trunk]\ninterface = "i2c"\nchannel = "/dev/i2c-1"\n'


def test_values_that_depend_on_each_other_are_set_together_in_any_order(fitted):
    for entries in ("channel = 3\nmux = 0x70\n", "mux = 0x70\nchannel = 3\n"):
        imu = fitted(f"{TRUNK}[device.imu]\n{entries}", sensors())["imu"]
        assert (imu.mux, imu.channel) == (0x70, 3)


@pytest.mark.parametrize(
    "entries, shown", [("channel = 3", "channel = 3"), ("channel = 3\naddress = 0x68", "channel = 3, address = 104")]
)
def test_values_that_no_device_can_have_together_are_reported_together(fitted, entries, shown):
    with pytest.raises(RigError) as caught:
        fitted(f"{TRUNK}[device.imu]\n{entries}\n", sensors())
    assert [problem.message for problem in caught.value.problems] == [
        f'[device."imu"] {shown}: channel requires a multiplexer. Set its address, such as mux=0x70'
    ]


def test_all_mismatches_are_reported_together_and_nothing_is_applied(fitted):
    text = '[device."left/kne"]\n[device."left/knee"]\ncan_id = 0\ninvert = "yes please"\n'
    assert [code for code, _, _ in troubles(fitted, text)] == ["TW104", "TW103", "TW102", "TW102"]


def test_hardware_must_be_parameters():
    with pytest.raises(TypeError, match="Sensor.hardware contains 'serial', which is not a parameter of the class"):

        class Sensor(Device):
            """A sensor."""

            hardware = ("serial",)
            port = Param("", "1", "where it is", dtype=str)
            angle = Output("rad", "angle")
