/* Writes gloss as glTF's extensions, as coordinator/import/gltf_gloss.c reads them. */
#include <math.h>

#include "coordinator/export/child.h"
#include "worker/scene/gloss.h"

/* A material while its gloss is written. */
struct writer {
    struct kiln_glb_build *b;
    const struct kiln_gloss *gloss;
    json_t *material;
    int set; /* the TEXCOORD of texcoord_gloss */
};

static void set_extension(struct writer *w, const char *name, json_t *json)
{
    kiln_glb_set(w->b, kiln_glb_object(w->b, w->material, "extensions"), name, json);
    kiln_glb_use(w->b, name);
}

/* Sets a texture, if there is one. Its transform is split into scale, rotation and offset. This is possible because the
 * columns of a transform that was read are perpendicular. */
static void set_texture(struct writer *w, json_t *json, const char *key, enum kiln_gloss_use use)
{
    const struct kiln_gloss_texture *texture = &w->gloss->textures[use];
    const float *t = texture->transform;
    if (texture->texture == KILN_NONE)
        return;
    json_t *info = json_pack("{s:i, s:i}", "index", (int)texture->texture, "texCoord", w->set);
    if (t[0] != 1.0f || t[1] != 0.0f || t[2] != 0.0f || t[3] != 0.0f || t[4] != 1.0f || t[5] != 0.0f) {
        const double a = (double)t[0], b = (double)t[1], d = (double)t[3], e = (double)t[4];
        const bool flat = a == 0.0 && d == 0.0; /* the first column is 0, so the rotation is taken from the second */
        const double rotation = flat ? atan2(b, e) : atan2(-d, a), turned = a * e - b * d < 0.0 ? -1.0 : 1.0;
        kiln_glb_set(w->b, kiln_glb_object(w->b, info, "extensions"), "KHR_texture_transform",
                     json_pack("{s:[f, f], s:f, s:[f, f]}", "offset", (double)t[2], (double)t[5], "rotation", rotation,
                               "scale", hypot(a, d), turned * hypot(b, e)));
        kiln_glb_use(w->b, "KHR_texture_transform");
    }
    kiln_glb_set(w->b, json, key, info);
}

/* Whether one texture has metallic and roughness in glTF's channels. Maps of an .mtl file are separate. */
static bool is_one_texture(const struct kiln_gloss *gloss)
{
    const struct kiln_gloss_texture *metallic = &gloss->textures[KILN_GLOSS_METALLIC],
                                    *roughness = &gloss->textures[KILN_GLOSS_ROUGHNESS];
    bool same = (metallic->texture == KILN_NONE || metallic->channel == 2) &&
                (roughness->texture == KILN_NONE || roughness->channel == 1);
    if (metallic->texture == KILN_NONE || roughness->texture == KILN_NONE)
        return same && (metallic->texture != KILN_NONE ? gloss->roughness == 0.0f : gloss->metallic == 0.0f);
    same = same && metallic->texture == roughness->texture;
    for (int i = 0; i < 6; i++)
        same = same && metallic->transform[i] == roughness->transform[i];
    return same;
}

static void set_base(struct writer *w)
{
    const struct kiln_gloss *g = w->gloss;
    json_t *surface = kiln_glb_object(w->b, w->material, "pbrMetallicRoughness");
    const bool one = is_one_texture(g), phong = g->model == KILN_GLOSS_PHONG;
    kiln_glb_set(w->b, surface, "metallicFactor", json_real((double)(one && !phong ? g->metallic : g->mean_metallic)));
    kiln_glb_set(w->b, surface, "roughnessFactor",
                 json_real((double)(one && !phong ? g->roughness : g->mean_roughness)));
    if (one && !phong)
        set_texture(w, surface, "metallicRoughnessTexture",
                    g->textures[KILN_GLOSS_METALLIC].texture != KILN_NONE ? KILN_GLOSS_METALLIC : KILN_GLOSS_ROUGHNESS);
}

