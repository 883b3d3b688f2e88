/* The probe pass (worker/pass/probes.h): rays over the whole sphere for the light of surfaces, shadow rays for the
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
#include "worker/light/light_groups.h"
#include "worker/pass/groups.h"
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

/* ---- light of groups (worker/pass/groups.h); `groups`: sums of each; NULL: not wanted ---- */

/* Adds each group's radiosity at a point that a ray has hit. `weight`: factor of the radiance. */
static void add_groups_of_point(const struct embree_backend *b, struct probe_sums *groups, struct kiln_dvec3 d,
                                uint64_t point, double weight)
{
    const struct kiln_groups *g = b->base.given.groups;
    for (uint32_t i = 0; point != KILN_NO_POINT && i < g->lights->count; i++) {
        const uint64_t packed = g->radiosity[point * g->lights->count + i];
        float rgb[3];
        double value[3];
        if (packed == 0)
            continue;
        kiln_radiosity_unpack(packed, rgb);
        for (int c = 0; c < 3; c++)
            value[c] = (double)(rgb[c] * KILN_INVERSE_PI) * weight;
        add(&groups[i], d, value);
    }
}

/* Adds the constant sky in a direction. */
static void add_group_of_sky(const struct embree_backend *b, struct probe_sums *groups, struct kiln_dvec3 d,
                             const double value[3])
{
    const struct kiln_light_groups *g = b->base.given.groups->lights;
    add(&groups[g->of_environment + (g->sky_divisions > 0 ? kiln_sky_patch(d, g->sky_divisions) : 0)], d, value);
}

static void store_groups(const struct embree_backend *b, const struct probe_sums *groups, float *to)
{
    for (uint32_t i = 0; i < b->base.given.groups->lights->count; i++) {
        for (int h = 0; h < KILN_HARMONICS; h++)
            for (int c = 0; c < 3; c++)
                *to++ = (float)groups[i].radiance[h][c];
        for (int a = 0; a < 6; a++)
            for (int c = 0; c < 3; c++)
                *to++ = (float)groups[i].axes[a][c];
    }
}

/* Allocates the answers of a part, and the sums of each thread. */
static int make_groups(struct embree_backend *b, const struct kiln_batch *part, struct probe_sums **sums,
                       struct kiln_error *error)
{
    struct kiln_groups *g = b->base.given.groups;
    static const char what[] = "the light of groups at probes";
    *sums = NULL;
    if (g == NULL)
        return KILN_OK;
    g->first = part->first;
    int status = kiln_allocate(sums, (size_t)g->lights->count * b->threads, sizeof **sums, what, error);
    if (status == KILN_OK)
        status = kiln_grow(&g->answers, &g->room, part->count * g->lights->count * KILN_GROUP_PROBE_FLOATS,
                           sizeof *g->answers, what, error);
    return status;
}

/* Radiance found by the chain of ray k: of diffuse surfaces, lamps and sky. */
static void follow(struct walk *walk, uint32_t key, uint32_t k, const struct RTCRayHit *ray, float rgb[3])
{
    struct chain_found found;
    chain_follow(walk, kiln_gather_chance(key), k, ray, true, &found);
    for (int c = 0; c < 3; c++)
        rgb[c] = found.radiosity[c] * KILN_INVERSE_PI + found.light[c];
}

static void gather_sphere(const struct embree_backend *b, struct walk *walk, struct kiln_vec3 p, uint32_t key,
                          uint32_t samples, struct probe_sums *sums, struct probe_sums *groups)
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
        uint64_t point = KILN_NO_POINT;
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
            if (back && kiln_geometry_is_solid(g, triangle))
                sums->back++;
            if (!back || (g->records[triangle].material & KILN_RECORD_DOUBLE_SIDED) != 0)
                point = embree_point(b, triangle, r.hit.u, r.hit.v, back).at;
            if (point != KILN_NO_POINT)
                kiln_radiosity_unpack(b->radiosity[point], rgb);
            for (int c = 0; c < 3; c++)
                rgb[c] *= KILN_INVERSE_PI;
        }
        double value[3];
        for (int c = 0; c < 3; c++)
            value[c] = (double)(rgb[c] * tint[c]) * weight;
        add(sums, d, value);
        if (groups != NULL && r.hit.geomID != RTC_INVALID_GEOMETRY_ID)
            add_groups_of_point(b, groups, d, point, weight);
        else if (groups != NULL && sky)
            add_group_of_sky(b, groups, d, value);
    }
}

/* Adds the light of lamps by shadow rays; the rays over the sphere find a constant sky. */
static uint64_t gather_lights(const struct embree_backend *b, struct embree_context *context,
                              struct kiln_light_choice *choices, struct kiln_vec3 position, uint32_t key,
                              uint32_t samples, struct probe_sums *sums, struct probe_sums *groups)
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
            if (!light_arrives(b, context, position, &choices[i], &s))
                continue;
            add(sums, s.direction, s.value);
            if (groups != NULL)
                add(&groups[kiln_light_group(b->base.given.groups->lights, lights, &choices[i],
                                             choices[i].kind == KILN_CHOICE_LIGHT_NODE ? s.light : KILN_NONE, p,
                                             s.direction, s.distance)],
                    s.direction, s.value);
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
    struct probe_sums *all_groups = NULL;
    int status = kiln_allocate(&choices, room * b->threads, sizeof *choices, "the probes' light choices", error);
    if (status == KILN_OK)
        status = make_groups(b, part, &all_groups, error);
    if (status != KILN_OK) {
        kiln_free(&choices);
        return status;
    }
    const size_t group_count = all_groups != NULL ? b->base.given.groups->lights->count : 0;
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
        struct probe_sums *groups = all_groups != NULL ? all_groups + group_count * (size_t)omp_get_thread_num() : NULL;
#pragma omp for schedule(dynamic, 4)
        for (size_t i = 0; i < part->count; i++) {
            const uint64_t index = (uint64_t)part->first + i;
            const uint32_t key = kiln_hash2(kiln_hash2(seed, (uint32_t)index), (uint32_t)(index >> 32));
            struct probe_sums sums = {0};
            if (groups != NULL)
                memset(groups, 0, group_count * sizeof *groups);
            gather_sphere(b, &walk, part->positions[i], key, part->samples, &sums, groups);
            traced += part->samples +
                      gather_lights(b, &context, walk.choices, part->positions[i], key, part->samples, &sums, groups);
            if (groups != NULL)
                store_groups(b, groups, b->base.given.groups->answers + i * group_count * KILN_GROUP_PROBE_FLOATS);
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
    kiln_free(&all_groups);
    return KILN_OK;
}
