#include <assert.h>
#include <stdlib.h>

#include "coordinator/surface/build.h"
#include "worker/base/arena.h"
#include "worker/sampling/keys.h"
#include "worker/base/memory.h"
#include "worker/material/surface_bsdf.h"
#include "worker/scene/footprint.h"
#include "worker/scene/texture.h"
#include "worker/scene/texture_means.h"

static const double DITHERED_ALBEDO = 0.95; /* below it rounding costs at most 1.6e-4 of the light */

/* Numbers of colour lookups in a texel, where no mean of a texture gives its colour: least and most per side, and most
 * in all. */
enum { LOOKS_LEAST = 4, LOOKS_SIDE = 16, LOOKS = LOOKS_SIDE * LOOKS_SIDE };
enum { CELLS = 8 }; /* cells of texture means along a texel's longer side */

/* A triangle whose colour is sampled. */
struct sampled {
    uint32_t triangle; /* world triangle; KILN_NONE: none yet */
    const struct kiln_scene *scene;
    const struct kiln_mesh *mesh;
    uint64_t stored;           /* the triangle among the scene's */
    bool flipped, see_through; /* its corners 1 and 2 are exchanged; it has opacity */
    bool glossy;               /* its material has gloss; otherwise `paint` is ready */
    struct kiln_paint paint;
    /* texture means that, with `factor`, give all of its colour; NULL: colours are looked up */
    const struct kiln_texture_means *means;
    struct kiln_texture_factor factor;
    double uv[3][2]; /* texture coordinates of the stored corners */
};

/* Working memory of one thread. */
struct fill_scratch {
    struct kiln_coverage_scratch coverage;
    struct sampled sampled; /* the triangle sampled last, which is mostly the next one too */
    uint32_t *order;        /* indices of the tile's pieces, sorted by texel, then by triangle */
    size_t order_capacity;
    double *areas; /* for a texel with too many pieces */
    size_t areas_capacity;
};

struct color_sum {
    double opaque[3], weight; /* sums weighted with area x opacity */
    double all[3], area;      /* sums weighted with area, for texels whose opacity is 0 everywhere */
};

/* ---- means of textures ---- */

/* Whether the metallic texture has the same size and wrapping as the base texture, so that means can include it. */
static bool goes_along(const struct kiln_scene *scene, uint32_t texture, uint32_t metal)
{
    const struct kiln_texture *a = &scene->textures[texture], *b = &scene->textures[metal];
    return a->width == b->width && a->height == b->height && a->wrap_u == b->wrap_u && a->wrap_v == b->wrap_v &&
           a->nearest == b->nearest;
}

/* Describes how a material's texture is averaged. False: no texture, or means cannot give its colour and opacity. They
 * can if both are one texture, perhaps times a metallic texture, times factors that are constant or linear over a
 * triangle. */
static bool look_of(const struct kiln_scene *scene, uint32_t material, struct kiln_texture_look *look)
{
    const struct kiln_material *m = &scene->materials[material];
    const struct kiln_gloss *gloss = kiln_gloss_taken(scene, material);
    if (m->base_color_texture == KILN_NONE || (m->transmission > 0.0f && m->transmission_texture != KILN_NONE))
        return false;
    if (gloss != NULL &&
        (gloss->textures[KILN_GLOSS_TRANSMISSION].texture != KILN_NONE ||
         (gloss->model == KILN_GLOSS_PHONG && (gloss->transmission > 0.0f || (gloss->flags & KILN_GLOSS_MIRROR) != 0))))
        return false;
    if (m->alpha_mode == KILN_ALPHA_MASK && !(m->base_color[3] > 0.0f))
        return false;
    *look = (struct kiln_texture_look){.texture = m->base_color_texture, .alpha_mode = m->alpha_mode};
    look->alpha_cutoff = m->alpha_mode == KILN_ALPHA_MASK ? m->alpha_cutoff / m->base_color[3] : 0.0f;
    const struct kiln_gloss_texture *metal = gloss != NULL ? &gloss->textures[KILN_GLOSS_METALLIC] : NULL;
    if (metal == NULL || metal->texture == KILN_NONE || !(gloss->metallic > 0.0f))
        return true;
    look->metal = gloss->metallic;
    look->metal_texture = metal->texture;
    look->metal_channel = metal->channel;
    return goes_along(scene, look->texture, look->metal_texture);
}

