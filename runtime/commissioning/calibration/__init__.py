"""Calibrating an IMU: what it measures while somebody turns it becomes a file that its block reads.

measuring   the readings, from a simulation or over the real bus
stillness   when it lay still, and which of the six positions it has had
fits        bias, offset and matrix, in closed form or by least squares
picture     before and after
"""
