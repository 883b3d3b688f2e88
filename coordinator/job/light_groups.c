#include "coordinator/job/light_groups.h"

#include <ctype.h>
#include <jansson.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "coordinator/job/job_private.h"
#include "worker/light/sky_patches.h"

enum { NAME_MOST = 31, BLOCKS_MOST = 256 };

static bool is_name(const char *name)
{
    size_t i = 0;
    while (isalnum((unsigned char)name[i]) != 0 || name[i] == '-' || name[i] == '_')
        i++;
    return i > 0 && i <= NAME_MOST && name[i] == '\0' && strcmp(name, "rest") != 0;
}

static bool is_list(const json_t *value)
{
    size_t i;
    json_t *one;
    bool good = json_array_size(value) > 0;
    json_array_foreach(value, i, one) good = good && json_is_string(one);
    return good;
}

/* Returns the value as a number. YAML scalars may come as text or as numbers. */
static double number_of(const json_t *value)
{
    char *end = NULL;
    if (!json_is_string(value))
        return json_number_value(value);
    const double number = strtod(json_string_value(value), &end);
    return *end == '\0' ? number : 0.0;
}

static bool is_blocks(const json_t *value)
{
    bool good = json_array_size(value) == 2;
    for (size_t i = 0; i < 2 && good; i++) {
        const double number = number_of(json_array_get(value, i));
        good = number >= 1.0 && number <= BLOCKS_MOST && number == floor(number);
    }
    return good;
}

void kiln_job_group_blocks(const json_t *rules, uint32_t blocks[2])
{
    const json_t *value = json_object_get(rules, "blocks");
    for (size_t i = 0; i < 2; i++)
        blocks[i] = value != NULL ? (uint32_t)number_of(json_array_get(value, i)) : 1;
}

/* Returns the name of the groups' source for errors. kiln relight takes groups from a bake, without knowing their
 * file. */
static const char *source_of(const struct kiln_job *job)
{
    return job->scene.light_groups != NULL ? job->scene.light_groups : "the bake's groups of lights";
}

static int check_group(const struct kiln_job *job, const char *name, json_t *rules, struct kiln_error *error)
{
    const char *key;
    json_t *value;
    if (!is_name(name))
        return kiln_fail(error, KILN_BAD_INPUT,
                         "%.300s: '%.100s' is no name of a group: up to %d letters, digits, - and _, and not 'rest', "
                         "which has what is in no group",
                         source_of(job), name, NAME_MOST);
    if (json_object_size(rules) == 0)
        return kiln_fail(error, KILN_BAD_INPUT, "%.300s: %s needs what is in it, such as {lights: [lamp]}",
                         source_of(job), name);
    json_object_foreach(rules, key, value)
    {
        const bool list = strcmp(key, "lights") == 0 || strcmp(key, "materials") == 0 || strcmp(key, "objects") == 0,
                   sky = strcmp(key, "environment") == 0, blocks = strcmp(key, "blocks") == 0;
        if (blocks && !is_blocks(value))
            return kiln_fail(error, KILN_BAD_INPUT,
                             "%.300s: %s: blocks are columns and rows, each from 1 to %d, such as [16, 9]",
                             source_of(job), name, BLOCKS_MOST);
        if ((!list && !sky && !blocks) || (list && !is_list(value)) || (sky && !json_is_true(value)))
            return kiln_fail(
                error, KILN_BAD_INPUT,
                "%.300s: %s: '%.100s' is not understood; a group has lists of names, lights, materials and "
                "objects, blocks: [COLUMNS, ROWS], and environment: true",
                source_of(job), name, key);
    }
    if (json_object_get(rules, "blocks") != NULL &&
        (json_object_get(rules, "lights") != NULL || json_object_get(rules, "environment") != NULL ||
         json_object_size(rules) == 1))
        return kiln_fail(error, KILN_BAD_INPUT,
                         "%.300s: %s: blocks are of surfaces that emit: give the group materials or objects alone",
                         source_of(job), name);
    return KILN_OK;
}

