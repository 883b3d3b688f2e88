#include "coordinator/output/map/lightmaps.h"

#include <math.h>
#include <omp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "coordinator/field/group_fields.h"
#include "coordinator/mpi/agree.h"
#include "coordinator/output/exr_bands.h"
#include "coordinator/output/map/bands.h"
#include "coordinator/output/map/regression_device.h"
#include "coordinator/output/map/texel_gather.h"
#include "coordinator/output/map/stage.h"
#include "coordinator/output/provenance.h"
#include "coordinator/files/publish.h"
#include "coordinator/output/map/strip_exchange.h"
#include "worker/backend/backend.h"
#include "worker/base/memory.h"

struct writer {
    const struct kiln_bake_result *result;
    const struct kiln_output_params *params;
    struct kiln_layers layers;
    struct kiln_lightmap_report *reports; /* reports of this rank's objects are filled in */
    struct kiln_publish_batch *batch;     /* finished files that have yet to be published */
    /* one for each lightmap; only those of this rank and round have a map, and those that are kept from joining */
    struct kiln_map_work *works;
    struct kiln_joined *joined; /* NULL: no objects touch */
    struct kiln_ghosts *ghosts; /* if objects are denoised that touch */
    int ghost_status;           /* of keeping those that come */
    struct kiln_error ghost_error;
    struct kiln_bands *bands;
    struct kiln_chart_graphs *graphs;      /* of all maps */
    struct kiln_regression_device *device; /* likewise; NULL: there is none */
    bool keeps;                            /* maps of objects that touch stay in memory from joining to writing */
    uint32_t rank, ranks;
    int64_t seed;
    bool has_seed;
};

/* ---- one object's file ---- */

/* The largest value of a colour. Collective for a band's image. */
static int find_most(const struct writer *w, bool bands, const struct kiln_image *image, float *most,
                     struct kiln_error *error)
{
    const size_t count = (size_t)image->width * image->height;
    *most = 0.0f;
    for (size_t c = 0; w->params->half && c < image->channel_count; c++)
        for (size_t i = 0; !image->channels[c].half && i < count; i++)
            *most = fmaxf(*most, fabsf(image->channels[c].values[i]));
    if (bands && MPI_Allreduce(MPI_IN_PLACE, most, 1, MPI_FLOAT, MPI_MAX, w->result->communicator) != MPI_SUCCESS)
        return kiln_fail(error, KILN_RANK_LOST, "MPI failed while all ranks worked on a lightmap");
    return KILN_OK;
}

/* "half" if colours can be stored as halves, else "float" with the reason. */
static const char *choose_precision(const struct kiln_output_params *params, float most)
{
    if (!params->half)
        return "float";
    if (most > KILN_HALF_MAX)
        return "float: a value exceeds 65504, the largest half";
    /* halves lose precision below 2^-14; keep eight octaves below the brightest texel */
    if (most > 0.0f && most < 0x1p-6f)
        return "float: values are too small for half";
    return "half";
}

/* Moves a plane of the map into the image, which then owns it; a band's in a copy of its rows. */
static int move_plane(const struct kiln_map *map, const struct kiln_image *image, const char *name, float **plane,
                      struct kiln_error *error)
{
    float **values = &kiln_image_find(image, name)->values;
    const size_t first = kiln_map_first(map), count = kiln_map_end(map) - first;
    if (map->bands == NULL) {
        *values = *plane;
        *plane = NULL;
        return KILN_OK;
    }
    const int status = kiln_allocate_bare(values, count, sizeof **values, "an image's pixels", error);
#pragma omp parallel for schedule(static) if (status == KILN_OK && count > KILN_IMAGE_ALONE)
    for (size_t i = 0; i < (status == KILN_OK ? count : 0); i++)
        (*values)[i] = (*plane)[first + i];
    kiln_map_free(map, plane, sizeof **plane);
    return status;
}

/* Ratios always fit halves: their precision suffices, and none exceeds the largest half. */
static bool fits_half(const struct kiln_field *field)
{
    return field->unit != NULL && strcmp(field->unit, "1") == 0 && fmax(-field->low, field->high) <= KILN_HALF_MAX;
}

/* Creates an image with the channels of all fields in lightmaps, without values. */
static int make_channels(const struct writer *w, const struct kiln_map *map, struct kiln_image **image,
                         struct kiln_error *error)
{
    const struct kiln_field_set *fields = w->result->fields;
    const char **names = NULL;
    size_t count = 2;
    int status = kiln_allocate(&names, kiln_field_set_channels(fields) + count, sizeof *names, "channels", error);
    if (status != KILN_OK)
        return status;
    names[0] = "coverage.Y";
    names[1] = "validity.Y";
    for (size_t i = 0; i < fields->count; i++)
        for (uint32_t c = 0; fields->entry[i].in_lightmaps && c < fields->entry[i].field->components; c++)
            names[count++] = fields->entry[i].field->channels[c];
    status = kiln_image_create_empty(image, map->width, kiln_map_rows(map), names, count, error);
    kiln_free(&names);
    for (size_t i = 0; status == KILN_OK && i < fields->count; i++)
        for (uint32_t c = 0; fields->entry[i].in_lightmaps && c < fields->entry[i].field->components; c++)
            kiln_image_find(*image, fields->entry[i].field->channels[c])->half =
                w->params->half && fits_half(fields->entry[i].field);
    return status;
}

/* Computes a field that is a sum of other fields, from their final channels, which are filled and smoothed. */
static void add_terms(const struct kiln_image *image, const struct kiln_field_set *fields, size_t index)
{
    const struct kiln_field_entry *entry = &fields->entry[index];
    const size_t count = (size_t)image->width * image->height;
    for (uint32_t c = 0; c < entry->field->components; c++) {
        const float *of[KILN_FIELD_TERMS] = {NULL};
        for (size_t k = 0; k < entry->term_count; k++)
            of[k] = kiln_image_find(image, fields->entry[entry->terms[k]].field->channels[c])->values;
        float *total = kiln_image_find(image, entry->field->channels[c])->values;
#pragma omp parallel for schedule(static) if (count > KILN_IMAGE_ALONE)
        for (size_t i = 0; i < count; i++)
            total[i] = of[0][i] + of[1][i] + (of[2] != NULL ? of[2][i] : 0.0f);
    }
}

