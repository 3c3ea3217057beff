"""The same diagram as Mermaid text."""

import re

from blocks.mathematics import Gain
from blocks.recorders import CsvRecorder
from blocks.sources import Sine
from graph import Diagram
from graph.drawing import draw, mermaid
from tests.graph.drawing.diagrams import by_chance, leg, nested


def test_blocks_subsystems_wires_and_feedback():
    lines = mermaid(draw(leg())).splitlines()
    assert lines[0] == "flowchart LR"
    inside = lines[lines.index('    subgraph f0["left"]') : lines.index("    end")]
    boxes = [line for line in inside[1:] if "command" not in line]
    names = {re.search(r'\["(.+?)(<br>.*)?"\]', line)[1]: line.split("[")[0].strip() for line in boxes}
    assert set(names) == {"knee", "Butterworth", "Impedance", "TorqueLimiter"}
    assert f'    {names["knee"]} -->|"velocity → u"| {names["Butterworth"]}' in lines
    command = next(line for line in inside if '"knee<br>CubeMars, command"' in line).split("[")[0].strip()
    assert f'    {names["TorqueLimiter"]} -->|"limited → torque_command"| {command}' in lines
    assert f'    {names["knee"]} -->|"position"| {names["Impedance"]}' in lines
    assert any(line.startswith("    classDef actuator fill:#") for line in lines)


def test_every_connection_is_drawn_once_across_frames():
    for seed in range(6):
        diagram = by_chance(seed)
        wires = {(wire.source.path, f"{wire.block.path}.{wire.port}") for wire in diagram.wires}
        arrows = [line for line in mermaid(draw(diagram)).splitlines() if "->|" in line]
        assert len(arrows) == len(wires)


def test_the_enabling_signal_points_at_the_subsystem():
    assert re.search(r'b0 -->\|"y → enabled"\| f\d+$', mermaid(draw(nested())), re.M)


def test_names_cannot_end_a_label():
    with Diagram("d", rate=100) as diagram:
        CsvRecorder()(Gain(name='say "hello" #1')(Sine()()))
    assert '["say #quot;hello#quot; #35;1<br>Gain"]' in mermaid(draw(diagram))
