"""Linear systems in discrete time: transfer functions, biquad cascades, state space.

Their output ranges follow from the 1-norm of the impulse response. An unstable system has no range.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction
from typing import TYPE_CHECKING, Any

import numpy as np

from blocks._plumbing.biquads import Biquads
from blocks._plumbing.filter_bounds import design_at, reach_of_cascade, reach_of_state_space, stable
from blocks._plumbing.ports import finite_numbers
from cext.kernels import linear as kernels
from graph import Block, Input, Memory, Output, Param
from graph.interval import EVERYTHING
from graph.units import canonical, multiply

if TYPE_CHECKING:
    from graph.interval import Interval


class TransferFunction(Block):
    """Rational transfer function: H = (b₀ xⁿ + ... + bₙ) / (a₀ xⁿ + ... + aₙ), x = z or s.

    Coefficients are in decreasing powers, as in scipy.signal.TransferFunction; leading zeros may be omitted. In the
    domain s, `zoh` is exact for an input that is constant between ticks, and `tustin` is the bilinear transform. Direct
    feedthrough if numerator and denominator have the same degree, or with `tustin`; otherwise none, and the block may
    close a loop. Starts at zero; after arming it starts in steady state for the present input, if such a state exists.
    NaN persists until the next reset. For high orders use a BiquadCascade, which is less sensitive to rounding.
    """

    numerator = Param((1.0,), "1", "numerator coefficients b, in decreasing powers", dtype=tuple)
    denominator = Param((1.0,), "1", "denominator coefficients a, in decreasing powers", dtype=tuple)
    domain = Param("z", "1", "domain of the coefficients: z (discrete) or s (continuous)", choices=("z", "s"))
    method = Param(
        "auto",
        "1",
        "discretisation in the domain s; auto: zoh if the degree of the numerator is lower, otherwise tustin",
        choices=("auto", "zoh", "tustin"),
    )
    unit = Param("1", "1", "unit of the gain; the output unit is its product with the input unit")

    u = Input("any", "input", shape=...)
    y = Output("any", "output", shape=...)
    b = Memory(0.0, "numerator in powers of 1/z")
    a = Memory(0.0, "denominator in powers of 1/z, a₀ = 1")
    delays = Memory(0.0, "one delay per degree and element")
    rest = Memory(0.0, "delays in steady state for an input of 1")

    smooth = ("u",)
    kernel = kernels.transfer
    update_kernel = kernels.transfer_next
    settle_kernel = kernels.transfer_at_rest

    def configure(self) -> None:
        self.numerator, self.denominator = (
            polynomial("numerator", self.numerator),
            polynomial("denominator", self.denominator),
        )
        if len(self.numerator) > len(self.denominator):
            raise ValueError(
                f"numerator: its degree, {len(self.numerator) - 1}, must not exceed that of the denominator, "
                f"{len(self.denominator) - 1}. The system would not be causal"
            )
        self.unit = canonical(self.unit)
        same_degree = len(self.numerator) == len(self.denominator)
        self.bilinear = self.domain == "s" and (self.method == "tustin" or self.method == "auto" and same_degree)
        self.feedthrough = None if same_degree or self.bilinear else ()

    def output_units(self, u: str) -> dict[str, str]:
        return {"y": multiply(u, self.unit)}

    def design(self, dt: Any) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Return (b, a) in powers of 1/z, of equal length, a[0] = 1. dt : s, used in the domain s only"""
        degree = len(self.denominator) - 1
        b, a = (np.concatenate([np.zeros(degree + 1 - len(c)), c]) for c in (self.numerator, self.denominator))
        if self.bilinear:
            b, a = tustin(b, dt), tustin(a, dt)
            if a[0] == 0.0:
                raise ValueError(f"denominator: a pole at {2 / dt:g} rad/s cannot be discretised at this rate")
        elif self.domain == "s":
            b, a = held_between_ticks(b / a[0], a / a[0], dt)
        return tuple((b / a[0]).tolist()), tuple((a / a[0]).tolist())

    def instability(self) -> tuple[str, str] | None:
        pole = unstable_pole(np.roots(self.denominator), self.domain)
        cure = "close a loop around it" if self.domain == "s" else 'pass domain="s" for coefficients in s'
        return (pole, cure) if pole else None

    def prepare(self, dt: float) -> None:
        self.b, self.a = self.design(dt)
        self.delays = [0.0] * ((len(self.a) - 1) * self.width)
        self.rest = delays_at_rest(self.b, self.a)

    def output_range(self, u: Interval) -> Interval | None:
        section = design_at(self) if self.domain == "s" else self.design(None)
        reach = None if section is None else reach_of_cascade((section,))
        return EVERYTHING if reach is None else reach.interval([u])


