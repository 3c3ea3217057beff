"""Serial lines whose devices are identified and set up by a dialogue.

A device is found by the last digits of its serial number, at any port. The block's `opening` returns serial, port and
baudrate; graph.StreamDevice has the dialogues.
"""

from __future__ import annotations

import glob
import os
import time
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING

from graph import StreamDevice
from graph.dialogue import NoReply, Rejected
from runtime.robot.rig import ports
from runtime.robot.rig.errors import Refused, RigProblem
from runtime.robot.rig.line import Opened, detach

if TYPE_CHECKING:
    from collections.abc import Sequence
    from typing import Any

    from serial import Serial

    from graph.dialogue import Dialogue


PORTS = "TICKWORK_PORTS"  # in the environment: patterns of the ports to look at, in place of what pyserial lists
ADAPTERS = (0x0403, 0x10C4, 0x067B, 0x1A86)  # USB vendor ids of makers of serial adapters
SCAN_ATTEMPTS = 2
READ_PERIOD = 0.0005  # s


def converse(port: Serial, dialogue: Dialogue) -> Any:
    """Carry a dialogue out on an open pyserial port; return its result."""
    reply, deadline = None, 0.0
    while True:
        try:
            exchange = dialogue.send(reply)
        except StopIteration as end:
            return end.value
        if exchange.data:
            port.write(exchange.data)
            deadline = time.monotonic() + exchange.timeout
        reply = b""
        while not reply and time.monotonic() < deadline:
            reply = port.read(4096)
            if not reply:
                time.sleep(READ_PERIOD)


def open_lines(devices: Sequence[StreamDevice]) -> dict[StreamDevice, Opened | RigProblem]:
    """Open the lines of `devices`, at the ports that they name or by the serial numbers of the sensors."""
    results, waiting, seen = {}, [], Seen({type(device) for device in devices})
    for device in devices:
        options = device.opening()
        if options["port"]:
            results[device] = _attempt(
                device, lambda: _set_up(device, ports.open_port(device.path, options["port"], options["baudrate"]))
            )
        else:
            waiting.append(device)
    if waiting:
        seen.look(waiting[0].opening()["baudrate"])
    with ThreadPoolExecutor(8) as pool:  # each waits for its own device
        pending = {
            device: pool.submit(_attempt, device, lambda device=device: _set_up(device, seen.take(device)))
            for device in waiting
        }
        results |= {device: answer.result() for device, answer in pending.items()}
    seen.close()
    return {device: results[device] for device in devices}


def _attempt(device, make):
    """Return the result of a function, or the RigProblem that it raised as Refused."""
    try:
        return make()
    except Refused as refused:
        return refused.problem


def _candidates(own):
    """Return the paths of ports that may belong to a device, those of its own USB vendor ids first."""
    if os.environ.get(PORTS):
        return sorted(path for pattern in os.environ[PORTS].split(os.pathsep) for path in glob.glob(pattern))
    vendors = (*own, *ADAPTERS)
    known = [port for port in ports.list_ports() if port.vid in vendors]
    return [port.device for port in sorted(known, key=lambda port: vendors.index(port.vid))]


@dataclass
class Sensor:
    """A device that has identified itself. kind : class of its block; port : open pyserial.Serial; about : identity"""

    kind: type[StreamDevice]
    port: Serial
    about: Any


