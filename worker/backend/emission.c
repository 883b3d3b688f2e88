/* Light traced from the lights, for the energy ledger: the shares that hit front faces, back faces or nothing, and that
 * mirrors, gloss and glass absorb; these reflect the rest until diffuse surfaces take it up. It shares no code with the
 * direct pass except the description of lights, so that agreement of the two is meaningful. Particles are made here, on
 * the host; every backend finds their hits with its own tracer. */
#include <assert.h>
#include <math.h>
#include <omp.h>
#include <string.h>

#include "shaders/shared/punctual_light.h"
#include "shaders/shared/random.h"
#include "worker/backend/backend.h"
#include "worker/backend/emission.h"
#include "worker/backend/particle.h"
#include "worker/base/arena.h"
#include "worker/base/memory.h"
#include "worker/light/lights.h"
#include "worker/material/scene_lobes.h"
#include "worker/sampling/sequence.h"
#include "worker/scene/enclosures.h"
#include "worker/scene/footprint.h"

enum { GROUPS = KILN_EMISSION_GROUPS };
enum { BATCH = 1 << 16 }; /* particles traced at once */

/* One particle: where it starts, where it goes, the flux it carries (W, RGB). */
struct particle {
    uint32_t light, index; /* light, and index of the particle among the light's in its group */
    double scale;          /* share of the light's flux that it stands for */
    struct kiln_vec3 origin;
    struct kiln_dvec3 direction;
    double flux[3];
    const struct kiln_point_light *ranged; /* its range cuts the flux down at the hit */
    uint32_t surface;                      /* number of surfaces with gloss that it has hit before */
    float weight[3];                       /* share of its initial flux that is left */
    bool unfound;                          /* no gather ray finds its way */
};

/* Light of suns and sky that hits an object directly: its front; its back, if that is the outer side of a room's wall;
 * other backs; and the number of particles. */
struct from_outside {
    double front, room, back;
    uint64_t count;
};

/* Particles directly from suns and sky that have hit backs of single-sided surfaces. They are traced on behind these.
 */
struct beyond {
    struct kiln_enclosures *enclosures; /* NULL: no light comes from outside, and no particles are stored */
    size_t count;
    struct kiln_vec3 *origins, *directions; /* BATCH of each of these */
    struct kiln_hit *hits;
    uint32_t *numbers;            /* of the particles in their batch */
    struct from_outside *objects; /* of each object, in a group */
    struct kiln_arena arena;
};

struct emission {
    struct kiln_backend *backend;
    const struct kiln_backend_params *params;
    int threads;
    double radius; /* of the sphere about the scene */
    struct kiln_vec3 centre;
    size_t light_count, inside; /* number of lights; of lights other than suns and sky, which come first */
    double total;               /* flux_of all lights */
    struct particle *particles; /* BATCH of each of these */
    struct kiln_vec3 *origins, *directions;
    struct kiln_hit *hits;
    struct kiln_gloss_lobes *lobes;   /* per material; NULL: no material has gloss */
    struct kiln_particle_turn *turns; /* NULL: no material has gloss */
    struct beyond beyond;
    struct kiln_arena arena;
};

/* Progress of a group in distributing its particles over lights by systematic sampling: a light gets the particles
 * whose position on the cumulative flux is in its interval. */
struct walk {
    uint32_t base, samples, next; /* hash of the group; number of particles; number distributed */
    double step, start;
    size_t light;
    uint32_t index;
    double flux, reached; /* of this light; of all up to it */
};

static double area_flux(const struct kiln_area_light *a) { return KILN_PI * a->area * (a->two_sided ? 2.0 : 1.0); }

