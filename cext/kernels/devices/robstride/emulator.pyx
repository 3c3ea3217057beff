# cython: freethreading_compatible=True
"""Emulated RobStride drive: receives the private protocol, closes the control loops, and replies.

Laws at the motor: operation control  kp (p_des - p) + kd (v_des - v) + t, limited by limit_torque;
position, CSP  spd_kp (loc_kp (loc_ref - p), limited by limit_spd or vel_max - v) A;  velocity  spd_kp (spd_ref - v) A;
current  iq_ref A; the first three limited by limit_cur. Accelerations are stored and have no effect.
"""

from libc.math cimport isfinite
from libc.stdint cimport int16_t, int32_t, uint8_t, uint32_t
from libc.string cimport memcpy, memset

from cext.abi cimport (
    EXTENDED, FOREIGN, ID_MASK, ITEMS, MALFORMED, NOT_FINITE, OK, TAKEN, TIME, Frame, decode_t, encode_t, export,
    export_decode, export_encode, items, kernel_t,
)
from cext.conversion cimport to_u32
from cext.kernels.devices.drives cimport (
    LAST_COMMAND, RUNNING, Drive, answerable, deliver, drive_sizes, forget, law, look, owe, own_id, produced,
    seen_position, seen_velocity, set_zero, strayed, unreachable, unwritten, within,
)
from cext.kernels.devices.fields cimport from_code, to_code

cdef enum: # in `memory_of_drive`
    HOST                        # id of the host that sent last
    LATCHED                     # faults of type 2 until they are cleared
    REPORTED                    # faults of type 21 that have been reported
    REPORTING                   # whether it reports periodically
    NEXT_REPORT                 # s
    TORQUE_CONSTANT             # N·m/A at the motor
    TIMEOUT_SCALE               # of the canTimeout

cdef enum: # parameters
    RUN_MODE = 0x05, IQ_REF, SPD_REF = 0x0A, LIMIT_TORQUE, LOC_REF = 0x16, LIMIT_SPD, LIMIT_CUR, MECH_POS, IQF,
    MECH_VEL, VBUS, ROTATION
    LOC_KP, SPD_KP, VEL_MAX = 0x24, EPSCAN_TIME = 0x26, CAN_TIMEOUT = 0x28, ZERO_STA

cdef enum: # values of RUN_MODE
    OPERATION, PP, SPEED, CURRENT, CSP = 5

cdef enum:
    FIRMWARE = 8                # in `identity`
    CYBERGEAR = 13
    HIGHEST_ID = 127
    NEWCOMER = 0xFE             # target of the reply with its unique number

cdef enum:
    FAULTS = 63
    WORD = 256                  # start of the 32 bits of type 21 in the input
    HOT = 4                     # bit of FAULTS


cdef inline uint32_t u16(const uint8_t *data) noexcept nogil:
    return <uint32_t>data[0] << 8 | data[1]


cdef inline uint32_t little(const uint8_t *data) noexcept nogil:
    return <uint32_t>data[3] << 24 | data[2] << 16 | data[1] << 8 | data[0]


cdef inline void put_little(uint8_t *data, uint32_t value) noexcept nogil:
    cdef int i
    for i in range(4):
        data[i] = <uint8_t>(value >> 8 * i)


cdef inline bint whole(uint32_t index) noexcept nogil:
    return index == RUN_MODE or index == EPSCAN_TIME or index == CAN_TIMEOUT or index == ZERO_STA


cdef struct RobStride:
    Drive drive
    int32_t registers           # values of the parameters 0x7000 to 0x703F
    int32_t defaults            # the same after power-on
    int32_t memory_of_drive     # the enum above
    int32_t ignored             # whether writes have no effect, for each parameter
    int32_t identity            # eight bytes of its unique number, five of its firmware, whether it is a CyberGear

ROB_STRIDE = items(
    (<RobStride *>ITEMS)[0],
    drive_sizes() + " registers[64] defaults[64] memory_of_drive[7] ignored[64] identity[14]")


