"""Block library: actuators, sensors, filters, controllers, limiters, recorders, viewers and plant models."""
