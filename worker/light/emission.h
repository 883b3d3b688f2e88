/* Where light begins: the rays with which paths of light leave the lights of a scene, and how likely each is.
 *
 * A light is chosen by its power: emissive triangles, points and spots, directional lights, the environment. Its ray
 * begins evenly over a triangle and leaves by the cosine, evenly over the sphere or a spot's cone from a point, and
 * evenly over a disc as wide as the scene, across the direction, from directional lights and from the environment,
 * whose directions are drawn by luminance.
 *
 * The other way to a light is a sample of the tree of lights (kiln_lights_sample of node 0). kiln_emission_connect says
 * how likely that is to find a place, which bidirectional paths weigh against the above.
 *
 * Built once and only read afterwards. Pure and thread-safe. */
#ifndef KILN_WORKER_LIGHT_EMISSION_H
#define KILN_WORKER_LIGHT_EMISSION_H

#include "shaders/shared/emitted.h"
#include "worker/base/arena.h"
#include "worker/light/lights.h"

/* Numbers of lights: the tree's as in struct kiln_light_sample, then the directional ones, then the environment. */
struct kiln_emission {
    const struct kiln_lights *lights;
    size_t count;
    double *chance; /* of each light to be chosen */
    double *up_to;  /* the sum of the chances up to each */
    double power;   /* W, of all, as luminance */
    struct kiln_dvec3 centre;
    double radius;           /* m: the sphere about the scene */
    uint32_t *parent, *leaf; /* of the tree's nodes the parent; of its lights the node */
    struct kiln_arena arena;
};

/* Borrows the lights. Destroy with kiln_emission_destroy. Not collective. KILN_SYSTEM. */
int kiln_emission_create(struct kiln_emission **emission, const struct kiln_lights *lights, struct kiln_error *error);
void kiln_emission_destroy(struct kiln_emission **emission);

/* The number of the light of a directional light, and of the environment. */
static inline uint32_t kiln_emission_directional(const struct kiln_emission *e, size_t directional)
{
    return (uint32_t)(e->lights->area_count + e->lights->point_count + directional);
}
static inline uint32_t kiln_emission_environment(const struct kiln_emission *e)
{
    return kiln_emission_directional(e, e->lights->directional_count);
}

/* The unit of sums of what light's paths bring, W/(m2 sr): a power of two, 30 powers below the mean radiance over what
 * lies about the scene, if it were white, which leaves as many above it for sums. */
double kiln_emission_splat_unit(const struct kiln_emission *e);

/* Draws a ray by random numbers in (0, 1). False: it brings nothing. */
bool kiln_emission_draw(const struct kiln_emission *e, double pick, double u, double v, double s, double t,
                        struct kiln_emitted *ray);

/* The density of the ray that leaves a light's place in a direction with this cosine: as struct kiln_emitted's.
 * `direction`: unit, from the light; of the environment it says which. */
double kiln_emission_density(const struct kiln_emission *e, uint32_t light, double cosine, struct kiln_dvec3 direction);

/* How likely one sample of the lights is to find this place of a light from p: per m2 of a triangle; the chance of a
 * point; per steradian of the environment; 1 of directional lights, each of which has its own sample. n: of p, as
 * kiln_lights_sample is given it. `place`: on the triangle. `direction`: unit, from the light. */
double kiln_emission_connect(const struct kiln_emission *e, uint32_t light, struct kiln_dvec3 p, struct kiln_dvec3 n,
                             struct kiln_dvec3 place, struct kiln_dvec3 direction);

/* The area light at a place of a world triangle, where its corners 1 and 2 have these weights; KILN_NONE: there is
 * none.
 */
uint32_t kiln_emission_at(const struct kiln_emission *e, uint32_t triangle, double b1, double b2);

#endif
