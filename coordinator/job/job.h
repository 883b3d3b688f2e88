/* The job: all settings of one run of kiln. It is filled from defaults, then --quality, then the job file, then the
 * command line; later values win. The table in coordinator/job/options.c gives each option its unit, default, range,
 * commands and member of this struct. --help, the job file reader and the command line all work from that table alone.
 */
#ifndef KILN_COORDINATOR_JOB_JOB_H
#define KILN_COORDINATOR_JOB_JOB_H

#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#include "coordinator/job/faults.h"
#include "coordinator/job/choices.h"
#include "coordinator/job/parts.h"
#include "worker/base/status.h"
#include "worker/pass/occlusion.h"
#include "worker/pass/reference.h"
#include "worker/scene/gloss.h"

enum { KILN_GROUPS_MAX = 2400, KILN_GROUP_NAME = 48 }; /* of lights; bytes of a name with its end */
struct kiln_field;

/* Unit of the lights: AUTO takes what the file says; the others override it. */
enum kiln_units_choice { KILN_UNITS_AUTO = 0, KILN_UNITS_RADIOMETRIC = 1, KILN_UNITS_PHOTOMETRIC = 2 };

/* Strings in a job and in its parts are owned by the job (or static); NULL means not given. */

/* Scene, and the rules of its import. */
struct kiln_job_scene {
    /* the first argument of bake, plan, info and check, or `scene:` of a job file, relative to that file's folder; with
     * `parts:` the job file itself */
    char *file;
    struct kiln_part *parts; /* `parts:` of a job file (job/parts.h) */
    size_t part_count;       /* 0: the scene is one file */
    /* "none", "R,G,B" (radiance), or the path of a lat-long .hdr or .exr image; NULL: what the scene says */
    char *environment;
    double environment_scale;    /* factor on the radiance; default 1 */
    double environment_rotation; /* degrees about +y */
    char *changes, *changed;     /* file of changes, and its content (job/changes.h); NULL: none */
    int units;                   /* enum kiln_units_choice */
    /* file of groups of lights, and its content as JSON (job/light_groups.h); NULL: none. Names of the groups, `rest`
     * last, and the rows of their fields (field/group_fields.h) */
    char *light_groups, *grouped;
    size_t group_count;
    char **group_names;
    const struct kiln_field **group_rows;
    int sky_patches;    /* enum kiln_sky_patches: patches of the sky that are groups */
    bool up_z;          /* an OBJ file's z points up, otherwise its y */
    double unit;        /* m, of an OBJ file */
    bool strict;        /* missing pictures are an error */
    bool repack;        /* pack charts again that lie too close together */
    bool keep_shared;   /* keep given layouts whose charts share texels */
    char *objects;      /* settings of objects, as JSON (coordinator/job/object_settings.h); NULL: none */
    bool trust_normals; /* normals decide which side of a triangle is its front; otherwise its winding does */
};

/* Backend, devices, threads and memory. */
struct kiln_job_machine {
    char *backend;          /* auto | embree | vulkan */
    int64_t device;         /* number in `kiln info --devices`; -1: ranks of a node take devices in turn */
    bool devices;           /* info: list the devices; there is no scene */
    double verify_fraction; /* fraction of the tile runs that are traced again with Embree */
    double device_memory;   /* GiB that a rank may use; 0: what is free on the device */
    double memory_budget;   /* GiB of a host; 0: auto; -1: none (coordinator/bake/prepare/results_memory.h) */
    char *kernel_cache;     /* folder of compiled kernels, or "none"; NULL: the user's (files/kernel_cache.h) */
    uint32_t threads;       /* of each rank; 0: the cores that this process may use, divided by the ranks of the node */
    char *instruction_set;  /* of Embree; NULL: the best that all ranks have */
};