/* Luminance of the flux of light i (areas, points, directionals, environment): the weight used everywhere. */
static double flux_of(const struct emission *e, size_t i)
{
    const struct kiln_lights *l = e->params->lights;
    if (i < l->area_count)
        return area_flux(&l->areas[i]) * kiln_luminance_of_floats(l->areas[i].radiance);
    i -= l->area_count;
    if (i < l->point_count)
        return kiln_punctual_angle(&l->points[i]) * kiln_luminance_of_floats(l->points[i].intensity);
    i -= l->point_count;
    const double disk = KILN_PI * e->radius * e->radius;
    if (i < l->directional_count)
        return disk * kiln_luminance_of_floats(l->directionals[i].irradiance);
    return 4.0 * KILN_PI * disk * kiln_luminance_of_floats(l->environment_mean);
}

static struct kiln_dvec3 turn(struct kiln_dvec3 local, struct kiln_dvec3 axis)
{
    struct kiln_vec3 t, b;
    kiln_basis(vec3_of(axis), &t, &b);
    return dvec3_add(dvec3_add(dvec3_scale(dvec3_of(t), local.x), dvec3_scale(dvec3_of(b), local.y)),
                     dvec3_scale(axis, local.z));
}

static void from_area(const struct emission *e, const struct kiln_area_light *a, const double r[5], struct particle *p)
{
    const struct kiln_backend_params *params = e->params;
    const double root = sqrt(r[0]), b1 = root * (1.0 - r[1]), b2 = root * r[1];
    const double side = a->two_sided && r[4] < 0.5 ? -1.0 : 1.0;
    const struct kiln_dvec3 normal = dvec3_scale(a->normal, side);
    const struct kiln_dvec3 at = dvec3_add(a->p0, dvec3_add(dvec3_scale(a->e1, b1), dvec3_scale(a->e2, b2)));
    p->origin = kiln_offset_origin(vec3_of(at), vec3_of(normal), params->geometry, a->triangle);
    p->direction = turn(kiln_cosine_direction(r[2], r[3]), normal);
    float rgb[3];
    kiln_area_light_radiance(params->lights, a, b1, b2, rgb);
    for (int c = 0; c < 3; c++)
        p->flux[c] = (double)rgb[c] * area_flux(a);
}

static void from_point(const struct kiln_point_light *l, const double r[5], struct particle *p)
{
    p->direction = kiln_punctual_sample(l, r[2], r[3]);
    p->origin = vec3_of(l->position);
    const double factor = kiln_punctual_angle(l) * kiln_punctual_profile(l, p->direction);
    for (int c = 0; c < 3; c++)
        p->flux[c] = (double)l->intensity[c] * factor;
    p->ranged = l->range > 0.0 ? l : NULL;
}

/* Starts a particle from outside: at a point of the disk that the scene's sphere projects to along the direction. */
static void from_outside(const struct emission *e, struct kiln_dvec3 towards, const double r[5], struct particle *p)
{
    const double radius = e->radius * sqrt(r[0]), phi = 2.0 * KILN_PI * r[1];
    const struct kiln_dvec3 disk = turn(dvec3(radius * cos(phi), radius * sin(phi), e->radius), towards);
    p->origin = vec3_of(dvec3_add(dvec3_of(e->centre), disk));
    p->direction = dvec3_scale(towards, -1.0);
}

static void make_particle(const struct emission *e, const double r[5], struct particle *p)
{
    const struct kiln_lights *l = e->params->lights;
    size_t i = p->light;
    if (i < l->area_count) {
        from_area(e, &l->areas[i], r, p);
        return;
    }
    i -= l->area_count;
    if (i < l->point_count) {
        from_point(&l->points[i], r, p);
        return;
    }
    i -= l->point_count;
    const double disk = KILN_PI * e->radius * e->radius;
    if (i < l->directional_count) {
        from_outside(e, l->directionals[i].towards, r, p);
        for (int c = 0; c < 3; c++)
            p->flux[c] = (double)l->directionals[i].irradiance[c] * disk;
        return;
    }
    double density;
    const struct kiln_dvec3 towards = kiln_environment_sample(l, r[2], r[3], &density);
    from_outside(e, towards, r, p);
    float rgb[3];
    kiln_environment_radiance(l, towards, rgb);
    for (int c = 0; c < 3; c++)
        p->flux[c] = (double)rgb[c] * disk / density;
}

