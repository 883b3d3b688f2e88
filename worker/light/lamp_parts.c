#include "worker/light/lamp_parts.h"

#include <stdlib.h>
#include <string.h>

#include "shaders/shared/area_light.h"
#include "worker/base/memory.h"
#include "worker/light/lamp_textures.h"

enum { ROUGH = 48, CELLS = 128 }; /* texture cells along a part: to decide about cuts; to find its emission */

/* Largest variance of a sample, over the squared light, with which a triangle's parts are even enough; for light that
 * arrives equally from all parts. */
static const double UNEVEN = 0.5;

struct part {
    uint32_t triangle, path, depth, turn;
    uint32_t whole;  /* index of its triangle among the triangles that are cut */
    double at[3][2]; /* corners, in the triangle; the edge from [1] to [2] is cut next */
    double area;     /* m2 */
    double radiance[3];
    double power, excess; /* luminance x area; (area x integral of its square - power²) / power */
};

struct whole {
    double power;
    uint32_t parts;
};

struct cutting {
    struct kiln_lights *lights;
    struct part *parts, *next;
    struct whole *wholes;
    uint8_t *chosen;
    size_t count, capacity, whole_count;
};

static void measure(const struct kiln_lights *lights, uint32_t cells, struct part *p)
{
    double square;
    kiln_lamp_mean(lights->textures, p->triangle, (const double(*)[2])p->at, 3, cells, p->radiance, &square);
    const float rgb[3] = {(float)p->radiance[0], (float)p->radiance[1], (float)p->radiance[2]};
    const double mean = kiln_luminance_of_floats(rgb);
    p->power = mean * p->area;
    p->excess = mean > 0.0 ? fmax(0.0, p->area * (square / mean - mean)) : 0.0;
}

/* Makes child 0 or 1 of a part: shaders/shared/area_light.h. */
static struct part child_of(const struct part *p, uint32_t child)
{
    struct part c = *p;
    const double *v0 = p->at[0], *v1 = p->at[1], *v2 = p->at[2];
    for (int k = 0; k < 2; k++) {
        c.at[0][k] = 0.5 * (v1[k] + v2[k]);
        c.at[1][k] = child == 0 ? v0[k] : v2[k];
        c.at[2][k] = child == 0 ? v1[k] : v0[k];
    }
    c.path |= child << (31 - p->depth);
    c.depth++;
    c.area *= 0.5;
    return c;
}

static struct part whole_of(const struct kiln_area_light *light, uint32_t number)
{
    static const double corner[3][2] = {{0.0, 0.0}, {1.0, 0.0}, {0.0, 1.0}};
    const struct kiln_dvec3 e3 = dvec3_sub(light->e2, light->e1);
    const double across[3] = {dvec3_dot(e3, e3), dvec3_dot(light->e2, light->e2), dvec3_dot(light->e1, light->e1)};
    struct part p = {.triangle = light->triangle, .whole = number, .area = light->area};
    p.turn = across[0] >= across[1] && across[0] >= across[2] ? 0 : across[1] >= across[2] ? 1 : 2;
    for (uint32_t k = 0; k < 3; k++)
        memcpy(p.at[k], corner[(p.turn + k) % 3], sizeof p.at[k]);
    return p;
}

/* ---- rounds ---- */

struct want {
    double excess;
    size_t part;
};

static int by_excess(const void *a, const void *b)
{
    const struct want *x = a, *y = b;
    return x->excess > y->excess ? -1 : x->excess < y->excess ? 1 : x->part < y->part ? -1 : x->part > y->part;
}

/* Marks the parts to cut in this round, at most `room`. *count: their number. */
static int choose(struct cutting *c, size_t room, size_t *count, struct kiln_error *error)
{
    struct want *wants = NULL;
    int status = kiln_allocate_bare(&wants, c->count, sizeof *wants, "the parts of lamps", error);
    *count = 0;
    if (status != KILN_OK)
        return status;
    for (size_t i = 0; i < c->count; i++) {
        const struct part *p = &c->parts[i];
        const struct whole *w = &c->wholes[p->whole];
        c->chosen[i] = 0;
        if (p->depth < KILN_SUBTRIANGLE_DEPTH && p->excess * w->parts > UNEVEN * w->power)
            wants[(*count)++] = (struct want){p->excess, i};
    }
    if (*count > room)
        qsort(wants, *count, sizeof *wants, by_excess);
    *count = *count < room ? *count : room;
    for (size_t i = 0; i < *count; i++)
        c->chosen[wants[i].part] = 1;
    kiln_free(&wants);
    return KILN_OK;
}

static int reserve(struct cutting *c, size_t count, struct kiln_error *error)
{
    const size_t before = c->capacity;
    if (count <= before)
        return KILN_OK;
    struct part *parts = NULL, *next = NULL;
    uint8_t *chosen = NULL;
    const size_t capacity = 2 * count;
    int status;
    KILN_TRY(kiln_allocate_bare(&parts, capacity, sizeof *parts, "the parts of lamps", error));
    KILN_TRY(kiln_allocate_bare(&next, capacity, sizeof *next, "the parts of lamps", error));
    KILN_TRY(kiln_allocate_bare(&chosen, capacity, sizeof *chosen, "the parts of lamps", error));
end:
    if (status != KILN_OK) {
        kiln_free(&parts);
        kiln_free(&next);
        kiln_free(&chosen);
        return status;
    }
    if (before > 0) {
        memcpy(parts, c->parts, c->count * sizeof *parts);
        memcpy(chosen, c->chosen, c->count);
    }
    kiln_free(&c->parts);
    kiln_free(&c->next);
    kiln_free(&c->chosen);
    c->parts = parts, c->next = next, c->chosen = chosen, c->capacity = capacity;
    return KILN_OK;
}

