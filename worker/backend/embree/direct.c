/* The direct pass (worker/pass/direct.h): light from all sources at each point, by shadow rays. */
#include <math.h>
#include <string.h>

#include "shaders/shared/random.h"
#include "shaders/shared/sun_pilot.h"
#include "worker/backend/embree/frame.h"
#include "worker/backend/embree/shadow.h"
#include "worker/backend/embree/tile_runs.h"
#include "worker/base/memory.h"
#include "worker/light/area_light_sampler.h"
#include "worker/pass/direct.h"
#include "worker/light/light_groups.h"
#include "worker/pass/groups.h"
#include "worker/sampling/sequence.h"

enum { SEQUENCES = 32 };

/* Samples of one choice of light, scrambled for the current tile; generated as far as they are needed. */
struct sequence {
    uint32_t identity, made;
    bool used;
    uint32_t *points[KILN_DIMENSIONS];
};

/* Samples of an area light for one packet. */
struct target_lanes {
    struct kiln_area_light_samples samples;
    uint32_t random[KILN_DIMENSIONS][PACKET];                     /* fractions of 2^32 */
    float position[3][PACKET], normal[3][PACKET], offset[PACKET]; /* of the places: see frame_position */
};
_Static_assert((int)PACKET == (int)KILN_TARGET_LANES, "a packet is one call's samples");

/* A thread's working set. */
struct direct_work {
    struct tile_run_frame frame;
    struct shadow_packet shadows;
    struct kiln_area_light_sampler target;
    struct target_lanes lanes;
    struct kiln_light_choice *choices;
    uint32_t *sobol[KILN_DIMENSIONS]; /* table_size points each */
    uint32_t samples, table_size;     /* samples: of the present tile run */
    const struct kiln_batch *part;    /* borrowed */
    /* cache by identity, direct mapped; points of all tiles of a tile run have the same choices */
    struct sequence sequences[SEQUENCES];
    uint32_t *sequence_points; /* what they are made of */
    double *groups;            /* light of each group at the current point: shadow_packet.groups; NULL: not wanted */
    float *group_answers;      /* of the present tile run */
};

static void work_destroy(void **work)
{
    struct direct_work *w = *work;
    for (int d = 0; d < KILN_DIMENSIONS && w != NULL; d++)
        kiln_free(&w->sobol[d]);
    if (w != NULL) {
        kiln_free(&w->choices);
        kiln_free(&w->sequence_points);
        kiln_free(&w->groups);
    }
    kiln_free(work);
}

static const struct kiln_lights *direct_lights(const struct embree_backend *b)
{
    return b->params.direct_lights != NULL ? b->params.direct_lights : b->params.lights;
}

/* Whether directional lights have pilots (shaders/shared/sun_pilot.h). */
static bool has_pilots(const struct embree_backend *b)
{
    return direct_lights(b)->environment && direct_lights(b)->directional_count > 0;
}

static int work_create(void **work, const struct embree_backend *b, const void *parameters,
                       const struct kiln_batch *part, struct kiln_error *error)
{
    (void)parameters;
    struct direct_work *w = NULL;
    int status = kiln_allocate(&w, 1, sizeof *w, "the direct pass", error);
    *work = w;
    if (status != KILN_OK)
        return status;
    w->part = part;
    /* a single choice gets all samples, rounded up at most; with pilots a range of the sequence has room for more */
    const uint32_t times = has_pilots(b) ? KILN_SUN_TIMES : 1, first_sample = times * part->first_sample;
    w->table_size = times * part->samples + 1;
    KILN_TRY(kiln_allocate(&w->choices, KILN_CUT_MAX + direct_lights(b)->directional_count + 1, sizeof *w->choices,
                           "the light choices", error));
    for (uint32_t d = 0; d < KILN_DIMENSIONS; d++) {
        KILN_TRY(kiln_allocate(&w->sobol[d], w->table_size, sizeof(uint32_t), "the samples of a pass", error));
        for (uint32_t k = 0; k < w->table_size; k++)
            w->sobol[d][k] = kiln_sobol(first_sample + k, d);
    }
    KILN_TRY(kiln_allocate(&w->sequence_points, (size_t)SEQUENCES * KILN_DIMENSIONS * w->table_size, sizeof(uint32_t),
                           "the samples of a tile", error));
    if (b->base.given.groups != NULL)
        KILN_TRY(kiln_allocate(&w->groups, b->base.given.groups->lights->count, KILN_GROUP_FLOATS * sizeof *w->groups,
                               "the light of groups", error));
end:
    w->shadows.groups = w->groups;
    for (size_t i = 0; status == KILN_OK && i < SEQUENCES; i++)
        for (size_t d = 0; d < KILN_DIMENSIONS; d++)
            w->sequences[i].points[d] = w->sequence_points + (i * KILN_DIMENSIONS + d) * w->table_size;
    if (status != KILN_OK)
        work_destroy(work);
    return status;
}

