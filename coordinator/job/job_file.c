/* Job file reader. A job file is one YAML mapping of option names to scalars, with settings of objects under `objects`.
 * It is read from libyaml's events, without a document tree whose size the file could inflate: an alias, a list, or a
 * mapping in another place ends the reading at once. */
#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#include <yaml.h>

#include "coordinator/job/job_private.h"
#include "coordinator/job/options.h"
#include "coordinator/job/object_settings.h"
#include "worker/base/calls.h"
#include "worker/base/memory.h"

struct reader {
    struct kiln_job *job;
    const char *path;
    int refusal;  /* status of errors in the text; 0: KILN_BAD_INPUT */
    char *folder; /* folder of the job file; "." for the current one */
    char *text;   /* the whole file */
    size_t length;
    bool only_quality;
    bool *seen; /* kiln_option_count + 1 flags, the last for `scene` */
    yaml_parser_t parser;
    bool parser_made;
};

static size_t line_of(const yaml_mark_t *mark) { return mark->line + 1; }

static int load(struct reader *reader, struct kiln_error *error)
{
    const int descriptor = kiln_open(reader->path, O_RDONLY | O_CLOEXEC | O_NONBLOCK, 0);
    if (descriptor < 0)
        return kiln_fail_errno(error, 0, "cannot open job file %.500s", reader->path);
    struct stat status;
    int result = KILN_OK;
    if (fstat(descriptor, &status) != 0)
        result = kiln_fail_errno(error, KILN_IO, "cannot read job file %.500s", reader->path);
    else if (!S_ISREG(status.st_mode))
        result = kiln_fail(error, KILN_BAD_INPUT, "%.500s: is not a file, so not a job file", reader->path);
    else if (status.st_size > KILN_JOB_FILE_LIMIT)
        result = kiln_fail(error, KILN_BAD_INPUT, "%.500s: %lld bytes are too many for a job file (at most %d)",
                           reader->path, (long long)status.st_size, KILN_JOB_FILE_LIMIT);
    else
        result = kiln_allocate(&reader->text, KILN_JOB_FILE_LIMIT + 1, 1, "the job file", error);
    while (result == KILN_OK && reader->length <= KILN_JOB_FILE_LIMIT) {
        const ssize_t got = read(descriptor, reader->text + reader->length, KILN_JOB_FILE_LIMIT + 1 - reader->length);
        if (got == 0)
            break;
        if (got < 0 && errno != EINTR)
            result = kiln_fail_errno(error, KILN_IO, "cannot read job file %.500s", reader->path);
        else if (got > 0)
            reader->length += (size_t)got;
    }
    if (result == KILN_OK && reader->length > KILN_JOB_FILE_LIMIT)
        result = kiln_fail(error, KILN_BAD_INPUT, "%.500s: is longer than a job file may be (%d bytes)", reader->path,
                           KILN_JOB_FILE_LIMIT);
    (void)close(descriptor);
    return result;
}

static int next(struct reader *reader, yaml_event_t *event, struct kiln_error *error)
{
    if (yaml_parser_parse(&reader->parser, event) != 0)
        return KILN_OK;
    const yaml_parser_t *parser = &reader->parser;
    if (parser->error == YAML_MEMORY_ERROR)
        return kiln_fail(error, KILN_SYSTEM, "out of memory while reading job file %.500s", reader->path);
    if (parser->error == YAML_READER_ERROR) {
        size_t line = 1; /* line of the byte that is not text */
        for (size_t i = 0; i < parser->problem_offset && i < reader->length; i++)
            line += reader->text[i] == '\n';
        return kiln_fail(error, KILN_BAD_INPUT, "%.500s:%zu: is not text in UTF-8: %s", reader->path, line,
                         parser->problem != NULL ? parser->problem : "unreadable");
    }
    return kiln_fail(error, KILN_BAD_INPUT, "%.500s:%zu: is not YAML: %s%s%s", reader->path,
                     line_of(&parser->problem_mark), parser->problem != NULL ? parser->problem : "cannot be read",
                     parser->context != NULL ? " " : "", parser->context != NULL ? parser->context : "");
}

