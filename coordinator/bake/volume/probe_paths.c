#include "coordinator/bake/volume/probe_paths.h"

#include <math.h>
#include <string.h>

#include "coordinator/integrate/land/land.h"
#include "coordinator/mpi/agree.h"
#include "worker/backend/extended.h"
#include "worker/base/memory.h"
#include "worker/light/aims.h"
#include "worker/pass/land.h"
#include "worker/pass/spheres.h"
#include "worker/sampling/sequence.h"

enum { BATCH_PATHS = 1 << 14, OF_A_DEVICE = 64, SIGHT_RAYS = 1024, SIGHT_TOGETHER = 64 };
enum { PATHS_AN_AIM = 4 };
enum { SPHERE_CELLS = 2 }; /* about, that a sphere is in */

/* Unit of fixed-point sums, as a fraction of the most light that one path after the other can bring to a probe. A
 * factor of 2^12 is left for light that crosses a sphere several times, and for colours of little luminance. */
#define UNIT 0x1p-51
#define NOISE 0.125 /* relative error of light found by rays; if larger, light paths compute it */

/* The paths for the probes, on this rank. */
struct paths_work {
    const struct kiln_probe_paths_params *params;
    struct kiln_volume_result *volume;
    struct kiln_probe_result *probes; /* own */
    uint8_t *done;                    /* own */
    /* backend beside a device, for work that the device does not take; NULL: Embree bakes */
    struct kiln_backend *host;
    struct kiln_aims *aims;
    uint64_t photons, iterations;
    /* per aim: moments and paths of all iterations of a chunk, and weights of the next iteration */
    double *learnt, *paths, *weights;
    /* spheres of the present chunk; they and their sums are allocated here */
    struct kiln_probe_spheres spheres;
    int *counts, *places;  /* per rank: elements of a collective call */
    uint64_t *own_sums;    /* of the chunk's own probes */
    uint64_t before, rays; /* paths of the chunks before this one; rays of this one */
    /* rays from the middles of spheres */
    struct kiln_vec3 *origins, *directions;
    struct kiln_hit *hits;
};

/* ---- what for ---- */

/* m2 */
static double area_of(const struct kiln_lights *lights, const struct kiln_lamp *lamp)
{
    double area = 0.0;
    for (uint32_t i = 0; i < lamp->count; i++)
        area += lights->areas[lamp->first + i].area;
    return area;
}

/* Estimates the squared relative error of the light of emitting objects, as found by a probe's rays. Assumes that each
 * object is met by the fraction of rays that its projected area, averaged over directions, has at half of the scene's
 * diagonal. */
static double noise_of(const struct kiln_aims *aims, uint32_t samples)
{
    const struct kiln_lights *lights = aims->lights;
    double flux = 0.0, noise = 0.0;
    for (size_t i = 0; i < aims->lamp_count && aims->lamps[i].kind == KILN_LAMP_AREA; i++) {
        const struct kiln_lamp *lamp = &aims->lamps[i];
        const double share = area_of(lights, lamp) / (8.0 * KILN_PI * aims->radius * aims->radius);
        flux += lamp->flux;
        noise += lamp->flux * lamp->flux / (share * samples);
    }
    return flux > 0.0 ? noise / (flux * flux) : 0.0;
}

int kiln_probe_paths_leaves(const struct kiln_integrate_settings *settings, const struct kiln_lights *lights,
                            uint32_t samples, uint32_t *leaves, struct kiln_error *error)
{
    struct kiln_aims *aims = NULL;
    uint32_t kinds = KILN_LEAVES_POINTS | KILN_LEAVES_IMAGE;
    bool any = false;
    *leaves = 0;
    if (settings->caustics < KILN_CAUSTICS_LAND)
        return KILN_OK;
    const int status = kiln_aims_create(&aims, lights, 0, error);
    if (status != KILN_OK)
        return status;
    kinds |= noise_of(aims, samples) > NOISE * NOISE ? KILN_LEAVES_AREAS : 0;
    for (size_t i = 0; i < aims->count && !any; i++)
        any = kiln_aims_is_left(aims, i, kinds);
    kiln_aims_destroy(&aims);
    *leaves = any ? kinds : 0;
    return KILN_OK;
}

