#include "coordinator/cli/options.h"

#include <string.h>

#define ARRAY_COUNT(array) (sizeof(array) / sizeof(array)[0])
#define AT(member) offsetof(struct kiln_job, member)

static const char *const backends[] = {"auto", "embree", "vulkan", NULL};
static const char *const traversals[] = {"auto", "compute", "pipeline", "all", "binary", "four", "eight", NULL}; /* enum kiln_traversal */
static const char *const shows[] = {"light", "texels", NULL};
static const char *const trusts[] = {"winding", "normals", NULL};
static const char *const methods[] = {"cells", NULL};
static const char *const schedules[] = {"lean", "equal", NULL}; /* in the order of enum kiln_schedule */
static const char *const exchanges[] = {"auto", "compact", "full", NULL}; /* in the order of enum kiln_exchange_form */
static const char *const rebalances[] = {"auto", "never", "always", NULL}; /* in the order of enum kiln_rebalance */
static const char *const units[] = {"auto", "radiometric", "photometric", NULL}; /* in the order of enum kiln_units_choice */
static const char *const formats[] = {"exr", "exr-half", "rgbm", "rgbe", "ktx2", NULL}; /* in the order of enum kiln_page_format */
static const char *const partitions[] = {"cells", "objects", NULL};
static const char *const side_choices[] = {"one", "two", NULL};
static const char *const qualities[] = {"draft", "preview", "production", "reference", NULL};
static const char *const instruction_sets[] = {"sse2", "sse4.2", "avx", "avx2", "avx512", NULL};

enum {
    READS_SCENE = KILN_FOR_BAKE | KILN_FOR_PLAN | KILN_FOR_INFO | KILN_FOR_CHECK | KILN_FOR_BENCH,
    TRACES = KILN_FOR_BAKE | KILN_FOR_BENCH | KILN_FOR_PLAN
};

#define MOST_SAMPLES 1048576.0

