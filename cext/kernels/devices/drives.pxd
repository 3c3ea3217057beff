"""Common parts of emulated drives: items, injected faults and pending replies.

All ranges, positions and torques refer to the joint. With every fault input at zero, the drive is healthy.
"""

from libc.math cimport floor, isfinite
from libc.stdint cimport int32_t, int64_t, uint8_t, uint32_t, uint64_t
from libc.string cimport memcpy, memset

from cext.abi cimport FRAMES_PER_DEVICE, TIME, Frame
from cext.conversion cimport to_u32

cdef struct Drive:              # items of blocks.actuators.emulated.EmulatedDrive; each family's struct contains it
    int32_t position, velocity, temperature, fault
    int32_t silent, dropped, wrong_id, stuck_encoder, delay, power_lost, stray_torque      # injected faults
    int32_t torque, enabled
    int32_t can_id, invert, offset, gear_ratio, peak, trip_temperature
    int32_t torque_scale, wrap, zero_silence
    int32_t wire                # position, velocity, stiffness, damping, torque: half ranges at the joint
    # position, velocity, stiffness, damping, torque last received, at the joint, in the motor's direction
    int32_t command
    int32_t state               # the enum below
    int32_t outbox              # first, count, then ANSWERS times: time due, identifier, length, eight raw bytes

cdef inline str drive_sizes(): return "wire[5] command[5] state[8] outbox[...]"

cdef enum: # in `state`
    RUNNING                     # whether it is enabled
    ZERO                        # zero of the encoder
    LUCK                        # random state for dropped frames
    HELD                        # position at which the encoder is stuck, in the motor's direction
    HOLDS                       # whether the encoder is stuck
    LAST_COMMAND                # s, time of the last command
    SHIFT                       # rad at the joint, one motor turn: without power the encoder does not count turns
    DEAF_UNTIL                  # s, end of the silence after its zero was set

cdef enum:
    ANSWERS = 24
    WORDS = 4
    UNWRITTEN = 255             # length of a reply that is filled in at the end of the step, with the state then


cdef inline bint drops(double *arena, const Drive *at) noexcept nogil:
    """Return whether the next frame is lost. A linear congruential generator: the same in every run."""
    cdef double *luck = arena + at.state + LUCK
    if not arena[at.dropped] > 0.0:
        return False
    luck[0] = <double>((<uint64_t>luck[0] * 1103515245u + 12345u) & 0x7FFFFFFFu)
    return luck[0] < arena[at.dropped] * 2147483648.0


cdef inline bint unreachable(double *arena, const Drive *at) noexcept nogil:
    """Return whether a frame to this drive is lost."""
    return arena[at.power_lost] != 0.0 or arena[TIME] < (arena + at.state)[DEAF_UNTIL] or drops(arena, at)


cdef inline void owe(double *arena, const Drive *at, uint32_t id, int length, const uint8_t *data) noexcept nogil:
    """Queue a reply; without data it is filled in at the end of the step. A full queue drops it."""
    cdef double *outbox = arena + at.outbox
    cdef double *answer
    if outbox[1] >= ANSWERS:
        return
    answer = outbox + 2 + WORDS * (<int>(outbox[0] + outbox[1]) % ANSWERS)
    outbox[1] += 1.0
    answer[0] = arena[TIME] + (arena[at.delay] if arena[at.delay] > 0.0 else 0.0)
    answer[1] = id
    answer[2] = UNWRITTEN if data == NULL else length
    if data != NULL:
        memcpy(&answer[3], data, 8)


cdef inline double *unwritten(double *arena, const Drive *at, int index) noexcept nogil:
    """Return the reply at an index of the queue if it is not filled in yet, else NULL."""
    cdef double *outbox = arena + at.outbox
    cdef double *answer = outbox + 2 + WORDS * (<int>(outbox[0] + index) % ANSWERS)
    return answer if index < outbox[1] and answer[2] == UNWRITTEN else NULL


