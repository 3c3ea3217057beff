"""What is fuzzed: each device of a diagram of its own, good packets that it has to hear behind anything, and seeds.

The packets are those that the tests of the devices make, by their own references.
"""

import importlib
import inspect
import pkgutil
import socket
import struct
from contextlib import suppress
from dataclasses import dataclass, field

import numpy as np

import cext.kernels
from blocks.actuators import (
    CubeMars,
    CubeMarsServo,
    CubeMarsV3,
    EmulatedCubeMars,
    EmulatedRobStride,
    RobStride,
    RobStrideMIT,
)
from blocks.actuators.cubemars.emulator_v3 import EmulatedCubeMarsServo, EmulatedCubeMarsV3
from blocks.actuators.robstride.mit import EmulatedRobStrideMIT
from blocks.charge_pump import ChargePump, EmulatedChargePump
from blocks.controls import EmulatedControls, GameController
from blocks.gpio import EmulatedGpio, EStopSwitch, GpioInput, SyncOut
from blocks.imus import ICM20948, MPU9250, EmulatedMicroStrain, EmulatedOpenImu, MicroStrain, OpenImu
from blocks.imus.invensense.emulator import EmulatedICM20948, EmulatedMPU9250
from blocks.imus.microstrain import mip
from blocks.safety import EmulatedEStop, EStopHeartbeat
from blocks.sensors import (
    ADS1115,
    AS5047,
    AS5048B,
    AS5600,
    NAU7802,
    EmulatedAS5047,
    EmulatedAS5048B,
    EmulatedAS5600,
    Insole,
    Microcontroller,
)
from blocks.sensors.ads1115 import EmulatedADS1115
from blocks.sensors.bno085 import BNO085RVC, EmulatedBNO085RVC
from blocks.sensors.insole import EmulatedInsole
from blocks.sensors.microcontroller import EmulatedMicrocontroller
from blocks.sensors.nau7802 import EmulatedNAU7802
from cext.kernel import Kernel
from cext.schedule.kernel_table import address
from graph import Interval
from tests.blocks.actuators import cubemars_reference, reference, robstride_reference
from tests.blocks.actuators.wire import EXTENDED, Wired
from tests.blocks.sensors import test_bno085, test_insole, test_microcontroller

NOTHING, READ, MISSED, GONE = range(4)  # in front of a chunk: tests/fuzzing/harness.pyx
NONE, MIP, COBS, LINES, INSOLE, DATAGRAMS = range(6)  # tests/fuzzing/oracles.pxd
PLAIN_CUTS = bytes([63] * 16)
LEVEL, IDENTITY_SHIFT = 3, 16
INPUTS = {float: 1, int: 2, bool: 3, "float": 1, "int": 2, "bool": 3}  # kinds of tests/fuzzing/harness.pyx


@dataclass(frozen=True)
class Target:
    """device, parameters : the block. same : outputs that the last good packet says.

    tail : a stream's pieces (what is in front, bytes), or frames (identifier, data); good : chunks that are its seeds
    protocol : (kind, whether counted, size, rows, columns, side), of tests/fuzzing/oracles.pxd
    """

    device: type
    parameters: dict = field(default_factory=dict)
    values: tuple = ()
    same: tuple = ()
    tail: tuple = ()
    seeds: tuple = ()
    protocol: tuple = (NONE, 0, 0, 0, 0, 0)
    is_stream: bool = True
    identifiers: tuple = ()


class Driven:
    """A target as tests/fuzzing/harness.pyx takes it."""

    def __init__(self, target):
        wired = Wired(target.device, *target.values, **target.parameters)
        block = wired.block
        anything = {name: Interval() for name in inspect.signature(block.output_range).parameters}
        ranges = {**{name: port.range for name, port in block.outputs.items()}, **block.output_range(**anything)}
        self.is_emulated = target.device.__name__.startswith("Emulated")
        self.is_stream, self.protocol, self.tail = target.is_stream, target.protocol, target.tail
        steps = wired.schedule.devices[0]
        self.block, self.decode, self.encode = block, steps.decode, steps.encode
        self.clock = wired.arena[:8].tolist()
        self.items = []
        for name, place in wired.place.items():
            found = ranges.get(name)
            span = found if isinstance(found, Interval) else Interval(*found) if found else Interval()
            told = name in block.outputs and name != "age"
            kind = INPUTS[block.inputs[name].dtype] if name in block.inputs else 0
            self.items.append((name, wired.arena[place].tolist(), span.low, span.high, told, name in target.same, kind))
        self.identifiers = list(target.identifiers)