int kiln_probe_paths_expect(const struct kiln_integrate_settings *settings, struct kiln_backend *backend,
                            uint32_t leaves, struct kiln_error *error)
{
    const struct kiln_probe_spheres spheres = {0};
    struct kiln_land_parameters parameters = {.spheres = &spheres};
    struct kiln_aims *aims = NULL;
    if (leaves == 0)
        return KILN_OK;
    const int status = kiln_aims_create(&aims, backend->params.lights, kiln_landing_aims(settings), error);
    parameters.aims = aims;
    if (status == KILN_OK)
        kiln_backend_expect(backend, &kiln_pass_land, &parameters);
    kiln_aims_destroy(&aims);
    return status;
}

static uint64_t max_of(uint64_t a, uint64_t b) { return a > b ? a : b; }

uint64_t kiln_probe_paths_photons(const struct kiln_integrate_settings *settings, size_t aims, const uint64_t size[3],
                                  uint32_t samples)
{
    const uint64_t landing = kiln_landing_photons(settings, aims), least = PATHS_AN_AIM * (uint64_t)aims,
                   face = max_of(size[0] * size[1], max_of(size[1] * size[2], size[2] * size[0])),
                   iterations = (uint64_t)settings->iterations * settings->parts,
                   enough = max_of(samples * face / iterations, least);
    return settings->photons_given ? max_of(landing, aims) : enough < landing ? enough : landing;
}

/* Whether the host traces the paths, for the device that bakes does not take them. */
static bool on_host(const struct paths_work *w)
{
    const struct kiln_land_parameters parameters = {.aims = w->aims, .spheres = &w->spheres};
    return w->host != NULL && !kiln_backend_takes(w->params->backend, &kiln_pass_land, &parameters);
}

/* Returns the backend that traces the paths, and the rays from the centres of spheres. */
static struct kiln_backend *backend_of(const struct paths_work *w) { return on_host(w) ? w->host : w->params->backend; }

/* ---- spheres ---- */

static double smallest(const double spacing[3]) { return fmin(spacing[0], fmin(spacing[1], spacing[2])); }

/* Upper estimate of all light that paths can carry, W. */
static double power_of(const struct kiln_aims *aims, uint32_t leaves)
{
    double power = 0.0;
    for (size_t i = 0; i < aims->count; i++) {
        const struct kiln_lamp *lamp = &aims->lamps[aims->aims[i].lamp];
        if (kiln_aims_is_left(aims, i, leaves))
            power += lamp->kind == KILN_LAMP_AREA ? lamp->flux : aims->aims[i].flux;
    }
    return power;
}

/* The grid, and room for the spheres of `count` probes. */
static int begin_spheres(struct kiln_probe_spheres *s, const struct kiln_volume_result *v,
                         const struct kiln_scene *scene, const struct kiln_aims *aims, uint64_t iterations,
                         uint64_t count, uint32_t leaves, struct kiln_error *error)
{
    struct kiln_sphere *sphere = NULL;
    float *clear = NULL;
    const double power = power_of(aims, leaves);
    *s = (struct kiln_probe_spheres){.radius = 0.5 * smallest(v->spacing), .leaves = leaves};
    s->unit = UNIT * (power > 0.0 ? power : 1.0) * (double)iterations * 2.0 * s->radius;
    for (int a = 0; a < 3; a++) {
        s->origin[a] = v->origin[a] - scene->header->centre[a];
        s->spacing[a] = v->spacing[a];
        s->size[a] = v->size[a];
    }
    int status = kiln_allocate(&sphere, count, sizeof *sphere, "the spheres of probes", error);
    s->sphere = sphere;
    if (status == KILN_OK)
        status = kiln_allocate(&clear, count, sizeof *clear, "the spheres of probes", error);
    s->clear = clear;
    if (status == KILN_OK)
        status = kiln_allocate(&s->sums, count * KILN_SPHERE_SUMS, sizeof *s->sums, "the light in spheres", error);
    if (status == KILN_OK)
        status = kiln_allocate(&s->moments, aims->count, sizeof *s->moments, "the moments of light paths", error);
    return status;
}

