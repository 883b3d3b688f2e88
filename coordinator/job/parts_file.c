/* Reads `parts:` of a job file. */
#include <string.h>

#include "coordinator/job/job_reader.h"
#include "worker/base/memory.h"

enum { DEEPEST = 5 }; /* a part's `at`, its places, a matrix's rows and their numbers */

static int read_value(struct kiln_job_reader *reader, yaml_event_t *event, bool text, int depth, json_t **json,
                      struct kiln_error *error);

static int wrong(const struct kiln_job_reader *reader, const yaml_event_t *at, const char *what,
                 struct kiln_error *error)
{
    return kiln_fail(error, KILN_BAD_INPUT, "%.500s:%zu: parts: %s", reader->path, kiln_job_line(&at->start_mark),
                     what);
}

/* Reads KEY: VALUE, whose key is `event`. */
static int read_member(struct kiln_job_reader *reader, const yaml_event_t *event, int depth, json_t *into,
                       struct kiln_error *error)
{
    const char *key = (const char *)event->data.scalar.value;
    json_t *member = NULL;
    yaml_event_t value;
    int status = kiln_job_expect_scalar(reader, event, "a key", error);
    if (status != KILN_OK)
        return status;
    if (json_object_get(into, key) != NULL)
        return kiln_fail(error, KILN_BAD_INPUT, "%.500s:%zu: parts: '%.60s' stands twice; remove one", reader->path,
                         kiln_job_line(&event->start_mark), key);
    status = kiln_job_next(reader, &value, error);
    if (status != KILN_OK)
        return status;
    status =
        read_value(reader, &value, strcmp(key, "name") == 0 || strcmp(key, "file") == 0, depth + 1, &member, error);
    if (status == KILN_OK && json_object_set(into, key, member) != 0)
        status = wrong(reader, event, "a key is not text in UTF-8", error);
    json_decref(member);
    return status;
}

static int read_element(struct kiln_job_reader *reader, yaml_event_t *event, int depth, json_t *into,
                        struct kiln_error *error)
{
    json_t *member = NULL;
    int status = read_value(reader, event, false, depth + 1, &member, error);
    if (status == KILN_OK && json_array_append(into, member) != 0)
        status = kiln_fail(error, KILN_SYSTEM, "out of memory: the parts of the scene");
    json_decref(member);
    return status;
}

/* Reads the members of a mapping or list whose beginning was read. */
static int read_members(struct kiln_job_reader *reader, bool list, int depth, json_t *into, struct kiln_error *error)
{
    int status = KILN_OK;
    for (bool end = false; status == KILN_OK && !end;) {
        yaml_event_t event;
        status = kiln_job_next(reader, &event, error);
        if (status != KILN_OK)
            return status;
        end = event.type == (list ? YAML_SEQUENCE_END_EVENT : YAML_MAPPING_END_EVENT);
        if (!end && list) {
            status = read_element(reader, &event, depth, into, error); /* deletes the event */
            continue;
        }
        if (!end)
            status = read_member(reader, &event, depth, into, error);
        yaml_event_delete(&event);
    }
    return status;
}

/* The value that begins with `event`, which is deleted. `text`: it is text even if it looks like a number. */
static int read_value(struct kiln_job_reader *reader, yaml_event_t *event, bool text, int depth, json_t **json,
                      struct kiln_error *error)
{
    const bool list = event->type == YAML_SEQUENCE_START_EVENT, mapping = event->type == YAML_MAPPING_START_EVENT;
    int status = KILN_OK;
    if (depth > DEEPEST)
        status =
            wrong(reader, event, "nothing of a part lies so deep; a place is a mapping or the rows of a matrix", error);
    else if (list || mapping)
        *json = list ? json_array() : json_object();
    else if ((status = kiln_job_expect_scalar(reader, event, "a value of a part", error)) == KILN_OK)
        *json = text ? json_string((const char *)event->data.scalar.value) : kiln_job_scalar_json(event);
    if (status == KILN_OK && *json == NULL)
        status = wrong(reader, event, "is not text in UTF-8", error);
    yaml_event_delete(event);
    return status == KILN_OK && (list || mapping) ? read_members(reader, list, depth, *json, error) : status;
}

/* Reads one part of the list, whose first event is `event`, which is deleted. */
static int read_part(struct kiln_job_reader *reader, yaml_event_t *event, struct kiln_part *part,
                     struct kiln_error *error)
{
    char where[600];
    json_t *json = NULL;
    (void)snprintf(where, sizeof where, "%.500s:%zu", reader->path, kiln_job_line(&event->start_mark));
    int status = read_value(reader, event, false, 0, &json, error);
    if (status == KILN_OK && !reader->only_quality)
        status = kiln_part_read(reader->job, json, where, reader->folder, part, error);
    json_decref(json);
    return status;
}

int kiln_job_parts_list(struct kiln_job_reader *reader, size_t line, struct kiln_error *error)
{
    struct kiln_part *parts = NULL;
    size_t count = 0, room = 0;
    int status = KILN_OK;
    char where[600];
    (void)snprintf(where, sizeof where, "%.500s:%zu", reader->path, line);
    for (;;) {
        yaml_event_t event;
        KILN_TRY(kiln_job_next(reader, &event, error));
        if (event.type == YAML_SEQUENCE_END_EVENT) {
            yaml_event_delete(&event);
            break;
        }
        status = kiln_grow(&parts, &room, count + 1, sizeof *parts, "the parts of the scene", error);
        if (status != KILN_OK)
            yaml_event_delete(&event);
        KILN_TRY(status);
        KILN_TRY(read_part(reader, &event, &parts[count], error));
        count++;
    }
    if (!reader->only_quality)
        KILN_TRY(kiln_job_take_parts(reader->job, parts, count, where, error));
end:
    kiln_free(&parts);
    return status;
}
