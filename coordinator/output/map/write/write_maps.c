#include "coordinator/output/map/write/writer.h"

#include <string.h>

#include "coordinator/files/publish.h"
#include "coordinator/mpi/agree.h"
#include "coordinator/output/map/bands/strip_exchange.h"
#include "coordinator/output/map/write/stages.h"
#include "worker/base/arena.h"

/* Creates the image of an object and the texts of its file; releases its map. */
static int finish_object(const struct kiln_writer *w, uint32_t object, struct kiln_image **image,
                         struct kiln_file_words *words, struct kiln_error *error)
{
    int status = kiln_writer_complete(w, object, error);
    if (status == KILN_OK)
        status = kiln_writer_image(w, w->works[object].map, image, error);
    kiln_writer_drop(w, object);
    return status == KILN_OK ? kiln_writer_describe(w, object, *image, words, error) : status;
}

static int write_object(const struct kiln_writer *w, uint32_t object, struct kiln_error *error)
{
    if (kiln_stop_asked(w->result->stop))
        return kiln_give_up(error);
    struct kiln_image *image = NULL;
    struct kiln_file_words words;
    int status = finish_object(w, object, &image, &words, error);
    if (status == KILN_OK)
        status = kiln_writer_put_files(w, object, image, &words, error);
    kiln_image_destroy(&image);
    return status;
}

/* The distributed objects of this rank in a round: their images, and files that have been begun. */
struct large {
    struct kiln_strip_source *sources;
    struct kiln_image **images;
    struct kiln_exr_file **files;
    size_t count;
    struct kiln_arena arena;
};

static void destroy_large(struct large *large)
{
    for (size_t i = 0; i < large->count; i++) {
        kiln_exr_file_destroy(&large->files[i]);
        kiln_image_destroy(&large->images[i]);
    }
    kiln_arena_release(&large->arena);
}

/* Finishes the images of large objects one after the other, each with all threads, and begins their files. */
static int begin_large(const struct kiln_writer *w, const uint32_t *objects, size_t count, struct large *large,
                       struct kiln_error *error)
{
    int status =
        kiln_arena_allocate(&large->arena, &large->sources, count, sizeof *large->sources, "large lightmaps", error);
    if (status == KILN_OK)
        status = kiln_arena_allocate(&large->arena, &large->images, count, sizeof(struct kiln_image *),
                                     "large lightmaps", error);
    if (status == KILN_OK)
        status = kiln_arena_allocate(&large->arena, &large->files, count, sizeof(struct kiln_exr_file *),
                                     "large lightmaps", error);
    for (size_t i = 0; status == KILN_OK && i < count; i++) {
        struct kiln_file_words words;
        large->count = i + 1;
        status = kiln_stop_asked(w->result->stop) ? kiln_give_up(error)
                                                  : finish_object(w, objects[i], &large->images[i], &words, error);
        if (status == KILN_OK)
            status = kiln_exr_file_create(&large->files[i], w->params->directory, words.name, large->images[i],
                                          words.attributes, words.count, error);
        large->sources[i] =
            (struct kiln_strip_source){.object = objects[i], .image = large->images[i], .file = large->files[i]};
    }
    return status;
}

/* Begins a map with a stage that may take long. */
static int begin_large_map(const struct kiln_writer *w, uint32_t object, struct kiln_error *error)
{
    return kiln_stop_asked(w->result->stop) ? kiln_give_up(error) : kiln_writer_begin(w, object, error);
}

/* Runs the stages that may take long, map after map, each with all threads, before the files are made: a map worked on
 * together with others gets threads only in proportion to its texels. */
static int run_long(const struct kiln_writer *w, const uint32_t *own, size_t count, struct kiln_error *error)
{
    enum { LEAST = 1 << 15 }; /* texels of such a map */
    size_t large = 0;
    while (large < count && kiln_writer_texels(w, own + large, 1) >= LEAST)
        large++; /* the largest come first */
    int status = kiln_writer_run_some(w, own, large, begin_large_map, error);
    for (size_t i = 0; i < large && status == KILN_OK; i++)
        status = kiln_stop_asked(w->result->stop) ? kiln_give_up(error)
                                                  : kiln_map_stages_run_long(kiln_map_stages, &w->works[own[i]], error);
    return status;
}

