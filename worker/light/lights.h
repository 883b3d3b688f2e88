/* All light sources of a scene, and choosing among them.
 *
 * Emissive triangles (or their parts, if textures make them uneven), point and spot lights are the leaves of a light
 * tree (Conty Estevez and Kulla, "Importance Sampling of Many Lights with Adaptive Tree Splitting", 2018; bounds as in
 * pbrt-v4 section 12.6). For a shaded point the tree is cut into at most KILN_CUT_MAX clusters by splitting the most
 * important one again and again, while its share of the total importance is at least KILN_CUT_SHARE; directional lights
 * and the environment are choices of their own. Each choice then gets a fixed number of samples, in proportion to its
 * importance, so that the choice of a single light adds no noise. Importance is zero only if the contribution is zero.
 *
 * Lights are built once and only read afterwards: safe to share between threads. Positions are relative to the scene's
 * centre. Radiance in W m-2 sr-1, intensity in W/sr, directional lights in W/m2. */
#ifndef KILN_WORKER_LIGHT_LIGHTS_H
#define KILN_WORKER_LIGHT_LIGHTS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "shaders/shared/area_light.h"
#include "shaders/shared/color.h"
#include "shaders/shared/light_importance.h"
#include "shaders/shared/light_structs.h"
#include "shaders/shared/punctual_light.h"
#include "worker/scene/geometry.h"

/* Bounds of a cluster: where it is, which way it shines, how much. */
struct kiln_light_node {
    struct kiln_dvec3 minimum, maximum;
    struct kiln_dvec3 axis; /* unit */
    double cos_o, cos_e;    /* spread of normals about the axis; emission beyond it */
    /* luminance of radiance x area, or of intensity; divided by a squared distance, it bounds the irradiance */
    double power;
    /* children; a leaf has left == KILN_NONE and right = index of the light (areas first, then points) */
    uint32_t left, right;
    bool two_sided;
};

struct kiln_lights {
    const struct kiln_scene *scene;
    const struct kiln_geometry *geometry;
    size_t area_count, point_count, directional_count;
    size_t triangle_count, textured_count; /* emissive triangles, whose parts the areas are; textured ones of these */
    struct kiln_lamp_textures *textures;   /* of emissive triangles (lamp_textures.h) */
    struct kiln_area_light *areas;         /* ascending by triangle, then by path */
    struct kiln_point_light *points;
    struct kiln_directional_light *directionals;
    size_t node_count;
    struct kiln_light_node *nodes; /* [0] is the root */
    /* environment */
    bool environment;
    float environment_mean[3];     /* mean radiance over the sphere */
    float *marginal, *conditional; /* lat-long: cumulative luminance x sin by row, and within rows; else NULL */
};

/* Borrows scene and geometry. Not collective. Destroy with kiln_lights_destroy. */
int kiln_lights_create(struct kiln_lights **lights, const struct kiln_scene *scene,
                       const struct kiln_geometry *geometry, struct kiln_error *error);
/* As kiln_lights_create, but without emissive triangles. */
int kiln_lights_create_without_areas(struct kiln_lights **lights, const struct kiln_scene *scene,
                                     const struct kiln_geometry *geometry, struct kiln_error *error);
void kiln_lights_destroy(struct kiln_lights **lights);
/* Whether the scene has no light at all. */
bool kiln_lights_are_none(const struct kiln_lights *lights);

/* Choices for points within `spread` metres of p with unit normal n (n = 0: every direction counts, as for a probe or a
 * texel with several normals), in a fixed order. All directional lights are kept, even beyond the size of the cut:
 * `choices` must hold KILN_CUT_MAX + directional_count + 1. Returns the number of choices. */
size_t kiln_lights_choices(const struct kiln_lights *lights, struct kiln_dvec3 p, double spread, struct kiln_dvec3 n,
                           size_t node_limit, struct kiln_light_choice *choices);
/* Shares out `samples` by importance, at least one each; returns the total given (at most samples + count). */
uint32_t kiln_lights_allot(struct kiln_light_choice *choices, size_t count, uint32_t samples);

/* Number of sampling strategies a choice alternates between: its `index`-th sample is number index / strategies of
 * strategy index % strategies. Each strategy needs a sequence of random points of its own: the parity of a Sobol' index
 * is a digit of the point, so one sequence dealt out in turn would give each strategy half of the square. */
uint32_t kiln_lights_strategies(const struct kiln_lights *lights, const struct kiln_light_choice *choice,
                                struct kiln_dvec3 n);

/* Draws the choice's `index`-th sample with random numbers in (0,1): `pick` goes down the tree, u and v over the light.
 * False: the sample brings no light. n as above. `shading`: the shading normal, or n if there is none; directions are
 * on the front side of both normals. */
bool kiln_lights_sample(const struct kiln_lights *lights, const struct kiln_light_choice *choice, uint32_t index,
                        struct kiln_dvec3 p, struct kiln_dvec3 n, struct kiln_dvec3 shading, double pick, double u,
                        double v, struct kiln_light_sample *sample);

/* Radiance at barycentric (b1, b2) of an area light, in its corner order: emission x opacity. */
void kiln_area_light_radiance(const struct kiln_lights *lights, const struct kiln_area_light *light, double b1,
                              double b2, float rgb[3]);

/* Radiance arriving from outside along `direction` (pointing outwards). Zero without an environment. */
void kiln_environment_radiance(const struct kiln_lights *lights, struct kiln_dvec3 direction, float rgb[3]);
/* A direction (outwards) by luminance, and its density per steradian; lat-long and constant alike. */
struct kiln_dvec3 kiln_environment_sample(const struct kiln_lights *lights, double u, double v, double *density);
double kiln_environment_density(const struct kiln_lights *lights, struct kiln_dvec3 direction);

#endif
