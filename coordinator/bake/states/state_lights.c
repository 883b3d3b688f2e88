#include "coordinator/bake/states/state_lights.h"

#include <math.h>
#include <string.h>
#include <xxhash.h>

#include "coordinator/field/packed_error.h"
#include "coordinator/integrate/patches/emission.h"
#include "coordinator/mpi/agree.h"
#include "worker/backend/emission.h"
#include "worker/backend/extended.h"
#include "worker/base/arena.h"
#include "worker/base/color.h"
#include "worker/base/memory.h"
#include "worker/pass/direct.h"

/* Number of samples that direct light given as a mean claims to have. It is a power of two, so that a mean is exact; it
 * is too small for a pilot step; and each part of a bake in parts still has quarters of it. */
enum { GIVEN_SAMPLES = 16, KEPT_MOST = 64, PARTS_MOST = 2 * KILN_STATE_TERMS, STEPS_MOST = KILN_PARTS };

/* The direct light of some elements. */
struct kept {
    uint64_t key, used;
    bool exact; /* exact: answers of all steps of the lights as they are; else means */
    struct kiln_emission_result emission;
    uint32_t steps;
    uint32_t samples[STEPS_MOST];
    struct kiln_direct_answer *answers[STEPS_MOST]; /* of the own points */
};

struct part {
    const struct kept *kept;
    float factor[3];
};

struct mix {
    const struct kiln_state_lights *lights;
    struct kiln_integrate_settings settings;
    struct kiln_emission_result emission;
    size_t count;
    bool same;
    struct part parts[PARTS_MOST];
    struct kiln_held_term held[PARTS_MOST]; /* the same, for a device */
};

struct kiln_state_lights {
    struct kiln_bake *bake;
    struct kiln_states *states;
    const struct kiln_state_scene *base;
    struct kiln_state_scene only; /* what is traced alone */
    size_t elements, emitting;    /* number of elements; of these, those that emit in the base scene */
    uint32_t *part_of;            /* part of each element that emits in the base scene; KILN_NONE: it emits nothing */
    uint32_t *own_part;           /* scratch: of each element, in a state */
    float (*own_factor)[3];
    bool *own_changed;
    struct kept **kept;
    size_t kept_count, kept_room;
    uint64_t clock, begun, traced; /* `begun`: value of the clock at the beginning of the present states */
    uint16_t *white;               /* an albedo of 1 for the own points */
    struct kept *filling;
    struct mix mixes[KILN_STATES_MOST];
    struct kiln_arena arena;
};

/* ---- scenes ---- */

int kiln_state_scene_create(struct kiln_state_scene *copy, const struct kiln_scene *scene, struct kiln_error *error)
{
    *copy = (struct kiln_state_scene){.environment = *scene->environment};
    int status = kiln_allocate(&copy->lights, scene->light_count, sizeof *copy->lights, "the lights", error);
    if (status == KILN_OK)
        status = kiln_allocate(&copy->materials, scene->material_count, sizeof *copy->materials, "materials", error);
    if (status != KILN_OK)
        return status;
    if (scene->light_count > 0)
        memcpy(copy->lights, scene->lights, scene->light_count * sizeof *copy->lights);
    memcpy(copy->materials, scene->materials, scene->material_count * sizeof *copy->materials);
    return KILN_OK;
}

void kiln_state_scene_release(struct kiln_state_scene *copy)
{
    kiln_free(&copy->lights);
    kiln_free(&copy->materials);
}

void kiln_state_scene_copy(struct kiln_state_scene *to, const struct kiln_state_scene *from,
                           const struct kiln_scene *scene)
{
    if (scene->light_count > 0)
        memcpy(to->lights, from->lights, scene->light_count * sizeof *to->lights);
    memcpy(to->materials, from->materials, scene->material_count * sizeof *to->materials);
    to->environment = from->environment;
}

int kiln_state_scene_use(struct kiln_prepared *p, const struct kiln_state_scene *copy, struct kiln_error *error)
{
    struct kiln_lights *lights = NULL;
    p->scene->lights = copy->lights;
    p->scene->materials = copy->materials;
    p->scene->environment = &copy->environment;
    const int status = kiln_agree(p->communicator, kiln_lights_create(&lights, p->scene, p->geometry, error), error);
    if (status == KILN_OK) { /* every user of the lights keeps a pointer to them */
        const struct kiln_lights before = *p->lights;
        *p->lights = *lights;
        *lights = before;
    }
    kiln_lights_destroy(&lights);
    return status == KILN_OK ? kiln_agree(p->communicator, kiln_backend_change_light(p->backend, error), error)
                             : status;
}

