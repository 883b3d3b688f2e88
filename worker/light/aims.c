#include "worker/light/aims.h"

#include <assert.h>
#include <math.h>

#include "shaders/shared/streams.h"
#include "worker/base/arena.h"
#include "worker/base/memory.h"
#include "worker/light/access.h"
#include "worker/scene/footprint.h"

#define SLACK 1.0001 /* of a sphere's radius, for rounding */
#define LEARNT 0.9   /* share of the paths that follow learnt probabilities */

enum {
    CELLS_MOST = 16, /* of an image */
    CELL_AIMS = 64,  /* at most one cell for so many aims */
    CELL_LOOKS = 4   /* per side; their squares: directions that estimate how much of a target a cell sees */
};

/* ---- declarations that shaders/shared/aims.h needs ---- */

#define KILN_AIM_COUNT(aims) ((uint32_t)(aims)->count)
#define KILN_AIM_LAMP(aims, aim) ((aims)->aims[aim].lamp)
#define KILN_AIM_TARGET(aims, aim) ((aims)->aims[aim].target)
#define KILN_AIM_AT(aims, lamp, target) ((lamp) * (uint32_t)(aims)->targets.count + (target))
#define KILN_AIM_EVEN(aims, aim) kiln_aims_even(aims, aim)
#define KILN_TARGET(aims, index) (&(aims)->targets.all[index])
#define KILN_TARGET_OF(aims, triangle) kiln_aims_target(aims, triangle)
#define KILN_TARGET_PICK(aims, target, pick) kiln_targets_pick(&(aims)->targets, target, pick)
#define KILN_AIM_CENTRE(aims) ((aims)->centre)
#define KILN_AIM_RADIUS(aims) ((aims)->radius)
#define KILN_AIM_LAMP_NUMBER(aims, light, direction) lamp_number(aims, light, direction)
#define KILN_AIM_SUNS(aims) ((uint32_t)((aims)->lights->area_count + (aims)->lights->point_count))
#define KILN_AIM_SKY(aims) (KILN_AIM_SUNS(aims) + (uint32_t)(aims)->lights->directional_count)
#define KILN_AIM_PER_CELL(aims, lamp, density)                                                                         \
    ((density) / ((aims)->sky.count > 1 ? (aims)->sky.all[(lamp)->cell].share : 1.0))
#define KILN_AIM_NORMAL(aims, triangle)                                                                                \
    kiln_triangle_exact_normal((aims)->lights->scene, (aims)->lights->geometry, triangle)
#define KILN_AIM_OFFSET(aims, triangle, normal) kiln_offset_distance((aims)->lights->geometry, triangle, normal)
#define KILN_AREA_LUMINANCE(light) kiln_luminance_of_floats((light)->radiance)

static struct kiln_dvec3 kiln_aim_sky_sample(const struct kiln_aims *a, const struct kiln_lamp *lamp, double u,
                                             double v, double *density)
{
    return a->sky.count > 1 ? kiln_sky_cell_sample(&a->sky, lamp->cell, u, v, density)
                            : kiln_environment_sample(a->lights, u, v, density);
}

static struct kiln_dvec3 kiln_aim_corner(const struct kiln_aims *a, uint32_t triangle)
{
    struct kiln_vec3 corner[3];
    kiln_geometry_corners(a->lights->geometry, triangle, corner);
    return dvec3_of(corner[0]);
}

static struct kiln_dvec3 kiln_aim_place(const struct kiln_aims *a, uint32_t triangle, double u, double v)
{
    struct kiln_vec3 corner[3];
    kiln_geometry_corners(a->lights->geometry, triangle, corner);
    const struct kiln_dvec3 origin = dvec3_of(corner[0]);
    return dvec3_add(origin, kiln_triangle_place(dvec3_sub(dvec3_of(corner[1]), origin),
                                                 dvec3_sub(dvec3_of(corner[2]), origin), u, v));
}