/* Room for the channels that are computed of others: each of their values is. */
static int make_room(const struct kiln_image *image, struct kiln_error *error)
{
    int status = KILN_OK;
    for (size_t c = 0; c < image->channel_count && status == KILN_OK; c++)
        if (image->channels[c].values == NULL)
            status = kiln_allocate_bare(&image->channels[c].values, (size_t)image->width * image->height, sizeof(float),
                                        "an image's pixels", error);
    return status;
}

/* Creates an image with the channels of the file from the planes of the map. */
static int make_image(const struct writer *w, struct kiln_map *map, struct kiln_image **image, struct kiln_error *error)
{
    const struct kiln_field_set *fields = w->result->fields;
    int status = make_channels(w, map, image, error);
    if (status != KILN_OK)
        return status;
    for (size_t i = 0; i < w->layers.count; i++) {
        const struct kiln_layer *layer = &w->layers.layer[i];
        const struct kiln_field *field = fields->entry[layer->field].field;
        for (uint32_t c = 0; status == KILN_OK && fields->entry[layer->field].in_lightmaps && c < field->components;
             c++)
            status = move_plane(map, *image, field->channels[c], &map->planes[layer->plane + c], error);
    }
    if (status == KILN_OK)
        status = move_plane(map, *image, "coverage.Y", &map->coverage, error);
    if (status == KILN_OK)
        status = make_room(*image, error);
    if (status != KILN_OK)
        return status;
    for (size_t i = 0; i < fields->count; i++)
        if (fields->entry[i].field->life == KILN_FIELD_SUM && fields->entry[i].in_lightmaps)
            add_terms(*image, fields, i);
    struct kiln_image_channel *validity = kiln_image_find(*image, "validity.Y");
    const size_t first = kiln_map_first(map), count = kiln_map_end(map) - first;
    kiln_image_find(*image, "coverage.Y")->half = validity->half = true;
#pragma omp parallel for schedule(static) if (count > KILN_IMAGE_ALONE)
    for (size_t i = 0; i < count; i++)
        validity->values[i] = 0.5f * (float)map->state[first + i];
    return KILN_OK;
}

enum { ATTRIBUTES = 15 }; /* attributes of every file; the last only if the seed is known */

/* Name of an object's file, and texts of its attributes. */
struct file_words {
    char name[KILN_PATH_SIZE], seed[32];
    struct kiln_exr_attribute attributes[ATTRIBUTES + KILN_FIELDS_ALWAYS];
    size_t count;
};

/* Collects the descriptions of layers that have one. */
static void describe_layers(const struct kiln_field_set *fields, struct file_words *words)
{
    for (size_t i = 0; i < fields->count; i++)
        if (fields->entry[i].in_lightmaps && fields->entry[i].field->attribute != NULL)
            words->attributes[words->count++] =
                (struct kiln_exr_attribute){.name = fields->entry[i].field->attribute,
                                            .kind = KILN_EXR_STRING,
                                            .text = fields->entry[i].field->description};
}

static int name_file(const struct writer *w, uint32_t object, struct file_words *words, struct kiln_error *error)
{
    const struct kiln_object *o = &w->result->scene->objects[kiln_map_object(w->result->surface, object)];
    const int length = snprintf(words->name, sizeof words->name, "lightmaps/%s%s.exr",
                                kiln_map_back(w->result->surface, object) ? "back/" : "",
                                kiln_scene_string(w->result->scene, o->name));
    if (length <= 0 || length >= KILN_PATH_SIZE)
        return kiln_fail(error, KILN_CANNOT_CREATE, "object %u has too long a name for a file", object);
    return KILN_OK;
}

static int integer_of(uint64_t number) { return (int)(number > INT32_MAX ? INT32_MAX : number); }

/* Fills in name and attributes of the file, and chooses the precision of the image's channels. */
static int describe_file(const struct writer *w, uint32_t object, struct kiln_image *image, struct file_words *words,
                         struct kiln_error *error)
{
    const struct kiln_scene *scene = w->result->scene;
    const struct kiln_object *o = &scene->objects[kiln_map_object(w->result->surface, object)];
    const struct kiln_mesh *mesh = &scene->meshes[o->mesh];
    float most = 0.0f;
    const int status = find_most(w, w->works[object].in_bands, image, &most, error);
    if (status != KILN_OK)
        return status;
    const char *precision = choose_precision(w->params, most);
    for (size_t c = 0; strcmp(precision, "half") == 0 && c < image->channel_count; c++)
        image->channels[c].half = true;
    const struct kiln_lightmap_report *report = &w->reports[object];
    const double asked = (double)scene->header->texels_per_metre, density = report->texels_per_metre;
    words->seed[0] = '\0';
    if (w->has_seed)
        (void)snprintf(words->seed, sizeof words->seed, "%lld", (long long)w->seed);
    const struct kiln_exr_attribute attributes[ATTRIBUTES] = {
        {.name = "kiln:version", .kind = KILN_EXR_STRING, .text = KILN_VERSION},
        {.name = "kiln:quantity",
         .kind = KILN_EXR_STRING,
         .text = kiln_field_set_find(w->result->fields, "caustic") < w->result->fields->count
                     ? "irradiance about the shading normal; R G B = direct + indirect + caustic"
                     : "irradiance about the shading normal; R G B = direct + indirect"},
        {.name = "kiln:units", .kind = KILN_EXR_STRING, .text = w->result->units->irradiance},
        {.name = "kiln:object", .kind = KILN_EXR_STRING, .text = kiln_scene_string(scene, o->name)},
        {.name = "kiln:originalName", .kind = KILN_EXR_STRING, .text = kiln_scene_string(scene, o->original_name)},
        {.name = "kiln:mesh", .kind = KILN_EXR_STRING, .text = kiln_scene_string(scene, mesh->name)},
        {.name = "kiln:uvSet",
         .kind = KILN_EXR_STRING,
         .text = (mesh->flags & KILN_MESH_REPACKED) != 0
                     ? "the charts of the mesh's second UV set in kiln's own layout; top row is v = 0"
                 : (mesh->flags & KILN_MESH_UNWRAPPED) != 0 ? "kiln's own layout; top row is v = 0"
                                                            : "the mesh's second UV set; top row is v = 0"},
        {.name = "kiln:precision", .kind = KILN_EXR_STRING, .text = precision},
        {.name = "kiln:texelsPerMetre", .kind = KILN_EXR_FLOAT, .number = (float)density},
        {.name = "kiln:capped",
         .kind = KILN_EXR_INTEGER,
         .integer = asked > 0.0 && density > 0.0 && density < 0.9 * asked},
        {.name = "kiln:validTexels", .kind = KILN_EXR_INTEGER, .integer = integer_of(report->valid)},
        {.name = "kiln:filledTexels", .kind = KILN_EXR_INTEGER, .integer = integer_of(report->filled)},
        {.name = "kiln:seams", .kind = KILN_EXR_STRING, .text = w->params->stitch ? "smoothed" : "as gathered"},
        {.name = "kiln:denoise", .kind = KILN_EXR_STRING, .text = w->params->denoise ? "regression" : "none"},
        {.name = "kiln:seed",
         .kind = KILN_EXR_STRING,
         .text = words->seed}, /* last, since it is left out if it is unknown */
    };
    memcpy(words->attributes, attributes, sizeof attributes);
    words->count = w->has_seed ? ATTRIBUTES : ATTRIBUTES - 1;
    describe_layers(w->result->fields, words);
    return name_file(w, object, words, error);
}

