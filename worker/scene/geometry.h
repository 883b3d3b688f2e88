/* The geometry: all triangles of the world as every backend traces them. All objects are expanded; positions are float,
 * relative to the scene's centre.
 *
 * World triangles are numbered 0 .. triangle_count - 1: first all opaque ones, object by object in scene order, then
 * all with an alpha mask or blending, object by object. At the end of each of these two ranges are the triangles of
 * receiver-only objects, which no ray hits; a backend builds its acceleration structure over the others. A backend's
 * hit gives the world triangle's number and (u, v), the barycentric weights of its corners 1 and 2. Seen from the
 * front, corners run counter-clockwise for mirrored objects too: their corners 1 and 2 are exchanged, in `indices` and
 * in the record. So (u, v) always refer to the world triangle's corners; kiln_geometry_stored_barycentrics translates
 * them for functions that take a stored triangle, such as kiln_surface_color.
 *
 * A triangle counts as opaque when its material can let no light through at any of its points: it has no transmission,
 * and its alpha mode is OPAQUE, or the product of the alpha factor, the lowest alpha of the base colour texture and the
 * lowest alpha of its three vertices is above the cutoff (MASK) or is 1 (BLEND).
 *
 * Triangles of an object share vertices as in its mesh. Memory: 48 bytes a triangle and 12 a vertex. */
#ifndef KILN_WORKER_SCENE_GEOMETRY_H
#define KILN_WORKER_SCENE_GEOMETRY_H

#include "shaders/shared/passage.h"
#include "shaders/shared/surface.h"
#include "worker/base/memory.h"
#include "worker/scene/scene.h"

/* Data that a ray needs of the triangle it hit, 32 bytes. */
struct kiln_hit_record {
    /* x and y of corner 0 in the object's lightmap, in texels, or in leaves; then the offsets of corners 1 and 2 from
     * corner 0 */
    float texel[6];
    uint32_t object;
    uint32_t material; /* index of the material, and KILN_RECORD_ flags (shaders/shared/surface.h) */
};

/* Additional hit data if surfaces have leaves (worker/scene/leaves.h): the depth of corner 0, in leaves, and the
 * offsets of corners 1 and 2; and the side that the triangle faces. */
struct kiln_leaf_record {
    float depth[3];
    uint32_t side;
};

/* The ranges of an object's triangles in the world's numbering. The k-th opaque (alpha) triangle of the object is the
 * k-th opaque (alpha) triangle of its mesh in stored order. */
struct kiln_object_range {
    uint64_t opaque_first, opaque_count;
    uint64_t alpha_first, alpha_count;
    uint64_t two_sided; /* number of triangles with KILN_RECORD_DOUBLE_SIDED */
};

struct kiln_geometry {
    size_t vertex_count, triangle_count, opaque_count;
    uint32_t passage; /* KILN_PASSAGE_NONE ... */
    bool coincident;  /* some opposite faces coincide (coincident.h): rays must hit the front */
    /* coincident faces with the same lit sides: their area, m2, and the objects of the largest such pair */
    double doubled_area;
    uint32_t doubled[2];
    /* triangles of receiver-only objects: the last opaque_receivers opaque ones, and the last alpha_receivers of all */
    size_t opaque_receivers, alpha_receivers;
    float *vertices;   /* x y z; 4 floats of padding after the last, as Embree wants */
    uint32_t *indices; /* 3 a triangle */
    struct kiln_hit_record *records;
    /* Leaves (worker/scene/leaves.h): side length, m; origin of their grid, m, relative to the centre; one record a
     * triangle. 0 and NULL: no leaves. */
    double leaf_size;
    struct kiln_dvec3 leaf_origin;
    struct kiln_leaf_record *leaves;
    struct kiln_object_range *ranges;        /* one per object */
    uint32_t *stored_triangle;               /* world triangle -> index among the scene's stored triangles */
    struct kiln_vec3 bounds_min, bounds_max; /* m, relative to the centre; both 0 for an empty scene */
    /* m, largest absolute coordinate: rounding errors are proportional to it */
    float extent;
    struct kiln_allocator memory; /* allocator of the arrays */
};

/* Expands the scene. Not collective. The scene is borrowed and must outlive the geometry. Uses as many OpenMP threads
 * as are set; the result does not depend on their number. KILN_BAD_INPUT if the world has 2^32 - 1 triangles or
 * vertices or more, more than 2^30 materials, or a position further than 1e18 m from the centre (the limit of ray
 * tracing in float); KILN_SYSTEM. Destroy with kiln_geometry_destroy. */
int kiln_geometry_create(struct kiln_geometry **geometry, const struct kiln_scene *scene, struct kiln_error *error);
/* As kiln_geometry_create, with the arrays allocated from `memory`. */
int kiln_geometry_create_in(struct kiln_geometry **geometry, const struct kiln_scene *scene,
                            const struct kiln_allocator *memory, struct kiln_error *error);
/* Makes a geometry from arrays that another process has filled and that this process sees at other addresses (shared
 * memory). `made` is a copy of that process's struct; place(context, p) translates that process's address p to this
 * process's address. `memory` releases the arrays. */
