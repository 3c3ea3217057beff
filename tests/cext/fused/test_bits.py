"""Every stencil of this processor computes what its kernel computes, from any memory."""

import ctypes

import numpy as np
import pytest

from cext.fused import library
from cext.fused.__main__ import kernels
from cext.fused.join import Code
from graph.arena_layout import CLOCK_SLOTS

MARGIN = 64  # doubles on both sides of the items
TICKS = 3
MEMORIES = 4  # all values are between -1 and 1, many of them 0: each is 0 as an index
UNDEFINED = {"filters_median_kernel", "states_machine_kernel"}  # for such memory: no samples, a state inside itself


def tables_of(kernel, stencil):
    """Return slots and sizes for which a stencil is made. Items follow each other; those of any size have 3 doubles."""
    fixed, lengths, rests = dict(stencil.fixed), [], set()
    for item in kernel.items:
        if item.rest:
            rests |= {len(lengths), len(lengths) + 1}
        lengths += [None] * (1 + item.rest) if item.rest else [item.size]
    lengths += [None] * (stencil.length - len(lengths))
    slots, sizes, at = [], [], MARGIN
    for index, length in enumerate(lengths):
        sizes.append(fixed[index] if index in rests else length or fixed.get(index, 3))
        slots.append(fixed[index] if index in rests else at)
        at += 0 if index in rests else sizes[-1]
    return tuple(slots), tuple(sizes)


def address_of(function):
    api = ctypes.pythonapi
    api.PyCapsule_GetName.restype, api.PyCapsule_GetName.argtypes = ctypes.c_char_p, [ctypes.py_object]
    api.PyCapsule_GetPointer.restype = ctypes.c_void_p
    api.PyCapsule_GetPointer.argtypes = [ctypes.py_object, ctypes.c_char_p]
    return api.PyCapsule_GetPointer(function, api.PyCapsule_GetName(function))


def after_ticks(code, arena):
    """Return the arena and the statuses after some ticks."""
    arena = arena.copy()
    run = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_void_p)(code.entries[0])
    return arena, [run(arena.ctypes.data) for _ in range(TICKS)]


def test_a_stencil_computes_what_its_kernel_computes():
    found, reason = library.open_library()
    if found is None:
        pytest.skip(reason)
    random, tried = np.random.default_rng(1), 0
    end, call = found.parts["end"], found.parts["call"]
    present = np.zeros(1, np.int64)  # item, at an address in memory
    place = np.array([present.ctypes.data], np.int64)
    for _, key, kernel in kernels():
        for stencil in library.variants(key):
            slots, sizes = tables_of(kernel, stencil)
            no_inputs = any(item.rest and item.name == "inputs" for item in kernel.items) and 0 in sizes
            if no_inputs or any(name in key for name in UNDEFINED):
                continue
            tables = [np.array(table, np.int32) for table in (slots, sizes)]
            addresses = (address_of(kernel.function), *(table.ctypes.data for table in (*tables, place)), 0)
            fused = Code([(0, [(stencil, slots, sizes, ())])], end, found.target)
            called = Code([(0, [(call, (), (), addresses)])], end, found.target)
            for _ in range(MEMORIES):
                arena = random.uniform(-1.0, 1.0, 2 * MARGIN + sum(sizes)) * random.integers(
                    0, 2, 2 * MARGIN + sum(sizes)
                )
                arena[:CLOCK_SLOTS] = 1.0, 1000.0, 0.001, 0.001, 1.0, 0.0, 1.0, 1.0
                (one, statuses), (other, expected) = after_ticks(fused, arena), after_ticks(called, arena)
                assert np.array_equal(one, other, equal_nan=True) and statuses == expected, (key, stencil.fixed)
            tried += 1
    assert tried > 800
