"""Diagram files: Python with `diagram` or `build(**parameters)`, and optionally `plant(robot, **parameters)`."""

from __future__ import annotations

import builtins
import importlib.util
import inspect
import os
import sys
import traceback
from collections.abc import Callable
from contextlib import ExitStack
from functools import lru_cache
from importlib.machinery import SourceFileLoader
from pathlib import Path
from types import CodeType, ModuleType, SimpleNamespace
from typing import TYPE_CHECKING, Any, TypeVar

from cext.user_files import read_small
from cext.user_text import TEXT_LIMIT, bound_text, repr_of
from graph import Diagram, DiagramError, compile
from graph.diagram import no_block_outside
from graph.sha256 import sha256
from runtime.host import diagram_folders
from runtime.host.ending import Interrupted
from runtime.host.errors import BadInput
from runtime.host.suggestions import suggestion
from runtime.robot.loading import hints
from runtime.robot.loading.diagram_file import DiagramFile
from runtime.robot.loading.overrides import set_block_parameters, share_out
from runtime.robot.loading.recorded_signals import select_recorded

if TYPE_CHECKING:
    from traceback import FrameSummary

    from graph import Schedule
    from runtime.robot.loading.overrides import Replaced, Settings
    from runtime.robot.loading.subject import Subject
    from runtime.robot.rig.file import RigFile

T = TypeVar("T")
PACKAGES = tuple(
    str(Path(__file__).parents[3] / package) + os.sep for package in ("blocks", "cext", "graph", "runtime")
)
STANDARD_LIBRARY = os.path.dirname(os.__file__) + os.sep


def load(
    path: str | os.PathLike[str] | Diagram | Callable[..., Diagram],
    settings: Settings = (),
    rig: RigFile | None = None,
    sha256: str | None = None,
    subject: Subject | None = None,
) -> tuple[DiagramFile, Diagram]:
    """Read a diagram file and build its diagram.

    path : path of the file; or a Diagram, or a function that builds one
    settings, rig, subject : as in `build`
    sha256 : hex digest of the only source that may be run; None for any

    Returns (DiagramFile, Diagram). Raises BadInput.
    """
    file = source(path, sha256=sha256)
    return file, build(file, settings, rig, subject=subject)


def source(
    given: str | os.PathLike[str] | Diagram | Callable[..., Diagram],
    plant: Diagram | Callable[..., Diagram] | None = None,
    sha256: str | None = None,
) -> DiagramFile:
    """Return the DiagramFile of a path, of a Diagram, or of a function that builds one. Raises BadInput.

    plant : Diagram or function plant(robot, **parameters) instead of the file's own
    sha256 : as in `load`
    """
    if not (plant is None or isinstance(plant, Diagram) or callable(plant)):
        raise BadInput(f"plant={plant!r}: expected a Diagram, or a function plant(robot) that returns one")
    if isinstance(given, (str, os.PathLike)):
        path = Path(given)
        module, digest = execute(path, sha256)
    elif isinstance(given, Diagram):
        path, module, digest = Path(given.name), SimpleNamespace(diagram=given), None
    elif callable(given):
        code = getattr(given, "__code__", None)
        path, module, digest = Path(code.co_filename if code else "diagram"), SimpleNamespace(build=given), None
    else:
        raise BadInput(f"expected a Diagram, the path of a diagram file or a function that builds one, not {given!r}")
    if plant is not None:
        function = plant if callable(plant) else lambda robot: plant
        module = SimpleNamespace(**{**vars(module), "plant": function})
    return DiagramFile(path, module, {}, {}, digest, given if isinstance(given, Diagram) else None)


def build(
    file: DiagramFile,
    settings: Settings = (),
    rig: RigFile | None = None,
    before: list[Replaced] | None = None,
    subject: Subject | None = None,
    undo: ExitStack | None = None,
) -> Diagram:
    """Build the diagram of a DiagramFile. Raises BadInput.

    settings : pairs (name, value or its text). A name with a dot is a block's parameter, "left/impedance.stiffness";
        any other is a parameter of `build` or `plant`
    rig : RigFile or None; its device parameters are set before the settings
    before : list that receives (block, parameter, value) of every parameter of a block before it is set
    subject : Subject whose limits come last, above all others; undo : receives what undoes them
    """
    path, build = file.path, file.function("build")
    diagram: Any = getattr(file.module, "diagram", None)
    if build is None and not isinstance(diagram, Diagram):
        raise BadInput(f"{path} has no diagram: {without_diagram(file)}")
    plant = getattr(file.module, "plant", None)
    if isinstance(plant, Diagram):
        raise BadInput(f"{path}: plant is a Diagram: write a function plant(robot) that returns it")
    share_out(file, settings if subject is None else [*settings, *subject.settings(build, settings)])
    if build is not None:
        diagram = call(file, build, **file.build_parameters)
        check_returned(build, diagram, "diagram")
    if not len(diagram):
        raise BadInput(f"{path}: the diagram {diagram.name!r} has no blocks: make them inside `with Diagram(...)`")
    if rig is not None:
        from runtime.robot.rig.overrides import override  # a simulation starts without it

        override(rig, diagram)
    set_block_parameters(diagram, [(name, value) for name, value in settings if "." in name], before)
    if subject is not None:
        restored = subject.apply(diagram)
        if undo is not None:
            undo.callback(restored)
    return diagram


