"""What is mutated, and which tests have to notice."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Target:
    """file : from the root; functions : of it; modules : extensions that are built anew, none for Python; tests :
    files, the quickest first
    """

    file: str
    functions: tuple
    modules: tuple
    tests: tuple


def named(folder, names):
    return tuple(f"{folder}/test_{name}.py" for name in names.split())


STOPS = (
    *named("tests/cext/schedule", "every_fault faults life_cycle devices taken_out"),
    "tests/cext/safety/test_damping.py",
    # in real time
    *named("tests/cext/schedule", "arming_again fence mailbox"),
    "tests/cext/safety/test_guarded.py",
)
DEVICES = (
    *named("tests/cext/schedule", "enabling ready zeroing two_devices"),
    *named("tests/cext/bus", "memory_bus timed_bus"),
    "tests/cext/safety/test_damped_stop.py",
    "tests/blocks/test_charge_pump.py",
    "tests/blocks/actuators/test_cubemars_extended_life.py",
    *STOPS,
    "tests/cext/safety/test_transit.py",
    "tests/cext/schedule/test_stop_values.py",
)
PROFILED = (*named("tests/cext/clock", "stopwatch overrun"), "tests/cext/schedule/test_latency.py")
DRIVE = tuple(
    f"tests/blocks/actuators/test_{name}.py" for name in ("drive_law", "cubemars_bus", "cubemars_wire", "sent")
)

TARGETS = (
    Target(
        "cext/kernels/limiters.pyx",
        (
            "saturation_kernel",
            "slew_kernel",
            "slew_settle",
            "torque_limiter_kernel",
            "power_kernel",
            "soft_stop_kernel",
            "derating_kernel",
            "soft_start_kernel",
            "remember",
            "rms_torque_kernel",
        ),
        ("cext/kernels/limiters",),
        ("tests/blocks/test_limiters.py", "tests/blocks/test_protection.py"),
    ),
    Target(
        "cext/kernels/limits.pxd",
        ("finite", "clip", "toward"),  # is_finite is not used by the limiters
        ("cext/kernels/limiters",),
        ("tests/blocks/test_limiters.py",),
    ),
    Target(
        "cext/kernels/devices/drive_law.pxd",
        ("quotient", "keep_inside"),
        (
            "cext/kernels/devices/cubemars/mit",
            "cext/kernels/devices/cubemars/v3",
            "cext/kernels/devices/robstride/private",
            "cext/kernels/devices/robstride/mit",
        ),
        DRIVE,
    ),
    Target(
        "cext/kernels/devices/mit.pxd",
        ("limit_law", "quantise", "encode_command"),
        ("cext/kernels/devices/cubemars/mit", "cext/kernels/devices/cubemars/v3"),
        (*DRIVE, "tests/blocks/actuators/test_cubemars_v3_wire.py"),
    ),
    Target(
        "cext/schedule/devices.pyx",
        ("receive", "offer_one", "watch", "command", "transmit"),
        ("cext/schedule/devices",),
        DEVICES + PROFILED,
    ),
    Target("cext/schedule/buses.pyx", ("send",), ("cext/schedule/buses",), DEVICES),
    Target(
        "cext/schedule/device_arming.pyx", ("all_answered", "begin", "send"), ("cext/schedule/device_arming",), DEVICES
    ),
    Target("cext/schedule/safe_stop.pyx", ("send",), ("cext/schedule/safe_stop",), DEVICES),
    Target(
        "cext/schedule/arming_round.pxd",
        ("begin_asking", "begin_enabling", "counts", "send_round"),
        ("cext/schedule/device_arming", "cext/schedule/drive_switch", "cext/schedule/devices"),
        DEVICES,
    ),
    Target(
        "cext/schedule/relays.pxd",
        ("pump", "pump_all", "holds_relay"),
        ("cext/schedule/device_arming", "cext/schedule/safe_stop"),
        DEVICES,
    ),
    Target(
        "cext/safety/stop_confirmation.pyx",
        ("begin", "sent", "is_at_rest", "note", "note_rest", "judge", "judge_answers"),
        ("cext/safety/stop_confirmation",),
        (
            "tests/cext/safety/test_stop_confirmation.py",
            *named("tests/blocks/actuators", "robstride_life cubemars_extended_life"),
            "tests/runtime/robot/guardian/test_safe_stop.py",
            "tests/cext/schedule/test_stop_values.py",
        ),
    ),
    Target(
        "cext/schedule/drive_switch.pyx",
        ("take_out", "begin_out", "disable", "judge_out", "disable_again", "is_fit", "permission", "send"),
        ("cext/schedule/drive_switch",),
        DEVICES,
    ),
    Target("cext/schedule/foreign_commands.pxd", ("commanded_device", "is_like"), ("cext/schedule/devices",), DEVICES),
    Target(
        "cext/schedule/publisher.pyx",
        ("fenced", "attend", "raise_fence", "lower_fence", "attend_fenced"),
        ("cext/schedule/publisher",),
        STOPS,
    ),
    Target(
        "cext/memory/shared_state.pyx", ("raise_fence", "look_after", "fenced"), ("cext/memory/shared_state",), STOPS
    ),
    Target("cext/schedule/executor.pyx", ("stop",), ("cext/schedule/executor",), STOPS),
    Target(
        "cext/schedule/arming.pyx",
        ("halt",),
        ("cext/schedule/arming",),
        (*STOPS, "tests/blocks/actuators/test_cubemars_extended_life.py"),
    ),
    Target("cext/schedule/lifecycle.pyx", ("is_survived",), ("cext/schedule/lifecycle",), STOPS),
    Target(
        "runtime/robot/guardian/stop.py",
        ("__init__", "step", "receive", "_judge"),
        (),
        ("tests/runtime/robot/guardian/test_safe_stop.py",),
    ),
    Target(
        "runtime/robot/guardian/process.py",
        ("check_loop", "begin_stop", "carry"),
        (),
        named("tests/runtime/robot/guardian", "carrying stopping relay misdeeds"),
    ),
    Target(
        "runtime/robot/guardian/handover.py",
        ("open", "was_taken", "attend", "handle", "_accept", "_proceed", "_take_back"),
        (),
        named("tests/runtime/robot/guardian", "silent_successor handover lock"),
    ),
    Target(
        "runtime/robot/guardian/interfaces.py",
        ("listen", "wait", "receive", "open_lost", "close"),
        (),
        ("tests/runtime/robot/guardian/test_interfaces.py", "tests/runtime/robot/guardian/test_carrying.py"),
    ),
)
