#include "worker/light/area_light_sampler.h"

#include "shaders/shared/sine.h"
#include "worker/base/clones.h"

bool kiln_area_light_sampler(const struct kiln_lights *lights, const struct kiln_light_choice *choice,
                             struct kiln_dvec3 centre, double spread, struct kiln_area_light_sampler *target)
{
    if (choice->kind != KILN_CHOICE_LIGHT_NODE)
        return false;
    const struct kiln_light_node *node = &lights->nodes[choice->index];
    if (node->left != KILN_NONE || node->right >= lights->area_count)
        return false;
    const struct kiln_area_light *light = &lights->areas[node->right];
    if (!kiln_area_is_near(light, centre, spread))
        return false;
    *target = (struct kiln_area_light_sampler){.light = light, .centre = centre};
    target->view = kiln_area_view_of(light, centre);
    return kiln_target_is_apart(target->view.seen);
}

/* Sine and cosine of angles up to a few turns; absolute error below 1e-15. Without branches, for SIMD lanes. */
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

/* Converts lane l's sample `on` the light, relative to the centre, to one seen from the lane's own position. `area`: 1
 * / density of the sample on the light, m2. */
static inline void see_from_place(const struct kiln_area_light_sampler *restrict t,
                                  struct kiln_area_light_samples *restrict s, int l, struct kiln_dvec3 on, double area)
{
    const struct kiln_dvec3 from = dvec3_sub(dvec3(s->place[0][l], s->place[1][l], s->place[2][l]), t->centre);
    struct kiln_dvec3 to;
    double distance, seen;
    const double weight = kiln_area_see(&t->view, on, from, area, &to, &distance, &seen);
    s->to[0][l] = to.x, s->to[1][l] = to.y, s->to[2][l] = to.z;
    s->distance[l] = distance;
    s->weight[l] = weight > 0.0 && weight < 1e300 ? weight : 0.0;
    s->backoff[l] = at_most(0.5 * distance, t->light->rounding / at_least(seen, 1e-6));
}

/* Draws directions from the centre, and intersects them with the light's plane. */
KILN_CLONES static void sample_spherical(const struct kiln_area_light_sampler *restrict target,
                                         struct kiln_area_light_samples *restrict s)
{
    const struct kiln_spherical_triangle t = target->view.seen;
    for (int l = 0; l < KILN_TARGET_LANES; l++) {
        double sine, cosine, area;
        sine_cosine(0.5 * s->u[l] * t.omega, &sine, &cosine);
        const struct kiln_dvec3 on =
            kiln_area_place(&target->view, kiln_spherical_triangle_turn(t, sine, cosine, s->v[l]), &area);
        see_from_place(target, s, l, on, area);
    }
}

KILN_CLONES static void sample_flat(const struct kiln_area_light_sampler *restrict t,
                                    struct kiln_area_light_samples *restrict s)
{
    const struct kiln_area_light *light = t->light;
    for (int l = 0; l < KILN_TARGET_LANES; l++)
        see_from_place(t, s, l, dvec3_add(t->view.to0, kiln_triangle_place(light->e1, light->e2, s->u[l], s->v[l])),
                       light->area);
}

/* Computes the barycentric weights of the samples on the light. */
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
    if (target->view.spherical)
        sample_spherical(target, samples);
    else
        sample_flat(target, samples);
    if (target->light->textured)
        find_weights(target, samples);
}
