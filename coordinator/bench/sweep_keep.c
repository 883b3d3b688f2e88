#include <math.h>
#include <stdio.h>
#include <string.h>

#include "coordinator/bench/sweep.h"
#include "coordinator/files/checksummed_json.h"
#include "coordinator/files/json.h"
#include "coordinator/files/publish.h"
#include "coordinator/job/job_private.h"
#include "coordinator/job/options.h"
#include "worker/base/memory.h"

enum { BYTES_MOST = 1 << 24, FILE_NAME = 64 };

/* A file of the bench: its name and `suffix`. */
static const char *file_name(const struct kiln_sweep *sweep, const char *suffix, char name[FILE_NAME])
{
    (void)snprintf(name, FILE_NAME, "%s%s", sweep->kind->name, suffix);
    return name;
}

/* ---- what the results hold for ---- */

/* The options of this command that bakes have, and where the reference is from. */
static json_t *identity(const struct kiln_job *job)
{
    static const char *const own[] = {"output", "resume", "checkpoint-every", "watchdog", NULL};
    const struct kiln_job_owned *owned = job->strings;
    json_t *options = json_object();
    for (size_t i = 0; i < kiln_option_count; i++) {
        char room[KILN_OPTION_TEXT];
        bool counts = owned->given[i] && (kiln_options[i].commands & KILN_FOR_BAKE) != 0;
        for (const char *const *name = own; *name != NULL; name++)
            counts = counts && strcmp(*name, kiln_options[i].name) != 0;
        if (counts && strcmp(kiln_options[i].group, "Messages") != 0)
            (void)json_object_set_new(options, kiln_options[i].name,
                                      kiln_json_string(kiln_option_text(job, &kiln_options[i], room)));
    }
    return json_pack("{s:s, s:o, s:o, s:o, s:i}", "kiln", KILN_VERSION, "scene", kiln_json_string(job->scene),
                     "options", options, "reference", kiln_json_string(job->reference != NULL ? job->reference : ""),
                     "reference_samples", job->reference != NULL ? 0 : (int)job->reference_samples);
}

json_t *kiln_sweep_number(double value) { return isfinite(value) ? json_real(value) : json_null(); }

static json_t *result_json(const struct kiln_setting_result *r)
{
    json_t *runs = json_array();
    for (size_t i = 0; i < r->runs; i++) {
        json_t *run = json_array();
        for (int t = 0; t < KILN_TIMES; t++)
            (void)json_array_append_new(run, kiln_sweep_number(r->run[i][t]));
        (void)json_array_append_new(runs, run);
    }
    return json_pack("{s:[f,f,f], s:o, s:f, s:f, s:f, s:f, s:f, s:f, s:f, s:f, s:f, s:f, s:f, s:f, s:f, s:f, s:f, "
                     "s:f, s:f, s:f}",
                     "nrmse", r->error[0], r->error[1], r->error[2], "runs", runs, "differing", r->differing,
                     "peak_bytes", r->bytes, "points", r->points, "rays", r->rays, "texels_per_metre",
                     r->texels_per_metre, "cells", r->cells, "cell_size", r->cell_size, "imbalance", r->imbalance,
                     "received", r->received, "probes", r->probes, "probe_bytes", r->probe_bytes, "probe_rays",
                     r->probe_rays, "points_alone", r->points_alone, "dfpr", r->dfpr, "dfpr_8bit", r->dfpr_8bit,
                     "first_pass", r->first_pass, "later_pass", r->later_pass, "triangles", r->triangles);
}

static void read_result(const json_t *json, struct kiln_setting_result *r)
{
    const struct {
        const char *name;
        double *value;
    } numbers[] = {{"differing", &r->differing},
                   {"peak_bytes", &r->bytes},
                   {"points", &r->points},
                   {"rays", &r->rays},
                   {"cells", &r->cells},
                   {"texels_per_metre", &r->texels_per_metre},
                   {"cell_size", &r->cell_size},
                   {"received", &r->received},
                   {"imbalance", &r->imbalance},
                   {"probes", &r->probes},
                   {"probe_bytes", &r->probe_bytes},
                   {"probe_rays", &r->probe_rays},
                   {"points_alone", &r->points_alone},
                   {"dfpr", &r->dfpr},
                   {"dfpr_8bit", &r->dfpr_8bit},
                   {"first_pass", &r->first_pass},
                   {"later_pass", &r->later_pass},
                   {"triangles", &r->triangles}};
    const json_t *runs = json_object_get(json, "runs");
    for (size_t i = 0; i < sizeof numbers / sizeof *numbers; i++)
        *numbers[i].value = json_number_value(json_object_get(json, numbers[i].name));
    for (size_t i = 0; i < KILN_LAYERS; i++)
        r->error[i] = json_number_value(json_array_get(json_object_get(json, "nrmse"), i));
    for (size_t i = 0; i < json_array_size(runs) && i < KILN_REPEATS_MOST; i++) {
        for (size_t t = 0; t < KILN_TIMES; t++) {
            const json_t *value = json_array_get(json_array_get(runs, i), t);
            r->run[i][t] = json_is_number(value) ? json_number_value(value) : (double)NAN;
        }
        kiln_sweep_note_run(r);
    }
}

