"""Explicit Runge-Kutta methods that integrate the continuous states of a plant."""

DEFAULT = "rk45"
ADAPTIVE = "rk45"  # the method with error control; the step of the others is a tick
INACCURATE = "TW039"  # code of the warning of a fixed step that is too long
RTOL, ATOL = 1e-6, 1e-9  # default tolerances of its error in a step

# Method of Dormand and Prince (1980), of order 5.
DOPRI5 = (
    (1 / 5,),
    (3 / 40, 9 / 40),
    (44 / 45, -56 / 15, 32 / 9),
    (19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729),
    (9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656),
    (35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84),
)

# Butcher tableaus: row s has the weights of the slopes of stages 0 to s in the state of stage s + 1; the last row has
# those of the result. The row after it of "rk45" has those of the difference from the result of order 4.
SOLVERS = {
    "euler": ((1.0,),),
    "heun": ((1.0,), (1 / 2, 1 / 2)),
    "rk4": ((1 / 2,), (0.0, 1 / 2), (0.0, 0.0, 1.0), (1 / 6, 1 / 3, 1 / 3, 1 / 6)),
    "dopri5": DOPRI5,
    "rk45": (*DOPRI5, (71 / 57600, 0.0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40)),
}
