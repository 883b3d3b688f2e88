#include "coordinator/cli/mix_factors.h"

#include <fnmatch.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "coordinator/job/options.h"
#include "worker/base/memory.h"

#define MOST_FACTOR 1e12

/* Reads a factor: one number, or three (RGB) separated by commas. */
static bool read_factor(const char *text, double factor[3])
{
    int count = 0;
    bool more = true;
    for (; more && count < 3; count++) {
        char *end = NULL;
        if (text[0] == '\0' || strchr("0123456789.+-", text[0]) == NULL ||
            /* refuses words ("inf", "nan") and hexadecimal numbers, which strtod accepts */
            text[strspn(text, "0123456789+-.eE,")] != '\0')
            return false;
        factor[count] = strtod(text, &end);
        if (end == text || !(factor[count] >= 0.0 && factor[count] <= MOST_FACTOR) || (*end != ',' && *end != '\0'))
            return false;
        more = *end == ',';
        text = end + 1;
    }
    if (count == 1)
        factor[1] = factor[2] = factor[0];
    return !more && count != 2;
}

static const char *nearest(const struct kiln_mix_factors *f, const char *name)
{
    const char *best = f->names[0];
    for (size_t g = 1; g < f->count; g++)
        if (kiln_edit_distance(name, f->names[g]) < kiln_edit_distance(name, best))
            best = f->names[g];
    return best;
}

static int set_line(struct kiln_mix_factors *f, const char *line, const char *directory, struct kiln_error *error)
{
    char name[256];
    double factor[3] = {0};
    const char *equals = strrchr(line, '=');
    bool found = false;
    if (equals == NULL || equals == line)
        return kiln_fail(error, KILN_USAGE,
                         "--set %.200s: give a group and its factor, such as lamp=0.5 or lamp=1,0.5,0", line);
    if (!read_factor(equals + 1, factor))
        return kiln_fail(error, KILN_USAGE,
                         "--set %.200s: '%.100s' is no factor; it must be a number from 0 to %g, or three, R,G,B, with "
                         "commas between them",
                         line, equals + 1, MOST_FACTOR);
    (void)snprintf(name, sizeof name, "%.*s", (int)(equals - line), line);
    for (size_t g = 0; g < f->count; g++)
        if (fnmatch(name, f->names[g], 0) == 0) {
            memcpy(f->of[g], factor, sizeof factor);
            found = true;
        }
    return found ? KILN_OK
                 : kiln_fail(error, KILN_USAGE,
                             "--set %.200s: %.300s has no group of lights '%.100s'; the nearest of its %zu is '%s'",
                             line, directory, name, f->count, nearest(f, name));
}

/* Each of the lines. */
static int set_lines(struct kiln_mix_factors *f, const struct kiln_job *job, struct kiln_error *error)
{
    int status = KILN_OK;
    for (const char *at = job->mix.factors; status == KILN_OK && at != NULL; at = strchr(at, '\n')) {
        char line[512];
        at += *at == '\n';
        (void)snprintf(line, sizeof line, "%.*s", (int)strcspn(at, "\n"), at);
        status = set_line(f, line, job->arguments[0], error);
    }
    return status;
}

static int take_names(struct kiln_mix_factors *f, const json_t *groups, const char *directory, struct kiln_error *error)
{
    for (size_t g = 0; g < f->count; g++) {
        f->names[g] = json_string_value(json_object_get(json_array_get(groups, g), "name"));
        if (f->names[g] == NULL || strlen(f->names[g]) >= KILN_GROUP_NAME)
            return kiln_fail(error, KILN_BAD_INPUT, "%.300s/run.json: group of lights %zu has no name; bake again",
                             directory, g);
        for (int c = 0; c < 3; c++)
            f->of[g][c] = 1.0;
    }
    return KILN_OK;
}

int kiln_mix_factors_make(struct kiln_mix_factors *f, const struct kiln_job *job, const json_t *run,
                          struct kiln_error *error)
{
    const json_t *groups = json_object_get(run, "light_groups");
    *f = (struct kiln_mix_factors){.count = json_array_size(groups)};
    if (f->count == 0 || f->count > KILN_GROUPS_MAX)
        return kiln_fail(error, KILN_BAD_INPUT,
                         "%.300s has not told groups of lights apart: bake with --light-groups or --sky-patches",
                         job->arguments[0]);
    int status;
    KILN_TRY(kiln_allocate(&f->names, f->count, sizeof *f->names, "groups of lights", error));
    KILN_TRY(kiln_allocate(&f->of, f->count, sizeof *f->of, "groups of lights", error));
    KILN_TRY(take_names(f, groups, job->arguments[0], error));
    KILN_TRY(set_lines(f, job, error));
end:
    for (int c = 0; c < 3; c++)
        f->least[c] = INFINITY;
    for (size_t g = 0; g < f->count && status == KILN_OK; g++)
        for (int c = 0; c < 3; c++)
            f->least[c] = fmin(f->least[c], f->of[g][c]);
    return status;
}

void kiln_mix_factors_release(struct kiln_mix_factors *f)
{
    kiln_free(&f->names);
    kiln_free(&f->of);
}

json_t *kiln_mix_factors_json(const struct kiln_mix_factors *f)
{
    json_t *json = json_object();
    for (size_t g = 0; g < f->count; g++)
        (void)json_object_set_new(json, f->names[g], json_pack("[f, f, f]", f->of[g][0], f->of[g][1], f->of[g][2]));
    return json;
}
