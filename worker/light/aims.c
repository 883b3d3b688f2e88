#include "worker/light/aims.h"

#include <assert.h>
#include <math.h>

#include "shaders/shared/area_light.h"
#include "shaders/shared/streams.h"
#include "worker/base/memory.h"
#include "worker/sampling/sequence.h"
#include "worker/scene/footprint.h"

#define SLACK 1.0001 /* of a sphere's radius, for rounding */
#define WIDE 0.5     /* cosine of half a cone that is wide */
#define LEARNT 0.9   /* part of the paths that goes by what was learnt */

enum {
    CELLS_MOST = 16, /* of an image */
    CELL_AIMS = 64,  /* and no more than one for so many aims that there may be */
    CELL_LOOKS = 4   /* the square of it: directions that say how much of a target a cell sees */
};

/* ---- lamps ---- */

static double area_flux(const struct kiln_area_light *light)
{
    return KILN_PI * light->area * (light->two_sided ? 2.0 : 1.0) * kiln_luminance_of_floats(light->radiance);
}

/* Emitting triangles that follow each other and are of one object. */
static void area_lamp(struct kiln_aims *a, size_t first, size_t end)
{
    const struct kiln_area_light *areas = a->lights->areas;
    struct kiln_lamp lamp = {.kind = KILN_LAMP_AREA, .first = (uint32_t)first, .count = (uint32_t)(end - first)};
    for (size_t i = first; i < end; i++) {
        const struct kiln_dvec3 middle =
            dvec3_add(areas[i].p0, dvec3_scale(dvec3_add(areas[i].e1, areas[i].e2), 1.0 / 3.0));
        lamp.flux += area_flux(&areas[i]);
        lamp.centre = dvec3_add(lamp.centre, dvec3_scale(middle, area_flux(&areas[i])));
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
    if (status == KILN_OK)
        status = kiln_allocate(&a->lamps, l->area_count + l->point_count + l->directional_count + skies,
                               sizeof *a->lamps, "the lamps of light paths", error);
    if (status == KILN_OK)
        status = kiln_allocate(&a->until, l->area_count, sizeof *a->until, "the shares of emitting triangles", error);
    if (status == KILN_OK)
        status =
            kiln_allocate(&a->lamp_of, l->area_count, sizeof *a->lamp_of, "the lamps of emitting triangles", error);
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

/* 1 less the cosine of half the cone in which a target's sphere is seen; 2 from within. */
static double cone_height(const struct kiln_target *target, struct kiln_dvec3 from)
{
    const struct kiln_dvec3 to = dvec3_sub(target->centre, from);
    const double sine2 = target->radius * target->radius / dvec3_dot(to, to);
    return sine2 < 1.0 ? sine2 / (1.0 + sqrt(1.0 - sine2)) : 2.0;
}

/* The spot's own cone is narrower than that to the target. */
static bool is_narrow(const struct kiln_point_light *light, double height)
{
    return light->spot && 1.0 - light->cos_outer < height;
}

/* m2: what the light of a cell of the sky sees of a target, about. */
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
    const double height = cone_height(target, lamp->centre);
    switch (lamp->kind) {
    case KILN_LAMP_AREA:
        return lamp->flux * (height < 1.0 ? height * (2.0 - height) : 1.0);
    case KILN_LAMP_POINT: {
        const struct kiln_point_light *p = &l->points[lamp->first];
        return kiln_luminance_of_floats(p->intensity) * 2.0 * KILN_PI *
               (is_narrow(p, height) ? 1.0 - p->cos_outer : height);
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
    int status = kiln_allocate(&a->aims, count, sizeof *a->aims, "the aims of light paths", error);
    if (status == KILN_OK)
        status = kiln_allocate(&a->first, count + 1, sizeof *a->first, "the numbers of light paths", error);
    for (size_t i = 0; i < a->lamp_count && status == KILN_OK; i++)
        for (size_t j = 0; j < a->targets.count; j++)
            a->aims[a->count++] =
                (struct kiln_aim){.lamp = (uint32_t)i,
                                  .target = (uint32_t)j,
                                  .flux = flux_towards(a, &a->lamps[i], &a->targets.all[j]),
                                  .even = a->lamps[i].kind == KILN_LAMP_POINT ? 0.0 : a->targets.all[j].even};
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
    status = find_lamps(a, most, error);
    if (status == KILN_OK)
        status = kiln_targets_create(&a->targets, lights, a->lamp_count > 0 ? most / a->lamp_count : 0, error);
    if (status == KILN_OK)
        status = make_aims(a, error);
    if (status != KILN_OK)
        kiln_aims_destroy(aims);
    return status;
}

void kiln_aims_destroy(struct kiln_aims **aims)
{
    struct kiln_aims *a = *aims;
    if (a == NULL)
        return;
    kiln_free(&a->lamps);
    kiln_sky_cells_release(&a->sky);
    kiln_targets_release(&a->targets);
    kiln_free(&a->aims);
    kiln_free(&a->until);
    kiln_free(&a->lamp_of);
    kiln_free(&a->first);
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

size_t kiln_aims_find(const struct kiln_aims *a, uint64_t path)
{
    size_t low = 0, high = a->count; /* first[low] <= path < first[high] */
    while (high - low > 1) {
        const size_t middle = low + (high - low) / 2;
        *(a->first[middle] <= path ? &low : &high) = middle;
    }
    return low;
}

/* ---- rays ---- */

static struct kiln_dvec3 about(struct kiln_dvec3 axis, struct kiln_dvec3 local)
{
    struct kiln_vec3 s, t;
    kiln_basis(vec3_of(axis), &s, &t);
    return dvec3_add(dvec3_add(dvec3_scale(dvec3_of(s), local.x), dvec3_scale(dvec3_of(t), local.y)),
                     dvec3_scale(axis, local.z));
}

static void set_flux(struct kiln_aimed_ray *ray, const float rgb[3], double factor)
{
    for (int c = 0; c < 3; c++)
        ray->flux[c] = (double)rgb[c] * factor;
}

/* Evenly over the cone about the axis, of which 1 less the cosine of half its angle is `height`. */
static struct kiln_dvec3 cone_direction(struct kiln_dvec3 axis, double height, double u, double v)
{
    const double below = u * height, sine = sqrt(below * (2.0 - below)), turn = 2.0 * KILN_PI * v;
    return about(axis, dvec3(sine * cos(turn), sine * sin(turn), 1.0 - below));
}

static struct kiln_dvec3 towards(const struct kiln_target *target, struct kiln_dvec3 from)
{
    const struct kiln_dvec3 to = dvec3_sub(target->centre, from);
    const double length = dvec3_length(to);
    return length > 0.0 ? dvec3_scale(to, 1.0 / length) : dvec3(0.0, 0.0, 1.0);
}

/* The cone that a point or spot sends to: 1 less the cosine of half its angle, and its axis. */
static double point_cone(const struct kiln_point_light *light, const struct kiln_target *target,
                         struct kiln_dvec3 *axis)
{
    const double height = cone_height(target, light->position);
    const bool narrow = is_narrow(light, height);
    *axis = narrow ? light->direction : towards(target, light->position);
    return narrow ? 1.0 - light->cos_outer : height;
}

static bool draw_point(const struct kiln_point_light *light, const struct kiln_target *target, const double numbers[],
                       struct kiln_aimed_ray *ray)
{
    struct kiln_dvec3 axis;
    struct kiln_box_seen box;
    const double used = point_cone(light, target, &axis);
    const bool by_box = kiln_target_see_box(target, light->position, 2.0 * KILN_PI * used, &box);
    const struct kiln_dvec3 direction = by_box ? kiln_box_direction(&box, numbers[1], numbers[4], numbers[5])
                                               : cone_direction(axis, used, numbers[4], numbers[5]);
    ray->origin = vec3_of(light->position);
    ray->direction = vec3_of(direction);
    ray->place = light->position;
    ray->range = light->range;
    ray->has_place = ray->is_point = true;
    set_flux(ray, light->intensity,
             (by_box ? box.omega : 2.0 * KILN_PI * used) * kiln_point_light_cone(light, direction));
    return true;
}

/* From outside the scene, through a place at the target. */
static void draw_outside(const struct kiln_aims *a, const struct kiln_target *target, struct kiln_dvec3 back,
                         struct kiln_dvec3 through, struct kiln_aimed_ray *ray)
{
    const double away = a->radius + dvec3_length(dvec3_sub(target->centre, a->centre)) + kiln_target_reach(target);
    ray->place = dvec3_add(through, dvec3_scale(back, away));
    ray->origin = vec3_of(ray->place);
    ray->direction = vec3_of(dvec3_scale(back, -1.0));
}

/* The emitting triangle of a lamp that `pick` falls to. */
static size_t find_area(const struct kiln_aims *a, const struct kiln_lamp *lamp, double pick)
{
    size_t low = lamp->first, high = lamp->first + lamp->count - 1;
    while (low < high) {
        const size_t middle = low + (high - low) / 2;
        if (a->until[middle] > pick)
            high = middle;
        else
            low = middle + 1;
    }
    return low;
}

/* The cone is so wide that directions are drawn by the cosine. */
static bool is_wide(double height) { return height > 1.0 - WIDE; }

/* sr: of a box that is better than that cone, for an emitting triangle. */
static double box_most(double height) { return 2.0 * KILN_PI * (is_wide(height) ? WIDE : height); }

/* The ray leaves an emitting triangle at the place `on` from its corner 0, and has `factor` of its radiance. */
static bool leave_area(const struct kiln_aims *a, size_t area, struct kiln_dvec3 on, double side,
                       struct kiln_dvec3 direction, double factor, struct kiln_aimed_ray *ray)
{
    const struct kiln_area_light *light = &a->lights->areas[area];
    float rgb[3];
    double b1 = 0.0, b2 = 0.0;
    if (!(factor > 0.0))
        return false;
    if (light->textured)
        kiln_triangle_weights(light->e1, light->e2, on, &b1, &b2);
    kiln_area_light_radiance(a->lights, light, b1, b2, rgb);
    ray->place = dvec3_add(light->p0, on);
    ray->origin = kiln_offset_origin(vec3_of(ray->place), vec3_of(dvec3_scale(light->normal, side)),
                                     a->lights->geometry, light->triangle);
    ray->direction = vec3_of(direction);
    ray->cosine = side * dvec3_dot(light->normal, direction);
    ray->light = (uint32_t)area;
    ray->has_place = true;
    set_flux(ray, rgb, factor);
    return true;
}

static bool draw_area(const struct kiln_aims *a, const struct kiln_lamp *lamp, const struct kiln_target *target,
                      const double numbers[], struct kiln_aimed_ray *ray)
{
    const size_t area = find_area(a, lamp, numbers[0]);
    const struct kiln_area_light *light = &a->lights->areas[area];
    const struct kiln_dvec3 on = kiln_triangle_place(light->e1, light->e2, numbers[2], numbers[3]),
                            at = dvec3_add(light->p0, on);
    const double height = cone_height(target, at), sides = light->two_sided ? 2.0 : 1.0;
    struct kiln_box_seen box;
    const bool by_box = kiln_target_see_box(target, at, box_most(height), &box);
    /* area over the chance of the triangle; what the direction's density adds */
    double factor = light->area * lamp->flux / area_flux(light), side = 1.0;
    struct kiln_dvec3 direction;
    if (!by_box && is_wide(height)) {
        side = light->two_sided && numbers[1] < 0.5 ? -1.0 : 1.0;
        direction = about(dvec3_scale(light->normal, side), kiln_cosine_direction(numbers[4], numbers[5]));
        factor *= KILN_PI * sides;
    } else {
        direction = by_box ? kiln_box_direction(&box, numbers[1], numbers[4], numbers[5])
                           : cone_direction(towards(target, at), height, numbers[4], numbers[5]);
        const double cosine = dvec3_dot(light->normal, direction);
        side = light->two_sided && cosine < 0.0 ? -1.0 : 1.0;
        factor *= (by_box ? box.omega : 2.0 * KILN_PI * height) * side * cosine;
    }
    return leave_area(a, area, on, side, direction, factor, ray);
}

/* ---- rays that go evenly over triangles ---- */

static struct kiln_dvec3 unit_of(struct kiln_dvec3 v) { return dvec3_scale(v, 1.0 / dvec3_length(v)); }

/* Of rays that go evenly over the target's triangles, the density of those that go to this one: per m2 across the
 * direction, or per steradian from a place. */
static double even_across(const struct kiln_aims *a, const struct kiln_target *target, uint32_t triangle,
                          struct kiln_dvec3 direction)
{
    const struct kiln_vec3 normal = kiln_triangle_exact_normal(a->lights->scene, a->lights->geometry, triangle);
    const double cosine = fabs(dvec3_dot(dvec3_of(normal), direction));
    return cosine > 0.0 ? 1.0 / (target->area * cosine) : 0.0;
}

static double even_from(const struct kiln_aims *a, const struct kiln_target *target, uint32_t triangle,
                        struct kiln_dvec3 place, struct kiln_dvec3 direction)
{
    const struct kiln_vec3 normal = kiln_triangle_exact_normal(a->lights->scene, a->lights->geometry, triangle);
    struct kiln_vec3 corner[3];
    kiln_geometry_corners(a->lights->geometry, triangle, corner);
    const double height = dvec3_dot(dvec3_sub(dvec3_of(corner[0]), place), dvec3_of(normal)),
                 cosine = dvec3_dot(dvec3_of(normal), direction), far = height / cosine;
    return isfinite(far) && far > 0.0 ? far * far / (target->area * fabs(cosine)) : 0.0;
}

/* The same by the lamp, with the density of the place on an emitting triangle, or of the sky's direction. */
static double even_density(const struct kiln_aims *a, const struct kiln_lamp *lamp, uint32_t light, uint32_t triangle,
                           struct kiln_dvec3 place, struct kiln_dvec3 direction)
{
    const struct kiln_target *target = &a->targets.all[a->targets.of_triangle[triangle]];
    if (lamp->kind == KILN_LAMP_AREA) {
        const struct kiln_area_light *area = &a->lights->areas[light];
        return area->two_sided || dvec3_dot(area->normal, direction) > 0.0
                   ? area_flux(area) / lamp->flux / area->area * even_from(a, target, triangle, place, direction)
                   : 0.0;
    }
    const double across = even_across(a, target, triangle, direction);
    if (lamp->kind == KILN_LAMP_DIRECTIONAL)
        return across;
    const double share = a->sky.count > 1 ? a->sky.all[lamp->cell].share : 1.0;
    return kiln_environment_density(a->lights, dvec3_scale(direction, -1.0)) / share * across;
}

/* A place on the target's triangle `triangle`. */
static struct kiln_dvec3 even_place(const struct kiln_aims *a, uint32_t triangle, double u, double v)
{
    struct kiln_vec3 corner[3];
    kiln_geometry_corners(a->lights->geometry, triangle, corner);
    const struct kiln_dvec3 origin = dvec3_of(corner[0]);
    return dvec3_add(origin, kiln_triangle_place(dvec3_sub(dvec3_of(corner[1]), origin),
                                                 dvec3_sub(dvec3_of(corner[2]), origin), u, v));
}

/* The number of the first light of a lamp. */
static uint32_t light_of(const struct kiln_aims *a, const struct kiln_lamp *lamp)
{
    const struct kiln_lights *l = a->lights;
    const size_t before = lamp->kind == KILN_LAMP_AREA          ? 0
                          : lamp->kind == KILN_LAMP_POINT       ? l->area_count
                          : lamp->kind == KILN_LAMP_DIRECTIONAL ? l->area_count + l->point_count
                                                                : l->area_count + l->point_count + l->directional_count;
    return (uint32_t)before + lamp->first;
}

/* Towards what a directional light or the environment sends its light, `rgb`, from; `density`: of that direction. */
static void from_outside(const struct kiln_aims *a, const struct kiln_lamp *lamp, const double numbers[],
                         struct kiln_dvec3 *back, float rgb[3], double *density, struct kiln_aimed_ray *ray)
{
    const struct kiln_lights *l = a->lights;
    *density = 1.0;
    if (lamp->kind == KILN_LAMP_DIRECTIONAL) {
        const struct kiln_directional_light *sun = &l->directionals[lamp->first];
        *back = sun->towards;
        ray->is_point = true;
        for (int c = 0; c < 3; c++)
            rgb[c] = sun->irradiance[c];
        return;
    }
    *back = a->sky.count > 1 ? kiln_sky_cell_sample(&a->sky, lamp->cell, numbers[4], numbers[5], density)
                             : kiln_environment_sample(l, numbers[4], numbers[5], density);
    kiln_environment_radiance(l, *back, rgb);
}

/* By sphere or box. */
static bool draw_by_outline(const struct kiln_aims *a, const struct kiln_lamp *lamp, const struct kiln_target *target,
                            const double numbers[], struct kiln_aimed_ray *ray)
{
    const struct kiln_lights *l = a->lights;
    struct kiln_dvec3 back;
    double density;
    float rgb[3];
    if (lamp->kind == KILN_LAMP_AREA)
        return draw_area(a, lamp, target, numbers, ray);
    if (lamp->kind == KILN_LAMP_POINT)
        return draw_point(&l->points[lamp->first], target, numbers, ray);
    from_outside(a, lamp, numbers, &back, rgb, &density, ray);
    draw_outside(a, target, back, kiln_target_place(target, back, numbers[1], numbers[2], numbers[3]), ray);
    set_flux(ray, rgb, kiln_target_outline(target, back) / density);
    return density > 0.0;
}

/* From an emitting triangle of the lamp to the place `to` on the ray's triangle, which was drawn evenly; likewise from
 * outside. */
static bool draw_even_area(const struct kiln_aims *a, const struct kiln_lamp *lamp, const double numbers[],
                           struct kiln_dvec3 to, struct kiln_aimed_ray *ray)
{
    const size_t area = find_area(a, lamp, numbers[0]);
    const struct kiln_area_light *light = &a->lights->areas[area];
    const struct kiln_dvec3 on = kiln_triangle_place(light->e1, light->e2, numbers[2], numbers[3]),
                            at = dvec3_add(light->p0, on), direction = dvec3_of(vec3_of(unit_of(dvec3_sub(to, at))));
    const double cosine = dvec3_dot(light->normal, direction), side = light->two_sided && cosine < 0.0 ? -1.0 : 1.0,
                 density = even_density(a, lamp, (uint32_t)area, ray->triangle, at, direction);
    return density > 0.0 && leave_area(a, area, on, side, direction, side * cosine / density, ray);
}

static bool draw_even_outside(const struct kiln_aims *a, const struct kiln_lamp *lamp, const struct kiln_target *target,
                              const double numbers[], struct kiln_dvec3 to, struct kiln_aimed_ray *ray)
{
    struct kiln_dvec3 back;
    double density;
    float rgb[3];
    from_outside(a, lamp, numbers, &back, rgb, &density, ray);
    draw_outside(a, target, back, to, ray);
    density *= even_across(a, target, ray->triangle, dvec3_of(ray->direction));
    if (density > 0.0)
        set_flux(ray, rgb, 1.0 / density);
    return density > 0.0;
}

static bool draw_even(const struct kiln_aims *a, const struct kiln_lamp *lamp, const struct kiln_target *target,
                      const double numbers[], struct kiln_aimed_ray *ray)
{
    const uint32_t triangle = kiln_targets_pick(&a->targets, target, numbers[1]);
    ray->triangle = triangle;
    return lamp->kind == KILN_LAMP_AREA
               ? draw_even_area(a, lamp, numbers, even_place(a, triangle, numbers[4], numbers[5]), ray)
               : draw_even_outside(a, lamp, target, numbers, even_place(a, triangle, numbers[2], numbers[3]), ray);
}

uint64_t kiln_aims_even(const struct kiln_aims *a, size_t aim)
{
    return (uint64_t)(a->aims[aim].even * (double)(a->first[aim + 1] - a->first[aim]));
}

bool kiln_aims_draw(const struct kiln_aims *a, size_t aim, uint64_t k, const double numbers[KILN_AIM_NUMBERS],
                    struct kiln_aimed_ray *ray)
{
    const struct kiln_lamp *lamp = &a->lamps[a->aims[aim].lamp];
    const struct kiln_target *target = &a->targets.all[a->aims[aim].target];
    *ray = (struct kiln_aimed_ray){.cosine = 1.0, .light = light_of(a, lamp), .triangle = KILN_NONE};
    return k < kiln_aims_even(a, aim) ? draw_even(a, lamp, target, numbers, ray)
                                      : draw_by_outline(a, lamp, target, numbers, ray);
}

/* ---- densities ---- */

/* Per steradian, of a direction in the cone about the axis; 0 beyond it, but for rounding. */
static double cone_density(struct kiln_dvec3 axis, double height, struct kiln_dvec3 direction)
{
    return 1.0 - dvec3_dot(axis, direction) <= SLACK * height ? 1.0 / (2.0 * KILN_PI * height) : 0.0;
}

static double area_density(const struct kiln_aims *a, uint32_t area, const struct kiln_target *target,
                           struct kiln_dvec3 place, struct kiln_dvec3 direction)
{
    const struct kiln_area_light *light = &a->lights->areas[area];
    struct kiln_box_seen box;
    const double height = cone_height(target, place), cosine = dvec3_dot(light->normal, direction),
                 chance = area_flux(light) / a->lamps[a->lamp_of[area]].flux;
    if (!light->two_sided && !(cosine > 0.0))
        return 0.0;
    if (kiln_target_see_box(target, place, box_most(height), &box))
        return chance / light->area / box.omega;
    return chance / light->area *
           (is_wide(height) ? fabs(cosine) / (KILN_PI * (light->two_sided ? 2.0 : 1.0))
                            : cone_density(towards(target, place), height, direction));
}

static double point_density(const struct kiln_point_light *light, const struct kiln_target *target,
                            struct kiln_dvec3 direction)
{
    struct kiln_dvec3 axis;
    struct kiln_box_seen box;
    const double height = point_cone(light, target, &axis);
    if (kiln_target_see_box(target, light->position, 2.0 * KILN_PI * height, &box))
        return 1.0 / box.omega;
    return cone_density(axis, height, direction);
}

/* The lamp that a light is a part of: they are in the order of the lights. */
static size_t lamp_of(const struct kiln_aims *a, uint32_t light)
{
    const size_t areas = a->lights->area_count;
    if (light < areas)
        return a->lamp_of[light];
    return (areas > 0 ? a->lamp_of[areas - 1] + 1 : 0) + (light - areas);
}

/* Of so many paths whose rays go by sphere or box. */
static double outline_density(const struct kiln_aims *a, const struct kiln_lamp *lamp, uint32_t light,
                              const struct kiln_target *target, double paths, struct kiln_dvec3 place,
                              struct kiln_dvec3 direction)
{
    const struct kiln_lights *l = a->lights;
    switch (lamp->kind) {
    case KILN_LAMP_AREA:
        return paths * area_density(a, light, target, place, direction);
    case KILN_LAMP_POINT:
        return paths * point_density(&l->points[lamp->first], target, direction);
    case KILN_LAMP_DIRECTIONAL:
        return paths / kiln_target_outline(target, l->directionals[lamp->first].towards);
    case KILN_LAMP_ENVIRONMENT:
        break;
    }
    const struct kiln_dvec3 back = dvec3_scale(direction, -1.0);
    const double share = a->sky.count > 1 ? a->sky.all[lamp->cell].share : 1.0;
    return paths * kiln_environment_density(l, back) / share / kiln_target_outline(target, back);
}

double kiln_aims_met(const struct kiln_aims *a, size_t aim, const struct kiln_aimed_ray *ray, uint32_t triangle)
{
    const double all = (double)(a->first[aim + 1] - a->first[aim]), even = (double)kiln_aims_even(a, aim);
    if (kiln_aims_target(a, triangle) != a->aims[aim].target ||
        (ray->triangle != KILN_NONE && ray->triangle != triangle))
        return 0.0;
    if (!(even > 0.0))
        return 1.0;
    const struct kiln_lamp *lamp = &a->lamps[a->aims[aim].lamp];
    const struct kiln_target *target = &a->targets.all[a->aims[aim].target];
    const struct kiln_dvec3 direction = dvec3_of(ray->direction);
    const double by_outline = outline_density(a, lamp, ray->light, target, all - even, ray->place, direction),
                 by_triangle = even * even_density(a, lamp, ray->light, triangle, ray->place, direction),
                 own = ray->triangle != KILN_NONE ? by_triangle / even : by_outline / (all - even);
    return own > 0.0 ? all * own / (by_outline + by_triangle) : 0.0;
}

double kiln_aims_density(const struct kiln_aims *a, uint32_t light, uint32_t triangle, struct kiln_dvec3 place,
                         struct kiln_dvec3 direction)
{
    const uint32_t target = kiln_aims_target(a, triangle);
    if (target == KILN_NONE)
        return 0.0;
    const size_t first = lamp_of(a, light),
                 number = a->lamps[first].kind == KILN_LAMP_ENVIRONMENT && a->sky.count > 1
                              ? first + kiln_sky_cell_of(&a->sky, dvec3_scale(direction, -1.0))
                              : first,
                 aim = number * a->targets.count + target;
    const struct kiln_lamp *lamp = &a->lamps[number];
    const double all = (double)(a->first[aim + 1] - a->first[aim]), even = (double)kiln_aims_even(a, aim),
                 by_outline = outline_density(a, lamp, light, &a->targets.all[target], all - even, place, direction);
    return even > 0.0 ? by_outline + even * even_density(a, lamp, light, triangle, place, direction) : by_outline;
}
