"""Serial lines whose devices are identified and set up by a dialogue, found by the last digits of a serial number at
whatever port they are plugged in.

What a block returns in `opening`: serial, port, baudrate; graph.StreamDevice has the dialogues.
"""

import glob
import os
import time
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

from graph import StreamDevice
from graph.dialogue import NoReply, Rejected
from runtime.rig import ports
from runtime.rig.errors import Refused, RigProblem
from runtime.rig.line import Opened, let_go

PORTS = "TICKWORK_PORTS"  # in the environment: patterns of the ports to look at, in place of what pyserial lists
ADAPTERS = (0x0403, 0x10C4, 0x067B, 0x1A86)  # USB vendor ids of makers of serial adapters
SCAN_ATTEMPTS = 2
READ_PERIOD = 0.0005  # s


def converse(port, dialogue):
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


def open_lines(devices):
    """Return {device: Opened or RigProblem}."""
    found, waiting, seen = {}, [], Seen({type(device) for device in devices})
    for device in devices:
        wanted = device.opening()
        if wanted["port"]:
            found[device] = attempt(
                device, lambda: opened(device, ports.open_port(device.path, wanted["port"], wanted["baudrate"]))
            )
        else:
            waiting.append(device)
    if waiting:
        seen.look(waiting[0].opening()["baudrate"])
    with ThreadPoolExecutor(8) as pool:  # each waits for its own device
        pending = {
            device: pool.submit(attempt, device, lambda device=device: opened(device, seen.take(device)))
            for device in waiting
        }
        found |= {device: answer.result() for device, answer in pending.items()}
    seen.close()
    return {device: found[device] for device in devices}


def attempt(device, make):
    try:
        return make()
    except Refused as refused:
        return refused.trouble


def candidates(own):
    """Return paths of ports that a device may be behind, those of its own USB vendor ids first."""
    if os.environ.get(PORTS):
        return sorted(path for pattern in os.environ[PORTS].split(os.pathsep) for path in glob.glob(pattern))
    vendors = (*own, *ADAPTERS)
    there = [port for port in ports.listed() if port.vid in vendors]
    return [port.device for port in sorted(there, key=lambda port: vendors.index(port.vid))]


@dataclass
class Sensor:
    """A device that has identified itself. kind : class of its block; port : open pyserial.Serial; about : identity"""

    kind: type
    port: object
    about: object


class Seen:
    """The devices of some kinds at serial ports of this machine that no other process has open.

    kinds : classes of graph.StreamDevice

    open : {path: Sensor}; troubles : of ports that could not be opened; silent : paths without an answer
    """

    def __init__(self, kinds: Iterable[type[StreamDevice]]):
        self.kinds = sorted(kinds, key=lambda kind: kind.__name__)
        self.open, self.troubles, self.silent = {}, [], []

    def look(self, baudrate):
        """Ask at every port at once."""
        paths = candidates([vendor for kind in self.kinds for vendor in kind.usb_vendors])
        with ThreadPoolExecutor(max(1, len(paths))) as pool:
            for path, found in zip(paths, pool.map(lambda path: self.ask(path, baudrate), paths)):
                if isinstance(found, RigProblem):
                    self.troubles.append(found)
                elif found is None:
                    self.silent.append(path)
                else:
                    self.open[path] = found
        return self

    def ask(self, path, baudrate):
        try:
            port = ports.open_port("", path, baudrate)
        except Refused as refused:
            return refused.trouble
        for kind in self.kinds:
            if kind.identify is None:
                continue
            try:
                return Sensor(kind, port, converse(port, kind.identify(SCAN_ATTEMPTS)))
            except (NoReply, ValueError, OSError):
                continue
        port.close()
        return None

    def take(self, device):
        """Return the open port of the device whose serial number ends as given. Refused"""
        where, serial = f'[device."{device.path}"]', device.opening()["serial"]
        found = [
            path
            for path, sensor in self.open.items()
            if isinstance(device, sensor.kind) and sensor.about.ends_with(serial)
        ]
        if len(found) == 1:
            return self.open.pop(found[0]).port
        if not serial:
            message = f"{where} has neither a serial number nor a port"
            raise Refused(RigProblem("TW127", message, f'write serial = "133931"; {self.words(device)}'))
        what = f"{len(found)} sensors have" if found else "no sensor has"
        message = f'{where} serial = "{serial}": {what} a serial number with this ending'
        raise Refused(RigProblem("TW127", message, self.words(device)))

    def words(self, device):
        seen = ", ".join(
            f"{sensor.about.serial} ({sensor.about.model}, {path})" for path, sensor in sorted(self.open.items())
        )
        words = [f"found: {seen}" if seen else f"no {device.sensor} was found"]
        words += [f"{trouble.message}: {trouble.hint}" for trouble in self.troubles]
        if self.silent:
            words.append(f"no sensor responds on {', '.join(self.silent)}")
        return "; ".join(words)

    def close(self):
        for sensor in self.open.values():
            sensor.port.close()
        self.open.clear()


def opened(device, port):
    """Set the device behind an open port up; return its Opened. Refused"""
    where, path, wanted = f'[device."{device.path}"] {port.port}', port.port, device.opening()
    try:
        about = converse(port, device.identify())
        if wanted["serial"] and not about.ends_with(wanted["serial"]):
            message = f'{where} serial = "{wanted["serial"]}": that sensor is {about.serial}'
            raise Refused(RigProblem("TW127", message, "correct one of the two"))
        messages, remarks = converse(port, device.set_up())
        line = Opened(let_go(port), path, path=ports.by_id(path), setup=tuple(messages), proof=about.proof())
    except NoReply:
        port.close()
        message = f"{where}: no {device.sensor} responds at {wanted['baudrate']} bit/s"
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
    line.remarks = tuple(f"{path}: {about.model} {about.serial} {remark}" for remark in remarks)
    return line
