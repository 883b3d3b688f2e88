/* The probe pass (worker/pass/probes.h): rays over the whole sphere for what surfaces send, shadow rays for the
 * lights. */
#include <math.h>
#include <omp.h>
#include <string.h>

#include "shaders/shared/streams.h"
#include "worker/backend/embree/chain.h"
#include "worker/backend/embree/light_samples.h"
#include "worker/backend/embree/lookup.h"
#include "worker/backend/embree/spheres.h"
#include "worker/base/memory.h"
#include "worker/pass/probes.h"
#include "worker/sampling/harmonics.h"
#include "worker/sampling/sequence.h"

struct probe_sums {
    double radiance[KILN_HARMONICS][3], axes[6][3], distance;
    uint32_t back;
};

/* Adds radiance x solid angle `value` that arrives from direction d. */
static void add(struct probe_sums *sums, struct kiln_dvec3 d, const double value[3])
{
    double weights[KILN_SPHERE_WEIGHTS];
    spheres_weights(d, weights);
    for (int i = 0; i < KILN_HARMONICS; i++)
        for (int c = 0; c < 3; c++)
            sums->radiance[i][c] += weights[i] * value[c];
    for (int i = 0; i < 6; i++)
        for (int c = 0; c < 3; c++)
            sums->axes[i][c] += weights[KILN_HARMONICS + i] * value[c];
}

/* Radiance by the chain of ray k, of diffuse surfaces, lamps and sky. */
static void follow(struct walk *walk, uint32_t key, uint32_t k, const struct RTCRayHit *ray, float rgb[3])
{
    struct chain_found found;
    chain_follow(walk, kiln_gather_chance(key), k, ray, true, &found);
    for (int c = 0; c < 3; c++)
        rgb[c] = found.radiosity[c] * KILN_INVERSE_PI + found.light[c];
}

static void gather_sphere(const struct embree_backend *b, struct walk *walk, struct kiln_vec3 p, uint32_t key,
                          uint32_t samples, struct probe_sums *sums)
{
    const struct kiln_geometry *g = b->params.geometry;
    const struct kiln_vec3 diagonal = vec3_sub(g->bounds_max, g->bounds_min);
    const double far = (double)vec3_length(diagonal), weight = 4.0 * KILN_PI / samples;
    const bool sky = light_sky_is_constant(b->params.lights);
    for (uint32_t k = 0; k < samples; k++) {
        const double u = kiln_unit_double(kiln_owen_scramble(kiln_sobol(k, 0), kiln_hash2(key, 0))),
                     v = kiln_unit_double(kiln_owen_scramble(kiln_sobol(k, 1), kiln_hash2(key, 1)));
        const struct kiln_dvec3 d = kiln_sphere_direction(u, v);
        struct RTCRayHit r = {.ray = {.org_x = p.x,
                                      .org_y = p.y,
                                      .org_z = p.z,
                                      .dir_x = (float)d.x,
                                      .dir_y = (float)d.y,
                                      .dir_z = (float)d.z,
                                      .tfar = INFINITY,
                                      .mask = ~0u},
                              .hit = {.geomID = RTC_INVALID_GEOMETRY_ID, .instID = {RTC_INVALID_GEOMETRY_ID}}};
        float rgb[3] = {0}, tint[3] = {1.0f, 1.0f, 1.0f};
        embree_nearest1(b, walk->context, &r, kiln_hash2(key + 1u, k), tint);
        if (r.hit.geomID == RTC_INVALID_GEOMETRY_ID) {
            sums->distance += far / samples;
            if (sky)
                kiln_environment_radiance(b->params.lights, d, rgb);
        } else if (chain_begins(b, &r)) {
            sums->distance += fmin((double)r.ray.tfar, far) / samples;
            follow(walk, key, k, &r, rgb);
        } else {
            sums->distance += fmin((double)r.ray.tfar, far) / samples;
            const uint32_t triangle = embree_triangle(b, r.hit.geomID, r.hit.primID);
            const bool back = r.hit.Ng_x * r.ray.dir_x + r.hit.Ng_y * r.ray.dir_y + r.hit.Ng_z * r.ray.dir_z > 0.0f;
            if (back && (g->records[triangle].material & KILN_RECORD_DOUBLE_SIDED) == 0)
                sums->back++;
            else
                kiln_radiosity_unpack(embree_radiosity(b, triangle, r.hit.u, r.hit.v, back), rgb);
            for (int c = 0; c < 3; c++)
                rgb[c] *= KILN_INVERSE_PI;
        }
        double value[3];
        for (int c = 0; c < 3; c++)
            value[c] = (double)(rgb[c] * tint[c]) * weight;
        add(sums, d, value);
    }
}

