#include <stdio.h>
#include <string.h>

#include "coordinator/bench/tradeoff_private.h"
#include "coordinator/files/checksummed_json.h"
#include "coordinator/files/html.h"
#include "coordinator/files/json.h"
#include "coordinator/files/publish.h"
#include "coordinator/job/job_private.h"
#include "coordinator/job/options.h"
#include "worker/base/memory.h"

enum { BYTES_MOST = 1 << 24 };

static const char file[] = "tradeoff.json";

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

static json_t *result_json(const struct kiln_setting_result *r)
{
    return json_pack("{s:[f,f,f], s:f, s:f, s:f, s:f, s:f, s:f, s:f}", "nrmse", r->error[0], r->error[1], r->error[2],
                     "seconds", r->seconds, "light_seconds", r->light_seconds, "processor_seconds",
                     r->processor_seconds, "peak_bytes", r->bytes, "points", r->points, "rays", r->rays,
                     "texels_per_metre", r->texels_per_metre);
}

static void read_result(const json_t *json, struct kiln_setting_result *r)
{
    *r =
        (struct kiln_setting_result){.done = true,
                                     .seconds = json_number_value(json_object_get(json, "seconds")),
                                     .light_seconds = json_number_value(json_object_get(json, "light_seconds")),
                                     .processor_seconds = json_number_value(json_object_get(json, "processor_seconds")),
                                     .bytes = json_number_value(json_object_get(json, "peak_bytes")),
                                     .points = json_number_value(json_object_get(json, "points")),
                                     .rays = json_number_value(json_object_get(json, "rays")),
                                     .texels_per_metre = json_number_value(json_object_get(json, "texels_per_metre"))};
    for (size_t i = 0; i < KILN_LAYERS; i++)
        r->error[i] = json_number_value(json_array_get(json_object_get(json, "nrmse"), i));
}

/* The name under which a bake's result is kept. */
static void key_of(const struct kiln_setting *s, char key[KILN_SETTING_OPTIONS])
{
    kiln_setting_options(s, 1.0, key);
    const size_t used = strlen(key);
    (void)snprintf(key + used, KILN_SETTING_OPTIONS - used, " (%u %u %u, density %.6g)", s->direct, s->bounce,
                   s->indirect, s->density);
}

/* ---- reading ---- */

static int read_kept(struct kiln_tradeoff *sweep, struct kiln_error *error)
{
    char *text = NULL;
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

int kiln_tradeoff_take_up(struct kiln_tradeoff *sweep, struct kiln_error *error)
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
        key_of(&sweep->settings[i], key);
        const json_t *result = json_object_get(json_object_get(sweep->kept, "results"), key);
        if (result != NULL)
            read_result(result, &sweep->results[i]);
    }
    json_decref(now);
    return status;
}

/* ---- writing ---- */

static int write_csv(const struct kiln_tradeoff *sweep, struct kiln_error *error)
{
    char path[KILN_PATH_SIZE], options[KILN_SETTING_OPTIONS];
    struct kiln_html page = {.error = error};
    kiln_html_add(
        &page, "group,name,options,samples_direct,samples_bounce,samples_indirect,bounces,schedule,denoised,"
               "texels_per_metre,points,rays,nrmse,nrmse_direct,nrmse_indirect,seconds,light_seconds,processor_seconds,"
               "peak_bytes,front\n");
    for (size_t i = 0; i < sweep->count; i++) {
        const struct kiln_setting *s = &sweep->settings[i];
        const struct kiln_setting_result *r = &sweep->results[i];
        if (!r->done)
            continue;
        kiln_setting_options(s, sweep->density, options);
        kiln_html_add(&page, "%s,\"%s\",%s,%u,%u,%u,", s->group, s->name, options, s->direct, s->bounce, s->indirect);
        if (s->bounces < 0)
            kiln_html_add(&page, "all");
        else
            kiln_html_add(&page, "%d", s->bounces);
        kiln_html_add(&page, ",%s,%s,%.9g,%.0f,%.0f,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%.0f,%s\n",
                      s->equal ? "equal" : "lean", s->raw ? "no" : "yes", r->texels_per_metre, r->points, r->rays,
                      r->error[0], r->error[1], r->error[2], r->seconds, r->light_seconds, r->processor_seconds,
                      r->bytes, r->front ? "yes" : "no");
    }
    const int status = kiln_path_join(path, sweep->job->output, "tradeoff.csv", error);
    if (status == KILN_OK)
        return kiln_html_publish(&page, path);
    kiln_html_free(&page);
    return status;
}

static int write_kept(const struct kiln_tradeoff *sweep, struct kiln_error *error)
{
    char *text = NULL;
    size_t size = 0;
    json_t *results = json_object_get(sweep->kept, "results");
    for (size_t i = 0; i < sweep->count; i++) {
        char key[KILN_SETTING_OPTIONS];
        key_of(&sweep->settings[i], key);
        if (sweep->results[i].done)
            (void)json_object_set_new(results, key, result_json(&sweep->results[i]));
    }
    int status = kiln_seal(sweep->kept, JSON_INDENT(1) | JSON_SORT_KEYS, &text, &size, "the sweep", error);
    if (status == KILN_OK)
        status = kiln_publish_bytes_below(sweep->job->output, file, text, size, error);
    kiln_free(&text);
    return status;
}

int kiln_tradeoff_keep(struct kiln_tradeoff *sweep, struct kiln_error *error)
{
    kiln_front_mark(sweep);
    int status = write_kept(sweep, error);
    if (status == KILN_OK)
        status = write_csv(sweep, error);
    if (status == KILN_OK)
        status = kiln_tradeoff_plot(sweep, error);
    return status;
}
