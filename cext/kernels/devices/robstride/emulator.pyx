# cython: freethreading_compatible=True
"""A RobStride drive that is not there: it hears the private protocol, closes its loops, and answers.

Its laws, at the motor: operation control  kp (p_des - p) + kd (v_des - v) + t, no further than limit_torque;
position, CSP  spd_kp (loc_kp (loc_ref - p), no faster than limit_spd or vel_max - v) A;  velocity  spd_kp (spd_ref - v) A;
current  iq_ref A; the first three no further than limit_cur. Accelerations are kept and have no effect.
"""

from libc.math cimport isfinite
from libc.stdint cimport int16_t, int32_t, uint8_t, uint32_t
from libc.string cimport memcpy, memset

from cext.abi cimport EXTENDED, FOREIGN, ID_MASK, MALFORMED, NOT_FINITE, OK, TAKEN, TIME, Frame, export, export_decode, export_encode
from cext.kernels.devices.drives cimport (
    CAN_ID, COMMAND, ENABLED, FAULT, GEAR_RATIO, HEARD, OUTBOX, OWN, PEAK, POWER_LOST, RUNNING, STATE, TEMPERATURE, TORQUE,
    TRIP_TEMPERATURE, WIRE, ZERO, answerable, deliver, forget, kept, law, look, owe, own_id, seen_position, seen_velocity, turned,
    unreachable, unwritten, within,
)
from cext.kernels.devices.fields cimport from_code, to_code

cdef enum: # memory behind that of every drive
    REGISTERS = OWN            # values of the parameters 0x7000 to 0x703F
    DEFAULTS                    # the same after power on
    MEMORY                      # as the enum below
    IDENTITY                    # eight bytes of its unique number, five of its firmware, whether it is a CyberGear

cdef enum: # in MEMORY
    HOST                        # who spoke last
    LATCHED                     # faults of type 2 until they are cleared
    REPORTED                    # faults of type 21 that have been reported
    REPORTING                   # whether it answers without being asked
    NEXT_REPORT                 # s
    TORQUE_CONSTANT             # N·m/A at the motor

cdef enum: # parameters
    RUN_MODE = 0x05, IQ_REF, SPD_REF = 0x0A, LIMIT_TORQUE, LOC_REF = 0x16, LIMIT_SPD, LIMIT_CUR, MECH_POS, IQF, MECH_VEL, VBUS, ROTATION
    LOC_KP, SPD_KP, VEL_MAX = 0x24, EPSCAN_TIME = 0x26, CAN_TIMEOUT = 0x28, ZERO_STA

cdef enum: # values of RUN_MODE
    OPERATION, PP, SPEED, CURRENT, CSP = 5

cdef enum:
    FIRMWARE = 8                # in IDENTITY
    CYBERGEAR = 13
    HIGHEST_ID = 127
    NEWCOMER = 0xFE             # target of the answer that has its unique number

cdef enum:
    FAULTS = 63
    WORD = 256                  # where the 32 bits of type 21 begin in the input
    HOT = 4                     # of FAULTS


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


cdef double motor_torque(double *arena, const int32_t *slots) noexcept nogil:
    """N·m at the joint, the way the motor turns."""
    cdef double *registers = kept(arena, slots, REGISTERS)
    cdef double *memory = kept(arena, slots, MEMORY)
    cdef double gear = arena[slots[GEAR_RATIO]]
    cdef double peak = arena[slots[PEAK]]
    cdef double velocity = gear * seen_velocity(arena, slots)
    cdef double mode = registers[RUN_MODE]
    cdef double current, most
    if kept(arena, slots, STATE)[RUNNING] == 0.0:
        return 0.0
    most = registers[LIMIT_TORQUE] * gear
    if not most < peak:
        most = peak
    if mode == OPERATION:
        return within(law(arena, slots), most)
    if mode == CURRENT:
        return within(gear * memory[TORQUE_CONSTANT] * registers[IQ_REF], most)
    current = registers[SPD_REF]
    if mode == PP or mode == CSP:
        current = within(registers[LOC_KP] * (registers[LOC_REF] - gear * seen_position(arena, slots)),
                         registers[VEL_MAX] if mode == PP and registers[VEL_MAX] > 0.0 else registers[LIMIT_SPD])
    current = within(registers[SPD_KP] * (current - velocity), registers[LIMIT_CUR])
    return within(gear * memory[TORQUE_CONSTANT] * current, most)


