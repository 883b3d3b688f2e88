/* Distance of positions to the nearest triangle, by Embree's point queries. */
#include <float.h>
#include <math.h>

#include "worker/backend/embree/embree.h"
#include "worker/pass/spheres.h"

#define LOOKED 1.01 /* of a radius: how far is looked */
/* Margin for rounding in tracing and searching: relative to the distance, and to coordinates */
#define FARTHER 1e-4
#define ROUNDING (32.0 * (double)FLT_EPSILON)

/* Squared distance to the nearest point of the segment from a to b. */
static double to_edge(struct kiln_dvec3 p, struct kiln_dvec3 a, struct kiln_dvec3 b)
{
    const struct kiln_dvec3 edge = dvec3_sub(b, a), to = dvec3_sub(p, a);
    const double square = dvec3_dot(edge, edge),
                 share = square > 0.0 ? fmax(0.0, fmin(dvec3_dot(to, edge) / square, 1.0)) : 0.0;
    const struct kiln_dvec3 off = dvec3_sub(to, dvec3_scale(edge, share));
    return dvec3_dot(off, off);
}

/* Whether the triangle's point nearest to p is p's projection onto its plane, which has the normal n. */
static bool has_foot(struct kiln_dvec3 p, const struct kiln_dvec3 corner[3], struct kiln_dvec3 n)
{
    bool inside = true;
    for (int i = 0; i < 3; i++) {
        const struct kiln_dvec3 edge = dvec3_sub(corner[(i + 1) % 3], corner[i]);
        inside = inside && dvec3_dot(dvec3_cross(edge, dvec3_sub(p, corner[i])), n) > 0.0;
    }
    return inside;
}

static double to_triangle(struct kiln_dvec3 p, const struct kiln_vec3 of[3])
{
    const struct kiln_dvec3 corner[3] = {dvec3_of(of[0]), dvec3_of(of[1]), dvec3_of(of[2])},
                            n = dvec3_cross(dvec3_sub(corner[1], corner[0]), dvec3_sub(corner[2], corner[0]));
    double square = INFINITY;
    if (has_foot(p, corner, n))
        return fabs(dvec3_dot(dvec3_sub(p, corner[0]), n)) / dvec3_length(n);
    for (int i = 0; i < 3; i++)
        square = fmin(square, to_edge(p, corner[i], corner[(i + 1) % 3]));
    return sqrt(square);
}

/* RTCPointQueryFunction */
static bool look(struct RTCPointQueryFunctionArguments *arguments)
{
    const struct embree_backend *b = arguments->userPtr;
    struct RTCPointQuery *query = arguments->query;
    struct kiln_vec3 corner[3];
    kiln_geometry_corners(b->params.geometry, embree_triangle(b, arguments->geomID, arguments->primID), corner);
    const double distance =
        to_triangle(dvec3((double)query->x, (double)query->y, (double)query->z), (const struct kiln_vec3 *)corner);
    if (!(distance < (double)query->radius))
        return false;
    query->radius = (float)distance;
    return true;
}

static float clear_about(const struct embree_backend *b, const struct kiln_sphere *sphere)
{
    const float *c = sphere->centre;
    struct RTCPointQueryContext context;
    struct RTCPointQuery query = {.x = c[0], .y = c[1], .z = c[2], .radius = (float)(LOOKED * (double)sphere->radius)};
    rtcInitPointQueryContext(&context);
    (void)rtcPointQuery(b->scene, &query, &context, look, (void *)(uintptr_t)b);
    const double size = fabs((double)c[0]) + fabs((double)c[1]) + fabs((double)c[2]) + (double)sphere->radius,
                 clear = (1.0 - FARTHER) * (double)query.radius - ROUNDING * size;
    return (float)fmax(0.0, clear);
}

int embree_clearance(struct kiln_backend *backend, const struct kiln_sphere *spheres, size_t count, float *clear,
                     struct kiln_error *error)
{
    const struct embree_backend *b = (const struct embree_backend *)backend;
    (void)error;
#pragma omp parallel for schedule(dynamic, 64) num_threads((int)b->threads)
    for (size_t i = 0; i < count; i++)
        clear[i] = spheres[i].radius > 0.0f ? clear_about(b, &spheres[i]) : 0.0f;
    return KILN_OK;
}
