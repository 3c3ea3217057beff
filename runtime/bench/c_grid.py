"""The clock of the loops in C that the benchmarks compare with."""

C_GRID = """
#include <errno.h>
#include <time.h>

/* Point k of a grid stands k periods, in ns, behind the first, which is one period from where it was made. */
struct grid { long long first, period; };

static long long nanoseconds(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return now.tv_sec * 1000000000LL + now.tv_nsec;
}

static struct grid grid_from_now(long long period)
{
    struct grid grid = {nanoseconds() + period, period};
    return grid;
}

/* Sleeps until point k. Returns how far behind it the process woke, in ns. */
static long long wait_for_point(const struct grid *grid, long k)
{
    long long point = grid->first + k * grid->period;
    struct timespec next = {point / 1000000000LL, point % 1000000000LL};
    while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &next, 0) == EINTR)
        ;
    return nanoseconds() - point;
}
"""
