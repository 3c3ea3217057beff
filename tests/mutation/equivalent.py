"""Mutants that behave as the original does, by their names, with the reason. One that is not there and survives is a hole in the tests."""

EQUIVALENT = {
    "cext/kernels/limiters.pyx remember: add(sums + RUNNING, square) -> add(sums - RUNNING, square)": "RUNNING is 0",
    "cext/kernels/limiters.pyx remember: add(sums + RUNNING, -arena[slots[SQUARES] + place]) -> "
    "add(sums - RUNNING, -arena[slots[SQUARES] + place])": "RUNNING is 0",
}
