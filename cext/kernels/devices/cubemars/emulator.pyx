# cython: freethreading_compatible=True
"""Emulated CubeMars boards with extended frames: force control of V3.0, and the servo mode of all boards.

    0 duty int32 x 1e-5
    1 current int32 mA
    2 braking current int32 mA
    3 speed int32, electrical revolutions per minute
    4 position int32 x 1e-4°
    5 origin, one byte
    6 position as 4, speed int16 x 10, acceleration int16 x 10 per second
    8 force control, V3.0 only, cext/kernels/devices/cubemars/v3.pyx
    15 disable, V3.0 only

They report periodically, or once per command if the rate is 0. The gains of the speed and position loops are assumed.
"""

from libc.math cimport isfinite
from libc.stdint cimport int16_t, int32_t, uint8_t, uint32_t
from libc.string cimport memcpy, memset

from cext.abi cimport (
    DT, EXTENDED, FOREIGN, ID_MASK, ITEMS, MALFORMED, NOT_FINITE, OK, TAKEN, TIME, Frame, decode_t, encode_t,
    export, export_decode, export_encode, items, kernel_t,
)
from cext.conversion cimport to_u8
cimport cext.kernels.devices.cubemars.status as wire
from cext.kernels.devices.drives cimport (
    LAST_COMMAND, RUNNING, Drive, answerable, deliver, drive_sizes, forget, law, look, owe, own_id, produced,
    seen_position, seen_velocity, set_zero, strayed, unreachable, unwritten, within,
)
from cext.kernels.devices.fields cimport from_code
from cext.kernels.devices.mit cimport all_ones

cdef enum:
    TOO_HOT = 1                 # error code

cdef enum: # in `motion`, in the motor's direction
    KIND                        # kind of the active command, below 0 for none
    TARGET                      # target of that command, in SI units at the joint
    FASTEST                     # rad/s, speed limit of a position command; 0 for none
    HARDEST                     # rad/s², acceleration limit of a position command; 0 for none
    REFERENCE                   # rad/s, reference of the speed loop
    PUSHES                      # N·m, present torque
    NEXT_REPORT                 # s
    ECHOES                      # whether the next status answers a disable
    WAS_DEAD                    # without power in the previous step

cdef double POSITION_GAIN = 20.0                # 1/s
cdef double VELOCITY_GAIN = 5.0                 # N·m·s/rad
cdef double RADIAN = 0.017453292519943295       # rad per degree


cdef inline int length_of(uint32_t kind, bint knows_force) noexcept nogil:
    """Return the number of data bytes of a command, -1 for an unknown one."""
    if kind <= wire.POSITION:
        return 4
    if kind == wire.ORIGIN:
        return 1
    if kind == wire.POSITION_SPEED:
        return 8
    if knows_force and kind == wire.FORCE:
        return 8
    return 0 if knows_force and kind == wire.DISABLE else -1


cdef struct Board:
    Drive drive
    int32_t report_rate
    int32_t command_timeout     # s, 0 for none
    int32_t scales              # rad and rad/s per code of the status, N·m per ampere, at the joint
    int32_t board               # whether it has force control, whether that mode must be entered
    int32_t motion              # the enum above

BOARD = items((<Board *>ITEMS)[0], drive_sizes() + " scales[3] board[2] motion[9]")


cdef void release(double *arena, const Board *at) noexcept nogil:
    cdef double *motion = arena + at.motion
    (arena + at.drive.state)[RUNNING] = 0.0
    motion[KIND], motion[PUSHES], motion[REFERENCE] = -1.0, 0.0, 0.0


