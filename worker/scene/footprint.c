#include "worker/scene/footprint.h"

#include <math.h>

#include "shaders/shared/passage.h"
#include "shaders/shared/streams.h"
#include "shaders/shared/warp.h"
#include "worker/sampling/sequence.h"
#include "worker/scene/clip.h"
#include "worker/scene/texture.h"

/* Number of roundings, each half a unit in the last place of a coordinate, in a position and the planes around it. */
static const double ROUNDINGS = 8.0;
static const double SLIVER = 1e-3; /* relative area of a clipped triangle below which it is the tip of a larger one */

static void local_corners(const struct kiln_footprint *f, uint32_t triangle, struct kiln_texel_triangle *local)
{
    kiln_texel_triangle(f->scene, f->geometry, triangle, &f->place, local);
}

uint32_t kiln_subtexel_clip(const struct kiln_divided_texel *texel, uint32_t part,
                            struct kiln_clip_corner polygon[KILN_CLIP_CORNERS], uint32_t corners)
{
    const uint32_t sides = texel->sides >> 8 * part;
    for (uint32_t i = 0; i < texel->line_count; i++) {
        const float *l = &texel->lines[3 * i];
        const float near[3] = {l[0], l[1], l[2] - texel->margin}, far[3] = {-l[0], -l[1], -l[2] - texel->margin};
        if ((sides >> i & 1) != 0)
            corners = kiln_clip_line(polygon, corners, (sides >> (4 + i) & 1) != 0 ? far : near);
    }
    return corners;
}

uint32_t kiln_footprint_clip(const struct kiln_footprint *f, uint32_t triangle,
                             struct kiln_clip_corner polygon[KILN_CLIP_CORNERS])
{
    struct kiln_texel_triangle local;
    local_corners(f, triangle, &local);
    const uint32_t corners = kiln_texel_clip(&local, 0.0, 0.0, 1.0, 1.0, polygon);
    return f->divided == NULL ? corners : kiln_subtexel_clip(f->divided, f->part, polygon, corners);
}

/* ---- room for rounding ---- */

/* Upper bound of the rounding error of a position on the triangle, m. */
static double rounding_of(const struct kiln_vec3 corner[3])
{
    float most = 0.0f;
    for (int c = 0; c < 3; c++)
        most = fmaxf(most, fmaxf(fabsf(corner[c].x), fmaxf(fabsf(corner[c].y), fabsf(corner[c].z))));
    return ROUNDINGS * 0x1p-24 * (double)most;
}

/* Twice the area, and the perimeter, of a polygon in a triangle with the edges e1 and e2, m2 and m. */
static void measure(const struct kiln_clip_corner *polygon, uint32_t corners, struct kiln_dvec3 e1,
                    struct kiln_dvec3 e2, double *twice, double *outline)
{
    double fraction = 0.0;
    *outline = 0.0;
    for (uint32_t i = 0; i < corners; i++) {
        const struct kiln_clip_corner *o = &polygon[0], *a = &polygon[i], *b = &polygon[i + 1 < corners ? i + 1 : 0];
        fraction += (a->b1 - o->b1) * (b->b2 - o->b2) - (b->b1 - o->b1) * (a->b2 - o->b2);
        *outline += dvec3_length(dvec3_add(dvec3_scale(e1, b->b1 - a->b1), dvec3_scale(e2, b->b2 - a->b2)));
    }
    *twice = fraction * dvec3_length(dvec3_cross(e1, e2));
}

/* Finds the polygon that samples are drawn from. It is shrunk about its centroid, so that rounding moves no sample out
 * of it, for example to the other side of a wall. One thinner than the rounding error becomes a point. */
static uint32_t clip_inside(const struct kiln_footprint *f, uint32_t triangle,
                            struct kiln_clip_corner polygon[KILN_CLIP_CORNERS])
{
    const uint32_t corners = kiln_footprint_clip(f, triangle, polygon);
    struct kiln_clip_corner middle;
    struct kiln_vec3 c[3];
    double twice, outline;
    if (corners < 3 || !(kiln_clip_fraction(polygon, corners, &middle) > 0.0))
        return corners;
    kiln_geometry_corners(f->geometry, triangle, c);
    const struct kiln_dvec3 c0 = dvec3_of(c[0]);
    measure(polygon, corners, dvec3_sub(dvec3_of(c[1]), c0), dvec3_sub(dvec3_of(c[2]), c0), &twice, &outline);
    const double room = rounding_of(c) * outline, keep = room < twice ? 1.0 - room / twice : 0.0;
    for (uint32_t i = 0; i < corners; i++) {
        polygon[i].b1 = middle.b1 + keep * (polygon[i].b1 - middle.b1);
        polygon[i].b2 = middle.b2 + keep * (polygon[i].b2 - middle.b2);
    }
    return corners;
}

