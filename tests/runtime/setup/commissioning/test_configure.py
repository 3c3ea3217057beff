"""`configure` of a drive over real udp_multicast: what is asked and sent, what is refused, and what a CyberGear never
gets.
"""

import io
import struct

import pytest

from runtime.host.errors import BAD_INPUT, OK
from tests.runtime.setup.commissioning.nodes import DISABLE, ZERO, Mit, Nodes, Private, Servo


def configure(command_line, nodes, *words):
    return command_line("configure", *words, *nodes.words)


def kinds(drive):
    """Types of the frames of the private protocol that a drive has heard, without repetition."""
    return {identifier >> 24 for identifier, extended, _ in drive.heard if extended}


def test_an_id_is_set_and_confirmed_by_the_same_drive(command_line):
    drive = Private(127)
    with Nodes(20, drive) as nodes:
        code, out, err = configure(command_line, nodes, "127", "--set-id", "9", "--yes")
    assert (code, err) == (OK, "") and drive.can_id == 9
    assert "  id: 127 -> 9\n" in out and "done: id 127 is now 9, unique 1122334455667788\n" in out
    assert [frame for frame in drive.heard if frame[1] and frame[0] >> 24 == 7] == [(0x0709FD7F, True, bytes(8))]
    assert kinds(drive) == {0, 4, 7, 17}  # never enabled, nothing else written


@pytest.mark.parametrize("other", [Private(9, unique=5), Mit(9)])
def test_an_id_in_use_is_refused(command_line, other):
    drive = Private(127)
    with Nodes(21, drive, other) as nodes:
        code, _, err = configure(command_line, nodes, "127", "--set-id", "9", "--yes")
    assert code == BAD_INPUT and "id 9 is already in use on the bus; id 127 was not changed" in err
    assert 7 not in kinds(drive) and drive.can_id == 127


def test_the_zero_of_a_cubemars_in_mit_mode_is_set_and_verified(command_line):
    drive = Mit(3, position=0.4)
    with Nodes(37, drive) as nodes:
        code, out, err = configure(command_line, nodes, "3", "--zero", "--yes")
    # half a code
    assert (
        (code, err) == (OK, "")
        and "  position: 0.4" in out
        and "-> 0 rad, permanently or until" in out
        and "done: position is -0.0002 rad" in out
    )
    told = [data for identifier, extended, data in drive.heard if not extended]
    assert told.count(ZERO) == 1 and set(told) == {DISABLE, ZERO} and told[0] == told[1] == DISABLE


@pytest.mark.parametrize("words, kept", [([], False), (["--save"], True)])
def test_the_zero_of_a_cubemars_in_servo_mode_is_permanent_only_with_save(command_line, words, kept):
    drive = Servo(4)
    with Nodes(38, drive) as nodes:
        code, out, _ = configure(command_line, nodes, "4", "--zero", *words, "--yes")
    assert (
        code == OK
        and drive.kept is kept
        and "  position: 1.5708 rad -> 0 rad" in out
        and "done: position is 0.0000 rad" in out
    )


@pytest.mark.parametrize(
    "drive, words, said",
    [
        (Mit(3, drift=0.05), [], "is running (from"),
        (Servo(3, current=150), [], "1.50 A); nothing was changed. End the program"),
        (Mit(3), ["--save"], "has no save command"),
    ],
)
def test_the_zero_of_a_running_cubemars_is_not_changed(command_line, drive, words, said):
    with Nodes(39, drive) as nodes:
        code, _, err = configure(command_line, nodes, "3", "--zero", *words, "--yes")
    assert code == BAD_INPUT and said in err
    assert not [frame for frame in drive.heard if frame[2] == ZERO or frame[1] and frame[0] >> 8 == 5]


def test_shared_absent_and_foreign_ids_are_reported(command_line):
    with Nodes(22, Private(9), Private(9, unique=5), Mit(3), Mit(12, host=0xFD)) as nodes:
        said = [
            configure(command_line, nodes, can_id, "--protocol", "canopen", "--yes")[2]
            for can_id in ("9", "3", "12", "77")
        ]
        assert 25 not in {
            identifier >> 24 for node in nodes.nodes for identifier, extended, _ in node.heard if extended
        }
    assert "2 drives have id 9" in said[0] and "Disconnect all but one" in said[0]
    assert "id 3: the id, mode and limits of a CubeMars" in said[1] and "CubeMars' software" in said[1]
    assert "id 12 uses RobStride's MIT protocol" in said[2] and "--protocol private" in said[2]
    assert "no drive responds as id 77; `scan`" in said[3]


@pytest.mark.parametrize("running", [{"velocity": 1.5}, {"current": 2.0}])
def test_a_running_drive_is_not_configured(command_line, running):
    drive = Private(9, **running)
    with Nodes(23, drive) as nodes:
        code, _, err = configure(command_line, nodes, "9", "--zero", "--yes")
        assert code == BAD_INPUT and "id 9 is running (" in err and "nothing was changed" in err
        assert kinds(drive) == {0, 17} and drive.values[0x7019] == 0.25
        assert configure(command_line, nodes, "9", "--read", "mechPos")[0] == OK  # reading disturbs no drive
    assert kinds(drive) == {0, 17}


