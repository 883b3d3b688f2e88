/* glTF materials, textures, samplers and images. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "coordinator/import/gltf_document.h"
#include "worker/base/arena.h"
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
        char path[1025], found[1025], where[64];
        (void)snprintf(where, sizeof where, "images[%u].uri", index);
        gltf_take(g, kiln_confine_decode(g->confine, uri, where, path, g->error));
        if (g->status == KILN_OK && kiln_confine_find(g->confine, "", path, found) == KILN_FOUND_NOT)
            (void)snprintf(found, sizeof found, "%s", path); /* the sentence says so */
        if (g->status == KILN_OK)
            gltf_take(g, kiln_confine_map(g->confine, g->builder, found, where, &bytes->file, g->error));
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

bool gltf_texture_is_missing(struct gltf *g, uint32_t texture, unsigned use)
{
    if (texture == KILN_NONE || g->status != KILN_OK)
        return false;
    const uint32_t image = gltf_source_image(g, texture);
    if (g->status != KILN_OK)
        return false;
    g->image_state[image] |= (uint8_t)use;
    return (g->image_state[image] & GLTF_IMAGE_MISSING) != 0;
}

uint32_t gltf_directions_texture(struct gltf *g, struct gltf_place place, uint32_t texture, const char *what,
                                 const char *without)
{
    struct kiln_error why = {""}, *told = g->error;
    if (texture == KILN_NONE || g->status != KILN_OK)
        return KILN_NONE;
    g->error = &why;
    uint32_t made = KILN_NONE;
    if (!gltf_texture_is_missing(g, texture, GLTF_IMAGE_FOR_NORMALS))
        made = gltf_builder_texture(g, texture, false);
    const int status = g->status;
    g->error = told;
    if (status != KILN_OK && (status != KILN_BAD_INPUT || g->builder->strict)) {
        g->status = kiln_fail(told, status, "%s", why.message);
        return KILN_NONE;
    }
    g->status = KILN_OK;
    const char *flaw =
        made != KILN_NONE ? kiln_image_no_normals(&g->images, &g->image_of[gltf_source_image(g, texture)]) : NULL;
    if (status == KILN_OK && flaw == NULL)
        return made;
    gltf_take(g, kiln_builder_note(g->builder, KILN_NOTE_WARNING, g->error,
                                   flaw != NULL ? "materials[%zu].%s: its image is no normal map (%s); %s"
                                                : "materials[%zu].%s: its image cannot be read (%.400s); %s",
                                   place.index, what, flaw != NULL ? flaw : why.message, without));
    return KILN_NONE;
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
    if (gltf_texture_is_missing(g, texture, 0))
        return KILN_NONE;
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
    (void)gltf_numbers(g, place, transform, KILN_NUMBER_TEXTURE_OFFSET, 2, offset);
    (void)gltf_numbers(g, place, transform, KILN_NUMBER_TEXTURE_SCALE, 2, scale);
    const double angle = gltf_number(g, place, transform, KILN_NUMBER_TEXTURE_ROTATION, 0.0);
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
    if (gltf_texture_is_missing(g, texture, GLTF_IMAGE_FOR_REST))
        return 1.0;
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
    material->transmission = (float)gltf_number(g, place, extension, KILN_NUMBER_TRANSMISSION, 0.0);
    gltf_texture_info(g, place, extension, "transmissionTexture", &use);
    if (g->status != KILN_OK || !(material->transmission > 0.0f))
        return;
    if (uses->base.texture == KILN_NONE) /* no other texture uses the base coordinates */
        uses->base = use;
    if (gltf_texture_is_missing(g, use.texture, GLTF_IMAGE_FOR_REST))
        return;
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
    const double scale = info != NULL ? gltf_number(g, place, info, KILN_NUMBER_NORMAL_SCALE, 1.0) : 0.0;
    if (scale == 0.0) /* such a map is flat */
        use->texture = KILN_NONE;
    const uint32_t texture =
        gltf_directions_texture(g, place, use->texture, "normalTexture", "kiln view shows the material without it");
    const struct kiln_normal_map map = {material, texture, (float)scale};
    if (texture == KILN_NONE)
        use->texture = KILN_NONE;
    else
        gltf_take(g, kiln_builder_append(g->builder, KILN_SECTION_NORMAL_MAPS, &map, 1, NULL, g->error));
}