/* Means made for another material with an equal look; NULL: there are none. */
static struct kiln_texture_means *means_of_other(const struct kiln_build *build, const struct kiln_texture_look *look)
{
    for (size_t i = 0; i < build->owner_count; i++) {
        struct kiln_texture_look other;
        if (look_of(build->scene, build->owners[i], &other) && kiln_texture_looks_equal(*look, other))
            return build->means[build->owners[i]];
    }
    return NULL;
}

static int create_means(struct kiln_build *build)
{
    const size_t count = build->scene->material_count;
    int status;
    KILN_TRY(kiln_allocate(&build->means, count, sizeof *build->means, "the means of textures", build->error));
    KILN_TRY(kiln_allocate(&build->owners, count, sizeof *build->owners, "the means of textures", build->error));
    for (uint32_t i = 0; i < count; i++) {
        struct kiln_texture_look look;
        if (!look_of(build->scene, i, &look))
            continue;
        build->means[i] = means_of_other(build, &look);
        if (build->means[i] != NULL)
            continue;
        KILN_TRY(kiln_texture_means_create(&build->means[i], build->scene, look, build->error));
        build->owners[build->owner_count++] = i;
    }
end:
    return status;
}

static void destroy_means(struct kiln_build *build)
{
    for (size_t i = 0; i < build->owner_count; i++)
        kiln_texture_means_destroy(&build->means[build->owners[i]]);
    build->owner_count = 0;
    kiln_free(&build->owners);
    kiln_free(&build->means);
}

/* ---- a triangle ---- */

/* Computes the factor: vertex colours x `factor` x coverage of a blended alpha. False: it is not linear over the
 * triangle. */
static bool find_factor(struct sampled *t, const float factor[3], uint32_t alpha_mode, float alpha)
{
    const uint32_t *corner = t->scene->triangles + 3 * t->stored;
    const uint8_t *code[3];
    for (int k = 0; k < 3; k++)
        code[k] = t->scene->colors + 4 * (t->mesh->vertex_first + corner[k]);
    const bool alike = code[0][3] == code[1][3] && code[0][3] == code[2][3];
    if ((alpha_mode == KILN_ALPHA_MASK && !(alike && code[0][3] == 255)) || (alpha_mode == KILN_ALPHA_BLEND && !alike))
        return false;
    const double covered = alpha_mode == KILN_ALPHA_BLEND ? (double)alpha * code[0][3] / 255.0 : 1.0;
    for (int c = 0; c < 4; c++) {
        double at[3];
        for (int k = 0; k < 3; k++)
            at[k] = c < 3 ? covered * (double)factor[c] * code[k][c] / 255.0 : covered;
        if (!kiln_texture_linear(t->uv, at, t->factor.value[c]))
            return false;
    }
    return true;
}

/* Whether the material has no metallic texture, or reads it at the coordinates of the base colour. */
static bool is_beside(const struct sampled *t, const struct kiln_gloss *gloss)
{
    if (gloss == NULL || gloss->textures[KILN_GLOSS_METALLIC].texture == KILN_NONE)
        return true;
    const float *m = gloss->textures[KILN_GLOSS_METALLIC].transform;
    const uint32_t *corner = t->scene->triangles + 3 * t->stored;
    for (int k = 0; k < 3; k++) {
        const struct kiln_vec2 at = t->scene->texcoord_gloss[t->mesh->vertex_first + corner[k]];
        const double u = (double)(m[0] * at.x + m[1] * at.y + m[2]), v = (double)(m[3] * at.x + m[4] * at.y + m[5]);
        if (fabs(u - t->uv[k][0]) > 1e-5 * fmax(1.0, fabs(u)) || fabs(v - t->uv[k][1]) > 1e-5 * fmax(1.0, fabs(v)))
            return false;
    }
    return true;
}