int kiln_geometry_attach(struct kiln_geometry **geometry, const struct kiln_geometry *made,
                         void *(*place)(const void *context, const void *there), const struct kiln_allocator *memory,
                         struct kiln_error *error);
void kiln_geometry_destroy(struct kiln_geometry **geometry);

/* Number of triangles that rays can hit, and the world number of the i-th of them. */
static inline size_t kiln_geometry_hittable_count(const struct kiln_geometry *g)
{
    return g->triangle_count - g->opaque_receivers - g->alpha_receivers;
}
static inline size_t kiln_geometry_hittable(const struct kiln_geometry *g, size_t i)
{
    return i < g->opaque_count - g->opaque_receivers ? i : i + g->opaque_receivers;
}

/* Makes triangles of receiver-only objects hittable, too, for pictures that show them. Call it before a backend is
 * created. */
static inline void kiln_geometry_make_all_hittable(struct kiln_geometry *g)
{
    g->opaque_receivers = g->alpha_receivers = 0;
}

/* Whether a ray that hit the back of a triangle is inside a solid. False for double-sided faces; for faces that let
 * light through somewhere (holes.h); and for simulated glass, in which objects may stand and be lit. */
static inline bool kiln_geometry_is_solid(const struct kiln_geometry *g, uint32_t triangle)
{
    return (g->records[triangle].material & (KILN_RECORD_DOUBLE_SIDED | KILN_RECORD_CLEAR)) == 0;
}

/* The three corners of a world triangle, m, relative to the scene's centre. */
static inline void kiln_geometry_corners(const struct kiln_geometry *g, uint64_t triangle, struct kiln_vec3 corner[3])
{
    for (int c = 0; c < 3; c++) {
        const float *p = g->vertices + 3 * (size_t)g->indices[3 * triangle + (uint64_t)c];
        corner[c] = vec3(p[0], p[1], p[2]);
    }
}

/* Area of a world triangle as it is traced, m2. */
static inline double kiln_geometry_triangle_area(const struct kiln_geometry *g, uint64_t triangle)
{
    struct kiln_vec3 corner[3];
    kiln_geometry_corners(g, triangle, corner);
    const struct kiln_dvec3 o = dvec3_of(corner[0]);
    return 0.5 * dvec3_length(dvec3_cross(dvec3_sub(dvec3_of(corner[1]), o), dvec3_sub(dvec3_of(corner[2]), o)));
}

/* Indices into the scene's vertex arrays of a world triangle's corners, in the world triangle's corner order. */
static inline void kiln_geometry_stored_vertices(const struct kiln_scene *scene, const struct kiln_geometry *g,
                                                 uint64_t triangle, uint64_t vertex[3])
{
    const struct kiln_object *object = &scene->objects[g->records[triangle].object];
    const uint64_t first = scene->meshes[object->mesh].vertex_first;
    const uint32_t *stored = scene->triangles + 3 * (size_t)g->stored_triangle[triangle];
    vertex[0] = first + stored[0];
    vertex[1] = first + stored[object->flipped ? 2 : 1];
    vertex[2] = first + stored[object->flipped ? 1 : 2];
}

/* Translates (u, v) of a hit on a world triangle to the weights of corners 1 and 2 of its stored triangle. */
static inline void kiln_geometry_stored_barycentrics(const struct kiln_scene *scene, const struct kiln_geometry *g,
                                                     uint64_t triangle, float u, float v, float *b1, float *b2)
{
    const int flipped = scene->objects[g->records[triangle].object].flipped != 0;
    *b1 = flipped ? v : u;
    *b2 = flipped ? u : v;
}

/* A world triangle's corners in its object's lightmap, in texels: exact products of stored coordinate and size. (The
 * hit record holds the same, rounded to float.) */
static inline void kiln_geometry_texel_corners(const struct kiln_scene *scene, const struct kiln_geometry *g,
                                               uint64_t triangle, double corner[3][2])
{
    const struct kiln_object *object = &scene->objects[g->records[triangle].object];
    uint64_t vertex[3];
    kiln_geometry_stored_vertices(scene, g, triangle, vertex);
    for (int c = 0; c < 3; c++) {
        const struct kiln_vec2 uv = scene->texcoord_lightmap[vertex[c]];
        corner[c][0] = (double)uv.x * object->lightmap_width;
        corner[c][1] = (double)uv.y * object->lightmap_height;
    }
}

/* The corners in a lightmap whose texels are 2^shift times as wide. Exact, too. */
static inline void kiln_geometry_map_corners(const struct kiln_scene *scene, const struct kiln_geometry *g,
                                             uint64_t triangle, uint32_t shift, double corner[3][2])
{
    kiln_geometry_texel_corners(scene, g, triangle, corner);
    const double scale = 1.0 / (double)(1u << shift);
    for (int c = 0; c < 3 && shift > 0; c++) {
        corner[c][0] *= scale;
        corner[c][1] *= scale;
    }
}

#endif
