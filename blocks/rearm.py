"""The safety vocabulary: arming again after a fault."""

from cext.kernels import logic as kernels
from graph import Block, Input


class Rearm(Block):
    """Lets a run survive a fault: after the safe stop it waits, and arms again when `request` rises and nothing stands in the way.

    For a button in somebody's hand. Only a rising edge while the run waits counts: an input that is held, or rose before, does nothing.
    What stops a run for good is in docs/rigs.md. It is no part of an emergency stop, and never arms by itself.
    """

    request = Input("1", "rises when somebody wants the robot armed again", dtype=bool)

    kernel = kernels.rearm
