"""Samples of a network's channels and its outputs, in the arena of a block."""

from libc.stdint cimport int32_t
from libc.string cimport memmove

from cext.abi cimport Rest, each
from cext.kernels.limits cimport clip

cdef enum: # in `plan`
    SAMPLES = 0                     # of each channel
    TIME_FIRST = 1                  # 1: the samples of all channels at one time are contiguous; 0: those of one channel
    NEEDED = 2                      # samples until the outputs are valid
    PLAN_SIZE = 3

cdef struct Network:
    int32_t valid, age, overruns
    Rest inputs                     # channels
    Rest outputs                    # of the network
    int32_t model                   # address of the Inference
    int32_t plan
    int32_t channel_scales          # mean and standard deviation of each channel
    int32_t output_scales           # mean, standard deviation, low and high of each output
    int32_t operands                # floats: the samples, oldest first, then the states
    int32_t computed                # floats: results, then the next states
    int32_t count                   # samples so far


cdef inline void take_sample(double *arena, const Network *at, float *samples) noexcept nogil:
    """Append the present values of the channels to a window of samples, and drop the oldest.

    A value that is infinite in single precision becomes NaN: a tanh in the network would return a finite result.
    """
    cdef int length = <int>arena[at.plan + SAMPLES]
    cdef int channels = at.inputs.count
    cdef bint time_first = arena[at.plan + TIME_FIRST] != 0.0
    cdef const int32_t *channel = each(at, at.inputs)
    cdef const double *scale = arena + at.channel_scales
    cdef float value
    cdef int k
    if time_first:
        memmove(samples, samples + channels, (length - 1) * channels * sizeof(float))
    for k in range(channels):
        value = <float>((arena[channel[k]] - scale[2 * k]) / scale[2 * k + 1])
        value = value - (value - value)
        if time_first:
            samples[(length - 1) * channels + k] = value
        else:
            memmove(samples + k * length, samples + k * length + 1, (length - 1) * sizeof(float))
            samples[k * length + length - 1] = value


cdef inline void put_out(double *arena, const Network *at, const float *results, double share) noexcept nogil:
    """Set the outputs from results, towards their value nearest to 0 by 1 - share; with share 0, to that value.

    An infinite result is NaN, and NaN passes.
    """
    cdef const int32_t *output = each(at, at.outputs)
    cdef const double *scale = arena + at.output_scales
    cdef double y, neutral
    cdef int k
    for k in range(at.outputs.count):
        neutral = clip(0.0, scale[2], scale[3])
        if share <= 0.0:
            y = neutral
        else:
            y = clip(results[k] * scale[1] + scale[0], scale[2], scale[3])
            if share < 1.0:
                y = neutral + share * (y - neutral)
        arena[output[k]] = y
        scale += 4
