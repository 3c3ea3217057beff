"""Interpolation tables against NumPy and SciPy, at and beyond their ends, and their ranges."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import RegularGridInterpolator

from blocks.sources import Ramp
from blocks.tables import LookupTable1D, LookupTable2D
from cext.schedule.executor import Executor
from cext.schedule.program import Program
from graph import Diagram, DiagramError, Interval, compile
from tests.blocks.proofs import anything, finite, keeps_its_range, sensible

NAN = math.nan
X, Y = (-1.0, 0.5, 2.0, 2.5), (3.0, -1.0, 4.0, 4.0)
ROWS, COLUMNS = (0.0, 1.0, 4.0), (-1.0, 0.0, 0.5, 2.0)
GRID = ((1.0, 2.0, -3.0, 0.5), (4.0, 0.0, 1.0, 2.0), (-2.0, 5.0, 0.0, 1.0))


@given(sensible | anything)
def test_a_clamped_curve_equals_numpys(u):
    wanted = np.interp(u, X, Y) if math.isfinite(u) else NAN
    assert LookupTable1D(X, Y).step(u) == pytest.approx(wanted, rel=1e-14, abs=1e-14, nan_ok=True)


@given(sensible)
def test_extrapolating_curve_continues_end_segments(u):
    slope = (Y[1] - Y[0]) / (X[1] - X[0])
    wanted = Y[0] + slope * (u - X[0]) if u < X[0] else Y[-1] if u > X[-1] else np.interp(u, X, Y)
    assert LookupTable1D(X, Y, "extrapolate").step(u) == pytest.approx(wanted, rel=1e-13, abs=1e-13)


@pytest.mark.parametrize("beyond", ["clamp", "extrapolate", "error"])
def test_a_curve_passes_through_its_points_exactly(beyond):
    assert [LookupTable1D(X, Y, beyond).step(x) for x in X] == list(Y)
    block = LookupTable2D(ROWS, COLUMNS, GRID, beyond)
    assert [[block.step(r, c) for c in COLUMNS] for r in ROWS] == [list(row) for row in GRID]


@pytest.mark.parametrize("beyond", ["clamp", "extrapolate", "error"])
def test_nan_affects_only_its_element(beyond):
    y = LookupTable1D(X, Y, beyond).step(np.array([0.0, NAN, 1.0]))
    assert [math.isnan(element) for element in y] == [False, True, False]
    block = LookupTable2D(ROWS, COLUMNS, GRID, beyond)
    assert math.isnan(block.step(NAN, 0.0)) and math.isnan(block.step(0.0, NAN)) and block.step(0.0, 0.0) == 2.0


@given(row=sensible, column=sensible)
def test_a_surface_is_that_of_scipy_and_clamps(row, column):
    wanted = RegularGridInterpolator((ROWS, COLUMNS), np.array(GRID))(
        (np.clip(row, 0.0, 4.0), np.clip(column, -1.0, 2.0))
    )
    assert LookupTable2D(ROWS, COLUMNS, GRID).step(row, column) == pytest.approx(float(wanted), rel=1e-13, abs=1e-13)


@given(row=sensible, column=sensible)
def test_a_surface_that_extrapolates_is_that_of_scipy(row, column):
    wanted = RegularGridInterpolator((ROWS, COLUMNS), np.array(GRID), bounds_error=False, fill_value=None)(
        (row, column)
    )
    assert LookupTable2D(ROWS, COLUMNS, GRID, "extrapolate").step(row, column) == pytest.approx(
        float(wanted), rel=1e-12, abs=1e-12
    )


def test_beyond_the_ends_the_run_ends_in_a_fault_on_request():
    with Diagram("d", rate=10) as diagram:
        curve = LookupTable1D(X, Y, "error", name="table")
        curve(Ramp(1.0)())
    outcome = Executor(Program(compile(diagram)), 10.0, virtual=True).run(100, fade=0.0)
    assert (outcome.faulted, outcome.culprit, outcome.tick) == (True, "table", 26), (
        "2.5 is the last breakpoint, reached at tick 25"
    )
    text = curve.fault_text(int(outcome.status.removeprefix("kernel status ")))
    assert text == f"u is outside the table, {X[0]:g} to 2.5"
    block = LookupTable2D(ROWS, COLUMNS, GRID, "error")
    for row, column in ((-0.1, 0.0), (4.1, 0.0), (1.0, -1.1), (1.0, 2.1), (math.inf, 0.0)):
        with pytest.raises(ArithmeticError, match="status 64"):
            block.step(row, column)
    assert block.fault_text(64) == "row or column is outside the table: rows 0 to 4, columns -1 to 2"


def test_the_output_has_the_given_unit():
    with Diagram("d", rate=10) as diagram:
        LookupTable1D(X, Y, unit="N*m", name="curve")(Ramp(1.0, unit="rad")())
        LookupTable2D(unit="N*m", name="surface")(
            Ramp(1.0, unit="rad", name="a")(), Ramp(1.0, unit="rad/s", name="b")()
        )
    signals = compile(diagram).signals
    assert signals["curve.y"].unit == signals["surface.y"].unit == "N·m"


@pytest.mark.parametrize(
    "make, said",
    [
        (lambda: LookupTable1D((0.0, 0.0), (1.0, 2.0)), "strictly increasing"),
        (lambda: LookupTable1D((0.0,), (1.0,)), "at least two"),
        (lambda: LookupTable1D((0.0, 1.0), (1.0,)), "2 breakpoints and 1 values"),
        (lambda: LookupTable1D((0.0, math.inf), (1.0, 2.0)), "finite"),
        (lambda: LookupTable1D((-1.7e308, 1.7e308), (1.0, 2.0)), "strictly increasing"),
        (lambda: LookupTable1D(beyond="wrap"), "must be one of clamp"),
        (lambda: LookupTable2D((0.0, 1.0), (0.0, 1.0), ((1.0, 2.0), (3.0,))), "2 rows of 2 numbers"),
        (lambda: LookupTable2D((0.0, 1.0), (0.0, 1.0), ((1.0, 2.0),)), "2 rows of 2 numbers"),
        (lambda: LookupTable2D(values=(1.0, 2.0)), "all finite"),
    ],
)
def test_invalid_table_is_refused(make, said):
    with pytest.raises(DiagramError, match=said):
        make()


def knots(smallest, largest):
    numbers = st.floats(-10.0, 10.0) | st.floats(-1e300, 1e300)
    return st.lists(numbers, min_size=smallest, max_size=largest, unique=True).map(lambda x: tuple(sorted(x)))


@pytest.mark.parametrize("beyond", ["clamp", "extrapolate"])
@given(data=st.data(), x=knots(2, 6))
def test_no_curve_leaves_its_range(beyond, data, x):
    values = data.draw(st.lists(sensible | finite, min_size=len(x), max_size=len(x)))
    keeps_its_range(
        data,
        LookupTable1D(x, tuple(values), beyond),
        nan=True,
        ticks=4,
        numbers=anything | sensible | st.sampled_from(x),
    )


@pytest.mark.parametrize("beyond", ["clamp", "extrapolate"])
@given(data=st.data(), rows=knots(2, 4), columns=knots(2, 4))
def test_no_surface_leaves_its_range(beyond, data, rows, columns):
    row = st.lists(sensible | finite, min_size=len(columns), max_size=len(columns)).map(tuple)
    values = tuple(data.draw(st.lists(row, min_size=len(rows), max_size=len(rows))))
    numbers = anything | sensible | st.sampled_from(rows + columns)
    keeps_its_range(data, LookupTable2D(rows, columns, values, beyond), nan=True, ticks=4, numbers=numbers)


def test_overflowing_surface_has_no_proved_range():
    block = LookupTable2D((0.0, 1.0), (0.0, 1.0), ((-1e308, 1e308), (0.0, 0.0)), "extrapolate")
    assert block.step(0.0, 1.000001) == math.inf
    assert block.output_range(Interval(0.0, 0.0), Interval(0.0, 1.000001)) == Interval()


@pytest.mark.parametrize(
    "beyond, ends, wanted",
    [
        ("clamp", (-math.inf, math.inf), (-1.0, 4.0)),
        ("clamp", (5.0, 9.0), (4.0, 4.0)),
        ("clamp", (-0.25, 0.25), (-1.0 / 3.0, 1.0)),
        ("clamp", (0.0, 1.25), (-1.0, 1.5)),
        ("extrapolate", (-4.0, 0.5), (-1.0, 11.0)),
        ("extrapolate", (2.0, math.inf), (4.0, 4.0)),
        ("extrapolate", (-math.inf, 3.0), (-1.0, math.inf)),
        ("error", (-9.0, 0.5), (-1.0, 3.0)),
    ],
)
def test_the_range_of_a_curve_is_tight(beyond, ends, wanted):
    """Within 1e-14: what rounding may add."""
    found = LookupTable1D(X, Y, beyond).output_range(Interval(*ends))
    assert (found.low, found.high) == pytest.approx(wanted, rel=1e-14)


@pytest.mark.parametrize(
    "beyond, row, column, wanted",
    [
        ("clamp", (-math.inf, math.inf), (-math.inf, math.inf), (-3.0, 5.0)),
        ("clamp", (0.0, 0.5), (-1.0, -0.5), (1.0, 2.5)),
        ("clamp", (4.0, 4.0), (0.25, 0.25), (2.5, 2.5)),
        ("extrapolate", (4.0, 7.0), (0.0, 0.0), (5.0, 10.0)),
        ("extrapolate", (0.0, math.inf), (0.0, 0.0), (-math.inf, math.inf)),
        ("extrapolate", (0.0, 1.0), (0.5, 2.0), (-3.0, 2.0)),
    ],
)
def test_the_range_of_a_surface_is_tight(beyond, row, column, wanted):
    """Within 1e-13: what rounding may add."""
    found = LookupTable2D(ROWS, COLUMNS, GRID, beyond).output_range(Interval(*row), Interval(*column))
    assert (found.low, found.high) == pytest.approx(wanted, rel=1e-13)
