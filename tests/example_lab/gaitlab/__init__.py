"""Blocks of the gait laboratory."""
