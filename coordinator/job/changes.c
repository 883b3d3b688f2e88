#include "coordinator/job/changes.h"

#include <ctype.h>
#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <yaml.h>

#include "coordinator/files/foreign_json.h"
#include "coordinator/files/plain_file.h"
#include "coordinator/job/job_private.h"

enum { LIMIT = 1 << 16, DEEPEST = 5 }; /* largest file, bytes; deepest nesting of mappings and lists */

struct reader {
    yaml_parser_t parser;
    const char *path;
};

static int wrong(const struct reader *r, const yaml_event_t *at, const char *what, struct kiln_error *error)
{
    return kiln_fail(error, KILN_BAD_INPUT, "%.500s:%zu: %s", r->path, at->start_mark.line + 1, what);
}

static int next(struct reader *r, yaml_event_t *event, struct kiln_error *error)
{
    if (yaml_parser_parse(&r->parser, event) != 0)
        return KILN_OK;
    return kiln_fail(error, KILN_BAD_INPUT, "%.500s:%zu: is not YAML: %s", r->path, r->parser.problem_mark.line + 1,
                     r->parser.problem != NULL ? r->parser.problem : "cannot be read");
}

static json_t *scalar(const yaml_event_t *event)
{
    const char *text = (const char *)event->data.scalar.value;
    char *end = NULL;
    if (event->data.scalar.style != YAML_PLAIN_SCALAR_STYLE)
        return json_string(text);
    if (strcmp(text, "true") == 0 || strcmp(text, "false") == 0)
        return json_boolean(text[0] == 't');
    const double value = strtod(text, &end);
    return text[0] != '\0' && *end == '\0' && isfinite(value) ? json_real(value) : json_string(text);
}

/* The value that begins with `event`, which is deleted. */
static int value(struct reader *r, yaml_event_t *event, int depth, json_t **json, struct kiln_error *error);

/* Reads the members of a mapping or list whose beginning was read. */
static int members(struct reader *r, bool list, int depth, json_t *into, struct kiln_error *error)
{
    for (;;) {
        yaml_event_t event;
        json_t *member = NULL;
        char *key = NULL;
        int status = next(r, &event, error);
        if (status != KILN_OK)
            return status;
        if (event.type == (list ? YAML_SEQUENCE_END_EVENT : YAML_MAPPING_END_EVENT)) {
            yaml_event_delete(&event);
            return KILN_OK;
        }
        if (!list) {
            if (event.type != YAML_SCALAR_EVENT)
                status = wrong(r, &event, "a key is a single value", error);
            else if (json_object_get(into, (const char *)event.data.scalar.value) != NULL)
                status = wrong(r, &event, "the key stands twice; remove one", error);
            else if ((key = strdup((const char *)event.data.scalar.value)) == NULL)
                status = kiln_fail(error, KILN_SYSTEM, "out of memory: the changes");
            yaml_event_delete(&event);
            if (status == KILN_OK)
                status = next(r, &event, error);
        }
        if (status == KILN_OK)
            status = value(r, &event, depth + 1, &member, error);
        if (status == KILN_OK && (list ? json_array_append(into, member) : json_object_set(into, key, member)) != 0)
            status = kiln_fail(error, KILN_BAD_INPUT, "%.500s: is not text in UTF-8", r->path);
        json_decref(member);
        free(key);
        if (status != KILN_OK)
            return status;
    }
}

static int value(struct reader *r, yaml_event_t *event, int depth, json_t **json, struct kiln_error *error)
{
    int status = KILN_OK;
    const bool list = event->type == YAML_SEQUENCE_START_EVENT, mapping = event->type == YAML_MAPPING_START_EVENT;
    *json = event->type == YAML_SCALAR_EVENT ? scalar(event) : list ? json_array() : mapping ? json_object() : NULL;
    if (depth > DEEPEST || (*json == NULL && event->type != YAML_SCALAR_EVENT))
        status =
            wrong(r, event, "this is no value that changes have; kiln relight --help names the file's keys", error);
    else if (*json == NULL)
        status = wrong(r, event, "is not text in UTF-8", error);
    yaml_event_delete(event);
    return status == KILN_OK && (list || mapping) ? members(r, list, depth, *json, error) : status;
}

/* Nothing may follow the document. */
static int end(struct reader *r, struct kiln_error *error)
{
    yaml_event_t event;
    int status = next(r, &event, error); /* the end of the document */
    if (status != KILN_OK)
        return status;
    yaml_event_delete(&event);
    status = next(r, &event, error);
    if (status != KILN_OK)
        return status;
    if (event.type != YAML_STREAM_END_EVENT)
        status = wrong(r, &event, "a second document begins here; leave one", error);
    yaml_event_delete(&event);
    return status;
}

static int document(struct reader *r, json_t **json, struct kiln_error *error)
{
    yaml_event_t event;
    int status = next(r, &event, error); /* the begin of the stream */
    if (status != KILN_OK)
        return status;
    yaml_event_delete(&event);
    status = next(r, &event, error); /* and of the document */
    if (status != KILN_OK)
        return status;
    const bool empty = event.type != YAML_DOCUMENT_START_EVENT;
    yaml_event_delete(&event);
    if (empty)
        return kiln_fail(error, KILN_BAD_INPUT, "%.500s: is empty; nothing is named in it", r->path);
    KILN_TRY(next(r, &event, error));
    KILN_TRY(value(r, &event, 0, json, error));
    if (!json_is_object(*json))
        KILN_TRY(kiln_fail(error, KILN_BAD_INPUT, "%.500s: is one mapping, NAME: {...}", r->path));
end:
    return status == KILN_OK ? end(r, error) : status;
}

