/* Layers of a map: assigns planes of floats to the fields that lightmaps contain, one plane for each component, in the
 * order of the bake's field set. Depends on that set only; not collective. */
#ifndef KILN_COORDINATOR_OUTPUT_MAP_LAYERS_H
#define KILN_COORDINATOR_OUTPUT_MAP_LAYERS_H

#include "coordinator/field/field.h"
#include "coordinator/output/map/map.h"

/* Number of fields that a stage names (stage.h); index of its optional field's plane; largest number of stages. */
enum { KILN_MAP_STAGE_FIELDS = 4, KILN_MAP_IF_ANY = KILN_MAP_STAGE_FIELDS, KILN_MAP_STAGES_MAX = 16 };

struct kiln_layers {
    size_t count;
    struct kiln_layer {
        size_t field;   /* index in the field set */
        uint32_t plane; /* plane of its first component */
    } layer[KILN_FIELDS_MAX];
    uint32_t position, normal; /* first of 3 planes each, for enum kiln_map_feature (stage.h); 0: absent */
    struct kiln_map_planes planes;
    /* for each stage of the table: first planes of the fields in its row, in order; KILN_MAP_PLANES_MAX for an optional
     * field that the bake lacks */
    uint32_t reads[KILN_MAP_STAGES_MAX][KILN_MAP_STAGE_FIELDS + 1];
};

/* Lists the layers. Direct light, indirect light and the error come first, even if the error is not published, since
 * filling, seams and reports use them (map.h). Fields that are sums have no planes. KILN_BUG if one of these three is
 * missing, or a map cannot have so many planes. */
int kiln_layers_make(struct kiln_layers *layers, const struct kiln_field_set *fields, struct kiln_error *error);

/* Add an additional input of a stage (stage.h), unless it is present: a field of points that the lightmap does not
 * publish, or three planes. *plane becomes its first plane. KILN_BUG if the set has no such field of numbers, or if a
 * map cannot have so many planes. */
int kiln_layers_add_field(struct kiln_layers *layers, const struct kiln_field_set *fields, const char *name,
                          uint32_t *plane, struct kiln_error *error);
int kiln_layers_add_vector(struct kiln_layers *layers, uint32_t *plane, struct kiln_error *error);
/* Returns the first plane of a field, given its index in the set; KILN_MAP_PLANES_MAX if it has none. */
uint32_t kiln_layers_plane(const struct kiln_layers *layers, size_t field);

#endif
