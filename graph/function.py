"""Blocks from functions: the signature is the declaration.

@block
def spring(angle: Input("rad"), stiffness: Param(30.0, "N·m/rad")) -> Output("N·m"):
    \"\"\"Virtual spring: τ = -K θ.\"\"\"
    return -stiffness * angle

torque = spring(stiffness=40.0)(knee.position)
"""

import inspect
from collections.abc import Callable
from typing import Any

from graph.block import Block
from graph.class_checks import CLOCK
from graph.declarations import Input, Output, Param
from graph.narrowing import is_table


def block(function: Callable[..., Any]) -> type[Block]:
    """Return a Block class from an annotated function without state.

    Arguments annotated with Input become inputs, those with Param parameters; `t`, `tick` and `dt` need no annotation.
    The return annotation is one Output, whose port is called `y`, or a dict of them by name.

    Raises TypeError for an incomplete signature.
    """
    try:
        annotations: dict[str, Any] = inspect.get_annotations(function, eval_str=True)
    except NameError as error:
        raise TypeError(
            f"{function.__name__}: {error.name!r} in its annotations is not defined: annotate an argument with "
            'Input(unit) or Param(default, unit), and the result with Output(unit), as in u: Input("rad")'
        ) from None
    outputs = annotations.pop("return", None)
    if isinstance(outputs, Output):
        outputs = {"y": outputs}
    if not is_table(outputs) or not all(isinstance(port, Output) for port in outputs.values()):
        raise TypeError(
            f"{function.__name__} has no return annotation: add -> Output(unit), or -> {{name: Output(unit), ...}}"
        )
    body: dict[str, Any] = {
        "__doc__": function.__doc__,
        "__module__": function.__module__,
        "__qualname__": function.__qualname__,
        "function": staticmethod(function),
    }
    arguments: list[str] = []
    parameters: list[str] = []
    for name in inspect.signature(function).parameters:
        declaration = annotations.get(name)
        if isinstance(declaration, Param):
            parameters.append(name)
        elif isinstance(declaration, Input) or (declaration is None and name in CLOCK):
            arguments.append(name)
        else:
            raise TypeError(f"{function.__name__}: annotate {name} with Input(unit) or Param(default, unit)")
        if declaration is not None:
            body[name] = declaration
    for name, port in outputs.items():
        if name in body:
            raise TypeError(f"{function.__name__}: the name {name!r} is used twice")
        body[name] = port
    body["step"] = make_step(function, arguments, parameters)
    return type(function.__name__, (Block,), body)


def make_step(function: Callable[..., Any], arguments: list[str], parameters: list[str]) -> Callable[..., Any]:
    """Return a `step` with the argument names of the function, by which a block selects its inputs."""
    call = ", ".join(f"{name}={name}" for name in arguments) + "".join(f", {name}=self.{name}" for name in parameters)
    source = f"def step(self, {', '.join(arguments)}):\n    return function({call.removeprefix(', ')})"
    namespace = {"function": function}
    exec(source, namespace)
    return namespace["step"]
