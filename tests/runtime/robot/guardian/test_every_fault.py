"""Whatever ends a run, and on whichever of its buses: real processes, a drive on each of two buses, and a third node on
each that listens.

Every drive receives zero torque, then disable, within two ticks of the detection, and no torque follows on any bus. In
virtual time, with more faults: tests/cext/schedule/test_every_fault.py. Elsewhere, with a third node that listens: a
block that hangs (test_hang), a process that is stopped, a guardian that is gone (test_stopping), an adapter that is
unplugged (tests/runtime/robot/rig/test_slcan), a button over UDP (test_udp), bus-off and an interface that is taken
down (tests/hardware).
"""

import os
import re
import select
import signal
import time
from dataclasses import dataclass

import pytest

from tests.runtime.robot.guardian.bus import Bus, is_torque
from tests.runtime.robot.rig.test_udp import Button, free_port
from tests.runtime.runs import DISABLE, NOTHING, started, write
from tests.runtime.terminals import Terminal
from tests.soaking import soaked

pytestmark = pytest.mark.paced

PERIOD = 0.005
ALLOWANCE = 0.08  # s, on a machine that may be busy; 0.001 where it is not
CONFIRMED = "confirmed by left/knee, right/knee"

ROBOT = '''
import ctypes
import os
import sys
import time

from blocks.actuators import CubeMars
from blocks.limiters import TorqueLimiter
from blocks.safety import EmergencyStop, EStopHeartbeat
from graph import Block, Diagram, Input, Kernel, Output, subsystem


class Law(Block):
    """A steady torque, until something happens."""

    position = Input("rad")
    torque = Output("N·m")
    late = Output("1", dtype=bool)

    def step(self, position, tick):
        {law}
        return {torque}, tick >= 80


@ctypes.CFUNCTYPE(ctypes.c_int, ctypes.POINTER(ctypes.c_double), ctypes.c_void_p, ctypes.c_void_p)
def own_status(arena, slots, sizes):
    return 77 if arena[1] >= 80.0 else 0


class Own(Block):
    """A native kernel with a fault of its own."""

    kernel = Kernel(own_status, "")


{before}


def build():
    with Diagram("knees", rate=200) as diagram:
        for side, can_id in (("left", 1), ("right", 2)):
            with subsystem(side):
                knee = CubeMars(
                    "AK10-9-V2.0", bus=side, can_id=can_id, range=(-12.5, 12.5), wake_shift=0.0, name="knee")
                law = Law(name="law"{options})(knee.position) if side == "left" else None
                knee(torque_command=TorqueLimiter(limit=5.0)(law.torque if law is not None else 1.0))
                if law is not None:
                    {more}
    return diagram
'''


@dataclass(frozen=True)
class Fault:
    """How a fault is injected, and the expected outcome of the run.

    law, torque, before, options, more : of the robot above, where something happens in its tick 80
    act : called with (process, buses) once there is torque on both buses
    words : more of the command line; code : the exit code; said : a pattern of what is shown at the end
    seconds : between the last torque and the detection, at most
    confirmed : by both drives
    """

    said: str
    code: int = 3
    law: str = "pass"
    torque: str = "2.0"
    before: str = ""
    options: str = ""
    more: str = "pass"
    act: object = lambda process, buses: None
    words: tuple = ()
    seconds: float = PERIOD
    confirmed: bool = True


def told(number):
    return lambda process, buses: process.send_signal(number)


def twice(process, buses):
    process.send_signal(signal.SIGINT)
    buses.listen(0.01)
    process.send_signal(signal.SIGINT)


def drive_gets(number):
    return lambda process, buses: buses[0].drives.send_signal(number)


def our_own_frame_again(process, buses):
    """Another controller that sends the same frames."""
    left = buses[0]
    buses.listen(0.8)  # until torque no longer fades in
    left.send(1, bytes.fromhex([frame.data for frame in left.commands(1) if is_torque(frame)][-1]))


