"""Live viewers. They have inputs only; the recorder process sends their data."""

from math import isfinite
from numbers import Real
from typing import Any

from cext.user_files import read_small
from graph import Param, Sink

NOTE_LENGTH = 200  # characters of the note on a mark


class PlotJuggler(Sink):
    """PlotJuggler stream over UDP: JSON nested by block path, with a `timestamp` in s in every message.

    PlotJuggler sorts by time stamp and discards samples older than its buffer, so a second run that started at 0 again
    would not be shown. Time stamps therefore increase from run to run; "remove time offset", which is on by default,
    shows them from 0.

    In PlotJuggler: Streaming, UDP Server, port 9870, JSON; tick "use field as timestamp" and enter `timestamp`.
    `python -m runtime plotjuggler FILE` writes a layout with the plots.

    A run in virtual time sends nothing, unless `virtual_time` is set or the run has the option `--plotjuggler`.
    """

    host = Param("127.0.0.1", "1", "host on which PlotJuggler runs")
    port = Param(9870, "1", "UDP port of PlotJuggler", min=1, max=65535, fixed=True)

    signals = Param(
        "", "1", "signals, blocks or subsystems to send, such as left/knee.torque, right, */imu.accel; all by default"
    )
    decimation = Param(1, "1", "one in this many ticks is sent", min=1, max=10_000, fixed=True)
    time = Param(
        "device",
        "1",
        "time stamps: s since 1970 by the computer's clock (device) or s since tick 0 (relative)",
        choices=("device", "relative"),
        fixed=True,
    )
    batch = Param(1, "1", "samples per datagram; more than 1 requires PlotJuggler 3.16", min=1, max=1000, fixed=True)

    virtual_time = Param(False, "1", "true also sends runs in virtual time", fixed=True)

    service = "plotjuggler"

    def is_active(self, virtual: bool) -> bool:
        return bool(self.virtual_time) or not virtual


class Panel(Sink):
    """Page in a browser for the operator: state, stop, live parameters, plots, and a picture for the subject.

    The page is for browsers on this computer, or on others if `host` is an address of this computer in their network.
    A run in virtual time has no page. With lost="stop" no drive of a rig is enabled before a page has the controls, and
    the run ends in its safe stop if that page is lost.

    Panel(marks=("start", "uphill")) adds a button for each of these marks. Panel(subject="left/knee.position",
    stride="maximum", target=(0.9, 1.1)) shows the largest knee angle of each stride at the address /subject.
    """

    host = Param("127.0.0.1", "1", "address on which the page is served; 0.0.0.0 for all of this computer")
    port = Param(0, "1", "TCP port of the page; 0 for the first free one from 8470 on", min=0, max=65535, fixed=True)
    lost = Param(
        "continue",
        "1",
        "what follows when the page that has the controls is lost: the run continues, or it stops",
        choices=("continue", "stop"),
        fixed=True,
    )
    marks = Param((), "1", "notes of marks, each with a button on the page")
    marks_file = Param("", "1", "path of a text file with further notes, one in a line", dtype=str, file=True)
    subject = Param("", "1", "recorded signal that the subject is shown; by default the one chosen on the page")
    target = Param((), "1", "lowest and highest value of the subject's target band, in the unit of the signal")
    stride = Param(
        "",
        "1",
        "what the subject is shown of each stride: its last, largest, smallest or mean value; by default the value now",
        choices=("", "last", "maximum", "minimum", "mean"),
    )

    service = "panel"

    def configure(self) -> None:
        lines = read_small(self.marks_file).decode().splitlines() if self.marks_file else []
        notes: list[Any] = [*self.marks, *filter(None, map(str.strip, lines))]
        for note in notes:
            if not isinstance(note, str) or not 0 < len(note) <= NOTE_LENGTH or not note.isprintable():
                raise ValueError(f"marks must be text of 1 to {NOTE_LENGTH} characters in one line, got {note!r}")
        self.marks = tuple(dict.fromkeys(notes))
        finite = all(isinstance(end, Real) and isfinite(end) for end in self.target)
        if self.target and not (finite and len(self.target) == 2 and self.target[0] < self.target[1]):
            raise ValueError(f"target must be (lowest, highest), got {self.target!r}")

    def is_active(self, virtual: bool) -> bool:
        return not virtual


class Lsl(Sink):
    """Lab Streaming Layer: a stream with the connected signals, or all, and one with events and marks.

    LabRecorder writes both to an XDF file, beside those of other devices. The second one is called `NAME events` and is
    of the type Markers. Every computer in the network can receive them. A run in virtual time sends nothing.

    Requires liblsl: `pip install 'tickwork[lsl]'`.
    """

    stream = Param("", "1", "name of the stream; that of the diagram by default", dtype=str)
    signals = Param(
        "", "1", "signals, blocks or subsystems to send, such as left/knee.torque, right, */imu.accel; all by default"
    )
    decimation = Param(1, "1", "one in this many ticks is sent", min=1, max=10_000, fixed=True)

    service = "lsl"

    def is_active(self, virtual: bool) -> bool:
        return not virtual


class Ros2(Sink):
    """ROS 2 by Zenoh: JointState of the actuators, Imu of each inertial sensor, and diagnostics, without ROS here.

    Nodes of ROS 2 with the middleware rmw_zenoh receive them. A block with a position in rad or m is a joint: left/knee
    is left_knee in `joint_states`. An inertial sensor has the topic of its path. `/diagnostics` has the state of the
    run and of each actuator once a second. A process of its own publishes. A run in virtual time publishes nothing.

    Requires eclipse-zenoh: `pip install 'tickwork[ros2]'`.
    """

    router = Param("tcp/localhost:7447", "1", "endpoint of the Zenoh router, `rmw_zenohd` of ROS 2", dtype=str)
    domain = Param(0, "1", "ROS_DOMAIN_ID of the nodes", min=0, max=232, fixed=True)
    namespace = Param("", "1", "namespace of the topics, such as exo; that of /diagnostics is always empty", dtype=str)
    signals = Param(
        "", "1", "signals, blocks or subsystems to publish, such as left/knee, */imu; all recorded ones by default"
    )
    decimation = Param(1, "1", "one in this many ticks is published", min=1, max=10_000, fixed=True)

    service = "ros2"

    def is_active(self, virtual: bool) -> bool:
        return not virtual


class Rerun(Sink):
    """Rerun viewer: one plot per subsystem with its limits, limbs in 3-D, faults as text.

    Requires rerun-sdk: `pip install 'tickwork[rerun]'`. A limb is identified by names: actuators called `hip`, `knee`
    and `ankle` in one subsystem.
    """

    target = Param(
        "",
        "1",
        "file.rrd; serve or serve:ADDRESS for a browser; HOST:PORT of a viewer; a viewer on this machine by default",
    )
    port = Param(9876, "1", "port of the viewer or server", min=1, max=65535, fixed=True)
    web_port = Param(9090, "1", "port of the server's web page", min=1, max=65535, fixed=True)

    service = "rerun"
