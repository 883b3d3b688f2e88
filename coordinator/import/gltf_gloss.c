/* Gloss of materials: metallic-roughness textures and KHR_materials_ior, _specular, _transmission, _volume,
 * _dispersion, _clearcoat, _anisotropy. */
#include <float.h>
#include <math.h>
#include <string.h>

#include "coordinator/import/gltf_document.h"
#include "worker/scene/gloss.h"

enum { AFTER_SPECULAR = 3 }; /* index of the first part that is read with specular-glossiness, too */

static const double unbounded = 1e30; /* attenuation distance beyond which a body absorbs nothing, m */

/* State of reading a material's gloss. */
struct reader {
    struct gltf *g;
    struct gltf_place place;
    struct gltf_texture_use *set; /* texture coordinate set of the gloss's textures */
    struct kiln_gloss *gloss;
};

static double linear_of_srgb(double code) { return code <= 0.04045 ? code / 12.92 : pow((code + 0.055) / 1.055, 2.4); }

/* Replaces a texture by its mean if its coordinate set is not that of the gloss's first texture, since gloss has a
 * single set. Directions (normal maps, anisotropy) have no mean. */
static void take_mean(struct reader *r, const char *key, uint32_t texture, enum kiln_gloss_use use, unsigned channel,
                      float *factors, unsigned count)
{
    const bool srgb = use == KILN_GLOSS_SPECULAR_COLOR;
    for (unsigned c = 0; c < count; c++) {
        const double mean = gltf_image_mean(r->g, texture, channel + c);
        factors[c] = (float)((double)factors[c] * (srgb ? linear_of_srgb(mean) : mean));
    }
    if (r->g->status == KILN_OK)
        gltf_take(r->g, kiln_builder_note(r->g->builder, KILN_NOTE_INFORMATION, r->g->error,
                                          "materials[%zu]: its %s has another set of coordinates than the first "
                                          "texture of its gloss and is %s",
                                          r->place.index, key, count > 0 ? "replaced by its mean" : "left out"));
}

/* Reads the texture `key` of `parent`, which multiplies `count` factors; the first one corresponds to `channel` of the
 * texture. A texture of factors that are all 0 has no effect, and is not decoded. */
static void read_texture(struct reader *r, const json_t *parent, const char *key, enum kiln_gloss_use use,
                         unsigned channel, float *factors, unsigned count)
{
    struct gltf_texture_use info;
    bool dark = count > 0;
    gltf_texture_info(r->g, r->place, parent, key, &info);
    for (unsigned c = 0; c < count; c++)
        dark = dark && factors[c] == 0.0f;
    if (r->g->status != KILN_OK || info.texture == KILN_NONE || dark ||
        gltf_texture_is_missing(r->g, info.texture, GLTF_IMAGE_FOR_REST))
        return;
    if (r->set->texture == KILN_NONE) {
        r->set->texture = info.texture;
        r->set->texcoord = info.texcoord;
    }
    if (r->set->texcoord != info.texcoord) {
        take_mean(r, key, info.texture, use, channel, factors, count);
        return;
    }
    struct kiln_gloss_texture *texture = &r->gloss->textures[use];
    texture->texture = gltf_builder_texture(r->g, info.texture, use == KILN_GLOSS_SPECULAR_COLOR);
    texture->channel = count == 1 ? channel : 0;
    memcpy(texture->transform, info.transform, sizeof texture->transform);
}

static float number(struct reader *r, const json_t *object, enum kiln_number which, double absent)
{
    return (float)gltf_number(r->g, r->place, object, which, absent);
}

static void colour(struct reader *r, const json_t *object, enum kiln_number which, float to[3])
{
    double values[3];
    if (gltf_numbers(r->g, r->place, object, which, 3, values))
        for (int c = 0; c < 3; c++)
            to[c] = (float)values[c];
}

/* ---- the parts ---- */

static void read_base(struct reader *r, const json_t *json)
{
    struct kiln_gloss *gloss = r->gloss;
    const json_t *pbr = gltf_object(r->g, r->place, json, "pbrMetallicRoughness");
    gloss->metallic = number(r, pbr, KILN_NUMBER_METALLIC, 1.0);
    gloss->roughness = gloss->mean_roughness = number(r, pbr, KILN_NUMBER_ROUGHNESS, 1.0);
    struct gltf_texture_use info;
    gltf_texture_info(r->g, r->place, pbr, "metallicRoughnessTexture", &info);
    if (gltf_texture_is_missing(r->g, info.texture, GLTF_IMAGE_FOR_REST)) { /* metal only where a picture says so */
        gloss->metallic = gloss->mean_metallic = 0.0f;
        return;
    }
    read_texture(r, pbr, "metallicRoughnessTexture", KILN_GLOSS_METALLIC, 2, &gloss->metallic, 1);
    read_texture(r, pbr, "metallicRoughnessTexture", KILN_GLOSS_ROUGHNESS, 1, &gloss->roughness, 1);
    if (info.texture != KILN_NONE && gloss->roughness > 0.0f && r->g->status == KILN_OK)
        gloss->mean_roughness = (float)fmin(1.0, (double)gloss->roughness * gltf_image_mean(r->g, info.texture, 1));
}

