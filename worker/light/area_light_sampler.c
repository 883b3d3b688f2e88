#include "worker/light/area_light_sampler.h"

#include "shaders/shared/sine.h"
#include "worker/base/clones.h"

bool kiln_area_light_sampler(const struct kiln_lights *lights, const struct kiln_light_choice *choice,
                             struct kiln_dvec3 centre, double spread, struct kiln_area_light_sampler *target)
{
    if (choice->kind != KILN_CHOICE_NODE)
        return false;
    const struct kiln_light_node *node = &lights->nodes[choice->index];
    if (node->left != KILN_NONE || node->right >= lights->area_count)
        return false;
    const struct kiln_area_light *light = &lights->areas[node->right];
    *target = (struct kiln_area_light_sampler){.light = light, .centre = centre, .to0 = dvec3_sub(light->p0, centre)};
    const double side = -dvec3_dot(target->to0, light->normal);
    target->height = light->two_sided ? fabs(side) : side;
    target->towards = side > 0.0 ? dvec3_scale(light->normal, -1.0) : light->normal;
    if (!kiln_target_is_near(target->height, light->rounding, spread))
        return false;
    target->seen = kiln_spherical_triangle_of(target->to0, light->e1, light->e2, light->area, target->height);
    target->spherical = kiln_spherical_triangle_wanted(target->seen);
    return kiln_target_is_apart(target->seen);
}

/* Sine and cosine for angles of a few turns at most; absolute error below 1e-15. By blends, so that lanes go together.
 */
static inline void sine_cosine(double x, double *sine, double *cosine)
{
    const double rounder = 0x1.8p52, quarters = (x * 0.63661977236758134308 + rounder) - rounder;
    const double r = (x - quarters * 1.57079632679489655800) - quarters * 6.12323399573676603587e-17, r2 = r * r;
    const double s = kiln_sine_series(r, r2), c = kiln_cosine_series(r2);
    const double halves = (quarters * 0.5 - 0.25 + rounder) - rounder; /* floor(quarters / 2) */
    const double odd = quarters - 2.0 * halves, half_odd = halves - 2.0 * ((halves * 0.5 - 0.25 + rounder) - rounder);
    const double sign = 1.0 - 2.0 * half_odd;
    *sine = sign * (odd > 0.5 ? c : s);
    *cosine = sign * (odd > 0.5 ? -s : c);
}

static inline double at_most(double x, double most) { return x < most ? x : most; }
static inline double at_least(double x, double least) { return x > least ? x : least; }

/* Lane l's sample, (x, y, z) from the centre, as its own place sees it; `area`: 1 / density of the sample on the light,
 * m2. */
static inline void see_from_place(const struct kiln_area_light_sampler *restrict t,
                                  struct kiln_area_light_samples *restrict s, int l, double x, double y, double z,
                                  double area)
{
    const double fx = s->place[0][l] - t->centre.x, fy = s->place[1][l] - t->centre.y,
                 fz = s->place[2][l] - t->centre.z;
    const double height = t->height - (fx * t->towards.x + fy * t->towards.y + fz * t->towards.z);
    x -= fx, y -= fy, z -= fz;
    /* cosine at the light */
    const double squared = x * x + y * y + z * z, distance = sqrt(squared), seen = height / distance;
    const double weight = seen * area / squared;
    s->to[0][l] = x, s->to[1][l] = y, s->to[2][l] = z;
    s->distance[l] = distance;
    s->weight[l] = weight > 0.0 && weight < 1e300 ? weight : 0.0;
    s->backoff[l] = at_most(0.5 * distance, t->light->rounding / at_least(seen, 1e-6));
}

/* Directions from the centre, as far as the light's plane. */
KILN_CLONES static void sample_spherical(const struct kiln_area_light_sampler *restrict target,
                                         struct kiln_area_light_samples *restrict s)
{
    const struct kiln_spherical_triangle t = target->seen;
    const struct kiln_dvec3 towards = target->towards;
    for (int l = 0; l < KILN_TARGET_LANES; l++) {
        double sine, cosine;
        sine_cosine(0.5 * s->u[l] * t.omega, &sine, &cosine);
        const struct kiln_dvec3 d = kiln_spherical_triangle_turn(t, sine, cosine, s->v[l]);
        const double there = dvec3_dot(d, towards), far = target->height / there;
        see_from_place(target, s, l, far * d.x, far * d.y, far * d.z, far * far * t.omega / there);
    }
}

KILN_CLONES static void sample_flat(const struct kiln_area_light_sampler *restrict t,
                                    struct kiln_area_light_samples *restrict s)
{
    const struct kiln_area_light *light = t->light;
    for (int l = 0; l < KILN_TARGET_LANES; l++) {
        const struct kiln_dvec3 on = kiln_triangle_place(light->e1, light->e2, s->u[l], s->v[l]);
        see_from_place(t, s, l, t->to0.x + on.x, t->to0.y + on.y, t->to0.z + on.z, light->area);
    }
}

/* Where on the light the samples are. */
static void find_weights(const struct kiln_area_light_sampler *t, struct kiln_area_light_samples *s)
{
    for (int l = 0; l < KILN_TARGET_LANES; l++) {
        const struct kiln_dvec3 place = dvec3(s->place[0][l], s->place[1][l], s->place[2][l]),
                                to = dvec3(s->to[0][l], s->to[1][l], s->to[2][l]);
        kiln_triangle_weights(t->light->e1, t->light->e2, dvec3_sub(dvec3_add(to, place), t->light->p0), &s->b1[l],
                              &s->b2[l]);
    }
}

void kiln_area_light_sampler_draw(const struct kiln_area_light_sampler *target, struct kiln_area_light_samples *samples)
{
    if (target->spherical)
        sample_spherical(target, samples);
    else
        sample_flat(target, samples);
    if (target->light->textured)
        find_weights(target, samples);
}
