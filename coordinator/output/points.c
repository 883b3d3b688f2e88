#include "coordinator/output/points.h"

#include "worker/scene/footprint.h"

struct triangle_view {
    const struct kiln_object *object;
    uint64_t vertex[3]; /* indices of its vertices in the scene */
};

static struct triangle_view view_triangle(const struct kiln_bake_result *result, uint32_t object, uint32_t triangle)
{
    const struct kiln_scene *scene = result->scene;
    struct triangle_view view = {.object = &scene->objects[object]};
    const struct kiln_mesh *mesh = &scene->meshes[view.object->mesh];
    const uint32_t *corner = scene->triangles + 3 * (size_t)result->geometry->stored_triangle[triangle];
    for (int c = 0; c < 3; c++)
        view.vertex[c] = mesh->vertex_first + corner[c];
    return view;
}

/* Computes the barycentric weights of corners 1 and 2 at the centroid of the part of the triangle in the texel; returns
 * the area of that part in texels. `scale`: size of the lightmap relative to the object's published one. */
static double piece_centroid(const struct kiln_scene *scene, const struct triangle_view *view, uint32_t x, uint32_t y,
                             double scale, double *b1, double *b2)
{
    double corner[3][2];
    for (int c = 0; c < 3; c++) {
        const struct kiln_vec2 uv = scene->texcoord_lightmap[view->vertex[c]];
        corner[c][0] = (double)uv.x * view->object->lightmap_width * scale - x;
        corner[c][1] = (double)uv.y * view->object->lightmap_height * scale - y;
    }
    struct kiln_clip_corner polygon[KILN_CLIP_CORNERS], centroid = {0.5, 0.5, 1.0 / 3.0, 1.0 / 3.0};
    const uint32_t count = kiln_clip_triangle(corner, 0.0, 0.0, 1.0, 1.0, polygon);
    const double area = count < 3 ? 0.0 : kiln_clip_area(polygon, count, &centroid);
    *b1 = centroid.b1;
    *b2 = centroid.b2;
    return area;
}

/* As piece_centroid, for a leaf; the area is in squares of leaves. */
static double leaf_centroid(const struct kiln_bake_result *result, uint32_t triangle,
                            const struct kiln_texel_place *place, bool flipped, double *b1, double *b2)
{
    struct kiln_texel_triangle local;
    struct kiln_clip_corner polygon[KILN_CLIP_CORNERS], centroid = {0.5, 0.5, 1.0 / 3.0, 1.0 / 3.0};
    kiln_texel_triangle(result->scene, result->geometry, triangle, place, &local);
    const uint32_t count = kiln_texel_clip(&local, 0.0, 0.0, 1.0, 1.0, polygon);
    const double area = count < 3 ? 0.0 : kiln_clip_area(polygon, count, &centroid);
    *b1 = flipped ? centroid.b2 : centroid.b1; /* a mirrored object's corners 1 and 2 are exchanged in the world */
    *b2 = flipped ? centroid.b1 : centroid.b2;
    return area;
}

/* As piece_centroid, for a part of a texel that walls divide. */
static double part_centroid(const struct kiln_footprint *part, uint32_t triangle, bool flipped, double *b1, double *b2)
{
    struct kiln_clip_corner polygon[KILN_CLIP_CORNERS], centroid = {0.5, 0.5, 1.0 / 3.0, 1.0 / 3.0};
    const uint32_t count = kiln_footprint_clip(part, triangle, polygon);
    const double area = count < 3 ? 0.0 : kiln_clip_area(polygon, count, &centroid);
    *b1 = flipped ? centroid.b2 : centroid.b1;
    *b2 = flipped ? centroid.b1 : centroid.b2;
    return area;
}

static double weigh(double a, double b, double c, double b1, double b2) { return a + b1 * (b - a) + b2 * (c - a); }

static void add_position(const struct kiln_scene *scene, const struct triangle_view *view, double b1, double b2,
                         double share, double position[3])
{
    const struct kiln_vec3 *p[3];
    for (int c = 0; c < 3; c++)
        p[c] = &scene->positions[view->vertex[c]];
    const double local[3] = {weigh((double)p[0]->x, (double)p[1]->x, (double)p[2]->x, b1, b2),
                             weigh((double)p[0]->y, (double)p[1]->y, (double)p[2]->y, b1, b2),
                             weigh((double)p[0]->z, (double)p[1]->z, (double)p[2]->z, b1, b2)};
    const double *m = view->object->transform;
    for (int i = 0; i < 3; i++)
        position[i] += share * (m[4 * i] * local[0] + m[4 * i + 1] * local[1] + m[4 * i + 2] * local[2] + m[4 * i + 3]);
}

