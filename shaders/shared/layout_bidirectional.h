/* The bidirectional pass (worker/pass/bidirectional.h) on the device; part of shaders/shared/push.h. */

/* Methods of the kernels: bits of the specialisation constant METHOD. */
#define KILN_GPU_BOTH_SPLATS 1u   /* light vertices are connected to the camera */
#define KILN_GPU_BOTH_CONNECTS 2u /* light vertices are connected to camera paths, which also sample lights */
#define KILN_GPU_BOTH_MERGES 4u   /* photons of all light paths are merged */
#define KILN_GPU_BOTH_OWN 8u      /* only photons of the pixel's own light path are merged */
#define KILN_GPU_BOTH_POINTS 16u  /* paths begin at surface points (worker/pass/reference.h), not at a camera, */
#define KILN_GPU_BOTH_ALONE 32u   /* light paths are not used for paths from surface points */
#define KILN_GPU_BOTH_LANDS 64u   /* only light paths that land (worker/pass/land.h) */
#define KILN_GPU_BOTH_FORM 15u    /* mask: bits of METHOD with the variant of path_rays.comp, path_pairs.comp */

/* A vertex of a light path, on a surface that does not only mirror. */
struct kiln_gpu_light_vertex {
    KILN_VECTOR position, from; /* m; unit, towards the vertex before */
    KILN_REAL32 flux[3];        /* W */
    KILN_REAL32 vcm, vc, vm;    /* struct kiln_path_sums */
    KILN_REAL32 u, v;
    KILN_WORD triangle; /* with KILN_GPU_BOTH_BACK: met from behind */
    KILN_WORD bounces;
    KILN_WORD number;   /* number of the surface on the path, from 0 */
    KILN_WORD previous; /* index of the path's previous stored vertex; KILN_GPU_NONE: this is the first */
    KILN_WORD path;     /* number of the light path */
    KILN_REAL32 lift;   /* as of struct kiln_gpu_subpath */
};
KILN_SIZE_IS(kiln_gpu_light_vertex, 80);
#define KILN_GPU_BOTH_BACK 0x80000000u

/* Photon: the members of a light vertex that merging reads (struct photon, worker/backend/embree/photons.h). */
struct kiln_gpu_photon {
    KILN_VECTOR position, from;
    KILN_REAL32 flux[3];
    KILN_REAL32 vcm, vm;
    KILN_WORD bounces, number;
};
KILN_SIZE_IS(kiln_gpu_photon, 52);

/* State of an unfinished camera or light path: the ray to its next surface, and the hit. */
struct kiln_gpu_subpath {
    KILN_VECTOR origin, direction;
    KILN_REAL32 weight[3];
    KILN_REAL32 vcm, vc, vm;           /* struct kiln_path_sums */
    KILN_VECTOR before, before_normal; /* previous vertex (light: origin of the ray) and its light_normal */
    KILN_WORD surface, bounces, chain; /* number of the next surface; diffuse events; surfaces since the last of them */
    KILN_WORD last_diffuse;            /* camera path: 1 if the last event was diffuse */
    KILN_WORD last;                    /* light path: index of its last stored vertex */
    KILN_WORD body;                    /* light path: material of the body around the ray, or KILN_GPU_NONE */
    KILN_REAL32 scale;                 /* light path: largest colour channel of its flux at the lamp, W */
    KILN_WORD triangle;                /* triangle that is hit; with KILN_GPU_BOTH_BACK: from behind */
    KILN_REAL32 u, v, distance;
    KILN_REAL32 tint[3];
    KILN_REAL32 lift; /* m: lift of rays that start at the hit, above its offset; limited by geometry above */
};
KILN_SIZE_IS(kiln_gpu_subpath, 132);

