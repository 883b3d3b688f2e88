/* Applies changes of lights, materials and sky (coordinator/job/changes.h) to the scene under construction. */
#ifndef KILN_COORDINATOR_IMPORT_CHANGES_H
#define KILN_COORDINATOR_IMPORT_CHANGES_H

#include "coordinator/scene/builder.h"

/* `text`: JSON; NULL or "": none. KILN_USAGE for a key that is none, a value out of its range, and a pattern that
 * matches nothing. Of lights and materials, once the scene is read; it checks all keys. */
int kiln_changes_apply(struct kiln_builder *builder, const char *text, struct kiln_error *error);
/* And of the environment, once that is set; its keys have been checked. */
void kiln_changes_apply_environment(struct kiln_builder *builder, const char *text);

#endif
