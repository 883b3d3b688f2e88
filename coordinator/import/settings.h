/* Settings of single objects (coordinator/job/object_settings.h), applied to the scene that is being put together. */
#ifndef KILN_COORDINATOR_IMPORT_SETTINGS_H
#define KILN_COORDINATOR_IMPORT_SETTINGS_H

#include "coordinator/scene/builder.h"

/* Applies rules (NULL or "": none) to the builder's objects, then does what the settings say: removes excluded objects,
 * sets KILN_OBJECT_*. Notes tell of patterns that match nothing and of objects left out. */
int kiln_object_settings_apply(struct kiln_builder *builder, const char *rules, struct kiln_error *error);

#endif