cdef void take_force(double *arena, const Board *at, const uint8_t *data) noexcept nogil:
    cdef double *half = arena + at.drive.wire
    cdef double *command = arena + at.drive.command
    cdef double *motion = arena + at.motion
    if (arena + at.board)[1] != 0.0:
        if all_ones(data, 7) and data[7] == 0xFC:
            (arena + at.drive.state)[RUNNING] = 1.0
            return
        if (arena + at.drive.state)[RUNNING] == 0.0:
            return
    command[2] = from_code(<uint32_t>data[0] << 4 | data[1] >> 4, 0.0, half[2], 12)
    command[3] = from_code((<uint32_t>data[1] & 15) << 8 | data[2], 0.0, half[3], 12)
    command[0] = from_code(<uint32_t>data[3] << 8 | data[4], -half[0], half[0], 16)
    command[1] = from_code(<uint32_t>data[5] << 4 | data[6] >> 4, -half[1], half[1], 12)
    command[4] = from_code((<uint32_t>data[6] & 15) << 8 | data[7], -half[4], half[4], 12)
    motion[KIND] = wire.FORCE
    (arena + at.drive.state)[RUNNING] = 1.0


cdef void take(double *arena, const Board *at, uint32_t kind, const uint8_t *data) noexcept nogil:
    """Accept a command of servo mode."""
    cdef double *motion = arena + at.motion
    cdef double *scales = arena + at.scales
    cdef double value = wire.get_long(data)
    if motion[KIND] != kind:
        motion[REFERENCE] = seen_velocity(arena, &at.drive)
    motion[KIND], motion[FASTEST], motion[HARDEST] = kind, 0.0, 0.0
    (arena + at.drive.state)[RUNNING] = 1.0
    if kind == wire.DUTY:
        motion[TARGET] = within(1e-5 * value, 1.0)
    elif kind == wire.CURRENT or kind == wire.BRAKE:
        motion[TARGET] = 1e-3 * value * scales[2]
    elif kind == wire.SPEED:
        motion[TARGET] = 0.1 * value * scales[1]
    else:
        motion[TARGET] = 1e-4 * RADIAN * value / arena[at.drive.gear_ratio]
        if kind == wire.POSITION_SPEED:
            motion[FASTEST] = wire.word(&data[4]) * scales[1]
            motion[HARDEST] = wire.word(&data[6]) * scales[1]


cdef int drive_decode_(double *arena, const Board *at, const Board *sizes, const Frame *frame) noexcept nogil:
    cdef uint32_t kind = (frame.id & <uint32_t>ID_MASK) >> 8
    cdef int length
    if (frame.id & ~<uint32_t>ID_MASK) != EXTENDED or (frame.id & 0xFF) != <uint32_t>arena[at.drive.can_id]:
        return FOREIGN
    length = length_of(kind, (arena + at.board)[0] != 0.0)
    if length < 0:
        return FOREIGN
    if frame.length != length:
        return MALFORMED
    if unreachable(arena, &at.drive):
        return TAKEN
    if kind == wire.DISABLE:
        release(arena, at)
        (arena + at.motion)[ECHOES] = 1.0
    elif kind == wire.ORIGIN:
        if set_zero(arena, &at.drive):
            return TAKEN
    else:
        (arena + at.drive.state)[LAST_COMMAND] = arena[TIME]
        if kind == wire.FORCE:
            take_force(arena, at, frame.data)
        else:
            take(arena, at, kind, frame.data)
    if arena[at.report_rate] == 0.0:
        owe(arena, &at.drive, 0, 0, NULL)
    return TAKEN


cdef inline uint8_t error_code(double *arena, const Board *at) noexcept nogil:
    if arena[at.drive.fault] != 0.0:
        return to_u8(arena[at.drive.fault])
    return TOO_HOT if arena[at.drive.temperature] >= arena[at.drive.trip_temperature] else 0


cdef double servo_torque(double *arena, const Board *at, double *motion) noexcept nogil:
    """Return the torque of the last command, N·m at the joint, and advance the reference of the speed loop."""
    cdef double velocity = seen_velocity(arena, &at.drive)
    cdef double peak = arena[at.drive.peak]
    cdef double wanted = motion[TARGET]
    cdef double step
    if motion[KIND] == wire.CURRENT:
        return wanted
    if motion[KIND] == wire.BRAKE:
        return within(-VELOCITY_GAIN * velocity, wanted if wanted > 0.0 else 0.0)
    # a voltage: the torque decreases with speed, to zero at that fraction of the no-load speed
    if motion[KIND] == wire.DUTY:
        return peak * (wanted - velocity / (arena + at.drive.wire)[1])
    if motion[KIND] != wire.SPEED:
        wanted = POSITION_GAIN * (wanted - seen_position(arena, &at.drive))
        if motion[KIND] == wire.POSITION_SPEED:
            wanted = within(wanted, motion[FASTEST])
            step = motion[HARDEST] * arena[DT]
            wanted = motion[REFERENCE] + within(wanted - motion[REFERENCE], step)
    motion[REFERENCE] = wanted
    return VELOCITY_GAIN * (wanted - velocity)


