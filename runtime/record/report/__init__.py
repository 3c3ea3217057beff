"""Text of results, faults, checks and progress for the command line: data in, lines out."""
