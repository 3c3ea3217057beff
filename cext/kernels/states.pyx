# cython: freethreading_compatible=True
"""State machines: conditions compiled to operations on a small stack."""

from libc.math cimport floor
from libc.stdint cimport int32_t

from cext.abi cimport DT, ITEMS, OK, PERIOD, Rest, each, export, items, kernel_t

cdef enum:
    DEPTH = 32                  # of the stack; the block rejects a condition that needs more
    LEVELS = 8                  # of nested states; the block rejects more

cdef enum: # operations, each followed by one operand
    CONSTANT, INPUT, ELAPSED, HELD, ADD, SUBTRACT, MULTIPLY, DIVIDE, NEGATE, ABS, LESS, LESS_EQUAL, GREATER, GREATER_EQUAL,
    EQUAL, NOT_EQUAL, AND, OR, NOT, STORE

cdef enum: # fields of a state in `nodes`
    PARENT                      # state that contains it, -1 for none
    CHILD                       # its first inner state, -1 for none
    HISTORY                     # 1 if it is entered where it was left
    NUMBER                      # index in the output `state`, of a state without inner ones
    ENTRY, ENTRY_COUNT          # first operation and number of operations of its actions
    EXIT, EXIT_COUNT
    FIELDS

cdef enum: # fields of a transition in `table`
    FROM, TO
    SCOPE                       # innermost state that it does not leave, -1 for none
    CONDITION, CONDITION_COUNT
    COLUMNS

cdef enum: # fields of `current`; then, for each state, the periods in it, -1 while it is not active, and its last inner state
    ACTIVE                      # innermost active state
    STARTED                     # 1 after the first tick
    SINCE

OPERATIONS = {
    "constant": CONSTANT, "input": INPUT, "elapsed": ELAPSED, "held": HELD, "+": ADD, "-": SUBTRACT, "*": MULTIPLY, "/": DIVIDE,
    "negate": NEGATE,
    "abs": ABS, "<": LESS, "<=": LESS_EQUAL, ">": GREATER, ">=": GREATER_EQUAL, "==": EQUAL, "!=": NOT_EQUAL,
    "and": AND, "or": OR, "not": NOT, "store": STORE,
}
STACK_DEPTH, NESTING = DEPTH, LEVELS


cdef struct Machine:
    Rest inputs
    int32_t state, time_in_state
    Rest outputs
    int32_t table, code, nodes
    int32_t values              # numbers of constant and of held outputs, then values of the former, state by state
    int32_t current, held

MACHINE = items((<Machine *>ITEMS)[0], "table[...] code[...] nodes[...] values[...] current[...] held[...]")

cdef struct Chart:              # of one tick
    const double *arena
    const int32_t *inputs
    const double *code
    const double *nodes
    double *current
    double *held
    double period


cdef double evaluate(const Chart *chart, double first, double count, int state) noexcept nogil:
    """Return the result of a condition, or execute actions. state : whose `time_in_state` they read"""
    cdef double[DEPTH] stack
    cdef const double *code = chart.code + 2 * <int>first
    cdef double a, b
    cdef int top = 0
    cdef int i, operation, operand
    stack[0] = 0.0
    for i in range(<int>count):
        operation, operand = <int>code[2 * i], <int>code[2 * i + 1]
        if operation <= HELD:
            stack[top] = (
                code[2 * i + 1] if operation == CONSTANT
                else chart.current[SINCE + 2 * state] * chart.period if operation == ELAPSED
                else chart.held[operand] if operation == HELD
                else chart.arena[chart.inputs[operand]])
            top += 1
            continue
        a = stack[top - 1]
        if operation == STORE:
            top -= 1
            chart.held[operand] = a
            continue
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


cdef void leave(const Chart *chart, int scope) noexcept nogil:
    """Leave the active states inside `scope`, the innermost first."""
    cdef int state = <int>chart.current[ACTIVE]
    cdef const double *node
    while state != scope:
        node = chart.nodes + FIELDS * state
        evaluate(chart, node[EXIT], node[EXIT_COUNT], state)
        chart.current[SINCE + 2 * state] = -1.0
        state = <int>node[PARENT]


cdef void enter(const Chart *chart, int state, int scope) noexcept nogil:
    """Enter a state: those around it inside `scope` first, then itself, then its first or last inner ones."""
    cdef int[LEVELS] path
    cdef int depth = 0
    cdef int child = state
    cdef const double *node
    while child >= 0:
        state, node = child, chart.nodes + FIELDS * child
        child = <int>chart.current[SINCE + 2 * state + 1] if node[HISTORY] != 0.0 else -1
        child = child if child >= 0 else <int>node[CHILD]
    chart.current[ACTIVE] = state
    while state != scope:
        path[depth] = state
        depth += 1
        child, state = state, <int>chart.nodes[FIELDS * state + PARENT]
        if state >= 0:
            chart.current[SINCE + 2 * state + 1] = child
    while depth > 0:
        depth -= 1
        state = path[depth]
        node = chart.nodes + FIELDS * state
        chart.current[SINCE + 2 * state] = 0.0
        evaluate(chart, node[ENTRY], node[ENTRY_COUNT], state)


cdef int machine_kernel(double *arena, const Machine *at, const Machine *sizes) noexcept nogil:
    cdef const int32_t *inputs = each(at, at.inputs)
    cdef const int32_t *outputs = each(at, at.outputs)
    cdef int constants = <int>arena[at.values]
    cdef int held = <int>arena[at.values + 1]
    cdef double *current = arena + at.current
    cdef double periods = floor(arena[DT] / arena[PERIOD] + 0.5)
    cdef double poison = 0.0
    cdef const double *row = arena + at.table
    cdef const double *values
    cdef Chart chart
    cdef int i, active
    chart.arena, chart.inputs, chart.code, chart.nodes = arena, inputs, arena + at.code, arena + at.nodes
    chart.current, chart.held, chart.period = current, arena + at.held, arena[PERIOD]
    for i in range(at.inputs.count):
        poison += arena[inputs[i]] - arena[inputs[i]]        # 0, or NaN if an input is NaN or infinite
    if current[STARTED] != 0.0:
        for i in range(sizes.nodes // FIELDS):
            if current[SINCE + 2 * i] >= 0.0:
                current[SINCE + 2 * i] += periods
    elif poison == 0.0:
        current[STARTED] = 1.0
        enter(&chart, <int>current[ACTIVE], -1)
    if poison == 0.0:
        for i in range(sizes.table // COLUMNS):
            if current[SINCE + 2 * <int>row[FROM]] >= 0.0 and evaluate(
                    &chart, row[CONDITION], row[CONDITION_COUNT], <int>row[FROM]) != 0.0:
                leave(&chart, <int>row[SCOPE])
                enter(&chart, <int>row[TO], <int>row[SCOPE])
                break
            row += COLUMNS
    active = <int>current[ACTIVE]
    arena[at.state] = chart.nodes[FIELDS * active + NUMBER]
    arena[at.time_in_state] = max(current[SINCE + 2 * active], 0.0) * arena[PERIOD] + poison
    values = arena + at.values + 2 + <int>arena[at.state] * constants
    for i in range(constants):
        arena[outputs[i]] = values[i] + poison
    for i in range(held):
        arena[outputs[constants + i]] = chart.held[i] + poison
    return OK


machine = export(<kernel_t>machine_kernel, MACHINE)