/* Current vertex of a camera path, for connecting it to light vertices and merging photons. */
struct kiln_gpu_eye_vertex {
    KILN_VECTOR position, from, normal;
    KILN_REAL32 weight[3];
    KILN_REAL32 vcm, vc, vm;
    KILN_REAL32 u, v;
    KILN_WORD triangle; /* with KILN_GPU_BOTH_BACK: met from behind */
    KILN_WORD surface, bounces;
    KILN_WORD faces;                    /* 1: diffuse; it is connected only to vertices above its normal's horizon */
    KILN_REAL32 lift;                   /* as of struct kiln_gpu_subpath */
    KILN_WORD vertex;                   /* next light vertex to connect; KILN_GPU_NONE: no more */
    KILN_WORD cell, photon, photon_end; /* merging: the next of eight cells; photons left in the current bucket */
};
KILN_SIZE_IS(kiln_gpu_eye_vertex, 104);

/* A pair to evaluate: the path vertex of a slot, and a light vertex or photon. */
struct kiln_gpu_both_pair {
    KILN_WORD slot, other;
};
KILN_SIZE_IS(kiln_gpu_both_pair, 8);

/* A shadow ray of a connection. */
struct kiln_gpu_shadow_ray {
    KILN_VECTOR origin, direction;
    KILN_REAL32 limit;
    KILN_REAL32 brings[3]; /* contribution if unoccluded, W/(m2 sr) */
    KILN_WORD to;          /* where the contribution goes: slot, or pixel of the film */
    KILN_WORD chance;      /* seed of the ray's random numbers, for rays to the camera */
};
KILN_SIZE_IS(kiln_gpu_shadow_ray, 48);

/* Radiance that a slot's path has gathered: one fixed-point number of 96 bits a colour, lowest word first. A slot of a
 * surface point has three such sums: irradiance about its shading normal, incident light, and the part of the latter
 * that came last (worker/pass/reference.h). */
#define KILN_GPU_BOTH_SUM_WORDS 9u
#define KILN_GPU_BOTH_POINT_WORDS 27u

/* ---- paths from surface points ---- */

/* Surface point at which a slot's path begins. */
struct kiln_gpu_point_path {
    KILN_VECTOR shading, axis; /* unit; rays are cosine-distributed about `axis` */
    KILN_WORD point;           /* of the block */
    KILN_WORD key, seed;       /* key of random numbers; seed of the first ray's random decisions */
    KILN_WORD goes;            /* 1: the first ray is to be traced */
    /* weights of the first ray's radiance: in irradiance about the shading normal, and in incident light */
    KILN_REAL32 irradiance, incident;
};
KILN_SIZE_IS(kiln_gpu_point_path, 48);

/* Data beside a shadow ray: the part of its light that is last, and weights as in struct kiln_gpu_point_path. */
struct kiln_gpu_point_ray {
    KILN_REAL32 last[3];
    KILN_REAL32 irradiance, incident;
};
KILN_SIZE_IS(kiln_gpu_point_ray, 20);

/* Sums over the paths of a point so far, each stored as a pair of floats (high, low): irradiance about the shading
 * normal, incident light, and the last part of the latter (three colours each); then the irradiance's luminance for
 * each quarter of the samples. */
#define KILN_GPU_POINT_SUMS 13u
struct kiln_gpu_point_sums {
    KILN_REAL32 high[KILN_GPU_POINT_SUMS], low[KILN_GPU_POINT_SUMS];
};
KILN_SIZE_IS(kiln_gpu_point_sums, 104);

/* Batch of surface points of one block, for the kernels. */
struct kiln_gpu_both_points {
    KILN_ADDRESS points, parts, states; /* as in struct kiln_gpu_chunk */
    KILN_ADDRESS sobol;                 /* Sobol' words of the first sample; dimensions are sobol_stride apart */
    KILN_ADDRESS paths;                 /* struct kiln_gpu_point_path of each slot */
    KILN_ADDRESS rays;                  /* struct kiln_gpu_point_ray of each shadow ray */
    KILN_WORD origin;                   /* number in the block of the batch's first point, modulo 2^32 */
    KILN_WORD sobol_stride, samples, reuse, stream, first_sample; /* as in struct kiln_gpu_hemisphere */
    KILN_WORD light_seed;                                         /* seed of the points' own light paths */
    KILN_WORD reserved;
};
KILN_SIZE_IS(kiln_gpu_both_points, 80);

