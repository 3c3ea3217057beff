"""Real-time settings that the system grants or refuses a loop, and their report: in real processes, with and without
privilege.
"""

import ctypes
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from runtime.host.errors import BAD_INPUT, OK
from runtime.host.machine.realtime import Realtime, number_list
from runtime.host.system import capable, isolated_processors, processors
from tests.runtime.runs import ROOT, Files, environment, finished, knee

pytestmark = pytest.mark.timing

ROOT_USER = os.geteuid() == 0
as_root = pytest.mark.skipif(not ROOT_USER, reason="needs the privileges that root has")
with_two_processors = pytest.mark.skipif(len(os.sched_getaffinity(0)) < 2, reason="needs two processors")
raising_limits = pytest.mark.skipif(not capable(24), reason="needs the privilege to raise limits (CAP_SYS_RESOURCE)")
SCHED_FIFO_FOR_US_ALONE = os.SCHED_FIFO | os.SCHED_RESET_ON_FORK

PRELUDE = '''
import json, os, resource, signal, subprocess, sys, time

from cext.clock import realtime as system
from runtime.host.machine.realtime import Realtime, RealtimeRefused


def status(name):
    with open("/proc/self/status") as file:
        return next(line.split()[1] for line in file if line.startswith(name + ":"))


def state():
    """All that a grant may change."""
    kinds = resource.RLIMIT_RTPRIO, resource.RLIMIT_MEMLOCK, resource.RLIMIT_RTTIME
    limits = [resource.getrlimit(kind) for kind in kinds]
    return [
        os.sched_getscheduler(0), os.sched_getparam(0).sched_priority, sorted(os.sched_getaffinity(0)), status("VmLck"),
        system.timer_slack(), system.slice_length(), limits, len(os.listdir("/proc/self/fd")), status("SigCgt")]


def limit(rtprio, memlock):
    resource.setrlimit(resource.RLIMIT_RTPRIO, rtprio)
    resource.setrlimit(resource.RLIMIT_MEMLOCK, memlock)


def be_nobody():
    if os.geteuid() == 0:
        os.setgroups([])
        os.setresgid(65534, 65534, 65534)
        os.setresuid(65534, 65534, 65534)
'''


def told(code, *arguments):
    """What a process prints as JSON that runs PRELUDE and then `code`."""
    process = subprocess.run(
        [sys.executable, "-c", PRELUDE + code, *map(str, arguments)],
        env=environment(),
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=30,
    )
    assert process.returncode == 0, process.stderr
    return json.loads(process.stdout)


@as_root
def test_root_is_granted_every_request_and_all_are_released():
    before, during, lines, after = told("""
before = state()
realtime = Realtime("require", priority=70, cpu=0)
realtime.obtain()
during = state()
realtime.release()
realtime.release()
print(json.dumps([before, during, realtime.lines(), state()]))
""")
    assert during[:3] == [SCHED_FIFO_FOR_US_ALONE, 70, [0]]
    assert int(during[3]) > 10_000  # KiB, locked
    assert during[6][2][0] == 500_000  # µs without a sleep
    assert before[3] == "0" and before[0] == os.SCHED_OTHER
    assert after == before
    awake = ", processors awake" if os.path.exists("/dev/cpu_dma_latency") else ""
    isolated = " (isolated)" if 0 in isolated_processors() else ""
    assert lines == [f"realtime: timer slack 1 ns, memory locked{awake}, SCHED_FIFO 70, processor 0{isolated}"]


@as_root
def test_settings_are_restored_after_exception():
    before, during, after = told("""
before = state()
try:
    with Realtime("try"):
        during = state()
        raise KeyError
except KeyError:
    print(json.dumps([before, during, state()]))
""")
    assert during[:2] == [SCHED_FIFO_FOR_US_ALONE, 80] and after == before


