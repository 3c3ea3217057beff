"""`check FILE`: the report as plain data, its text, and the budget of a battery."""