static void begin_group(const struct emission *e, struct walk *w, uint32_t group, uint32_t samples)
{
    const uint64_t seed = e->params->seed;
    const uint32_t base = kiln_hash2(kiln_hash2((uint32_t)seed, (uint32_t)(seed >> 32)), 0x656d6974u + group);
    *w = (struct walk){.base = base, .samples = samples, .step = e->total / samples, .flux = flux_of(e, 0)};
    w->start = kiln_unit_double(kiln_hash1(base)) * w->step;
    w->reached = w->flux;
}

/* Makes the next particles, light after light, at most BATCH. */
static size_t deal(const struct emission *e, struct walk *w)
{
    size_t count = 0;
    while (count < BATCH && w->next < w->samples && w->light < e->light_count) {
        if (w->start + w->next * w->step < w->reached) {
            e->particles[count++] = (struct particle){.light = (uint32_t)w->light,
                                                      .index = w->index++,
                                                      .scale = w->step / w->flux,
                                                      .weight = {1.0f, 1.0f, 1.0f}};
            w->next++;
            continue;
        }
        w->index = 0;
        w->flux = ++w->light < e->light_count ? flux_of(e, w->light) : 0.0;
        w->reached += w->flux;
    }
    return count;
}

static void make_batch(const struct emission *e, uint32_t base, size_t count)
{
#pragma omp parallel for num_threads(e->threads) schedule(static)
    for (size_t j = 0; j < count; j++) {
        struct particle *p = &e->particles[j];
        double r[KILN_DIMENSIONS];
        for (uint32_t d = 0; d < KILN_DIMENSIONS; d++)
            r[d] = kiln_unit_double(
                kiln_owen_scramble(kiln_sobol(p->index, d), kiln_hash2(kiln_hash2(base, p->light + 1u), d)));
        make_particle(e, r, p);
        e->origins[j] = p->origin;
        e->directions[j] = vec3_of(p->direction);
    }
}

/* Adds flux that has arrived. `target`: the sum of received flux, or that of escaped or blocked flux. */
static void receive(const struct particle *p, const double flux[3], double target[3], struct kiln_emission_result *out)
{
    for (int c = 0; c < 3; c++) {
        target[c] += flux[c];
        out->caustic[c] += target == out->received && p->surface > 0 ? flux[c] : 0.0;
        out->mirrored[c] += target == out->received && p->unfound ? flux[c] : 0.0;
    }
}

static bool is_textured(const struct emission *e, uint32_t light)
{
    const struct kiln_lights *l = e->params->lights;
    return light < l->area_count && l->areas[light].textured;
}

/* Adds the emission of triangles with textures, as the textures' integrals. */
static void add_textured(const struct emission *e, struct kiln_emission_result *out)
{
    const struct kiln_lights *l = e->params->lights;
    for (size_t i = 0; i < l->area_count; i++)
        for (int c = 0; c < 3 && l->areas[i].textured; c++)
            out->textured[c] += area_flux(&l->areas[i]) * (double)l->areas[i].radiance[c];
    for (int c = 0; c < 3; c++)
        out->emitted[c] += out->textured[c];
}

