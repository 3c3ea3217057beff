# cython: freethreading_compatible=True
"""CubeMars boards that are not there, as far as they speak in extended frames: force control of V3.0, and the servo mode of all of them.

    0 duty int32 x 1e-5 · 1 current int32 mA · 2 braking current int32 mA · 3 speed int32, electrical revolutions a minute
    4 position int32 x 1e-4° · 5 origin, one byte · 6 position as 4, speed int16 x 10, acceleration int16 x 10 a second
    8 force control, V3.0 alone, cext/kernels/devices/cubemars/v3.pyx · 15 disable, V3.0 alone

They report by themselves at a rate, or once to each command where that is 0. The gains of the loops of speed and position are ours.
"""

from libc.math cimport isfinite
from libc.stdint cimport int16_t, int32_t, uint8_t, uint32_t
from libc.string cimport memcpy, memset

from cext.abi cimport DT, EXTENDED, FOREIGN, ID_MASK, MALFORMED, NOT_FINITE, OK, TAKEN, TIME, Frame, export, export_decode, export_encode
cimport cext.kernels.devices.cubemars.status as wire
from cext.kernels.devices.drives cimport (
    CAN_ID, COMMAND, ENABLED, FAULT, FIRST_OWN, GEAR_RATIO, OUTBOX, OWN, PEAK, POWER_LOST, RUNNING, STATE, TEMPERATURE, TORQUE,
    TRIP_TEMPERATURE, WIRE, ZERO, answerable, deliver, forget, kept, law, look, owe, own_id, seen_position, seen_velocity,
    turned, unreachable, unwritten, within,
)
from cext.kernels.devices.fields cimport from_code
from cext.kernels.devices.mit cimport all_ones

cdef enum:
    REPORT_RATE = FIRST_OWN     # parameter
    TOO_HOT = 1                 # error code

cdef enum: # memory behind that of every drive
    SCALES = OWN               # rad and rad/s of a code of the status, N·m of an ampere, at the joint
    BOARD                       # whether it knows force control, whether that needs to be entered
    MOTION                      # as the enum below

cdef enum: # in MOTION, the way the motor turns
    KIND                        # of the command it obeys, below 0 for none
    TARGET                      # of that, in SI units at the joint
    FASTEST                     # rad/s, on the way to a position; 0 for no limit
    HARDEST                     # rad/s², likewise
    REFERENCE                   # rad/s, where the loop of speed is
    PUSHES                      # N·m, its torque of now
    NEXT_REPORT                 # s
    ECHOES                      # whether its next status answers a disable
    WAS_DEAD                    # without power, in the step before

cdef double POSITION_GAIN = 20.0                # 1/s
cdef double VELOCITY_GAIN = 5.0                 # N·m·s/rad
cdef double RADIAN = 0.017453292519943295       # of a degree


cdef inline int length_of(uint32_t kind, bint knows_force) noexcept nogil:
    """Data bytes of a command; -1 where there is no such command."""
    if kind <= wire.POSITION:
        return 4
    if kind == wire.ORIGIN:
        return 1
    if kind == wire.POSITION_SPEED:
        return 8
    if knows_force and kind == wire.FORCE:
        return 8
    return 0 if knows_force and kind == wire.DISABLE else -1


cdef void release(double *arena, const int32_t *slots) noexcept nogil:
    cdef double *motion = kept(arena, slots, MOTION)
    kept(arena, slots, STATE)[RUNNING] = 0.0
    motion[KIND], motion[PUSHES], motion[REFERENCE] = -1.0, 0.0, 0.0


