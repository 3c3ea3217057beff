"""Filters as biquads in closed form: against SciPy, sample by sample, and against the formulas."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import signal

from blocks._plumbing.biquads import at_rest, butterworth
from blocks.filters import Butterworth, Notch
from blocks.linear import BiquadCascade
from graph import Diagram, DiagramError, Interval
from tests.blocks.playing import made, play, settle
from tests.soaking import soaked

RATE = 1000.0
NOISE = np.random.default_rng(11).normal(0.0, 2.0, 600)
CASES = [
    ("lowpass", 20.0),
    ("lowpass", 0.3),
    ("lowpass", 480.0),
    ("highpass", 20.0),
    ("highpass", 0.5),
    ("highpass", 400.0),
    ("bandpass", (8.0, 40.0)),
    ("bandpass", (49.0, 51.0)),
    ("bandpass", (0.5, 300.0)),
    ("bandstop", (45.0, 55.0)),
    ("bandstop", (10.0, 200.0)),
]


def as_sos(sections):
    return np.array([(b0, b1, b2, 1.0, a1, a2) for b0, b1, b2, a1, a2 in sections])


@pytest.mark.parametrize("order", soaked(range(1, 9), but=[1, 2, 7]))
@pytest.mark.parametrize("btype, cutoff", CASES)
def test_every_kind_and_order_filters_as_scipy_does(btype, cutoff, order):
    """Within 1e-9 of the largest output; both are cascades of biquads in doubles, whose rounding differs."""
    y = play(lambda: Butterworth(order=order, cutoff=cutoff, btype=btype), RATE, u=NOISE)["y"]
    wanted = signal.sosfilt(signal.butter(order, cutoff, btype, fs=RATE, output="sos"), NOISE)
    assert np.abs(y - wanted).max() < 1e-9 * np.abs(wanted).max()


@pytest.mark.parametrize("order", range(1, 9))
@pytest.mark.parametrize("low, high", [(8.0, 40.0), (0.5, 300.0), (49.0, 51.0)])
def test_the_gain_of_a_band_is_that_of_its_formula(order, low, high):
    """|H|² = 1 / (1 + x^(2 order)), x the prewarped distance from the centre over the width: within 1e-10 at every
    frequency.
    """
    frequencies = np.array([0.1, low, math.sqrt(low * high), 0.5 * (low + high), high, 410.0, 499.0])
    edges, w = (np.tan(np.pi * np.asarray(f) / RATE) for f in ((low, high), frequencies))
    x = (w * w - edges[0] * edges[1]) / (w * (edges[1] - edges[0]))
    for btype, wanted in (
        ("bandpass", 1.0 / np.sqrt(1.0 + x ** (2.0 * order))),
        ("bandstop", 1.0 / np.sqrt(1.0 + x ** (-2.0 * order))),
    ):
        _, found = signal.sosfreqz(
            as_sos(butterworth(order, (low, high), btype, 1.0 / RATE)), worN=frequencies, fs=RATE
        )
        assert np.abs(np.abs(found) - wanted).max() < 1e-10


@given(order=st.integers(1, 8), edges=st.tuples(st.floats(0.005, 0.49), st.floats(0.005, 0.49)), passes=st.booleans())
def test_any_band_is_stable_and_has_the_gain_of_its_formula(order, edges, passes):
    low, high = sorted(edges)
    if high - low < 0.002:
        high = low + 0.002
    sections = butterworth(order, (low, high), "bandpass" if passes else "bandstop", 1.0)
    assert len(sections) == order and all(abs(a2) < 1.0 and abs(a1) < 1.0 + a2 for *_, a1, a2 in sections)
    _, found = signal.sosfreqz(as_sos(sections), worN=[low, high], fs=1.0)
    assert np.abs(np.abs(found) - math.sqrt(0.5)).max() < 1e-6


@pytest.mark.parametrize("frequency, q", [(50.0, 30.0), (60.0, 5.0), (1.0, 0.5), (490.0, 100.0)])
def test_a_notch_equals_scipys_and_removes_its_frequency(frequency, q):
    y = play(lambda: Notch(frequency, q), RATE, u=NOISE)["y"]
    wanted = signal.lfilter(*signal.iirnotch(frequency, q, RATE), NOISE)
    assert np.abs(y - wanted).max() < 1e-11 * np.abs(wanted).max()
    hum = np.sin(2.0 * math.pi * frequency * np.arange(20000) / RATE)
    assert np.abs(play(lambda: Notch(frequency, q), RATE, u=hum)["y"][-1000:]).max() < 1e-6


def test_a_cascade_accepts_scipys_sections():
    sos = signal.ellip(6, 0.5, 60.0, (5.0, 60.0), "bandpass", fs=RATE, output="sos")
    y = play(lambda: BiquadCascade(sos), RATE, u=NOISE)["y"]
    assert np.abs(y - signal.sosfilt(sos, NOISE)).max() < 1e-11
    scaled = sos * np.array([[2.0], [4.0], [0.5]] * 2)
    assert np.array_equal(play(lambda: BiquadCascade(scaled), RATE, u=NOISE)["y"], y), "a0 is divided out"


@pytest.mark.parametrize(
    "btype, cutoff, rest",
    [("lowpass", 6.0, 1.0), ("highpass", 6.0, 0.0), ("bandpass", (4.0, 9.0), 0.0), ("bandstop", (4.0, 9.0), 1.0)],
)
def test_a_settled_filter_stays_at_its_steady_state(btype, cutoff, rest):
    """As SciPy's sosfilt_zi has it: within 1e-12 for a thousand ticks."""
    block = made(Butterworth, 3, cutoff, btype, rate=RATE)
    settle(block, u=0.8)
    assert max(abs(block.step(0.8) - 0.8 * rest) for _ in range(1000)) < 1e-12
    sos = signal.butter(3, cutoff, btype, fs=RATE, output="sos")
    settle(block, u=0.8)
    found = [block.step(u) for u in NOISE[:200]]
    wanted = signal.sosfilt(sos, NOISE[:200], zi=signal.sosfilt_zi(sos) * 0.8)[0]
    assert np.abs(found - wanted).max() < 1e-10


