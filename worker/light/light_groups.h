/* Groups of lights: each light of a scene is in one, so that its light can be told from that of the others. Borrowed by
 * those who read it, and not changed. */
#ifndef KILN_WORKER_LIGHT_LIGHT_GROUPS_H
#define KILN_WORKER_LIGHT_LIGHT_GROUPS_H

#include "worker/light/lights.h"

struct kiln_light_groups {
    uint32_t count;
    uint32_t *of_tree;        /* of each light of the tree, areas first, then points: as kiln_light_sample.light */
    uint32_t *of_directional; /* of each directional light */
    uint32_t of_environment;
};

/* The group of a sample of a choice; `light`: kiln_light_sample.light. */
static inline uint32_t kiln_light_group(const struct kiln_light_groups *g, const struct kiln_light_choice *choice,
                                        uint32_t light)
{
    if (choice->kind == KILN_CHOICE_ENVIRONMENT)
        return g->of_environment;
    return choice->kind == KILN_CHOICE_DIRECTIONAL ? g->of_directional[choice->index] : g->of_tree[light];
}

#endif
