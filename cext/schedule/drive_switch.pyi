# Generated from the source by `python -m cext.stubs`. Do not edit.
from cext.safety.drive_watch import DriveWatch
from cext.schedule.buses import Buses
from cext.schedule.device_events import DeviceEvents
from cext.schedule.device_table import DeviceTable
from cext.schedule.live import LiveTable

class DriveSwitch:
    def __init__(self, table: DeviceTable, buses: Buses, drives: DriveWatch, events: DeviceEvents, live: LiveTable) -> None: ...
