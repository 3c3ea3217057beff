"""GPIO lines, taken through libgpiod's Python package, the extra `gpio`. Its edges come with times of CLOCK_MONOTONIC.

What a block says in `opening`: chip, pin (name or number), active_low, output; of an input bias and debounce (s).
"""

import errno
import os
from datetime import timedelta

from runtime.rig.errors import Refused, Trouble
from runtime.rig.streams import Opened, one_by_one

EVENT = 48  # bytes of struct gpio_v2_line_event
CONSUMER = "tickwork"


def open_lines(devices):
    """{device: Opened or Trouble}"""
    return one_by_one(devices, lambda device: opened(device.path, **device.opening()))


def opened(who, chip, pin, active_low, output, bias="as_is", debounce=0.0):
    name = f'[device."{who}"] {chip} {pin}'
    if not pin:
        hint = 'write pin = "GPIO17", or its number on the chip; the names there are: gpioinfo'
        raise Refused(Trouble("TW127", f'[device."{who}"] names no GPIO line', hint))
    try:
        import gpiod
    except ImportError:
        raise Refused(
            Trouble("TW119", f"{name}: libgpiod's Python package is not installed", "pip install 'tickwork[gpio]'")
        ) from None
    from gpiod.line import Bias, Clock, Direction, Edge

    settings = (
        gpiod.LineSettings(direction=Direction.OUTPUT, active_low=active_low)
        if output
        else gpiod.LineSettings(
            direction=Direction.INPUT,
            edge_detection=Edge.BOTH,
            bias=getattr(Bias, bias.upper()),
            active_low=active_low,
            debounce_period=timedelta(seconds=debounce),
            event_clock=Clock.MONOTONIC,
        )
    )
    try:
        request = gpiod.request_lines(str(chip), {int(pin) if pin.isdecimal() else pin: settings}, consumer=CONSUMER)
    except (OSError, ValueError) as error:
        raise Refused(in_words(name, chip, pin, error)) from None
    return Opened(os.dup(request.fd), f"{chip} {pin}", record=EVENT, is_gpio=True, close=request.release)


def in_words(name, chip, pin, error):
    number = getattr(error, "errno", None)
    if not os.path.exists(chip):
        return Trouble(
            "TW127", f"{name}: there is no such chip", "those there are: ls /dev/gpiochip*; their lines: gpioinfo"
        )
    if number in (errno.EACCES, errno.EPERM):
        return Trouble(
            "TW118", f"{name}: {os.strerror(number)}", f"sudo usermod -aG {group_of(chip)} $USER, then log in again"
        )
    if number == errno.EBUSY:
        return Trouble("TW119", f"{name}: somebody else has that line", "who it is: gpioinfo")
    if number is None or number in (errno.EINVAL, errno.ENOENT):
        return Trouble(
            "TW127", f"{name}: the chip has no such line, or it cannot do that ({error})", "its lines: gpioinfo"
        )
    return Trouble("TW119", f"{name}: {os.strerror(number)}", "is it a chip of GPIO lines? gpiodetect")


def group_of(path):
    """Name of the group that may use it."""
    import grp

    try:
        return grp.getgrgid(os.stat(path).st_gid).gr_name
    except (KeyError, OSError):
        return "gpio"
