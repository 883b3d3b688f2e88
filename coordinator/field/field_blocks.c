#include "coordinator/field/field_blocks.h"

#include <assert.h>
#include <string.h>

#include "worker/base/memory.h"

int kiln_block_insane(const char *name, struct kiln_error *error)
{
    return kiln_fail(
        error, KILN_IO,
        "the checkpoint has values in '%s' that no bake can have; give --no-resume to start from the beginning", name);
}

bool kiln_field_is_saved(const struct kiln_field *field, const struct kiln_save_moment *moment)
{
    switch (field->saved) {
    case KILN_FIELD_NOT_SAVED:
        break;
    case KILN_FIELD_SAVED:
        return true;
    case KILN_FIELD_SAVED_IN_STEP:
        return moment->in_step;
    case KILN_FIELD_SAVED_IN_GATHER:
        return moment->in_step && moment->in_gather;
    }
    return false;
}

/* Whether the field's values take 4 bytes each, in the first half of the array; all of them are finite. */
static bool is_compact(const struct kiln_field *field, const struct kiln_save_moment *moment)
{
    return moment->compact && field->type == KILN_FIELD_RADIOSITY && field->life == KILN_FIELD_STEP;
}

size_t kiln_field_blocks(const struct kiln_field_set *fields, const struct kiln_rank_data *data,
                         const struct kiln_save_moment *moment, struct kiln_block *blocks)
{
    size_t count = 0;
    for (size_t i = 0; i < fields->count; i++) {
        const struct kiln_field *field = fields->entry[i].field;
        if (!kiln_field_is_saved(field, moment))
            continue;
        assert(field->domain == KILN_DOMAIN_POINT && field->length == KILN_FIELD_EACH);
        blocks[count] =
            (struct kiln_block){.first = data->surface.first,
                                .count = data->surface.count,
                                .size = is_compact(field, moment) ? sizeof(uint32_t) : kiln_field_size(field),
                                .data = kiln_rank_field(data, fields, i)};
        (void)strncpy(blocks[count].name, field->name, sizeof blocks[count].name - 1);
        count++;
    }
    return count;
}

static int read_compact(const struct kiln_checkpoint *checkpoint, const struct kiln_field *field,
                        const struct kiln_surface *surface, void *values, struct kiln_error *error)
{
    return kiln_checkpoint_read(checkpoint, field->name, surface->first, surface->count, sizeof(uint32_t), values,
                                error);
}

static int read_block(const struct kiln_checkpoint *checkpoint, const struct kiln_field *field,
                      const struct kiln_surface *surface, void *values, struct kiln_error *error)
{
    const int status = kiln_checkpoint_read(checkpoint, field->name, surface->first, surface->count,
                                            kiln_field_size(field), values, error);
    return status == KILN_OK && !kiln_field_is_sane(field, values, surface->count)
               ? kiln_block_insane(field->name, error)
               : status;
}

/* A field of the surface has values already, which the backend may have taken over. */
static int read_surface_block(const struct kiln_checkpoint *checkpoint, const struct kiln_field *field,
                              const struct kiln_surface *surface, void *values, bool *changed, struct kiln_error *error)
{
    const size_t bytes = (size_t)surface->count * kiln_field_size(field);
    void *found = NULL;
    int status = kiln_allocate(&found, (size_t)surface->count, kiln_field_size(field), "a checkpoint's values", error);
    if (status == KILN_OK)
        status = read_block(checkpoint, field, surface, found, error);
    if (status == KILN_OK && memcmp(found, values, bytes) != 0) {
        memcpy(values, found, bytes);
        *changed = true;
    }
    kiln_free(&found);
    return status;
}

int kiln_field_blocks_read(const struct kiln_checkpoint *checkpoint, const struct kiln_field_set *fields,
                           const struct kiln_rank_data *data, const struct kiln_save_moment *moment,
                           bool *surface_changed, struct kiln_error *error)
{
    int status = KILN_OK;
    *surface_changed = false;
    for (size_t i = 0; i < fields->count && status == KILN_OK; i++) {
        const struct kiln_field *field = fields->entry[i].field;
        void *values = kiln_rank_field(data, fields, i);
        if (!kiln_field_is_saved(field, moment))
            continue;
        if (field->life == KILN_FIELD_SURFACE)
            status = read_surface_block(checkpoint, field, &data->surface, values, surface_changed, error);
        else
            status = is_compact(field, moment) ? read_compact(checkpoint, field, &data->surface, values, error)
                                               : read_block(checkpoint, field, &data->surface, values, error);
    }
    return status;
}
