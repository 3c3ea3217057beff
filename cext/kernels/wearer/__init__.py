"""Kernels of the walking adult."""