/* Finds the groups of a packet's samples of the area light. */
static void find_groups(struct direct_work *w, const struct embree_backend *b, const struct kiln_light_choice *choice)
{
    const struct kiln_area_light_samples *t = &w->lanes.samples;
    const uint32_t light = (uint32_t)(w->target.light - direct_lights(b)->areas);
    for (uint32_t l = 0; l < PACKET && b->base.given.groups != NULL; l++)
        w->shadows.group[l] = kiln_light_group(b->base.given.groups->lights, direct_lights(b), choice, light,
                                               dvec3(t->place[0][l], t->place[1][l], t->place[2][l]),
                                               dvec3(t->to[0][l], t->to[1][l], t->to[2][l]), 1.0);
}

static uint32_t identity_of(const struct direct_work *w, const struct kiln_light_choice *choice)
{
    return kiln_direct_identity((uint32_t)choice->kind, choice->index, w->part->stream);
}

/* Returns the first `count` samples of the choice with this identity. */
static const struct sequence *find_sequence(struct direct_work *w, uint32_t identity, uint32_t count)
{
    struct sequence *q = &w->sequences[identity % SEQUENCES];
    if (!q->used || q->identity != identity) {
        q->used = true;
        q->identity = identity;
        q->made = 0;
    }
    if (q->made < count) {
        const uint32_t seed = kiln_hash2(w->frame.tile_key, identity);
        for (uint32_t d = 0; d < KILN_DIMENSIONS; d++) {
            const uint32_t scramble = kiln_hash2(seed, d);
            for (uint32_t k = q->made; k < count; k++)
                q->points[d][k] = kiln_owen_scramble(w->sobol[d][k], scramble);
        }
        q->made = count;
    }
    return q;
}

/* Where rays of a packet start. */
static void place_lanes(struct direct_work *w, const struct embree_backend *b, uint32_t j)
{
    struct target_lanes *t = &w->lanes;
    for (int l = 0; l < PACKET; l++) {
        struct kiln_vec3 p, n;
        t->offset[l] = frame_position(&w->frame, b, j, (float)kiln_unit_double(t->random[KILN_DIMENSION_S][l]),
                                      (float)kiln_unit_double(t->random[KILN_DIMENSION_T][l]), &p, &n);
        t->position[0][l] = p.x, t->position[1][l] = p.y, t->position[2][l] = p.z;
        t->normal[0][l] = n.x, t->normal[1][l] = n.y, t->normal[2][l] = n.z;
    }
}

/* Sets the positions where samples are weighted: on the surface, without offset. */
KILN_CLONES static void start_samples(struct target_lanes *restrict t)
{
    for (int l = 0; l < PACKET; l++) {
        /* kiln_unit_double */
        t->samples.u[l] = ((double)(int32_t)(t->random[KILN_DIMENSION_U][l] ^ 0x80000000u) + 2147483648.5) * 0x1p-32;
        t->samples.v[l] = ((double)(int32_t)(t->random[KILN_DIMENSION_V][l] ^ 0x80000000u) + 2147483648.5) * 0x1p-32;
    }
    for (int c = 0; c < 3; c++)
        for (int l = 0; l < PACKET; l++)
            t->samples.place[c][l] = (double)t->position[c][l] - (double)t->normal[c][l] * (double)t->offset[l];
}

