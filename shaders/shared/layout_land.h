/* Light paths that land, and what gather rays share with them (worker/pass/land.h, weighed.h), on the device; part of
 * shaders/shared/push.h. */

struct kiln_gpu_target { /* struct kiln_target */
    KILN_VECTOR centre, low, high;
    KILN_REAL32 radius, area;
    KILN_WORD listed, count; /* where its triangles are listed, if rays go evenly over them */
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

/* Data that all threads share: struct kiln_aims, and struct kiln_caustic_techniques where there are other
 * techniques. */
struct kiln_gpu_land {
    KILN_ADDRESS lamps, targets;
    KILN_ADDRESS first;       /* numbers of 64 bits: of each aim its first path, and one more */
    KILN_ADDRESS until;       /* floats: of each emitting triangle the share of its lamp's flux up to its end */
    KILN_ADDRESS lamp_of;     /* words: of each emitting triangle its lamp */
    KILN_ADDRESS even;        /* numbers of 64 bits: of each aim its paths that go evenly over triangles */
    KILN_ADDRESS triangles;   /* words: of targets to which such paths go */
    KILN_ADDRESS shares;      /* floats: of each of these the share of its target's area up to its end */
    KILN_ADDRESS of_triangle; /* words: of each world triangle its target; KILN_GPU_NONE: none */
    KILN_ADDRESS plane_of;    /* words: of each world triangle its mirror plane, likewise; 0: lamps have no images */
    KILN_ADDRESS spheres;     /* struct kiln_gpu_spheres, where paths cross the spheres of probes */
    KILN_WORD64 paths;        /* of an iteration */
    KILN_WORD aim_count, target_count;
    KILN_VECTOR centre;     /* of the sphere about the scene, m, */
    KILN_REAL32 radius;     /* and its radius */
    KILN_REAL32 iterations; /* of caustic_weights.h */
    KILN_WORD mis;
};
KILN_SIZE_IS(kiln_gpu_land, 128);
#define KILN_GPU_LAND_BYTES 128ul

/* The spheres about probes: struct kiln_probe_spheres. */
struct kiln_gpu_spheres {
    KILN_ADDRESS spheres; /* of each four floats: struct kiln_sphere */
    KILN_ADDRESS clear;   /* floats: of each, m */
    KILN_ADDRESS paths;   /* floats: of each aim its paths over its flux, 1/W; 0: they leave nothing */
    KILN_ADDRESS sums;    /* of each sphere KILN_GPU_SPHERE_SUMS whole numbers of 64 bits, the lower half first */
    KILN_ADDRESS moments; /* of each aim one; and how many rays have asked for walls */
    KILN_WORD64 first;    /* the probe of the grid whose sphere is number 0 */
    KILN_WORD count, aims;
    KILN_WORD size[3], low, high; /* of the grid; along z the first and the last layer that has spheres */
    KILN_VECTOR origin, spacing;  /* the grid's, m */
    KILN_VECTOR reach;            /* spacings, from a probe's place in the grid: beyond it lies nothing of its sphere */
    KILN_REAL32 diameter;         /* m, of the largest sphere, */
    KILN_REAL32 units;            /* and units of the sums that 1 W leaves along it */
};
KILN_SIZE_IS(kiln_gpu_spheres, 120);
#define KILN_GPU_SPHERE_SUMS 45u

/* How a path has ended; the host looks its surface point up. */
struct kiln_gpu_landing {
    KILN_REAL32 flux[3];
    KILN_REAL32 shading, taken_up, others; /* struct kiln_land_result */
    KILN_WORD point_low, point_high; /* the surface point's global number; KILN_NO_POINT: it has landed beside all */
    KILN_WORD end; /* enum kiln_land_end, KILN_GPU_LAND_..., and from KILN_GPU_LAND_LENGTH on the surfaces met */
};
KILN_SIZE_IS(kiln_gpu_landing, 36);
#define KILN_GPU_LANDING_BYTES 36ul
#define KILN_GPU_LAND_END 0xffu
#define KILN_GPU_LAND_MISSED 0x100u /* its last ray has met nothing */
#define KILN_GPU_LAND_LENGTH 16u

/* Flags of a path under way (layout_land_real.h). */
#define KILN_GPU_LAND_IS_POINT 1u  /* no ray meets its lamp, */
#define KILN_GPU_LAND_HAS_PLACE 2u /* which is in the scene */
#define KILN_GPU_LAND_IMAGED 4u    /* it comes as from the lamp's mirror image */

/* The kernels' own constant. */
#define KILN_GPU_LAND_BEGINS 1u  /* of land.comp: paths begin; else they end */
#define KILN_GPU_LAND_SHARES 2u  /* landings share their light with other techniques */
#define KILN_GPU_LAND_CROSSES 4u /* paths cross the spheres of probes, and land on what is only diffuse */
