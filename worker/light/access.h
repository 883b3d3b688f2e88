/* Macros and functions in C that shaders/shared/lights.h expects its includer to define. Private to worker/light. */
#ifndef KILN_WORKER_LIGHT_ACCESS_H
#define KILN_WORKER_LIGHT_ACCESS_H

#include "shaders/shared/color.h"
#include "worker/light/lights.h"
#include "worker/light/tree.h"

#define KILN_MAY_BE(kinds) true
#define KILN_SKY_IS_IMAGE(lights) ((lights)->conditional != NULL)
#define KILN_SKY_WIDTH(lights) ((lights)->scene->environment->width)
#define KILN_SKY_HEIGHT(lights) ((lights)->scene->environment->height)
#define KILN_SKY_ROTATION(lights) ((double)(lights)->scene->environment->rotation)
#define KILN_SKY_MARGINAL(lights) ((lights)->marginal)
#define KILN_SKY_CONDITIONAL(lights) ((lights)->conditional)
#define KILN_SKY_COSINE(lights, y) cos(KILN_PI *(y) / (lights)->scene->environment->height)
#define KILN_SKY_BAND(lights, y) (KILN_SKY_COSINE(lights, y) - KILN_SKY_COSINE(lights, (y) + 1))
#define KILN_SUN_LUMINANCE(light) kiln_luminance_of_floats((light)->irradiance)
#define KILN_LIGHT_NODE_IMPORTANCE(lights, index, p, spread, n)                                                        \
    kiln_light_node_importance(&(lights)->nodes[index], p, spread, n)

/* Radiance of an area light at a place; `on`: the place relative to the light's corner 0. */
static inline void kiln_area_light_radiance_on(const struct kiln_lights *lights, const struct kiln_area_light *light,
                                               struct kiln_dvec3 on, float rgb[3])
{
    double b1 = 0.0, b2 = 0.0;
    if (light->textured)
        kiln_triangle_weights(light->e1, light->e2, on, &b1, &b2);
    kiln_area_light_radiance(lights, light, b1, b2, rgb);
}

/* A cut of the light tree: an array of choices that have no samples yet. */
#define KILN_CUT struct kiln_light_choice *
#define KILN_CUT_LIGHT_NODE(cut, i) ((cut)[i].index)
#define KILN_CUT_IMPORTANCE(cut, i) ((cut)[i].importance)
#define KILN_CUT_IS_LEAF(lights, cut, i) ((lights)->nodes[(cut)[i].index].left == KILN_NONE)

static inline void kiln_cut_set(const struct kiln_lights *lights, struct kiln_light_choice *cut, uint32_t i,
                                uint32_t node, double importance)
{
    (void)lights;
    cut[i] = (struct kiln_light_choice){KILN_CHOICE_LIGHT_NODE, node, 0, importance};
}

#include "shaders/shared/lights.h"

#endif
