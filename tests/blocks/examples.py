"""Parameters of blocks for tests and for their pages."""

import subprocess
from pathlib import Path

ROOT = Path(__file__).parents[2]


def compile_spring(folder):
    """Compile the example of a controller in C. Returns the path of its library."""
    file, source = str(Path(folder, "spring.so")), str(ROOT / "diagrams" / "examples" / "spring.c")
    subprocess.run(["cc", "-O2", "-shared", "-fPIC", f"-I{ROOT / 'cext'}", source, "-o", file], check=True)
    return file


# Parameters for blocks that have no usable defaults and no `examples`, and some with which every parameter of a block
# has its effect.
TAMED = {"kp": 2.0, "ki": 9.0, "lower": -1.0, "upper": 1.0, "anti_windup": "back-calculation"}
EXAMPLES = {
    "CubeMars": ({"model": "AK80-9"},),
    "EmulatedCubeMars": ({"model": "AK80-9"},),
    "EmulatedRobStride": ({"model": "RS03"},),
    "RobStride": tuple(
        {"model": "RS03", "mode": mode} for mode in ("operation", "position", "csp", "velocity", "current")
    ),
    "CubeMarsV3": ({"model": "AK80-9-V3.0"}, {"model": "AK80-8-V3.0", "limit": 8.0}),
    "EmulatedCubeMarsV3": ({"model": "AK80-8-V3.0"},),
    "CubeMarsServo": tuple(
        {"model": "AK80-9", "mode": mode}
        for mode in ("duty", "current", "current_brake", "velocity", "position", "position_velocity")
    ),
    "EmulatedCubeMarsServo": ({"model": "AK80-9"}, {"model": "AK80-9-V3.0"}),
    "RobStrideMIT": ({"model": "RS03"},),
    "EmulatedRobStrideMIT": ({"model": "RS03"},),
    "TorqueLimiter": ({"limit": 12.0}, {"limit": 12.0, "slew": 200.0}, {"limit": 1.5}),
    "PI": ({}, TAMED, TAMED | {"tracking_time": 0.2}),
    "PID": ({}, TAMED | {"kd": 0.1, "filter_time": 0.01, "c": 0.5}),
    "PD": ({}, {"kd": 0.1, "filter_time": 0.01, "c": 0.5}),
    "TorqueProfile": ({}, {"points": ((0.1, 3.0), (0.6, -8.0))}),
    "TorqueGate": ({}, {"mode": "damping"}, {"mode": "hold"}),
    "FeedForward": ({}, {"friction": 2.0}),
    "InverseDynamics": ({"file": str(ROOT / "diagrams" / "examples" / "leg.urdf")},),
    "Limb": ({}, {"lower": 0.0}),
    "StepSource": ({"time": 0.1},),
    "Pulse": ({}, {"period": 0.1}),
    "TimeTable": ({}, {"times": (0.0, 0.1), "values": (0.0, 1.0)}),
    **{name: ({}, {"window": 0.05}) for name in ("MovingAverage", "MovingRMS", "MovingMaximum", "MovingMinimum")},
}
