#include "coordinator/bake/volume/volume.h"

#include <math.h>
#include <string.h>

#include "coordinator/bake/volume/occluders.h"
#include "coordinator/bake/volume/probe_fill.h"
#include "coordinator/bake/volume/probe_paths.h"
#include "coordinator/bake/volume/probe_places.h"
#include "coordinator/bake/volume/volume_bounds.h"
#include "coordinator/job/options.h"
#include "coordinator/mpi/agree.h"
#include "worker/backend/extended.h"
#include "worker/base/memory.h"
#include "worker/light/light_groups.h"
#include "worker/pass/groups.h"

_Static_assert(sizeof(struct kiln_probe_group) == KILN_GROUP_PROBE_FLOATS * sizeof(float) &&
                   offsetof(struct kiln_probe_result, irradiance_axes) ==
                       sizeof(((struct kiln_probe_group *)0)->radiance),
               "groups are as backends answer, and as the begin of a probe");

/* Longest move of a probe inside geometry, as a part of half the spacing: so it stays in its box of the grid. */
static const double REACH = 0.9;

enum { PROBES_ALONG = 16, BATCH_LEAST = 256, BATCH_MOST = 1 << 16, BATCH_RAYS = 1 << 24 };

/* Returns the given bounds or, if there are none, those of everything that receives light. */
static int find_bounds(struct kiln_volume_bounds *bounds, const struct kiln_scene *scene, const char *given,
                       struct kiln_error *error)
{
    double box[6];
    if (given == NULL)
        return kiln_volume_bounds_find(bounds, scene, error);
    if (!kiln_option_box(given, box))
        return kiln_fail(error, KILN_USAGE, "--volume-bounds: '%.200s' is no box", given);
    *bounds = (struct kiln_volume_bounds){.largest = KILN_NONE};
    memcpy(bounds->low, box, sizeof bounds->low);
    memcpy(bounds->high, box + 3, sizeof bounds->high);
    return KILN_OK;
}

int kiln_volume_grid(struct kiln_volume_result *volume, const struct kiln_scene *scene, double spacing,
                     const char *given, struct kiln_error *error)
{
    struct kiln_volume_bounds bounds;
    const double *low = bounds.low, *high = bounds.high;
    *volume = (struct kiln_volume_result){0};
    const int status = find_bounds(&bounds, scene, given, error);
    if (status != KILN_OK)
        return status;
    volume->sources_left_out = bounds.left_out;
    volume->largest_left_out = bounds.largest;
    double longest = 0.0;
    for (int a = 0; a < 3; a++)
        longest = fmax(longest, high[a] - low[a]);
    const bool chosen = spacing <= 0.0;
    if (chosen)
        spacing = longest > 0.0 ? longest / PROBES_ALONG : 1.0;
    double total = 1.0;
    for (int a = 0; a < 3; a++) {
        const double extent = high[a] - low[a];
        double count = extent < spacing ? 2.0 : floor(extent / spacing + 0.5);
        count = fmax(count, 1.0);
        volume->spacing[a] = chosen && extent >= spacing ? extent / count : spacing;
        volume->origin[a] = 0.5 * (low[a] + high[a]) - 0.5 * (count - 1.0) * volume->spacing[a];
        total *= count;
        if (total > 0x1p28)
            return kiln_fail(error, KILN_USAGE,
                             "a probe every %g m would make more than %.0f probes in a volume of %g x %g x %g m; "
                             "use a larger --probe-spacing, or a smaller --volume-bounds",
                             spacing, 0x1p28, high[0] - low[0], high[1] - low[1], high[2] - low[2]);
        volume->size[a] = (uint64_t)count;
    }
    return KILN_OK;
}

/* Position of a probe relative to the scene's centre. */
static struct kiln_vec3 position_of(const struct kiln_volume_result *v, const double centre[3], uint64_t index)
{
    const uint64_t at[3] = {index % v->size[0], index / v->size[0] % v->size[1], index / (v->size[0] * v->size[1])};
    double p[3];
    for (int a = 0; a < 3; a++)
        p[a] = v->origin[a] + (double)at[a] * v->spacing[a] - centre[a];
    return vec3((float)p[0], (float)p[1], (float)p[2]);
}

/* Probes in a batch: enough to fill a GPU, and few enough to show progress. */
static uint64_t batch_size(uint32_t samples)
{
    const uint64_t count = BATCH_RAYS / (uint64_t)samples;
    return count < BATCH_LEAST ? BATCH_LEAST : count > BATCH_MOST ? BATCH_MOST : count;
}

