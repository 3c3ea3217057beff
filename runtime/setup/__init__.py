"""Devices, computer and laboratory before a run."""
