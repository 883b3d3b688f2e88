/* Which planes of floats a lightmap on its way to a file has: one for each component of each field that is published in
 * lightmaps, in the order of the bake's field set. Pure functions of that set. */
#ifndef KILN_COORDINATOR_OUTPUT_MAP_LAYERS_H
#define KILN_COORDINATOR_OUTPUT_MAP_LAYERS_H

#include "coordinator/field/field.h"
#include "coordinator/output/map/map.h"

struct kiln_layers {
    size_t count;
    struct kiln_layer {
        size_t field;   /* its place in the field set */
        uint32_t plane; /* the first of its components' */
    } layer[KILN_FIELDS_MAX];
    struct kiln_map_planes planes;
};

/* The layers of direct and indirect light and of the error come first, also where the last is not published: filling,
 * seams and reports read them (map.h). Sums of fields have no planes of their own. KILN_BUG when the set lacks one of
 * these three, or needs more planes than a map can have. */
int kiln_layers_make(struct kiln_layers *layers, const struct kiln_field_set *fields, struct kiln_error *error);

#endif
