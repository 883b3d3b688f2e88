/* The world's triangles as every backend traces them: all objects expanded, float positions relative to the scene's
 * centre.
 *
 * World triangles are numbered 0 .. triangle_count-1: first all opaque ones, object by object in scene order, then all
 * with an alpha mask or blending, object by object. At the end of either part stand those of receiver-only objects,
 * which no ray meets: a backend builds its tree over what comes before them. A backend's hit gives this number and (u,
 * v), the barycentric weights of corners 1 and 2. Corner order is made counter-clockwise seen from the front also for
 * mirrored objects: their corners 1 and 2 change places, in `indices` and in the record alike. So (u, v) always speak
 * of the world triangle's corners; where the stored triangle's are wanted (kiln_surface_color and its like),
 * kiln_geometry_stored_barycentrics translates.
 *
 * A triangle counts as opaque when its material can never let light through at any of its points: it has no
 * transmission, and its alpha mode is OPAQUE, or the product of the alpha factor, the lowest alpha of the base colour
 * texture and the lowest alpha of its three vertices is above the cutoff (MASK) or is 1 (BLEND).
 *
 * Vertices are shared by an object's triangles as they are in its mesh. Memory: 48 bytes a triangle and 12 a vertex. */
#ifndef KILN_WORKER_SCENE_GEOMETRY_H
#define KILN_WORKER_SCENE_GEOMETRY_H

#include "shaders/shared/passage.h"
#include "shaders/shared/surface.h"
#include "worker/base/memory.h"
#include "worker/scene/scene.h"

/* What a ray needs to know of the triangle it hit, 32 bytes. Texel coordinates in the object's lightmap at hit (u, v):
 * x = texel[0] + u * texel[2] + v * texel[4], y = texel[1] + u * texel[3] + v * texel[5]. */
struct kiln_hit_record {
    float texel[6];
    uint32_t object;
    uint32_t material; /* index of the material, and KILN_RECORD_ flags (shaders/shared/surface.h) */
};

/* Where an object's triangles stand in the world's numbering. The k-th opaque (alpha) triangle of the object is the
 * k-th opaque (alpha) triangle of its mesh in stored order. */
struct kiln_object_range {
    uint64_t opaque_first, opaque_count;
    uint64_t alpha_first, alpha_count;
    uint64_t two_sided; /* how many have KILN_RECORD_DOUBLE_SIDED */
};

struct kiln_geometry {
    size_t vertex_count, triangle_count, opaque_count;
    uint32_t passage;                 /* KILN_PASSAGE_NONE ... */
    size_t opaque_unmet, alpha_unmet; /* of receiver-only objects: the last opaque ones, and the last of all */
    float *vertices;                  /* x y z; 4 floats of padding after the last, as Embree wants */
    uint32_t *indices;                /* 3 a triangle */
    struct kiln_hit_record *records;
    struct kiln_object_range *ranges;        /* one an object */
    uint32_t *stored_triangle;               /* world triangle -> index among the scene's stored triangles */
    struct kiln_vec3 bounds_min, bounds_max; /* relative to the centre; a point at 0 for an empty scene */
    float extent;                            /* largest absolute coordinate: what rounding errors are proportional to */
    struct kiln_allocator memory;            /* of the arrays */
};

/* Not collective. The scene is borrowed and must outlive the geometry. Uses as many OpenMP threads as are set; the
 * result does not depend on it. KILN_BAD_INPUT if the world has 2^32 - 1 triangles or vertices or more, more than 2^30
 * materials, or a position further than 1e18 m from the centre (what ray tracing in float can hold); KILN_SYSTEM. */
int kiln_geometry_create(struct kiln_geometry **geometry, const struct kiln_scene *scene, struct kiln_error *error);
/* The same with its arrays in `memory`. */
int kiln_geometry_create_in(struct kiln_geometry **geometry, const struct kiln_scene *scene,
                            const struct kiln_allocator *memory, struct kiln_error *error);
/* Of arrays that another process has made and this one sees elsewhere: `made` is a copy of that one's struct, and
 * place(context, p) gives the address here of what p is there. `memory` is what releases them. */
int kiln_geometry_attach(struct kiln_geometry **geometry, const struct kiln_geometry *made,
                         void *(*place)(const void *context, const void *there), const struct kiln_allocator *memory,
                         struct kiln_error *error);
void kiln_geometry_destroy(struct kiln_geometry **geometry);

/* How many triangles rays can meet, and the number in the world of the i-th of them. */
static inline size_t kiln_geometry_met_count(const struct kiln_geometry *g)
{
    return g->triangle_count - g->opaque_unmet - g->alpha_unmet;
}
static inline size_t kiln_geometry_met(const struct kiln_geometry *g, size_t i)
{
    return i < g->opaque_count - g->opaque_unmet ? i : i + g->opaque_unmet;
}

/* From now on rays meet all triangles: for pictures, in which receiver-only objects are seen. Before a backend is made.
 */
static inline void kiln_geometry_meet_all(struct kiln_geometry *g) { g->opaque_unmet = g->alpha_unmet = 0; }

/* The three corners of a world triangle, relative to the scene's centre. */
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

/* From (u, v) of a hit on a world triangle to the weights of corners 1 and 2 of the stored triangle it came from. */
static inline void kiln_geometry_stored_barycentrics(const struct kiln_scene *scene, const struct kiln_geometry *g,
                                                     uint64_t triangle, float u, float v, float *b1, float *b2)
{
    const int flipped = scene->objects[g->records[triangle].object].flipped != 0;
    *b1 = flipped ? v : u;
    *b2 = flipped ? u : v;
}

/* A world triangle's corners in its object's lightmap, in texels: exact products of the stored coordinate and the size
 * (the record holds the same rounded to float). */
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

/* The same in a lightmap whose texels are 2^shift as wide: exact. */
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
