/* The radiance pass (worker/pass/radiance.h): rays over the elements of probes' maps. */
#include <math.h>
#include <omp.h>
#include <string.h>

#include "shaders/shared/streams.h"
#include "shaders/shared/warp.h"
#include "worker/backend/embree/chain.h"
#include "worker/backend/embree/lookup.h"
#include "worker/pass/radiance.h"
#include "worker/sampling/sequence.h"

/* Radiosity that ray k finds, after tints. Returns whether it hit the back of a single-sided surface that lets no light
 * through. */
static bool find_radiosity(const struct embree_backend *b, struct embree_context *context, struct kiln_vec3 p,
                           struct kiln_vec3 d, uint32_t key, uint32_t k, float rgb[3])
{
    struct RTCRayHit r = {.ray = {.org_x = p.x,
                                  .org_y = p.y,
                                  .org_z = p.z,
                                  .dir_x = d.x,
                                  .dir_y = d.y,
                                  .dir_z = d.z,
                                  .tfar = INFINITY,
                                  .mask = ~0u},
                          .hit = {.geomID = RTC_INVALID_GEOMETRY_ID, .instID = {RTC_INVALID_GEOMETRY_ID}}};
    float tint[3] = {1.0f, 1.0f, 1.0f};
    rgb[0] = rgb[1] = rgb[2] = 0.0f;
    embree_nearest1(b, context, &r, kiln_radiance_chance(key, k), tint);
    if (r.hit.geomID == RTC_INVALID_GEOMETRY_ID)
        return false;
    const uint32_t triangle = embree_triangle(b, r.hit.geomID, r.hit.primID);
    const bool back = r.hit.Ng_x * d.x + r.hit.Ng_y * d.y + r.hit.Ng_z * d.z > 0.0f;
    if (chain_begins(b, &r)) {
        struct walk walk = {.b = b, .context = context};
        struct chain_found found;
        chain_follow(&walk, kiln_gather_chance(key), k, &r, true, &found);
        memcpy(rgb, found.radiosity, sizeof found.radiosity);
    } else if (back && (b->params.geometry->records[triangle].material & KILN_RECORD_DOUBLE_SIDED) == 0) {
        return kiln_geometry_is_solid(b->params.geometry, triangle);
    } else {
        kiln_radiosity_unpack(embree_radiosity(b, triangle, r.hit.u, r.hit.v, back), rgb);
    }
    for (int c = 0; c < 3; c++)
        rgb[c] *= tint[c];
    return false;
}

static void gather_element(const struct embree_backend *b, struct embree_context *context,
                           const struct kiln_radiance_parameters *map, uint32_t element, struct kiln_vec3 position,
                           uint32_t key, uint32_t samples, struct kiln_radiance_result *result)
{
    double sum[3] = {0.0, 0.0, 0.0}, back = 0.0, weights = 0.0;
    for (uint32_t k = 0; k < samples; k++) {
        const struct kiln_vec3 at = kiln_probe_point(
            map->basis, map->side, element, kiln_unit_float(kiln_owen_scramble(kiln_sobol(k, 0), kiln_hash2(key, 0))),
            kiln_unit_float(kiln_owen_scramble(kiln_sobol(k, 1), kiln_hash2(key, 1))));
        const float scale = 1.0f / vec3_length(at);
        const double weight = (double)(scale * scale * scale);
        float rgb[3];
        if (find_radiosity(b, context, position, vec3_scale(at, scale), key, k, rgb))
            back += weight;
        for (int c = 0; c < 3; c++)
            sum[c] += weight * (double)rgb[c];
        weights += weight;
    }
    for (int c = 0; c < 3; c++)
        result->radiance[c] = (float)(sum[c] / weights) * KILN_INVERSE_PI;
    result->back = (float)(back / weights);
}

int embree_radiance(struct embree_backend *b, const void *parameters, const struct kiln_batch *part, void *results,
                    uint64_t *rays, struct kiln_error *error)
{
    (void)error;
    const struct kiln_radiance_parameters *map = parameters;
    const uint32_t seed = kiln_hash2((uint32_t)b->params.seed, (uint32_t)(b->params.seed >> 32) ^ KILN_RADIANCE_SEED);
    const uint32_t elements = kiln_probe_elements(map->basis, map->side);
    struct kiln_radiance_result *r = results;
#pragma omp parallel num_threads((int)b->threads)
    {
        const unsigned saved = embree_enter();
        struct embree_context context;
        embree_context(b, &context);
#pragma omp for schedule(dynamic, 64)
        for (size_t i = 0; i < part->count; i++) {
            const uint64_t item = (uint64_t)part->first + i;
            const uint64_t draws = map->period > 0 ? item % map->period : item;
            const uint32_t key = kiln_radiance_key(seed, part->stream, (uint32_t)draws, (uint32_t)(draws >> 32));
            gather_element(b, &context, map, (uint32_t)(item % elements), part->positions[i], key, part->samples,
                           &r[i]);
        }
        embree_leave(saved);
    }
    *rays += (uint64_t)part->count * part->samples;
    return KILN_OK;
}