/* The lamp that a light belongs to. Lamps are in the order of the lights. */
static uint32_t lamp_number(const struct kiln_aims *a, uint32_t light, struct kiln_dvec3 direction)
{
    const uint32_t areas = (uint32_t)a->lights->area_count;
    if (light < areas)
        return a->lamp_of[light];
    const uint32_t lamp = (areas > 0 ? a->lamp_of[areas - 1] + 1 : 0) + (light - areas);
    return a->lamps[lamp].kind == KILN_LAMP_ENVIRONMENT && a->sky.count > 1
               ? lamp + (uint32_t)kiln_sky_cell_of(&a->sky, dvec3_scale(direction, -1.0))
               : lamp;
}

#include "shaders/shared/aims.h"

/* ---- lamps ---- */

/* Makes a lamp from consecutive emitting triangles of one object. */
static void area_lamp(struct kiln_aims *a, size_t first, size_t end)
{
    const struct kiln_area_light *areas = a->lights->areas;
    struct kiln_lamp lamp = {.kind = KILN_LAMP_AREA, .first = (uint32_t)first, .count = (uint32_t)(end - first)};
    for (size_t i = first; i < end; i++) {
        const struct kiln_dvec3 middle =
            dvec3_add(areas[i].p0, dvec3_scale(dvec3_add(areas[i].e1, areas[i].e2), 1.0 / 3.0));
        lamp.flux += kiln_area_flux(&areas[i]);
        lamp.centre = dvec3_add(lamp.centre, dvec3_scale(middle, kiln_area_flux(&areas[i])));
        a->until[i] = lamp.flux;
        a->lamp_of[i] = (uint32_t)a->lamp_count;
    }
    lamp.centre = dvec3_scale(lamp.centre, 1.0 / lamp.flux);
    for (size_t i = first; i < end; i++)
        a->until[i] = i + 1 < end ? a->until[i] / lamp.flux : 1.0;
    a->lamps[a->lamp_count++] = lamp;
}

static uint32_t object_of(const struct kiln_lights *l, size_t area)
{
    return l->geometry->records[l->areas[area].triangle].object;
}

static int find_lamps(struct kiln_aims *a, size_t most, struct kiln_error *error)
{
    const struct kiln_lights *l = a->lights;
    const size_t cells = most / CELL_AIMS < CELLS_MOST ? most / CELL_AIMS : CELLS_MOST;
    int status = kiln_sky_cells_create(&a->sky, l, cells, error);
    const size_t skies = a->sky.count > 0 ? a->sky.count : l->environment ? 1 : 0;
    KILN_TRY(status);
    KILN_TRY(kiln_arena_allocate(&a->arena, &a->lamps, l->area_count + l->point_count + l->directional_count + skies,
                                 sizeof *a->lamps, "the lamps of light paths", error));
    KILN_TRY(kiln_arena_allocate(&a->arena, &a->until, l->area_count, sizeof *a->until,
                                 "the shares of emitting triangles", error));
    KILN_TRY(kiln_arena_allocate(&a->arena, &a->lamp_of, l->area_count, sizeof *a->lamp_of,
                                 "the lamps of emitting triangles", error));
end:
    if (status != KILN_OK)
        return status;
    for (size_t i = 0, end; i < l->area_count; i = end) {
        for (end = i + 1; end < l->area_count && object_of(l, end) == object_of(l, i);)
            end++;
        area_lamp(a, i, end);
    }
    for (size_t i = 0; i < l->point_count; i++)
        a->lamps[a->lamp_count++] = (struct kiln_lamp){
            .kind = KILN_LAMP_POINT, .first = (uint32_t)i, .count = 1, .centre = l->points[i].position};
    for (size_t i = 0; i < l->directional_count; i++)
        a->lamps[a->lamp_count++] = (struct kiln_lamp){.kind = KILN_LAMP_DIRECTIONAL, .first = (uint32_t)i, .count = 1};
    for (size_t i = 0; i < skies; i++)
        a->lamps[a->lamp_count++] = (struct kiln_lamp){.kind = KILN_LAMP_ENVIRONMENT, .count = 1, .cell = (uint32_t)i};
    return KILN_OK;
}

