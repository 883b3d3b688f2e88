/* Reading a scene file of any known kind into a builder, in this process: what the confined child does first. Fuzzers
 * and tests call it directly. */
#ifndef KILN_COORDINATOR_IMPORT_READ_H
#define KILN_COORDINATOR_IMPORT_READ_H

#include "coordinator/scene/builder.h"
#include "coordinator/import/confine.h"
#include "coordinator/import/import.h"

/* Chooses the reader by the file's first bytes and name, reads, puts the environment that the settings ask for in place
 * of the scene's, and does with single objects what the document and the settings say. `mapped` (may be NULL) is told
 * when another file has been mapped. The layouts are not made yet. */
int kiln_import_read(const struct kiln_import_params *params, void (*mapped)(const struct kiln_confine *),
                     struct kiln_builder *builder, struct kiln_error *error);

/* The key of the cache: sources (path, size, hash), settings, and `program`, the hash of the importing program. */
void kiln_import_key(const struct kiln_import_params *params, uint64_t program, const struct kiln_source *sources,
                     size_t source_count, const char *strings, uint64_t key[2]);

#endif
