/* Light traced from the lights: as a whole, or in parts, of which several processes can have some each. */
#ifndef KILN_WORKER_BACKEND_EMISSION_H
#define KILN_WORKER_BACKEND_EMISSION_H

#include "worker/backend/backend.h"

/* Where light that leaves the lights goes: traced from the lights, independent of the direct pass. Watts, RGB. */
struct kiln_emission_result {
    double emitted[3], received[3], blocked[3], escaped[3]; /* blocked: on backs of single-sided surfaces */
    /* luminance of the part of `received` that came straight from suns and sky, and of `blocked`; of that, of what fell
     * on rooms from outside: behind the back, the way it went, is the front of another object, or of one that has
     * things in it (enclosures.h); and, summed over objects, by how much the rest on their backs is more than what they
     * have as a room's wall and twice what they have in front */
    double from_outside, outside, on_rooms, astray;
    double ranged[3];  /* cut off by a light's range */
    double glass[3];   /* taken by tinted surfaces that it went through */
    double gloss[3];   /* taken by mirrors, gloss and bodies of glass that it went by way of; 0 without any */
    double caustic[3]; /* part of `received` that came by way of these */
    /* part of `caustic` that gather rays cannot find: a mirror or smooth glass was first, and the light has no size */
    double mirrored[3];
    double error[3]; /* standard error of `received`, and of its parts: what came straight, and `caustic` */
    double straight_error[3], caustic_error[3];
    /* of the triangles whose emission or opacity has a texture: part of `emitted`, the integral over the textures; and
     * the same by the particles, with its standard error */
    double textured[3], drawn[3], drawn_error[3];
};

/* Traces about `samples` particles from the lights: made on the host, in batches, in the same way for every backend
 *. */
int kiln_backend_emission(struct kiln_backend *backend, uint32_t samples, struct kiln_emission_result *result,
                          struct kiln_error *error);

/* Independent groups of particles, whose spread tells the error. */
enum { KILN_EMISSION_GROUPS = 16 };

/* About `samples` particles in all groups. Of these traces `first` and each `step`-th after it, and leaves the others
 * at 0. */
int kiln_emission_groups(struct kiln_backend *backend, uint32_t samples, uint32_t first, uint32_t step,
                         struct kiln_emission_result groups[KILN_EMISSION_GROUPS], struct kiln_error *error);
/* The means of all groups, and their standard errors. */
void kiln_emission_combine(const struct kiln_emission_result groups[KILN_EMISSION_GROUPS],
                           struct kiln_emission_result *result);

#endif