/* ---- elements ---- */

static size_t light_count(const struct kiln_state_lights *l) { return l->bake->prepared->scene->light_count; }

static float *value_of(const struct kiln_state_lights *l, const struct kiln_state_scene *s, size_t i)
{
    const size_t lights = light_count(l);
    struct kiln_state_scene *scene = (struct kiln_state_scene *)(uintptr_t)s;
    return i < lights                                         ? scene->lights[i].intensity
           : i + 1 < l->elements                              ? scene->materials[i - lights].emission
           : scene->environment.kind != KILN_ENVIRONMENT_NONE ? scene->environment.radiance
                                                              : NULL;
}

static bool emits(const struct kiln_state_lights *l, const struct kiln_state_scene *s, size_t i)
{
    const float *value = value_of(l, s, i);
    return value != NULL && (value[0] > 0.0f || value[1] > 0.0f || value[2] > 0.0f);
}

/* Whether two scenes have the element in the same place and form, whatever its intensity. */
static bool same_form(const struct kiln_state_lights *l, const struct kiln_state_scene *a,
                      const struct kiln_state_scene *b, size_t i)
{
    if (i >= light_count(l) && i + 1 < l->elements)
        return true;
    if (i + 1 == l->elements)
        return a->environment.kind == b->environment.kind &&
               memcmp(&a->environment.rotation, &b->environment.rotation, sizeof(float)) == 0;
    struct kiln_light x = a->lights[i];
    memcpy(x.intensity, b->lights[i].intensity, sizeof x.intensity);
    return memcmp(&x, &b->lights[i], sizeof x) == 0;
}

/* Finds the factor for the element's light in the base scene. Returns false if no factor gives the state's light. */
static bool factor_of(const struct kiln_state_lights *l, const struct kiln_state_scene *scene, size_t i,
                      float factor[3])
{
    const float *from = value_of(l, l->base, i), *to = value_of(l, scene, i);
    if (to == NULL || !emits(l, scene, i)) {
        factor[0] = factor[1] = factor[2] = 0.0f;
        return true;
    }
    if (from == NULL || !same_form(l, l->base, scene, i))
        return false;
    float most = 0.0f;
    for (int c = 0; c < 3; c++) {
        if (from[c] > 0.0f)
            most = fmaxf(most, factor[c] = to[c] / from[c]);
        else if (to[c] > 0.0f)
            return false;
    }
    for (int c = 0; c < 3; c++)
        factor[c] = from[c] > 0.0f ? factor[c] : most;
    return true;
}

/* ---- what is kept ---- */

static void drop(struct kept **kept)
{
    for (uint32_t i = 0; i < STEPS_MOST; i++)
        kiln_free(&(*kept)->answers[i]);
    kiln_free(kept);
}

/* Implements kiln_state_direct.see: stores the answers of a step. */
static void see(void *context, const struct kiln_step *step, size_t first, size_t count,
                const struct kiln_point_result *results)
{
    struct kiln_state_lights *l = context;
    const struct kiln_surface *s = l->bake->prepared->surface;
    struct kept *k = l->filling;
    const uint32_t place = l->bake->light_settings.parts > 1         ? step->part
                           : step->samples_field != NULL && k->exact ? 1
                                                                     : 0;
    k->steps = k->steps > place + 1 ? k->steps : place + 1;
    k->samples[place] = step->samples;
    struct kiln_direct_answer *to = k->answers[place] + (s->tile_runs[first].first.at - s->first.at);
    for (size_t f = first; f < first + count; f++)
        for (uint32_t i = 0; i < s->tile_runs[f].count; i++, to++, results++) {
            *to = (struct kiln_direct_answer){
                .error = results->error, .present = results->present, .count = results->count};
            memcpy(to->irradiance, results->irradiance, sizeof to->irradiance);
            memcpy(to->incident, results->incident, sizeof to->incident);
        }
}

/* Turns sums into means, for each part of a bake in parts. */
static void make_means(const struct kiln_state_lights *l, struct kept *k)
{
    for (uint32_t s = 0; s < k->steps; s++)
        for (uint64_t i = 0; i < l->bake->prepared->surface->count; i++) {
            struct kiln_direct_answer *a = &k->answers[s][i];
            for (int c = 0; c < 3; c++) {
                a->irradiance[c] = kiln_mean(a->irradiance[c], a->count);
                a->incident[c] = kiln_mean(a->incident[c], a->count);
            }
            a->error = kiln_mean(a->error, a->count);
            a->count = a->count > 0;
        }
}

