/* The bidirectional pass (worker/pass/bidirectional.h) on the device; part of shaders/shared/push.h. */

/* Methods of the kernels: their own constant. */
#define KILN_GPU_BOTH_SPLATS 1u   /* vertices of light are connected to the camera, */
#define KILN_GPU_BOTH_CONNECTS 2u /* and to the camera's path, which takes samples of the lights too */
#define KILN_GPU_BOTH_MERGES 4u   /* photons are merged: those of all paths of light, */
#define KILN_GPU_BOTH_OWN 8u      /* or only of the pixel's own */
#define KILN_GPU_BOTH_POINTS 16u  /* paths begin at surface points (worker/pass/reference.h), not at a camera, */
#define KILN_GPU_BOTH_ALONE 32u   /* and paths of light have no part in them */
#define KILN_GPU_BOTH_LANDS 64u   /* paths are of light that lands (worker/pass/land.h), and there are no others */
#define KILN_GPU_BOTH_FORM 15u    /* what is left is what else a kernel's own constant tells */

/* A vertex of a path of light that is not of mirrors alone. */
struct kiln_gpu_light_vertex {
    KILN_VECTOR position, from; /* m; unit, to where light has come from */
    KILN_REAL32 flux[3];        /* W */
    KILN_REAL32 vcm, vc, vm;    /* struct kiln_path_sums */
    KILN_REAL32 u, v;
    KILN_WORD triangle; /* with KILN_GPU_BOTH_BACK: met from behind */
    KILN_WORD bounces;
    KILN_WORD number;   /* of the path's surface, 0 the first */
    KILN_WORD previous; /* of the path's vertices that are kept; KILN_GPU_NONE: this is the first */
    KILN_WORD path;     /* of light */
    KILN_REAL32 lift;   /* as of struct kiln_gpu_subpath */
};
KILN_SIZE_IS(kiln_gpu_light_vertex, 80);
#define KILN_GPU_BOTH_BACK 0x80000000u

/* Parts of a vertex of light that merging reads: struct photon of worker/backend/embree/photons.h. */
struct kiln_gpu_photon {
    KILN_VECTOR position, from;
    KILN_REAL32 flux[3];
    KILN_REAL32 vcm, vm;
    KILN_WORD bounces, number;
};
KILN_SIZE_IS(kiln_gpu_photon, 52);

/* A path under way, of the camera or of light: the ray to its next surface, and what that has met. */
struct kiln_gpu_subpath {
    KILN_VECTOR origin, direction;
    KILN_REAL32 weight[3];
    KILN_REAL32 vcm, vc, vm;           /* struct kiln_path_sums */
    KILN_VECTOR before, before_normal; /* the vertex before (of light: where the ray comes from), its light_normal */
    KILN_WORD surface, bounces, chain; /* number of the next surface; diffuse events; surfaces since the last of them */
    KILN_WORD last_diffuse;            /* of the camera: 1 where the last event was diffuse */
    KILN_WORD last;                    /* of light: its last vertex that is kept */
    KILN_WORD body;                    /* of light: material of the body that the ray goes through, or KILN_GPU_NONE */
    KILN_REAL32 scale;                 /* of light: largest colour at the lamp, W */
    KILN_WORD triangle;                /* that is met; with KILN_GPU_BOTH_BACK: from behind */
    KILN_REAL32 u, v, distance;
    KILN_REAL32 tint[3];
    KILN_REAL32 lift; /* m, of rays that begin at what is met, above its offset: not through what lies above */
};
KILN_SIZE_IS(kiln_gpu_subpath, 132);

/* The vertex that a path of the camera has come to, for what is connected to it and merged with it. */
struct kiln_gpu_eye_vertex {
    KILN_VECTOR position, from, normal;
    KILN_REAL32 weight[3];
    KILN_REAL32 vcm, vc, vm;
    KILN_REAL32 u, v;
    KILN_WORD triangle; /* with KILN_GPU_BOTH_BACK: met from behind */
    KILN_WORD surface, bounces;
    KILN_WORD faces;                    /* 1: it is diffuse, and only what its normal sees is connected to it */
    KILN_REAL32 lift;                   /* as of struct kiln_gpu_subpath */
    KILN_WORD vertex;                   /* of light: the next to be connected, KILN_GPU_NONE: none is left */
    KILN_WORD cell, photon, photon_end; /* of merging: the next of eight cells; what is left of the bucket before it */
};
KILN_SIZE_IS(kiln_gpu_eye_vertex, 104);

/* The vertex of the path in a slot, and a vertex of light or a photon. */
struct kiln_gpu_both_pair {
    KILN_WORD slot, other;
};
KILN_SIZE_IS(kiln_gpu_both_pair, 8);

/* A ray that asks what is in the way of light. */
struct kiln_gpu_shadow_ray {
    KILN_VECTOR origin, direction;
    KILN_REAL32 limit;
    KILN_REAL32 brings[3]; /* W/(m2 sr), if nothing is in the way */
    KILN_WORD to;          /* a slot, or a pixel of the film */
    KILN_WORD chance;      /* what its chances hang on, of a ray to the camera */
};
KILN_SIZE_IS(kiln_gpu_shadow_ray, 48);

/* Light that the path in a slot has brought: numbers of 96 bits, the lowest word first, one a colour. A surface point
 * has three such sums: about its shading normal, incident, and what of that is last (worker/pass/reference.h). */
#define KILN_GPU_BOTH_SUM_WORDS 9u
#define KILN_GPU_BOTH_POINT_WORDS 27u

/* ---- paths from surface points ---- */