cdef double motor_torque(double *arena, const RobStride *at) noexcept nogil:
    """Return the torque, N·m at the joint, in the motor's direction."""
    cdef double *registers = arena + at.registers
    cdef double *memory = arena + at.memory_of_drive
    cdef double gear = arena[at.drive.gear_ratio]
    cdef double peak = arena[at.drive.peak]
    cdef double velocity = gear * seen_velocity(arena, &at.drive)
    cdef double mode = registers[RUN_MODE]
    cdef double current, most
    if (arena + at.drive.state)[RUNNING] == 0.0:
        return strayed(arena, &at.drive, 0.0)
    most = registers[LIMIT_TORQUE] * gear
    if not most < peak:
        most = peak
    if mode == OPERATION:
        return strayed(arena, &at.drive, within(law(arena, &at.drive), most))
    if mode == CURRENT:
        return strayed(arena, &at.drive, within(gear * memory[TORQUE_CONSTANT] * registers[IQ_REF], most))
    current = registers[SPD_REF]
    if mode == PP or mode == CSP:
        current = within(registers[LOC_KP] * (registers[LOC_REF] - gear * seen_position(arena, &at.drive)),
                         registers[VEL_MAX] if mode == PP and registers[VEL_MAX] > 0.0 else registers[LIMIT_SPD])
    current = within(registers[SPD_KP] * (current - velocity), registers[LIMIT_CUR])
    return strayed(arena, &at.drive, within(gear * memory[TORQUE_CONSTANT] * current, most))


cdef void stop(double *arena, const RobStride *at) noexcept nogil:
    (arena + at.drive.state)[RUNNING] = 0.0
    memset(arena + at.drive.command, 0, 5 * sizeof(double))


cdef void start(double *arena, const RobStride *at) noexcept nogil:
    """Command the present position at standstill."""
    cdef double *registers = arena + at.registers
    if (arena + at.drive.state)[RUNNING] != 0.0 or (arena + at.memory_of_drive)[LATCHED] != 0.0:
        return
    registers[IQ_REF] = registers[SPD_REF] = 0.0
    registers[LOC_REF] = arena[at.drive.gear_ratio] * seen_position(arena, &at.drive)
    (arena + at.drive.state)[RUNNING] = 1.0


cdef void read(double *arena, const RobStride *at, uint32_t host, uint32_t index) noexcept nogil:
    """Queue the reply of type 17, without delay."""
    cdef double *registers = arena + at.registers
    cdef double gear = arena[at.drive.gear_ratio]
    cdef uint32_t place = index & 63
    cdef bint known = index >> 6 == 0x7000 >> 6
    cdef uint8_t data[8]
    cdef float single = 0.0
    cdef uint32_t bits = 0
    if known:
        single = <float>registers[place]
        if place == MECH_POS or place == MECH_VEL:      # filled in at the end of the step, as the state
            owe(arena, &at.drive, index << 8 | host, 0, NULL)
            return
        if place == IQF:
            single = <float>(motor_torque(arena, at) / gear / (arena + at.memory_of_drive)[TORQUE_CONSTANT])
    if whole(place):
        bits = to_u32(registers[place])
    else:
        memcpy(&bits, &single, 4)
    data[0] = <uint8_t>index
    data[1] = <uint8_t>(index >> 8)
    data[2] = data[3] = 0
    put_little(&data[4], bits if known else 0)
    owe(arena, &at.drive, <uint32_t>EXTENDED | 17 << 24 | (0 if known else 1) << 16 | own_id(arena, &at.drive) << 8
        | host, 8, data)


cdef void write(double *arena, const RobStride *at, const uint8_t *data) noexcept nogil:
    """Write a parameter to RAM. Measured values, the mode while running, and NaN are rejected."""
    cdef uint32_t index = <uint32_t>data[1] << 8 | data[0]
    cdef uint32_t place = index & 63
    cdef uint32_t bits = little(&data[4])
    cdef uint32_t most
    cdef float single
    if index >> 6 != 0x7000 >> 6 or MECH_POS <= place <= ROTATION or (arena + at.ignored)[place] != 0.0:
        return
    if place == RUN_MODE and ((arena + at.drive.state)[RUNNING] != 0.0 or data[4] > CSP or data[4] == 4):
        return
    if whole(place):
        most = 100000 if place == CAN_TIMEOUT else 0xFFFF if place == EPSCAN_TIME else 0xFF
        (arena + at.registers)[place] = bits if bits < most else most
        return
    memcpy(&single, &bits, 4)
    if isfinite(single):
        (arena + at.registers)[place] = single


cdef void tell_identity(double *arena, const RobStride *at) noexcept nogil:
    """Queue the reply to get id and set id, without delay."""
    cdef double *identity = arena + at.identity
    cdef uint8_t data[8]
    cdef int i
    for i in range(8):
        data[i] = <uint8_t>identity[i]
    owe(arena, &at.drive, <uint32_t>EXTENDED | own_id(arena, &at.drive) << 8 | NEWCOMER, 8, data)


