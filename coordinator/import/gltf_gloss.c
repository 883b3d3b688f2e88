/* Gloss of materials: metallic-roughness textures and KHR_materials_ior, _specular, _transmission, _volume,
 * _dispersion, _clearcoat, _anisotropy. Ranges are those of the specifications. */
#include <float.h>
#include <math.h>
#include <string.h>

#include "coordinator/import/gltf_document.h"
#include "worker/scene/gloss.h"

static const double most = 1e30; /* for numbers without an upper end: their products stay finite */

/* A material while its gloss is read. */
struct reader {
    struct gltf *g;
    struct gltf_place place;
    struct gltf_texture_use *set; /* the set of coordinates of its gloss's textures */
    struct kiln_gloss *gloss;
};

static double linear_of_srgb(double code) { return code <= 0.04045 ? code / 12.92 : pow((code + 0.055) / 1.055, 2.4); }

/* Replaces a texture that has another set of coordinates than the gloss's first one by its mean: the gloss has one set
 * of coordinates. The directions of a normal map or of anisotropy have no mean. */
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

/* Reads the texture `key` of `parent`, which multiplies `count` factors; `channel` is the first of them in the texture.
 * If the factors are 0, a texture changes nothing and is not decoded. */
static void read_texture(struct reader *r, const json_t *parent, const char *key, enum kiln_gloss_use use,
                         unsigned channel, float *factors, unsigned count)
{
    struct gltf_texture_use info;
    bool dark = count > 0;
    gltf_texture_info(r->g, r->place, parent, key, &info);
    for (unsigned c = 0; c < count; c++)
        dark = dark && factors[c] == 0.0f;
    if (r->g->status != KILN_OK || info.texture == KILN_NONE || dark)
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

static float share(struct reader *r, const json_t *object, const char *key, double absent)
{
    return (float)gltf_number(r->g, r->place, object, key, 0.0, 1.0, absent);
}

static void colour(struct reader *r, const json_t *object, const char *key, double high, float to[3])
{
    double values[3];
    if (gltf_numbers(r->g, r->place, object, key, 0.0, high, 3, values))
        for (int c = 0; c < 3; c++)
            to[c] = (float)values[c];
}

/* ---- the parts ---- */

static void read_base(struct reader *r, const json_t *json)
{
    struct kiln_gloss *gloss = r->gloss;
    const json_t *pbr = gltf_object(r->g, r->place, json, "pbrMetallicRoughness");
    gloss->metallic = share(r, pbr, "metallicFactor", 1.0);
    gloss->roughness = gloss->mean_roughness = share(r, pbr, "roughnessFactor", 1.0);
    read_texture(r, pbr, "metallicRoughnessTexture", KILN_GLOSS_METALLIC, 2, &gloss->metallic, 1);
    read_texture(r, pbr, "metallicRoughnessTexture", KILN_GLOSS_ROUGHNESS, 1, &gloss->roughness, 1);
    struct gltf_texture_use info;
    gltf_texture_info(r->g, r->place, pbr, "metallicRoughnessTexture", &info);
    if (info.texture != KILN_NONE && gloss->roughness > 0.0f && r->g->status == KILN_OK)
        gloss->mean_roughness = (float)fmin(1.0, (double)gloss->roughness * gltf_image_mean(r->g, info.texture, 1));
}

static void read_ior(struct reader *r, const json_t *json)
{
    const json_t *ior = gltf_extension(r->g, r->place, json, "KHR_materials_ior");
    const double value = gltf_number(r->g, r->place, ior, "ior", 0.0, most, 1.5);
    if (value > 0.0 && value < 1.0)
        gltf_fail(r->g, r->place, "extensions.KHR_materials_ior.ior", "is %.9g, neither 0 nor at least 1", value);
    r->gloss->ior = (float)value;
}

static void read_specular(struct reader *r, const json_t *json)
{
    const json_t *specular = gltf_extension(r->g, r->place, json, "KHR_materials_specular");
    if (specular == NULL)
        return;
    r->gloss->specular = share(r, specular, "specularFactor", 1.0);
    colour(r, specular, "specularColorFactor", most, r->gloss->specular_color);
    read_texture(r, specular, "specularTexture", KILN_GLOSS_SPECULAR, 3, &r->gloss->specular, 1);
    if (r->gloss->specular > 0.0f)
        read_texture(r, specular, "specularColorTexture", KILN_GLOSS_SPECULAR_COLOR, 0, r->gloss->specular_color, 3);
}

static void read_transmission(struct reader *r, const json_t *json)
{
    const json_t *transmission = gltf_extension(r->g, r->place, json, "KHR_materials_transmission");
    r->gloss->transmission = share(r, transmission, "transmissionFactor", 0.0);
    read_texture(r, transmission, "transmissionTexture", KILN_GLOSS_TRANSMISSION, 0, &r->gloss->transmission, 1);
}

/* Volume and dispersion, which mean nothing where no light gets in. Some exporters write the largest float for a body
 * that absorbs nothing. */
static void read_volume(struct reader *r, const json_t *json)
{
    struct kiln_gloss *gloss = r->gloss, body = *gloss;
    const json_t *volume = gltf_extension(r->g, r->place, json, "KHR_materials_volume"),
                 *dispersion = gltf_extension(r->g, r->place, json, "KHR_materials_dispersion");
    const double distance = gltf_number(r->g, r->place, volume, "attenuationDistance", 0.0, DBL_MAX, DBL_MAX);
    if (distance == 0.0)
        gltf_fail(r->g, r->place, "extensions.KHR_materials_volume.attenuationDistance", "is 0, not above 0");
    body.thickness = (float)gltf_number(r->g, r->place, volume, "thicknessFactor", 0.0, most, 0.0);
    body.attenuation_distance = distance > most ? 0.0f : fmaxf((float)distance, FLT_MIN);
    colour(r, volume, "attenuationColor", 1.0, body.attenuation_color);
    body.dispersion = (float)gltf_number(r->g, r->place, dispersion, "dispersion", 0.0, most, 0.0);
    if (!(body.thickness > 0.0f) || !(gloss->transmission > 0.0f))
        return;
    body.flags |= KILN_GLOSS_VOLUME;
    *gloss = body;
    read_texture(r, volume, "thicknessTexture", KILN_GLOSS_THICKNESS, 1, &gloss->thickness, 1);
}

/* The clear coat's normal map, unless its image is none, as of a material's own normal map. */
static void read_clearcoat_normal(struct reader *r, const json_t *clearcoat)
{
    struct kiln_gloss_texture *use = &r->gloss->textures[KILN_GLOSS_CLEARCOAT_NORMAL];
    const json_t *info = gltf_object(r->g, r->place, clearcoat, "clearcoatNormalTexture");
    const double scale = info != NULL ? gltf_number(r->g, r->place, info, "scale", -1e6, 1e6, 1.0) : 0.0;
    if (scale == 0.0) /* such a map is flat */
        return;
    read_texture(r, clearcoat, "clearcoatNormalTexture", KILN_GLOSS_CLEARCOAT_NORMAL, 0, NULL, 0);
    if (r->g->status != KILN_OK || use->texture == KILN_NONE)
        return;
    r->gloss->clearcoat_normal_scale = (float)scale;
    const uint32_t image = gltf_source_image(r->g, gltf_index(r->g, r->place, info, "index", r->g->texture_count));
    const char *why = kiln_image_no_normals(&r->g->images, &r->g->image_of[image]);
    if (why == NULL)
        return;
    use->texture = KILN_NONE;
    gltf_take(r->g, kiln_builder_note(r->g->builder, KILN_NOTE_WARNING, r->g->error,
                                      "materials[%zu].clearcoatNormalTexture: its image is no normal map (%s) and is "
                                      "left out",
                                      r->place.index, why));
}

static void read_clearcoat(struct reader *r, const json_t *json)
{
    struct kiln_gloss *gloss = r->gloss;
    const json_t *clearcoat = gltf_extension(r->g, r->place, json, "KHR_materials_clearcoat");
    const float roughness = share(r, clearcoat, "clearcoatRoughnessFactor", 0.0);
    gloss->clearcoat = share(r, clearcoat, "clearcoatFactor", 0.0);
    if (!(gloss->clearcoat > 0.0f))
        return;
    gloss->clearcoat_roughness = roughness;
    read_texture(r, clearcoat, "clearcoatTexture", KILN_GLOSS_CLEARCOAT, 0, &gloss->clearcoat, 1);
    read_texture(r, clearcoat, "clearcoatRoughnessTexture", KILN_GLOSS_CLEARCOAT_ROUGHNESS, 1,
                 &gloss->clearcoat_roughness, 1);
    read_clearcoat_normal(r, clearcoat);
}

/* Anisotropy has a direction along u, so that it needs coordinates without a texture too: those of the normal map or
 * else the first set, as glTF defines tangents. */
static void read_anisotropy(struct reader *r, const json_t *json)
{
    struct kiln_gloss *gloss = r->gloss;
    const json_t *anisotropy = gltf_extension(r->g, r->place, json, "KHR_materials_anisotropy");
    const double rotation = gltf_number(r->g, r->place, anisotropy, "anisotropyRotation", -1e6, 1e6, 0.0);
    gloss->anisotropy = share(r, anisotropy, "anisotropyStrength", 0.0);
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
        r->set->texture = 0; /* any: the set is wanted, not a texture */
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
    *gloss = plain;
    for (size_t i = 0; i < sizeof parts / sizeof parts[0] && g->status == KILN_OK; i++)
        parts[i](&r, json);
    const bool says_more = memcmp(gloss, &plain, sizeof plain) != 0;
    if (g->status == KILN_OK && (says_more || kiln_gloss_needed(material, gloss, KILN_GLOSS_MODE_AUTO)))
        gltf_take(g, kiln_builder_append(g->builder, KILN_SECTION_GLOSS, gloss, 1, NULL, g->error));
}