/* Diffuse share: 1 - metallic, less the transmitted share; without factors that are in the texture's means. */
static float matt_of(const struct sampled *t, const struct kiln_gloss *gloss, const struct kiln_material *m)
{
    const float third = 1.0f / 3.0f;
    if (gloss == NULL)
        return 1.0f - m->metallic;
    struct kiln_bsdf p = kiln_surface_bsdf(t->scene, gloss, t->mesh, t->stored, third, third);
    if (gloss->textures[KILN_GLOSS_METALLIC].texture != KILN_NONE)
        p.metallic = 0.0f;
    return kiln_bsdf_matt(p);
}

/* Whether texture means give the triangle's colour; then prepares them. */
static bool find_means(const struct kiln_build *build, struct sampled *t)
{
    const uint32_t material = t->scene->triangle_materials[t->stored];
    const struct kiln_material *m = &t->scene->materials[material];
    const struct kiln_gloss *gloss = kiln_gloss_taken(t->scene, material);
    const uint32_t *corner = t->scene->triangles + 3 * t->stored;
    float factor[3];
    t->means = build->means[material];
    if (t->means == NULL)
        return false;
    for (int k = 0; k < 3; k++) {
        const struct kiln_vec2 at = t->scene->texcoord_base[t->mesh->vertex_first + corner[k]];
        t->uv[k][0] = (double)at.x;
        t->uv[k][1] = (double)at.y;
    }
    const float matt = matt_of(t, gloss, m);
    for (int c = 0; c < 3; c++)
        factor[c] = m->base_color[c] * matt;
    return is_beside(t, gloss) && find_factor(t, factor, m->alpha_mode, m->base_color[3]);
}

static void begin_samples(const struct kiln_build *build, uint32_t triangle, struct sampled *t)
{
    const struct kiln_geometry *g = build->geometry;
    const struct kiln_scene *scene = build->scene;
    const struct kiln_object *object = &scene->objects[g->records[triangle].object];
    if (t->triangle == triangle)
        return;
    t->triangle = triangle;
    t->scene = scene;
    t->mesh = &scene->meshes[object->mesh];
    t->stored = g->stored_triangle[triangle];
    t->flipped = object->flipped != 0;
    t->see_through = triangle >= g->opaque_count;
    t->glossy = kiln_gloss_taken(scene, scene->triangle_materials[t->stored]) != NULL;
    if (!find_means(build, t))
        t->means = NULL;
    if (!t->glossy)
        kiln_paint_prepare(&t->paint, scene, t->mesh, t->stored);
}

/* ---- looks ---- */

/* Positions of a triangle at which its colour is read, each standing for some area, m2. */
struct positions {
    float b1[LOOKS], b2[LOOKS];
    double area[LOOKS];
    int count;
};

static void add_position(const struct sampled *t, double b1, double b2, double area, struct positions *at)
{
    at->b1[at->count] = (float)(t->flipped ? b2 : b1);
    at->b2[at->count] = (float)(t->flipped ? b1 : b2);
    at->area[at->count++] = area;
}

static void sample_colors(const struct sampled *t, const struct positions *at, struct color_sum *sum)
{
    float rgba[LOOKS][4];
    for (int i = 0; i < at->count && !t->glossy; i += KILN_PAINT_MOST)
        kiln_paint_colors(&t->paint, at->b1 + i, at->b2 + i,
                          at->count - i < KILN_PAINT_MOST ? at->count - i : KILN_PAINT_MOST, rgba + i);
    for (int i = 0; i < at->count; i++) {
        if (t->glossy)
            kiln_surface_albedo(t->scene, t->mesh, t->stored, at->b1[i], at->b2[i], rgba[i]);
        double weight = at->area[i];
        if (t->see_through)
            weight *= (double)kiln_surface_opacity(t->scene, t->mesh, t->stored, at->b1[i], at->b2[i]);
        for (int c = 0; c < 3; c++) {
            sum->opaque[c] += weight * (double)rgba[i][c];
            sum->all[c] += at->area[i] * (double)rgba[i][c];
        }
        sum->weight += weight;
        sum->area += at->area[i];
    }
}

