"""Studies: many runs in virtual time over grids and samples of parameters, and their objectives as one table."""