/* State of the probe pass on this rank. */
struct volume_work {
    const struct kiln_volume_params *params;
    struct kiln_volume_result *volume;
    struct kiln_probe_result *probes;       /* own */
    struct kiln_probe_occluders *occluders; /* own */
    struct kiln_probe_place *places;        /* own */
    struct kiln_probe_group *groups;        /* this rank's: light of all groups of each probe; NULL: no groups */
    uint8_t *done;                          /* own: enum kiln_probe_done */
    uint32_t leaves;                        /* light that comes from light paths (kiln_probe_paths_leaves) */
    struct kiln_vec3 *positions;            /* of the probes of a batch */
    uint64_t batch, batch_most, next, finished;
    uint64_t *rays;
};

/* Reads the probes that earlier runs have gathered. Only one rank counts the rays of each file. */
static int restore(struct volume_work *w, int rank, int ranks, struct kiln_error *error)
{
    const struct kiln_checkpoint *c = w->params->checkpoint;
    const uint64_t first = w->volume->first, count = w->volume->count;
    if (!w->params->restore || kiln_checkpoint_generation(c) == 0 || !kiln_checkpoint_has(c, "probes") ||
        !kiln_checkpoint_has(c, "probe_occluders") || !kiln_checkpoint_has(c, "probe_places") ||
        (w->groups != NULL && !kiln_checkpoint_has(c, "probe_groups")))
        return KILN_OK;
    int status;
    KILN_TRY(kiln_checkpoint_read(c, "probes", first, count, sizeof *w->probes, w->probes, error));
    KILN_TRY(kiln_checkpoint_read(c, "probe_occluders", first, count, sizeof *w->occluders, w->occluders, error));
    KILN_TRY(kiln_checkpoint_read(c, "probe_places", first, count, sizeof *w->places, w->places, error));
    if (w->groups != NULL)
        KILN_TRY(kiln_checkpoint_read(c, "probe_groups", first, count, w->volume->group_count * sizeof *w->groups,
                                      w->groups, error));
    KILN_TRY(kiln_checkpoint_read(c, "probes_done", first, count, 1, w->done, error));
end:
    for (uint64_t i = 0; i < count; i++) {
        if (w->done[i] > KILN_PROBE_COMPLETE)
            w->done[i] = KILN_PROBE_TO_DO;
        w->finished += w->done[i] != KILN_PROBE_TO_DO;
    }
    for (size_t part = (size_t)rank; status == KILN_OK && part < kiln_checkpoint_files(c); part += (size_t)ranks) {
        uint64_t *rays = NULL, one = 0;
        status = kiln_checkpoint_read_file(c, part, "probe_rays", sizeof *rays, &rays, &one, error);
        *w->rays += one > 0 ? *rays : 0;
        kiln_free(&rays);
    }
    return status;
}

/* Collective. */
static int save(const struct volume_work *w, bool stop, struct kiln_error *error)
{
    const uint64_t first = w->volume->first, count = w->volume->count;
    const struct kiln_array_range blocks[] = {
        {"probes", first, count, sizeof *w->probes, w->probes},
        {"probe_occluders", first, count, sizeof *w->occluders, w->occluders},
        {"probe_places", first, count, sizeof *w->places, w->places},
        {"probes_done", first, count, 1, w->done},
        {"probe_rays", 0, 1, sizeof *w->rays, w->rays},
        {"probe_groups", first, count, w->volume->group_count * sizeof *w->groups, w->groups}};
    const size_t all = sizeof blocks / sizeof *blocks;
    return w->params->save(w->params->context, blocks, w->groups != NULL ? all : all - 1, stop, error);
}

static bool find_next(struct volume_work *w)
{
    while (w->next < w->volume->count && w->done[w->next] != KILN_PROBE_TO_DO)
        w->next++;
    return w->next < w->volume->count;
}

/* kiln_take_results: stores the results of this rank's probes from `first` on. */
static int keep_probes(void *context, size_t first, size_t count, const void *results, struct kiln_error *error)
{
    (void)error;
    const struct volume_work *w = context;
    memcpy(w->probes + (first - w->volume->first), results, count * sizeof *w->probes);
    if (w->groups != NULL)
        memcpy(w->groups + (first - w->volume->first) * w->volume->group_count,
               w->params->groups->answers +
                   (first - w->params->groups->first) * w->volume->group_count * KILN_GROUP_PROBE_FLOATS,
               count * w->volume->group_count * sizeof *w->groups);
    return KILN_OK;
}