/* Makes the rays from their starts to the positions on the light. */
KILN_CLONES static void fill_rays(const struct target_lanes *restrict t, struct shadow_packet *restrict s)
{
    double to[3][PACKET];
    for (int c = 0; c < 3; c++)
        for (int l = 0; l < PACKET; l++)
            to[c][l] = t->samples.to[c][l] - (double)t->normal[c][l] * (double)t->offset[l];
    for (int l = 0; l < PACKET; l++) {
        const double distance = sqrt(to[0][l] * to[0][l] + to[1][l] * to[1][l] + to[2][l] * to[2][l]);
        s->rays.org_x[l] = t->position[0][l], s->rays.org_y[l] = t->position[1][l],
        s->rays.org_z[l] = t->position[2][l];
        s->rays.dir_x[l] = (float)(to[0][l] / distance);
        s->rays.dir_y[l] = (float)(to[1][l] / distance);
        s->rays.dir_z[l] = (float)(to[2][l] / distance);
        s->rays.tnear[l] = 0.0f, s->rays.time[l] = 0.0f;
        s->rays.mask[l] = ~0u, s->rays.flags[l] = 0;
        s->rays.tfar[l] = shadow_limit(distance, t->samples.backoff[l]);
    }
}

/* Computes the light of lane l's ray if it is not blocked, and whether it must be traced. */
static void weigh_lane(struct direct_work *w, const struct embree_backend *b, uint32_t j, uint32_t l)
{
    const struct kiln_area_light *light = w->target.light;
    const struct kiln_area_light_samples *t = &w->lanes.samples;
    struct shadow_packet *s = &w->shadows;
    const struct kiln_vec3 n = vec3(w->lanes.normal[0][l], w->lanes.normal[1][l], w->lanes.normal[2][l]);
    const struct kiln_dvec3 to = dvec3_scale(dvec3(t->to[0][l], t->to[1][l], t->to[2][l]), 1.0 / t->distance[l]);
    const double cosine = dvec3_dot(dvec3_of(n), to);
    const double shading_cosine =
        w->frame.smooth ? fmax(0.0, dvec3_dot(dvec3_of(frame_shading(&w->frame, j, n)), to)) : cosine;
    const double incident = fmax(0.0, cosine) * (double)frame_taken_up(&w->frame, j, (float)shading_cosine);
    float textured[3];
    const float *radiance = light->radiance;
    s->valid[l] =
        s->index[l] < s->samples && frame_faces(&w->frame, j, cosine, shading_cosine) && t->weight[l] > 0.0 ? -1 : 0;
    if (light->textured && s->valid[l] != 0) {
        kiln_area_light_radiance(direct_lights(b), light, t->b1[l], t->b2[l], textured);
        radiance = textured;
    }
    for (int c = 0; c < 3; c++) {
        s->incident[l][c] = (double)radiance[c] * t->weight[l] * incident;
        s->irradiance[l][c] = (double)radiance[c] * t->weight[l] * shading_cosine;
    }
}

/* Traces a packet of the area light's samples at point j, from `first` on, whose random numbers are drawn. */
static void sample_packet(struct direct_work *w, const struct embree_backend *b, struct embree_context *context,
                          uint32_t j, const struct kiln_light_choice *choice, uint32_t first, uint64_t *rays)
{
    place_lanes(w, b, j);
    start_samples(&w->lanes);
    kiln_area_light_sampler_draw(&w->target, &w->lanes.samples);
    fill_rays(&w->lanes, &w->shadows);
    find_groups(w, b, choice);
    for (uint32_t l = 0; l < PACKET; l++) {
        w->shadows.index[l] = first + l;
        weigh_lane(w, b, j, l);
        *rays += w->shadows.valid[l] != 0;
    }
    shadow_trace(&w->shadows, b, context);
}

