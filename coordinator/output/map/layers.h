/* Layers of a map: assigns planes of floats to the fields that lightmaps contain, one plane for each component, in the
 * order of the bake's field set. Depends on that set only; not collective. */
#ifndef KILN_COORDINATOR_OUTPUT_MAP_LAYERS_H
#define KILN_COORDINATOR_OUTPUT_MAP_LAYERS_H

#include "coordinator/field/field.h"
#include "coordinator/output/map/map.h"

/* Fields that a stage names (stage.h), and where the plane of its optional one stands; stages of a table at most. */
enum { KILN_MAP_STAGE_FIELDS = 4, KILN_MAP_IF_ANY = KILN_MAP_STAGE_FIELDS, KILN_MAP_STAGES_MAX = 16 };

struct kiln_layers {
    size_t count;
    struct kiln_layer {
        size_t field;   /* index in the field set */
        uint32_t plane; /* plane of its first component */
    } layer[KILN_FIELDS_MAX];
    uint32_t position, normal; /* first of 3 planes each, as enum kiln_map_feature says (stage.h); 0: not there */
    struct kiln_map_planes planes;
    /* first planes of the fields that each stage of the table names, in the order of its row; KILN_MAP_PLANES_MAX of an
     * optional field that the bake does not have */
    uint32_t reads[KILN_MAP_STAGES_MAX][KILN_MAP_STAGE_FIELDS + 1];
};

/* Lists the layers. Direct light, indirect light and the error come first, even if the error is not published, since
 * filling, seams and reports use them (map.h). Fields that are sums have no planes. KILN_BUG if the set lacks one of
 * these three, or needs more planes than a map can have. */
int kiln_layers_make(struct kiln_layers *layers, const struct kiln_field_set *fields, struct kiln_error *error);

/* Adds what a stage reads besides (stage.h), unless it is there: a field of points, which the lightmap does not
 * publish; three planes. `plane` becomes the first of them. KILN_BUG if the set has no such field of numbers, or if a
 * map cannot have so many planes. */
int kiln_layers_add_field(struct kiln_layers *layers, const struct kiln_field_set *fields, const char *name,
                          uint32_t *plane, struct kiln_error *error);
int kiln_layers_add_vector(struct kiln_layers *layers, uint32_t *plane, struct kiln_error *error);
/* The first plane of a field of the set, by its index; KILN_MAP_PLANES_MAX if it has none. */
uint32_t kiln_layers_plane(const struct kiln_layers *layers, size_t field);

#endif