@as_root
def test_children_inherit_neither_the_priority_nor_the_lock():
    assert told('''
with Realtime("require"):
    subprocess.run([sys.executable, "-c", """
import json, os
with open("/proc/self/status") as file:
    print(json.dumps([os.sched_getscheduler(0), next(line.split()[1] for line in file if line.startswith("VmLck:"))]))
"""])
''') == [os.SCHED_OTHER, "0"]


@as_root
def test_the_previous_priority_is_restored():
    before, during, after = told("""
os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(5))
before = state()
with Realtime("try"):
    during = state()
print(json.dumps([before, during, state()]))
""")
    assert before[:2] == [os.SCHED_RR, 5] and during[:2] == [SCHED_FIFO_FOR_US_ALONE, 80] and after == before


@as_root
def test_spinning_loop_loses_priority_and_continues():
    seconds, before, after, spun, summary = told("""
before = state()
with Realtime("try") as realtime:
    began = time.monotonic()
    while os.sched_getscheduler(0) & os.SCHED_FIFO and time.monotonic() < began + 5:
        pass
    seconds = time.monotonic() - began
print(json.dumps([seconds, before, state(), realtime.spun, realtime.summary()]))
""")
    assert seconds == pytest.approx(0.5, abs=0.3)
    assert spun and "SCHED_FIFO 80" in summary and summary.endswith("; LOST its priority: 0.5 s without a sleep")
    assert after == before


@as_root
def test_a_loop_that_sleeps_keeps_its_priority():
    scheduler, spun = told("""
with Realtime("try") as realtime:
    for _ in range(8):
        until = time.monotonic() + 0.1
        while time.monotonic() < until:
            pass
        time.sleep(0.001)
    scheduler = os.sched_getscheduler(0)
print(json.dumps([scheduler, realtime.spun]))
""")
    assert (scheduler, spun) == (SCHED_FIFO_FOR_US_ALONE, False)


def test_refused_settings_are_reported_with_remedy():
    before, lines, names, after = told("""
limit((0, 0), (1 << 20, 1 << 20))
be_nobody()
before = state()
with Realtime("try") as realtime:
    pass
print(json.dumps([before, realtime.lines(), sorted(realtime.metadata()["refused"]), state()]))
""")
    text = "\n".join(lines)
    assert lines[0].startswith("realtime: granted timer slack 1 ns; NOT granted locked memory, ")
    assert {"SCHED_FIFO 80", "locked memory"} <= set(names)
    assert "  SCHED_FIFO 80: the rtprio limit of " in text and " is 0\n" in text
    assert " - rtprio 90` into /etc/security/limits.d/90-tickwork.conf and log in again" in text
    assert "the memlock limit of " in text and " is 1 MiB, and " in text and " - memlock unlimited`" in text
    if "awake processors" in names:
        assert (
            "  awake processors: /dev/cpu_dma_latency: Permission denied\n" in text
            and 'KERNEL=="cpu_dma_latency"' in text
        )
    assert lines[-1].endswith("doctor --script")
    assert after == before


def test_run_without_real_time_priority_reports_risk():
    realtime = Realtime("off")
    assert len(realtime.risk()) == 1 and "ticks are then lost" in realtime.risk()[0]
    realtime.granted.append("SCHED_FIFO 80")
    assert realtime.risk() == []


def test_a_denied_required_request_releases_all_others():
    refused, before, after = told("""
limit((0, 0), (1 << 20, 1 << 20))
be_nobody()
before = state()
try:
    Realtime("require").obtain()
except RealtimeRefused as error:
    print(json.dumps([str(error), before, state()]))
""")
    assert refused.startswith("--realtime require: not granted: locked memory, ") and "; nothing was armed\n" in refused
    assert after == before


