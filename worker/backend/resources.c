#include "worker/backend/resources.h"

#include <string.h>

#include "worker/backend/api.h"

#define MEMBER(name)                                                                                                   \
    .offset = offsetof(struct kiln_resources, name), .bytes = sizeof((struct kiln_resources *)NULL)->name

const struct kiln_resource kiln_resources[KILN_RESOURCE_COUNT] = {
    [KILN_RESOURCE_surface] = {"the surface", MEMBER(surface)},
    [KILN_RESOURCE_others] = {"tile runs of another rank", MEMBER(others)},
    [KILN_RESOURCE_radiosity] = {"the radiosity of all points", MEMBER(radiosity)},
    [KILN_RESOURCE_probes] = {"radiance probes", MEMBER(probes)},
    [KILN_RESOURCE_light] = {"light that has changed", MEMBER(light)},
    [KILN_RESOURCE_rows] = {"rows of kept rays", MEMBER(rows), .is_filled = true},
    [KILN_RESOURCE_groups] = {"groups of lights", MEMBER(groups), .is_filled = true},
};

bool kiln_resource_is_given(const struct kiln_resources *given, enum kiln_resource_index index)
{
    const void *first;
    memcpy(&first, (const char *)given + kiln_resources[index].offset, sizeof first);
    return first != NULL;
}

int kiln_backend_give(struct kiln_backend *backend, enum kiln_resource_index index, const struct kiln_resources *from,
                      struct kiln_error *error)
{
    const struct kiln_resource *row = &kiln_resources[index];
    struct kiln_resources *given = &backend->given;
    memcpy((char *)given + row->offset, (const char *)from + row->offset, row->bytes);
    if (index == KILN_RESOURCE_surface)
        given->others = (struct kiln_others){.surface = NULL};
    backend->surface = given->others.surface != NULL ? given->others.surface : given->surface;
    return backend->api->set(backend, index, error);
}
