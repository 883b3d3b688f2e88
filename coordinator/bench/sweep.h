/* Private to the benches that sweep: they bake a scene with many settings and compare each bake with a reference. What
 * they share is here: children, repeats, breaks and budgets, what is kept. A bench is a row of functions (struct
 * kiln_sweep_kind). Nothing here is collective. */
#ifndef KILN_COORDINATOR_BENCH_SWEEP_H
#define KILN_COORDINATOR_BENCH_SWEEP_H

#include <jansson.h>

#include "coordinator/bench/child.h"
#include "coordinator/bench/counters.h"
#include "coordinator/files/folder.h"
#include "coordinator/files/html.h"
#include "coordinator/job/job.h"
#include "coordinator/output/read/results.h"
#include "coordinator/view/compare_surface.h"

enum { KILN_SETTING_NAME = 48, KILN_SETTING_OPTIONS = 200, KILN_SETTINGS_MOST = 128, KILN_REPEATS_MOST = 100 };

/* One bake of the sweep. */
struct kiln_setting {
    const char *group; /* the name by which bakes are chosen */
    char name[KILN_SETTING_NAME];
    uint32_t ranks; /* started by mpirun; 0: by itself */
    /* of tradeoff */
    const char *quality;               /* the preset that it is, or is derived from; NULL: none */
    uint32_t direct, bounce, indirect; /* samples */
    int bounces;                       /* -1: all */
    double density;                    /* relative to that of the reference */
    bool preset;                       /* given as --quality alone */
    bool equal, raw;                   /* schedule; not denoised */
    /* of cell-size and per-object */
    double cell_factor; /* side of a cell relative to the automatic one; 0: cell_size is given */
    double cell_size;   /* m */
    bool objects;       /* work in order of objects */
    /* of tracing-range */
    double range_factor;   /* range over the scene's longest side; 0: `range` is given */
    double range;          /* m */
    uint32_t probes_along; /* spacings of probes along that side */
    int basis;             /* of the probes */
    /* of radiosity */
    uint32_t side;     /* of a square of as many texels as the scene has, roughly */
    const char *words; /* options */
    double parameter;  /* by which its group's figure is drawn: texels of a window, a threshold, directions */
    double share;      /* of all pairs, or of rays for each texel, as a measure of how long the bake takes */
    /* another scene than the job's, as the words of kiln generate; NULL: the job's. It is not compared. */
    const char *generate;
};

/* What a run of a bake took: seconds of the whole process, of its passes of light, of those of indirect light among
 * them, of the exchange among them, of the processor; and the counters. */
enum kiln_sweep_time {
    KILN_TIME_WHOLE,
    KILN_TIME_LIGHT,
    KILN_TIME_INDIRECT,
    KILN_TIME_EXCHANGE,
    KILN_TIME_PROCESSOR,
    KILN_TIME_COUNTERS,
    KILN_TIMES = KILN_TIME_COUNTERS + KILN_COUNTERS
};

struct kiln_setting_result {
    bool done, front; /* done: at least one run */
    size_t runs;
    double run[KILN_REPEATS_MOST][KILN_TIMES];        /* NaN: not known */
    double error[KILN_LAYERS];                        /* nrmse: of all light, of direct, of indirect */
    double differing;                                 /* values of the lightmaps whose bits are not the reference's */
    double seconds, light_seconds, processor_seconds; /* medians of the runs */
    double bytes, points, rays, texels_per_metre;
    double cells, cell_size, imbalance, received;         /* occupied; m; most points of a rank / mean - 1; bytes */
    double probes, probe_bytes, probe_rays, points_alone; /* radiance probes; points that see none */
    double dfpr, dfpr_8bit, first_pass, later_pass;       /* of radiosity; s of the first pass, and of a later one */
    double triangles;
};

struct kiln_sweep;

/* A text file of a bench besides its own three: NAME and a suffix. */
struct kiln_sweep_file {
    const char *suffix;
    void (*add)(const struct kiln_sweep *sweep, struct kiln_html *page);
};