/* Factor that shrinks a side of a whole texel likewise; length of the side in m. */
static double keep_of(struct kiln_dvec3 side, double rounding)
{
    const double length = dvec3_length(side);
    return 2.0 * rounding < length ? 1.0 - 2.0 * rounding / length : 0.0;
}

bool kiln_texel_is_sliver(const struct kiln_scene *scene, const struct kiln_geometry *g, uint32_t triangle,
                          const struct kiln_texel_place *place, double area)
{
    const double all = kiln_geometry_triangle_area(g, triangle);
    struct kiln_texel_triangle local;
    struct kiln_vec3 c[3];
    if (area >= SLIVER * all)
        return false;
    kiln_geometry_corners(g, triangle, c);
    kiln_texel_triangle(scene, g, triangle, place, &local);
    const double texels = 0.5 * fabs(kiln_clip_twice_area(local.corner)),
                 width = texels > 0.0 ? sqrt(all / texels) : 0.0;
    return area < 2.0 * rounding_of(c) * width;
}

static void prepare_whole(struct kiln_footprint *f)
{
    struct kiln_texel_triangle local;
    local_corners(f, f->pieces[0], &local);
    struct kiln_clip_weights w = kiln_clip_weights(local.corner);
    struct kiln_vec3 c[3];
    kiln_geometry_corners(f->geometry, f->pieces[0], c);
    const struct kiln_dvec3 c0 = dvec3_of(c[0]);
    const struct kiln_dvec3 e1 = dvec3_sub(dvec3_of(c[1]), c0), e2 = dvec3_sub(dvec3_of(c[2]), c0);
    struct kiln_dvec3 at[3];
    for (int i = 1; i < 3; i++) {
        const struct kiln_dvec3 side = dvec3_add(dvec3_scale(e1, w.b1[i]), dvec3_scale(e2, w.b2[i]));
        const double keep = keep_of(side, rounding_of(c));
        at[i] = dvec3_scale(side, keep);
        w.b1[0] += 0.5 * (1.0 - keep) * w.b1[i];
        w.b2[0] += 0.5 * (1.0 - keep) * w.b2[i];
        w.b1[i] *= keep;
        w.b2[i] *= keep;
    }
    at[0] = dvec3_add(dvec3_scale(e1, w.b1[0]), dvec3_scale(e2, w.b2[0]));
    f->whole.origin = vec3_of(dvec3_add(c0, at[0]));
    f->whole.du = vec3_of(at[1]);
    f->whole.dv = vec3_of(at[2]);
    f->whole.b[0] = (float)w.b1[0];
    f->whole.b[1] = (float)w.b2[0];
    f->whole.b_du[0] = (float)w.b1[1];
    f->whole.b_du[1] = (float)w.b2[1];
    f->whole.b_dv[0] = (float)w.b1[2];
    f->whole.b_dv[1] = (float)w.b2[2];
}

/* Cumulative areas of a polygon's triangle fan, as fractions of the polygon: until[i] belongs to triangle (0, i + 1, i
 * + 2). */
static void fan_areas(const struct kiln_clip_corner *polygon, uint32_t corners, double *until)
{
    const struct kiln_clip_corner *o = polygon;
    double sum = 0.0;
    for (uint32_t i = 0; i + 2 < corners; i++) { /* each as kiln_clip_fraction says */
        const struct kiln_clip_corner *a = &polygon[i + 1], *b = &polygon[i + 2];
        const double fraction = (a->b1 - o->b1) * (b->b2 - o->b2) - (b->b1 - o->b1) * (a->b2 - o->b2);
        sum += fraction > 0.0 ? fraction : 0.0;
        until[i] = sum;
    }
    for (uint32_t i = 0; i + 2 < corners; i++)
        until[i] = sum > 0.0 ? until[i] / sum : 1.0;
}

static bool prepare_few(struct kiln_footprint *f)
{
    for (uint32_t i = 0; i < f->piece_count; i++) {
        struct kiln_footprint_polygon *out = &f->few[i];
        struct kiln_clip_corner polygon[KILN_CLIP_CORNERS];
        double until[KILN_CLIP_CORNERS];
        out->corners = clip_inside(f, f->pieces[i], polygon);
        if (out->corners < 3 || out->corners > KILN_FOOTPRINT_CORNERS)
            return false;
        fan_areas(polygon, out->corners, until);
        for (uint32_t k = 0; k < out->corners; k++) {
            out->b1[k] = (float)polygon[k].b1;
            out->b2[k] = (float)polygon[k].b2;
            if (k + 2 < out->corners)
                out->until[k] = (float)until[k];
        }
    }
    return true;
}

