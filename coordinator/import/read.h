/* Reads a scene file of any known format into a builder, in this process. It is the first step of the confined child.
 * Fuzzers and tests call it directly. */
#ifndef KILN_COORDINATOR_IMPORT_READ_H
#define KILN_COORDINATOR_IMPORT_READ_H

#include "coordinator/scene/builder.h"
#include "coordinator/import/confine.h"
#include "coordinator/import/import.h"

/* Reads the scene. Chooses the reader by the file's first bytes and its name, replaces the scene's environment by the
 * one that the settings ask for, and applies the per-object settings of the document and the job. `mapped` (may be
 * NULL) is called after each file has been mapped. Layouts are not made here. */
int kiln_import_read(const struct kiln_import_params *params, void (*mapped)(const struct kiln_confine *),
                     struct kiln_builder *builder, struct kiln_error *error);

/* Computes the key of the cache from the sources (path, size, hash), the settings, and `program`, the hash of the
 * importing program. */
void kiln_import_key(const struct kiln_import_params *params, uint64_t program, const struct kiln_source *sources,
                     size_t source_count, const char *strings, uint64_t key[2]);

#endif
