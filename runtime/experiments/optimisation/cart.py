"""Metabolic carts: their exported tables, as a file that grows or as a stream of lines.

    time (s)    VO2 (mL/min)    VCO2 (mL/min)
    4.1         1180            1010
    0:08.3      1203            1022

The columns are separated by tabs, semicolons, commas or spaces. Their names give the units. Instead of the two gases a
column may be the power: "W", "EE (kcal/min)". Without a header a line is the power in W; time in s and power in W; or
time in s, VO2 and VCO2 in mL/min.
"""

from __future__ import annotations

import errno
import math
import os
import re
import socket
import stat
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from runtime.experiments.optimisation.metabolic import HIGHEST_POWER, LOWEST_POWER, plausible, power
from runtime.host.errors import BadInput

CONNECT_TIMEOUT, RECONNECT_TIMEOUT = 3.0, 0.3  # s, before and during the run
RECONNECT_PERIOD = 2.0  # s
READ_SIZE = 1 << 16  # bytes
LINE_LIMIT = 1 << 16  # bytes of a line; a longer one is discarded
LINE_SHOWN = 60  # characters of a rejected line in a message
DELAY_LIMIT = 60.0  # s from a breath to its sample; a longer delay is a clock that was set back
BAUD_RATE = 9600  # of a serial stream, unless it is given

TIME, OXYGEN, CARBON_DIOXIDE, POWER = "time", "oxygen", "carbon dioxide", "power"
NAMES = {  # a column by its name in lower case, without unit, apostrophes and dots
    **dict.fromkeys(("t", "time", "elapsed time", "exercise time", "test time"), TIME),
    **dict.fromkeys(("vo2", "vo2 stpd"), OXYGEN),
    **dict.fromkeys(("vco2", "vco2 stpd"), CARBON_DIOXIDE),
    **dict.fromkeys(("w", "power", "metabolic power", "metabolic rate", "ee", "eem"), POWER),
}
UNITS = {  # factors to s, L/s and W
    TIME: {"": 1.0, "s": 1.0, "sec": 1.0, "min": 60.0, "h:m:s": 1.0, "hh:mm:ss": 1.0, "mm:ss": 1.0, "m:s": 1.0},
    OXYGEN: {"": 1e-3 / 60.0, "ml/min": 1e-3 / 60.0, "l/min": 1.0 / 60.0, "ml/s": 1e-3, "l/s": 1.0},
    POWER: {"": 1.0, "w": 1.0, "kcal/min": 4184.0 / 60.0, "kj/min": 1e3 / 60.0},
}
UNITS[CARBON_DIOXIDE] = UNITS[OXYGEN]
HEADERLESS = {1: (POWER,), 2: (TIME, POWER), 3: (TIME, OXYGEN, CARBON_DIOXIDE)}  # by the number of columns
HEADER = re.compile(r"\s*(?P<name>[^\[(/]*?)\s*(?:[\[(](?P<unit>[^\])]*)[\])])?\s*")


class Table:
    """Lines of a cart's table, from which samples are taken.

    rejected : number of lines without a valid sample
    reason : the last of these and why it was rejected, as text
    """

    def __init__(self) -> None:
        self.columns: dict[str, tuple[int, float]] = {}  # {kind: (place, factor)}
        self.separator: str | None = None
        self.rejected, self.reason = 0, ""
        self._second = False  # whether the next line follows the header, and may have the units

    def sample(self, line: str) -> tuple[float, float] | None:
        """Return (time in s of the cart's clock, NaN without one; power in W), or None for a line without a sample.

        Raises BadInput for a header that names an unknown unit, or no gas and no power.
        """
        if not line.strip():
            return None
        if not self.columns and self._take_header(line):
            return None
        cells = self._cells(line)
        if self._second:
            self._second = False
            if all(math.isnan(number(cell)) for cell in cells):
                self._take_units(cells)
                return None
        values = {
            kind: factor * number(cells[place]) for kind, (place, factor) in self.columns.items() if place < len(cells)
        }
        watts = values.get(POWER, math.nan)
        if POWER not in self.columns:
            watts = power(values.get(OXYGEN, math.nan), values.get(CARBON_DIOXIDE, math.nan))
        if not plausible(watts) or (TIME in self.columns and not math.isfinite(values.get(TIME, math.nan))):
            self.rejected += 1
            self.reason = f"{line.strip()[:LINE_SHOWN]!r}, {self._reason(watts)}"
            return None
        return values.get(TIME, math.nan), watts

    def _reason(self, watts):
        if plausible(watts):
            return "whose time is not a number"
        if not math.isfinite(watts):
            return "whose gases or power are not numbers"
        return (
            f"whose {watts:.3g} W is outside the range of {LOWEST_POWER:g} to {HIGHEST_POWER:g} W: compare the units "
            "of the header with the numbers"
        )

    def _cells(self, line):
        cells = line.split(self.separator)
        return [cell.strip().strip('"').replace(",", ".") for cell in cells]

    def _take_header(self, line):
        """Take the columns of the first line. Returns whether it is a header; False if it has numbers only."""
        self.separator = next((mark for mark in "\t;," if mark in line), None)
        cells = [cell.strip().strip('"') for cell in line.split(self.separator)]
        if all(math.isfinite(number(cell.replace(",", "."))) for cell in cells):
            kinds = HEADERLESS.get(len(cells))
            if kinds is None:
                raise BadInput(
                    f"{len(cells)} columns without a header: expected a first line with names and units, such as "
                    "'time (s)', 'VO2 (mL/min)' and 'VCO2 (mL/min)'"
                )
            self.columns = {kind: (place, UNITS[kind][""]) for place, kind in enumerate(kinds)}
            return False
        columns = {}
        if self.separator is None:  # names and units may also be separated by a space
            cells = re.findall(r"\S+(?:\s*[\[(][^\])]*[\])])?", line)
        for place, cell in enumerate(cells):
            match = HEADER.fullmatch(cell)
            kind = NAMES.get(re.sub(r"['’.]", "", match["name"]).lower()) if match else None
            if match is None or kind is None or kind in columns:
                continue
            columns[kind] = place, factor(kind, match["unit"] or "", cell)
        if POWER in columns or {OXYGEN, CARBON_DIOXIDE} <= set(columns):
            self.columns, self._second = columns, True
        elif columns:
            raise BadInput(f"the header {line.strip()!r} has neither a power nor both VO2 and VCO2")
        return True  # a title line otherwise: the header follows

    def _take_units(self, cells):
        """Take a second line with the units of the columns."""
        for kind, (place, _) in self.columns.items():
            if place < len(cells):
                self.columns[kind] = place, factor(kind, cells[place], cells[place])


