"""Calibration of an IMU from readings in several orientations, written to a file that its block reads.

measuring   readings from a simulation or from the real bus
stillness   rest periods and the six positions
fits        bias, offset and matrix, in closed form or by least squares
result      calibration with figures before and after
picture     plots before and after
"""
