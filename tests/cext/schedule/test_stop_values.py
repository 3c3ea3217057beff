"""What confirms a safe stop: values in replies to it, for drives of every family that are not as they should be.

In virtual time, on in-memory buses, with the drives of tests.own_drives. The run commands every 5 ms.
"""

import random

import pytest

from graph import Diagram
from tests.cext.rigs import Rig
from tests.own_drives import FAMILIES, OwnDrive, Wired
from tests.soaking import crossed

RATE, PLANT = 200, 2000
COMMANDS = {name: RATE for name in FAMILIES}
HOLDS = (0.5, 2.0, 5.0)
PERIODIC = ("v3", "v3 reports", "servo")


def robot_with(names, rate=RATE, **options):
    """A robot with a drive of each family, each on its own bus. options : of the blocks"""
    with Diagram("robot", rate=rate) as robot:
        for index, name in enumerate(names):
            family = FAMILIES[name]
            drive = family.block(
                family.model, can_id=1, bus=f"bus{index}", name=f"drive{index}", **family.options | options
            )
            drive(**{family.names[0]: 1.0})
    return robot


def run(name, drives, ticks=20, block=None, wired=None, rate=RATE, **options):
    """Run a robot with the block of a family, and these drives on its bus. Returns the Outcome and the Rig.

    block : its options; wired : those of Wired
    """
    robot = robot_with([name], rate, **block or {})
    with Diagram("plant", rate=PLANT) as plant:
        wire = Wired(drives, PLANT, **wired or {}, name="drives")
    rig = Rig(robot, plant)
    wire.end = rig.buses["bus0"].device
    outcome = rig.run(ticks, **{"fade": 0.0} | options)
    return outcome, rig


def own(name, **options):
    """A drive of a family. A family that reports by itself does so at 200 Hz by default."""
    default = {"reports": 200.0} if name in ("servo", "v3 reports") else {}
    return OwnDrive(FAMILIES[name], **default | options)


@pytest.mark.hazard("H9d")
@pytest.mark.parametrize("name, times, hold", crossed(FAMILIES, [1, 2, 5, 10], HOLDS))
def test_a_drive_that_misses_the_stop_and_reports_by_itself_is_not_confirmed(name, times, hold):
    always = name in ("v3 reports", "servo")  # more often than it states is another drive
    rate = min(times * RATE, 500.0) if always else times * RATE
    drive = own(name, hold=hold, misses_stop=True, reports=rate)
    outcome, rig = run(name, [drive], block={"report_rate": rate} if always else None)
    assert drive.deaf and drive.torque == hold
    assert outcome.unconfirmed == ("drive0",)


@pytest.mark.parametrize("times", [1, 2, 5, 10])
@pytest.mark.parametrize("name", [name for name in FAMILIES if name not in PERIODIC])
def test_reports_of_no_torque_by_a_drive_that_misses_the_stop_confirm_nothing(name, times):
    """They do not stop when the questions do. In V3 the answer to the disable is missing."""
    drive = own(name, hold=5.0, reported=0.0, misses_stop=True, reports=times * RATE)
    outcome, _ = run(name, [drive])
    assert drive.deaf and outcome.unconfirmed == ("drive0",)


def test_reports_of_no_torque_without_an_answer_to_the_disable_confirm_nothing():
    drive = own("v3 reports", hold=5.0, reported=0.0, misses_stop=True)
    outcome, _ = run("v3 reports", [drive])
    assert drive.deaf and outcome.unconfirmed == ("drive0",)


@pytest.mark.hazard("H9d")
@pytest.mark.parametrize("hold", HOLDS)
@pytest.mark.parametrize("name", FAMILIES)
def test_a_drive_that_answers_the_stop_and_keeps_its_torque_is_not_confirmed(name, hold):
    outcome, _ = run(name, [own(name, hold=hold)])
    assert outcome.unconfirmed == ("drive0",)


