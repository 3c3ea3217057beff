"""What all emulated drives share: where their items stand, what can be wrong with them, and the answers that they owe.

Items in the order of blocks.actuators.emulated.EmulatedDrive; what a family adds comes behind. All is at the joint: ranges, positions,
torques. Of the faults every input at zero is a healthy drive.
"""

from libc.math cimport floor, isfinite
from libc.stdint cimport int32_t, int64_t, uint8_t, uint32_t, uint64_t
from libc.string cimport memcpy, memset

from cext.abi cimport FRAMES_PER_DEVICE, INPUTS, OUTPUTS, PARAMETERS, TIME, Frame

cdef enum:
    POSITION, VELOCITY, TEMPERATURE, FAULT, SILENT, DROPPED, WRONG_ID, STUCK_ENCODER, DELAY, POWER_LOST
    TORQUE, ENABLED
    CAN_ID, INVERT, OFFSET, GEAR_RATIO, PEAK, TRIP_TEMPERATURE, WIRE_POSITION, WIRE_VELOCITY, WIRE_STIFFNESS, WIRE_DAMPING, WIRE_TORQUE
    FIRST_OWN                   # parameter of a family

cdef enum: # items of memory
    WIRE                        # position, velocity, stiffness, damping, torque: half ranges at the joint
    COMMAND                     # position, velocity, stiffness, damping, torque last heard, at the joint, the way the motor turns
    STATE                       # as the enum below
    OUTBOX                      # first, count, then ANSWERS times: time due, identifier, length, eight bytes as they are
    OWN                         # first of a family

cdef enum: # in STATE
    RUNNING                     # whether it is enabled
    ZERO                        # of the encoder
    LUCK                        # of frames that may be dropped
    HELD                        # position at which its encoder is stuck, the way the motor turns
    HOLDS                       # whether it is
    HEARD                       # s, when it was last commanded
    SHIFT                       # rad at the joint, a turn of the motor: its encoder counts no more without power

cdef enum:
    ANSWERS = 24
    WORDS = 4
    UNWRITTEN = 255             # length of an answer that is written when it is owed: with the state at the end of the step


cdef inline double *kept(double *arena, const int32_t *slots, int item) noexcept nogil:
    """An item of memory: it lies behind what parameters a family has."""
    return arena + slots[slots[INPUTS] + slots[OUTPUTS] + slots[PARAMETERS] + item]


cdef inline bint drops(double *arena, const int32_t *slots) noexcept nogil:
    """Whether the next frame is lost on its way. A linear congruence: the same in every run."""
    cdef double *luck = kept(arena, slots, STATE) + LUCK
    if not arena[slots[DROPPED]] > 0.0:
        return False
    luck[0] = <double>((<uint64_t>luck[0] * 1103515245u + 12345u) & 0x7FFFFFFFu)
    return luck[0] < arena[slots[DROPPED]] * 2147483648.0


cdef inline bint unreachable(double *arena, const int32_t *slots) noexcept nogil:
    """Whether a frame that is for it does not reach it."""
    return arena[slots[POWER_LOST]] != 0.0 or drops(arena, slots)


cdef inline void owe(double *arena, const int32_t *slots, uint32_t id, int length, const uint8_t *data) noexcept nogil:
    """Promise an answer; without data it is written at the end of the step. One too many is forgotten."""
    cdef double *outbox = kept(arena, slots, OUTBOX)
    cdef double *answer
    if outbox[1] >= ANSWERS:
        return
    answer = outbox + 2 + WORDS * (<int>(outbox[0] + outbox[1]) % ANSWERS)
    outbox[1] += 1.0
    answer[0] = arena[TIME] + (arena[slots[DELAY]] if arena[slots[DELAY]] > 0.0 else 0.0)
    answer[1] = id
    answer[2] = UNWRITTEN if data == NULL else length
    if data != NULL:
        memcpy(&answer[3], data, 8)


cdef inline double *unwritten(double *arena, const int32_t *slots, int index) noexcept nogil:
    """The answer at that place of the queue if it waits to be written; NULL if there is none or it is."""
    cdef double *outbox = kept(arena, slots, OUTBOX)
    cdef double *answer = outbox + 2 + WORDS * (<int>(outbox[0] + index) % ANSWERS)
    return answer if index < outbox[1] and answer[2] == UNWRITTEN else NULL


