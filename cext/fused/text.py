"""Plain C of a kernel, taken from the C file that Cython writes for its module: the function and all that it calls."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path
from typing import NamedTuple

HEADER = """#include <stdint.h>
#include <stddef.h>
#include <math.h>
#include <string.h>
#define CYTHON_INLINE inline
#define CYTHON_UNUSED
#define CYTHON_FALLTHROUGH
#define PY_LONG_LONG long long
#define likely(x) __builtin_expect(!!(x), 1)
#define unlikely(x) __builtin_expect(!!(x), 0)
#define __PYX_NAN() ((double)NAN)
"""
COMMENT = re.compile(r"/\*.*?\*/", re.S)
FUNCTION = re.compile(r"^static (?:CYTHON_\w+ )*[\w ]+?\*?\s?(__pyx_f_\w+)\([^;{]*\) \{\n.*?^\}", re.S | re.M)
TYPE = re.compile(r"^(?:enum|struct|union) ?(\w*) \{.*?^\};", re.S | re.M)
ENUMERATOR = re.compile(r"^\s+(__pyx_e_\w+)", re.M)
TYPEDEF = re.compile(r"^typedef .*?(__pyx_t_\w+)\)?(?:\(.*?\))?;", re.M)
NAME = re.compile(r"\b__pyx_\w+")
ITEMS = re.compile(r"\((?:const )?double (?:const )?\*\w+, (struct \w+) const \*\w+")  # of a kernel's definition
HINT = re.compile(r"^( *)(\w+) = (unlikely\(.*\));\n *if \(\2\)", re.M)  # which clang finds only in `if`
GLOBAL = re.compile(r"^static (double|int|int64_t|uint64_t|float) (__pyx_v_\w+)(?: = 0)?;", re.M)
LOOP = re.compile(
    r"^ *for \((?P<counter>\w+) = 0; [^;]*; \w+ ?\+= ?1\) \{\n\s+(?P<variable>__pyx_v_\w+) = (?P=counter);\n"
    r"(?P<body>[^{}]*)\}",
    re.M,
)
PARALLEL = "#pragma clang loop vectorize(assume_safety) unroll(full)\n"


class Source(NamedTuple):
    """Functions, and types by name, of a C file."""

    functions: dict[str, str]
    types: dict[str, str]


@cache
def read(path: Path) -> Source:
    """Return the Source of a C file that Cython has written."""
    text = COMMENT.sub("", path.read_text())
    functions = {match[1]: re.sub(r"\n\s*\n+", "\n", match[0]) for match in FUNCTION.finditer(text)}
    types = {}
    for match in TYPE.finditer(text):
        names = ENUMERATOR.findall(match[0]) if match[0].startswith("enum") else []
        types |= dict.fromkeys([*names, *([match[1]] if match[1] else [])], match[0])
    types |= {match[1]: match[0] for match in TYPEDEF.finditer(text)}
    for kind, name in GLOBAL.findall(text):
        values = re.findall(rf"^  {name} = (.+);$", text, re.M)
        if len(values) == 1 and "__pyx_t_" not in values[0]:
            types[name] = f"static const {kind} {name} = {values[0]};"
    return Source(functions, types)


def text_of(path: Path, symbol: str) -> str:
    """Return the C text of a function in a C file, with all that it needs. Raises KeyError for an unknown symbol."""
    source = read(path)
    parts: list[str] = []
    visited: set[str] = set()

    def visit(name: str) -> None:
        part = source.functions.get(name) or source.types.get(name)
        if part is None or part in visited:
            return
        visited.add(part)
        for used in dict.fromkeys(NAME.findall(part)):
            visit(used)
        parts.append(part)

    if symbol not in source.functions:
        raise KeyError(symbol)
    visit(symbol)
    return HINT.sub(r"\1if (\3)", "\n".join(parts) + "\n")


def with_wide_slots(text: str, symbol: str) -> str:
    """Return the text with slots and sizes of type intptr_t, so that a compiler can fold them into addresses.

    They are the structs of the items of the kernel, and the tables of a Rest; a kernel uses `sizeof(int32_t)` only to
    count them.
    """
    found = re.search(rf"\b{symbol}{ITEMS.pattern}[^;]*?\) {{", text)
    structs = {found[1]} if found else set()
    todo = list(structs)
    while todo:
        inner = set(re.findall(r"struct \w+", _body(text, todo.pop()).partition("{")[2]))
        todo += inner - structs
        structs |= inner
    for struct in structs:
        body = _body(text, struct)
        text = text.replace(body, body.replace("int32_t ", "intptr_t "))
    return text.replace("int32_t const *", "intptr_t const *").replace("sizeof(int32_t)", "sizeof(intptr_t)")


def with_parallel_loops(text: str) -> str:
    """Return the text with a mark for clang at each loop whose steps are independent, so that it uses vectors.

    They are loops of plain assignments in which each index is that of the loop, and no variable is read before it is
    written: items never overlap in part, and no sum depends on its order.
    """

    def marked(match: re.Match[str]) -> str:
        variable, body = match["variable"], match["body"]
        indices = re.findall(r"\[([^]]*)\]", body)
        assigned = re.findall(r"^\s+(__pyx_v_\w+|__pyx_t_\w+) = ", body, re.M)
        accumulates = any(name in re.split(rf"^\s+{name} = ", body, maxsplit=1, flags=re.M)[0] for name in assigned)
        own = all(re.fullmatch(rf"{variable}|\(.* \+ {variable}\)", index) for index in indices)
        plain = all(re.fullmatch(r"\s+\S.* = .*;|\s*", line) for line in body.splitlines())
        return PARALLEL + match[0] if indices and own and plain and not accumulates else match[0]

    return LOOP.sub(marked, text)


def _body(text: str, struct: str) -> str:
    match = re.search(rf"^{struct} \{{.*?^\}};", text, re.S | re.M)
    return match[0] if match else ""
