#include "worker/light/emission.h"

#include <math.h>

#include "shaders/shared/area_light.h"
#include "shaders/shared/sphere.h"
#include "worker/base/memory.h"
#include "worker/light/tree.h"
#include "worker/sampling/sequence.h"

/* ---- what the lights emit ---- */

static double cone_angle(const struct kiln_point_light *light)
{
    return 2.0 * KILN_PI * (light->spot ? 1.0 - light->cos_outer : 2.0);
}

static double disc(const struct kiln_emission *e) { return KILN_PI * e->radius * e->radius; }

/* W as luminance, of a light by its number. */
static double power_of(const struct kiln_emission *e, uint32_t number)
{
    const struct kiln_lights *l = e->lights;
    size_t i = number;
    if (i < l->area_count)
        return KILN_PI * l->areas[i].area * (l->areas[i].two_sided ? 2.0 : 1.0) *
               kiln_luminance_of_floats(l->areas[i].radiance);
    i -= l->area_count;
    if (i < l->point_count)
        return cone_angle(&l->points[i]) * kiln_luminance_of_floats(l->points[i].intensity);
    i -= l->point_count;
    if (i < l->directional_count)
        return disc(e) * kiln_luminance_of_floats(l->directionals[i].irradiance);
    return l->environment ? 4.0 * KILN_PI * disc(e) * kiln_luminance_of_floats(l->environment_mean) : 0.0;
}

/* ---- building ---- */

static void bound(struct kiln_emission *e)
{
    const struct kiln_geometry *g = e->lights->geometry;
    const struct kiln_dvec3 low = dvec3_of(g->bounds_min), high = dvec3_of(g->bounds_max);
    e->centre = dvec3_scale(dvec3_add(low, high), 0.5);
    e->radius = 0.5 * dvec3_length(dvec3_sub(high, low)) * (1.0 + 1e-6);
}

static void choose_by_power(struct kiln_emission *e)
{
    for (size_t i = 0; i < e->count; i++)
        e->power += e->chance[i] = power_of(e, (uint32_t)i);
    double sum = 0.0;
    for (size_t i = 0; i < e->count; i++) {
        e->chance[i] = e->power > 0.0 ? e->chance[i] / e->power : 0.0;
        e->up_to[i] = sum += e->chance[i];
    }
}

static void find_parents(struct kiln_emission *e)
{
    const struct kiln_lights *l = e->lights;
    for (size_t i = 0; i < l->node_count; i++) {
        const struct kiln_light_node *node = &l->nodes[i];
        if (node->left == KILN_NONE)
            e->leaf[node->right] = (uint32_t)i;
        else
            e->parent[node->left] = e->parent[node->right] = (uint32_t)i;
    }
}

int kiln_emission_create(struct kiln_emission **emission, const struct kiln_lights *lights, struct kiln_error *error)
{
    static const char what[] = "the lights' emission";
    *emission = NULL;
    struct kiln_emission *e = NULL;
    int status = kiln_allocate(&e, 1, sizeof *e, what, error);
    if (status != KILN_OK)
        return status;
    e->lights = lights;
    e->count = lights->area_count + lights->point_count + lights->directional_count + 1;
    status = kiln_allocate(&e->chance, e->count, sizeof *e->chance, what, error);
    if (status == KILN_OK)
        status = kiln_allocate(&e->up_to, e->count, sizeof *e->up_to, what, error);
    if (status == KILN_OK)
        status = kiln_allocate(&e->parent, lights->node_count, sizeof *e->parent, what, error);
    if (status == KILN_OK)
        status = kiln_allocate(&e->leaf, e->count, sizeof *e->leaf, what, error);
    if (status != KILN_OK) {
        kiln_emission_destroy(&e);
        return status;
    }
    bound(e);
    choose_by_power(e);
    find_parents(e);
    *emission = e;
    return KILN_OK;
}

void kiln_emission_destroy(struct kiln_emission **emission)
{
    if (*emission == NULL)
        return;
    kiln_free(&(*emission)->chance);
    kiln_free(&(*emission)->up_to);
    kiln_free(&(*emission)->parent);
    kiln_free(&(*emission)->leaf);
    kiln_free(emission);
}

double kiln_emission_splat_unit(const struct kiln_emission *e)
{
    int power;
    const double mean = e->power / (4.0 * KILN_PI * KILN_PI * e->radius * e->radius);
    (void)frexp(mean, &power);
    return mean > 0.0 ? ldexp(1.0, power - 30) : 1.0;
}

