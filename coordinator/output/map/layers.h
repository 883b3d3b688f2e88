/* Layers of a map: assigns planes of floats to the fields that lightmaps contain, one plane for each component, in the
 * order of the bake's field set. Depends on that set only; not collective. */
#ifndef KILN_COORDINATOR_OUTPUT_MAP_LAYERS_H
#define KILN_COORDINATOR_OUTPUT_MAP_LAYERS_H

#include "coordinator/field/field.h"
#include "coordinator/output/map/map.h"

struct kiln_layers {
    size_t count;
    struct kiln_layer {
        size_t field;   /* index in the field set */
        uint32_t plane; /* plane of its first component */
    } layer[KILN_FIELDS_MAX];
    uint32_t position, normal; /* first of 3 planes each, as enum kiln_map_feature says (stage.h); 0: not there */
    struct kiln_map_planes planes;
};

/* Lists the layers. Direct light, indirect light and the error come first, even if the error is not published, since
 * filling, seams and reports use them (map.h). Fields that are sums have no planes. KILN_BUG if the set lacks one of
 * these three, or needs more planes than a map can have. */
int kiln_layers_make(struct kiln_layers *layers, const struct kiln_field_set *fields, struct kiln_error *error);

/* Adds what a stage reads besides (stage.h), unless it is there: a field of points, which the lightmap does not
 * publish; three planes, of which the first is to be `plane`. KILN_BUG if the set has no such field of numbers, or if a
 * map cannot have so many planes. */
int kiln_layers_add_field(struct kiln_layers *layers, const struct kiln_field_set *fields, const char *name,
                          struct kiln_error *error);
int kiln_layers_add_vector(struct kiln_layers *layers, uint32_t *plane, struct kiln_error *error);
/* The first plane of the field of that name; KILN_MAP_PLANES_MAX if it has none. */
uint32_t kiln_layers_plane(const struct kiln_layers *layers, const struct kiln_field_set *fields, const char *name);

#endif