const struct kiln_option kiln_options[] = {
    {.name = "output", .group = "Files", .kind = KILN_OPTION_PATH, .value = "PATH",
     .help = "where the result goes, also -o; a folder of bake (SCENE-bake), plan, bench, submit; else a file",
     .commands = KILN_FOR_BAKE | KILN_FOR_VIEW | KILN_FOR_COMPARE | KILN_FOR_GENERATE | KILN_FOR_REPORT | KILN_FOR_BENCH |
                 KILN_FOR_SUBMIT | KILN_FOR_PLAN | KILN_FOR_EXPORT,
     .offset = AT(output)},
    {.name = "scene", .group = "Files", .kind = KILN_OPTION_PATH, .value = "SCENE", .shown = "where it was baked from",
     .help = "the scene file that was baked, should it have moved", .commands = KILN_FOR_EXPORT, .offset = AT(source)},
    {.name = "environment", .group = "Light", .kind = KILN_OPTION_ENVIRONMENT, .value = "none|R,G,B|IMAGE",
     .shown = "the scene's own", .help = "light from outside: constant radiance, or a lat-long .hdr or .exr",
     .commands = READS_SCENE, .offset = AT(environment)},
    {.name = "environment-scale", .group = "Light", .kind = KILN_OPTION_DOUBLE, .value = "FACTOR", .fallback = "1", .minimum = 0,
     .maximum = 1e12, .help = "multiplies the environment's radiance", .commands = READS_SCENE, .offset = AT(environment_scale)},
    {.name = "environment-rotation", .group = "Light", .kind = KILN_OPTION_DOUBLE, .value = "DEGREES", .fallback = "0",
     .minimum = -3600, .maximum = 3600, .help = "turns the environment about the upward axis", .commands = READS_SCENE,
     .offset = AT(environment_rotation)},
    {.name = "units", .group = "Light", .kind = KILN_OPTION_CHOICE_ENUM, .fallback = "auto", .choices = units,
     .help = "of lights and results: W/m2 or lux; auto: what the file says, else W/m2", .commands = KILN_FOR_BAKE | KILN_FOR_INFO,
     .offset = AT(units)},

    {.name = "backend", .group = "Where it runs", .kind = KILN_OPTION_CHOICE, .fallback = "auto", .choices = backends,
     .refusal = KILN_NO_DEVICE, .help = "what traces the rays; auto: vulkan where there is a fit GPU, else embree",
     .commands = TRACES | KILN_FOR_VIEW, .offset = AT(backend)},
    {.name = "device", .group = "Where it runs", .kind = KILN_OPTION_INT64, .value = "N", .fallback = "auto", .word = "auto",
     .word_value = -1, .minimum = 0, .maximum = 1023, .help = "GPU, as kiln info --devices numbers them; auto: the node's ranks take turns",
     .commands = TRACES | KILN_FOR_VIEW, .offset = AT(device)},
    {.name = "traversal", .group = "Where it runs", .kind = KILN_OPTION_CHOICE_ENUM, .fallback = "auto", .choices = traversals,
     .refusal = KILN_NO_DEVICE, .help = "how a GPU finds hits: compute shaders or its ray-tracing pipeline; auto: the faster one",
     .commands = TRACES | KILN_FOR_VIEW, .offset = AT(traversal)},
    {.name = "dispatch-time", .group = "Where it runs", .kind = KILN_OPTION_DOUBLE, .value = "MILLISECONDS", .fallback = "100", .minimum = 1,
     .maximum = 60000, .help = "how long a GPU may be kept busy at a stretch", .commands = TRACES | KILN_FOR_VIEW,
     .offset = AT(dispatch_time)},
    {.name = "device-memory", .group = "Where it runs", .kind = KILN_OPTION_DOUBLE, .value = "GIB", .fallback = "auto", .word = "auto",
     .minimum = 1e-3, .maximum = 1e6, .help = "of a GPU, that a rank may use; auto: its share of what is free",
     .commands = TRACES | KILN_FOR_VIEW, .offset = AT(device_memory)},
    {.name = "verify-share", .group = "Where it runs", .kind = KILN_OPTION_DOUBLE, .value = "SHARE", .fallback = "0", .minimum = 0, .maximum = 1,
     .help = "of the texels, traced again with Embree; the bake ends where they differ", .commands = TRACES, .offset = AT(verify_share)},
    {.name = "devices", .group = "Where it runs", .kind = KILN_OPTION_FLAG, .fallback = "false",
     .help = "lists what can trace here, and what is amiss with what cannot; takes no scene", .commands = KILN_FOR_INFO, .offset = AT(devices)},
    {.name = "threads", .group = "Where it runs", .kind = KILN_OPTION_UINT32, .value = "N", .fallback = "auto", .word = "auto",
     .minimum = 1, .maximum = 4096, .help = "threads a rank; auto: the cores it may use, shared with the node's ranks",
     .commands = TRACES | KILN_FOR_VIEW | KILN_FOR_SUBMIT, .offset = AT(threads)},
    {.name = "instruction-set", .group = "Where it runs", .kind = KILN_OPTION_CHOICE, .shown = "the best all ranks have",
     .choices = instruction_sets, .refusal = KILN_NO_DEVICE, .help = "holds Embree to one; the same one gives the same bits",
     .commands = TRACES | KILN_FOR_VIEW, .offset = AT(instruction_set)},

    {.name = "quality", .group = "Light transport", .kind = KILN_OPTION_CHOICE, .fallback = "preview", .choices = qualities,
     .help = "sets the sample counts, before any that are given one by one", .commands = TRACES, .offset = AT(quality)},
    {.name = "method", .group = "Light transport", .kind = KILN_OPTION_CHOICE, .fallback = "cells", .choices = methods,
     .help = "radiance cells: all surface points gather, bounce by bounce", .commands = TRACES, .offset = AT(method)},
    {.name = "bounces", .group = "Light transport", .kind = KILN_OPTION_INT64, .value = "N", .fallback = "all", .word = "all",
     .word_value = -1, .minimum = 0, .maximum = 10000, .help = "indirect bounces; all: while they carry energy, then a tail",
     .commands = TRACES, .offset = AT(bounces)},
    {.name = "tail", .group = "Light transport", .kind = KILN_OPTION_FLAG, .fallback = "false", .shown = "with --bounces all",
     .help = "add what later bounces would bring, as a geometric series", .commands = TRACES, .offset = AT(tail)},
    {.name = "schedule", .group = "Light transport", .kind = KILN_OPTION_CHOICE_ENUM, .fallback = "lean", .choices = schedules,
     .help = "lean: cheap bounces, one final gather; equal: samples-indirect in each bounce", .commands = TRACES,
     .offset = AT(schedule)},
    {.name = "samples-direct", .group = "Light transport", .kind = KILN_OPTION_UINT32, .value = "N", .shown = "by --quality",
     .minimum = 1, .maximum = MOST_SAMPLES, .help = "rays to lights a texel", .commands = TRACES,
     .offset = AT(samples_direct)},
    {.name = "samples-bounce", .group = "Light transport", .kind = KILN_OPTION_UINT32, .value = "N", .shown = "by --quality",
     .minimum = 1, .maximum = MOST_SAMPLES, .help = "gather rays a texel in each bounce", .commands = TRACES,
     .offset = AT(samples_bounce)},
    {.name = "samples-indirect", .group = "Light transport", .kind = KILN_OPTION_UINT32, .value = "N", .shown = "by --quality",
     .minimum = 1, .maximum = MOST_SAMPLES, .help = "gather rays a texel in the final gather", .commands = TRACES,
     .offset = AT(samples_indirect)},
    {.name = "seed", .group = "Light transport", .kind = KILN_OPTION_UINT64, .value = "N", .fallback = "0", .maximum = 0x1p64,
     .help = "of the random numbers", .commands = TRACES | KILN_FOR_GENERATE, .offset = AT(seed)},

    {.name = "texels-per-metre", .group = "Lightmaps", .kind = KILN_OPTION_DOUBLE, .value = "X", .fallback = "auto", .word = "auto",
     .minimum = 1e-12, .maximum = 1e12, .help = "density; auto: about 2^18 texels in the scene, up to 2^20 where charts lie close together", .commands = READS_SCENE,
     .offset = AT(texels_per_metre)},
    {.name = "lightmap-size", .group = "Lightmaps", .kind = KILN_OPTION_UINT32, .value = "TEXELS", .fallback = "auto", .word = "auto",
     .minimum = 1, .maximum = 32768, .help = "every lightmap N x N; auto: by density", .commands = READS_SCENE,
     .offset = AT(lightmap_size)},
    {.name = "lightmap-max", .group = "Lightmaps", .kind = KILN_OPTION_UINT32, .value = "TEXELS", .fallback = "4096", .minimum = 1,
     .maximum = 32768, .help = "the longest side a lightmap may have", .commands = READS_SCENE, .offset = AT(lightmap_max)},
    {.name = "repack", .group = "Lightmaps", .kind = KILN_OPTION_FLAG, .fallback = "false",
     .help = "lay charts of given UV sets out anew that lie less than two texels apart", .commands = READS_SCENE, .offset = AT(repack)},
    {.name = "objects", .group = "Lightmaps", .kind = KILN_OPTION_RULES, .value = "RULES", .shown = "none",
     .help = "of single objects: '{Chair*: {density-scale: 2}}'; also lightmap-size, exclude, role, sides", .commands = READS_SCENE,
     .offset = AT(objects)},
    {.name = "trust", .group = "Lightmaps", .kind = KILN_OPTION_CHOICE_FLAG, .fallback = "winding", .choices = trusts,
     .help = "what decides the front of triangles wound against their normals", .commands = READS_SCENE, .offset = AT(trust_normals)},
    {.name = "half", .group = "Lightmaps", .kind = KILN_OPTION_FLAG, .fallback = "false",
     .help = "half floats, where nothing overflows", .commands = KILN_FOR_BAKE, .offset = AT(half)},
    {.name = "stitch", .group = "Lightmaps", .kind = KILN_OPTION_FLAG, .fallback = "true",
     .help = "smooth the seams between charts of an object", .commands = KILN_FOR_BAKE, .offset = AT(stitch)},
    {.name = "sides", .group = "Lightmaps", .kind = KILN_OPTION_CHOICE_FLAG, .fallback = "one", .choices = side_choices,
     .help = "two: backs of double-sided surfaces get lightmaps too, in lightmaps/back", .commands = TRACES, .offset = AT(both_sides)},
    {.name = "error-map", .group = "Lightmaps", .kind = KILN_OPTION_FLAG, .fallback = "false",
     .help = "keep each texel's standard error as a layer", .commands = KILN_FOR_BAKE, .offset = AT(error_map)},
    {.name = "preview", .group = "Lightmaps", .kind = KILN_OPTION_FLAG, .fallback = "true", .help = "write preview.png",
     .commands = KILN_FOR_BAKE, .offset = AT(preview)},
    {.name = "export", .group = "Lightmaps", .kind = KILN_OPTION_FLAG, .fallback = "true",
     .help = "write scene.glb: the scene with the lightmaps' coordinates and links", .commands = KILN_FOR_BAKE, .offset = AT(export)},
    {.name = "format", .group = "Lightmaps", .kind = KILN_OPTION_CHOICE_ENUM, .fallback = "exr", .choices = formats,
     .help = "of the pages: OpenEXR, PNG with a common multiplier or exponent, KTX2 of half floats (no BC6H)", .commands = KILN_FOR_EXPORT,
     .offset = AT(format)},
    {.name = "range", .group = "Lightmaps", .kind = KILN_OPTION_DOUBLE, .value = "E", .fallback = "auto", .word = "auto", .minimum = 1e-30,
     .maximum = 1e30, .help = "irradiance that rgbm's 1 x 1 stands for, more is an error; auto: each page's largest", .commands = KILN_FOR_EXPORT,
     .offset = AT(range)},
    {.name = "atlas", .group = "Lightmaps", .kind = KILN_OPTION_UINT32, .value = "TEXELS", .fallback = "off", .word = "off", .minimum = 16,
     .maximum = 16384, .help = "many objects on a page of at most N x N, texels as they are", .commands = KILN_FOR_EXPORT, .offset = AT(atlas)},
    {.name = "drop-baked-lights", .group = "Lightmaps", .kind = KILN_OPTION_FLAG, .fallback = "false",
     .help = "leave punctual lights out, whose light is in the lightmaps; else they are marked", .commands = KILN_FOR_EXPORT,
     .offset = AT(drop_baked_lights)},

    {.name = "cell-size", .group = "Cells and probes", .kind = KILN_OPTION_DOUBLE, .value = "METRES", .fallback = "auto", .word = "auto",
     .minimum = 1e-12, .maximum = 1e12, .help = "side of a radiance cell", .commands = TRACES, .offset = AT(cell_size)},
    {.name = "partition", .group = "Cells and probes", .kind = KILN_OPTION_CHOICE_FLAG, .fallback = "cells", .choices = partitions,
     .help = "what is dealt out to the ranks as a whole", .commands = TRACES, .offset = AT(partition_objects)},
    {.name = "probe-spacing", .group = "Cells and probes", .kind = KILN_OPTION_DOUBLE, .value = "METRES", .fallback = "auto",
     .word = "auto", .minimum = 1e-12, .maximum = 1e12, .help = "between probes of the irradiance volume",
     .commands = TRACES, .offset = AT(probe_spacing)},
    {.name = "samples-probe", .group = "Cells and probes", .kind = KILN_OPTION_UINT32, .value = "N", .shown = "by --quality",
     .minimum = 0, .maximum = MOST_SAMPLES, .help = "rays a probe; 0: no volume", .commands = TRACES,
     .offset = AT(samples_probe)},

    {.name = "resume", .group = "Checkpoints and limits", .kind = KILN_OPTION_FLAG, .fallback = "true",
     .help = "go on from the checkpoint in the output folder; --no-resume discards it", .commands = KILN_FOR_BAKE, .offset = AT(resume)},
    {.name = "checkpoint-every", .group = "Checkpoints and limits", .kind = KILN_OPTION_DOUBLE, .value = "SECONDS", .fallback = "300",
     .minimum = 0, .maximum = 1e9, .help = "and after bounces, while that costs less than 2 %; 0: only when stopped",
     .commands = KILN_FOR_BAKE, .offset = AT(checkpoint_every)},
    {.name = "max-time", .group = "Checkpoints and limits", .kind = KILN_OPTION_DOUBLE, .value = "SECONDS", .fallback = "none", .word = "none",
     .minimum = 1e-3, .maximum = 1e9, .help = "save and end with 75 after so long; the same command goes on", .commands = KILN_FOR_BAKE, .offset = AT(max_time)},
    {.name = "watchdog", .group = "Checkpoints and limits", .kind = KILN_OPTION_DOUBLE, .value = "SECONDS", .fallback = "60", .minimum = 0,
     .maximum = 1e9, .help = "end with 76 when a rank gives no sign of life for so long; 0: never", .commands = KILN_FOR_BAKE, .offset = AT(watchdog)},

    {.name = "share-ranks", .group = "Ranks", .kind = KILN_OPTION_UINT32, .value = "N", .fallback = "all", .word = "all", .minimum = 1,
     .maximum = 1e6, .help = "of a host that hold geometry and radiosity together; 1: none do", .commands = KILN_FOR_BAKE | KILN_FOR_PLAN, .offset = AT(share_ranks)},
    {.name = "give-away", .group = "Ranks", .kind = KILN_OPTION_FLAG, .fallback = "true",
     .help = "ranks of a host that are done compute for those that are not (Embree)", .commands = KILN_FOR_BAKE | KILN_FOR_PLAN,
     .offset = AT(give_away)},
    {.name = "rebalance", .group = "Ranks", .kind = KILN_OPTION_CHOICE_ENUM, .fallback = "auto", .choices = rebalances,
     .help = "move points between ranks after a pass, by what they cost; auto: on CPUs, when it pays", .commands = KILN_FOR_BAKE | KILN_FOR_PLAN,
     .offset = AT(rebalance)},
    {.name = "exchange", .group = "Ranks", .kind = KILN_OPTION_CHOICE_ENUM, .fallback = "auto", .choices = exchanges,
     .help = "radiosity between bounces: 4 or 8 bytes a point; auto: 4 from 2^22 points on", .commands = KILN_FOR_BAKE | KILN_FOR_PLAN,
     .offset = AT(exchange)},
    {.name = "exchange-limit", .group = "Ranks", .kind = KILN_OPTION_UINT64, .value = "N", .fallback = "auto", .word = "auto", .minimum = 1,
     .maximum = 0x1p31, .help = "values in one message at most", .commands = KILN_FOR_BAKE, .offset = AT(exchange_limit)},
    {.name = "trace", .group = "Ranks", .kind = KILN_OPTION_PATH, .value = "FILE.json", .shown = "none",
     .help = "what each rank did when, for chrome://tracing and Perfetto", .commands = KILN_FOR_BAKE, .offset = AT(trace)},

    {.name = "camera", .group = "View", .kind = KILN_OPTION_STRING, .value = "NAME", .shown = "the first",
     .help = "a camera of the scene", .commands = KILN_FOR_VIEW, .offset = AT(camera)},
    {.name = "from", .group = "View", .kind = KILN_OPTION_POINT, .value = "X,Y,Z", .shown = "the camera's",
     .help = "where the eye is, metres", .commands = KILN_FOR_VIEW, .offset = AT(from)},
    {.name = "to", .group = "View", .kind = KILN_OPTION_POINT, .value = "X,Y,Z", .shown = "the camera's",
     .help = "what it looks at, metres", .commands = KILN_FOR_VIEW, .offset = AT(to)},
    {.name = "field-of-view", .group = "View", .kind = KILN_OPTION_DOUBLE, .value = "DEGREES", .fallback = "auto", .word = "auto",
     .minimum = 0.001, .maximum = 179, .help = "vertical angle; auto: the camera's, or 45", .commands = KILN_FOR_VIEW,
     .offset = AT(field_of_view)},
    {.name = "width", .group = "View", .kind = KILN_OPTION_UINT32, .value = "PIXELS", .fallback = "auto", .word = "auto", .minimum = 1,
     .maximum = 32768, .help = "of the image", .commands = KILN_FOR_VIEW, .offset = AT(width)},
    {.name = "height", .group = "View", .kind = KILN_OPTION_UINT32, .value = "PIXELS", .fallback = "auto", .word = "auto", .minimum = 1,
     .maximum = 32768, .help = "of the image", .commands = KILN_FOR_VIEW, .offset = AT(height)},
    {.name = "exposure", .group = "View", .kind = KILN_OPTION_DOUBLE, .value = "STOPS", .fallback = "0", .minimum = -100, .maximum = 100,
     .help = "added to the automatic exposure, powers of two", .commands = KILN_FOR_VIEW | KILN_FOR_BAKE, .offset = AT(exposure)},

    {.name = "show", .group = "View", .kind = KILN_OPTION_CHOICE_FLAG, .fallback = "light", .choices = shows,
     .help = "light, or the lightmaps' texels as a checkerboard", .commands = KILN_FOR_VIEW, .offset = AT(show_texels)},

    {.name = "ranks", .group = "Plan", .kind = KILN_OPTION_UINT32, .value = "N", .fallback = "1", .minimum = 1, .maximum = 1048576,
     .help = "how many ranks to plan for", .commands = KILN_FOR_PLAN, .offset = AT(ranks)},
    {.name = "node-memory", .group = "Plan", .kind = KILN_OPTION_DOUBLE, .value = "GIB", .fallback = "auto", .word = "auto",
     .minimum = 1e-3, .maximum = 1e9, .help = "memory of a node; auto: this machine's", .commands = KILN_FOR_PLAN,
     .offset = AT(node_memory)},
    {.name = "points", .group = "Plan", .kind = KILN_OPTION_UINT64, .value = "N", .fallback = "auto", .word = "auto", .minimum = 1,
     .maximum = 1e15, .help = "surface points of the scaling curve; auto: the scene's", .commands = KILN_FOR_PLAN, .offset = AT(points)},
    {.name = "bandwidth", .group = "Plan", .kind = KILN_OPTION_DOUBLE, .value = "GB/S", .fallback = "1.25", .minimum = 1e-6,
     .maximum = 1e6, .help = "of the network between nodes", .commands = KILN_FOR_PLAN, .offset = AT(node_bandwidth)},
    {.name = "latency", .group = "Plan", .kind = KILN_OPTION_DOUBLE, .value = "MICROSECONDS", .fallback = "30", .minimum = 0,
     .maximum = 1e9, .help = "of the network between nodes", .commands = KILN_FOR_PLAN, .offset = AT(node_latency)},

    {.name = "triangles", .group = "Generate", .kind = KILN_OPTION_UINT64, .value = "N", .fallback = "auto", .word = "auto",
     .minimum = 1, .maximum = 1e9, .help = "about how many (city, cornell-statue)", .commands = KILN_FOR_GENERATE,
     .offset = AT(triangles)},
    {.name = "columns", .group = "Generate", .kind = KILN_OPTION_UINT32, .value = "N", .fallback = "auto", .word = "auto",
     .minimum = 1, .maximum = 10000, .help = "rooms or lights along x (rooms, lights)", .commands = KILN_FOR_GENERATE,
     .offset = AT(columns)},
    {.name = "rows", .group = "Generate", .kind = KILN_OPTION_UINT32, .value = "N", .fallback = "auto", .word = "auto", .minimum = 1,
     .maximum = 10000, .help = "rooms or lights along z (rooms, lights)", .commands = KILN_FOR_GENERATE, .offset = AT(rows)},
    {.name = "albedo", .group = "Generate", .kind = KILN_OPTION_DOUBLE, .value = "SHARE", .fallback = "auto",
     .word = "auto", .word_value = -1, .minimum = 0, .maximum = 0.999, .help = "of the furnace's walls; auto: 0.5", .commands = KILN_FOR_GENERATE, .offset = AT(albedo)},

    {.name = "ranks", .group = "Bench", .kind = KILN_OPTION_STRING, .value = "N,N,...", .fallback = "1,2",
     .help = "numbers of ranks to bake with (scaling)", .commands = KILN_FOR_BENCH, .offset = AT(rank_counts)},
    {.name = "repeats", .group = "Bench", .kind = KILN_OPTION_UINT32, .value = "N", .fallback = "5", .minimum = 1, .maximum = 1000,
     .help = "runs of each measurement; the median counts", .commands = KILN_FOR_BENCH, .offset = AT(repeats)},

    {.name = "nodes", .group = "Batch job", .kind = KILN_OPTION_UINT32, .value = "N", .fallback = "1", .minimum = 1, .maximum = 1048576,
     .help = "how many nodes", .commands = KILN_FOR_SUBMIT, .offset = AT(nodes)},
    {.name = "gpus", .group = "Batch job", .kind = KILN_OPTION_UINT32, .value = "N", .fallback = "0", .maximum = 1024,
     .help = "GPUs of each node, one rank for each", .commands = KILN_FOR_SUBMIT, .offset = AT(gpus)},
    {.name = "ranks-per-node", .group = "Batch job", .kind = KILN_OPTION_UINT32, .value = "N", .fallback = "auto", .word = "auto",
     .minimum = 1, .maximum = 65536, .help = "auto: one a GPU, or one with all cores", .commands = KILN_FOR_SUBMIT | KILN_FOR_PLAN, .offset = AT(ranks_per_node)},
    {.name = "memory", .group = "Batch job", .kind = KILN_OPTION_DOUBLE, .value = "GIB", .fallback = "auto", .word = "auto",
     .minimum = 1e-3, .maximum = 1e9, .help = "of each node; auto: all of it, or with --threads what the site gives", .commands = KILN_FOR_SUBMIT,
     .offset = AT(memory)},
    {.name = "time", .group = "Batch job", .kind = KILN_OPTION_STRING, .value = "[DAYS-]HH:MM:SS", .shown = "the partition's",
     .help = "limit of one run; the bake goes on in the next", .commands = KILN_FOR_SUBMIT, .offset = AT(time_limit)},
    {.name = "warning", .group = "Batch job", .kind = KILN_OPTION_UINT32, .value = "SECONDS", .fallback = "90", .minimum = 1,
     .maximum = 65535, .help = "before the time limit, to stop and save in", .commands = KILN_FOR_SUBMIT, .offset = AT(warning)},
    {.name = "tries", .group = "Batch job", .kind = KILN_OPTION_UINT32, .value = "N", .fallback = "1", .minimum = 1, .maximum = 1000,
     .help = "so many runs in one allocation: a lost node, but for the first, is left out; 1: back into the queue", .commands = KILN_FOR_SUBMIT,
     .offset = AT(tries)},
    {.name = "partition", .group = "Batch job", .kind = KILN_OPTION_STRING, .value = "NAME", .shown = "the cluster's",
     .help = "of the cluster, to queue in", .commands = KILN_FOR_SUBMIT, .offset = AT(queue)},
    {.name = "account", .group = "Batch job", .kind = KILN_OPTION_STRING, .value = "NAME", .shown = "yours",
     .help = "that the job is charged to", .commands = KILN_FOR_SUBMIT, .offset = AT(account)},
    {.name = "array", .group = "Batch job", .kind = KILN_OPTION_STRING, .value = "PATTERN",
     .help = "a job array over the files that match, like 'jobs/*.yaml'", .commands = KILN_FOR_SUBMIT, .offset = AT(array)},
    {.name = "setup", .group = "Batch job", .kind = KILN_OPTION_PATH, .value = "FILE",
     .help = "shell script that the job reads first (module load ...)", .commands = KILN_FOR_SUBMIT, .offset = AT(setup)},
    {.name = "dry-run", .group = "Batch job", .kind = KILN_OPTION_FLAG, .fallback = "false",
     .help = "print the batch script, submit nothing", .commands = KILN_FOR_SUBMIT, .offset = AT(dry_run)},

    {.name = "json", .group = "Talking", .kind = KILN_OPTION_FLAG, .fallback = "false",
     .help = "one JSON object on stdout at the end", .commands = KILN_FOR_ALL, .offset = AT(json)},
    {.name = "quiet", .group = "Talking", .kind = KILN_OPTION_FLAG, .fallback = "false", .help = "errors only, no progress",
     .commands = KILN_FOR_ALL, .offset = AT(quiet)},
    {.name = "verbose", .group = "Talking", .kind = KILN_OPTION_FLAG, .fallback = "false", .help = "processor time and memory of each rank, on stderr at the end",
     .commands = KILN_FOR_ALL, .offset = AT(verbose)},
};
const size_t kiln_option_count = ARRAY_COUNT(kiln_options);

