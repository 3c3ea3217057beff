"""Block library: actuators, sensors, filters, controllers, limiters, recorders, viewers and plant models."""

from cext.one_place import check_place

check_place("graph", __file__)
