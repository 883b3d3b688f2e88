/* Job file reader. A job file is one YAML mapping of option names to scalars, with settings of objects under `objects`
 * and a list of files under `parts`. It is read from libyaml's events, without a document tree whose size the file
 * could inflate: an alias, or a list or mapping in another place, ends the reading at once. */
#include <errno.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "coordinator/files/plain_file.h"
#include "coordinator/job/gone.h"
#include "coordinator/job/job_reader.h"
#include "coordinator/job/options.h"
#include "worker/base/memory.h"

static int load(struct kiln_job_reader *reader, struct kiln_error *error)
{
    struct stat status;
    int descriptor, result = kiln_open_plain(reader->path, &descriptor, error);
    if (result != KILN_OK)
        return result;
    if (fstat(descriptor, &status) != 0)
        result = kiln_fail_errno(error, KILN_IO, "cannot read job file %.500s", reader->path);
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
    if (result == KILN_OK && memchr(reader->text, '\0', reader->length) != NULL) /* which ends all text for libyaml */
        result = kiln_fail(error, KILN_BAD_INPUT, "%.500s: has a byte of value 0, which is no text; remove it",
                           reader->path);
    (void)close(descriptor);
    return result;
}

static bool is_text(enum kiln_option_kind kind)
{
    return kind == KILN_OPTION_STRING || kind == KILN_OPTION_PATH || kind == KILN_OPTION_ENVIRONMENT ||
           kind == KILN_OPTION_POINT || kind == KILN_OPTION_BOX || kind == KILN_OPTION_CHOICE ||
           kind == KILN_OPTION_CHOICE_ENUM || kind == KILN_OPTION_CHOICE_FLAG;
}

/* The nearest known key; NULL: none is near. */
static const char *nearest_key(const char *key)
{
    static const char *const others[] = {"scene", "parts"};
    const char *nearest = kiln_option_nearest(key, KILN_FOR_BAKE | KILN_FOR_PLAN);
    for (size_t i = 0; i < sizeof others / sizeof *others; i++)
        if (kiln_is_near(key, others[i]) &&
            (nearest == NULL || kiln_edit_distance(key, others[i]) < kiln_edit_distance(key, nearest)))
            nearest = others[i];
    return nearest;
}

static int unknown_key(const struct kiln_job_reader *reader, const char *key, size_t line, const char *what,
                       struct kiln_error *error)
{
    const char *nearest = nearest_key(key);
    const struct kiln_gone_option *gone = kiln_gone_option_find(key);
    if (gone != NULL)
        return kiln_fail(error, KILN_BAD_INPUT, "%.500s:%zu: %s is no more since kiln %s: %s", reader->path, line, key,
                         gone->since, gone->instead);
    if (nearest == NULL)
        return kiln_fail(error, KILN_BAD_INPUT, "%.500s:%zu: %s '%.200s'; kiln bake --help all lists them",
                         reader->path, line, what, key);
    return kiln_fail(error, KILN_BAD_INPUT, "%.500s:%zu: %s '%.200s'; the nearest one is '%s'", reader->path, line,
                     what, key, nearest);
}

/* Marks the key as seen; an error if it was seen before. */
static int take_key(struct kiln_job_reader *reader, const char *key, size_t index, size_t line,
                    struct kiln_error *error)
{
    if (reader->seen[index])
        return kiln_fail(error, KILN_BAD_INPUT, "%.500s:%zu: the key '%s' stands twice; remove one", reader->path, line,
                         key);
    reader->seen[index] = true;
    return KILN_OK;
}

/* Stores a key whose value is a mapping. */
static int store_rules(struct kiln_job_reader *reader, const yaml_event_t *key, const yaml_event_t *value,
                       struct kiln_error *error)
{
    const char *name = (const char *)key->data.scalar.value;
    const struct kiln_option *option = kiln_option_find(name);
    char *kept = NULL;
    if (value->type != YAML_MAPPING_START_EVENT)
        return kiln_fail(error, KILN_BAD_INPUT, "%.500s:%zu: %s has lines of its own, `PATTERN: {KEY: VALUE, ...}`",
                         reader->path, kiln_job_line(&value->start_mark), name);
    int status = take_key(reader, name, (size_t)(option - kiln_options), kiln_job_line(&key->start_mark), error);
    if (status == KILN_OK)
        status = kiln_job_rules_read(reader, &kept, error);
    if (status != KILN_OK || reader->only_quality)
        return status;
    ((struct kiln_job_owned *)reader->job->strings)->given[option - kiln_options] = true;
    memcpy((char *)reader->job + option->offset, &kept, sizeof kept);
    return KILN_OK;
}

/* Stores `parts`, whose value begins with `value`. */
static int store_parts(struct kiln_job_reader *reader, const yaml_event_t *key, const yaml_event_t *value,
                       struct kiln_error *error)
{
    const size_t line = kiln_job_line(&key->start_mark);
    if (value->type != YAML_SEQUENCE_START_EVENT)
        return kiln_fail(error, KILN_BAD_INPUT,
                         "%.500s:%zu: parts is a list, one part a line: `- {name: house, file: house.glb}`",
                         reader->path, line);
    const int status = take_key(reader, "parts", kiln_option_count + 1, line, error);
    return status == KILN_OK ? kiln_job_parts_list(reader, line, error) : status;
}

