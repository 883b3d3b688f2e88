#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <xxhash.h>

#include "coordinator/import/parts_private.h"
#include "worker/base/affine.h"
#include "worker/base/arena.h"
#include "worker/base/memory.h"

enum { NAMED_MOST = 8 }; /* parts that are named one by one */
/* ratio of a part's size to the median of all from which on its unit is in doubt */
static const double size_ratio = 400.0;

/* ---- environment and unit ---- */

static int note_others(struct kiln_merger *m, size_t first, size_t others, size_t other)
{
    char more[40] = "";
    if (others > 1)
        (void)snprintf(more, sizeof more, " and %zu other parts", others - 1);
    return kiln_builder_note(m->builder, KILN_NOTE_REPEATED, m->error,
                             "the environment of part '%s' lights the scene; that of part '%s'%s is left out: "
                             "--environment decides for all",
                             m->parts[first].name, m->parts[other].name, more);
}

static int take_environment(struct kiln_merger *m, bool asked)
{
    struct kiln_environment none = {0};
    size_t first = SIZE_MAX, other = 0, others = 0;
    for (size_t i = 0; i < m->count; i++) {
        if (m->parts[i].scene->environment->kind == KILN_ENVIRONMENT_NONE)
            continue;
        if (first == SIZE_MAX) {
            first = i;
            continue;
        }
        other = others++ == 0 ? i : other;
    }
    const struct kiln_scene *scene = first == SIZE_MAX ? NULL : m->parts[first].scene;
    int status = kiln_builder_append(m->builder, KILN_SECTION_ENVIRONMENT, scene == NULL ? &none : scene->environment,
                                     1, NULL, m->error);
    if (status == KILN_OK && scene != NULL)
        status =
            kiln_builder_append(m->builder, KILN_SECTION_ENVIRONMENT_TEXELS, scene->environment_texels,
                                (size_t)scene->header->sections[KILN_SECTION_ENVIRONMENT_TEXELS].count, NULL, m->error);
    return status == KILN_OK && others > 0 && !asked ? note_others(m, first, others, other) : status;
}

static int take_units(struct kiln_merger *m)
{
    const struct kiln_open_part *first = NULL, *other = NULL;
    for (size_t i = 0; i < m->count; i++) {
        const uint32_t units = m->parts[i].scene->header->units;
        if (units == KILN_SCENE_UNITS_UNKNOWN)
            continue;
        if (first == NULL)
            first = &m->parts[i];
        else if (other == NULL && units != first->scene->header->units)
            other = &m->parts[i];
    }
    m->builder->units = first == NULL ? (uint32_t)KILN_SCENE_UNITS_UNKNOWN : first->scene->header->units;
    return other == NULL ? KILN_OK
                         : kiln_builder_note(m->builder, KILN_NOTE_REPEATED, m->error,
                                             "the lights of part '%s' have another unit than those of part '%s', which "
                                             "is taken for all: beside one another they are 683 times too bright or "
                                             "too dark; export both with the same lighting mode",
                                             other->name, first->name);
}

/* ---- sizes ---- */

/* The longest side of a part in its first place, m. */
static double size_of(const struct kiln_open_part *part)
{
    const struct kiln_scene_header *h = part->scene->header;
    double longest = 0.0, at[12];
    for (int k = 0; k < 3; k++)
        longest = fmax(longest, h->bounds_max[k] - h->bounds_min[k]);
    for (size_t i = 0; i < 12; i++)
        at[i] = json_number_value(json_array_get(json_array_get(part->places, 0), i));
    return longest * cbrt(fabs(kiln_affine_determinant(at)));
}