cdef void tell_firmware(double *arena, const RobStride *at) noexcept nogil:
    """Queue the reply to a stop that requests it: feedback whose data are not a state."""
    cdef double *identity = arena + at.identity
    cdef double *memory = arena + at.memory_of_drive
    cdef uint8_t data[8]
    cdef int i
    data[0], data[1], data[2] = 0x00, 0xC4, 0x56
    for i in range(5):
        data[3 + i] = <uint8_t>identity[FIRMWARE + i]
    owe(arena, &at.drive, <uint32_t>EXTENDED | 2 << 24 | <uint32_t>memory[LATCHED] << 16
        | own_id(arena, &at.drive) << 8 | <uint32_t>memory[HOST], 8, data)


cdef void save(double *arena, const RobStride *at) noexcept nogil:
    """Keep the parameters over a power cycle, except the mode and the commands."""
    cdef double *registers = arena + at.registers
    cdef double *defaults = arena + at.defaults
    cdef int place
    for place in range(64):
        if place not in (RUN_MODE, IQ_REF, SPD_REF, LOC_REF):
            defaults[place] = registers[place]


cdef inline bint counts_up(const uint8_t *data) noexcept nogil:
    """Return whether the data are 01 02 .. 08."""
    cdef int i
    for i in range(8):
        if data[i] != i + 1:
            return False
    return True


cdef int heard_decode(double *arena, const RobStride *at, const RobStride *sizes, const Frame *frame) noexcept nogil:
    cdef double *memory = arena + at.memory_of_drive
    cdef double *wire = arena + at.drive.wire
    cdef double *command = arena + at.drive.command
    cdef const uint8_t *data = &frame.data[0]
    cdef uint32_t type = frame.id >> 24 & 31
    cdef uint32_t field = frame.id >> 8 & 0xFFFF
    cdef bint cybergear = (arena + at.identity)[CYBERGEAR] != 0.0
    if (frame.id & ~<uint32_t>ID_MASK) != EXTENDED or (frame.id & 255) != <uint32_t>arena[at.drive.can_id]:
        return FOREIGN
    if type not in (0, 1, 3, 4, 6, 7, 17, 18, 24) and not (type == 22 and not cybergear and frame.length == 8
            and counts_up(data)):
        return FOREIGN          # type 22 changes the baud rate of a CyberGear, which is not emulated
    if frame.length != 8:
        return MALFORMED
    if unreachable(arena, &at.drive):
        return TAKEN
    (arena + at.drive.state)[LAST_COMMAND] = arena[TIME]
    if type != 1:
        memory[HOST] = field & 255
    if type == 0 or type == 7:
        if type == 7 and 0 < field >> 8 <= HIGHEST_ID:
            arena[at.drive.can_id] = field >> 8                   # at once, and permanent
        tell_identity(arena, at)
        return TAKEN
    if type == 17:
        read(arena, at, field & 255, <uint32_t>data[1] << 8 | data[0])
        return TAKEN
    if type == 24:
        memory[REPORTING] = data[6] == 1
        memory[NEXT_REPORT] = arena[TIME]
        return TAKEN            # the reply is the first report
    if type == 1 and (arena + at.drive.state)[RUNNING] != 0.0:
        command[0] = from_code(u16(&data[0]), -wire[0], wire[0], 16)
        command[1] = from_code(u16(&data[2]), -wire[1], wire[1], 16)
        command[2] = from_code(u16(&data[4]), 0.0, wire[2], 16)
        command[3] = from_code(u16(&data[6]), 0.0, wire[3], 16)
        command[4] = from_code(field, -wire[4], wire[4], 16)
    elif type == 3:
        start(arena, at)
    elif type == 4:
        stop(arena, at)
        if data[0] == 1:
            memory[LATCHED] = 0.0
        if data[0] == 0 and data[1] == 0xC4 and not cybergear:
            tell_firmware(arena, at)
            return TAKEN
    elif type == 6 and data[0] == 1:
        if set_zero(arena, &at.drive):
            return TAKEN
    elif type == 18:
        write(arena, at, data)
    elif type == 22:
        save(arena, at)
    owe(arena, &at.drive, 0, 0, NULL)
    return TAKEN


cdef int drive_kernel(double *arena, const RobStride *at, const RobStride *sizes) noexcept nogil:
    cdef double *state = arena + at.drive.state
    cdef double *registers = arena + at.registers
    cdef double *memory = arena + at.memory_of_drive
    cdef double fault = arena[at.drive.fault]
    cdef double timeout = registers[CAN_TIMEOUT] / 20000.0 * memory[TIMEOUT_SCALE]
    look(arena, &at.drive)
    if arena[at.drive.power_lost] != 0.0:
        forget(arena, &at.drive)
        memcpy(registers, arena + at.defaults, 64 * sizeof(double))
        memory[LATCHED] = memory[REPORTED] = memory[REPORTING] = 0.0
    memory[LATCHED] = <int>memory[LATCHED] | <int>(to_u32(fault) & FAULTS) | (
        HOT if arena[at.drive.temperature] >= arena[at.drive.trip_temperature] else 0)
    if memory[LATCHED] != 0.0 or fault >= WORD:
        stop(arena, at)
    if timeout > 0.0 and state[RUNNING] != 0.0 and arena[TIME] - state[LAST_COMMAND] > timeout:
        stop(arena, at)
    arena[at.drive.torque] = produced(arena, &at.drive, motor_torque(arena, at))
    arena[at.drive.enabled] = state[RUNNING]
    return OK