/* ---- specular and glossiness ---- */

static float largest(const float rgb[3]) { return fmaxf(rgb[0], fmaxf(rgb[1], rgb[2])); }

/* Estimates the metal fraction of a specular colour: the part that no dielectric reflects. It only decides whether the
 * material is more than diffuse (kiln_gloss_kind). */
static float metal_of(float specular)
{
    const float dielectric = 0.08f;
    return fminf(fmaxf((specular - dielectric) / (1.0f - dielectric), 0.0f), 1.0f);
}

/* Makes the texture of roughness, 1 - factor x glossiness, from the alpha of a texture; false: there is no room. */
static bool make_roughness(struct reader *r, const struct gltf_texture_use *info, double factor)
{
    struct kiln_builder *builder = r->g->builder;
    const uint32_t from = gltf_builder_texture(r->g, info->texture, false);
    if (r->g->status != KILN_OK || from == KILN_NONE)
        return false;
    struct kiln_texture made = KILN_BUILDER_DATA(builder, const struct kiln_texture, KILN_SECTION_TEXTURES)[from];
    const size_t texels = (size_t)made.width * made.height;
    const uint64_t first = made.first;
    size_t at = 0, index = 0;
    if (!kiln_images_have_room(&r->g->images, texels))
        return false;
    gltf_take(r->g, kiln_builder_append(builder, KILN_SECTION_TEXELS, NULL, 4 * texels, &at, r->g->error));
    made.first = at;
    if (r->g->status == KILN_OK)
        gltf_take(r->g, kiln_builder_append(builder, KILN_SECTION_TEXTURES, &made, 1, &index, r->g->error));
    uint8_t *rgba = KILN_BUILDER_DATA(builder, uint8_t, KILN_SECTION_TEXELS);
    for (size_t i = 0; i < texels && r->g->status == KILN_OK; i++) {
        uint8_t *to = rgba + at + 4 * i;
        to[0] = to[1] = to[2] = (uint8_t)(255.0 - factor * (double)rgba[first + 4 * i + 3] + 0.5);
        to[3] = 255;
    }
    struct kiln_gloss_texture *use = &r->gloss->textures[KILN_GLOSS_ROUGHNESS];
    use->texture = (uint32_t)index;
    use->channel = 1;
    memcpy(use->transform, info->transform, sizeof use->transform);
    r->gloss->roughness = 1.0f;
    return r->g->status == KILN_OK;
}

static void read_roughness(struct reader *r, const struct gltf_texture_use *info, double factor)
{
    struct kiln_gloss *gloss = r->gloss;
    gloss->roughness = gloss->mean_roughness = (float)(1.0 - factor);
    if (r->g->status != KILN_OK || info->texture == KILN_NONE || factor == 0.0 ||
        gltf_texture_is_missing(r->g, info->texture, GLTF_IMAGE_FOR_REST))
        return;
    gloss->mean_roughness = (float)(1.0 - factor * gltf_image_mean(r->g, info->texture, 3));
    const bool fits = r->set->texture == KILN_NONE || r->set->texcoord == info->texcoord;
    if (fits && r->set->texture == KILN_NONE) {
        r->set->texture = info->texture;
        r->set->texcoord = info->texcoord;
    }
    if ((!fits || !make_roughness(r, info, factor)) && r->g->status == KILN_OK)
        gloss->roughness = gloss->mean_roughness;
}

/* Converts KHR_materials_pbrSpecularGlossiness to glTF's later model. An infinite index reflects the specular colour at
 * any angle, and leaves the rest to the diffuse part (KHR_materials_ior, "ior: 0"). The roughness is 1 - glossiness. */