/* Checks that the event is a scalar without a NUL character. */
static int expect_scalar(const struct reader *reader, const yaml_event_t *event, const char *what,
                         struct kiln_error *error)
{
    const size_t line = line_of(&event->start_mark);
    switch (event->type) {
    case YAML_SCALAR_EVENT:
        break;
    case YAML_ALIAS_EVENT:
        return kiln_fail(error, KILN_BAD_INPUT, "%.500s:%zu: %.100s is an alias (*); write the value itself",
                         reader->path, line, what);
    case YAML_SEQUENCE_START_EVENT:
        return kiln_fail(error, KILN_BAD_INPUT, "%.500s:%zu: %.100s is a list; it must be a single value", reader->path,
                         line, what);
    default:
        return kiln_fail(error, KILN_BAD_INPUT, "%.500s:%zu: %.100s is a mapping; it must be a single value",
                         reader->path, line, what);
    }
    if (strlen((const char *)event->data.scalar.value) != event->data.scalar.length)
        return kiln_fail(error, KILN_BAD_INPUT, "%.500s:%zu: %.100s has a NUL character in it", reader->path, line,
                         what);
    return KILN_OK;
}

static bool is_text(enum kiln_option_kind kind)
{
    return kind == KILN_OPTION_STRING || kind == KILN_OPTION_PATH || kind == KILN_OPTION_ENVIRONMENT ||
           kind == KILN_OPTION_POINT || kind == KILN_OPTION_CHOICE || kind == KILN_OPTION_CHOICE_ENUM ||
           kind == KILN_OPTION_CHOICE_FLAG;
}

/* The nearest known key; NULL: none is near. */
static const char *nearest_key(const char *key)
{
    const char *nearest = kiln_option_nearest(key, KILN_FOR_BAKE | KILN_FOR_PLAN);
    if (!kiln_is_near(key, "scene"))
        return nearest;
    return nearest == NULL || kiln_edit_distance(key, "scene") < kiln_edit_distance(key, nearest) ? "scene" : nearest;
}

static int unknown_key(const struct reader *reader, const char *key, size_t line, const char *what,
                       struct kiln_error *error)
{
    const char *nearest = nearest_key(key);
    if (nearest == NULL)
        return kiln_fail(error, KILN_BAD_INPUT, "%.500s:%zu: %s '%.200s'; kiln bake --help lists all", reader->path,
                         line, what, key);
    return kiln_fail(error, KILN_BAD_INPUT, "%.500s:%zu: %s '%.200s'; the nearest one is '%s'", reader->path, line,
                     what, key, nearest);
}

/* ---- settings of single objects ---- */

static int refuse(const struct reader *reader) { return reader->refusal != 0 ? reader->refusal : KILN_BAD_INPUT; }