cdef inline int deliver(double *arena, const int32_t *slots, Frame *frames) noexcept nogil:
    """The answers that are due, oldest first: as many as fit; those that get lost do not count."""
    cdef double *outbox = kept(arena, slots, OUTBOX)
    cdef double *answer
    cdef int count = 0
    while outbox[1] > 0.0 and count < FRAMES_PER_DEVICE:
        answer = outbox + 2 + WORDS * <int>outbox[0]
        if answer[0] > arena[TIME] + 1e-9:
            break
        outbox[0] = (<int>outbox[0] + 1) % ANSWERS
        outbox[1] -= 1.0
        if arena[slots[SILENT]] != 0.0 or arena[slots[POWER_LOST]] != 0.0 or drops(arena, slots):
            continue
        memset(&frames[count], 0, sizeof(Frame))
        frames[count].id = <uint32_t>answer[1]
        frames[count].length = <uint8_t>answer[2]
        memcpy(frames[count].data, &answer[3], 8)
        count += 1
    return count


cdef inline uint32_t own_id(double *arena, const int32_t *slots) noexcept nogil:
    """The id that it says it has."""
    return <uint32_t>arena[slots[WRONG_ID] if arena[slots[WRONG_ID]] > 0.0 else slots[CAN_ID]]


cdef inline double turned(double *arena, const int32_t *slots, double x) noexcept nogil:
    """Between the joint and the motor's way of turning."""
    return -x if arena[slots[INVERT]] != 0.0 else x


cdef inline double true_position(double *arena, const int32_t *slots) noexcept nogil:
    return turned(arena, slots, arena[slots[POSITION]] + arena[slots[OFFSET]])


cdef inline double seen_position(double *arena, const int32_t *slots) noexcept nogil:
    """What its encoder says, its zero taken away."""
    cdef double *state = kept(arena, slots, STATE)
    return (state[HELD] if state[HOLDS] != 0.0 else true_position(arena, slots)) - state[ZERO]


cdef inline double seen_velocity(double *arena, const int32_t *slots) noexcept nogil:
    if kept(arena, slots, STATE)[HOLDS] != 0.0:
        return 0.0
    return turned(arena, slots, arena[slots[VELOCITY]])


cdef inline void look(double *arena, const int32_t *slots) noexcept nogil:
    """Begin of a step: the encoder sticks where it is, or lets go."""
    cdef double *state = kept(arena, slots, STATE)
    if arena[slots[STUCK_ENCODER]] == 0.0:
        state[HOLDS] = 0.0
    elif state[HOLDS] == 0.0:
        state[HELD] = true_position(arena, slots)
        state[HOLDS] = 1.0


cdef inline void forget(double *arena, const int32_t *slots) noexcept nogil:
    """Power is gone: what it was told, what it would have said, and how many turns the motor has made."""
    cdef double *state = kept(arena, slots, STATE)
    cdef double seen = seen_position(arena, slots)
    state[RUNNING] = 0.0
    if state[SHIFT] > 0.0 and isfinite(seen):
        state[ZERO] += state[SHIFT] * floor(seen / state[SHIFT] + 0.5)
    memset(kept(arena, slots, COMMAND), 0, 5 * sizeof(double))
    kept(arena, slots, OUTBOX)[1] = 0.0


cdef inline double law(double *arena, const int32_t *slots) noexcept nogil:
    """kp (p_des - p) + kd (v_des - v) + t of what it was told."""
    cdef double *command = kept(arena, slots, COMMAND)
    return (command[2] * (command[0] - seen_position(arena, slots)) + command[3] * (command[1] - seen_velocity(arena, slots))
            + command[4])


cdef inline double within(double x, double most) noexcept nogil:
    return most if x > most else -most if x < -most else x


cdef inline bint answerable(double *arena, const int32_t *slots) noexcept nogil:
    """Whether its state can be said in codes: that of a plant that has blown up cannot."""
    return isfinite(arena[slots[POSITION]]) and isfinite(arena[slots[VELOCITY]])