const struct kiln_quality kiln_qualities[] = {
    {"draft", 16, 4, 32, 16},
    {"preview", 64, 8, 128, 64},
    {"production", 256, 16, 512, 256},
    {"reference", 1024, 64, 4096, 1024},
};
const size_t kiln_quality_count = ARRAY_COUNT(kiln_qualities);

const struct kiln_command kiln_commands[] = {
    {.name = "bake", .bit = KILN_FOR_BAKE, .arguments = "SCENE|JOB.yaml", .minimum = 1, .maximum = 1, .scene = true, .mpi = true,
     .summary = "bake lightmaps and an irradiance volume",
     .examples = {"kiln bake room.glb -o out", "kiln bake jobs/cornell.yaml --quality production",
                  "kiln bake house.glb --texels-per-metre 20 --environment sky.hdr",
                  "mpirun -n 4 --bind-to none kiln bake room.glb -o out"}},
    {.name = "plan", .bit = KILN_FOR_PLAN, .arguments = "SCENE|JOB.yaml", .minimum = 1, .maximum = 1, .scene = true, .mpi = true,
     .summary = "cells, balance, memory and time, without baking",
     .examples = {"kiln plan room.glb --ranks 16", "kiln plan jobs/cornell.yaml --ranks 4 --json",
                  "kiln plan city.glb --ranks 1024 --ranks-per-node 8 --points 1000000000 -o curves"}},
    {.name = "info", .bit = KILN_FOR_INFO, .arguments = "SCENE|JOB.yaml", .minimum = 1, .maximum = 1, .scene = true,
     .summary = "what the importer sees in a scene",
     .examples = {"kiln info room.glb", "kiln info room.glb --lightmap-size 512 --json", "kiln info --devices"}},
    {.name = "check", .bit = KILN_FOR_CHECK, .arguments = "SCENE|JOB.yaml", .minimum = 1, .maximum = 1, .scene = true,
     .summary = "every problem of a scene, with place and severity",
     .examples = {"kiln check room.glb", "kiln check room.glb --json"}},
    {.name = "view", .bit = KILN_FOR_VIEW, .arguments = "DIR", .minimum = 1, .maximum = 1, .folder = true,
     .summary = "render a picture from a bake",
     .examples = {"kiln view out -o view.png", "kiln view out --from 1,1.5,3 --to 0,1,0 --width 1280 --height 720",
                  "kiln view out -o view.exr"}},
    {.name = "compare", .bit = KILN_FOR_COMPARE, .arguments = "A B", .minimum = 2, .maximum = 2,
     .summary = "how far one result is from another",
     .examples = {"kiln compare out reference", "kiln compare a.exr b.exr --json"}},
    {.name = "probe", .bit = KILN_FOR_PROBE, .arguments = "DIR X Y Z [NX NY NZ]", .minimum = 4, .maximum = 7, .folder = true,
     .summary = "irradiance at a point, from the volume",
     .examples = {"kiln probe out 0.2 1.5 -0.3", "kiln probe out 0.2 1.5 -0.3 0 1 0 --json"}},
    {.name = "generate", .bit = KILN_FOR_GENERATE, .arguments = "NAME", .minimum = 0, .maximum = 1,
     .summary = "make a scene: cornell, furnace, city, rooms, ...",
     .examples = {"kiln generate", "kiln generate cornell -o cornell.glb", "kiln generate city -o city.glb --triangles 1000000",
                  "kiln generate rooms -o rooms.glb --columns 3 --rows 2"}},
    {.name = "report", .bit = KILN_FOR_REPORT, .arguments = "DIR", .minimum = 1, .maximum = 1, .folder = true,
     .summary = "report.html from a bake", .examples = {"kiln report out"}},
    {.name = "bench", .bit = KILN_FOR_BENCH, .arguments = "NAME SCENE", .minimum = 2, .maximum = 2, .mpi = true,
     .summary = "measurements on this machine",
     .examples = {"kiln bench rays room.glb", "kiln bench rays room.glb --repeats 9 --json",
                  "kiln bench scaling room.glb --ranks 1,2,4 -o scaling"}},
    {.name = "submit", .bit = KILN_FOR_SUBMIT, .arguments = "JOB.yaml|SCENE...", .maximum = SIZE_MAX,
     .summary = "queue a bake on a Slurm cluster",
     .examples = {"kiln submit jobs/cornell.yaml --nodes 2 --time 1:00:00", "kiln submit room.glb --gpus 4 --dry-run",
                  "kiln submit --array 'jobs/*.yaml' --threads 8 --memory 4"}},
    {.name = "status", .bit = KILN_FOR_STATUS, .arguments = "DIR", .minimum = 1, .maximum = 1, .folder = true,
     .summary = "where a bake is, from any node", .examples = {"kiln status out", "kiln status out --json"}},
    {.name = "stop", .bit = KILN_FOR_STOP, .arguments = "DIR", .minimum = 1, .maximum = 1, .folder = true,
     .summary = "end a running bake politely: it saves first", .examples = {"kiln stop out"}},
    {.name = "export", .bit = KILN_FOR_EXPORT, .arguments = "DIR", .minimum = 1, .maximum = 1, .folder = true,
     .summary = "the scene with its lightmaps, as engines take it",
     .examples = {"kiln export out -o level/scene.glb", "kiln export out -o level/scene.glb --drop-baked-lights"}},
    {.name = "verify", .bit = KILN_FOR_VERIFY, .arguments = "DIR", .minimum = 1, .maximum = 1, .folder = true,
     .summary = "whether every result is as it was written", .examples = {"kiln verify out", "kiln verify out --json"}},
};
const size_t kiln_command_count = ARRAY_COUNT(kiln_commands);

