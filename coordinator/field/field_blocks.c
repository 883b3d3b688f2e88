#include "coordinator/field/field_blocks.h"

#include <assert.h>
#include <string.h>

#include "worker/base/memory.h"

int kiln_array_insane(const char *name, struct kiln_error *error)
{
    return kiln_fail(
        error, KILN_IO,
        "the checkpoint has values in '%s' that no bake can have; give --no-resume to start from the beginning", name);
}

static bool is_saved(const struct kiln_field *field, const struct kiln_save_moment *moment)
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

/* Whether the step stores the field in the compact 4-byte form of radiosity, in which every bit pattern is a finite
 * value. */
static bool is_compact(const struct kiln_field *field, const struct kiln_save_moment *moment)
{
    return moment->compact && field->life == KILN_FIELD_STEP && field->type == KILN_FIELD_RADIOSITY;
}

/* Bytes of an item in the field's array. */
static size_t block_size(const struct kiln_field *field, const struct kiln_save_moment *moment)
{
    return is_compact(field, moment) ? field->components * sizeof(uint32_t) : kiln_field_size(field);
}

/* This rank's items of a field's domain, in the global order. */
struct items {
    uint64_t first, count;
};

static struct items items_of(const struct kiln_field *field, const struct kiln_save_moment *moment,
                             const struct kiln_surface *surface)
{
    assert(field->domain == KILN_DOMAIN_POINT || field->domain == KILN_DOMAIN_TILE_RUN);
    return field->domain == KILN_DOMAIN_TILE_RUN ? (struct items){moment->tile_run_first, surface->tile_run_count}
                                                 : (struct items){surface->first.at, surface->count};
}

size_t kiln_field_arrays(const struct kiln_field_set *fields, const struct kiln_rank_data *data,
                         const struct kiln_save_moment *moment, struct kiln_array_range *blocks)
{
    size_t count = 0;
    for (size_t i = 0; i < fields->count; i++) {
        const struct kiln_field *field = fields->entry[i].field;
        if (!is_saved(field, moment))
            continue;
        assert(field->length == KILN_FIELD_EACH);
        const struct items items = items_of(field, moment, &data->surface);
        blocks[count] = (struct kiln_array_range){.first = items.first,
                                                  .count = items.count,
                                                  .size = block_size(field, moment),
                                                  .data = kiln_rank_field(data, fields, i)};
        (void)strncpy(blocks[count].name, field->name, sizeof blocks[count].name - 1);
        count++;
    }
    return count;
}

static int read_block(const struct kiln_checkpoint *checkpoint, const struct kiln_field *field,
                      const struct kiln_save_moment *moment, const struct kiln_surface *surface, void *values,
                      struct kiln_error *error)
{
    const struct items items = items_of(field, moment, surface);
    const int status = kiln_checkpoint_read(checkpoint, field->name, items.first, items.count,
                                            block_size(field, moment), values, error);
    if (status == KILN_IO && field->present != NULL)
        return kiln_fail(error, KILN_BAD_INPUT,
                         "the checkpoint has no '%s', which the options of this bake ask for and those of the earlier "
                         "one did not; repeat the command that it was made with, or give --no-resume to start from the "
                         "beginning",
                         field->name);
    return status == KILN_OK && !is_compact(field, moment) && !kiln_field_is_sane(field, values, items.count)
               ? kiln_array_insane(field->name, error)
               : status;
}

/* Reads a field of the surface. The surface already has values, which the backend may have copied; *changed: they
 * differ from the file's. */
static int read_surface_block(const struct kiln_checkpoint *checkpoint, const struct kiln_field *field,
                              const struct kiln_save_moment *moment, const struct kiln_surface *surface, void *values,
                              bool *changed, struct kiln_error *error)
{
    const size_t bytes = (size_t)surface->count * kiln_field_size(field);
    void *found = NULL;
    int status;
    KILN_TRY(kiln_allocate(&found, (size_t)surface->count, kiln_field_size(field), "a checkpoint's values", error));
    KILN_TRY(read_block(checkpoint, field, moment, surface, found, error));
    if (memcmp(found, values, bytes) != 0) {
        memcpy(values, found, bytes);
        *changed = true;
    }
end:
    kiln_free(&found);
    return status;
}

int kiln_field_arrays_read(const struct kiln_checkpoint *checkpoint, const struct kiln_field_set *fields,
                           const struct kiln_rank_data *data, const struct kiln_save_moment *moment,
                           bool *surface_changed, struct kiln_error *error)
{
    int status = KILN_OK;
    *surface_changed = false;
    for (size_t i = 0; i < fields->count && status == KILN_OK; i++) {
        const struct kiln_field *field = fields->entry[i].field;
        void *values = kiln_rank_field(data, fields, i);
        if (!is_saved(field, moment))
            continue;
        status = field->life == KILN_FIELD_SURFACE
                     ? read_surface_block(checkpoint, field, moment, &data->surface, values, surface_changed, error)
                     : read_block(checkpoint, field, moment, &data->surface, values, error);
    }
    return status;
}
