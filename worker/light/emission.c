#include "worker/light/emission.h"

#include <math.h>

#include "worker/base/arena.h"
#include "worker/base/memory.h"
#include "worker/light/access.h"

#define KILN_EMISSION_DIRECTIONAL(emission) kiln_emission_directional(emission, 0)
#define KILN_EMISSION_ENVIRONMENT(emission) ((uint32_t)(emission)->count - 1)
#define KILN_EMISSION_CENTRE(emission) ((emission)->centre)
#define KILN_EMISSION_RADIUS(emission) ((emission)->radius)
#include "shaders/shared/emission.h"

/* ---- what the lights emit ---- */

/* Power of a light by its number, W as luminance. */
static double power_of(const struct kiln_emission *e, uint32_t number)
{
    const struct kiln_lights *l = e->lights;
    size_t i = number;
    if (i < l->area_count)
        return KILN_PI * l->areas[i].area * (l->areas[i].two_sided ? 2.0 : 1.0) *
               kiln_luminance_of_floats(l->areas[i].radiance);
    i -= l->area_count;
    if (i < l->point_count)
        return kiln_punctual_angle(&l->points[i]) * kiln_luminance_of_floats(l->points[i].intensity);
    i -= l->point_count;
    if (i < l->directional_count)
        return kiln_emission_disc(e->radius) * kiln_luminance_of_floats(l->directionals[i].irradiance);
    return l->environment
               ? 4.0 * KILN_PI * kiln_emission_disc(e->radius) * kiln_luminance_of_floats(l->environment_mean)
               : 0.0;
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
    KILN_TRY(kiln_allocate(&e->chance, e->count, sizeof *e->chance, what, error));
    KILN_TRY(kiln_arena_allocate(&e->arena, &e->up_to, e->count, sizeof *e->up_to, what, error));
    KILN_TRY(kiln_arena_allocate(&e->arena, &e->parent, lights->node_count, sizeof *e->parent, what, error));
    KILN_TRY(kiln_arena_allocate(&e->arena, &e->leaf, e->count, sizeof *e->leaf, what, error));
end:
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
    kiln_arena_release(&(*emission)->arena);
    kiln_free(emission);
}

double kiln_emission_splat_unit(const struct kiln_emission *e)
{
    int power;
    const double mean = e->power / (4.0 * KILN_PI * KILN_PI * e->radius * e->radius);
    (void)frexp(mean, &power);
    return mean > 0.0 ? ldexp(1.0, power - 30) : 1.0;
}

/* ---- drawing and densities ---- */

bool kiln_emission_draw(const struct kiln_emission *e, double pick, double u, double v, double s, double t,
                        struct kiln_emitted *ray)
{
    return e->power > 0.0 && kiln_draw_emitted(e, pick, u, v, s, t, ray);
}

double kiln_emission_density(const struct kiln_emission *e, uint32_t light, double cosine, struct kiln_dvec3 direction)
{
    return kiln_emitted_density(e, light, cosine, direction);
}

double kiln_emission_connect(const struct kiln_emission *e, uint32_t light, struct kiln_dvec3 p, struct kiln_dvec3 n,
                             struct kiln_dvec3 place, struct kiln_dvec3 direction)
{
    return kiln_light_connect(e, light, p, n, place, direction);
}

uint32_t kiln_emission_at(const struct kiln_emission *e, uint32_t triangle, double b1, double b2)
{
    return kiln_area_light_at(e->lights, triangle, b1, b2);
}