cdef void stop(double *arena, const int32_t *slots) noexcept nogil:
    kept(arena, slots, STATE)[RUNNING] = 0.0
    memset(kept(arena, slots, COMMAND), 0, 5 * sizeof(double))


cdef void start(double *arena, const int32_t *slots) noexcept nogil:
    """Where it is, and still."""
    cdef double *registers = kept(arena, slots, REGISTERS)
    if kept(arena, slots, STATE)[RUNNING] != 0.0 or kept(arena, slots, MEMORY)[LATCHED] != 0.0:
        return
    registers[IQ_REF] = registers[SPD_REF] = 0.0
    registers[LOC_REF] = arena[slots[GEAR_RATIO]] * seen_position(arena, slots)
    kept(arena, slots, STATE)[RUNNING] = 1.0


cdef void read(double *arena, const int32_t *slots, uint32_t host, uint32_t index) noexcept nogil:
    """The answer of type 17, at once."""
    cdef double *registers = kept(arena, slots, REGISTERS)
    cdef double gear = arena[slots[GEAR_RATIO]]
    cdef uint32_t place = index & 63
    cdef bint known = index >> 6 == 0x7000 >> 6
    cdef uint8_t data[8]
    cdef float single = 0.0
    cdef uint32_t bits = 0
    if known:
        single = <float>registers[place]
        if place == MECH_POS:
            single = <float>(gear * seen_position(arena, slots))
        elif place == MECH_VEL:
            single = <float>(gear * seen_velocity(arena, slots))
        elif place == IQF:
            single = <float>(motor_torque(arena, slots) / gear / kept(arena, slots, MEMORY)[TORQUE_CONSTANT])
    if whole(place):
        bits = <uint32_t>registers[place]
    else:
        memcpy(&bits, &single, 4)
    data[0] = <uint8_t>index
    data[1] = <uint8_t>(index >> 8)
    data[2] = data[3] = 0
    put_little(&data[4], bits if known else 0)
    owe(arena, slots, <uint32_t>EXTENDED | 17 << 24 | (0 if known else 1) << 16 | own_id(arena, slots) << 8 | host, 8, data)


cdef void write(double *arena, const int32_t *slots, const uint8_t *data) noexcept nogil:
    """RAM alone. What is measured cannot be written, the mode not while it runs; what is not a number is not taken."""
    cdef uint32_t index = <uint32_t>data[1] << 8 | data[0]
    cdef uint32_t place = index & 63
    cdef uint32_t bits = little(&data[4])
    cdef uint32_t most
    cdef float single
    if index >> 6 != 0x7000 >> 6 or MECH_POS <= place <= ROTATION:
        return
    if place == RUN_MODE and (kept(arena, slots, STATE)[RUNNING] != 0.0 or data[4] > CSP or data[4] == 4):
        return
    if whole(place):
        most = 100000 if place == CAN_TIMEOUT else 0xFFFF if place == EPSCAN_TIME else 0xFF
        kept(arena, slots, REGISTERS)[place] = bits if bits < most else most
        return
    memcpy(&single, &bits, 4)
    if isfinite(single):
        kept(arena, slots, REGISTERS)[place] = single


cdef void tell_identity(double *arena, const int32_t *slots) noexcept nogil:
    """The answer to get id and set id, at once."""
    cdef double *identity = kept(arena, slots, IDENTITY)
    cdef uint8_t data[8]
    cdef int i
    for i in range(8):
        data[i] = <uint8_t>identity[i]
    owe(arena, slots, <uint32_t>EXTENDED | own_id(arena, slots) << 8 | NEWCOMER, 8, data)


