/* Push constants: what each kernel is started with, one struct a kernel or family of kernels. A kernel says which with
 * KILN_PUSH(struct) (shaders/kernel.glsl) and reads push.scene and so on; the host fills in the same struct. The first
 * member is always the address of struct kiln_gpu_scene. At most 128 bytes, which every device takes. */
#ifndef KILN_SHADERS_SHARED_PUSH_H
#define KILN_SHADERS_SHARED_PUSH_H

#include "shaders/shared/layout.h"

#ifdef KILN_GLSL
#    define KILN_OFFSET_IS(type, member, offset)
#else
#    include <stddef.h>
#    define KILN_OFFSET_IS(type, member, offset)                                                                       \
        _Static_assert(offsetof(struct type, member) == (offset), "shaders and C disagree on " #member " of " #type)
#endif

/* trace/trace.rahit, trace.rchit, trace.rmiss: they read the scene of the kernel that traces. */
struct kiln_gpu_trace_push {
    KILN_ADDRESS scene;
};
KILN_SIZE_IS(kiln_gpu_trace_push, 8);

/* intersect.comp: nearest hits, or occlusion, of rays. */
struct kiln_gpu_intersect_push {
    KILN_ADDRESS scene;
    KILN_ADDRESS origins, directions; /* three floats each */
    KILN_ADDRESS hits;                /* struct kiln_gpu_hit */
    KILN_WORD count;
    KILN_WORD reserved;
};
KILN_SIZE_IS(kiln_gpu_intersect_push, 40);
KILN_OFFSET_IS(kiln_gpu_intersect_push, count, 32);

/* validity.comp: how many places of each point are buried. */
struct kiln_gpu_validity_push {
    KILN_ADDRESS scene;
    KILN_STRUCT kiln_gpu_chunk chunk; /* `list`: the points of the second look */
    KILN_ADDRESS sobol;               /* words: dimension d's samples from d * sobol_stride on */
    KILN_ADDRESS counts;              /* word of thread x */
    KILN_WORD stream, sobol_stride, looks;
    KILN_WORD reserved;
};
KILN_SIZE_IS(kiln_gpu_validity_push, 88);
KILN_OFFSET_IS(kiln_gpu_validity_push, sobol, 56);
KILN_OFFSET_IS(kiln_gpu_validity_push, stream, 72);

/* choose.comp, direct.comp, direct_precise.comp, direct_reduce.comp, direct_groups.comp: the direct pass. */
struct kiln_gpu_direct_push {
    KILN_ADDRESS scene;
    KILN_STRUCT kiln_gpu_chunk chunk;
    KILN_STRUCT kiln_gpu_direct pass;
};
KILN_SIZE_IS(kiln_gpu_direct_push, 128);
KILN_OFFSET_IS(kiln_gpu_direct_push, pass, 56);

/* directional.comp: light by direction. The push constants of all kernels that sample the
 * hemisphere begin like these. */
struct kiln_gpu_hemisphere_push {
    KILN_ADDRESS scene;
    KILN_STRUCT kiln_gpu_chunk chunk;
    KILN_STRUCT kiln_gpu_hemisphere hemisphere;
};
KILN_SIZE_IS(kiln_gpu_hemisphere_push, 112);
KILN_OFFSET_IS(kiln_gpu_hemisphere_push, hemisphere, 56);

/* gather.comp: the bounce pass. */
struct kiln_gpu_gather_push {
    KILN_ADDRESS scene;
    KILN_STRUCT kiln_gpu_chunk chunk;
    KILN_STRUCT kiln_gpu_hemisphere hemisphere;
    KILN_ADDRESS probes;      /* struct kiln_gpu_radiance_probes; 0: rays have no end */
    KILN_ADDRESS near_probes; /* words: of each point of the block, which probes it sees */
};
KILN_SIZE_IS(kiln_gpu_gather_push, 128);
KILN_OFFSET_IS(kiln_gpu_gather_push, hemisphere, 56);
KILN_OFFSET_IS(kiln_gpu_gather_push, probes, 112);

/* keep.comp: the bounce pass whose rays are kept. */
struct kiln_gpu_rows_push {
    KILN_ADDRESS scene;
    KILN_STRUCT kiln_gpu_chunk chunk;
    KILN_STRUCT kiln_gpu_hemisphere hemisphere;
    KILN_ADDRESS weights; /* of rays of smooth meshes, as row_weights.comp leaves them; 0: nobody asks */
    KILN_ADDRESS rows;    /* words: the row of the chunk's point x from x * (1 + samples) on */
};
KILN_SIZE_IS(kiln_gpu_rows_push, 128);
KILN_OFFSET_IS(kiln_gpu_rows_push, hemisphere, 56);
KILN_OFFSET_IS(kiln_gpu_rows_push, rows, 120);

/* directions.comp: the directions pass. */
struct kiln_gpu_directions_push {
    KILN_ADDRESS scene;
    KILN_STRUCT kiln_gpu_chunk chunk;
    KILN_STRUCT kiln_gpu_hemisphere hemisphere;
    KILN_ADDRESS lights; /* packed radiosity of each point */
    KILN_ADDRESS set;    /* directions.glsl */
};
KILN_SIZE_IS(kiln_gpu_directions_push, 128);
KILN_OFFSET_IS(kiln_gpu_directions_push, hemisphere, 56);
KILN_OFFSET_IS(kiln_gpu_directions_push, lights, 112);

/* guided.comp: the guided pass. */
struct kiln_gpu_guided_push {
    KILN_ADDRESS scene;
    KILN_STRUCT kiln_gpu_chunk chunk;
    KILN_STRUCT kiln_gpu_hemisphere hemisphere;
    KILN_ADDRESS probes; /* as in struct kiln_gpu_gather_push */
    KILN_ADDRESS guided; /* struct kiln_gpu_guided */
};
KILN_SIZE_IS(kiln_gpu_guided_push, 128);
KILN_OFFSET_IS(kiln_gpu_guided_push, hemisphere, 56);
KILN_OFFSET_IS(kiln_gpu_guided_push, probes, 112);

/* occlusion.comp: ambient occlusion. */
struct kiln_gpu_occlusion_push {
    KILN_ADDRESS scene;
    KILN_STRUCT kiln_gpu_chunk chunk;
    KILN_STRUCT kiln_gpu_hemisphere hemisphere;
    KILN_REAL32 distance; /* m: what is farther away does not count */
    KILN_WORD reserved;
};
KILN_SIZE_IS(kiln_gpu_occlusion_push, 120);
KILN_OFFSET_IS(kiln_gpu_occlusion_push, hemisphere, 56);
KILN_OFFSET_IS(kiln_gpu_occlusion_push, distance, 112);

/* gather_reduce.comp, occlusion_reduce.comp, directional_reduce.comp: they add up the slices. */
struct kiln_gpu_hemisphere_reduce_push {
    KILN_ADDRESS scene;
    KILN_STRUCT kiln_gpu_chunk chunk;
    KILN_ADDRESS slices, results;
    KILN_ADDRESS rays; /* word: shadow rays of a point of the chunk, where there are any */
    KILN_WORD samples, per_quarter, split;
    KILN_WORD reserved;
};
KILN_SIZE_IS(kiln_gpu_hemisphere_reduce_push, 96);
KILN_OFFSET_IS(kiln_gpu_hemisphere_reduce_push, slices, 56);
KILN_OFFSET_IS(kiln_gpu_hemisphere_reduce_push, samples, 80);

/* guided_learn.comp, guided_reduce.comp: the same of the guided pass. */
struct kiln_gpu_guided_reduce_push {
    KILN_ADDRESS scene;
    KILN_STRUCT kiln_gpu_chunk chunk;
    KILN_ADDRESS slices, results;
    KILN_ADDRESS rays;
    KILN_WORD samples, per_quarter, split;
    KILN_WORD reserved;
    KILN_ADDRESS guided; /* struct kiln_gpu_guided */
};
KILN_SIZE_IS(kiln_gpu_guided_reduce_push, 104);
KILN_OFFSET_IS(kiln_gpu_guided_reduce_push, guided, 96);

#include "shaders/shared/layout_held.h"
#include "shaders/shared/layout_regression.h"

/* replay.comp, replay_held.comp, replay_groups.comp: the gather pass from rows; replay_take.comp, which takes answers
 * over on the device. */
struct kiln_gpu_replay_push {
    KILN_ADDRESS scene;
    KILN_STRUCT kiln_gpu_chunk chunk;
    KILN_ADDRESS lights;  /* packed radiosity: of point i under light l pair i * lights + l, of so many lights */
    KILN_ADDRESS rows;    /* words: the row of the chunk's point x from x * (1 + samples) on */
    KILN_ADDRESS weights; /* row_weights.comp */
    /* of point x under light l: number x * lights + l; of replay_held.comp and replay_groups.comp floats */
    KILN_ADDRESS results;
    KILN_ADDRESS held; /* of replay_take.comp: struct kiln_gpu_held */
    KILN_WORD64 first; /* likewise: the own point of x = 0 */
    KILN_WORD samples;
    /* of a whole point a slice has so many samples, of a partly buried one `split` times fewer */
    KILN_WORD slice, split;
    /* of replay_groups.comp: lights, and all surface points (rows that nobody asks for may name others) */
    KILN_WORD groups, points;
    KILN_WORD reserved;
};
KILN_SIZE_IS(kiln_gpu_replay_push, 128);
KILN_OFFSET_IS(kiln_gpu_replay_push, lights, 56);
KILN_OFFSET_IS(kiln_gpu_replay_push, first, 96);

/* held.comp, held_direct.comp, held_powers.comp: light that stays on the device. */
struct kiln_gpu_held_push {
    KILN_ADDRESS scene;
    KILN_ADDRESS held;      /* struct kiln_gpu_held */
    KILN_ADDRESS bytes;     /* of held.comp: what the host has brought of a light, or fetches */
    KILN_WORD light;        /* whose that is */
    KILN_WORD groups;       /* of held_powers.comp: whose sums are added */
    KILN_WORD first, count; /* of held_direct.comp: points */
};
KILN_SIZE_IS(kiln_gpu_held_push, 40);

/* probes.comp: radiance probes. */
struct kiln_gpu_probes_push {
    KILN_ADDRESS scene;
    KILN_ADDRESS positions; /* three floats each */
    KILN_ADDRESS sobol;     /* words: dimension d's samples from d * sobol_stride on */
    KILN_ADDRESS slices; /* floats: component c of slice s of probe x at (s * KILN_GPU_PROBE_FLOATS + c) * count + x */
    KILN_WORD64 index;   /* of the first probe among all */
    KILN_WORD count, samples, slice_first, slice_count, sobol_stride, seed;
    KILN_REAL32 far;  /* m: stands in for the distance of escapes */
    KILN_WORD leaves; /* struct kiln_probe_parameters */
    KILN_WORD lights; /* light samples of a probe that are kept at most; */
    KILN_WORD reserved;
    KILN_ADDRESS found; /* what is kept (probe_found.glsl); 0: nothing */
};
KILN_SIZE_IS(kiln_gpu_probes_push, 88);
KILN_OFFSET_IS(kiln_gpu_probes_push, count, 40);
KILN_OFFSET_IS(kiln_gpu_probes_push, far, 64);
KILN_OFFSET_IS(kiln_gpu_probes_push, found, 80);

/* probes_groups.comp: the light of groups at probes. */
struct kiln_gpu_probe_groups_push {
    KILN_ADDRESS scene;
    KILN_ADDRESS found;     /* as above, as are lights, count and samples */
    KILN_ADDRESS radiosity; /* packed, of each point that of all groups */
    KILN_ADDRESS results;   /* KILN_GPU_PROBE_GROUP_FLOATS floats of each group of each probe */
    KILN_WORD count, samples, lights, groups;
};
KILN_SIZE_IS(kiln_gpu_probe_groups_push, 48);

/* radiance.comp: radiance at the elements of probes' maps. */
struct kiln_gpu_radiance_push {
    KILN_ADDRESS scene;
    KILN_ADDRESS positions; /* three floats each */
    KILN_ADDRESS results;   /* struct kiln_radiance_result: four floats each */
    KILN_ADDRESS sobol;     /* words: dimension d's samples from d * sobol_stride on */
    KILN_WORD64 index;      /* of the first item */
    KILN_WORD count, samples, sobol_stride, seed, stream;
    KILN_WORD basis, side, period; /* struct kiln_radiance_parameters */
};
KILN_SIZE_IS(kiln_gpu_radiance_push, 72);
KILN_OFFSET_IS(kiln_gpu_radiance_push, count, 40);
KILN_OFFSET_IS(kiln_gpu_radiance_push, basis, 60);

/* probes_reduce.comp: adds up the slices. */
struct kiln_gpu_probes_reduce_push {
    KILN_ADDRESS scene;
    KILN_ADDRESS slices, results;
    KILN_WORD count, slice_count;
};
KILN_SIZE_IS(kiln_gpu_probes_reduce_push, 32);
KILN_OFFSET_IS(kiln_gpu_probes_reduce_push, count, 24);

#include "shaders/shared/layout_path.h"
#include "shaders/shared/layout_path_apart.h"

/* path.glsl: paths of pixels. */
struct kiln_gpu_path_push {
    KILN_ADDRESS scene;
    KILN_ADDRESS sums; /* struct kiln_gpu_path_sums of thread x */
    KILN_WORD64 index; /* of the first pixel in the picture */
    KILN_WORD count, first_sample, samples, seed, width, height, bounces;
    KILN_WORD orthographic;                   /* 0 or 1 */
    KILN_VECTOR position, forward, right, up; /* struct kiln_path_parameters */
    KILN_REAL32 extent;                       /* m, of the scene */
    KILN_REAL32 lens_radius, focus_distance;
    KILN_WORD path_length; /* KILN_PATH_LENGTH_ANY, or what it is at most */
    KILN_ADDRESS turn; /* struct kiln_gpu_path_turn, in scenes with gloss; of path_add.comp also words to set to 0 */
};
KILN_SIZE_IS(kiln_gpu_path_push, 128);
KILN_OFFSET_IS(kiln_gpu_path_push, count, 24);
KILN_OFFSET_IS(kiln_gpu_path_push, position, 56);
KILN_OFFSET_IS(kiln_gpu_path_push, extent, 104);

#include "shaders/shared/layout_bidirectional.h"

/* The kernels of the bidirectional pass, and of light paths that land. A slot has a path under way. */
struct kiln_gpu_both_push {
    KILN_ADDRESS scene;
    KILN_ADDRESS both;    /* struct kiln_gpu_both */
    KILN_ADDRESS sums;    /* struct kiln_gpu_path_sums or kiln_gpu_landing of slot 0; or words to set to 0 */
    KILN_ADDRESS list;    /* words: the slots that threads have; 0: thread x has slot x */
    KILN_ADDRESS onward;  /* words: the slots whose paths go on are put here, or those sorted by what they met */
    KILN_ADDRESS tally;   /* struct kiln_gpu_both_tally */
    KILN_ADDRESS counter; /* a word: what is to be done, no more than `count` from `offset` on; 0: all of `count` is */
    KILN_WORD64 pixel;    /* of slot 0, or its light path that lands; of splats: the first that light is connected to */
    KILN_WORD64 pixels;   /* of splats: how many there are from it on */
    KILN_WORD count;      /* threads */
    KILN_WORD offset;     /* thread 0 is number `offset` of the list, the slots, pairs, rays or vertices */
    KILN_WORD path;       /* of light: that in slot 0 */
    KILN_WORD first;      /* the path of light whose last vertex is the first of `last` */
    KILN_WORD seed, light_key; /* of the camera's paths; of this sample's paths of light */
    KILN_WORD sampled;         /* the camera's sample */
    KILN_WORD stage;           /* KILN_GPU_PHOTONS_... of photons.comp, KILN_GPU_STAGE_... of paths */
    KILN_WORD light;           /* KILN_GPU_OF_...: whose the paths are */
    KILN_WORD room;            /* path_pairs.comp: room for pairs; path_rays.comp: first of gloss in `onward` */
    KILN_ADDRESS halts[2];     /* words: nothing is to be done where one of them is not 0; 0: no such word */
};
KILN_SIZE_IS(kiln_gpu_both_push, 128);
KILN_OFFSET_IS(kiln_gpu_both_push, count, 72);
#define KILN_GPU_OF_CAMERA 0u       /* or surface points, */
#define KILN_GPU_OF_LIGHT 1u        /* light, numbered over the whole sample, */
#define KILN_GPU_OF_LIGHT_OWN 2u    /* or by the surface point whose own it is */
#define KILN_GPU_STAGE_BEGIN 0u     /* the first ray of a path */
#define KILN_GPU_STAGE_ARRIVE 1u    /* what it has met, and the next ray */
#define KILN_GPU_STAGE_END 2u       /* what paths of the camera have brought is added to their pixels */
#define KILN_GPU_RAYS_NEXT 0u       /* path_rays.comp: the next surface of each path, */
#define KILN_GPU_RAYS_TO_PATHS 1u   /* what is in the way of light to paths, */
#define KILN_GPU_RAYS_TO_CAMERA 2u  /* to the camera */
#define KILN_GPU_PAIRS_CONNECTED 0u /* path_pairs.comp: vertices of light of the pixel's own path, */
#define KILN_GPU_PAIRS_OWN 1u       /* photons of that path, */
#define KILN_GPU_PAIRS_NEAR 2u      /* photons of all paths */
#define KILN_GPU_PHOTONS_CLEAR 0u
#define KILN_GPU_PHOTONS_COUNT 1u
#define KILN_GPU_PHOTONS_BEGIN 2u
#define KILN_GPU_PHOTONS_PLACE 3u

#include "shaders/shared/layout_land.h"

#include "shaders/shared/layout_apart.h"

/* weighed.comp: the weighed pass. */
struct kiln_gpu_weighed_push {
    KILN_ADDRESS scene;
    KILN_STRUCT kiln_gpu_chunk chunk;
    KILN_STRUCT kiln_gpu_hemisphere hemisphere;
    KILN_ADDRESS both;  /* struct kiln_gpu_both, of which the light tree and the number of lights are set; before it
                         * lies a struct kiln_gpu_land */
    KILN_ADDRESS areas; /* floats: of each point of the chunk m2 that are not buried */
};
KILN_SIZE_IS(kiln_gpu_weighed_push, 128);
KILN_OFFSET_IS(kiln_gpu_weighed_push, hemisphere, 56);
KILN_OFFSET_IS(kiln_gpu_weighed_push, both, 112);

#include "shaders/shared/layout_patches.h"

/* patches.comp: pairs of points and nodes. */
struct kiln_gpu_patches_push {
    KILN_ADDRESS scene;
    KILN_STRUCT kiln_gpu_chunk chunk;
    KILN_ADDRESS points;         /* struct kiln_gpu_patch of each point of the chunk */
    KILN_ADDRESS facing, shapes; /* struct kiln_gpu_node_facing and kiln_gpu_node_shape of each node */
    KILN_ADDRESS slices; /* floats: c of row r of a point at (r * KILN_GPU_PATCH_FLOATS + c) * chunk.total + x */
    KILN_WORD nodes, nodes_a_row;
    KILN_WORD row_first;                 /* row of y = 0 */
    KILN_REAL32 most_factor, most_added; /* struct kiln_patches_parameters */
    KILN_WORD reserved;
    KILN_ADDRESS sight; /* struct kiln_gpu_sight */
    KILN_ADDRESS open;  /* words: w of point x at w * chunk.total + x; two a group, bits of open pairs */
};
KILN_SIZE_IS(kiln_gpu_patches_push, 128);
KILN_OFFSET_IS(kiln_gpu_patches_push, nodes, 88);

/* patches_reduce.comp: adds up the rows. */
struct kiln_gpu_patches_reduce_push {
    KILN_ADDRESS scene;
    KILN_STRUCT kiln_gpu_chunk chunk;
    KILN_ADDRESS slices, results; /* results: struct kiln_gpu_patch_sums */
    KILN_ADDRESS rays;            /* KILN_GPU_PAIRS_WORDS words a point */
    KILN_WORD rows;
    KILN_WORD reserved;
};
KILN_SIZE_IS(kiln_gpu_patches_reduce_push, 88);
KILN_OFFSET_IS(kiln_gpu_patches_reduce_push, rows, 80);

/* sight_forget.comp: group x of own tile run y. */
struct kiln_gpu_sight_forget_push {
    KILN_ADDRESS sight;
    KILN_ADDRESS same;   /* two words a group: columns of which something may be known still */
    KILN_ADDRESS forget; /* word of each own tile run: 1: nothing is */
    KILN_WORD runs;
    KILN_WORD reserved;
};
KILN_SIZE_IS(kiln_gpu_sight_forget_push, 32);

/* sight_open.comp and sight_store.comp: word y of point x of a chunk, between what is kept and what patches.comp reads
 * and writes. sight_close.comp: tile run x of the chunk. */
struct kiln_gpu_sight_push {
    KILN_ADDRESS sight;
    KILN_ADDRESS points, open; /* as in struct kiln_gpu_patches_push */
    KILN_ADDRESS columns;      /* two words a group: those of the step's nodes */
    KILN_WORD total;           /* points, */
    KILN_WORD run_first, runs; /* and own tile runs */
    KILN_WORD reserved;
};
KILN_SIZE_IS(kiln_gpu_sight_push, 48);

#include "shaders/shared/layout_links.h"

/* links.comp: adds up links. */
struct kiln_gpu_links_push {
    KILN_ADDRESS scene;
    KILN_STRUCT kiln_gpu_chunk chunk;
    KILN_ADDRESS points;               /* struct kiln_gpu_linked_point of each point of the chunk */
    KILN_ADDRESS runs, links, tinted;  /* of the chunk */
    KILN_ADDRESS nodes, leaves, light; /* of the tree */
    KILN_ADDRESS slices; /* floats: c of row r of a point at (r * KILN_GPU_LINK_FLOATS + c) * chunk.total + x */
    KILN_WORD row_first; /* row of y = 0 */
    KILN_WORD node_count;
};
KILN_SIZE_IS(kiln_gpu_links_push, 128);
KILN_OFFSET_IS(kiln_gpu_links_push, row_first, 120);

/* links_reduce.comp: adds up the rows. */
struct kiln_gpu_links_reduce_push {
    KILN_ADDRESS scene;
    KILN_STRUCT kiln_gpu_chunk chunk;
    KILN_ADDRESS points, runs;    /* as above */
    KILN_ADDRESS slices, results; /* results: struct kiln_gpu_link_sums */
};
KILN_SIZE_IS(kiln_gpu_links_reduce_push, 88);

/* link_rays.comp: what comes through between two places. */
struct kiln_gpu_link_rays_push {
    KILN_ADDRESS scene;
    KILN_ADDRESS rays;           /* struct kiln_gpu_link_ray */
    KILN_ADDRESS through;        /* floats: one of each ray, or three where surfaces let light through in part */
    KILN_ADDRESS places, others; /* struct kiln_gpu_link_place: of all points; of those in the tree's order */
    KILN_WORD count;
    KILN_WORD reserved;
};
KILN_SIZE_IS(kiln_gpu_link_rays_push, 48);

#include "shaders/shared/layout_bvh.h"

#endif