/* Number of lookups along a texel's side: twice the number of texture texels along it, within limits. */
static int looks_along(const struct sampled *t, const double local[3][2])
{
    double at[3][2];
    if (t->glossy || t->paint.texture == KILN_NONE)
        return LOOKS_SIDE;
    const struct kiln_texture *texture = &t->scene->textures[t->paint.texture];
    for (int k = 0; k < 3; k++) {
        at[k][0] = (double)t->paint.at[k].x * texture->width;
        at[k][1] = (double)t->paint.at[k].y * texture->height;
    }
    const double area = fabs(kiln_clip_twice_area(local)), fine = sqrt(fabs(kiln_clip_twice_area(at)) / area);
    return fine < LOOKS_SIDE / 2 ? (int)fmax(LOOKS_LEAST, ceil(2.0 * fine)) : LOOKS_SIDE;
}

/* Lookup positions in a piece that fills its texel: a jittered one in each of side x side sub-squares. The jitter
 * depends on the texel, so that no regular grid of lookups aliases with regular patterns of a texture. */
static void spread_in_square(const struct sampled *t, const double local[3][2], const struct kiln_texel_place *place,
                             double area, struct positions *at)
{
    const struct kiln_clip_weights w = kiln_clip_weights(local);
    const int side = looks_along(t, local);
    const uint32_t key = kiln_hash2(kiln_hash2(place->x, place->y), t->triangle);
    for (int i = 0; i < side * side; i++) {
        const uint32_t hash = kiln_hash2(key, (uint32_t)i);
        const double x = (i % side + (double)kiln_unit_float(hash)) / side,
                     y = (i / side + (double)kiln_unit_float(kiln_hash1(hash))) / side;
        add_position(t, w.b1[0] + w.b1[1] * x + w.b1[2] * y, w.b2[0] + w.b2[1] * x + w.b2[2] * y, area / (side * side),
                     at);
    }
}

/* Lookup positions in a piece that does not fill its texel. Its bounding box is divided into equal rectangles, more for
 * larger pieces; each has one at the centroid of its part of the piece. `fraction`: area of the piece / of the point.
 */
static void spread_in_polygon(const struct sampled *t, const struct kiln_texel_triangle *local, double area,
                              double fraction, struct positions *at)
{
    struct kiln_clip_corner polygon[KILN_CLIP_CORNERS], centroid;
    const uint32_t corners = kiln_texel_clip(local, 0.0, 0.0, 1.0, 1.0, polygon);
    const double whole = kiln_clip_fraction(polygon, corners, &centroid);
    double x0 = 1.0, y0 = 1.0, x1 = 0.0, y1 = 0.0;
    for (uint32_t i = 0; i < corners; i++) {
        x0 = fmin(x0, polygon[i].x), y0 = fmin(y0, polygon[i].y);
        x1 = fmax(x1, polygon[i].x), y1 = fmax(y1, polygon[i].y);
    }
    if (!(fabs(kiln_clip_twice_area(local->corner)) > 0.0)) { /* collapsed in the lightmap: it cannot be clipped */
        add_position(t, centroid.b1, centroid.b2, area, at);
        return;
    }
    const int most = looks_along(t, local->corner), side = (int)fmin(most, ceil(1.5 * most * sqrt(fraction)));
    const double dx = (x1 - x0) / side, dy = (y1 - y0) / side;
    struct kiln_clip_corner column[LOOKS_SIDE][KILN_CLIP_CORNERS];
    uint32_t in_column[LOOKS_SIDE];
    for (int i = 0; i < side; i++) {
        const double x = x0 + i * dx;
        in_column[i] = kiln_clip_column(local->corner, x, x + dx, column[i]);
    }
    for (int i = 0; i < side * side; i++) {
        const double x = x0 + i % side * dx, y = y0 + i / side * dy;
        if (kiln_clip_classify(local->corner, x, y, x + dx, y + dy) == KILN_CLIP_OUTSIDE)
            continue;
        uint32_t count = kiln_clip_rows(local->corner, column[i % side], in_column[i % side], y, y + dy, polygon);
        if (local->layered)
            count = kiln_clip_depths(polygon, count, local->depth);
        const double covered = kiln_clip_fraction(polygon, count, &centroid);
        if (covered > 0.0)
            add_position(t, centroid.b1, centroid.b2, area * (covered / whole), at);
    }
}

