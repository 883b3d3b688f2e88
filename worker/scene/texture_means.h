/* Means of a texture over polygons: what a texture comes to over the surface of a lightmap's texel, or of a part of a
 * lamp.
 *
 * The texture is seen as cells: its texels or, where the polygon is large, blocks of them, whose linear means are made
 * once; where it is smaller than a few texels, parts of texels. Each cell counts by the area that the polygon has of
 * it, exactly. So polygons that share out a texture get all of it between them: no texel is missed and none counts
 * twice, whatever the ratio of texels to polygons.
 *
 * Created once, not collective, then only read: safe to share between threads. */
#ifndef KILN_WORKER_SCENE_TEXTURE_MEANS_H
#define KILN_WORKER_SCENE_TEXTURE_MEANS_H

#include <stdbool.h>

#include "worker/scene/scene.h"

struct kiln_texture_means;

/* Values that are averaged: red, green and blue times the coverage of the alpha, and the coverage itself
 * (kiln_coverage, of the texture's own alpha). With KILN_ALPHA_OPAQUE the coverage is 1. The colours are also
 * multiplied by 1 - `metal` x a channel of another texture of the same size, filter and wrapping, read at the same
 * place. */
struct kiln_texture_look {
    uint32_t texture, alpha_mode;
    float alpha_cutoff; /* of a mask: on the texture's own alpha */
    float metal;        /* 0: there is no such texture */
    uint32_t metal_texture, metal_channel;
};

/* Borrows the scene. About 1.7 bytes a texel. Destroy with kiln_texture_means_destroy. KILN_SYSTEM. */
int kiln_texture_means_create(struct kiln_texture_means **means, const struct kiln_scene *scene,
                              struct kiln_texture_look look, struct kiln_error *error);
void kiln_texture_means_destroy(struct kiln_texture_means **means);

/* Whether both are the same, so that means of one serve the other. */
static inline bool kiln_texture_looks_equal(struct kiln_texture_look a, struct kiln_texture_look b)
{
    return a.texture == b.texture && a.alpha_mode == b.alpha_mode && a.metal_texture == b.metal_texture &&
           a.metal_channel == b.metal_channel && !(a.metal < b.metal || a.metal > b.metal) &&
           !(a.alpha_cutoff < b.alpha_cutoff || a.alpha_cutoff > b.alpha_cutoff);
}

/* Factors of a cell's four numbers: linear in the texture coordinates, [0] + [1] u + [2] v of each; and another
 * texture's (NULL: none), read at its own coordinates, which are linear in these. */
struct kiln_texture_factor {
    double value[4][3];
    bool by_coverage; /* in the place of each of the cell's colours stands its coverage */
    const struct kiln_texture_means *other;
    bool by_other_coverage; /* likewise of the other's */
    double at[2][3];
};

/* A number that is linear over a triangle, by its value at the corners, as one that is linear in the texture: value[0]
 * + value[1] u + value[2] v. `uv`: of the corners. False: the triangle has no area in the texture, and the number is
 * not the same all over it. */
bool kiln_texture_linear(const double uv[3][2], const double corner[3], double value[3]);

/* Means over the polygon. */
struct kiln_texture_mean {
    double value[4];
    double square; /* of the luminance of the colours, squared; as far as the cells tell */
};

/* `polygon`: convex, `corners` of (u, v), at most KILN_TEXTURE_POLYGON. Cells are texels where at most twice `most` of
 * these lie along the polygon's longer side, else blocks of which more than half and at most `most` do; of the texels
 * of a linear filter, if there are fewer than 4 or an eighth of `most`, parts. `most` is at most KILN_TEXTURE_CELLS.
 * `factor` NULL: ones. False: the polygon has no area in the texture, or is too large for its cells. */
enum { KILN_TEXTURE_POLYGON = 16, KILN_TEXTURE_CELLS = 256 };
bool kiln_texture_means_over(const struct kiln_texture_means *means, const double (*polygon)[2], uint32_t corners,
                             uint32_t most, const struct kiln_texture_factor *factor, struct kiln_texture_mean *mean);

/* Finds the values that are averaged, at (u, v). */
void kiln_texture_means_at(const struct kiln_texture_means *means, double u, double v, float value[4]);

#endif
