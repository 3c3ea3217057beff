"""Trials read back: strides, resampling, plots and differences of recordings."""
