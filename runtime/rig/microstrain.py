"""MicroStrain's sensors on a rig: found by the last digits of their serial numbers wherever they are plugged in, and
set up.

    idle, ping, device information     who is it?
    descriptors                        what commands and data does it have?
    base rate, formats                 what it shall tell, and how often
    heading source, low-pass           where the block says so
    streams, resume

Two generations differ: the older has a format of its own for each set and calls the streams 1 and 3, the newer has one
for all (0C 0F) and calls a stream by its set. What was sent is what a sensor is told again when it has been away.
"""

import glob
import os
import struct
from concurrent.futures import ThreadPoolExecutor

from blocks.imus.microstrain import mip
from blocks.imus.microstrain.descriptors import BY_NAME, FILTER, SENSOR
from runtime.rig import ports
from runtime.rig.errors import Refused, Trouble
from runtime.rig.mip_port import MipPort, Refusal, Silent
from runtime.rig.serial_line import let_go
from runtime.rig.streams import Opened

PORTS = "TICKWORK_PORTS"  # in the environment: patterns of the ports to look at, in place of what pyserial lists
VENDORS = (0x199B, 0x0403, 0x10C4, 0x067B, 0x1A86)  # MicroStrain, and makers of USB adapters
BAUDRATES = "115200 and 921600 are what MicroStrain sells"
QUICK = 0.25  # s, in which one that is asked who it is answers
GENERIC_FORMAT, GENERIC_BASE_RATE = 0x0C0F, 0x0C0E
# commands format and base rate, its reply, stream
LEGACY = {SENSOR: (0x08, 0x06, 0x83, 1), FILTER: (0x0A, 0x0B, 0x8A, 3)}
HEADING, MEASUREMENT, MAGNETIC_FIELD = 0x0D18, 0x0D50, 0x8006
INVALID_PARAMETER = 3  # of an acknowledgement
MAGNETOMETER_HEADING, MAGNETOMETER_MEASUREMENT = 1, 4
NEW_LOW_PASS, OLD_LOW_PASS = 0x0C54, 0x0C50


def open_lines(devices):
    """{device: Opened or Trouble}"""
    found, waiting, seen = {}, [], Seen()
    for device in devices:
        if device.port:
            found[device] = attempt(
                device, lambda: opened(device, ports.open_port(device.path, device.port, device.baudrate))
            )
        else:
            waiting.append(device)
    if waiting:
        seen.look(waiting[0].baudrate, [device.serial for device in waiting])
    with ThreadPoolExecutor(8) as pool:  # each waits for its own sensor
        for device in waiting:
            found[device] = pool.submit(attempt, device, lambda device=device: opened(device, seen.take(device)))
        found = {
            device: answer if not hasattr(answer, "result") else answer.result() for device, answer in found.items()
        }
    seen.close()
    return {device: found[device] for device in devices}


def attempt(device, make):
    try:
        return make()
    except Refused as refused:
        return refused.trouble


def candidates():
    """Paths of ports that a sensor may be behind, those of the vendor first."""
    if os.environ.get(PORTS):
        return sorted(path for pattern in os.environ[PORTS].split(os.pathsep) for path in glob.glob(pattern))
    there = [port for port in ports.listed() if port.vid in VENDORS]
    return [port.device for port in sorted(there, key=lambda port: VENDORS.index(port.vid))]


class Seen:
    """The sensors of this machine that nobody else has open.

    open : {path: (MipPort, Information)}; troubles : of ports that could not be asked; silent : paths where no sensor
        answers
    """

    def __init__(self):
        self.open, self.troubles, self.silent = {}, [], []

    def look(self, baudrate, wanted=None):
        """Ask every port at once who is there. wanted : digits; None for all"""
        paths = candidates()
        with ThreadPoolExecutor(max(1, len(paths))) as pool:
            for path, found in zip(paths, pool.map(lambda path: self.ask(path, baudrate), paths)):
                if isinstance(found, Trouble):
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
        sensor = MipPort(port)
        try:
            return sensor, sensor.identify(2, QUICK)
        except (Silent, Refusal, ValueError, OSError):
            port.close()
            return None

    def take(self, device):
        """The open port of the sensor whose serial number ends as the device's. Refused"""
        where = f'[device."{device.path}"]'
        found = [path for path, (_, about) in self.open.items() if about.ends_with(device.serial)]
        if len(found) == 1:
            return self.open.pop(found[0])[0].port
        if not device.serial:
            raise Refused(
                Trouble(
                    "TW127",
                    f"{where} names neither a serial number nor a port",
                    f'write serial = "133931"; {self.words()}',
                )
            )
        what = f"{len(found)} sensors have" if found else "no sensor has"
        raise Refused(
            Trouble(
                "TW127", f'{where} serial = "{device.serial}": {what} this ending of the serial number', self.words()
            )
        )

    def words(self):
        seen = ", ".join(f"{about.serial} ({about.model}, {path})" for path, (_, about) in sorted(self.open.items()))
        words = [f"seen: {seen}" if seen else "no MicroStrain sensor was seen"]
        words += [f"{trouble.message}: {trouble.hint}" for trouble in self.troubles]
        if self.silent:
            words.append(f"no sensor answers on {', '.join(self.silent)}")
        return "; ".join(words)

    def close(self):
        for sensor, _ in self.open.values():
            sensor.port.close()
        self.open.clear()


