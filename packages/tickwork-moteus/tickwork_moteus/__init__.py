"""moteus controllers (r4, n1, c1, x1) in position mode over CAN FD: a device family for Tickwork."""

from tickwork_moteus.block import Moteus
from tickwork_moteus.emulator import EmulatedMoteus

__all__ = ["EmulatedMoteus", "Moteus"]