/* Light transport. */
struct kiln_job_light {
    char *quality;   /* draft | preview | production | reference, or an error such as "5%" */
    char *method;    /* name of an integrator (coordinator/integrate/integrators.c) */
    int64_t bounces; /* indirect bounces; -1: until little energy is left, then the tail */
    bool tail;       /* add the geometric tail after the last bounce (default: only when bounces is -1) */
    enum kiln_schedule schedule;
    uint32_t samples_direct, samples_bounce, samples_indirect; /* rays for each texel */
    int indirect_scale;      /* log2 of texels a side of a block in bounces (integrate/sparse/blocks.h) */
    int final_scale;         /* likewise in the final gather (integrate/sparse/nodes.h) */
    int guide;               /* 1: the final gather samples what the bounces learn (worker/pass/guided.h) */
    int materials;           /* enum kiln_gloss_mode */
    bool diffuse_unasked;    /* `materials` is diffuse by the method, not by --materials: a scene may refuse that */
    int caustics;            /* enum kiln_caustics */
    bool caustics_tried;     /* no option: a first round decides on caustics (coordinator/bake/prepare/materials.h) */
    int mis;                 /* enum kiln_mis (worker/pass/caustic_weights.h), of --caustics vcm */
    uint32_t photons;        /* --caustics land, ...: light paths of an iteration; 0: kiln_light_photons */
    uint32_t iterations;     /* iterations of light paths; or KILN_ITERATIONS_ALL */
    double radius_alpha;     /* --caustics merge (integrate/land/merge.h) */
    double merge_radius;     /* m; 0: by the scene; or KILN_MERGE_RADIUS_TEXEL (merge.h). Of views, too */
    uint32_t chain_length;   /* surfaces in a gather ray's chain that are always traced (shaders/shared/chain.h) */
    char *only_visible_from; /* cameras, or a path's file: bake/light/visible_from.h; NULL: all surfaces are lit */
    double target_error;     /* of a texel, relative: more samples until it is reached; 0: none */
    double published_error;  /* no option: that --quality asks for, which 95 % of the texels stay below; 0: none */
    double time;             /* s that the whole bake may take; the rounds end early enough for that; 0: any */
    char *rounds;            /* levels of the rounds after the first, "3,7"; NULL: by the error */
    struct kiln_round_list round_list; /* no option: of `rounds` */
    const char *counted_for; /* no option: the one that makes --quality a preset of sample counts; NULL: none does */
    struct kiln_radiance_settings radiance;     /* radiance probes for distant light; see kiln_job_has_probes */
    struct kiln_reference_parameters paths;     /* of the methods of kiln_job_is_reference */
    struct kiln_patch_settings patches;         /* of the method of kiln_job_is_radiosity */
    struct kiln_occlusion_parameters occlusion; /* distance 0: no ambient occlusion and no bent normal */
    int directional;                            /* enum kiln_directional */
    uint64_t seed;
    int keep; /* enum kiln_keep: kind of transport that is kept for relighting */
};

/* Texels, and how the light at them is written. */
struct kiln_job_lightmaps {
    int store;        /* enum kiln_store_kind */
    double leaf_size; /* m, of octrees; 0: 1 / texels_per_metre */
    double texels_per_metre;
    double texels;      /* no option: of the whole scene with automatic density, by --quality */
    uint32_t size;      /* texels a side; 0: by density */
    uint32_t most;      /* texels a side, at most */
    bool half;          /* write lightmaps as half floats where no value overflows */
    bool both_sides;    /* also write lightmaps for the backs of double-sided surfaces */
    bool stitch;        /* smooth seams between charts, and between objects that touch; default true */
    int denoise;        /* enum kiln_denoise */
    bool error_map;     /* write the standard error of each texel as a layer */
    bool vertex_light;  /* irradiance at vertices (coordinator/output/vertex_light.h) */
    bool check_density; /* whether the texels are fine enough (coordinator/bake/light/density_check.h) */
};

/* Irradiance volume. */
struct kiln_job_volume {
    double spacing;   /* m between probes; 0: chosen automatically */
    char *bounds;     /* "x,y,z,x,y,z", m: least and greatest corner; NULL: chosen automatically */
    uint32_t samples; /* rays for each probe; 0: no volume */
};

/* Cells, and communication between ranks. */
struct kiln_job_ranks {
    double cell_size;             /* m; 0: chosen automatically */
    bool partition_objects;       /* assign whole objects to ranks, otherwise whole cells */
    uint32_t shared_memory_ranks; /* so many ranks of a host at most share memory; 0: all of them, 1: none */
    bool work_stealing;           /* ranks that are done compute points of other ranks of their host; default true */
    int rebalance;                /* enum kiln_rebalance */
    int exchange;                 /* enum kiln_exchange_form */
    int exchange_points;          /* enum kiln_exchange_points */
    char *trace;                  /* file for the timeline of all ranks; NULL: none */
};

/* Checkpoints and limits, seconds; 0: none. */
struct kiln_job_checkpoints {
    bool resume; /* continue from an existing checkpoint; default true */
    double every, max_time, watchdog;
    char *local; /* a folder of each node, where checkpoints are written first; NULL: none */
};

/* Settings of relight. */
struct kiln_job_relighting {
    const char *folder; /* a bake whose kept transport is replayed; NULL: rays are traced. The first argument */
    /* file of states, and its content (job/changes.h); NULL: none */
    char *states, *stated;
    bool listen; /* read a change per line from standard input */
};

