"""What a rig changes in a diagram: hardware parameters of its devices, and the bitrates of its buses. Controllers stay
as they are.
"""

from graph import Device, DiagramError
from graph.names import suggestion
from runtime.rig.errors import RigError, Trouble


def override(rig, diagram):
    """Make the diagram that of the rig, before it is compiled. RigError with everything in which the two do not fit.

    rig : RigFile
    """
    devices = {block.path: block for block in diagram if isinstance(block, Device)}
    troubles = list(unmapped(rig, {block.bus for block in devices.values() if block.medium != "stream"}))
    for path, values in rig.devices.items():
        if path in devices:
            troubles += changed(devices[path], values)
        else:
            troubles.append(stranger(path, diagram, devices))
    troubles += other_bitrates(rig, devices.values())
    if troubles:
        raise RigError(rig.path, troubles)
    for block in devices.values():
        if block.medium == "can":
            block.bitrate = float(rig.buses[block.bus].bitrate)


def other_bitrates(rig, devices):
    """Devices that are set to another bitrate than their bus has, where they know theirs."""
    for device in devices:
        bus = rig.buses.get(device.bus)
        if bus is not None and "bitrate" in device.parameters and device.bitrate != bus.bitrate:
            yield Trouble(
                "TW103",
                f"[bus.{device.bus}] has {bus.bitrate / 1e3:g} kbit/s, and {device.path} is set to "
                f"{device.bitrate / 1e3:g} kbit/s",
                f"give it a bus of its own, or set the device itself to {bus.bitrate / 1e3:g} kbit/s and say so: "
                f'[device."{device.path}"] '
                f"bitrate = {bus.bitrate}",
            )


def unmapped(rig, wanted):
    for name in sorted(wanted - rig.buses.keys()):
        near = suggestion(name, rig.buses.keys() - wanted)
        yield Trouble(
            "TW104",
            f"nothing stands behind the bus {name!r}" + (f"; {near}" if near else ""),
            f'add [bus.{name}] with interface = "socketcan" and channel = "can0"',
        )


def stranger(path, diagram, devices):
    """A path at which there is no device."""
    if path in diagram.blocks:
        kind = type(diagram.blocks[path]).__name__
        return Trouble(
            "TW103",
            f'[device."{path}"] is a {kind} and no device',
            f"a rig changes hardware alone; for one run, --set {path}.PARAMETER=VALUE changes any block",
        )
    return Trouble(
        "TW103",
        f'[device."{path}"]: {diagram.name} has no such device',
        suggestion(path, devices) or f"its devices are {', '.join(sorted(devices)) or 'none'}",
    )


def changed(device, values):
    """Set what is right; yield a Trouble for each value that is not."""
    for name, value in values.items():
        entry = f'[device."{device.path}"] {name}'
        if name not in device.hardware:
            known = f"{type(device).__name__} has {', '.join(device.hardware) or 'none'}"
            if name in device.parameters:
                yield Trouble("TW103", f"{entry} is no hardware parameter", f"set it in the diagram; {known}")
            else:
                yield Trouble(
                    "TW103", f"{entry}: there is no such parameter", suggestion(name, device.hardware) or known
                )
            continue
        try:
            device.set(name, value)
        except DiagramError as error:
            message = error.diagnostics[0].message.removeprefix(f"{name}: ")
            yield Trouble("TW103", f"{entry} = {value!r}: {message}", device.parameters[name].description)