SWALLOW = """
def swallow():
    try:
        time.sleep(9.0)
    except KeyboardInterrupt:
        pass
"""
LATE = (
    "the guardian does not respond"  # in time, on a busy machine: its silence is then taken for why a drive is silent
)
AT_80 = r"tick ([89]\d|1\d\d) \(0\.[4-9]\d* s\)"  # a busy machine may skip tick 80
FAULTS = {
    "an exception in a block": Fault(
        f"FAULT at left/law, {AT_80}: its step raised", law="if tick >= 80: raise ValueError('torn')"
    ),
    "a silent drive": Fault(
        f"FAULT at left/knee, .*no reply for longer than its timeout|{LATE}",
        act=drive_gets(signal.SIGSTOP),
        confirmed=False,
    ),
    "a frame of another controller that equals ours": Fault(
        "FAULT at left/knee, .*another node commands it", act=our_own_frame_again
    ),
    "a block that hangs and takes its interruption for itself": Fault(
        f"FAULT at left/law, {AT_80}: it hung", law="tick >= 80 and swallow()", seconds=PERIOD + 0.015, before=SWALLOW
    ),
    "SIGTERM": Fault("stopped by SIGTERM", 143, act=told(signal.SIGTERM)),
}
MORE = {
    "sys.exit in a block": Fault(
        f"FAULT at left/law, {AT_80}: its step exited the program", law="if tick >= 80: sys.exit('enough')"
    ),
    "more exceptions than are held": Fault(
        r"FAULT at left/law, tick ([89]\d|1\d\d) .*its step raised",
        law="if tick >= 80: raise ValueError('torn')",
        options=", hold_exceptions=2",
    ),
    "a status of a native kernel's own": Fault(
        f"FAULT at left/own, {AT_80}: ended with status .kernel status 77.", more="Own(name='own')"
    ),
    "NaN": Fault(f"FAULT at left/knee, {AT_80}: a command is NaN", torque="float('nan') if tick >= 80 else 2.0"),
    "a fault bit": Fault("FAULT at left/knee, .*the device reports a fault", act=drive_gets(signal.SIGUSR1)),
    "a drive that is too hot": Fault(
        "FAULT at left/knee, .*the temperature exceeds its limit", act=drive_gets(signal.SIGALRM)
    ),
    "overruns": Fault(
        "FAULT at .*grid points",
        law="if tick >= 160: time.sleep(0.011)",
        words=("--rate", "400", "--overrun", "fault:3"),
        seconds=0.015,
    ),
    "an emergency stop": Fault(
        f"FAULT at left/stop, {AT_80}: the emergency stop was pressed", more="EmergencyStop(name='stop')(law.late)"
    ),
    "SIGINT": Fault("stopped by Ctrl-C|stopped by SIGINT", 130, act=told(signal.SIGINT)),
    "a second SIGINT": Fault("stopped by Ctrl-C|stopped by SIGINT", 130, act=twice),
    "SIGHUP": Fault("stopped by SIGHUP", 129, act=told(signal.SIGHUP)),
    "SIGSEGV": Fault("the control process died of SIGSEGV", -11, act=told(signal.SIGSEGV), seconds=2 * PERIOD),
    "SIGABRT": Fault("the control process died of SIGABRT", -6, act=told(signal.SIGABRT), seconds=2 * PERIOD),
    "SIGKILL": Fault("the control process died after", -9, act=told(signal.SIGKILL), seconds=2 * PERIOD),
    "SIGSTOP": Fault(
        "the loop has stalled",
        3,
        seconds=0.04 + 2 * PERIOD,
        act=lambda process, buses: (
            process.send_signal(signal.SIGSTOP),
            buses.listen(0.4),
            process.send_signal(signal.SIGCONT),
        ),
    ),
    "the end": Fault(CONFIRMED, 0, words=("--duration", "0.6")),
}


class Buses(list):
    """Two buses, a drive on each."""

    def __init__(self, folder):
        super().__init__(Bus(folder, number=20 + number, motors=(1 + number,)) for number in range(2))
        self.folder = folder
        self.rig = write(
            folder,
            "".join(
                f'[bus.{side}]\ninterface = "udp_multicast"\nchannel = "{bus.channel}"\n'
                for side, bus in zip(("left", "right"), self)
            ),
            "rig.toml",
        )

    def __enter__(self):
        for bus in self:
            bus.__enter__()
        return self

    def __exit__(self, *exception):
        for bus in reversed(self):
            bus.__exit__(*exception)

    def robot(self, fault):
        return write(
            self.folder,
            ROBOT.format(
                law=fault.law, torque=fault.torque, before=fault.before, options=fault.options, more=fault.more
            ),
        )

    def words(self, fault):
        return (self.robot(fault), "--rig", self.rig, "--yes", "--no-record", *fault.words)

    def start(self, fault):
        self[0].runs.append(started(*self.words(fault), cwd=self.folder))
        return self[0].runs[-1]

    def listen(self, seconds=0.0, until=lambda: False):
        deadline = time.monotonic() + seconds
        while True:
            left = max(0.0, deadline - time.monotonic())
            select.select([bus.node for bus in self], [], [], min(left, 0.05))
            for bus in self:
                bus.listen()
            if left == 0.0 or until():
                return

    def commands(self):
        """All frames to the drives, of both buses in the order of the kernel: (side, frame)"""
        both = [(side, frame) for side, bus in enumerate(self) for frame in bus.commands(1 + side)]
        return sorted(both, key=lambda pair: pair[1].time)

    def await_torque(self):
        self.listen(15.0, lambda: all(any(map(is_torque, bus.commands(1 + side))) for side, bus in enumerate(self)))
        assert all(any(map(is_torque, bus.commands(1 + side))) for side, bus in enumerate(self)), (
            "no torque was commanded"
        )

    def assert_stopped(self, seconds):
        """Both drives, at most so many s and two ticks after the last torque, and nothing but that from then on."""
        said = self.commands()
        first = [
            next(place for place, (whose, frame) in enumerate(said) if whose == side and frame.data == DISABLE)
            for side in range(2)
        ]
        for side, place in enumerate(first):
            before = [frame.data for whose, frame in said[:place] if whose == side]
            assert before[-1] == NOTHING, "zero torque comes before disable"
        behind = {frame.data for _, frame in said[min(first) :]}
        assert behind <= {NOTHING, DISABLE}, f"a drive was commanded after its stop: {said[min(first) - 2 :]}"
        last = max((frame.time for _, frame in said if is_torque(frame)), default=None)
        if last is not None:
            took = said[max(first)][1].time - last
            assert took < seconds + 2 * PERIOD + ALLOWANCE
            return took
        return None