def stream_seed(data, flags=0x80, plan=PLAIN_CUTS):
    return plan + bytes([flags]) + data


def frames_seed(target, frames):
    """Frames as an input: which of the identifiers, the length, the data."""
    words = b""
    for identifier, data in frames:
        known = [number for number, (other, _) in enumerate(target.identifiers) if other == identifier]
        words += (
            bytes([known[0], len(data)]) if known else bytes([127, len(data)]) + identifier.to_bytes(4, "big")
        ) + data
    return words


def seeds(target):
    """Inputs to begin with: the good packets, cut in several ways, alone and behind one another."""
    if not target.is_stream:
        made = [frames_seed(target, target.tail), *(frames_seed(target, frames) for frames in target.seeds)]
        return made + [frames_seed(target, [(identifier, bytes(length))]) for identifier, length in target.identifiers]
    parts = [data for _, data in target.tail] + list(target.seeds)
    whole = b"".join(parts)[:3000]
    cuts = bytes(range(16)), bytes([0] * 16), bytes([63, 0x7F, 0xBF, 0xFF] * 4)
    return [stream_seed(part, flags) for part in parts for flags in (0x80, 0x83)] + [
        stream_seed(whole, 0x82, plan) for plan in cuts
    ]


# Streams


def floats(*values):
    return struct.pack(f">{len(values)}f", *values)


SENSOR = mip.packet(
    0x80, (0x04, floats(0.1, -0.2, 1.0)), (0x05, floats(0.01, 0.02, -0.03)), (0x06, floats(0.2, 0.1, 0.4))
)
ATTITUDE = mip.packet(0x82, (0x03, floats(0.5, 0.5, -0.5, 0.5) + b"\0\1"))
TIMED = mip.packet(0x80, (0xD5, (1_500_000_000).to_bytes(8, "big")), (0x04, floats(0.0, 0.0, 1.0)))
ODD = (
    mip.packet(0x80, (0xD3, struct.pack(">dHH", 1.5, 2000, 3)), (0x12, struct.pack(">dHH", 1.5, 2000, 3))),
    mip.packet(0x82, (0x05, floats(0.1, 0.2, 0.3) + b"\0\0"), (0x10, bytes(6)), (0x11, struct.pack(">dHH", 1e9, 1, 1))),
    mip.packet(0xA0, (0xD5, bytes(8)), (0xD1, bytes(4))),
    mip.packet(0x0C, (0xF1, b"\x01\x00")),
    TIMED,
    mip.packet(0x82, (0x03, floats(float("nan"), float("inf"), 1e38, -0.0) + b"\0\1")),
)
COMMANDS = (
    mip.packet(0x01, (0x01, b"")),
    mip.packet(0x01, (0x03, b"")),
    mip.packet(0x0C, (0x08, b"\x01\x01\x02\x04\x00\x01\x05\x00\x02")),
    mip.packet(0x0C, (0x0F, b"\x01\x80\x01\x04\x00\x01")),
    mip.packet(0x0C, (0x11, b"\x01\x01\x01")),
    mip.packet(0x0C, (0x30, b"\x03")),
    mip.packet(0x0C, (0x51, b"\x01\x01\x00" + b"\x41\x20\x00\x00" * 2)),
    mip.packet(0x0C, (0x51, b"\x02")),
    mip.packet(0x0D, (0x11, b"\x01" + b"\x3f\x80\x00\x00" * 3)),
    mip.packet(0x0D, (0x18, b"\x01\x01")),
    mip.packet(0x0D, (0x50, b"\x01\x01\x00\x01")),
    mip.packet(0x0C, (0x08, b"\x02\x01")),
)
FIELDS = (("force", "int24", "N", 0.01), ("accel", "int16[3]", "m/s²", 0.0048))
WIDE = (("a", "uint8"), ("b", "float32[2]"), ("c", "float64"), ("d", "int32"), ("e", "uint16"))
WIDE_PACKET = test_microcontroller.packet(None, struct.pack("<B2fdiH", 7, 1.5, -2.5, 3.25, -4, 500))
PACKETS = tuple(test_microcontroller.force_packet(number, 1234 - number, (1, -2, 0)) for number in (0, 1, 255))
SOLE_SIZE = 18 + 2 * 6 * 3