/* Settings of view; pictures of other commands take exposure and size, too. */
struct kiln_job_view {
    char *camera; /* name of a camera in the scene, names separated by commas, or "all" */
    uint32_t width, height;
    double exposure;        /* stops */
    bool auto_exposure;     /* default true */
    int tone_map;           /* enum kiln_tone_curve */
    char *path;             /* file of key frames */
    uint32_t frames;        /* number of frames of the path; 0: 24 for each interval, and one */
    char *from, *to;        /* "x,y,z", m: position and target of the eye */
    char *show;             /* "light", "texels", or what else coordinator/view/show.h has */
    uint32_t voxels;        /* along the scene's longest side; 0: as the bake had */
    char *texel;            /* "OBJECT,X,Y", whose links are shown; NULL: none */
    char *atlas;            /* name of the object whose lightmap is drawn; NULL: a view */
    int filter;             /* enum kiln_view_filter_choice */
    double field_of_view;   /* degrees, vertical */
    int method;             /* enum kiln_view_method */
    uint32_t samples_pixel; /* paths of a pixel */
    uint32_t path_length;   /* rays of a path at most; 0: any number */
    char *accumulate;       /* folder that keeps the sums of paths; NULL: none */
    bool sequence;          /* frames of a path are means over those before them */
    uint32_t places;        /* print so many camera positions in place of a picture; 0: a picture */
    int denoise;            /* enum kiln_view_denoise */
    bool aov;               /* auxiliary layers of the visible surface, besides light */
    double lens_radius;     /* m; 0: a pinhole */
    double focus_distance;  /* m; 0: distance of the surface in the middle of the picture */
    bool normal_maps;       /* show materials' normal maps; default true */
};

/* Settings of plan. */
struct kiln_job_plan {
    uint32_t ranks;
    double node_memory;                  /* memory of a node, GiB; 0: this machine's */
    double node_bandwidth, node_latency; /* of the network, GB/s and microseconds */
    uint64_t points;                     /* surface points of the scaling curve; 0: those of the scene */
};

/* Settings of generate. */
struct kiln_job_generated {
    uint64_t triangles;     /* approximate number; 0: the scene's default */
    uint32_t columns, rows; /* rooms, lights: numbers along x and z */
    double albedo;          /* furnace; -1: not given */
    bool distinct;          /* city: no two houses alike */
    uint32_t parts;         /* city: number of files; 1: one scene file */
};

/* Settings of bench. */
struct kiln_job_bench {
    char *rank_counts; /* scaling: "1,2,4" */
    uint32_t repeats;  /* rays: runs of each measurement */
};

/* Settings of submit: what the batch job requests. */
struct kiln_job_submit {
    uint32_t nodes, gpus, ranks_per_node; /* gpus: of each node; ranks_per_node 0: one for each GPU, or one */
    double memory;                        /* GiB of each node; 0: not given */
    char *time_limit, *queue, *account;   /* Slurm's --time, --partition, --account */
    uint32_t warning;                     /* seconds between the warning signal and the time limit */
    uint32_t tries;                       /* runs in one allocation when nodes are lost */
    char *array, *setup;                  /* pattern of job files; shell script that the job reads first */
    bool dry_run;
};

/* Settings of export. */
struct kiln_job_exported {
    char *source;           /* path of the scene that was baked; NULL: the one in run.json */
    int format;             /* enum kiln_page_format */
    double range;           /* irradiance of RGBM value 1,1,1,1; 0: each page's largest value */
    uint32_t atlas;         /* largest side of a page, texels; 0: one page for each object */
    bool drop_baked_lights; /* remove lights whose light is in the lightmaps */
};

/* Settings of mix. */
struct kiln_job_mix {
    char *factors; /* arguments of --set, one per line */
};

struct kiln_job {
    const char *command;
    char **arguments;
    size_t argument_count;
    char *output;     /* DIR; default: the scene's name without extension + "-bake" */
    bool preview;     /* write preview.png; default true */
    bool write_scene; /* write scene.glb; default true */
    bool json, quiet, verbose;

    struct kiln_job_scene scene;
    struct kiln_job_machine machine;
    struct kiln_job_light light;
    struct kiln_job_lightmaps lightmaps;
    struct kiln_job_volume volume;
    struct kiln_job_ranks ranks;
    struct kiln_job_checkpoints checkpoints;

    struct kiln_job_relighting relighting;
    struct kiln_job_view view;
    struct kiln_job_plan plan;
    struct kiln_job_generated generated;
    struct kiln_job_bench bench;
    struct kiln_job_submit submit;
    struct kiln_job_exported exported;
    struct kiln_job_mix mix;

    struct kiln_faults faults; /* faults that tests inject, read from the environment */
    bool answered;             /* the command has printed its JSON object, even if it then fails */
    void *strings;             /* private: struct kiln_job_owned */
};