@pytest.mark.parametrize("before", [False, True], ids=["after", "before"])
@pytest.mark.parametrize("name", FAMILIES)
def test_a_healthy_drive_is_confirmed_within_four_rounds(name, before):
    """Also one that packs its reply before it unpacks the command: its replies are one command old."""
    drive = own(name, before=before)
    outcome, rig = run(name, [drive])
    assert (outcome.status, outcome.unconfirmed) == ("ok", ()) and drive.torque == 0.0
    stops = [now for now, kind in drive.heard if kind in ("zero", "disable") and now > 100_000_000]
    assert len({now // 1_000_000 for now in stops}) <= 4
    assert stops[-1] - stops[0] <= 20_000_000


@pytest.mark.parametrize("name, delay", crossed(FAMILIES, [0.008, 0.016, 0.030]))
def test_a_healthy_drive_with_late_replies_is_confirmed_within_the_limit(name, delay):
    drive = own(name)
    outcome, _ = run(name, [drive], ticks=60, wired={"transit": lambda: round(delay * 1e9)})
    assert (outcome.status, outcome.unconfirmed) == ("ok", ()) and drive.torque == 0.0


@pytest.mark.parametrize("name, rate", crossed(FAMILIES, [100, 200, 500, 1000]))
def test_a_healthy_drive_with_random_transits_runs_and_is_confirmed(name, rate):
    """Of at most 5 ms in each direction, in the order in which the frames were sent."""
    for seed in range(5):
        chance = random.Random(seed)
        ways = {"transit": lambda: chance.randrange(5_000_000), "there": lambda frame: chance.randrange(5_000_000)}
        drive = own(name)
        outcome, _ = run(name, [drive], ticks=100, rate=rate, wired=ways | {"in_order": True})
        assert (outcome.status, outcome.unconfirmed) == ("ok", ()) and drive.torque == 0.0, seed


@pytest.mark.parametrize("name", ["robstride", "robstride reports"])
def test_a_disable_that_the_enable_overtakes_ends_the_run(name):
    """No bus does that. The drive is disabled, as it reports, while the loop commands torque."""
    family = FAMILIES[name]
    drive = own(name)
    late = {"disable": 30_000_000}
    ways = {"there": lambda frame: late.get(family.kind(*frame[:3], 1), 0)}
    outcome, _ = run(name, [drive], ticks=100, wired=ways)
    assert outcome.status == "device fault" and (drive.torque, drive.enabled) == (0.0, False)


@pytest.mark.parametrize("name", FAMILIES)
def test_a_healthy_drive_with_lost_replies_is_confirmed_within_the_limit(name):
    chance = random.Random(7)
    block = {"restart_time": 0.1} if name in PERIODIC else {}  # three lost reports in a row may be a restart
    for _ in range(10):
        lossy = {"lost": lambda: chance.random() < 0.1}
        outcome, _ = run(name, [own(name)], ticks=60, wired=lossy, block=block)
        assert (outcome.status, outcome.unconfirmed) == ("ok", ())


@pytest.mark.parametrize("delay", [0.008, 0.016, 0.030])
@pytest.mark.parametrize("name", ["mit", "robstride", "robstride mit"])
def test_late_replies_to_earlier_commands_confirm_nothing(name, delay):
    """The drive misses the stop and reports no torque: only replies to earlier commands arrive after its begin."""
    drive = own(name, hold=5.0, reported=0.0, misses_stop=True)
    outcome, _ = run(name, [drive], ticks=60, wired={"transit": lambda: round(delay * 1e9)})
    assert drive.deaf and outcome.unconfirmed == ("drive0",)


BURSTS = [0.005, 0.008, 0.016, 0.020, 0.032]
FROM = [0.0, 0.0023, 0.0049, 0.0121]  # s, of a burst relative to a tick


def bursts(burst, start):
    """Options of Wired for an adapter with a latency timer of `burst` s."""
    return {"burst": round(burst * 1e9), "burst_from": round(start * 1e9)}


@pytest.mark.parametrize("name, burst, start", crossed(FAMILIES, BURSTS, FROM))
def test_a_healthy_drive_behind_an_adapter_that_delivers_in_bursts_is_confirmed_within_the_limit(name, burst, start):
    drive = own(name)
    block = {"restart_time": 0.0} if name in PERIODIC else {}  # otherwise a burst ends the run
    outcome, _ = run(name, [drive], ticks=60, block=block, wired=bursts(burst, start))
    assert (outcome.status, outcome.unconfirmed) == ("ok", ()) and drive.torque == 0.0


def confirmed_by_bursts(name, burst, start, reports, reported):
    """Whether a drive that misses the stop is confirmed. reports : Hz"""
    block = {"restart_time": 0.0} if name in PERIODIC else {}
    if name in ("v3 reports", "servo"):
        reports = min(reports, 500.0)
        block |= {"report_rate": reports, "timeout": 0.2}
    drive = own(name, hold=5.0, reported=reported, misses_stop=True, reports=reports)
    outcome, _ = run(name, [drive], ticks=60, block=block, wired=bursts(burst, start))
    assert drive.deaf
    return outcome.unconfirmed != ("drive0",)


REPORTS = [50.0, 100.0, 125.0, 200.0, 400.0, 1000.0]  # Hz
# N·m, by a drive that keeps its torque. Servo mode has no answer to the disable: reports at rest are all there is
REPORTED = [(name, reported) for name in FAMILIES for reported in (None, 0.0) if (name, reported) != ("servo", 0.0)]


@pytest.mark.hazard("H9d")
@pytest.mark.parametrize("drive, burst", crossed(REPORTED, BURSTS))
def test_bursts_of_reports_by_a_drive_that_misses_the_stop_confirm_nothing(drive, burst):
    """One start of the bursts for each rate of reports, each start in turn."""
    name, reported = drive
    first = BURSTS.index(burst)
    for number, reports in enumerate(REPORTS):
        start = FROM[(first + number) % len(FROM)]
        assert not confirmed_by_bursts(name, burst, start, reports, reported), (start, reports)


@pytest.mark.soak
@pytest.mark.parametrize("burst", BURSTS)
@pytest.mark.parametrize("name, reported", REPORTED)
def test_bursts_of_reports_confirm_nothing_wherever_they_start(name, reported, burst):
    for start in FROM:
        for reports in REPORTS:
            assert not confirmed_by_bursts(name, burst, start, reports, reported), (start, reports)


@pytest.mark.hazard("H9d")
@pytest.mark.parametrize("name, burst", crossed([name for name in FAMILIES if name not in PERIODIC], [0.0, *BURSTS]))
def test_frames_of_another_node_do_not_confirm_a_dead_drive(name, burst):
    """The drive loses its power in the stop; another node sends what its replies look like, with any period."""
    family = FAMILIES[name]
    for period in (0.0025, 0.004, 0.005, 0.008, 0.010, 0.016, 0.02, 0.05):
        dead = own(name, misses_stop=True)
        imposter = OwnDrive(family, reports=1.0 / period)
        imposter.deaf = True
        imposter.due = 10**12

        class Late(Wired):
            def step(self, tick):
                if dead.deaf and imposter.due == 10**12:
                    imposter.due = tick * self.period
                return super().step(tick)

        robot = robot_with([name])
        with Diagram("plant", rate=PLANT) as plant:
            wired = Late([dead, imposter], PLANT, **bursts(burst, 0.0023), name="drives")
        rig = Rig(robot, plant)
        wired.end = rig.buses["bus0"].device
        outcome = rig.run(20, fade=0.0)
        assert dead.deaf and outcome.unconfirmed == ("drive0",), period


def test_replies_from_two_ids_are_not_of_one_drive():
    """MIT mode: a drive answers from its id or from 0, not from both."""

    class Mixed(OwnDrive):
        count = 0

        def hear(self, *frame):
            frames = super().hear(*frame)
            self.count += len(frames)
            return [frame._replace(identifier=0) if self.count % 2 else frame for frame in frames]

    outcome, _ = run("mit", [Mixed(FAMILIES["mit"])])
    assert outcome.unconfirmed == ("drive0",)
