#include "coordinator/layout/uv_check.h"

#include <stdio.h>

#include "coordinator/layout/raster.h"
#include "worker/base/memory.h"

static const double OUTSIDE_TOLERANCE = 1e-4, COLLAPSED_DENSITY = 1e-4, COLLAPSED_FRACTION = 5e-3,
                    OVERLAP_FRACTION = 0.03;
static const double COLLAPSED_WARNING = 1e-3, OVERLAP_WARNING = 5e-3;
static const double LEAST_USE = 1.0 / 256.0;
enum { SIDE = 2048, SIDE_LARGE = 4096, LARGE_MESH = 20000 };

static void corners(const struct kiln_vec2 *uv, const uint32_t *c, double scale, double corner[3][2])
{
    for (int k = 0; k < 3; k++) {
        corner[k][0] = scale * (double)uv[c[k]].x;
        corner[k][1] = scale * (double)uv[c[k]].y;
    }
}

static double uv_triangle_area(const struct kiln_vec2 *uv, const uint32_t *c)
{
    double p[3][2];
    corners(uv, c, 1.0, p);
    return 0.5 * fabs((p[1][0] - p[0][0]) * (p[2][1] - p[0][1]) - (p[1][1] - p[0][1]) * (p[2][0] - p[0][0]));
}

static double triangle_area(const struct kiln_vec3 *positions, const uint32_t *c)
{
    const struct kiln_dvec3 origin = dvec3_of(positions[c[0]]);
    return 0.5 * dvec3_length(dvec3_cross(dvec3_sub(dvec3_of(positions[c[1]]), origin),
                                          dvec3_sub(dvec3_of(positions[c[2]]), origin)));
}

static bool inside(float value)
{
    return (double)value >= -OUTSIDE_TOLERANCE && (double)value <= 1.0 + OUTSIDE_TOLERANCE;
}

/* Whether all coordinates in use are finite and within 0..1. */
static bool range_holds(struct kiln_uv_verdict *verdict, const struct kiln_vec2 *uv, const uint32_t *triangles,
                        size_t count)
{
    for (size_t i = 0; i < 3 * count; i++) {
        const struct kiln_vec2 t = uv[triangles[i]];
        if (inside(t.x) && inside(t.y))
            continue;
        snprintf(verdict->reason, sizeof verdict->reason, "leaves 0..1: vertex %u is at (%g, %g)", triangles[i],
                 (double)t.x, (double)t.y);
        return false;
    }
    return true;
}

static bool area_holds(struct kiln_uv_verdict *verdict, const struct kiln_vec3 *positions, const struct kiln_vec2 *uv,
                       const uint32_t *triangles, size_t count)
{
    double area = 0.0, collapsed = 0.0;
    for (size_t i = 0; i < count; i++) {
        area += triangle_area(positions, triangles + 3 * i);
        verdict->uv_area += uv_triangle_area(uv, triangles + 3 * i);
    }
    for (size_t i = 0; i < count; i++) {
        const double own = triangle_area(positions, triangles + 3 * i);
        if (uv_triangle_area(uv, triangles + 3 * i) * area < COLLAPSED_DENSITY * own * verdict->uv_area ||
            !(verdict->uv_area > 0.0))
            collapsed += own;
    }
    if (collapsed > COLLAPSED_FRACTION * area) {
        snprintf(verdict->reason, sizeof verdict->reason, "is collapsed for %.3g %% of the surface",
                 100.0 * collapsed / area);
        return false;
    }
    if (collapsed > COLLAPSED_WARNING * area)
        snprintf(verdict->warning, sizeof verdict->warning, "is collapsed for %.3g %% of the surface",
                 100.0 * collapsed / area);
    if (verdict->uv_area < LEAST_USE && area > 0.0) {
        snprintf(verdict->reason, sizeof verdict->reason, "uses only %.3g %% of the unit square",
                 100.0 * verdict->uv_area);
        return false;
    }
    return true;
}

static bool overlap_holds(struct kiln_uv_verdict *verdict, struct kiln_bitmap *bitmap, const struct kiln_vec2 *uv,
                          const uint32_t *triangles, size_t count)
{
    uint64_t covered = 0, again = 0;
    for (size_t i = 0; i < count; i++) {
        double corner[3][2];
        corners(uv, triangles + 3 * i, bitmap->width, corner);
        kiln_raster_samples(bitmap, (const double(*)[2])corner, &covered, &again);
    }
    /* A sample covered n times was counted n times in `covered` and n - 1 times in `again`. */
    verdict->overlap = covered > again ? fmin((double)again / (double)(covered - again), 1.0) : 0.0;
    if (verdict->overlap > OVERLAP_WARNING && verdict->overlap <= OVERLAP_FRACTION)
        snprintf(verdict->warning, sizeof verdict->warning, "overlaps itself in %.3g %% of what it covers",
                 100.0 * verdict->overlap);
    if (verdict->overlap <= OVERLAP_FRACTION)
        return true;
    snprintf(verdict->reason, sizeof verdict->reason, "overlaps itself in %.3g %% of what it covers",
             100.0 * verdict->overlap);
    return false;
}

int kiln_uv_check(struct kiln_uv_verdict *verdict, const struct kiln_vec3 *positions, const struct kiln_vec2 *uv,
                  const uint32_t *triangles, size_t triangle_count, struct kiln_error *error)
{
    struct kiln_bitmap bitmap = {0};
    *verdict = (struct kiln_uv_verdict){0};
    if (!range_holds(verdict, uv, triangles, triangle_count) ||
        !area_holds(verdict, positions, uv, triangles, triangle_count))
        return KILN_OK;
    const uint32_t side = triangle_count < LARGE_MESH ? SIDE : SIDE_LARGE;
    const int status = kiln_bitmap_reset(&bitmap, side, side, error);
    if (status == KILN_OK)
        verdict->valid = overlap_holds(verdict, &bitmap, uv, triangles, triangle_count);
    kiln_free(&bitmap.words);
    return status;
}
