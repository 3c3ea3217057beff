"""Tables over time and files played back."""

import math
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from blocks.sources import Playback, TimeTable
from graph import Diagram, DiagramError, Interval, compile
from tests.blocks.proofs import at
from tests.blocks.running import run
from tests.shared import shared

STRIDE = str(Path(__file__).with_name("stride.csv"))  # 1 s at 20 Hz, with a NaN in the torque at 0.5 s


def trace(make, ticks, rate=200.0):
    with Diagram("source", rate=rate) as diagram:
        make(name="source")
    return run(diagram, ticks)["source.y"]


def write(folder, text):
    path = folder / "data.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return str(path)


def test_a_table_over_time_is_that_of_numpy():
    times, values = (0.1, 0.25, 0.7, 1.5), (1.0, -2.0, 4.0, 0.5)
    y = trace(lambda name: TimeTable(times, values, name=name), 400)
    assert y == pytest.approx(np.interp(np.arange(400) / 200.0, times, values), rel=1e-13, abs=1e-14)


def test_a_table_that_holds_changes_at_the_tick_of_its_times():
    y = trace(
        lambda name: TimeTable((0.1, 0.3, 0.6), (1.0, 2.0, 3.0), interpolation="previous", name=name), 10, rate=10
    )
    assert y.tolist() == [1.0, 1.0, 1.0, 2.0, 2.0, 2.0, 3.0, 3.0, 3.0, 3.0]


@pytest.mark.parametrize("rate", [10.0, 200.0, 1000.0])
def test_a_table_that_holds_and_repeats_keeps_to_the_tick_for_100_s(rate):
    tenth = int(rate / 10)
    parameters = {"interpolation": "previous", "repeat": True}
    y = trace(lambda name: TimeTable((0.0, 0.1, 0.3), (1.0, 2.0, 9.0), **parameters, name=name), int(100 * rate), rate)
    k = np.arange(len(y)) % (3 * tenth)
    assert np.array_equal(y, np.where(k < tenth, 1.0, 2.0))


def test_repeating_table_wraps_from_last_to_first_value():
    """A sawtooth: within 1e-9 of one by integer arithmetic."""
    y = trace(lambda name: TimeTable((0.0, 0.5), (0.0, 5.0), repeat=True, name=name), 1000)
    assert y == pytest.approx(np.arange(1000) % 100 / 20.0, abs=1e-9)


@pytest.mark.parametrize("rate, length", [(100.0, 0.1), (100.0, 0.07), (333.0, 0.3), (1000.0, 0.07)])
def test_a_sawtooth_falls_at_the_tick_of_every_repetition(rate, length):
    """Within 1e-9 over 20 s, also where t / length rounds to less than a whole number."""
    y = trace(lambda name: TimeTable((0.0, length), (0.0, 1.0), repeat=True, name=name), int(20 * rate), rate)
    cycle = Fraction(str(length)) * int(rate)
    wanted = [float(k / cycle % 1) for k in range(len(y))]
    assert y == pytest.approx(np.array(wanted), abs=1e-9)


@pytest.mark.parametrize(
    "parameters, said",
    [
        ({"times": (0.0, 1.0, 1.0), "values": (0.0, 1.0, 2.0)}, "strictly increasing"),
        ({"times": (0.0, 1.0), "values": (0.0,)}, "got 2 times and 1 values"),
        ({"times": (0.0,), "values": (0.0,)}, "at least two times"),
        ({"times": (0.0, math.inf)}, "finite"),
        ({"values": (0.0, math.nan)}, "finite"),
        ({"interpolation": "cubic"}, "must be one of linear, previous"),
    ],
)
def test_invalid_table_is_refused(parameters, said):
    with pytest.raises(DiagramError, match=said):
        TimeTable(**parameters)


finite = st.floats(allow_nan=False, allow_infinity=False)


@given(
    data=st.data(),
    times=st.lists(st.floats(-10.0, 10.0), min_size=2, max_size=6, unique=True),
    repeat=st.booleans(),
    interpolation=st.sampled_from(["linear", "previous"]),
)
def test_no_table_leaves_the_range_of_its_values(data, times, repeat, interpolation):
    values = data.draw(st.lists(finite | st.floats(-10.0, 10.0), min_size=len(times), max_size=len(times)))
    block = TimeTable(tuple(sorted(times)), tuple(values), interpolation, repeat)
    block.dt = data.draw(st.floats(1e-3, 1.0))
    assert block.output_range() == Interval(min(values), max(values))
    for _ in range(5):
        assert at(block, data.draw(st.integers(0, 10000))) in block.output_range()