/* Adds a note on how a material that transmits light is baked. */
static void note_glass(struct gltf *g, struct gltf_place place, const json_t *json, const struct kiln_material *m,
                       const struct kiln_gloss *gloss)
{
    const json_t *volume = gltf_extension(g, place, json, "KHR_materials_volume");
    const double thickness = volume != NULL ? gltf_number(g, place, volume, KILN_NUMBER_THICKNESS, 0.0) : 0.0;
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
    if (gltf_texture_is_missing(g, use.texture, GLTF_IMAGE_FOR_METAL)) {
        material->metallic = 0.0f;
        return;
    }
    /* gloss needs the whole texture, so it is decoded once for both */
    (void)gltf_builder_texture(g, use.texture, false);
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
    (void)gltf_numbers(g, place, json, KILN_NUMBER_EMISSIVE, 3, factor);
    if (fmax(factor[0], fmax(factor[1], factor[2])) > 1.0)
        gltf_take(g,
                  kiln_builder_note(g->builder, 1, g->error,
                                    "materials[%zu].emissiveFactor is above 1, which glTF forbids; it is used as it is",
                                    place.index));
    double strength = 1.0;
    const json_t *extension = gltf_extension(g, place, json, "KHR_materials_emissive_strength");
    if (extension != NULL)
        strength = gltf_number(g, place, extension, KILN_NUMBER_EMISSIVE_STRENGTH, 1.0);
    for (int c = 0; c < 3; c++) {
        const double value = factor[c] * strength;
        if (!kiln_number_fits(KILN_NUMBER_LIGHT, value))
            gltf_fail(g, place, "emissiveFactor", "times its strength is %g, more than %g", value,
                      kiln_number_range(KILN_NUMBER_LIGHT)->high);
        material->emission[c] = (float)value;
    }
}

static void read_alpha(struct gltf *g, struct gltf_place place, const json_t *json, struct kiln_material *material)
{
    const char *mode = gltf_string(g, place, json, "alphaMode");
    material->alpha_cutoff = (float)gltf_number(g, place, json, KILN_NUMBER_ALPHA_CUTOFF, 0.5);
    if (mode == NULL || strcmp(mode, "OPAQUE") == 0)
        material->alpha_mode = KILN_ALPHA_OPAQUE;
    else if (strcmp(mode, "MASK") == 0)
        material->alpha_mode = KILN_ALPHA_MASK;
    else if (strcmp(mode, "BLEND") == 0)
        material->alpha_mode = KILN_ALPHA_BLEND;
    else
        gltf_fail(g, place, "alphaMode", "is '%.20s', not one of OPAQUE, MASK, BLEND", mode);
}

/* Adds notes on the material's extensions whose effect in a bake is not the one that their names suggest. */
static void note_unused(struct gltf *g, struct gltf_place place, const json_t *json, bool unlit, bool glows)
{
    if (unlit)
        gltf_take(g, kiln_builder_note(g->builder, KILN_NOTE_INFORMATION, g->error,
                                       "materials[%zu] (KHR_materials_unlit): bakes as a diffuse surface of its base "
                                       "colour that is lit like any other%s",
                                       place.index,
                                       glows ? "; its emissiveFactor counts for nothing, as the extension says" : ""));
    if (gltf_extension(g, place, json, "KHR_materials_diffuse_transmission") != NULL)
        gltf_take(g, kiln_builder_note(g->builder, KILN_NOTE_INFORMATION, g->error,
                                       "materials[%zu] (KHR_materials_diffuse_transmission): bakes as a diffuse "
                                       "surface that lets no light through",
                                       place.index));
}

const json_t *gltf_specular_glossiness(struct gltf *g, struct gltf_place place, const json_t *material)
{
    return gltf_extension(g, place, material, "KHR_materials_unlit") != NULL
               ? NULL
               : gltf_extension(g, place, material, "KHR_materials_pbrSpecularGlossiness");
}

