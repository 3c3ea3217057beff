"""Damiao drives (DM-J series) in MIT mode: a device family for Tickwork."""

from tickwork_damiao.block import Damiao
from tickwork_damiao.emulator import EmulatedDamiao

__all__ = ["Damiao", "EmulatedDamiao"]