def sole(number, **more):
    return test_insole.frame(number, 1e4 * (1 + np.arange(18).reshape(6, 3)), rows=6, columns=3, **more)


SOLES = sole(1), sole(2), sole(9, side=1), sole(65535)
INSOLES = {"rows": 6, "columns": 3}
RVC = test_bno085.EXAMPLE
SMALL = (("x", "float32"), ("y", "float32"))

STREAMS = {
    "microstrain": Target(
        MicroStrain,
        same=("accel", "gyro", "mag", "quaternion", "euler", "rotation", "raw_quaternion", "valid", "connected"),
        tail=((NOTHING, bytes(300)), (NOTHING, SENSOR), (NOTHING, ATTITUDE), (GONE, b"")),
        seeds=ODD,
        protocol=(MIP, 0, 0, 0, 0, 0),
    ),
    "microstrain_tared": Target(
        MicroStrain,
        {
            "channels": ("accel", "quaternion", "euler", "pressure", "filter_status"),
            "tare_at_start": True,
            "tare_time": 0.0,
        },
        same=("accel", "raw_quaternion", "connected"),
        tail=((NOTHING, bytes(300)), (NOTHING, SENSOR), (NOTHING, ATTITUDE), (GONE, b"")),
        seeds=ODD,
        protocol=(MIP, 0, 0, 0, 0, 0),
    ),
    "microstrain_emulated": Target(EmulatedMicroStrain, seeds=COMMANDS, protocol=(NONE, 0, 0, 0, 0, 0)),
    "cobs": Target(
        Microcontroller,
        {"fields": FIELDS},
        same=("force", "accel"),
        tail=((NOTHING, b"\0"), (NOTHING, PACKETS[0])),
        seeds=PACKETS,
        protocol=(COBS, 1, 9, 0, 0, 0),
    ),
    "cobs_wide": Target(
        Microcontroller,
        {"fields": WIDE, "counter": False},
        same=("a", "b", "c", "d", "e"),
        tail=((NOTHING, b"\0"), (NOTHING, WIDE_PACKET)),
        seeds=(WIDE_PACKET,),
        protocol=(COBS, 0, 23, 0, 0, 0),
    ),
    "lines": Target(
        Microcontroller,
        {"fields": SMALL, "format": "lines"},
        same=("x", "y"),
        tail=((NOTHING, b"\n"), (NOTHING, b"17,1.5,-2e3\n")),
        seeds=(
            b"18,0x1p3,nan\n",
            b"# a remark\n19, -inf ,3\r\n",
            b"20,1,2,3\n\n21,.5,5.\n",
            b"300,1e400,-1e-400\n",
            b"1," * 600 + b"\n",
        ),
        protocol=(LINES, 1, 3, 0, 0, 0),
    ),
    "lines_uncounted": Target(
        Microcontroller,
        {"fields": (("x", "float32"),), "format": "lines", "counter": False},
        same=("x",),
        tail=((NOTHING, b"\n"), (NOTHING, b"12.5\n")),
        seeds=(b"1\n2\n3\n", b"12.5\n-4.25\n"),
        protocol=(LINES, 0, 1, 0, 0, 0),
    ),
    "bno085": Target(
        BNO085RVC,
        same=("yaw", "pitch", "roll", "accel"),
        tail=((NOTHING, b"\x55" * 19), (NOTHING, RVC)),
        seeds=(RVC, test_bno085.message(223), test_bno085.message(170, 1, 2, 3), RVC[:11] + RVC),
        protocol=(NONE, 0, 0, 0, 0, 0),
    ),
    "insole": Target(
        Insole,
        {**INSOLES, "transport": "tcp"},
        same=("force", "centre", "regions", "dead"),
        tail=((NOTHING, bytes(SOLE_SIZE)), (NOTHING, SOLES[0])),
        seeds=SOLES,
        protocol=(INSOLE, 1, SOLE_SIZE, 6, 3, 0),
    ),
    "insole_datagrams": Target(
        Insole,
        INSOLES,
        same=("force", "centre", "regions", "dead"),
        tail=((READ, SOLES[0]),),
        seeds=SOLES,
        protocol=(DATAGRAMS, 1, SOLE_SIZE, 6, 3, 0),
    ),
}


