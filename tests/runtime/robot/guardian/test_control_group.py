"""What kills the group or the session of a run does not reach its guardian, where the system permits that: real groups,
real kills.
"""

import os
import signal
import time
from contextlib import suppress

import pytest

from runtime.robot.guardian import control_group
from tests.forking import exit_code, fork
from tests.runtime.robot.guardian.bus import Bus, assert_nothing_is_left, guardian_of
from tests.runtime.robot.guardian.test_stopping import DEATH
from tests.runtime.stuck import family
from tests.soaking import soaked

pytestmark = pytest.mark.paced


@pytest.fixture
def bus(tmp_path):
    with Bus(tmp_path, number=8) as bus:
        yield bus


@pytest.fixture
def group():
    """A control group like that of a systemd unit, which is killed as a whole."""
    top = control_group.hierarchy()
    if top is None:
        pytest.skip("this system has no control groups of version 2")
    group = top / f"tickwork-test-{os.getpid()}"
    try:
        group.mkdir()
    except OSError as error:
        pytest.skip(f"control groups cannot be made here: {error.strerror}")
    if not (group / "cgroup.kill").exists():
        group.rmdir()
        pytest.skip("this kernel has no cgroup.kill (Linux 5.14)")
    yield group
    (group / "cgroup.kill").write_text("1")
    deadline = time.monotonic() + 5.0
    while group.exists() and time.monotonic() < deadline:
        with suppress(OSError):
            group.rmdir()
        time.sleep(0.01)
    assert not group.exists()


def inside(group):
    """Options of a process that starts in a group."""
    return {"preexec_fn": lambda: (group / "cgroup.procs").write_text(str(os.getpid()))}


def groups_of_guardians():
    return {path.name for path in control_group.hierarchy().glob(f"**/{control_group.PREFIX}*")}


def test_the_guardian_outlives_its_runs_control_group_stops_the_motors_and_leaves_no_group_behind(bus, group):
    process = bus.start("--no-record", **inside(group))
    bus.await_torque()
    guardian, everybody = guardian_of(process), family(process)
    assert control_group.group_of(process.pid) == group.name
    assert control_group.group_of(guardian.pid) == f"{control_group.PREFIX}{guardian.pid}"
    killed = time.time()
    (group / "cgroup.kill").write_text("1")
    bus.listen(0.3)
    _, err = process.communicate(timeout=10)
    assert process.returncode == -signal.SIGKILL and bus.stopped_after(killed) < DEATH
    assert "the control process died after tick" in err and "confirmed by left/knee, right/knee" in err
    assert_nothing_is_left(everybody, bus.channel)
    assert f"{control_group.PREFIX}{guardian.pid}" not in groups_of_guardians()


def test_the_guardian_outlives_the_process_group_of_its_run(bus):
    process = bus.start("--no-record", start_new_session=True)
    bus.await_torque()
    killed = time.time()
    os.killpg(process.pid, signal.SIGKILL)
    bus.listen(0.3)
    process.communicate(timeout=10)
    assert bus.stopped_after(killed) < DEATH


@pytest.mark.parametrize("guardian_is_killed", soaked([False, True], but=[1]))
def test_a_run_that_ends_removes_the_group_of_its_guardian(bus, group, guardian_is_killed):
    process = bus.start("--no-record", "--duration", "60", **inside(group))
    bus.await_torque()
    guardian = guardian_of(process)
    if guardian_is_killed:
        guardian.kill()
    else:
        process.send_signal(signal.SIGTERM)
    out, err = process.communicate(timeout=10)
    assert process.returncode == (3 if guardian_is_killed else 128 + signal.SIGTERM), out + err
    assert f"{control_group.PREFIX}{guardian.pid}" not in groups_of_guardians()


@pytest.mark.soak
def test_the_pre_flight_table_lists_the_privileges_of_the_guardian(bus, group):
    process = bus.start("--no-record", "--duration", "0.1", **inside(group))
    out, err = process.communicate(timeout=20)
    assert process.returncode == 0, err
    assert "  guardian  own control group, " in out + err


def in_a_child(group, action):
    """What a child process that starts in a group returns of an action, as its exit status."""

    def work():
        (group / "cgroup.procs").write_text(str(os.getpid()))
        return action()

    return exit_code(fork(work))


def test_control_group_is_separate_and_removed_after_process_ends(group):
    def action():
        own, came_from = control_group.enter()
        outside = came_from == group and own.parent == group.parent and control_group.group_of("self") == own.name
        control_group.leave(own, came_from)
        return 0 if outside and not own.exists() and control_group.group_of("self") == group.name else 1

    assert in_a_child(group, action) == 0


def test_a_control_group_left_by_a_guardian_is_removed_by_the_next(group):
    stale = group.parent / f"{control_group.PREFIX}{2**22 + 1}"  # beyond every process number
    stale.mkdir()

    def action():
        control_group.leave(*control_group.enter())
        return int(stale.exists())

    assert in_a_child(group, action) == 0


@pytest.mark.skipif(os.geteuid() != 0, reason="needs root, to give it up")
def test_a_user_without_permission_stays_in_the_group_of_the_run(group):
    def action():
        os.setuid(65534)
        return int(control_group.enter() is not None or control_group.group_of("self") != group.name)

    assert in_a_child(group, action) == 0


@pytest.mark.skipif(os.geteuid() != 0, reason="needs root, to give it up")
def test_the_guardian_leaves_the_scope_of_the_run_if_control_groups_are_delegated(group):
    """As below user@UID.service: the user owns the folder, its list of processes, and the scope in it."""
    scope = group / "run.scope"
    scope.mkdir()
    for path in (group, group / "cgroup.procs", group / "cgroup.subtree_control", scope, scope / "cgroup.procs"):
        os.chown(path, 65534, 65534)

    def action():
        os.setuid(65534)
        own, came_from = control_group.enter()
        outside = (
            own.parent == group and came_from == scope and control_group.group_of("self") == f"{group.name}/{own.name}"
        )
        control_group.leave(own, came_from)
        return 0 if outside and not own.exists() else 1

    try:
        assert in_a_child(scope, action) == 0
    finally:
        scope.rmdir()


def test_without_permission_the_guardian_stays_in_its_control_group(tmp_path, monkeypatch):
    (tmp_path / "system.slice" / "robot.service").mkdir(parents=True)
    monkeypatch.setattr(control_group, "hierarchy", lambda: tmp_path)  # folders without cgroup.procs
    monkeypatch.setattr(control_group, "group_of", lambda process: "system.slice/robot.service")
    assert control_group.enter() is None
    monkeypatch.setattr(control_group, "group_of", lambda process: None)
    assert control_group.enter() is None
    assert sorted(path.name for path in tmp_path.glob("**/*")) == ["robot.service", "system.slice"]
