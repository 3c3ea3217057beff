"""MicroStrain sensors on serial lines, as a device family."""

from blocks.imus.microstrain.block import MicroStrain
from graph.family import Family


class MicroStrainFamily(Family):
    name = "MicroStrain"
    sensors = (MicroStrain,)


FAMILY = MicroStrainFamily()