void kiln_footprint_prepare(struct kiln_footprint *footprint, const struct kiln_scene *scene,
                            const struct kiln_geometry *geometry, const struct kiln_surface *surface,
                            const struct kiln_point_cursor *at)
{
    struct kiln_footprint *f = footprint;
    f->scene = scene;
    f->geometry = geometry;
    f->pieces = surface->pieces + at->piece;
    f->piece_count = kiln_piece_count(surface, at->point);
    f->area_cdf = surface->area_cdf + at->cdf;
    f->place = at->place;
    f->back = at->back;
    const struct kiln_subtexel *part =
        surface->part_count > 0 ? kiln_surface_subtexel(surface, kiln_global_of_own(surface, at->point)) : NULL;
    f->divided = part != NULL ? &surface->divided[part->divided] : NULL;
    f->part = part != NULL ? part->part : 0;
    if (kiln_point_whole(surface, at->point) && part == NULL) {
        f->kind = KILN_FOOTPRINT_WHOLE;
        prepare_whole(f);
        return;
    }
    f->kind = f->piece_count <= KILN_FOOTPRINT_PIECES && prepare_few(f) ? KILN_FOOTPRINT_FEW : KILN_FOOTPRINT_MANY;
}

/* Inverts a CDF: returns the index of the first of `count` entries above u, or the last index (whose entry is 1 and is
 * not read). u becomes the position between that entry and the one before, 0..1. */
static uint32_t invert_cdf(const float *until, uint32_t count, double *u)
{
    uint32_t low = 0, high = count - 1;
    while (low < high) {
        const uint32_t middle = low + (high - low) / 2;
        if ((double)until[middle] > *u)
            high = middle;
        else
            low = middle + 1;
    }
    const double before = low > 0 ? (double)until[low - 1] : 0.0,
                 width = (low + 1 < count ? (double)until[low] : 1.0) - before;
    *u = width > 0.0 ? fmin(fmax((*u - before) / width, 0.0), 1.0) : 0.5;
    return low;
}

/* A uniform sample of the triangle whose corners are given by pairs of barycentric weights. */
static void sample_corners(const double b1[3], const double b2[3], double u1, double u2, float *out1, float *out2)
{
    const double root = sqrt(u1), w0 = 1.0 - root, w2 = root * u2, w1 = root - w2;
    const double s1 = fmax(w0 * b1[0] + w1 * b1[1] + w2 * b1[2], 0.0),
                 s2 = fmax(w0 * b2[0] + w1 * b2[1] + w2 * b2[2], 0.0);
    *out1 = fminf((float)s1, 1.0f);
    *out2 = fminf((float)s2, 1.0f - *out1); /* clipping and rounding may step outside the triangle by the last bit */
}

/* A piece that has been clipped, ready to be sampled. */
struct clipped {
    uint32_t triangle, corners; /* KILN_NONE: nothing */
    struct kiln_clip_corner polygon[KILN_CLIP_CORNERS];
    float until[KILN_CLIP_CORNERS];
};

static void clip_piece(const struct kiln_footprint *f, uint32_t triangle, struct clipped *to)
{
    double until[KILN_CLIP_CORNERS];
    to->triangle = triangle;
    to->corners = clip_inside(f, triangle, to->polygon);
    fan_areas(to->polygon, to->corners, until);
    for (uint32_t i = 0; i + 2 < to->corners; i++)
        to->until[i] = (float)until[i];
}

static void sample_clipped(const struct clipped *from, double u1, double u2, float *b1, float *b2)
{
    const uint32_t i = invert_cdf(from->until, from->corners - 2, &u1);
    const struct kiln_clip_corner *a = &from->polygon[0], *b = &from->polygon[i + 1], *c = &from->polygon[i + 2];
    sample_corners((const double[3]){a->b1, b->b1, c->b1}, (const double[3]){a->b2, b->b2, c->b2}, u1, u2, b1, b2);
}

static void sample_few(const struct kiln_footprint_polygon *polygon, double u1, double u2, float *b1, float *b2)
{
    const uint32_t i = invert_cdf(polygon->until, polygon->corners - 2, &u1);
    const double w1[3] = {(double)polygon->b1[0], (double)polygon->b1[i + 1], (double)polygon->b1[i + 2]};
    const double w2[3] = {(double)polygon->b2[0], (double)polygon->b2[i + 1], (double)polygon->b2[i + 2]};
    sample_corners(w1, w2, u1, u2, b1, b2);
}

