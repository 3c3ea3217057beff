"""What a drive says when it is asked while nobody controls it: the state of one answer, in the units of its
declaration.
"""

from dataclasses import dataclass, field


@dataclass
class Answer:
    """
    family : how its frames are read, in words; can_id : its own
    position in rad, velocity in rad/s, torque in N·m, current in A, temperature in °C, voltage in V: None where it does
    not say
    fault : in words, "" for none, None where it does not say; enabled : whether it says that it is, None where it does
        not say
    unique : what tells it from every other drive, "" where it does not say; firmware likewise
    remarks : what is amiss; notes : what is good to know; settings : {parameter: value} that its block needs and that
        differ from the defaults
    """

    family: str
    can_id: int
    position: float | None = None
    velocity: float | None = None
    torque: float | None = None
    current: float | None = None
    temperature: float | None = None
    voltage: float | None = None
    fault: str | None = ""
    enabled: bool | None = None
    unique: str = ""
    firmware: str = ""
    remarks: list = field(default_factory=list)
    notes: list = field(default_factory=list)
    settings: dict = field(default_factory=dict)


def symmetric(code, half, bits):
    """The value of a code whose range is ± half: everybody decodes with 2ⁿ − 1."""
    return code * 2.0 * half / ((1 << bits) - 1) - half