/* ---- a piece ---- */

/* Texture coordinates of a point of the triangle, given by world barycentrics. */
static void texture_place(const struct sampled *t, double b1, double b2, double at[2])
{
    const double first = t->flipped ? b2 : b1, second = t->flipped ? b1 : b2;
    for (int k = 0; k < 2; k++)
        at[k] = t->uv[0][k] + first * (t->uv[1][k] - t->uv[0][k]) + second * (t->uv[2][k] - t->uv[0][k]);
}

/* Adds the mean colour of the piece in the texel; false if the texture means do not give it. */
static bool add_mean(const struct sampled *t, const struct kiln_texel_triangle *local, bool whole, double area,
                     struct color_sum *sum)
{
    double polygon[KILN_CLIP_CORNERS][2];
    struct kiln_clip_corner clipped[KILN_CLIP_CORNERS];
    struct kiln_texture_mean mean;
    uint32_t corners = 4;
    if (t->means == NULL)
        return false;
    if (whole) {
        const struct kiln_clip_weights w = kiln_clip_weights(local->corner);
        for (int i = 0; i < 4; i++) {
            const double x = i == 1 || i == 2 ? 1.0 : 0.0, y = i >= 2 ? 1.0 : 0.0;
            texture_place(t, w.b1[0] + w.b1[1] * x + w.b1[2] * y, w.b2[0] + w.b2[1] * x + w.b2[2] * y, polygon[i]);
        }
    } else {
        corners = kiln_texel_clip(local, 0.0, 0.0, 1.0, 1.0, clipped);
        for (uint32_t i = 0; i < corners; i++)
            texture_place(t, clipped[i].b1, clipped[i].b2, polygon[i]);
    }
    if (!kiln_texture_means_over(t->means, polygon, corners, CELLS, &t->factor, &mean) || !(mean.value[3] > 0.0))
        return false;
    for (int c = 0; c < 3; c++) {
        sum->opaque[c] += area * mean.value[c];
        sum->all[c] += area * mean.value[c] / mean.value[3];
    }
    sum->weight += area * mean.value[3];
    sum->area += area;
    return true;
}

/* Whether colour or opacity of a material may vary within a triangle, apart from vertex colours. */
static bool has_texture(const struct kiln_scene *scene, uint32_t material)
{
    const struct kiln_material *m = &scene->materials[material];
    const struct kiln_gloss *gloss = kiln_gloss_taken(scene, material);
    return m->base_color_texture != KILN_NONE || (m->transmission > 0.0f && m->transmission_texture != KILN_NONE) ||
           (gloss != NULL && (gloss->textures[KILN_GLOSS_METALLIC].texture != KILN_NONE ||
                              gloss->textures[KILN_GLOSS_TRANSMISSION].texture != KILN_NONE));
}

static void add_piece_color(const struct kiln_build *build, const struct kiln_coverage_piece *piece,
                            const struct kiln_texel_place *place, double total, struct sampled *t,
                            struct color_sum *sum)
{
    const struct kiln_hit_record *record = &build->geometry->records[piece->triangle];
    const uint32_t material = record->material & KILN_RECORD_MATERIAL;
    struct kiln_texel_triangle local;
    struct positions at;
    at.count = 0;
    begin_samples(build, piece->triangle, t);
    if (!has_texture(build->scene, material)) {
        add_position(t, piece->b1, piece->b2, piece->area, &at);
    } else {
        kiln_texel_triangle(build->scene, build->geometry, piece->triangle, place, &local);
        if (add_mean(t, &local, piece->whole, piece->area, sum))
            return;
        if (piece->whole)
            spread_in_square(t, local.corner, place, piece->area, &at);
        else
            spread_in_polygon(t, &local, piece->area, piece->area / total, &at);
    }
    sample_colors(t, &at, sum);
}

