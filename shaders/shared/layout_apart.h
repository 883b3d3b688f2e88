/* Rays of the gather and the weighed pass whose chains are followed apart (shaders/gather_chains.glsl); part of
 * shaders/shared/push.h. */

#define KILN_GPU_APART_COUNT_BYTES 16u /* a word, the number of chains; the other bytes are padding */

/* A ray that has met a surface at which its chain begins. */
struct kiln_gpu_apart_ray {
    KILN_VECTOR direction;
    KILN_WORD triangle; /* with KILN_GPU_BOTH_BACK: met from behind */
    KILN_REAL32 u, v, distance;
    KILN_REAL32 tint[3];
    KILN_REAL32 facet, weight, taken_up; /* factors of the ray's findings: shaders/gather.glsl */
    KILN_WORD chance, number;            /* arguments of chain_follow (shaders/chain.glsl) */
};
KILN_SIZE_IS(kiln_gpu_apart_ray, 60);

/* Findings of a ray: the floats of a slice, including all optional ones. */
struct kiln_gpu_apart_found {
    KILN_REAL32 incident[3], irradiance[3];
    KILN_REAL32 escaped, blocked, luminance;
    KILN_REAL32 glass[3], gloss[3];
};
KILN_SIZE_IS(kiln_gpu_apart_found, 60);
#define KILN_GPU_APART_RAY_BYTES 60ul /* of the gather pass */

/* A ray of the weighed pass, whose chains also need the point's area. */
struct kiln_gpu_apart_weighed_ray {
    KILN_STRUCT kiln_gpu_apart_ray ray;
    KILN_REAL32 area; /* m2: the point's area that can be lit */
};
KILN_SIZE_IS(kiln_gpu_apart_weighed_ray, 64);
#define KILN_GPU_APART_WEIGHED_RAY_BYTES 64ul

/* chains.comp, weighed_chains.comp, chains_add.comp. */
struct kiln_gpu_chains_push {
    KILN_ADDRESS scene;
    KILN_ADDRESS both;   /* of weighed_chains.comp: as in struct kiln_gpu_weighed_push */
    KILN_ADDRESS room;   /* buffer of rays, findings and lists: layout in apart.glsl */
    KILN_ADDRESS slices; /* as in struct kiln_gpu_hemisphere */
    KILN_WORD points, samples, rows;
    KILN_WORD threads;             /* number of threads that follow chains */
    KILN_WORD row_first, row_last; /* for chains_add.comp: slices row_first .. row_last - 1 */
    KILN_WORD per_quarter, slice;  /* likewise */
    KILN_WORD ray_bytes;           /* for chains_add.comp: bytes that each ray takes */
    KILN_WORD reserved;
};
KILN_SIZE_IS(kiln_gpu_chains_push, 72);
