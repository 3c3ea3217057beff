"""Compile the stencils of all kernels: `make stencils`, with clang of version 19 or newer.

The other processor's C library is needed as well: on Debian, `apt install clang-19 gcc-aarch64-linux-gnu`.
A kernel without a stencil is called, with the same results: those in UNFUSED, and those of other packages.
A kernel of which no stencil can be made is an error.
"""

from __future__ import annotations

import importlib
import struct
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from os import cpu_count
from pathlib import Path

from cext.fused import compile as clang
from cext.fused import library, text
from cext.kernel import Item, Kernel

KERNELS = Path(__file__).parents[1] / "kernels"
UNFUSED = {  # reasons why the kernels of a module have no stencils
    "compiled": "kernel calls another library",
    "continuous": "kernels of plants, not of robots",
    "inverse_dynamics": "kernel takes far longer than its call, and has dozens of inputs",
    "mujoco": "kernel calls another library",
    "networks/inference": "kernel calls another library",
    "networks/worker": "kernel calls another library",
    "wearer/walker": "kernel has dozens of outputs",
}
CONSTANT_LIMIT = 600  # bytes of a stencil with constant sizes, which a larger kernel hardly gains from
LENGTHS = {"sections": (5, 10)}  # numbers of elements of items that are not signals, by name
RESTS = range(9)  # numbers of inputs or outputs of kernels that take any
WIDTHS = (1, 2, 3, 4, 6)  # elements of signals
REST_LIMIT = 4  # number of them up to which their kernels are compiled for all WIDTHS; beyond it for the first


def kernels() -> Iterator[tuple[Path, str, Kernel]]:
    """Yield each kernel of the library: the .pyx file, its key in the library, and the Kernel."""
    for path in sorted(KERNELS.rglob("*.pyx")):
        module = importlib.import_module(".".join(path.relative_to(KERNELS.parents[1]).with_suffix("").parts))
        keys = set()
        for value in vars(module).values():
            for kernel in value.values() if isinstance(value, dict) else (value,):
                key = library.key_of(kernel) if isinstance(kernel, Kernel) else ""
                if key and key not in keys:
                    keys.add(key)
                    yield path, key, kernel


def module_of(path: Path) -> str:
    """Return the name of the module in a .pyx file, as UNFUSED has it."""
    return path.relative_to(KERNELS).with_suffix("").as_posix()


def tables(items: tuple[Item, ...]) -> Iterator[tuple[dict[int, str], int, dict[int, int], dict[int, int]]]:
    """Yield the tables for which a kernel is compiled: names of the items of entries, the length, the entries of their
    Rests, and the sizes of items that have one.
    """
    names, places = {}, []
    sizes, index = {}, 0
    for item in items:
        names[index] = item.name
        if item.rest:
            places.append(index)
        elif item.size is not None:
            sizes[index] = item.size
        index += 1 + item.rest
    for count in RESTS if places else (0,):
        fixed = {}
        for number, place in enumerate(places):
            fixed |= {place: count, place + 1: index + number * count}
        yield names, index + count * len(places), fixed, sizes


def main() -> None:
    """Compile the stencils for all targets, and write the file."""
    library.write(library.FILE, [library_for(target) for target in clang.TARGETS])
    print(f"{library.FILE.name}: {library.FILE.stat().st_size} bytes")


def library_for(target: str) -> library.Library:
    """Compile the stencils for a target."""
    unfused = {key: UNFUSED[name] for path, key, _ in kernels() if (name := module_of(path)) in UNFUSED}
    jobs = [
        (path, key, *table) for path, key, kernel in kernels() if key not in unfused for table in tables(kernel.items)
    ]
    found: dict[str, list[library.Stencil]] = {}
    with ThreadPoolExecutor(cpu_count()) as pool:
        for (_, key, *_), made in zip(jobs, pool.map(lambda job: stencils(target, *job), jobs)):
            found.setdefault(key, []).extend(made)
    parts = {
        name: packed({}, 0, clang.compile_stencil(clang.HEADER + clang.DECLARATIONS + source, target))
        for name, source in (("end", clang.END), ("call", clang.CALLED))
    }
    print(f"{target}: {sum(map(len, found.values()))} stencils of {len(found)} kernels")
    return library.Library(target, {key: library.pack(each) for key, each in sorted(found.items())}, unfused, parts)


def constant_sizes(read: list[int], names: dict[int, str], count: int) -> Iterator[dict[int, int]]:
    """Yield the sizes with which a kernel is compiled.

    read : entries that it reads; names : of the items of entries; count : of the inputs or outputs of a Rest
    """
    lengths = [LENGTHS.get(names.get(index, ""), ()) for index in read]
    for width in WIDTHS[: None if count <= REST_LIMIT else 1] if read else ():
        for number in range(max(1, *map(len, lengths)) if lengths else 1):
            yield {index: each[number] if each else width for index, each in zip(read, lengths)}


def stencils(
    target: str, path: Path, key: str, names: dict[int, str], length: int, fixed: dict[int, int], sizes: dict[int, int]
) -> list[library.Stencil]:
    """Return the stencils of a kernel for tables of a length, those with most constants first.

    fixed : entries of the Rests, the number of their inputs or outputs first
    """
    symbol = key.split()[1]
    source = text.text_of(path.with_suffix(".c"), symbol)
    try:
        open_one = clang.compile_stencil(clang.c_text(source, symbol, length, fixed, sizes), target)
        read = sorted({hole.which for hole in open_one.holes if hole.value == clang.SIZE})
        found = []
        for constants in constant_sizes(read, names, next(iter(fixed.values()), 0)):
            stencil = clang.compile_stencil(clang.c_text(source, symbol, length, fixed, sizes | constants), target)
            if len(stencil.code) <= CONSTANT_LIMIT:
                found.append(packed(fixed | constants, length, stencil))
        return [*found, packed(fixed, length, open_one)]
    except ValueError as error:
        raise ValueError(f"{target}: {symbol}: {error}") from None


def packed(fixed: dict[int, int], length: int, stencil: clang.Stencil) -> library.Stencil:
    """Return a stencil as the library has it."""
    holes = b"".join(struct.pack("<5i", *hole) for hole in stencil.holes)
    return library.Stencil(tuple(fixed.items()), length, stencil.code, holes, stencil.data, stencil.externs)


if __name__ == "__main__":
    main()
