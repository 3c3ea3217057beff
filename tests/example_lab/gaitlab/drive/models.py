"""The models of the laboratory's drive."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Model:
    """rated, peak, wire torque in N·m; wire velocity in rad/s; wire position in rad; torque constant in N·m/A"""

    name: str
    gear: float
    rated: float
    peak: float
    torque_constant: float | None = None
    wire_torque: float = 327.67
    wire_velocity: float = 327.67
    wire_position: float = 32.767
    wire_stiffness: float | None = None
    wire_damping: float | None = None


MODELS = {model.name: model for model in (Model("GD-10", 6.0, 10.0, 20.0), Model("GD-30", 9.0, 30.0, 60.0))}


def find(name):
    """Return the Model of a name. Raises ValueError without one."""
    for model in MODELS.values():
        if str(name).upper() == model.name:
            return model
    raise ValueError(f"{name!r} is not a model of the gait laboratory; there are {', '.join(MODELS)}")
