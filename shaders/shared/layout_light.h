/* Lights on the device; part of shaders/shared/layout.h. */

#define KILN_GPU_KIND_AREA 1u /* bits of the specialisation constant LIGHT_KINDS */
#define KILN_GPU_KIND_PUNCTUAL 2u
#define KILN_GPU_KIND_SUN 4u
#define KILN_GPU_KIND_SKY 8u
#define KILN_GPU_KIND_IMAGE 16u
#define KILN_GPU_KIND_TEXTURED 32u

#define KILN_GPU_LIGHT_TWO_SIDED 1u /* flags of area lights and clusters */
#define KILN_GPU_LIGHT_HAS_TEXTURE 2u
#define KILN_GPU_LIGHT_IS_SPOT 1u /* flag of point lights */

/* Lights. The arrays hold structs of shaders/shared/layout_light_real.h, in double if the device has it, else in float.
 */
struct kiln_gpu_lights {
    KILN_ADDRESS nodes, areas, points, directionals;
    KILN_ADDRESS marginal, conditional; /* float: as in struct kiln_lights */
    /* real: cos(pi y / height), y = 0 .. height; then the difference of each to the next, which with many rows is too
     * small to compute from the cosines in floats */
    KILN_ADDRESS rows;
    KILN_ADDRESS texels; /* float: the image, RGB, times its factor */
    KILN_ADDRESS groups; /* struct kiln_gpu_light_groups; 0: no light by groups is computed */
    KILN_WORD area_count, directional_count;
    KILN_WORD width, height; /* of the image */
    KILN_REAL32 rotation;    /* radians about +y */
    KILN_REAL32 sky[3];      /* radiance of a constant sky */
    KILN_REAL32 mean[3];     /* mean radiance of the environment */
    KILN_WORD environment;   /* 1: the environment emits light */
};
KILN_SIZE_IS(kiln_gpu_lights, 120);

/* Groups of lights (worker/light/light_groups.h). */
struct kiln_gpu_light_groups {
    KILN_ADDRESS of_tree, of_directional; /* words */
    KILN_ADDRESS blocks;                  /* struct kiln_gpu_light_block of each area light */
    KILN_WORD count, of_environment, sky_divisions, reserved;
};
KILN_SIZE_IS(kiln_gpu_light_groups, 40);

struct kiln_gpu_light_block { /* struct kiln_light_block */
    KILN_REAL32 at[2], along1[2], along2[2];
    KILN_WORD columns, rows;
};
KILN_SIZE_IS(kiln_gpu_light_block, 32);

/* Choices that choose.comp leaves for the kernels that trace. `what`: kind in the two highest bits, index in the
 * others. */
#define KILN_GPU_CHOICE_KIND_SHIFT 30u
/* flag in `samples`: a single area light, computed in doubles if the device has them */
#define KILN_GPU_CHOICE_PRECISE 0x80000000u
/* kind in addition to those of shaders/lights.glsl: a node that is a target (shaders/area_light_sampler.glsl) */
#define KILN_GPU_CHOICE_TARGET 3u
struct kiln_gpu_choice {
    KILN_WORD what, samples;
};
KILN_SIZE_IS(kiln_gpu_choice, 8);

/* A direct pass over a chunk of points, in `rows` = 4 `slices` `split` rows a point. Thread q * slices + s takes slice
 * s of quarter q of every choice's samples, and row (q * slices + s) * split; for partly buried points, each of whose
 * slices is cut in as many again, the kernel runs with `slices` so many times larger and `split` 1. The other kernels
 * get the former. Where points differ in their number of samples, `samples` is 0, each point's number is in its state
 * (KILN_GPU_STATE_SAMPLES_SHIFT), from which each has slices and so rows of its own (shaders/shared/slices.h), and
 * `slices` says how many rows all points have together.
 *
 * `scratch` holds these arrays strided by `room` >= the chunk's points, each beginning at a multiple of 8 bytes
 * (shaders/direct.glsl computes where):
 *
 *   word places[room]: where `samples` is 0, else absent: the number of the point's first row among those of all, and
 *                from bit KILN_GPU_DIRECT_ROW_BITS on, less 1, how many rows its next one comes after that
 *   struct kiln_gpu_direct_sums sums[rows * room], at row * room + point, or where the place says: see
 *                shaders/shared/layout_light_real.h
 *   struct kiln_gpu_choice choices[slots * room], at i * room + point; slots >= clusters of the cut +
 *                directional_count + 1
 *   float luminances[slots * rows * room], for each choice i as the sums are: sum over the row's samples of choice i,
 *                for choices of KILN_QUARTERS_FROM samples and more
 *   word counts[room]: number of choices of a point; with KILN_GPU_COUNT_PRECISE where some of them are precise
 *   word pilot_rays[room]: where directional lights have pilots (direct_pilot.comp)
 *   float groups[count * GROUP_FLOATS * rows * room], where the light of groups is found besides: of each group
 *                (shaders/light_groups.glsl) GROUP_FLOATS floats, for each of these as the sums are: sums over the
 *                samples of all choices, each divided by how many its choice has */
#define KILN_GPU_COUNT_PRECISE 0x80000000u
#define KILN_GPU_DIRECT_ROW_BITS 26 /* 6 bits are left, for up to 64 points of a tile run */
struct kiln_gpu_direct {
    /* one struct kiln_gpu_result a point of the chunk; for direct_groups.comp GROUP_FLOATS floats a group */
    KILN_ADDRESS results;
    KILN_ADDRESS sobol; /* words: dimension d's points from d * sobol_stride on */
    KILN_ADDRESS scratch;
    KILN_ADDRESS rays; /* words: number of shadow rays of each point of the chunk */
    KILN_WORD room, slots, samples, limit, sobol_stride;
    KILN_WORD row_first; /* thread (x, y) takes row y + row_first of point x */
    KILN_WORD slices, split;
    KILN_WORD stream;
    KILN_WORD software; /* 1: a software device (kiln_slices_of) */
};
KILN_SIZE_IS(kiln_gpu_direct, 72);
