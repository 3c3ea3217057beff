"""`python -m runtime rate`: the highest rate at which one to eight actuators miss no reply.

This is the maximum operating frequency of Leestma et al. 2025, with every missing reply counted.

robot       the diagram: actuators on one bus, at zero torque
search      bisection
steps       one step of the search: simulated in virtual time, or on a rig
picture     the measured rates beside the limit of the bus
"""