static void land(const struct emission *e, const struct particle *p, const struct kiln_hit *hit,
                 struct kiln_emission_result *out)
{
    double *target = out->escaped, kept = 1.0, arrives[3];
    const bool turns = kiln_particle_turns(e->params, hit);
    if (hit->triangle != KILN_NONE) {
        const bool double_sided =
            (e->params->geometry->records[hit->triangle].material & KILN_RECORD_DOUBLE_SIDED) != 0;
        target = !hit->back || double_sided ? out->received : out->blocked;
        if (p->ranged != NULL)
            kept = kiln_light_range(p->ranged->range, (double)hit->distance);
    }
    for (int c = 0; c < 3; c++) {
        const double flux = p->flux[c] * p->scale, here = flux * (double)hit->tint[c];
        if (p->surface == 0)
            (is_textured(e, p->light) ? out->drawn : out->emitted)[c] += flux;
        arrives[c] = here * kept;
        out->ranged[c] += here * (1.0 - kept);
        out->glass[c] += flux - here;
    }
    if (!turns)
        receive(p, arrives, target, out);
}

/* Continues particle j of the batch behind the back that it has hit. */
static void go_beyond(const struct emission *e, size_t j, struct beyond *b)
{
    const struct kiln_geometry *g = e->params->geometry;
    const struct kiln_hit *hit = &e->hits[j];
    const struct kiln_vec3 direction = e->directions[j], normal = kiln_triangle_normal(g, hit->triangle),
                           ahead = vec3_scale(normal, vec3_dot(normal, direction) < 0.0f ? -1.0f : 1.0f);
    b->numbers[b->count] = (uint32_t)j;
    b->directions[b->count] = direction;
    b->origins[b->count++] =
        kiln_offset_origin(vec3_madd(e->origins[j], direction, hit->distance), ahead, g, hit->triangle);
}

/* Whether the surface behind a back shows that the back is the outer side of a room's wall. */
static bool is_room(const struct emission *e, struct kiln_enclosures *enclosures, const struct kiln_hit *back,
                    const struct kiln_hit *behind)
{
    const struct kiln_hit_record *records = e->params->geometry->records;
    if (behind->triangle == KILN_NONE ||
        (behind->back && (records[behind->triangle].material & KILN_RECORD_DOUBLE_SIDED) == 0))
        return false;
    const uint32_t object = records[back->triangle].object;
    return records[behind->triangle].object != object || kiln_encloses(enclosures, object);
}

/* Luminance of the flux of a particle that arrives. */
static double arrives(const struct particle *p, const struct kiln_hit *hit)
{
    double flux[3];
    for (int c = 0; c < 3; c++)
        flux[c] = p->flux[c] * p->scale * (double)hit->tint[c];
    return kiln_luminance(flux);
}

/* Adds the flux of particles directly from suns and sky to the objects that they hit in the batch, by side. */
static void meet_objects(const struct emission *e, struct beyond *b, size_t count, struct kiln_emission_result *out)
{
    const struct kiln_hit_record *records = e->params->geometry->records;
    b->count = 0;
    for (size_t j = 0; j < count; j++) {
        const struct kiln_hit *hit = &e->hits[j];
        if (e->particles[j].surface > 0 || e->particles[j].light < e->inside || hit->triangle == KILN_NONE ||
            kiln_particle_turns(e->params, hit))
            continue;
        const double flux = arrives(&e->particles[j], hit);
        struct from_outside *object = &b->objects[records[hit->triangle].object];
        object->count++;
        if (hit->back && (records[hit->triangle].material & KILN_RECORD_DOUBLE_SIDED) == 0) {
            out->outside += flux;
            go_beyond(e, j, b);
        } else {
            out->from_outside += flux;
            object->front += flux;
        }
    }
}

/* Does the same, and finds the part that fell on the outside of rooms. */
static int look_beyond(const struct emission *e, struct beyond *b, size_t count, struct kiln_emission_result *out,
                       struct kiln_error *error)
{
    if (b->enclosures == NULL)
        return KILN_OK;
    meet_objects(e, b, count, out);
    const int status = b->count == 0
                           ? KILN_OK
                           : kiln_backend_intersect(e->backend, b->origins, b->directions, b->count, b->hits, error);
    for (size_t k = 0; status == KILN_OK && k < b->count; k++) {
        const struct kiln_hit *back = &e->hits[b->numbers[k]];
        struct from_outside *object = &b->objects[e->params->geometry->records[back->triangle].object];
        const double flux = arrives(&e->particles[b->numbers[k]], back);
        const bool room = is_room(e, b->enclosures, back, &b->hits[k]);
        *(room ? &object->room : &object->back) += flux;
        out->on_rooms += room ? flux : 0.0;
    }
    return status;
}