def factor(kind: str, unit: str, column: str) -> float:
    """Return the factor of a unit. Raises BadInput for an unknown one. kind, column : named in the message"""
    factors = UNITS[kind]
    if unit.strip().lower() not in factors:
        known = ", ".join(name for name in factors if name)
        raise BadInput(f"column {column!r} ({kind}): unknown unit {unit!r}; expected one of {known}")
    return factors[unit.strip().lower()]


def number(text: str) -> float:
    """Return a number, or the s of a time such as 1:02:03.5 or 62:03; NaN for any other text."""
    seconds = 0.0
    try:
        for part in text.split(":"):
            seconds = 60.0 * seconds + float(part)
    except ValueError:
        return math.nan
    return seconds


class Clock:
    """Offset between a cart's clock and that of this process.

    A sample arrives some time after its breath, and never before: the smallest difference is the offset. A cart that
    is started again begins with another one.
    """

    def __init__(self) -> None:
        self.offset = math.inf

    def here(self, cart: float, arrival: float) -> float:
        """Return the time of a sample by the clock of this process, in s.

        cart : time of the sample in s by the cart's clock; NaN without one
        arrival : time of its arrival in s
        """
        if not math.isfinite(cart):
            return arrival
        difference = arrival - cart
        self.offset = difference if difference - self.offset > DELAY_LIMIT else min(self.offset, difference)
        return cart + self.offset


class Cart:
    """Samples of a metabolic cart that arrive during a run.

    read : function that returns the bytes that have arrived since its last call, b"" for none; None for a source that
        begins again, whose lines so far are repeated
    name : name of the source, for messages

    Samples that the source already contains at the first `take` are ignored.
    """

    def __init__(self, read: Callable[[], bytes | None], name: str) -> None:
        self.read, self.name = read, name
        self.table, self.clock = Table(), Clock()
        self.unfinished = b""
        self.lines = self.repeated = 0
        self.begun = False

    def take(self, now: float) -> list[tuple[float, float]]:
        """Return the new samples, (s by the clock of `now`, W). Raises BadInput for a table that cannot be read."""
        samples = []
        while data := self._data():
            *whole, self.unfinished = (self.unfinished + data).split(b"\n")
            if len(self.unfinished) > LINE_LIMIT:
                self.unfinished = b""
            for line in whole:
                self.lines += 1
                if self.lines <= self.repeated:
                    continue
                try:
                    sample = self.table.sample(line.decode("utf-8", "replace").lstrip("\ufeff"))
                except BadInput as error:
                    raise BadInput(f"{self.name}, line {self.lines}: {error}") from None
                if sample is not None and self.begun:
                    samples.append((self.clock.here(sample[0], now), sample[1]))
        self.begun = True
        return samples

    def _data(self):
        data = self.read()
        if data is None:
            self.repeated, self.lines, self.unfinished = max(self.repeated, self.lines), 0, b""
            data = self.read()
        return data


