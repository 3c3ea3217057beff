"""A robot: its diagram file, its rig file, the guardian of its drives, and emulated devices."""
