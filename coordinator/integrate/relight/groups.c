#include "coordinator/integrate/relight/groups.h"

#include <string.h>

#include "coordinator/field/group_fields.h"
#include "coordinator/integrate/packing.h"
#include "coordinator/mpi/agree.h"
#include "coordinator/integrate/companion.h"
#include "worker/backend/extended.h"
#include "worker/base/memory.h"
#include "worker/light/light_groups.h"
#include "worker/light/sky_patches.h"
#include "worker/pass/groups.h"
#include "worker/scene/radiosity.h"

enum {
    STREAMS = 1 << 20,     /* distance between the random streams of two groups */
    AT_ONCE = 64,          /* points */
    TOTAL_STREAM = 0x10000 /* random stream for rounding total radiosity, the same as in radiosity_exchange.c */
};

struct kiln_group_light {
    const struct kiln_integrate_params *params;
    struct kiln_solution *solution;
    struct kiln_groups channel;
    size_t first; /* field */
    uint64_t *radiosity, *own;
    int *counts, *begins; /* points of each rank */
};

static void *field_of(const struct kiln_group_light *g, const struct kiln_rank_data *data, uint32_t group, int kind)
{
    return kiln_rank_field(data, g->params->fields, g->first + group * KILN_GROUP_FIELDS + (size_t)kind);
}

/* Returns a view of the data with only those fields that the solution of a single group uses. */
static struct kiln_rank_data view_of(const struct kiln_rank_data *data)
{
    struct kiln_rank_data view = *data;
    view.error = view.error_direct = view.error_indirect = view.error_caustic = NULL;
    view.radiosity = view.caustic = view.indirect = view.parts = NULL;
    return view;
}

static void turn_to(const struct kiln_group_light *g, const struct kiln_rank_data *data, uint32_t group,
                    struct kiln_rank_data *view)
{
    view->direct = field_of(g, data, group, KILN_GROUP_DIRECT);
    view->sum = field_of(g, data, group, KILN_GROUP_SUM);
    view->next = field_of(g, data, group, KILN_GROUP_NEXT);
}

int kiln_group_light_create(struct kiln_group_light **light, const struct kiln_integrate_params *params,
                            struct kiln_solution *solution, struct kiln_error *error)
{
    struct kiln_group_light *g = NULL;
    const size_t ranks = (size_t)params->ranks, total = (size_t)params->surface->point_count;
    int status;
    KILN_TRY(kiln_allocate(&g, 1, sizeof *g, "the light of groups", error));
    g->params = params;
    g->solution = solution;
    g->channel.lights = params->groups;
    g->first = kiln_group_fields_first(params->fields);
    KILN_TRY(kiln_allocate(&g->radiosity, total * params->groups->count, sizeof *g->radiosity,
                           "the radiosity of groups", error));
    KILN_TRY(kiln_allocate(&g->counts, ranks, sizeof *g->counts, "the ranges of ranks", error));
    KILN_TRY(kiln_allocate(&g->begins, ranks, sizeof *g->begins, "the ranges of ranks", error));
end:
    *light = g;
    if (status == KILN_OK) {
        g->channel.radiosity = g->radiosity;
        kiln_backend_set_groups(params->backend, &g->channel);
    }
    status = kiln_agree(params->communicator, status, error);
    if (status != KILN_OK)
        kiln_group_light_destroy(light);
    return status;
}

void kiln_group_light_destroy(struct kiln_group_light **light)
{
    struct kiln_group_light *g = *light;
    if (g == NULL)
        return;
    kiln_backend_set_groups(g->params->backend, NULL);
    kiln_free(&g->channel.answers);
    kiln_free(&g->radiosity);
    kiln_free(&g->counts);
    kiln_free(&g->begins);
    kiln_free(light);
}

/* Converts a group's answers to the form of the answers for all light. */
static void answers_of(const struct kiln_group_light *g, const struct kiln_tile_run *run, uint32_t group,
                       const struct kiln_point_result *all, struct kiln_point_result of[KILN_TILE_TEXELS])
{
    const size_t count = g->channel.lights->count;
    const float *from = g->channel.answers + ((run->first.at - g->channel.first) * count + group) * KILN_GROUP_FLOATS;
    for (uint32_t k = 0; k < run->count; k++, from += count * KILN_GROUP_FLOATS) {
        of[k] = (struct kiln_point_result){.count = all[k].count, .present = all[k].present};
        memcpy(of[k].incident, from, sizeof of[k].incident);
        memcpy(of[k].irradiance, from + 3, sizeof of[k].irradiance);
    }
}

