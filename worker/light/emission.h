/* Emission sampling: rays by which light paths leave the lights of a scene, and their densities.
 *
 * A light is chosen by its power: emissive triangles, points and spots, directional lights, the environment. Its ray
 * begins evenly over a triangle and leaves by the cosine, evenly over the sphere or a spot's cone from a point, and
 * evenly over a disc as wide as the scene, across the direction, from directional lights and from the environment,
 * whose directions are drawn by luminance.
 *
 * The other way to a light is a sample of the tree of lights (kiln_lights_sample of node 0). kiln_emission_connect
 * returns the density of such a sample, which bidirectional paths need for their weights.
 *
 * Built once and only read afterwards. Pure and thread-safe. */
#ifndef KILN_WORKER_LIGHT_EMISSION_H
#define KILN_WORKER_LIGHT_EMISSION_H

#include "shaders/shared/emitted.h"
#include "worker/base/arena.h"
#include "worker/light/lights.h"

/* Lights are numbered: those of the tree as in struct kiln_light_sample, then directional lights, then the environment.
 */
struct kiln_emission {
    const struct kiln_lights *lights;
    size_t count;
    double *chance; /* of each light to be chosen */
    double *up_to;  /* cumulative chances, each light included */
    double power;   /* W, of all, as luminance */
    struct kiln_dvec3 centre;
    double radius;           /* m: the sphere about the scene */
    uint32_t *parent, *leaf; /* parent of each node of the tree; leaf node of each light of the tree */
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

/* Unit of sums of light paths' contributions, W/(m2 sr): a power of two, 2^-30 of the mean radiance that the scene's
 * surroundings would have if they were white. So sums have about as many powers of two above that mean. */
double kiln_emission_splat_unit(const struct kiln_emission *e);

/* Draws a ray from random numbers in (0, 1). False: it carries no light. */
bool kiln_emission_draw(const struct kiln_emission *e, double pick, double u, double v, double s, double t,
                        struct kiln_emitted *ray);

/* Density of the ray that leaves a place of a light in a direction with this cosine, as in struct kiln_emitted.
 * `direction`: unit, from the light; the density of the environment depends on it. */
double kiln_emission_density(const struct kiln_emission *e, uint32_t light, double cosine, struct kiln_dvec3 direction);

/* Density with which one sample of the lights, for a shaded point p, finds this place of a light: per m2 of a triangle;
 * the chance of a point light; per steradian of the environment; 1 for directional lights, each of which has its own
 * sample. n: normal at p, as for kiln_lights_sample. `place`: on the triangle. `direction`: unit, from the light. */
double kiln_emission_connect(const struct kiln_emission *e, uint32_t light, struct kiln_dvec3 p, struct kiln_dvec3 n,
                             struct kiln_dvec3 place, struct kiln_dvec3 direction);

/* The area light at a place of a world triangle; b1 and b2 are the weights of corners 1 and 2. KILN_NONE: none. */
uint32_t kiln_emission_at(const struct kiln_emission *e, uint32_t triangle, double b1, double b2);

#endif
