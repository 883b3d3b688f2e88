/* Shared parts of passes that sample the hemisphere over points: a thread's rays, what they find, how they go on in
 * chains, and the sums of a point. The gather, guided, directions, caustic, weighed and reference passes begin with it.
 */
#ifndef KILN_WORKER_BACKEND_EMBREE_HEMISPHERE_H
#define KILN_WORKER_BACKEND_EMBREE_HEMISPHERE_H

#include "shaders/shared/color.h"
#include "worker/backend/embree/chain.h"
#include "worker/backend/embree/lookup.h"
#include "worker/pass/point.h"

/* The first member of a pass's own working set, which is zeros before hemisphere_create. */
struct hemisphere {
    struct tile_run_rays *rays;
    uint32_t stream;
    struct rays_found found;
    /* where rays go on in chains: what a chain has found; and of each lane what has escaped and was blocked */
    struct walk walk;
    struct chain_found chain;
    float lost[2][RAY_LANES];
    struct kiln_light_choice *choices; /* of passes that ask for the light of lamps; else NULL */
    /* sums of a point */
    double incident[RAY_LANES][3], irradiance[RAY_LANES][3], quarter[RAY_QUARTERS][RAY_LANES];
    double escaped[RAY_LANES], blocked[RAY_LANES], glass[RAY_LANES][3], gloss[RAY_LANES][3];
};

/* Rays half-way between both normals, with random numbers of `stream`. Release it, after a failure too. */
int hemisphere_create(struct hemisphere *h, const struct embree_backend *b, const struct kiln_batch *part,
                      uint32_t stream, struct kiln_error *error);
/* The walk asks for the light of lamps from now on. */
int hemisphere_ask_lights(struct hemisphere *h, struct kiln_error *error);
void hemisphere_release(struct hemisphere *h);

/* Sets the sums of the frame's points to 0. */
void hemisphere_clear(struct hemisphere *h);
/* Writes the sums, and their standard errors, to the tile run's results: `bytes` apart, each begins with a struct
 * kiln_point_result. */
void hemisphere_store(const struct hemisphere *h, void *results, size_t bytes);

/* Counts the lanes that have escaped, and those that were blocked, where no ray goes on. */
void hemisphere_count_lost(struct hemisphere *h);
/* The same lane by lane, with what the chains of others have lost (`lost`). */
void hemisphere_count_lost_in_order(struct hemisphere *h, uint32_t lanes);

/* Follows the chain of the ray of lane l; `radiosity` as of chain_follow. */
void hemisphere_follow(struct hemisphere *h, uint32_t step, uint32_t l, bool radiosity);
/* Counts what the chain of lane l has lost: a share of what the tint of its first ray leaves. */
void hemisphere_count_chain(struct hemisphere *h, uint32_t l, bool tints);

/* kiln_facet_weight of a lane's direction, times its weight. */
static inline float hemisphere_weight(const struct tile_run_rays *r, uint32_t l)
{
    if (!r->frame.smooth)
        return r->weight[l];
    const float cosine =
        r->facet[0][l] * r->direction[0][l] + r->facet[1][l] * r->direction[1][l] + r->facet[2][l] * r->direction[2][l];
    const float tilt = r->facet[0][l] * r->axis[0][l] + r->facet[1][l] * r->axis[1][l] + r->facet[2][l] * r->axis[2][l];
    return kiln_facet_weight(cosine, tilt, r->cosine[l]) * r->weight[l];
}

/* The cosine of lane l's ray about the shading normal, of a smooth mesh. */
static inline float hemisphere_shading_cosine(const struct tile_run_rays *rays, uint32_t l)
{
    const struct kiln_vec3 shading =
        frame_shading(&rays->frame, rays->point[l], vec3(rays->facet[0][l], rays->facet[1][l], rays->facet[2][l]));
    return shading.x * rays->direction[0][l] + shading.y * rays->direction[1][l] + shading.z * rays->direction[2][l];
}

/* Whether the ray of lane l goes on in a chain: not one that begins below its facet and may be inside of something. */
static inline bool hemisphere_is_chain(const struct embree_backend *b, const struct tile_run_rays *r, uint32_t l)
{
    return hemisphere_weight(r, l) > 0.0f && chain_begins_at(b, r, l);
}

/* Adds radiosity that the ray of lane l has found, to this quarter of the samples. Returns its weight as irradiance;
 * `luminance`: of what counts as that. */
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
