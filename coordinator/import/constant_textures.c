#include "coordinator/import/constant_textures.h"

#include <string.h>

#include "worker/scene/texture.h"

/* Gets the linear RGBA of a texture of a single colour; false for other textures. */
static bool is_constant(const struct kiln_builder *builder, uint32_t index, float rgba[4])
{
    if (index == KILN_NONE)
        return false;
    const struct kiln_texture *t = &KILN_BUILDER_DATA(builder, const struct kiln_texture, KILN_SECTION_TEXTURES)[index];
    const uint8_t *texels = KILN_BUILDER_DATA(builder, const uint8_t, KILN_SECTION_TEXELS) + t->first;
    const size_t bytes = 4 * (size_t)t->width * t->height;
    if (memcmp(texels, texels + 4, bytes - 4) != 0) /* each texel is the one before it */
        return false;
    float linear[256];
    kiln_texture_codes(linear);
    for (int c = 0; c < 4; c++)
        rgba[c] = c < 3 && t->srgb != 0 ? linear[texels[c]] : (float)texels[c] / 255.0f;
    return true;
}

static size_t fold(const struct kiln_builder *builder, uint32_t *texture, float *factors, int count)
{
    float rgba[4];
    if (!is_constant(builder, *texture, rgba))
        return 0;
    for (int c = 0; c < count; c++)
        factors[c] *= rgba[c];
    *texture = KILN_NONE;
    return 1;
}

size_t kiln_fold_constant_textures(struct kiln_builder *builder)
{
    struct kiln_material *materials = KILN_BUILDER_DATA(builder, struct kiln_material, KILN_SECTION_MATERIALS);
    size_t folded = 0;
    for (size_t i = 0; i < builder->sections[KILN_SECTION_MATERIALS].count; i++) {
        struct kiln_material *m = &materials[i];
        folded += fold(builder, &m->emission_texture, m->emission, 3) +
                  fold(builder, &m->base_color_texture, m->base_color, 4) +
                  fold(builder, &m->transmission_texture, &m->transmission, 1);
    }
    return folded;
}
