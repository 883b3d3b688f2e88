/* Materials, textures, samplers, images. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "coordinator/import/gltf_document.h"
#include "worker/base/memory.h"
#include "worker/scene/gloss.h"

/* The encoded bytes of an image, from a file, a buffer view or a data URI. Release with image_close. */
struct image_bytes {
    const unsigned char *data;
    size_t size;
    struct kiln_file file;
    unsigned char *owned;
};

static void image_close(struct image_bytes *bytes)
{
    kiln_file_unmap(&bytes->file);
    kiln_free(&bytes->owned);
}

static void image_open(struct gltf *g, uint32_t index, struct image_bytes *bytes)
{
    const struct gltf_place place = {"images", index, ""};
    const json_t *json = gltf_element(g, "images", index);
    const char *uri = gltf_string(g, place, json, "uri");
    const uint32_t view = gltf_index(g, place, json, "bufferView", g->view_count);
    if (g->status != KILN_OK)
        return;
    if (view != KILN_NONE) {
        bytes->data = g->views[view].data;
        bytes->size = g->views[view].size;
        if (bytes->data == NULL)
            gltf_fail(g, place, "bufferView", "%u has no bytes of its own: it is compressed", view);
    } else if (uri == NULL) {
        gltf_fail(g, place, "uri", "is missing, and bufferView too");
    } else if (strncmp(uri, "data:", 5) == 0) {
        gltf_decode_data(g, place, uri, &bytes->owned, &bytes->size);
        bytes->data = bytes->owned;
    } else {
        char path[1025], where[64];
        (void)snprintf(where, sizeof where, "images[%u].uri", index);
        gltf_take(g, kiln_confine_decode(g->confine, uri, where, path, g->error));
        if (g->status == KILN_OK)
            gltf_take(g, kiln_confine_map(g->confine, g->builder, path, where, &bytes->file, g->error));
        bytes->data = bytes->file.data;
        bytes->size = bytes->file.size;
    }
}

uint32_t gltf_source_image(struct gltf *g, uint32_t texture)
{
    const struct gltf_place place = {"textures", texture, ""};
    const json_t *json = gltf_element(g, "textures", texture);
    const uint32_t image = gltf_index(g, place, json, "source", g->image_count);
    if (image == KILN_NONE)
        gltf_fail(g, place, "source",
                  "is missing; kiln reads PNG and JPEG images, no WebP or Basis Universal (convert them)");
    return image;
}

static void image_place(const struct gltf *g, uint32_t image, char where[640])
{
    (void)snprintf(where, 640, "%.512s: images[%u]", g->confine->scene, image);
}

static void decode_image(struct gltf *g, uint32_t index)
{
    struct image_bytes bytes = {0};
    char where[640];
    if (g->image_of[index].decoded)
        return;
    image_open(g, index, &bytes);
    image_place(g, index, where);
    const struct kiln_image_bytes encoded = {.data = bytes.data, .size = bytes.size, .where = where};
    if (g->status == KILN_OK)
        gltf_take(g, kiln_image_append(&g->images, &encoded, &g->image_of[index], g->error));
    image_close(&bytes);
}

static uint32_t wrap_mode(struct gltf *g, struct gltf_place place, const json_t *json, const char *key)
{
    const uint64_t mode = gltf_whole(g, place, json, key, 0, 65535, 10497);
    switch (mode) {
    case 10497:
        return KILN_WRAP_REPEAT;
    case 33071:
        return KILN_WRAP_CLAMP;
    case 33648:
        return KILN_WRAP_MIRROR;
    default:
        gltf_fail(g, place, key, "is %llu, not one of 10497, 33071, 33648", (unsigned long long)mode);
        return KILN_WRAP_REPEAT;
    }
}

