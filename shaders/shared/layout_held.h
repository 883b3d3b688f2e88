/* Light that stays on the device (worker/pass/held.h); part of shaders/shared/push.h. */

/* A surface point, as far as taking its answers over goes. */
struct kiln_gpu_held_point {
    KILN_WORD area[2]; /* the halves of a double, m2: what of it counts in sums of power; 0: it does not */
    KILN_WORD tile;    /* hash of its lightmap and tile, */
    KILN_WORD bit;     /* and its place in the tile */
};
KILN_SIZE_IS(kiln_gpu_held_point, 16);

/* A light: its units are powers of two, of which these are the exponents, in two's complement. */
struct kiln_gpu_held_light {
    KILN_ADDRESS albedo; /* halves of words, three a point */
    KILN_WORD scale;     /* of radiosity in 4 bytes */
    KILN_WORD unit, unit_squared;
    KILN_WORD part_first, part_count; /* of its direct light, among all; count KILN_GPU_NONE: the host has made that */
    KILN_WORD samples;                /* of it: a power of two */
};
KILN_SIZE_IS(kiln_gpu_held_light, 32);

/* A point's answer in a direct step: struct kiln_direct_answer. */
struct kiln_gpu_direct_answer {
    KILN_REAL32 irradiance[3], incident[3], error, present;
    KILN_WORD count;
};
KILN_SIZE_IS(kiln_gpu_direct_answer, 36);

/* A part of a light's direct light. */
struct kiln_gpu_held_part {
    KILN_ADDRESS answers; /* struct kiln_gpu_direct_answer each: means of the points */
    KILN_REAL32 factor[3];
    KILN_WORD reserved;
};
KILN_SIZE_IS(kiln_gpu_held_part, 24);

/* Floats of a gather's answer under a light: incident, irradiance (3 each; not there where no normal is smooth, then
 * the same), escaped, blocked, error. */
#define KILN_GPU_REPLAY_FLOATS 9u
#define KILN_GPU_REPLAY_INCIDENT 0u
#define KILN_GPU_REPLAY_IRRADIANCE 3u
#define KILN_GPU_REPLAY_ESCAPED 6u
#define KILN_GPU_REPLAY_BLOCKED 7u
#define KILN_GPU_REPLAY_ERROR 8u

/* Sums of a step, in this order: incident, reflected, sent, escaped, blocked (3 each), variance. */
#define KILN_GPU_HELD_POWERS 16u
/* A sum of whole units: high x 2^40 + low. */
struct kiln_gpu_held_power {
    KILN_WORD64 high, low; /* signed, in two's complement */
};
KILN_SIZE_IS(kiln_gpu_held_power, 16);

struct kiln_gpu_held {
    KILN_ADDRESS from, to; /* packed radiosity: of point i under light l pair i * count + l */
    KILN_ADDRESS sums;     /* three floats each: of light l from point l * points on */
    KILN_ADDRESS errors;   /* words, likewise: packed errors of all light, and of indirect light in the upper half */
    KILN_ADDRESS direct;   /* three floats each, likewise: irradiance by direct light; of lights that are mixed */
    KILN_ADDRESS direct_errors; /* words, likewise: its packed errors */
    KILN_ADDRESS mixes;         /* struct kiln_gpu_held_part each */
    KILN_ADDRESS of_point;      /* struct kiln_gpu_held_point each */
    KILN_ADDRESS lights;        /* struct kiln_gpu_held_light each */
    /* sums of power of group g of points under light l: from (g * count + l) * KILN_GPU_HELD_POWERS on */
    KILN_ADDRESS parts;
    KILN_ADDRESS powers; /* of all: of light l from l * KILN_GPU_HELD_POWERS on; then a word: an answer is not good */
    KILN_WORD64 points;
    KILN_WORD count;   /* lights */
    KILN_WORD final;   /* answers are the light; else what they send is added to it, and gathered from next */
    KILN_WORD compact; /* that is rounded to 4 bytes */
    KILN_WORD stream;  /* for rounding, */
    KILN_WORD seed;    /* and of the 4 bytes */
    KILN_WORD reserved;
};
KILN_SIZE_IS(kiln_gpu_held, 120);
