"""Kernels of devices: laws, wire protocols, emulators."""