void kiln_probe_spheres_release(struct kiln_probe_spheres *s)
{
    struct kiln_sphere *sphere = (struct kiln_sphere *)(uintptr_t)s->sphere;
    float *clear = (float *)(uintptr_t)s->clear;
    kiln_free(&sphere);
    kiln_free(&clear);
    kiln_sphere_cells_release(&s->cells);
    kiln_free(&s->sums);
    kiln_free(&s->moments);
    s->sphere = NULL;
    s->clear = NULL;
}

/* Computes clearances of the spheres and their grid of cells, before paths cross them. */
static int prepare_spheres(struct kiln_probe_spheres *s, struct kiln_backend *host, struct kiln_error *error)
{
    const int status = kiln_backend_clearance(host, s->sphere, s->count, (float *)(uintptr_t)s->clear, error);
    return status == KILN_OK ? kiln_sphere_cells_make(&s->cells, s, error) : status;
}

/* The sphere about probe `index`, which lies `offset` from its place in the grid. */
static struct kiln_sphere sphere_of(const struct kiln_probe_spheres *s, uint64_t index, const float offset[3])
{
    const uint64_t at[3] = {index % s->size[0], index / s->size[0] % s->size[1], index / (s->size[0] * s->size[1])};
    struct kiln_sphere sphere = {.radius = (float)s->radius};
    for (int a = 0; a < 3; a++)
        sphere.centre[a] = (float)(s->origin[a] + (double)at[a] * s->spacing[a]) + offset[a];
    return sphere;
}

static uint64_t total_of(const struct kiln_volume_result *v) { return v->size[0] * v->size[1] * v->size[2]; }

int kiln_probe_spheres_try(struct kiln_probe_spheres *s, struct kiln_backend *host,
                           const struct kiln_volume_result *grid, const struct kiln_scene *scene,
                           const struct kiln_aims *aims, uint32_t leaves, struct kiln_error *error)
{
    const uint64_t total = total_of(grid), count = total < KILN_PROBE_PATHS_CHUNK ? total : KILN_PROBE_PATHS_CHUNK;
    const int status = begin_spheres(s, grid, scene, aims, 1, count, leaves, error);
    struct kiln_sphere *sphere = (struct kiln_sphere *)(uintptr_t)s->sphere;
    s->count = count;
    for (uint64_t i = 0; status == KILN_OK && i < count; i++)
        sphere[i] = sphere_of(s, i, (const float[3]){0.0f, 0.0f, 0.0f});
    return status == KILN_OK ? prepare_spheres(s, host, error) : status;
}

uint64_t kiln_probe_paths_bytes(uint64_t probes, uint32_t ranks, bool device)
{
    const uint64_t chunk = probes < KILN_PROBE_PATHS_CHUNK ? probes : KILN_PROBE_PATHS_CHUNK,
                   own = probes / ranks < chunk ? probes / ranks : chunk, sums = KILN_SPHERE_SUMS * sizeof(uint64_t),
                   ray = 2 * sizeof(struct kiln_vec3) + sizeof(struct kiln_hit);
    return chunk * ((device ? 2 : 1) * sums + sizeof(struct kiln_sphere) + sizeof(float) +
                    SPHERE_CELLS * sizeof(struct kiln_cell_sphere)) +
           own * sums + SIGHT_TOGETHER * SIGHT_RAYS * ray;
}

/* ---- a chunk ---- */

/* Returns the number of this rank's probes in the present chunk. *begin: index of the first among this rank's
 * probes. */
static uint64_t own_part(const struct paths_work *w, uint64_t *begin)
{
    const uint64_t first = w->volume->first, end = first + w->volume->count, chunk = w->spheres.first,
                   chunk_end = chunk + w->spheres.count, low = first > chunk ? first : chunk,
                   high = end < chunk_end ? end : chunk_end;
    *begin = low - first;
    return high > low ? high - low : 0;
}

