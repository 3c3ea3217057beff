/* A controller for Tickwork's block `Compiled`: three functions with C linkage in a shared library.

   Each block loads a copy of the library of its own, so static variables are the state of one controller. The functions
   are called by one thread. tickwork_step must not allocate, lock, print or wait. */

#ifndef TICKWORK_H
#define TICKWORK_H

#define TICKWORK_VERSION 1

#ifdef __cplusplus
extern "C" {
#endif

/* Store the numbers of doubles of all inputs and of all outputs. Return TICKWORK_VERSION. */
int tickwork_sizes(int *inputs, int *outputs);

/* Set the state of the start, before the first step and before each further run.
   period : s, nominal time between two steps. Return 0, or a number of your own for an error. */
int tickwork_init(double period);

/* Compute the outputs of one step.
   in, out : the ports in the order of their declaration, the elements of a vector one after the other
   dt : s since the previous step; more than the period after a skipped tick
   Return 0, or a number of your own, which is a fault. */
int tickwork_step(const double *in, double *out, double dt);

#ifdef __cplusplus
}
#endif

#endif