/* Cache of pieces of a footprint of KILN_FOOTPRINT_MANY, kept between samples. */
enum { PIECES_KEPT = 8 };
struct kept_pieces {
    struct clipped at[PIECES_KEPT];
};

static void keep_none(struct kept_pieces *kept)
{
    for (int i = 0; i < PIECES_KEPT; i++)
        kept->at[i].triangle = KILN_NONE;
}

static inline void sample(const struct kiln_footprint *f, float u1, float u2, struct kept_pieces *kept,
                          uint32_t *triangle, float *b1, float *b2)
{
    double u = (double)u1;
    if (f->kind == KILN_FOOTPRINT_WHOLE) {
        *triangle = f->pieces[0];
        *b1 = fminf(fmaxf(f->whole.b[0] + u1 * f->whole.b_du[0] + u2 * f->whole.b_dv[0], 0.0f), 1.0f);
        *b2 = fminf(fmaxf(f->whole.b[1] + u1 * f->whole.b_du[1] + u2 * f->whole.b_dv[1], 0.0f), 1.0f - *b1);
        return;
    }
    const uint32_t piece = f->piece_count > 1 ? invert_cdf(f->area_cdf, f->piece_count, &u) : 0;
    *triangle = f->pieces[piece];
    if (f->kind == KILN_FOOTPRINT_FEW) {
        sample_few(&f->few[piece], u, (double)u2, b1, b2);
        return;
    }
    struct clipped *clipped = &kept->at[piece % PIECES_KEPT];
    if (clipped->triangle != *triangle)
        clip_piece(f, *triangle, clipped);
    sample_clipped(clipped, u, (double)u2, b1, b2);
}

void kiln_footprint_sample(const struct kiln_footprint *footprint, float u1, float u2, uint32_t *triangle, float *b1,
                           float *b2)
{
    struct kept_pieces kept;
    if (footprint->kind == KILN_FOOTPRINT_MANY)
        keep_none(&kept);
    sample(footprint, u1, u2, &kept, triangle, b1, b2);
}

uint32_t kiln_footprint_triangles(const struct kiln_footprint *f, uint32_t piece,
                                  struct kiln_footprint_triangle *triangles)
{
    struct kiln_clip_corner polygon[KILN_CLIP_CORNERS];
    double until[KILN_CLIP_CORNERS];
    const uint32_t corners = clip_inside(f, f->pieces[piece], polygon);
    if (corners < 3)
        return 0;
    fan_areas(polygon, corners, until);
    const double begin = piece > 0 ? (double)f->area_cdf[piece - 1] : 0.0,
                 end = piece + 1 < f->piece_count ? (double)f->area_cdf[piece] : 1.0;
    for (uint32_t i = 0; i + 2 < corners; i++) {
        const struct kiln_clip_corner *corner[3] = {&polygon[0], &polygon[i + 1], &polygon[i + 2]};
        triangles[i] = (struct kiln_footprint_triangle){
            .triangle = f->pieces[piece], .until = begin + (end - begin) * (i + 3 < corners ? until[i] : 1.0)};
        for (int c = 0; c < 3; c++) {
            triangles[i].b1[c] = corner[c]->b1;
            triangles[i].b2[c] = corner[c]->b2;
        }
    }
    return corners - 2;
}

double kiln_footprint_piece_area(const struct kiln_footprint *f, uint32_t piece)
{
    struct kiln_clip_corner polygon[KILN_CLIP_CORNERS], centroid;
    return kiln_clip_fraction(polygon, kiln_footprint_clip(f, f->pieces[piece], polygon), &centroid) *
           kiln_geometry_triangle_area(f->geometry, f->pieces[piece]);
}

static struct kiln_vec3 lower(struct kiln_vec3 a, struct kiln_vec3 b)
{
    return vec3(fminf(a.x, b.x), fminf(a.y, b.y), fminf(a.z, b.z));
}
static struct kiln_vec3 upper(struct kiln_vec3 a, struct kiln_vec3 b)
{
    return vec3(fmaxf(a.x, b.x), fmaxf(a.y, b.y), fmaxf(a.z, b.z));
}

