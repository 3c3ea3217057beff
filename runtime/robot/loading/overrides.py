"""Settings NAME=VALUE: parameters of `build` and `plant`, and of any block by its path.

The messages are valid for callers in Python and for `--set`.
"""

from __future__ import annotations

import ast
import inspect
from collections.abc import Iterable, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from graph import DiagramError, units
from graph.declarations import TRUTHS
from graph.sha256 import sha256
from runtime.host.errors import BadInput
from runtime.host.live import patterns
from runtime.host.suggestions import suggestion

if TYPE_CHECKING:
    from graph.block import Block
    from graph.diagnostics import Diagnostic
    from graph.diagram import Diagram
    from runtime.robot.loading.diagram_file import DiagramFile

Settings = Sequence[tuple[str, Any]]  # name, and the value or its text
Replaced = tuple[Any, str, Any]  # block, name of its parameter, value before


def share_out(file: DiagramFile, settings: Settings) -> None:
    """Assign each setting without a dot to `build`, `plant` or both: those with a parameter of that name.

    file : DiagramFile, whose `build_parameters` and `plant_parameters` are filled

    Raises BadInput.
    """
    offered, open_ended = {}, []  # {name: [(parameter, dict for its value)]}; functions that accept any name
    for function, target, skip in (
        (file.function("build"), file.build_parameters, 0),
        (file.function("plant"), file.plant_parameters, 1),
    ):
        if function is None:
            continue
        for parameter in list(inspect.signature(function).parameters.values())[skip:]:
            if parameter.kind is parameter.VAR_KEYWORD:
                open_ended.append((parameter, target))
            elif parameter.kind is not parameter.VAR_POSITIONAL:
                offered.setdefault(parameter.name, []).append((parameter, target))
    for name, text in settings:
        if "." in name:
            continue
        places = offered.get(name, open_ended)
        if not places:
            hint = (
                suggestion(name, offered)
                or parameter_of_block(file, name)
                or (f"it has {', '.join(offered)}" if offered else "it has none")
            )
            raise BadInput(
                f"setting {name}={text}: {file.path} has no parameter {name!r}; {hint} "
                f"(parameters of build() and plant(); name a block's parameter as BLOCK.PARAMETER)"
            )
        for parameter, target in places:
            target[name] = parse_like(parameter.default, name, text)


def parameter_of_block(file: DiagramFile, name: str) -> str:
    """Return a suggestion of a parameter of a block for "stiffness" or "left/impedance/stiffness", or ""."""
    wanted = "." + name.rpartition("/")[2]
    matching = [path for path in places(getattr(file.module, "diagram", ())) if path.endswith(wanted)]
    return suggestion(name, matching) or (f"did you mean {matching[0]!r}?" if matching else "")


def parse_like(default: Any, name: str, text: Any) -> Any:
    """Convert a text to the type of a default: bool, int, float, str; other types are parsed as Python literals.

    A value that is not a text is returned unchanged.
    """
    if isinstance(default, str) or not isinstance(text, str):
        return text
    if isinstance(default, bool):
        if text.lower() in TRUTHS:
            return TRUTHS[text.lower()]
        raise BadInput(f"setting {name}={text}: expected true or false")
    if isinstance(default, (int, float)):
        try:
            return (
                int(text)
                if isinstance(default, int) and text.lstrip("+-").isdigit()
                else units.parse_quantity(text, None)
            )
        except ValueError:
            raise BadInput(
                f"setting {name}={text}: expected a number, such as {default}; with a unit it is converted "
                "to SI, deg to rad"
            ) from None
    try:
        return ast.literal_eval(text)
    except (ValueError, SyntaxError):
        return text