const struct kiln_option *kiln_option_find(const char *name)
{
    for (size_t i = 0; i < kiln_option_count; i++)
        if (strcmp(kiln_options[i].name, name) == 0)
            return &kiln_options[i];
    return NULL;
}

const struct kiln_option *kiln_option_find_for(const char *name, uint32_t commands)
{
    for (size_t i = 0; i < kiln_option_count; i++)
        if ((kiln_options[i].commands & commands) != 0 && strcmp(kiln_options[i].name, name) == 0)
            return &kiln_options[i];
    return kiln_option_find(name);
}

const struct kiln_command *kiln_command_find(const char *name)
{
    for (size_t i = 0; i < kiln_command_count; i++)
        if (strcmp(kiln_commands[i].name, name) == 0)
            return &kiln_commands[i];
    return NULL;
}

const char *kiln_option_default(const struct kiln_option *option)
{
    if (option->shown != NULL)
        return option->shown;
    if (option->kind == KILN_OPTION_FLAG)
        return strcmp(option->fallback, "true") == 0 ? "on" : "";
    return option->fallback != NULL ? option->fallback : "";
}

/* Names longer than the table's are cut, which cannot bring a wrong one nearer. */
size_t kiln_edit_distance(const char *a, const char *b)
{
    enum { LIMIT = 48 };
    const size_t rows = strnlen(a, LIMIT), columns = strnlen(b, LIMIT);
    size_t distance[LIMIT + 1][LIMIT + 1];
    for (size_t i = 0; i <= rows; i++)
        distance[i][0] = i;
    for (size_t j = 0; j <= columns; j++)
        distance[0][j] = j;
    for (size_t i = 1; i <= rows; i++)
        for (size_t j = 1; j <= columns; j++) {
            size_t best = distance[i - 1][j - 1] + (a[i - 1] != b[j - 1]);
            if (distance[i - 1][j] + 1 < best)
                best = distance[i - 1][j] + 1;
            if (distance[i][j - 1] + 1 < best)
                best = distance[i][j - 1] + 1;
            if (i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1] && distance[i - 2][j - 2] + 1 < best)
                best = distance[i - 2][j - 2] + 1;
            distance[i][j] = best;
        }
    return distance[rows][columns];
}