/* A bench that sweeps. */
struct kiln_sweep_kind {
    const char *name;           /* of the bench; NAME.csv, NAME.svg and NAME.json are its files */
    const char *suffix;         /* of the folder, after the scene's name */
    const char *const *refused; /* options that the bench sets itself; ends with NULL */
    bool exact;                 /* every bake must have the reference's bits; runs are repeated */
    /* Lists the settings. KILN_USAGE for arguments that it does not know. */
    int (*choose)(struct kiln_sweep *sweep, struct kiln_error *error);
    /* The options of a bake, as words with a blank between. */
    void (*options)(const struct kiln_sweep *sweep, const struct kiln_setting *setting,
                    char text[KILN_SETTING_OPTIONS]);
    /* The name under which a bake's result is kept. */
    void (*key)(const struct kiln_setting *setting, char key[KILN_SETTING_OPTIONS]);
    /* Adds the options of the reference. */
    void (*push_reference)(const struct kiln_sweep *sweep, struct kiln_child *child);
    /* A measure of how long the bake takes. */
    double (*rays)(const struct kiln_setting *setting);
    /* Before a bake's options are asked for: makes its scene, where that is not the job's; NULL: it always is. */
    int (*prepare)(struct kiln_sweep *sweep, size_t i, struct kiln_error *error);
    /* Measures more of the bake in sweep->trial, whose run.json is `report`; NULL: there is no more. */
    int (*more)(struct kiln_sweep *sweep, size_t i, const json_t *report, struct kiln_error *error);
    const struct kiln_sweep_file *files; /* more of them, up to a suffix of NULL; NULL: none */
    /* Judges the results before they are written; NULL: there is nothing to judge. */
    void (*judge)(struct kiln_sweep *sweep);
    void (*csv)(const struct kiln_sweep *sweep, struct kiln_html *page);
    void (*plot)(const struct kiln_sweep *sweep, struct kiln_html *page);
    void (*list)(const struct kiln_sweep *sweep);
    /* Prints the result, with `left` runs that the budget had no room for. */
    int (*tell)(const struct kiln_sweep *sweep, size_t left, struct kiln_error *error);
};

struct kiln_sweep {
    const struct kiln_sweep_kind *kind;
    struct kiln_job *job;
    size_t repeats;
    char program[KILN_PATH_SIZE], reference[KILN_PATH_SIZE], trial[KILN_PATH_SIZE], said[KILN_PATH_SIZE];
    struct kiln_setting settings[KILN_SETTINGS_MOST];
    struct kiln_setting_result results[KILN_SETTINGS_MOST];
    size_t count;
    json_t *kept;             /* what NAME.json holds (sweep_keep.c) */
    json_t *reference_report; /* run.json of the reference */
    struct kiln_results *reference_results;
    struct kiln_scene *reference_scene;
    double density;         /* of the reference, texels per metre */
    double cell_size;       /* of the reference, m; 0: not known yet */
    double reference_error; /* of the reference's own, as it states it, relative to its mean */
};

/* sweep.c. Runs the sweep of this kind, or lists it. KILN_USAGE, KILN_BAD_INPUT, KILN_STOPPED, or the status of a bake
 * that failed. From a process with one thread, before MPI is started. */
int kiln_sweep_run(const struct kiln_sweep_kind *kind, struct kiln_job *job, struct kiln_error *error);
/* The file of a setting's scene. */
int kiln_sweep_scene(const struct kiln_sweep *sweep, const struct kiln_setting *setting, char path[KILN_PATH_SIZE],
                     struct kiln_error *error);
/* Adds a setting, if there is room. */
void kiln_sweep_add(struct kiln_sweep *sweep, const struct kiln_setting *setting);
/* Counts the run whose times have been written behind the last one, and takes the medians again. */
void kiln_sweep_note_run(struct kiln_setting_result *result);
/* Median, least and most of a time over the runs of a bake; NaN if a run does not know it. */
struct kiln_spread {
    double median, least, most;
};
struct kiln_spread kiln_sweep_spread(const struct kiln_setting_result *result, enum kiln_sweep_time time);

/* sweep_error.c. Opens the reference. Close with kiln_reference_close, also after a failure. */
int kiln_reference_open(struct kiln_sweep *sweep, struct kiln_error *error);
void kiln_reference_close(struct kiln_sweep *sweep);
/* Compares the bake in sweep->trial, whose run.json is `report`: its error, and with kind->exact its bits. */
int kiln_reference_compare(struct kiln_sweep *sweep, const json_t *report, struct kiln_setting_result *result,
                           struct kiln_error *error);

/* sweep_keep.c. Takes the results of an earlier run with the same options from NAME.json. KILN_BAD_INPUT if it had
 * others. */
int kiln_sweep_take_up(struct kiln_sweep *sweep, struct kiln_error *error);
/* Writes NAME.json, NAME.csv and NAME.svg. */
int kiln_sweep_keep(struct kiln_sweep *sweep, struct kiln_error *error);
/* A number; null if it is not finite. */
json_t *kiln_sweep_number(double value);
/* For --json: prints that the sweep is done, how many bakes are left, and a row for each that was done. KILN_SYSTEM,
 * KILN_IO. */
int kiln_sweep_tell_rows(const struct kiln_sweep *sweep, size_t left,
                         json_t *(*row)(const struct kiln_sweep *sweep, size_t setting), struct kiln_error *error);

#endif