# Frames


def openimu(group, data, address=128):
    return EXTENDED | 0x18 << 24 | group << 8 | address, data


IMU_GROUPS = 0xF029, 0xF02A, 0xF02D, 0xFF6A, 0xEEFF, 0xFF55, 0xFF56, 0xFF57, 0xFF58, 0xFF59
FINE_GROUPS = 0xFF6B, 0xFF6D, 0xF013
IMU_TOLD = (
    openimu(0xFF59, b"\x80\x00\xc2"),
    openimu(0xFF56, b"\x80\x0f\x00"),
    openimu(0xFF55, b"\x80\x01"),
    openimu(0xFF58, b"\x80\0\0"),
    openimu(0xFF57, b"\x80\x19\x19"),
)
IMU_FRAMES = (
    openimu(0xF02A, bytes(range(1, 9))),
    openimu(0xF02D, bytes(range(11, 19))),
    openimu(0xFF6A, bytes(range(21, 29))),
)
CUBEMARS_LIMITS = {"position": (-12.5, 12.5), "velocity": (-50.0, 50.0), "torque": (-18.0, 18.0)}
JOINT = "position", "velocity", "torque", "temperature"


def answers(identity, *frames):
    """Answers on an I2C bus: (number of the transfer, data)."""
    return tuple((EXTENDED | transfer << IDENTITY_SHIFT | identity, data) for transfer, data in frames)


def named(frames, *more):
    """Identifiers of frames with their length, and of others."""
    return tuple(dict((identifier, len(data)) for identifier, data in frames).items()) + more


def robstride(**given):
    return robstride_reference.reply(
        {"position": (-12.57, 12.57), "velocity": (-20.0, 20.0), "torque": (-60.0, 60.0)}, 127, **given
    )


def event(kind, number, when=10**9):
    return struct.pack("<qIIII24x", when, kind, 4, number, number)


V3, V3_FAULT = cubemars_reference.status(7, 100, -20, 30, 35), cubemars_reference.status(7, error=3)
RUNS, FAILS = robstride(position=1.0, velocity=-2.0, torque=3.0), robstride(faults=5, mode=0)
REPLY = (0, reference.reply(CUBEMARS_LIMITS, 1, 1.0, -2.0, 3.0, 30, 0))
MPU = answers(
    0x68,
    (0, bytes(range(14))),
    (1, b"\x01" + bytes(range(6)) + b"\x10" + bytes([120, 130, 140])),
    (15, b"\0\1\0\0\0"),
    (2, bytes(range(14)) + b"\x01" + bytes(range(6)) + b"\x10" + bytes([120, 130, 140])),
)
ICM = answers(0x68, (0, bytes(range(14))), (1, b"\x01" + bytes(range(7)) + b"\x00"), (15, b"\0\1\0\0\0"))
INPUT = struct.Struct("<qqHHi")

