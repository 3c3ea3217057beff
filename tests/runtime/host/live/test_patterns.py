"""`*/profile.scale` is both legs: with `--set`, with `set` and with the keys, in one tick, all or nothing."""

import pytest

from cext.schedule.mailbox_writer import CHANGE_LIMIT
from runtime.host.errors import BadInput
from runtime.host.live import patterns
from runtime.host.live.requests import changes_of
from runtime.host.live.sending import batches
from runtime.host.live.table import Parameter, Table
from runtime.record.recorder.panel import choices
from runtime.robot.loading.file import load
from runtime.robot.loading.overrides import set_block_parameters
from tests.runtime.host.live.test_set import going
from tests.runtime.runs import Files, finished, write
from tests.runtime.terminals import Terminal

SCALES = """
from blocks.controllers import TorqueProfile
from blocks.recorders import CsvRecorder
from blocks.sources import Constant
from graph import Diagram, Live, subsystem


def leg(name, scale):
    with subsystem(name):
        TorqueProfile(((0.0, 4.0), (0.5, 4.0)), scale=scale, name="profile")(phase=Constant(0.0, unit="1")())


with Diagram("legs", rate=200) as diagram:
    leg("left", Live(0.5, min=0.0, max=1.0))
    leg("right", Live(0.25, min=0.0, max=0.8))
    CsvRecorder()
"""


def parameter(index, path, low=0.0, high=1.0, dtype="float", unit="1"):
    return Parameter(index, path, dtype, unit, "", 0.5, low, high, 1.0)


LEGS = Table(
    "legs",
    200.0,
    (
        parameter(0, "left/profile.scale"),
        parameter(1, "left/spring.damping"),
        parameter(2, "right/profile.scale", high=0.8),
        parameter(3, "gain.gain"),
    ),
)


def test_a_pattern_selects_every_match_and_a_name_only_itself():
    known = [each.path for each in LEGS.parameters]
    assert patterns.matching("*/profile.scale", known) == ["left/profile.scale", "right/profile.scale"]
    assert patterns.matching("left/*", known) == ["left/profile.scale", "left/spring.damping"]
    assert patterns.matching("gain.gain", known) == ["gain.gain"] and patterns.matching("scale", known) == []


def test_one_rejected_value_rejects_the_whole_pattern():
    assert [value for _, value in changes_of(LEGS, "*/profile.scale", "0.75")] == [0.75, 0.75]
    with pytest.raises(BadInput) as refused:
        changes_of(LEGS, "*/profile.scale", "0.9")
    assert str(refused.value) == "*/profile.scale=0.9: right/profile.scale must be at most 0.8, got 0.9"


def test_a_pattern_that_matches_nothing_is_an_error_with_a_suggestion():
    with pytest.raises(BadInput) as refused:
        changes_of(LEGS, "*/profil.scale", "0.5")
    assert str(refused.value) == (
        "*/profil.scale=0.5: legs has no live parameter '*/profil.scale'; did you mean '*/profile.scale'?"
    )


def test_the_matches_of_one_pattern_are_one_request_if_they_fit():
    groups = [
        [("a", index) for index in range(10)],
        [("b", index) for index in range(8)],
        [("c", index) for index in range(CHANGE_LIMIT + 1)],
    ]
    assert [len(letter) for letter in batches(groups)] == [10, 8, CHANGE_LIMIT, 1]
    assert [len(letter) for letter in batches(groups[:1] * 1 + [[("d", 0)]])] == [11]


def test_keys_list_parameters_shared_by_both_legs_first():
    assert [(name, [each.index for each in found]) for name, found in choices(LEGS.parameters)] == [
        ("*/profile.scale", [0, 2]),
        ("left/profile.scale", [0]),
        ("left/spring.damping", [1]),
        ("right/profile.scale", [2]),
        ("gain.gain", [3]),
    ]
    unlike = (parameter(0, "left/profile.scale"), parameter(1, "right/profile.scale", unit="N·m"))
    assert [name for name, _ in choices(unlike)] == ["left/profile.scale", "right/profile.scale"]


@pytest.fixture
def legs(tmp_path_factory):
    """Folder of legs.py, outside of that of `command_line`, whose files must not change while a run writes its own."""
    folder = tmp_path_factory.mktemp("legs")
    write(folder, SCALES, "legs.py")
    return folder


def test_a_setting_at_the_start_accepts_a_pattern(legs):
    _, diagram = load(legs / "legs.py", [])
    set_block_parameters(diagram, [("*/profile.scale", "0.7")])
    assert diagram["left/profile"].scale == diagram["right/profile"].scale == 0.7
    with pytest.raises(
        BadInput,
        match=r"setting right/profile.scale=0.9: scale: must be between its live bounds 0 and "
        r"0.8, got 0.9",
    ):
        set_block_parameters(diagram, [("*/profile.scale", "0.9")])
    with pytest.raises(BadInput) as refused:
        set_block_parameters(diagram, [("*/profile.scales", "0.5")])
    assert str(refused.value) == (
        "setting */profile.scales=0.5: legs has no parameter that matches; did you mean '*/profile.scale'?"
    )


def test_both_legs_change_in_one_tick_and_ramp_and_the_replay_is_the_same(legs, command_line):
    with going(legs, "legs.py") as run:
        assert command_line.refused("set", run.pid, "*/profile.scale=0.9").endswith(
            "right/profile.scale must be at most 0.8, got 0.9"
        )
        told = finished("set", run.pid, "*/profile.scale=0.75", cwd=legs)
        assert told.returncode == 0, told.stderr
        run.send_signal(2)
        run.communicate(timeout=30)
    files = Files(legs / "recordings")
    left, right = files.sidecar["events"]
    assert (left["path"], right["path"], left["tick"]) == ("left/profile.scale", "right/profile.scale", right["tick"])
    assert (left["slew"], right["slew"]) == (1.0, 0.8), "the whole range of each in a second"
    table = files.table
    row, ticks = list(table["tick"]).index(left["tick"]), table["tick"]
    dt = (ticks[row] - ticks[row - 1]) / 200.0
    assert table["left/profile.torque [N*m]"][row] == pytest.approx(4.0 * min(0.75, 0.5 + 1.0 * dt), abs=1e-9)
    assert table["right/profile.torque [N*m]"][row] == pytest.approx(4.0 * min(0.75, 0.25 + 0.8 * dt), abs=1e-9)
    code, out, err = command_line("replay", files.one(".mcap"))
    assert (code, err) == (0, "") and "the same, bit for bit" in out


def test_one_key_press_changes_both_legs_in_one_tick(legs):
    with Terminal() as terminal:
        terminal.run("legs.py", "--duration", "60", cwd=legs)
        terminal.wait_for(r"running .* \? lists the keys")
        terminal.press(b"\t")
        terminal.wait_for(r"\*/profile\.scale 0\.5, 0\.25 \(0 to 1, 0 to 0\.8\)")
        terminal.press(b"\x1b[A")
        terminal.wait_for(r"\*/profile\.scale 0\.55, 0\.26 ")
        terminal.press(b" ")
        assert terminal.end() == 0
    first, second, _ = Files(legs / "recordings").sidecar["events"]
    assert (first["path"], first["value"], second["path"], second["value"]) == (
        "left/profile.scale",
        0.55,
        "right/profile.scale",
        0.26,
    )
    assert first["tick"] == second["tick"]
