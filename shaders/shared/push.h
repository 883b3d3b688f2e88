/* Push constants: the arguments of each kernel, one struct a kernel or family of kernels. A kernel selects its struct
 * with KILN_PUSH(struct) (shaders/kernel.glsl) and reads push.scene and so on; the host fills in the same struct. The
 * first member is always the address of struct kiln_gpu_scene. The size is at most 128 bytes, which every device
 * supports. */
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

/* trace/trace.rahit, trace.rchit, trace.rmiss: shaders that read the scene of the kernel that traces. */
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

/* validity.comp: counts the buried places of each point. */
struct kiln_gpu_validity_push {
    KILN_ADDRESS scene;
    KILN_STRUCT kiln_gpu_chunk chunk; /* `list`: points that are tested a second time */
    KILN_ADDRESS sobol;               /* words: dimension d's samples from d * sobol_stride on */
    KILN_ADDRESS counts;              /* words: count of thread x */
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
    KILN_ADDRESS probes;      /* struct kiln_gpu_radiance_probes; 0: rays have unlimited length */
    KILN_ADDRESS near_probes; /* words: mask of the probes that each point of the block sees */
};
KILN_SIZE_IS(kiln_gpu_gather_push, 128);
KILN_OFFSET_IS(kiln_gpu_gather_push, hemisphere, 56);
KILN_OFFSET_IS(kiln_gpu_gather_push, probes, 112);

/* keep.comp: the bounce pass whose rays are kept. */
struct kiln_gpu_rows_push {
    KILN_ADDRESS scene;
    KILN_STRUCT kiln_gpu_chunk chunk;
    KILN_STRUCT kiln_gpu_hemisphere hemisphere;
    KILN_ADDRESS weights; /* weights of rays at smooth meshes, written by row_weights.comp; 0: none needed */
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
    KILN_REAL32 distance; /* m: surfaces farther away do not occlude */
    KILN_WORD reserved;
};
KILN_SIZE_IS(kiln_gpu_occlusion_push, 120);
KILN_OFFSET_IS(kiln_gpu_occlusion_push, hemisphere, 56);
KILN_OFFSET_IS(kiln_gpu_occlusion_push, distance, 112);

/* gather_reduce.comp, occlusion_reduce.comp, directional_reduce.comp: kernels that add up the slices. */
struct kiln_gpu_hemisphere_reduce_push {
    KILN_ADDRESS scene;
    KILN_STRUCT kiln_gpu_chunk chunk;
    KILN_ADDRESS slices, results;
    KILN_ADDRESS rays; /* words: shadow rays of each point of the chunk, if there are any */
    KILN_WORD samples, per_quarter, split;
    KILN_WORD reserved;
};
KILN_SIZE_IS(kiln_gpu_hemisphere_reduce_push, 96);
KILN_OFFSET_IS(kiln_gpu_hemisphere_reduce_push, slices, 56);
KILN_OFFSET_IS(kiln_gpu_hemisphere_reduce_push, samples, 80);

/* guided_learn.comp, guided_reduce.comp: kernels that add up the slices of the guided pass. */
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

/* replay.comp, replay_held.comp, replay_groups.comp: the gather pass from stored rows; replay_take.comp: takes answers
 * over on the device. */
struct kiln_gpu_replay_push {
    KILN_ADDRESS scene;
    KILN_STRUCT kiln_gpu_chunk chunk;
    KILN_ADDRESS lights;  /* packed radiosity: point i under light l at i * lights + l; `lights` is set in the kernel */
    KILN_ADDRESS rows;    /* words: the row of the chunk's point x from x * (1 + samples) on */
    KILN_ADDRESS weights; /* row_weights.comp */
    /* point x under light l has number x * lights + l; floats for replay_held.comp and replay_groups.comp */
    KILN_ADDRESS results;
    KILN_ADDRESS held; /* of replay_take.comp: struct kiln_gpu_held */
    KILN_WORD64 first; /* for replay_take.comp: this rank's point of x = 0 */
    KILN_WORD samples;
    /* samples a slice of a point that is not buried; a partly buried point has `split` times fewer */
    KILN_WORD slice, split;
    /* for replay_groups.comp: number of lights, and of all surface points (unused rows may name others) */
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
    KILN_ADDRESS bytes;     /* for held.comp: buffer of one light's data to or from the host */
    KILN_WORD light;        /* the light of `bytes` */
    KILN_WORD groups;       /* for held_powers.comp: number of groups whose sums are added */
    KILN_WORD first, count; /* for held_direct.comp: range of points */
};
KILN_SIZE_IS(kiln_gpu_held_push, 40);