/* Dither threshold of texel (x, y): a number is rounded up if its fraction is above it. Thresholds of neighbours differ
 * strongly, so that the mean over a few texels is the number (R2 sequence of the plastic number). */
static double threshold_of(uint32_t x, uint32_t y)
{
    const double place = 0.5 + 0.7548776662466927 * (double)x + 0.5698402909980532 * (double)y;
    return place - floor(place);
}

/* Rounds an albedo to 16 bits. Near 1 the last digit counts: in a furnace of albedo 0.999 rounding to the nearest of
 * 65,536 values changes the light by 0.7 %. There the albedo is dithered. */
static uint16_t albedo_of(const struct color_sum *sum, int channel, uint32_t x, uint32_t y)
{
    const double value = sum->weight > 0.0 ? sum->opaque[channel] / sum->weight : sum->all[channel] / sum->area;
    const double steps = fmin(value, 1.0) * 65535.0;
    if (value > DITHERED_ALBEDO)
        return (uint16_t)fmin(floor(steps + threshold_of(x, y)), 65535.0);
    return value > 0.0 ? (uint16_t)lrint(steps) : 0;
}

static int descending(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return x > y ? -1 : x < y ? 1 : 0;
}

/* Reduces `order` to the KILN_PIECES_MOST largest pieces; of equal ones, those with lower numbers stay. Updates *count.
 */
static int keep_largest(struct fill_scratch *scratch, uint32_t *order, uint32_t *count, struct kiln_error *error)
{
    const int status =
        kiln_grow(&scratch->areas, &scratch->areas_capacity, *count, sizeof *scratch->areas, "a texel's pieces", error);
    if (status != KILN_OK)
        return status;
    for (uint32_t i = 0; i < *count; i++)
        scratch->areas[i] = scratch->coverage.pieces[order[i]].area;
    qsort(scratch->areas, *count, sizeof *scratch->areas, descending);
    const double limit = scratch->areas[KILN_PIECES_MOST - 1];
    uint32_t larger = 0, kept = 0;
    while (scratch->areas[larger] > limit)
        larger++;
    uint32_t equal = KILN_PIECES_MOST - larger; /* how many pieces of just this area are kept */
    for (uint32_t i = 0; i < *count; i++) {
        const double area = scratch->coverage.pieces[order[i]].area;
        if (area < limit || (!(area > limit) && equal == 0))
            continue;
        equal -= area > limit ? 0 : 1;
        order[kept++] = order[i];
    }
    *count = kept;
    return KILN_OK;
}

struct point_place {
    struct kiln_own_point point;
    uint64_t piece, cdf; /* indices in the surface's arrays where the point's pieces and fractions of area go */
    uint32_t x, y;       /* the point's texel */
    struct kiln_texel_place texel; /* the same, or its leaf */
};

/* Whether only a sliver of a surface that ends in the texel lies in it (kiln_texel_is_sliver). */
static bool is_sliver(const struct kiln_build *build, const struct kiln_coverage_piece *pieces, const uint32_t *order,
                      uint32_t count, double area, const struct kiln_texel_place *texel)
{
    const struct kiln_coverage_piece *largest = &pieces[order[0]];
    for (uint32_t i = 0; i < count; i++)
        largest = pieces[order[i]].area > largest->area ? &pieces[order[i]] : largest;
    return !largest->whole && kiln_texel_is_sliver(build->scene, build->geometry, largest->triangle, texel, area);
}