@raising_limits
def test_user_limits_are_sufficient_without_privileges():
    """What `doctor --script` sets up: an ordinary user, with the limits and nothing else."""
    before, during, granted, after = told("""
forever = resource.RLIM_INFINITY
limit((0, 90), (1 << 16, forever))                                          # to be raised by whoever needs it
be_nobody()
before = state()
with Realtime("try") as realtime:
    during = state()
print(json.dumps([before, during, realtime.granted, state()]))
""")
    assert {"memory locked", "SCHED_FIFO 80"} <= set(granted)
    assert during[:2] == [SCHED_FIFO_FOR_US_ALONE, 80]
    assert during[6][:2] == [[90, 90], [-1, -1]]
    assert after[0] & ~os.SCHED_RESET_ON_FORK == os.SCHED_OTHER  # the flag cannot be taken back without privilege
    assert after[1:] == before[1:]


@raising_limits
def test_a_memlock_limit_without_headroom_is_not_enough():
    """Beyond the limit a locked process gets no memory at all."""
    assert "locked memory" in told("""
size = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
limit((0, 0), (size + (1 << 20),) * 2)
be_nobody()
with Realtime("try") as realtime:
    print(json.dumps(realtime.metadata()["refused"]))
""")


@as_root
def test_a_control_group_without_real_time_budget_is_reported():
    groups = Path("/sys/fs/cgroup/cpu")
    if not (groups / "cpu.rt_runtime_us").exists():
        pytest.skip("needs control groups that divide real-time")
    group = groups / f"tickwork-test-{os.getpid()}"
    group.mkdir()
    try:
        lines = told(
            """
with open(sys.argv[1] + "/tasks", "w") as tasks:
    tasks.write(str(os.getpid()))
with Realtime("try") as realtime:
    print(json.dumps(realtime.lines()))
""",
            group,
        )
    finally:
        group.rmdir()
    assert lines[1] == f"  SCHED_FIFO 80: its control group has no real-time budget: {group}/cpu.rt_runtime_us is 0"
    assert f"sudo tee {group}/cpu.rt_runtime_us" in lines[2] and "kernel.sched_rt_runtime_us=-1" in lines[2]


def test_a_processor_that_does_not_exist_is_refused_by_number():
    realtime = Realtime("try", cpu=4000)
    before = os.sched_getaffinity(0)
    with realtime:
        assert os.sched_getaffinity(0) == before
    assert f"  processor 4000: this process may only run on {number_list(before)}" in realtime.lines()


def test_realtime_off_sets_and_restores_only_timer_slack_and_slice():
    before, during, lines, after = told("""
open("/proc/self/timerslack_ns", "w").write("50000")                    # a parent's may be another
before = state()
with Realtime() as realtime:
    during = state()
print(json.dumps([before, during, realtime.lines(), state()]))
""")
    assert (before[4], during[4]) == (50_000, 1)  # ns
    assert during[5] == (100_000 if before[5] else 0)
    assert during[:4] == before[:4] and lines == [] and after == before


def test_an_unknown_mode_or_priority_is_rejected():
    for mode, priority in (("perhaps", 80), ("try", 99), ("try", 0)):
        with pytest.raises(ValueError, match="a priority of 1 to 98"):
            Realtime(mode, priority)


@pytest.mark.parametrize("text, found", [("", set()), ("\n", set()), ("3\n", {3}), ("0,2-4,7\n", {0, 2, 3, 4, 7})])
def test_processors_as_the_kernel_writes_them(text, found):
    assert processors(text) == found


def test_options_that_do_not_go_together(command_line):
    refused, file = command_line.refused, knee(command_line.folder)
    assert refused(file, "--realtime", "yes").startswith("argument --realtime: invalid choice: 'yes'")
    assert refused(file, "--realtime", "try", "--priority", "99") == "--priority 99: at most 98"
    assert refused(file, "--realtime", "try", "--priority", "0") == "--priority 0: expected a whole number, 1 or more"
    assert refused(file, "--realtime", "try", "--cpu", "4000").startswith(
        "--cpu 4000: expected the number of a processor; this machine has 0"
    )
    assert refused(file, "--priority", "50") == "--priority needs --realtime try or --realtime require"
    assert refused(file, "--cpu", "0") == "--cpu needs --realtime try or --realtime require"
    assert refused(file, "--realtime", "try", "--fast", "--duration", "1").startswith(
        "--realtime try and --fast exclude each other"
    )


