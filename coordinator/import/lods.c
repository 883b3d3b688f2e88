#include "coordinator/import/lods.h"

#include <ctype.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include <xxhash.h>

#include "worker/base/arena.h"
#include "worker/base/memory.h"

static const double SIZES_MOST = 2.0, CENTRES_MOST = 0.25;
enum { LEVEL_DIGITS = 2, NAMED = 8 };

/* ---- names ---- */

static bool is_separator(char c) { return c == '_' || c == '-' || c == '.' || c == ' '; }

/* Returns the length of a name without a suffix that makes copies unique: ".001", "_12", " (3)". A plain number is no
 * level. */
static size_t without_copy(const char *name, size_t length)
{
    size_t end = length, digits;
    if (end > 0 && name[end - 1] == ')')
        end--;
    for (digits = 0; end > digits && isdigit((unsigned char)name[end - digits - 1]); digits++)
        ;
    size_t begin = end - digits;
    if (digits == 0 || begin == 0)
        return length;
    if (name[begin - 1] == '(')
        begin--;
    return begin > 0 && is_separator(name[begin - 1]) ? begin - 1 : length;
}

/* Whether a name ends in a level: "LOD" and a number. */
static bool ends_in_level(const char *name, size_t length, uint32_t *level, size_t *rest)
{
    size_t digits = 0;
    while (digits < length && isdigit((unsigned char)name[length - digits - 1]))
        digits++;
    size_t at = length - digits;
    if (digits == 0 || digits > LEVEL_DIGITS)
        return false;
    const uint32_t found = (uint32_t)strtoul(name + at, NULL, 10);
    if (at > 0 && is_separator(name[at - 1]))
        at--;
    if (at < 3 || strncasecmp(name + at - 3, "lod", 3) != 0)
        return false;
    at -= 3;
    /* "ball_LOD1" and "ballLOD1", but no "melod1" */
    if (at > 0 && isalpha((unsigned char)name[at - 1]) && name[at] == 'l')
        return false;
    *level = found;
    *rest = at > 0 && is_separator(name[at - 1]) ? at - 1 : at;
    return true;
}

static bool begins_with_level(const char *name, uint32_t *level, const char **begin)
{
    if (strncasecmp(name, "lod", 3) != 0)
        return false;
    const char *number = name + 3 + (is_separator(name[3]) ? 1 : 0);
    size_t digits = 0;
    while (isdigit((unsigned char)number[digits]))
        digits++;
    if (digits == 0 || digits > LEVEL_DIGITS || !is_separator(number[digits]))
        return false;
    *level = (uint32_t)strtoul(number, NULL, 10);
    *begin = number + digits + 1;
    return true;
}

bool kiln_lod_of_name(const char *name, uint32_t *level, const char **begin, size_t *length)
{
    const size_t whole = strlen(name), shorter = without_copy(name, whole);
    *begin = name;
    if (ends_in_level(name, whole, level, length) || ends_in_level(name, shorter, level, length))
        return true;
    const bool begins = begins_with_level(name, level, begin);
    *length = begins ? without_copy(*begin, strlen(*begin)) : shorter;
    return begins;
}

/* ---- members ---- */

/* An object, or several objects, that form one level of detail of one thing. */
struct member {
    double low[3], high[3]; /* world, m */
    uint64_t thing;         /* hash of the name without the level; equal for members of the same thing */
    uint32_t level;         /* 0: the finest, or nothing is known */
    uint32_t number;        /* number in struct kiln_object_settings; 0 for a single object */
    uint32_t group;
    bool by_extras, lower;
};

struct finder {
    struct kiln_builder *builder;
    struct member *members; /* one per object, or one for all objects with the same number */
    uint32_t *member_of;    /* per object */
    size_t count;
    uint32_t *by_thing, *by_place; /* members, sorted */
    struct kiln_arena arena;
};

static const char *string(const struct kiln_builder *builder, uint32_t offset)
{
    return KILN_BUILDER_DATA(builder, const char, KILN_SECTION_STRINGS) + offset;
}

