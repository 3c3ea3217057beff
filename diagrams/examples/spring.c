/* A spring with a damper, whose velocity is filtered: a controller for Tickwork's block Compiled. */

#include "tickwork.h"

static double filtered; /* rad/s */

int tickwork_sizes(int *inputs, int *outputs) {
    *inputs = 2;
    *outputs = 1;
    return TICKWORK_VERSION;
}

int tickwork_init(double period) {
    (void)period;
    filtered = 0.0;
    return 0;
}

int tickwork_step(const double *in, double *out, double dt) {
    filtered += dt / (dt + 0.01) * (in[1] - filtered);
    out[0] = -20.0 * in[0] - 1.5 * filtered;
    return 0;
}
