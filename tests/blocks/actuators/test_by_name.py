"""One name, one actuator: the block follows from the model, in the spelling of vendors and papers."""

import pytest

import runtime
from blocks.actuators import Actuator, CubeMars, CubeMarsServo, CubeMarsV3, RobStride, RobStrideMIT, actuators
from graph import Diagram, DiagramError, compile
from graph.store import from_json, to_json
from runtime.host.errors import BadInput
from runtime.robot.loading.overrides import restore, set_block_parameters


@pytest.mark.parametrize(
    "name, kind, model",
    [
        ("AK80-9", CubeMars, "AK80-9"),
        ("ak80-9 v2", CubeMars, "AK80-9"),
        ("AK10-9 V2", CubeMars, "AK10-9-V2.0"),
        ("AK80-9-MIT", CubeMars, "AK80-9"),
        ("AK10-9 V3.0", CubeMarsV3, "AK10-9-V3.0"),
        ("AKE60-8", CubeMarsV3, "AKE60-8"),
        ("AK80-9 (V3)", CubeMarsV3, "AK80-9-V3.0"),
        ("CubeMars AK10-9 [V2.0]", CubeMars, "AK10-9-V2.0"),
        ("AK80-9-servo", CubeMarsServo, "AK80-9"),
        ("AK80-9 V3 (servo mode)", CubeMarsServo, "AK80-9-V3.0"),
        ("RS02", RobStride, "RS02"),
        ("RobStride 03", RobStride, "RS03"),
        ("RS02-MIT", RobStrideMIT, "RS02"),
        ("CyberGear", RobStride, "CyberGear"),
        ("Xiaomi CyberGear Micromotor", RobStride, "CyberGear"),
        ("EduLite 05", RobStride, "EL05"),
    ],
)
def test_the_block_follows_from_the_name(name, kind, model):
    block = Actuator(name, can_id=3, limit=1.0)
    assert (type(block), block.model, block.can_id, block.limit) == (kind, model, 3, 1.0)


@pytest.mark.parametrize(
    "name, said",
    [
        ("AK10-9", "several generations"),
        ("AK80-9-V1", "did you mean 'AK80-9'"),
        ("RS2", "did you mean 'RS02'"),
        ("CyberGear-MIT", "the CyberGear has no MIT protocol"),
        ("GL40", "no device family that is installed"),
    ],
)
def test_a_name_of_several_or_no_models_is_refused_where_it_was_written(name, said):
    with pytest.raises(DiagramError, match=said) as refused:
        Actuator(name)
    assert refused.value.diagnostics[0].where.file == __file__


def test_a_group_is_a_dict_of_ids_and_models():
    with Diagram("leg", rate=200) as leg:
        group = actuators({1: "AK80-9", 2: "RS02"}, bus="legs")
        for block in group.values():
            block(torque_command=0.0)
    assert {can_id: (type(block), block.can_id, block.bus) for can_id, block in group.items()} == {
        1: (CubeMars, 1, "legs"),
        2: (RobStride, 2, "legs"),
    }
    assert [device.name for device in compile(leg).devices] == ["actuator_1", "actuator_2"]


def robot(model="AK80-9", **wires):
    with Diagram("robot", rate=200) as diagram:
        motor = Actuator(model, bus="legs", can_id=1, limit=3.0, invert=True, name="motor")
        motor(**{"torque_command": 1.0, **wires})
    return diagram


@pytest.mark.parametrize(
    "model, kind", [("RS02", RobStride), ("AK10-9-V3.0", CubeMarsV3), ("AK10-9-V2.0", CubeMars), ("EL05", RobStride)]
)
def test_a_setting_selects_a_model_of_any_family(model, kind):
    diagram = robot()
    motor, position = diagram["motor"], diagram["motor"].position
    replaced = []
    set_block_parameters(diagram, [("motor.model", model)], replaced)
    assert type(motor) is kind and motor.model == model and diagram["motor"] is motor
    assert (motor.bus, motor.can_id, motor.limit, motor.invert, motor.path) == ("legs", 1, 3.0, True, "motor")
    assert motor.position == position
    [device] = compile(diagram).devices
    assert device.name == "motor" and type(from_json(to_json(diagram))["motor"]) is kind
    restore(replaced)
    assert type(motor) is CubeMars and motor.model == "AK80-9"
    compile(diagram)


@pytest.mark.parametrize("model", ["RS02", "CyberGear", "AK10-9-V3.0", "AK70-10"])
def test_a_simulation_runs_with_the_selected_model(model):
    diagram = robot()
    trial = runtime.run(diagram, 0.5, settings={"motor.model": model})
    assert trial.fault is None and trial["motor.torque_sent"][-1] == pytest.approx(1.0, abs=0.05)
    assert type(diagram["motor"]) is CubeMars, "the diagram keeps its own parameters"


def test_a_model_without_a_port_in_use_is_refused():
    with pytest.raises(BadInput, match="selects a CubeMarsServo, which has no torque_command"):
        set_block_parameters(robot(), [("motor.model", "AK80-9-servo")])


def test_a_block_of_one_family_names_the_block_of_every_family():
    with Diagram("robot", rate=200) as diagram:
        CubeMars("AK80-9", name="motor")(torque_command=1.0)
    with pytest.raises(BadInput, match=r"Actuator\('RS02'\) makes the block of any family"):
        set_block_parameters(diagram, [("motor.model", "RS02")])