/* The inverse transpose is the cofactor matrix over the determinant, of which only the sign matters here. */
struct kiln_dvec3 kiln_world_normal(const double m[12], struct kiln_dvec3 n)
{
    const struct kiln_dvec3 r0 = dvec3(m[0], m[1], m[2]), r1 = dvec3(m[4], m[5], m[6]), r2 = dvec3(m[8], m[9], m[10]);
    const struct kiln_dvec3 c0 = dvec3_cross(r1, r2), c1 = dvec3_cross(r2, r0), c2 = dvec3_cross(r0, r1);
    const double sign = dvec3_dot(r0, c0) < 0.0 ? -1.0 : 1.0;
    const struct kiln_dvec3 out = dvec3(dvec3_dot(c0, n), dvec3_dot(c1, n), dvec3_dot(c2, n));
    const double length = dvec3_length(out);
    return length > 0.0 ? dvec3_scale(out, sign / length) : out;
}

static void add_normal(const struct kiln_scene *scene, const struct triangle_view *view, double b1, double b2,
                       double share, struct kiln_dvec3 *normal)
{
    const struct kiln_vec3 *n[3];
    for (int c = 0; c < 3; c++)
        n[c] = &scene->normals[view->vertex[c]];
    const struct kiln_dvec3 local = dvec3(weigh((double)n[0]->x, (double)n[1]->x, (double)n[2]->x, b1, b2),
                                          weigh((double)n[0]->y, (double)n[1]->y, (double)n[2]->y, b1, b2),
                                          weigh((double)n[0]->z, (double)n[1]->z, (double)n[2]->z, b1, b2));
    *normal = dvec3_add(*normal, dvec3_scale(kiln_world_normal(view->object->transform, local), share));
}

static void describe(const struct kiln_bake_result *result, const struct kiln_point_cursor *at, const uint32_t *pieces,
                     const float *shares, uint32_t piece_count, struct kiln_point_detail *detail)
{
    const double scale = 1.0 / (double)(1u << at->place.shift), side = at->back ? -1.0 : 1.0;
    struct kiln_dvec3 normal = dvec3(0.0, 0.0, 0.0);
    struct kiln_footprint part;
    double coverage = 0.0, before = 0.0;
    kiln_footprint_prepare(&part, result->scene, result->geometry, result->surface, at);
    for (uint32_t i = 0; i < piece_count; i++) {
        const double until = i + 1 < piece_count ? (double)shares[i] : 1.0;
        const struct triangle_view view = view_triangle(result, at->object, pieces[i]);
        double b1, b2;
        coverage += part.divided != NULL ? part_centroid(&part, pieces[i], view.object->flipped != 0, &b1, &b2)
                    : at->leaves ? leaf_centroid(result, pieces[i], &at->place, view.object->flipped != 0, &b1, &b2)
                                 : piece_centroid(result->scene, &view, detail->x, detail->y, scale, &b1, &b2);
        add_position(result->scene, &view, b1, b2, until - before, detail->position);
        add_normal(result->scene, &view, b1, b2, until - before, &normal);
        before = until;
    }
    const double length = dvec3_length(normal);
    const struct kiln_vec3 unit = vec3_of(length > 0.0 ? dvec3_scale(normal, side / length) : normal);
    detail->normal[0] = unit.x;
    detail->normal[1] = unit.y;
    detail->normal[2] = unit.z;
    detail->coverage = (float)(coverage < 1.0 ? coverage : 1.0);
}

static void find_leaf(const struct kiln_geometry *g, uint32_t triangle, const struct kiln_texel_place *place,
                      uint32_t leaf[3])
{
    const uint32_t side = g->leaves[triangle].side, of[3] = {place->x, place->y, place->layer};
    for (int k = 0; k < 3; k++)
        leaf[kiln_leaf_axis(side, k)] = of[k];
}

uint32_t kiln_tile_run_details(const struct kiln_bake_result *result, size_t tile_run,
                               struct kiln_point_detail *details)
{
    const struct kiln_surface *s = result->surface;
    const uint32_t count = s->tile_runs[tile_run].count;
    struct kiln_point_cursor at = kiln_point_first(s, tile_run);
    for (uint32_t i = 0; i < count; i++, kiln_point_next(s, &at)) {
        const uint32_t *pieces = s->pieces + at.piece;
        const uint32_t piece_count = kiln_piece_count(s, at.point);
        details[i] = (struct kiln_point_detail){.x = at.x, .y = at.y, .triangle = pieces[0]};
        if (at.leaves)
            find_leaf(result->geometry, pieces[0], &at.place, details[i].leaf);
        describe(result, &at, pieces, s->area_cdf + at.cdf, piece_count, &details[i]);
        if (kiln_point_whole(s, at.point))
            details[i].coverage = 1.0f;
    }
    return count;
}
