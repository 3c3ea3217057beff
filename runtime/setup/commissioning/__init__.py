"""Commissioning of devices: scan, set-up, movement, live values, calibration. Each locks its bus as a run does."""