/* A surface point whose path is in a slot. */
struct kiln_gpu_point_path {
    KILN_VECTOR shading, axis; /* unit; the point's rays go by the cosine about `axis` */
    KILN_WORD point;           /* of the block */
    KILN_WORD key, seed;       /* of random numbers; of the chances of the first ray */
    KILN_WORD goes;            /* 1: the first ray is traced */
    /* how much radiance along the first ray counts for: about the shading normal, and as incident light */
    KILN_REAL32 irradiance, incident;
};
KILN_SIZE_IS(kiln_gpu_point_path, 48);

/* Beside a shadow ray: what of its light is last, and how much it counts for, as in struct kiln_gpu_point_path. */
struct kiln_gpu_point_ray {
    KILN_REAL32 last[3];
    KILN_REAL32 irradiance, incident;
};
KILN_SIZE_IS(kiln_gpu_point_ray, 20);

/* Sums over the paths of a point so far, each as the sum of two floats: three colours about the shading normal,
 * incident, and of that the last; then the luminance of the first three in each quarter of the samples. */
#define KILN_GPU_POINT_SUMS 13u
struct kiln_gpu_point_sums {
    KILN_REAL32 high[KILN_GPU_POINT_SUMS], low[KILN_GPU_POINT_SUMS];
};
KILN_SIZE_IS(kiln_gpu_point_sums, 104);

/* Surface points of one block, for the kernels. */
struct kiln_gpu_both_points {
    KILN_ADDRESS points, parts, states; /* as in struct kiln_gpu_chunk */
    KILN_ADDRESS sobol;                 /* of the first sample in dimension 0; the next dimension is a stride away */
    KILN_ADDRESS paths;                 /* struct kiln_gpu_point_path of each slot */
    KILN_ADDRESS rays;                  /* struct kiln_gpu_point_ray of each shadow ray */
    KILN_WORD origin;                   /* number in the block of the batch's first point, modulo 2^32 */
    KILN_WORD sobol_stride, samples, reuse, stream, first_sample; /* as in struct kiln_gpu_hemisphere */
    KILN_WORD light_seed;                                         /* of the points' own paths of light */
    KILN_WORD reserved;
};
KILN_SIZE_IS(kiln_gpu_both_points, 80);

/* Work that a dispatch leaves for those after it; 0 before it. Numbers of paths, rays, pairs; those of pairs also count
 * what found no room. Where rays of scenes with gloss have gone to their next surfaces, `shadows` are the paths that
 * have met gloss there, and `paths` the others. */
struct kiln_gpu_both_tally {
    KILN_WORD paths, shadows, pairs;
    KILN_WORD left; /* paths that have more pairs */
};
KILN_SIZE_IS(kiln_gpu_both_tally, 16);

/* Counts of the kernels; 0 before the first path of light. */
struct kiln_gpu_both_counts {
    KILN_WORD vertices; /* of light, also those that found no room */
    KILN_WORD photons;
    KILN_WORD stopped;  /* 1: the device has ended a loop early */
    KILN_WORD too_much; /* 1: one path brings more than the sums hold */
};
KILN_SIZE_IS(kiln_gpu_both_counts, 16);

/* Data that all threads of a sample share. */
struct kiln_gpu_both {
    KILN_ADDRESS chances, up_to;   /* real: struct kiln_emission */
    KILN_ADDRESS parents, leaves;  /* words: the same */
    KILN_ADDRESS counts;           /* struct kiln_gpu_both_counts */
    KILN_ADDRESS vertices, last;   /* of paths of light; and the number of each path's last one, KILN_GPU_NONE: none */
    KILN_ADDRESS photons;          /* bucket by bucket, in each in no order */
    KILN_ADDRESS begins, ends;     /* words: where each bucket begins and ends in `photons` */
    KILN_ADDRESS film;             /* three numbers of 64 bits a pixel, the lower half first: struct kiln_splat_film */
    KILN_ADDRESS subpaths, eyes;   /* of each slot: struct kiln_gpu_subpath, struct kiln_gpu_eye_vertex */
    KILN_ADDRESS lands;            /* of each slot, where light lands: struct kiln_gpu_land_path */
    KILN_ADDRESS radiance;         /* of each slot: KILN_GPU_BOTH_SUM_WORDS words */
    KILN_ADDRESS pairs, shadows;   /* struct kiln_gpu_both_pair, struct kiln_gpu_shadow_ray */
    KILN_ADDRESS points;           /* struct kiln_gpu_both_points; 0: paths begin at a camera */
    KILN_WORD unit_power;          /* of the sums of slots: their unit is 2 to this (signed) power, W/(m2 sr) */
    KILN_WORD room;                /* vertices of light that there is room for */
    KILN_WORD lights, bucket_mask; /* how many lights there are; the number of buckets, less 1 */
    KILN_WORD most;                /* bounces, below 2^30 */
    KILN_WORD endless;             /* 1: paths have no last bounce */
    KILN_WORD path_length;         /* rays of a path: KILN_PATH_LENGTH_ANY, or what they are at most */
    KILN_WORD width, height, orthographic;
    KILN_VECTOR position, forward, right, up; /* struct kiln_path_parameters */
    KILN_REAL32 lens_radius, focus_distance;
    KILN_VECTOR centre; /* of the sphere about the scene, m, */
    KILN_REAL32 sphere; /* and its radius */
    KILN_REAL32 extent; /* m, of the scene */
    KILN_REAL32 pixel;  /* area of one at distance 1; m2 when orthographic */
    KILN_REAL32 paths;  /* of light */
    KILN_REAL32 unit;   /* of the film, W/(m2 sr) */
    KILN_REAL32 radius; /* m, of merging; */
    KILN_REAL32 area;   /* m2, pi times its square times the paths whose vertices are merged; 0: none are */
};
KILN_SIZE_IS(kiln_gpu_both, 280);
