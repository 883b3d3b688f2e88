#include "coordinator/files/foreign_json.h"

#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include "coordinator/confined/confined.h"
#include "coordinator/confined/fence.h"
#include "coordinator/files/json_text.h"
#include "coordinator/files/publish.h"
#include "worker/base/memory.h"

/* The plain form: a letter, and what it needs. Numbers are those of this machine.
 *
 *     o, a    uint32: members of an object, each a text and a value, or of an array, each a value
 *     s       uint32: bytes of a text, and these
 *     i, r    int64; double
 *     t, f, n nothing */
enum { LETTER = 1, COUNT = 4, NUMBER = 8 };

/* Upper bound for the plain form of a text of `size` bytes. The worst case is a value of one byte and a comma, which
 * become nine bytes. */
static size_t plain_most(size_t size) { return 4096 + 6 * size; }

/* ---- what the child writes ---- */

struct writer {
    char *bytes;
    size_t size, room;
    int status;
    struct kiln_error *error;
};

static void put(struct writer *w, const void *data, size_t bytes)
{
    if (w->status == KILN_OK)
        w->status = kiln_grow(&w->bytes, &w->room, w->size + bytes, 1, "the values of a text", w->error);
    if (w->status == KILN_OK && bytes > 0)
        memcpy(w->bytes + w->size, data, bytes);
    w->size += bytes;
}

static void put_head(struct writer *w, char letter, size_t count)
{
    const uint32_t number = (uint32_t)count;
    put(w, &letter, LETTER);
    put(w, &number, COUNT);
}

static void put_text(struct writer *w, const char *text, size_t length)
{
    put_head(w, 's', length);
    put(w, text, length);
}

static void put_number(struct writer *w, char letter, const void *number)
{
    put(w, &letter, LETTER);
    put(w, number, NUMBER);
}

static void put_value(struct writer *w, json_t *value)
{
    const char *key;
    json_t *member;
    size_t i;
    const json_int_t integer = json_integer_value(value);
    const double real = json_real_value(value);
    switch (json_typeof(value)) {
    case JSON_OBJECT:
        put_head(w, 'o', json_object_size(value));
        json_object_foreach(value, key, member)
        {
            put_text(w, key, strlen(key));
            put_value(w, member);
        }
        break;
    case JSON_ARRAY:
        put_head(w, 'a', json_array_size(value));
        json_array_foreach(value, i, member) put_value(w, member);
        break;
    case JSON_STRING:
        put_text(w, json_string_value(value), json_string_length(value));
        break;
    case JSON_INTEGER:
        put_number(w, 'i', &integer);
        break;
    case JSON_REAL:
        put_number(w, 'r', &real);
        break;
    default:
        put(w, json_is_true(value) ? "t" : json_is_false(value) ? "f" : "n", LETTER);
        break;
    }
}

/* Limits of memory and time: a value takes about a hundred bytes, and at least two bytes of text. */
static void confine(size_t size)
{
    const uint64_t values = size / 2 < KILN_JSON_VALUES_MOST ? size / 2 : KILN_JSON_VALUES_MOST;
    kiln_fence_begin();
    kiln_fence_limit(RLIMIT_FSIZE, plain_most(size));
    kiln_fence_calls();
    kiln_fence_limits(((uint64_t)64 << 20) + 256 * values + 8 * (uint64_t)size, 4 + size / 1000000);
}

static int parse_json(const char *path, const char *text, size_t size, json_t **json, struct kiln_error *error)
{
    *json = kiln_json_text(text, size, path, error);
    return *json != NULL ? KILN_OK : KILN_BAD_INPUT;
}

int kiln_foreign_json_child(int argc, char **argv,
                            int (*parse)(const char *path, const char *text, size_t size, json_t **json,
                                         struct kiln_error *error))
{
    struct stat input, output;
    struct kiln_error error = {""};
    struct writer w = {.error = &error};
    json_t *json = NULL;
    char *text = NULL;
    size_t size = 0;
    if (argc != 3 || fstat(STDIN_FILENO, &input) != 0 || !S_ISREG(input.st_mode) ||
        fstat(KILN_CHILD_OUTPUT, &output) != 0 || !S_ISREG(output.st_mode)) {
        (void)fprintf(stderr, "%s is an internal command of kiln\n", argv[1]);
        return KILN_USAGE;
    }
    confine((size_t)input.st_size);
    int status;
    KILN_TRY(kiln_read_open(STDIN_FILENO, argv[2], (size_t)input.st_size, &text, &size, &error));
    KILN_TRY((parse != NULL ? parse : parse_json)(argv[2], text, size, &json, &error));
    put_value(&w, json);
    KILN_TRY(w.status);
    KILN_TRY(kiln_write_all(KILN_CHILD_OUTPUT, w.bytes, w.size, 0, "the values of a text", &error));
end:
    json_decref(json);
    kiln_free(&w.bytes);
    kiln_free(&text);
    (void)printf("%d\n%s", status, status == KILN_OK ? "" : error.message);
    return fflush(stdout) == 0 ? status : KILN_IO;
}