def opened(device, port):
    """Set the sensor behind an open port up. Refused"""
    where, path = f'[device."{device.path}"] {port.port}', port.port
    sensor = MipPort(port)
    try:
        about = sensor.identify()
        if device.serial and not about.ends_with(device.serial):
            raise Refused(
                Trouble(
                    "TW127",
                    f'{where} serial = "{device.serial}": that sensor is {about.serial}',
                    "correct one of the two",
                )
            )
        setup = SetUp(device, sensor, sensor.known())
        setup.send()
    except Silent:
        port.close()
        raise Refused(
            Trouble(
                "TW128",
                f"{where}: no MicroStrain sensor answers at {device.baudrate} bit/s",
                f"is that its port, and its supply on? With a real serial line: its baud rate; {BAUDRATES}",
            )
        ) from None
    except (Refused, OSError, ValueError) as error:
        port.close()
        if isinstance(error, Refused):
            raise
        raise Refused(Trouble("TW128", f"{where}: {error}", "unplug it, and plug it in again")) from None
    remarks = tuple(f"{path}: {about.model} {about.serial} {remark}" for remark in setup.remarks)
    return Opened(
        let_go(port), path, path=ports.by_id(path), setup=tuple(setup.messages), remarks=remarks, proof=sensor.proof()
    )


