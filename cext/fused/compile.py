"""Stencils of kernels: machine code by clang with holes for the positions of items (Xu and Kjolstad 2021).

A stencil is the body of one step: a C function that receives the arena, calls the kernel inline, and continues in the
next stencil by a tail call. In its C text an item's position is the address of an external symbol, so the relocations
of the object file are the holes.
"""

from __future__ import annotations

import struct
import subprocess
import tempfile
from pathlib import Path
from typing import NamedTuple

from cext.fused.join import FUNCTIONS, HOLES, RELOCATIONS
from cext.fused.text import HEADER, PARALLEL, with_parallel_loops, with_wide_slots

TARGETS = {"x86_64": "x86_64-linux-gnu", "aarch64": "aarch64-linux-gnu"}
PARALLEL_FLAGS = ["-mllvm", "-unroll-threshold=0"]  # marked loops become vectors, before they are unrolled
FLAGS = (
    "-O2 -fno-pic -mcmodel=small -fno-plt -fno-asynchronous-unwind-tables -fno-stack-protector -ffp-contract=off "
    "-fno-math-errno -fomit-frame-pointer -falign-loops=1 -fno-jump-tables -fno-slp-vectorize -w -c"
).split()
SLOT, SIZE, STEP, NEXT, DATA, EXTERN, CALL = HOLES.values()
NUMBERED = {"T": SLOT, "Z": SIZE}  # holes by the first letter of their symbols; the number of the item follows
LAST_JUMP = {"x86_64": (b"\xe9", 4), "aarch64": (b"", 4)}  # instruction before the hole, and length of the hole
OPAQUE = {"x86_64": ["-DOPAQUE", "-fpie"]}  # flags with which the code refers to its constants by distance, by target
DECLARATIONS = """extern int64_t NEXT(double *) __attribute__((visibility("hidden")));
extern char STEP;
#ifdef OPAQUE
#define VALUE(hole) ({ intptr_t value; __asm__("movq $" #hole ", %0" : "=r"(value)); value; })
#else
#define VALUE(hole) ((intptr_t)&hole)
#endif
"""
END = "int64_t stencil(double *arena) { return 0; }"
CALLED = """extern struct {
  int (*kernel)(double *, const int32_t *, const int32_t *);
  const int32_t *slots, *sizes;
  int32_t **at;
  int64_t item;
} CALL __attribute__((visibility("hidden")));
int64_t stencil(double *arena) {
  int32_t *at = *CALL.at, run = *at;
  *at = CALL.item;
  int status = CALL.kernel(arena, CALL.slots, CALL.sizes);
  if (__builtin_expect(status, 0)) return (int64_t)VALUE(STEP) << 32 | (uint32_t)status;
  *at = run;
  __attribute__((musttail)) return NEXT(arena);
}
"""


class Hole(NamedTuple):
    """Place in a stencil. kind : ELF relocation; value : SLOT to CALL; which : number of the item, or of the symbol"""

    offset: int
    kind: int
    value: int
    which: int
    addend: int


class Stencil(NamedTuple):
    """Machine code with holes. data : constants that it refers to; externs : names of functions that it calls"""

    code: bytes
    holes: tuple[Hole, ...]
    data: bytes
    externs: tuple[str, ...]


def c_text(text: str, symbol: str, length: int, fixed: dict[int, int], sizes: dict[int, int]) -> str:
    """Return the C text of the stencil of a kernel.

    length : of the tables
    fixed : entries of both tables that are not items: numbers of Rests, and their places
    sizes : entries of the table of sizes that are constants; the others are holes
    """
    wide = with_wide_slots(text, symbol)
    if any(size > 1 for size in sizes.values()):
        wide = with_parallel_loops(wide)
    wide = wide.replace("static int __pyx_f_", "static inline __attribute__((always_inline)) int __pyx_f_")
    holes = [index for index in range(length) if index not in fixed]
    slots = [str(fixed.get(index, f"VALUE(T{index}) / 8")) for index in range(length)]
    lengths = [str((fixed | sizes).get(index, f"VALUE(Z{index})")) for index in range(length)]
    return f"""{HEADER}{wide}{DECLARATIONS}
{"".join(f"extern double T{index}; extern char Z{index};" for index in holes)}
int64_t stencil(double *arena) {{
  const intptr_t slots[] = {{{", ".join(slots)}}};
  const intptr_t sizes[] = {{{", ".join(lengths)}}};
  int status = {symbol}(arena, (const void *)slots, (const void *)sizes);
  if (__builtin_expect(status, 0)) return (int64_t)VALUE(STEP) << 32 | (uint32_t)status;
  __attribute__((musttail)) return NEXT(arena);
}}
"""


