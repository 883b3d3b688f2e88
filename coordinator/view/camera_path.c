#include "coordinator/view/camera_path.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "coordinator/files/publish.h"
#include "worker/base/memory.h"

enum { FROM = 0, TO = 3, ANGLE = 6, TIME = 7, NUMBERS = 8, REQUIRED = 6, MOST_BYTES = 4 << 20 };

static const char *const names[NUMBERS] = {"from.x", "from.y", "from.z",        "to.x",
                                           "to.y",   "to.z",   "field-of-view", "time"};
static const double LEAST_ANGLE = 0.001, MOST_ANGLE = 179.0, MOST_PLACE = 1e15;

struct kiln_camera_path {
    size_t count, capacity;
    double (*keys)[NUMBERS];
    bool closed; /* the last key frame is the first again */
};

/* A file that is being read. */
struct table {
    const char *file;
    size_t line;
    int columns[NUMBERS]; /* which number each column holds */
    size_t column_count;
    bool has[NUMBERS];
    struct kiln_camera_path *path;
};

/* Takes blanks and quotes off both ends of a cell. */
static char *trim(char *cell)
{
    static const char outer[] = " \t\r\"";
    cell += strspn(cell, outer);
    for (size_t length = strlen(cell); length > 0 && strchr(outer, cell[length - 1]) != NULL; length--)
        cell[length - 1] = '\0';
    return cell;
}

/* Cuts the text at the next comma; returns the cell, or NULL after the last one. */
static char *next_cell(char **rest)
{
    char *cell = *rest;
    if (cell == NULL)
        return NULL;
    char *comma = strchr(cell, ',');
    *rest = comma == NULL ? NULL : comma + 1;
    if (comma != NULL)
        *comma = '\0';
    return trim(cell);
}

static int read_heading(struct table *t, char *line, struct kiln_error *error)
{
    for (char *cell; (cell = next_cell(&line)) != NULL; t->column_count++) {
        int number = 0;
        while (number < NUMBERS && strcmp(cell, names[number]) != 0)
            number++;
        if (number == NUMBERS)
            return kiln_fail(error, KILN_BAD_INPUT,
                             "%.500s:%zu: '%.100s' is no column of a camera path; it has: from.x, from.y, from.z, "
                             "to.x, to.y, to.z and, if wanted, field-of-view, time",
                             t->file, t->line, cell);
        if (t->has[number])
            return kiln_fail(error, KILN_BAD_INPUT, "%.500s:%zu: there are two columns '%s'", t->file, t->line, cell);
        t->has[number] = true;
        t->columns[t->column_count] = number;
    }
    for (int number = 0; number < REQUIRED; number++)
        if (!t->has[number])
            return kiln_fail(error, KILN_BAD_INPUT,
                             "%.500s:%zu: there is no column '%s'; the first line of a camera path names the columns",
                             t->file, t->line, names[number]);
    return KILN_OK;
}

static int read_number(const struct table *t, const char *cell, int number, double *value, struct kiln_error *error)
{
    const double least = number == ANGLE ? LEAST_ANGLE : -MOST_PLACE, most = number == ANGLE ? MOST_ANGLE : MOST_PLACE;
    char *end = NULL;
    *value = strtod(cell, &end);
    if (cell[0] == '\0' || cell[strspn(cell, "0123456789+-.eE")] != '\0' || *end != '\0')
        return kiln_fail(error, KILN_BAD_INPUT, "%.500s:%zu: %s is '%.100s', which is not a number", t->file, t->line,
                         names[number], cell);
    if (!(*value >= least && *value <= most))
        return kiln_fail(error, KILN_BAD_INPUT, "%.500s:%zu: %s is %.100s; it must be from %g to %g", t->file, t->line,
                         names[number], cell, least, most);
    return KILN_OK;
}

/* Checks a key frame that has been read. */
static int check_key(const struct table *t, const double key[NUMBERS], struct kiln_error *error)
{
    const size_t count = t->path->count;
    if (t->has[TIME] && count > 0 && !(key[TIME] > t->path->keys[count - 1][TIME]))
        return kiln_fail(error, KILN_BAD_INPUT, "%.500s:%zu: time is %g, not after %g of the key frame before", t->file,
                         t->line, key[TIME], t->path->keys[count - 1][TIME]);
    if (key[FROM] == key[TO] && key[FROM + 1] == key[TO + 1] && key[FROM + 2] == key[TO + 2])
        return kiln_fail(error, KILN_BAD_INPUT, "%.500s:%zu: the eye and its target are the same point", t->file,
                         t->line);
    return KILN_OK;
}

static int read_key(struct table *t, char *line, struct kiln_error *error)
{
    struct kiln_camera_path *path = t->path;
    double key[NUMBERS] = {[TIME] = (double)path->count};
    size_t column = 0;
    int status = KILN_OK;
    for (char *cell; (cell = next_cell(&line)) != NULL; column++)
        if (column < t->column_count)
            KILN_TRY(read_number(t, cell, t->columns[column], &key[t->columns[column]], error));
    if (column != t->column_count)
        KILN_TRY(kiln_fail(error, KILN_BAD_INPUT, "%.500s:%zu: this line has %zu values, and there are %zu columns",
                           t->file, t->line, column, t->column_count));
    KILN_TRY(check_key(t, key, error));
    KILN_TRY(kiln_grow(&path->keys, &path->capacity, path->count + 1, sizeof *path->keys, "key frames", error));
    memcpy(path->keys[path->count++], key, sizeof key);
end:
    return status;
}

