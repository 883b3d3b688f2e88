/* Shared by the exports of a whole scene (export.c) and of single parts (export_places.c). Private to
 * coordinator/export. */
#ifndef KILN_COORDINATOR_EXPORT_EXPORT_PRIVATE_H
#define KILN_COORDINATOR_EXPORT_EXPORT_PRIVATE_H

#include "coordinator/export/export.h"

enum { KILN_EXPORT_NAME = 256 }; /* bytes of a lightmap's path; names in a scene file have at most 200 */

/* The plan's entries of an object and of a page (child.h). */
json_t *kiln_export_link_json(const struct kiln_export_params *p, size_t object);
json_t *kiln_export_page_json(const struct kiln_export_params *p, size_t index);

/* Publishes the file `name` of a directory: `write` writes it to `file`, which is open under the name `temporary`. Its
 * header and length are checked as readers will. KILN_IO, else the status of `write`: nothing is published then. */
int kiln_export_publish(const char *directory, const char *name,
                        int (*write)(void *context, const char *temporary, int file, struct kiln_error *error),
                        void *context, struct kiln_error *error);

#endif
