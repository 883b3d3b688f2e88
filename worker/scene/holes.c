#include "worker/scene/holes.h"

#include <math.h>

#include "worker/base/memory.h"

/* Minima of a texture: level 0 has a value for each texel, each further level the minimum of 2 x 2 values. */
enum { LEVELS_MAX = 18, CELLS_ACROSS = 8 };
struct lows {
    uint8_t *values;
    size_t first[LEVELS_MAX];
    uint32_t width[LEVELS_MAX], height[LEVELS_MAX];
    int levels;
};

/* Per texture; empty if no material needs it. */
struct textures {
    struct lows *alpha, *closed; /* lowest alpha; lowest 255 - red, of what transmits */
};

static uint8_t texel_value(const uint8_t *texel, bool closed) { return closed ? (uint8_t)(255 - texel[0]) : texel[3]; }

static size_t plan_levels(struct lows *lows, const struct kiln_texture *texture)
{
    size_t total = 0;
    uint32_t w = texture->width, h = texture->height;
    for (lows->levels = 0; lows->levels < LEVELS_MAX; w = (w + 1) / 2, h = (h + 1) / 2) {
        const int level = lows->levels++;
        lows->first[level] = total;
        lows->width[level] = w, lows->height[level] = h;
        total += (size_t)w * h;
        if (w == 1 && h == 1)
            break;
    }
    return total;
}

static uint8_t lowest_of_four(const uint8_t *from, uint32_t w, uint32_t h, uint32_t x, uint32_t y)
{
    uint8_t lowest = 255;
    for (uint32_t k = 0; k < 4; k++) {
        const uint32_t cx = 2 * x + (k & 1) < w ? 2 * x + (k & 1) : w - 1,
                       cy = 2 * y + (k >> 1) < h ? 2 * y + (k >> 1) : h - 1;
        const uint8_t value = from[(size_t)cy * w + cx];
        lowest = value < lowest ? value : lowest;
    }
    return lowest;
}

static int lows_build(struct lows *lows, const struct kiln_scene *scene, uint32_t index, bool closed,
                      struct kiln_error *error)
{
    const struct kiln_texture *texture = &scene->textures[index];
    if (lows->values != NULL)
        return KILN_OK;
    const int status = kiln_allocate(&lows->values, plan_levels(lows, texture), 1, "the holes of textures", error);
    if (status != KILN_OK)
        return status;
    const size_t texels = (size_t)texture->width * texture->height;
    for (size_t i = 0; i < texels; i++)
        lows->values[i] = texel_value(scene->texels + texture->first + 4 * i, closed);
    for (int level = 1; level < lows->levels; level++)
        for (uint32_t y = 0; y < lows->height[level]; y++)
            for (uint32_t x = 0; x < lows->width[level]; x++)
                lows->values[lows->first[level] + (size_t)y * lows->width[level] + x] = lowest_of_four(
                    lows->values + lows->first[level - 1], lows->width[level - 1], lows->height[level - 1], x, y);
    return KILN_OK;
}

/* Range of columns (or rows) covered by three coordinates, including those that a filter reads beside them; the whole
 * range if they cross the texture's edge. */
static void find_range(const float at[3], uint32_t size, uint32_t wrap, double beside, uint32_t range[2])
{
    const double n = size, first = floor((double)fminf(at[0], fminf(at[1], at[2])) * n - beside),
                 last = fmax(ceil((double)fmaxf(at[0], fmaxf(at[1], at[2])) * n + beside) - 1.0, first);
    const double tile = floor(first / n);
    range[0] = 0, range[1] = size - 1;
    if (wrap == KILN_WRAP_CLAMP) {
        range[0] = (uint32_t)fmin(fmax(first, 0.0), n - 1.0);
        range[1] = (uint32_t)fmin(fmax(last, 0.0), n - 1.0);
    } else if (floor(last / n) == tile) { /* false if a coordinate is NaN */
        const uint32_t from = (uint32_t)fmin(fmax(first - tile * n, 0.0), n - 1.0),
                       to = (uint32_t)fmin(fmax(last - tile * n, 0.0), n - 1.0);
        const bool turned = wrap == KILN_WRAP_MIRROR && fmod(tile, 2.0) != 0.0;
        range[0] = turned ? size - 1 - to : from;
        range[1] = turned ? size - 1 - from : to;
    }
}