cdef inline int deliver(double *arena, const Drive *at, Frame *frames) noexcept nogil:
    """Write the replies that are due, oldest first, as many as fit; lost ones are not counted."""
    cdef double *outbox = arena + at.outbox
    cdef double *answer
    cdef int count = 0
    while outbox[1] > 0.0 and count < FRAMES_PER_DEVICE:
        answer = outbox + 2 + WORDS * <int>outbox[0]
        if answer[0] > arena[TIME] + 1e-9:
            break
        outbox[0] = (<int>outbox[0] + 1) % ANSWERS
        outbox[1] -= 1.0
        if arena[at.silent] != 0.0 or arena[at.power_lost] != 0.0 or drops(arena, at):
            continue
        memset(&frames[count], 0, sizeof(Frame))
        frames[count].id = <uint32_t>answer[1]
        frames[count].length = <uint8_t>answer[2]
        memcpy(frames[count].data, &answer[3], 8)
        count += 1
    return count


cdef inline uint32_t own_id(double *arena, const Drive *at) noexcept nogil:
    """Return the id that the drive reports."""
    return to_u32(arena[at.wrong_id if arena[at.wrong_id] > 0.0 else at.can_id])


cdef inline double turned(double *arena, const Drive *at, double x) noexcept nogil:
    """Convert between the directions of the joint and of the motor."""
    return -x if arena[at.invert] != 0.0 else x


cdef inline double strayed(double *arena, const Drive *at, double torque) noexcept nogil:
    """Return the torque of the motor: the given one and the injected one, which needs power."""
    return within(torque + (turned(arena, at, arena[at.stray_torque]) if arena[at.power_lost] == 0.0 else 0.0),
        arena[at.peak])


cdef inline double produced(double *arena, const Drive *at, double torque) noexcept nogil:
    """Return the torque at the joint of a torque that the drive computes and reports."""
    return turned(arena, at, arena[at.torque_scale] * torque)


cdef inline double true_position(double *arena, const Drive *at) noexcept nogil:
    return turned(arena, at, arena[at.position] + arena[at.offset])


cdef inline double seen_position(double *arena, const Drive *at) noexcept nogil:
    """Return the reading of the encoder relative to its zero."""
    cdef double *state = arena + at.state
    cdef double reading = (state[HELD] if state[HOLDS] != 0.0 else true_position(arena, at)) - state[ZERO]
    if arena[at.wrap] > 0.0:
        reading -= arena[at.wrap] * floor(reading / arena[at.wrap] + 0.5)
    return reading


cdef inline double seen_velocity(double *arena, const Drive *at) noexcept nogil:
    if (arena + at.state)[HOLDS] != 0.0:
        return 0.0
    return turned(arena, at, arena[at.velocity])


cdef inline bint set_zero(double *arena, const Drive *at) noexcept nogil:
    """Make the present position the zero. Returns whether the drive stops replying."""
    cdef double *state = arena + at.state
    state[ZERO] += seen_position(arena, at)
    state[DEAF_UNTIL] = arena[TIME] + arena[at.zero_silence]
    return arena[at.zero_silence] > 0.0


cdef inline void look(double *arena, const Drive *at) noexcept nogil:
    """Begin a step: let the encoder stick at its position, or release it."""
    cdef double *state = arena + at.state
    if arena[at.stuck_encoder] == 0.0:
        state[HOLDS] = 0.0
    elif state[HOLDS] == 0.0:
        state[HELD] = true_position(arena, at)
        state[HOLDS] = 1.0


cdef inline void forget(double *arena, const Drive *at) noexcept nogil:
    """Reset after a loss of power: the command, the pending replies and the count of motor turns are lost."""
    cdef double *state = arena + at.state
    cdef double seen = seen_position(arena, at)
    state[RUNNING] = 0.0
    if state[SHIFT] > 0.0 and isfinite(seen):
        state[ZERO] += state[SHIFT] * floor(seen / state[SHIFT] + 0.5)
    memset(arena + at.command, 0, 5 * sizeof(double))
    (arena + at.outbox)[1] = 0.0


cdef inline double law(double *arena, const Drive *at) noexcept nogil:
    """Return kp (p_des - p) + kd (v_des - v) + t of the last command."""
    cdef double *command = arena + at.command
    return (command[2] * (command[0] - seen_position(arena, at)) + command[3] * (command[1] - seen_velocity(arena, at))
            + command[4])


cdef inline double within(double x, double most) noexcept nogil:
    return most if x > most else -most if x < -most else x


cdef inline bint answerable(double *arena, const Drive *at) noexcept nogil:
    """Return whether the state can be encoded; that of a diverged plant cannot."""
    return isfinite(arena[at.position]) and isfinite(arena[at.velocity])
