/* Applies the settings for single objects (coordinator/job/object_settings.h) to the scene under construction. */
#ifndef KILN_COORDINATOR_IMPORT_SETTINGS_H
#define KILN_COORDINATOR_IMPORT_SETTINGS_H

#include "coordinator/scene/builder.h"

/* Applies the rules (NULL or "": none) to the builder's objects, then carries out all settings: removes excluded
 * objects and the coarser levels of detail of the remaining ones (lods.h), and sets KILN_OBJECT_*. Notes report
 * patterns without a match, and removed objects. */
int kiln_object_settings_apply(struct kiln_builder *builder, const char *rules, struct kiln_error *error);

#endif