cdef void take_force(double *arena, const int32_t *slots, const uint8_t *data) noexcept nogil:
    cdef double *half = kept(arena, slots, WIRE)
    cdef double *command = kept(arena, slots, COMMAND)
    cdef double *motion = kept(arena, slots, MOTION)
    if kept(arena, slots, BOARD)[1] != 0.0:
        if all_ones(data, 7) and data[7] == 0xFC:
            kept(arena, slots, STATE)[RUNNING] = 1.0
            return
        if kept(arena, slots, STATE)[RUNNING] == 0.0:
            return
    command[2] = from_code(<uint32_t>data[0] << 4 | data[1] >> 4, 0.0, half[2], 12)
    command[3] = from_code((<uint32_t>data[1] & 15) << 8 | data[2], 0.0, half[3], 12)
    command[0] = from_code(<uint32_t>data[3] << 8 | data[4], -half[0], half[0], 16)
    command[1] = from_code(<uint32_t>data[5] << 4 | data[6] >> 4, -half[1], half[1], 12)
    command[4] = from_code((<uint32_t>data[6] & 15) << 8 | data[7], -half[4], half[4], 12)
    motion[KIND] = wire.FORCE
    kept(arena, slots, STATE)[RUNNING] = 1.0


cdef void take(double *arena, const int32_t *slots, uint32_t kind, const uint8_t *data) noexcept nogil:
    """A command of servo mode."""
    cdef double *motion = kept(arena, slots, MOTION)
    cdef double *scales = kept(arena, slots, SCALES)
    cdef double value = wire.get_long(data)
    if motion[KIND] != kind:
        motion[REFERENCE] = seen_velocity(arena, slots)
    motion[KIND], motion[FASTEST], motion[HARDEST] = kind, 0.0, 0.0
    kept(arena, slots, STATE)[RUNNING] = 1.0
    if kind == wire.DUTY:
        motion[TARGET] = within(1e-5 * value, 1.0)
    elif kind == wire.CURRENT or kind == wire.BRAKE:
        motion[TARGET] = 1e-3 * value * scales[2]
    elif kind == wire.SPEED:
        motion[TARGET] = 0.1 * value * scales[1]
    else:
        motion[TARGET] = 1e-4 * RADIAN * value / arena[slots[GEAR_RATIO]]
        if kind == wire.POSITION_SPEED:
            motion[FASTEST] = wire.word(&data[4]) * scales[1]
            motion[HARDEST] = wire.word(&data[6]) * scales[1]


cdef int drive_decode_(double *arena, const int32_t *slots, const int32_t *sizes, const Frame *frame) noexcept nogil:
    cdef uint32_t kind = (frame.id & <uint32_t>ID_MASK) >> 8
    cdef int length
    if (frame.id & ~<uint32_t>ID_MASK) != EXTENDED or (frame.id & 0xFF) != <uint32_t>arena[slots[CAN_ID]]:
        return FOREIGN
    length = length_of(kind, kept(arena, slots, BOARD)[0] != 0.0)
    if length < 0:
        return FOREIGN
    if frame.length != length:
        return MALFORMED
    if unreachable(arena, slots):
        return TAKEN
    if kind == wire.DISABLE:
        release(arena, slots)
        kept(arena, slots, MOTION)[ECHOES] = 1.0
    elif kind == wire.ORIGIN:
        kept(arena, slots, STATE)[ZERO] += seen_position(arena, slots)
    elif kind == wire.FORCE:
        take_force(arena, slots, frame.data)
    else:
        take(arena, slots, kind, frame.data)
    if arena[slots[REPORT_RATE]] == 0.0:
        owe(arena, slots, 0, 0, NULL)
    return TAKEN


cdef inline uint8_t error_code(double *arena, const int32_t *slots) noexcept nogil:
    if arena[slots[FAULT]] != 0.0:
        return <uint8_t>arena[slots[FAULT]]
    return TOO_HOT if arena[slots[TEMPERATURE]] >= arena[slots[TRIP_TEMPERATURE]] else 0


