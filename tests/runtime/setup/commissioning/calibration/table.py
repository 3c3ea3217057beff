"""A diagram of one IMU, `shank`, and a plant that turns it as a person would; the sensor is off by what a calibration
has to find.

It lies on each of its six sides for two seconds, with a second of turning between, and is then turned to all sides.
"""

import math

import numpy as np

from blocks.imus import MPU9250
from graph import Block, Diagram, Output

G = 9.80665  # m/s²
BIAS = np.array((0.03, -0.02, 0.01))  # rad/s
OFFSET, SCALE = np.array((0.3, -0.2, 0.4)), np.array((1.02, 0.97, 1.01))  # m/s², and what takes it away
IRON = np.array((25.0, -15.0, 8.0))  # µT
SOFT = np.array(((1.1, 0.05, 0.0), (0.05, 0.9, 0.02), (0.0, 0.02, 1.0)))  # what makes a sphere of it
FIELD = np.array((20.0, 0.0, -44.0))  # µT
UP = np.array([(0, 0, 1), (0, 0, -1), (0, 1, 0), (0, -1, 0), (1, 0, 0), (-1, 0, 0)], float)
SIDE = 3.0  # s, of which the last is a turn

with Diagram("leg", rate=100) as diagram:
    MPU9250(name="shank", bus="imus", rate=100.0, timeout=0.0)


def turned(a, b, c):
    """A rotation about z, x and y, one after the other."""
    about_z = np.array(((math.cos(a), -math.sin(a), 0.0), (math.sin(a), math.cos(a), 0.0), (0.0, 0.0, 1.0)))
    about_x = np.array(((1.0, 0.0, 0.0), (0.0, math.cos(b), -math.sin(b)), (0.0, math.sin(b), math.cos(b))))
    about_y = np.array(((math.cos(c), 0.0, math.sin(c)), (0.0, 1.0, 0.0), (-math.sin(c), 0.0, math.cos(c))))
    return about_z @ about_x @ about_y


class Hand(Block):
    """What the sensor would measure if it were right, made wrong."""

    accel = Output("m/s²", shape=(3,))
    gyro = Output("rad/s", shape=(3,))
    mag = Output("µT", shape=(3,))

    def step(self, t):
        side = int(t // SIDE)
        rests = side < len(UP) and t % SIDE < SIDE - 1.0
        rotation = turned(0.9 * t, 0.37 * t, 0.61 * t)
        accel = G * UP[side] if rests else rotation.T @ (0.0, 0.0, G) + 2.0 * math.sin(20.0 * t)
        rate = np.zeros(3) if rests else np.array((math.sin(3.0 * t), math.cos(4.0 * t), 1.0))
        return accel / SCALE + OFFSET, rate + BIAS, np.linalg.solve(SOFT, rotation.T @ FIELD) + IRON


def plant(robot):
    with Diagram("table", rate=robot.rate) as table:
        hand = Hand()
        robot["shank"].emulator()(accel=hand.accel, gyro=hand.gyro, mag=hand.mag)
    return table
