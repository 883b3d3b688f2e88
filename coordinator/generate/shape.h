/* Builds a mesh from quads, boxes and round solids, with a lightmap layout if all its faces are flat.
 *
 * A failing append is remembered and reported once, by kiln_shape_add: calls in between need no checks. Flat faces
 * belong to charts. kiln_shape_chart gives two directions in the chart's plane, and every vertex after it is laid out
 * by its projection onto them. Charts are packed when the mesh is added, all at one scale, with padding. Solids with
 * curved faces have no chart: a mesh that contains one has no TEXCOORD_1, and kiln unwraps it at import. */
#ifndef KILN_COORDINATOR_GENERATE_SHAPE_H
#define KILN_COORDINATOR_GENERATE_SHAPE_H

#include "coordinator/generate/glb.h"

enum { KILN_SHAPE_MATERIALS = 16 };

struct kiln_shape_chart {
    struct kiln_dvec3 u, v;              /* unit directions */
    double u_low, v_low, u_high, v_high; /* extent, m; measured when the mesh is added */
    size_t vertex_first;                 /* its first vertex; the last one is before the next chart's first */
    double u_place, v_place;             /* position in the layout, layout units */
};

struct kiln_shape {
    struct kiln_vec3 *positions, *normals;
    struct kiln_vec2 *texcoord_0;
    size_t count, positions_capacity, normals_capacity, texcoord_capacity;
    struct {
        uint32_t *indices;
        size_t count, capacity;
    } triangles[KILN_SHAPE_MATERIALS]; /* triangles by material of the palette */
    struct kiln_shape_chart *charts;
    size_t chart_count, chart_capacity;
    bool curved; /* some vertices have no chart */
    int status;  /* status of the first call that failed */
    struct kiln_error error;
};

/* The materials that a scene's shapes may use. A material is written to the file when the first mesh uses it. */
struct kiln_palette {
    const struct kiln_glb_material *table; /* at most KILN_SHAPE_MATERIALS; shapes refer to materials by index */
    /* bit i: table[i] has been written, as material index[i] of the file; start with 0 */
    uint32_t added;
    uint32_t index[KILN_SHAPE_MATERIALS];
};

/* Frees everything and zeroes the struct. Start with a zeroed struct. */
void kiln_shape_clear(struct kiln_shape *shape);

/* Starts a chart; u and v are unit directions in its plane. */
void kiln_shape_chart(struct kiln_shape *shape, struct kiln_dvec3 u, struct kiln_dvec3 v);

/* Adds a quad a b c d, counter-clockwise seen from its front, to the current chart; its normal is that of the triangle
 * a b c. `material` is an index into the palette's table. */
void kiln_shape_quad(struct kiln_shape *shape, uint32_t material, struct kiln_dvec3 a, struct kiln_dvec3 b,
                     struct kiln_dvec3 c, struct kiln_dvec3 d);
/* Adds a quad likewise, in a chart of its own. */
void kiln_shape_face(struct kiln_shape *shape, uint32_t material, struct kiln_dvec3 a, struct kiln_dvec3 b,
                     struct kiln_dvec3 c, struct kiln_dvec3 d);
/* Adds a triangle a b c, counter-clockwise seen from its front, in a chart of its own. */
void kiln_shape_triangle(struct kiln_shape *shape, uint32_t material, struct kiln_dvec3 a, struct kiln_dvec3 b,
                         struct kiln_dvec3 c);
/* Adds a parallelogram at `origin` with sides u and v, front towards u x v, in one chart, with a hole whose sides lie
 * at the given fractions of u and v (all inside 0..1). */
void kiln_shape_face_with_hole(struct kiln_shape *shape, uint32_t material, struct kiln_dvec3 origin,
                               struct kiln_dvec3 u, struct kiln_dvec3 v, const double hole_u[2],
                               const double hole_v[2]);
/* Adds a box of six faces, fronts outwards (or inwards), rotated by `turn` radians about +y through its centre. */
void kiln_shape_box(struct kiln_shape *shape, uint32_t material, struct kiln_dvec3 low, struct kiln_dvec3 high,
                    double turn, bool inwards);

/* A closed surface p(s,t), s and t in 0..1. s goes around: p(0,t) = p(1,t). With `poles`, t = 0 and t = 1 are single
 * points; otherwise t goes around too. Normals are smooth, from differences of p. dp/ds x dp/dt must point outwards. */
struct kiln_shape_surface {
    struct kiln_dvec3 (*point)(const void *data, double s, double t);
    const void *data;
    uint32_t columns, rows; /* 2 x columns x rows triangles, 2 x columns fewer with poles */
    bool poles;
    /* an open sheet: s and t do not wrap around, and `point` is also called slightly outside 0..1 */
    bool open;
};
void kiln_shape_surface(struct kiln_shape *shape, uint32_t material, const struct kiln_shape_surface *surface);

/* Ellipsoids, and tori about the y axis, as surfaces for kiln_shape_surface. */
struct kiln_shape_ellipsoid {
    struct kiln_dvec3 centre, radius;
};
struct kiln_shape_torus {
    struct kiln_dvec3 centre;
    double ring, tube; /* radii */
};
struct kiln_dvec3 kiln_shape_ellipsoid_point(const void *ellipsoid, double s, double t);
struct kiln_dvec3 kiln_shape_torus_point(const void *torus, double s, double t);

/* Moves and scales every vertex: p -> p * scale + offset. */
void kiln_shape_transform(struct kiln_shape *shape, double scale, struct kiln_dvec3 offset);

/* Adds the mesh to the file with materials of the palette, and clears the shape in any case. */
int kiln_shape_add(struct kiln_shape *shape, struct kiln_glb *glb, const char *name, struct kiln_palette *palette,
                   uint32_t *mesh, struct kiln_error *error);

/* Returns the next random number of a sequence in [0,1), with 53 bits: splitmix64 (Steele, Lea, Flood, "Fast Splittable
 * Pseudorandom Number Generators", 2014). */
double kiln_shape_random(uint64_t *state);

#endif