uint32_t gltf_builder_texture(struct gltf *g, uint32_t texture, bool srgb)
{
    if (texture == KILN_NONE || g->status != KILN_OK)
        return KILN_NONE;
    uint32_t *known = &g->texture_of[srgb ? texture : g->texture_count + texture];
    if (*known != KILN_NONE)
        return *known;
    const struct gltf_place place = {"textures", texture, ""};
    struct kiln_texture result = {.srgb = srgb};
    const uint32_t sampler =
        gltf_index(g, place, gltf_element(g, "textures", texture), "sampler", gltf_length(g, "samplers"));
    if (sampler != KILN_NONE) {
        const struct gltf_place at = {"samplers", sampler, ""};
        const json_t *json = gltf_element(g, "samplers", sampler);
        result.wrap_u = wrap_mode(g, at, json, "wrapS");
        result.wrap_v = wrap_mode(g, at, json, "wrapT");
        const uint64_t filter = gltf_whole(g, at, json, "magFilter", 0, 65535, 9729);
        result.nearest = filter == 9728;
        if (filter != 9728 && filter != 9729)
            gltf_fail(g, at, "magFilter", "is %llu, not one of 9728, 9729", (unsigned long long)filter);
    }
    const uint32_t image = gltf_source_image(g, texture);
    if (g->status == KILN_OK)
        decode_image(g, image);
    if (g->status != KILN_OK)
        return KILN_NONE;
    result.first = g->image_of[image].first;
    result.width = g->image_of[image].width;
    result.height = g->image_of[image].height;
    size_t index = 0;
    gltf_take(g, kiln_builder_append(g->builder, KILN_SECTION_TEXTURES, &result, 1, &index, g->error));
    *known = (uint32_t)index;
    return (uint32_t)index;
}

void gltf_texture_info(struct gltf *g, struct gltf_place place, const json_t *parent, const char *key,
                       struct gltf_texture_use *use)
{
    *use = (struct gltf_texture_use){.texture = KILN_NONE, .transform = {1.0f, 0.0f, 0.0f, 0.0f, 1.0f, 0.0f}};
    const json_t *json = gltf_object(g, place, parent, key);
    if (json == NULL)
        return;
    use->texture = gltf_index(g, place, json, "index", g->texture_count);
    if (use->texture == KILN_NONE)
        gltf_fail(g, place, key, "has no texture index");
    use->texcoord = (uint32_t)gltf_whole(g, place, json, "texCoord", 0, 1000, 0);
    const json_t *transform = gltf_extension(g, place, json, "KHR_texture_transform");
    if (transform == NULL)
        return;
    double offset[2] = {0.0, 0.0}, scale[2] = {1.0, 1.0};
    (void)gltf_numbers(g, place, transform, "offset", -1e6, 1e6, 2, offset);
    (void)gltf_numbers(g, place, transform, "scale", -1e6, 1e6, 2, scale);
    const double angle = gltf_number(g, place, transform, "rotation", -1e6, 1e6, 0.0);
    use->texcoord = (uint32_t)gltf_whole(g, place, transform, "texCoord", 0, 1000, use->texcoord);
    /* The rotation is counter-clockwise on the image, whose v points down. The specification's example (offset 0 1, a
     * quarter turn, scale 1/2 shows the lower left quarter) holds for this sign only. */
    const double c = cos(angle), s = sin(angle);
    const double matrix[6] = {c * scale[0], s * scale[1], offset[0], -s * scale[0], c * scale[1], offset[1]};
    for (int i = 0; i < 6; i++)
        use->transform[i] = (float)matrix[i];
}

static bool same_coordinates(const struct gltf_texture_use *a, const struct gltf_texture_use *b)
{
    return a->texcoord == b->texcoord && memcmp(a->transform, b->transform, sizeof a->transform) == 0;
}

double gltf_image_mean(struct gltf *g, uint32_t texture, unsigned channel)
{
    const uint32_t index = gltf_source_image(g, texture);
    struct image_bytes bytes = {0};
    char where[640];
    if (g->status != KILN_OK)
        return 0.0;
    struct kiln_image *image = &g->image_of[index];
    if (!image->averaged) {
        image_open(g, index, &bytes);
        image_place(g, index, where);
        const struct kiln_image_bytes encoded = {.data = bytes.data, .size = bytes.size, .where = where};
        if (g->status == KILN_OK)
            gltf_take(g, kiln_image_mean(&g->images, &encoded, image, g->error));
        image_close(&bytes);
    }
    return image->mean[channel];
}

/* Reads a material's transmission. Its texture is read at the base colour's coordinates; if it has others, it is
 * replaced by its mean. */