def test_an_integrating_section_starts_at_zero_despite_rounding():
    assert (
        at_rest([(1.0, 0.0, 0.0, -1.0, 0.0), (1.0, 0.0, 0.0, -1.9, 0.9), (1.0, 0.0, 0.0, -1.7, 0.7000000000000001)])
        == [0.0] * 9
    )
    block = made(BiquadCascade, ((1.0, 0.0, 0.0, 1.0, -1.9, 0.9),))
    settle(block, u=5.0)
    assert block.step(5.0) == 5.0 and block.output_range(u=Interval(-1.0, 1.0)) == Interval()


def test_each_element_of_a_vector_is_filtered_separately():
    u = NOISE.reshape(200, 3)
    y = play(lambda: Butterworth(2, (5.0, 50.0), "bandpass"), RATE, u=u)["y"]
    for column in range(3):
        assert np.array_equal(
            y[:, column], play(lambda: Butterworth(2, (5.0, 50.0), "bandpass"), RATE, u=u[:, column])["y"]
        )


@pytest.mark.parametrize(
    "parameters, said",
    [
        ({"cutoff": (1.0, 2.0)}, r"cutoff: a lowpass filter requires one frequency in Hz, got \(1.0, 2.0\)"),
        (
            {"btype": "bandpass"},
            r"cutoff: a bandpass filter requires an increasing pair of frequencies in Hz, \(low, high\), got "
            r"10.0",
        ),
        ({"btype": "bandstop", "cutoff": (9.0, 4.0)}, "cutoff: a bandstop filter requires an increasing pair"),
        ({"btype": "bandpass", "cutoff": (4.0, 5.0, 6.0)}, "cutoff: a bandpass filter requires an increasing pair"),
        ({"btype": "bandpass", "cutoff": (0.0, 5.0)}, "cutoff: must be above 0.0 Hz, got 0.0"),
        ({"btype": "bandpass", "cutoff": (1.0, math.nan)}, "cutoff: NaN is not allowed"),
        ({"cutoff": "fast"}, "cutoff: expected a number, got 'fast'"),
        ({"btype": "notch"}, "btype: must be one of lowpass, highpass"),
    ],
)
def test_invalid_butterworth_parameters_are_rejected(parameters, said):
    with pytest.raises(DiagramError, match=said):
        Butterworth(**parameters)


@pytest.mark.parametrize(
    "make, said",
    [
        (
            lambda: Butterworth(2, (10.0, 100.0), "bandpass"),
            "a cutoff of 100 Hz requires a rate above 200 Hz, got 200 Hz",
        ),
        (lambda: Notch(100.0), "a frequency of 100 Hz requires a rate above 200 Hz, got 200 Hz"),
        (lambda: Notch(90.0, 0.5), "q: the bandwidth of 180 Hz must be below half the rate, 100 Hz"),
    ],
)
def test_frequency_above_nyquist_is_refused(make, said):
    with Diagram("slow", rate=200):
        block = make()
    with pytest.raises((DiagramError, ValueError), match=said):
        block.step(0.0)


@pytest.mark.parametrize(
    "rows", [(), ((1.0, 2.0),), ((1.0, 0.0, 0.0, 0.0, 0.0, 0.0),), ((1.0, 0.0, 0.0, 1.0, 0.0, math.nan),)]
)
def test_invalid_sections_of_a_cascade_are_rejected(rows):
    with pytest.raises(DiagramError, match="sos: expected rows of six finite numbers"):
        BiquadCascade(rows)


def test_the_edges_of_a_band_can_be_set_from_the_command_line():
    block = made(Butterworth, 2, (1.0, 2.0), "bandpass")
    block.set("cutoff", "8, 12.5")
    assert block.cutoff == (8.0, 12.5)
    with pytest.raises(DiagramError, match="requires an increasing pair"):
        block.set("cutoff", "8")