static int read_lines(struct table *t, char *text, struct kiln_error *error)
{
    int status = KILN_OK;
    for (char *line = text, *after; line != NULL; line = after) {
        after = strchr(line, '\n');
        if (after != NULL)
            *after++ = '\0';
        t->line++;
        const char *first = line + strspn(line, " \t\r");
        if (*first == '\0' || *first == '#')
            continue;
        KILN_TRY(t->column_count == 0 ? read_heading(t, line, error) : read_key(t, line, error));
    }
    if (t->path->count < 2)
        KILN_TRY(kiln_fail(error, KILN_BAD_INPUT, "%.500s: it has %zu key frames; a camera path needs two or more",
                           t->file, t->path->count));
end:
    return status;
}

int kiln_camera_path_read(struct kiln_camera_path **path, const char *file, struct kiln_error *error)
{
    static const char mark[] = "\xef\xbb\xbf"; /* with which some spreadsheets begin */
    char *text = NULL;
    size_t size = 0;
    int status = kiln_allocate(path, 1, sizeof **path, "a camera path", error);
    if (status != KILN_OK)
        return status;
    struct table t = {.file = file, .path = *path};
    KILN_TRY(kiln_read_file(file, MOST_BYTES, &text, &size, error));
    if (strlen(text) != size)
        KILN_TRY(kiln_fail(error, KILN_BAD_INPUT, "%.500s: is not text", file));
    KILN_TRY(read_lines(&t, strncmp(text, mark, 3) == 0 ? text + 3 : text, error));
end:
    kiln_free(&text);
    if (status != KILN_OK) {
        kiln_camera_path_destroy(path);
        return status;
    }
    (*path)->closed =
        (*path)->count > 2 && memcmp((*path)->keys[0], (*path)->keys[(*path)->count - 1], TIME * sizeof(double)) == 0;
    return KILN_OK;
}

void kiln_camera_path_destroy(struct kiln_camera_path **path)
{
    if (*path == NULL)
        return;
    kiln_free(&(*path)->keys);
    kiln_free(path);
}

size_t kiln_camera_path_keys(const struct kiln_camera_path *path) { return path->count; }

/* Slope of a key frame's number, for interpolation. */
static double tangent(const struct kiln_camera_path *path, size_t key, int number)
{
    const double(*keys)[NUMBERS] = (const double(*)[NUMBERS])path->keys;
    const size_t last = path->count - 1;
    if (path->closed && (key == 0 || key == last)) {
        const double time = keys[1][TIME] - keys[0][TIME] + keys[last][TIME] - keys[last - 1][TIME];
        return (keys[1][number] - keys[last - 1][number]) / time;
    }
    const size_t before = key == 0 ? 0 : key - 1, after = key == last ? last : key + 1;
    return (keys[after][number] - keys[before][number]) / (keys[after][TIME] - keys[before][TIME]);
}

/* Interpolates a number at `u`, 0 to 1, in the interval after a key frame. */
static double between(const struct kiln_camera_path *path, size_t key, double u, int number)
{
    const double *a = path->keys[key], *b = path->keys[key + 1];
    if (u == 0.0 || u == 1.0)
        return u == 0.0 ? a[number] : b[number];
    const double span = b[TIME] - a[TIME], v = 1.0 - u;
    return (1.0 + 2.0 * u) * v * v * a[number] + u * v * v * span * tangent(path, key, number) +
           u * u * (3.0 - 2.0 * u) * b[number] - u * u * v * span * tangent(path, key + 1, number);
}

/* Index of the last key frame at or before `passed`, which counts from the first; the final key frame is excluded. */
static size_t interval_at(const struct kiln_camera_path *path, double passed)
{
    size_t low = 0, high = path->count - 1;
    while (high - low > 1) {
        const size_t middle = low + (high - low) / 2;
        if (path->keys[middle][TIME] - path->keys[0][TIME] <= passed)
            low = middle;
        else
            high = middle;
    }
    return low;
}

void kiln_camera_path_frame(const struct kiln_camera_path *path, size_t index, size_t count,
                            struct kiln_camera_frame *frame)
{
    const size_t last = path->count - 1;
    const double first = path->keys[0][TIME], whole = path->keys[last][TIME] - first,
                 passed = count > 1 ? whole * (double)index / (double)(count - 1) : 0.0;
    const size_t key = interval_at(path, passed);
    const double begin = path->keys[key][TIME] - first, span = path->keys[key + 1][TIME] - path->keys[key][TIME],
                 u = count > 1 && index == count - 1 ? 1.0 : fmin(fmax((passed - begin) / span, 0.0), 1.0);
    for (int axis = 0; axis < 3; axis++) {
        frame->from[axis] = between(path, key, u, FROM + axis);
        frame->to[axis] = between(path, key, u, TO + axis);
    }
    const double angle = between(path, key, u, ANGLE);
    frame->field_of_view = path->keys[0][ANGLE] > 0.0 ? fmin(fmax(angle, LEAST_ANGLE), MOST_ANGLE) : 0.0;
}
