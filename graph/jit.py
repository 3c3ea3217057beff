"""Python blocks compiled to native kernels with Numba, the optional extra `jit`.

    class Spring(Block):
        jit = True
        ...

The source of the block's `step` (and `update` and `settle`) is rewritten for the kernel ABI: inputs, outputs,
parameters and the numbers that `reset` sets become slots of the arena, and the step runs without the GIL, among the
native blocks. It may contain scalar arithmetic, comparisons, `if`, loops, and functions of `math`. Results equal those
of Python for + - * /, sqrt and comparisons, and are within 2 ulp for elementary functions. As in Python, NaN at an int
or bool, a result that its output does not declare, a missing `return`, `raise`, and the conversion of NaN to an int are
faults. Numba raises no exception for arithmetic: a division by zero and a function outside its domain return an
infinity or NaN, an integer divided by zero is 0, and an int has 64 bits. A local variable without a value is 0. Without
Numba the block runs in Python.
"""

from __future__ import annotations

import ast
import inspect
import math
import textwrap
from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

from cext.kernel import Kernel
from graph.class_checks import CLOCK
from graph.declarations import Memory
from graph.syntax import parse

if TYPE_CHECKING:
    from ast import AST, Attribute, FunctionDef, Module, Name, Return, stmt

    from graph.block import Block


CONVERSIONS = {"int", "round", "math.floor", "math.ceil", "math.trunc"}  # to an int: NaN raises in Python
RESULTS = {"derivative": "slope[...]", "crossing": "margin[...]", "jump": "state[...]"}  # of a continuous block
RAISED, NO_VALUE = 64, 65  # the kernels' own statuses, from cext.abi.FIRST_OWN_STATUS on; those of the ports follow


class CannotCompile(ValueError):
    """A step whose source cannot be compiled. The message states the construct and its line."""


def available() -> bool:
    """Return whether Numba is installed."""
    from importlib.util import find_spec

    return find_spec("numba") is not None


def compile_block(block: Block) -> None:
    """Compile the methods of a Python block to kernels. Raises CannotCompile if that is not possible."""
    if block.continuous:
        compile_continuous(block)
        return
    block.reset()
    state = {
        name: value
        for name, value in vars(block).items()
        if type(value) in (float, int, bool) and is_state(block, name)
    }
    check_scalars(block)
    items = [*block.inputs, *block.outputs, *(n for n, p in block.parameters.items() if p.placed), *state]
    slots = {name: index for index, name in enumerate(items)}
    block.memory = {name: Memory(float(value), "state").named(name) for name, value in state.items()}
    block.feedthrough = tuple(name for name in block.step_inputs() if name in block.inputs)
    block.kernel = kernel_of(block, type(block).step, slots, list(block.outputs))
    if block.has_python_update:
        block.update_kernel = kernel_of(block, type(block).update, slots, [])
    if hasattr(block, "settle"):
        block.settle_kernel = kernel_of(block, type(block).settle, slots, [])
    block.fault_text = partial(fault_text, block)
    block.compiled = True


def compile_continuous(block: Any) -> None:
    """Compile the methods of a continuous block. Raises CannotCompile if that is not possible."""
    check_scalars(block)
    items = [*block.inputs, *block.outputs, *(n for n, p in block.parameters.items() if p.placed)]
    kernels: dict[str, Kernel] = {}
    for method, result in RESULTS.items():
        if hasattr(block, method):
            slots = {name: index for index, name in enumerate([*items, result])}
            outputs = ["margin"] if method == "crossing" else list(block.outputs)
            kernels[f"{method}_kernel"] = kernel_of(block, getattr(block, method).__func__, slots, outputs, result)
    for name, kernel in kernels.items():
        setattr(block, name, kernel)


def check_scalars(block: Block) -> None:
    """Raise CannotCompile for ports with a shape."""
    for name, port in (*block.inputs.items(), *block.outputs.items()):
        if port.shape != ():
            raise CannotCompile(f"{name} has shape {port.shape}: only scalar ports can be compiled")