cdef int drive_kernel(double *arena, const Board *at, const Board *sizes) noexcept nogil:
    cdef double *motion = arena + at.motion
    cdef double rate = arena[at.report_rate]
    cdef uint8_t powered[8]
    look(arena, &at.drive)
    if arena[at.drive.power_lost] != 0.0:
        forget(arena, &at.drive)
        release(arena, at)
        motion[WAS_DEAD] = 1.0
    elif motion[WAS_DEAD] != 0.0:
        motion[WAS_DEAD] = 0.0
        memset(powered, 0, 8)
        powered[0], powered[1], powered[2], powered[3] = 0xFA, 0xFB, 0xFC, 0xFD
        owe(arena, &at.drive, <uint32_t>EXTENDED | wire.POWER_UP << 8 | own_id(arena, &at.drive), 4, powered)
    if arena[at.command_timeout] > 0.0 and motion[KIND] >= 0.0 and (
            arena[TIME] - (arena + at.drive.state)[LAST_COMMAND] > arena[at.command_timeout]):
        motion[KIND], motion[TARGET] = wire.CURRENT, 0.0               # and the next command acts at once
    motion[PUSHES] = strayed(arena, &at.drive, 0.0 if motion[KIND] < 0.0 or error_code(arena, at) != 0
        else law(arena, &at.drive) if motion[KIND] == wire.FORCE else servo_torque(arena, at, motion))
    if rate > 0.0 and arena[TIME] + 1e-9 >= motion[NEXT_REPORT]:
        motion[NEXT_REPORT] += 1.0 / rate
        if motion[NEXT_REPORT] <= arena[TIME] + 1e-9:
            motion[NEXT_REPORT] = arena[TIME] + 1.0 / rate
        owe(arena, &at.drive, 0, 0, NULL)
    arena[at.drive.torque] = produced(arena, &at.drive, motion[PUSHES])
    arena[at.drive.enabled] = (arena + at.drive.state)[RUNNING]
    return OK


cdef int drive_encode_(double *arena, const Board *at, const Board *sizes, Frame *frames) noexcept nogil:
    """Send the reports that are due, with the present state."""
    cdef double *motion = arena + at.motion
    cdef double *scales = arena + at.scales
    cdef double temperature = arena[at.drive.temperature]
    cdef uint8_t data[8]
    cdef double *answer
    cdef int index
    if not answerable(arena, &at.drive) or not isfinite(temperature):
        return -NOT_FINITE      # no reply with the state of a diverged plant
    wire.put_word(&data[0], seen_position(arena, &at.drive) / scales[0])
    wire.put_word(&data[2], seen_velocity(arena, &at.drive) / scales[1])
    wire.put_word(&data[4], 100.0 * motion[PUSHES] / scales[2])
    data[6] = <uint8_t><int>(127.0 if temperature > 127.0 else temperature if temperature > -128.0 else -128.0)
    data[7] = error_code(arena, at)
    if data[7] == 0 and motion[ECHOES] != 0.0:
        data[7] = wire.DISABLED
    for index in range(<int>(arena + at.drive.outbox)[1]):
        answer = unwritten(arena, &at.drive, index)
        if answer != NULL:
            answer[1], answer[2] = <uint32_t>EXTENDED | wire.STATUS << 8 | own_id(arena, &at.drive), 8.0
            memcpy(&answer[3], data, 8)
            motion[ECHOES] = 0.0
    return deliver(arena, &at.drive, frames)


drive = export(<kernel_t>drive_kernel, BOARD)
drive_decode = export_decode(<decode_t>drive_decode_, BOARD)
drive_encode = export_encode(<encode_t>drive_encode_, BOARD)