def build_plant(file: DiagramFile, robot: Diagram) -> Diagram:
    """Build the plant of a diagram file. Returns a Diagram. Raises BadInput."""
    function = file.function("plant")
    assert function is not None
    plant = call(file, function, robot, **file.plant_parameters)
    check_returned(function, plant, "plant")
    return plant


def check_returned(function: Callable[..., Any], value: Any, name: str) -> None:
    """Raise BadInput if `build` or `plant` has not returned a Diagram. name : usual one of the Diagram"""
    if not isinstance(value, Diagram):
        raise BadInput(
            f"{place_of(function)}: {function.__name__}() returned {repr_of(value)}, and must return a Diagram: end it "
            f"with `return {name}`"
        )


def place_of(function: Callable[..., Any]) -> str:
    """Return the file and the line of a function; its name if it has none."""
    code = getattr(function, "__code__", None)
    return f"{code.co_filename}:{code.co_firstlineno}" if code else getattr(function, "__name__", "build")


def without_diagram(file: DiagramFile) -> str:
    """Return the remedy for a file without `diagram` and `build`."""
    others = [name for name, value in vars(file.module).items() if isinstance(value, Diagram)]
    if others[1:]:
        return f"its Diagrams are called {', '.join(map(repr, others))}: rename the one to run to `diagram`"
    if others:
        return f"its Diagram is called {others[0]!r}: rename it to `diagram`"
    return "write `with Diagram(...) as diagram:`, or a function `build()` that returns a Diagram"


def compile_diagram(path: str | os.PathLike[str], diagram: Diagram) -> Schedule:
    """Compile a diagram, select its recorded signals and reset its Python blocks once. Returns its Schedule.

    path : diagram file named in messages

    Raises DiagramError, and BadInput for an exception in user code.
    """
    schedule = select_recorded(call_code_of_blocks(path, compile, diagram))
    for block in schedule.python_blocks:
        call_code_of_blocks(path, block.reset)
    return schedule


def call_code_of_blocks(path: str | os.PathLike[str], function: Callable[..., T], *arguments: Any) -> T:
    """Call a function that calls user code of blocks; an exception there becomes BadInput with its line.

    path : path of the diagram file
    """
    try:
        return function(*arguments)
    except DiagramError:
        raise
    except Exception as error:
        if not own_frames(path, error):
            raise  # a defect of Tickwork, not of user code
        raise BadInput(exception(path, error)) from error


class Source(SourceFileLoader):
    """Loader that always reads the source: bytecode could be that of an edit within the same second.

    sha256 : hex digest of the only source that may be run, None for any; after loading, of the source read
    """

    def __init__(self, name: str, path: str, sha256: str | None = None) -> None:
        super().__init__(name, path)
        self.sha256 = sha256

    def get_code(self, name: str) -> CodeType:
        """Read and compile the source. Raises BadInput if it has changed or is not text."""
        source = read_small(self.path)
        digest = sha256(source).hexdigest()
        if self.sha256 not in (None, digest):
            raise BadInput(f"{os.path.relpath(self.path)} has changed while it was read: run the command again")
        self.sha256 = digest
        if b"\0" in source:
            raise BadInput(f"{os.path.relpath(self.path)} is not text: a diagram file is Python")
        return code_of(source, self.path)


@lru_cache(maxsize=16)
def code_of(source: bytes, path: str) -> CodeType:
    """Return compiled source, for repeated runs of one file."""
    return builtins.compile(source, path, "exec", dont_inherit=True)


def execute(path: Path, sha256: str | None = None) -> tuple[ModuleType, str | None]:
    """Run the file as a module. Raises BadInput with the line of an error.

    The file can import modules in its folder, which do not shadow libraries.

    sha256 : hex digest of the only source that may be run, None for any

    Returns (module, hex digest of the source that was run).
    """
    if path.is_dir():
        example = min(path.glob("*.py"), default=path / "knee_exo.py")
        raise BadInput(f"{path} is a folder: name a diagram file in it, such as {example}")
    if not path.exists():
        raise BadInput(f"file {path} does not exist" + near_miss(path))
    if path.suffix != ".py":
        raise BadInput(f"{path} is not a Python file: its name must end in .py")
    diagram_folders.import_from(os.path.dirname(os.path.realpath(path)))
    location = os.path.abspath(path)
    source = Source(path.stem, location, sha256)
    spec = importlib.util.spec_from_file_location(path.stem, location, loader=source)
    assert spec is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules.setdefault(path.stem, module)
    call_user_code(path, inside_diagrams(location, source.exec_module), module)
    return module, source.sha256


