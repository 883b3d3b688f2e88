/* Shared by the exports of a whole scene (export.c) and of single parts (export_places.c). Private to
 * coordinator/export. */
#ifndef KILN_COORDINATOR_EXPORT_EXPORT_PRIVATE_H
#define KILN_COORDINATOR_EXPORT_EXPORT_PRIVATE_H

#include "coordinator/export/export.h"

/* The plan's entries of an object and of a page (child.h). */
json_t *kiln_export_link_json(const struct kiln_export_params *p, size_t object);
json_t *kiln_export_page_json(const struct kiln_export_params *p, size_t index);

/* Checks the new file's header and length, as readers will. */
int kiln_export_check_written(int file, const char *name, struct kiln_error *error);

#endif