/* Work counts that a dispatch leaves for the next ones; 0 before it. They count paths, rays and pairs; the count of
 * pairs includes those that found no room. After rays of scenes with gloss have been traced to their next surfaces,
 * `shadows` counts the paths that hit gloss, and `paths` the others. */
struct kiln_gpu_both_tally {
    KILN_WORD paths, shadows, pairs;
    KILN_WORD left; /* paths that have more pairs */
};
KILN_SIZE_IS(kiln_gpu_both_tally, 16);

/* Counters of the kernels; 0 before the first light path. */
struct kiln_gpu_both_counts {
    KILN_WORD vertices; /* light vertices, including those that found no room */
    KILN_WORD photons;
    KILN_WORD stopped;  /* 1: the device has ended a loop early */
    KILN_WORD too_much; /* 1: overflow: a path brings more than the sums can hold */
};
KILN_SIZE_IS(kiln_gpu_both_counts, 16);

/* Data that all threads share while one sample is traced. */
struct kiln_gpu_both {
    KILN_ADDRESS chances, up_to;   /* real: struct kiln_emission */
    KILN_ADDRESS parents, leaves;  /* words: members of struct kiln_emission */
    KILN_ADDRESS counts;           /* struct kiln_gpu_both_counts */
    KILN_ADDRESS vertices, last;   /* light vertices; index of each light path's last vertex, KILN_GPU_NONE: none */
    KILN_ADDRESS photons;          /* sorted by bucket; unordered within a bucket */
    KILN_ADDRESS begins, ends;     /* words: begin and end of each bucket in `photons` */
    KILN_ADDRESS film;             /* three numbers of 64 bits a pixel, the lower half first: struct kiln_splat_film */
    KILN_ADDRESS subpaths, eyes;   /* of each slot: struct kiln_gpu_subpath, struct kiln_gpu_eye_vertex */
    KILN_ADDRESS lands;            /* of each slot, where light lands: struct kiln_gpu_land_path */
    KILN_ADDRESS radiance;         /* of each slot: KILN_GPU_BOTH_SUM_WORDS words */
    KILN_ADDRESS pairs, shadows;   /* struct kiln_gpu_both_pair, struct kiln_gpu_shadow_ray */
    KILN_ADDRESS points;           /* struct kiln_gpu_both_points; 0: paths begin at a camera */
    KILN_WORD unit_power;          /* the slots' sums count in units of 2^unit_power (signed), W/(m2 sr) */
    KILN_WORD room;                /* capacity of `vertices` */
    KILN_WORD lights, bucket_mask; /* how many lights there are; the number of buckets, less 1 */
    KILN_WORD most;                /* maximum number of bounces, below 2^30 */
    KILN_WORD endless;             /* 1: paths have no last bounce */
    KILN_WORD path_length;         /* maximum number of rays of a path, or KILN_PATH_LENGTH_ANY */
    KILN_WORD width, height, orthographic;
    KILN_VECTOR position, forward, right, up; /* struct kiln_path_parameters */
    KILN_REAL32 lens_radius, focus_distance;
    KILN_VECTOR centre; /* of the sphere about the scene, m, */
    KILN_REAL32 sphere; /* and its radius */
    KILN_REAL32 extent; /* m, of the scene */
    KILN_REAL32 pixel;  /* area of a pixel at distance 1; m2 when orthographic */
    KILN_REAL32 paths;  /* number of light paths */
    KILN_REAL32 unit;   /* of the film, W/(m2 sr) */
    KILN_REAL32 radius; /* m: merging radius */
    KILN_REAL32 area;   /* m2: pi radius^2 times the number of light paths that are merged; 0: no merging */
};
KILN_SIZE_IS(kiln_gpu_both, 280);