/* Collective. Computes the counts and places of all ranks' parts of the chunk, with `elements` elements a probe. */
static void share_counts(const struct paths_work *w, int elements)
{
    uint64_t begin;
    int ranks, place = 0;
    const int count = elements * (int)own_part(w, &begin);
    (void)MPI_Comm_size(w->params->communicator, &ranks);
    (void)MPI_Allgather(&count, 1, MPI_INT, w->counts, 1, MPI_INT, w->params->communicator);
    for (int r = 0; r < ranks; r++) {
        w->places[r] = place;
        place += w->counts[r];
    }
}

/* Collective. Exchanges the spheres of the chunk, so that each rank has all of them. */
static void share_spheres(struct paths_work *w)
{
    struct kiln_sphere *sphere = (struct kiln_sphere *)(uintptr_t)w->spheres.sphere;
    uint64_t begin;
    const uint64_t count = own_part(w, &begin);
    share_counts(w, sizeof *sphere / sizeof(float));
    struct kiln_sphere *own = sphere + (w->volume->first + begin - w->spheres.first);
    for (uint64_t i = 0; i < count; i++) {
        const struct kiln_probe_place *place = &w->volume->places[begin + i];
        own[i] = sphere_of(&w->spheres, w->volume->first + begin + i, place->offset);
        if (place->state != KILN_PROBE_IN_PLACE && place->state != KILN_PROBE_MOVED)
            own[i].radius = 0.0f;
    }
    (void)MPI_Allgatherv(MPI_IN_PLACE, 0, MPI_DATATYPE_NULL, sphere, w->counts, w->places, MPI_FLOAT,
                         w->params->communicator);
}

/* Collective. Adds up the sums of all ranks; each rank receives those of its own probes. */
static void reduce_sums(const struct paths_work *w)
{
    share_counts(w, KILN_SPHERE_SUMS);
    (void)MPI_Reduce_scatter(w->spheres.sums, w->own_sums, w->counts, MPI_UINT64_T, MPI_SUM, w->params->communicator);
}

/* ---- free volume around a sphere's centre ---- */

static bool is_crossed(const uint64_t *sums)
{
    bool any = false;
    for (int i = 0; i < KILN_SPHERE_SUMS && !any; i++)
        any = sums[i] != 0;
    return any;
}

/* Volume that one of SIGHT_RAYS rays stands for if it is free up to a distance, m3. */
static double volume_of(double free) { return 4.0 * KILN_PI / 3.0 * free * free * free / SIGHT_RAYS; }

/* Whether no geometry reaches into a sphere of this rank in the chunk. */
static bool is_clear(const struct paths_work *w, const struct kiln_sphere *sphere)
{
    return w->spheres.clear[sphere - w->spheres.sphere] > sphere->radius;
}

/* Volume of a clear sphere, summed up as in find_volumes, m3. */
static double whole_volume(const struct kiln_sphere *sphere)
{
    double volume = 0.0;
    for (size_t k = 0; k < SIGHT_RAYS; k++)
        volume += volume_of((double)sphere->radius);
    return volume;
}

/* Finds, for each of `count` spheres, the volume that is visible from its centre, m3. */
static int find_volumes(struct paths_work *w, const struct kiln_sphere *const *spheres, size_t count, double *volumes,
                        struct kiln_error *error)
{
    for (size_t i = 0; i < count * SIGHT_RAYS; i++) {
        const float *centre = spheres[i / SIGHT_RAYS]->centre;
        w->origins[i] = vec3(centre[0], centre[1], centre[2]);
    }
    w->rays += count * SIGHT_RAYS;
    const int status =
        kiln_backend_intersect(backend_of(w), w->origins, w->directions, count * SIGHT_RAYS, w->hits, error);
    for (size_t i = 0; i < count; i++) {
        const double radius = (double)spheres[i]->radius;
        volumes[i] = 0.0;
        for (size_t k = 0; status == KILN_OK && k < SIGHT_RAYS; k++) {
            const struct kiln_hit *hit = &w->hits[i * SIGHT_RAYS + k];
            volumes[i] += volume_of(hit->triangle == KILN_NONE ? radius : fmin(radius, (double)hit->distance));
        }
    }
    return status;
}

