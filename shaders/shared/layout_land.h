/* Light paths that land, and what gather rays share with them (worker/pass/land.h, weighed.h), on the device; part of
 * shaders/shared/push.h. */

struct kiln_gpu_target { /* struct kiln_target */
    KILN_VECTOR centre, low, high;
    KILN_REAL32 radius, area;
    KILN_WORD listed, count; /* range of its triangles in `triangles`, if rays are spread evenly over them */
};
KILN_SIZE_IS(kiln_gpu_target, 52);

struct kiln_gpu_lamp { /* struct kiln_lamp */
    KILN_WORD kind, first, count;
    KILN_REAL32 flux;
};
KILN_SIZE_IS(kiln_gpu_lamp, 16);
#define KILN_GPU_LAMP_AREA 0u
#define KILN_GPU_LAMP_POINT 1u
#define KILN_GPU_LAMP_DIRECTIONAL 2u
#define KILN_GPU_LAMP_ENVIRONMENT 3u

/* Data that all threads share: struct kiln_aims, and struct kiln_caustic_techniques if other techniques are combined.
 */
struct kiln_gpu_land {
    KILN_ADDRESS lamps, targets;
    KILN_ADDRESS first;       /* numbers of 64 bits: first path of each aim, and the end */
    KILN_ADDRESS until;       /* floats: cumulative share of its lamp's flux, including this triangle */
    KILN_ADDRESS lamp_of;     /* words: lamp of each emitting triangle */
    KILN_ADDRESS even;        /* numbers of 64 bits: paths of each aim that are spread evenly over triangles */
    KILN_ADDRESS triangles;   /* words: triangles of targets of such evenly spread paths */
    KILN_ADDRESS shares;      /* floats: cumulative share of the target's area, including this triangle */
    KILN_ADDRESS of_triangle; /* words: of each world triangle its target; KILN_GPU_NONE: none */
    KILN_ADDRESS plane_of;    /* words: mirror plane of each triangle, KILN_GPU_NONE: none; 0: no mirror images */
    KILN_ADDRESS spheres;     /* struct kiln_gpu_spheres, if paths cross the spheres of probes */
    KILN_WORD64 paths;        /* of an iteration */
    KILN_WORD aim_count, target_count;
    KILN_VECTOR centre;     /* of the sphere about the scene, m, */
    KILN_REAL32 radius;     /* and its radius */
    KILN_REAL32 iterations; /* number of iterations, for caustic_weights.h */
    KILN_WORD mis;
};
KILN_SIZE_IS(kiln_gpu_land, 128);
#define KILN_GPU_LAND_BYTES 128ul

/* The spheres about probes: struct kiln_probe_spheres. */
struct kiln_gpu_spheres {
    KILN_ADDRESS spheres; /* of each four floats: struct kiln_sphere */
    KILN_ADDRESS clear;   /* floats: clear radius of each sphere, m */
    KILN_ADDRESS paths;   /* floats: each aim's paths over its flux, 1/W; 0: its paths are not recorded */
    KILN_ADDRESS sums;    /* KILN_GPU_SPHERE_SUMS integers of 64 bits a sphere, lower half first */
    KILN_ADDRESS moments; /* one number for each aim; then the number of rays traced for walls */
    KILN_WORD64 first;    /* grid number of the probe of sphere 0 */
    KILN_WORD count, aims;
    KILN_WORD size[3], low, high; /* size of the grid; first and last layer along z with spheres */
    KILN_VECTOR origin, spacing;  /* the grid's, m */
    KILN_VECTOR reach;            /* largest extent of a sphere from its probe's place in the grid, in spacings */
    KILN_REAL32 diameter;         /* m, of the largest sphere, */
    KILN_REAL32 units;            /* units of the sums for 1 W along that diameter */
};
KILN_SIZE_IS(kiln_gpu_spheres, 120);
#define KILN_GPU_SPHERE_SUMS 45u

/* End of a path. The host finds its surface point by the number. */
struct kiln_gpu_landing {
    KILN_REAL32 flux[3];
    KILN_REAL32 shading, taken_up, others; /* struct kiln_land_result */
    KILN_WORD point_low, point_high;       /* global number of the surface point; KILN_NO_POINT: it landed beside all */
    KILN_WORD end; /* enum kiln_land_end, KILN_GPU_LAND_...; number of surfaces met from bit KILN_GPU_LAND_LENGTH on */
};
KILN_SIZE_IS(kiln_gpu_landing, 36);
#define KILN_GPU_LANDING_BYTES 36ul
#define KILN_GPU_LAND_END 0xffu
#define KILN_GPU_LAND_MISSED 0x100u /* its last ray has met nothing */
#define KILN_GPU_LAND_LENGTH 16u

/* Flags of a path under way (layout_land_real.h). */
#define KILN_GPU_LAND_IS_POINT 1u  /* its lamp is a point: no ray can hit it */
#define KILN_GPU_LAND_HAS_PLACE 2u /* its lamp has a position in the scene */
#define KILN_GPU_LAND_IMAGED 4u    /* it starts as if from the lamp's mirror image */

/* Bits of the kernels' specialisation constant METHOD. */
#define KILN_GPU_LAND_BEGINS 1u  /* land.comp: paths begin; 0: they end */
#define KILN_GPU_LAND_SHARES 2u  /* landings are weighted against other techniques */
#define KILN_GPU_LAND_CROSSES 4u /* paths cross the spheres of probes, and land only on purely diffuse surfaces */