struct kiln_footprint_extent kiln_footprint_extent(const struct kiln_footprint *f)
{
    if (f->kind == KILN_FOOTPRINT_WHOLE)
        return (struct kiln_footprint_extent){
            vec3_madd(vec3_madd(f->whole.origin, f->whole.du, 0.5f), f->whole.dv, 0.5f),
            0.5f * (vec3_length(f->whole.du) + vec3_length(f->whole.dv)), true};
    const struct kiln_vec3 normal = kiln_triangle_normal(f->geometry, f->pieces[0]);
    struct kiln_vec3 low = vec3(INFINITY, INFINITY, INFINITY), high = vec3(-INFINITY, -INFINITY, -INFINITY);
    bool one_normal = true;
    for (uint32_t i = 0; i < f->piece_count; i++) {
        struct kiln_footprint_triangle triangles[KILN_FOOTPRINT_TRIANGLES];
        const uint32_t count = kiln_footprint_triangles(f, i, triangles);
        for (uint32_t k = 0; k < count; k++)
            for (int c = 0; c < 3; c++) {
                const struct kiln_vec3 p = kiln_triangle_position(f->geometry, triangles[k].triangle,
                                                                  (float)triangles[k].b1[c], (float)triangles[k].b2[c]);
                low = lower(low, p);
                high = upper(high, p);
            }
        one_normal = one_normal && vec3_dot(normal, kiln_triangle_normal(f->geometry, f->pieces[i])) >= 0.99999f;
    }
    if (!(low.x <= high.x)) /* clipping left nothing: use the triangle's first corner */
        low = high = kiln_triangle_position(f->geometry, f->pieces[0], 0.0f, 0.0f);
    return (struct kiln_footprint_extent){vec3_scale(vec3_add(low, high), 0.5f),
                                          0.5f * vec3_length(vec3_sub(high, low)), one_normal};
}

/* Number of texels of the opacity texture along one lightmap texel of the triangle; 0: no texture determines opacity.
 */
static double texture_detail(const struct kiln_footprint *f, uint32_t triangle)
{
    const struct kiln_scene *scene = f->scene;
    const struct kiln_material *m = &scene->materials[f->geometry->records[triangle].material & KILN_RECORD_MATERIAL];
    const uint32_t texture = m->transmission > 0.0f && m->transmission_texture != KILN_NONE ? m->transmission_texture
                             : m->alpha_mode != KILN_ALPHA_OPAQUE                           ? m->base_color_texture
                                                                                            : KILN_NONE;
    struct kiln_texel_triangle local;
    double at[3][2];
    uint64_t vertex[3];
    if (texture == KILN_NONE)
        return 0.0;
    local_corners(f, triangle, &local);
    kiln_geometry_stored_vertices(scene, f->geometry, triangle, vertex);
    for (int c = 0; c < 3; c++) {
        at[c][0] = (double)scene->texcoord_base[vertex[c]].x * scene->textures[texture].width;
        at[c][1] = (double)scene->texcoord_base[vertex[c]].y * scene->textures[texture].height;
    }
    const double area = fabs(kiln_clip_twice_area(local.corner));
    return area > 0.0 ? fabs(kiln_clip_twice_area(at)) / area : 0.0;
}

/* Opacity lookups along each side of the square of (u1, u2). */
static uint32_t lookups_of(const struct kiln_footprint *f)
{
    double detail = 0.0;
    for (uint32_t i = 0; i < f->piece_count; i++)
        detail = f->pieces[i] < f->geometry->opaque_count ? detail : fmax(detail, texture_detail(f, f->pieces[i]));
    return detail <= 1.0 ? 4 : detail <= 4.0 ? 8 : KILN_MASK_SIDE;
}

/* Opacity of a world triangle where (u, v) are the weights of its corners 1 and 2. */
static float opacity_at(const struct kiln_footprint *f, uint32_t triangle, float u, float v)
{
    const struct kiln_geometry *g = f->geometry;
    float b1, b2;
    if (triangle < g->opaque_count)
        return 1.0f;
    kiln_geometry_stored_barycentrics(f->scene, g, triangle, u, v, &b1, &b2);
    return kiln_surface_opacity(f->scene, &f->scene->meshes[f->scene->objects[g->records[triangle].object].mesh],
                                g->stored_triangle[triangle], b1, b2);
}

/* Positions are drawn over the whole point if at least one lookup in so many finds something: then a part that the
 * lookups missed is found, and KILN_PLACE_TRIES positions suffice. */
enum { LOOKS_A_FIND = 8 };

/* Whether the lookup at (x, y) or a neighbouring one found opacity above 0. */
static bool found_near(const float *opacity, uint32_t side, uint32_t x, uint32_t y)
{
    for (uint32_t j = y > 0 ? y - 1 : 0; j <= y + 1 && j < side; j++)
        for (uint32_t i = x > 0 ? x - 1 : 0; i <= x + 1 && i < side; i++)
            if (opacity[j * side + i] > 0.0f)
                return true;
    return false;
}

