"""Robots that share diagrams/parts.py.

CLAIMS: {robot: {joint: [(phase from, to)] in which its mean power is positive}}, of the estimated gait phase
PROSTHESES: robots that replace a limb, and whose torque must not end with walking
HEAVIEST: {robot: largest mass of its wearer in kg, if it has one}
SUITS: {robot without actuators: joints whose angles it measures}
"""

from tests.checkout import ROOT

CLAIMS = {
    "hip_exo_1dof": {"hip": [(0.05, 0.3), (0.55, 0.8)]},
    "hip_exo_2dof": {"hip": [(0.05, 0.3), (0.55, 0.8)]},
    "hip_exo_bilateral": {"hip": [(0.05, 0.39), (0.53, 0.81)]},
    "hip_exo_metamobility": {"hip": [(0.05, 0.3), (0.55, 0.8)]},
    "hip_exo_teensy": {"hip": [(0.05, 0.4), (0.6, 0.85)]},
    "ankle_exo": {"ankle": [(0.45, 0.62)]},
    "hip_knee_exo": {"hip": [(0.07, 0.37), (0.59, 0.79)], "knee": [(0.18, 0.3), (0.5, 0.69)]},
    "knee_exo_cybergear": {"knee": [(0.17, 0.33), (0.49, 0.69)]},
    "knee_exo_gatech": {"knee": [(0.17, 0.33), (0.49, 0.69)]},
    "m_blue": {"hip": [(0.07, 0.37), (0.59, 0.79)], "knee": [(0.17, 0.33), (0.49, 0.69)]},
}
IN_MOTION = {"m_blue": {"controller": "phase"}}
PROSTHESES = ("knee_ankle_prosthesis",)
HEAVIEST = {"knee_ankle_prosthesis": 90}
SUITS = {"sensor_suit": ("knee", "ankle"), "sensor_suit_lite": ("hip", "knee")}
ROBOTS = (*CLAIMS, *PROSTHESES, *SUITS)


def path(robot):
    """Return the path of a robot's diagram file."""
    return ROOT / "diagrams" / f"{robot}.py"
