/* Light of groups of lights (--light-groups), solved beside the whole light by the same steps and rays
 * (worker/pass/groups.h). Each group has its own direct light, sum and radiosity, like the whole bake
 * (field/group_fields.h), and the integrator handles its answers in the same way. Light transport is linear, so the
 * groups add up to the bake except for rounding: of sums, and of radiosity, which is stochastically rounded to 8 bytes.
 * At the end a group's sum is its light, direct and indirect. */
#ifndef KILN_COORDINATOR_INTEGRATE_RELIGHT_GROUPS_H
#define KILN_COORDINATOR_INTEGRATE_RELIGHT_GROUPS_H

#include "coordinator/integrate/integrate.h"

struct kiln_group_light;

/* Collective. Creates the light of params->groups and passes it to the backend; needs the own data. KILN_SYSTEM.
 * Destroy with kiln_group_light_destroy. */
int kiln_group_light_create(struct kiln_group_light **light, const struct kiln_integrate_params *params,
                            struct kiln_solution *solution, struct kiln_error *error);
void kiln_group_light_destroy(struct kiln_group_light **light);

/* Stores the groups' answers for a tile run; `results` are those of the whole light. NULL: does nothing. */
void kiln_group_light_take(const struct kiln_group_light *light, const struct kiln_taking *taking,
                           const struct kiln_rank_data *data, const struct kiln_tile_run *tile_run,
                           const void *results);
/* Collective, after all light is computed. Makes the groups' radiosity that of all their light, for the probe pass; the
 * backend has it until the light is destroyed. */
struct kiln_groups *kiln_group_light_total(struct kiln_group_light *light);
/* Collective. Exchanges the groups' radiosity to gather from: that made by the last step, or after a restart the
 * restored one. */
void kiln_group_light_exchange(struct kiln_group_light *light, bool restored);
/* Calls `change` for each group, with the own data whose direct, sum and next are the group's. */
void kiln_group_light_each(const struct kiln_group_light *light, void (*change)(const struct kiln_rank_data *own));
/* Adds, for each group, `factor` times the radiosity of the last step to the sums of `count` own points. */
void kiln_group_light_extend(const struct kiln_group_light *light, struct kiln_own_point first, uint64_t count,
                             const float factor[3]);

#endif