static bool glows(const struct kiln_material *m)
{
    return m->emission[0] > 0.0f || m->emission[1] > 0.0f || m->emission[2] > 0.0f;
}

/* Whether a specular-glossiness material is nothing but metal: black below a specular colour that no dielectric has. It
 * is then a metal of that colour, whose facets lose nothing. */
static bool is_pure_metal(struct gltf *g, struct gltf_place place, const json_t *gloss,
                          const struct kiln_material *material)
{
    const double black = 0.02, metal = 0.2;
    double specular[3] = {1.0, 1.0, 1.0};
    (void)gltf_numbers(g, place, gloss, KILN_NUMBER_SPECULAR, 3, specular);
    return material->alpha_mode == KILN_ALPHA_OPAQUE && json_object_get(gloss, "diffuseTexture") == NULL &&
           fmaxf(material->base_color[0], fmaxf(material->base_color[1], material->base_color[2])) < (float)black &&
           fmax(specular[0], fmax(specular[1], specular[2])) > metal;
}

/* Base colour, metal and roughness of a specular-glossiness material. */
static void read_specular_colors(struct gltf *g, struct gltf_place place, const json_t *gloss,
                                 struct kiln_material *material)
{
    material->metallic = 0.0f;
    material->roughness = 1.0f - (float)gltf_number(g, place, gloss, KILN_NUMBER_GLOSSINESS, 1.0);
    if (!is_pure_metal(g, place, gloss, material))
        return;
    double color[3] = {1.0, 1.0, 1.0};
    (void)gltf_numbers(g, place, gloss, KILN_NUMBER_SPECULAR, 3, color);
    for (int c = 0; c < 3; c++)
        material->base_color[c] = (float)color[c];
    material->metallic = 1.0f;
    gltf_texture_info(g, place, gloss, "specularGlossinessTexture", &g->materials[place.index].base);
}

/* Base colour, metal and roughness: of pbrMetallicRoughness or KHR_materials_pbrSpecularGlossiness. An unlit material
 * has its base colour only. */
static void read_colors(struct gltf *g, struct gltf_place place, const json_t *json, bool unlit,
                        struct kiln_material *material)
{
    const json_t *pbr = gltf_object(g, place, json, "pbrMetallicRoughness"),
                 *gloss = gltf_specular_glossiness(g, place, json);
    double color[4] = {1.0, 1.0, 1.0, 1.0};
    (void)gltf_numbers(g, place, gloss != NULL ? gloss : pbr,
                       gloss != NULL ? KILN_NUMBER_DIFFUSE : KILN_NUMBER_BASE_COLOR, 4, color);
    for (int c = 0; c < 4; c++)
        material->base_color[c] = (float)color[c];
    gltf_texture_info(g, place, gloss != NULL ? gloss : pbr, gloss != NULL ? "diffuseTexture" : "baseColorTexture",
                      &g->materials[place.index].base);
    material->metallic = (float)gltf_number(g, place, pbr, KILN_NUMBER_METALLIC, 1.0);
    material->roughness = (float)gltf_number(g, place, pbr, KILN_NUMBER_ROUGHNESS, 1.0);
    if (gloss != NULL)
        read_specular_colors(g, place, gloss, material);
    else if (!unlit)
        read_metallic(g, place, pbr, material);
    if (unlit) {
        material->metallic = 0.0f;
        material->roughness = 1.0f;
    }
    if (gltf_texture_is_missing(g, g->materials[place.index].base.texture, GLTF_IMAGE_FOR_REST))
        g->materials[place.index].base.texture = KILN_NONE;
}