cdef void tell_firmware(double *arena, const int32_t *slots) noexcept nogil:
    """The answer to a stop that asks for it: feedback whose data are no state."""
    cdef double *identity = kept(arena, slots, IDENTITY)
    cdef double *memory = kept(arena, slots, MEMORY)
    cdef uint8_t data[8]
    cdef int i
    data[0], data[1], data[2] = 0x00, 0xC4, 0x56
    for i in range(5):
        data[3 + i] = <uint8_t>identity[FIRMWARE + i]
    owe(arena, slots, <uint32_t>EXTENDED | 2 << 24 | <uint32_t>memory[LATCHED] << 16 | own_id(arena, slots) << 8 | <uint32_t>memory[HOST], 8, data)


cdef void save(double *arena, const int32_t *slots) noexcept nogil:
    """Parameters as they are come back with the power, all but the mode and what is commanded."""
    cdef double *registers = kept(arena, slots, REGISTERS)
    cdef double *defaults = kept(arena, slots, DEFAULTS)
    cdef int place
    for place in range(64):
        if place not in (RUN_MODE, IQ_REF, SPD_REF, LOC_REF):
            defaults[place] = registers[place]


cdef inline bint counts_up(const uint8_t *data) noexcept nogil:
    """01 02 .. 08."""
    cdef int i
    for i in range(8):
        if data[i] != i + 1:
            return False
    return True


cdef int heard_decode(double *arena, const int32_t *slots, const int32_t *sizes, const Frame *frame) noexcept nogil:
    cdef double *memory = kept(arena, slots, MEMORY)
    cdef double *wire = kept(arena, slots, WIRE)
    cdef double *command = kept(arena, slots, COMMAND)
    cdef const uint8_t *data = &frame.data[0]
    cdef uint32_t type = frame.id >> 24 & 31
    cdef uint32_t field = frame.id >> 8 & 0xFFFF
    cdef bint cybergear = kept(arena, slots, IDENTITY)[CYBERGEAR] != 0.0
    if (frame.id & ~<uint32_t>ID_MASK) != EXTENDED or (frame.id & 255) != <uint32_t>arena[slots[CAN_ID]]:
        return FOREIGN
    if type not in (0, 1, 3, 4, 6, 7, 17, 18, 24) and not (type == 22 and not cybergear and frame.length == 8 and counts_up(data)):
        return FOREIGN          # type 22 changes the baud rate of a CyberGear, which is not emulated
    if frame.length != 8:
        return MALFORMED
    if unreachable(arena, slots):
        return TAKEN
    kept(arena, slots, STATE)[HEARD] = arena[TIME]
    if type != 1:
        memory[HOST] = field & 255
    if type == 0 or type == 7:
        if type == 7 and 0 < field >> 8 <= HIGHEST_ID:
            arena[slots[CAN_ID]] = field >> 8                   # at once, and for good
        tell_identity(arena, slots)
        return TAKEN
    if type == 17:
        read(arena, slots, field & 255, <uint32_t>data[1] << 8 | data[0])
        return TAKEN
    if type == 24:
        memory[REPORTING] = data[6] == 1
        memory[NEXT_REPORT] = arena[TIME]
        return TAKEN            # its answer is the first report
    if type == 1 and kept(arena, slots, STATE)[RUNNING] != 0.0:
        command[0] = from_code(u16(&data[0]), -wire[0], wire[0], 16)
        command[1] = from_code(u16(&data[2]), -wire[1], wire[1], 16)
        command[2] = from_code(u16(&data[4]), 0.0, wire[2], 16)
        command[3] = from_code(u16(&data[6]), 0.0, wire[3], 16)
        command[4] = from_code(field, -wire[4], wire[4], 16)
    elif type == 3:
        start(arena, slots)
    elif type == 4:
        stop(arena, slots)
        if data[0] == 1:
            memory[LATCHED] = 0.0
        if data[0] == 0 and data[1] == 0xC4 and not cybergear:
            tell_firmware(arena, slots)
            return TAKEN
    elif type == 6 and data[0] == 1:
        kept(arena, slots, STATE)[ZERO] += seen_position(arena, slots)
    elif type == 18:
        write(arena, slots, data)
    elif type == 22:
        save(arena, slots)
    owe(arena, slots, 0, 0, NULL)
    return TAKEN


