/* Rows (rows.h) that stay in memory, so that the gather pass can be run again and again without a tracer: of the points
 * of one rank, in one step. What of a ray's light is no matter of light stands beside its row: its weights, where the
 * mesh has smooth normals, and of each point what has escaped and was blocked.
 *
 * kiln_resident_gather is the gather from kept transport: it gives the irradiance of a tile run's points under several
 * lights at once, which share one read of the rows. Of each the bits are those of the gather pass (gather.h). */
#ifndef KILN_WORKER_PASS_RESIDENT_ROWS_H
#define KILN_WORKER_PASS_RESIDENT_ROWS_H

#include "worker/pass/point.h"
#include "worker/pass/rows.h"
#include "worker/scene/scene.h"
#include "worker/scene/surface.h"

/* Part of a point's answer that hangs on no light. */
struct kiln_resident_point {
    float escaped, blocked, present; /* as in struct kiln_point_result */
    uint32_t count;                  /* samples; 0: the step asks no ray of it */
};

struct kiln_resident_rows {
    uint64_t first, count; /* the first point in the global order, and their number */
    uint32_t samples;      /* of a row */
    uint32_t *rows;        /* as in the file: of each point its check and its words; 0: it has no row yet */
    /* two floats a ray of the smooth tile runs: as incident light and as irradiance; `weights_at`: where those of a
     * tile run begin, in floats; KILN_RESIDENT_FLAT: all are 1 */
    float *weights;
    uint64_t *weights_at;
    struct kiln_resident_point *points;
    uint8_t *ready; /* of each tile run: its rows, weights and points are there */
};
#define KILN_RESIDENT_FLAT UINT64_MAX

/* Room for the rows of the surface's own points, none of them ready. KILN_SYSTEM. Release in any case. */
int kiln_resident_rows_create(struct kiln_resident_rows *resident, const struct kiln_surface *surface,
                              const struct kiln_scene *scene, uint32_t samples, struct kiln_error *error);
void kiln_resident_rows_release(struct kiln_resident_rows *resident);
uint64_t kiln_resident_rows_bytes(const struct kiln_resident_rows *resident, size_t tile_runs);

/* Where the row of the point stands, which is `place` points after the first. */
static inline uint32_t *kiln_resident_row(const struct kiln_resident_rows *r, uint64_t place)
{
    return r->rows + place * (1 + (uint64_t)r->samples);
}

/* Takes what hangs on no light out of the answers of a tile run that was traced or looked up. */
void kiln_resident_take(const struct kiln_resident_rows *resident, const struct kiln_surface *surface, size_t tile_run,
                        const struct kiln_point_result *results);

/* Lights that are gathered together stand side by side in lanes; so many hold `lights` of them: 1, 2, 4 or 8. */
enum { KILN_RESIDENT_LANES = 8 };
static inline uint32_t kiln_resident_lanes(size_t lights)
{
    return lights <= 1 ? 1 : lights <= 2 ? 2 : lights <= 4 ? 4 : 8;
}
static inline uint64_t kiln_resident_floats(uint64_t points, uint32_t lanes) { return 4 * (points + 1) * lanes; }

/* Unpacks the radiosity of all points under one light to its lane: of each point red, green, blue and luminance,
 * `lanes` floats each; and one point more, which is black. */
void kiln_resident_light(const uint64_t *radiosity, uint64_t points, uint32_t lane, uint32_t lanes, float *light);

/* The answers of a ready tile run, the surface's `number`th, under up to `lanes` lights, of which `light` has the
 * radiosity of all `points` of the scene. `results`: of light i, from results[i] on, one for each point of the tile
 * run; NULL: there is no such light. */
void kiln_resident_gather(const struct kiln_resident_rows *resident, const struct kiln_tile_run *tile_run,
                          size_t number, const float *light, uint64_t points, uint32_t lanes,
                          struct kiln_point_result *const results[]);

#endif
