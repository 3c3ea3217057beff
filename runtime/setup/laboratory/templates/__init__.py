"""Files of a new laboratory's package, in which `my_lab` stands for its name."""