static const struct kiln_object *objects(const struct kiln_builder *builder)
{
    return KILN_BUILDER_DATA(builder, const struct kiln_object, KILN_SECTION_OBJECTS);
}

const char *kiln_lod_name(const char *found, const char *node, const char *mesh)
{
    const char *begin;
    uint32_t level;
    size_t length;
    if (found != NULL)
        return found;
    return node[0] == '\0' ||
                   (!kiln_lod_of_name(node, &level, &begin, &length) && kiln_lod_of_name(mesh, &level, &begin, &length))
               ? mesh
               : node;
}

static const char *name_of(const struct kiln_builder *builder, size_t object)
{
    const struct kiln_object *o = &objects(builder)[object];
    const uint32_t found = builder->object_settings[object].lod_name;
    return kiln_lod_name(
        found != 0 ? string(builder, found) : NULL, string(builder, o->original_name),
        string(builder, KILN_BUILDER_DATA(builder, const struct kiln_mesh, KILN_SECTION_MESHES)[o->mesh].name));
}

static struct member member_of(const struct kiln_builder *builder, size_t object)
{
    const struct kiln_object_settings *settings = &builder->object_settings[object];
    const char *name = name_of(builder, object), *begin;
    struct member m = {.low = {INFINITY, INFINITY, INFINITY}, .high = {-INFINITY, -INFINITY, -INFINITY}};
    size_t length;
    (void)kiln_lod_of_name(name, &m.level, &begin, &length);
    m.thing = XXH3_64bits(begin, length);
    m.number = settings->lod_member;
    m.group = settings->lod_group;
    m.by_extras = settings->lod_level != 0 && settings->lod_group == 0;
    if (settings->lod_level != 0)
        m.level = settings->lod_level - 1;
    return m;
}

/* Whether any object has a lower level. Most scenes have none, and nothing more is done. */
static bool has_lower(const struct kiln_builder *builder)
{
    for (size_t i = 0; i < builder->sections[KILN_SECTION_OBJECTS].count; i++)
        if (builder->object_settings[i].exclude == KILN_EXCLUDE_UNSET && member_of(builder, i).level > 0)
            return true;
    return false;
}

static void enclose(struct member *m, const struct kiln_builder *builder, const struct kiln_object *object)
{
    const struct kiln_mesh *mesh =
        &KILN_BUILDER_DATA(builder, const struct kiln_mesh, KILN_SECTION_MESHES)[object->mesh];
    const struct kiln_vec3 *points = KILN_BUILDER_DATA(builder, const struct kiln_vec3, KILN_SECTION_POSITIONS);
    for (uint64_t i = 0; i < mesh->vertex_count; i++) {
        const struct kiln_vec3 v = points[mesh->vertex_first + i];
        for (int k = 0; k < 3; k++) {
            const double *t = object->transform + 4 * k,
                         x = t[0] * (double)v.x + t[1] * (double)v.y + t[2] * (double)v.z + t[3];
            m->low[k] = fmin(m->low[k], x);
            m->high[k] = fmax(m->high[k], x);
        }
    }
}

struct numbered {
    uint32_t number, object;
};

static int compare_numbered(const void *a, const void *b)
{
    const struct numbered *p = a, *q = b;
    if (p->number != q->number)
        return p->number > q->number ? 1 : -1;
    return (p->object > q->object) - (p->object < q->object);
}

/* Forms the members: objects with the same number form one; each other object is one. Excluded objects are left out. */
static int find_members(struct finder *f, struct kiln_error *error)
{
    const size_t count = f->builder->sections[KILN_SECTION_OBJECTS].count;
    struct numbered *sorted = NULL;
    const int status = kiln_allocate(&sorted, count, sizeof *sorted, "levels of detail", error);
    if (status != KILN_OK)
        return status;
    for (size_t i = 0; i < count; i++)
        sorted[i] = (struct numbered){f->builder->object_settings[i].lod_member, (uint32_t)i};
    qsort(sorted, count, sizeof *sorted, compare_numbered);
    for (size_t i = 0; i < count; i++) {
        const uint32_t object = sorted[i].object;
        f->member_of[object] = KILN_NONE;
        if (f->builder->object_settings[object].exclude == KILN_EXCLUDE_YES)
            continue;
        if (f->count == 0 || sorted[i].number == 0 || f->members[f->count - 1].number != sorted[i].number)
            f->members[f->count++] = member_of(f->builder, object);
        f->member_of[object] = (uint32_t)(f->count - 1);
        enclose(&f->members[f->count - 1], f->builder, &objects(f->builder)[object]);
    }
    kiln_free(&sorted);
    return KILN_OK;
}

