/* Light that the device keeps from step to step (worker/pass/held.h); part of shaders/shared/push.h. */

/* Members of a surface point that are needed to take its answer over. */
struct kiln_gpu_held_point {
    KILN_WORD area[2]; /* two halves of a double, m2: area counted in sums of power; 0: not counted */
    KILN_WORD tile;    /* hash of its lightmap and tile, */
    KILN_WORD bit;     /* and its place in the tile */
};
KILN_SIZE_IS(kiln_gpu_held_point, 16);

/* A light. Its units are powers of two, stored as exponents in two's complement. */
struct kiln_gpu_held_light {
    KILN_ADDRESS albedo; /* 16-bit values, three a point */
    KILN_WORD scale;     /* exponent of the unit of radiosity packed in 4 bytes */
    KILN_WORD unit, unit_squared;
    KILN_WORD part_first, part_count; /* its terms in `mixes`; count KILN_GPU_NONE: the host has mixed them */
    KILN_WORD samples;                /* samples of the direct light, a power of two */
};
KILN_SIZE_IS(kiln_gpu_held_light, 32);

/* A point's answer in a direct step: struct kiln_direct_answer. */
struct kiln_gpu_direct_answer {
    KILN_REAL32 irradiance[3], incident[3], error, present;
    KILN_WORD count;
};
KILN_SIZE_IS(kiln_gpu_direct_answer, 36);

/* A term of a light's direct light. */
struct kiln_gpu_held_term {
    KILN_ADDRESS answers; /* struct kiln_gpu_direct_answer of each point: means */
    KILN_REAL32 factor[3];
    KILN_WORD reserved;
};
KILN_SIZE_IS(kiln_gpu_held_term, 24);

/* Floats of a gather answer under a light: incident, irradiance (3 each), escaped, blocked, error. Without smooth
 * normals irradiance is left out, as it equals incident. */
#define KILN_GPU_REPLAY_FLOATS 9u
#define KILN_GPU_REPLAY_INCIDENT 0u
#define KILN_GPU_REPLAY_IRRADIANCE 3u
#define KILN_GPU_REPLAY_ESCAPED 6u
#define KILN_GPU_REPLAY_BLOCKED 7u
#define KILN_GPU_REPLAY_ERROR 8u

/* Sums of a step, in this order: incident, reflected, sent, escaped, blocked (3 each), variance. */
#define KILN_GPU_HELD_POWERS 16u
/* Integer sum in units: high x 2^40 + low. */
struct kiln_gpu_held_power {
    KILN_WORD64 high, low; /* signed, in two's complement */
};
KILN_SIZE_IS(kiln_gpu_held_power, 16);

struct kiln_gpu_held {
    KILN_ADDRESS from, to; /* packed radiosity before and after a step: point i under light l is at i * count + l */
    KILN_ADDRESS sums;     /* three floats a point: light l begins at l * points */
    KILN_ADDRESS errors;   /* words, indexed as `sums`: packed errors, in the upper half of indirect light alone */
    KILN_ADDRESS direct;   /* three floats each, indexed as `sums`: direct irradiance, for lights that are mixed */
    KILN_ADDRESS direct_errors; /* words, indexed as `sums`: packed errors of `direct` */
    KILN_ADDRESS mixes;         /* struct kiln_gpu_held_term each */
    KILN_ADDRESS of_point;      /* struct kiln_gpu_held_point each */
    KILN_ADDRESS lights;        /* struct kiln_gpu_held_light each */
    /* sums of power of group g of points under light l: from (g * count + l) * KILN_GPU_HELD_POWERS on */
    KILN_ADDRESS parts;
    KILN_ADDRESS powers; /* total powers: light l at l * KILN_GPU_HELD_POWERS; then a word: an answer is not good */
    KILN_WORD64 points;
    KILN_WORD count;   /* lights */
    KILN_WORD final;   /* 1: answers are the final light; 0: radiosity from them is added to `sums` */
    KILN_WORD compact; /* 1: radiosity is rounded to 4 bytes */
    KILN_WORD stream;  /* stream of random numbers for rounding */
    KILN_WORD seed;    /* seed for rounding to 4 bytes */
    KILN_WORD reserved;
};
KILN_SIZE_IS(kiln_gpu_held, 120);
