"""Libraries of stencils: a file of the wheel, read by the first program of a process.

Stencils are compressed for each kernel, and unpacked when a program first uses it.
"""

from __future__ import annotations

import os
import platform
import re
import struct
import zlib
from functools import cache
from pathlib import Path
from typing import Any

import msgspec

from cext.fused.join import TARGET, VERSION, Code, context_of

FILE = Path(__file__).parent / "library.stencils"
HEAD = struct.Struct("<II")  # of a file: version of the stencils, and checksum of the content that follows
CONTEXT = re.compile(r"(\w+) .*?(__pyx_f_\w+)\W*$")


class Stencil(msgspec.Struct, array_like=True, frozen=True):
    """Machine code of one step, with holes.

    fixed : (index, value) of the entries of the table of sizes that the code assumes
    length : of the tables
    holes : int32 values, five per hole: offset, relocation, value, which, addend
    data : constants of the code; externs : names of the functions that it calls
    """

    fixed: tuple[tuple[int, int], ...]
    length: int
    code: bytes
    holes: bytes
    data: bytes
    externs: tuple[str, ...]


class Library(msgspec.Struct, frozen=True):
    """Stencils of a kind of processor.

    kernels : {key: stencils of the kernel, those with most constants first, as `pack` returns them}
    unfused : {key: reason why the kernel has none}
    parts : stencils `call` for a kernel without any, and `end` of a run
    """

    target: str
    kernels: dict[str, bytes]
    unfused: dict[str, str]
    parts: dict[str, Stencil]


def key_of(kernel: Any) -> str:
    """Return the hash of the sources and the C name of a Kernel's function, or "" if the function has none.

    So a kernel whose sources have changed since the stencils were compiled has none.
    """
    match = CONTEXT.match(context_of(getattr(kernel, "function", kernel)))
    return f"{match[1]} {match[2]}" if match else ""


@cache
def open_library() -> tuple[Library | None, str]:
    """Return the library for this processor, or the reason why this process does not fuse programs."""
    if os.environ.get("TICKWORK_FUSED") == "0":
        return None, "TICKWORK_FUSED=0 in the environment"
    try:
        found = read(FILE).get(TARGET)
        if found is None:
            return None, f"no machine code for the processor {platform.machine()}"
        Code((), found.parts["end"], found.target)
    except (OSError, ValueError) as error:
        return None, str(error)
    return found, ""


def library() -> Library | None:
    """Return the library for this processor, or None if this process does not fuse programs."""
    return open_library()[0]


def read(path: Path) -> dict[str, Library]:
    """Return the libraries in a file by their target.

    Raises OSError, or ValueError for a file that is damaged or of another version.
    """
    found = path.read_bytes()
    head, content = found[: HEAD.size], memoryview(found)[HEAD.size :]
    if len(head) < HEAD.size or HEAD.unpack(head)[1] != zlib.crc32(content):
        raise ValueError(f"the file {path.name} is damaged: its checksum is wrong")
    if HEAD.unpack(head)[0] != VERSION:
        raise ValueError(f"the file {path.name} is of another version of the native code")
    return {each.target: each for each in msgspec.msgpack.decode(content, type=list[Library])}


def write(path: Path, libraries: list[Library]) -> None:
    """Write libraries to a file."""
    content = msgspec.msgpack.encode(libraries)
    path.write_bytes(HEAD.pack(VERSION, zlib.crc32(content)) + content)


@cache
def variants(key: str) -> tuple[Stencil, ...]:
    """Return the stencils of a kernel, those with most constants first."""
    found = library()
    if found is None or key not in found.kernels:
        return ()
    return unpack(found.kernels[key])


def pack(stencils: list[Stencil]) -> bytes:
    """Return the stencils of a kernel as a library has them."""
    return zlib.compress(msgspec.msgpack.encode(stencils), 9)


def unpack(stencils: bytes) -> tuple[Stencil, ...]:
    """Return the stencils of a kernel in a library."""
    return msgspec.msgpack.decode(zlib.decompress(stencils), type=tuple[Stencil, ...])


def stencil_of(kernel: Any, sizes: tuple[int, ...]) -> Stencil | None:
    """Return the stencil of a Kernel for a table of sizes, or None."""
    for stencil in variants(key_of(kernel)):
        if stencil.length == len(sizes) and all(sizes[index] == value for index, value in stencil.fixed):
            return stencil
    return None


def obstacle(kernel: Any, sizes: tuple[int, ...]) -> str:
    """Return the reason why a step of a Kernel with a table of sizes is called and not fused, or ""."""
    found, reason = open_library()
    if found is None or stencil_of(kernel, sizes) is not None:
        return reason
    key = key_of(kernel)
    if key in found.kernels:
        return "no machine code for these numbers of elements"
    if key in found.unfused:
        return found.unfused[key]
    known = {name.split()[1] for name in (*found.kernels, *found.unfused)}
    return "kernel changed since `make stencils`" if key.partition(" ")[2] in known else "kernel of another package"
