"""--set NAME=VALUE: parameters of `build` and `plant`, and of any block by its path."""

import ast
import inspect

from graph import DiagramError, units
from graph.names import suggestion
from runtime.base.errors import BadInput
from runtime.live import patterns

TRUTHS = {"true": True, "yes": True, "1": True, "false": False, "no": False, "0": False}


def share_out(file, settings):
    """Give each setting without a dot to `build`, to `plant`, or to both: to whichever has a parameter of that name.
    BadInput.

    file : DiagramFile
    settings : pairs (name, text)
    """
    offered, open_ended = {}, []  # name: [(parameter, where its value goes)]; functions that take any name
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
            hint = suggestion(name, offered) or (f"it has {', '.join(offered)}" if offered else "it has none")
            raise BadInput(
                f"--set {name}={text}: {file.path} has no parameter {name!r}; {hint} "
                f"(parameters of build() and plant(); a block's own is set as BLOCK.PARAMETER=VALUE)"
            )
        for parameter, target in places:
            target[name] = parse_like(parameter.default, name, text)


def parse_like(default, name, text):
    """The value of a text in the type of a default: bool, int, float, str; anything else as Python would read it."""
    if isinstance(default, str):
        return text
    if isinstance(default, bool):
        if text.lower() in TRUTHS:
            return TRUTHS[text.lower()]
        raise BadInput(f"--set {name}={text}: expected true or false")
    if isinstance(default, (int, float)):
        try:
            return (
                int(text)
                if isinstance(default, int) and text.lstrip("+-").isdigit()
                else units.parse_quantity(text, None)
            )
        except ValueError:
            raise BadInput(
                f"--set {name}={text}: expected a number, such as {default}; with a unit it is converted "
                "to SI, deg to rad"
            ) from None
    try:
        return ast.literal_eval(text)
    except (ValueError, SyntaxError):
        return text


def set_block_parameters(diagram, name, text):
    """Set "left/impedance.stiffness", or all that "*/impedance.stiffness" matches, from a text. BadInput."""
    if not patterns.is_pattern(name):
        set_block_parameter(diagram, name, text)
        return
    known = [f"{block.path}.{parameter}" for block in diagram for parameter in block.parameters]
    found = patterns.matching(name, known)
    if not found:
        hint = patterns.hint(name, known) or f"its blocks are {', '.join(sorted(diagram.blocks))}"
        raise BadInput(f"--set {name}={text}: {diagram.name} has no parameter that matches; {hint}")
    for each in found:
        set_block_parameter(diagram, each, text)


def set_block_parameter(diagram, name, text):
    """Set "left/impedance.stiffness" from a text. BadInput."""
    path, _, parameter = name.rpartition(".")
    if path not in diagram.blocks:
        known = [f"{block.path}.{p}" for block in diagram for p in block.parameters]
        near = suggestion(path, diagram.blocks)
        hint = suggestion(name, known) or near or f"its blocks are {', '.join(sorted(diagram.blocks))}"
        raise BadInput(f"--set {name}={text}: {diagram.name} has no block {path!r}; {hint}")
    try:
        diagram[path].set(parameter, text)
    except DiagramError as error:
        problem = error.diagnostics[0]
        hint = f"; {problem.hint}" if problem.hint else ""
        raise BadInput(
            f"--set {name}={text}: {path} {problem.message}{hint}"
            if problem.message.startswith("has no")
            else f"--set {name}={text}: {problem.message}{hint}"
        ) from None