static void read_transmission(struct gltf *g, struct gltf_place place, const json_t *json, struct gltf_material *uses,
                              struct kiln_material *material)
{
    const json_t *extension = gltf_extension(g, place, json, "KHR_materials_transmission");
    struct gltf_texture_use use;
    if (extension == NULL)
        return;
    material->transmission = (float)gltf_number(g, place, extension, "transmissionFactor", 0.0, 1.0, 0.0);
    gltf_texture_info(g, place, extension, "transmissionTexture", &use);
    if (g->status != KILN_OK || !(material->transmission > 0.0f))
        return;
    if (uses->base.texture == KILN_NONE) /* no other texture uses the base coordinates */
        uses->base = use;
    if (use.texture != KILN_NONE && same_coordinates(&use, &uses->base)) {
        material->transmission_texture = gltf_builder_texture(g, use.texture, false);
    } else if (use.texture != KILN_NONE) {
        const double mean = gltf_image_mean(g, use.texture, 0);
        material->transmission = (float)fmin(1.0, (double)material->transmission * mean);
        if (g->status == KILN_OK)
            gltf_take(g, kiln_builder_note(
                             g->builder, 0, g->error,
                             "materials[%zu]: its transmission texture has other coordinates than its base colour and "
                             "is replaced by its mean, %.3f",
                             place.index, mean));
    }
}

/* Reads a material's normal map, which no bake needs: kiln view shows it. `material` is the material's index in the
 * builder. */
static void read_normal_map(struct gltf *g, struct gltf_place place, const json_t *json, uint32_t material)
{
    struct gltf_texture_use *use = &g->materials[place.index].normal;
    gltf_texture_info(g, place, json, "normalTexture", use);
    const json_t *info = gltf_object(g, place, json, "normalTexture");
    const double scale = info != NULL ? gltf_number(g, place, info, "scale", -1e6, 1e6, 1.0) : 0.0;
    if (scale == 0.0) /* such a map is flat */
        use->texture = KILN_NONE;
    const struct kiln_normal_map map = {material, gltf_builder_texture(g, use->texture, false), (float)scale};
    if (g->status != KILN_OK || use->texture == KILN_NONE)
        return;
    const char *why = kiln_image_no_normals(&g->images, &g->image_of[gltf_source_image(g, use->texture)]);
    if (why != NULL) {
        use->texture = KILN_NONE;
        gltf_take(g, kiln_builder_note(g->builder, KILN_NOTE_WARNING, g->error,
                                       "materials[%zu].normalTexture: its image is no normal map (%s); kiln view shows "
                                       "the material without it",
                                       place.index, why));
    } else {
        gltf_take(g, kiln_builder_append(g->builder, KILN_SECTION_NORMAL_MAPS, &map, 1, NULL, g->error));
    }
}

/* Notes how a material that transmits light is baked. */
static void note_glass(struct gltf *g, struct gltf_place place, const json_t *json, const struct kiln_material *m,
                       const struct kiln_gloss *gloss)
{
    const json_t *volume = gltf_extension(g, place, json, "KHR_materials_volume");
    const double thickness = volume != NULL ? gltf_number(g, place, volume, "thicknessFactor", 0.0, 1e30, 0.0) : 0.0;
    if (g->status != KILN_OK || !(m->transmission > 0.0f))
        return;
    gltf_take(
        g, kiln_builder_note(g->builder, 0, g->error,
                             "materials[%zu] (KHR_materials_transmission): lets %.3g %% of the light through%s, "
                             "tinted by its base colour, as thin walls do; %s",
                             place.index, 100.0 * (double)m->transmission,
                             m->transmission_texture != KILN_NONE ? " where its texture is white" : "",
                             kiln_gloss_is_passage(gloss)
                                 ? "it is thin and smooth: what it reflects is taken off but with --materials diffuse"
                                 : "without --materials diffuse it is refracted and mirrored, too"));
    if (g->status == KILN_OK && thickness > 0.0)
        gltf_take(g, kiln_builder_note(
                         g->builder, KILN_NOTE_INFORMATION, g->error,
                         "materials[%zu] (KHR_materials_volume): --materials diffuse bakes thin walls, not a body "
                         "%g m thick that bends light and absorbs it",
                         place.index, thickness));
}

static void read_metallic(struct gltf *g, struct gltf_place place, const json_t *pbr, struct kiln_material *material)
{
    struct gltf_texture_use use;
    gltf_texture_info(g, place, pbr, "metallicRoughnessTexture", &use);
    if (g->status != KILN_OK || use.texture == KILN_NONE || material->metallic == 0.0f)
        return;
    (void)gltf_builder_texture(g, use.texture, false); /* gloss needs all of it: so it is decoded once */
    const double mean = gltf_image_mean(g, use.texture, 2);
    if (g->status != KILN_OK)
        return;
    material->metallic = (float)fmin(1.0, (double)material->metallic * mean);
    gltf_take(g, kiln_builder_note(g->builder, 0, g->error,
                                   "materials[%zu]: its metallic texture is replaced by its mean, %.3f", place.index,
                                   (double)material->metallic));
}