cdef void unasked(double *arena, const RobStride *at) noexcept nogil:
    """Queue new faults of type 21, and reports of type 24 that are due."""
    cdef double *memory = arena + at.memory_of_drive
    cdef double word = <double>to_u32(arena[at.drive.fault] / WORD)
    cdef double scan = (arena + at.registers)[EPSCAN_TIME]
    cdef uint8_t data[8]
    if arena[at.drive.power_lost] != 0.0:
        return
    if word != memory[REPORTED]:
        memory[REPORTED] = word
        memset(data, 0, 8)
        put_little(data, <uint32_t>word)
        owe(arena, &at.drive, <uint32_t>EXTENDED | 21 << 24 | own_id(arena, &at.drive) << 8 | <uint32_t>memory[HOST],
            8, data)
    if memory[REPORTING] != 0.0 and arena[TIME] + 1e-9 >= memory[NEXT_REPORT]:
        memory[NEXT_REPORT] += 0.01 + 0.005 * (scan - 1.0 if scan > 1.0 else 0.0)
        owe(arena, &at.drive, 24, 0, NULL)


cdef void measured(double *arena, const RobStride *at, uint32_t asked, uint8_t *data) noexcept nogil:
    """Write the reply to a read of mechPos or mechVel. asked : index << 8 | host"""
    cdef float single = <float>(arena[at.drive.gear_ratio] * (
        seen_position(arena, &at.drive) if asked >> 8 & 63 == MECH_POS else seen_velocity(arena, &at.drive)))
    memset(data, 0, 8)
    data[0], data[1] = <uint8_t>(asked >> 8), <uint8_t>(asked >> 16)
    memcpy(&data[4], &single, 4)


cdef int answer_encode(double *arena, const RobStride *at, const RobStride *sizes, Frame *frames) noexcept nogil:
    cdef double *wire = arena + at.drive.wire
    cdef double *memory = arena + at.memory_of_drive
    cdef double raw = arena[at.drive.temperature] * 10.0
    cdef uint32_t codes[4]
    cdef uint32_t mode = 2 if (arena + at.drive.state)[RUNNING] != 0.0 else 0
    cdef uint8_t data[8]
    cdef uint8_t value[8]
    cdef double *answer
    cdef int index, i
    if not answerable(arena, &at.drive):
        return -NOT_FINITE
    unasked(arena, at)
    codes[0] = to_code(seen_position(arena, &at.drive), -wire[0], wire[0], 16)
    codes[1] = to_code(seen_velocity(arena, &at.drive), -wire[1], wire[1], 16)
    codes[2] = to_code(motor_torque(arena, at), -wire[4], wire[4], 16)
    codes[3] = <uint32_t><int16_t>(32767.0 if raw > 32767.0 else raw if raw > -32768.0 else -32768.0)
    for i in range(4):
        data[2 * i] = <uint8_t>(codes[i] >> 8)
        data[2 * i + 1] = <uint8_t>codes[i]
    for index in range(<int>(arena + at.drive.outbox)[1]):
        answer = unwritten(arena, &at.drive, index)
        if answer != NULL and answer[1] >= 0x10000:
            measured(arena, at, <uint32_t>answer[1], value)
            answer[1] = (<uint32_t>EXTENDED | 17 << 24 | own_id(arena, &at.drive) << 8 | (<uint32_t>answer[1] & 255))
            answer[2] = 8
            memcpy(&answer[3], value, 8)
        elif answer != NULL:
            answer[1] = (<uint32_t>EXTENDED | (24 if answer[1] == 24.0 else 2) << 24 | mode << 22
                | <uint32_t>memory[LATCHED] << 16
                         | own_id(arena, &at.drive) << 8 | <uint32_t>memory[HOST])
            answer[2] = 8
            memcpy(&answer[3], data, 8)
    return deliver(arena, &at.drive, frames)


drive = export(<kernel_t>drive_kernel, ROB_STRIDE)
drive_decode = export_decode(<decode_t>heard_decode, ROB_STRIDE)
drive_encode = export_encode(<encode_t>answer_encode, ROB_STRIDE)