FRAMES = {
    "openimu": Target(
        OpenImu,
        {"write_settings": False},
        same=("accel", "gyro", "mag"),
        tail=IMU_FRAMES,
        is_stream=False,
        identifiers=tuple((openimu(group, b"")[0], 8) for group in IMU_GROUPS),
    ),
    "openimu_told": Target(
        OpenImu,
        {"slope": True},
        is_stream=False,
        tail=(),
        seeds=((*IMU_TOLD, *IMU_FRAMES, openimu(0xF029, bytes(8))),),
        identifiers=tuple((openimu(group, b"")[0], 8) for group in IMU_GROUPS),
    ),
    "openimu_fine": Target(
        OpenImu,
        {"write_settings": False, "model": "335RI", "high_resolution": True, "slope": True, "slope_sensor": 1},
        same=("accel", "gyro", "roll", "pitch"),
        tail=tuple(openimu(group, bytes(range(1, 9))) for group in FINE_GROUPS),
        is_stream=False,
        identifiers=tuple((openimu(group, b"")[0], 8) for group in (*FINE_GROUPS, *IMU_GROUPS)),
    ),
    "openimu_emulated_335": Target(
        EmulatedOpenImu,
        {"model": "335RI"},
        is_stream=False,
        identifiers=tuple((openimu(group, b"", 0)[0], 8) for group in (0xEAFF, 0xEA80, *IMU_GROUPS[5:])),
    ),
    "openimu_emulated": Target(
        EmulatedOpenImu,
        is_stream=False,
        identifiers=tuple((openimu(group, b"", 0)[0], 8) for group in (0xEAFF, 0xEA80, *IMU_GROUPS[5:])),
    ),
    "cubemars": Target(
        CubeMars,
        {"can_id": 1},
        ("AK80-9",),
        same=JOINT,
        tail=(REPLY,),
        is_stream=False,
        identifiers=((0, 8), (1, 8), (2, 8), (EXTENDED, 8)),
    ),
    "cubemars_servo": Target(
        CubeMarsServo,
        {"can_id": 7},
        ("AK80-9",),
        same=JOINT,
        tail=(V3,),
        seeds=((V3_FAULT,),),
        is_stream=False,
        identifiers=named((V3,), *((cubemars_reference.identifier(kind, 7), 8) for kind in (0, 1, 8, 15, 0x2A))),
    ),
    "cubemars_v3": Target(
        CubeMarsV3,
        {"can_id": 7},
        ("AK80-9-V3.0",),
        same=JOINT,
        tail=(V3,),
        seeds=((V3_FAULT,),),
        is_stream=False,
        identifiers=named((V3,), *((cubemars_reference.identifier(kind, 7), 8) for kind in (0, 1, 8, 15, 0x2A))),
    ),
    "cubemars_emulated": Target(
        EmulatedCubeMars,
        {"can_id": 1},
        ("AK80-9",),
        is_stream=False,
        identifiers=((1, 8), (2, 8)),
        seeds=(((1, b"\xff" * 7 + b"\xfc"), (1, bytes(8)), (1, b"\xff" * 7 + b"\xfd")),),
    ),
    "robstride": Target(
        RobStride,
        values=("RS03",),
        same=JOINT,
        tail=(RUNS,),
        seeds=((FAILS,),),
        is_stream=False,
        identifiers=named(
            (RUNS, FAILS),
            *((robstride_reference.identifier(kind, 127, 0xFD), 8) for kind in (0, 2, 17, 21, 24)),
            *((robstride_reference.identifier(kind, 0xFD, 127), 8) for kind in (1, 3, 4, 6, 18, 21)),
        ),
    ),
    "robstride_emulated": Target(
        EmulatedRobStride,
        values=("RS03",),
        is_stream=False,
        identifiers=tuple(
            (robstride_reference.identifier(kind, 0xFD, 127), 8) for kind in (0, 1, 3, 4, 6, 7, 17, 18, 24, 25)
        ),
    ),
    "robstride_mit": Target(
        RobStrideMIT,
        {"can_id": 1},
        ("RS03",),
        same=JOINT,
        tail=((0xFD, bytes([1] + [128] * 7)),),
        is_stream=False,
        identifiers=((0, 8), (1, 8), (0xFD, 8), (0xFE, 8)),
    ),
    "mpu9250": Target(
        MPU9250,
        {"calibration": ""},
        is_stream=False,
        same=("accel", "gyro", "mag", "temperature"),
        tail=MPU,
        identifiers=named(MPU),
    ),
    "icm20948": Target(
        ICM20948,
        {"calibration": ""},
        is_stream=False,
        same=("accel", "gyro", "mag", "temperature"),
        tail=ICM,
        identifiers=named(ICM),
    ),
    "ads1115": Target(
        ADS1115,
        is_stream=False,
        identifiers=tuple(
            (EXTENDED | transfer << IDENTITY_SHIFT | 0x48, 5 if transfer == 15 else 4)
            for transfer in (0, 1, 2, 3, 4, 7, 15)
        ),
        seeds=(answers(0x48, *((n, bytes([1, 2, 0x80 | 4 + n << 4 | 2, 0xE3])) for n in range(4))),),
    ),
    **{
        kind.__name__.lower(): Target(
            kind,
            is_stream=False,
            same=("counts", "magnet", "position"),
            tail=answers(address, (0, good)),
            identifiers=tuple(
                (EXTENDED | transfer << IDENTITY_SHIFT | address, 5 if transfer == 15 else len(good))
                for transfer in (0, 1, 15)
            ),
        )
        for kind, address, good in (
            (AS5600, 0x36, b"\x20\x0a\xbc"),
            (AS5048B, 0x40, b"\x01\x80\x00\x55\x15"),
            (AS5047, 0, b"\x00\x00\x95\x55\x01\x80"),
        )
    },
    "nau7802": Target(
        NAU7802,
        {"tare_at_start": False},
        is_stream=False,
        same=("counts", "ratio", "force"),
        tail=answers(0x2A, (0, b"\x20\x80\x00\x01")),
        identifiers=tuple(
            (EXTENDED | transfer << IDENTITY_SHIFT | 0x2A, 5 if transfer == 15 else 4) for transfer in (0, 1, 15)
        ),
    ),
    "gpio": Target(
        GpioInput,
        is_stream=False,
        same=("on", "known"),
        tail=((0, event(1, 7)),),
        identifiers=((0, 48), (1, 0), (2, 0), (LEVEL, 1)),
        seeds=(((0, event(1, 0xFFFFFFFE)), (0, event(2, 0xFFFFFFFF)), (0, event(1, 0))),),
    ),
    "estop_switch": Target(
        EStopSwitch,
        is_stream=False,
        same=("pressed",),
        tail=((0, event(1, 7)),),
        identifiers=((0, 48), (1, 0), (2, 0), (LEVEL, 1)),
    ),
    "estop_heartbeat": Target(
        EStopHeartbeat,
        is_stream=False,
        same=("pressed",),
        tail=((0x100, b"\x05\x00"), (0x100, b"\x06\x5a")),
        identifiers=((0x100, 2), (0x101, 2)),
    ),
    "controls": Target(
        GameController,
        is_stream=False,
        identifiers=((0, 48), (1, 0), (2, 0)),
        seeds=(
            ((0, INPUT.pack(1, 2, 3, 0, 255) + INPUT.pack(1, 2, 1, 304, 1)), (0, INPUT.pack(1, 2, 0, 3, 0)), (1, b"")),
        ),
    ),
}

