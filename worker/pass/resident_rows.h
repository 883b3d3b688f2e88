/* Rows (rows.h) that stay in memory, so that the gather pass can be repeated without tracing: rows of the points of one
 * rank, in one step. Beside the rows stand all other values independent of light: the rays' weights, if the mesh has
 * smooth normals, and each point's escaped and blocked shares.
 *
 * kiln_resident_gather is the gather from kept transport: it computes the irradiance of a tile run's points under
 * several lights at once, with one read of the rows. The bits for each light are those of the gather pass (gather.h).
 */
#ifndef KILN_WORKER_PASS_RESIDENT_ROWS_H
#define KILN_WORKER_PASS_RESIDENT_ROWS_H

#include "worker/pass/point.h"
#include "worker/pass/rows.h"
#include "worker/scene/scene.h"
#include "worker/scene/surface.h"

/* Part of a point's result that does not depend on the lights. */
struct kiln_resident_point {
    float escaped, blocked, present; /* as in struct kiln_point_result */
    uint32_t count;                  /* samples; 0: the step traces no ray for the point */
};

struct kiln_resident_rows {
    uint64_t first, count; /* the first point in the global order, and their number */
    uint32_t samples;      /* of a row */
    uint32_t *rows;        /* as in the file: check and words of each point; check 0: no row yet */
    /* weights of rays, for tile runs with smooth normals: two floats a ray, for incident light and for irradiance.
     * `weights_at`: index of a tile run's first float; KILN_RESIDENT_FLAT: all its weights are 1 */
    float *weights;
    uint64_t *weights_at;
    struct kiln_resident_point *points;
    uint8_t *ready; /* by tile run: its rows, weights and points are complete */
};
#define KILN_RESIDENT_FLAT UINT64_MAX

/* Allocates room for the rows of the surface's own points; none is ready. KILN_SYSTEM. Release even after an error. */
int kiln_resident_rows_create(struct kiln_resident_rows *resident, const struct kiln_surface *surface,
                              const struct kiln_scene *scene, uint32_t samples, struct kiln_error *error);
void kiln_resident_rows_release(struct kiln_resident_rows *resident);
uint64_t kiln_resident_rows_bytes(const struct kiln_resident_rows *resident, size_t tile_runs);

/* Returns the row of the point that is `place` points after the first. */
static inline uint32_t *kiln_resident_row(const struct kiln_resident_rows *r, uint64_t place)
{
    return r->rows + place * (1 + (uint64_t)r->samples);
}

/* Stores the light-independent values from the results of a tile run that was traced or looked up. */
void kiln_resident_take(const struct kiln_resident_rows *resident, const struct kiln_surface *surface, size_t tile_run,
                        const struct kiln_point_result *results);

/* Lights that are gathered together are interleaved in SIMD lanes. Returns the number of lanes for `lights` lights: 1,
 * 2, 4 or 8. */
enum { KILN_RESIDENT_LANES = 8 };
static inline uint32_t kiln_resident_lanes(size_t lights)
{
    return lights <= 1 ? 1 : lights <= 2 ? 2 : lights <= 4 ? 4 : 8;
}
static inline uint64_t kiln_resident_floats(uint64_t points, uint32_t lanes) { return 4 * (points + 1) * lanes; }

/* Unpacks the radiosity of all points under one light into a lane: for each point red, green, blue and luminance,
 * `lanes` floats each; then one extra point, which is black. */
void kiln_resident_light(const uint64_t *radiosity, uint64_t points, uint32_t lane, uint32_t lanes, float *light);

/* Gathers for a ready tile run, number `number` of the surface, under up to `lanes` lights. `light`: the radiosity of
 * all `points` of the scene (kiln_resident_light). `results`: for light i the array results[i], one entry for each
 * point of the tile run; NULL: no such light. */
void kiln_resident_gather(const struct kiln_resident_rows *resident, const struct kiln_tile_run *tile_run,
                          size_t number, const float *light, uint64_t points, uint32_t lanes,
                          struct kiln_point_result *const results[]);

#endif
