# cython: freethreading_compatible=True
"""Safety thresholds for Python: the names of cext/safety/thresholds.pxd."""
