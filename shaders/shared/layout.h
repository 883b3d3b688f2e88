/* Data on the device, as both C and GLSL must know it: every struct once, in scalar layout, which is C's. Included by
 * GLSL and by C, which checks sizes at compile time; tests/unit/test_shared.c checks the offsets in the kernels.
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

/* ---- the scene's surfaces: what a hit needs to know (worker/scene/geometry.h, worker/store/store.h) ---- */

struct kiln_gpu_record { /* struct kiln_hit_record */
    KILN_REAL32 texel[6];
    KILN_WORD object, material;
};
KILN_SIZE_IS(kiln_gpu_record, 32);

#include "shaders/shared/layout_store_lightmap.h"
#include "shaders/shared/layout_store_octree.h"

/* ---- surface points made ready for sampling ---- */

#define KILN_GPU_POINT_PARTIAL 1u /* edges unused: parts[first_part .. first_part + part_count) */
#define KILN_GPU_POINT_ONE_NORMAL 2u
#define KILN_GPU_POINT_SMOOTH 4u /* the shading normal may differ from the geometric one */
/* something is not everywhere on it: its mask is parts[first_part + part_count], and behind it stand the triangles of
 * its parts, or the one triangle of a point that is not partial */
#define KILN_GPU_POINT_MASKED 8u
/* its material is taken with its gloss: at parts[first_part - KILN_GPU_POINT_GLOSS_PARTS] stands what is in
 * layout_point_gloss.h */
#define KILN_GPU_POINT_GLOSS 16u
#define KILN_GPU_POINT_GLOSS_PARTS 4u
#define KILN_GPU_POINT_RECEIVES_ONLY 32u /* its object is lit, and met by no ray */
/* its rays begin above it (shaders/shared/lift.h): behind the parts, and the mask if there is one, are their triangles
 */
#define KILN_GPU_POINT_LIFTED 64u

/* Position of a whole point = origin + s edge_s + t edge_t, the offset off the surface included. */
struct kiln_gpu_point {
    KILN_VECTOR origin, edge_s, edge_t;
    KILN_VECTOR normal;  /* geometric, unit; of a partial point its first piece's */
    KILN_VECTOR shading; /* unit */
    KILN_REAL32 offset;  /* m along the normal that positions carry (whole points) */
    KILN_WORD key;       /* hash of (seed, object, texel) */
    KILN_WORD tile_key;  /* hash of (seed, object, tile) */
    KILN_WORD flags;
    KILN_WORD first_part, part_count; /* partial points: also those that are partly buried */
    KILN_REAL32 present;              /* see struct kiln_point_result */
    KILN_VECTOR centre;               /* of the point, for choosing lights */
    KILN_REAL32 spread;               /* m: no part of it is farther from `centre` */
};
KILN_SIZE_IS(kiln_gpu_point, 104);

/* A triangle of a partial point; positions carry the offset: p + b1 e1 + b2 e2. */
struct kiln_gpu_part {
    KILN_VECTOR p, e1, e2, normal;
    KILN_REAL32 until; /* share of the point's area up to this part's end; the last is 1 */
    KILN_REAL32 offset;
};
KILN_SIZE_IS(kiln_gpu_part, 56);

/* A point's mask (struct kiln_mask of worker/scene/footprint.h), as large as a part. */
struct kiln_gpu_mask {
    KILN_WORD cells[KILN_MASK_WORDS];
    KILN_WORD count; /* bits that are set, at least 1 */
    KILN_REAL32 most;
    KILN_WORD reserved[4];
};
KILN_SIZE_IS(kiln_gpu_mask, 56);

/* Where a part of a masked or lifted point is on its world triangle, as large as a part: the weights of corners 1 and 2
 * at p + b1 e1 + b2 e2 are weight + b1 along_e1 + b2 along_e2. Of a whole point: at (s, t) in the place of (b1, b2). */
struct kiln_gpu_part_triangle {
    KILN_WORD triangle;
    KILN_REAL32 weight[2], along_e1[2], along_e2[2];
    KILN_REAL32 lift[6]; /* struct kiln_lift */
    KILN_WORD reserved[1];
};
KILN_SIZE_IS(kiln_gpu_part_triangle, 56);

/* State of a point after the validity pass: a word each. */
#define KILN_GPU_STATE_INVALID 0u
#define KILN_GPU_STATE_VALID 1u
#define KILN_GPU_STATE_BURIED 2u /* partly: positions are drawn again while they are buried */
/* In a pass over points that differ in their number of samples the number stands above the state, which are the lowest
 * bits. Points that are left out are not valid then. */