bool kiln_is_near(const char *name, const char *known)
{
    const size_t length = strlen(name), other = strlen(known);
    return 3 * kiln_edit_distance(name, known) < (length > other ? length : other) || (length >= 3 && strncmp(name, known, length) == 0);
}

const char *kiln_option_nearest(const char *name, uint32_t commands)
{
    const char *nearest = NULL;
    size_t least = SIZE_MAX;
    for (size_t i = 0; i < kiln_option_count; i++) {
        const size_t distance = kiln_edit_distance(name, kiln_options[i].name);
        if ((kiln_options[i].commands & commands) != 0 && distance < least && kiln_is_near(name, kiln_options[i].name)) {
            least = distance;
            nearest = kiln_options[i].name;
        }
    }
    return nearest;
}

const char *kiln_command_nearest(const char *name)
{
    const char *nearest = NULL;
    size_t least = SIZE_MAX;
    for (size_t i = 0; i < kiln_command_count; i++) {
        const size_t distance = kiln_edit_distance(name, kiln_commands[i].name);
        if (distance < least && kiln_is_near(name, kiln_commands[i].name)) {
            least = distance;
            nearest = kiln_commands[i].name;
        }
    }
    return nearest;
}

int kiln_command_unknown(const char *name, struct kiln_error *error)
{
    const char *nearest = kiln_command_nearest(name);
    if (nearest == NULL)
        return kiln_fail(error, KILN_USAGE, "unknown command '%.200s'; kiln --help lists all", name);
    return kiln_fail(error, KILN_USAGE, "unknown command '%.200s'; the nearest one is '%s' (kiln --help lists all)", name, nearest);
}
