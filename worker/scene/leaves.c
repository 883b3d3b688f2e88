#include "worker/scene/leaves.h"

static const double BEFORE = 0.5;        /* distance of the grid's origin from the scene's bounds, in leaves */
static const double NEARER = 1.0 + 1e-4; /* an axis is preferred to the one before if its component is larger by this */

static double component(struct kiln_dvec3 v, int axis) { return axis == 0 ? v.x : axis == 1 ? v.y : v.z; }

static uint32_t side_of(const struct kiln_geometry *g, uint64_t triangle)
{
    struct kiln_vec3 c[3];
    kiln_geometry_corners(g, triangle, c);
    const struct kiln_dvec3 o = dvec3_of(c[0]),
                            n = dvec3_cross(dvec3_sub(dvec3_of(c[1]), o), dvec3_sub(dvec3_of(c[2]), o));
    int nearest = 0;
    for (int axis = 1; axis < 3; axis++)
        if (fabs(component(n, axis)) > NEARER * fabs(component(n, nearest)))
            nearest = axis;
    return 2 * (uint32_t)nearest + (component(n, nearest) < 0.0 ? 1u : 0u);
}

void kiln_leaf_corners(const struct kiln_geometry *g, uint64_t triangle, double corner[3][3])
{
    const uint32_t side = g->leaves[triangle].side;
    struct kiln_vec3 c[3];
    kiln_geometry_corners(g, triangle, c);
    for (int i = 0; i < 3; i++) {
        const struct kiln_dvec3 p = dvec3_sub(dvec3_of(c[i]), g->leaf_origin);
        for (int k = 0; k < 3; k++)
            corner[i][k] = component(p, kiln_leaf_axis(side, k)) / g->leaf_size;
        corner[i][2] = (double)(float)corner[i][2];
    }
}

static void lay_record(struct kiln_geometry *g, uint64_t triangle)
{
    struct kiln_leaf_record *leaf = &g->leaves[triangle];
    float *texel = g->records[triangle].texel;
    double c[3][3];
    leaf->side = side_of(g, triangle);
    kiln_leaf_corners(g, triangle, c);
    for (int i = 0; i < 3; i++) {
        for (int k = 0; k < 2; k++)
            texel[2 * i + k] = (float)(i == 0 ? c[0][k] : c[i][k] - c[0][k]);
        leaf->depth[i] = (float)(i == 0 ? c[0][2] : c[i][2] - c[0][2]);
    }
}

int kiln_leaves_lay(struct kiln_geometry *geometry, double size, struct kiln_error *error)
{
    struct kiln_geometry *g = geometry;
    const struct kiln_dvec3 low = dvec3_of(g->bounds_min), extent = dvec3_sub(dvec3_of(g->bounds_max), low);
    const double longest = fmax(extent.x, fmax(extent.y, extent.z)), most = (double)(KILN_LEAVES_ALONG - 2);
    if (!(size > 0.0) || isinf(size) || longest / size > most)
        return kiln_fail(error, KILN_BAD_INPUT,
                         "leaves of %g m do not fit a scene %g m long, of which %u along a side are possible: "
                         "--leaf-size %.3g would do",
                         size, longest, KILN_LEAVES_ALONG - 2, 1.01 * longest / most);
    const int status = g->memory.allocate(g->memory.context, &g->leaves, g->triangle_count, sizeof *g->leaves,
                                          "the leaves' records", error);
    if (status != KILN_OK)
        return status;
    g->leaf_size = size;
    g->leaf_origin = dvec3_sub(low, dvec3(BEFORE * size, BEFORE * size, BEFORE * size));
#pragma omp parallel for
    for (size_t t = 0; t < g->triangle_count; t++)
        lay_record(g, t);
    return KILN_OK;
}