cdef int drive_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    cdef double *state = kept(arena, slots, STATE)
    cdef double *registers = kept(arena, slots, REGISTERS)
    cdef double *memory = kept(arena, slots, MEMORY)
    cdef double fault = arena[slots[FAULT]]
    cdef double patience = registers[CAN_TIMEOUT] / 20000.0
    look(arena, slots)
    if arena[slots[POWER_LOST]] != 0.0:
        forget(arena, slots)
        memcpy(registers, kept(arena, slots, DEFAULTS), 64 * sizeof(double))
        memory[LATCHED] = memory[REPORTED] = memory[REPORTING] = 0.0
    memory[LATCHED] = <int>memory[LATCHED] | (<int>fault & FAULTS if fault > 0.0 else 0) | (
        HOT if arena[slots[TEMPERATURE]] >= arena[slots[TRIP_TEMPERATURE]] else 0)
    if memory[LATCHED] != 0.0 or fault >= WORD:
        stop(arena, slots)
    if patience > 0.0 and state[RUNNING] != 0.0 and arena[TIME] - state[HEARD] > patience:
        stop(arena, slots)
    arena[slots[TORQUE]] = turned(arena, slots, motor_torque(arena, slots))
    arena[slots[ENABLED]] = state[RUNNING]
    return OK


cdef void unasked(double *arena, const int32_t *slots) noexcept nogil:
    """Faults of type 21 that are new, and reports of type 24 that are due."""
    cdef double *memory = kept(arena, slots, MEMORY)
    cdef double word = <double><uint32_t>(arena[slots[FAULT]] / WORD) if arena[slots[FAULT]] >= WORD else 0.0
    cdef double scan = kept(arena, slots, REGISTERS)[EPSCAN_TIME]
    cdef uint8_t data[8]
    if arena[slots[POWER_LOST]] != 0.0:
        return
    if word != memory[REPORTED]:
        memory[REPORTED] = word
        memset(data, 0, 8)
        put_little(data, <uint32_t>word)
        owe(arena, slots, <uint32_t>EXTENDED | 21 << 24 | own_id(arena, slots) << 8 | <uint32_t>memory[HOST], 8, data)
    if memory[REPORTING] != 0.0 and arena[TIME] + 1e-9 >= memory[NEXT_REPORT]:
        memory[NEXT_REPORT] += 0.01 + 0.005 * (scan - 1.0 if scan > 1.0 else 0.0)
        owe(arena, slots, 24, 0, NULL)


cdef int answer_encode(double *arena, const int32_t *slots, const int32_t *sizes, Frame *frames) noexcept nogil:
    cdef double *wire = kept(arena, slots, WIRE)
    cdef double *memory = kept(arena, slots, MEMORY)
    cdef double raw = arena[slots[TEMPERATURE]] * 10.0
    cdef uint32_t codes[4]
    cdef uint32_t mode = 2 if kept(arena, slots, STATE)[RUNNING] != 0.0 else 0
    cdef uint8_t data[8]
    cdef double *answer
    cdef int index, i
    if not answerable(arena, slots):
        return -NOT_FINITE
    unasked(arena, slots)
    codes[0] = to_code(seen_position(arena, slots), -wire[0], wire[0], 16)
    codes[1] = to_code(seen_velocity(arena, slots), -wire[1], wire[1], 16)
    codes[2] = to_code(motor_torque(arena, slots), -wire[4], wire[4], 16)
    codes[3] = <uint32_t><int16_t>(32767.0 if raw > 32767.0 else raw if raw > -32768.0 else -32768.0)
    for i in range(4):
        data[2 * i] = <uint8_t>(codes[i] >> 8)
        data[2 * i + 1] = <uint8_t>codes[i]
    for index in range(<int>kept(arena, slots, OUTBOX)[1]):
        answer = unwritten(arena, slots, index)
        if answer != NULL:
            answer[1] = (<uint32_t>EXTENDED | (24 if answer[1] == 24.0 else 2) << 24 | mode << 22 | <uint32_t>memory[LATCHED] << 16
                         | own_id(arena, slots) << 8 | <uint32_t>memory[HOST])
            answer[2] = 8
            memcpy(&answer[3], data, 8)
    return deliver(arena, slots, frames)


drive = export(drive_kernel)
drive_decode = export_decode(heard_decode)
drive_encode = export_encode(answer_encode)
