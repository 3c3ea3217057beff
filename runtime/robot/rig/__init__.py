"""Rigs: the real interface and device of each logical name in a diagram."""
