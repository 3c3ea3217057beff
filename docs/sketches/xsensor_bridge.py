"""Bridge from XSENSOR insoles to the block Insole. It needs Python alone, on the Windows computer of the insoles.

    python xsensor_bridge.py XSCore90x64.dll --calibration C:\\calibration --left ROBOT:5005 --right ROBOT:5006
    python xsensor_bridge.py export.csv --left ROBOT:5005 --right ROBOT:5006

The first line reads insoles with XSENSOR's library. The second one plays a CSV export of XSENSOR's software at the
times of its frames, to test a robot without insoles. Each frame goes to the address of its foot by UDP.

What goes over the radio or the cable between an insole and that library is not published. The functions are those of
the library's header XSCore90.h (2022), the columns those of exports in public analysis scripts. Neither was tried with
insoles: press the heel and the inner edge of each foot, and compare `centre` of the block. `--flip` and `--mirror`
reverse the order of rows and columns.
"""

from __future__ import annotations

import argparse
import binascii
import csv
import ctypes
import math
import re
import socket
import struct
import time
from collections.abc import Iterator

SIDES = ("left", "right")
PASCAL = 8  # ePRESUNIT_NM2 of the library
UNITS = {  # Pa, by the column Units without blanks and special characters
    "pa": 1.0, "nm2": 1.0, "kpa": 1e3, "mbar": 100.0, "bar": 1e5, "atm": 101325.0, "ncm2": 1e4, "psi": 6894.757,
    "mmhg": 133.3224, "inh2o": 249.0889, "kgcm2": 98066.5, "gcm2": 98.0665,
}  # fmt: skip
NO_CELL, STEP = 65535, 10.0  # Pa of a code
Sample = tuple[float, dict[str, list[list[float]]]]  # time in s, {side: rows of pressures in Pa}


def frame(number: int, pressures: list[list[float]], side: str, seconds: float) -> bytes:
    """Return the frame of an insole as bytes.

    pressures : rows from the heel, each from the wearer's left, in Pa; NaN or negative where there is no cell
    seconds : on the clock of this computer
    """
    rows, columns = len(pressures), len(pressures[0])
    cells = [NO_CELL if not p >= 0.0 else min(NO_CELL - 1, round(p / STEP)) for row in pressures for p in row]
    clock = int(seconds * 1e6) % 2**32
    body = struct.pack("<4sBBHBBHI", b"SOLE", 1, SIDES.index(side), number % 65536, rows, columns, 0, clock)
    body += struct.pack(f"<{rows * columns}H", *cells)
    return body + struct.pack("<H", binascii.crc_hqx(body, 0xFFFF))


# The vendor's library


def library(path: str, calibration: str, wireless: bool) -> Iterator[Sample]:
    """Yield the samples of all insoles that the library finds. Raises OSError if it finds none or loses them."""
    core = ctypes.CDLL(path)
    core.XS_ConfigSensorPID.restype = ctypes.c_uint64
    core.XS_GetLastErrorCodeAsString.restype = ctypes.c_char_p
    for name in ("XS_InitLibrary", "XS_AutoConfig", "XS_OpenConnection", "XS_Sample", "XS_GetPressure"):
        getattr(core, name).restype = ctypes.c_bool  # a C++ bool, of one byte

    def require(is_so: bool, what: str) -> None:
        if not is_so:
            raise OSError(f"{what}: {core.XS_GetLastErrorCodeAsString().decode()}")

    require(core.XS_InitLibrary(ctypes.c_bool(False)), "XS_InitLibrary")  # a sample is taken when it is requested
    try:
        if calibration:
            core.XS_SetCalibrationFolderUTF8(calibration.encode())
        (core.XS_SetAllowX4Wireless if wireless else core.XS_SetAllowX4)(ctypes.c_bool(True))
        core.XS_SetX4Mode8Bit(ctypes.c_bool(wireless))
        core.XS_SetSampleAverageCount(ctypes.c_uint16(4))  # the fastest of an insole
        print("looking for insoles: this takes 5 to 180 s", flush=True)
        require(core.XS_EnumSensors() > 0, "XS_EnumSensors")
        require(core.XS_AutoConfig(ctypes.c_uint8(PASCAL), ctypes.c_float(-1.0)), "XS_AutoConfig")
        soles = {}
        for index in range(core.XS_ConfigSensorCount()):
            sensor = ctypes.c_uint64(core.XS_ConfigSensorPID(index))
            is_foot, is_left, rows, columns = ctypes.c_bool(), ctypes.c_bool(), ctypes.c_uint16(), ctypes.c_uint16()
            core.XS_IsX4FootSensor(sensor, ctypes.byref(is_foot), ctypes.byref(is_left))
            core.XS_GetSensorDimensions(sensor, ctypes.byref(rows), ctypes.byref(columns))
            if is_foot:
                side = SIDES[not is_left]
                soles[side] = sensor, columns.value, (ctypes.c_float * (rows.value * columns.value))()
                print(f"{side}: {rows.value} rows, {columns.value} columns", flush=True)
        require(bool(soles), "no insole among the sensors")
        require(core.XS_OpenConnection(ctypes.c_uint32(0)), "XS_OpenConnection")
        while True:
            require(core.XS_Sample(), "XS_Sample")
            now, found = time.monotonic(), {}
            for side, (sensor, columns, cells) in soles.items():
                require(core.XS_GetPressure(sensor, cells), "XS_GetPressure")
                found[side] = [list(cells[at : at + columns]) for at in range(0, len(cells), columns)]
            yield now, found
    finally:
        core.XS_CloseConnection()
        core.XS_ExitLibrary()


