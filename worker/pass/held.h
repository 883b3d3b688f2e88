/* Light that stays in device memory between bounces of gathers from rows (resident_rows.h), for several lights at once.
 * The device does the integrator's ("cells") work after each step: it sums the light that points send, packs it as
 * radiosity for the next gather, and sums power; only sums over all points return to the host. Direct light that is a
 * weighted sum of known parts is summed on the device, too. In the end the host fetches the light of each point: 16
 * bytes, or 32 with direct light. All points are the rank's own. Results have the same bits as on the host. */
#ifndef KILN_WORKER_PASS_HELD_H
#define KILN_WORKER_PASS_HELD_H

#include <stdbool.h>
#include <stdint.h>

/* A point's answer in a direct step: sums, as struct kiln_point_result has them, or means with count 1. */
struct kiln_direct_answer {
    float irradiance[3], incident[3], error, present;
    uint32_t count;
};

/* A known part of a light's direct light, and the factor that scales it. */
struct kiln_held_term {
    uint64_t key; /* identity of the answers: same key, same answers */
    const struct kiln_direct_answer *answers;
    float factor[3];
};

/* Initial state of a light, for all points. Borrowed. */
struct kiln_held_light {
    const uint16_t *albedo; /* three a point, as kiln_surface.albedo */
    /* First way (mixed): direct light is a sum of parts, and the direct step computes it. It then has `samples`
     * samples, a power of two; errors add up by their squares. */
    bool mixed;
    uint32_t samples;
    const struct kiln_held_term *parts;
    uint32_t part_count; /* 0: it is dark */
    /* second way (not mixed): state that the host supplies */
    const void *next;          /* the radiosity that is gathered first: packed, or with `compact` in 4 bytes */
    const float *sum;          /* three a point: what points have sent so far, W/m2 */
    const uint16_t *error;     /* error of the light so far: the upper 16 bits of a float */
    double scale;              /* of radiosity in 4 bytes: a power of two of 2^-80 to 2^80 */
    double unit, unit_squared; /* of sums of power, W and W2: powers of two */
};

struct kiln_held {
    const struct kiln_held_light *lights;
    uint32_t count; /* at most KILN_ROW_LIGHTS */
    bool compact;
    /* stream and seed of the random bits that round the radiosity of mixed lights */
    uint32_t stream, seed;
};

/* Arrays that the host fetches for a light, with a value or three for each point; NULL: not wanted. Direct light and
 * its error are fetched for mixed lights only: the host knows them for the others. */
struct kiln_held_fetch {
    float *direct, *sum;
    uint16_t *error, *error_direct, *error_indirect;
};

/* Work of a step besides the gather from rows. */
struct kiln_held_step {
    bool final;   /* answers are the light, with their errors; else what they make points send is added to the sums, */
    bool compact; /* and gathered next: rounded to 4 bytes */
    bool packs; /* it gathers from the sums, which are packed for it with random bits of this stream; else from what */
    uint32_t pack_stream; /* the step before has made */
    uint32_t seed;        /* of the random bits of 4 bytes */
    bool direct;          /* no gather: direct light, of those that are mixed (kiln_backend_hold) */
};

/* A sum over all points: high x 2^40 + low, in units. A step has KILN_HELD_POWERS sums a light: incident, reflected,
 * sent, escaped, blocked (3 each), variance. */
struct kiln_held_power {
    int64_t high, low;
};
enum { KILN_HELD_POWERS = 16 };

#endif