/* Traces all samples of the area light of the choice at point j. */
static void sample_target(struct direct_work *w, const struct embree_backend *b, struct embree_context *context,
                          uint32_t j, const struct kiln_light_choice *choice, struct shadow_sums *sums, uint64_t *rays)
{
    const uint32_t identity = identity_of(w, choice), samples = choice->samples;
    const struct sequence *q = find_sequence(w, identity, samples);
    uint32_t shift[KILN_DIMENSIONS];
    for (uint32_t d = 0; d < KILN_DIMENSIONS; d++)
        shift[d] = kiln_hash2(kiln_hash2(w->frame.key[j], identity), d);
    shadow_begin(&w->shadows, sums, samples);
    for (uint32_t first = 0; first < samples; first += PACKET) {
        const uint32_t last = samples - 1;
        for (uint32_t d = 0; d < KILN_DIMENSIONS; d++)
            for (uint32_t l = 0; l < PACKET; l++)
                w->lanes.random[d][l] = q->points[d][first + l < last ? first + l : last] ^ shift[d];
        sample_packet(w, b, context, j, choice, first, rays);
    }
}

/* All samples of one choice at point j. */
static void sample_choice(struct direct_work *w, const struct embree_backend *b, struct embree_context *context,
                          uint32_t j, const struct kiln_light_choice *choice, struct shadow_sums *sums, uint64_t *rays)
{
    struct tile_run_frame *f = &w->frame;
    const uint32_t identity = identity_of(w, choice);
    const struct kiln_dvec3 normal0 = dvec3((double)f->normal[0][j], (double)f->normal[1][j], (double)f->normal[2][j]);
    const uint32_t strategies = kiln_lights_strategies(direct_lights(b), choice, normal0);
    const struct sequence *sequence[2];
    uint32_t shift[2][KILN_DIMENSIONS];
    for (uint32_t i = 0; i < strategies; i++) {
        sequence[i] = find_sequence(w, identity + i, (choice->samples + strategies - 1) / strategies);
        for (uint32_t d = 0; d < KILN_DIMENSIONS; d++)
            shift[i][d] = kiln_hash2(kiln_hash2(f->key[j], identity + i), d);
    }
    shadow_begin(&w->shadows, sums, choice->samples);
    for (uint32_t i = 0; i < choice->samples; i++) {
        const uint32_t strategy = i % strategies;
        double random[KILN_DIMENSIONS];
        for (uint32_t d = 0; d < KILN_DIMENSIONS; d++)
            random[d] = kiln_unit_double(sequence[strategy]->points[d][i / strategies] ^ shift[strategy][d]);
        struct kiln_vec3 p, n;
        const float offset =
            frame_position(f, b, j, (float)random[KILN_DIMENSION_S], (float)random[KILN_DIMENSION_T], &p, &n);
        struct kiln_light_sample s;
        const struct kiln_dvec3 normal = dvec3_of(n), shading = dvec3_of(frame_shading(f, j, n)),
                                place = dvec3_sub(dvec3_of(p), dvec3_scale(normal, (double)offset));
        if (!kiln_lights_sample(direct_lights(b), choice, i, place, normal, shading, random[KILN_DIMENSION_CHOICE],
                                random[KILN_DIMENSION_U], random[KILN_DIMENSION_V], &s))
            continue;
        const double cosine = dvec3_dot(normal, s.direction);
        const double shading_cosine = f->smooth ? fmax(0.0, dvec3_dot(shading, s.direction)) : cosine;
        if (!frame_faces(f, j, cosine, shading_cosine))
            continue;
        if (b->base.given.groups != NULL)
            w->shadows.group[w->shadows.count] = kiln_light_group(b->base.given.groups->lights, direct_lights(b),
                                                                  choice, s.light, place, s.direction, s.distance);
        shadow_aim(&s, place, dvec3_of(p));
        shadow_add(&w->shadows, b, context, p, &s, i,
                   fmax(0.0, cosine) * (double)frame_taken_up(f, j, (float)shading_cosine), shading_cosine);
        (*rays)++;
    }
    shadow_end(&w->shadows, b, context);
}