/* Sums up light on the wrong side of objects: flux on backs, less that on outer walls of rooms, less twice that on
 * fronts. Objects with few particles are summed together. */
static void find_astray(const struct emission *e, struct beyond *b, struct kiln_emission_result *out)
{
    enum { FEW = 16 };
    double rest = 0.0;
    for (size_t i = 0; i < e->params->scene->object_count; i++) {
        const struct from_outside *object = &b->objects[i];
        const double more = object->back - object->room - 2.0 * object->front;
        if (object->count < FEW)
            rest += more;
        else
            out->astray += fmax(0.0, more);
    }
    out->astray += fmax(0.0, rest);
    memset(b->objects, 0, e->params->scene->object_count * sizeof *b->objects);
}

/* Whether the light has no size, so that no ray of a chain can hit it. */
static bool has_no_size(const struct emission *e, uint32_t light)
{
    const struct kiln_lights *l = e->params->lights;
    return light >= l->area_count && light < l->area_count + l->point_count + l->directional_count;
}

/* Adds the flux that a surface with gloss takes from a particle; returns whether the particle continues. */
static bool take_turn(const struct emission *e, struct particle *p, const struct kiln_hit *hit,
                      const struct kiln_particle_turn *turn, struct kiln_emission_result *out)
{
    const double kept = p->ranged != NULL ? kiln_light_range(p->ranged->range, (double)hit->distance) : 1.0;
    double comes[3], taken_up[3];
    bool any = false;
    for (int c = 0; c < 3; c++) {
        comes[c] = p->flux[c] * p->scale * (double)hit->tint[c] * kept;
        taken_up[c] = comes[c] * (double)turn->taken_up[c];
        out->gloss[c] += comes[c] * (1.0 - (double)turn->goes_on[c]) - taken_up[c];
    }
    receive(p, taken_up, out->received, out);
    for (int c = 0; c < 3; c++) {
        p->flux[c] = comes[c] * (double)turn->goes_on[c];
        p->weight[c] *= hit->tint[c] * turn->goes_on[c];
        any = any || turn->goes_on[c] > 0.0f;
    }
    p->unfound = p->unfound || (p->surface == 0 && turn->mirrored && has_no_size(e, p->light));
    p->scale = 1.0;
    p->ranged = NULL;
    p->surface++;
    return any;
}

/* Adds the flux that surfaces with gloss take from particles that have hit them, and moves those that continue to the
 * front. Returns their number. */
static size_t turn_on(const struct emission *e, uint32_t base, size_t count, struct kiln_emission_result *out)
{
    size_t left = 0;
#pragma omp parallel for num_threads(e->threads) schedule(dynamic, 256)
    for (size_t j = 0; j < count; j++) {
        const struct particle *p = &e->particles[j];
        const struct kiln_particle_chance chance = {kiln_hash2(base, p->light + 1u), p->index, p->surface};
        if (!kiln_particle_turns(e->params, &e->hits[j]))
            continue;
        const struct kiln_particle_place place =
            kiln_particle_place(e->params, e->lobes, &e->hits[j], e->directions[j]);
        e->turns[j] = kiln_particle_turn(&place, p->weight, &chance, KILN_IMPORTANCE);
    }
    for (size_t j = 0; j < count; j++) {
        struct particle p = e->particles[j];
        const bool turns = kiln_particle_turns(e->params, &e->hits[j]);
        if (!turns || !take_turn(e, &p, &e->hits[j], &e->turns[j], out))
            continue;
        e->particles[left] = p;
        e->origins[left] = e->turns[j].origin;
        e->directions[left++] = e->turns[j].direction;
    }
    return left;
}