/* Marks cells of the mask where something may exist, by side x side lookups, of which `found` found something. */
static void fill_mask(struct kiln_mask *mask, const float *opacity, uint32_t side, uint32_t found)
{
    const bool everywhere = found * LOOKS_A_FIND >= side * side;
    for (uint32_t cell = 0; cell < KILN_MASK_SIDE * KILN_MASK_SIDE; cell++) {
        const uint32_t x = kiln_cell_column(cell) * side / KILN_MASK_SIDE,
                       y = kiln_cell_column(cell >> 1) * side / KILN_MASK_SIDE;
        const uint32_t set = everywhere || found_near(opacity, side, x, y);
        mask->cells[cell / 32] |= set << cell % 32;
        mask->count += set;
    }
}

static float look(const struct kiln_footprint *f, float u1, float u2, struct kept_pieces *kept)
{
    uint32_t triangle;
    float b1, b2;
    sample(f, u1, u2, kept, &triangle, &b1, &b2);
    return opacity_at(f, triangle, b1, b2);
}

/* Look i of side x side. */
static float look_in_cell(const struct kiln_footprint *f, uint32_t key, uint32_t side, uint32_t i,
                          struct kept_pieces *kept)
{
    const uint32_t hash = kiln_hash2(key, i);
    const float x = (float)(i % side) + kiln_unit_float(hash),
                y = (float)(i / side) + kiln_unit_float(kiln_hash1(hash));
    return look(f, fminf(x / (float)side, 0x1.fffffep-1f), fminf(y / (float)side, 0x1.fffffep-1f), kept);
}

float kiln_footprint_opacity(const struct kiln_footprint *f, uint32_t key, struct kiln_mask *mask)
{
    *mask = (struct kiln_mask){0};
    if (f->pieces[f->piece_count - 1] < f->geometry->opaque_count) /* pieces ascend: those with alpha come last */
        return 1.0f;
    const uint32_t side = lookups_of(f), count = side * side;
    uint32_t found = 0;
    float opacity[KILN_MASK_SIDE * KILN_MASK_SIDE], sum = 0.0f, low = 1.0f, high = 0.0f;
    struct kept_pieces kept;
    keep_none(&kept);
    for (uint32_t x = 0; x < side; x++) /* lookups in one column mostly hit the same pieces */
        for (uint32_t i = x; i < count; i += side)
            opacity[i] = look_in_cell(f, key, side, i, &kept);
    for (uint32_t i = 0; i < count; i++) {
        sum += opacity[i];
        found += opacity[i] > 0.0f;
        low = fminf(low, opacity[i]);
        high = fmaxf(high, opacity[i]);
    }
    mask->most = fminf(2.0f * high, 1.0f);
    if (high - low > 1.0f / 256.0f)
        fill_mask(mask, opacity, side, found);
    return sum / (float)count;
}

void kiln_footprint_sample_present(const struct kiln_footprint *footprint, const struct kiln_mask *mask, uint32_t key,
                                   float u1, float u2, uint32_t *triangle, float *b1, float *b2)
{
    float s = u1, t = u2;
    for (uint32_t i = 0; i < KILN_PLACE_TRIES; i++) {
        const uint32_t hash = kiln_place_try(u1, u2, key, i);
        kiln_mask_place(mask, &s, &t);
        kiln_footprint_sample(footprint, s, t, triangle, b1, b2);
        if (kiln_is_there(hash, *triangle, opacity_at(footprint, *triangle, *b1, *b2) / mask->most))
            return;
        s = kiln_unit_float(hash);
        t = kiln_unit_float(kiln_hash1(hash));
    }
}

static struct kiln_dvec3 unit(struct kiln_dvec3 v)
{
    const double length = dvec3_length(v);
    return length > 0.0 ? dvec3_scale(v, 1.0 / length) : v;
}

static struct kiln_dvec3 triangle_normal(const struct kiln_geometry *g, uint32_t triangle)
{
    struct kiln_vec3 c[3];
    kiln_geometry_corners(g, triangle, c);
    const struct kiln_dvec3 o = dvec3_of(c[0]);
    return unit(dvec3_cross(dvec3_sub(dvec3_of(c[1]), o), dvec3_sub(dvec3_of(c[2]), o)));
}

struct kiln_vec3 kiln_triangle_normal(const struct kiln_geometry *geometry, uint32_t triangle)
{
    return vec3_of(triangle_normal(geometry, triangle));
}

static struct kiln_dvec3 row(const double *m, int r) { return dvec3(m[4 * r], m[4 * r + 1], m[4 * r + 2]); }

/* Transforms a normal by the cofactor matrix: the inverse transpose times the determinant. The determinant's sign is
 * divided out. */
