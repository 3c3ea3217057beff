"""Diagram files: Python that offers `diagram` or `build(**parameters)`, and may offer `plant(robot, **parameters)`."""

import importlib.util
import inspect
import sys
import traceback
from dataclasses import dataclass
from pathlib import Path

from graph import Diagram, DiagramError
from graph.block import suggestion
from runtime.errors import BadInput


@dataclass
class DiagramFile:
    """A loaded file: the module, and what was set for its `build` and its `plant`."""

    path: Path
    module: object
    build_parameters: dict
    plant_parameters: dict

    @property
    def has_plant(self):
        return callable(getattr(self.module, "plant", None))


def load(path, settings=()):
    """Read a diagram file and build its diagram.

    path : of the file
    settings : pairs (name, text) from --set. A name with a dot is a block's parameter, "left/impedance.stiffness"; any other one of the
        parameters of `build` or `plant`

    Returns (DiagramFile, Diagram). Raises BadInput.
    """
    file = DiagramFile(Path(path), execute(Path(path)), {}, {})
    diagram = getattr(file.module, "diagram", None)
    build = getattr(file.module, "build", None)
    if not callable(build) and not isinstance(diagram, Diagram):
        raise BadInput(f"{path} has no diagram: it must define `diagram = Diagram(...)` or a function `build()` that returns one")
    share_out(file, build if callable(build) else None, [s for s in settings if "." not in s[0]])
    if callable(build):
        diagram = guarded(path, build, **file.build_parameters)
        if not isinstance(diagram, Diagram):
            raise BadInput(f"{path}: build() returned {diagram!r}, and must return a Diagram")
    for name, text in settings:
        if "." in name:
            set_block_parameter(diagram, name, text)
    return file, diagram


def build_plant(file, robot):
    """The plant of a diagram file: a Diagram. Raises BadInput."""
    plant = guarded(file.path, file.module.plant, robot, **file.plant_parameters)
    if not isinstance(plant, Diagram):
        raise BadInput(f"{file.path}: plant() returned {plant!r}, and must return a Diagram")
    return plant


def execute(path):
    """Run the file as a module. BadInput, with the line, for everything that can be wrong with it."""
    if not path.exists():
        raise BadInput(f"there is no file {path}")
    if path.is_dir():
        raise BadInput(f"{path} is a folder: name a diagram file in it, such as {next(iter(sorted(path.glob('*.py'))), path / 'knee_exo.py')}")
    spec = importlib.util.spec_from_file_location(path.stem, path)
    if spec is None:
        raise BadInput(f"{path} is not a Python file: its name must end in .py")
    module = importlib.util.module_from_spec(spec)
    sys.modules.setdefault(path.stem, module)
    guarded(path, spec.loader.exec_module, module)
    return module


def guarded(path, function, *arguments, **named):
    """Call the user's code; whatever it raises becomes BadInput with the user's own line."""
    try:
        return function(*arguments, **named)
    except BadInput:
        raise
    except DiagramError as error:
        refused = BadInput("\n".join(map(str, error.diagnostics)))
        refused.diagnostics = tuple(error.diagnostics)
        raise refused from None
    except SyntaxError as error:
        raise BadInput(f"{error.filename}:{error.lineno}: syntax error: {error.msg}" + (f"\n    {error.text.strip()}" if error.text else "")) from None
    except UnicodeDecodeError:
        raise BadInput(f"{path} is not text: a diagram file is Python") from None
    except Exception as error:
        frames = [f for f in traceback.extract_tb(error.__traceback__) if Path(f.filename) == Path(path)]
        frames = frames or traceback.extract_tb(error.__traceback__)[-1:]
        raise BadInput(f"{frames[-1].filename}:{frames[-1].lineno}: {type(error).__name__}: {error}\n    {frames[-1].line}") from error


def share_out(file, build, settings):
    """Give each --set without a dot to `build`, or to `plant`, whichever has a parameter of that name."""
    offered = {}
    for function, target, skip in ((build, file.build_parameters, 0), (getattr(file.module, "plant", None), file.plant_parameters, 1)):
        if callable(function):
            for parameter in list(inspect.signature(function).parameters.values())[skip:]:
                offered.setdefault(parameter.name, (parameter, target))
    for name, text in settings:
        if name not in offered:
            hint = suggestion(name, offered) or (f"{file.path} offers {', '.join(offered)}" if offered else f"{file.path} offers none")
            raise BadInput(f"--set {name}={text}: there is no such parameter; {hint}; a block's parameter is set as BLOCK.PARAMETER=VALUE")
        parameter, target = offered[name]
        target[name] = parse_like(parameter.default, name, text)


def parse_like(default, name, text):
    """The value of a text in the type of a default: bool, int, float or str."""
    try:
        if isinstance(default, bool):
            return {"true": True, "yes": True, "1": True, "false": False, "no": False, "0": False}[text.lower()]
        if isinstance(default, (int, float)):
            return int(text) if isinstance(default, int) and text.lstrip("+-").isdigit() else float(text)
    except (KeyError, ValueError):
        raise BadInput(f"--set {name}={text}: expected a {type(default).__name__}, such as {default}") from None
    return text


def set_block_parameter(diagram, name, text):
    path, _, parameter = name.rpartition(".")
    if path not in diagram.blocks:
        known = [f"{block.path}.{p}" for block in diagram for p in block.parameters]
        hint = suggestion(name, known) or f"blocks are {', '.join(sorted(diagram.blocks))}"
        raise BadInput(f"--set {name}={text}: {diagram.name} has no block {path!r}; {hint}")
    try:
        diagram[path].set(parameter, text)
    except DiagramError as error:
        problem = error.diagnostics[0]
        raise BadInput(f"--set {name}={text}: {problem.message}" + (f"; {problem.hint}" if problem.hint else "")) from None