def compile_stencil(text: str, target: str, clang: str = "clang-19") -> Stencil:
    """Return the Stencil of a C text. Raises ValueError for an error, or a relocation that cannot become a hole.

    With `OPAQUE` an instruction of its own moves each hole to a register.
    """
    try:
        return _compiled(text, target, clang, [])
    except ValueError:
        if target not in OPAQUE:
            raise
        return _compiled(text, target, clang, OPAQUE[target])


def _compiled(text: str, target: str, clang: str, more: list[str]) -> Stencil:
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "stencil.c").write_text(text)
        flags = FLAGS + PARALLEL_FLAGS * (PARALLEL in text) + more
        command = [clang, f"--target={TARGETS[target]}", *flags, "-o", "stencil.o", "stencil.c"]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
        if done.returncode:
            raise ValueError(done.stderr)
        return stencil_of(Path(folder, "stencil.o").read_bytes(), target)


def stencil_of(content: bytes, target: str) -> Stencil:
    """Return the Stencil in an object file: the function `stencil`."""
    sections, names = _sections(content)
    text = names.index(".text")
    code = _bytes(content, sections[text])
    symbols = _symbols(content, sections)
    holes, externs, data = [], [], bytearray()
    places: dict[int, int] = {}
    for section in sections:
        if section.kind == 4 and section.info == text:  # relocations with addend
            for at in range(section.offset, section.offset + section.size, 24):
                offset, info, addend = struct.unpack_from("<QQq", content, at)
                symbol = symbols[info >> 32]
                kind = info & 0xFFFFFFFF
                if symbol.section == text:
                    raise ValueError(f"the code refers to itself by relocation {kind}")
                if symbol.section and names[symbol.section].startswith(".rodata"):
                    if symbol.section not in places:
                        data += bytes(-len(data) % 32)
                        places[symbol.section] = len(data)
                        data += _bytes(content, sections[symbol.section])
                    value, which, addend = DATA, 0, addend + symbol.value + places[symbol.section]
                elif symbol.section:
                    raise ValueError(f"the code refers to {names[symbol.section]}")
                elif symbol.name in HOLES:
                    value, which = HOLES[symbol.name], 0
                elif symbol.name[0] in NUMBERED and symbol.name[1:].isdigit():
                    value, which = NUMBERED[symbol.name[0]], int(symbol.name[1:])
                elif symbol.name not in FUNCTIONS:
                    raise ValueError(f"the code calls {symbol.name}, which is not in FUNCTIONS of cext.fused.join")
                else:
                    value = EXTERN
                    if symbol.name not in externs:
                        externs.append(symbol.name)
                    which = externs.index(symbol.name)
                if kind not in RELOCATIONS[target][value]:
                    raise ValueError(
                        f"relocation {kind} of {symbol.name or names[symbol.section]} cannot become a hole"
                    )
                if target == "aarch64" and value <= STEP and kind == 277:  # an addition that becomes a move
                    (word,) = struct.unpack_from("<I", code, offset)
                    if word & 31 != word >> 5 & 31:
                        raise ValueError("an address is computed in two registers")
                holes.append(Hole(offset, kind, value, which, addend))
    opcode, length = LAST_JUMP[target]
    last = max((hole for hole in holes if hole.value == NEXT), default=None)
    if last is not None and last.offset + length == len(code):
        if code[last.offset - len(opcode) : last.offset] == opcode:  # the next stencil follows
            code = code[: last.offset - len(opcode)]
            holes.remove(last)
    return Stencil(bytes(code), tuple(sorted(holes)), bytes(data), tuple(externs))


class _Section(NamedTuple):
    name: int
    kind: int
    offset: int
    size: int
    link: int
    info: int


class _Symbol(NamedTuple):
    name: str
    section: int
    value: int


def _sections(content: bytes) -> tuple[list[_Section], list[str]]:
    """Return the sections of an ELF file of 64 bits, and their names."""
    (at,) = struct.unpack_from("<Q", content, 0x28)
    size, count, strings = struct.unpack_from("<HHH", content, 0x3A)
    sections = []
    for index in range(count):
        fields = struct.unpack_from("<IIQQQQII", content, at + index * size)
        sections.append(_Section(fields[0], fields[1], *fields[4:8]))
    return sections, [_string(content, sections[strings], section.name) for section in sections]


def _symbols(content: bytes, sections: list[_Section]) -> list[_Symbol]:
    table = next(section for section in sections if section.kind == 2)
    symbols = []
    for at in range(table.offset, table.offset + table.size, 24):
        name, _, _, section, value, _ = struct.unpack_from("<IBBHQQ", content, at)
        symbols.append(_Symbol(_string(content, sections[table.link], name), section, value))
    return symbols


def _string(content: bytes, section: _Section, at: int) -> str:
    begin = section.offset + at
    return content[begin : content.index(0, begin)].decode()


def _bytes(content: bytes, section: _Section) -> bytes:
    return content[section.offset : section.offset + section.size]