/* The covered texels of the map's rows. */
static uint64_t count_covered(const struct kiln_surface *surface, uint32_t object, const struct kiln_map *map)
{
    enum { ROWS = 8 }; /* of a tile: a band begins with one */
    const struct kiln_lightmap *lightmap = &surface->lightmaps[object];
    const uint64_t first = map->first_row / ROWS, end = (map->end_row + ROWS - 1) / ROWS;
    uint64_t covered = 0;
    for (uint64_t t = first * lightmap->tiles_x; t < end * lightmap->tiles_x; t++)
        covered += (uint64_t)__builtin_popcountll(surface->tiles[lightmap->tile_first + t].mask);
    return covered;
}

/* Whether all points of the object have arrived. */
static int check_arrived(const struct writer *w, uint32_t object, struct kiln_error *error)
{
    const struct kiln_map *map = w->works[object].map;
    const uint64_t covered = count_covered(w->result->surface, object, map);
    uint64_t arrived = 0;
#pragma omp parallel for schedule(static) reduction(+ : arrived) if (kiln_map_texels(map) > KILN_IMAGE_ALONE)
    for (size_t i = kiln_map_first(map); i < kiln_map_end(map); i++)
        arrived += map->state[i] != KILN_TEXEL_MARGIN;
    if (arrived != covered)
        return kiln_fail(error, KILN_BUG, "object %u: %llu of its %llu points arrived where its lightmap is written",
                         object, (unsigned long long)arrived, (unsigned long long)covered);
    return KILN_OK;
}

/* Begins to turn gathered points into a map, unless that has been begun: the map may have been kept. */
static int begin_map(const struct writer *w, uint32_t object, struct kiln_error *error)
{
    struct kiln_map_work *work = &w->works[object];
    if (work->next > 0)
        return KILN_OK;
    const int status = kiln_bands_agree(work->map, check_arrived(w, object, error), error);
    return status == KILN_OK ? kiln_map_stages_begin(kiln_map_stages, work, error) : status;
}

static void drop_map(const struct writer *w, uint32_t object)
{
    kiln_map_stages_release(&w->works[object]);
    kiln_map_destroy(&w->works[object].map);
}

/* Turns gathered points into a map with a value in every texel. */
static int complete_map(const struct writer *w, uint32_t object, struct kiln_error *error)
{
    const int status = begin_map(w, object, error);
    return status == KILN_OK ? kiln_map_stages_run(kiln_map_stages, &w->works[object], error) : status;
}

/* Creates the image of an object and the texts of its file; releases its map. */
static int finish_object(const struct writer *w, uint32_t object, struct kiln_image **image, struct file_words *words,
                         struct kiln_error *error)
{
    int status = complete_map(w, object, error);
    if (status == KILN_OK)
        status = make_image(w, w->works[object].map, image, error);
    drop_map(w, object);
    return status == KILN_OK ? describe_file(w, object, *image, words, error) : status;
}

/* The layers of groups that have files of their own (field/group_fields.h). */
static size_t group_files(const struct writer *w)
{
    const struct kiln_field_set *fields = w->result->fields;
    return kiln_group_files((fields->count - kiln_group_fields_first(fields)) / KILN_GROUP_FIELDS);
}

static int compare_channels(const void *a, const void *b)
{
    return strcmp(((const struct kiln_image_channel *)a)->name, ((const struct kiln_image_channel *)b)->name);
}

/* Channels of the fields [first, last) as an image whose values are those of `image`; release its channels. */
static int view_channels(const struct kiln_image *image, const struct kiln_field_set *fields, size_t first, size_t last,
                         struct kiln_image *view, struct kiln_error *error)
{
    *view = (struct kiln_image){.width = image->width, .height = image->height};
    int status =
        kiln_allocate(&view->channels, image->channel_count, sizeof *view->channels, "the layers of groups", error);
    for (size_t i = first; i < last && status == KILN_OK; i++)
        for (uint32_t c = 0; fields->entry[i].in_lightmaps && c < fields->entry[i].field->components; c++)
            view->channels[view->channel_count++] = *kiln_image_find(image, fields->entry[i].field->channels[c]);
    if (status == KILN_OK)
        qsort(view->channels, view->channel_count, sizeof *view->channels, compare_channels);
    return status;
}

/* Puts a file into the batch; of an image in bands all ranks write it. */
static int put_file(const struct writer *w, uint32_t object, const char *name, const struct kiln_image *image,
                    const struct file_words *words, struct kiln_error *error)
{
    const struct kiln_lightmap *lightmap = &w->result->surface->lightmaps[object];
    uint32_t first = 0, end = 0;
    if (!w->works[object].in_bands)
        return kiln_exr_put(w->batch, w->params->directory, name, image, words->attributes, words->count, error);
    kiln_bands_rows(lightmap->height, w->rank, w->ranks, &first, &end);
    return kiln_exr_write_bands(w->result->communicator, w->params->directory, name, image, first, lightmap->height,
                                words->attributes, words->count, kiln_faults_packer_fails(w->params->faults, w->rank),
                                error);
}

