"""Kernels of the family."""
