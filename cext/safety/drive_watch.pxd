from libc.stdint cimport int64_t, uint64_t

from cext.safety.motion_watch cimport Motion
from cext.safety.shared_state cimport PageLayout

cdef enum:
    BUCKETS = 65                     # of a window, and one more that is being filled

cdef enum: # what happens where the RMS torque passes the rated one
    SILENT_MODE
    WARN
    SATURATE
    THROTTLE
    DISABLE

cdef enum: # what is told of, once a run each
    RMS_NEWS
    WARM_NEWS
    DERATED_NEWS
    ACCELERATION_NEWS
    NEWS_KINDS

cdef struct Watched:
    int device                       # index
    int torque                       # slots
    int temperature                  # -1: the drive reports none
    int rms
    int felt                         # where the kernel finds what is left of its limit; -1: nowhere
    double full                      # what is there when nothing is taken
    double left                      # share of it that was left in the last tick
    int64_t heard                    # ns, of the newest reply
    Motion motion
    int mode
    double rated, limit              # N·m
    double window                    # s
    double warm, derate, hot         # °C
    double squares[BUCKETS]          # N²·m²·s
    double filled                    # s in the bucket that is being filled
    double past                      # sum of the others
    int place
    double largest                   # N·m, RMS
    double hottest                   # °C
    int64_t ticks[NEWS_KINDS]        # in which each was so

cdef class DriveWatch:
    cdef Watched *drives
    cdef int count
    cdef list names, news
    cdef void **told                 # News, borrowed: NEWS_KINDS of each
    cdef PageLayout *page
    cdef int failed                  # index of the device, -1

    cdef void reset(self) noexcept nogil
    cdef uint64_t share(self, PageLayout *page)
    cdef int look(self, double *arena, int64_t tick, double dt) noexcept nogil
    cdef void place_motion(self, Watched *drive, steps)
    cdef int look_at(self, Watched *drive, double *arena, int64_t tick, double dt) noexcept nogil
    cdef int look_at_heat(self, Watched *drive, double *arena, double temperature, int64_t tick, double dt) noexcept nogil
    cdef void note(self, Watched *drive, int kind, int64_t tick) noexcept nogil
