/* The fields of light groups: rows of a bake's field set that are made of a job, because users name them. Each group
 * has its direct light, its light in all, and the radiosity that a step gathers from and makes, in this order. */
#ifndef KILN_COORDINATOR_FIELD_GROUP_FIELDS_H
#define KILN_COORDINATOR_FIELD_GROUP_FIELDS_H

#include "coordinator/field/field.h"

enum kiln_group_field { KILN_GROUP_DIRECT, KILN_GROUP_SUM, KILN_GROUP_SOURCE, KILN_GROUP_NEXT, KILN_GROUP_FIELDS };

/* Makes job->scene.group_rows, which the job owns, of job->scene.group_names. Not collective. KILN_SYSTEM. */
int kiln_group_fields_make(struct kiln_job *job, struct kiln_error *error);
/* The place of the first field of group 0; those of the next groups follow. set->count: the bake has no groups. */
size_t kiln_group_fields_first(const struct kiln_field_set *set);

/* The row that every group has for the channel or dataset of this name, with its range; NULL: it is not of a group. A
 * group called "normal" has "group.normal.B" and "/groups/normal", which are light. */
const struct kiln_field *kiln_group_field_named(const char *name);

/* Layers of groups are in lightmaps/OBJECT.exr, of more groups than so many in lightmaps/groups-N/OBJECT.exr, of
 * KILN_GROUPS_A_FILE groups each. How many such files a lightmap has; the folder of the n-th. */
enum { KILN_GROUPS_IN_MAP = 16, KILN_GROUPS_A_FILE = 64, KILN_GROUP_FOLDER = 40 };
static inline size_t kiln_group_files(size_t groups)
{
    return groups > KILN_GROUPS_IN_MAP ? (groups + KILN_GROUPS_A_FILE - 1) / KILN_GROUPS_A_FILE : 0;
}
void kiln_group_folder(size_t n, char folder[KILN_GROUP_FOLDER]);

#endif
