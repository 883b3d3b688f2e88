#include "coordinator/job/parts.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>
#include <unistd.h>

#include "coordinator/job/job_private.h"
#include "worker/base/affine.h"
#include "worker/base/memory.h"

static const double identity[12] = KILN_AFFINE_IDENTITY;
/* least ratio of a map's determinant to the cube of its largest number; largest number in a map */
static const double determinant_floor = 1e-9, number_most = 1e12;

/* ---- places ---- */

/* The place of a place in its file, for sentences. */
struct place {
    const char *where, *part;
    struct kiln_error *error;
};

static int wrong(const struct place *p, const char *what)
{
    return kiln_fail(p->error, KILN_BAD_INPUT, "%.500s: part '%.60s': at: %s", p->where, p->part, what);
}

static bool is_numbers(const json_t *json, size_t count)
{
    for (size_t i = 0; i < count; i++)
        if (!json_is_number(json_array_get(json, i)))
            return false;
    return json_array_size(json) == count;
}

static void take_numbers(const json_t *json, size_t count, double *values)
{
    for (size_t i = 0; i < count; i++)
        values[i] = json_number_value(json_array_get(json, i));
}

static bool is_matrix(const json_t *json)
{
    for (size_t r = 0; r < 4; r++)
        if (!is_numbers(json_array_get(json, r), 4))
            return false;
    return json_array_size(json) == 4;
}

static int take_matrix(const struct place *p, const json_t *json, double at[12])
{
    double last[4];
    take_numbers(json_array_get(json, 3), 4, last);
    for (size_t r = 0; r < 3; r++)
        take_numbers(json_array_get(json, r), 4, at + 4 * r);
    if (last[0] != 0.0 || last[1] != 0.0 || last[2] != 0.0 || last[3] != 1.0)
        return wrong(p, "the last row of a matrix is 0, 0, 0, 1: write it row by row, the translation as last column");
    return KILN_OK;
}

/* A turn about y, exact where it is a multiple of 90 degrees. */
static void turn_about_y(double degrees, double q[4])
{
    static const double halves[4][2] = {{0.0, 1.0}, {M_SQRT1_2, M_SQRT1_2}, {1.0, 0.0}, {M_SQRT1_2, -M_SQRT1_2}};
    const double whole = fmod(fmod(degrees, 360.0) + 360.0, 360.0), quarter = whole / 90.0;
    const bool exact = quarter == floor(quarter) && quarter < 4.0;
    q[0] = q[2] = 0.0;
    q[1] = exact ? halves[(int)quarter][0] : sin(whole * M_PI / 360.0);
    q[3] = exact ? halves[(int)quarter][1] : cos(whole * M_PI / 360.0);
}

/* Makes what rounding has left of 0 and 1 in the turn of a quarter exactly these. */
static void tidy(double m[12])
{
    for (int i = 0; i < 12; i++)
        if (i % 4 != 3 && fabs(m[i] - nearbyint(m[i])) < 1e-15)
            m[i] = nearbyint(m[i]) + 0.0;
}

static int read_turn(const struct place *p, const json_t *json, double q[4], bool *about_y)
{
    *about_y = json_is_number(json);
    if (*about_y) {
        turn_about_y(json_number_value(json), q);
        return KILN_OK;
    }
    if (!is_numbers(json, 4))
        return wrong(p, "rotation is a quaternion, [x, y, z, w], or a number, degrees about y");
    take_numbers(json, 4, q);
    return kiln_quaternion_unit(q) ? KILN_OK : wrong(p, "rotation is no unit quaternion: its four squares add up to 1");
}

static int read_mapping(const struct place *p, const json_t *json, double at[12])
{
    double t[3] = {0, 0, 0}, q[4] = {0, 0, 0, 1}, s[3] = {1, 1, 1}, turn[12];
    const double none[3] = {0, 0, 0}, one[3] = {1, 1, 1};
    bool about_y = false;
    const char *key;
    json_t *value;
    json_object_foreach((json_t *)(uintptr_t)json, key, value)
    {
        int status = KILN_OK;
        if (strcmp(key, "translation") == 0) {
            if (!is_numbers(value, 3))
                return wrong(p, "translation is three finite numbers, [x, y, z], in metres");
            take_numbers(value, 3, t);
        } else if (strcmp(key, "rotation") == 0) {
            status = read_turn(p, value, q, &about_y);
        } else if (strcmp(key, "scale") == 0) {
            if (json_is_number(value))
                s[0] = s[1] = s[2] = json_number_value(value);
            else if (is_numbers(value, 3))
                take_numbers(value, 3, s);
            else
                status = wrong(p, "scale is one finite factor, or three, [x, y, z]");
        } else {
            return kiln_fail(p->error, KILN_BAD_INPUT,
                             "%.500s: part '%.60s': at: there is no key '%.60s'; a place has translation, rotation and "
                             "scale, or is the four rows of a matrix",
                             p->where, p->part, key);
        }
        if (status != KILN_OK)
            return status;
    }
    kiln_affine_compose(none, q, one, turn);
    if (about_y)
        tidy(turn);
    for (int r = 0; r < 3; r++) {
        for (int c = 0; c < 3; c++)
            at[4 * r + c] = turn[4 * r + c] * s[c];
        at[4 * r + 3] = t[r];
    }
    return KILN_OK;
}