@pytest.fixture
def buses(tmp_path):
    with Buses(tmp_path) as buses:
        yield buses


def ends_in_the_safe_stop(buses, fault):
    process = buses.start(fault)
    buses.await_torque()
    fault.act(process, buses)
    buses.listen(10.0, lambda: process.poll() is not None)
    out, err = process.communicate(timeout=10)
    buses.listen(0.05)
    assert process.returncode == fault.code, err
    assert re.search(fault.said, out + err), out + err
    assert "Traceback" not in out + err
    assert (CONFIRMED in re.sub("confirmed by right/knee, left/knee", CONFIRMED, out + err)) == fault.confirmed, (
        out + err
    )
    buses.assert_stopped(fault.seconds)


@pytest.mark.hazard("H6d")
@pytest.mark.parametrize("what", soaked(list(FAULTS), but=[0]))
def test_drives_on_both_buses_are_stopped_within_two_ticks(buses, what):
    ends_in_the_safe_stop(buses, FAULTS[what])


@pytest.mark.soak
@pytest.mark.parametrize("what", MORE)
def test_drives_on_both_buses_are_stopped_within_two_ticks_of_every_other_fault(buses, what):
    ends_in_the_safe_stop(buses, MORE[what])


@pytest.mark.soak
def test_an_exception_at_the_pre_flight_table_disables_both_drives(buses):
    """A bug of ours at the pre-flight table. Nothing was under torque, and both are disabled all the same."""
    fault = Fault(
        "",
        before="from runtime.record.report.preflight.table import Preflight\n"
        "Preflight.event = lambda self, values, found: 1 / 0",
    )
    process = buses.start(fault)
    out, err = process.communicate(timeout=20)
    buses.listen(0.05)
    assert process.returncode == 3 and "division by zero" in err
    assert not any(is_torque(frame) for _, frame in buses.commands())
    assert buses.assert_stopped(0.0) is None


@pytest.mark.soak
@pytest.mark.parametrize("how", ["pressed", "silent"])
def test_button_on_separate_bus_stops_both(buses, how):
    port = free_port()
    buses.rig.write_text(buses.rig.read_text() + f'[bus.estop]\ninterface = "udp"\nchannel = "127.0.0.1:{port}"\n')
    with Button(port) as button:
        stops = {
            "pressed": ("the emergency stop was pressed", button.press),
            "silent": ("no reply for longer", button.silence),
        }
        said, act = stops[how]
        ends_in_the_safe_stop(
            buses,
            Fault(
                f"FAULT at left/button, .*{said}|{LATE}",
                more="EStopHeartbeat(name='button', timeout=0.2)",
                act=lambda process, buses: act(),
            ),
        )


@pytest.mark.hazard("H9b")
@pytest.mark.soak
def test_the_space_bar_stops_both_drives(buses):
    with Terminal() as terminal:
        terminal.run(*buses.words(Fault("")), cwd=buses.folder)
        buses.await_torque()
        os.write(terminal.master, b" ")
        buses.listen(1.0)
        assert terminal.end() == 0 and "stopped by the space bar" in terminal.look()
    buses.listen(0.05)
    buses.assert_stopped(2 * PERIOD)
