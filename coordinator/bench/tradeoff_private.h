/* Private to the sources of kiln bench tradeoff: what the sweep knows of its bakes. */
#ifndef KILN_COORDINATOR_BENCH_TRADEOFF_PRIVATE_H
#define KILN_COORDINATOR_BENCH_TRADEOFF_PRIVATE_H

#include <jansson.h>

#include "coordinator/files/folder.h"
#include "coordinator/job/job.h"
#include "coordinator/output/read/results.h"
#include "coordinator/view/compare_surface.h"

enum { KILN_SETTING_NAME = 40, KILN_SETTING_OPTIONS = 200, KILN_SETTINGS_MOST = 128 };

/* One bake of the sweep. */
struct kiln_setting {
    const char *group; /* the name by which bakes are chosen */
    char name[KILN_SETTING_NAME];
    const char *quality;               /* the preset that it is, or is derived from; NULL: none */
    uint32_t direct, bounce, indirect; /* samples */
    int bounces;                       /* -1: all */
    double density;                    /* relative to that of the reference */
    bool preset;                       /* given as --quality alone */
    bool equal, raw;                   /* schedule; not denoised */
};

struct kiln_setting_result {
    bool done, front;
    double error[KILN_LAYERS]; /* nrmse: of all light, of direct, of indirect */
    double seconds, light_seconds, processor_seconds, bytes, points, rays, texels_per_metre;
};

struct kiln_tradeoff {
    struct kiln_job *job;
    char program[KILN_PATH_SIZE], reference[KILN_PATH_SIZE], trial[KILN_PATH_SIZE], said[KILN_PATH_SIZE];
    struct kiln_setting settings[KILN_SETTINGS_MOST];
    struct kiln_setting_result results[KILN_SETTINGS_MOST];
    size_t count;
    json_t *kept;             /* what tradeoff.json holds (tradeoff_keep.c) */
    json_t *reference_report; /* run.json of the reference */
    struct kiln_results *reference_results;
    struct kiln_scene *reference_scene;
    double density;         /* of the reference, texels per metre */
    double reference_error; /* of the reference's own, as it states it, relative to its mean */
};

/* tradeoff_settings.c. Lists the bakes of the groups that are named, or of all, after those whose samples are given.
 * KILN_USAGE for a group that there is none of. */
int kiln_settings_choose(struct kiln_tradeoff *sweep, struct kiln_error *error);
/* The options of a bake, as words with a blank between. `density`: of the reference. */
void kiln_setting_options(const struct kiln_setting *setting, double density, char text[KILN_SETTING_OPTIONS]);
/* Rays for each texel, as a measure of how long the bake takes. */
double kiln_setting_rays(const struct kiln_setting *setting);

/* tradeoff_error.c. Opens the reference. Close with kiln_reference_close, also after a failure. */
int kiln_reference_open(struct kiln_tradeoff *sweep, struct kiln_error *error);
void kiln_reference_close(struct kiln_tradeoff *sweep);
/* Compares the bake in sweep->trial, whose run.json is `report`. */
int kiln_reference_compare(struct kiln_tradeoff *sweep, const json_t *report, double error_of[KILN_LAYERS],
                           struct kiln_error *error);

/* tradeoff_keep.c. Takes the results of an earlier run with the same options from tradeoff.json. KILN_BAD_INPUT if it
 * had others. */
int kiln_tradeoff_take_up(struct kiln_tradeoff *sweep, struct kiln_error *error);
/* Marks the front, and writes tradeoff.json, tradeoff.csv and tradeoff.svg. */
int kiln_tradeoff_keep(struct kiln_tradeoff *sweep, struct kiln_error *error);

/* tradeoff_front.c. Whether a bake is on the front: no other has less time and no more error, or less error and no more
 * time. */
void kiln_front_mark(struct kiln_tradeoff *sweep);
/* The bakes of the front by time, at most KILN_SETTINGS_MOST; returns their number. */
size_t kiln_front_list(const struct kiln_tradeoff *sweep, size_t *indices);
/* The time in which the front, without the presets, has an error: between two bakes of it the logarithms are
 * interpolated. NaN beyond its ends. */
double kiln_front_seconds(const struct kiln_tradeoff *sweep, double error);

/* tradeoff_plot.c */
int kiln_tradeoff_plot(const struct kiln_tradeoff *sweep, struct kiln_error *error);

/* tradeoff_tell.c. Prints the front and the sentences on what to choose, as text or JSON. */
int kiln_tradeoff_tell(const struct kiln_tradeoff *sweep, size_t left, struct kiln_error *error);
void kiln_tradeoff_list(const struct kiln_tradeoff *sweep);

#endif