def open_cart(text: str) -> Cart:
    """Return the Cart of "tcp:HOST:PORT", "serial:DEVICE", "serial:DEVICE@BAUD", "lsl:STREAM", or the path of a file.

    A file may appear later. Raises BadInput for a source that cannot be opened.
    """
    kind, colon, rest = text.partition(":")
    if colon and kind == "tcp":
        return Cart(_Tcp(rest).read, text)
    if colon and kind == "serial":
        return Cart(_serial(rest), text)
    if colon and kind == "lsl":
        return Cart(_lsl(rest), text)
    return Cart(_File(text).read, text)


class _File:
    """File that grows, or that another program writes again and again; or a named pipe."""

    def __init__(self, path):
        self.path, self.descriptor, self.position = path, -1, 0
        if os.path.isdir(path):
            raise BadInput(f"--cost {path} is a folder: pass the file that the cart writes")
        if not os.path.isdir(os.path.dirname(path) or "."):
            raise BadInput(f"--cost {path}: there is no folder {os.path.dirname(path)}")
        self._open()

    def _open(self):
        try:
            self.descriptor = os.open(self.path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        except FileNotFoundError:
            return
        except OSError as error:
            raise BadInput(f"--cost {self.path}: {error.strerror}") from None
        self.position = 0

    def read(self) -> bytes | None:
        if self.descriptor < 0:
            self._open()
            if self.descriptor < 0:
                return b""
        here = os.fstat(self.descriptor)
        if stat.S_ISREG(here.st_mode):
            with suppress(OSError):
                there = os.stat(self.path)
                if here.st_ino != there.st_ino or here.st_size < self.position:  # another file, or it begins again
                    os.close(self.descriptor)
                    self.descriptor = -1
                    return None
        try:
            data = os.read(self.descriptor, READ_SIZE)
        except OSError:  # a pipe without data, a network folder that is unreachable
            return b""
        self.position += len(data)
        return data


class _Tcp:
    """Connection to a server that sends lines. A lost one is made again."""

    def __init__(self, address):
        host, _, port = address.rpartition(":")
        if not host or not port.isdecimal() or not 0 < int(port) < 65536:
            raise BadInput(f"--cost tcp:{address}: expected tcp:HOST:PORT, as in tcp:192.168.0.20:5000")
        self.address, self.due = (host, int(port)), 0.0
        self.end: Any = None
        try:
            self._connect(CONNECT_TIMEOUT)
        except OSError as error:
            raise BadInput(f"--cost tcp:{address}: cannot connect: {error.strerror or error}") from None

    def _connect(self, timeout):
        self.end = socket.create_connection(self.address, timeout)
        self.end.setblocking(False)

    def read(self) -> bytes:
        if self.end is None and time.monotonic() >= self.due:
            self.due = time.monotonic() + RECONNECT_PERIOD
            with suppress(OSError):
                self._connect(RECONNECT_TIMEOUT)
        if self.end is None:
            return b""
        try:
            data = self.end.recv(READ_SIZE)
        except BlockingIOError:
            return b""
        except OSError:
            data = b""
        if not data:
            self.end.close()
            self.end = None
        return data


def _serial(place):
    """Return a function that reads a serial port. place : DEVICE or DEVICE@BAUD"""
    import serial

    path, at, baud = place.partition("@")
    if at and not baud.isdecimal():
        raise BadInput(f"--cost serial:{place}: expected serial:DEVICE@BAUD, as in serial:/dev/ttyUSB0@9600")
    try:
        port = serial.Serial(path, int(baud or BAUD_RATE), timeout=0)
    except (OSError, ValueError) as error:
        reason = os.strerror(getattr(error, "errno", None) or errno.EINVAL)
        raise BadInput(f"--cost serial:{place}: {reason}") from None

    def read():
        try:
            return port.read(READ_SIZE)
        except OSError:  # the adapter was unplugged: a measurement without samples
            return b""

    return read


def _lsl(name):
    """Return a function that reads a stream of the Lab Streaming Layer as a table, with its labels and units."""
    from runtime.host.liblsl import Inlet, found

    infos = found(name)
    if len(infos) != 1:
        raise BadInput(f"--cost lsl:{name}: {len(infos)} streams have this name, expected 1")
    try:
        inlet = Inlet(infos[0])
    except OSError as error:
        raise BadInput(f"--cost lsl:{name}: {error.strerror}") from None
    inlet.correction()  # from then on it sees a restart of the sender
    waiting = ["\t".join(["time (s)", *(f"{label} ({unit})" for label, unit in inlet.about["channels"])])]

    def read():
        try:
            samples, stamps = inlet.pull(0.0)
        except OSError:  # it is lost permanently: a measurement without samples
            return b""
        lines = ["\t".join(map(repr, (stamp, *sample))) for sample, stamp in zip(samples, stamps)]
        text = "".join(f"{line}\n" for line in (*waiting, *lines))
        waiting.clear()
        return text.encode()

    return read
