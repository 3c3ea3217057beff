# Generated from the source by `python -m cext.stubs`. Do not edit.
from cext.schedule.buses import Buses
from cext.schedule.device_events import DeviceEvents
from cext.schedule.device_table import DeviceTable

class DeviceArming:
    def __init__(self, table: DeviceTable, buses: Buses, events: DeviceEvents) -> None: ...
