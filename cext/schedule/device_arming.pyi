# Generated from the source by `python -m cext.stubs`. Do not edit.
from cext.schedule.buses import Buses
from cext.schedule.device_events import DeviceEvents
from cext.schedule.device_table import DeviceTable
from cext.schedule.drive_switch import DriveSwitch

class DeviceArming:
    def __init__(self, table: DeviceTable, buses: Buses, events: DeviceEvents, switch: DriveSwitch) -> None: ...