static int fill_point(struct kiln_build *build, struct fill_scratch *scratch, uint32_t *order, uint32_t count,
                      struct point_place *place, struct kiln_error *error)
{
    struct kiln_surface *s = build->surface;
    const struct kiln_coverage_piece *pieces = scratch->coverage.pieces;
    double total = 0.0, kept = 0.0, sum = 0.0;
    for (uint32_t i = 0; i < count; i++)
        total += pieces[order[i]].area;
    if (count > KILN_PIECES_MOST) {
        const int status = keep_largest(scratch, order, &count, error);
        if (status != KILN_OK)
            return status;
    }
    for (uint32_t i = 0; i < count; i++)
        kept += pieces[order[i]].area;
    struct color_sum color = {0};
    for (uint32_t i = 0; i < count; i++) {
        const struct kiln_coverage_piece *piece = &pieces[order[i]];
        add_piece_color(build, piece, &place->texel, kept, &scratch->sampled, &color);
        s->pieces[place->piece++] = piece->triangle;
        sum += piece->area;
        if (i + 1 < count)
            s->area_cdf[place->cdf++] = (float)fmin(sum / kept, 1.0);
    }
    const uint64_t p = place->point.at++;
    s->piece_count[p] = (uint16_t)(count | (count == 1 && pieces[order[0]].whole ? KILN_PIECES_WHOLE : 0u));
    s->area[p] = fmaxf((float)total, 0x1p-126f); /* never 0, however small the scene */
    s->visible[p] = is_sliver(build, pieces, order, count, total, &place->texel) ? 0 : 0xffff;
    for (int c = 0; c < 3; c++)
        s->albedo[3 * p + (uint64_t)c] = albedo_of(&color, c, place->x, place->y);
    return KILN_OK;
}

/* Counting sort of a tile's pieces by texel. Pieces first[bit] .. first[bit + 1] - 1 of scratch->order belong to that
 * texel. */
static int sort_pieces(struct fill_scratch *scratch, size_t first[KILN_TILE_TEXELS + 1], struct kiln_error *error)
{
    const size_t count = scratch->coverage.count;
    const int status =
        kiln_grow(&scratch->order, &scratch->order_capacity, count, sizeof *scratch->order, "a tile's pieces", error);
    if (status != KILN_OK)
        return status;
    size_t place[KILN_TILE_TEXELS];
    for (int bit = 0; bit <= KILN_TILE_TEXELS; bit++)
        first[bit] = 0;
    for (size_t i = 0; i < count; i++)
        first[scratch->coverage.pieces[i].bit + 1]++;
    for (int bit = 0; bit < KILN_TILE_TEXELS; bit++) {
        place[bit] = first[bit];
        first[bit + 1] += first[bit];
    }
    for (size_t i = 0; i < count; i++)
        scratch->order[place[scratch->coverage.pieces[i].bit]++] = (uint32_t)i;
    return KILN_OK;
}

static int fill_tile_run(struct kiln_build *build, const struct kiln_coverage *coverage, size_t f,
                         struct fill_scratch *scratch, struct kiln_error *error)
{
    struct kiln_surface *s = build->surface;
    const struct kiln_tile_run *tile_run = &s->tile_runs[f];
    size_t first[KILN_TILE_TEXELS + 1];
    int status = kiln_coverage_tile(coverage, tile_run->tile, tile_run->mask, &scratch->coverage, error);
    if (status == KILN_OK)
        status = sort_pieces(scratch, first, error);
    struct point_place place = {
        .point = kiln_own_of_global(s, tile_run->first), .piece = s->piece_base[f], .cdf = s->area_cdf_base[f]};
    struct kiln_point_cursor at = kiln_point_begin(s, tile_run);
    for (; at.rest != 0 && status == KILN_OK; at.rest &= at.rest - 1, kiln_point_locate(&at)) {
        const uint32_t bit = (uint32_t)__builtin_ctzll(at.rest);
        place.x = at.x;
        place.y = at.y;
        place.texel = at.place;
        status = fill_point(build, scratch, scratch->order + first[bit], (uint32_t)(first[bit + 1] - first[bit]),
                            &place, error);
    }
    assert(status != KILN_OK || (place.piece == s->piece_base[f + 1] && place.cdf == s->area_cdf_base[f + 1]));
    return status;
}

struct own_maps {
    uint64_t *first;     /* one per lightmap, and one more at the end: its first entry in `tile_runs` */
    uint64_t *tile_runs; /* this rank's tile runs, grouped by lightmap */
    uint8_t *wanted;     /* one per lightmap: 1 if this rank has tile runs of it */
    struct kiln_arena arena;
};