def test_zero_is_set_once_it_has_stopped_and_saved(command_line):
    drive = Private(9, position=0.25)
    with Nodes(24, drive) as nodes:
        code, out, _ = configure(command_line, nodes, "9", "--zero", "--save", "--yes")
    assert (
        code == OK
        and "  position: 0.25 rad -> 0 rad\n" in out
        and "done: position is 0.0000 rad" in out
        and "done: saved" in out
    )
    told = [identifier >> 24 for identifier, _, _ in drive.heard if identifier >> 24 in (4, 6, 22)]
    assert told == [4, 4, 6, 22] and drive.saved == 1
    assert [data for identifier, _, data in drive.heard if identifier >> 24 == 22] == [bytes(range(1, 9))]


@pytest.mark.parametrize(
    "words", [["--save"], ["--zero", "--save"], ["--protocol", "mit"], ["--write", "canTimeout=2000"]]
)
def test_a_cybergear_never_receives_a_frame_that_it_interprets_differently(command_line, words):
    drive = Private(9, cybergear=True)
    with Nodes(25, drive) as nodes:
        code, _, err = configure(command_line, nodes, "9", *words, "--yes")
    assert code == BAD_INPUT and ("it may be a CyberGear, which interprets such frames differently") in err
    assert not kinds(drive) & {6, 18, 22, 23, 25} and drive.saved == 0


def test_id_zero_and_supported_parameters_of_a_cybergear_can_be_set(command_line):
    drive = Private(9, cybergear=True)
    with Nodes(26, drive) as nodes:
        assert (
            configure(command_line, nodes, "9", "--write", "limit_cur=10", "--zero", "--set-id", "4", "--yes")[0] == OK
        )
    assert (drive.can_id, drive.values[0x7018], drive.values[0x7019]) == (4, 10.0, 0.0) and 22 not in kinds(drive)


def test_parameters_are_written_by_name_and_read_back(command_line):
    drive = Private(9)
    with Nodes(27, drive) as nodes:
        code, out, _ = configure(command_line, nodes, "9", "--write", "limit_torque=10.1", "canTimeout=2000", "--yes")
        assert code == OK and "  limit_torque: 17 N·m -> 10.1 N·m\n" in out and "done: canTimeout is 2000\n" in out
        written = [data for identifier, _, data in drive.heard if identifier >> 24 == 18]
        assert written == [struct.pack("<HHf", 0x700B, 0, 10.1), struct.pack("<HHI", 0x7028, 0, 2000)]
        out = configure(command_line, nodes, "9", "--read", "VBUS", "vel_max")[1]
        assert "  VBUS           47.5 V" in out and "  vel_max        - " in out
        drive.layouts[0x700B] = "<I"  # a drive that keeps another number
        drive.values[0x700B] = 5
        drive.hear, original = lambda *frame: [] if frame[0] >> 24 == 18 else original(*frame), drive.hear
        code, out, _ = configure(command_line, nodes, "9", "--write", "limit_torque=3", "--yes")
        assert code == 1 and "NOT done: limit_torque is" in out


def test_nothing_is_changed_without_confirmation(command_line, monkeypatch):
    monkeypatch.setattr("sys.stdin", io.StringIO("yes\n"))
    drive = Private(9)
    with Nodes(28, drive) as nodes:
        code, _, err = configure(command_line, nodes, "9", "--zero")
    assert code == BAD_INPUT and "cannot ask for confirmation" in err and 6 not in kinds(drive)


def test_a_robstride_changes_its_protocol_both_ways(command_line):
    private, mit = Private(9), Mit(12, host=0xFD)
    with Nodes(29, private, mit) as nodes:
        assert configure(command_line, nodes, "9", "--protocol", "mit", "--yes")[0] == OK
        assert configure(command_line, nodes, "12", "--protocol", "private", "--yes")[0] == OK
    assert private.protocol == 2
    assert [data for identifier, extended, data in mit.heard if identifier == 12 and not extended] == [
        DISABLE,
        b"\xff\xff\xff\xff\xff\xff\x00\xfd",
    ]


@pytest.mark.parametrize(
    "words, said",
    [
        ([], "no drive given: pass its id"),
        (["9"], "nothing to do: pass"),
        (["0", "--zero"], "0: expected an id from 1 to 127"),
        (["AK80-9", "--zero"], "AK80-9: the id, mode and limits of a CubeMars can be set only"),
        (["9", "--set-id", "9"], "the drive already has this id"),
        (["9", "--set-id", "128"], "128: expected an id from 1 to 127"),
        (["9", "--write", "limit_torqe=1"], "unknown parameter 'limit_torqe'; did you mean 'limit_torque'?"),
        (["9", "--write", "limit_torque=nan"], "expected a number (N·m)"),
        (["9", "--write", "canTimeout=1.5"], "expected an integer in the range of the parameter"),
        (["9", "--write", "run_mode=300"], "expected an integer in the range of the parameter"),
        (["9", "--write", "mechPos=1"], "position is measured or commanded"),
        (["9", "--protocol", "mti"], "did you mean 'mit'?"),
        (["--joint", "left/knee"], "--joint needs the rig and the diagram"),
    ],
)
def test_configure_rejects_invalid_options_with_reason(command_line, words, said):
    assert said in command_line.refused("configure", *words)
