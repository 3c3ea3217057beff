from libc.stdint cimport int64_t, uint64_t

from cext.safety.motion_watch cimport Motion
from cext.memory.shared_state cimport SharedLayout

cdef enum:
    BUCKETS = 65                     # buckets of a window, and the current one

cdef enum: # action when the RMS torque exceeds the rated torque
    SILENT_MODE
    WARN
    SATURATE
    THROTTLE
    DISABLE

cdef enum: # events, each reported once a run
    RMS_EVENT
    WARM_EVENT
    DERATED_EVENT
    ACCELERATION_EVENT
    TRANSIT_EVENT
    END_EVENT
    EVENT_KINDS

cdef struct Watched:
    int device                       # index
    int torque                       # slots
    int temperature                  # -1: not reported
    int rms
    int law_limit                         # slot of the kernel's torque limit; -1: none
    double full                      # full limit
    double left                      # fraction of it in the last tick
    int64_t reply_time               # ns, time of the newest reply
    double transit                   # s, from the command to it
    bint late                        # transits exceed what stiffness and damping allow for
    bint replied                     # it has replied in this run
    bint out                         # it is taken out of the run: of its motion nothing is checked
    bint stays_out                   # long enough that it must not produce torque
    bint off                         # its motion is not checked, and its checks start again afterwards
    Motion motion
    int mode
    double rated, limit              # N·m
    double power                     # W, largest product of the remaining limit and the speed
    double window                    # s
    double warm, derate, hot         # °C
    double squares[BUCKETS]          # N²·m²·s
    double filled                    # s in the current bucket
    double past                      # sum of the other buckets
    int place
    double largest                   # N·m, RMS
    double hottest                   # °C
    int64_t ticks[EVENT_KINDS]        # number of ticks of each kind

cdef class DriveWatch:
    cdef Watched *drives
    cdef int count
    cdef list names, news
    cdef void **templates                 # EventTemplate, borrowed: EVENT_KINDS of each
    cdef SharedLayout *layout
    cdef int failed                  # index of the device, -1

    cdef void reset(self) noexcept nogil
    cdef uint64_t share(self, SharedLayout *layout)
    cdef int look(self, double *arena, int64_t tick, double dt) noexcept nogil
    cdef void place_motion(self, Watched *drive, steps)
    cdef int look_at(self, Watched *drive, double *arena, int64_t tick, double dt) noexcept nogil
    cdef int look_at_heat(self, Watched *drive, double *arena, double temperature, int64_t tick,
        double dt) noexcept nogil
    cdef void note(self, Watched *drive, int kind, int64_t tick) noexcept nogil
