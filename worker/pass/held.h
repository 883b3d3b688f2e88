/* Light that stays on a device while gathers from rows (resident_rows.h) go from bounce to bounce, under several lights
 * at once. What the integrator "cells" does with the answers of a step the device does there: it adds up what points
 * send, packs it for the next gather, and adds up power; only sums over all points return. Where direct light is a
 * weighted sum of what is known, that is done there too. In the end the host fetches the light of each point: 16 bytes,
 * or 32 with direct light. All points are the rank's own. Bits are those that the host gives. */
#ifndef KILN_WORKER_PASS_HELD_H
#define KILN_WORKER_PASS_HELD_H

#include <stdbool.h>
#include <stdint.h>

/* A point's answer in a direct step: sums, as struct kiln_point_result has them, or means with count 1. */
struct kiln_direct_answer {
    float irradiance[3], incident[3], error, present;
    uint32_t count;
};

/* A part of a light's direct light: means, and by what they are scaled. */
struct kiln_held_part {
    uint64_t key; /* of these answers: what has the same is the same */
    const struct kiln_direct_answer *answers;
    float factor[3];
};

/* State that a light begins with, for all points. Borrowed. */
struct kiln_held_light {
    const uint16_t *albedo; /* three a point, as kiln_surface.albedo */
    /* either its direct light as a sum of parts, which is the step that is taken: with so many samples, a power of two;
     * errors add up by their squares; */
    bool mixed;
    uint32_t samples;
    const struct kiln_held_part *parts;
    uint32_t part_count; /* 0: it is dark */
    /* or what the host has taken over */
    const void *next;          /* the radiosity that is gathered first: packed, or with `compact` in 4 bytes */
    const float *sum;          /* three a point: what points have sent so far, W/m2 */
    const uint16_t *error;     /* of the light so far, in the upper half of a float */
    double scale;              /* of radiosity in 4 bytes: a power of two of 2^-80 to 2^80 */
    double unit, unit_squared; /* of sums of power, W and W2: powers of two */
};

struct kiln_held {
    const struct kiln_held_light *lights;
    uint32_t count; /* at most KILN_ROW_LIGHTS */
    bool compact;
    /* of those that are mixed: the random bits that round what they send */
    uint32_t stream, seed;
};

/* Arrays that the host fetches of a light, over all its points; NULL: not wanted. For a light that was not mixed the
 * host has direct light, and its error. */
struct kiln_held_fetch {
    float *direct, *sum;
    uint16_t *error, *error_direct, *error_indirect;
};

/* Work of a step besides its rows' gather. */
struct kiln_held_step {
    bool final;   /* answers are the light, with their errors; else what they make points send is added to the sums, */
    bool compact; /* and gathered next: rounded to 4 bytes */
    bool packs; /* it gathers from the sums, which are packed for it with random bits of this stream; else from what */
    uint32_t pack_stream; /* the step before has made */
    uint32_t seed;        /* of the random bits of 4 bytes */
    bool direct;          /* no gather: direct light, of those that are mixed (kiln_backend_hold) */
};

/* A sum over all points: high x 2^40 + low units. A step has of each light these: incident, reflected, sent, escaped,
 * blocked (3 each), variance. */
struct kiln_held_power {
    int64_t high, low;
};
enum { KILN_HELD_POWERS = 16 };

#endif
