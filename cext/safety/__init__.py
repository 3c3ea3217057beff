"""Thresholds, drive monitors, owner death, fatal signals, the keys of a terminal."""