/* Gathers the next probes that have not been gathered yet. */
static int gather_batch(struct volume_work *w, double *seconds, struct kiln_error *error)
{
    const struct kiln_volume_params *p = w->params;
    const double start = MPI_Wtime();
    const uint64_t first = w->next;
    uint64_t count = 0;
    for (; first + count < w->volume->count && count < w->batch && w->done[first + count] == KILN_PROBE_TO_DO; count++)
        w->positions[count] = position_of(w->volume, p->scene->header->centre, w->volume->first + first + count);
    const struct kiln_batch items = {.first = w->volume->first + first,
                                     .count = count,
                                     .positions = w->positions,
                                     .samples = p->samples,
                                     .take = keep_probes,
                                     .context = w};
    const struct kiln_probe_parameters parameters = {.leaves = w->leaves};
    double reach[3];
    for (int a = 0; a < 3; a++)
        reach[a] = REACH * 0.5 * w->volume->spacing[a];
    int status =
        kiln_probe_places_find(p->backend, p->geometry, w->positions, count, reach, w->places + first, w->rays, error);
    if (status == KILN_OK)
        status = kiln_backend_run(p->backend, &kiln_pass_probes, &parameters, &items, w->rays, error);
    if (status == KILN_OK)
        status =
            kiln_occluders_find(p->backend, p->geometry, w->positions, count, w->occluders + first, w->rays, error);
    if (status == KILN_OK)
        memset(w->done + first, KILN_PROBE_GATHERED, count);
    w->next += count;
    w->finished += count;
    kiln_progress_advance(p->progress, w->finished);
    *seconds = MPI_Wtime() - start;
    const double wanted = kiln_control_batch_seconds(p->control);
    if (*seconds < 0.5 * wanted)
        w->batch = 2 * w->batch < w->batch_most ? 2 * w->batch : w->batch_most;
    else if (*seconds > 2.0 * wanted && w->batch > 1)
        w->batch /= 2;
    return status;
}

/* Runs until all ranks are done or the control ends the pass. */
static int gather_all(struct volume_work *w, struct kiln_error *error)
{
    const struct kiln_volume_params *p = w->params;
    int status = kiln_backend_set_radiosity(p->backend, p->radiosity, error);
    for (;;) {
        enum kiln_event event;
        if (status == KILN_OK && find_next(w)) {
            double seconds = 0.0;
            status = gather_batch(w, &seconds, error);
            event = kiln_control_poll(p->control, !find_next(w), (double)w->finished / (double)w->volume->count,
                                      seconds, status);
        } else {
            event = kiln_control_wait(p->control, true, 1.0, status, NULL, NULL);
        }
        if (event == KILN_EVENT_FAIL || event == KILN_EVENT_DONE)
            return kiln_agree(p->communicator, status, error);
        if (event == KILN_EVENT_SAVE || event == KILN_EVENT_STOP) {
            const int saved = save(w, event == KILN_EVENT_STOP, error);
            if (saved != KILN_OK)
                return saved;
        }
    }
}

/* Implements the callback of struct kiln_probe_paths_params that saves between iterations. */
static int save_between(void *context, bool stop, struct kiln_error *error) { return save(context, stop, error); }

/* Collective. */
static int add_paths(struct volume_work *w, struct kiln_error *error)
{
    const struct kiln_volume_params *p = w->params;
    const struct kiln_probe_paths_params paths = {.communicator = p->communicator,
                                                  .backend = p->backend,
                                                  .scene = p->scene,
                                                  .settings = p->light,
                                                  .leaves = w->leaves,
                                                  .samples = p->samples,
                                                  .progress = p->progress,
                                                  .control = p->control,
                                                  .save = save_between,
                                                  .context = w};
    return w->leaves != 0 ? kiln_probe_paths_add(&paths, w->volume, w->probes, w->done, w->rays, error) : KILN_OK;
}

int kiln_volume_save_all(const struct kiln_volume_result *volume, const struct kiln_volume_params *params,
                         uint64_t *rays, struct kiln_error *error)
{
    struct volume_work w = {.params = params, .volume = (struct kiln_volume_result *)(uintptr_t)volume, .rays = rays};
    w.probes = (struct kiln_probe_result *)(uintptr_t)volume->probes;
    w.occluders = (struct kiln_probe_occluders *)(uintptr_t)volume->occluders;
    w.places = (struct kiln_probe_place *)(uintptr_t)volume->places;
    w.groups = (struct kiln_probe_group *)(uintptr_t)volume->groups;
    int status;
    KILN_TRY(kiln_agree(params->communicator, kiln_allocate(&w.done, volume->count, 1, "the probes", error), error));
    if (volume->count > 0)
        memset(w.done, KILN_PROBE_COMPLETE, volume->count);
    KILN_TRY(save(&w, true, error));
end:
    kiln_free(&w.done);
    return status;
}

static int make_groups(struct volume_work *w, struct kiln_error *error)
{
    const struct kiln_groups *groups = w->params->groups;
    if (groups == NULL)
        return KILN_OK;
    w->volume->group_count = groups->lights->count;
    w->volume->group_names = w->params->group_names;
    const int status = kiln_allocate(&w->groups, (size_t)w->volume->count * w->volume->group_count, sizeof *w->groups,
                                     "the light of groups at probes", error);
    w->volume->groups = w->groups;
    return status;
}