static uint8_t lowest_within(const struct lows *lows, const struct kiln_texture *texture, const float u[3],
                             const float v[3])
{
    uint32_t x[2], y[2];
    int level = 0;
    const double beside = texture->nearest ? 0.0 : 0.5;
    find_range(u, texture->width, texture->wrap_u, beside, x);
    find_range(v, texture->height, texture->wrap_v, beside, y);
    for (; level + 1 < lows->levels && (x[1] - x[0] >= CELLS_ACROSS || y[1] - y[0] >= CELLS_ACROSS); level++)
        for (int end = 0; end < 2; end++)
            x[end] /= 2, y[end] /= 2;
    uint8_t lowest = 255;
    for (uint32_t row = y[0]; row <= y[1]; row++)
        for (uint32_t column = x[0]; column <= x[1]; column++) {
            const uint8_t value = lows->values[lows->first[level] + (size_t)row * lows->width[level] + column];
            lowest = value < lowest ? value : lowest;
        }
    return lowest;
}

/* Lowest value of a texture over a world triangle; 255 without a texture. */
static float lowest_texel(const struct kiln_scene *scene, const struct lows *lows, uint32_t texture,
                          const uint64_t vertex[3])
{
    if (texture == KILN_NONE)
        return 255.0f;
    float u[3], v[3];
    for (int c = 0; c < 3; c++) {
        u[c] = scene->texcoord_base[vertex[c]].x;
        v[c] = scene->texcoord_base[vertex[c]].y;
    }
    return (float)lowest_within(&lows[texture], &scene->textures[texture], u, v);
}

static bool lets_through(const struct kiln_scene *scene, const struct kiln_geometry *g, const struct textures *textures,
                         uint64_t triangle)
{
    const struct kiln_material *m = &scene->materials[g->records[triangle].material & KILN_RECORD_MATERIAL];
    uint64_t vertex[3];
    kiln_geometry_stored_vertices(scene, g, triangle, vertex);
    if (m->transmission > 0.0f && (m->transmission_texture == KILN_NONE ||
                                   lowest_texel(scene, textures->closed, m->transmission_texture, vertex) < 255.0f))
        return true;
    if (m->alpha_mode == KILN_ALPHA_OPAQUE)
        return false;
    uint8_t lowest = 255;
    for (int c = 0; c < 3; c++) {
        const uint8_t alpha = scene->colors[4 * vertex[c] + 3];
        lowest = alpha < lowest ? alpha : lowest;
    }
    const float alpha = m->base_color[3] * ((float)lowest / 255.0f) *
                        (lowest_texel(scene, textures->alpha, m->base_color_texture, vertex) / 255.0f);
    return m->alpha_mode == KILN_ALPHA_MASK ? alpha < m->alpha_cutoff : alpha < 1.0f;
}

static int build_textures(struct textures *textures, const struct kiln_scene *scene, struct kiln_error *error)
{
    int status =
        kiln_allocate(&textures->alpha, scene->texture_count, sizeof *textures->alpha, "textures' holes", error);
    if (status == KILN_OK)
        status =
            kiln_allocate(&textures->closed, scene->texture_count, sizeof *textures->closed, "textures' holes", error);
    for (size_t i = 0; i < scene->material_count && status == KILN_OK; i++) {
        const struct kiln_material *m = &scene->materials[i];
        if (m->transmission > 0.0f && m->transmission_texture != KILN_NONE)
            status =
                lows_build(&textures->closed[m->transmission_texture], scene, m->transmission_texture, true, error);
        if (status == KILN_OK && m->alpha_mode != KILN_ALPHA_OPAQUE && m->base_color_texture != KILN_NONE)
            status = lows_build(&textures->alpha[m->base_color_texture], scene, m->base_color_texture, false, error);
    }
    return status;
}

int kiln_holes_mark(struct kiln_geometry *g, const struct kiln_scene *scene, struct kiln_error *error)
{
    struct textures textures = {NULL, NULL};
    if (g->opaque_count == g->triangle_count)
        return KILN_OK;
    const int status = build_textures(&textures, scene, error);
    if (status == KILN_OK) {
#pragma omp parallel for schedule(static)
        for (size_t t = g->opaque_count; t < g->triangle_count; t++)
            if (lets_through(scene, g, &textures, t))
                g->records[t].material |= KILN_RECORD_CLEAR;
    }
    for (size_t i = 0; i < scene->texture_count; i++) {
        if (textures.alpha != NULL)
            kiln_free(&textures.alpha[i].values);
        if (textures.closed != NULL)
            kiln_free(&textures.closed[i].values);
    }
    kiln_free(&textures.alpha);
    kiln_free(&textures.closed);
    return status;
}
