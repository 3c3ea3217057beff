"""Options of a run: each field declares one option of the command line."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from os import PathLike
from pathlib import Path
from typing import Any, TypedDict

from graph.units import parse_quantity
from runtime.host.errors import BadInput
from runtime.host.machine.realtime import MODES, PRIORITY, PRIORITY_LIMIT
from runtime.host.options import (
    TIME_LIMIT,
    folder,
    host_and_port,
    number,
    option,
    panel_address,
    processor,
    settings,
    subject_file,
    trial_fields,
    whole_number,
)
from runtime.record.report.timing import overrun_policy, spin_window
from runtime.record.storage.mcap_file import ZSTD as COMPRESSION
from runtime.record.storage.mcap_file import compression_level


def _rerun_target(text: str) -> str:
    from runtime.host.optional_dependencies import need
    from runtime.record.recorder.rerun.target import parse

    parse(text)
    if find_spec("rerun") is None:
        need("rerun", "--rerun")
    return text


def compression(text: str) -> str:
    """Return a compression of the recording. Raises BadInput."""
    compression_level(text)
    return text


def poses(texts: list[str]) -> dict[str, float]:
    """Return {path: rad} of PATH=ANGLE texts. Raises BadInput."""
    angles = {}
    for text in texts:
        path, _, angle = text.partition("=")
        try:
            angles[path] = parse_quantity(angle, "rad")
            if not abs(angles[path]) < float("inf"):
                raise ValueError("an angle is a finite number")
        except ValueError as error:
            raise BadInput(
                f"--pose {text}: {error}; write PATH=ANGLE, as in left/knee=0 or 'left/knee=30 deg'"
            ) from None
    return angles


class RunOptions(TypedDict, total=False):
    """The options of a run in real time that a program passes by name, with values as in the command line."""

    record: str | PathLike[str] | None
    compression: str
    can_log: bool
    trial: Mapping[str, Any]
    plotjuggler: str | None
    rerun: str | None
    panel: str | None
    panel_lost: str | None
    realtime: str | None
    priority: int | None
    cpu: int | None
    yes: bool
    arm_on: str | None
    stop_for: float | None
    poses: Mapping[str, Any]
    accept: Sequence[str]
    rearm: bool
    overrun: str
    spin: Any
    bitrate: float | None
    profile: bool


HARDWARE, SIMULATION, OUTPUT, TIMING = "hardware", "simulation", "recording and viewers", "timing"


@dataclass
class Request:
    """The options of a run."""

    file: Path = option(type=Path, metavar="FILE", help="a diagram file, such as diagrams/knee_exo.py")
    rig: Path | None = option(
        "--rig",
        section=HARDWARE,
        default=None,
        type=Path,
        metavar="FILE",
        help="run on hardware: a rig file, such as lab.toml, with the interface of each bus and the mounting of each "
        "device",
    )
    subject: Path | None = option(
        "--subject",
        default=None,
        collect=subject_file,
        action="append",
        metavar="FILE",
        help="limits for one person, signed by the principal investigator: no setting and no change exceeds them",
    )
    rate: float | None = option(
        "--rate",
        default=None,
        type=number("--rate", "Hz"),
        metavar="HZ",
        help="ticks per second (default: the diagram's)",
    )
    settings: list[tuple[str, Any]] = option(
        "--set",
        default=list,
        collect=settings,
        action="append",
        metavar="NAME=VALUE",
        help="set a parameter of build() or plant(), or of a block: left/impedance.stiffness=40, angle='60 deg'; "
        "@FILE reads such settings, one per line",
    )
    duration: float | None = option(
        "--duration",
        default=None,
        type=number("--duration", "seconds", TIME_LIMIT),
        metavar="S",
        help="stop after S seconds (default: Ctrl-C)",
    )
    fast: bool = option(
        "--fast",
        section=SIMULATION,
        default=False,
        action="store_true",
        help="virtual time: as fast as possible (needs --duration)",
    )
    seed: int | None = option(
        "--seed",
        section=SIMULATION,
        default=None,
        type=whole_number("--seed", 2**53, 0),
        metavar="N",
        help="derive the seed of each noise source of robot and plant from N (default: their own seeds)",
    )
    record: Path | None = option(
        "--record",
        section=OUTPUT,
        default=None,
        group="files",
        type=folder,
        metavar="DIR",
        help="folder of the recording (default: recordings)",
    )
    no_record: bool = option(
        "--no-record", section=OUTPUT, default=False, group="files", action="store_true", help="write no files"
    )
    compression: str = option(
        "--compression",
        section=OUTPUT,
        default=COMPRESSION,
        type=compression,
        metavar="NAME",
        help="compression of the .mcap file: zstd (default), zstd:LEVEL with a level from 1, the fastest, to 19, or "
        "none",
    )
    can_log: bool = option(
        "--can-log",
        section=OUTPUT,
        default=False,
        action="store_true",
        help="also write a .can.log of the CAN frames; `convert --to candump` makes one from the .mcap file later",
    )
    trial: dict[str, str] = option(
        "--trial",
        section=OUTPUT,
        default=dict,
        collect=trial_fields,
        nargs="+",
        metavar="NAME=VALUE",
        help="describe this trial: subject=S03 condition=assist notes='new shoes'",
    )
    plotjuggler: tuple[str, int] | None = option(
        "--plotjuggler",
        section=OUTPUT,
        default=None,
        type=host_and_port,
        metavar="HOST:PORT",
        help="address on which PlotJuggler listens",
    )
    rerun: str | None = option(
        "--rerun",
        section=OUTPUT,
        default=None,
        nargs="?",
        const="",
        type=_rerun_target,
        metavar="WHERE",
        help="show the run in Rerun's viewer; or WHERE: a FILE.rrd, serve for a browser, HOST:PORT of another viewer",
    )
    panel: tuple[str, int] | None = option(
        "--panel",
        section=OUTPUT,
        default=None,
        nargs="?",
        const="",
        type=panel_address,
        metavar="ADDRESS:PORT",
        help="serve a page for a browser: state, stop, live parameters, plots (default: on this computer alone, "
        "127.0.0.1, first free port from 8470 on)",
    )
    panel_lost: str | None = option(
        "--panel-lost",
        section=OUTPUT,
        default=None,
        choices=("continue", "stop"),
        help="what follows when the page that has the controls is lost: stop arms only once there is one, and ends the "
        "run in its safe stop when it is lost (default: as in the diagram's Panel, else continue)",
    )
    realtime: str | None = option(
        "--realtime",
        section=TIMING,
        default=None,
        choices=MODES,
        help="request real-time priority, locked memory and processors without deep sleep: try reports denied "
        "requests, require does not start if one is denied (default: try on a rig, off in simulation)",
    )
    priority: int | None = option(
        "--priority",
        section=TIMING,
        default=None,
        type=whole_number("--priority", PRIORITY_LIMIT),
        metavar="N",
        help=f"priority of SCHED_FIFO, 1 to {PRIORITY_LIMIT} (default: {PRIORITY})",
    )
    cpu: int | None = option(
        "--cpu",
        section=TIMING,
        default=None,
        type=processor,
        metavar="N",
        help="run on this processor (default: the last isolated one, or with real-time priority one that no other run "
        "uses)",
    )
    yes: bool = option(
        "--yes", section=HARDWARE, default=False, action="store_true", help="on a rig: arm without waiting for Enter"
    )
    arm_on: str | None = option(
        "--arm-on",
        section=HARDWARE,
        default=None,
        metavar="SIGNAL",
        help="on a rig: arm once this signal of a device, such as button.on, was held for 1 s, also without a terminal",
    )
    stop_for: float | None = option(
        "--stop-for",
        section=HARDWARE,
        default=None,
        type=number("--stop-for", "seconds", TIME_LIMIT),
        metavar="S",
        help="on a rig: time for which a safe stop continues for drives that do not confirm it (default: "
        "until Ctrl-C; 10 s without a terminal)",
    )
    poses: dict[str, float] = option(
        "--pose",
        section=HARDWARE,
        default=dict,
        collect=poses,
        action="append",
        metavar="PATH=ANGLE",
        help="on a rig: observed angle of a joint, to check its drive's reading: left/knee=0 or 'left/knee=30 deg'. "
        "May be repeated",
    )
    accept: list[str] = option(
        "--accept",
        section=HARDWARE,
        default=list,
        action="append",
        collect=list,
        metavar="NAME",
        help="on a rig: arm although the torque limit of an actuator may not hold because of this setting, such as "
        "left/knee.wire_torque; `check` lists them. May be repeated",
    )
    rearm: bool = option(
        "--rearm",
        default=False,
        action="store_true",
        help="after a fault, wait in the safe stop until the key r arms again and no fault remains",
    )
    overrun: str = option(
        "--overrun",
        section=TIMING,
        default="skip",
        type=overrun_policy,
        metavar="POLICY",
        help="handling of late ticks: skip (default); catch-up:N runs up to N late ticks; fault:N ends the run after N "
        "missed ticks in a row, fault:N/WINDOW within a window. Separate several by commas",
    )
    spin: float = option(
        "--spin",
        section=TIMING,
        default=0.0,
        type=spin_window,
        metavar="TIME",
        help="busy-wait instead of sleeping for this long before each deadline, such as 50us",
    )
    bitrate: float | None = option(
        "--bitrate",
        section=SIMULATION,
        default=None,
        type=number("--bitrate", "bit/s", 1e9),
        metavar="N",
        help="bitrate of the simulated buses in bit/s; delays frames by the time of their bits (default: no delay)",
    )
    profile: bool = option(
        "--profile",
        section=TIMING,
        default=False,
        action="store_true",
        help="measure the time of every block and print it at the end",
    )
    report: int | None = option(
        "--report",
        section=OUTPUT,
        default=None,
        type=whole_number("--report", minimum=3),
        metavar="FD",
        help="for programs that start a run: write its files as a line of JSON to this file descriptor at the end",
    )
    bench: bool = False  # on a rig: an actuator that moves no joint, so that its range is not required

    def __post_init__(self) -> None:
        self.realtime = self.realtime or ("off" if self.rig is None else "try")

    def check(self) -> None:
        """Raise BadInput for options that exclude or need each other."""
        if self.poses and self.rig is None:
            raise BadInput("--pose needs --rig: in simulation every drive reads the true angle of its joint")
        if self.accept and self.rig is None:
            raise BadInput("--accept needs --rig: a simulation needs no acceptance")
        if self.arm_on is not None and (self.rig is None or self.yes):
            raise BadInput("--arm-on needs --rig, and excludes --yes, which arms without a confirmation")
        if self.bitrate is not None and self.rig is not None:
            raise BadInput("--bitrate and --rig exclude each other: the rig file has the bitrate of a real bus")
        if self.fast and self.rig is not None:
            raise BadInput("--fast and --rig exclude each other: a rig runs in real time")
        if self.seed is not None and self.rig is not None:
            raise BadInput("--seed and --rig exclude each other: a robot has no simulated noise")
        if self.fast and self.panel is not None:
            raise BadInput("--panel and --fast exclude each other: a run in virtual time is over before it can be seen")
        if self.fast and self.rearm:
            raise BadInput("--fast and --rearm exclude each other: virtual time does not wait for a key")
        if self.fast and self.duration is None:
            raise BadInput("--fast needs --duration S, as in --fast --duration 60")
        if self.fast and self.realtime != "off":
            raise BadInput(f"--realtime {self.realtime} and --fast exclude each other: virtual time has no deadlines")
        for name in ("priority", "cpu"):
            if self.realtime == "off" and getattr(self, name) is not None:
                raise BadInput(f"--{name} needs --realtime try or --realtime require")