/* Traces a group. Sums are in the order of the particles, whatever the batches. */
static int trace_group(struct emission *e, uint32_t group, uint32_t samples, struct kiln_emission_result *out,
                       struct kiln_error *error)
{
    struct walk w;
    begin_group(e, &w, group, samples);
    for (size_t count; (count = deal(e, &w)) > 0;) {
        make_batch(e, w.base, count);
        while (count > 0) {
            if (kiln_stop_asked(e->params->stop))
                return kiln_give_up(error);
            int status = kiln_backend_intersect(e->backend, e->origins, e->directions, count, e->hits, error);
            if (status == KILN_OK)
                status = look_beyond(e, &e->beyond, count, out, error);
            if (status != KILN_OK)
                return status;
            for (size_t j = 0; j < count; j++)
                land(e, &e->particles[j], &e->hits[j], out);
            count = e->turns != NULL ? turn_on(e, w.base, count, out) : 0;
        }
    }
    if (e->beyond.enclosures != NULL)
        find_astray(e, &e->beyond, out);
    return KILN_OK;
}

/* Standard error of the mean over groups, estimated from their spread. */
static double spread_of(const double numbers[GROUPS])
{
    double mean = 0.0, square = 0.0;
    for (int i = 0; i < GROUPS; i++)
        mean += numbers[i] / GROUPS;
    for (int i = 0; i < GROUPS; i++)
        square += (numbers[i] - mean) * (numbers[i] - mean);
    return sqrt(square / (GROUPS * (GROUPS - 1)));
}

void kiln_emission_combine(const struct kiln_emission_result groups[GROUPS], struct kiln_emission_result *result)
{
    *result = (struct kiln_emission_result){0};
    for (int i = 0; i < GROUPS; i++) {
        result->from_outside += groups[i].from_outside / GROUPS;
        result->outside += groups[i].outside / GROUPS;
        result->on_rooms += groups[i].on_rooms / GROUPS;
        result->astray += groups[i].astray / GROUPS;
    }
    for (int c = 0; c < 3; c++) {
        double received[GROUPS], straight[GROUPS], caustic[GROUPS], drawn[GROUPS];
        for (int i = 0; i < GROUPS; i++) {
            received[i] = groups[i].received[c];
            caustic[i] = groups[i].caustic[c];
            drawn[i] = groups[i].drawn[c];
            straight[i] = received[i] - caustic[i];
            result->emitted[c] += groups[i].emitted[c] / GROUPS;
            result->received[c] += groups[i].received[c] / GROUPS;
            result->blocked[c] += groups[i].blocked[c] / GROUPS;
            result->escaped[c] += groups[i].escaped[c] / GROUPS;
            result->ranged[c] += groups[i].ranged[c] / GROUPS;
            result->glass[c] += groups[i].glass[c] / GROUPS;
            result->gloss[c] += groups[i].gloss[c] / GROUPS;
            result->caustic[c] += groups[i].caustic[c] / GROUPS;
            result->mirrored[c] += groups[i].mirrored[c] / GROUPS;
            result->textured[c] += groups[i].textured[c] / GROUPS;
            result->drawn[c] += groups[i].drawn[c] / GROUPS;
        }
        result->error[c] = spread_of(received);
        result->straight_error[c] = spread_of(straight);
        result->caustic_error[c] = spread_of(caustic);
        result->drawn_error[c] = spread_of(drawn);
    }
}

