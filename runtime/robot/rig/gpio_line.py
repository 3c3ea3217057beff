"""GPIO lines, through libgpiod's Python package (extra `gpio`), with edge times of CLOCK_MONOTONIC.

Keys of `opening`: chip, pin (name or number), active_low, output; for an input, bias and debounce (s).
"""

from __future__ import annotations

import errno
import os
import socket
from datetime import timedelta
from importlib import import_module
from typing import TYPE_CHECKING

from runtime.robot.rig.errors import Refused, RigProblem
from runtime.robot.rig.file import EMULATED, EMULATED_TEXT
from runtime.robot.rig.line import Opened, one_by_one

if TYPE_CHECKING:
    from collections.abc import Iterable

    from graph import StreamDevice


EVENT = 48  # bytes of struct gpio_v2_line_event
KIND, RISING = 8, 1  # index of the kind of an event, and one of its values
LEVEL_TIMEOUT = 2.0  # s
CONSUMER = "tickwork"


def open_lines(devices: Iterable[StreamDevice]) -> dict[StreamDevice, Opened | RigProblem]:
    """Open the lines of `devices`. Returns {device: Opened or RigProblem}."""
    return one_by_one(devices, lambda device: open_line(device.path, **device.opening()))


def open_line(
    path: str, chip: str, pin: str, active_low: bool, output: bool, bias: str = "as_is", debounce: float = 0.0
) -> Opened:
    """Request a GPIO line. Raises Refused.

    path : device named in messages
    chip : device file, such as /dev/gpiochip0, or unix:PATH for `emulate`
    pin : name of the line, or its number on the chip
    active_low : whether a low level is 1
    output : whether it is an output
    bias : "as_is", "pull_up", "pull_down" or "disabled", of an input
    debounce : s, of an input
    """
    name = f'[device."{path}"] {chip} {pin}'
    if not pin:
        hint = 'write pin = "GPIO17", or its number on the chip; list the names: gpioinfo'
        raise Refused(RigProblem("TW127", f'[device."{path}"] has no chip and pin', hint))
    if chip.startswith(EMULATED):
        return open_emulated(name, socket_path(chip, pin), output)
    try:
        gpiod = import_module("gpiod")
    except ImportError:
        raise Refused(
            RigProblem("TW119", f"{name}: libgpiod's Python package is not installed", "pip install 'tickwork[gpio]'")
        ) from None
    line = import_module("gpiod.line")
    settings = (
        gpiod.LineSettings(direction=line.Direction.OUTPUT, active_low=active_low)
        if output
        else gpiod.LineSettings(
            direction=line.Direction.INPUT,
            edge_detection=line.Edge.BOTH,
            bias=getattr(line.Bias, bias.upper()),
            active_low=active_low,
            debounce_period=timedelta(seconds=debounce),
            event_clock=line.Clock.MONOTONIC,
        )
    )
    try:
        request = gpiod.request_lines(str(chip), {int(pin) if pin.isdecimal() else pin: settings}, consumer=CONSUMER)
    except (OSError, ValueError) as error:
        raise Refused(_open_problem(name, chip, pin, error)) from None
    return Opened(os.dup(request.fd), f"{chip} {pin}", record=EVENT, is_gpio=True, close=request.release)


def socket_path(chip: str, pin: str) -> str:
    """Return the path of the socket of an emulated line. chip : unix:PATH"""
    return f"{chip.removeprefix(EMULATED)}.{pin}"


def open_emulated(name: str, path: str, output: bool) -> Opened:
    """Connect to a line of `emulate`, and wait for the level of an input. Raises Refused.

    name : line named in the message
    """
    end = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    level = None
    try:
        end.settimeout(LEVEL_TIMEOUT)
        end.connect(path)
        if not output:
            level = end.recv(EVENT)[KIND] == RISING
    except (OSError, IndexError) as error:
        end.close()
        why = getattr(error, "strerror", None) or "no level"
        hint = "start `python -m runtime emulate` with this rig first, in another terminal"
        raise Refused(RigProblem("TW127", f"{name}: {why}", hint)) from None
    end.setblocking(False)
    remark = f"{name} is {EMULATED_TEXT}"
    return Opened(end.detach(), path, record=EVENT, is_gpio=True, level=level, remarks=(remark,))


def _open_problem(name, chip, pin, error):
    """Return a RigProblem that explains why a line cannot be requested."""
    number = getattr(error, "errno", None)
    if not os.path.exists(chip):
        return RigProblem(
            "TW127", f"{name}: no such chip", "list the chips: ls /dev/gpiochip*; list their lines: gpioinfo"
        )
    if number in (errno.EACCES, errno.EPERM):
        return RigProblem(
            "TW118", f"{name}: {os.strerror(number)}", f"sudo usermod -aG {_group_of(chip)} $USER, then log in again"
        )
    if number == errno.EBUSY:
        return RigProblem("TW119", f"{name}: in use by another process", "find it: gpioinfo")
    if number is None or number in (errno.EINVAL, errno.ENOENT):
        return RigProblem(
            "TW127", f"{name}: no such line, or an unsupported option ({error})", "list the lines: gpioinfo"
        )
    return RigProblem("TW119", f"{name}: {os.strerror(number)}", "check that it is a GPIO chip: gpiodetect")


def _group_of(path):
    """Return the name of the group with access to a file."""
    import grp

    try:
        return grp.getgrgid(os.stat(path).st_gid).gr_name
    except (KeyError, OSError):
        return "gpio"
