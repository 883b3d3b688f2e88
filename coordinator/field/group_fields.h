/* Fields of light groups: rows of a bake's field set that are created for a job, because users name the groups. Each
 * group has these fields, in this order: its direct light, its total light, the radiosity from which a step gathers,
 * and the radiosity that the step makes. */
#ifndef KILN_COORDINATOR_FIELD_GROUP_FIELDS_H
#define KILN_COORDINATOR_FIELD_GROUP_FIELDS_H

#include "coordinator/field/field.h"

enum kiln_group_field { KILN_GROUP_DIRECT, KILN_GROUP_SUM, KILN_GROUP_SOURCE, KILN_GROUP_NEXT, KILN_GROUP_FIELDS };

/* Makes job->scene.group_rows (owned by the job) from job->scene.group_names. Not collective. KILN_SYSTEM. */
int kiln_group_fields_make(struct kiln_job *job, struct kiln_error *error);
/* The index of the first field of group 0; the fields of the next groups follow. set->count: the bake has no groups. */
size_t kiln_group_fields_first(const struct kiln_field_set *set);

/* Finds the row, with its range, for a group's channel or dataset of this name; NULL: the name belongs to no group. A
 * group called "normal" has "group.normal.B" and "/groups/normal", which are light. */
const struct kiln_field *kiln_group_field_named(const char *name);

/* Files of the layers of groups. Up to KILN_GROUPS_IN_MAP groups are in lightmaps/OBJECT.exr; if there are more, they
 * are in lightmaps/groups-N/OBJECT.exr, with KILN_GROUPS_A_FILE groups each. The functions return the number of such
 * files of a lightmap, and the folder of the n-th. */
enum { KILN_GROUPS_IN_MAP = 16, KILN_GROUPS_A_FILE = 64, KILN_GROUP_FOLDER = 40 };
static inline size_t kiln_group_files(size_t groups)
{
    return groups > KILN_GROUPS_IN_MAP ? (groups + KILN_GROUPS_A_FILE - 1) / KILN_GROUPS_A_FILE : 0;
}
void kiln_group_folder(size_t n, char folder[KILN_GROUP_FOLDER]);

#endif
