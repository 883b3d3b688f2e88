#include "worker/backend/embree/hemisphere.h"

#include <math.h>
#include <string.h>

#include "worker/backend/embree/light_samples.h"
#include "worker/base/memory.h"

int hemisphere_create(struct hemisphere *h, const struct embree_backend *b, const struct kiln_batch *part,
                      uint32_t stream, struct kiln_error *error)
{
    h->stream = stream;
    h->walk = (struct walk){.b = b};
    return rays_create(&h->rays, RAYS_HALF_WAY, INFINITY, part, error);
}

int hemisphere_ask_lights(struct hemisphere *h, struct kiln_error *error)
{
    const int status = kiln_allocate(&h->choices, light_choices_room(h->walk.b->params.lights), sizeof *h->choices,
                                     "the light choices", error);
    h->walk.choices = h->choices;
    return status;
}

void hemisphere_release(struct hemisphere *h)
{
    rays_destroy(&h->rays);
    kiln_free(&h->choices);
}

/* ---- sums ---- */

void hemisphere_clear(struct hemisphere *h)
{
    const size_t count = h->rays->frame.count;
    memset(h->incident, 0, count * sizeof *h->incident);
    memset(h->irradiance, 0, count * sizeof *h->irradiance);
    memset(h->glass, 0, count * sizeof *h->glass);
    memset(h->gloss, 0, count * sizeof *h->gloss);
    memset(h->escaped, 0, count * sizeof *h->escaped);
    memset(h->blocked, 0, count * sizeof *h->blocked);
    for (int i = 0; i < RAY_QUARTERS; i++)
        memset(h->quarter[i], 0, count * sizeof *h->quarter[i]);
}

/* Standard error of the sum of point j. */
static float error_of(const struct hemisphere *h, uint32_t j)
{
    double sum[RAY_QUARTERS];
    for (int i = 0; i < RAY_QUARTERS; i++)
        sum[i] = h->quarter[i][j];
    return rays_quarters_error(sum, h->rays->samples);
}

void hemisphere_store(const struct hemisphere *h, void *results, size_t bytes)
{
    for (uint32_t j = 0; j < h->rays->frame.count; j++) {
        struct kiln_point_result *r =
            (struct kiln_point_result *)(void *)((char *)results + h->rays->frame.place[j] * bytes);
        for (int c = 0; c < 3; c++) {
            r->incident[c] = (float)h->incident[j][c];
            r->irradiance[c] =
                h->rays->frame.smooth || h->rays->frame.glossy[j] ? (float)h->irradiance[j][c] : r->incident[c];
            r->glass[c] = (float)h->glass[j][c];
            r->gloss[c] = (float)h->gloss[j][c];
        }
        r->error = error_of(h, j);
        r->present = h->rays->frame.present[j];
        r->escaped = (float)h->escaped[j];
        r->blocked = (float)h->blocked[j];
        r->count = h->rays->samples;
    }
}

/* ---- rays that are lost, and those that go on ---- */

void hemisphere_count_lost(struct hemisphere *h)
{
    const struct tile_run_rays *rays = h->rays;
    const struct rays_found *found = &h->found;
    for (uint32_t i = 0; i < found->escaped; i++)
        h->escaped[rays->point[found->escaped_lane[i]]] += (double)hemisphere_weight(rays, found->escaped_lane[i]);
    for (uint32_t i = 0; i < found->blocked; i++)
        h->blocked[rays->point[found->blocked_lane[i]]] += (double)hemisphere_weight(rays, found->blocked_lane[i]);
}

void hemisphere_count_lost_in_order(struct hemisphere *h, uint32_t lanes)
{
    const struct rays_found *found = &h->found;
    for (uint32_t i = 0; i < found->escaped; i++)
        h->lost[0][found->escaped_lane[i]] = 1.0f;
    for (uint32_t i = 0; i < found->blocked; i++)
        h->lost[1][found->blocked_lane[i]] = 1.0f;
    for (uint32_t l = 0; l < lanes; l++) {
        const double facet = (double)hemisphere_weight(h->rays, l);
        h->escaped[h->rays->point[l]] += facet * (double)h->lost[0][l];
        h->blocked[h->rays->point[l]] += facet * (double)h->lost[1][l];
    }
}

void hemisphere_follow(struct hemisphere *h, uint32_t step, uint32_t l, bool radiosity)
{
    const struct tile_run_rays *r = h->rays;
    const struct RTCRayHit ray = rays_lane(r, l);
    chain_follow(&h->walk, r->chance[l], rays_sample(r, step, l), &ray, radiosity, &h->chain);
}

void hemisphere_count_chain(struct hemisphere *h, uint32_t l, bool tints)
{
    const struct tile_run_rays *r = h->rays;
    const float facet = hemisphere_weight(r, l), white[3] = {1.0f, 1.0f, 1.0f}, *tint = tints ? r->tint[l] : white;
    const float mean = (tint[0] + tint[1] + tint[2]) * (1.0f / 3.0f);
    h->lost[0][l] = mean * h->chain.escaped;
    h->lost[1][l] = mean * h->chain.blocked;
    for (int c = 0; c < 3; c++) /* of each colour all is somewhere */
        h->gloss[r->point[l]][c] +=
            (double)(facet * (tint[c] * h->chain.gloss[c] + (tint[c] - mean) * (h->chain.escaped + h->chain.blocked)));
}