/* ---- names ---- */

static int add_name(struct kiln_job *job, const char *name, struct kiln_error *error)
{
    if (job->scene.group_count == KILN_GROUPS_MAX)
        return kiln_fail(error, KILN_USAGE, "there may be %d groups of lights at most, blocks and patches among them",
                         KILN_GROUPS_MAX - 1);
    return kiln_job_keep_text(job, name, &job->scene.group_names[job->scene.group_count++], error);
}

/* Adds the names of a group's blocks or, if it has none, the group's name. */
static int add_group(struct kiln_job *job, const char *name, const json_t *rules, struct kiln_error *error)
{
    uint32_t blocks[2];
    char text[NAME_MOST + 24];
    int status = KILN_OK;
    kiln_job_group_blocks(rules, blocks);
    if (json_object_get(rules, "blocks") == NULL)
        return add_name(job, name, error);
    for (uint32_t y = 0; y < blocks[1]; y++)
        for (uint32_t x = 0; x < blocks[0] && status == KILN_OK; x++) {
            (void)snprintf(text, sizeof text, "%.*s.%u.%u", NAME_MOST, name, x, y);
            status = add_name(job, text, error);
        }
    return status;
}

static int add_groups(struct kiln_job *job, json_t *groups, struct kiln_error *error)
{
    const char *name;
    json_t *rules;
    int status = KILN_OK, skies = job->scene.sky_patches != KILN_SKY_WHOLE;
    json_object_foreach(groups, name, rules)
    {
        status = check_group(job, name, rules, error);
        skies += json_is_true(json_object_get(rules, "environment"));
        if (status == KILN_OK && skies > 1)
            status =
                kiln_fail(error, KILN_BAD_INPUT, "%.300s: the environment is in two groups%s", source_of(job),
                          job->scene.sky_patches != KILN_SKY_WHOLE ? ", for --sky-patches makes groups of it" : "");
        if (status == KILN_OK)
            status = add_group(job, name, rules, error);
        if (status != KILN_OK)
            return status;
    }
    return KILN_OK;
}

static int add_patches(struct kiln_job *job, struct kiln_error *error)
{
    const uint32_t count = kiln_sky_patches[job->scene.sky_patches];
    int status = KILN_OK;
    for (uint32_t i = 0; i < count && status == KILN_OK; i++) {
        char name[KILN_GROUP_NAME];
        (void)snprintf(name, sizeof name, count > 1000 ? "sky.%04u" : "sky.%03u", i);
        status = add_name(job, name, error);
    }
    return status == KILN_OK && count > 0 ? add_name(job, "sky.ground", error) : status;
}

int kiln_job_groups_read(struct kiln_job *job, struct kiln_error *error)
{
    json_t *groups = NULL;
    void *room = NULL;
    job->scene.group_count = 0;
    if (job->scene.light_groups == NULL && job->scene.grouped == NULL && job->scene.sky_patches == KILN_SKY_WHOLE)
        return KILN_OK;
    int status = kiln_job_keep_room(job, KILN_GROUPS_MAX * sizeof(char *), &room, error);
    job->scene.group_names = room;
    KILN_TRY(status);
    if (job->scene.light_groups != NULL)
        KILN_TRY(kiln_job_yaml_read(job, job->scene.light_groups, &job->scene.grouped, error));
    if (job->scene.grouped != NULL && (groups = json_loads(job->scene.grouped, 0, NULL)) == NULL)
        KILN_TRY(kiln_fail(error, KILN_SYSTEM, "out of memory: the groups of lights"));
    KILN_TRY(add_groups(job, groups, error));
    KILN_TRY(add_patches(job, error));
    KILN_TRY(add_name(job, "rest", error));
end:
    json_decref(groups);
    return status;
}
