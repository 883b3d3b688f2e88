/* Settings of single objects, as a job file or an option has them. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "coordinator/job/job_reader.h"
#include "coordinator/job/object_settings.h"
#include "coordinator/job/options.h"

static int refuse(const struct kiln_job_reader *reader)
{
    return reader->refusal != 0 ? reader->refusal : KILN_BAD_INPUT;
}

json_t *kiln_job_scalar_json(const yaml_event_t *event)
{
    const char *text = (const char *)event->data.scalar.value;
    char *end = NULL;
    if (event->data.scalar.style != YAML_PLAIN_SCALAR_STYLE)
        return json_string(text);
    if (strcmp(text, "true") == 0 || strcmp(text, "false") == 0)
        return json_boolean(text[0] == 't');
    const double value = strtod(text, &end);
    if (text[0] == '\0' || text[strspn(text, "0123456789+-.eE")] != '\0' || *end != '\0' || !isfinite(value))
        return json_string(text);
    return value == floor(value) && fabs(value) < 0x1p53 ? json_integer((json_int_t)value) : json_real(value);
}

/* Reads one KEY: VALUE of a rule; sets *end at the end of the rule. */
static int read_setting(struct kiln_job_reader *reader, const char *pattern, json_t *rule, bool *end,
                        struct kiln_error *error)
{
    yaml_event_t key, value;
    struct kiln_object_settings unused = {0};
    char where[800];
    bool known = false;
    int status = kiln_job_next(reader, &key, error);
    if (status != KILN_OK)
        return status;
    *end = key.type == YAML_MAPPING_END_EVENT;
    if (!*end && (status = kiln_job_expect_scalar(reader, &key, "a setting", error)) == KILN_OK &&
        (status = kiln_job_next(reader, &value, error)) == KILN_OK) {
        const char *name = (const char *)key.data.scalar.value;
        json_t *json = NULL;
        status = kiln_job_expect_scalar(reader, &value, name, error);
        (void)snprintf(where, sizeof where, "%.500s:%zu: objects '%.200s'", reader->path,
                       kiln_job_line(&key.start_mark), pattern);
        if (status == KILN_OK && json_object_get(rule, name) != NULL)
            status = kiln_fail(error, refuse(reader), "%s: '%.100s' stands twice; remove one", where, name);
        if (status == KILN_OK)
            status = kiln_object_settings_read(&unused, name, json = kiln_job_scalar_json(&value), where,
                                               refuse(reader), &known, error);
        if (status == KILN_OK && !known)
            status = kiln_fail(error, refuse(reader), "%s: there is no setting '%.100s'; the nearest one is '%s'",
                               where, name, kiln_object_settings_nearest(name));
        if (status == KILN_OK)
            (void)json_object_set(rule, name, json);
        json_decref(json);
        yaml_event_delete(&value);
    }
    yaml_event_delete(&key);
    return status;
}

/* Reads one PATTERN: {...}; sets *end at the end of the rules. */
static int read_rule(struct kiln_job_reader *reader, json_t *rules, bool *end, struct kiln_error *error)
{
    yaml_event_t key, value;
    int status = kiln_job_next(reader, &key, error);
    if (status != KILN_OK)
        return status;
    *end = key.type == YAML_MAPPING_END_EVENT;
    if (!*end && (status = kiln_job_expect_scalar(reader, &key, "a name or pattern", error)) == KILN_OK &&
        (status = kiln_job_next(reader, &value, error)) == KILN_OK) {
        const char *pattern = (const char *)key.data.scalar.value;
        const size_t line = kiln_job_line(&key.start_mark);
        json_t *rule = json_object();
        if (value.type != YAML_MAPPING_START_EVENT)
            status = kiln_fail(error, refuse(reader),
                               "%.500s:%zu: objects '%.200s' needs settings, such as {density-scale: 2}", reader->path,
                               line, pattern);
        else if (json_object_get(rules, pattern) != NULL)
            status = kiln_fail(error, refuse(reader), "%.500s:%zu: objects '%.200s' stands twice; remove one",
                               reader->path, line, pattern);
        for (bool done = false; status == KILN_OK && !done;)
            status = read_setting(reader, pattern, rule, &done, error);
        if (status == KILN_OK && json_object_set(rules, pattern, rule) != 0)
            status = kiln_fail(error, refuse(reader), "%.500s:%zu: objects '%.200s' is not a name in UTF-8",
                               reader->path, line, pattern);
        json_decref(rule);
        yaml_event_delete(&value);
    }
    yaml_event_delete(&key);
    return status;
}

int kiln_job_rules_read(struct kiln_job_reader *reader, char **kept, struct kiln_error *error)
{
    json_t *rules = json_object();
    int status = KILN_OK;
    for (bool end = false; status == KILN_OK && !end;)
        status = read_rule(reader, rules, &end, error);
    char *text = status == KILN_OK ? json_dumps(rules, 0) : NULL;
    json_decref(rules);
    if (status != KILN_OK)
        return status;
    if (text == NULL)
        status = kiln_fail(error, KILN_SYSTEM, "out of memory for the settings of objects");
    else if (strlen(text) > KILN_RULES_LIMIT)
        status = kiln_fail(
            error, refuse(reader),
            "%.500s: objects: %zu bytes of rules are too many (at most %d); use patterns, or extras in the scene",
            reader->path, strlen(text), KILN_RULES_LIMIT);
    else
        status = kiln_job_keep(reader->job, text, strlen(text), kept, error);
    free(text);
    return status;
}

int kiln_job_rules_parse(const char *text, const char *where, int refusal, struct kiln_job *job, char **kept,
                         struct kiln_error *error)
{
    static const char *const shape = "settings of objects are written as {PATTERN: {KEY: VALUE, ...}, ...}";
    struct kiln_job_reader reader = {.job = job, .path = where, .refusal = refusal};
    if (yaml_parser_initialize(&reader.parser) == 0)
        return kiln_fail(error, KILN_SYSTEM, "out of memory for the settings of objects");
    yaml_parser_set_input_string(&reader.parser, (const unsigned char *)text, strlen(text));
    int status;
    KILN_TRY(kiln_job_expect(&reader, YAML_STREAM_START_EVENT, shape, error));
    KILN_TRY(kiln_job_expect(&reader, YAML_DOCUMENT_START_EVENT, shape, error));
    KILN_TRY(kiln_job_expect(&reader, YAML_MAPPING_START_EVENT, shape, error));
    KILN_TRY(kiln_job_rules_read(&reader, kept, error));
    KILN_TRY(kiln_job_expect(&reader, YAML_DOCUMENT_END_EVENT, shape, error));
    KILN_TRY(kiln_job_expect(&reader, YAML_STREAM_END_EVENT, shape, error));
end:
    yaml_parser_delete(&reader.parser);
    return status == KILN_BAD_INPUT ? refusal : status;
}