/* Reads the emission. Unlit materials have none, nor have those whose emission texture is missing. */
static void read_light(struct gltf *g, struct gltf_place place, const json_t *json, bool unlit,
                       struct kiln_material *material)
{
    struct gltf_texture_use *use = &g->materials[place.index].emission;
    read_emission(g, place, json, material);
    gltf_texture_info(g, place, json, "emissiveTexture", use);
    note_unused(g, place, json, unlit, glows(material));
    kiln_kinds_add(&g->unused, unlit && glows(material), "emissions of unlit materials");
    kiln_kinds_add(&g->unused, !glows(material) && use->texture != KILN_NONE,
                   "emission textures beside an emissiveFactor of 0");
    const bool lost = !unlit && glows(material) && gltf_texture_is_missing(g, use->texture, GLTF_IMAGE_FOR_EMISSION);
    for (int c = 0; c < 3 && (unlit || lost); c++)
        material->emission[c] = 0.0f;
    if (!glows(material)) /* a black emitter needs no texture */
        use->texture = KILN_NONE;
}

static void read_material(struct gltf *g, size_t index)
{
    const struct gltf_place place = {"materials", index, ""};
    const json_t *json = gltf_element(g, "materials", index);
    const char *name = gltf_string(g, place, json, "name");
    const bool unlit = gltf_extension(g, place, json, "KHR_materials_unlit") != NULL;
    struct gltf_material *uses = &g->materials[index];
    struct kiln_material material = {
        .base_color_texture = KILN_NONE, .emission_texture = KILN_NONE, .transmission_texture = KILN_NONE};
    material.double_sided = gltf_bool(g, place, json, "doubleSided", false);
    read_alpha(g, place, json, &material);
    read_colors(g, place, json, unlit, &material);
    read_light(g, place, json, unlit, &material);
    material.base_color_texture = gltf_builder_texture(g, uses->base.texture, true);
    if (!unlit)
        read_transmission(g, place, json, uses, &material);
    material.emission_texture = gltf_builder_texture(g, uses->emission.texture, true);
    /* the texture is not decoded, but its reference must be valid */
    struct gltf_texture_use unused;
    gltf_texture_info(g, place, json, "occlusionTexture", &unused);
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

/* Looks for an image's file, under its name or a similar one. */
static void look_for(struct gltf *g, size_t index, const char *uri)
{
    char path[1025], found[1025], where[64];
    (void)snprintf(where, sizeof where, "images[%zu].uri", index);
    gltf_take(g, kiln_confine_decode(g->confine, uri, where, path, g->error));
    if (g->status != KILN_OK)
        return;
    const enum kiln_found way = kiln_confine_find(g->confine, "", path, found);
    if (way == KILN_FOUND_NOT)
        g->image_state[index] = GLTF_IMAGE_MISSING;
    if (way == KILN_FOUND_OTHERWISE)
        gltf_take(g, kiln_builder_note(g->builder, KILN_NOTE_REPEATED, g->error,
                                       "%s: '%.200s' is not in the scene's folder; '%.200s', which is, is used", where,
                                       path, found));
}

static void note_missing(struct gltf *g, size_t index)
{
    const unsigned uses = g->image_state[index];
    char path[1025], where[64];
    const char *instead = (uses & GLTF_IMAGE_FOR_EMISSION) != 0 ? "what it would light is dark"
                          : (uses & GLTF_IMAGE_FOR_METAL) != 0  ? "the materials that it would make metal are none"
                          : (uses & GLTF_IMAGE_FOR_REST) != 0   ? "white stands in for it"
                          : (uses & GLTF_IMAGE_FOR_NORMALS) != 0
                              ? "kiln view shows its materials without it; no bake needs it"
                              : "no bake needs it";
    const bool matters = (uses & (GLTF_IMAGE_FOR_EMISSION | GLTF_IMAGE_FOR_METAL | GLTF_IMAGE_FOR_REST)) != 0;
    (void)snprintf(where, sizeof where, "images[%zu].uri", index);
    gltf_take(g, kiln_confine_decode(
                     g->confine,
                     gltf_string(g, (struct gltf_place){"images", index, ""}, gltf_element(g, "images", index), "uri"),
                     where, path, g->error));
    if (g->status == KILN_OK)
        gltf_take(g,
                  kiln_missing_add(&g->missing, g->confine, g->builder, where, "", path, matters, instead, g->error));
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
        if (g->status == KILN_OK && uri != NULL && strncmp(uri, "data:", 5) != 0)
            look_for(g, i, uri);
    }
}