static void read_emission(struct gltf *g, struct gltf_place place, const json_t *json, struct kiln_material *material)
{
    double factor[3] = {0.0, 0.0, 0.0};
    (void)gltf_numbers(g, place, json, "emissiveFactor", 0.0, 1e30, 3, factor);
    if (fmax(factor[0], fmax(factor[1], factor[2])) > 1.0)
        gltf_take(g,
                  kiln_builder_note(g->builder, 1, g->error,
                                    "materials[%zu].emissiveFactor is above 1, which glTF forbids; it is used as it is",
                                    place.index));
    double strength = 1.0;
    const json_t *extension = gltf_extension(g, place, json, "KHR_materials_emissive_strength");
    if (extension != NULL)
        strength = gltf_number(g, place, extension, "emissiveStrength", 0.0, 1e30, 1.0);
    for (int c = 0; c < 3; c++) {
        const double value = factor[c] * strength;
        if (value > 1e30)
            gltf_fail(g, place, "emissiveFactor", "times its strength is %g, more than 1e30", value);
        material->emission[c] = (float)value;
    }
}

static void read_alpha(struct gltf *g, struct gltf_place place, const json_t *json, struct kiln_material *material)
{
    const char *mode = gltf_string(g, place, json, "alphaMode");
    material->alpha_cutoff = (float)gltf_number(g, place, json, "alphaCutoff", 0.0, 1e30, 0.5);
    if (mode == NULL || strcmp(mode, "OPAQUE") == 0)
        material->alpha_mode = KILN_ALPHA_OPAQUE;
    else if (strcmp(mode, "MASK") == 0)
        material->alpha_mode = KILN_ALPHA_MASK;
    else if (strcmp(mode, "BLEND") == 0)
        material->alpha_mode = KILN_ALPHA_BLEND;
    else
        gltf_fail(g, place, "alphaMode", "is '%.20s', not one of OPAQUE, MASK, BLEND", mode);
}

/* Notes which of a material's extensions have no effect on diffuse light, or are not read. */
static void note_unused(struct gltf *g, struct gltf_place place, const json_t *json)
{
    static const struct {
        const char *name, *what;
    } known[] = {{"KHR_materials_unlit", "is lit like any other"},
                 {"KHR_materials_diffuse_transmission", "lets no light through"}};
    for (size_t i = 0; i < sizeof known / sizeof known[0]; i++)
        if (gltf_extension(g, place, json, known[i].name) != NULL)
            gltf_take(g, kiln_builder_note(g->builder, 0, g->error,
                                           "materials[%zu] (%s): bakes as a diffuse surface that %s", place.index,
                                           known[i].name, known[i].what));
    if (gltf_extension(g, place, json, "KHR_materials_pbrSpecularGlossiness") != NULL)
        gltf_take(g, kiln_builder_note(g->builder, KILN_NOTE_WARNING, g->error,
                                       "materials[%zu] (KHR_materials_pbrSpecularGlossiness): it is not read; the "
                                       "material is what its pbrMetallicRoughness says, %s; export again with "
                                       "metallic-roughness materials",
                                       place.index,
                                       json_object_get(json, "pbrMetallicRoughness") == NULL
                                           ? "and without one a white metal"
                                           : "which may lack its colours and textures"));
}