class SetUp:
    """
    device : blocks.imus.MicroStrain; sensor : MipPort; known : what the sensor has

    messages : that set it up, once they were sent; remarks : what a person should know
    """

    def __init__(self, device, sensor, known):
        self.device, self.sensor, self.known = device, sensor, known
        self.newer = GENERIC_FORMAT in known
        self.messages, self.remarks = [mip.command(mip.BASE, mip.IDLE)], []

    def send(self):
        formats = {descriptor_set: self.fields(descriptor_set) for descriptor_set in (SENSOR, FILTER)}
        lacking = [field.name for field in self.device.fields if not self.has(field)]
        if lacking:
            self.remarks.append(f"has no {', '.join(lacking)}: those outputs are NaN")
        if not any(formats.values()):
            self.refuse(
                f"it has none of {', '.join(field.name for field in self.device.fields)}",
                "ask for what it has: channels=...",
            )
        for descriptor_set, fields in formats.items():
            if self.has_set(descriptor_set):
                self.format(descriptor_set, fields)
        self.heading()
        self.low_pass()
        for descriptor_set, fields in formats.items():
            if self.has_set(descriptor_set):
                stream = descriptor_set if self.newer else LEGACY[descriptor_set][3]
                self.tell(mip.command(mip.COMMAND_3DM, 0x11, "BBB", mip.WRITE, stream, bool(fields)), "its stream")
        self.tell(mip.command(mip.BASE, mip.RESUME), "to resume")

    def has(self, field):
        return field.set << 8 | field.descriptor in self.known or (
            field.set == 0x100
            and any(descriptor_set << 8 | field.descriptor in self.known for descriptor_set in (SENSOR, FILTER))
        )

    def has_set(self, descriptor_set):
        return any(number >> 8 == descriptor_set for number in self.known)

    def fields(self, descriptor_set):
        """Descriptors that the set is asked for, its time first; [] for none."""
        wanted = [
            field.descriptor
            for field in self.device.fields
            if field.set in (descriptor_set, 0x100) and descriptor_set << 8 | field.descriptor in self.known
        ]
        own = [field for field in self.device.fields if field.set == descriptor_set and self.has(field)]
        if not own:
            return []
        legacy = BY_NAME["sensor_time" if descriptor_set == SENSOR else "filter_time"].descriptor
        time_of = next((number for number in (0xD5, 0xD3, legacy) if descriptor_set << 8 | number in self.known), None)
        return list(dict.fromkeys(([] if time_of is None else [time_of]) + wanted))

    def format(self, descriptor_set, fields):
        decimation = self.decimation(descriptor_set) if fields else 1
        body = b"".join(struct.pack(">BH", field, decimation) for field in fields)
        if self.newer:
            data = bytes((mip.WRITE, descriptor_set, len(fields))) + body
            packet = mip.packet(mip.COMMAND_3DM, (GENERIC_FORMAT & 0xFF, data))
        else:
            packet = mip.packet(mip.COMMAND_3DM, (LEGACY[descriptor_set][0], bytes((mip.WRITE, len(fields))) + body))
        self.tell(packet, f"the format of set {descriptor_set:02X}: {' '.join(f'{field:02X}' for field in fields)}")

    def decimation(self, descriptor_set):
        """By what its base rate has to be divided. Refused where that is no whole number"""
        if self.newer and GENERIC_BASE_RATE in self.known:
            [base] = struct.unpack(
                ">H", self.ask(mip.command(mip.COMMAND_3DM, 0x0E, "B", descriptor_set), "its base rate")[0x8E][1:3]
            )
        else:
            _, command, reply, _ = LEGACY[descriptor_set]
            [base] = struct.unpack(">H", self.ask(mip.command(mip.COMMAND_3DM, command), "its base rate")[reply][:2])
        ratio = base / self.device.rate
        if ratio < 1.0 - 1e-6 or abs(ratio - round(ratio)) > 1e-6:
            near = sorted({base / divisor for divisor in (int(ratio) or 1, int(ratio) + 1)}, reverse=True)
            self.refuse(
                f"{self.device.rate:g} Hz is not its base rate, {base} Hz, divided by a whole number",
                f"take {' or '.join(f'{rate:g}' for rate in near)} Hz",
            )
        return round(ratio)

    def heading(self):
        if not self.device.heading:
            return
        magnetic = self.device.heading == "magnetometer"
        if magnetic and (MAGNETIC_FIELD not in self.known or not {HEADING, MEASUREMENT} & set(self.known)):
            why = "no magnetometer" if MAGNETIC_FIELD not in self.known else "no command that says so"
            self.refuse(
                f"its filter cannot take its heading from a magnetometer: it has {why}",
                'leave `heading` out, or give it "none"',
            )
        if HEADING in self.known:
            self.tell(
                mip.command(mip.COMMAND_FILTER, 0x18, "BB", mip.WRITE, MAGNETOMETER_HEADING * magnetic),
                "its heading source",
            )
        elif MEASUREMENT in self.known:
            self.measure(magnetic)
        else:
            self.remarks.append("has no command for its heading source: it stays as it is")

    def measure(self, magnetic):
        """Whether its filter uses the magnetometer, of the newer generation: as MicroStrain's own examples for that
        tell it.

        One without a magnetometer says that there is no such source, and so it is as it was asked not to be used.
        """
        packet = mip.command(mip.COMMAND_FILTER, 0x50, "BHB", mip.WRITE, MAGNETOMETER_MEASUREMENT, magnetic)
        try:
            self.sensor.ask(packet)
        except Refusal as refusal:
            if magnetic or refusal.code != INVALID_PARAMETER:
                self.refuse(f"its heading source: {refusal}", "its own program, SensorConnect, shows what it takes")
        else:
            self.messages.append(packet)

    def low_pass(self):
        cutoff = self.device.low_pass
        if cutoff <= 0.0:
            return
        for name in ("accel", "gyro", "mag"):
            field = BY_NAME[name]
            if not self.has(field) or field not in self.device.fields:
                continue
            if NEW_LOW_PASS in self.known:
                self.tell(
                    mip.command(mip.COMMAND_3DM, 0x54, "BBBBBf", mip.WRITE, SENSOR, field.descriptor, 1, 1, cutoff),
                    f"the low-pass of {name}",
                )
            elif OLD_LOW_PASS in self.known:
                self.tell(
                    mip.command(mip.COMMAND_3DM, 0x50, "BBBBHB", mip.WRITE, field.descriptor, 1, 1, round(cutoff), 0),
                    f"the low-pass of {name}",
                )
            else:
                self.remarks.append("has no command for its low-pass: it stays as it is")
                return

    def tell(self, packet, what):
        """A setting, kept for when the sensor comes back."""
        self.ask(packet, what)
        self.messages.append(packet)

    def ask(self, packet, what):
        try:
            return self.sensor.ask(packet)
        except Refusal as refusal:
            self.refuse(f"{what}: {refusal}", "its own program, SensorConnect, shows what it takes")

    def refuse(self, message, hint):
        raise Refused(Trouble("TW129", f'[device."{self.device.path}"] {self.sensor.port.port}: {message}', hint))