static struct kiln_dvec3 to_world(const struct kiln_object *object, struct kiln_dvec3 n)
{
    const struct kiln_dvec3 x = row(object->transform, 0), y = row(object->transform, 1), z = row(object->transform, 2);
    const struct kiln_dvec3 world =
        dvec3(dvec3_dot(dvec3_cross(y, z), n), dvec3_dot(dvec3_cross(z, x), n), dvec3_dot(dvec3_cross(x, y), n));
    return unit(object->flipped ? dvec3_scale(world, -1.0) : world);
}

struct kiln_vec3 kiln_triangle_exact_normal(const struct kiln_scene *scene, const struct kiln_geometry *geometry,
                                            uint32_t triangle)
{
    const double *m = scene->objects[geometry->records[triangle].object].transform;
    uint64_t vertex[3];
    kiln_geometry_stored_vertices(scene, geometry, triangle, vertex);
    const struct kiln_dvec3 origin = dvec3_of(scene->positions[vertex[0]]);
    struct kiln_dvec3 edge[2];
    for (int i = 0; i < 2; i++) {
        const struct kiln_dvec3 e = dvec3_sub(dvec3_of(scene->positions[vertex[i + 1]]), origin);
        edge[i] = dvec3(dvec3_dot(row(m, 0), e), dvec3_dot(row(m, 1), e), dvec3_dot(row(m, 2), e));
    }
    const struct kiln_dvec3 normal = unit(dvec3_cross(edge[0], edge[1]));
    if (!(dvec3_dot(normal, normal) > 0.0))
        return kiln_triangle_normal(geometry, triangle);
    const struct kiln_object *object = &scene->objects[geometry->records[triangle].object];
    if ((scene->meshes[object->mesh].flags & KILN_MESH_SMOOTH) != 0)
        return vec3_of(normal);
    const struct kiln_dvec3 stored = to_world(
        object, dvec3_add(dvec3_of(scene->normals[vertex[0]]),
                          dvec3_add(dvec3_of(scene->normals[vertex[1]]), dvec3_of(scene->normals[vertex[2]]))));
    return vec3_of(dvec3_dot(stored, normal) > 1.0 - 1e-6 ? stored : normal);
}

static struct kiln_dvec3 shading_normal(const struct kiln_scene *scene, const struct kiln_geometry *g,
                                        uint32_t triangle, double b1, double b2)
{
    const struct kiln_object *object = &scene->objects[g->records[triangle].object];
    const struct kiln_dvec3 geometric = triangle_normal(g, triangle);
    if ((scene->meshes[object->mesh].flags & KILN_MESH_SMOOTH) == 0)
        return geometric;
    uint64_t vertex[3];
    kiln_geometry_stored_vertices(scene, g, triangle, vertex);
    const struct kiln_dvec3 mesh = dvec3_add(dvec3_scale(dvec3_of(scene->normals[vertex[0]]), 1.0 - b1 - b2),
                                             dvec3_add(dvec3_scale(dvec3_of(scene->normals[vertex[1]]), b1),
                                                       dvec3_scale(dvec3_of(scene->normals[vertex[2]]), b2)));
    const struct kiln_dvec3 shading = to_world(object, mesh);
    return dvec3_dot(shading, geometric) > 0.0 ? shading : geometric;
}

struct kiln_vec3 kiln_triangle_shading_normal(const struct kiln_scene *scene, const struct kiln_geometry *geometry,
                                              uint32_t triangle, float b1, float b2)
{
    return vec3_of(shading_normal(scene, geometry, triangle, (double)b1, (double)b2));
}

bool kiln_triangle_lift(const struct kiln_scene *scene, const struct kiln_geometry *g, uint32_t triangle, bool back,
                        struct kiln_lift *lift)
{
    static const int ends[3][2] = {{0, 1}, {0, 2}, {1, 2}}, places[3][2] = {{0, 2}, {1, 4}, {3, 5}};
    const struct kiln_object *object = &scene->objects[g->records[triangle].object];
    const struct kiln_dvec3 n = triangle_normal(g, triangle);
    struct kiln_dvec3 soft[3];
    struct kiln_vec3 corner[3];
    uint64_t vertex[3];
    bool any = false;
    kiln_geometry_corners(g, triangle, corner);
    kiln_geometry_stored_vertices(scene, g, triangle, vertex);
    for (int i = 0; i < 3; i++) { /* times the cosine, and the corner's weight */
        const struct kiln_dvec3 own = to_world(object, dvec3_of(scene->normals[vertex[i]]));
        const double cosine = dvec3_dot(own, n), none = (double)KILN_LIFT_NONE, whole = (double)KILN_LIFT_WHOLE;
        soft[i] = dvec3_scale(own, cosine * fmin(fmax((cosine - none) / (whole - none), 0.0), 1.0));
    }
    for (int e = 0; e < 3; e++) {
        const int i = ends[e][0], j = ends[e][1];
        const struct kiln_dvec3 edge = dvec3_sub(dvec3_of(corner[i]), dvec3_of(corner[j]));
        const double height = 0.5 * (back ? -1.0 : 1.0) * dvec3_dot(dvec3_sub(soft[i], soft[j]), edge);
        const bool counts = height > 1e-5 * dvec3_length(edge);
        lift->at[places[e][0]] = lift->at[places[e][1]] = counts ? (float)height : 0.0f;
        any = any || counts;
    }
    return any;
}