def fault_text(block: Block, status: int) -> str:
    """Return what a status of the kernel of a compiled block reports."""
    if status == RAISED:
        return "its step raised an exception. Remove `jit = True` to see which"
    if status == NO_VALUE:
        return "its step returned no value"
    name = [*block.inputs, *block.outputs][status - NO_VALUE - 1]
    if name in block.inputs:
        return f"{name} is NaN or infinite, which is neither an int nor a bool"
    port = block.outputs[name]
    kind = {"float": "a number", "int": "a whole number", "bool": "a bool"}[port.dtype]
    return f"its step returned a value for {name} that is not {kind}" + (f" in {port.range}" if port.range else "")


def is_state(block: Block, name: str) -> bool:
    """Return whether an attribute is state: set on the block, not private, not a parameter."""
    return name not in block.parameters and not name.startswith("_") and not hasattr(type(block), name)


def kernel_of(
    block: Block, method: Callable[..., Any], slots: dict[str, int], outputs: Sequence[str], result: str = ""
) -> Kernel:
    """Return the Kernel of a method of a block, compiled by Numba.

    slots : {item: position in the slot table}
    outputs : names of the values that it returns
    result : item with all of them, in place of an item for each
    """
    import numba
    from numba import types
    from numba.core.errors import NumbaError

    try:
        source = textwrap.dedent(inspect.getsource(method))
    except OSError:
        raise CannotCompile(f"cannot read the source of {method.__qualname__}: define the class in a file") from None
    function = parse(source).body[0]
    if not isinstance(function, ast.FunctionDef):
        raise CannotCompile(f"{method.__qualname__} is not a plain method")
    arguments = [a.arg for a in function.args.args[1:]]
    rewritten = Rewriter(block, slots, outputs, arguments, result).kernel(function)
    namespace: dict[str, Any] = {**method.__globals__, "math": math, "finite_or_raise": numba.njit(finite_or_raise)}
    exec(compile(rewritten, inspect.getsourcefile(method) or "<step>", "exec"), namespace)
    pointer = types.CPointer
    signature = types.int32(pointer(types.float64), pointer(types.int32), pointer(types.int32))
    step: Callable[..., int] = numba.njit(error_model="numpy")(namespace["kernel"])

    def guarded(arena: Any, slots: Any, sizes: Any) -> int:
        try:
            return step(arena, slots, sizes)
        except Exception:  # a C function would print it and return 0
            return RAISED

    try:
        function = numba.cfunc(signature, error_model="numpy")(guarded)
    except NumbaError as error:
        lines = [line for line in str(error).splitlines() if line and not line.startswith("Failed in nopython mode")]
        raise CannotCompile(f"Numba cannot compile {method.__qualname__}: {lines[0]}") from None
    return Kernel(function, " ".join(slots))


def finite_or_raise(x: Any) -> Any:
    """Return x. Raises ValueError for NaN and infinity, which machine code would convert to an arbitrary int."""
    number = 1.0 * x
    if number - number != 0.0:
        raise ValueError("NaN or infinity is not an int")
    return x


