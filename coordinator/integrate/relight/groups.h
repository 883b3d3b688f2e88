/* The light of groups of lights (--light-groups), solved beside the light of all by the same steps and rays
 * (worker/pass/groups.h). Each group has a direct light, a sum and a radiosity as the whole bake has
 * (field/group_fields.h), and the integrator takes its answers in the same way. All that is done to light is linear, so
 * the groups add up to the bake but for rounding: of radiosity, which goes in 8 bytes and by chance, and of sums. In
 * the end a group's sum is its light, direct and indirect. */
#ifndef KILN_COORDINATOR_INTEGRATE_RELIGHT_GROUPS_H
#define KILN_COORDINATOR_INTEGRATE_RELIGHT_GROUPS_H

#include "coordinator/integrate/integrate.h"

struct kiln_group_light;

/* Collective. Of params->groups, which the backend is given; needs the own data. KILN_SYSTEM. Destroy with
 * kiln_group_light_destroy. */
int kiln_group_light_create(struct kiln_group_light **light, const struct kiln_integrate_params *params,
                            struct kiln_solution *solution, struct kiln_error *error);
void kiln_group_light_destroy(struct kiln_group_light **light);

/* Takes over what the groups have answered of a tile run; `results` are those of the whole light. NULL: nothing. */
void kiln_group_light_take(const struct kiln_group_light *light, const struct kiln_taking *taking,
                           const struct kiln_rank_data *data, const struct kiln_tile_run *tile_run,
                           const void *results);
/* Collective, when all light is computed. What the probe pass reads of groups is all light that each sends; the backend
 * has them until the light is destroyed. */
struct kiln_groups *kiln_group_light_total(struct kiln_group_light *light);
/* Collective. What is gathered from is what the last step has made, or after a restart what was gathered from. */
void kiln_group_light_exchange(struct kiln_group_light *light, bool restored);
/* Calls `change` for each group with the own data, whose direct, sum and next are the group's. */
void kiln_group_light_each(const struct kiln_group_light *light, void (*change)(const struct kiln_rank_data *own));
/* Adds, for each group, `factor` times the radiosity of the last step to the sums of `count` own points. */
void kiln_group_light_extend(const struct kiln_group_light *light, struct kiln_own_point first, uint64_t count,
                             const float factor[3]);

#endif
