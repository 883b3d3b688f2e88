/* Gloss of the materials of .mtl files: Phong's model, or the extension for physically based materials, which becomes
 * glTF's model. Illumination models are those of Alias Wavefront's "MTL material format", version 4.2, 1995. */
#include <math.h>

#include "coordinator/import/obj_document.h"
#include "worker/scene/gloss.h"

void obj_gloss_begin(struct obj_gloss *gloss)
{
    *gloss = (struct obj_gloss){.filter = {1.0f, 1.0f, 1.0f}, .ior = 1.5f, .roughness = 1.0f, .illum = 2.0f};
}

/* ---- textures ---- */

/* Mean of a texture's first channel, 0..1, as it is coded. */
static float mean_of(const struct kiln_builder *builder, uint32_t index)
{
    const struct kiln_texture *t = &KILN_BUILDER_DATA(builder, const struct kiln_texture, KILN_SECTION_TEXTURES)[index];
    const uint8_t *texels = KILN_BUILDER_DATA(builder, const uint8_t, KILN_SECTION_TEXELS) + t->first;
    const uint64_t count = (uint64_t)t->width * t->height;
    uint64_t sum = 0;
    for (uint64_t i = 0; i < count; i++)
        sum += texels[4 * i];
    return (float)((double)sum / (255.0 * (double)count));
}

/* Reads a texture of gloss. If its file cannot be opened, it is left out with a note, since diffuse light does not need
 * it. Gloss coordinates are (u, 1 - v) of the file; a map's scale and offset refer to (u, v). */
static int add_map(struct obj_materials *m, const struct obj_material *material, const struct obj_map *map,
                   const char *what, struct kiln_gloss *gloss, enum kiln_gloss_use use)
{
    struct kiln_gloss_texture *texture = &gloss->textures[use];
    const float transform[6] = {map->scale[0], 0.0f,          map->offset[0],
                                0.0f,          map->scale[1], 1.0f - map->scale[1] - map->offset[1]};
    if (map->path == 0)
        return KILN_OK;
    if (!obj_map_opens(m, material, map))
        return kiln_builder_note(m->builder, KILN_NOTE_WARNING, m->error,
                                 "material '%.80s': the file of its %s, '%.200s', cannot be opened; it is left out",
                                 m->text + material->name, what, m->text + map->path);
    for (int i = 0; i < 6 && map->moved; i++)
        texture->transform[i] = transform[i];
    return obj_find_texture(m, material, map, use == KILN_GLOSS_SPECULAR_COLOR, what, "its factor stands alone",
                            &texture->texture);
}

static float mean_with(const struct obj_materials *m, const struct kiln_gloss *gloss, enum kiln_gloss_use use,
                       float factor)
{
    const uint32_t texture = gloss->textures[use].texture;
    return texture == KILN_NONE ? factor : factor * mean_of(m->builder, texture);
}

/* ---- models ---- */

/* Sets the transmission of glass: models 4, 6, 7 and 9, of which 6 and 7 refract. A file gives it as 1 - d or, with d =
 * 1, as Tf. */
static void set_transmission(const struct obj_material *source, int illum, struct kiln_gloss *gloss)
{
    const bool glass = illum == 4 || illum == 6 || illum == 7 || illum == 9;
    if (!glass || (source->alpha >= 1.0f && !source->gloss.has_filter))
        return;
    gloss->transmission = source->alpha < 1.0f ? 1.0f - source->alpha : 1.0f;
    for (int c = 0; c < 3; c++)
        gloss->filter[c] = source->gloss.filter[c];
    gloss->thickness = illum == 6 || illum == 7 ? 1.0f : 0.0f; /* of any size: the file says none */
    gloss->flags |= (illum == 6 || illum == 7 ? (uint32_t)KILN_GLOSS_VOLUME : 0u) |
                    (source->alpha < 1.0f ? (uint32_t)KILN_GLOSS_ALPHA_TRANSMITS : 0u);
}