void kiln_group_light_take(const struct kiln_group_light *g, const struct kiln_taking *taking,
                           const struct kiln_rank_data *data, const struct kiln_tile_run *run, const void *results)
{
    struct kiln_point_result of[KILN_TILE_TEXELS];
    if (g == NULL || taking->step->quantity != NULL)
        return;
    struct kiln_rank_data view = view_of(data);
    for (uint32_t group = 0; group < g->channel.lights->count; group++) {
        turn_to(g, data, group, &view);
        struct kiln_step step = *taking->step;
        struct kiln_taking own = *taking;
        step.compact = false;
        own.step = &step;
        own.rounding = (group + 1) * STREAMS;
        answers_of(g, run, group, results, of);
        taking->settings->integrator->take(&own, &view, run, of, NULL, NULL);
        const uint64_t first = 3 * kiln_own_of_global(&data->surface, run->first).at;
        for (uint64_t i = first; step.terminal && i < first + 3 * (uint64_t)run->count; i++)
            view.sum[i] += view.direct[i];
    }
}

/* Collective. Finds the ranks' ranges of points, which may have moved. */
static void find_ranges(const struct kiln_group_light *g)
{
    const struct kiln_surface *s = &g->solution->own->surface;
    const int mine[2] = {(int)s->count, (int)s->first.at};
    (void)MPI_Allgather(&mine[0], 1, MPI_INT, g->counts, 1, MPI_INT, g->params->communicator);
    (void)MPI_Allgather(&mine[1], 1, MPI_INT, g->begins, 1, MPI_INT, g->params->communicator);
}

/* Collective. Gathers `radiosity` of all ranks on all ranks. */
static void share(struct kiln_group_light *g)
{
    MPI_Datatype point;
    g->channel.changed = true;
    find_ranges(g);
    (void)MPI_Type_contiguous((int)g->channel.lights->count, MPI_UINT64_T, &point);
    (void)MPI_Type_commit(&point);
    (void)MPI_Allgatherv(MPI_IN_PLACE, 0, point, g->radiosity, g->counts, g->begins, point, g->params->communicator);
    (void)MPI_Type_free(&point);
}

struct kiln_groups *kiln_group_light_total(struct kiln_group_light *g)
{
    const struct kiln_rank_data *own = g->solution->own;
    const uint64_t count = g->channel.lights->count;
#pragma omp parallel for schedule(static)
    for (size_t f = 0; f < own->surface.tile_run_count; f++) {
        const struct kiln_tile_run *run = &own->surface.tile_runs[f];
        struct kiln_own_point at = kiln_own_of_global(&own->surface, run->first);
        for (uint64_t rest = run->mask; rest != 0; rest &= rest - 1, at.at++) {
            float albedo[3], total[3];
            kiln_point_albedo(&own->surface, at, albedo);
            for (uint32_t group = 0; group < count; group++) {
                const float *sum = (const float *)field_of(g, own, group, KILN_GROUP_SUM) + 3 * at.at;
                const uint32_t hash =
                    kiln_packing_hash(run, (uint32_t)__builtin_ctzll(rest), TOTAL_STREAM + (group + 1) * STREAMS);
                for (int c = 0; c < 3; c++)
                    total[c] = albedo[c] * sum[c];
                g->radiosity[(own->surface.first.at + at.at) * count + group] = kiln_radiosity_pack(total, hash);
            }
        }
    }
    share(g);
    return &g->channel;
}

/* Exchanges this rank's points from `begin` to `end`. In the ranks' data each group's radiosity is separate; for the
 * rays that read it, the groups of a point are adjacent. */
static void exchange_some(const struct kiln_group_light *g, uint64_t begin, uint64_t end, bool restored)
{
    const struct kiln_rank_data *own = g->solution->own;
    const uint64_t count = g->channel.lights->count;
    uint64_t *together = g->radiosity + (own->surface.first.at + begin) * count;
    for (uint32_t group = 0; group < count; group++) {
        uint64_t *source = field_of(g, own, group, KILN_GROUP_SOURCE);
        if (!restored)
            memcpy(source + begin, (uint64_t *)field_of(g, own, group, KILN_GROUP_NEXT) + begin,
                   (end - begin) * sizeof *source);
        for (uint64_t i = begin; i < end; i++)
            together[(i - begin) * count + group] = source[i];
    }
}

void kiln_group_light_exchange(struct kiln_group_light *g, bool restored)
{
    if (g == NULL)
        return;
    const uint64_t points = g->solution->own->surface.count;
#pragma omp parallel for schedule(static)
    for (uint64_t begin = 0; begin < points; begin += AT_ONCE)
        exchange_some(g, begin, begin + AT_ONCE < points ? begin + AT_ONCE : points, restored);
    share(g);
}