def near_miss(path: Path) -> str:
    """Return ": " and a suggestion of a file with a similar name; "" without one."""
    hint = suggestion(path.name, [file.name for file in path.parent.glob("*.py")]) if path.parent.is_dir() else ""
    return f": {hint}" if hint else ""


def call(file: DiagramFile, function: Callable[..., T], /, *arguments: Any, **named: Any) -> T:
    """Call `build` or `plant` with its parameters. An exception, or a wrong signature, becomes BadInput."""
    try:
        inspect.signature(function).bind(*arguments, **named)
    except TypeError as error:
        hint = (
            "give the parameter a default, or set its value"
            if "missing" in str(error)
            else "declare it as plant(robot)"
        )
        raise BadInput(f"{place_of(function)}: {function.__name__}() cannot be called: {error}; {hint}") from None
    return call_user_code(file.path, inside_diagrams(os.path.abspath(file.path), function), *arguments, **named)


def inside_diagrams(path: str, function: Callable[..., T]) -> Callable[..., T]:
    """Return the function, which raises DiagramError if the file makes blocks outside every diagram."""
    return no_block_outside(path)(function)


def call_user_code(path: str | os.PathLike[str], function: Callable[..., T], /, *arguments: Any, **named: Any) -> T:
    """Call user code; any exception becomes BadInput with the line in user code."""
    try:
        return function(*arguments, **named)
    except BadInput:
        raise
    except DiagramError as error:
        refused = BadInput("\n".join(map(str, error.diagnostics)))
        refused.diagnostics = tuple(error.diagnostics)
        raise refused from None
    except SyntaxError as error:
        raise BadInput(syntax_error(error)) from None
    except OSError as error:
        if error.filename == os.path.abspath(path):
            raise BadInput(f"cannot read {path}: {error.strerror}") from None
        raise BadInput(exception(path, error)) from error
    except SystemExit as error:
        raise BadInput(exception(path, error)) from None
    except (KeyboardInterrupt, Interrupted):
        raise
    except BaseException as error:  # user code may derive exceptions from BaseException
        if isinstance(error.__cause__, KeyboardInterrupt):  # until 3.11 Python replaces it where a class is made
            raise error.__cause__ from None
        if isinstance(error, RecursionError) and not own_frames(path, error):
            raise  # of a file that runs itself: an outer call has the line
        raise BadInput(exception(path, error)) from error


def syntax_error(error: SyntaxError) -> str:
    """Return Python's message with the line and a caret at its position."""
    message = f"{error.filename}:{error.lineno}: syntax error: {error.msg}"
    if not error.text or not error.text.strip():
        return message
    line = error.text.rstrip()
    text = line.lstrip()
    caret = (error.offset or 0) - 1 - (len(line) - len(text))
    return f"{message}\n    {text}" + (f"\n    {' ' * caret}^" if 0 <= caret <= len(text) else "")


def exception(path: str | os.PathLike[str], error: BaseException) -> str:
    """Return the line in user code that raised an exception, and its text."""
    frames = own_frames(path, error) or traceback.extract_tb(error.__traceback__)
    remedy = hints.hint(path, error)
    line = f"\n    {frames[-1].line}" if frames[-1].line else ""
    return f"{frames[-1].filename}:{frames[-1].lineno}: {words(error)}" + (f"; {remedy}" if remedy else "") + line


def own_frames(path: str | os.PathLike[str], error: BaseException) -> list[FrameSummary]:
    """Return the frames of a traceback in user code, not in Tickwork, Python or libraries.

    If some are in the folder of the diagram file, only those.
    """
    folder = os.path.dirname(os.path.abspath(path)) + os.sep
    own = [
        frame
        for frame in traceback.extract_tb(error.__traceback__)
        if not frame.filename.startswith((*PACKAGES, STANDARD_LIBRARY, "<frozen", "cext/"))
        and "site-packages" not in frame.filename
    ]
    return [frame for frame in own if frame.filename.startswith(folder)] or own


def words(error: BaseException, limit: float = TEXT_LIMIT) -> str:
    """Return the name and text of an exception; the text of a KeyError without its quotation marks.

    limit : s for forming the text
    """

    def text():
        return (
            str(error.args[0])
            if isinstance(error, KeyError) and error.args and " " in str(error.args[0])
            else str(error)
        )

    message = bound_text(text, limit)
    return type(error).__name__ + (f": {message}" if message else "")