/* Implements kiln_state_direct.end for a bake in one part: takes the combined result of pilot and second step from the
 * rank's data. With an albedo of 1, radiosity equals incident light. */
static void end(void *context, const struct kiln_rank_data *own)
{
    struct kiln_state_lights *l = context;
    struct kept *k = l->filling;
    k->steps = 1;
    for (uint64_t i = 0; i < own->surface.count; i++) {
        struct kiln_direct_answer *a = &k->answers[0][i];
        memcpy(a->irradiance, own->direct + 3 * i, sizeof a->irradiance);
        memcpy(a->incident, own->sum + 3 * i, sizeof a->incident);
        a->error = own->error != NULL ? kiln_error_unpack(own->error[i]) : kiln_mean(a->error, a->count);
    }
}

/* Settings of direct light alone. */
static struct kiln_integrate_settings direct_alone(const struct kiln_state_lights *l)
{
    struct kiln_integrate_settings settings = l->bake->light_settings;
    settings.bounces = 0;
    settings.occlusion = NULL;
    settings.directional = KILN_DIRECTIONAL_NONE;
    settings.probes = false;
    return settings;
}

/* Collective. Traces the direct light of the present lights of the prepared scene. */
static int trace(struct kiln_state_lights *l, struct kept *k, struct kiln_error *error)
{
    const struct kiln_prepared *p = l->bake->prepared;
    const bool in_parts = l->bake->light_settings.parts > 1, together = !k->exact && !in_parts;
    const uint32_t steps = in_parts ? KILN_PARTS : k->exact ? 2 : 1;
    const struct kiln_integrate_settings settings = direct_alone(l);
    int status = KILN_OK;
    for (uint32_t i = 0; i < steps && status == KILN_OK; i++)
        status = kiln_allocate(&k->answers[i], (size_t)p->surface->count, sizeof *k->answers[i],
                               "direct light that is kept", error);
    status = kiln_agree(p->communicator, status, error);
    if (status == KILN_OK)
        status = kiln_trace_emission(p->communicator, p->backend, &k->emission, error);
    const struct kiln_state state = {.settings = &settings,
                                     .emission = &k->emission,
                                     .albedo = l->white,
                                     .direct = {.see = see, .end = together ? end : NULL, .context = l}};
    l->filling = k;
    if (status == KILN_OK)
        status = kiln_states_solve(l->states, &state, 1, error);
    if (status == KILN_OK && !k->exact && in_parts)
        make_means(l, k);
    l->traced++;
    return status;
}

static struct kept *find(struct kiln_state_lights *l, uint64_t key)
{
    for (size_t i = 0; i < l->kept_count; i++)
        if (l->kept[i]->key == key) {
            l->kept[i]->used = l->clock;
            return l->kept[i];
        }
    return NULL;
}

/* Makes room for one more entry. If there are many, the least recently used one is dropped, unless a present state
 * needs it. */
static int make_room(struct kiln_state_lights *l, struct kiln_error *error)
{
    size_t oldest = 0;
    for (size_t i = 1; i < l->kept_count; i++)
        oldest = l->kept[i]->used < l->kept[oldest]->used ? i : oldest;
    if (l->kept_count >= KEPT_MOST && l->kept[oldest]->used < l->begun) {
        drop(&l->kept[oldest]);
        l->kept[oldest] = l->kept[--l->kept_count];
    }
    return kiln_grow(&l->kept, &l->kept_room, l->kept_count + 1, sizeof(struct kept *), "direct light that is kept",
                     error);
}

/* Collective. Returns the kept direct light of `scene`; traces it first if it is new. */
static int keep(struct kiln_state_lights *l, const struct kiln_state_scene *scene, uint64_t key, bool exact,
                const struct kept **kept, struct kiln_error *error)
{
    struct kept *k = find(l, key);
    int status = KILN_OK;
    if (k == NULL) {
        status = make_room(l, error);
        if (status == KILN_OK)
            status = kiln_allocate(&k, 1, sizeof *k, "direct light that is kept", error);
        status = kiln_agree(l->bake->communicator, status, error);
        if (status == KILN_OK)
            status = kiln_state_scene_use(l->bake->prepared, scene, error);
        if (status == KILN_OK) {
            k->key = key;
            k->used = l->clock;
            k->exact = exact;
            status = trace(l, k, error);
        }
        if (status == KILN_OK)
            l->kept[l->kept_count++] = k;
        else if (k != NULL)
            drop(&k);
    }
    *kept = k;
    return status;
}

