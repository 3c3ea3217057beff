"""Blocks that take away what the run itself needs: its file descriptors, its limits, its root folder, its account.

Real processes. Whatever a block does, the motors are stopped, and the report names the cause without a traceback of
this program.
"""

import re
import signal
import textwrap

import pytest

from tests.runtime.robot.guardian.bus import Bus, assert_nothing_is_left, is_torque
from tests.runtime.runs import DISABLE, Files
from tests.runtime.stuck import family
from tests.soaking import soaked

pytestmark = pytest.mark.paced

STOP = 0.12  # s from the last torque to the last drive's stop, on a machine that may be busy

FIND_GUARDIAN = """
children = open(f"/proc/self/task/{os.getpid()}/children").read().split()
[guardian] = [int(pid) for pid in children if open(f"/proc/{pid}/comm").read().strip() == "tickwork-guard"]
"""
EXHAUST = """
kept = []
try:
    while True:
        kept.append(os.open("/dev/null", os.O_RDONLY))
except OSError:
    globals()["kept"] = kept
"""
REPLACE = """
other = os.open("/dev/null", os.O_RDWR)
for number in map(int, os.listdir("/proc/self/fd")):
    if number > 2 and number != other:
        try:
            os.dup2(other, number, inheritable=False)
        except OSError:
            pass
"""
FULL = "resource.setrlimit(resource.RLIMIT_NOFILE, (64, 64))" + EXHAUST
CLOSE = "os.closerange({first}, 4096)"


@pytest.fixture
def bus(tmp_path):
    with Bus(tmp_path, number=11) as bus:
        yield bus


def misled(bus, deed, *words, allowed=STOP):
    """A run with a block that does something once, in tick 40 or the next that is not skipped.

    Returns (its process, standard output, standard error).
    """
    lines = ["import os, resource, signal, sys", "", "", "def do():", textwrap.indent(deed, "    "), ""]
    (bus.folder / "deed.py").write_text("\n".join(lines))
    blocks = "import os, sys\nsys.path[:0] = [os.path.dirname(__file__)]\nimport deed\n\ndone = []\n\n\n"
    blocks += "def once():\n    if not done:\n        done.append(True)\n        deed.do()\n"
    process = bus.start("--record", "out", *words, law="if tick >= 40: once()", blocks=blocks)
    bus.await_torque()
    everybody = family(process)
    assert bus.listen(5.0, lambda frame: frame.data == DISABLE) is not None, "the drives were never stopped"
    out, err = process.communicate(timeout=20)
    bus.listen(0.1)
    assert bus.stopped_after(max(frame.time for frame in bus.frames if is_torque(frame))) < allowed
    assert "Traceback" not in err and "lost sys.stderr" not in err, err
    assert_nothing_is_left(everybody, bus.channel)
    return process, out, err


@pytest.mark.parametrize("deed", soaked([CLOSE.format(first=3), REPLACE, CLOSE.format(first=3) + "\n" + FULL], but=[1]))
def test_a_block_that_closes_the_descriptors_of_the_run_ends_it_at_once_and_is_reported(bus, deed, tmp_path):
    process, _, err = misled(bus, deed)
    assert process.returncode == 3
    assert re.search(
        r"FAULT at knees, tick [4-9]\d .*: stopped by the guardian, because the control process has closed", err
    )
    assert "  file descriptors of the run were closed or replaced: the orders to the guardian, the answers of" in err
    assert "tickwork guardian: the control process has closed its connection to the guardian after tick " in err
    assert "confirmed by left/knee, right/knee" in err
    assert Files(tmp_path / "out").sidecar["last_tick"] < 100


@pytest.mark.parametrize(
    "deed",
    soaked(
        [
            CLOSE.format(first=0),
            "sys.stdout.close(); sys.stderr.close(); sys.stdin.close()",
            "sys.stdout = sys.stderr = None; raise OSError(5)",
            "sys.stdout = sys.stderr = open('/dev/full', 'w'); raise OSError(5)",
        ],
        but=[0],
    ),
)
def test_a_block_that_closes_the_standard_streams_does_not_change_the_end_of_the_run(bus, deed, tmp_path):
    process, _, _ = misled(bus, deed, "--duration", "0.5")
    assert process.returncode == (0 if deed.startswith("sys.stdout.close") else 3)
    assert Files(tmp_path / "out").sidecar["last_tick"] < 100


TAKEN = {
    "no descriptor is free": FULL,
    "no descriptor is allowed": "resource.setrlimit(resource.RLIMIT_NOFILE, (0, 1024))",
    "another root folder": "os.mkdir('empty'); os.chroot('empty')",
    "another account": "os.setgroups([]); os.setgid(65534); os.setuid(65534)",
    "an exception": "raise OSError(5)",
}


@pytest.mark.hazard("H8f")
@pytest.mark.parametrize(
    "by, what",
    # a process of another account cannot end a guardian of root that is suspended
    soaked(
        [(by, what) for by in ("SIGKILL", "SIGSTOP") for what in TAKEN if (by, what) != ("SIGSTOP", "another account")],
        but=[7],
    ),
)
def test_the_run_stops_the_motors_after_the_death_of_its_guardian_whatever_a_block_has_done(bus, by, what):
    """The guardian ends at the time of the deed, so that the control process itself reaches the drives."""
    allowed = STOP + (0.1 if by == "SIGSTOP" else 0.0)
    process, out, err = misled(bus, f"{FIND_GUARDIAN}os.kill(guardian, signal.{by})\n{TAKEN[what]}", allowed=allowed)
    assert process.returncode == 3
    if what == "an exception":
        assert "its step raised an exception" in err
    else:
        assert "the guardian does not respond" in err and "; the control process stopped the motors\n" in err
    assert "zero torque, then disable: confirmed by left/knee, right/knee" in out


@pytest.mark.parametrize(
    "deed",
    soaked(
        [
            FULL,
            "os.chdir('/proc')",
            "os.umask(0o777)",
            "resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))",
            "resource.setrlimit(resource.RLIMIT_NPROC, (0, 0))",
            "signal.signal(signal.SIGCHLD, signal.SIG_IGN)",
            "os.setgroups([]); os.setgid(65534); os.setuid(65534)",
        ],
        but=[2],
    ),
)
def test_a_run_ends_as_usual_whatever_limit_a_block_has_lowered(bus, deed, tmp_path):
    process, out, err = misled(bus, deed, "--duration", "0.5")
    assert process.returncode == 0, err
    assert "zero torque, then disable: confirmed by left/knee, right/knee" in out
    assert Files(tmp_path / "out").sidecar["last_tick"] > 90


@pytest.mark.parametrize(
    "deed, status",
    soaked(
        [
            ("os.execv('/bin/sleep', ['sleep', '0.2'])", 0),
            ("if os.fork(): os._exit(0)\nos.setsid()\nos.closerange(0, 4096)\nos._exit(0)", 0),
            (
                "import ctypes\n"
                "for line in open('/proc/self/maps'):\n"
                "    if 'memfd:tickwork' in line:\n"
                "        first, last = (int(end, 16) for end in line.split()[0].split('-'))\n"
                "        ctypes.CDLL(None).munmap(ctypes.c_void_p(first), ctypes.c_size_t(last - first))",
                -signal.SIGSEGV,
            ),
        ],
        but=[0, 2],
    ),
)
def test_the_guardian_stops_the_motors_of_a_process_that_is_no_longer_the_run(bus, deed, status):
    process, _, err = misled(bus, deed)
    assert process.returncode == status
    assert "tickwork guardian: the " in err and "confirmed by left/knee, right/knee" in err