cdef double servo_torque(double *arena, const int32_t *slots, double *motion) noexcept nogil:
    """N·m at the joint, of what it was last told; moves the reference of its loop of speed on."""
    cdef double velocity = seen_velocity(arena, slots)
    cdef double peak = arena[slots[PEAK]]
    cdef double wanted = motion[TARGET]
    cdef double step
    if motion[KIND] == wire.CURRENT:
        return wanted
    if motion[KIND] == wire.BRAKE:
        return within(-VELOCITY_GAIN * velocity, wanted if wanted > 0.0 else 0.0)
    if motion[KIND] == wire.DUTY:               # a voltage: the torque goes down as the speed goes up to its share of that without a load
        return peak * (wanted - velocity / kept(arena, slots, WIRE)[1])
    if motion[KIND] != wire.SPEED:
        wanted = POSITION_GAIN * (wanted - seen_position(arena, slots))
        if motion[KIND] == wire.POSITION_SPEED:
            wanted = within(wanted, motion[FASTEST])
            step = motion[HARDEST] * arena[DT]
            wanted = motion[REFERENCE] + within(wanted - motion[REFERENCE], step)
    motion[REFERENCE] = wanted
    return VELOCITY_GAIN * (wanted - velocity)


cdef int drive_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    cdef double *motion = kept(arena, slots, MOTION)
    cdef double rate = arena[slots[REPORT_RATE]]
    cdef uint8_t powered[8]
    look(arena, slots)
    if arena[slots[POWER_LOST]] != 0.0:
        forget(arena, slots)
        release(arena, slots)
        motion[WAS_DEAD] = 1.0
    elif motion[WAS_DEAD] != 0.0:
        motion[WAS_DEAD] = 0.0
        memset(powered, 0, 8)
        powered[0], powered[1], powered[2], powered[3] = 0xFA, 0xFB, 0xFC, 0xFD
        owe(arena, slots, <uint32_t>EXTENDED | wire.POWER_UP << 8 | own_id(arena, slots), 4, powered)
    motion[PUSHES] = 0.0
    if motion[KIND] >= 0.0 and error_code(arena, slots) == 0:
        motion[PUSHES] = within(law(arena, slots) if motion[KIND] == wire.FORCE else servo_torque(arena, slots, motion), arena[slots[PEAK]])
    if rate > 0.0 and arena[TIME] + 1e-9 >= motion[NEXT_REPORT]:
        motion[NEXT_REPORT] += 1.0 / rate
        if motion[NEXT_REPORT] <= arena[TIME] + 1e-9:
            motion[NEXT_REPORT] = arena[TIME] + 1.0 / rate
        owe(arena, slots, 0, 0, NULL)
    arena[slots[TORQUE]] = turned(arena, slots, motion[PUSHES])
    arena[slots[ENABLED]] = kept(arena, slots, STATE)[RUNNING]
    return OK


cdef int drive_encode_(double *arena, const int32_t *slots, const int32_t *sizes, Frame *frames) noexcept nogil:
    """The reports that are due, with the state of now."""
    cdef double *motion = kept(arena, slots, MOTION)
    cdef double *scales = kept(arena, slots, SCALES)
    cdef double temperature = arena[slots[TEMPERATURE]]
    cdef uint8_t data[8]
    cdef double *answer
    cdef int index
    if not answerable(arena, slots) or not isfinite(temperature):
        return -NOT_FINITE      # a plant that has blown up has no answer
    wire.put_word(&data[0], seen_position(arena, slots) / scales[0])
    wire.put_word(&data[2], seen_velocity(arena, slots) / scales[1])
    wire.put_word(&data[4], 100.0 * motion[PUSHES] / scales[2])
    data[6] = <uint8_t><int>(127.0 if temperature > 127.0 else temperature if temperature > -128.0 else -128.0)
    data[7] = error_code(arena, slots)
    if data[7] == 0 and motion[ECHOES] != 0.0:
        data[7] = wire.DISABLED
    for index in range(<int>kept(arena, slots, OUTBOX)[1]):
        answer = unwritten(arena, slots, index)
        if answer != NULL:
            answer[1], answer[2] = <uint32_t>EXTENDED | wire.STATUS << 8 | own_id(arena, slots), 8.0
            memcpy(&answer[3], data, 8)
            motion[ECHOES] = 0.0
    return deliver(arena, slots, frames)


drive = export(drive_kernel)
drive_decode = export_decode(drive_decode_)
drive_encode = export_encode(drive_encode_)
