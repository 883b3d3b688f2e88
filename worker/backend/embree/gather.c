/* The gather pass (worker/pass/gather.h): cosine-distributed rays of a tile run's points and the radiosity that they
 * find. */
#include <math.h>
#include <string.h>

#include "shaders/shared/color.h"
#include "shaders/shared/warp.h"
#include "worker/backend/embree/lookup.h"
#include "worker/backend/embree/rays.h"
#include "worker/backend/embree/tile_runs.h"
#include "worker/base/memory.h"
#include "worker/pass/gather.h"

/* A thread's working set. */
struct gather_work {
    struct tile_run_rays *rays;
    uint32_t stream;
    struct rays_found found;
    /* sums of a point */
    double incident[RAY_LANES][3], irradiance[RAY_LANES][3], quarter[RAY_QUARTERS][RAY_LANES];
    double escaped[RAY_LANES], blocked[RAY_LANES], glass[RAY_LANES][3];
};

static void work_destroy(void **work)
{
    struct gather_work *w = *work;
    if (w != NULL)
        rays_destroy(&w->rays);
    kiln_free(work);
}

static int work_create(void **work, const struct embree_backend *b, const void *parameters,
                       const struct kiln_batch *part, struct kiln_error *error)
{
    (void)b, (void)parameters;
    struct gather_work *w = NULL;
    int status = kiln_allocate(&w, 1, sizeof *w, "the gather pass", error);
    *work = w;
    if (status != KILN_OK)
        return status;
    w->stream = part->stream;
    status = rays_create(&w->rays, RAYS_HALF_WAY, INFINITY, part, error);
    if (status != KILN_OK)
        work_destroy(work);
    return status;
}

/* kiln_facet_weight of a lane's direction. */
static inline float facet_weight(const struct tile_run_rays *r, uint32_t l)
{
    if (!r->frame.smooth)
        return 1.0f;
    const float cosine =
        r->facet[0][l] * r->direction[0][l] + r->facet[1][l] * r->direction[1][l] + r->facet[2][l] * r->direction[2][l];
    const float tilt = r->facet[0][l] * r->axis[0][l] + r->facet[1][l] * r->axis[1][l] + r->facet[2][l] * r->axis[2][l];
    return kiln_facet_weight(cosine, tilt, r->cosine[l]);
}

static void count_lost(struct gather_work *w)
{
    const struct tile_run_rays *rays = w->rays;
    const struct rays_found *found = &w->found;
    for (uint32_t i = 0; i < found->escaped; i++)
        w->escaped[rays->point[found->escaped_lane[i]]] += (double)facet_weight(rays, found->escaped_lane[i]);
    for (uint32_t i = 0; i < found->blocked; i++)
        w->blocked[rays->point[found->blocked_lane[i]]] += (double)facet_weight(rays, found->blocked_lane[i]);
}

/* Adds the radiosity lane by lane: for each point in the order of its samples, whatever the number of lanes. */
KILN_CLONES static void collect(const struct embree_backend *b, struct gather_work *w, uint32_t step)
{
    const struct tile_run_rays *rays = w->rays;
    const struct rays_found *found = &w->found;
    const uint32_t first = step * rays->copies, count = found->count;
    const bool tints = embree_tints(b);
    for (uint32_t i = 0; i < count; i++) {
        const uint32_t l = found->lane[i], j = rays->point[l];
        const float facet = facet_weight(rays, l);
        float rgb[3] = {0.0f, 0.0f, 0.0f}, weight = facet;
        if (found->point[i] != KILN_NO_POINT && facet > 0.0f)
            kiln_radiosity_unpack(b->radiosity[found->point[i]], rgb);
        for (int c = 0; c < 3 && tints; c++) {
            rgb[c] *= rays->tint[l][c];
            w->glass[j][c] += (double)(facet * (1.0f - rays->tint[l][c]));
        }
        if (rays->frame.smooth) {
            const struct kiln_vec3 shading =
                frame_shading(&rays->frame, j, vec3(rays->facet[0][l], rays->facet[1][l], rays->facet[2][l]));
            const float cosine = shading.x * rays->direction[0][l] + shading.y * rays->direction[1][l] +
                                 shading.z * rays->direction[2][l];
            weight = kiln_shading_weight(cosine, rays->cosine[l]);
            for (int c = 0; c < 3; c++)
                w->irradiance[j][c] += (double)(weight * rgb[c]);
        }
        for (int c = 0; c < 3; c++)
            w->incident[j][c] += (double)(facet * rgb[c]);
        w->quarter[rays->quarter_of[first + rays->copy[l]]][j] += (double)(weight * kiln_luminance_in_float(rgb));
    }
}

/* Standard error of the sum, by the spread of the means of its four quarters: more than the error of the whole net,
 * whose parts balance one another. */
static float quarters_error(const struct gather_work *w, uint32_t j)
{
    if (w->rays->samples < RAY_QUARTERS)
        return 0.0f;
    double mean = 0.0, square = 0.0, value[RAY_QUARTERS];
    for (int i = 0; i < RAY_QUARTERS; i++) {
        value[i] = w->quarter[i][j] * RAY_QUARTERS / w->rays->samples;
        mean += value[i] / RAY_QUARTERS;
    }
    for (int i = 0; i < RAY_QUARTERS; i++)
        square += (value[i] - mean) * (value[i] - mean);
    return (float)(w->rays->samples * sqrt(square / (RAY_QUARTERS * (RAY_QUARTERS - 1))));
}

static void store(const struct gather_work *w, struct kiln_point_result *results)
{
    for (uint32_t j = 0; j < w->rays->frame.count; j++) {
        struct kiln_point_result *r = &results[w->rays->frame.place[j]];
        for (int c = 0; c < 3; c++) {
            r->incident[c] = (float)w->incident[j][c];
            r->irradiance[c] = w->rays->frame.smooth ? (float)w->irradiance[j][c] : r->incident[c];
            r->glass[c] = (float)w->glass[j][c];
        }
        r->error = quarters_error(w, j);
        r->present = w->rays->frame.present[j];
        r->escaped = (float)w->escaped[j];
        r->blocked = (float)w->blocked[j];
        r->count = w->rays->samples;
    }
}

static void clear_sums(struct gather_work *w)
{
    memset(w->incident, 0, sizeof w->incident);
    memset(w->irradiance, 0, sizeof w->irradiance);
    memset(w->quarter, 0, sizeof w->quarter);
    memset(w->glass, 0, sizeof w->glass);
    memset(w->escaped, 0, sizeof w->escaped);
    memset(w->blocked, 0, sizeof w->blocked);
}

static void gather_tile_run(void *work, const struct embree_backend *b, struct embree_context *context, size_t tile_run,
                            void *results, uint64_t *rays)
{
    struct gather_work *w = work;
    const uint32_t steps = rays_begin(w->rays, b, tile_run, w->stream, 0);
    if (steps == 0)
        return;
    clear_sums(w);
    for (uint32_t step = 0; step < steps; step++) {
        const uint32_t lanes = rays_make(w->rays, b, step);
        rays_trace(w->rays, b, context, lanes);
        embree_find(b, w->rays, lanes, &w->found);
        count_lost(w);
        collect(b, w, step);
        *rays += lanes;
    }
    store(w, results);
}

int embree_gather(struct embree_backend *b, const void *parameters, const struct kiln_batch *part, void *results,
                  uint64_t *rays, struct kiln_error *error)
{
    static const struct tile_run_pass pass = {work_create, work_destroy, gather_tile_run,
                                              sizeof(struct kiln_point_result)};
    return embree_each_tile_run(b, &pass, parameters, part, results, rays, error);
}
