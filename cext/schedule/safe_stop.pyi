# Generated from the source by `python -m cext.stubs`. Do not edit.
from cext.schedule.buses import Buses
from cext.schedule.device_table import DeviceTable

class SafeStop:
    def __init__(self, table: DeviceTable, buses: Buses) -> None: ...