static void read_glossiness(struct reader *r, const json_t *extension)
{
    struct kiln_gloss *gloss = r->gloss;
    struct gltf_texture_use info;
    double mean[3] = {1.0, 1.0, 1.0};
    gltf_texture_info(r->g, r->place, extension, "specularGlossinessTexture", &info);
    if (gloss->metallic > 0.0f) { /* pure metal: its colour is the material's */
        read_roughness(r, &info, number(r, extension, KILN_NUMBER_GLOSSINESS, 1.0));
        return;
    }
    gloss->ior = 0.0f;
    colour(r, extension, KILN_NUMBER_SPECULAR, gloss->specular_color);
    const bool missing = gltf_texture_is_missing(r->g, info.texture, GLTF_IMAGE_FOR_REST);
    for (unsigned c = 0; c < 3 && info.texture != KILN_NONE && !missing; c++)
        mean[c] = linear_of_srgb(gltf_image_mean(r->g, info.texture, c));
    const float specular[3] = {gloss->specular_color[0] * (float)mean[0], gloss->specular_color[1] * (float)mean[1],
                               gloss->specular_color[2] * (float)mean[2]};
    gloss->mean_metallic = metal_of(largest(specular));
    gloss->specular = largest(gloss->specular_color) > 0.0f ? 1.0f : 0.0f;
    read_texture(r, extension, "specularGlossinessTexture", KILN_GLOSS_SPECULAR_COLOR, 0, gloss->specular_color, 3);
    read_roughness(r, &info, number(r, extension, KILN_NUMBER_GLOSSINESS, 1.0));
}

/* ---- the other parts ---- */

static void read_ior(struct reader *r, const json_t *json)
{
    const json_t *ior = gltf_extension(r->g, r->place, json, "KHR_materials_ior");
    const double value = gltf_number(r->g, r->place, ior, KILN_NUMBER_IOR, 1.5);
    if (value > 0.0 && value < 1.0)
        gltf_fail(r->g, r->place, "extensions.KHR_materials_ior.ior", "is %.9g, neither 0 nor at least 1", value);
    r->gloss->ior = (float)value;
}

static void read_specular(struct reader *r, const json_t *json)
{
    const json_t *specular = gltf_extension(r->g, r->place, json, "KHR_materials_specular");
    if (specular == NULL)
        return;
    r->gloss->specular = number(r, specular, KILN_NUMBER_SPECULAR, 1.0);
    colour(r, specular, KILN_NUMBER_SPECULAR_COLOR, r->gloss->specular_color);
    read_texture(r, specular, "specularTexture", KILN_GLOSS_SPECULAR, 3, &r->gloss->specular, 1);
    if (r->gloss->specular > 0.0f)
        read_texture(r, specular, "specularColorTexture", KILN_GLOSS_SPECULAR_COLOR, 0, r->gloss->specular_color, 3);
}

static void read_transmission(struct reader *r, const json_t *json)
{
    const json_t *transmission = gltf_extension(r->g, r->place, json, "KHR_materials_transmission");
    r->gloss->transmission = number(r, transmission, KILN_NUMBER_TRANSMISSION, 0.0);
    read_texture(r, transmission, "transmissionTexture", KILN_GLOSS_TRANSMISSION, 0, &r->gloss->transmission, 1);
}

/* Reads volume and dispersion, which have no effect on opaque materials. Some exporters write the largest float for a
 * body that absorbs nothing. */
static void read_volume(struct reader *r, const json_t *json)
{
    struct kiln_gloss *gloss = r->gloss, body = *gloss;
    const json_t *volume = gltf_extension(r->g, r->place, json, "KHR_materials_volume"),
                 *dispersion = gltf_extension(r->g, r->place, json, "KHR_materials_dispersion");
    const double distance = gltf_number(r->g, r->place, volume, KILN_NUMBER_ATTENUATION, DBL_MAX);
    if (distance == 0.0)
        gltf_fail(r->g, r->place, "extensions.KHR_materials_volume.attenuationDistance", "is 0, not above 0");
    body.thickness = number(r, volume, KILN_NUMBER_THICKNESS, 0.0);
    body.attenuation_distance = distance > unbounded ? 0.0f : fmaxf((float)distance, FLT_MIN);
    colour(r, volume, KILN_NUMBER_ATTENUATION_COLOR, body.attenuation_color);
    body.dispersion = number(r, dispersion, KILN_NUMBER_DISPERSION, 0.0);
    if (!(body.thickness > 0.0f) || !(gloss->transmission > 0.0f))
        return;
    body.flags |= KILN_GLOSS_VOLUME;
    *gloss = body;
    read_texture(r, volume, "thicknessTexture", KILN_GLOSS_THICKNESS, 1, &gloss->thickness, 1);
}

/* Reads the clear coat's normal map, unless its image is no normal map; the same check as for the material's own
 * map. */
static void read_clearcoat_normal(struct reader *r, const json_t *clearcoat)
{
    struct kiln_gloss_texture *use = &r->gloss->textures[KILN_GLOSS_CLEARCOAT_NORMAL];
    const json_t *info = gltf_object(r->g, r->place, clearcoat, "clearcoatNormalTexture");
    const double scale = info != NULL ? gltf_number(r->g, r->place, info, KILN_NUMBER_NORMAL_SCALE, 1.0) : 0.0;
    if (scale == 0.0) /* such a map is flat */
        return;
    struct gltf_texture_use use_of;
    gltf_texture_info(r->g, r->place, clearcoat, "clearcoatNormalTexture", &use_of);
    const uint32_t made = gltf_directions_texture(r->g, r->place, use_of.texture, "clearcoatNormalTexture",
                                                  "the clear coat is baked without it");
    if (made == KILN_NONE)
        return;
    read_texture(r, clearcoat, "clearcoatNormalTexture", KILN_GLOSS_CLEARCOAT_NORMAL, 0, NULL, 0);
    if (r->g->status == KILN_OK && use->texture != KILN_NONE)
        r->gloss->clearcoat_normal_scale = (float)scale;
}