static int check_map(const struct place *p, const double at[12])
{
    const double size = kiln_affine_size(at);
    for (int i = 0; i < 12; i++)
        if (!(fabs(at[i]) <= number_most))
            return wrong(p, "a number is infinite, not a number or above 1e12; repair it");
    if (size == 0.0 || fabs(kiln_affine_determinant(at)) <= determinant_floor * size * size * size)
        return wrong(p, "is singular: it would press the part flat or to nothing; no factor of scale may be 0");
    return KILN_OK;
}

static int read_place(const struct place *p, const json_t *json, double at[12])
{
    int status = json_is_object(json) ? read_mapping(p, json, at)
                 : is_matrix(json)
                     ? take_matrix(p, json, at)
                     : wrong(p, "a place is a mapping of translation, rotation and scale, or the four rows of a matrix "
                                "of finite numbers");
    return status == KILN_OK ? check_map(p, at) : status;
}

static int read_places(struct kiln_job *job, const struct place *p, const json_t *json, struct kiln_part *part)
{
    const bool one = json == NULL || json_is_object(json) || is_matrix(json);
    void *room;
    if (!one && (!json_is_array(json) || json_array_size(json) == 0))
        return wrong(p, "names no place: give one or a list of them; without `at` the part stands as in its file");
    part->at_count = one ? 1 : json_array_size(json);
    int status = kiln_job_keep_room(job, part->at_count * sizeof *part->at, &room, p->error);
    part->at = room;
    if (status == KILN_OK && json == NULL)
        memcpy(part->at[0], identity, sizeof identity);
    for (size_t i = 0; status == KILN_OK && json != NULL && i < part->at_count; i++)
        status = read_place(p, one ? json : json_array_get(json, i), part->at[i]);
    return status;
}

/* ---- parts ---- */

static bool is_name(const char *name)
{
    const size_t length = strnlen(name, KILN_PART_NAME + 1);
    return length > 0 && length <= KILN_PART_NAME && strcasecmp(name, "back") != 0 &&
           strncasecmp(name, "groups-", 7) != 0 &&
           strspn(name, "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789_-") == length;
}

static bool ends_with(const char *path, const char *extension)
{
    const size_t length = strlen(path), end = strlen(extension);
    return length > end && strcasecmp(path + length - end, extension) == 0;
}

static int check_file(const char *where, const char *name, const char *file, struct kiln_error *error)
{
    if (ends_with(file, ".glb") || ends_with(file, ".gltf") || ends_with(file, ".obj"))
        return KILN_OK;
    return kiln_fail(error, KILN_BAD_INPUT, "%.500s: part '%.60s': %.300s %s", where, name, file,
                     kiln_is_yaml(file) ? "is a job, and a part is one file of a scene; list its parts here"
                     : ends_with(file, ".kscene")
                         ? "has its layouts already; name the .glb, .gltf or .obj file it is of"
                         : "is no file that a part can be: .glb, .gltf or .obj");
}

static int check_keys(const char *where, const json_t *json, struct kiln_error *error)
{
    const char *key;
    json_t *value;
    json_object_foreach((json_t *)(uintptr_t)json, key, value)
    {
        if (strcmp(key, "name") != 0 && strcmp(key, "file") != 0 && strcmp(key, "at") != 0)
            return kiln_fail(error, KILN_BAD_INPUT, "%.500s: a part has no key '%.60s'; it has name, file and at",
                             where, key);
    }
    return KILN_OK;
}

int kiln_part_read(struct kiln_job *job, const json_t *json, const char *where, const char *folder,
                   struct kiln_part *part, struct kiln_error *error)
{
    const char *name = json_string_value(json_object_get(json, "name")),
               *file = json_string_value(json_object_get(json, "file"));
    int status = KILN_OK;
    if (!json_is_object(json))
        return kiln_fail(error, KILN_BAD_INPUT, "%.500s: a part is a mapping, such as {name: house, file: house.glb}",
                         where);
    KILN_TRY(check_keys(where, json, error));
    if (name == NULL || !is_name(name))
        KILN_TRY(kiln_fail(error, KILN_BAD_INPUT,
                           "%.500s: %s%.60s%s; a part's name is 1 to %d letters, digits, - and _, and not back or "
                           "groups-...",
                           where, name == NULL ? "a part has no name" : "'", name == NULL ? "" : name,
                           name == NULL ? "" : "' is no name of a part", (int)KILN_PART_NAME));
    if (file == NULL || file[0] == '\0')
        KILN_TRY(kiln_fail(error, KILN_BAD_INPUT, "%.500s: part '%.60s' has no file; add `file: FILE`", where, name));
    KILN_TRY(check_file(where, name, file, error));
    KILN_TRY(kiln_job_keep_text(job, name, &part->name, error));
    KILN_TRY(kiln_job_keep_path(job, file, folder, &part->file, error));
    const struct place place = {where, part->name, error};
    KILN_TRY(read_places(job, &place, json_object_get(json, "at"), part));
end:
    return status;
}

