/* Resources that a backend has while passes run, as one table: the surface, the radiosity of its points, probes, the
 * rows and groups that passes fill beside their results. Backends that stand in front of others (fallback.c, verify.c)
 * walk the table and know no resource by name.
 *
 * A new resource called NAME is: NAME in KILN_RESOURCE_LIST, a member below, a row in resources.c, and a function
 * kiln_backend_set_NAME (backend.h or extended.h). A backend reads it in `given`; where it has to bring it somewhere,
 * its `set` does (api.h). */
#ifndef KILN_WORKER_BACKEND_RESOURCES_H
#define KILN_WORKER_BACKEND_RESOURCES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "worker/base/status.h"

struct kiln_backend;
struct kiln_groups;
struct kiln_lights;
struct kiln_radiance_probes;
struct kiln_rows;
struct kiln_surface;

/* In the order in which they are given to a backend that has none yet. */
#define KILN_RESOURCE_LIST(DO)                                                                                         \
    DO(surface)                                                                                                        \
    DO(others)                                                                                                         \
    DO(radiosity)                                                                                                      \
    DO(probes)                                                                                                         \
    DO(light)                                                                                                          \
    DO(rows)                                                                                                           \
    DO(groups)

#define KILN_RESOURCE_OF(name) KILN_RESOURCE_##name,
enum kiln_resource_index { KILN_RESOURCE_LIST(KILN_RESOURCE_OF) KILN_RESOURCE_COUNT };
#undef KILN_RESOURCE_OF

/* Tile runs of another rank: some of its surface, which has the same map. Zero: none. */
struct kiln_others {
    const struct kiln_surface *surface; /* borrowed; NULL: none */
    size_t first, count;                /* its tile runs */
};

/* Resources that a backend was given last, all borrowed; NULL: nothing yet, or nothing any more. */
struct kiln_resources {
    const struct kiln_surface *surface; /* the own one */
    struct kiln_others others;
    const uint64_t *radiosity;
    const struct kiln_radiance_probes *probes;
    const struct kiln_lights *light; /* those of its parameters, once they have changed in their place */
    struct kiln_rows *rows;
    struct kiln_groups *groups;
};

/* A row of the table. */
struct kiln_resource {
    const char *name;
    size_t offset, bytes; /* of the member of struct kiln_resources, which begins with a pointer */
    bool is_filled;       /* passes leave answers in it: who only checks another backend's results has none of it */
};
extern const struct kiln_resource kiln_resources[KILN_RESOURCE_COUNT];

/* Whether it is there. */
bool kiln_resource_is_given(const struct kiln_resources *given, enum kiln_resource_index index);

/* Gives the backend what `from` has of a resource: NULL takes away what it had. With a surface of its own the tile runs
 * of others go. */
int kiln_backend_give(struct kiln_backend *backend, enum kiln_resource_index index, const struct kiln_resources *from,
                      struct kiln_error *error);

#endif
