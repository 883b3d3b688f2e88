/* Layout of device data: each struct is defined once for C and GLSL, in scalar layout, which equals C's. C checks sizes
 * at compile time; tests/unit/test_shared.c checks the offsets in the kernels.
 *
 * Addresses are 64-bit device addresses (0: there is none). Positions are relative to the scene's centre, in metres. */
#ifndef KILN_SHADERS_LAYOUT_H
#define KILN_SHADERS_LAYOUT_H

#include "shaders/shared/language.h"

#ifdef KILN_GLSL
#    define KILN_ADDRESS uint64_t
#    define KILN_WORD64 uint64_t
#    define KILN_WORD uint
#    define KILN_REAL32 float
#    define KILN_SIZE_IS(type, size)
#else
#    define KILN_ADDRESS uint64_t
#    define KILN_WORD64 uint64_t
#    define KILN_WORD uint32_t
#    define KILN_REAL32 float
#    define KILN_SIZE_IS(type, size)                                                                                   \
        _Static_assert(sizeof(struct type) == (size), "shaders and C disagree on struct " #type)
#endif

#include "shaders/shared/divided.h"
#include "shaders/shared/mask.h"
#include "shaders/shared/passage.h"
#include "shaders/shared/radiance_probe.h"
#include "shaders/shared/surface.h"

#define KILN_GPU_NONE KILN_NONE

/* ---- surfaces of the scene: data that is read at a hit (worker/scene/geometry.h, worker/store/store.h) ---- */

struct kiln_gpu_record { /* struct kiln_hit_record */
    KILN_REAL32 texel[6];
    KILN_WORD object, material;
};
KILN_SIZE_IS(kiln_gpu_record, 32);

#include "shaders/shared/layout_store_lightmap.h"
#include "shaders/shared/layout_store_octree.h"

/* ---- surface points made ready for sampling ---- */

#define KILN_GPU_POINT_PARTIAL 1u /* edges unused: parts[first_piece .. first_piece + part_count) */
#define KILN_GPU_POINT_ONE_NORMAL 2u
#define KILN_GPU_POINT_SMOOTH 4u /* the shading normal may differ from the geometric one */
/* the surface exists only on a part of the point: its mask is parts[first_piece + part_count]. The mask is followed by
 * the triangles of its parts, or by the one triangle of a point that is not partial */
#define KILN_GPU_POINT_MASKED 8u
/* glossy material: its data (layout_point_gloss.h) begins at parts[first_piece - KILN_GPU_POINT_GLOSS_PIECES] */
#define KILN_GPU_POINT_GLOSS 16u
#define KILN_GPU_POINT_GLOSS_PIECES 4u
#define KILN_GPU_POINT_RECEIVES_ONLY 32u /* receiver-only object: lit, but no ray hits it */
/* lifted ray origins (shaders/shared/lift.h): the parts, and the mask if there is one, are followed by their triangles
 */
#define KILN_GPU_POINT_LIFTED 64u

/* Position of a whole point = origin + s edge_s + t edge_t, the offset off the surface included. */
struct kiln_gpu_point {
    KILN_VECTOR origin, edge_s, edge_t;
    KILN_VECTOR normal;  /* geometric, unit; for a partial point that of its first piece */
    KILN_VECTOR shading; /* unit */
    KILN_REAL32 offset;  /* distance of positions off the surface along the normal, m (whole points) */
    KILN_WORD key;       /* hash of (seed, object, texel) */
    KILN_WORD tile_key;  /* hash of (seed, object, tile) */
    KILN_WORD flags;
    KILN_WORD first_piece, part_count; /* of partial points, including partly buried ones */
    KILN_REAL32 present;               /* see struct kiln_point_result */
    KILN_VECTOR centre;                /* of the point, for choosing lights */
    KILN_REAL32 spread;                /* largest distance of the point's surface from `centre`, m */
};
KILN_SIZE_IS(kiln_gpu_point, 104);

/* A triangle of a partial point. Positions are p + b1 e1 + b2 e2, with the offset off the surface included. */
struct kiln_gpu_piece {
    KILN_VECTOR p, e1, e2, normal;
    KILN_REAL32 until; /* cumulative fraction of the point's area, including this part; the last is 1 */
    KILN_REAL32 offset;
};
KILN_SIZE_IS(kiln_gpu_piece, 56);

/* A point's mask (struct kiln_mask of worker/scene/footprint.h), as large as a piece. */
struct kiln_gpu_mask {
    KILN_WORD cells[KILN_MASK_WORDS];
    KILN_WORD count; /* bits that are set, at least 1 */
    KILN_REAL32 most;
    KILN_WORD reserved[4];
};
KILN_SIZE_IS(kiln_gpu_mask, 56);

/* Location of a part of a masked or lifted point on its world triangle; as large as a part. At p + b1 e1 + b2 e2 the
 * barycentric weights of corners 1 and 2 are weight + b1 along_e1 + b2 along_e2. For a whole point (s, t) replaces (b1,
 * b2). */
struct kiln_gpu_piece_triangle {
    KILN_WORD triangle;
    KILN_REAL32 weight[2], along_e1[2], along_e2[2];
    KILN_REAL32 lift[6]; /* struct kiln_lift */
    KILN_WORD reserved[1];
};
KILN_SIZE_IS(kiln_gpu_piece_triangle, 56);

/* State of a point after the validity pass; one word per point. */
#define KILN_GPU_STATE_INVALID 0u
#define KILN_GPU_STATE_VALID 1u
#define KILN_GPU_STATE_BURIED 2u /* partly buried: buried positions are sampled again */
/* Number of samples of a point, in the bits above the state, for passes in which it differs between points. Points left
 * out of such a pass are not valid. */
#define KILN_GPU_STATE_SAMPLES_SHIFT 2u
#define KILN_GPU_STATE_MASK 3u

/* Chunk of points for a kernel: thread x has point `first + x`, or point list[first + x] (`list`: array of words; 0:
 * none). Results are indexed by point index - origin. */
struct kiln_gpu_chunk {
    KILN_ADDRESS points, parts, states, list;
    KILN_WORD first, count; /* threads */
    KILN_WORD origin;       /* index of the chunk's first point */
    KILN_WORD total;        /* points of the chunk, valid or not */
};
KILN_SIZE_IS(kiln_gpu_chunk, 48);

/* Parameters of a pass that samples the hemisphere over points (shaders/hemisphere.glsl). Samples are divided into
 * slices. */
struct kiln_gpu_hemisphere {
    KILN_ADDRESS sobol; /* words: dimension d's samples from d * sobol_stride on */
    /* array of floats: component c of row r of a point is at (r * floats + c) * chunk.total + point - origin, where
     * `floats` is the number of floats in a slice */
    KILN_ADDRESS slices;
    KILN_WORD samples, stream, reuse, sobol_stride;
    KILN_WORD per_quarter; /* number of slices in a quarter */
    KILN_WORD row_first;   /* slice of y = 0 */
    KILN_WORD slice;       /* number of samples in a slice */
    KILN_WORD row_step;    /* slice y goes to row y * row_step */
    /* number in the sequence of the first sample, with which `sobol` begins; random numbers depend on it */
    KILN_WORD first_sample;
    KILN_WORD reserved;
};
KILN_SIZE_IS(kiln_gpu_hemisphere, 56);

/* Floats in a slice of the gather pass: incident, irradiance (3 each), escaped, blocked, luminance of irradiance. */
#define KILN_GPU_SLICE_FLOATS 9u
#define KILN_GPU_SLICE_TINTED_FLOATS 12u /* in scenes with tinted surfaces; glass (3) is the last */
#define KILN_GPU_SLICE_GLOSS 3u          /* additional floats in kernels that follow chains: gloss */
/* Floats in a slice of the occlusion pass: open, direction (3). */
#define KILN_GPU_OCCLUSION_FLOATS 4u
/* Floats in a slice of the directional pass: radiance for each harmonic (3 each), shadow rays. */
#define KILN_GPU_DIRECTIONAL_FLOATS 13u

/* ---- radiance probes ---- */

struct kiln_gpu_radiance_probes { /* struct kiln_radiance_probes */
    KILN_STRUCT kiln_probe_grid grid;
    KILN_ADDRESS positions; /* three floats each */
    KILN_ADDRESS data;      /* grid.floats floats each */
};
KILN_SIZE_IS(kiln_gpu_radiance_probes, 88);

/* ---- results ---- */

struct kiln_gpu_result { /* struct kiln_point_result */
    KILN_REAL32 irradiance[3], incident[3];
    KILN_REAL32 error, escaped, blocked;
    KILN_REAL32 glass[3], gloss[3];
    KILN_REAL32 present;
    KILN_WORD count;
};
KILN_SIZE_IS(kiln_gpu_result, 68);

/* Short result, words that the direct and the gather pass send to the host, in this order: incident (3), error. For
 * gather rays: escaped and blocked, as floats, or, if they are integers of at most KILN_GPU_SHORT_MOST rays, as the
 * lower and the upper half of one word. irradiance (3), if it differs from incident. If the scene has any: glass (3)
 * and gloss (3) of gather rays, and present. The host knows the rest (worker/backend/vulkan/answers.c). */
#define KILN_GPU_SHORT_ERROR 3u
#define KILN_GPU_SHORT_RAYS 4u
#define KILN_GPU_SHORT_MOST 65535u

struct kiln_gpu_occlusion_result { /* struct kiln_occlusion_result */
    KILN_REAL32 open, direction[3], error;
    KILN_WORD count;
};
KILN_SIZE_IS(kiln_gpu_occlusion_result, 24);

struct kiln_gpu_directional_result { /* struct kiln_directional_result */
    KILN_REAL32 radiance[12];
    KILN_WORD count;
};
KILN_SIZE_IS(kiln_gpu_directional_result, 52);

#include "shaders/shared/layout_guide.h"
#include "shaders/shared/layout_trace.h"
#include "shaders/shared/layout_material.h"
#include "shaders/shared/layout_light.h"

/* ---- root struct: one buffer, whose address is passed to every kernel ---- */

struct kiln_gpu_scene {
    KILN_STRUCT kiln_gpu_trace trace;
    KILN_STRUCT kiln_gpu_materials materials;
    KILN_STRUCT kiln_gpu_lights lights;
    KILN_ADDRESS records;
    KILN_STRUCT kiln_gpu_store store;
    KILN_ADDRESS radiosity;      /* packed radiosity of the places of `store` */
    KILN_WORD opaque_count;      /* world triangles from opaque_count on may let rays through */
    KILN_WORD object_count;      /* lightmaps from this number on are those of backs (worker/scene/surface.h) */
    KILN_WORD64 slot_last;       /* for octrees: number of brick slots, a power of two, minus 1 */
    KILN_ADDRESS path_triangles; /* struct kiln_gpu_path_triangle of each world triangle; 0: not needed */
    KILN_WORD chain_length;      /* number of the surface from which roulette applies to every chain */
    KILN_WORD reserved;
};

#endif