int kiln_changes_parse(const char *path, const char *text, size_t size, json_t **json, struct kiln_error *error)
{
    struct reader r = {.path = path};
    *json = NULL;
    if (memchr(text, '\0', size) != NULL) /* which ends all text for libyaml */
        return kiln_fail(error, KILN_BAD_INPUT, "%.500s: has a byte of value 0, which is no text; remove it", path);
    if (yaml_parser_initialize(&r.parser) == 0)
        return kiln_fail(error, KILN_SYSTEM, "out of memory: the changes");
    yaml_parser_set_input_string(&r.parser, (const unsigned char *)text, size);
    const int status = document(&r, json, error);
    yaml_parser_delete(&r.parser);
    return status;
}

/* Converts JSON to text and releases `json`. `status`: result of the parsing before. Release the text with free. */
static int text_of(json_t *json, int status, char **json_text, struct kiln_error *error)
{
    *json_text = status == KILN_OK ? json_dumps(json, JSON_COMPACT) : NULL;
    json_decref(json);
    return status == KILN_OK && *json_text == NULL ? kiln_fail(error, KILN_SYSTEM, "out of memory: the changes")
                                                   : status;
}

int kiln_changes_line(const char *line, size_t length, const char *where, char **json_text, struct kiln_error *error)
{
    json_t *json;
    const int status = kiln_changes_parse(where, line, length, &json, error);
    return text_of(json, status, json_text, error);
}

/* The file's bytes, in `bytes`. */
static int read_file(const char *path, char bytes[LIMIT + 1], size_t *size, struct kiln_error *error)
{
    int descriptor;
    const int status = kiln_open_plain(path, &descriptor, error);
    ssize_t got = 1;
    if (status != KILN_OK)
        return status;
    for (*size = 0; *size <= LIMIT && got != 0;) {
        got = read(descriptor, bytes + *size, LIMIT + 1 - *size);
        if (got < 0 && errno != EINTR)
            break;
        *size += got > 0 ? (size_t)got : 0;
    }
    const int read_all = got >= 0 ? KILN_OK : kiln_fail_errno(error, KILN_IO, "cannot read %.500s", path);
    (void)close(descriptor);
    return *size <= LIMIT
               ? read_all
               : kiln_fail(error, KILN_BAD_INPUT, "%.500s: is longer than such a file may be (%d bytes)", path, LIMIT);
}

int kiln_job_yaml_read(struct kiln_job *job, const char *path, char **kept, struct kiln_error *error)
{
    char bytes[LIMIT + 1], *text = NULL;
    size_t size = 0;
    json_t *json = NULL;
    int status = read_file(path, bytes, &size, error);
    if (status == KILN_OK)
        status = kiln_foreign_json(&json, KILN_YAML_CHILD, bytes, size, path, error);
    status = text_of(json, status, &text, error);
    if (status == KILN_OK)
        status = kiln_job_keep_text(job, text, kept, error);
    free(text);
    return status;
}

int kiln_job_changes_read(struct kiln_job *job, struct kiln_error *error)
{
    return job->scene.changes != NULL ? kiln_job_yaml_read(job, job->scene.changes, &job->scene.changed, error)
                                      : KILN_OK;
}

static bool is_state_name(const char *name)
{
    static const char *const taken[] = {"lightmaps", "transport", "checkpoint", "manifest"};
    size_t i = 0;
    for (size_t k = 0; k < sizeof taken / sizeof *taken; k++)
        if (strcmp(name, taken[k]) == 0)
            return false;
    while (isalnum((unsigned char)name[i]) != 0 || name[i] == '-' || name[i] == '_')
        i++;
    return i > 0 && i < 64 && name[i] == '\0';
}

int kiln_job_states_read(struct kiln_job *job, struct kiln_error *error)
{
    const char *name;
    json_t *states = NULL, *changes;
    if (job->relighting.states == NULL)
        return KILN_OK;
    int status;
    KILN_TRY(kiln_job_yaml_read(job, job->relighting.states, &job->relighting.stated, error));
    if ((states = json_loads(job->relighting.stated, 0, NULL)) == NULL)
        KILN_TRY(kiln_fail(error, KILN_SYSTEM, "out of memory: the states"));
    if (json_object_size(states) == 0)
        KILN_TRY(kiln_fail(error, KILN_BAD_INPUT,
                           "%.500s: has no state, such as 'evening: {lights: {sun: {on: false}}}'",
                           job->relighting.states));
end:
    json_object_foreach(states, name, changes)
    {
        if (status == KILN_OK && !is_state_name(name))
            status = kiln_fail(error, KILN_BAD_INPUT,
                               "%.500s: '%.100s' is no name of a state, which a folder has: up to 63 letters, digits, "
                               "- and _, and not lightmaps, transport, checkpoint or manifest",
                               job->relighting.states, name);
        if (status == KILN_OK && !json_is_object(changes))
            status = kiln_fail(error, KILN_BAD_INPUT,
                               "%.500s: %.100s needs its changes, lights, materials and environment; {}: none",
                               job->relighting.states, name);
    }
    json_decref(states);
    return status;
}