/* ---- aims ---- */

/* m2: approximate area of a target as seen from a cell of the sky. */
static double cell_outline(const struct kiln_aims *a, size_t cell, const struct kiln_target *target)
{
    double sum = 0.0, density;
    for (int i = 0; i < CELL_LOOKS * CELL_LOOKS; i++)
        sum += kiln_target_outline(target, kiln_sky_cell_sample(&a->sky, cell, (i % CELL_LOOKS + 0.5) / CELL_LOOKS,
                                                                (i / CELL_LOOKS + 0.5) / CELL_LOOKS, &density));
    return sum / (CELL_LOOKS * CELL_LOOKS);
}

static double flux_towards(const struct kiln_aims *a, const struct kiln_lamp *lamp, const struct kiln_target *target)
{
    const struct kiln_lights *l = a->lights;
    const double height = kiln_cone_height(target, lamp->centre);
    switch (lamp->kind) {
    case KILN_LAMP_AREA:
        return lamp->flux * (height < 1.0 ? height * (2.0 - height) : 1.0);
    case KILN_LAMP_POINT: {
        const struct kiln_point_light *p = &l->points[lamp->first];
        return kiln_luminance_of_floats(p->intensity) * 2.0 * KILN_PI * fmin(kiln_punctual_cone(p), height);
    }
    case KILN_LAMP_DIRECTIONAL:
        return kiln_luminance_of_floats(l->directionals[lamp->first].irradiance) *
               kiln_target_outline(target, l->directionals[lamp->first].towards);
    case KILN_LAMP_ENVIRONMENT:
        break;
    }
    const double flux = 4.0 * KILN_PI * kiln_luminance_of_floats(l->environment_mean);
    return a->sky.count > 1 ? flux * a->sky.all[lamp->cell].share * cell_outline(a, lamp->cell, target)
                            : flux * kiln_target_mean_outline(target);
}

static int make_aims(struct kiln_aims *a, struct kiln_error *error)
{
    if (a->targets.count > 0 && a->lamp_count > KILN_AIMS_MOST / a->targets.count)
        return kiln_fail(error, KILN_USAGE,
                         "light paths would have %zu lamps to go from and %zu objects with gloss to be aimed at, more "
                         "than %d pairs: give --caustics gather",
                         a->lamp_count, a->targets.count, (int)KILN_AIMS_MOST);
    const size_t count = a->lamp_count * a->targets.count;
    int status;
    KILN_TRY(kiln_arena_allocate(&a->arena, &a->aims, count, sizeof *a->aims, "the aims of light paths", error));
    KILN_TRY(
        kiln_arena_allocate(&a->arena, &a->first, count + 1, sizeof *a->first, "the numbers of light paths", error));
    for (size_t i = 0; i < a->lamp_count; i++)
        for (size_t j = 0; j < a->targets.count; j++)
            a->aims[a->count++] =
                (struct kiln_aim){.lamp = (uint32_t)i,
                                  .target = (uint32_t)j,
                                  .flux = flux_towards(a, &a->lamps[i], &a->targets.all[j]),
                                  .even = a->lamps[i].kind == KILN_LAMP_POINT ? 0.0 : a->targets.all[j].even};
end:
    return status;
}

int kiln_aims_create(struct kiln_aims **aims, const struct kiln_lights *lights, size_t most, struct kiln_error *error)
{
    const struct kiln_geometry *g = lights->geometry;
    struct kiln_aims *a = NULL;
    int status = kiln_allocate(&a, 1, sizeof *a, "the aims", error);
    *aims = a;
    if (status != KILN_OK)
        return status;
    a->lights = lights;
    a->centre = dvec3_of(vec3_scale(vec3_add(g->bounds_min, g->bounds_max), 0.5f));
    a->radius = 0.5 * SLACK * (double)vec3_length(vec3_sub(g->bounds_max, g->bounds_min));
    KILN_TRY(find_lamps(a, most, error));
    KILN_TRY(kiln_targets_create(&a->targets, lights, a->lamp_count > 0 ? most / a->lamp_count : 0, error));
    KILN_TRY(make_aims(a, error));
end:
    if (status != KILN_OK)
        kiln_aims_destroy(aims);
    return status;
}