/* A scalar as JSON: true, false and numbers keep their type unless they are quoted; everything else is a string. */
static json_t *scalar_json(const yaml_event_t *event)
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
static int read_setting(struct reader *reader, const char *pattern, json_t *rule, bool *end, struct kiln_error *error)
{
    yaml_event_t key, value;
    struct kiln_object_settings unused = {0};
    char where[800];
    bool known = false;
    int status = next(reader, &key, error);
    if (status != KILN_OK)
        return status;
    *end = key.type == YAML_MAPPING_END_EVENT;
    if (!*end && (status = expect_scalar(reader, &key, "a setting", error)) == KILN_OK &&
        (status = next(reader, &value, error)) == KILN_OK) {
        const char *name = (const char *)key.data.scalar.value;
        json_t *json = NULL;
        status = expect_scalar(reader, &value, name, error);
        (void)snprintf(where, sizeof where, "%.500s:%zu: objects '%.200s'", reader->path, line_of(&key.start_mark),
                       pattern);
        if (status == KILN_OK && json_object_get(rule, name) != NULL)
            status = kiln_fail(error, refuse(reader), "%s: '%.100s' stands twice; remove one", where, name);
        if (status == KILN_OK)
            status = kiln_object_settings_read(&unused, name, json = scalar_json(&value), where, refuse(reader), &known,
                                               error);
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
static int read_rule(struct reader *reader, json_t *rules, bool *end, struct kiln_error *error)
{
    yaml_event_t key, value;
    int status = next(reader, &key, error);
    if (status != KILN_OK)
        return status;
    *end = key.type == YAML_MAPPING_END_EVENT;
    if (!*end && (status = expect_scalar(reader, &key, "a name or pattern", error)) == KILN_OK &&
        (status = next(reader, &value, error)) == KILN_OK) {
        const char *pattern = (const char *)key.data.scalar.value;
        const size_t line = line_of(&key.start_mark);
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

/* Reads the rules of `objects:`, after the start of their mapping, and stores them in *kept as JSON. */
static int read_rules(struct reader *reader, char **kept, struct kiln_error *error)
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

/* ---- keys ---- */

/* Marks the key as seen; an error if it was seen before. */
static int take_key(struct reader *reader, const char *key, size_t index, size_t line, struct kiln_error *error)
{
    if (reader->seen[index])
        return kiln_fail(error, KILN_BAD_INPUT, "%.500s:%zu: the key '%s' stands twice; remove one", reader->path, line,
                         key);
    reader->seen[index] = true;
    return KILN_OK;
}

/* Stores a key whose value is a mapping. */
static int store_rules(struct reader *reader, const yaml_event_t *key, const yaml_event_t *value,
                       struct kiln_error *error)
{
    const char *name = (const char *)key->data.scalar.value;
    const struct kiln_option *option = kiln_option_find(name);
    char *kept = NULL;
    if (value->type != YAML_MAPPING_START_EVENT)
        return kiln_fail(error, KILN_BAD_INPUT, "%.500s:%zu: %s has lines of its own, `PATTERN: {KEY: VALUE, ...}`",
                         reader->path, line_of(&value->start_mark), name);
    int status = take_key(reader, name, (size_t)(option - kiln_options), line_of(&key->start_mark), error);
    if (status == KILN_OK)
        status = read_rules(reader, &kept, error);
    if (status != KILN_OK || reader->only_quality)
        return status;
    ((struct kiln_job_owned *)reader->job->strings)->given[option - kiln_options] = true;
    memcpy((char *)reader->job + option->offset, &kept, sizeof kept);
    return KILN_OK;
}

static int store(struct reader *reader, const char *key, size_t key_line, const yaml_event_t *value,
                 struct kiln_error *error)
{
    const struct kiln_option *option = kiln_option_find(key);
    const bool scene = strcmp(key, "scene") == 0;
    const char *text = (const char *)value->data.scalar.value;
    const bool plain = value->data.scalar.style == YAML_PLAIN_SCALAR_STYLE;
    if (!scene && (option == NULL || (option->commands & (KILN_FOR_BAKE | KILN_FOR_PLAN)) == 0))
        return unknown_key(reader, key, key_line, option == NULL ? "unknown key" : "a job file has no key", error);
    const int taken =
        take_key(reader, key, scene ? kiln_option_count : (size_t)(option - kiln_options), key_line, error);
    if (taken != KILN_OK)
        return taken;
    const size_t line = line_of(&value->start_mark);
    if (plain && (text[0] == '\0' || strcmp(text, "~") == 0 || strcmp(text, "null") == 0))
        return kiln_fail(error, KILN_BAD_INPUT, "%.500s:%zu: the key '%s' has no value; give one or remove the line",
                         reader->path, line, key);
    if (reader->only_quality && strcmp(key, "quality") != 0)
        return KILN_OK;
    if (scene) {
        if (text[0] == '\0')
            return kiln_fail(error, KILN_BAD_INPUT, "%.500s:%zu: scene is empty; name a scene file", reader->path,
                             line);
        return kiln_job_keep_path(reader->job, text, reader->folder, &reader->job->scene, error);
    }
    if (!plain && !is_text(option->kind))
        return kiln_fail(error, KILN_BAD_INPUT, "%.500s:%zu: %s: \"%.100s\" is text; write it without quotation marks",
                         reader->path, line, key, text);
    char where[700];
    (void)snprintf(where, sizeof where, "%.500s:%zu: %s", reader->path, line, key);
    struct kiln_job_owned *own = reader->job->strings;
    own->given[option - kiln_options] = true;
    if (strcmp(key, option->name) != 0)
        own->renamed[option - kiln_options] = true;
    return kiln_option_set(reader->job, option, text, where, KILN_BAD_INPUT, reader->folder, error);
}

/* Reads one key and its value; sets *end at the end of the mapping. */
static int read_pair(struct reader *reader, bool *end, struct kiln_error *error)
{
    yaml_event_t key, value;
    int status = next(reader, &key, error);
    if (status != KILN_OK)
        return status;
    *end = key.type == YAML_MAPPING_END_EVENT;
    if (!*end && (status = expect_scalar(reader, &key, "a key", error)) == KILN_OK &&
        (status = next(reader, &value, error)) == KILN_OK) {
        const struct kiln_option *option = kiln_option_find((const char *)key.data.scalar.value);
        const bool rules = option != NULL && option->kind == KILN_OPTION_RULES;
        status = rules ? store_rules(reader, &key, &value, error)
                       : expect_scalar(reader, &value, (const char *)key.data.scalar.value, error);
        if (status == KILN_OK && !rules)
            status = store(reader, (const char *)key.data.scalar.value, line_of(&key.start_mark), &value, error);
        yaml_event_delete(&value);
    }
    yaml_event_delete(&key);
    return status;
}

/* Takes the next event, which must be of the type given; `complaint` says what is wrong otherwise. */
static int expect(struct reader *reader, yaml_event_type_t type, const char *complaint, struct kiln_error *error)
{
    yaml_event_t event;
    int status = next(reader, &event, error);
    if (status != KILN_OK)
        return status;
    if (event.type != type)
        status =
            kiln_fail(error, KILN_BAD_INPUT, "%.500s:%zu: %s", reader->path, line_of(&event.start_mark), complaint);
    yaml_event_delete(&event);
    return status;
}

static int read_events(struct reader *reader, struct kiln_error *error)
{
    if (yaml_parser_initialize(&reader->parser) == 0)
        return kiln_fail(error, KILN_SYSTEM, "out of memory while reading job file %.500s", reader->path);
    reader->parser_made = true;
    yaml_parser_set_input_string(&reader->parser, (const unsigned char *)reader->text, reader->length);
    static const char *const shape = "a job file is one mapping, lines of `name: value`";
    int status = expect(reader, YAML_STREAM_START_EVENT, shape, error);
    if (status == KILN_OK)
        status =
            expect(reader, YAML_DOCUMENT_START_EVENT, "the job file is empty; it needs at least `scene: FILE`", error);
    if (status == KILN_OK)
        status = expect(reader, YAML_MAPPING_START_EVENT, shape, error);
    for (bool end = false; status == KILN_OK && !end;)
        status = read_pair(reader, &end, error);
    if (status == KILN_OK)
        status = expect(reader, YAML_DOCUMENT_END_EVENT, shape, error);
    if (status == KILN_OK)
        status = expect(reader, YAML_STREAM_END_EVENT, "a second document begins here; a job file has one", error);
    if (status == KILN_OK && !reader->only_quality && reader->job->scene == NULL)
        status =
            kiln_fail(error, KILN_BAD_INPUT, "%.500s: the key 'scene' is missing; add `scene: FILE`", reader->path);
    return status;
}

int kiln_job_rules_parse(const char *text, const char *where, int refusal, struct kiln_job *job, char **kept,
                         struct kiln_error *error)
{
    static const char *const shape = "settings of objects are written as {PATTERN: {KEY: VALUE, ...}, ...}";
    struct reader reader = {.job = job, .path = where, .refusal = refusal};
    if (yaml_parser_initialize(&reader.parser) == 0)
        return kiln_fail(error, KILN_SYSTEM, "out of memory for the settings of objects");
    yaml_parser_set_input_string(&reader.parser, (const unsigned char *)text, strlen(text));
    int status = expect(&reader, YAML_STREAM_START_EVENT, shape, error);
    if (status == KILN_OK)
        status = expect(&reader, YAML_DOCUMENT_START_EVENT, shape, error);
    if (status == KILN_OK)
        status = expect(&reader, YAML_MAPPING_START_EVENT, shape, error);
    if (status == KILN_OK)
        status = read_rules(&reader, kept, error);
    if (status == KILN_OK)
        status = expect(&reader, YAML_DOCUMENT_END_EVENT, shape, error);
    yaml_parser_delete(&reader.parser);
    return status == KILN_BAD_INPUT ? refusal : status;
}

static int read_file(struct kiln_job *job, const char *path, bool only_quality, struct kiln_error *error)
{
    struct reader reader = {.job = job, .path = path, .only_quality = only_quality};
    const char *slash = strrchr(path, '/');
    const size_t length = slash == NULL ? 1 : slash == path ? 1 : (size_t)(slash - path);
    int status = kiln_job_keep(job, slash == NULL ? "." : path, length, &reader.folder, error);
    if (status == KILN_OK)
        status = kiln_allocate(&reader.seen, kiln_option_count + 1, sizeof(bool), "the keys of the job file", error);
    if (status == KILN_OK)
        status = load(&reader, error);
    if (status == KILN_OK)
        status = read_events(&reader, error);
    if (reader.parser_made)
        yaml_parser_delete(&reader.parser);
    kiln_free(&reader.seen);
    kiln_free(&reader.text);
    return status;
}

int kiln_job_file_read(struct kiln_job *job, const char *path, struct kiln_error *error)
{
    return read_file(job, path, false, error);
}

int kiln_job_file_read_quality(struct kiln_job *job, const char *path, struct kiln_error *error)
{
    return read_file(job, path, true, error);
}