#define KILN_GPU_STATE_SAMPLES_SHIFT 2u
#define KILN_GPU_STATE_MASK 3u

/* The points that a kernel works on: thread x has point `first + x`, or the point that `list` (of words, 0: none) names
 * at first + x. Answers stand by x of the chunk: point index - origin. */
struct kiln_gpu_chunk {
    KILN_ADDRESS points, parts, states, list;
    KILN_WORD first, count; /* threads */
    KILN_WORD origin;       /* index of the chunk's first point */
    KILN_WORD total;        /* points of the chunk, valid or not */
};
KILN_SIZE_IS(kiln_gpu_chunk, 48);

/* A pass that samples the hemisphere over points (shaders/hemisphere.glsl), its samples in slices. */
struct kiln_gpu_hemisphere {
    KILN_ADDRESS sobol; /* words: dimension d's samples from d * sobol_stride on */
    /* floats: component c of row r of a point at (r * floats + c) * chunk.total + point - origin, with so many `floats`
     * a slice */
    KILN_ADDRESS slices;
    KILN_WORD samples, stream, reuse, sobol_stride;
    KILN_WORD per_quarter; /* slices a quarter */
    KILN_WORD row_first;   /* slice of y = 0 */
    KILN_WORD slice;       /* samples of a slice */
    KILN_WORD row_step;    /* slice y goes to row y * row_step */
    /* number of the first sample in the sequence, of which `sobol` begins there; chances hang on a sample's number */
    KILN_WORD first_sample;
    KILN_WORD reserved;
};
KILN_SIZE_IS(kiln_gpu_hemisphere, 56);

/* A slice of the gather pass has so many floats: incident, irradiance (3 each), escaped, blocked, luminance of
 * irradiance. */
#define KILN_GPU_SLICE_FLOATS 9u
#define KILN_GPU_SLICE_TINTED_FLOATS 12u /* in scenes with tinted surfaces; glass (3) is the last */
#define KILN_GPU_SLICE_GLOSS 3u          /* so many more in kernels that follow chains: gloss */
/* One of the occlusion pass: open, direction (3). */
#define KILN_GPU_OCCLUSION_FLOATS 4u
/* One of the directional pass: radiance of its harmonics (3 each), shadow rays. */
#define KILN_GPU_DIRECTIONAL_FLOATS 13u

/* ---- radiance probes ---- */

struct kiln_gpu_radiance_probes { /* struct kiln_radiance_probes */
    KILN_STRUCT kiln_probe_grid grid;
    KILN_ADDRESS positions; /* three floats each */
    KILN_ADDRESS data;      /* grid.floats floats each */
};
KILN_SIZE_IS(kiln_gpu_radiance_probes, 88);

/* ---- answers ---- */

struct kiln_gpu_result { /* struct kiln_point_result */
    KILN_REAL32 irradiance[3], incident[3];
    KILN_REAL32 error, escaped, blocked;
    KILN_REAL32 glass[3], gloss[3];
    KILN_REAL32 present;
    KILN_WORD count;
};
KILN_SIZE_IS(kiln_gpu_result, 68);

/* Words of the result that the direct and the gather pass hand to the host: incident (3) and the error; then, of gather
 * rays, escaped and blocked, as floats, or, where they are whole numbers of at most KILN_GPU_SHORT_MOST rays, as the
 * lower and the upper half of one word; irradiance (3) where it is not the same as incident; then, where the scene has
 * any, glass (3) and gloss (3) of gather rays, and present. The rest the host knows:
 * worker/backend/vulkan/answers.c. */
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

/* ---- the root: one buffer, whose address every kernel gets ---- */

struct kiln_gpu_scene {
    KILN_STRUCT kiln_gpu_trace trace;
    KILN_STRUCT kiln_gpu_materials materials;
    KILN_STRUCT kiln_gpu_lights lights;
    KILN_ADDRESS records;
    KILN_STRUCT kiln_gpu_store store;
    KILN_ADDRESS radiosity;      /* of the store's places, packed */
    KILN_WORD opaque_count;      /* world triangles from opaque_count on may let rays through */
    KILN_WORD object_count;      /* lightmaps from here on are those of backs: worker/scene/surface.h */
    KILN_WORD64 slot_last;       /* of octrees: the number of slots of bricks, a power of two, less 1 */
    KILN_ADDRESS path_triangles; /* struct kiln_gpu_path_triangle of each world triangle; 0: nobody asks for them */
    KILN_WORD chain_length;      /* surfaces of a chain that are met for certain */
    KILN_WORD reserved;
};

#endif