/* Collective. Fills the groups' light of buried probes from the same neighbours as all light. */
static int fill_groups(struct volume_work *w, struct kiln_error *error)
{
    struct kiln_volume_result one = *w->volume;
    struct kiln_probe_result *probes = NULL;
    const size_t count = w->volume->group_count;
    int status = w->groups != NULL
                     ? kiln_allocate(&probes, w->volume->count, sizeof *probes, "the light of groups at probes", error)
                     : KILN_OK;
    status = kiln_agree(w->params->communicator, status, error);
    one.probes = probes;
    for (size_t g = 0; g < count && status == KILN_OK; g++) {
        for (uint64_t i = 0; i < one.count; i++)
            memcpy(&probes[i], &w->groups[i * count + g], sizeof *w->groups);
        status = kiln_probe_fill(w->params->communicator, &one, error);
        for (uint64_t i = 0; i < one.count; i++)
            memcpy(&w->groups[i * count + g], &probes[i], sizeof *w->groups);
    }
    kiln_free(&probes);
    return status;
}

int kiln_volume_run(struct kiln_volume_result *volume, const struct kiln_volume_params *params, uint64_t *rays,
                    struct kiln_error *error)
{
    int rank, ranks;
    (void)MPI_Comm_rank(params->communicator, &rank);
    (void)MPI_Comm_size(params->communicator, &ranks);
    int status = kiln_volume_grid(volume, params->scene, params->spacing, params->bounds, error);
    if (status != KILN_OK)
        return status; /* the same on all ranks */
    const uint64_t total = volume->size[0] * volume->size[1] * volume->size[2];
    volume->first = total * (uint64_t)rank / (uint64_t)ranks;
    volume->count = total * ((uint64_t)rank + 1) / (uint64_t)ranks - volume->first;
    struct volume_work w = {
        .params = params, .volume = volume, .batch_most = batch_size(params->samples), .rays = rays};
    w.batch = 1; /* start with a single probe, which takes up to a second with many samples */
    status = kiln_allocate(&w.probes, volume->count, sizeof *w.probes, "the probes", error);
    if (status == KILN_OK)
        status = kiln_allocate(&w.occluders, volume->count, sizeof *w.occluders, "the probes", error);
    if (status == KILN_OK)
        status = kiln_allocate(&w.places, volume->count, sizeof *w.places, "the probes", error);
    if (status == KILN_OK)
        status = kiln_allocate(&w.done, volume->count, 1, "the probes", error);
    if (status == KILN_OK)
        status = make_groups(&w, error);
    if (status == KILN_OK)
        status = kiln_allocate(&w.positions, w.batch_most, sizeof *w.positions, "probe positions", error);
    volume->probes = w.probes;
    volume->occluders = w.occluders;
    volume->places = w.places;
    if (status == KILN_OK)
        status =
            kiln_probe_paths_leaves(params->light, params->backend->params.lights, params->samples, &w.leaves, error);
    if (status == KILN_OK)
        status = restore(&w, rank, ranks, error);
    status = kiln_agree(params->communicator, status, error);
    kiln_progress_phase(params->progress, "probes", volume->count);
    kiln_control_begin(params->control, "probes");
    if (status == KILN_OK)
        status = gather_all(&w, error);
    if (status == KILN_OK)
        status = add_paths(&w, error);
    if (status == KILN_OK)
        status = kiln_probe_fill(params->communicator, volume, error);
    if (status == KILN_OK)
        status = fill_groups(&w, error);
    kiln_free(&w.positions);
    kiln_free(&w.done);
    return status;
}

int kiln_volume_expect(const struct kiln_integrate_settings *light, struct kiln_backend *backend, uint32_t samples,
                       struct kiln_error *error)
{
    struct kiln_probe_parameters parameters = {0};
    const int status = kiln_probe_paths_leaves(light, backend->params.lights, samples, &parameters.leaves, error);
    if (status != KILN_OK)
        return status;
    kiln_backend_expect(backend, &kiln_pass_probes, &parameters);
    return kiln_probe_paths_expect(light, backend, parameters.leaves, error);
}

void kiln_volume_destroy(struct kiln_volume_result *volume)
{
    struct kiln_probe_result *probes = (struct kiln_probe_result *)(uintptr_t)volume->probes;
    struct kiln_probe_occluders *occluders = (struct kiln_probe_occluders *)(uintptr_t)volume->occluders;
    struct kiln_probe_place *places = (struct kiln_probe_place *)(uintptr_t)volume->places;
    struct kiln_probe_group *groups = (struct kiln_probe_group *)(uintptr_t)volume->groups;
    kiln_free(&probes);
    kiln_free(&occluders);
    kiln_free(&places);
    kiln_free(&groups);
    volume->groups = NULL;
    volume->probes = NULL;
    volume->occluders = NULL;
    volume->places = NULL;
}