static int set_physical(struct obj_materials *m, const struct obj_material *source, struct kiln_gloss *gloss)
{
    const struct obj_gloss *from = &source->gloss;
    gloss->roughness = from->has_roughness  ? from->roughness
                       : from->has_exponent ? kiln_gloss_phong_roughness(from->exponent)
                                            : 1.0f;
    gloss->metallic = from->metallic_map.path != 0 && from->metallic == 0.0f ? 1.0f : from->metallic;
    gloss->clearcoat = from->clearcoat;
    gloss->clearcoat_roughness = from->clearcoat > 0.0f ? from->clearcoat_roughness : 0.0f;
    gloss->anisotropy = from->anisotropy;
    gloss->anisotropy_rotation = from->anisotropy > 0.0f ? (float)(2.0 * KILN_PI * (double)from->rotation) : 0.0f;
    int status;
    KILN_TRY(add_map(m, source, &from->roughness_map, "map_Pr", gloss, KILN_GLOSS_ROUGHNESS));
    KILN_TRY(add_map(m, source, &from->metallic_map, "map_Pm", gloss, KILN_GLOSS_METALLIC));
    if (gloss->textures[KILN_GLOSS_METALLIC].texture == KILN_NONE)
        gloss->metallic = from->metallic;
end:
    gloss->mean_roughness = mean_with(m, gloss, KILN_GLOSS_ROUGHNESS, gloss->roughness);
    gloss->mean_metallic = mean_with(m, gloss, KILN_GLOSS_METALLIC, gloss->metallic);
    return status;
}

/* Model 0 and 1 have no specular lobe; 3 to 7 trace reflections: an ideal mirror. */
static int set_phong(struct obj_materials *m, const struct obj_material *source, int illum, struct kiln_gloss *gloss)
{
    const struct obj_gloss *from = &source->gloss;
    int status = KILN_OK;
    gloss->model = KILN_GLOSS_PHONG;
    gloss->exponent = from->exponent;
    for (int c = 0; c < 3; c++)
        gloss->specular_color[c] = illum >= 2 ? from->specular[c] : 0.0f;
    const bool lobe = gloss->specular_color[0] + gloss->specular_color[1] + gloss->specular_color[2] > 0.0f;
    if (illum >= 3 && illum <= 7)
        gloss->flags |= KILN_GLOSS_MIRROR;
    if (lobe)
        status = add_map(m, source, &from->specular_map, "map_Ks", gloss, KILN_GLOSS_SPECULAR_COLOR);
    if (status == KILN_OK && lobe)
        status = add_map(m, source, &from->exponent_map, "map_Ns", gloss, KILN_GLOSS_ROUGHNESS);
    gloss->mean_roughness =
        illum >= 3 && illum <= 7
            ? 0.0f
            : kiln_gloss_phong_roughness(mean_with(m, gloss, KILN_GLOSS_ROUGHNESS, gloss->exponent));
    return status;
}

int obj_add_gloss(struct obj_materials *m, struct obj_material *source, uint32_t index)
{
    const struct kiln_material *material =
        &KILN_BUILDER_DATA(m->builder, const struct kiln_material, KILN_SECTION_MATERIALS)[index];
    struct kiln_gloss gloss = kiln_gloss_default(material, index);
    const int illum = (int)source->gloss.illum;
    gloss.ior = fmaxf(source->gloss.ior, 1.0f);
    set_transmission(source, illum, &gloss);
    int status = source->gloss.physical ? set_physical(m, source, &gloss) : set_phong(m, source, illum, &gloss);
    const bool specular = gloss.specular_color[0] + gloss.specular_color[1] + gloss.specular_color[2] > 0.0f;
    if (status != KILN_OK || (!source->gloss.physical && !specular && gloss.transmission == 0.0f))
        return status;
    source->glossy = true;
    m->mended += source->gloss.mended + (source->gloss.ior < 1.0f);
    return kiln_builder_append(m->builder, KILN_SECTION_GLOSS, &gloss, 1, NULL, m->error);
}