/* Light straight from the lights; a constant sky is met by the rays above. */
static uint64_t gather_lights(const struct embree_backend *b, struct embree_context *context,
                              struct kiln_light_choice *choices, struct kiln_vec3 position, uint32_t key,
                              uint32_t samples, struct probe_sums *sums)
{
    const struct kiln_lights *lights = b->params.lights;
    const struct kiln_dvec3 p = dvec3_of(position), any = dvec3(0.0, 0.0, 0.0);
    const size_t count = light_choose(lights, p, 0.0, any, KILN_CUT_MAX, samples, choices);
    uint64_t rays = 0;
    for (size_t i = 0; i < count; i++) {
        const uint32_t identity = light_identity(key, &choices[i]);
        for (uint32_t k = 0; k < choices[i].samples; k++) {
            struct kiln_light_sample s;
            if (!light_draw(lights, &choices[i], identity, k, p, &s))
                continue;
            rays++;
            if (light_arrives(b, context, position, &choices[i], &s))
                add(sums, s.direction, s.value);
        }
    }
    return rays;
}

int embree_probes(struct embree_backend *b, const void *parameters, const struct kiln_batch *part, void *results,
                  uint64_t *rays, struct kiln_error *error)
{
    const struct kiln_probe_parameters *settings = parameters;
    const uint32_t seed = kiln_hash2((uint32_t)b->params.seed, (uint32_t)(b->params.seed >> 32) ^ KILN_PROBE_SEED);
    const size_t room = light_choices_room(b->params.lights);
    struct kiln_light_choice *choices = NULL;
    const int status = kiln_allocate(&choices, room * b->threads, sizeof *choices, "the probes' light choices", error);
    if (status != KILN_OK)
        return status;
    uint64_t traced = 0;
#pragma omp parallel num_threads((int)b->threads) reduction(+ : traced)
    {
        const unsigned saved = embree_enter();
        struct embree_context context;
        embree_context(b, &context);
        struct walk walk = {.b = b,
                            .context = &context,
                            .choices = choices + room * (size_t)omp_get_thread_num(),
                            .leaves = settings->leaves};
#pragma omp for schedule(dynamic, 4)
        for (size_t i = 0; i < part->count; i++) {
            const uint64_t index = (uint64_t)part->first + i;
            const uint32_t key = kiln_hash2(kiln_hash2(seed, (uint32_t)index), (uint32_t)(index >> 32));
            struct probe_sums sums = {0};
            gather_sphere(b, &walk, part->positions[i], key, part->samples, &sums);
            traced +=
                part->samples + gather_lights(b, &context, walk.choices, part->positions[i], key, part->samples, &sums);
            struct kiln_probe_result *r = (struct kiln_probe_result *)results + i;
            for (int h = 0; h < KILN_HARMONICS; h++)
                for (int c = 0; c < 3; c++)
                    r->radiance[h][c] = (float)sums.radiance[h][c];
            for (int a = 0; a < 6; a++)
                for (int c = 0; c < 3; c++)
                    r->irradiance_axes[a][c] = (float)sums.axes[a][c];
            r->mean_distance = (float)sums.distance;
            r->back_share = (float)sums.back / (float)part->samples;
        }
        embree_leave(saved);
    }
    *rays += traced;
    kiln_free(&choices);
    return KILN_OK;
}
