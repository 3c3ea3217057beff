"""What a person is told: results and complaints on the terminal, the pre-flight table, faults, and the end of a run."""
