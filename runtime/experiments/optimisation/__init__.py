"""Optimisation: parameters with bounds, optimisers that propose values of them, and runs that measure the cost."""