static void add_light(const struct paths_work *w, const uint64_t *sums, double volume, struct kiln_probe_result *probe)
{
    const double scale = volume > 0.0 ? w->spheres.unit / (volume * (double)w->iterations) : 0.0;
    for (int i = 0; i < KILN_SPHERE_SUMS; i++) {
        float *light = i < 27 ? &probe->radiance[i / 3][i % 3] : &probe->irradiance_axes[(i - 27) / 3][i % 3];
        *light += (float)((double)(int64_t)sums[i] * scale);
    }
}

/* Stores the light of this rank's probes in the chunk. */
static int take_light(struct paths_work *w, struct kiln_error *error)
{
    uint64_t begin, crossed[SIGHT_TOGETHER];
    const struct kiln_sphere *spheres[SIGHT_TOGETHER];
    double volumes[SIGHT_TOGETHER];
    const uint64_t count = own_part(w, &begin);
    const struct kiln_sphere *own = w->spheres.sphere + (w->volume->first + begin - w->spheres.first);
    int status = KILN_OK;
    for (uint64_t next = 0; next < count && status == KILN_OK;) {
        size_t some = 0;
        for (; next < count && some < SIGHT_TOGETHER; next++) {
            const uint64_t *sums = w->own_sums + KILN_SPHERE_SUMS * next;
            const bool any = is_crossed(sums);
            if (any && is_clear(w, &own[next])) {
                add_light(w, sums, whole_volume(&own[next]), &w->probes[begin + next]);
            } else if (any) {
                spheres[some] = &own[next];
                crossed[some++] = next;
            }
        }
        status = find_volumes(w, spheres, some, volumes, error);
        for (size_t i = 0; i < some && status == KILN_OK; i++)
            add_light(w, w->own_sums + KILN_SPHERE_SUMS * crossed[i], volumes[i], &w->probes[begin + crossed[i]]);
    }
    return status;
}

/* ---- paths ---- */

static void share_out(struct paths_work *w, bool first)
{
    struct kiln_aims *a = w->aims;
    if (!first)
        kiln_aims_weigh(a, w->learnt, w->paths, 0.0, w->weights);
    for (size_t i = 0; i < a->count; i++) {
        const bool left = kiln_aims_is_left(a, i, w->params->leaves);
        w->weights[i] = !left ? 0.0 : first ? a->aims[i].flux : w->weights[i];
        w->learnt[i] = first ? 0.0 : w->learnt[i];
        w->paths[i] = first ? 0.0 : w->paths[i];
    }
    kiln_aims_share(a, w->photons, w->weights);
}

/* Collective. Adapts the weights of aims: the paths of the next iteration go where those of this one brought most. */
static void learn(struct paths_work *w)
{
    uint64_t *moments = w->spheres.moments;
    (void)MPI_Allreduce(MPI_IN_PLACE, moments, (int)w->aims->count, MPI_UINT64_T, MPI_SUM, w->params->communicator);
    for (size_t i = 0; i < w->aims->count; i++) {
        w->learnt[i] += (double)moments[i] / KILN_SPHERE_MOMENT;
        w->paths[i] += (double)(w->aims->first[i + 1] - w->aims->first[i]);
        moments[i] = 0;
    }
    share_out(w, false);
}

static int trace(struct paths_work *w, uint64_t first, uint64_t count, struct kiln_error *error)
{
    const struct kiln_land_parameters parameters = {.aims = w->aims, .spheres = &w->spheres};
    const struct kiln_batch batch = {.first = first, .count = count};
    w->volume->paths += count;
    w->volume->paths_on_host += on_host(w) ? count : 0;
    return kiln_backend_run(backend_of(w), &kiln_pass_land, &parameters, &batch, &w->rays, error);
}

