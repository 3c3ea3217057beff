"""Pages of blocks: every example runs, linear blocks have the frequency response of theory, and the index is fresh."""

import networkx
import numpy as np
import pytest

from blocks.filters import Butterworth
from graph import Device, Signal, Sink
from graph.drawing.cards import family
from tests.docs import block_examples, block_pages, responses


@pytest.fixture(scope="module")
def examples():
    """Return {name: (Example, home)} of every block."""
    with block_examples.folder():
        yield {kind.__name__: block_examples.example_of(kind, home) for kind, home in block_pages.homes().items()}


def test_every_example_runs_and_its_block_computes(examples):
    for name, shown in examples.items():
        trial, inputs = block_examples.run(shown)
        if shown.style == "none":
            assert issubclass(shown.kind, (Device, Sink)) or shown.kind.always or not shown.kind.outputs, name
            continue
        assert trial.fault is None and set(inputs) <= set(shown.inputs), name
        assert any(path.startswith("block.") for path in trial.signals), name


def test_frequency_response_of_a_filter_is_that_of_its_design(examples):
    gain, phase = responses.frequency_response(examples["Butterworth"])
    design = np.tan(np.pi * responses.FREQUENCIES / block_examples.RATE) / np.tan(
        np.pi * Butterworth().cutoff / block_examples.RATE
    )
    assert gain == pytest.approx(1.0 / np.sqrt(1.0 + design**4), abs=1e-6)
    assert np.degrees(phase[0]) == pytest.approx(0.0, abs=5.0) and np.degrees(phase[-1]) < -170.0


def test_frequency_response_of_a_notch_reaches_its_bottom(examples):
    gain, _ = responses.frequency_response(examples["Notch"])
    assert gain.min() < 0.1 and responses.FREQUENCIES[gain.argmin()] == pytest.approx(50.0, abs=0.2)


@pytest.mark.parametrize("name", ["Median", "SoftStart", "TorqueLimiter"])
def test_nonlinear_and_time_varying_blocks_have_no_frequency_response(examples, name):
    assert responses.frequency_response(examples[name]) is None


def test_the_example_of_a_controller_closes_its_loop(examples):
    kinds = [shown for shown in examples.values() if family(shown.kind) == "controller" and shown.style != "walk"]
    assert len(kinds) >= 8
    for shown in kinds:
        wires = [wire for wire in block_examples.diagram(shown).wires if isinstance(wire.source, Signal)]
        graph = networkx.DiGraph((wire.source.block.path, wire.block.path) for wire in wires)
        loop = next((loop for loop in networkx.strongly_connected_components(graph) if len(loop) > 1), set())
        # which a feed-forward has beside it
        assert "plant" in loop and ("block" in loop) == (shown.kind.__name__ != "FeedForward"), shown.kind.__name__


@pytest.mark.parametrize(
    "name, port, target", [("PD", "position", 0.5), ("PID", "position", 0.5), ("PI", "velocity", 1)]
)
def test_a_controller_brings_the_plant_of_its_example_to_the_set_point(examples, name, port, target):
    trial, _ = block_examples.run(examples[name])
    assert trial[f"plant.{port}"][-1] == pytest.approx(target, rel=0.05)


def test_index_of_the_blocks_is_fresh():
    text = block_pages.index(block_pages.source)
    assert block_pages.INDEX.read_text() == text, "run `python -m tests.docs.block_pages`"


def test_tables_show_addresses_as_data_sheets_do_and_the_truth_of_defaults(examples, tmp_path):
    kind = examples["ICM20948"].kind
    text = block_pages.page(kind, block_pages.homes()[kind], tmp_path, pictures=False)
    assert (
        "| 0x68 | 0x8 to 0x77 |" in text
        and "| 0 | 0 to 0x77 |" in text
        and "whether the magnetometer is read | true |" in text
    )


def test_ports_of_a_page_are_those_of_its_example(examples, tmp_path):
    kind = examples["CubeMarsServo"].kind
    text = block_pages.page(kind, block_pages.homes()[kind], tmp_path, pictures=False)
    assert "`current_command`" in text and ">current_command " in (tmp_path / "CubeMarsServo.svg").read_text()


def test_text_of_a_docstring_is_literal_markdown():
    assert block_pages.markdown("y = a * b for |u| < 1, `*_power` [N]") == r"y = a \* b for \|u\| \< 1, `*_power` \[N\]"


def test_path_of_a_page_in_a_docstring_becomes_a_link():
    text = "docs/reference/inputs.md describes its bytes"
    assert block_pages.markdown(text) == "[docs/reference/inputs.md](../../reference/inputs.md) describes its bytes"