/* ---- choice of the levels that are left out ---- */

static double diagonal(const struct member *m)
{
    const double d[3] = {m->high[0] - m->low[0], m->high[1] - m->low[1], m->high[2] - m->low[2]};
    return sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
}

static double middle(const struct member *m, int axis) { return 0.5 * (m->low[axis] + m->high[axis]); }

static bool at_one_place(const struct member *a, const struct member *b)
{
    const double da = diagonal(a), db = diagonal(b), longer = fmax(da, db);
    double apart = 0.0;
    for (int k = 0; k < 3; k++)
        apart += (middle(a, k) - middle(b, k)) * (middle(a, k) - middle(b, k));
    return longer <= SIZES_MOST * fmin(da, db) && sqrt(apart) <= CENTRES_MOST * longer;
}

static int compare_places(const struct member *a, const struct member *b)
{
    return (middle(a, 0) > middle(b, 0)) - (middle(a, 0) < middle(b, 0));
}

static int compare_by_place(const void *a, const void *b, void *members)
{
    const uint32_t p = *(const uint32_t *)a, q = *(const uint32_t *)b;
    const struct member *all = members;
    const int places = compare_places(&all[p], &all[q]);
    return places != 0 ? places : (p > q) - (p < q);
}

static int compare_by_thing(const void *a, const void *b, void *members)
{
    const struct member *all = members, *p = &all[*(const uint32_t *)a], *q = &all[*(const uint32_t *)b];
    return p->thing != q->thing ? (p->thing > q->thing ? 1 : -1) : compare_by_place(a, b, members);
}

/* Finds the first entry of `sorted` that is not before x. `things`: entries are sorted by thing, and the search is for
 * this one's; else they are sorted by place only. */
static size_t first_from(const struct finder *f, const uint32_t *sorted, bool things, uint64_t thing, double x)
{
    size_t low = 0, high = f->count;
    while (low < high) {
        const size_t at = low + (high - low) / 2;
        const struct member *m = &f->members[sorted[at]];
        const bool before = things && m->thing != thing ? m->thing < thing : middle(m, 0) < x;
        if (before)
            low = at + 1;
        else
            high = at;
    }
    return low;
}

/* Whether a finer level exists at the member's place: one of the same thing or, if extras state the level, of any. */
static bool has_finer(const struct finder *f, const struct member *m)
{
    const bool things = !m->by_extras;
    const uint32_t *sorted = things ? f->by_thing : f->by_place;
    const double reach = SIZES_MOST * CENTRES_MOST * diagonal(m), x = middle(m, 0);
    for (size_t i = first_from(f, sorted, things, m->thing, x - reach); i < f->count; i++) {
        const struct member *other = &f->members[sorted[i]];
        if ((things && other->thing != m->thing) || middle(other, 0) > x + reach)
            return false;
        if (other->level < m->level && at_one_place(m, other))
            return true;
    }
    return false;
}

static int sort_members(struct finder *f, struct kiln_error *error)
{
    int status;
    KILN_TRY(kiln_arena_allocate(&f->arena, &f->by_thing, f->count, sizeof *f->by_thing, "levels of detail", error));
    KILN_TRY(kiln_arena_allocate(&f->arena, &f->by_place, f->count, sizeof *f->by_place, "levels of detail", error));
    for (uint32_t i = 0; i < f->count; i++)
        f->by_thing[i] = f->by_place[i] = i;
    qsort_r(f->by_thing, f->count, sizeof *f->by_thing, compare_by_thing, f->members);
    qsort_r(f->by_place, f->count, sizeof *f->by_place, compare_by_place, f->members);
end:
    return status;
}