class Seen:
    """Sensors of some kinds at the serial ports of this machine that no other process has open.

    kinds : classes of graph.StreamDevice

    open : {path: Sensor}
    problems : problems of the ports that could not be opened
    silent : paths of ports without an answer
    """

    def __init__(self, kinds: Iterable[type[StreamDevice]]) -> None:
        self.kinds = sorted(kinds, key=lambda kind: kind.__name__)
        self.open, self.problems, self.silent = {}, [], []

    def look(self, baudrate: int) -> Seen:
        """Identify the sensors at all ports at once. baudrate : bit/s"""
        paths = _candidates([vendor for kind in self.kinds for vendor in kind.usb_vendors])
        with ThreadPoolExecutor(max(1, len(paths))) as pool:
            for path, result in zip(paths, pool.map(lambda path: self._identify(path, baudrate), paths)):
                if isinstance(result, RigProblem):
                    self.problems.append(result)
                elif result is None:
                    self.silent.append(path)
                else:
                    self.open[path] = result
        return self

    def _identify(self, path, baudrate):
        """Return the Sensor at a port, None if none answers, or the RigProblem of the port."""
        try:
            port = ports.open_port("", path, baudrate)
        except Refused as refused:
            return refused.problem
        for kind in self.kinds:
            if kind.identify is None:
                continue
            try:
                return Sensor(kind, port, converse(port, kind.identify(SCAN_ATTEMPTS)))
            except (NoReply, ValueError, OSError):
                continue
        port.close()
        return None

    def take(self, device: StreamDevice) -> Serial:
        """Return the open port of the device whose serial number ends as given. Raises Refused."""
        where, serial = f'[device."{device.path}"]', device.opening()["serial"]
        matches = [
            path
            for path, sensor in self.open.items()
            if isinstance(device, sensor.kind) and sensor.about.ends_with(serial)
        ]
        if len(matches) == 1:
            return self.open.pop(matches[0]).port
        if not serial:
            message = f"{where} has neither a serial number nor a port"
            raise Refused(RigProblem("TW127", message, f'write serial = "133931"; {self._ports_text(device)}'))
        what = f"{len(matches)} sensors have" if matches else "no sensor has"
        message = f'{where} serial = "{serial}": {what} a serial number with this ending'
        raise Refused(RigProblem("TW127", message, self._ports_text(device)))

    def _ports_text(self, device):
        """Return a hint on the sensors that responded, and on the ports without one."""
        seen = ", ".join(
            f"{sensor.about.serial} ({sensor.about.model}, {path})" for path, sensor in sorted(self.open.items())
        )
        words = [f"found: {seen}" if seen else f"no {device.sensor} was found"]
        words += [f"{problem.message}: {problem.hint}" for problem in self.problems]
        if self.silent:
            words.append(f"no sensor responds on {', '.join(self.silent)}")
        return "; ".join(words)

    def close(self) -> None:
        """Close the ports that were not taken."""
        for sensor in self.open.values():
            sensor.port.close()
        self.open.clear()


def _set_up(device, port):
    """Identify and set up the device behind an open port; return its Opened. Raises Refused."""
    where, path, options = f'[device."{device.path}"] {port.port}', port.port, device.opening()
    try:
        about = converse(port, device.identify())
        if options["serial"] and not about.ends_with(options["serial"]):
            message = f'{where} serial = "{options["serial"]}": that sensor is {about.serial}'
            raise Refused(RigProblem("TW127", message, "correct one of the two"))
        messages, remarks, settings = converse(port, device.set_up())
        line = Opened(detach(port), path, path=ports.by_id(path), setup=tuple(messages), proof=about.proof())
    except NoReply:
        port.close()
        message = f"{where}: no {device.sensor} responds at {options['baudrate']} bit/s"
        hint = f"check the port, the supply and, on a hardware serial port, the baud rate; {device.remedy}"
        raise Refused(RigProblem("TW128", message, hint)) from None
    except Refused:
        port.close()
        raise
    except Rejected as rejected:
        port.close()
        raise Refused(RigProblem("TW129", f"{where}: {rejected}", rejected.hint)) from None
    except (OSError, ValueError) as error:
        port.close()
        raise Refused(RigProblem("TW128", f"{where}: {error}", "unplug the sensor and plug it in again")) from None
    line.settings = {"sensor": f"{about.model} {about.serial}, firmware {about.firmware}", **settings}
    line.remarks = tuple(f"{path}: {about.model} {about.serial} {remark}" for remark in remarks)
    return line
