/* Shared parts of passes that sample the hemisphere over points: a thread's rays, their hits, their continuation in
 * chains, and the sums of a point. The gather, guided, directions, caustic, weighed and reference passes begin with it.
 */
#ifndef KILN_WORKER_BACKEND_EMBREE_HEMISPHERE_H
#define KILN_WORKER_BACKEND_EMBREE_HEMISPHERE_H

#include "shaders/shared/color.h"
#include "worker/backend/embree/chain.h"
#include "worker/backend/embree/lookup.h"
#include "worker/pass/point.h"

/* First member of a pass's own working set; all zeros before hemisphere_create. */
struct hemisphere {
    struct tile_run_rays *rays;
    uint32_t stream;
    struct rays_found found;
    /* where rays continue in chains: findings of a chain; escaped and blocked share of each lane */
    struct walk walk;
    struct chain_found chain;
    float lost[2][RAY_LANES];
    struct kiln_light_choice *choices; /* light choices of passes that sample lamps; else NULL */
    /* sums of a point */
    double incident[RAY_LANES][3], irradiance[RAY_LANES][3], quarter[RAY_QUARTERS][RAY_LANES];
    double escaped[RAY_LANES], blocked[RAY_LANES], glass[RAY_LANES][3], gloss[RAY_LANES][3];
};

/* Creates rays distributed about the axis half-way between both normals, with random numbers of `stream`. Release it,
 * after a failure too. */
int hemisphere_create(struct hemisphere *h, const struct embree_backend *b, const struct kiln_batch *part,
                      uint32_t stream, struct kiln_error *error);
/* Makes the walk sample the light of lamps from now on. */
int hemisphere_ask_lights(struct hemisphere *h, struct kiln_error *error);
void hemisphere_release(struct hemisphere *h);

/* Sets the sums of the frame's points to 0. */
void hemisphere_clear(struct hemisphere *h);
/* Writes the sums, and their standard errors, to the tile run's results: `bytes` apart, each begins with a struct
 * kiln_point_result. */
void hemisphere_store(const struct hemisphere *h, void *results, size_t bytes);

/* Adds escaped and blocked lanes to the sums, for steps without chains. */
void hemisphere_count_lost(struct hemisphere *h);
/* Adds escaped and blocked light lane by lane, including the losses of the lanes' chains (`lost`). */
void hemisphere_count_lost_in_order(struct hemisphere *h, uint32_t lanes);

/* Follows the chain of the ray of lane l; `radiosity` as of chain_follow. */
void hemisphere_follow(struct hemisphere *h, uint32_t step, uint32_t l, bool radiosity);
/* Sets `lost` of lane l from its chain: the escaped and blocked shares, times the transmittance of its first ray. */
void hemisphere_count_chain(struct hemisphere *h, uint32_t l, bool tints);

/* Returns kiln_facet_weight of a lane's direction, times the lane's weight. */
static inline float hemisphere_weight(const struct tile_run_rays *r, uint32_t l)
{
    if (!r->frame.smooth)
        return r->weight[l];
    const float cosine =
        r->facet[0][l] * r->direction[0][l] + r->facet[1][l] * r->direction[1][l] + r->facet[2][l] * r->direction[2][l];
    const float tilt = r->facet[0][l] * r->axis[0][l] + r->facet[1][l] * r->axis[1][l] + r->facet[2][l] * r->axis[2][l];
    return kiln_facet_weight(cosine, tilt, r->cosine[l]) * r->weight[l];
}

/* Returns the cosine of lane l's ray with the shading normal, on a smooth mesh. */
static inline float hemisphere_shading_cosine(const struct tile_run_rays *rays, uint32_t l)
{
    const struct kiln_vec3 shading =
        frame_shading(&rays->frame, rays->point[l], vec3(rays->facet[0][l], rays->facet[1][l], rays->facet[2][l]));
    return shading.x * rays->direction[0][l] + shading.y * rays->direction[1][l] + shading.z * rays->direction[2][l];
}

/* Whether the ray of lane l continues in a chain. Rays that begin below their facet do not, as they may be inside a
 * body. */
static inline bool hemisphere_is_chain(const struct embree_backend *b, const struct tile_run_rays *r, uint32_t l)
{
    return hemisphere_weight(r, l) > 0.0f && chain_begins_at(b, r, l);
}

/* Adds radiosity found by the ray of lane l to its point's sums and to this quarter of the samples. Returns the ray's
 * weight in irradiance; `luminance`: of the added irradiance. */
static inline float hemisphere_add(struct hemisphere *h, uint32_t l, uint32_t quarter, float rgb[3], bool tints,
                                   float *luminance)
{
    const struct tile_run_rays *rays = h->rays;
    const uint32_t j = rays->point[l];
    const float facet = hemisphere_weight(rays, l);
    float weight = facet, cosine = rays->cosine[l];
    for (int c = 0; c < 3 && tints; c++) {
        rgb[c] *= rays->tint[l][c];
        h->glass[j][c] += (double)(facet * (1.0f - rays->tint[l][c]));
    }
    const bool glossy = rays->frame.glossy[j];
    if (rays->frame.smooth) {
        cosine = hemisphere_shading_cosine(rays, l);
        weight = kiln_shading_weight(cosine, rays->cosine[l]) * rays->weight[l];
    }
    for (int c = 0; c < 3 && (rays->frame.smooth || glossy); c++)
        h->irradiance[j][c] += (double)(weight * rgb[c]);
    const float incident = glossy ? facet * frame_taken_up(&rays->frame, j, cosine) : facet;
    for (int c = 0; c < 3; c++)
        h->incident[j][c] += (double)(incident * rgb[c]);
    *luminance = weight * kiln_luminance_in_float(rgb);
    h->quarter[quarter][j] += (double)*luminance;
    return weight;
}

#endif