/* ---- what this process reads ---- */

struct reader {
    const char *at;
    size_t left, values; /* bytes that are left; most values that may still follow */
    bool bad;
};

static const char *get(struct reader *r, size_t bytes)
{
    const char *at = r->at;
    r->bad = r->bad || bytes > r->left;
    if (r->bad)
        return NULL;
    r->at += bytes;
    r->left -= bytes;
    return at;
}

static uint32_t get_count(struct reader *r)
{
    uint32_t count = 0;
    const char *at = get(r, COUNT);
    if (at != NULL)
        memcpy(&count, at, COUNT);
    return count;
}

static json_t *get_value(struct reader *r, int depth);

/* The members of an object or an array; NULL, and the reader is bad: they are not sound, or memory is short. */
static json_t *get_members(struct reader *r, bool named, int depth)
{
    json_t *into = named ? json_object() : json_array();
    const uint32_t count = get_count(r);
    for (uint32_t i = 0; i < count && !r->bad; i++) {
        const char *letter = named ? get(r, LETTER) : NULL;
        const size_t length = named ? get_count(r) : 0;
        const char *key = named ? get(r, length) : NULL;
        r->bad = r->bad || (named && (*letter != 's' || memchr(key, '\0', length) != NULL));
        json_t *value = get_value(r, depth + 1);
        const int failed = value == NULL ? -1
                           : named       ? json_object_setn_new(into, key, length, value)
                                         : json_array_append_new(into, value);
        r->bad = r->bad || failed != 0;
    }
    if (!r->bad && into != NULL)
        return into;
    r->bad = true;
    json_decref(into);
    return NULL;
}

static json_t *get_number(struct reader *r, bool real)
{
    json_int_t integer = 0;
    double number = 0.0;
    const char *at = get(r, NUMBER);
    if (at == NULL)
        return NULL;
    memcpy(real ? (void *)&number : (void *)&integer, at, NUMBER);
    return real ? json_real(number) : json_integer(integer);
}

static json_t *get_text(struct reader *r)
{
    const size_t length = get_count(r);
    const char *text = get(r, length);
    return text == NULL || memchr(text, '\0', length) != NULL ? NULL : json_stringn(text, length);
}

static json_t *get_value(struct reader *r, int depth)
{
    const char *letter = get(r, LETTER);
    r->bad = r->bad || depth > KILN_JSON_DEPTH_MOST || r->values == 0;
    if (r->bad)
        return NULL;
    r->values--;
    switch (*letter) {
    case 'o':
    case 'a':
        return get_members(r, *letter == 'o', depth);
    case 's':
        return get_text(r);
    case 'i':
    case 'r':
        return get_number(r, *letter == 'r');
    case 't':
    case 'f':
        return json_boolean(*letter == 't');
    default:
        return *letter == 'n' ? json_null() : NULL;
    }
}

/* The values in the file that the child has written. */
static int take(json_t **json, int answer, size_t size, const char *path, struct kiln_error *error)
{
    char *bytes = NULL;
    size_t length = 0;
    int status = kiln_read_open(answer, path, plain_most(size), &bytes, &length, error);
    if (status != KILN_OK)
        return status;
    struct reader r = {bytes, length, KILN_JSON_VALUES_MOST, false};
    *json = get_value(&r, 0);
    if (*json != NULL && r.left != 0) {
        json_decref(*json);
        *json = NULL;
    }
    kiln_free(&bytes);
    return *json != NULL ? KILN_OK
                         : kiln_fail(error, KILN_BAD_INPUT,
                                     "'%s': its values were not taken over: it is damaged, or memory is short", path);
}

/* A file in memory. */
static int make_memory(int *descriptor, const char *text, size_t size, struct kiln_error *error)
{
    *descriptor = memfd_create("kiln text", MFD_CLOEXEC);
    if (*descriptor < 0)
        return kiln_fail_errno(error, KILN_SYSTEM, "a file in memory cannot be made");
    return size == 0 ? KILN_OK : kiln_write_all(*descriptor, text, size, 0, "memory for a text", error);
}

int kiln_foreign_json(json_t **json, const char *child, const char *text, size_t size, const char *path,
                      struct kiln_error *error)
{
    const char *const arguments[] = {"kiln", child, path, NULL};
    int input = -1, answer = -1;
    *json = NULL;
    int status;
    KILN_TRY(make_memory(&input, text, size, error));
    KILN_TRY(make_memory(&answer, NULL, 0, error));
    const struct kiln_confined_call call = {.arguments = arguments,
                                            .input = input,
                                            .output = answer,
                                            .subject = path,
                                            .what = "the reader of texts",
                                            .crashed = "it is damaged or somebody made it so",
                                            .costly = "it is damaged, or longer than it has to be",
                                            .seconds = 30.0 + (double)size / 100000.0};
    KILN_TRY(kiln_confined_run(&call, error));
    KILN_TRY(take(json, answer, size, path, error));
end:
    if (input >= 0)
        (void)close(input);
    if (answer >= 0)
        (void)close(answer);
    return status;
}
