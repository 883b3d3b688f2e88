/* Light that stays on a device while gathers from rows (resident_rows.h) go from bounce to bounce, under several lights
 * at once. What the integrator "cells" does with the answers of a step the device does there: it adds up what points
 * send, packs it for the next gather, and adds up power; only sums over all points return. In the end the host fetches
 * the light of each point, 16 bytes. All points are the rank's own. Bits are those that the host gives. */
#ifndef KILN_WORKER_PASS_HELD_H
#define KILN_WORKER_PASS_HELD_H

#include <stdbool.h>
#include <stdint.h>

/* What a light begins with, of all points. Borrowed. */
struct kiln_held_light {
    const void *next;          /* the radiosity that is gathered first: packed, or with `compact` in 4 bytes */
    const float *sum;          /* three a point: what points have sent so far, W/m2 */
    const uint16_t *albedo;    /* three a point, as kiln_surface.albedo */
    const uint16_t *error;     /* of the light so far, in the upper half of a float */
    double scale;              /* of radiosity in 4 bytes: a power of two of 2^-80 to 2^80 */
    double unit, unit_squared; /* of sums of power, W and W2: powers of two */
};

struct kiln_held {
    const struct kiln_held_light *lights;
    uint32_t count; /* at most KILN_ROW_LIGHTS */
    bool compact;
};

/* What a step does besides its rows' gather. */
struct kiln_held_step {
    bool final;   /* answers are the light, with their errors; else what they make points send is added to the sums, */
    bool compact; /* and gathered next: rounded to 4 bytes */
    bool packs; /* it gathers from the sums, which are packed for it with random bits of this stream; else from what */
    uint32_t pack_stream; /* the step before has made */
    uint32_t seed;        /* of the random bits of 4 bytes */
};

/* A sum over all points: high x 2^40 + low units. A step has of each light these: incident, reflected, sent, escaped,
 * blocked (3 each), variance. */
struct kiln_held_power {
    int64_t high, low;
};
enum { KILN_HELD_POWERS = 16 };

#endif