/* Writes the objects of a round, in batches whose files are published together. */
static int write_round(struct kiln_writer *w, const uint32_t *own, size_t count, struct kiln_error *error)
{
    enum { AT_ONCE = 1024 };
    int status = KILN_OK;
    if (count > 1)
        KILN_TRY(run_long(w, own, count, error));
    if (count > 0)
        KILN_TRY(kiln_publish_batch_create(&w->batch, error));
    for (size_t first = 0; first < count; first += AT_ONCE) {
        const size_t some = count - first < AT_ONCE ? count - first : AT_ONCE;
        KILN_TRY(kiln_writer_run_some(w, own + first, some, write_object, error));
        KILN_TRY(kiln_publish_batch_finish(w->batch, error));
    }
end:
    kiln_publish_batch_destroy(&w->batch);
    return status;
}

/* Moves own objects of the round whose strips are distributed to the front of `own`, in order. Returns their number. */
static size_t sort_large(const struct kiln_strip_assignment *strips, uint32_t *own, size_t count)
{
    size_t large = 0;
    for (size_t i = 0; i < count; i++) {
        const uint32_t object = own[i];
        if (!kiln_strip_assignment_has(strips, object))
            continue;
        memmove(own + large + 1, own + large, (i - large) * sizeof *own);
        own[large++] = object;
    }
    return large;
}

/* Collective. Writes the file of an object in bands. */
static int write_bands(const struct kiln_writer *w, const struct kiln_assignment *assignment, uint32_t object,
                       struct kiln_error *error)
{
    const MPI_Comm comm = w->result->communicator;
    struct kiln_map_work *work = &w->works[object];
    struct kiln_image *image = NULL;
    struct kiln_file_words words;
    int status;
    KILN_TRY(kiln_agree(comm, kiln_stop_asked(w->result->stop) ? kiln_give_up(error) : KILN_OK, error));
    KILN_TRY(work->joined != NULL ? kiln_writer_complete(w, object, error)
                                  : kiln_writer_solve_alone(w, assignment, object, error));
    KILN_TRY(kiln_agree(comm, kiln_writer_image(w, work->map, &image, error), error));
end:
    kiln_writer_drop(w, object);
    if (status == KILN_OK)
        status = kiln_agree(comm, kiln_writer_describe(w, object, image, &words, error), error);
    if (status == KILN_OK)
        status = kiln_writer_put_files(w, object, image, &words, error);
    kiln_image_destroy(&image);
    if (w->rank != 0) /* the report is complete on all ranks; only rank 0 prints it */
        *work->report = (struct kiln_lightmap_report){0};
    return status;
}

/* Collective. Writes the objects of a round in bands, one after the other. */
static int write_all_bands(const struct kiln_writer *w, const struct kiln_assignment *assignment, const uint32_t *own,
                           size_t count, struct kiln_error *error)
{
    int status = KILN_OK;
    for (size_t i = 0; i < count && status == KILN_OK; i++)
        status = write_bands(w, assignment, own[i], error);
    return status;
}

int kiln_writer_write(struct kiln_writer *w, const struct kiln_assignment *assignment, uint32_t round, uint32_t *own,
                      size_t count, struct kiln_error *error)
{
    const MPI_Comm comm = w->result->communicator;
    const struct kiln_lightmap *lightmaps = w->result->surface->lightmaps;
    struct kiln_strip_assignment *strips = NULL;
    if (round >= assignment->own_rounds)
        return write_all_bands(w, assignment, own, count, error);
    struct large large = {0};
    /* strips have room for the few channels of one file; layers of groups are packed by the rank that has the map */
    const bool wide = kiln_field_set_channels(w->result->fields) + 2 > KILN_EXR_CHANNELS;
    const uint64_t least = wide                           ? UINT64_MAX
                           : w->params->least_divided > 0 ? w->params->least_divided
                                                          : KILN_STRIPS_LEAST;
    int status = kiln_strip_assignment_create(&strips, lightmaps, assignment, round, w->ranks, least, error);
    if (status == KILN_OK) {
        const size_t first_small = sort_large(strips, own, count);
        status = write_round(w, own + first_small, count - first_small, error);
        if (status == KILN_OK)
            status = begin_large(w, own, first_small, &large, error);
    }
    status = kiln_agree(comm, status, error);
    if (status == KILN_OK)
        status = kiln_strips_write(comm, strips, lightmaps, large.sources, large.count, w->params->faults, error);
    destroy_large(&large);
    kiln_strip_assignment_destroy(&strips);
    return status;
}
