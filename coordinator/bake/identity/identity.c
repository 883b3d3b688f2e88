#include "coordinator/bake/identity/identity.h"

#include <stdio.h>
#include <string.h>

#include "coordinator/bake/light/visible_from.h"
#include "coordinator/job/gone.h"
#include "coordinator/job/options.h"
#include "coordinator/files/checksummed_json.h"
#include "coordinator/integrate/companion.h"
#include "worker/base/text.h"
#include "worker/base/version.h"

#define VERSION "kiln" /* the key of the version that made the identity */

/* Options of bake that affect the light on the surfaces, or the order of the points in a checkpoint. Companions have
 * more (integrate/companion.h). */
static const char *const counting[] = {"environment",
                                       "environment-scale",
                                       "environment-rotation",
                                       "method",
                                       "bounces",
                                       "tail",
                                       "schedule",
                                       "samples-direct",
                                       "samples-bounce",
                                       "samples-indirect",
                                       "indirect-scale",
                                       "final-scale",
                                       "guide",
                                       "materials",
                                       "caustics",
                                       "chain-length",
                                       "only-visible-from",
                                       "seed",
                                       "ambient-occlusion",
                                       "directional",
                                       "store",
                                       "leaf-size",
                                       "texels-per-metre",
                                       "lightmap-size",
                                       "lightmap-max",
                                       "repack",
                                       "shared-texels",
                                       "objects",
                                       "trust",
                                       "up",
                                       "unit",
                                       "sides",
                                       "cell-size",
                                       "partition",
                                       "exchange",
                                       NULL};
/* Options that affect only the probes. */
static const char *const probing[] = {"probe-spacing", "volume-bounds", "samples-probe", NULL};
/* Options that affect neither: devices, speed, limits, messages and output files. --quality is covered by the sample
 * counts that it sets, --rounds by parts (integrate/parts/parts.c). */
static const char *const other[] = {
    "output", "backend", "threads", "instruction-set", "quality", "half", "stitch", "denoise", "check-density",
    "preview", "exposure", "auto-exposure", "tone-map", "json", "quiet", "verbose", "resume", "checkpoint-every",
    "max-time", "rounds", "time", "watchdog", "device", "devices", "device-memory", "memory-budget", "kernel-cache",
    "checkpoint-local", "strict",
    /* units only give numbers a name; they change none of them */
    "verify-fraction", "trace", "shared-memory-ranks", "work-stealing", "rebalance", "units", "export", "vertex-light",
    /* changes are already part of the scene's content */
    "changes", NULL};

static bool is_among(const char *name, const char *const *list)
{
    for (size_t i = 0; list != NULL && list[i] != NULL; i++)
        if (strcmp(list[i], name) == 0)
            return true;
    return false;
}

bool kiln_identity_counts(const char *name, bool *known)
{
    bool counts = is_among(name, counting) || is_among(name, probing), idle = is_among(name, other);
    for (size_t i = 0; kiln_companions[i] != NULL; i++) {
        counts = counts || is_among(name, kiln_companions[i]->identity);
        idle = idle || is_among(name, kiln_companions[i]->no_identity);
    }
    *known = counts || idle;
    return counts;
}

static json_t *value_json(const struct kiln_job *job, const struct kiln_option *option)
{
    char room[KILN_OPTION_TEXT];
    json_t *json = json_string(kiln_option_text(job, option, room));
    return json != NULL ? json : json_string("not UTF-8");
}

/* The list may be NULL. */
static void add_values(json_t *values, const struct kiln_job *job, const char *const *names)
{
    for (size_t i = 0; names != NULL && names[i] != NULL; i++) {
        const struct kiln_option *option = kiln_option_find_for(names[i], KILN_FOR_BAKE);
        if (option != NULL)
            (void)json_object_set_new(values, names[i], value_json(job, option));
    }
}

/* Adds the options of the companions that come after option `after`; NULL: after all others. */
static void add_companions(json_t *values, const struct kiln_job *job, const char *after)
{
    for (size_t i = 0; kiln_companions[i] != NULL; i++) {
        const char *own = kiln_companions[i]->identity_after;
        if (own == after || (own != NULL && after != NULL && strcmp(own, after) == 0))
            add_values(values, job, kiln_companions[i]->identity);
    }
}

static json_t *fields_json(const struct kiln_job *job)
{
    json_t *fields = json_object();
    for (size_t i = 0; counting[i] != NULL; i++) {
        add_values(fields, job, (const char *const[]){counting[i], NULL});
        add_companions(fields, job, counting[i]);
    }
    add_companions(fields, job, NULL);
    return fields;
}

json_t *kiln_identity_make(const struct kiln_job *job, const struct kiln_prepared *prepared)
{
    const struct kiln_scene *scene = prepared->scene;
    json_t *fields = fields_json(job), *sources = json_object(), *probes = json_object();
    add_values(probes, job, probing);
    for (size_t i = 0; i < scene->source_count; i++)
        (void)json_object_set_new(sources, kiln_scene_string(scene, scene->sources[i].path),
                                  kiln_hash_json(scene->sources[i].hash));
    uint64_t views[2];
    if (job->light.only_visible_from != NULL && kiln_visible_from_hash(job->light.only_visible_from, views))
        (void)json_object_set_new(fields, "camera path", kiln_hash_json(views));
    for (size_t i = 0; kiln_companions[i] != NULL; i++)
        if (kiln_companions[i]->identify != NULL)
            kiln_companions[i]->identify(job, fields);
    (void)json_object_set_new(fields, "scene content", kiln_hash_json(scene->header->content_hash));
    (void)json_object_set_new(fields, VERSION, json_string(KILN_VERSION));
    return json_pack("{s:o, s:o, s:o, s:{s:s, s:s}}", "fields", fields, "probes", probes, "sources", sources, "machine",
                     "backend", kiln_backend_name(prepared->backend), "instruction set", prepared->instruction_set);
}

