"""Analysis of recordings: trials, strides, resampling, plots and differences."""