/* ---- parts ---- */

/* Assigns the state's elements to parts: own_part of each, KILN_NONE for those that do not shine. Returns the number of
 * parts. */
static uint32_t divide(struct kiln_state_lights *l, const struct kiln_state_scene *scene)
{
    uint32_t parts = 0;
    for (size_t i = 0; i < l->elements; i++) {
        l->own_part[i] = KILN_NONE;
        l->own_changed[i] = !factor_of(l, scene, i, l->own_factor[i]);
        if (!emits(l, scene, i))
            continue;
        if (l->own_changed[i])
            l->own_factor[i][0] = l->own_factor[i][1] = l->own_factor[i][2] = 1.0f;
        for (size_t k = 0; k < i && l->own_part[i] == KILN_NONE; k++)
            if (l->own_part[k] != KILN_NONE && l->own_changed[k] == l->own_changed[i] &&
                (l->own_changed[i] || l->part_of[k] == l->part_of[i]) &&
                memcmp(l->own_factor[k], l->own_factor[i], sizeof l->own_factor[i]) == 0)
                l->own_part[i] = l->own_part[k];
        if (l->own_part[i] == KILN_NONE)
            l->own_part[i] = parts++;
    }
    return parts;
}

/* Makes the scene l->only, in which only one part of the state's elements shines: lights, emissions of materials, the
 * environment. Elements that no factor turns into the state's (own_changed) are as in the state, others as in the base
 * scene. Returns a hash of the part's values. */
static uint64_t isolate(struct kiln_state_lights *l, const struct kiln_state_scene *scene, uint32_t part)
{
    const struct kiln_scene *s = l->bake->prepared->scene;
    uint64_t key = XXH3_64bits("part", 4);
    kiln_state_scene_copy(&l->only, l->base, s);
    for (size_t i = 0; i < l->elements; i++) {
        const bool in = l->own_part[i] == part;
        const struct kiln_state_scene *from = l->own_changed[i] ? scene : l->base;
        if (in && i < light_count(l))
            l->only.lights[i] = from->lights[i];
        if (in && i + 1 == l->elements)
            l->only.environment = from->environment;
        float *to = value_of(l, &l->only, i);
        const float *value = value_of(l, from, i);
        if (!in && to != NULL)
            memset(to, 0, 3 * sizeof *to);
        else if (in)
            memcpy(to, value, 3 * sizeof *to);
        if (!in && i + 1 == l->elements)
            l->only.environment = (struct kiln_environment){.kind = KILN_ENVIRONMENT_NONE};
        if (!in)
            continue;
        key = XXH3_64bits_withSeed(&i, sizeof i, key);
        key = XXH3_64bits_withSeed(to, 3 * sizeof *to, key);
        if (i < light_count(l))
            key = XXH3_64bits_withSeed(&l->only.lights[i], sizeof l->only.lights[i], key);
        if (i + 1 == l->elements)
            key = XXH3_64bits_withSeed(&l->only.environment, sizeof l->only.environment, key);
    }
    return key;
}

/* Whether all elements of the state are those of the base scene. */
static bool is_same(const struct kiln_state_lights *l, const struct kiln_state_scene *scene)
{
    bool same = true;
    for (size_t i = 0; i < l->elements && same; i++) {
        const float *a = value_of(l, l->base, i), *b = value_of(l, scene, i);
        const bool lit = emits(l, scene, i);
        same = emits(l, l->base, i) == lit &&
               (!lit || (same_form(l, l->base, scene, i) && memcmp(a, b, 3 * sizeof *a) == 0));
    }
    return same;
}

static void add_emission(struct kiln_emission_result *sum, const struct part *part)
{
    const struct kiln_emission_result *e = &part->kept->emission;
    const double factor[3] = {(double)part->factor[0], (double)part->factor[1], (double)part->factor[2]},
                 luminance = kiln_luminance(factor);
    sum->from_outside += luminance * e->from_outside;
    sum->outside += luminance * e->outside;
    sum->on_rooms += luminance * e->on_rooms;
    sum->astray += luminance * e->astray;
    for (int c = 0; c < 3; c++) {
        const double f = (double)part->factor[c];
        sum->emitted[c] += f * e->emitted[c];
        sum->received[c] += f * e->received[c];
        sum->blocked[c] += f * e->blocked[c];
        sum->escaped[c] += f * e->escaped[c];
        sum->ranged[c] += f * e->ranged[c];
        sum->error[c] = hypot(sum->error[c], f * e->error[c]);
    }
}