# Emulators, and outputs: whatever is sent to them, and whatever their inputs are
CONTROLS = {"axes": (("x", 0, -255, 255),), "buttons": (("a", 304),)}
CUBEMARS_COMMANDS = tuple((cubemars_reference.identifier(kind, 7), 8) for kind in (0, 1, 3, 4, 5, 6, 8, 15))
FRAMES |= {
    name: Target(device, parameters, values, is_stream=False, identifiers=identifiers, seeds=(((0, bytes(8)),),))
    for name, device, values, parameters, identifiers in (
        ("robstride_written", RobStride, ("RS03",), {"mode": "current"}, ((EXTENDED, 8),)),
        ("cubemars_servo_emulated", EmulatedCubeMarsServo, ("AK80-9",), {"can_id": 7}, CUBEMARS_COMMANDS),
        ("cubemars_v3_emulated", EmulatedCubeMarsV3, ("AK80-9-V3.0",), {"can_id": 7}, CUBEMARS_COMMANDS),
        (
            "robstride_mit_emulated",
            EmulatedRobStrideMIT,
            ("RS03",),
            {"can_id": 1},
            ((1, 8), (0x301, 8), (0x401, 8), (0x101, 8)),
        ),
        ("charge_pump", ChargePump, (), {"port": "/dev/null", "chip": ""}, ((0, 8), (1, 0))),
        ("charge_pump_emulated", EmulatedChargePump, (), {}, ((0, 8), (1, 0))),
        ("ads1115_emulated", EmulatedADS1115, (), {}, ((0, 8),)),
        ("nau7802_emulated", EmulatedNAU7802, (), {}, ((0, 8),)),
        ("as5600_emulated", EmulatedAS5600, (), {}, ((0, 8),)),
        ("as5048b_emulated", EmulatedAS5048B, (), {}, ((0, 8),)),
        ("as5047_emulated", EmulatedAS5047, (), {}, ((0, 8),)),
        ("mpu9250_emulated", EmulatedMPU9250, (), {}, ((0, 8),)),
        ("icm20948_emulated", EmulatedICM20948, (), {}, ((0, 8),)),
        ("bno085_emulated", EmulatedBNO085RVC, (), {}, ((0, 8),)),
        ("insole_emulated", EmulatedInsole, (), {"rows": 6, "columns": 3}, ((0, 8),)),
        ("microcontroller_emulated", EmulatedMicrocontroller, (), {"fields": WIDE}, ((0, 8),)),
        ("lines_emulated", EmulatedMicrocontroller, (), {"fields": SMALL, "format": "lines"}, ((0, 8),)),
        (
            "controls_emulated",
            EmulatedControls,
            (),
            {"axes": (("x", 0, -255, 255),), "buttons": (("a", 304),)},
            ((0, 8),),
        ),
        ("gpio_emulated", EmulatedGpio, (), {}, ((0, 1), (LEVEL, 1))),
        ("sync_out", SyncOut, (), {}, ((0, 1),)),
        ("estop_emulated", EmulatedEStop, (), {}, ((0, 2),)),
    )
}