/* Shading normal at the centroid of the triangle's part in the texel. */
static struct kiln_dvec3 piece_normal(const struct kiln_footprint *f, uint32_t triangle)
{
    struct kiln_clip_corner polygon[KILN_CLIP_CORNERS], centroid = {0.0, 0.0, 1.0 / 3.0, 1.0 / 3.0};
    kiln_clip_fraction(polygon, kiln_footprint_clip(f, triangle, polygon), &centroid);
    return shading_normal(f->scene, f->geometry, triangle, centroid.b1, centroid.b2);
}

void kiln_footprint_normals(const struct kiln_footprint *footprint, struct kiln_vec3 *geometric,
                            struct kiln_vec3 *shading)
{
    const struct kiln_footprint *f = footprint;
    const struct kiln_object *object = &f->scene->objects[f->geometry->records[f->pieces[0]].object];
    const bool smooth = (f->scene->meshes[object->mesh].flags & KILN_MESH_SMOOTH) != 0;
    struct kiln_dvec3 flat = {0.0, 0.0, 0.0}, soft = {0.0, 0.0, 0.0};
    double before = 0.0, most = 0.0;
    uint32_t largest = f->pieces[0];
    for (uint32_t i = 0; i < f->piece_count; i++) {
        const double until = i + 1 < f->piece_count ? (double)f->area_cdf[i] : 1.0, fraction = until - before;
        flat = dvec3_add(flat, dvec3_scale(triangle_normal(f->geometry, f->pieces[i]), fraction));
        if (smooth)
            soft = dvec3_add(soft, dvec3_scale(piece_normal(f, f->pieces[i]), fraction));
        largest = fraction > most ? f->pieces[i] : largest;
        most = fmax(most, fraction);
        before = until;
    }
    if (dvec3_length(flat) < 1e-3) {
        flat = triangle_normal(f->geometry, largest);
        if (smooth)
            soft = piece_normal(f, largest);
    }
    flat = unit(flat);
    const double side = f->back ? -1.0 : 1.0;
    *geometric = vec3_of(dvec3_scale(flat, side));
    *shading = smooth && dvec3_length(soft) >= 1e-3 && dvec3_dot(soft, flat) > 0.0
                   ? vec3_of(dvec3_scale(unit(soft), side))
                   : *geometric;
}

float kiln_offset_distance(const struct kiln_geometry *geometry, uint32_t triangle, struct kiln_vec3 n)
{
    static const double u = 0x1p-24;
    struct kiln_vec3 corner[3];
    double c[3][3];
    kiln_geometry_corners(geometry, triangle, corner);
    for (int i = 0; i < 3; i++) {
        c[i][0] = (double)corner[i].x;
        c[i][1] = (double)corner[i].y;
        c[i][2] = (double)corner[i].z;
    }
    const double normal[3] = {fabs((double)n.x), fabs((double)n.y), fabs((double)n.z)};
    double along = 0.0, tilt = 0.0, most = 0.0, square = 0.0;
    for (int k = 0; k < 3; k++) {
        const double size = fmax(fabs(c[1][k] - c[0][k]), fmax(fabs(c[2][k] - c[0][k]), fabs(c[2][k] - c[1][k])));
        const double magnitude = fmax(fabs(c[0][k]), fmax(fabs(c[1][k]), fabs(c[2][k])));
        along += normal[k] * u * (5.0 * magnitude + 9.0 * size);
        const int i = (k + 1) % 3, j = (k + 2) % 3;
        const double a = (c[1][i] - c[0][i]) * (c[2][j] - c[0][j]), b = (c[1][j] - c[0][j]) * (c[2][i] - c[0][i]);
        tilt += 6.0 * u * (fabs(a) + fabs(b)) * size;
        square += (a - b) * (a - b);
        most = fmax(most, size);
    }
    const double limit = 0x1p-10 * most;
    tilt = square > 0.0 ? fmin(tilt / sqrt(square), limit) : 0.0;
    return (float)fmax(1.25 * (along + tilt), u * most);
}