/* The finest level of each group that MSFT_lod makes. The caller frees *finest. */
static int find_finest(const struct finder *f, uint32_t **finest, struct kiln_error *error)
{
    uint32_t most = 0;
    for (size_t i = 0; i < f->count; i++)
        most = f->members[i].group > most ? f->members[i].group : most;
    const int status = kiln_allocate(finest, (size_t)most + 1, sizeof **finest, "levels of detail", error);
    for (uint32_t g = 0; g <= most && status == KILN_OK; g++)
        (*finest)[g] = UINT32_MAX;
    for (size_t i = 0; i < f->count && status == KILN_OK; i++) {
        uint32_t *own = &(*finest)[f->members[i].group];
        *own = f->members[i].level < *own ? f->members[i].level : *own;
    }
    return status;
}

static int find_lower(struct finder *f, struct kiln_error *error)
{
    uint32_t *finest = NULL;
    int status;
    KILN_TRY(sort_members(f, error));
    KILN_TRY(find_finest(f, &finest, error));
    for (size_t i = 0; i < f->count; i++) {
        struct member *m = &f->members[i];
        m->lower = m->level > 0 && ((m->group != 0 && finest[m->group] < m->level) || has_finer(f, m));
    }
end:
    kiln_free(&finest);
    return status;
}

/* Adds a note with the names of the first few objects. */
static int note_lower(struct kiln_builder *builder, const size_t *first, size_t count, struct kiln_error *error)
{
    char names[NAMED * 72] = "", more[40] = "";
    size_t used = 0;
    for (size_t i = 0; i < count && i < NAMED; i++) {
        const struct kiln_object *o = &objects(builder)[first[i]];
        const char *original = string(builder, o->original_name);
        used += (size_t)snprintf(names + used, sizeof names - used, "%s\"%.60s\"", i == 0 ? "" : ", ",
                                 original[0] != '\0' ? original : string(builder, o->name));
    }
    if (count > NAMED)
        (void)snprintf(more, sizeof more, " and %zu more", count - NAMED);
    return kiln_builder_note(
        builder, KILN_NOTE_WARNING, error,
        "%s%s: lower levels of detail of what stands there already; %zu object%s left out, since light "
        "between levels is nonsense: for theirs bake them without the finer ones, such as with "
        "--objects '{\"*LOD0\": {exclude: true}}'; {exclude: false} keeps one",
        names, more, count, count == 1 ? " is" : "s are");
}

static int leave_out(struct finder *f, size_t *left_out, struct kiln_error *error)
{
    size_t first[NAMED], count = 0;
    for (size_t i = 0; i < f->builder->sections[KILN_SECTION_OBJECTS].count; i++) {
        struct kiln_object_settings *settings = &f->builder->object_settings[i];
        if (f->member_of[i] == KILN_NONE || !f->members[f->member_of[i]].lower ||
            settings->exclude != KILN_EXCLUDE_UNSET)
            continue;
        settings->exclude = KILN_EXCLUDE_YES;
        if (count < NAMED)
            first[count] = i;
        count++;
    }
    *left_out = count;
    return count > 0 ? note_lower(f->builder, first, count, error) : KILN_OK;
}

int kiln_lods_leave_out(struct kiln_builder *builder, size_t *count, struct kiln_error *error)
{
    const size_t all = builder->sections[KILN_SECTION_OBJECTS].count;
    struct finder f = {.builder = builder};
    *count = 0;
    if (!has_lower(builder))
        return KILN_OK;
    int status;
    KILN_TRY(kiln_arena_allocate(&f.arena, &f.members, all, sizeof *f.members, "levels of detail", error));
    KILN_TRY(kiln_arena_allocate(&f.arena, &f.member_of, all, sizeof *f.member_of, "levels of detail", error));
    KILN_TRY(find_members(&f, error));
    KILN_TRY(find_lower(&f, error));
    KILN_TRY(leave_out(&f, count, error));
end:
    kiln_arena_release(&f.arena);
    return status;
}
