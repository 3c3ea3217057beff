# cython: freethreading_compatible=True
"""Machine code of runs of steps, joined from stencils: copied one behind the other, and patched.

The memory is writable while it is filled, then executable; never both.
"""

from cpython.pycapsule cimport PyCapsule_CheckExact, PyCapsule_GetContext
from libc.math cimport (
    acos, asin, atan, atan2, ceil, cos, exp, expm1, floor, fmod, log, pow, rint, sin, tan,
)
from libc.stdint cimport int32_t, int64_t, uint32_t, uint64_t, uintptr_t
from libc.stdlib cimport calloc, free
from libc.string cimport memcpy, memmove, memset

cdef extern from "<sys/mman.h>" nogil:
    enum: PROT_READ, PROT_WRITE, PROT_EXEC, MAP_PRIVATE, MAP_ANONYMOUS
    void *MAP_FAILED
    void *mmap(void *address, size_t length, int protection, int flags, int file, int64_t offset)
    int mprotect(void *address, size_t length, int protection)
    int munmap(void *address, size_t length)

cdef extern from "<elf.h>":
    enum:
        R_X86_64_PC32, R_X86_64_PLT32, R_X86_64_32, R_X86_64_32S
        R_X86_64_GOTPCREL, R_X86_64_GOTPCRELX, R_X86_64_REX_GOTPCRELX
        R_AARCH64_ADR_PREL_PG_HI21, R_AARCH64_ADD_ABS_LO12_NC, R_AARCH64_JUMP26
        R_AARCH64_LDST32_ABS_LO12_NC, R_AARCH64_LDST64_ABS_LO12_NC, R_AARCH64_LDST128_ABS_LO12_NC
        R_AARCH64_ADR_GOT_PAGE, R_AARCH64_LD64_GOT_LO12_NC

cdef extern from *:
    """
    #if defined(__x86_64__) && defined(__LP64__)
    #define TICKWORK_TARGET "x86_64"
    #elif defined(__aarch64__) && defined(__LP64__) && defined(__AARCH64EL__)
    #define TICKWORK_TARGET "aarch64"
    #else
    #define TICKWORK_TARGET ""
    #endif
    extern void sincos(double x, double *sine, double *cosine);     /* of the C library, as GCC calls it */
    /* Make new code visible to the processor. The compiler's function for it may come with other definitions of sin,
       cos, ..., which then are those of FUNCTIONS. */
    static void tickwork_clear(void *begin, void *end) {
    #ifdef __aarch64__
        uintptr_t types, line, at;
        __asm__ volatile("mrs %0, ctr_el0" : "=r"(types));
        line = (uintptr_t)4 << (types >> 16 & 15);
        for (at = (uintptr_t)begin & -line; at < (uintptr_t)end; at += line)
            __asm__ volatile("dc cvau, %0" : : "r"(at) : "memory");
        __asm__ volatile("dsb ish" : : : "memory");
        line = (uintptr_t)4 << (types & 15);
        for (at = (uintptr_t)begin & -line; at < (uintptr_t)end; at += line)
            __asm__ volatile("ic ivau, %0" : : "r"(at) : "memory");
        __asm__ volatile("dsb ish\\n\\tisb" : : : "memory");
    #else
        (void)begin, (void)end;
    #endif
    }
    """
    const char *TICKWORK_TARGET
    void sincos(double x, double *sine, double *cosine) nogil
    void clear_cache "tickwork_clear" (void *begin, void *end) nogil

cdef enum:
    SLOT, SIZE, STEP, NEXT, DATA, EXTERN, CALL      # values of holes
    PAGE = 65536                # bytes, a multiple of the page size of every kernel
    ALIGNMENT = 32              # bytes, of data
    CALL_BYTES = 40             # kernel, slots, sizes, place of the address of the present item, item

TARGET = TICKWORK_TARGET.decode()      # kind of this processor, or "" if there is no machine code for it

VERSION = 2                     # of the stencils that `Code` joins: changes with `Hole` and with the words of `CALL`

HOLES = {"SLOT": SLOT, "SIZE": SIZE, "STEP": STEP, "NEXT": NEXT, "DATA": DATA, "EXTERN": EXTERN, "CALL": CALL}

