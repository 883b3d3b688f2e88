#include "coordinator/view/normal_map.h"

#include <stdlib.h>

#include "worker/scene/texture.h"

static int compare_materials(const void *key, const void *map)
{
    const uint32_t a = *(const uint32_t *)key, b = ((const struct kiln_normal_map *)map)->material;
    return (a > b) - (a < b);
}

const struct kiln_normal_map *kiln_normal_map_of(const struct kiln_scene *scene, uint64_t stored_triangle)
{
    if (scene->normal_map_count == 0)
        return NULL;
    return bsearch(&scene->triangle_materials[stored_triangle], scene->normal_maps, scene->normal_map_count,
                   sizeof *scene->normal_maps, compare_materials);
}

/* Derivatives of the position by the texture coordinates, each up to a positive factor. False: they do not exist. */
static bool derivatives(const struct kiln_scene *scene, const struct kiln_geometry *g, uint32_t triangle,
                        struct kiln_dvec3 *along_u, struct kiln_dvec3 *along_v)
{
    struct kiln_vec3 corner[3];
    uint64_t vertex[3];
    kiln_geometry_corners(g, triangle, corner);
    kiln_geometry_stored_vertices(scene, g, triangle, vertex);
    const struct kiln_vec2 *uv = scene->texcoord_normal;
    const struct kiln_dvec3 o = dvec3_of(corner[0]), a = dvec3_sub(dvec3_of(corner[1]), o),
                            b = dvec3_sub(dvec3_of(corner[2]), o);
    const double u0 = (double)uv[vertex[0]].x, v0 = (double)uv[vertex[0]].y;
    const double ua = (double)uv[vertex[1]].x - u0, va = (double)uv[vertex[1]].y - v0;
    const double ub = (double)uv[vertex[2]].x - u0, vb = (double)uv[vertex[2]].y - v0;
    const double area = ua * vb - ub * va;
    *along_u = dvec3_sub(dvec3_scale(a, vb), dvec3_scale(b, va));
    *along_v = dvec3_sub(dvec3_scale(b, ua), dvec3_scale(a, ub));
    if (area < 0.0) {
        *along_u = dvec3_scale(*along_u, -1.0);
        *along_v = dvec3_scale(*along_v, -1.0);
    }
    return area != 0.0 && isfinite(area);
}

/* The unit vector along a; the zero vector if it has no direction. */
static struct kiln_dvec3 unit(struct kiln_dvec3 a)
{
    const double length = dvec3_length(a);
    return length > 0.0 && isfinite(length) ? dvec3_scale(a, 1.0 / length) : dvec3(0.0, 0.0, 0.0);
}

/* The map's normal at (u, v) of a world triangle, in tangent space. */
static struct kiln_dvec3 stored_normal(const struct kiln_scene *scene, const struct kiln_geometry *g,
                                       const struct kiln_normal_map *map, uint32_t triangle, float u, float v)
{
    uint64_t vertex[3];
    float rgba[4];
    kiln_geometry_stored_vertices(scene, g, triangle, vertex);
    const struct kiln_vec2 a = scene->texcoord_normal[vertex[0]], b = scene->texcoord_normal[vertex[1]],
                           c = scene->texcoord_normal[vertex[2]];
    kiln_texture_sample(scene, map->texture, a.x + u * (b.x - a.x) + v * (c.x - a.x),
                        a.y + u * (b.y - a.y) + v * (c.y - a.y), rgba);
    const double scale = (double)map->scale;
    return dvec3(scale * (2.0 * (double)rgba[0] - 1.0), scale * (2.0 * (double)rgba[1] - 1.0),
                 2.0 * (double)rgba[2] - 1.0);
}

struct kiln_dvec3 kiln_normal_map_apply(const struct kiln_scene *scene, const struct kiln_geometry *g,
                                        const struct kiln_normal_map *map, uint32_t triangle, float u, float v,
                                        struct kiln_dvec3 n)
{
    struct kiln_dvec3 along_u, along_v;
    if (!derivatives(scene, g, triangle, &along_u, &along_v))
        return n;
    const struct kiln_dvec3 tangent = unit(dvec3_sub(along_u, dvec3_scale(n, dvec3_dot(n, along_u))));
    const struct kiln_dvec3 cross = dvec3_cross(n, tangent);
    const struct kiln_dvec3 up = dvec3_scale(cross, dvec3_dot(cross, along_v) > 0.0 ? -1.0 : 1.0);
    const struct kiln_dvec3 t = stored_normal(scene, g, map, triangle, u, v);
    const struct kiln_dvec3 mapped =
        unit(dvec3_add(dvec3_scale(n, t.z), dvec3_add(dvec3_scale(tangent, t.x), dvec3_scale(up, t.y))));
    return dvec3_dot(tangent, tangent) > 0.0 && dvec3_dot(mapped, mapped) > 0.0 ? mapped : n;
}