/* Collective. */
static int find_parts(struct kiln_state_lights *l, const struct kiln_state_scene *scene, struct mix *m,
                      struct kiln_error *error)
{
    const uint32_t parts = divide(l, scene);
    int status = KILN_OK;
    m->count = 0;
    if (parts > PARTS_MOST)
        return kiln_fail(error, KILN_USAGE,
                         "the state scales its lights in %u different ways, and there may be %d at most: give more of "
                         "them the same scale",
                         parts, PARTS_MOST);
    for (uint32_t i = 0; i < parts && status == KILN_OK; i++) {
        struct part *part = &m->parts[m->count++];
        for (size_t k = 0; k < l->elements; k++)
            if (l->own_part[k] == i)
                memcpy(part->factor, l->own_factor[k], sizeof part->factor);
        const uint64_t key = isolate(l, scene, i);
        status = keep(l, &l->only, key, false, &part->kept, error);
        if (status != KILN_OK)
            break;
        add_emission(&m->emission, part);
        m->held[i] = (struct kiln_held_term){.key = key, .answers = part->kept->answers[0]};
        memcpy(m->held[i].factor, part->factor, sizeof part->factor);
    }
    return status;
}

/* ---- giving ---- */

/* Implements kiln_state_direct.give with the bake's own direct light. */
static void give_same(void *context, const struct kiln_step *step, size_t first, size_t count,
                      struct kiln_point_result *results)
{
    const struct mix *m = context;
    const struct kiln_surface *s = m->lights->bake->prepared->surface;
    const uint32_t place = m->settings.parts > 1 ? step->part : step->samples_field != NULL ? 1 : 0;
    const struct kiln_direct_answer *from =
        m->parts[0].kept->answers[place] + (s->tile_runs[first].first.at - s->first.at);
    const uint64_t points = kiln_tile_runs_points(&s->tile_runs[first], &s->tile_runs[first + count - 1]);
    for (uint64_t i = 0; i < points; i++) {
        results[i] =
            (struct kiln_point_result){.error = from[i].error, .present = from[i].present, .count = from[i].count};
        memcpy(results[i].irradiance, from[i].irradiance, sizeof from[i].irradiance);
        memcpy(results[i].incident, from[i].incident, sizeof from[i].incident);
    }
}

/* Adds a part's light at a point, as sums of GIVEN_SAMPLES samples. Parts are traced independently, so their squared
 * errors add up; each error scales with its light. */
static void add_part(const struct part *part, const struct kiln_direct_answer *a, uint32_t samples,
                     struct kiln_point_result *r, double *square)
{
    float scaled[3];
    for (int c = 0; c < 3; c++) {
        scaled[c] = part->factor[c] * a->irradiance[c];
        r->irradiance[c] += (float)samples * scaled[c];
        r->incident[c] += (float)samples * part->factor[c] * a->incident[c];
    }
    const double before = kiln_luminance_of_floats(a->irradiance), after = kiln_luminance_of_floats(scaled),
                 all = kiln_luminance_of_floats(part->factor),
                 error = (before > 0.0 ? after / before : all) * (double)a->error;
    *square += error * error;
    r->present = a->present;
    r->count = a->count > 0 ? samples : 0;
}

/* kiln_state_direct.give of parts. */
static void give_mix(void *context, const struct kiln_step *step, size_t first, size_t count,
                     struct kiln_point_result *results)
{
    const struct mix *m = context;
    const struct kiln_surface *s = m->lights->bake->prepared->surface;
    const uint32_t place = m->settings.parts > 1 ? step->part : 0;
    const uint64_t begin = s->tile_runs[first].first.at - s->first.at,
                   points = kiln_tile_runs_points(&s->tile_runs[first], &s->tile_runs[first + count - 1]);
    for (uint64_t i = 0; i < points; i++) {
        double square = 0.0;
        results[i] = (struct kiln_point_result){.present = 1.0f};
        if (m->count == 0) /* dark */
            results[i].count = kiln_point_valid(s, (struct kiln_own_point){begin + i}) ? step->samples : 0;
        for (size_t k = 0; k < m->count; k++)
            add_part(&m->parts[k], &m->parts[k].kept->answers[place][begin + i], step->samples, &results[i], &square);
        results[i].error = (float)((double)step->samples * sqrt(square));
    }
}