static int store(struct kiln_job_reader *reader, const char *key, size_t key_line, const yaml_event_t *value,
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
    const size_t line = kiln_job_line(&value->start_mark);
    if (plain && (text[0] == '\0' || strcmp(text, "~") == 0 || strcmp(text, "null") == 0))
        return kiln_fail(error, KILN_BAD_INPUT, "%.500s:%zu: the key '%s' has no value; give one or remove the line",
                         reader->path, line, key);
    if (reader->only_quality && strcmp(key, "quality") != 0)
        return KILN_OK;
    if (scene) {
        if (text[0] == '\0')
            return kiln_fail(error, KILN_BAD_INPUT, "%.500s:%zu: scene is empty; name a scene file", reader->path,
                             line);
        return kiln_job_keep_path(reader->job, text, reader->folder, &reader->job->scene.file, error);
    }
    const bool two = kiln_option_second(option) != NULL && strchr(text, ':') != NULL;
    if (!plain && !is_text(option->kind) && !two)
        return kiln_fail(error, KILN_BAD_INPUT, "%.500s:%zu: %s: \"%.100s\" is text; write it without quotation marks",
                         reader->path, line, key, text);
    char where[700];
    (void)snprintf(where, sizeof where, "%.500s:%zu: %s", reader->path, line, key);
    return kiln_job_give(reader->job, option, key, text, where, KILN_BAD_INPUT, reader->folder, error);
}

/* Reads one key and its value; sets *end at the end of the mapping. */
static int read_pair(struct kiln_job_reader *reader, bool *end, struct kiln_error *error)
{
    yaml_event_t key, value;
    int status = kiln_job_next(reader, &key, error);
    if (status != KILN_OK)
        return status;
    *end = key.type == YAML_MAPPING_END_EVENT;
    if (!*end && (status = kiln_job_expect_scalar(reader, &key, "a key", error)) == KILN_OK &&
        (status = kiln_job_next(reader, &value, error)) == KILN_OK) {
        const char *name = (const char *)key.data.scalar.value;
        const struct kiln_option *option = kiln_option_find(name);
        const bool rules = option != NULL && option->kind == KILN_OPTION_RULES, parts = strcmp(name, "parts") == 0,
                   known = option != NULL || parts || strcmp(name, "scene") == 0;
        status = !known  ? unknown_key(reader, name, kiln_job_line(&key.start_mark), "unknown key", error)
                 : rules ? store_rules(reader, &key, &value, error)
                 : parts ? store_parts(reader, &key, &value, error)
                         : kiln_job_expect_scalar(reader, &value, name, error);
        if (status == KILN_OK && !rules && !parts)
            status = store(reader, name, kiln_job_line(&key.start_mark), &value, error);
        yaml_event_delete(&value);
    }
    yaml_event_delete(&key);
    return status;
}

/* A job has one scene or parts of one. The job file stands for the scene of parts in messages and defaults. */
static int settle_scene(const struct kiln_job_reader *reader, struct kiln_error *error)
{
    struct kiln_job_scene *scene = &reader->job->scene;
    if (scene->part_count > 0 && scene->file != NULL)
        return kiln_fail(error, KILN_BAD_INPUT,
                         "%.500s: has scene and parts, and a job has one of them; list the scene as a part",
                         reader->path);
    if (scene->part_count > 0)
        return kiln_job_keep(reader->job, reader->path, strlen(reader->path), &scene->file, error);
    return scene->file != NULL
               ? KILN_OK
               : kiln_fail(error, KILN_BAD_INPUT,
                           "%.500s: the key 'scene' is missing; add `scene: FILE`, or `parts:` with a list of files",
                           reader->path);
}

static int read_events(struct kiln_job_reader *reader, struct kiln_error *error)
{
    if (yaml_parser_initialize(&reader->parser) == 0)
        return kiln_fail(error, KILN_SYSTEM, "out of memory while reading job file %.500s", reader->path);
    reader->parser_made = true;
    yaml_parser_set_input_string(&reader->parser, (const unsigned char *)reader->text, reader->length);
    static const char *const shape = "a job file is one mapping, lines of `name: value`";
    int status;
    KILN_TRY(kiln_job_expect(reader, YAML_STREAM_START_EVENT, shape, error));
    KILN_TRY(kiln_job_expect(reader, YAML_DOCUMENT_START_EVENT,
                             "the job file is empty; it needs at least `scene: FILE`, or `parts:`", error));
    KILN_TRY(kiln_job_expect(reader, YAML_MAPPING_START_EVENT, shape, error));
    for (bool end = false; !end;)
        KILN_TRY(read_pair(reader, &end, error));
    KILN_TRY(kiln_job_expect(reader, YAML_DOCUMENT_END_EVENT, shape, error));
    KILN_TRY(
        kiln_job_expect(reader, YAML_STREAM_END_EVENT, "a second document begins here; a job file has one", error));
    KILN_TRY(reader->only_quality ? KILN_OK : settle_scene(reader, error));
end:
    return status;
}

static int read_file(struct kiln_job *job, const char *path, bool only_quality, struct kiln_error *error)
{
    struct kiln_job_reader reader = {.job = job, .path = path, .only_quality = only_quality};
    const char *slash = strrchr(path, '/');
    const size_t length = slash == NULL ? 1 : slash == path ? 1 : (size_t)(slash - path);
    int status;
    KILN_TRY(kiln_job_keep(job, slash == NULL ? "." : path, length, &reader.folder, error));
    KILN_TRY(kiln_allocate(&reader.seen, kiln_option_count + 2, sizeof(bool), "the keys of the job file", error));
    KILN_TRY(load(&reader, error));
    KILN_TRY(read_events(&reader, error));
end:
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