static void set_specular(struct writer *w)
{
    const struct kiln_gloss *g = w->gloss;
    if (g->specular == 1.0f && g->specular_color[0] == 1.0f && g->specular_color[1] == 1.0f &&
        g->specular_color[2] == 1.0f && g->textures[KILN_GLOSS_SPECULAR].texture == KILN_NONE &&
        g->textures[KILN_GLOSS_SPECULAR_COLOR].texture == KILN_NONE)
        return;
    json_t *specular =
        json_pack("{s:f, s:[f, f, f]}", "specularFactor", (double)g->specular, "specularColorFactor",
                  (double)g->specular_color[0], (double)g->specular_color[1], (double)g->specular_color[2]);
    set_texture(w, specular, "specularTexture", KILN_GLOSS_SPECULAR);
    set_texture(w, specular, "specularColorTexture", KILN_GLOSS_SPECULAR_COLOR);
    set_extension(w, "KHR_materials_specular", specular);
}

static void set_glass(struct writer *w)
{
    const struct kiln_gloss *g = w->gloss;
    json_t *transmission = json_pack("{s:f}", "transmissionFactor", (double)g->transmission);
    set_texture(w, transmission, "transmissionTexture", KILN_GLOSS_TRANSMISSION);
    set_extension(w, "KHR_materials_transmission", transmission);
    if ((g->flags & KILN_GLOSS_VOLUME) == 0)
        return;
    json_t *volume = json_pack("{s:f}", "thicknessFactor", (double)g->thickness);
    set_texture(w, volume, "thicknessTexture", KILN_GLOSS_THICKNESS);
    if (g->attenuation_distance > 0.0f) {
        kiln_glb_set(w->b, volume, "attenuationDistance", json_real((double)g->attenuation_distance));
        kiln_glb_set(w->b, volume, "attenuationColor",
                     json_pack("[f, f, f]", (double)g->attenuation_color[0], (double)g->attenuation_color[1],
                               (double)g->attenuation_color[2]));
    }
    set_extension(w, "KHR_materials_volume", volume);
    if (g->dispersion > 0.0f)
        set_extension(w, "KHR_materials_dispersion", json_pack("{s:f}", "dispersion", (double)g->dispersion));
}

static void set_clearcoat(struct writer *w)
{
    const struct kiln_gloss *g = w->gloss;
    json_t *coat = json_pack("{s:f, s:f}", "clearcoatFactor", (double)g->clearcoat, "clearcoatRoughnessFactor",
                             (double)g->clearcoat_roughness);
    set_texture(w, coat, "clearcoatTexture", KILN_GLOSS_CLEARCOAT);
    set_texture(w, coat, "clearcoatRoughnessTexture", KILN_GLOSS_CLEARCOAT_ROUGHNESS);
    set_texture(w, coat, "clearcoatNormalTexture", KILN_GLOSS_CLEARCOAT_NORMAL);
    json_t *normal = json_object_get(coat, "clearcoatNormalTexture");
    if (normal != NULL)
        kiln_glb_set(w->b, normal, "scale", json_real((double)g->clearcoat_normal_scale));
    set_extension(w, "KHR_materials_clearcoat", coat);
}

static void set_anisotropy(struct writer *w)
{
    const struct kiln_gloss *g = w->gloss;
    json_t *anisotropy = json_pack("{s:f, s:f}", "anisotropyStrength", (double)g->anisotropy, "anisotropyRotation",
                                   (double)g->anisotropy_rotation);
    set_texture(w, anisotropy, "anisotropyTexture", KILN_GLOSS_ANISOTROPY);
    set_extension(w, "KHR_materials_anisotropy", anisotropy);
}

void kiln_export_gloss(struct kiln_glb_build *b, json_t *material, const struct kiln_gloss *gloss, int set)
{
    struct writer w = {b, gloss, material, set};
    set_base(&w);
    if (gloss->ior != 1.5f)
        set_extension(&w, "KHR_materials_ior", json_pack("{s:f}", "ior", (double)gloss->ior));
    if (gloss->model == KILN_GLOSS_METALLIC_ROUGHNESS)
        set_specular(&w);
    if (gloss->transmission > 0.0f)
        set_glass(&w);
    if (gloss->clearcoat > 0.0f)
        set_clearcoat(&w);
    if (gloss->anisotropy > 0.0f)
        set_anisotropy(&w);
}