const char *kiln_identity_backend(const json_t *identity)
{
    return json_string_value(json_object_get(json_object_get(identity, "machine"), "backend"));
}

const char *kiln_identity_instruction_set(const json_t *identity)
{
    return json_string_value(json_object_get(json_object_get(identity, "machine"), "instruction set"));
}

/* A table of differences, as text. */
struct rows {
    char text[1400];
    size_t count;
};

static const char *text_of(const json_t *json) { return json_is_string(json) ? json_string_value(json) : "-"; }

static void add_row(struct rows *rows, const char *name, const char *then, const char *now)
{
    char cells[3][104];
    const size_t used = strlen(rows->text);
    (void)snprintf(rows->text + used, sizeof rows->text - used, "\n  %-22s %-34s %s",
                   kiln_text_plain(cells[0], 61, name), kiln_text_plain(cells[1], sizeof cells[1], then),
                   kiln_text_plain(cells[2], sizeof cells[2], now));
    rows->count++;
}

/* Whether the value is the default of an option that no longer exists, so that nobody gave it. */
static bool is_gone_default(const char *name, const json_t *value)
{
    const struct kiln_gone_option *gone = kiln_gone_option_find(name);
    return gone != NULL && strcmp(text_of(value), gone->fallback) == 0;
}

/* Adds a row for each key whose values differ, or that only one of the objects has; none for the version. */
static void compare_objects(struct rows *rows, const json_t *then, const json_t *now, const char *prefix)
{
    const char *key;
    json_t *value;
    char name[300];
    json_object_foreach((json_t *)(uintptr_t)now, key, value)
    {
        const json_t *old = json_object_get(then, key);
        (void)snprintf(name, sizeof name, "%s%.250s", prefix, key);
        if (strcmp(key, VERSION) != 0 && (old == NULL || json_equal(old, value) == 0))
            add_row(rows, name, text_of(old), text_of(value));
    }
    json_object_foreach((json_t *)(uintptr_t)then, key, value)
    {
        (void)snprintf(name, sizeof name, "%s%.250s", prefix, key);
        if (json_object_get(now, key) == NULL && !is_gone_default(key, value))
            add_row(rows, name, text_of(value), "-");
    }
}

bool kiln_identity_same_probes(const json_t *then, const json_t *now)
{
    const json_t *old = json_object_get(then, "probes"), *new = json_object_get(now, "probes");
    return old != NULL && new != NULL &&json_equal(old, new) != 0;
}

/* Refuses the checkpoint of a version whose results have other bits. An identity without a version passes. */
static int check_version(const char *version, const char *directory, struct kiln_error *error)
{
    if (version == NULL || kiln_version_has_same_bits(version))
        return KILN_OK;
    return kiln_fail(error, KILN_BAD_INPUT,
                     "the checkpoint in %.300s/checkpoint is of kiln %.50s, and the results of this kiln, %s, have "
                     "other bits: finish it with kiln %.50s, or give --no-resume to discard it and start from the "
                     "beginning",
                     directory, version, KILN_VERSION, version);
}

/* The advice where another version, which may have had other options, has made the identity. */
static const char *version_note(const char *version, char *text, size_t size)
{
    if (version != NULL && strcmp(version, KILN_VERSION) != 0)
        (void)snprintf(text, size, ". It is of kiln %.30s, which can finish it", version);
    return text;
}

int kiln_identity_compare(const json_t *then, const json_t *now, const char *directory, char *note, size_t note_size,
                          struct kiln_error *error)
{
    struct rows rows = {"", 0}, machine = {"", 0};
    const char *version = json_string_value(json_object_get(json_object_get(then, "fields"), VERSION));
    const int status = check_version(version, directory, error);
    if (status != KILN_OK)
        return status;
    add_row(&rows, "field", "in the checkpoint", "now");
    rows.count = 0;
    compare_objects(&rows, json_object_get(then, "fields"), json_object_get(now, "fields"), "");
    if (rows.count >
        0) { /* changed source files are shown only then; if the scene is the same, they are no reason to refuse */
        compare_objects(&rows, json_object_get(then, "sources"), json_object_get(now, "sources"), "file ");
        return kiln_fail_table(error, KILN_BAD_INPUT, rows.text,
                               "the checkpoint in %.300s/checkpoint is of another job; repeat the command that it was "
                               "made with, or give --no-resume to discard it and start from the beginning%s",
                               directory, version_note(version, (char[100]){""}, 100));
    }
    compare_objects(&machine, json_object_get(then, "machine"), json_object_get(now, "machine"), "");
    const json_t *old = json_object_get(then, "machine"), *new = json_object_get(now, "machine");
    (void)snprintf(note, note_size, "%s", "");
    if (machine.count > 0)
        (void)snprintf(note, note_size,
                       "the checkpoint was made by %s, %s, and this run has %s, %s: the same light within its error, "
                       "not the same bits",
                       text_of(json_object_get(old, "backend")), text_of(json_object_get(old, "instruction set")),
                       text_of(json_object_get(new, "backend")), text_of(json_object_get(new, "instruction set")));
    return KILN_OK;
}