/* Cuts the marked parts, and removes dark halves. */
static void cut(struct cutting *c)
{
    size_t count = 0;
    for (size_t i = 0; i < c->count; i++) {
        c->next[count++] = c->chosen[i] ? child_of(&c->parts[i], 0) : c->parts[i];
        if (c->chosen[i])
            c->next[count++] = child_of(&c->parts[i], 1);
    }
    uint8_t *fresh = c->chosen; /* flags of parts in `next`, where each cut part has become two */
    for (size_t i = count, j = c->count; j-- > 0;) {
        const uint8_t chosen = c->chosen[j];
        fresh[--i] = chosen;
        if (chosen)
            fresh[--i] = chosen;
    }
#pragma omp parallel for schedule(dynamic, 4)
    for (size_t i = 0; i < count; i++)
        if (fresh[i])
            measure(c->lights, ROUGH, &c->next[i]);
    c->count = 0;
    for (size_t i = 0; i < c->whole_count; i++)
        c->wholes[i].parts = 0;
    for (size_t i = 0; i < count; i++)
        if (c->next[i].power > 0.0) {
            c->parts[c->count++] = c->next[i];
            c->wholes[c->next[i].whole].parts++;
        }
}

static void leave_out_dark(struct cutting *c)
{
    size_t bright = 0;
    for (size_t i = 0; i < c->count; i++)
        if (c->parts[i].power > 0.0)
            c->parts[bright++] = c->parts[i];
    c->count = bright;
}

static int cut_all(struct cutting *c, struct kiln_error *error)
{
    const size_t most = c->count + KILN_LAMP_PARTS;
    int status = KILN_OK;
    for (size_t chosen = 1; chosen > 0;) {
        KILN_TRY(choose(c, most - c->count, &chosen, error));
        KILN_TRY(reserve(c, c->count + chosen, error));
        if (chosen > 0)
            cut(c);
    }
#pragma omp parallel for schedule(dynamic, 16)
    for (size_t i = 0; i < c->count; i++)
        measure(c->lights, CELLS, &c->parts[i]);
    leave_out_dark(c);
end:
    return status;
}

/* ---- lights ---- */

static void make_light(const struct kiln_area_light *whole, const struct part *p, struct kiln_area_light *light)
{
    *light = *whole;
    struct kiln_dvec3 corner[3];
    for (int k = 0; k < 3; k++) {
        corner[k] =
            dvec3_add(whole->p0, dvec3_add(dvec3_scale(whole->e1, p->at[k][0]), dvec3_scale(whole->e2, p->at[k][1])));
        for (int i = 0; i < 2; i++)
            light->at[k][i] = (float)p->at[k][i];
    }
    light->turn = p->turn;
    light->path = p->path;
    light->depth = p->depth;
    light->area = p->area;
    for (int i = 0; i < 3; i++)
        light->radiance[i] = (float)p->radiance[i];
    if (p->depth == 0) /* not cut: keeps the triangle's own order */
        memcpy(light->at, whole->at, sizeof light->at);
    else
        light->p0 = corner[0], light->e1 = dvec3_sub(corner[1], corner[0]), light->e2 = dvec3_sub(corner[2], corner[0]);
}

/* Makes the list of all lights anew, in the order of their triangles. */
static int put_together(struct cutting *c, struct kiln_error *error)
{
    struct kiln_lights *l = c->lights;
    struct kiln_area_light *areas = NULL;
    size_t count = 0, next = 0;
    int status = kiln_allocate_bare(&areas, l->area_count + c->count, sizeof *areas, "the emissive triangles", error);
    if (status != KILN_OK)
        return status;
    for (size_t i = 0; i < l->area_count; i++) {
        const size_t before = count;
        if (!l->areas[i].textured)
            areas[count++] = l->areas[i];
        for (; next < c->count && c->parts[next].triangle == l->areas[i].triangle; next++)
            make_light(&l->areas[i], &c->parts[next], &areas[count++]);
        l->triangle_count += count > before;
        l->textured_count += count > before && l->areas[i].textured;
    }
    kiln_free(&l->areas);
    l->areas = areas;
    l->area_count = count;
    return KILN_OK;
}

static void begin(struct cutting *c)
{
    for (size_t i = 0; i < c->lights->area_count; i++)
        if (c->lights->areas[i].textured) {
            c->parts[c->count] = whole_of(&c->lights->areas[i], (uint32_t)c->count);
            c->count++;
        }
    c->whole_count = c->count;
#pragma omp parallel for schedule(dynamic, 16)
    for (size_t i = 0; i < c->count; i++) {
        measure(c->lights, ROUGH, &c->parts[i]);
        c->wholes[i] = (struct whole){c->parts[i].power, 1};
    }
    leave_out_dark(c);
}

int kiln_lamp_parts_cut(struct kiln_lights *lights, struct kiln_error *error)
{
    struct cutting c = {.lights = lights};
    size_t count = 0;
    for (size_t i = 0; i < lights->area_count; i++)
        count += lights->areas[i].textured;
    lights->triangle_count = lights->textured_count = 0;
    if (count == 0) {
        lights->triangle_count = lights->area_count;
        return KILN_OK;
    }
    int status;
    KILN_TRY(reserve(&c, count, error));
    KILN_TRY(kiln_allocate(&c.wholes, count, sizeof *c.wholes, "the parts of lamps", error));
    begin(&c);
    KILN_TRY(cut_all(&c, error));
    KILN_TRY(put_together(&c, error));
end:
    kiln_free(&c.parts);
    kiln_free(&c.next);
    kiln_free(&c.chosen);
    kiln_free(&c.wholes);
    return status;
}
