/* Groups of lights. Each light of a scene is in one group, and the light of each group is baked apart. Emitting objects
 * may be cut into blocks, and the sky into patches (sky_patches.h); each block or patch is a group. Read-only after
 * creation; users borrow it. */
#ifndef KILN_WORKER_LIGHT_LIGHT_GROUPS_H
#define KILN_WORKER_LIGHT_LIGHT_GROUPS_H

#include "shaders/shared/area_light.h"
#include "worker/light/lights.h"
#include "worker/light/sky_patches.h"

/* Block coordinates of an emitting triangle: column and row as linear functions over it. Columns go along u, rows along
 * v of the emitting object. */
struct kiln_light_block {
    uint32_t columns, rows; /* number; columns 0: not cut into blocks */
    double at[2];           /* column and row at corner 0 */
    double along[2][2];     /* their increments towards corners 1 and 2 of the world triangle */
};

struct kiln_light_groups {
    uint32_t count;
    uint32_t *of_tree;        /* group of each light of the tree, numbered as kiln_light_sample.light */
    uint32_t *of_directional; /* of each directional light */
    uint32_t of_environment;  /* group; first patch (kiln_sky_patch) if sky_divisions > 0; the ground is last */
    uint32_t sky_divisions;
    struct kiln_light_block *block_of; /* by emitting triangle, whose group is that of block 0; NULL: no blocks */
};

/* Block number of a place on an emitting triangle, within its group. */
static inline uint32_t kiln_light_block(const struct kiln_light_block *b, const struct kiln_area_light *light,
                                        struct kiln_dvec3 place)
{
    double b1, b2;
    uint32_t at[2];
    const uint32_t most[2] = {b->columns, b->rows};
    kiln_triangle_weights(light->e1, light->e2, dvec3_sub(place, light->p0), &b1, &b2);
    for (int k = 0; k < 2; k++) {
        const double on = b->at[k] + b1 * b->along[0][k] + b2 * b->along[1][k];
        at[k] = on > 0.0 ? (uint32_t)fmin(on, most[k] - 1.0) : 0;
    }
    return at[1] * b->columns + at[0];
}

/* Group of the light that a sample of a choice, drawn at `place`, goes to; `light`: kiln_light_sample.light. */
static inline uint32_t kiln_light_group(const struct kiln_light_groups *g, const struct kiln_lights *lights,
                                        const struct kiln_light_choice *choice, uint32_t light, struct kiln_dvec3 place,
                                        struct kiln_dvec3 direction, double distance)
{
    if (choice->kind == KILN_CHOICE_ENVIRONMENT)
        return g->of_environment + (g->sky_divisions > 0 ? kiln_sky_patch(direction, g->sky_divisions) : 0);
    if (choice->kind == KILN_CHOICE_DIRECTIONAL)
        return g->of_directional[choice->index];
    if (g->block_of == NULL || light >= lights->area_count || g->block_of[light].columns == 0)
        return g->of_tree[light];
    return g->of_tree[light] + kiln_light_block(&g->block_of[light], &lights->areas[light],
                                                dvec3_add(place, dvec3_scale(direction, distance)));
}

#endif
