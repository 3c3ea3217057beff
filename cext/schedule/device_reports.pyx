# cython: freethreading_compatible=True
"""What the devices of a run report to Python, by path."""

from cext.clock.histogram cimport summary
from cext.abi cimport FRAME_BYTES
from cext.safety.drive_watch cimport DriveWatch
from cext.schedule.buses cimport Buses
from cext.schedule.device_table cimport Device, DeviceTable


cdef class DeviceReports:
    """Reports of the devices of one schedule."""
    cdef DeviceTable table
    cdef Buses buses
    cdef DriveWatch drives
    cdef list names

    def __init__(self, DeviceTable table, Buses buses, DriveWatch drives):
        self.table, self.buses, self.drives = table, buses, drives
        self.names = [device.name for device in table.schedule.devices]

    @property
    def culprit(self) -> str | None:
        """Path of the device or bus that failed last, or None."""
        if self.table.failed >= 0:
            return self.names[self.table.failed]
        return self.table.schedule.buses[self.buses.failed] if self.buses.failed >= 0 else None

    @property
    def silent(self) -> list[str]:
        """Paths of the devices with too few replies, or not ready."""
        return [
            name for index, name in enumerate(self.names) if not self.table.has_answered(&self.table.devices[index])]

    @property
    def unready(self) -> list[str]:
        """Paths of the devices that reply but have not returned what arming wrote."""
        return [
            name for index, name in enumerate(self.names)
            if self.table.devices[index].ready >= 0 and self.table.devices[index].answered
            and self.table.arena[self.table.devices[index].ready] == 0.0]

    @property
    def found_enabled(self) -> list[str]:
        """Paths of the drives that replied as enabled ones before arming has enabled them."""
        return [name for index, name in enumerate(self.names) if self.table.devices[index].was_enabled]

    @property
    def enabling(self) -> bool:
        """Whether arming enables the actuators, or has enabled them."""
        return self.table.count > 0 and self.table.devices[0].enabling

    @property
    def unzeroed(self) -> list[str]:
        """Paths of the devices whose zero arming has not set, although they reply."""
        return [
            name for index, name in enumerate(self.names)
            if self.table.devices[index].zeroing.due and self.table.has_replied(&self.table.devices[index])]

    @property
    def latencies(self) -> dict[str, dict[str, float]]:
        """{path: cext.clock.histogram.summary of its reply times in s} of the timed devices."""
        return {
            name: summary(self.table.devices[index].latency)
            for index, name in enumerate(self.names) if self.table.devices[index].latency != NULL}

    @property
    def transits(self) -> dict[str, float]:
        """{path: s, longest certain time from the tick of a command to its reply} of the drives that answer commands.
        """
        return {
            name: 1e-9 * self.table.devices[index].transit.longest
            for index, name in enumerate(self.names)
            if self.table.devices[index].transit.answers and self.table.devices[index].transit.measured}

    @property
    def missed(self) -> dict[str, int]:
        """{path: commands without a reply before the next one, from tick `count_from` on} of the commanded devices."""
        return {
            name: self.table.devices[index].missed
            for index, name in enumerate(self.names) if self.table.devices[index].zero.count}

    @property
    def malformed(self) -> dict[str, tuple[dict[int, int], int]]:
        """{path: ({length: frames}, first byte of the newest)} of the devices that rejected frames of their own id."""
        reports = {}
        for index, name in enumerate(self.names):
            lengths = {
                length: self.table.devices[index].malformed[length] for length in range(FRAME_BYTES + 1)
                if self.table.devices[index].malformed[length]}
            if lengths:
                reports[name] = lengths, self.table.devices[index].rejected_id
        return reports

    @property
    def switched(self) -> dict[str, tuple[int, int]]:
        """{path: (times taken out, times armed again)} of the drives that were taken out during the run."""
        return {
            name: (self.table.devices[index].drive.taken_out, self.table.devices[index].drive.returned)
            for index, name in enumerate(self.names)
            if self.table.devices[index].drive.taken_out or self.table.devices[index].drive.returned}

    @property
    def zeros(self) -> dict[str, tuple[int, int]]:
        """{path: (number of zeros set, number of refused requests)} of the devices with any."""
        return {
            name: (self.table.devices[index].zeroing.set, self.table.devices[index].zeroing.refused)
            for index, name in enumerate(self.names)
            if self.table.devices[index].zeroing.set or self.table.devices[index].zeroing.refused}

    @property
    def watched(self) -> list[dict[str, Any]]:
        """Monitored values of each actuator, as in cext.safety.drive_watch.DriveWatch.found."""
        return self.drives.found