static void read_clearcoat(struct reader *r, const json_t *json)
{
    struct kiln_gloss *gloss = r->gloss;
    const json_t *clearcoat = gltf_extension(r->g, r->place, json, "KHR_materials_clearcoat");
    const float roughness = number(r, clearcoat, KILN_NUMBER_CLEARCOAT_ROUGHNESS, 0.0);
    gloss->clearcoat = number(r, clearcoat, KILN_NUMBER_CLEARCOAT, 0.0);
    if (!(gloss->clearcoat > 0.0f))
        return;
    gloss->clearcoat_roughness = roughness;
    read_texture(r, clearcoat, "clearcoatTexture", KILN_GLOSS_CLEARCOAT, 0, &gloss->clearcoat, 1);
    read_texture(r, clearcoat, "clearcoatRoughnessTexture", KILN_GLOSS_CLEARCOAT_ROUGHNESS, 1,
                 &gloss->clearcoat_roughness, 1);
    read_clearcoat_normal(r, clearcoat);
}

/* Reads anisotropy. Its direction is relative to u, so it needs coordinates even without a texture: those of the normal
 * map, or else the first set, from which glTF defines tangents. */
static void read_anisotropy(struct reader *r, const json_t *json)
{
    struct kiln_gloss *gloss = r->gloss;
    const json_t *anisotropy = gltf_extension(r->g, r->place, json, "KHR_materials_anisotropy");
    const double rotation = gltf_number(r->g, r->place, anisotropy, KILN_NUMBER_ANISOTROPY_ROTATION, 0.0);
    gloss->anisotropy = number(r, anisotropy, KILN_NUMBER_ANISOTROPY, 0.0);
    if (!(gloss->anisotropy > 0.0f))
        return;
    gloss->anisotropy_rotation = (float)rotation;
    struct gltf_texture_use info;
    gltf_texture_info(r->g, r->place, anisotropy, "anisotropyTexture", &info);
    if (info.texture != KILN_NONE && r->set->texture != KILN_NONE && info.texcoord != r->set->texcoord)
        take_mean(r, "anisotropyTexture", info.texture, KILN_GLOSS_ANISOTROPY, 2, &gloss->anisotropy, 1);
    else
        read_texture(r, anisotropy, "anisotropyTexture", KILN_GLOSS_ANISOTROPY, 0, NULL, 0);
    const struct gltf_texture_use *normal = &r->g->materials[r->place.index].normal;
    if (r->set->texture == KILN_NONE) {
        r->set->texture = 0; /* any index: only the set is used, no texture */
        r->set->texcoord = normal->texture != KILN_NONE ? normal->texcoord : 0;
    }
}

void gltf_read_gloss(struct gltf *g, struct gltf_place place, const json_t *json, const struct kiln_material *material,
                     uint32_t index, struct kiln_gloss *gloss)
{
    const struct kiln_gloss plain = kiln_gloss_default(material, index);
    struct gltf_texture_use *set = &g->materials[place.index].gloss;
    *set = (struct gltf_texture_use){.texture = KILN_NONE, .transform = {1.0f, 0.0f, 0.0f, 0.0f, 1.0f, 0.0f}};
    struct reader r = {g, place, set, gloss};
    static void (*const parts[])(struct reader *, const json_t *) = {
        read_base, read_ior, read_specular, read_transmission, read_volume, read_clearcoat, read_anisotropy};
    const bool unlit = gltf_extension(g, place, json, "KHR_materials_unlit") != NULL;
    const json_t *glossiness = gltf_specular_glossiness(g, place, json);
    *gloss = plain;
    if (glossiness != NULL)
        read_glossiness(&r, glossiness);
    for (size_t i = glossiness != NULL ? AFTER_SPECULAR : 0; i < sizeof parts / sizeof parts[0] && !unlit; i++)
        if (g->status == KILN_OK)
            parts[i](&r, json);
    const bool says_more = memcmp(gloss, &plain, sizeof plain) != 0;
    if (g->status == KILN_OK && (says_more || kiln_gloss_needed(material, gloss, KILN_GLOSS_MODE_AUTO)))
        gltf_take(g, kiln_builder_append(g->builder, KILN_SECTION_GLOSS, gloss, 1, NULL, g->error));
}