/* ---- drawing ---- */

/* The light that `pick` falls on, and what is left of it, in (0, 1). */
static uint32_t pick_light(const struct kiln_emission *e, double *pick)
{
    size_t low = 0, high = e->count - 1;
    while (low < high) {
        const size_t middle = (low + high) / 2;
        if (*pick < e->up_to[middle])
            high = middle;
        else
            low = middle + 1;
    }
    while (low > 0 && !(e->chance[low] > 0.0)) /* the sum is rounded */
        low--;
    return (uint32_t)low;
}

/* `z` towards the axis. */
static struct kiln_dvec3 about(struct kiln_dvec3 axis, double x, double y, double z)
{
    struct kiln_vec3 s, t;
    kiln_basis(vec3_of(axis), &s, &t);
    return dvec3_add(dvec3_add(dvec3_scale(dvec3_of(s), x), dvec3_scale(dvec3_of(t), y)), dvec3_scale(axis, z));
}

static void normalize(struct kiln_dvec3 *d) { *d = dvec3_scale(*d, 1.0 / dvec3_length(*d)); }

static void set_flux(struct kiln_emitted *ray, const float light[3], double factor)
{
    for (int c = 0; c < 3; c++)
        ray->flux[c] = (double)light[c] * factor / ray->density;
}

static void draw_area(const struct kiln_emission *e, const struct kiln_area_light *light, double u, double v, double s,
                      double t, struct kiln_emitted *ray)
{
    const struct kiln_dvec3 on = kiln_triangle_place(light->e1, light->e2, u, v);
    const bool back = light->two_sided && s < 0.5;
    if (light->two_sided)
        s = back ? 2.0 * s : 2.0 * s - 1.0;
    const struct kiln_dvec3 local = kiln_cosine_direction(s, t);
    double b1, b2;
    float rgb[3];
    kiln_triangle_weights(light->e1, light->e2, on, &b1, &b2);
    kiln_area_light_radiance(e->lights, light, b1, b2, rgb);
    ray->origin = dvec3_add(light->p0, on);
    ray->direction = about(light->normal, local.x, local.y, back ? -local.z : local.z);
    normalize(&ray->direction);
    ray->cosine = fabs(dvec3_dot(ray->direction, light->normal));
    ray->density = kiln_emission_density(e, ray->light, ray->cosine, ray->direction);
    ray->has_place = true;
    set_flux(ray, rgb, ray->cosine);
}

static void draw_point(const struct kiln_emission *e, const struct kiln_point_light *light, double s, double t,
                       struct kiln_emitted *ray)
{
    if (light->spot) {
        const double z = 1.0 - s * (1.0 - light->cos_outer), r = sqrt(fmax(0.0, 1.0 - z * z)), turn = 2.0 * KILN_PI * t;
        ray->direction = about(light->direction, r * cos(turn), r * sin(turn), z);
        normalize(&ray->direction);
    } else {
        ray->direction = kiln_sphere_direction(s, t);
    }
    ray->origin = light->position;
    ray->density = kiln_emission_density(e, ray->light, 1.0, ray->direction);
    ray->has_place = ray->is_point = true;
    set_flux(ray, light->intensity, kiln_point_light_cone(light, ray->direction));
}

/* Begins outside of the scene, on a disc across the direction, and brings `light`, radiance or irradiance. */
static void draw_outside(const struct kiln_emission *e, const float light[3], double u, double v,
                         struct kiln_emitted *ray)
{
    const double r = e->radius * sqrt(u), turn = 2.0 * KILN_PI * v;
    ray->origin = dvec3_add(e->centre, about(ray->direction, r * cos(turn), r * sin(turn), -2.0 * e->radius));
    ray->density = kiln_emission_density(e, ray->light, 1.0, ray->direction);
    set_flux(ray, light, 1.0);
}

