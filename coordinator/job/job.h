/* Every setting kiln knows, filled from defaults, then `--quality`, then the job file, then the command line (later
 * wins). The one table in coordinator/job/options.c names each option, its unit, default, range, the commands it
 * belongs to and its place in this struct; `--help`, the job file reader and the command line all read that table and
 * nothing else. */
#ifndef KILN_COORDINATOR_JOB_JOB_H
#define KILN_COORDINATOR_JOB_JOB_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

#include "coordinator/job/faults.h"
#include "coordinator/integrate/settings.h"
#include "worker/base/status.h"

/* What the lights' numbers are measured in: what the file says, or as asked. */
enum kiln_units_choice { KILN_UNITS_AUTO = 0, KILN_UNITS_RADIOMETRIC = 1, KILN_UNITS_PHOTOMETRIC = 2 };

/* Strings are owned by the job (or static); NULL means not given. */
struct kiln_job {
    /* what the command is given besides options */
    const char *command;
    char **arguments;
    size_t argument_count;

    /* scene and output */
    /* the first argument of bake, plan, info, check; `scene:` of a job file, relative to the job file's folder */
    char *scene;
    char *output; /* DIR; default: the scene's name without extension + "-bake" */
    /* "none", "R,G,B" (radiance), or an .hdr or .exr lat-long image; NULL: what the scene says */
    char *environment;
    double environment_scale;    /* factor; default 1 */
    double environment_rotation; /* degrees about +y */
    int units;                   /* enum kiln_units_choice */

    /* where it runs */
    char *backend;          /* auto | embree | vulkan */
    int64_t device;         /* as `kiln info --devices` numbers them; -1: in turn, by the rank's place on its node */
    int traversal;          /* enum kiln_traversal */
    double verify_fraction; /* fraction of the tile runs that are traced again with Embree */
    double dispatch_time;   /* ms that one dispatch may take */
    double device_memory;   /* GiB; 0: what the device has free */
    bool devices;           /* info: list devices, no scene */
    uint32_t threads;       /* a rank; 0: the cores this process may use, divided by the ranks of the node */
    char *instruction_set;  /* NULL: the best that all ranks have */

    /* transport */
    char *quality;   /* draft | preview | production | reference: what the sample counts start from */
    char *method;    /* name of an integrator: integrate/integrators.c */
    int64_t bounces; /* indirect bounces; -1: as many as there is energy for, and a tail */
    bool tail;       /* add the geometric tail after the last bounce (default: only when bounces is -1) */
    enum kiln_schedule schedule;
    uint32_t samples_direct, samples_bounce, samples_indirect;
    uint64_t seed;

    /* texels, cells, partition */
    double texels_per_metre;
    uint32_t lightmap_size; /* 0: by density */
    uint32_t lightmap_max;  /* texels a side */
    bool repack;            /* lay charts that lie too close together out anew */
    char *objects;          /* settings of single objects, as JSON: coordinator/job/object_settings.h; NULL: none */
    bool trust_normals;     /* they decide the front of a triangle, not its winding */
    double cell_size;       /* m; 0: chosen */
    bool partition_objects;

    /* volume */
    double probe_spacing;   /* m; 0: chosen */
    uint32_t samples_probe; /* 0: no volume */

    /* results */
    bool half;       /* lightmaps in half float where nothing overflows */
    bool both_sides; /* publish lightmaps of backs */
    bool stitch;     /* smooth seams between charts; default true */
    bool error_map;  /* standard error of each texel as a layer */
    bool preview;    /* write preview.png; default true */
    bool export;     /* write scene.glb; default true */

    /* checkpoints and limits, seconds; 0: none */
    bool resume; /* go on from a checkpoint that is there; default true */
    double checkpoint_every, max_time, watchdog;

    /* between ranks */
    uint32_t share_ranks;    /* at most so many of a host share memory; 0: all, 1: none */
    bool work_stealing;      /* ranks that are done compute for others of their host; default true */
    int rebalance;           /* enum kiln_rebalance */
    int exchange;            /* enum kiln_exchange_form: 4 or 8 bytes a point between bounces */
    uint64_t exchange_limit; /* elements in one call of MPI; 0: what it can count */
    char *trace;             /* file for the timeline of all ranks */

    /* talking */
    bool json, quiet, verbose;

    /* view, compare, probe, generate, bench, plan: see the option table */
    char *camera; /* name of a camera in the scene */
    uint32_t width, height;
    double exposure;                     /* stops */
    char *from, *to;                     /* "x,y,z": eye and target of a view */
    char *show;                          /* "light", "texels", or the name of a field in the lightmaps */
    double field_of_view;                /* degrees, vertical */
    uint32_t ranks;                      /* plan */
    double node_memory;                  /* GiB; plan */
    uint64_t triangles;                  /* generate: about how many */
    uint32_t columns, rows;              /* generate rooms: N x M */
    double albedo;                       /* generate furnace; -1: not given */
    double node_bandwidth, node_latency; /* plan: network, GB/s and microseconds */
    uint64_t points;                     /* plan: of the scaling curve; 0: the scene's */
    char *rank_counts;                   /* bench scaling: "1,2,4" */
    uint32_t repeats;                    /* bench */

    /* submit: what the batch job asks for */
    uint32_t nodes, gpus, ranks_per_node; /* gpus: of a node; ranks_per_node 0: one a GPU, or one */
    double memory;                        /* GiB of a node; 0: not said */
    char *time_limit, *queue, *account;   /* in Slurm's words; --time, --partition, --account */
    uint32_t warning;                     /* seconds before the time limit */
    uint32_t tries;                       /* in one allocation, when nodes are lost */
    char *array, *setup;
    bool dry_run;

    /* export */
    char *source;           /* the scene that was baked; NULL: where run.json says */
    int format;             /* enum kiln_page_format */
    double range;           /* of rgbm; 0: each page's largest value */
    uint32_t atlas;         /* largest side of a page; 0: one page an object */
    bool drop_baked_lights; /* leave the lights out that are in the lightmaps */

    struct kiln_faults faults; /* of the environment, for tests */

    bool answered; /* by the command: its JSON object is on stdout, though it fails */
    void *strings; /* private: what the job owns */
};

/* Reads the command line (argv[1] is the command) and, where the argument is a .yaml or .yml file, the job file. Not
 * collective: every rank reads the same. KILN_USAGE for an unknown command, option or bad value on the command line,
 * naming the nearest known one; KILN_BAD_INPUT for the same in a job file, with file and line. Release with
 * kiln_job_destroy. */
int kiln_job_parse(struct kiln_job **job, int argc, char **argv, struct kiln_error *error);
void kiln_job_destroy(struct kiln_job **job);

/* Prints one line for each option that was given by its former name, with the present name. Not collective. */
void kiln_job_print_renamed(const struct kiln_job *job, FILE *stream);

#endif