/* Makes the pilot's rays first .. first+PACKET-1 of `count` at point j. `share`: light of each if it is not blocked, as
 * a share of the total. */
static void aim_pilot(struct direct_work *w, const struct embree_backend *b, uint32_t j, struct kiln_dvec3 towards,
                      uint32_t identity, uint32_t first, uint32_t count, double share[PACKET])
{
    const struct tile_run_frame *f = &w->frame;
    const struct sequence *q = find_sequence(w, identity, count);
    const uint32_t key = kiln_hash2(f->key[j], identity);
    const uint32_t shift_s = kiln_hash2(key, KILN_DIMENSION_S), shift_t = kiln_hash2(key, KILN_DIMENSION_T);
    struct RTCRay8 *rays = &w->shadows.rays;
    for (uint32_t l = 0; l < PACKET; l++) {
        const uint32_t k = first + l < count ? first + l : count - 1;
        struct kiln_vec3 p, n;
        (void)frame_position(&w->frame, b, j, (float)kiln_unit_double(q->points[KILN_DIMENSION_S][k] ^ shift_s),
                             (float)kiln_unit_double(q->points[KILN_DIMENSION_T][k] ^ shift_t), &p, &n);
        if (k >= count / 2) /* start the ray by the same distance farther off the surface */
            p = vec3_madd(p, vec3_sub(p, f->extent[j].centre), KILN_SUN_PILOT_BEYOND);
        const double shading = dvec3_dot(dvec3_of(frame_shading(f, j, n)), towards);
        share[l] = frame_faces(f, j, dvec3_dot(dvec3_of(n), towards), shading) ? fmax(0.0, shading) : 0.0;
        w->shadows.valid[l] = first + l < count && share[l] > 0.0 ? -1 : 0;
        rays->org_x[l] = p.x, rays->org_y[l] = p.y, rays->org_z[l] = p.z;
        rays->dir_x[l] = (float)towards.x, rays->dir_y[l] = (float)towards.y, rays->dir_z[l] = (float)towards.z;
        rays->tnear[l] = 0.0f, rays->tfar[l] = INFINITY, rays->time[l] = 0.0f;
        rays->mask[l] = ~0u, rays->flags[l] = 0;
    }
}

/* Whether the choice's directional light varies over and around point j, found by a pilot of `count` rays. */
static bool pilot_differs(struct direct_work *w, const struct embree_backend *b, struct embree_context *context,
                          uint32_t j, const struct kiln_light_choice *choice, uint32_t count, uint64_t *rays)
{
    const struct kiln_dvec3 towards = direct_lights(b)->directionals[choice->index].towards;
    double least = INFINITY, most = 0.0, share[PACKET], through[PACKET][3];
    for (uint32_t first = 0; first < count; first += PACKET) {
        aim_pilot(w, b, j, towards, identity_of(w, choice) + 1, first, count, share);
        for (uint32_t l = 0; l < PACKET; l++)
            *rays += w->shadows.valid[l] != 0;
        embree_through8(b, context, w->shadows.valid, &w->shadows.rays, through);
        for (uint32_t l = 0; l < PACKET && first + l < count; l++) {
            if (w->shadows.valid[l] != 0 && w->shadows.rays.tfar[l] < 0.0f)
                share[l] = 0.0;
            else if (w->shadows.valid[l] != 0 && embree_blends(b))
                share[l] *= kiln_luminance(through[l]);
            least = fmin(least, share[l]);
            most = fmax(most, share[l]);
        }
    }
    return least < (double)KILN_SUN_SAME * most;
}

