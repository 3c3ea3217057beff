"""Relays that drop without frames: frames to the devices that hold them, outside a tick."""

from libc.stdint cimport int64_t

from cext.abi cimport FRAMES_PER_DEVICE, Frame
from cext.clock.deadline_clock cimport monotonic
from cext.schedule.buses cimport Buses
from cext.schedule.device_table cimport Device, DeviceTable


cdef inline int pump(DeviceTable table, Buses buses, Device *device, int64_t now) noexcept nogil:
    """Send the next frame of a device that holds a relay. Only those of a safe stop pass the fence."""
    cdef Frame[FRAMES_PER_DEVICE] frames
    cdef int count = device.encode(table.arena, device.encode_slots, device.encode_sizes, frames)
    device.pumped = now
    return buses.send(device.bus, frames, max(count, 0), now, table.stopping)


cdef inline int pump_all(DeviceTable table, Buses buses, int64_t now) noexcept nogil:
    """Send frames to the devices that hold relays, while the drives behind the relays start."""
    cdef int number
    cdef int status = 0
    for number in range(table.count):
        if table.devices[number].relay > 0:
            status |= pump(table, buses, &table.devices[number], now)
    return buses.status(status, False)


cdef inline bint holds_relay(DeviceTable table, Buses buses, const Device *device, int64_t now) noexcept nogil:
    """Return whether a relay has not dropped since its last frame.

    now : ns since the start of the run. On a rig the clock is read again, as the process may have been suspended.
    """
    return (monotonic() - buses.began if table.alone else now) - device.pumped < device.relay
