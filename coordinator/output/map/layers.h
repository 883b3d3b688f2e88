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
    struct kiln_map_planes planes;
};

/* Lists the layers. Direct light, indirect light and the error come first, even if the error is not published, since
 * filling, seams and reports use them (map.h). Fields that are sums have no planes. KILN_BUG if the set lacks one of
 * these three, or needs more planes than a map can have. */
int kiln_layers_make(struct kiln_layers *layers, const struct kiln_field_set *fields, struct kiln_error *error);

#endif
