"""Options and tables of `python -m tests.bench`."""