/* Collective. Traces this rank's part of an iteration and waits for the others. Saves and stops on request. */
static int run_iteration(struct paths_work *w, uint64_t iteration, struct kiln_error *error)
{
    const struct kiln_probe_paths_params *p = w->params;
    int rank, ranks, status = KILN_OK;
    (void)MPI_Comm_rank(p->communicator, &rank);
    (void)MPI_Comm_size(p->communicator, &ranks);
    const uint64_t begin = w->photons * (uint64_t)rank / (uint64_t)ranks,
                   end = w->photons * ((uint64_t)rank + 1) / (uint64_t)ranks,
                   most = w->host == NULL || on_host(w) ? BATCH_PATHS : OF_A_DEVICE * BATCH_PATHS;
    uint64_t next = begin;
    kiln_control_begin(p->control, "light paths at probes");
    for (;;) {
        enum kiln_event event;
        if (status == KILN_OK && next < end) {
            const double start = MPI_Wtime();
            const uint64_t now = end - next < most ? end - next : most;
            status = trace(w, iteration * w->photons + next, now, error);
            next += now;
            event = kiln_control_poll(p->control, next == end, (double)(next - begin) / (double)(end - begin),
                                      MPI_Wtime() - start, status);
        } else {
            event = kiln_control_wait(p->control, true, 1.0, status, NULL, NULL);
        }
        if (event == KILN_EVENT_FAIL || event == KILN_EVENT_DONE)
            return kiln_agree(p->communicator, status, error);
        if (event == KILN_EVENT_SAVE || event == KILN_EVENT_STOP) {
            const int saved = p->save(p->context, event == KILN_EVENT_STOP, error);
            if (saved != KILN_OK)
                return saved;
        }
    }
}

/* Collective. Whether an earlier run has computed the light of all probes of the chunk. */
static bool is_complete(const struct paths_work *w)
{
    uint64_t begin;
    const uint64_t count = own_part(w, &begin);
    int complete = 1;
    for (uint64_t i = 0; i < count && complete != 0; i++)
        complete = w->done[begin + i] == KILN_PROBE_COMPLETE;
    (void)MPI_Allreduce(MPI_IN_PLACE, &complete, 1, MPI_INT, MPI_LAND, w->params->communicator);
    return complete != 0;
}

/* Collective. All iterations, for the probes of a chunk. */
static int run_chunk(struct paths_work *w, struct kiln_error *error)
{
    const struct kiln_probe_paths_params *p = w->params;
    uint64_t begin;
    const uint64_t count = own_part(w, &begin);
    share_spheres(w);
    int status =
        kiln_agree(p->communicator, prepare_spheres(&w->spheres, w->host != NULL ? w->host : p->backend, error), error);
    memset(w->spheres.sums, 0, w->spheres.count * KILN_SPHERE_SUMS * sizeof *w->spheres.sums);
    memset(w->spheres.moments, 0, w->aims->count * sizeof *w->spheres.moments);
    share_out(w, true);
    w->rays = 0;
    for (uint64_t i = 0; i < w->iterations && status == KILN_OK; i++) {
        status = run_iteration(w, i, error);
        if (status == KILN_OK)
            learn(w);
        kiln_progress_advance(p->progress, w->before + (i + 1) * w->photons);
    }
    if (status != KILN_OK)
        return status;
    kiln_control_blocking(p->control, "adding up light at probes", 0.0);
    reduce_sums(w);
    kiln_control_blocking(p->control, NULL, 0.0);
    status = kiln_agree(p->communicator, take_light(w, error), error);
    if (status == KILN_OK && count > 0)
        memset(w->done + begin, KILN_PROBE_COMPLETE, count);
    return status;
}

/* ---- all of it ---- */

/* Computes the directions of rays from a sphere's centre, repeated for SIGHT_TOGETHER spheres. */
static void find_directions(struct kiln_vec3 *directions)
{
    for (uint32_t k = 0; k < SIGHT_RAYS; k++)
        directions[k] =
            vec3_of(kiln_sphere_direction(kiln_unit_double(kiln_sobol(k, 0)), kiln_unit_double(kiln_sobol(k, 1))));
    for (size_t i = SIGHT_RAYS; i < (size_t)SIGHT_TOGETHER * SIGHT_RAYS; i++)
        directions[i] = directions[i - SIGHT_RAYS];
}