static int compare_names(const void *a, const void *b)
{
    return strcasecmp(*(const char *const *)a, *(const char *const *)b);
}

static int check_names(const struct kiln_job_scene *scene, const char *where, struct kiln_error *error)
{
    const char **names = NULL;
    int status = kiln_allocate(&names, scene->part_count, sizeof *names, "the names of parts", error);
    for (size_t i = 0; status == KILN_OK && i < scene->part_count; i++)
        names[i] = scene->parts[i].name;
    if (status == KILN_OK)
        qsort(names, scene->part_count, sizeof *names, compare_names);
    for (size_t i = 1; status == KILN_OK && i < scene->part_count; i++)
        if (strcasecmp(names[i - 1], names[i]) == 0)
            status =
                kiln_fail(error, KILN_BAD_INPUT,
                          "%.500s: two parts are called '%.60s'; give one another name, or, to place a file often, "
                          "give one part a list as `at`",
                          where, names[i]);
    kiln_free(&names);
    return status;
}

int kiln_job_take_parts(struct kiln_job *job, const struct kiln_part *parts, size_t count, const char *where,
                        struct kiln_error *error)
{
    void *room;
    if (count == 0)
        return kiln_fail(error, KILN_BAD_INPUT, "%.500s: parts is empty; list one at least", where);
    int status = kiln_job_keep_room(job, count * sizeof *parts, &room, error);
    if (status != KILN_OK)
        return status;
    memcpy(room, parts, count * sizeof *parts);
    job->scene.parts = room;
    job->scene.part_count = count;
    return check_names(&job->scene, where, error);
}

int kiln_job_parts_read(struct kiln_job *job, const json_t *list, const char *where, struct kiln_error *error)
{
    const size_t count = json_array_size(list);
    struct kiln_part *parts = NULL;
    int status = kiln_allocate(&parts, count, sizeof *parts, "the parts of the scene", error);
    for (size_t i = 0; status == KILN_OK && i < count; i++)
        status = kiln_part_read(job, json_array_get(list, i), where, NULL, &parts[i], error);
    if (status == KILN_OK)
        status = kiln_job_take_parts(job, parts, count, where, error);
    kiln_free(&parts);
    return status;
}

static json_t *matrix_json(const double at[12])
{
    json_t *rows = json_array();
    for (int r = 0; r < 3; r++)
        (void)json_array_append_new(rows,
                                    json_pack("[f,f,f,f]", at[4 * r], at[4 * r + 1], at[4 * r + 2], at[4 * r + 3]));
    (void)json_array_append_new(rows, json_pack("[f,f,f,f]", 0.0, 0.0, 0.0, 1.0));
    return rows;
}

json_t *kiln_job_parts_json(const struct kiln_job *job)
{
    json_t *list = json_array();
    for (size_t i = 0; i < job->scene.part_count; i++) {
        const struct kiln_part *part = &job->scene.parts[i];
        json_t *at = json_array();
        char *path = realpath(part->file, NULL);
        for (size_t k = 0; k < part->at_count; k++)
            (void)json_array_append_new(at, matrix_json(part->at[k]));
        (void)json_array_append_new(
            list, json_pack("{s:s, s:s, s:o}", "name", part->name, "file", path != NULL ? path : part->file, "at", at));
        free(path);
    }
    return list;
}

int kiln_job_parts_check(const struct kiln_job *job, struct kiln_error *error)
{
    for (size_t i = 0; i < job->scene.part_count; i++) {
        const struct kiln_part *part = &job->scene.parts[i];
        struct stat status;
        if (stat(part->file, &status) != 0 || access(part->file, R_OK) != 0)
            return kiln_fail_errno(error, errno == ENOTDIR ? KILN_NO_INPUT : 0,
                                   "part '%s': cannot read its file %.500s", part->name, part->file);
        if (!S_ISREG(status.st_mode))
            return kiln_fail(error, KILN_BAD_INPUT,
                             "part '%s': %.500s is not a regular file; name the scene file in it", part->name,
                             part->file);
    }
    return KILN_OK;
}
