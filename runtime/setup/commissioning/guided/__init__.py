"""Guided commissioning: steps that find what is wrong with a device before it drives a joint.

A step is a function of a Bench and a device block that returns a Result. Steps without torque poll the drives with the
frame that disables their motors (`bench`, `by_hand`); steps with torque are runs with a guardian (`driven`).
"""
