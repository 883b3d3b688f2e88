/* Surface regression (worker/pass/regression.h); part of shaders/shared/push.h. */

/* Numbers of fits: a linear one at each scale, and quadratic ones at some. KILN_REGRESSION_RAW: no fit. */
#define KILN_REGRESSION_SCALES 6
#define KILN_REGRESSION_FITS 10
#define KILN_REGRESSION_RAW 10
/* Largest search radius for neighbours, texels. */
#define KILN_NEIGHBOUR_RADIUS 8.0f
#define KILN_NEIGHBOUR_COSINE 0.9f

struct kiln_gpu_regression_point {
    KILN_VECTOR position; /* m */
    KILN_REAL32 area;     /* m2 */
    KILN_VECTOR normal;   /* unit */
    KILN_REAL32 size;     /* m, above 0 */
};
KILN_SIZE_IS(kiln_gpu_regression_point, 32);

/* Input: a point's gathered light. */
struct kiln_gpu_regression_given {
    KILN_VECTOR rgb;
    KILN_REAL32 luminance, variance;
};
KILN_SIZE_IS(kiln_gpu_regression_given, 20);

/* Choice of a fit for a point's light, which one sweep passes to the next. */
struct kiln_gpu_regression_choice {
    KILN_REAL32 pooled; /* the mean variance around */
    KILN_REAL32 risk;   /* estimated risk of the choice */
    KILN_REAL32 part;   /* blend factor from the raw value to the chosen fit */
    KILN_WORD choice;   /* a fit, or KILN_REGRESSION_RAW */
};
KILN_SIZE_IS(kiln_gpu_regression_choice, 16);

struct kiln_gpu_regression_result {
    KILN_VECTOR rgb;
    KILN_REAL32 noise;  /* the variance of the result */
    KILN_REAL32 bias;   /* squared bias: excess of the choices' risk over the noise */
    KILN_REAL32 pooled; /* the mean variance around */
};
KILN_SIZE_IS(kiln_gpu_regression_result, 24);

/* regression.comp: thread x takes point first + x. */
struct kiln_gpu_regression_push {
    KILN_ADDRESS scene;
    KILN_ADDRESS points; /* struct kiln_gpu_regression_point each */
    KILN_ADDRESS cells;  /* words: the cell of each point */
    KILN_ADDRESS firsts; /* words: first range of each cell, and the end of the last */
    KILN_ADDRESS ranges; /* two words each, [begin, end): points that may be neighbours of a cell's points */
    KILN_ADDRESS given;  /* struct kiln_gpu_regression_given: point i under light l at i * lights + l */
    KILN_ADDRESS fits;   /* floats, (1 + lights) x KILN_REGRESSION_FITS a point: the fits' leverages; then of each light
                          * (fit - value)^2, which becomes Stein's estimate over the variance */
    KILN_ADDRESS choices; /* struct kiln_gpu_regression_choice, indexed as `given` */
    KILN_ADDRESS results; /* struct kiln_gpu_regression_result, indexed as `given` */
    KILN_WORD first, count;
    KILN_WORD lights; /* 1 or 2 */
    KILN_WORD reserved;
};
KILN_SIZE_IS(kiln_gpu_regression_push, 88);
KILN_OFFSET_IS(kiln_gpu_regression_push, first, 72);