def set_block_parameters(diagram: Diagram, settings: Settings, before: list[Replaced] | None = None) -> None:
    """Set "left/impedance.stiffness", or all matches of "*/impedance.stiffness", to values or their texts.

    Rules between parameters hold for all settings together.

    before : list that receives (block, parameter, value before) of each

    Raises BadInput.
    """
    given: dict[Block, list[str]] = {}
    for name, value in settings:
        for block, parameter in places_of(diagram, name, value):
            setting, earlier = f"{block.path}.{parameter}={value}", getattr(block, parameter, None)
            try:
                put_value(block, parameter, value, "--set")
            except DiagramError as error:
                raise setting_error(setting, error.diagnostics[0]) from None
            given.setdefault(block, []).append(setting)
            if before is not None:
                before.append((block, parameter, earlier))
    for block, texts in given.items():
        try:
            block.reconfigure()
        except DiagramError as error:
            raise setting_error(", ".join(texts), error.diagnostics[0], other_family(texts)) from None


def places_of(diagram: Diagram, name: str, value: Any) -> list[tuple[Block, str]]:
    """Return (block, name of a parameter) of what a setting sets. Raises BadInput without one."""
    path, _, parameter = name.rpartition(".")
    pattern = patterns.is_pattern(name)
    if not pattern and path in diagram.blocks:
        return [(diagram[path], parameter)]
    known = places(diagram)
    matching = patterns.matching(name, known)
    if not matching:
        missing = "parameter that matches" if pattern else f"block {path!r}"
        near = patterns.hint(name, known) or ("" if pattern else suggestion(path, diagram.blocks))
        hint = near or f"its blocks are {', '.join(sorted(diagram.blocks))}"
        raise BadInput(f"setting {name}={value}: {diagram.name} has no {missing}; {hint}")
    return [known[path] for path in matching]


def places(diagram: Iterable[Block]) -> dict[str, tuple[Block, str]]:
    """Return {"left/impedance.stiffness": (block, name of its parameter)} of all parameters."""
    return {f"{block.path}.{name}": (block, name) for block in diagram for name in block.parameters}


def setting_error(setting: str, problem: Diagnostic, remedy: str = "") -> BadInput:
    """Return the error of a setting that a block does not accept. remedy : if the problem has no hint"""
    hint = f"; {problem.hint or remedy}" if problem.hint or remedy else ""
    path = f"{problem.path} " if problem.message.startswith("has no") else ""
    return BadInput(f"setting {setting}: {path}{problem.message}{hint}")


def set_seeds(diagram: Diagram, seed: int) -> list[Replaced]:
    """Derive the seed of every noise source of a diagram from one number and the path of its block, within its bounds.

    Returns [(block, "seed", value before)].
    """
    replaced: list[Replaced] = []
    noise = [block for block in diagram if "seed" in block.parameters]
    set_block_parameters(diagram, [(f"{block.path}.seed", _seed_of(block, seed)) for block in noise], replaced)
    return replaced


def derive_seed(seed: int, path: str) -> int:
    """Return the first 53 bits of the SHA-256 of "SEED:PATH" as an integer."""
    return int.from_bytes(sha256(f"{seed}:{path}".encode()).digest()[:7], "big") >> 3


def _seed_of(block: Block, seed: int) -> int:
    number, bounds = derive_seed(seed, block.path), block.parameters["seed"]
    lowest, highest = bounds.min or 0, bounds.max
    return number if highest is None or number <= highest else int(lowest + number % (highest - lowest + 1))


def restore(replaced: Sequence[Replaced]) -> None:
    """Restore parameters to their previous values. replaced : values as returned by the functions above"""
    for block, parameter, before in reversed(replaced):
        put_value(block, parameter, before)
    for block in dict.fromkeys(block for block, *_ in replaced):
        block.reconfigure()


def put_value(block: Block, parameter: str, value: Any, source: str = "") -> None:
    """Set a parameter as Block.put does; the model of an actuator that was made by name may be of another family."""
    if parameter == "model":
        from blocks.actuators.by_name import change_model  # imports every family

        if change_model(block, value):
            return
    block.put(parameter, value, source)


def other_family(settings: Sequence[str]) -> str:
    """Return the remedy for a model of another family than that of its block, "" without one.

    settings : settings of the block, as NAME=VALUE
    """
    from blocks.families import find_model

    for name, _, model in (setting.partition("=") for setting in settings):
        with suppress(ValueError):
            if name.endswith(".model") and find_model(model):
                return f"in the diagram, Actuator({model!r}) makes the block of any family"
    return ""
