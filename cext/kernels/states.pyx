# cython: freethreading_compatible=True
"""State machines: conditions compiled to operations on a small stack."""

from libc.math cimport floor
from libc.stdint cimport int32_t

from cext.abi cimport DT, ITEMS, OK, PERIOD, Rest, each, export, items, kernel_t

cdef enum:
    DEPTH = 32                  # of the stack; the block rejects a condition that needs more

cdef enum: # operations, each followed by one operand
    CONSTANT, INPUT, ELAPSED, ADD, SUBTRACT, MULTIPLY, DIVIDE, NEGATE, ABS, LESS, LESS_EQUAL, GREATER, GREATER_EQUAL,
    EQUAL, NOT_EQUAL, AND, OR, NOT

OPERATIONS = {
    "constant": CONSTANT, "input": INPUT, "elapsed": ELAPSED, "+": ADD, "-": SUBTRACT, "*": MULTIPLY, "/": DIVIDE,
    "negate": NEGATE,
    "abs": ABS, "<": LESS, "<=": LESS_EQUAL, ">": GREATER, ">=": GREATER_EQUAL, "==": EQUAL, "!=": NOT_EQUAL,
    "and": AND, "or": OR, "not": NOT,
}
STACK_DEPTH = DEPTH


cdef struct Machine:
    Rest inputs
    int32_t state, time_in_state
    Rest outputs
    int32_t table               # of each transition: from, to, first operation, number of operations
    int32_t code                # operation and operand of each
    int32_t values              # number of outputs, then their values, state by state
    int32_t current             # state, periods in it, whether it was initialized

MACHINE = items((<Machine *>ITEMS)[0], "table[...] code[...] values[...] current[3]")


cdef double evaluate(const double *code, int count, const double *arena, const int32_t *inputs,
        double elapsed) noexcept nogil:
    cdef double[DEPTH] stack
    cdef double a, b
    cdef int top = 0
    cdef int i, operation
    for i in range(count):
        operation = <int>code[2 * i]
        if operation <= ELAPSED:
            stack[top] = (
                code[2 * i + 1] if operation == CONSTANT else elapsed if operation == ELAPSED
                else arena[inputs[<int>code[2 * i + 1]]])
            top += 1
            continue
        a = stack[top - 1]
        if operation == NEGATE:
            stack[top - 1] = -a
            continue
        if operation == ABS:
            stack[top - 1] = -a if a < 0.0 else a
            continue
        if operation == NOT:
            stack[top - 1] = 1.0 if a == 0.0 else 0.0
            continue
        top -= 1
        b, a = a, stack[top - 1]
        if operation == ADD:
            a = a + b
        elif operation == SUBTRACT:
            a = a - b
        elif operation == MULTIPLY:
            a = a * b
        elif operation == DIVIDE:
            a = a / b
        elif operation == LESS:
            a = a < b
        elif operation == LESS_EQUAL:
            a = a <= b
        elif operation == GREATER:
            a = a > b
        elif operation == GREATER_EQUAL:
            a = a >= b
        elif operation == EQUAL:
            a = a == b
        elif operation == NOT_EQUAL:
            a = a != b
        elif operation == AND:
            a = a != 0.0 and b != 0.0
        else:
            a = a != 0.0 or b != 0.0
        stack[top - 1] = a
    return stack[0]


cdef int machine_kernel(double *arena, const Machine *at, const Machine *sizes) noexcept nogil:
    cdef const int32_t *inputs = each(at, at.inputs)
    cdef const int32_t *outputs = each(at, at.outputs)
    cdef const double *transitions = arena + at.table
    cdef const double *code = arena + at.code
    cdef int output_count = <int>arena[at.values]
    cdef const double *values = arena + at.values + 1
    cdef double *current = arena + at.current
    cdef double poison = 0.0
    cdef int count = sizes.table // 4
    cdef int i
    for i in range(at.inputs.count):
        poison += arena[inputs[i]] - arena[inputs[i]]        # 0, or NaN if an input is NaN or infinite
    if current[2] != 0.0:
        current[1] += floor(arena[DT] / arena[PERIOD] + 0.5)
    current[2] = 1.0
    if poison == 0.0:
        for i in range(count):
            if transitions[4 * i] == current[0] and evaluate(
                    code + 2 * <int>transitions[4 * i + 2], <int>transitions[4 * i
                            + 3], arena, inputs, current[1] * arena[PERIOD]) != 0.0:
                current[0] = transitions[4 * i + 1]
                current[1] = 0.0
                break
    arena[at.state] = current[0]
    arena[at.time_in_state] = current[1] * arena[PERIOD] + poison
    for i in range(output_count):
        arena[outputs[i]] = values[<int>current[0] * output_count + i] + poison
    return OK


machine = export(<kernel_t>machine_kernel, MACHINE)
