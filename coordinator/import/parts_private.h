/* Parts while they are put together (parts_reader.c, parts_append.c, parts_notes.c). Private to coordinator/import. */
#ifndef KILN_COORDINATOR_IMPORT_PARTS_PRIVATE_H
#define KILN_COORDINATOR_IMPORT_PARTS_PRIVATE_H

#include <jansson.h>

#include "coordinator/import/parts.h"

/* A part that is open, with the index of its first element of each kind in the builder. */
struct kiln_open_part {
    const char *name;
    json_t *places; /* of 12 numbers each */
    struct kiln_scene *scene;
    size_t strings, materials, textures, meshes;
};

struct kiln_merger {
    struct kiln_confine *confine;
    struct kiln_builder *builder;
    struct kiln_error *error;
    struct kiln_open_part *parts;
    size_t count;
    uint32_t members, groups; /* numbers of levels of detail that are taken */
    char *text;               /* room for a name */
    size_t text_room;
};

/* Appends what parts have once: names, materials, textures, meshes. */
int kiln_parts_append(struct kiln_merger *m);
/* Appends the objects, lights and cameras of all places. */
int kiln_parts_place(struct kiln_merger *m);
/* Chooses environment and unit, and appends notes: those of the parts, and those on what does not fit together.
 * `asked`: the job names an environment. */
int kiln_parts_settle(struct kiln_merger *m, bool asked);

#endif
