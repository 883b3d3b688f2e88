/* Table of the resources that a backend uses while passes run: the surface, the radiosity of its points, probes, and
 * the rows and groups that passes fill in addition to their results. Wrappers of other backends (fallback.c, verify.c)
 * loop over the table and know no resource by name.
 *
 * To add a resource called NAME, add: NAME in KILN_RESOURCE_LIST, a member below, a row in resources.c, and a function
 * kiln_backend_set_NAME (backend.h or extended.h). A backend reads it from `given`; if it must be uploaded, the
 * backend's `set` does that (api.h). */
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

/* Resources in the order in which a new backend receives them. */
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

/* Tile runs of another rank: a part of its surface, which has the same map. Zero: none. */
struct kiln_others {
    const struct kiln_surface *surface; /* borrowed; NULL: none */
    size_t first, count;                /* its tile runs */
};

/* Resources that a backend was last given, all borrowed; NULL: none yet, or withdrawn. */
struct kiln_resources {
    const struct kiln_surface *surface; /* this rank's surface */
    struct kiln_others others;
    const uint64_t *radiosity;
    const struct kiln_radiance_probes *probes;
    const struct kiln_lights *light; /* lights of its parameters, once they have been changed in place */
    struct kiln_rows *rows;
    struct kiln_groups *groups;
};

/* A row of the table. */
struct kiln_resource {
    const char *name;
    size_t offset, bytes; /* offset and size of the member of struct kiln_resources, which begins with a pointer */
    bool is_filled;       /* passes write answers to it: backends that only verify others do not get it */
};
extern const struct kiln_resource kiln_resources[KILN_RESOURCE_COUNT];

/* Whether it is there. */
bool kiln_resource_is_given(const struct kiln_resources *given, enum kiln_resource_index index);

/* Gives the backend the resource in `from`; NULL withdraws it. A new surface of its own also withdraws the tile runs of
 * other ranks. */
int kiln_backend_give(struct kiln_backend *backend, enum kiln_resource_index index, const struct kiln_resources *from,
                      struct kiln_error *error);

#endif