static void fill_map(struct kiln_build *build, uint32_t map, uint32_t threads, const void *context)
{
    const struct own_maps *maps = context;
    struct kiln_error error;
    struct kiln_coverage coverage = {0};
    const int status =
        kiln_coverage_create(&coverage, build->scene, build->geometry, build->surface, map, threads, &error);
    if (status != KILN_OK) {
        kiln_build_fail(build, status, &error);
        return;
    }
    const int team = (int)threads;
    const uint64_t *tile_runs = maps->tile_runs + maps->first[map];
    const uint64_t count = maps->first[map + 1] - maps->first[map];
#pragma omp parallel num_threads(team)
    {
        struct fill_scratch scratch = {.sampled.triangle = KILN_NONE};
        struct kiln_error own;
#pragma omp for schedule(dynamic, 16)
        for (uint64_t i = 0; i < count; i++) {
            if (kiln_build_failed(build))
                continue;
            const int failed = fill_tile_run(build, &coverage, tile_runs[i], &scratch, &own);
            if (failed != KILN_OK)
                kiln_build_fail(build, failed, &own);
        }
        kiln_coverage_scratch_destroy(&scratch.coverage);
        kiln_free(&scratch.order);
        kiln_free(&scratch.areas);
    }
    kiln_coverage_destroy(&coverage);
}

static int group_by_map(struct kiln_build *build, struct own_maps *own)
{
    const struct kiln_surface *s = build->surface;
    const size_t maps = s->map_count;
    const char *what = "the own tile runs of each lightmap";
    uint64_t *place = NULL;
    int status = kiln_arena_allocate(&own->arena, &own->first, maps + 1, sizeof *own->first, what, build->error);
    if (status == KILN_OK)
        status = kiln_arena_allocate(&own->arena, &own->tile_runs, s->tile_run_count, sizeof *own->tile_runs, what,
                                     build->error);
    if (status == KILN_OK)
        status = kiln_arena_allocate(&own->arena, &own->wanted, maps, sizeof *own->wanted, what, build->error);
    if (status == KILN_OK)
        status = kiln_allocate(&place, maps, sizeof *place, what, build->error);
    if (status != KILN_OK)
        goto end;
    for (size_t f = 0; f < s->tile_run_count; f++)
        own->first[s->tile_runs[f].map + 1]++;
    for (size_t o = 0; o < maps; o++) {
        own->wanted[o] = own->first[o + 1] > 0;
        place[o] = own->first[o];
        own->first[o + 1] += own->first[o];
    }
    for (size_t f = 0; f < s->tile_run_count; f++)
        own->tile_runs[place[s->tile_runs[f].map]++] = f;
end:
    kiln_free(&place);
    return status;
}

int kiln_build_fill(struct kiln_build *build)
{
    struct kiln_surface *s = build->surface;
    struct own_maps own = {0};
    int status;
    KILN_TRY(kiln_allocate(&s->piece_count, s->count, sizeof *s->piece_count, "the surface points", build->error));
    KILN_TRY(
        kiln_allocate(&s->pieces, s->piece_base[s->tile_run_count], sizeof *s->pieces, "the pieces", build->error));
    KILN_TRY(kiln_allocate(&s->area_cdf, s->area_cdf_base[s->tile_run_count], sizeof *s->area_cdf, "the pieces",
                           build->error));
    KILN_TRY(kiln_allocate(&s->albedo, 3 * s->count, sizeof *s->albedo, "the surface points", build->error));
    KILN_TRY(kiln_allocate(&s->area, s->count, sizeof *s->area, "the surface points", build->error));
    KILN_TRY(kiln_allocate(&s->visible, s->count, sizeof *s->visible, "the surface points", build->error));
    KILN_TRY(group_by_map(build, &own));
    KILN_TRY(create_means(build));
    kiln_build_for_maps(build, own.wanted, fill_map, &own);
    KILN_TRY(build->status);
end:
    destroy_means(build);
    kiln_arena_release(&own.arena);
    return build->exchange->agree(build->exchange->context, status, build->error);
}
