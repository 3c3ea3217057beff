"""Thresholds, the shared state with the fence, drive monitors, owner death, fatal signals."""
