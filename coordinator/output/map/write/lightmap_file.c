#include "coordinator/output/map/write/writer.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "coordinator/field/group_fields.h"
#include "coordinator/files/publish.h"
#include "coordinator/job/faults.h"
#include "coordinator/output/exr_bands.h"
#include "coordinator/output/map/bands/bands.h"
#include "worker/base/memory.h"

/* Finds the largest value of a colour. Collective for an image in bands. */
static int find_most(const struct kiln_writer *w, bool bands, const struct kiln_image *image, float *most,
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

/* "half" if colours can be stored as halves; otherwise "float" with the reason. */
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

/* Collects the descriptions of layers that have one. */
static void describe_layers(const struct kiln_field_set *fields, struct kiln_file_words *words)
{
    for (size_t i = 0; i < fields->count; i++)
        if (fields->entry[i].in_lightmaps && fields->entry[i].field->attribute != NULL)
            words->attributes[words->count++] =
                (struct kiln_exr_attribute){.name = fields->entry[i].field->attribute,
                                            .kind = KILN_EXR_STRING,
                                            .text = fields->entry[i].field->description};
}

static int name_file(const struct kiln_writer *w, uint32_t object, struct kiln_file_words *words,
                     struct kiln_error *error)
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

int kiln_writer_describe(const struct kiln_writer *w, uint32_t object, struct kiln_image *image,
                         struct kiln_file_words *words, struct kiln_error *error)
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
    const struct kiln_exr_attribute attributes[KILN_FILE_ATTRIBUTES] = {
        {.name = "kiln:version", .kind = KILN_EXR_STRING, .text = KILN_VERSION},
        {.name = "kiln:quantity",
         .kind = KILN_EXR_STRING,
         .text = w->has_caustics ? "irradiance about the shading normal; R G B = direct + indirect + caustic"
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
        {.name = "kiln:seed", .kind = KILN_EXR_STRING, .text = words->seed}, /* last, since it is left out if unknown */
    };
    memcpy(words->attributes, attributes, sizeof attributes);
    words->count = w->has_seed ? KILN_FILE_ATTRIBUTES : KILN_FILE_ATTRIBUTES - 1;
    describe_layers(w->result->fields, words);
    return name_file(w, object, words, error);
}

size_t kiln_writer_group_files(const struct kiln_writer *w)
{
    const struct kiln_field_set *fields = w->result->fields;
    return kiln_group_files((fields->count - kiln_group_fields_first(fields)) / KILN_GROUP_FIELDS);
}

static int compare_channels(const void *a, const void *b)
{
    return strcmp(((const struct kiln_image_channel *)a)->name, ((const struct kiln_image_channel *)b)->name);
}

/* Makes an image of the channels of fields [first, last), which shares the values of `image`; release its channels. */
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

/* Puts a file into the batch. All ranks write the file of an image in bands. */
static int put_file(const struct kiln_writer *w, uint32_t object, const char *name, const struct kiln_image *image,
                    const struct kiln_file_words *words, struct kiln_error *error)
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

static int write_group_file(const struct kiln_writer *w, uint32_t object, size_t n, const struct kiln_image *image,
                            const struct kiln_file_words *words, struct kiln_error *error)
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

int kiln_writer_put_files(const struct kiln_writer *w, uint32_t object, struct kiln_image *image,
                          const struct kiln_file_words *words, struct kiln_error *error)
{
    struct kiln_image kept;
    int status = KILN_OK;
    if (kiln_writer_group_files(w) == 0)
        return put_file(w, object, words->name, image, words, error);
    for (size_t n = 0; n < kiln_writer_group_files(w) && status == KILN_OK; n++)
        status = write_group_file(w, object, n, image, words, error);
    if (status != KILN_OK)
        return status;
    KILN_TRY(view_channels(image, w->result->fields, 0, kiln_group_fields_first(w->result->fields), &kept, error));
    for (int k = 0; k < 2; k++)
        kept.channels[kept.channel_count++] = *kiln_image_find(image, k == 0 ? "coverage.Y" : "validity.Y");
    qsort(kept.channels, kept.channel_count, sizeof *kept.channels, compare_channels);
    KILN_TRY(put_file(w, object, words->name, &kept, words, error));
end:
    kiln_free(&kept.channels);
    return status;
}
