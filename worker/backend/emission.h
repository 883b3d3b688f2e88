/* Light traced from the lights by particles: as a whole, or in groups, which several processes can share. */
#ifndef KILN_WORKER_BACKEND_EMISSION_H
#define KILN_WORKER_BACKEND_EMISSION_H

#include "worker/backend/backend.h"

/* Balance of emitted light, traced from the lights and independent of the direct pass. Watts, RGB. */
struct kiln_emission_result {
    double emitted[3], received[3], blocked[3], escaped[3]; /* blocked: on backs of single-sided surfaces */
    /* luminances of light that came directly from suns and sky: its part of `received`; its part of `blocked`; of the
     * latter the part that fell on rooms from outside (behind the back, along the ray, lies the front of another
     * object, or of one that contains things: enclosures.h); and, summed over objects, the excess of the rest on an
     * object's backs over its light as a room's wall plus twice the light on its front */
    double from_outside, outside, on_rooms, astray;
    double ranged[3];  /* cut off by a light's range */
    double glass[3];   /* absorbed by tinted surfaces that it passed */
    double gloss[3];   /* absorbed by mirrors, gloss and glass bodies on its way; 0 without any */
    double caustic[3]; /* part of `received` that came via mirrors, gloss or glass */
    /* part of `caustic` that gather rays cannot find: its first surface was a mirror or smooth glass, and the light has
     * no extent */
    double mirrored[3];
    double error[3]; /* standard errors of `received`, of its direct part, and of `caustic` */
    double straight_error[3], caustic_error[3];
    /* triangles whose emission or opacity has a texture: their part of `emitted`, by integrating the textures; and by
     * the particles, with its standard error */
    double textured[3], drawn[3], drawn_error[3];
};

/* Traces about `samples` particles from the lights, on the host in batches, in the same way for every backend. */
int kiln_backend_emission(struct kiln_backend *backend, uint32_t samples, struct kiln_emission_result *result,
                          struct kiln_error *error);

/* Number of independent groups of particles, from whose spread the error is estimated. */
enum { KILN_EMISSION_GROUPS = 16 };

/* Traces group `first` and each `step`-th after it, and leaves the others at 0. All groups together have about
 * `samples` particles. */
int kiln_emission_groups(struct kiln_backend *backend, uint32_t samples, uint32_t first, uint32_t step,
                         struct kiln_emission_result groups[KILN_EMISSION_GROUPS], struct kiln_error *error);
/* Computes the means of all groups, and their standard errors. */
void kiln_emission_combine(const struct kiln_emission_result groups[KILN_EMISSION_GROUPS],
                           struct kiln_emission_result *result);

#endif