class Rewriter(ast.NodeTransformer):
    """Transformer of a method to a kernel.

    `self.gain` becomes arena[slots[i]], an argument a local variable read from the arena, and `return` assignments to
    the outputs.
    """

    def __init__(
        self, block: Block, slots: dict[str, int], outputs: Sequence[str], arguments: Sequence[str], result: str
    ) -> None:
        self.block, self.slots, self.result = block, slots, result
        self.outputs, self.arguments = outputs, arguments

    def kernel(self, function: FunctionDef) -> Module:
        """Return the module with the kernel of a method, as a syntax tree. Raises CannotCompile."""
        reads = [statement for name in self.arguments for statement in self.read(name)]
        tree = parse(f"def kernel(arena, slots, sizes):\n    return {NO_VALUE if self.outputs else 0}")
        self.generic_visit(body := ast.Module(function.body, []))
        kernel = tree.body[0]
        assert isinstance(kernel, ast.FunctionDef)
        kernel.body[:0] = [*reads, *body.body]
        return ast.fix_missing_locations(tree)

    def read(self, name: str) -> list[stmt]:
        """Return the statements that read an argument of the method from the arena."""
        if name in CLOCK and name not in self.block.inputs:
            value = f"arena[{CLOCK[name]}]"
            return parse(f"{name} = int({value})" if name == "tick" else f"{name} = {value}").body
        value = f"arena[slots[{self.slots[name]}]]"
        dtype = (self.block.inputs | self.block.outputs)[name].dtype
        if dtype == "float":
            return parse(f"{name} = {value}").body
        converted = f"{value} != 0.0" if dtype == "bool" else f"int({value})"
        return parse(f"{self.unless(f'{value} - {value} == 0.0', name)}\n{name} = {converted}").body

    def unless(self, condition: str, name: str) -> str:
        """Return the statement that ends the run with the status of a port. condition : condition that must hold"""
        return f"if not ({condition}): return {NO_VALUE + 1 + self.slots[name]}"

    def checks(self, name: str, result: str) -> list[stmt]:
        """Return the statements that convert and check a result as PythonStep does. result : variable that holds it"""
        port = self.block.outputs[name]
        lines = []
        if port.dtype == "int":
            lines = [self.unless(f"{result} % 1.0 == 0.0", name)]  # not for NaN and infinity
        elif port.dtype == "bool":
            lines = [self.unless(f"{result} == {result}", name), f"{result} = 1.0 if {result} != 0.0 else 0.0"]
        if port.range is not None:
            low, high = float(port.range.low), float(port.range.high)
            lines += [self.unless(f"not {result} < {low!r}", name)] if low > -math.inf else []  # NaN passes
            lines += [self.unless(f"not {result} > {high!r}", name)] if high < math.inf else []
        return parse("\n".join(lines)).body

    def visit_Attribute(self, node: Attribute) -> AST:
        """Replace an attribute of self by its slot in the arena."""
        if not (isinstance(node.value, ast.Name) and node.value.id == "self"):
            return self.generic_visit(node)
        if node.attr not in self.slots:
            raise CannotCompile(
                f"line {node.lineno} of the method uses self.{node.attr}, which is neither a parameter nor a "
                "number that reset() sets"
            )
        place = parse(f"arena[slots[{self.slots[node.attr]}]]", mode="eval").body
        assert isinstance(place, ast.Subscript)
        place.ctx = node.ctx
        return ast.copy_location(place, node)

    def visit_Call(self, node: ast.Call) -> AST:
        """Check the argument of a conversion to an int."""
        self.generic_visit(node)
        if ast.unparse(node.func) in CONVERSIONS and len(node.args) == 1:
            node.args = [ast.Call(ast.Name("finite_or_raise", ast.Load()), node.args, [])]
        return node

    def visit_Return(self, node: Return) -> list[stmt]:
        """Replace a return by stores to the outputs and the status 0."""
        self.generic_visit(node)
        stores: list[stmt] = []
        values = node.value.elts if isinstance(node.value, ast.Tuple) else [node.value]
        if self.outputs and (node.value is None or len(values) != len(self.outputs)):
            raise CannotCompile(
                f"line {node.lineno} of the method returns {len(values)} values for {', '.join(self.outputs)}"
            )
        for index, value in enumerate(values if self.outputs else []):
            assert value is not None
            number = ast.BinOp(value, ast.Mult(), ast.Constant(1.0))  # Numba has no float() of a bool
            stores.append(ast.Assign([ast.Name(f"result_{index}", ast.Store())], number))
        for index, name in enumerate(() if self.result else self.outputs):
            stores += self.checks(name, f"result_{index}")
        for index, name in enumerate(self.outputs):
            place = f"slots[{self.slots[self.result]}] + {index}" if self.result else f"slots[{self.slots[name]}]"
            stores.append(parse(f"arena[{place}] = result_{index}").body[0])
        return [*stores, parse("return 0").body[0]]

    def visit_Name(self, node: Name) -> Name:
        """Reject uses of self other than its attributes."""
        if node.id == "self":
            raise CannotCompile(f"line {node.lineno} of the method uses self without an attribute")
        return node

    def visit_FunctionDef(self, node: FunctionDef) -> FunctionDef:
        """Reject a function inside the method."""
        raise CannotCompile(f"line {node.lineno} of the method defines a function")