/* ---- reading ---- */

static int read_kept(struct kiln_sweep *sweep, struct kiln_error *error)
{
    char *text = NULL, name[FILE_NAME];
    const char *file = file_name(sweep, ".json", name);
    size_t size = 0;
    struct kiln_error unread = {{0}};
    if (!sweep->job->resume)
        return KILN_OK;
    const int status = kiln_read_file_below(sweep->job->output, file, BYTES_MOST, &text, &size, &unread);
    if (status == KILN_NO_INPUT)
        return KILN_OK;
    if (status != KILN_OK)
        return kiln_fail(error, status, "%s", unread.message);
    sweep->kept = kiln_unseal(text, size);
    kiln_free(&text);
    return sweep->kept != NULL
               ? KILN_OK
               : kiln_fail(error, KILN_BAD_INPUT,
                           "'%.500s/%s' is damaged; --no-resume begins the sweep anew, another --output keeps it",
                           sweep->job->output, file);
}

int kiln_sweep_take_up(struct kiln_sweep *sweep, struct kiln_error *error)
{
    json_t *now = identity(sweep->job);
    int status = read_kept(sweep, error);
    if (status == KILN_OK && sweep->kept == NULL)
        sweep->kept = json_pack("{s:O, s:b, s:{}}", "identity", now, "reference_done", 0, "results");
    if (status == KILN_OK && !json_equal(now, json_object_get(sweep->kept, "identity")))
        status = kiln_fail(error, KILN_BAD_INPUT,
                           "'%.500s' has a sweep of another scene, by another kiln or with other options; give another "
                           "--output, or --no-resume to begin anew",
                           sweep->job->output);
    for (size_t i = 0; status == KILN_OK && i < sweep->count; i++) {
        char key[KILN_SETTING_OPTIONS];
        sweep->kind->key(&sweep->settings[i], key);
        const json_t *result = json_object_get(json_object_get(sweep->kept, "results"), key);
        if (result != NULL)
            read_result(result, &sweep->results[i]);
    }
    json_decref(now);
    return status;
}

/* ---- writing ---- */

/* A text file of the bench, written by `add`. */
static int write_text(const struct kiln_sweep *sweep, const char *suffix,
                      void (*add)(const struct kiln_sweep *sweep, struct kiln_html *page), struct kiln_error *error)
{
    char path[KILN_PATH_SIZE], name[FILE_NAME];
    struct kiln_html page = {.error = error};
    add(sweep, &page);
    const int status = kiln_path_join(path, sweep->job->output, file_name(sweep, suffix, name), error);
    if (status == KILN_OK)
        return kiln_html_publish(&page, path);
    kiln_html_free(&page);
    return status;
}

static int write_kept(const struct kiln_sweep *sweep, struct kiln_error *error)
{
    char *text = NULL, name[FILE_NAME];
    const char *file = file_name(sweep, ".json", name);
    size_t size = 0;
    json_t *results = json_object_get(sweep->kept, "results");
    for (size_t i = 0; i < sweep->count; i++) {
        char key[KILN_SETTING_OPTIONS];
        sweep->kind->key(&sweep->settings[i], key);
        if (sweep->results[i].done)
            (void)json_object_set_new(results, key, result_json(&sweep->results[i]));
    }
    int status = kiln_seal(sweep->kept, JSON_INDENT(1) | JSON_SORT_KEYS, &text, &size, "the sweep", error);
    if (status == KILN_OK)
        status = kiln_publish_bytes_below(sweep->job->output, file, text, size, error);
    kiln_free(&text);
    return status;
}

int kiln_sweep_keep(struct kiln_sweep *sweep, struct kiln_error *error)
{
    if (sweep->kind->judge != NULL)
        sweep->kind->judge(sweep);
    int status = write_kept(sweep, error);
    if (status == KILN_OK)
        status = write_text(sweep, ".csv", sweep->kind->csv, error);
    if (status == KILN_OK)
        status = write_text(sweep, ".svg", sweep->kind->plot, error);
    const struct kiln_sweep_file *file = sweep->kind->files;
    for (; status == KILN_OK && file != NULL && file->suffix != NULL; file++)
        status = write_text(sweep, file->suffix, file->add, error);
    return status;
}

int kiln_sweep_tell_rows(const struct kiln_sweep *sweep, size_t left,
                         json_t *(*row)(const struct kiln_sweep *sweep, size_t setting), struct kiln_error *error)
{
    json_t *rows = json_array();
    for (size_t i = 0; i < sweep->count; i++)
        if (sweep->results[i].done)
            (void)json_array_append_new(rows, row(sweep, i));
    sweep->job->answered = true;
    return kiln_json_print(json_pack("{s:s, s:s, s:i, s:o}", "status", "done", "output", sweep->job->output, "left",
                                     (int)left, "bakes", rows),
                           error);
}