/* Redistributes the samples among point j's choices, after pilots of its directional lights. */
static void use_pilots(struct direct_work *w, const struct embree_backend *b, struct embree_context *context,
                       uint32_t j, size_t count, uint64_t *rays)
{
    const uint32_t pilot = kiln_sun_pilot(w->samples);
    struct kiln_sun_sharing sharing = {.samples = w->samples, .rest = w->samples};
    for (size_t i = 0; i < count; i++) {
        struct kiln_light_choice *c = &w->choices[i];
        if (kiln_sun_asks(&sharing, c->kind == KILN_CHOICE_DIRECTIONAL, c->samples))
            c->samples = kiln_sun_samples(&sharing, c->samples, pilot_differs(w, b, context, j, c, pilot, rays));
    }
    for (size_t i = 0; sharing.any && i < count; i++)
        if (w->choices[i].kind != KILN_CHOICE_DIRECTIONAL)
            w->choices[i].samples = kiln_sun_other(w->choices[i].samples, sharing.others, sharing.rest);
}

static void direct_point(struct direct_work *w, const struct embree_backend *b, struct embree_context *context,
                         uint32_t j, struct kiln_point_result *result, uint64_t *rays)
{
    const struct tile_run_frame *f = &w->frame;
    const uint32_t samples = w->samples;
    const size_t count =
        kiln_lights_choices(direct_lights(b), dvec3_of(f->extent[j].centre), (double)f->extent[j].spread,
                            frame_one_normal(f, j), kiln_cut_limit(samples), w->choices);
    (void)kiln_lights_allot(w->choices, count, samples);
    if (has_pilots(b) && !f->partly_buried[j])
        use_pilots(w, b, context, j, count, rays);
    double incident[3] = {0}, irradiance[3] = {0}, variance = 0.0;
    if (w->groups != NULL)
        memset(w->groups, 0, b->base.given.groups->lights->count * KILN_GROUP_FLOATS * sizeof *w->groups);
    for (size_t i = 0; i < count; i++) {
        struct shadow_sums sums = {0};
        const struct kiln_light_choice *choice = &w->choices[i];
        if (kiln_area_light_sampler(direct_lights(b), choice, dvec3_of(f->extent[j].centre),
                                    (double)f->extent[j].spread, &w->target))
            sample_target(w, b, context, j, choice, &sums, rays);
        else
            sample_choice(w, b, context, j, choice, &sums, rays);
        const double scale = 1.0 / (double)w->choices[i].samples;
        for (int c = 0; c < 3; c++) {
            incident[c] += sums.incident[c] * scale;
            irradiance[c] += sums.irradiance[c] * scale;
        }
        variance += shadow_variance(&sums, w->choices[i].samples);
    }
    for (int c = 0; c < 3; c++) {
        result->incident[c] = (float)(samples * incident[c]);
        result->irradiance[c] = (float)(samples * irradiance[c]);
    }
    result->error = (float)(samples * sqrt(variance));
    result->present = f->present[j];
    result->count = samples;
    for (size_t i = 0; w->groups != NULL && i < b->base.given.groups->lights->count * KILN_GROUP_FLOATS; i++)
        embree_group_answers(w->group_answers, b, f->place[j])[i] = (float)(samples * w->groups[i]);
}

static void direct_tile_run(void *work, const struct embree_backend *b, struct embree_context *context, size_t tile_run,
                            void *results, uint64_t *rays)
{
    struct direct_work *w = work;
    struct kiln_point_result *points = results;
    w->samples = w->part->samples_each != NULL ? w->part->samples_each[tile_run - w->part->first] : w->part->samples;
    frame_build(&w->frame, b, tile_run, kiln_batch_points(w->part, tile_run), FRAME_EXTENT | FRAME_LIFT);
    for (int q = 0; q < SEQUENCES; q++)
        w->sequences[q].used = false;
    w->group_answers = embree_group_run(b, tile_run);
    for (uint32_t j = 0; j < w->frame.count; j++)
        direct_point(w, b, context, j, &points[w->frame.place[j]], rays);
}

int embree_direct(struct embree_backend *b, const void *parameters, const struct kiln_batch *part, void *results,
                  uint64_t *rays, struct kiln_error *error)
{
    static const struct tile_run_pass pass = {work_create, work_destroy, direct_tile_run,
                                              sizeof(struct kiln_point_result)};
    return embree_each_tile_run(b, &pass, parameters, part, results, rays, error);
}