ABSOLUTE_X86_64 = {R_X86_64_32, R_X86_64_32S}
ABSOLUTE_AARCH64 = {R_AARCH64_ADR_PREL_PG_HI21, R_AARCH64_ADD_ABS_LO12_NC}
RELOCATIONS = {                 # which `Code` can fill, by target and value
    "x86_64": {
        SLOT: ABSOLUTE_X86_64, SIZE: ABSOLUTE_X86_64, STEP: ABSOLUTE_X86_64,
        NEXT: {R_X86_64_PC32, R_X86_64_PLT32},
        DATA: {R_X86_64_PC32, R_X86_64_PLT32},
        CALL: {R_X86_64_PC32, R_X86_64_PLT32},
        EXTERN: {R_X86_64_GOTPCREL, R_X86_64_GOTPCRELX, R_X86_64_REX_GOTPCRELX},
    },
    "aarch64": {
        SLOT: ABSOLUTE_AARCH64, SIZE: ABSOLUTE_AARCH64, STEP: ABSOLUTE_AARCH64,
        NEXT: {R_AARCH64_JUMP26},
        DATA: {
            *ABSOLUTE_AARCH64,
            R_AARCH64_LDST32_ABS_LO12_NC, R_AARCH64_LDST64_ABS_LO12_NC, R_AARCH64_LDST128_ABS_LO12_NC,
        },
        CALL: {*ABSOLUTE_AARCH64, R_AARCH64_LDST64_ABS_LO12_NC},
        EXTERN: {R_AARCH64_ADR_GOT_PAGE, R_AARCH64_LD64_GOT_LO12_NC},
    },
}
FUNCTIONS = {                   # that stencils may call
    "acos": <uintptr_t>acos, "asin": <uintptr_t>asin, "atan": <uintptr_t>atan, "atan2": <uintptr_t>atan2,
    "ceil": <uintptr_t>ceil, "cos": <uintptr_t>cos, "exp": <uintptr_t>exp, "expm1": <uintptr_t>expm1,
    "floor": <uintptr_t>floor, "fmod": <uintptr_t>fmod, "log": <uintptr_t>log, "pow": <uintptr_t>pow,
    "rint": <uintptr_t>rint, "sin": <uintptr_t>sin, "tan": <uintptr_t>tan, "sincos": <uintptr_t>sincos,
    "memcpy": <uintptr_t>memcpy, "memmove": <uintptr_t>memmove, "memset": <uintptr_t>memset,
}


cdef struct Hole:
    int32_t offset
    int32_t kind                # relocation of ELF
    int32_t value
    int32_t which
    int32_t addend


def context_of(function) -> str:
    """Return the context of a capsule as text, or ""."""
    cdef const char *text = <const char *>PyCapsule_GetContext(function) if PyCapsule_CheckExact(function) else NULL
    return "" if text == NULL else text.decode()


