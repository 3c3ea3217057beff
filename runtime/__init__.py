"""Runs a schedule on a rig or in simulation: life cycle, buses, recorder, command line."""
