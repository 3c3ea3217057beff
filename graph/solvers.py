"""Explicit Runge-Kutta methods that integrate the continuous states of a plant."""

DEFAULT = "rk4"

# Butcher tableaus: row s has the weights of the slopes of stages 0 to s in the state of stage s + 1; the last row has
# those of the result. "dopri5" is that of Dormand and Prince (1980), without the stage for an error estimate.
SOLVERS = {
    "euler": ((1.0,),),
    "heun": ((1.0,), (1 / 2, 1 / 2)),
    "rk4": ((1 / 2,), (0.0, 1 / 2), (0.0, 0.0, 1.0), (1 / 6, 1 / 3, 1 / 3, 1 / 6)),
    "dopri5": (
        (1 / 5,),
        (3 / 40, 9 / 40),
        (44 / 45, -56 / 15, 32 / 9),
        (19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729),
        (9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656),
        (35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84),
    ),
}