static int make_beyond(struct emission *e, struct kiln_error *error)
{
    struct beyond *b = &e->beyond;
    int status;
    KILN_TRY(kiln_arena_allocate(&b->arena, &b->origins, BATCH, sizeof *b->origins, "the particles' origins", error));
    KILN_TRY(kiln_arena_allocate(&b->arena, &b->directions, BATCH, sizeof *b->directions, "the particles' directions",
                                 error));
    KILN_TRY(kiln_arena_allocate(&b->arena, &b->hits, BATCH, sizeof *b->hits, "the particles' hits", error));
    KILN_TRY(kiln_arena_allocate(&b->arena, &b->numbers, BATCH, sizeof *b->numbers, "the particles' numbers", error));
    KILN_TRY(kiln_arena_allocate(&b->arena, &b->objects, e->params->scene->object_count, sizeof *b->objects,
                                 "the light of objects from outside", error));
    KILN_TRY(kiln_enclosures_create(&b->enclosures, e->params->scene, e->params->geometry, error));
end:
    return status;
}

static void release_beyond(struct beyond *b)
{
    kiln_arena_release(&b->arena);
    kiln_enclosures_destroy(&b->enclosures);
}

static int make_room(struct emission *e, struct kiln_error *error)
{
    int status;
    KILN_TRY(kiln_arena_allocate(&e->arena, &e->particles, BATCH, sizeof *e->particles, "the particles of the lights",
                                 error));
    KILN_TRY(kiln_arena_allocate(&e->arena, &e->origins, BATCH, sizeof *e->origins, "the particles' origins", error));
    KILN_TRY(kiln_arena_allocate(&e->arena, &e->directions, BATCH, sizeof *e->directions, "the particles' directions",
                                 error));
    if (e->params->scene->taken != NULL)
        KILN_TRY(kiln_arena_allocate(&e->arena, &e->turns, BATCH, sizeof *e->turns, "the particles' ways", error));
    KILN_TRY(kiln_scene_lobes(&e->lobes, e->params->scene, error));
    if (e->light_count > e->inside)
        KILN_TRY(make_beyond(e, error));
    KILN_TRY(kiln_arena_allocate(&e->arena, &e->hits, BATCH, sizeof *e->hits, "the particles' hits", error));
end:
    return status;
}

int kiln_emission_groups(struct kiln_backend *backend, uint32_t samples, uint32_t first, uint32_t step,
                         struct kiln_emission_result groups[GROUPS], struct kiln_error *error)
{
    assert(samples > 0 && step > 0);
    const struct kiln_lights *l = backend->params.lights;
    const struct kiln_geometry *g = backend->params.geometry;
    struct emission e = {.backend = backend, .params = &backend->params};
    e.threads = e.params->threads != 0 ? (int)e.params->threads : omp_get_num_procs();
    e.inside = l->area_count + l->point_count;
    e.light_count = e.inside + l->directional_count + (l->environment ? 1 : 0);
    e.centre = vec3_scale(vec3_add(g->bounds_min, g->bounds_max), 0.5f);
    e.radius = 0.5 * (double)vec3_length(vec3_sub(g->bounds_max, g->bounds_min)) * 1.0001;
    memset(groups, 0, GROUPS * sizeof *groups);
    for (size_t i = 0; i < e.light_count; i++)
        e.total += flux_of(&e, i);
    if (!(e.total > 0.0) || first >= GROUPS)
        return KILN_OK;
    int status = make_room(&e, error);
    for (uint32_t i = first; i < GROUPS && status == KILN_OK; i += step) {
        status = trace_group(&e, i, samples / GROUPS < 1 ? 1 : samples / GROUPS, &groups[i], error);
        add_textured(&e, &groups[i]);
    }
    kiln_arena_release(&e.arena);
    kiln_free(&e.lobes);
    release_beyond(&e.beyond);
    return status;
}

int kiln_backend_emission(struct kiln_backend *backend, uint32_t samples, struct kiln_emission_result *result,
                          struct kiln_error *error)
{
    struct kiln_emission_result groups[GROUPS];
    const int status = kiln_emission_groups(backend, samples, 0, 1, groups, error);
    if (status == KILN_OK)
        kiln_emission_combine(groups, result);
    return status;
}