static int compare_doubles(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static int note_size(struct kiln_merger *m, size_t i, double size, double median)
{
    return kiln_builder_note(m->builder, KILN_NOTE_WARNING, m->error,
                             "part '%s' is %.3g m long where it stands, and half of the parts are at most %.3g m: if "
                             "its file has another unit, give its place a scale, or OBJ files --unit",
                             m->parts[i].name, size, median);
}

/* Notes parts whose sizes let suppose another unit of length. */
static int check_sizes(struct kiln_merger *m)
{
    double *sizes = NULL, *sorted = NULL;
    size_t count = 0, noted = 0;
    int status;
    KILN_TRY(kiln_allocate(&sizes, m->count, sizeof *sizes, "the sizes of parts", m->error));
    KILN_TRY(kiln_allocate(&sorted, m->count, sizeof *sorted, "the sizes of parts", m->error));
    for (size_t i = 0; i < m->count; i++) {
        sizes[i] = size_of(&m->parts[i]);
        if (sizes[i] > 0.0)
            sorted[count++] = sizes[i];
    }
    if (count < 2)
        goto end;
    qsort(sorted, count, sizeof *sorted, compare_doubles);
    const double median = sorted[(count - 1) / 2];
    for (size_t i = 0; i < m->count; i++)
        if (sizes[i] > 0.0 && (sizes[i] >= size_ratio * median || size_ratio * sizes[i] <= median) &&
            noted++ < NAMED_MOST)
            KILN_TRY(note_size(m, i, sizes[i], median));
    if (noted > NAMED_MOST)
        KILN_TRY(kiln_builder_note(m->builder, KILN_NOTE_WARNING, m->error,
                                   "%zu more parts are hundreds of times larger or smaller than the others",
                                   noted - NAMED_MOST));
end:
    kiln_free(&sorted);
    kiln_free(&sizes);
    return status;
}

/* ---- notes of the parts ---- */

struct part_note {
    uint64_t hash; /* of severity and text */
    size_t order, part;
    uint32_t severity, text; /* text: in the part's strings */
    size_t others;           /* parts after this one with the same note; SIZE_MAX: an earlier part has it */
};

static int compare_hashes(const void *a, const void *b)
{
    const struct part_note *x = a, *y = b;
    return x->hash != y->hash ? (x->hash > y->hash) - (x->hash < y->hash)
                              : (x->order > y->order) - (x->order < y->order);
}

static int compare_orders(const void *a, const void *b)
{
    const struct part_note *x = a, *y = b;
    return (x->order > y->order) - (x->order < y->order);
}

static size_t collect_notes(const struct kiln_merger *m, struct part_note *notes)
{
    size_t count = 0;
    for (size_t i = 0; i < m->count; i++) {
        const struct kiln_scene *scene = m->parts[i].scene;
        for (size_t k = 0; k < scene->note_count; k++, count++) {
            const char *text = kiln_scene_string(scene, scene->notes[k].text);
            notes[count] =
                (struct part_note){.hash = XXH3_64bits_withSeed(text, strlen(text), scene->notes[k].severity),
                                   .order = count,
                                   .part = i,
                                   .severity = scene->notes[k].severity,
                                   .text = scene->notes[k].text};
        }
    }
    return count;
}

/* Counts equal notes at the first of them. */
static void join_notes(struct part_note *notes, size_t count)
{
    qsort(notes, count, sizeof *notes, compare_hashes);
    for (size_t i = 0, first = 0, part = 0; i < count; i++) {
        first = notes[i].hash == notes[first].hash ? first : i;
        if (i != first) {
            notes[first].others += notes[i].part != part;
            notes[i].others = SIZE_MAX;
        }
        part = notes[i].part;
    }
    qsort(notes, count, sizeof *notes, compare_orders);
}

static int add_notes(struct kiln_merger *m)
{
    struct part_note *notes = NULL;
    size_t count = 0;
    for (size_t i = 0; i < m->count; i++)
        count += m->parts[i].scene->note_count;
    int status;
    KILN_TRY(kiln_allocate(&notes, count, sizeof *notes, "the notes of parts", m->error));
    join_notes(notes, collect_notes(m, notes));
    for (size_t i = 0; i < count; i++) {
        const struct kiln_open_part *part = &m->parts[notes[i].part];
        char more[48] = "";
        if (notes[i].others == SIZE_MAX)
            continue;
        if (notes[i].others > 0)
            (void)snprintf(more, sizeof more, " and %zu other part%s", notes[i].others,
                           notes[i].others == 1 ? "" : "s");
        KILN_TRY(kiln_builder_note(m->builder, notes[i].severity, m->error, "part '%s'%s: %s", part->name, more,
                                   kiln_scene_string(part->scene, notes[i].text)));
    }
end:
    kiln_free(&notes);
    return status;
}

int kiln_parts_settle(struct kiln_merger *m, bool asked)
{
    int status;
    KILN_TRY(take_environment(m, asked));
    KILN_TRY(take_units(m));
    KILN_TRY(add_notes(m));
    KILN_TRY(check_sizes(m));
end:
    return status;
}
