/* Mean values of a texture over polygons, such as the surface of a lightmap's texel, or a part of a lamp.
 *
 * The texture is divided into cells: texels; for large polygons blocks of texels, with precomputed linear means; for
 * polygons smaller than a few texels, parts of texels. Each cell is weighted by the exact area of its overlap with the
 * polygon. So if polygons tile a texture, no texel is missed and none counts twice, whatever the ratio of texels to
 * polygons.
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
    float metal;        /* strength of the other texture; 0: none */
    uint32_t metal_texture, metal_channel;
};

/* Borrows the scene. About 1.7 bytes a texel. Destroy with kiln_texture_means_destroy. KILN_SYSTEM. */
int kiln_texture_means_create(struct kiln_texture_means **means, const struct kiln_scene *scene,
                              struct kiln_texture_look look, struct kiln_error *error);
void kiln_texture_means_destroy(struct kiln_texture_means **means);

/* Whether both looks are the same, so that they can share means. */
static inline bool kiln_texture_looks_equal(struct kiln_texture_look a, struct kiln_texture_look b)
{
    return a.texture == b.texture && a.alpha_mode == b.alpha_mode && a.metal_texture == b.metal_texture &&
           a.metal_channel == b.metal_channel && !(a.metal < b.metal || a.metal > b.metal) &&
           !(a.alpha_cutoff < b.alpha_cutoff || a.alpha_cutoff > b.alpha_cutoff);
}

/* Factors of a cell's four values. `value`: linear in the texture coordinates, [0] + [1] u + [2] v for each. `other`:
 * another texture that is multiplied (NULL: none); `at`: its coordinates, linear in u and v. */
struct kiln_texture_factor {
    double value[4][3];
    bool by_coverage; /* replace the cell's colours by its coverage */
    const struct kiln_texture_means *other;
    bool by_other_coverage; /* replace the other's colours by its coverage */
    double at[2][3];
};

/* Converts a number that is linear over a triangle, given at its corners, to one linear in texture coordinates:
 * value[0] + value[1] u + value[2] v. `uv`: of the corners. False: the triangle has no area in the texture, and the
 * number is not constant. */
bool kiln_texture_linear(const double uv[3][2], const double corner[3], double value[3]);

/* Means over the polygon. */
struct kiln_texture_mean {
    double value[4];
    double square; /* mean squared luminance of the colours, to the cells' resolution */
};

/* Computes means over a convex polygon with `corners` vertices (u, v), at most KILN_TEXTURE_POLYGON. Size of cells:
 * texels, if at most twice `most` lie along the polygon's longer side; else blocks, of which more than half of `most`
 * and at most `most` do. With a linear filter, texels are divided if fewer than 4, or than an eighth of `most`, lie
 * there. `most` is at most KILN_TEXTURE_CELLS. `factor` NULL: ones. False: the polygon has no area in the texture, or
 * too many cells. */
enum { KILN_TEXTURE_POLYGON = 16, KILN_TEXTURE_CELLS = 256 };
bool kiln_texture_means_over(const struct kiln_texture_means *means, const double (*polygon)[2], uint32_t corners,
                             uint32_t most, const struct kiln_texture_factor *factor, struct kiln_texture_mean *mean);

/* Looks up the averaged values (struct kiln_texture_look) at (u, v). */
void kiln_texture_means_at(const struct kiln_texture_means *means, double u, double v, float value[4]);

#endif
