"""Fused schedules: the machine code of consecutive kernels, copied and patched into one run of code."""