@as_root
def test_granted_settings_apply_and_are_recorded(tmp_path):
    """The block in the loop asks which policy it runs under."""
    knee(tmp_path, law="return float(__import__('os').sched_getscheduler(0) & 3)")
    process = finished("robot.py", "--duration", "0.2", "--realtime", "require", cwd=tmp_path)
    assert process.returncode == OK, process.stderr
    assert process.stderr.startswith("realtime: timer slack 1 ns, memory locked")
    assert "\n  realtime    timer slack 1 ns, memory locked" in process.stdout
    files = Files(tmp_path / "recordings")
    assert set(files.table["law.torque [N*m]"]) == {os.SCHED_FIFO}
    realtime = files.sidecar["metadata"]["realtime"]
    assert realtime["mode"] == "require" and "SCHED_FIFO 80" in realtime["granted"] and realtime["refused"] == {}


@with_two_processors
@pytest.mark.parametrize("mode", [pytest.param("require", marks=as_root), "off"])
def test_recorder_and_viewers_leave_one_processor_to_the_loop(tmp_path, mode):
    """The block in the loop asks where its process and those that the process has started may be."""
    knee(
        tmp_path,
        law="""import os, psutil
        here = psutil.Process()
        places = [os.sched_getaffinity(process.pid) for process in (here, *here.children(recursive=True))]
        alike = places[1:] == 2 * [places[1]]
        return 1000.0 * len(places[0]) + 100.0 * len(places[0] - places[1]) + 10.0 * len(places[1]) + 1.0 * alike""",
    )
    process = finished("robot.py", "--duration", "0.2", "--realtime", mode, cwd=tmp_path)
    assert process.returncode == OK, process.stderr
    everywhere = len(os.sched_getaffinity(0))
    loop = 1 if mode == "require" else everywhere
    assert Files(tmp_path / "recordings").table["law.torque [N*m]"][-1] == 1000 * loop + 100 + 10 * (everywhere - 1) + 1


@as_root
@with_two_processors
def test_two_loops_use_two_processors_and_release_them():
    first, second, again = told("""
other = (
    "from runtime.host.machine.realtime import Realtime; realtime = Realtime('try'); "
    "realtime.obtain(); print(*realtime.granted[-1:])"
)
with Realtime("try") as realtime:
    first, others = realtime.granted[-1], realtime.others
    spread = lambda: os.sched_setaffinity(0, others | os.sched_getaffinity(0))
    second = subprocess.run(
        [sys.executable, "-c", other], capture_output=True, text=True, preexec_fn=spread
    ).stdout.strip()
with Realtime("try") as realtime:
    print(json.dumps([first, second, realtime.granted[-1]]))
""")
    assert first.startswith("processor ") and second.startswith("processor ")
    assert first != second and again == first


@as_root
@with_two_processors
def test_a_loop_without_a_processor_of_its_own_is_below_those_that_came_first():
    granted, priority, places, chosen = told("""
from runtime.host.machine.processor import Processor
processors = os.sched_getaffinity(0)
taken = [Processor([number]) for number in processors]
with Realtime("try") as realtime:
    late = realtime.granted, os.sched_getparam(0).sched_priority, os.sched_getaffinity(0) == processors
with Realtime("try", cpu=0) as realtime:
    print(json.dumps([*late, realtime.granted[-2:]]))
""")
    assert granted[-1] == "SCHED_FIFO 78 (below other loops, which have taken every processor)"
    assert "SCHED_FIFO 80" not in granted and priority == 78 and places, "it moves to where it finds time"
    assert [words.partition(" (")[0] for words in chosen] == ["SCHED_FIFO 80", "processor 0"], "the operator decides"