cdef class Code:
    """Machine code of runs of steps.

    runs : for each, the stopwatch item of its first step, and a list of (stencil, slots, sizes, addresses): the tables
        of the step; or, for the stencil that calls its kernel, the words of `CALL`
    end : stencil behind each run
    target : processor that the code is for

    Raises OSError if the system permits no executable memory.
    """

    def __init__(self, runs, end, str target):
        cdef size_t code_bytes, data_bytes
        cdef int index, item
        self.arm = target == "aarch64"
        self.places, self.entries = {}, []
        steps = [step for _, run in runs for step in run]
        everything = [stencil for stencil, *_ in steps] + [end]
        code_bytes = sum(len(stencil.code) for stencil, *_ in steps)
        code_bytes += len(runs) * (len(end.code) + ALIGNMENT)
        data_bytes = sum(len(data) + ALIGNMENT for data in {stencil.data for stencil in everything})
        data_bytes += 8 * len(FUNCTIONS) + sum(CALL_BYTES for *_, addresses in steps if addresses)
        self.data_size = pages(data_bytes + ALIGNMENT)
        self.size = self.data_size + pages(code_bytes + ALIGNMENT)
        self.memory = <char *>mmap(NULL, self.size, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0)
        if self.memory == <char *>MAP_FAILED:
            self.memory = NULL
            raise OSError("no memory for machine code")
        self.map.starts = <uintptr_t *>calloc(max(1, len(steps)), sizeof(uintptr_t))
        self.map.items = <int32_t *>calloc(max(1, len(steps)), sizeof(int32_t))
        if self.map.starts == NULL or self.map.items == NULL:
            raise MemoryError
        self.map.begin, self.map.end = <uintptr_t>self.memory + self.data_size, <uintptr_t>self.memory + self.size
        self.at, self.used = self.data_size, 0
        for item, run in runs:
            self.at = (self.at + ALIGNMENT - 1) // ALIGNMENT * ALIGNMENT
            self.entries.append(<uintptr_t>self.memory + self.at)
            for index, (stencil, slots, sizes, addresses) in enumerate(run):
                self.note(item + index)
                self.add(stencil, slots, sizes, addresses, index)
            self.add(end, (), (), (), 0)
        if mprotect(self.memory, self.data_size, PROT_READ) or mprotect(
                self.memory + self.data_size, self.size - self.data_size, PROT_READ | PROT_EXEC):
            raise OSError("the system permits no executable memory")
        clear_cache(self.memory, self.memory + self.size)

    def __dealloc__(self):
        if self.memory != NULL:
            munmap(self.memory, self.size)
        free(self.map.starts)
        free(self.map.items)

    @property
    def content(self) -> bytes:
        """The memory: constants and addresses, then code."""
        return self.memory[:self.size]

    cdef void note(self, int item) noexcept nogil:
        """Begin the code of a step in the map."""
        self.map.starts[self.map.count] = <uintptr_t>self.memory + self.at
        self.map.items[self.map.count] = item
        self.map.count += 1

    cdef add(self, stencil, tuple slots, tuple sizes, tuple addresses, int step):
        """Append a stencil, and fill its holes."""
        cdef bytes code = stencil.code
        cdef bytes packed = stencil.holes
        cdef const Hole *hole = <const Hole *><const char *>packed
        cdef const Hole *end = hole + len(packed) // sizeof(Hole)
        cdef size_t length = len(code)
        cdef char *begin = self.memory + self.at
        cdef int64_t value
        cdef int64_t data = self.place(stencil.data) if stencil.data else 0
        cdef int64_t call = self.place_words(addresses) if addresses else 0
        memcpy(begin, <const char *>code, length)
        while hole < end:
            if hole.value == SLOT:
                value = 8 * <int64_t>slots[hole.which]
            elif hole.value == SIZE:
                value = sizes[hole.which]
            elif hole.value == STEP:
                value = step
            elif hole.value == NEXT:
                value = <int64_t>(begin + length)
            elif hole.value == DATA:
                value = data
            elif hole.value == CALL:
                value = call
            else:
                value = self.place_function(stencil.externs[hole.which])
            if self.arm:
                patch_aarch64(begin + hole.offset, hole, value + hole.addend)
            else:
                patch_x86_64(begin + hole.offset, hole, value + hole.addend)
            hole += 1
        self.at += length

    cdef int64_t place(self, bytes data):
        """Return the address of constants, equal ones once."""
        if data not in self.places:
            self.used = (self.used + ALIGNMENT - 1) // ALIGNMENT * ALIGNMENT
            memcpy(self.memory + self.used, <const char *>data, len(data))
            self.places[data] = <uintptr_t>self.memory + self.used
            self.used += len(data)
        return self.places[data]

    cdef int64_t place_function(self, str name):
        """Return the address of the address of a function of the C library."""
        if name not in self.places:
            self.places[name] = self.place_words((FUNCTIONS[name],))
        return self.places[name]

    cdef int64_t place_words(self, tuple words):
        """Append addresses to the data, and return the address of the first."""
        cdef size_t at = (self.used + 7) // 8 * 8
        for index, word in enumerate(words):
            (<uint64_t *>(self.memory + at))[index] = word
        self.used = at + 8 * len(words)
        return <int64_t>(self.memory + at)


cdef size_t pages(size_t size) noexcept nogil:
    return (size + PAGE - 1) // PAGE * PAGE


cdef void patch_x86_64(char *at, const Hole *hole, int64_t value) noexcept nogil:
    cdef int32_t word = <int32_t>value
    if hole.value >= NEXT:                  # relative to the hole
        word = <int32_t>(value - <int64_t>at)
    memcpy(at, &word, 4)


cdef void patch_aarch64(char *at, const Hole *hole, int64_t value) noexcept nogil:
    cdef int kind = hole.kind
    cdef int shift = 3
    cdef uint32_t word, target
    cdef int64_t distance
    memcpy(&word, at, 4)
    target = word & 31
    if hole.value <= STEP:
        if kind == R_AARCH64_ADR_PREL_PG_HI21:      # adrp becomes movz
            word = 0xD2800000U | <uint32_t>(value & 0xFFFF) << 5 | target
        else:                                       # add becomes movk of the upper half
            word = 0xF2A00000U | <uint32_t>(value >> 16 & 0xFFFF) << 5 | target
    elif kind == R_AARCH64_JUMP26:
        distance = value - <int64_t>at
        word = word & 0xFC000000U | <uint32_t>(distance >> 2) & 0x3FFFFFF
    elif kind == R_AARCH64_ADR_PREL_PG_HI21 or kind == R_AARCH64_ADR_GOT_PAGE:
        distance = (value >> 12) - (<int64_t>at >> 12)
        word = word & 0x9F00001FU | <uint32_t>(distance & 3) << 29 | <uint32_t>(distance >> 2 & 0x7FFFF) << 5
    else:                                           # the lower 12 bits, in units of the access
        if kind == R_AARCH64_ADD_ABS_LO12_NC:
            shift = 0
        elif kind == R_AARCH64_LDST32_ABS_LO12_NC:
            shift = 2
        elif kind == R_AARCH64_LDST128_ABS_LO12_NC:
            shift = 4
        word = word & ~(<uint32_t>0xFFF << 10) | <uint32_t>((value & 0xFFF) >> shift) << 10
    memcpy(at, &word, 4)