static int write_group_file(const struct writer *w, uint32_t object, size_t n, const struct kiln_image *image,
                            const struct file_words *words, struct kiln_error *error)
{
    const struct kiln_field_set *fields = w->result->fields;
    const size_t first = kiln_group_fields_first(fields) + n * KILN_GROUPS_A_FILE * KILN_GROUP_FIELDS,
                 end = first + KILN_GROUPS_A_FILE * KILN_GROUP_FIELDS;
    char folder[KILN_GROUP_FOLDER], name[KILN_PATH_SIZE];
    struct kiln_image part;
    kiln_group_folder(n, folder);
    (void)snprintf(name, sizeof name, "%s%s", folder, words->name + strlen("lightmaps"));
    int status = view_channels(image, fields, first, end < fields->count ? end : fields->count, &part, error);
    if (status == KILN_OK)
        status = put_file(w, object, name, &part, words, error);
    kiln_free(&part.channels);
    return status;
}

/* The files of one object: its lightmap, and the layers of groups where those have their own. */
static int put_files(const struct writer *w, uint32_t object, struct kiln_image *image, const struct file_words *words,
                     struct kiln_error *error)
{
    struct kiln_image kept;
    int status = KILN_OK;
    if (group_files(w) == 0)
        return put_file(w, object, words->name, image, words, error);
    for (size_t n = 0; n < group_files(w) && status == KILN_OK; n++)
        status = write_group_file(w, object, n, image, words, error);
    if (status != KILN_OK)
        return status;
    status = view_channels(image, w->result->fields, 0, kiln_group_fields_first(w->result->fields), &kept, error);
    for (int k = 0; k < 2 && status == KILN_OK; k++)
        kept.channels[kept.channel_count++] = *kiln_image_find(image, k == 0 ? "coverage.Y" : "validity.Y");
    if (status == KILN_OK) {
        qsort(kept.channels, kept.channel_count, sizeof *kept.channels, compare_channels);
        status = put_file(w, object, words->name, &kept, words, error);
    }
    kiln_free(&kept.channels);
    return status;
}

static int write_object(const struct writer *w, uint32_t object, struct kiln_error *error)
{
    if (kiln_stop_asked(w->result->stop))
        return kiln_give_up(error);
    struct kiln_image *image = NULL;
    struct file_words words;
    int status = finish_object(w, object, &image, &words, error);
    if (status == KILN_OK)
        status = put_files(w, object, image, &words, error);
    kiln_image_destroy(&image);
    return status;
}

/* ---- objects packed by all ranks ---- */

/* The distributed objects of this rank in a round: their images, and files that have been begun. */
struct large {
    struct kiln_strip_source *sources;
    struct kiln_image **images;
    struct kiln_exr_file **files;
    size_t count;
};

static void destroy_large(struct large *large)
{
    for (size_t i = 0; i < large->count; i++) {
        kiln_exr_file_destroy(&large->files[i]);
        kiln_image_destroy(&large->images[i]);
    }
    kiln_free(&large->sources);
    kiln_free(&large->images);
    kiln_free(&large->files);
}