@as_root
def test_temporary_hang_costs_priority_and_is_reported(tmp_path):
    knee(
        tmp_path,
        law="import os\n        while tick >= 20 and os.sched_getscheduler(0) & 3:\n            pass\n"
        "        return float(os.sched_getscheduler(0) & 3)",
    )
    process = finished("robot.py", "--duration", "1", "--realtime", "try", cwd=tmp_path)
    assert "LOST its priority: 0.5 s without a sleep" in process.stdout, process.stderr
    files = Files(tmp_path / "recordings")
    assert [event["lost"] for event in files.sidecar["events"] if event["event"] == "realtime"] == ["the priority"]
    policy = files.table["law.torque [N*m]"]
    assert (policy[0], policy[-1]) == (os.SCHED_FIFO, os.SCHED_OTHER)


def without_privilege(*words, cwd):
    """A run by a user without real-time permission: root without the capabilities for it, or whoever runs the tests."""
    libc, names = ctypes.CDLL(None), (14, 23, 24)  # CAP_IPC_LOCK, CAP_SYS_NICE, CAP_SYS_RESOURCE

    def drop():
        import resource

        resource.setrlimit(resource.RLIMIT_RTPRIO, (0, 0))
        resource.setrlimit(resource.RLIMIT_MEMLOCK, (1 << 16, 1 << 16))
        for capability in names if ROOT_USER else ():
            libc.prctl(24, capability, 0, 0, 0)  # PR_CAPBSET_DROP; the exec that follows obeys it

    return subprocess.run(
        [sys.executable, "-m", "runtime", *words],
        cwd=cwd,
        env=environment(),
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=60,
        preexec_fn=drop,
    )


def test_require_refuses_to_start_and_leaves_no_files(tmp_path):
    knee(tmp_path)
    process = without_privilege("robot.py", "--duration", "0.1", "--realtime", "require", cwd=tmp_path)
    assert (process.returncode, process.stdout) == (BAD_INPUT, "")
    assert process.stderr.startswith("tickwork: --realtime require: not granted: locked memory, ")
    assert "  SCHED_FIFO 80: the rtprio limit of " in process.stderr and "Traceback" not in process.stderr
    assert not (tmp_path / "recordings").exists()


def test_realtime_try_runs_without_refused_settings_and_reports_them(tmp_path):
    knee(tmp_path)
    process = without_privilege("robot.py", "--duration", "0.1", "--realtime", "try", cwd=tmp_path)
    assert process.returncode == OK, process.stderr
    assert "NOT granted locked memory, " in process.stderr and "NOT granted: locked memory, " in process.stdout
    assert "SCHED_FIFO 80" in Files(tmp_path / "recordings").sidecar["metadata"]["realtime"]["refused"]


@as_root
@pytest.mark.timing
def test_locked_loop_has_no_page_faults_and_locks_only_what_it_uses():
    text = """
import numpy as np
import runtime.cli.run  # noqa: F401 the modules of a control process
from cext.schedule.executor import Executor
from cext.schedule.program import Program
from blocks.mathematics import Gain
from blocks.recorders import CsvRecorder
from graph import Block, Diagram, Output, compile

class Faults(Block):
    y = Output("1")

    def step(self):
        usage = resource.getrusage(resource.RUSAGE_THREAD)
        return usage.ru_minflt + usage.ru_majflt

with Diagram("d", rate=500) as diagram:
    Gain(2.0)(Faults(name="faults").y)
    CsvRecorder()
schedule = compile(diagram)
program = Program(schedule, [])
rows = np.zeros((300, 2 + len(schedule.recorded)))

def resident():  # KiB
    return next(int(line.split()[1]) for line in open("/proc/self/status") if line.startswith("VmRSS"))

before = resident()
with Realtime("try") as realtime:
    executor = Executor(program, 500.0, rows=rows)
    realtime.prefault()
    assert executor.run(300).status == "ok"
    brought = resident() - before
recorded = rows[: executor.rows]  # a lost tick has no row
counts = recorded[:, 2 + [column.path for column in schedule.recorded].index("faults.y")]
print(json.dumps([counts[-1] - counts[5], brought, realtime.granted]))
"""
    faults, brought, granted = told(text)
    assert "memory locked" in granted
    assert faults == 0 and brought < 20_000