static int prepare(struct paths_work *w, struct kiln_error *error)
{
    const struct kiln_probe_paths_params *p = w->params;
    const uint64_t total = total_of(w->volume), chunk = total < KILN_PROBE_PATHS_CHUNK ? total : KILN_PROBE_PATHS_CHUNK;
    const size_t rays = (size_t)SIGHT_TOGETHER * SIGHT_RAYS;
    int ranks;
    (void)MPI_Comm_size(p->communicator, &ranks);
    int status = kiln_aims_create(&w->aims, p->backend->params.lights, kiln_landing_aims(p->settings), error);
    const size_t aims = status == KILN_OK ? w->aims->count : 0;
    KILN_TRY(status);
    KILN_TRY(begin_spheres(&w->spheres, w->volume, p->scene, w->aims, w->iterations, chunk, p->leaves, error));
    KILN_TRY(kiln_allocate(&w->own_sums, (w->volume->count < chunk ? w->volume->count : chunk) * KILN_SPHERE_SUMS,
                           sizeof *w->own_sums, "the light in spheres", error));
    KILN_TRY(kiln_allocate(&w->learnt, 3 * aims, sizeof *w->learnt, "the moments of light paths", error));
    KILN_TRY(kiln_allocate(&w->counts, 2 * (size_t)ranks, sizeof *w->counts, "the ranks' probes", error));
    KILN_TRY(kiln_allocate(&w->origins, rays, sizeof *w->origins, "the probes' rays", error));
    KILN_TRY(kiln_allocate(&w->directions, rays, sizeof *w->directions, "the probes' rays", error));
    KILN_TRY(kiln_allocate(&w->hits, rays, sizeof *w->hits, "the probes' rays", error));
    KILN_TRY(kiln_landing_host(&w->host, p->backend, error));
end:
    w->paths = w->learnt != NULL ? w->learnt + aims : NULL;
    w->weights = w->learnt != NULL ? w->learnt + 2 * aims : NULL;
    w->places = w->counts != NULL ? w->counts + ranks : NULL;
    if (status == KILN_OK)
        find_directions(w->directions);
    if (status == KILN_OK)
        w->photons = kiln_probe_paths_photons(p->settings, aims, w->volume->size, p->samples);
    return kiln_agree(p->communicator, status, error);
}

static void release(struct paths_work *w)
{
    kiln_backend_destroy(&w->host);
    kiln_probe_spheres_release(&w->spheres);
    kiln_aims_destroy(&w->aims);
    kiln_free(&w->own_sums);
    kiln_free(&w->learnt);
    kiln_free(&w->counts);
    kiln_free(&w->origins);
    kiln_free(&w->directions);
    kiln_free(&w->hits);
}

int kiln_probe_paths_add(const struct kiln_probe_paths_params *params, struct kiln_volume_result *volume,
                         struct kiln_probe_result *probes, uint8_t *done, uint64_t *rays, struct kiln_error *error)
{
    const uint64_t total = total_of(volume);
    struct paths_work w = {.params = params,
                           .volume = volume,
                           .probes = probes,
                           .done = done,
                           .iterations = (uint64_t)params->settings->iterations * params->settings->parts};
    int status = prepare(&w, error);
    const uint64_t paths = w.photons * w.iterations, chunks = (total - 1) / KILN_PROBE_PATHS_CHUNK + 1;
    kiln_progress_phase(params->progress, "light paths at probes", chunks * paths);
    for (uint64_t i = 0; i < chunks && status == KILN_OK; i++) {
        const uint64_t first = i * KILN_PROBE_PATHS_CHUNK, left = total - first;
        w.spheres.first = first;
        w.spheres.count = left < KILN_PROBE_PATHS_CHUNK ? left : KILN_PROBE_PATHS_CHUNK;
        w.before = i * paths;
        if (is_complete(&w))
            continue;
        status = run_chunk(&w, error);
        *rays += status == KILN_OK ? w.rays : 0;
    }
    release(&w);
    return status;
}