TARGETS = STREAMS | FRAMES


# What carries frames


@dataclass(frozen=True)
class Carrying:
    """record : bytes that belong together; of datagrams above 1 where there is CAN FD. module : its path"""

    kind: str
    socket: int
    record: int
    module: str
    seeds: tuple


CAN_DATAGRAMS = (
    b"\x80" + struct.pack("=IB3x8s", 0x123, 8, b"abcdefgh"),
    b"\x80" + struct.pack("=IB3x8s", 0x20000040, 8, b"\0\4\0\0\0\0\0\0"),
    b"\x40" + struct.pack("=IBB2x64s", EXTENDED | 0x1234567, 64, 1, bytes(64)),
    b"\x80" + struct.pack("=IB3x8s", 1, 9, b"longer"),
    b"\x05short",
)
READS = (bytes([0, 9, 2, 63]), bytes([0xFD, 0, 0xFD, 0] * 12 + [2, 63]), bytes([1, 5, 3, 0, 4, 4, 2, 1]))
LINES_THAT_CARRY = {
    "reads": Carrying("reads", socket.SOCK_STREAM, 1, "cext/lines/streams", READS),
    "reads_of_records": Carrying("reads", socket.SOCK_STREAM, 24, "cext/lines/streams", READS),
    "datagrams": Carrying(
        "datagrams", socket.SOCK_SEQPACKET, 1, "cext/bus/socketcan", (*CAN_DATAGRAMS, b"".join(CAN_DATAGRAMS))
    ),
    "datagrams_fd": Carrying(
        "datagrams", socket.SOCK_SEQPACKET, 2, "cext/bus/socketcan", (*CAN_DATAGRAMS, b"".join(CAN_DATAGRAMS))
    ),
}

EVERYTHING = (*TARGETS, *LINES_THAT_CARRY)


def kernels():
    """Every decode and encode of the native modules of devices: {address: (module, name)}."""
    found = {}
    for info in pkgutil.walk_packages(cext.kernels.__path__, "cext.kernels."):
        for name, value in vars(importlib.import_module(info.name)).items():
            for kind in ("decode", "encode") if isinstance(value, Kernel) else ():
                with suppress(TypeError):  # a value of another kind
                    found[address(value, kind)] = info.name, name
    return found


def kernels_of(name):
    """Addresses of the decode and the encode that a target drives."""
    target = TARGETS[name]
    steps = Wired(target.device, *target.values, **target.parameters).schedule.devices[0]
    return address(steps.decode, "decode"), address(steps.encode, "encode")


def modules_of(name):
    """Paths of the native modules that a target drives, without their endings."""
    if name in LINES_THAT_CARRY:
        return [LINES_THAT_CARRY[name].module]
    known = kernels()
    return sorted({known[place][0].replace(".", "/") for place in kernels_of(name)})


def seeds_of(name):
    return seeds(TARGETS[name]) if name in TARGETS else LINES_THAT_CARRY[name].seeds