static void plan_image(struct gltf *g, size_t texture)
{
    const json_t *source = json_object_get(json_array_get(json_object_get(g->root, "textures"), texture), "source");
    const size_t image = json_is_integer(source) ? (size_t)json_integer_value(source) : SIZE_MAX;
    struct image_bytes bytes = {0};
    char where[640];
    if (image >= g->image_count || (g->image_state[image] & (GLTF_IMAGE_MISSING | GLTF_IMAGE_PLANNED)) != 0)
        return;
    g->image_state[image] |= GLTF_IMAGE_PLANNED;
    image_open(g, (uint32_t)image, &bytes);
    image_place(g, (uint32_t)image, where);
    const struct kiln_image_bytes encoded = {.data = bytes.data, .size = bytes.size, .where = where};
    if (g->status == KILN_OK)
        gltf_take(g, kiln_image_plan(&g->images, &encoded, g->error));
    image_close(&bytes);
}

static bool gives_directions(const char *key)
{
    return strcmp(key, "normalTexture") == 0 || strcmp(key, "clearcoatNormalTexture") == 0;
}

/* Counts the images of a material's textures: those of directions, or (`directions` false) all others except occlusion
 * maps, which are not used. A texture with factor 0 counts, too. */
static void plan_images(struct gltf *g, const json_t *value, bool directions)
{
    const char *key;
    json_t *member;
    json_object_foreach((json_t *)(uintptr_t)value, key, member)
    {
        const json_t *index = json_object_get(member, "index");
        if (json_is_integer(index) && gives_directions(key) == directions && strcmp(key, "occlusionTexture") != 0)
            plan_image(g, (size_t)json_integer_value(index));
        if (strcmp(key, "extras") != 0 && g->status == KILN_OK)
            plan_images(g, member, directions);
    }
}

/* Reserves room for all images. Direction maps without room are left out later. */
static void plan(struct gltf *g)
{
    struct kiln_error *told = g->error, dropped;
    for (size_t i = 0; i < g->material_count && g->status == KILN_OK; i++)
        plan_images(g, gltf_element(g, "materials", i), false);
    for (size_t i = 0; i < g->material_count && g->status == KILN_OK; i++) {
        g->error = &dropped;
        plan_images(g, gltf_element(g, "materials", i), true);
        g->status = KILN_OK;
        g->error = told;
    }
    if (g->status == KILN_OK)
        gltf_take(g, kiln_images_reserve(&g->images, g->error));
}

void gltf_read_materials(struct gltf *g)
{
    g->material_count = gltf_length(g, "materials");
    g->texture_count = gltf_length(g, "textures");
    g->image_count = gltf_length(g, "images");
    g->default_material = KILN_NONE;
    if (g->status == KILN_OK)
        gltf_take(g, kiln_arena_allocate(&g->arena, &g->materials, g->material_count, sizeof *g->materials, "materials",
                                         g->error));
    if (g->status == KILN_OK)
        gltf_take(
            g, kiln_arena_allocate(&g->arena, &g->image_of, g->image_count, sizeof *g->image_of, "images", g->error));
    if (g->status == KILN_OK)
        gltf_take(g, kiln_arena_allocate(&g->arena, &g->image_state, g->image_count, 1, "images", g->error));
    g->images = (struct kiln_images){.confine = g->confine, .builder = g->builder};
    if (g->status == KILN_OK)
        gltf_take(g, kiln_arena_allocate(&g->arena, &g->texture_of, 2 * g->texture_count, sizeof *g->texture_of,
                                         "textures", g->error));
    if (g->status != KILN_OK)
        return;
    memset(g->texture_of, 0xff, 2 * g->texture_count * sizeof *g->texture_of);
    check_references(g);
    plan(g);
    for (size_t i = 0; i < g->material_count && g->status == KILN_OK; i++)
        read_material(g, i);
    for (size_t i = 0; i < g->image_count && g->status == KILN_OK; i++)
        if ((g->image_state[i] & GLTF_IMAGE_MISSING) != 0)
            note_missing(g, i);
    if (g->status == KILN_OK)
        gltf_take(g, kiln_missing_end(&g->missing, g->confine, g->builder, g->error));
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