/* probes.comp: radiance probes. */
struct kiln_gpu_probes_push {
    KILN_ADDRESS scene;
    KILN_ADDRESS positions; /* three floats each */
    KILN_ADDRESS sobol;     /* words: dimension d's samples from d * sobol_stride on */
    KILN_ADDRESS slices; /* floats: component c of slice s of probe x at (s * KILN_GPU_PROBE_FLOATS + c) * count + x */
    KILN_WORD64 index;   /* global number of the first probe */
    KILN_WORD count, samples, slice_first, slice_count, sobol_stride, seed;
    KILN_REAL32 far;  /* m: stands in for the distance of escapes */
    KILN_WORD leaves; /* struct kiln_probe_parameters */
    KILN_WORD lights; /* maximum number of light samples of a probe that are kept */
    KILN_WORD reserved;
    KILN_ADDRESS found; /* kept rays and light samples (probe_found.glsl); 0: none are kept */
};
KILN_SIZE_IS(kiln_gpu_probes_push, 88);
KILN_OFFSET_IS(kiln_gpu_probes_push, count, 40);
KILN_OFFSET_IS(kiln_gpu_probes_push, far, 64);
KILN_OFFSET_IS(kiln_gpu_probes_push, found, 80);

/* probes_groups.comp: the light of groups at probes. */
struct kiln_gpu_probe_groups_push {
    KILN_ADDRESS scene;
    KILN_ADDRESS found;     /* as in struct kiln_gpu_probes_push, as are lights, count and samples */
    KILN_ADDRESS radiosity; /* packed radiosity of each point for all groups */
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
    KILN_WORD64 index; /* number in the picture of the first pixel */
    KILN_WORD count, first_sample, samples, seed, width, height, bounces;
    KILN_WORD orthographic;                   /* 0 or 1 */
    KILN_VECTOR position, forward, right, up; /* struct kiln_path_parameters */
    KILN_REAL32 extent;                       /* m, of the scene */
    KILN_REAL32 lens_radius, focus_distance;
    KILN_WORD path_length; /* maximum number of rays of a path, or KILN_PATH_LENGTH_ANY */
    KILN_ADDRESS turn;     /* struct kiln_gpu_path_turn, in scenes with gloss; for path_add.comp also words to clear */
};
KILN_SIZE_IS(kiln_gpu_path_push, 128);
KILN_OFFSET_IS(kiln_gpu_path_push, count, 24);
KILN_OFFSET_IS(kiln_gpu_path_push, position, 56);
KILN_OFFSET_IS(kiln_gpu_path_push, extent, 104);

#include "shaders/shared/layout_bidirectional.h"

/* Kernels of the bidirectional pass, and of light paths that land. Each unfinished path has a slot. */
struct kiln_gpu_both_push {
    KILN_ADDRESS scene;
    KILN_ADDRESS both;    /* struct kiln_gpu_both */
    KILN_ADDRESS sums;    /* struct kiln_gpu_path_sums or kiln_gpu_landing of slot 0; or words to clear */
    KILN_ADDRESS list;    /* words: slots of the threads; 0: thread x has slot x */
    KILN_ADDRESS onward;  /* words: output, slots of the paths that go on, or slots sorted by what they hit */
    KILN_ADDRESS tally;   /* struct kiln_gpu_both_tally */
    KILN_ADDRESS counter; /* word: number of items, of which at most `count` from `offset` on are done; 0: `count` */
    KILN_WORD64 pixel;    /* pixel, or landing light path, of slot 0; splats: first pixel that light is connected to */
    KILN_WORD64 pixels;   /* splats: number of pixels from there on */
    KILN_WORD count;      /* threads */
    KILN_WORD offset;     /* first item: thread 0 takes number `offset` of the list, slots, pairs, rays or vertices */
    KILN_WORD path;       /* number of the light path in slot 0 */
    KILN_WORD first;      /* the light path whose last vertex is the first of `last` */
    KILN_WORD seed, light_key; /* seed of the camera paths; key of this sample's light paths */
    KILN_WORD sampled;         /* number of the camera's sample */
    KILN_WORD stage;           /* KILN_GPU_PHOTONS_... of photons.comp, KILN_GPU_STAGE_... of paths */
    KILN_WORD light;           /* KILN_GPU_OF_...: kind of the paths */
    KILN_WORD room;            /* path_pairs.comp: capacity for pairs; path_rays.comp: begin of gloss in `onward` */
    KILN_ADDRESS halts[2];     /* words: if one is not 0, the kernel does nothing; 0: no such word */
};
KILN_SIZE_IS(kiln_gpu_both_push, 128);
KILN_OFFSET_IS(kiln_gpu_both_push, count, 72);
#define KILN_GPU_OF_CAMERA 0u       /* paths of the camera or of surface points */
#define KILN_GPU_OF_LIGHT 1u        /* light paths, numbered over the whole sample */
#define KILN_GPU_OF_LIGHT_OWN 2u    /* light paths, numbered by the surface point that owns them */
#define KILN_GPU_STAGE_BEGIN 0u     /* the first ray of a path */
#define KILN_GPU_STAGE_ARRIVE 1u    /* evaluates the hit, and samples the next ray */
#define KILN_GPU_STAGE_END 2u       /* adds the radiance of camera paths to their pixels */
#define KILN_GPU_RAYS_NEXT 0u       /* path_rays.comp: traces each path to its next surface */
#define KILN_GPU_RAYS_TO_PATHS 1u   /* shadow rays of light to paths */
#define KILN_GPU_RAYS_TO_CAMERA 2u  /* shadow rays of light to the camera */
#define KILN_GPU_PAIRS_CONNECTED 0u /* path_pairs.comp: light vertices of the pixel's own light path */
#define KILN_GPU_PAIRS_OWN 1u       /* photons of the pixel's own light path */
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
    KILN_ADDRESS both;  /* struct kiln_gpu_both, with only the light tree and the number of lights set; a struct
                         * kiln_gpu_land lies before it */
    KILN_ADDRESS areas; /* floats: unburied area of each point of the chunk, m2 */
};
KILN_SIZE_IS(kiln_gpu_weighed_push, 128);
KILN_OFFSET_IS(kiln_gpu_weighed_push, hemisphere, 56);
KILN_OFFSET_IS(kiln_gpu_weighed_push, both, 112);

