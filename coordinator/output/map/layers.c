#include "coordinator/output/map/layers.h"

#include <assert.h>
#include <string.h>

/* The layers that every map has, with their planes. */
static const struct {
    const char *field;
    uint32_t plane;
} always[] = {{"direct", KILN_MAP_DIRECT}, {"sum", KILN_MAP_INDIRECT}, {"error", KILN_MAP_ERROR}};
enum { ALWAYS = sizeof always / sizeof *always };

static int add_layer(struct kiln_layers *layers, const struct kiln_field_set *fields, size_t field,
                     struct kiln_error *error)
{
    const struct kiln_field *f = fields->entry[field].field;
    const uint32_t first = layers->planes.count;
    if (first + f->components > KILN_MAP_PLANES_MAX)
        return kiln_fail(error, KILN_BUG, "the field '%s' does not fit into a lightmap of at most %d planes", f->name,
                         (int)KILN_MAP_PLANES_MAX);
    layers->layer[layers->count++] = (struct kiln_layer){field, first};
    layers->planes.count += f->components;
    for (uint32_t p = first; p < layers->planes.count; p++)
        layers->planes.smooth[p] = f->smooth;
    layers->planes.direction[first] = f->meaning == KILN_FIELD_DIRECTION;
    return KILN_OK;
}

static bool is_always(const char *name)
{
    for (size_t k = 0; k < ALWAYS; k++)
        if (strcmp(name, always[k].field) == 0)
            return true;
    return false;
}

int kiln_layers_make(struct kiln_layers *layers, const struct kiln_field_set *fields, struct kiln_error *error)
{
    *layers = (struct kiln_layers){.count = 0};
    int status = KILN_OK;
    for (size_t k = 0; k < ALWAYS; k++) {
        const size_t field = kiln_field_set_find(fields, always[k].field);
        if (field == fields->count)
            return kiln_fail(error, KILN_BUG, "a bake has no field '%s', which every lightmap has", always[k].field);
        assert(layers->planes.count == always[k].plane);
        KILN_TRY(add_layer(layers, fields, field, error));
    }
    for (size_t i = 0; i < fields->count; i++) {
        const struct kiln_field *f = fields->entry[i].field;
        if (f->channels != NULL && f->life != KILN_FIELD_SUM && fields->entry[i].in_lightmaps && !is_always(f->name))
            KILN_TRY(add_layer(layers, fields, i, error));
    }
end:
    return status;
}

uint32_t kiln_layers_plane(const struct kiln_layers *layers, size_t field)
{
    for (size_t i = 0; i < layers->count; i++)
        if (layers->layer[i].field == field)
            return layers->layer[i].plane;
    return KILN_MAP_PLANES_MAX;
}

int kiln_layers_add_field(struct kiln_layers *layers, const struct kiln_field_set *fields, const char *name,
                          uint32_t *plane, struct kiln_error *error)
{
    const size_t field = kiln_field_set_find(fields, name);
    *plane = kiln_layers_plane(layers, field);
    if (*plane < KILN_MAP_PLANES_MAX)
        return KILN_OK;
    if (field == fields->count || fields->entry[field].field->dataset == NULL)
        return kiln_fail(error, KILN_BUG, "a stage of lightmaps reads the field '%s', which no point of this bake has",
                         name);
    *plane = layers->planes.count;
    return add_layer(layers, fields, field, error);
}

int kiln_layers_add_vector(struct kiln_layers *layers, uint32_t *plane, struct kiln_error *error)
{
    if (*plane != 0)
        return KILN_OK;
    if (layers->planes.count + 3 > KILN_MAP_PLANES_MAX)
        return kiln_fail(error, KILN_BUG, "the stages of lightmaps need more than %d planes", (int)KILN_MAP_PLANES_MAX);
    *plane = layers->planes.count;
    layers->planes.count += 3;
    return KILN_OK;
}