/* Finishes the images of large objects one after the other, each with all threads, and begins their files. */
static int begin_large(const struct writer *w, const uint32_t *objects, size_t count, struct large *large,
                       struct kiln_error *error)
{
    int status = kiln_allocate(&large->sources, count, sizeof *large->sources, "large lightmaps", error);
    if (status == KILN_OK)
        status = kiln_allocate(&large->images, count, sizeof(struct kiln_image *), "large lightmaps", error);
    if (status == KILN_OK)
        status = kiln_allocate(&large->files, count, sizeof(struct kiln_exr_file *), "large lightmaps", error);
    for (size_t i = 0; status == KILN_OK && i < count; i++) {
        struct file_words words;
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

/* ---- rounds ---- */

/* Keeps a ghost of a map. */
static void put_ghost(struct writer *w, const struct kiln_texel_record *record)
{
    struct kiln_map_ghosts *ghosts = &w->works[record->map].ghosts;
    if (record->valid == 0)
        return;
#pragma omp critical(kiln_put_ghost)
    {
        ghosts->size = sizeof *record + w->layers.planes.count * sizeof(float);
        if (w->ghost_status == KILN_OK)
            w->ghost_status = kiln_grow(&ghosts->records, &ghosts->capacity, ghosts->count + 1, ghosts->size,
                                        "texels of objects that touch", &w->ghost_error);
        if (w->ghost_status == KILN_OK)
            memcpy(ghosts->records + ghosts->count++ * ghosts->size, record, ghosts->size);
    }
}

static void put_point(void *context, const struct kiln_texel_record *record)
{
    struct writer *w = context;
    struct kiln_map *map = w->works[record->map].map;
    if (record->from != record->map) {
        put_ghost(w, record);
        return;
    }
    const size_t texel = (size_t)record->y * map->width + record->x;
    const struct kiln_mesh *mesh =
        &w->result->scene->meshes[w->result->scene->objects[kiln_map_object(w->result->surface, record->map)].mesh];
    map->state[texel] = record->valid != 0 ? KILN_TEXEL_VALID : KILN_TEXEL_FILLED;
    map->area[texel] = record->area;
    map->coverage[texel] = record->coverage;
    map->chart[texel] = (uint32_t)(w->result->geometry->stored_triangle[record->triangle] - mesh->triangle_first);
    for (uint32_t p = 0; record->valid != 0 && p < map->has->count; p++)
        map->planes[p][texel] = record->values[p];
}

static int compare_texels(const void *a, const void *b, void *context)
{
    const struct kiln_lightmap *maps = context;
    const uint32_t i = *(const uint32_t *)a, j = *(const uint32_t *)b;
    const uint64_t p = (uint64_t)maps[i].width * maps[i].height, q = (uint64_t)maps[j].width * maps[j].height;
    return p != q ? (p > q ? -1 : 1) : (i > j) - (i < j);
}

static int open_map(const struct writer *w, uint32_t object, struct kiln_error *error)
{
    const struct kiln_lightmap *lightmap = &w->result->surface->lightmaps[object];
    struct kiln_map_work *work = &w->works[object];
    if (work->map != NULL)
        return KILN_OK;
    work->result = w->result;
    work->params = w->params;
    work->layers = &w->layers;
    work->object = object;
    work->device = w->device;
    work->graphs = w->graphs;
    work->report = &w->reports[object];
    *work->report = (struct kiln_lightmap_report){.map = object};
    return work->in_bands
               ? kiln_map_create_band(&work->map, lightmap->width, lightmap->height, &w->layers.planes, w->bands, error)
               : kiln_map_create(&work->map, lightmap->width, lightmap->height, &w->layers.planes, error);
}

static uint64_t texels_of(const struct writer *w, const uint32_t *own, size_t count)
{
    uint64_t texels = 0;
    for (size_t i = 0; i < count; i++)
        texels += (uint64_t)w->result->surface->lightmaps[own[i]].width * w->result->surface->lightmaps[own[i]].height;
    return texels;
}

/* How many of the objects, of which the largest come first, are worked on one after the other, each by all threads:
 * those that would keep one thread at work when the others have nothing left. */
static size_t count_alone(const struct writer *w, const uint32_t *own, size_t count, uint64_t threads)
{
    enum { LEAST = 1 << 16 }; /* texels from which on many threads have enough to do */
    uint64_t left = texels_of(w, own, count);
    size_t alone = 0;
    for (; alone < count; alone++) {
        const uint64_t texels = texels_of(w, own + alone, 1);
        if (texels < LEAST || 2 * threads * texels <= left)
            break;
        left -= texels;
    }
    return alone;
}

/* Calls `run` for each of the objects, by one thread. Keeps the message of the first object that failed. */
static int run_side_by_side(const struct writer *w, const uint32_t *own, size_t count, int threads,
                            int (*run)(const struct writer *, uint32_t, struct kiln_error *), struct kiln_error *error)
{
    size_t first_failed = SIZE_MAX;
    int status = KILN_OK;
    const int team = count < (size_t)threads ? (int)count : threads;
#pragma omp parallel for schedule(dynamic, 1) num_threads(team)
    for (size_t i = 0; i < count; i++) {
        struct kiln_error mine = {{0}};
        omp_set_num_threads(1); /* for the loops within the object */
        const int result = run(w, own[i], &mine);
        if (result == KILN_OK)
            continue;
#pragma omp critical(kiln_write_round)
        if (i < first_failed) {
            first_failed = i;
            status = kiln_fail(error, result, "%s", mine.message);
        }
    }
    return status;
}

/* Lists own objects of the round in `own`, largest first, so that a thread does not start the largest when the others
 * are done; creates their maps, unless they have been kept. */
static int open_round(const struct writer *w, const struct kiln_assignment *assignment, uint32_t rank, uint32_t round,
                      uint32_t *own, size_t *count, struct kiln_error *error)
{
    *count = 0;
    for (size_t i = 0; i < assignment->count; i++) {
        const bool bands = assignment->owner[i] == KILN_IN_BANDS;
        if ((assignment->owner[i] != rank && !bands) || assignment->round[i] != round)
            continue;
        w->works[i].in_bands = bands;
        own[(*count)++] = (uint32_t)i;
    }
    qsort_r(own, *count, sizeof *own, compare_texels, w->result->surface->lightmaps);
    return run_side_by_side(w, own, *count, omp_get_max_threads(), open_map, error);
}

/* Calls `run` for some objects of a round, the largest first. */
static int run_some(const struct writer *w, const uint32_t *own, size_t count,
                    int (*run)(const struct writer *, uint32_t, struct kiln_error *), struct kiln_error *error)
{
    const int threads = omp_get_max_threads();
    const size_t alone = count_alone(w, own, count, (uint64_t)threads);
    int status = KILN_OK;
    for (size_t i = 0; i < alone && status == KILN_OK; i++)
        status = run(w, own[i], error);
    return status == KILN_OK && count > alone ? run_side_by_side(w, own + alone, count - alone, threads, run, error)
                                              : status;
}

/* Begins a map of which a stage may take long. */
static int begin_large_map(const struct writer *w, uint32_t object, struct kiln_error *error)
{
    return kiln_stop_asked(w->result->stop) ? kiln_give_up(error) : begin_map(w, object, error);
}

/* Runs what takes long of single maps, before the files of all are made: one after the other, each with all threads,
 * since a map's part of the threads is that of its texels. */
static int run_long(const struct writer *w, const uint32_t *own, size_t count, struct kiln_error *error)
{
    enum { LEAST = 1 << 15 }; /* texels of such a map */
    size_t large = 0;
    while (large < count && texels_of(w, own + large, 1) >= LEAST)
        large++; /* the largest come first */
    int status = run_some(w, own, large, begin_large_map, error);
    for (size_t i = 0; i < large && status == KILN_OK; i++)
        status = kiln_stop_asked(w->result->stop) ? kiln_give_up(error)
                                                  : kiln_map_stages_run_long(kiln_map_stages, &w->works[own[i]], error);
    return status;
}

/* Writes the objects of a round, in batches whose files are published together. */
static int write_round(struct writer *w, const uint32_t *own, size_t count, struct kiln_error *error)
{
    enum { AT_ONCE = 1024 };
    int status = KILN_OK;
    if (count > 1)
        status = run_long(w, own, count, error);
    if (status == KILN_OK && count > 0)
        status = kiln_publish_batch_create(&w->batch, error);
    for (size_t first = 0; status == KILN_OK && first < count; first += AT_ONCE) {
        const size_t some = count - first < AT_ONCE ? count - first : AT_ONCE;
        status = run_some(w, own + first, some, write_object, error);
        if (status == KILN_OK)
            status = kiln_publish_batch_finish(w->batch, error);
    }
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

/* ---- objects in bands ---- */

/* Collective. Begins the map of an object in bands, and solves its seams, unless they are those of objects that touch.
 */
static int solve_alone(const struct writer *w, const struct kiln_assignment *assignment, uint32_t object,
                       struct kiln_error *error)
{
    struct kiln_map_work *work = &w->works[object];
    const struct kiln_joined_params params = {.communicator = w->result->communicator,
                                              .alone = object,
                                              .lightmaps = w->result->surface->lightmaps,
                                              .assignment = assignment,
                                              .planes = &w->layers.planes,
                                              .measure = !w->params->stitch};
    struct kiln_joined *alone = NULL;
    int status = begin_map(w, object, error);
    if (status == KILN_OK)
        status = kiln_agree(w->result->communicator, kiln_joined_create(&alone, &params, error), error);
    if (status == KILN_OK)
        status = kiln_joined_add(alone, object, work->map, work->graph, work->nearest, error);
    if (status == KILN_OK)
        status = kiln_joined_solve(alone, error);
    work->joined = alone;
    if (status == KILN_OK)
        status = kiln_map_stages_run(kiln_map_stages, work, error);
    work->joined = NULL;
    kiln_joined_destroy(&alone);
    return status;
}

/* Collective. Writes the file of an object in bands. */
static int write_bands(const struct writer *w, const struct kiln_assignment *assignment, uint32_t object,
                       struct kiln_error *error)
{
    const MPI_Comm comm = w->result->communicator;
    struct kiln_map_work *work = &w->works[object];
    struct kiln_image *image = NULL;
    struct file_words words;
    int status = kiln_agree(comm, kiln_stop_asked(w->result->stop) ? kiln_give_up(error) : KILN_OK, error);
    if (status == KILN_OK)
        status = work->joined != NULL ? complete_map(w, object, error) : solve_alone(w, assignment, object, error);
    if (status == KILN_OK)
        status = kiln_agree(comm, make_image(w, work->map, &image, error), error);
    drop_map(w, object);
    if (status == KILN_OK)
        status = kiln_agree(comm, describe_file(w, object, image, &words, error), error);
    if (status == KILN_OK)
        status = put_files(w, object, image, &words, error);
    kiln_image_destroy(&image);
    if (w->rank != 0) /* the report is complete on all ranks, and told of by one */
        *work->report = (struct kiln_lightmap_report){0};
    return status;
}

/* Collective. Writes the objects of a round in bands, one after the other. */
static int write_all_bands(const struct writer *w, const struct kiln_assignment *assignment, const uint32_t *own,
                           size_t count, struct kiln_error *error)
{
    int status = KILN_OK;
    for (size_t i = 0; i < count && status == KILN_OK; i++)
        status = write_bands(w, assignment, own[i], error);
    return status;
}

/* Collective. Writes the objects of the round: each rank its small ones, then all ranks together the large ones. */
static int write_together(struct writer *w, const struct kiln_assignment *assignment, uint32_t round, uint32_t *own,
                          size_t count, struct kiln_error *error)
{
    const MPI_Comm comm = w->result->communicator;
    const struct kiln_lightmap *lightmaps = w->result->surface->lightmaps;
    struct kiln_strip_assignment *strips = NULL;
    if (round >= assignment->own_rounds)
        return write_all_bands(w, assignment, own, count, error);
    struct large large = {0};
    /* strips have room for few channels, of one file: the layers of groups are packed by who has the map */
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

/* ---- objects that touch ---- */

/* Begins the map of an object that touches others, and adds it to what is joined. Only if all maps fit in one round is
 * it kept; else it is made again when its file is written. */
static int join_object(const struct writer *w, uint32_t object, struct kiln_error *error)
{
    if (!w->works[object].in_bands && kiln_stop_asked(w->result->stop))
        return kiln_give_up(error);
    const struct kiln_map_work *work = &w->works[object];
    int status = begin_map(w, object, error);
    if (status == KILN_OK)
        status = kiln_joined_add(w->joined, object, work->map, work->graph, work->nearest, error);
    if (!w->keeps)
        drop_map(w, object);
    return status;
}

/* Collective. Lets the points of a round come, and ghosts. */
static int gather_round(struct writer *w, struct kiln_texel_gather *gather, uint32_t round, struct kiln_error *error)
{
    int status = kiln_texel_gather_round(gather, round, put_point, w, error);
    if (status != KILN_OK)
        return status;
    if (w->ghost_status != KILN_OK)
        status = kiln_fail(error, w->ghost_status, "%s", w->ghost_error.message);
    return kiln_agree(w->result->communicator, status, error);
}

/* Collective. Calls `finish` with the objects of each round, when their points and their ghosts have arrived. The
 * points of lightmaps whose owner in `gathered` is KILN_NONE stay where they are. */
static int walk_rounds(struct writer *w, const struct kiln_assignment *assignment,
                       const struct kiln_assignment *gathered, const struct kiln_ghosts *ghosts,
                       int (*finish)(struct writer *, const struct kiln_assignment *, uint32_t round, uint32_t *own,
                                     size_t count, struct kiln_error *),
                       struct kiln_error *error)
{
    const MPI_Comm comm = w->result->communicator;
    struct kiln_texel_gather *gather = NULL;
    uint32_t *own = NULL;
    const size_t wide = w->layers.planes.count > 64 ? (64ull << 18) / w->layers.planes.count : 0; /* records a pass */
    int status = kiln_texel_gather_create(&gather, w->result, gathered, &w->layers, ghosts, wide, error);
    if (status != KILN_OK)
        return status;
    status = kiln_agree(comm, kiln_allocate(&own, assignment->count, sizeof *own, "objects to write", error), error);
    for (uint32_t round = 0; status == KILN_OK && round < assignment->rounds; round++) {
        size_t count = 0;
        status = kiln_agree(comm, open_round(w, assignment, w->rank, round, own, &count, error), error);
        if (status == KILN_OK)
            status = gather_round(w, gather, round, error);
        if (status == KILN_OK)
            status = finish(w, assignment, round, own, count, error);
    }
    kiln_free(&own);
    kiln_texel_gather_destroy(&gather);
    return status;
}

/* Collective: as walk_rounds wants it. */
static int join_together(struct writer *w, const struct kiln_assignment *assignment, uint32_t round, uint32_t *own,
                         size_t count, struct kiln_error *error)
{
    int status = KILN_OK;
    for (size_t i = 0; round >= assignment->own_rounds && i < count && status == KILN_OK; i++) {
        status = kiln_stop_asked(w->result->stop) ? kiln_give_up(error) : KILN_OK;
        if ((status = kiln_agree(w->result->communicator, status, error)) == KILN_OK)
            status = join_object(w, own[i], error);
    }
    if (round >= assignment->own_rounds)
        return status;
    return kiln_agree(w->result->communicator, run_some(w, own, count, join_object, error), error);
}

/* A copy of the assignment without the lightmaps that have a joint, or without those that have none. */
static int choose_maps(struct kiln_assignment *chosen, const struct kiln_assignment *all,
                       const struct kiln_joints *joints, bool joined, struct kiln_error *error)
{
    *chosen = *all;
    const int status =
        kiln_allocate(&chosen->owner, all->count, sizeof *chosen->owner, "the assignment of lightmaps", error);
    for (size_t i = 0; status == KILN_OK && i < all->count; i++)
        chosen->owner[i] = (joints->group[i] != KILN_NONE) == joined ? all->owner[i] : KILN_NONE;
    return status;
}

/* Collective. Solves the seams of objects that touch. Sets `joined` of their works. */
static int join_seams(struct writer *w, const struct kiln_assignment *assignment, const struct kiln_joints *joints,
                      struct kiln_error *error)
{
    const MPI_Comm comm = w->result->communicator;
    const struct kiln_joined_params params = {.communicator = comm,
                                              .joints = joints,
                                              .lightmaps = w->result->surface->lightmaps,
                                              .assignment = assignment,
                                              .planes = &w->layers.planes};
    struct kiln_assignment touching = {0};
    int status = choose_maps(&touching, assignment, joints, true, error);
    if (status == KILN_OK)
        status = kiln_joined_create(&w->joined, &params, error);
    status = kiln_agree(comm, status, error);
    if (status == KILN_OK)
        status = walk_rounds(w, &touching, &touching, w->ghosts, join_together, error);
    if (status == KILN_OK)
        status = kiln_joined_solve(w->joined, error);
    for (size_t i = 0; status == KILN_OK && i < joints->map_count; i++)
        w->works[i].joined = joints->group[i] != KILN_NONE ? w->joined : NULL;
    kiln_free(&touching.owner);
    return status;
}

static uint64_t texels_at_once(const struct writer *w)
{
    const struct kiln_surface *s = w->result->surface;
    double texels = 0.0;
    for (uint32_t i = 0; i < s->map_count; i++)
        texels += s->lightmaps[i].published != 0 ? (double)texels_of(w, &i, 1) : 0.0;
    return w->params->texel_budget > 0 ? w->params->texel_budget
                                       : kiln_lightmap_texels(w->layers.planes.count, texels / w->ranks);
}

/* Whether the maps of objects that touch may stay in memory until they are written, on every rank: those of one round
 * may, and as many as take no more than the largest map does while it is denoised. Others are made twice. */
static int may_keep(const struct writer *w, const struct kiln_assignment *assignment, const struct kiln_joints *joints,
                    bool *keeps, struct kiln_error *error)
{
    uint64_t *texels = NULL, largest = 0, bands = 0, most = 0;
    const int status = kiln_allocate(&texels, w->ranks, sizeof *texels, "the texels of ranks", error);
    for (uint32_t i = 0; status == KILN_OK && i < joints->map_count; i++) {
        const uint64_t of_map = texels_of(w, &i, 1);
        largest = of_map > largest ? of_map : largest;
        if (joints->group[i] == KILN_NONE || assignment->owner[i] == KILN_NONE)
            continue;
        if (assignment->owner[i] == KILN_IN_BANDS)
            bands += of_map / w->ranks;
        else
            texels[assignment->owner[i]] += of_map;
    }
    for (uint32_t i = 0; status == KILN_OK && i < w->ranks; i++)
        most = texels[i] + bands > most ? texels[i] + bands : most;
    kiln_free(&texels);
    const bool one_round = assignment->own_rounds <= 1 && assignment->rounds - assignment->own_rounds <= 1;
    *keeps = one_round || most <= texels_at_once(w) || most <= 2 * largest;
    return kiln_agree(w->result->communicator, status, error);
}

/* Collective. Writes all files, with the seams of objects that touch as they were solved. Of maps that were kept no
 * points are sent again. */
static int write_rounds(struct writer *w, const struct kiln_assignment *assignment, const struct kiln_joints *joints,
                        struct kiln_error *error)
{
    struct kiln_assignment others = {0};
    if (joints->count == 0 || !w->params->stitch)
        return walk_rounds(w, assignment, assignment, w->ghosts, write_together, error);
    int status = may_keep(w, assignment, joints, &w->keeps, error);
    if (status == KILN_OK)
        status = join_seams(w, assignment, joints, error);
    if (status == KILN_OK)
        status = kiln_agree(w->result->communicator, choose_maps(&others, assignment, joints, false, error), error);
    if (status == KILN_OK)
        status = walk_rounds(w, assignment, w->keeps ? &others : assignment, w->keeps ? NULL : w->ghosts,
                             write_together, error);
    kiln_free(&others.owner);
    return status;
}

/* Leaves out the lightmaps that need not be written: of those that touch others all are, or none. Returns whether
 * lightmaps that touch are left. */
static bool leave_out(const struct writer *w, struct kiln_assignment *assignment, const struct kiln_joints *joints)
{
    const uint8_t *only = w->params->only;
    bool touching = only == NULL;
    for (size_t i = 0; only != NULL && joints != NULL && i < joints->map_count; i++)
        touching = touching || (only[i] != 0 && joints->group[i] != KILN_NONE);
    for (size_t i = 0; only != NULL && i < assignment->count; i++)
        if (only[i] == 0 && !(touching && joints != NULL && joints->group[i] != KILN_NONE))
            assignment->owner[i] = assignment->round[i] = KILN_NONE;
    return touching;
}

/* Collective. Finds where objects touch, if their seams are to be smoothed or noise to be taken out, and writes all
 * files. */
static int write_all(struct writer *w, struct kiln_error *error)
{
    static const struct kiln_joints none = {0};
    struct kiln_assignment *assignment = NULL;
    struct kiln_joints *joints = NULL;
    int status = KILN_OK;
    if (w->params->stitch || w->params->denoise)
        status =
            kiln_joints_find(&joints, w->result->scene, w->result->surface, (double)w->result->geometry->extent, error);
    if (status == KILN_OK)
        status = kiln_assignment_create(
            &assignment, w->result->surface->lightmaps, w->result->surface->map_count, w->ranks, texels_at_once(w),
            w->params->least_divided > 0 ? w->params->least_divided : KILN_BANDS_LEAST, error);
    const bool touching = status == KILN_OK && leave_out(w, assignment, joints);
    if (status == KILN_OK && joints != NULL && touching && w->params->denoise)
        status = kiln_ghosts_create(&w->ghosts, joints, w->result->surface, error);
    status = kiln_agree(w->result->communicator, status, error);
    if (status == KILN_OK)
        status = write_rounds(w, assignment, joints != NULL && touching ? joints : &none, error);
    kiln_joined_destroy(&w->joined);
    kiln_ghosts_destroy(&w->ghosts);
    kiln_joints_destroy(&joints);
    kiln_assignment_destroy(&assignment);
    return status;
}

/* Collective. Combines the reports by a bitwise or, which is exact, since each is filled in on one rank and zero on
 * others. */
static int gather_reports(const struct kiln_bake_result *result, const struct kiln_lightmap_report *own, int rank,
                          struct kiln_lightmap_report *reports, struct kiln_error *error)
{
    enum { AT_ONCE = 1 << 16 };
    for (size_t first = 0; first < result->surface->map_count; first += AT_ONCE) {
        const size_t left = result->surface->map_count - first;
        const int count = (int)(left < AT_ONCE ? left : AT_ONCE);
        /* the struct contains numbers of different sizes, so it is combined as bytes */
        if (MPI_Reduce(own + first, rank == 0 ? reports + first : NULL, count * (int)sizeof *own, MPI_BYTE, MPI_BOR, 0,
                       result->communicator) != MPI_SUCCESS)
            return kiln_fail(error, KILN_RANK_LOST, "MPI failed while the ranks' reports on lightmaps were gathered");
    }
    for (size_t i = 0; rank != 0 && i < result->surface->map_count; i++)
        reports[i] = (struct kiln_lightmap_report){.map = (uint32_t)i};
    return KILN_OK;
}

static int make_folder(const char *directory, const char *name, bool backs, struct kiln_error *error)
{
    struct kiln_folder made;
    char path[KILN_GROUP_FOLDER + 8];
    (void)snprintf(path, sizeof path, "%s%s", name, backs ? "/back" : "");
    const int status = kiln_folder_open(&made, directory, path, true, error);
    kiln_folder_close(&made);
    return status;
}

static int make_folders(const struct writer *w, const struct kiln_surface *surface, const char *directory,
                        struct kiln_error *error)
{
    bool backs = false;
    for (uint32_t i = surface->object_count; i < surface->map_count; i++)
        backs = backs || surface->lightmaps[i].published != 0;
    int status = make_folder(directory, "lightmaps", backs, error);
    for (size_t n = 0; n < group_files(w) && status == KILN_OK; n++) {
        char folder[KILN_GROUP_FOLDER];
        kiln_group_folder(n, folder);
        status = make_folder(directory, folder, backs, error);
    }
    return status;
}

/* Software devices are slower than the host. */
static int find_device(struct writer *w, struct kiln_error *error)
{
    struct kiln_backend_info info = {.regresses = false};
    if (w->params->backend != NULL)
        kiln_backend_info(w->params->backend, &info);
    return info.regresses ? kiln_regression_device_create(&w->device, w->params->backend, error) : KILN_OK;
}

int kiln_write_lightmaps(const struct kiln_bake_result *result, const struct kiln_output_params *params,
                         struct kiln_lightmap_report *reports, struct kiln_error *error)
{
    const size_t maps = result->surface->map_count;
    struct writer w = {.result = result, .params = params};
    int rank = 0, ranks = 1;
    if (MPI_Comm_rank(result->communicator, &rank) != MPI_SUCCESS ||
        MPI_Comm_size(result->communicator, &ranks) != MPI_SUCCESS)
        return kiln_fail(error, KILN_RANK_LOST, "MPI cannot give the rank number");
    w.rank = (uint32_t)rank;
    w.ranks = (uint32_t)ranks;
    w.has_seed = kiln_provenance_seed(params->provenance_json, &w.seed);
    int status = rank == 0 ? make_folders(&w, result->surface, params->directory, error) : KILN_OK;
    if (status == KILN_OK)
        status = kiln_layers_make(&w.layers, result->fields, error);
    if (status == KILN_OK)
        status = kiln_map_stages_layers(kiln_map_stages, params, &w.layers, result->fields, error);
    if (status == KILN_OK)
        status = kiln_allocate(&w.reports, maps, sizeof *w.reports, "reports on lightmaps", error);
    if (status == KILN_OK)
        status = kiln_allocate(&w.works, maps, sizeof *w.works, "lightmaps", error);
    if (status == KILN_OK)
        status = kiln_chart_graphs_create(&w.graphs, result->scene, error);
    if (status == KILN_OK)
        status = find_device(&w, error);
    status = kiln_agree(result->communicator, status, error);
    if (status == KILN_OK)
        status = kiln_bands_create(&w.bands, result->communicator, error);
    if (status == KILN_OK)
        status = write_all(&w, error);
    if (status == KILN_OK && reports != NULL)
        status = kiln_agree(result->communicator, gather_reports(result, w.reports, rank, reports, error), error);
    for (size_t i = 0; w.works != NULL && i < maps; i++)
        drop_map(&w, (uint32_t)i);
    kiln_chart_graphs_destroy(&w.graphs);
    kiln_regression_device_destroy(&w.device);
    kiln_bands_destroy(&w.bands);
    kiln_free(&w.works);
    kiln_free(&w.reports);
    return status;
}