#include "shaders/shared/layout_patches.h"

/* patches.comp: sums the light of patch nodes at points. */
struct kiln_gpu_patches_push {
    KILN_ADDRESS scene;
    KILN_STRUCT kiln_gpu_chunk chunk;
    KILN_ADDRESS points;         /* struct kiln_gpu_patch of each point of the chunk */
    KILN_ADDRESS facing, shapes; /* struct kiln_gpu_patch_node_facing and kiln_gpu_patch_node_shape of each node */
    KILN_ADDRESS slices; /* floats: c of row r of a point at (r * KILN_GPU_PATCH_FLOATS + c) * chunk.total + x */
    KILN_WORD nodes, nodes_a_row;
    KILN_WORD row_first;                 /* row of y = 0 */
    KILN_REAL32 most_factor, most_added; /* struct kiln_patches_parameters */
    KILN_WORD reserved;
    KILN_ADDRESS sight; /* struct kiln_gpu_sight */
    KILN_ADDRESS open;  /* words: masks of open pairs, two words a group; word w of point x at w * chunk.total + x */
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

/* sight_forget.comp: thread (x, y) clears outdated visibility of group x of this rank's tile run y. */
struct kiln_gpu_sight_forget_push {
    KILN_ADDRESS sight;
    KILN_ADDRESS same;   /* two words a group: mask of columns whose known visibility is still valid */
    KILN_ADDRESS forget; /* word of each of this rank's tile runs: 1: forget everything */
    KILN_WORD runs;
    KILN_WORD reserved;
};
KILN_SIZE_IS(kiln_gpu_sight_forget_push, 32);

/* sight_open.comp and sight_store.comp: copy word y of point x of a chunk from kept visibility to the masks of
 * patches.comp, and back. sight_close.comp: processes tile run x of the chunk. */
struct kiln_gpu_sight_push {
    KILN_ADDRESS sight;
    KILN_ADDRESS points, open; /* as in struct kiln_gpu_patches_push */
    KILN_ADDRESS columns;      /* two words a group: mask of the columns of the step's nodes */
    KILN_WORD total;           /* points of the chunk */
    KILN_WORD run_first, runs; /* this rank's tile runs */
    KILN_WORD reserved;
};
KILN_SIZE_IS(kiln_gpu_sight_push, 48);

#include "shaders/shared/layout_links.h"

/* links.comp: adds up links. */
struct kiln_gpu_links_push {
    KILN_ADDRESS scene;
    KILN_STRUCT kiln_gpu_chunk chunk;
    KILN_ADDRESS points;               /* struct kiln_gpu_linked_point of each point of the chunk */
    KILN_ADDRESS runs, links, tinted;  /* arrays of the chunk */
    KILN_ADDRESS nodes, leaves, light; /* arrays of the link tree */
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

/* link_rays.comp: transmission between two places. */
struct kiln_gpu_link_rays_push {
    KILN_ADDRESS scene;
    KILN_ADDRESS rays;           /* struct kiln_gpu_link_ray */
    KILN_ADDRESS through;        /* floats: transmission of each ray, three a ray if surfaces are partly transparent */
    KILN_ADDRESS places, others; /* struct kiln_gpu_link_place: of all points; of leaf points in the tree's order */
    KILN_WORD count;
    KILN_WORD reserved;
};
KILN_SIZE_IS(kiln_gpu_link_rays_push, 48);

#include "shaders/shared/layout_bvh.h"

#endif