def test_a_column_is_played_by_its_times_with_the_unit_of_its_header():
    with Diagram("d", rate=40) as diagram:
        Playback(STRIDE, "left/knee.position", name="knee")
    assert compile(diagram).signals["knee.y"].unit == "rad"
    y = run(diagram, 50)["knee.y"]
    written = 0.4 - 0.4 * np.cos(2.0 * math.pi * np.arange(21) / 20.0)
    assert y[:41:2] == pytest.approx(written, abs=1e-6)
    assert y[1:40:2] == pytest.approx((written[:-1] + written[1:]) / 2.0, abs=1e-6)
    assert set(y[41:]) == {y[40]}


def test_a_unit_can_be_set_only_for_a_column_without_one():
    assert Playback(STRIDE, "phase", unit="%").output_units() == {"y": "%"}
    assert Playback(STRIDE, "phase").output_units() == {"y": "any"}
    assert Playback(STRIDE, "left/knee.torque", unit="N·m").output_units() == {"y": "N·m"}
    with pytest.raises(
        DiagramError, match="left/knee.position is in rad, not in deg. Convert it with a UnitConversion"
    ):
        Playback(STRIDE, "left/knee.position", unit="deg")


def test_nan_in_a_file_plays_as_nan_and_is_not_held():
    y = trace(lambda name: Playback(STRIDE, "left/knee.torque", name=name), 100, rate=100)
    assert np.flatnonzero(np.isnan(y)).tolist() == list(range(46, 55)), (
        "the torque at 0.50 s is NaN, those at 0.45 and 0.55 s are not"
    )
    assert Playback(STRIDE, "left/knee.torque").output_range() == Interval(-1.0, 1.0)


def test_a_file_that_repeats_never_ends():
    y = trace(lambda name: Playback(STRIDE, "left/knee.position", repeat=True, name=name), 60, rate=20)
    assert y == pytest.approx(0.4 - 0.4 * np.cos(2.0 * math.pi * np.arange(60) / 20.0), abs=1e-6)


def test_semicolons_tabs_uneven_times_and_a_start_that_is_not_zero(tmp_path):
    rows = (("t", "force [N]"), ("100.0", "1"), ("100.1", "3"), ("100.4", "0"))
    for delimiter in ";\t":
        file = write(tmp_path, "\ufeff" + "\n".join(delimiter.join(row) for row in rows))
        y = trace(lambda name: Playback(file, "force", time="t", name=name), 5, rate=10)
        assert y == pytest.approx([1.0, 3.0, 2.0, 1.0, 0.0], abs=1e-9)


@pytest.mark.parametrize(
    "text, said",
    [
        ("time,a\n0,1\n1,2\n", "has no column 'u'; it has time, a"),
        ("t,u\n0,1\n1,2\n", "has no column 'time': name that of the times, as in time='t'"),
        ("time,u\n0,1\n1,x\n", "line 3: column 'u' does not contain a number"),
        ("time,u\n0,1\n1\n", "line 3"),
        ("time,u\n0,1\n", "at least two times"),
        ("time,u\n0,1\n0,2\n", "strictly increasing"),
        ("time,u\n0,1\n1,inf\n", "finite"),
        ("time,u\n0,nan\n1,nan\n", "finite"),
        ("", "has no rows: it needs a header"),
        ("time [ms],u\n0,1\n5,2\n", "must be in s, got ms"),
        ("time,u\nnan,1\n1,2\n", "finite"),
        ("time,u\n", "has no rows: it needs a header"),
        (
            "time;u\n0,0;1,5\n0,1;2\n",
            "line 2: column 'time' does not contain a number: '0,0'; write numbers with a decimal point",
        ),
        ("größe".encode("latin-1"), "is not a CSV file in UTF-8"),
    ],
)
def test_a_file_that_cannot_be_played_is_refused_with_its_line(tmp_path, text, said):
    with pytest.raises(DiagramError, match=said):
        Playback(write(tmp_path, text), "u")


def test_a_file_that_does_not_exist_is_refused():
    with pytest.raises(DiagramError, match="file: there is no nowhere.csv in .* or in the working folder"):
        Playback("nowhere.csv", "u")


def test_recorded_walking_plays_back_sample_by_sample():
    """Needs ../shared: 200 Hz, angles in deg."""
    file = str(shared("gait/healthy_young.csv"))
    rows = np.genfromtxt(file, delimiter=",", names=True)
    y = trace(lambda name: Playback(file, "knee_flexion_lt_deg", unit="deg", name=name), len(rows))
    assert y == pytest.approx(rows["knee_flexion_lt_deg"], abs=1e-9)