bool kiln_emission_draw(const struct kiln_emission *e, double pick, double u, double v, double s, double t,
                        struct kiln_emitted *ray)
{
    const struct kiln_lights *l = e->lights;
    if (!(e->power > 0.0))
        return false;
    *ray = (struct kiln_emitted){.light = pick_light(e, &pick), .cosine = 1.0};
    size_t i = ray->light;
    if (i < l->area_count) {
        draw_area(e, &l->areas[i], u, v, s, t, ray);
    } else if ((i -= l->area_count) < l->point_count) {
        draw_point(e, &l->points[i], s, t, ray);
    } else if ((i -= l->point_count) < l->directional_count) {
        ray->direction = dvec3_scale(l->directionals[i].towards, -1.0);
        ray->is_point = true;
        draw_outside(e, l->directionals[i].irradiance, u, v, ray);
    } else {
        float rgb[3];
        double density;
        const struct kiln_dvec3 outwards = kiln_environment_sample(l, s, t, &density);
        kiln_environment_radiance(l, outwards, rgb);
        ray->direction = dvec3_scale(outwards, -1.0);
        draw_outside(e, rgb, u, v, ray);
    }
    return ray->density > 0.0 && (ray->flux[0] > 0.0 || ray->flux[1] > 0.0 || ray->flux[2] > 0.0);
}

/* ---- densities ---- */

double kiln_emission_density(const struct kiln_emission *e, uint32_t light, double cosine, struct kiln_dvec3 direction)
{
    const struct kiln_lights *l = e->lights;
    const double chance = e->chance[light];
    size_t i = light;
    if (i < l->area_count)
        return chance * cosine / (KILN_PI * l->areas[i].area * (l->areas[i].two_sided ? 2.0 : 1.0));
    i -= l->area_count;
    if (i < l->point_count)
        return chance / cone_angle(&l->points[i]);
    i -= l->point_count;
    if (i < l->directional_count)
        return chance / disc(e);
    return chance * kiln_environment_density(l, dvec3_scale(direction, -1.0)) / disc(e);
}

/* The chance of the light among all of the tree, as pick_light of lights.c goes down. */
static double tree_chance(const struct kiln_emission *e, uint32_t light, struct kiln_dvec3 p, struct kiln_dvec3 n)
{
    const struct kiln_light_node *nodes = e->lights->nodes;
    double chance = 1.0;
    for (uint32_t node = e->leaf[light]; node != 0; node = e->parent[node]) {
        const uint32_t parent = e->parent[node], left = nodes[parent].left, right = nodes[parent].right;
        const double a = kiln_light_node_importance(&nodes[left], p, 0.0, n),
                     b = kiln_light_node_importance(&nodes[right], p, 0.0, n);
        if (!(a + b > 0.0))
            return 0.0;
        chance *= (node == left ? a : b) / (a + b);
    }
    return chance;
}

/* Per m2, of a place on the light, seen from p. */
static double area_density(const struct kiln_area_light *light, struct kiln_dvec3 p, struct kiln_dvec3 place)
{
    const struct kiln_dvec3 to0 = dvec3_sub(light->p0, p), to = dvec3_sub(place, p);
    const double side = -dvec3_dot(to0, light->normal), height = fabs(side), squared = dvec3_dot(to, to);
    if ((light->two_sided ? height : side) <= KILN_AREA_LIGHT_HEIGHT * light->rounding)
        return 0.0;
    const struct kiln_spherical_triangle t = kiln_spherical_triangle_of(to0, light->e1, light->e2, light->area, height);
    return kiln_spherical_triangle_wanted(t) ? height / (sqrt(squared) * squared * t.omega) : 1.0 / light->area;
}

double kiln_emission_connect(const struct kiln_emission *e, uint32_t light, struct kiln_dvec3 p, struct kiln_dvec3 n,
                             struct kiln_dvec3 place, struct kiln_dvec3 direction)
{
    const struct kiln_lights *l = e->lights;
    if (light < l->area_count + l->point_count)
        return tree_chance(e, light, p, n) * (light < l->area_count ? area_density(&l->areas[light], p, place) : 1.0);
    return light < kiln_emission_environment(e) ? 1.0 : kiln_environment_density(l, dvec3_scale(direction, -1.0));
}

uint32_t kiln_emission_of_triangle(const struct kiln_emission *e, uint32_t triangle)
{
    size_t low = 0, high = e->lights->area_count;
    while (low < high) { /* they are in the order of the triangles */
        const size_t middle = (low + high) / 2;
        if (e->lights->areas[middle].triangle < triangle)
            low = middle + 1;
        else
            high = middle;
    }
    return low < e->lights->area_count && e->lights->areas[low].triangle == triangle ? (uint32_t)low : KILN_NONE;
}