def polynomial(name: str, coefficients: tuple[float, ...]) -> tuple[float, ...]:
    """Return the coefficients as a tuple without leading zeros.

    ValueError if they are missing or not finite, or if a denominator is zero.
    """
    try:
        values = [
            float(value) for value in ([coefficients] if isinstance(coefficients, (int, float)) else coefficients)
        ]
    except (TypeError, ValueError):
        raise ValueError(f"{name}: expected numbers in decreasing powers, got {coefficients!r}") from None
    if not values or not all(map(math.isfinite, values)):
        raise ValueError(f"{name}: expected finite numbers in decreasing powers, got {coefficients!r}")
    while len(values) > 1 and values[0] == 0.0:
        values.pop(0)
    if name == "denominator" and values[0] == 0.0:
        raise ValueError("denominator: must not be zero")
    return tuple(values)


def held_between_ticks(b: np.ndarray, a: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Return (b, a) in z of the zero-order-hold discretisation of b(s) / a(s), where a[0] = 1. dt : s

    The states of the companion form are scaled with the mean pole, so that its matrix exponential is well conditioned.
    """
    n = len(a) - 1
    scale = max((abs(c) ** (1.0 / k) for k, c in enumerate(a[1:], 1)), default=0.0) or 1.0  # rad/s
    powers = scale ** np.arange(1, n + 1)
    companion = scale * np.vstack([-a[1:] / powers, np.eye(n)[:-1]]) if n else np.zeros((0, 0))
    A, B = zero_order_hold(companion, scale * np.eye(n, 1), dt)
    C = (b[1:] - b[0] * a[1:]) / powers
    poles = np.poly(A) if n else np.ones(1)
    markov, state = [b[0]], B
    for _ in range(n):
        markov.append((C @ state).item())
        state = A @ state
    return np.convolve(markov, poles)[: n + 1], poles


def unstable_pole(poles: np.ndarray, domain: str) -> str:
    """Return what is wrong with the least stable of some poles, or "" for poles that rounding may have moved."""
    found = [complex(pole) for pole in poles]
    pole = max(found, key=lambda each: each.real if domain == "s" else abs(each), default=0j)
    excess = pole.real / max(map(abs, found), default=1.0) if domain == "s" and pole else abs(pole) - 1.0
    if excess <= 1e-4:
        return ""
    value = f"{pole.real:.4g}" + f" ± {abs(pole.imag):.4g}j" * (pole.imag != 0.0)
    where = "in the right half of the plane" if domain == "s" else "outside the unit circle"
    return f"its pole at {domain} = {value} is {where}: alone, its output grows without bound"


def tustin(coefficients: Sequence[float] | np.ndarray, dt: Any) -> np.ndarray:
    """Convert a polynomial in s to one in z: times (z + 1)^degree, with s = 2/dt (z - 1)/(z + 1).

    Coefficients are in decreasing powers.
    """
    degree = len(coefficients) - 1
    total = np.zeros(degree + 1)
    for power, coefficient in zip(range(degree, -1, -1), coefficients):
        term = np.array([coefficient * (2.0 / dt) ** power])
        for root in [1.0] * power + [-1.0] * (degree - power):
            term = np.convolve(term, [1.0, -root])
        total += term
    return total


def delays_at_rest(b: tuple[float, ...], a: tuple[float, ...]) -> list[float]:
    """Return the steady-state delays of the transposed direct form II for an input of 1.

    The sums are exact before one rounding. Zeros for an integrator, which has no such state, including systems that
    differ from an integrator by rounding only.
    """
    if abs(math.fsum(a)) <= 1e-12 * math.fsum(map(abs, a)):
        return [0.0] * (len(b) - 1)
    gain = math.fsum(b) / math.fsum(a)
    return [math.fsum(b[k:]) - gain * math.fsum(a[k:]) for k in range(1, len(b))]


class BiquadCascade(Biquads):
    """Second-order sections in series: H(z) = Π (b0 + b1/z + b2/z²) / (a0 + a1/z + a2/z²).

    Rows (b0, b1, b2, a0, a1, a2), as returned by SciPy's designs with output="sos". Transposed direct form II. Direct
    feedthrough. Starts at zero; after arming it starts in steady state for the present input. NaN passes and persists
    until the next reset.
    """

    sos = Param(((1.0, 0.0, 0.0, 1.0, 0.0, 0.0),), "1", "rows (b0, b1, b2, a0, a1, a2), one per section")

    def configure(self) -> None:
        try:
            rows: Any = np.asarray(self.sos, dtype=float)
        except (TypeError, ValueError, OverflowError):
            rows = np.empty(0)
        shaped = rows.ndim == 2 and rows.shape[1] == 6 and len(rows)
        if not shaped or not np.all(np.isfinite(rows)) or not np.all(rows[:, 3]):
            raise ValueError(
                f"sos: expected rows of six finite numbers, b0 b1 b2 a0 a1 a2, with a nonzero a0, got {self.sos!r}"
            )
        self.sos = tuple((*row,) for row in rows.tolist())

    def design(self, dt: float) -> list[tuple[float, ...]]:
        """Return the biquads (b0, b1, b2, a1, a2), with a0 divided out. dt : s"""
        return [(b0 / a0, b1 / a0, b2 / a0, a1 / a0, a2 / a0) for b0, b1, b2, a0, a1, a2 in self.sos]


class StateSpace(Block):
    """Linear state-space system: x[k+1] = A x[k] + B u[k], y[k] = C x[k] + D u[k], x[0] = start.

    In the domain s, the matrices are those of x' = A x + B u, discretised with a zero-order hold: exact for an input
    that is constant between ticks. Matrices are nested tuples or arrays: A (n, n), B (n, m), C (p, n), D (p, m). A port
    is a scalar if m or p is 1, and a vector otherwise. Direct feedthrough if D is not zero; otherwise none, and the
    block may close a loop. After arming it starts in steady state for the present input, unless `start` is given or the
    system is unstable. NaN persists until the next reset.
    """

    A = Param((), "1", "system matrix A, (n, n)", dtype=tuple, required=True)
    B = Param((), "1", "input matrix B, (n, m)", dtype=tuple, required=True)
    C = Param((), "1", "output matrix C, (p, n)", dtype=tuple, required=True)
    D = Param((), "1", "feedthrough matrix D, (p, m); zero by default", dtype=tuple)
    start = Param((), "1", "initial state, (n,); zero by default", dtype=tuple)
    unit = Param("1", "1", "unit of the gain; the output unit is its product with the input unit")
    domain = Param("z", "1", "domain of the matrices: z (discrete) or s (continuous)", choices=("z", "s"))

    u = Input("any", "input", shape=...)
    y = Output("any", "output", shape=...)

    matrix_a = Memory(0.0, "A, row by row")
    matrix_b = Memory(0.0, "B, row by row")
    matrix_c = Memory(0.0, "C, row by row")
    matrix_d = Memory(0.0, "D, row by row; empty if it is zero")
    rest = Memory(0.0, "steady state for inputs of 1, row by row")
    state = Memory(0.0, "state x")
    following = Memory(0.0, "buffer for the next state")

    smooth = ("u",)
    kernel = kernels.state_space
    update_kernel = kernels.state_space_next

    examples = (
        {"A": ((0.9, 0.1), (-0.1, 0.8)), "B": ((0.0,), (0.1,)), "C": ((1.0, 0.0),)},
        {"A": ((0.5,),), "B": ((1.0, -1.0),), "C": ((1.0,), (2.0,)), "D": ((0.0, 1.0), (1.0, 0.0)), "start": (3.0,)},
    )

    def configure(self) -> None:
        self.unit = canonical(self.unit)
        A, B, C = (matrix(name, getattr(self, name)) for name in "ABC")
        n, m, p = len(A), B.shape[1], len(C)
        D = matrix("D", self.D) if len(self.D) else np.zeros((p, m))
        start = np.array(finite_numbers("start", self.start)) if len(self.start) else np.zeros(n)
        for name, shape, expected in (
            ("A", A.shape, (n, n)),
            ("B", B.shape, (n, m)),
            ("C", C.shape, (p, n)),
            ("D", D.shape, (p, m)),
            ("start", start.shape, (n,)),
        ):
            if shape != expected:
                raise ValueError(
                    f"{name}: expected shape {expected}, got {shape}, with A {A.shape}, B {B.shape} and C {C.shape}"
                )
        self.inputs = {"u": Input("any", "input", shape=() if m == 1 else (m,)).named("u")}
        self.outputs = {"y": Output("any", "output", shape=() if p == 1 else (p,)).named("y")}
        self.feedthrough = None if D.any() else ()
        self.matrix_c, self.matrix_d = C.ravel(), D.ravel() if D.any() else ()
        self.given = A, B, C, D, start
        self.state, self.following = start, np.zeros(n)
        self.place(A, B)

    def prepare(self, dt: float) -> None:
        if self.domain == "s":
            self.place(*self.design(dt)[:2])

    def design(self, dt: Any) -> tuple[np.ndarray, ...]:
        """Return (A, B, C, D, start) of one step. dt : s, used in the domain s only"""
        A, B, *others = self.given
        return (*(zero_order_hold(A, B, dt) if self.domain == "s" else (A, B)), *others)

    def place(self, A: np.ndarray, B: np.ndarray) -> None:
        """Set the matrices of a step, and its steady state."""
        self.matrix_a, self.matrix_b = A.ravel(), B.ravel()
        rest = None if len(self.start) or not stable(A) else state_at_rest(A, B)
        self.rest = np.zeros(B.size) if rest is None else rest.ravel()
        self.settle_kernel = None if rest is None else kernels.state_space_at_rest

    def output_units(self, u: str) -> dict[str, str]:
        return {"y": multiply(u, self.unit)}

    def instability(self) -> tuple[str, str] | None:
        pole = unstable_pole(np.linalg.eigvals(self.given[0]), self.domain)
        cure = "close a loop around it" if self.domain == "s" else 'pass domain="s" for the matrices of x\' = A x + B u'
        return (pole, cure) if pole else None

    def output_range(self, u: Interval) -> Interval | None:
        matrices = design_at(self) if self.domain == "s" else self.given
        reach = None if matrices is None else reach_of_state_space(*matrices)
        return EVERYTHING if reach is None else reach.interval([u] * self.given[1].shape[1])


def matrix(name: str, rows: tuple[tuple[float, ...], ...]) -> np.ndarray:
    """Return a two-dimensional array of finite numbers. ValueError for other rows."""
    try:
        array = np.array(rows, dtype=float)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{name}: expected rows of numbers of equal length, got {rows!r}") from None
    if array.ndim != 2 or not array.size or not np.all(np.isfinite(array)):
        raise ValueError(f"{name}: expected rows of finite numbers, got {rows!r}")
    return array


def state_at_rest(A: np.ndarray, B: np.ndarray) -> np.ndarray:
    """Return (I - A)⁻¹ B, the steady state for each input of 1, exact before one rounding. A must be stable."""
    n = len(B)
    rows = [
        [Fraction(int(i == j)) - Fraction(A[i, j]) for j in range(n)] + [Fraction(value) for value in B[i]]
        for i in range(n)
    ]
    for column in range(n):
        pivot = next(row for row in range(column, n) if rows[row][column])
        rows[column], rows[pivot] = rows[pivot], rows[column]
        factor = rows[column][column]
        rows[column] = [value / factor for value in rows[column]]
        for row in range(n):
            if row != column and rows[row][column]:
                factor = rows[row][column]
                rows[row] = [value - factor * other for value, other in zip(rows[row], rows[column])]
    return np.array([[float(value) for value in row[n:]] for row in rows])


def zero_order_hold(A: np.ndarray, B: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Return (A, B) of the zero-order-hold discretisation of x' = A x + B u with the period dt in s.

    The matrix exponential is computed by scaling and squaring.
    """
    n, m = B.shape
    step = np.zeros((n + m, n + m))
    step[:n, :n], step[:n, n:] = A * dt, B * dt
    squarings = max(0, math.frexp(float(np.abs(step).sum()))[1] + 1)
    total = term = np.eye(n + m)
    for k in range(1, 20):
        term = term @ step / (k * 2.0**squarings)
        total = total + term
    for _ in range(squarings):
        total = total @ total
    return total[:n, :n], total[:n, n:]