void kiln_aims_destroy(struct kiln_aims **aims)
{
    struct kiln_aims *a = *aims;
    if (a == NULL)
        return;
    kiln_sky_cells_release(&a->sky);
    kiln_targets_release(&a->targets);
    kiln_arena_release(&a->arena);
    kiln_free(aims);
}

void kiln_aims_share(struct kiln_aims *a, uint64_t paths, const double *weights)
{
    assert(paths >= a->count);
    const double rest = (double)(paths - a->count);
    double total = 0.0, sum = 0.0;
    for (size_t i = 0; i < a->count; i++)
        total += weights != NULL ? weights[i] : a->aims[i].flux;
    for (size_t i = 0; i < a->count; i++) {
        a->first[i] = i + (total > 0.0 ? (uint64_t)(rest * fmin(1.0, sum / total)) : 0);
        sum += weights != NULL ? weights[i] : a->aims[i].flux;
    }
    a->first[a->count] = a->paths = paths;
}

void kiln_aims_weigh(const struct kiln_aims *a, const double *moments, const double *paths, double even,
                     double *weights)
{
    double sent = 0.0, sum = 0.0;
    for (size_t i = 0; i < a->count; i++) {
        weights[i] = a->aims[i].flux * sqrt(moments[i] / paths[i]);
        sent += a->aims[i].flux;
        sum += weights[i];
    }
    const double all = even / (1.0 - even) / (double)a->count;
    for (size_t i = 0; i < a->count; i++)
        weights[i] = (sum > 0.0 ? LEARNT * weights[i] / sum : 0.0) +
                     (sent > 0.0 ? (1.0 - LEARNT) * a->aims[i].flux / sent : 0.0) + all;
}

bool kiln_aims_is_left(const struct kiln_aims *a, size_t aim, uint32_t leaves)
{
    const uint32_t image = a->lights->conditional != NULL ? KILN_LEAVES_IMAGE : 0,
                   kinds[] = {[KILN_LAMP_AREA] = KILN_LEAVES_AREAS,
                              [KILN_LAMP_POINT] = KILN_LEAVES_POINTS,
                              [KILN_LAMP_DIRECTIONAL] = KILN_LEAVES_POINTS,
                              [KILN_LAMP_ENVIRONMENT] = image};
    return (leaves & kinds[a->lamps[a->aims[aim].lamp].kind]) != 0;
}

size_t kiln_aims_find(const struct kiln_aims *a, uint64_t path) { return kiln_aim_find(a, path); }

/* ---- rays and densities ---- */

uint64_t kiln_aims_even(const struct kiln_aims *a, size_t aim)
{
    return (uint64_t)(a->aims[aim].even * (double)(a->first[aim + 1] - a->first[aim]));
}

bool kiln_aims_draw(const struct kiln_aims *a, size_t aim, uint64_t k, const double numbers[KILN_AIM_NUMBERS],
                    struct kiln_aimed_ray *ray)
{
    const struct kiln_aim_numbers n = {numbers[0], numbers[1], numbers[2], numbers[3], numbers[4], numbers[5]};
    *ray = (struct kiln_aimed_ray){.triangle = KILN_NONE};
    return kiln_aim_draw(a, (uint32_t)aim, k, n, ray);
}

double kiln_aims_met(const struct kiln_aims *a, size_t aim, const struct kiln_aimed_ray *ray, uint32_t triangle)
{
    return kiln_aim_met(a, (uint32_t)aim, ray, triangle);
}

double kiln_aims_density(const struct kiln_aims *a, uint32_t light, uint32_t triangle, struct kiln_dvec3 place,
                         struct kiln_dvec3 direction)
{
    return kiln_aim_density(a, light, triangle, place, direction);
}
