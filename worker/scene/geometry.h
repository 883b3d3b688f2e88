/* The world's triangles as every backend traces them: all objects expanded, float positions relative to the scene's centre.
 *
 * World triangles are numbered 0 .. triangle_count-1: first all opaque ones, object by object in scene order, then all with an
 * alpha mask or blending, object by object. A backend's hit gives this number and (u, v), the barycentric weights of corners 1
 * and 2. Corner order is made counter-clockwise seen from the front also for mirrored objects. */
#ifndef KILN_WORKER_SCENE_GEOMETRY_H
#define KILN_WORKER_SCENE_GEOMETRY_H

#include "worker/scene/scene.h"

/* What a ray needs to know of the triangle it hit, 32 bytes. Texel coordinates in the object's lightmap at hit (u, v):
 * x = texel[0] + u * texel[2] + v * texel[4], y = texel[1] + u * texel[3] + v * texel[5]. */
struct kiln_hit_record {
    float texel[6];
    uint32_t object;
    uint32_t material; /* bit 31: double-sided; bit 30: emits; the rest: index of the material */
};
#define KILN_RECORD_DOUBLE_SIDED 0x80000000u
#define KILN_RECORD_EMITS 0x40000000u
#define KILN_RECORD_MATERIAL 0x3fffffffu

/* Where an object's triangles stand in the world's numbering. The k-th opaque (alpha) triangle of the object is the k-th
 * opaque (alpha) triangle of its mesh in stored order. */
struct kiln_object_range {
    uint64_t opaque_first, opaque_count;
    uint64_t alpha_first, alpha_count;
};

struct kiln_geometry {
    size_t vertex_count, triangle_count, opaque_count;
    float *vertices;   /* x y z; 4 floats of padding after the last, as Embree wants */
    uint32_t *indices; /* 3 a triangle */
    struct kiln_hit_record *records;
    struct kiln_object_range *ranges;  /* one an object */
    uint32_t *stored_triangle;         /* world triangle -> index among the scene's stored triangles */
    struct kiln_vec3 bounds_min, bounds_max; /* relative to the centre; a point at 0 for an empty scene */
    float extent;                      /* largest absolute coordinate: what rounding errors are proportional to */
};

/* Not collective. The scene is borrowed and must outlive the geometry. KILN_BAD_INPUT if the world has 2^32 - 1 triangles or
 * vertices or more, KILN_SYSTEM. */
int kiln_geometry_create(struct kiln_geometry **geometry, const struct kiln_scene *scene, struct kiln_error *error);
void kiln_geometry_destroy(struct kiln_geometry **geometry);

/* World triangle of the object's mesh triangle `k` is found through the ranges; this is the inverse, the three corners. */
static inline void kiln_geometry_corners(const struct kiln_geometry *g, uint64_t triangle, struct kiln_vec3 corner[3])
{
    for (int c = 0; c < 3; c++) {
        const float *p = g->vertices + 3 * (size_t)g->indices[3 * triangle + (uint64_t)c];
        corner[c] = vec3(p[0], p[1], p[2]);
    }
}

#endif
