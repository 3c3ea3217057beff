"""Signals between the ticks at which they were recorded, against references of others."""

import copy
import json
import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

import runtime
from cext.memory.shared_state import RECORD_EVENT
from runtime.host.errors import BadInput
from runtime.record.analysis import plots
from runtime.record.analysis.resample import interpolate
from tests.runtime.record.recorder.running import CSV, columns, plan, record, row, sink

RANDOM = np.random.default_rng(8)
TICKS = np.array([tick for tick in range(400) if tick not in (50, 51, 52, 200)])  # four were missed
TIME = TICKS / 200.0
RATES = (7.0, 50.0, 73.3, 150.0, 333.0, 1000.0)


@pytest.fixture(scope="module")
def trial(tmp_path_factory):
    """A number a tick, a product of two quaternions whose port is called y, four numbers that choose one, and a mark at
    0.5 s.
    """
    folder = tmp_path_factory.mktemp("rates")
    turned = Rotation.from_rotvec(np.cumsum(RANDOM.normal(size=(len(TICKS), 3)) * 0.2, axis=0))
    y = turned.as_quat(scalar_first=True) * RANDOM.choice([-1, 1], (len(TICKS), 1))  # either sign is the same turn
    choice = np.eye(4)[TICKS // 7 % 4]
    rows = np.column_stack((TICKS, RANDOM.normal(size=len(TICKS)), y, choice))
    signals = ("a.x m", *(f"product.y[{i}] 1" for i in range(4)), *(f"gait.part[{i}] 1" for i in range(4)))
    mark = RECORD_EVENT, json.dumps({"event": "mark", "number": 1, "tick": 100, "by": "keys"}).encode()
    early = RECORD_EVENT, json.dumps({"event": "set", "path": "a.b", "value": 1.0, "tick": -1, "by": "keys"}).encode()
    record(
        plan(folder, sink(CSV, "csv", columns(*signals)), stem="rates"),
        [early, *(row(*values) for values in rows.tolist()), mark],
    )
    return runtime.load(folder / "rates.mcap")


@pytest.mark.parametrize("rate", RATES)
def test_resampling_at_any_rate_equals_numpys_interpolation(trial, rate):
    made = trial.resample(rate)
    assert np.array_equal(made.tick, np.arange(made.tick[0], made.tick[-1] + 1)) and np.allclose(
        made.time, made.tick / rate, atol=1e-12
    )
    assert made.time[0] == 0.0 and TIME[-1] - 1.0 / rate < made.time[-1] <= TIME[-1] + 1e-9
    assert np.abs(made["a.x"] - np.interp(made.time, TIME, trial["a.x"])).max() < 1e-12


@pytest.mark.parametrize("rate", RATES)
def test_a_quaternion_is_recognised_under_any_port_name(trial, rate):
    made = trial.resample(rate)
    between = Slerp(TIME, Rotation.from_quat(trial["product.y"], scalar_first=True))(
        np.clip(made.time, TIME[0], TIME[-1])
    )
    assert (between.inv() * Rotation.from_quat(made["product.y"], scalar_first=True)).magnitude().max() < 1e-9
    assert np.abs(np.linalg.norm(made["product.y"], axis=1) - 1.0).max() < 1e-12


def test_an_array_of_four_shares_is_not_resampled_as_a_quaternion(trial):
    made = trial.resample(1000)["gait.part"]
    assert np.allclose(made.sum(axis=1), 1.0, atol=1e-12) and len(np.unique(made.round(9))) > 2


def test_events_keep_their_times(trial):
    for rate in (50, 333):
        made = trial.resample(rate)
        assert made.marks == pytest.approx([0.5], abs=1e-12) and plots.moments(made)[0][0] == pytest.approx(
            0.5, abs=1e-12
        )
        assert made.events[0]["tick"] == -1
    assert [event["tick"] for event in trial.resample(50).events if event["event"] == "mark"] == [25]
    assert trial.marks.tolist() == [0.5] and trial.resample(50).resample(200).marks.tolist() == [0.5]


@pytest.mark.parametrize("rate", [1e11, 1e300])
def test_table_larger_than_memory_is_refused(trial, rate):
    with pytest.raises(BadInput, match=r"rows of 9 signals do not fit into this machine's memory"):
        trial.resample(rate)


def test_interpolation_keeps_constant_values_bit_for_bit_without_overflow():
    time = np.arange(8.0)
    values = np.array([-0.0, -0.0, math.inf, math.inf, 1.7e308, -1.7e308, 5e-324, 5e-324])[:, None]
    made = interpolate("straight", time, values, time[:-1] + 0.25)[:, 0]
    assert made[0] == 0.0 and math.copysign(1.0, made[0]) == -1.0
    assert made[1] == made[2] == math.inf and made[3] == math.inf
    assert made[4] == pytest.approx(0.85e308) and made[6] == 5e-324


def test_value_outside_its_type_is_reported_as_recorded(trial):
    """Whole numbers are doubles in a run, and go on behind the last int64."""
    odd = copy.copy(trial)
    odd.about = {**trial.about, "signals": [{**signal, "dtype": "int"} for signal in trial.about["signals"]]}
    odd.rows = np.round(trial.rows)
    assert odd["a.x"].dtype == np.int64
    odd.rows[3, 0] = -(2.0**63)
    assert odd["a.x"].dtype == np.int64 and odd["a.x"][3] == -(2**63)
    odd.rows[4, 0] = 2.0**63
    assert odd["a.x"].dtype == np.float64 and odd["a.x"][4] == 2.0**63
