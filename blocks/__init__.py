"""The library: actuators, filters, controllers, limiters, recorders, sinks, and models of what a robot is attached
to.
"""