# An export


def export(path: str) -> Iterator[Sample]:
    """Yield the samples of an export at their times. Raises ValueError for a file without the columns of one."""
    with open(path, newline="", encoding="utf-8-sig", errors="replace") as file:
        lines = csv.reader(file)
        head = next((row for row in lines if row and row[0].strip() == "Frame"), [])
        starts = [index for index, name in enumerate(head) if name.strip() == "Sensor"]
        if not starts:
            raise ValueError(f"{path}: no line begins with Frame and has a column Sensor: export all cells as CSV")
        began = first = None
        for row in lines:
            if len(row) < len(head):
                continue
            when = seconds(row[head.index("Time")])
            scale = unit(row[head.index("Units")])
            if began is None or first is None:
                began, first = time.monotonic(), when
            time.sleep(max(0.0, began + when - first - time.monotonic()))
            found = {}
            for begin, end in zip(starts, [*starts[1:], len(head)]):
                side, pressures = sole(head[begin:end], row[begin:end], scale)
                found[side] = pressures
            yield began + when - first, found


def sole(head: list[str], row: list[str], scale: float) -> tuple[str, list[list[float]]]:
    """Return (side, rows of pressures in Pa) of the columns of one insole. scale : Pa of its unit"""
    cells, side = {}, ""
    for name, value in zip(head, row):
        if name.strip() in ("Insole", "Insole Side"):
            side = value.strip().lower()
        if place := re.fullmatch(r"\s*S_(\d+)_(\d+)\s*", name):
            cells[int(place[1]), int(place[2])] = float(value) * scale if value.strip() else math.nan
    if side not in SIDES or not cells:
        raise ValueError(
            f"an insole has the side {side!r} and {len(cells)} cells: expected Left or Right, and S_1_1 ..."
        )
    rows, columns = (max(place[axis] for place in cells) for axis in (0, 1))
    return side, [[cells.get((r, c), math.nan) for c in range(1, columns + 1)] for r in range(1, rows + 1)]


def seconds(text: str) -> float:
    """Return a time, such as 12.34, 10:02:03.45 or 10:02:03.45 AM, in s."""
    total = 0.0
    for part in text.split()[0].split(":"):
        total = 60.0 * total + float(part)
    return total


def unit(text: str) -> float:
    """Return the Pa of a unit, such as PSI or N/cm². Raises ValueError for an unknown one."""
    name = re.sub(r"[^a-z0-9]", "", text.lower().replace("²", "2"))
    if name not in UNITS:
        raise ValueError(f"the unit {text!r} is not known: expected one of {', '.join(UNITS)}")
    return UNITS[name]


def main() -> None:
    """Send frames until Ctrl-C, or until the export has ended."""
    parser = argparse.ArgumentParser(description="Send the pressures of XSENSOR insoles to a robot.")
    parser.add_argument("source", help="XSENSOR's library, such as XSCore90x64.dll, or a CSV export")
    for side in SIDES:
        parser.add_argument(f"--{side}", metavar="HOST:PORT", help=f"address of the {side} Insole block")
    parser.add_argument("--calibration", default="", help="folder in which the library keeps calibration files")
    parser.add_argument("--wireless", action="store_true", help="insoles that are paired with this computer")
    parser.add_argument("--flip", action="store_true", help="row 1 is at the heel; otherwise at the toes")
    parser.add_argument(
        "--mirror", choices=SIDES, action="append", default=[], help="column 1 is on the wearer's right"
    )
    options = parser.parse_args()
    targets = {side: address.rsplit(":", 1) for side in SIDES if (address := getattr(options, side))}
    is_export = options.source.lower().endswith(".csv")
    samples = export(options.source) if is_export else library(options.source, options.calibration, options.wireless)
    counts = dict.fromkeys(targets, 0)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as end:
        try:
            for now, found in samples:
                for side in targets.keys() & found.keys():
                    pressures = found[side] if options.flip else found[side][::-1]
                    pressures = [row[::-1] for row in pressures] if side in options.mirror else pressures
                    host, port = targets[side]
                    end.sendto(frame(counts[side], pressures, side, now), (host, int(port)))
                    counts[side] += 1
        except KeyboardInterrupt:
            pass
        except (OSError, ValueError) as error:
            raise SystemExit(f"xsensor_bridge: {error}") from None
        finally:
            samples.close()  # the library and its connection
            print("sent: " + ", ".join(f"{count} frames {side}" for side, count in counts.items()), flush=True)


if __name__ == "__main__":
    main()