/* Reads the command line (argv[1] is the command) and, if the first argument is a .yaml or .yml file, that job file.
 * Not collective: every rank reads them itself. KILN_USAGE for an unknown command, an unknown option or a bad value on
 * the command line, with the nearest known name; KILN_BAD_INPUT for the same in a job file, with file and line. Release
 * with kiln_job_destroy. */
int kiln_job_parse(struct kiln_job **job, int argc, char **argv, struct kiln_error *error);

/* Checks a job's options of light against one another, as kiln_job_parse does for a bake, and derives the dependent
 * values. For jobs whose options were set after parsing. KILN_USAGE. */
int kiln_job_settle_light(struct kiln_job *job, struct kiln_error *error);
void kiln_job_destroy(struct kiln_job **job);

struct kiln_option;
/* Whether a file name is that of a YAML file. */
bool kiln_is_yaml(const char *path);
/* Whether the command line or the job file gives the option. */
bool kiln_job_given(const struct kiln_job *job, const struct kiln_option *option);
/* Copies a text as a string that the job owns. KILN_SYSTEM. */
int kiln_job_keep_text(struct kiln_job *job, const char *text, char **copy, struct kiln_error *error);

/* Allocates zeroed memory that lives as long as the job. KILN_SYSTEM. */
int kiln_job_keep_room(struct kiln_job *job, size_t bytes, void **room, struct kiln_error *error);

/* Whether points gather by links (worker/pass/links.h), each of which has an error estimate of its own. */
static inline bool kiln_job_has_links(const struct kiln_job *job)
{
    return job->light.method != NULL && strcmp(job->light.method, "radiosity") == 0 &&
           job->light.patches.patches == KILN_PATCHES_LINKS;
}

/* Whether light is computed in rounds, until its error is small enough (integrate/parts/rounds.h). */
static inline bool kiln_job_has_rounds(const struct kiln_job *job)
{
    return job->light.target_error > 0.0 || job->light.published_error > 0.0;
}

/* Whether parts of later rounds start from the light of earlier ones instead of the lamps (integrate/parts/parts.h).
 * With an error of published light they do, which excludes methods and options with which they cannot. */
static inline bool kiln_job_goes_on(const struct kiln_job *job) { return job->light.published_error > 0.0; }

/* Whether noise is taken out of the lightmaps: what --denoise and --quality say together. */
enum { KILN_PARTS = 4 }; /* that light is computed in where its errors are to be known (integrate/parts/parts.h) */
/* Factor on an error that is estimated from so few parts alone, so that 95 % of all values lie within two stated
 * errors, as with a well-known error: half the 97.5th percentile of Student's t with three degrees of freedom. */
#define KILN_PARTS_STUDENT 1.591
static inline uint32_t kiln_job_parts(const struct kiln_job *job)
{
    return (job->lightmaps.error_map || kiln_job_has_rounds(job)) && !kiln_job_has_links(job) ? KILN_PARTS : 1;
}

/* kiln_job_takes_gloss: whether mirrors, gloss and glass reflect or transmit light. kiln_job_has_caustics: whether a
 * bake computes the lamps' light by way of these. Both for a settled job (coordinator/bake/prepare/materials.h). */
static inline bool kiln_job_takes_gloss(const struct kiln_job *job)
{
    return job->light.materials != KILN_GLOSS_MODE_DIFFUSE && job->light.chain_length > 0;
}
static inline bool kiln_job_has_caustics(const struct kiln_job *job)
{
    return kiln_job_takes_gloss(job) && job->light.caustics > KILN_CAUSTICS_NONE;
}

/* Whether the light is found by paths from surface points, without radiosity (coordinator/integrate/reference). */
static inline bool kiln_job_is_reference(const struct kiln_job *job)
{
    return job->light.method != NULL && strcmp(job->light.method, "cells") != 0 &&
           strcmp(job->light.method, "radiosity") != 0;
}

/* Whether light bounces between patches, pair by pair (coordinator/integrate/radiosity). */
static inline bool kiln_job_is_radiosity(const struct kiln_job *job)
{
    return job->light.method != NULL && strcmp(job->light.method, "radiosity") == 0;
}

/* Whether gather rays end at a range, beyond which radiance probes supply the light. */
static inline bool kiln_job_has_probes(const struct kiln_job *job)
{
    return job->light.radiance.samples > 0 && job->light.radiance.range < (double)INFINITY;
}

static inline bool kiln_job_denoises(const struct kiln_job *job)
{
    return job->lightmaps.denoise == KILN_DENOISE_REGRESSION ||
           (job->lightmaps.denoise == KILN_DENOISE_AUTO && job->light.quality != NULL &&
            (job->light.published_error > 0.0 || strcmp(job->light.quality, "reference") != 0));
}

/* Prints one line for each option that was given by its former name, with the present form. Not collective. */
void kiln_job_print_renamed(const struct kiln_job *job, FILE *stream);

#endif
