#include "coordinator/job/light_groups.h"

#include <ctype.h>
#include <jansson.h>
#include <stdlib.h>
#include <string.h>

#include "coordinator/job/job_private.h"

static bool is_name(const char *name)
{
    size_t i = 0;
    while (isalnum((unsigned char)name[i]) != 0 || name[i] == '-' || name[i] == '_')
        i++;
    return i > 0 && i < KILN_GROUP_NAME && name[i] == '\0' && strcmp(name, "rest") != 0;
}

static bool is_list(const json_t *value)
{
    size_t i;
    json_t *one;
    bool good = json_array_size(value) > 0;
    json_array_foreach(value, i, one) good = good && json_is_string(one);
    return good;
}

static int check_group(const struct kiln_job *job, const char *name, json_t *rules, struct kiln_error *error)
{
    const char *key;
    json_t *value;
    if (!is_name(name))
        return kiln_fail(error, KILN_BAD_INPUT,
                         "%.300s: '%.100s' is no name of a group: up to %d letters, digits, - and _, and not 'rest', "
                         "which has what is in no group",
                         job->light_groups, name, KILN_GROUP_NAME - 1);
    if (json_object_size(rules) == 0)
        return kiln_fail(error, KILN_BAD_INPUT, "%.300s: %s needs what is in it, such as {lights: [lamp]}",
                         job->light_groups, name);
    json_object_foreach(rules, key, value)
    {
        const bool list = strcmp(key, "lights") == 0 || strcmp(key, "materials") == 0 || strcmp(key, "objects") == 0,
                   sky = strcmp(key, "environment") == 0;
        if ((!list && !sky) || (list && !is_list(value)) || (sky && !json_is_true(value)))
            return kiln_fail(
                error, KILN_BAD_INPUT,
                "%.300s: %s: '%.100s' is not understood; a group has lists of names, lights, materials and "
                "objects, and environment: true",
                job->light_groups, name, key);
    }
    return KILN_OK;
}

static int take(struct kiln_job *job, json_t *groups, struct kiln_error *error)
{
    const char *name;
    json_t *rules;
    int status = KILN_OK, skies = 0;
    if (json_object_size(groups) >= KILN_GROUPS_MAX)
        return kiln_fail(error, KILN_BAD_INPUT, "%.300s: there may be %d groups at most", job->light_groups,
                         KILN_GROUPS_MAX - 1);
    json_object_foreach(groups, name, rules)
    {
        status = check_group(job, name, rules, error);
        skies += json_is_true(json_object_get(rules, "environment"));
        if (status == KILN_OK && skies > 1)
            status = kiln_fail(error, KILN_BAD_INPUT, "%.300s: the environment is in two groups", job->light_groups);
        if (status == KILN_OK)
            status = kiln_job_keep_text(job, name, &job->group_names[job->group_count++], error);
        if (status != KILN_OK)
            return status;
    }
    return kiln_job_keep_text(job, "rest", &job->group_names[job->group_count++], error);
}

int kiln_job_groups_read(struct kiln_job *job, struct kiln_error *error)
{
    json_t *groups = NULL;
    job->group_count = 0;
    if (job->light_groups == NULL)
        return KILN_OK;
    int status = kiln_job_yaml_read(job, job->light_groups, &job->grouped, error);
    if (status == KILN_OK && (groups = json_loads(job->grouped, 0, NULL)) == NULL)
        status = kiln_fail(error, KILN_SYSTEM, "out of memory: the groups of lights");
    if (status == KILN_OK)
        status = take(job, groups, error);
    json_decref(groups);
    return status;
}