static void read_material(struct gltf *g, size_t index)
{
    const struct gltf_place place = {"materials", index, ""};
    const json_t *json = gltf_element(g, "materials", index);
    const json_t *pbr = gltf_object(g, place, json, "pbrMetallicRoughness");
    const char *name = gltf_string(g, place, json, "name");
    struct gltf_material *uses = &g->materials[index];
    struct kiln_material material = {
        .base_color_texture = KILN_NONE, .emission_texture = KILN_NONE, .transmission_texture = KILN_NONE};
    double color[4] = {1.0, 1.0, 1.0, 1.0};
    (void)gltf_numbers(g, place, pbr, "baseColorFactor", 0.0, 1.0, 4, color);
    for (int c = 0; c < 4; c++)
        material.base_color[c] = (float)color[c];
    material.metallic = (float)gltf_number(g, place, pbr, "metallicFactor", 0.0, 1.0, 1.0);
    material.roughness = (float)gltf_number(g, place, pbr, "roughnessFactor", 0.0, 1.0, 1.0);
    material.double_sided = gltf_bool(g, place, json, "doubleSided", false);
    read_alpha(g, place, json, &material);
    read_emission(g, place, json, &material);
    read_metallic(g, place, pbr, &material);
    gltf_texture_info(g, place, pbr, "baseColorTexture", &uses->base);
    gltf_texture_info(g, place, json, "emissiveTexture", &uses->emission);
    /* A black emitter needs no texture. */
    if (material.emission[0] == 0.0f && material.emission[1] == 0.0f && material.emission[2] == 0.0f)
        uses->emission.texture = KILN_NONE;
    material.base_color_texture = gltf_builder_texture(g, uses->base.texture, true);
    read_transmission(g, place, json, uses, &material);
    material.emission_texture = gltf_builder_texture(g, uses->emission.texture, true);
    /* Not decoded, but an invalid reference is an error all the same. */
    struct gltf_texture_use unused;
    gltf_texture_info(g, place, json, "occlusionTexture", &unused);
    note_unused(g, place, json);
    if (g->status != KILN_OK)
        return;
    if (name == NULL)
        name = "";
    gltf_take(g, kiln_builder_string(g->builder, name, strlen(name), &material.name, g->error));
    size_t at = 0;
    gltf_take(g, kiln_builder_append(g->builder, KILN_SECTION_MATERIALS, &material, 1, &at, g->error));
    read_normal_map(g, place, json, (uint32_t)at);
    struct kiln_gloss gloss;
    gltf_read_gloss(g, place, json, &material, (uint32_t)at, &gloss);
    note_glass(g, place, json, &material, &gloss);
}

/* Checks images and textures that no material uses: their references must be valid too, and no URI may point
 * outside. */
static void check_references(struct gltf *g)
{
    for (size_t i = 0; i < g->texture_count && g->status == KILN_OK; i++) {
        const struct gltf_place place = {"textures", i, ""};
        const json_t *json = gltf_element(g, "textures", i);
        (void)gltf_index(g, place, json, "source", g->image_count);
        (void)gltf_index(g, place, json, "sampler", gltf_length(g, "samplers"));
    }
    for (size_t i = 0; i < g->image_count && g->status == KILN_OK; i++) {
        const struct gltf_place place = {"images", i, ""};
        const json_t *json = gltf_element(g, "images", i);
        const char *uri = gltf_string(g, place, json, "uri");
        (void)gltf_index(g, place, json, "bufferView", g->view_count);
        char path[1025], where[64];
        (void)snprintf(where, sizeof where, "images[%zu].uri", i);
        if (g->status == KILN_OK && uri != NULL && strncmp(uri, "data:", 5) != 0)
            gltf_take(g, kiln_confine_decode(g->confine, uri, where, path, g->error));
    }
}

void gltf_read_materials(struct gltf *g)
{
    g->material_count = gltf_length(g, "materials");
    g->texture_count = gltf_length(g, "textures");
    g->image_count = gltf_length(g, "images");
    g->default_material = KILN_NONE;
    if (g->status == KILN_OK)
        gltf_take(g, kiln_allocate(&g->materials, g->material_count, sizeof *g->materials, "materials", g->error));
    if (g->status == KILN_OK)
        gltf_take(g, kiln_allocate(&g->image_of, g->image_count, sizeof *g->image_of, "images", g->error));
    g->images = (struct kiln_images){.confine = g->confine, .builder = g->builder};
    if (g->status == KILN_OK)
        gltf_take(g, kiln_allocate(&g->texture_of, 2 * g->texture_count, sizeof *g->texture_of, "textures", g->error));
    if (g->status != KILN_OK)
        return;
    memset(g->texture_of, 0xff, 2 * g->texture_count * sizeof *g->texture_of);
    check_references(g);
    for (size_t i = 0; i < g->material_count && g->status == KILN_OK; i++)
        read_material(g, i);
}

uint32_t gltf_default_material(struct gltf *g)
{
    if (g->default_material != KILN_NONE || g->status != KILN_OK)
        return g->default_material;
    struct kiln_material material = {.base_color = {0.8f, 0.8f, 0.8f, 1.0f},
                                     .base_color_texture = KILN_NONE,
                                     .emission_texture = KILN_NONE,
                                     .transmission_texture = KILN_NONE,
                                     .alpha_cutoff = 0.5f,
                                     .roughness = 1.0f};
    size_t index = 0;
    gltf_take(g, kiln_builder_string(g->builder, "default", 7, &material.name, g->error));
    gltf_take(g, kiln_builder_append(g->builder, KILN_SECTION_MATERIALS, &material, 1, &index, g->error));
    g->default_material = (uint32_t)index;
    return g->default_material;
}
