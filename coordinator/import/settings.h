/* Applies the settings for single objects (coordinator/job/object_settings.h) to the scene under construction. */
#ifndef KILN_COORDINATOR_IMPORT_SETTINGS_H
#define KILN_COORDINATOR_IMPORT_SETTINGS_H

#include "coordinator/scene/builder.h"

/* Applies the rules (NULL or "": none) to the builder's objects, then carries out all settings: removes excluded
 * objects, and lower levels of detail of what is left (lods.h), and sets KILN_OBJECT_*. Notes report patterns that
 * match nothing, and what is removed. */
int kiln_object_settings_apply(struct kiln_builder *builder, const char *rules, struct kiln_error *error);

#endif