/* ---- all ---- */

int kiln_state_lights_mix(struct kiln_state_lights *l, const struct kiln_state_scene *scene, size_t place,
                          struct kiln_state *state, struct kiln_error *error)
{
    struct mix *m = &l->mixes[place];
    int status;
    l->clock++;
    if (place == 0)
        l->begun = l->clock;
    *m = (struct mix){.lights = l, .settings = l->bake->light_settings, .same = is_same(l, scene)};
    if (m->same) {
        m->count = 1;
        status = keep(l, l->base, 0, true, &m->parts[0].kept, error);
        if (status == KILN_OK)
            m->emission = m->parts[0].kept->emission;
    } else {
        m->settings.samples_direct = m->settings.parts > 1 ? GIVEN_SAMPLES * KILN_PARTS : GIVEN_SAMPLES;
        status = find_parts(l, scene, m, error);
    }
    state->settings = &m->settings;
    state->emission = &m->emission;
    state->direct = (struct kiln_state_direct){.give = m->same ? give_same : give_mix,
                                               .mixed = !m->same && m->settings.parts <= 1,
                                               .parts = m->held,
                                               .part_count = (uint32_t)m->count,
                                               .context = m};
    return kiln_agree(l->bake->communicator, status, error);
}

bool kiln_state_lights_same(const struct kiln_state_lights *l, size_t place, size_t *parts)
{
    *parts = l->mixes[place].count;
    return l->mixes[place].same;
}

void kiln_state_lights_counts(const struct kiln_state_lights *l, uint64_t *traced, uint64_t *bytes)
{
    *traced = l->traced;
    *bytes = 0;
    for (size_t i = 0; i < l->kept_count; i++)
        *bytes += (uint64_t)l->kept[i]->steps * l->bake->prepared->surface->count * sizeof(struct kiln_direct_answer);
}

/* The base scene's elements that emit, in up to KILN_STATE_TERMS parts of about as many. */
static void number_parts(struct kiln_state_lights *l)
{
    size_t number = 0;
    for (size_t i = 0; i < l->elements; i++)
        l->emitting += emits(l, l->base, i);
    const size_t each = (l->emitting + KILN_STATE_TERMS - 1) / KILN_STATE_TERMS;
    for (size_t i = 0; i < l->elements; i++)
        l->part_of[i] = emits(l, l->base, i) ? (uint32_t)(number++ / each) : KILN_NONE;
}

int kiln_state_lights_create(struct kiln_state_lights **lights, struct kiln_bake *bake, struct kiln_states *states,
                             const struct kiln_state_scene *base, struct kiln_error *error)
{
    const struct kiln_prepared *p = bake->prepared;
    struct kiln_state_lights *l = NULL;
    int status = kiln_allocate(&l, 1, sizeof *l, "the lights of states", error);
    *lights = l;
    KILN_TRY(status);
    *l = (struct kiln_state_lights){.bake = bake, .states = states, .base = base};
    l->elements = p->scene->light_count + p->scene->material_count + 1;
    KILN_TRY(kiln_state_scene_create(&l->only, p->scene, error));
    KILN_TRY(
        kiln_arena_allocate(&l->arena, &l->part_of, l->elements, sizeof *l->part_of, "the lights of states", error));
    KILN_TRY(
        kiln_arena_allocate(&l->arena, &l->own_part, l->elements, sizeof *l->own_part, "the lights of states", error));
    KILN_TRY(kiln_arena_allocate(&l->arena, &l->own_factor, l->elements, sizeof *l->own_factor, "the lights of states",
                                 error));
    KILN_TRY(kiln_arena_allocate(&l->arena, &l->own_changed, l->elements, sizeof *l->own_changed,
                                 "the lights of states", error));
    KILN_TRY(kiln_arena_allocate(&l->arena, &l->white, 3 * (size_t)p->surface->count, sizeof *l->white,
                                 "an albedo of 1", error));
    memset(l->white, 0xff, 3 * (size_t)p->surface->count * sizeof *l->white);
    number_parts(l);
end:
    return kiln_agree(p->communicator, status, error);
}

void kiln_state_lights_destroy(struct kiln_state_lights **lights)
{
    struct kiln_state_lights *l = *lights;
    if (l == NULL)
        return;
    for (size_t i = 0; i < l->kept_count; i++)
        drop(&l->kept[i]);
    kiln_state_scene_release(&l->only);
    kiln_free(&l->kept);
    kiln_arena_release(&l->arena);
    kiln_free(lights);
}
