"""Mutants that behave as the original does, by their names, with the reason. One that is not there and survives is a hole in the tests."""

EQUIVALENT = {
}