void kiln_group_light_each(const struct kiln_group_light *g, void (*change)(const struct kiln_rank_data *own))
{
    if (g == NULL)
        return;
    struct kiln_rank_data view = view_of(g->solution->own);
    for (uint32_t group = 0; group < g->channel.lights->count; group++) {
        turn_to(g, g->solution->own, group, &view);
        change(&view);
    }
}

void kiln_group_light_extend(const struct kiln_group_light *g, struct kiln_own_point first, uint64_t count,
                             const float factor[3])
{
    for (uint32_t group = 0; g != NULL && group < g->channel.lights->count; group++) {
        const uint64_t *next = field_of(g, g->solution->own, group, KILN_GROUP_NEXT);
        float *sum = field_of(g, g->solution->own, group, KILN_GROUP_SUM);
        for (uint64_t i = first.at; i < first.at + count; i++) {
            float last[3];
            kiln_radiosity_unpack(next[i], last);
            for (uint64_t c = 0; c < 3; c++)
                sum[3 * i + c] += factor[c] * last[c];
        }
    }
}

/* ---- the companion ---- */

static bool groups_wanted(const struct kiln_integrate_params *params) { return params->groups != NULL; }

static int settle(void **self, const struct kiln_companion_site *site, struct kiln_error *error)
{
    struct kiln_group_light *g = NULL;
    const int status = kiln_group_light_create(&g, site->params, site->solution, error);
    *self = g;
    return status;
}

static void destroy(void **self)
{
    struct kiln_group_light *g = *self;
    kiln_group_light_destroy(&g);
    *self = NULL;
}

static void take(const void *self, const struct kiln_taking *taking, const struct kiln_rank_data *data,
                 const struct kiln_tile_run *tile_run, const void *results)
{
    kiln_group_light_take(self, taking, data, tile_run, results);
}

static void exchange(void *self, bool restored) { kiln_group_light_exchange(self, restored); }

static void each_light(const void *self, void (*change)(const struct kiln_rank_data *own))
{
    kiln_group_light_each(self, change);
}

static void extend(const void *self, struct kiln_own_point first, uint64_t count, const float factor[3])
{
    kiln_group_light_extend(self, first, count, factor);
}

/* The groups of lights, in the order of their layers; of patches of the sky where they are, away from the scene, sr. */
static json_t *groups_json(const struct kiln_job *job)
{
    const uint32_t patches = kiln_sky_patches[job->scene.sky_patches],
                   divisions = kiln_sky_divisions[job->scene.sky_patches];
    const size_t first = patches > 0 ? job->scene.group_count - 2 - patches : job->scene.group_count;
    json_t *array = json_array();
    for (size_t g = 0; g < job->scene.group_count; g++) {
        json_t *group = json_pack("{s:s}", "name", job->scene.group_names[g]);
        double steradians;
        if (g >= first && g < first + patches) {
            const struct kiln_dvec3 d = kiln_sky_patch_middle((uint32_t)(g - first), divisions, &steradians);
            (void)json_object_set_new(group, "direction", json_pack("[f, f, f]", d.x, d.y, d.z));
            (void)json_object_set_new(group, "steradians", json_real(steradians));
        }
        (void)json_array_append_new(array, group);
    }
    return array;
}

static void report(const struct kiln_companion_told *told, json_t *json)
{
    if (told->job->scene.group_count > 0)
        (void)json_object_set_new(json, "light_groups", groups_json(told->job));
    if (told->job->scene.grouped != NULL)
        (void)json_object_set_new(json, "light_group_rules", json_loads(told->job->scene.grouped, 0, NULL));
}

/* The groups are what the file says, wherever it lies. */
static void identify(const struct kiln_job *job, json_t *fields)
{
    if (job->scene.grouped != NULL)
        (void)json_object_set_new(fields, "light groups", json_string(job->scene.grouped));
}

static const char *const identity[] = {"sky-patches", NULL};
static const char *const no_identity[] = {"light-groups", NULL};

const struct kiln_companion kiln_companion_groups = {.name = "groups",
                                                     .identity = identity,
                                                     .no_identity = no_identity,
                                                     .wanted = groups_wanted,
                                                     .settle = settle,
                                                     .destroy = destroy,
                                                     .take = take,
                                                     .exchange = exchange,
                                                     .each_light = each_light,
                                                     .extend = extend,
                                                     .identify = identify,
                                                     .report = {[KILN_REPORT_FILES] = report}};
