/* Run by mpirun on two ranks: the lockstep runner takes an integrator that it does not know, which is no more than the
 * struct below, and computes direct light and one bounce of cubes under a sky with it, the bounce with samples that a
 * field says for each tile run. The integrator "cells" must find the same bits by its equal schedule.
 *
 * Beside both goes a companion that the runner does not know either: it is asked once before and once after each step,
 * takes the answers of each point once a step, and leaves every second tile run out of the steps that name it. The
 * table of companions is this one's in all of the program, so that what plans, reports and tells bakes apart walks it,
 * and shows what they have to say. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "coordinator/bake/identity/identity.h"
#include "coordinator/bake/report/run_report.h"
#include "coordinator/files/foreign_json.h"
#include "coordinator/integrate/companion.h"
#include "coordinator/integrate/packing.h"
#include "coordinator/integrate/run/radiosity_exchange.h"
#include "coordinator/mpi/agree.h"
#include "coordinator/surface/surface_build.h"
#include "tests/unit/surface_scene.h"
#include "worker/backend/emission.h"
#include "worker/light/lights.h"
#include "worker/scene/radiosity.h"

enum { RANKS = 2, SAMPLES = 16 };

/* ---- the integrator ---- */

static const struct kiln_field samples_field = {.name = "test_samples",
                                                .unit = "1",
                                                .type = KILN_FIELD_UINT32,
                                                .components = 1,
                                                .domain = KILN_DOMAIN_TILE_RUN,
                                                .life = KILN_FIELD_RESULT};

static bool pair_next(const struct kiln_integrate_settings *settings, const struct kiln_step_report *reports,
                      size_t count, struct kiln_step *step)
{
    (void)reports;
    *step = (struct kiln_step){.pass = count == 0 ? &kiln_pass_direct : &kiln_pass_gather,
                               .role = count > 0,
                               .bounce = (uint32_t)count,
                               .samples = settings->samples_indirect,
                               .samples_field = count == 0 ? NULL : samples_field.name,
                               .stream = (uint32_t)count,
                               .counted = true};
    return count < 2;
}

static int pair_begin(struct kiln_integration *integration, struct kiln_step_report *last, const struct kiln_step *step,
                      struct kiln_error *error)
{
    (void)error;
    const struct kiln_solution *solution = integration->solution;
    const struct kiln_field_set *fields = kiln_node_data_fields(solution->node_data);
    uint32_t *samples = kiln_rank_field(solution->own, fields, kiln_field_set_find(fields, samples_field.name));
    for (size_t i = 0; i < solution->own->surface.tile_run_count; i++)
        samples[i] = step->samples;
    if (step->pass->reads_radiosity)
        kiln_exchange_radiosity(integration->exchange, KILN_EXCHANGE_NEXT, last);
    return KILN_OK;
}

static void pair_take(const struct kiln_taking *t, const struct kiln_rank_data *data, const struct kiln_tile_run *f,
                      const void *answers, struct kiln_tally *tally, struct kiln_tile_run_tally *tile_run_tally)
{
    const struct kiln_surface *surface = &data->surface;
    const struct kiln_point_result *results = answers;
    float *values = !t->step->pass->reads_radiosity ? data->direct : data->sum;
    struct kiln_own_point own = kiln_own_of_global(surface, f->first);
    for (uint64_t rest = f->mask; rest != 0; rest &= rest - 1, own.at++, results++) {
        float albedo[3], radiosity[3], sent[3];
        const struct kiln_point_mean mean = kiln_point_mean(results);
        kiln_point_albedo(surface, own, albedo);
        kiln_radiosity_unpack(t->radiosity[kiln_global_of_own(surface, own).at], sent);
        for (int c = 0; c < 3; c++) {
            radiosity[c] = albedo[c] * mean.incident[c];
            values[3 * own.at + (uint64_t)c] = mean.irradiance[c];
        }
        data->next[own.at] =
            kiln_radiosity_pack(radiosity, kiln_packing_hash(f, (uint32_t)__builtin_ctzll(rest), t->step->stream));
        const struct kiln_ledger_point point = {
            .area = (double)surface->area[own.at] * ((double)surface->visible[own.at] / 65535.0) * (double)mean.present,
            .albedo = albedo,
            .sent = t->step->pass->reads_radiosity ? sent : NULL};
        if (kiln_point_valid(surface, own))
            kiln_tally_add(&point, &mean, t->unit, tally, tile_run_tally);
    }
}

static int pair_end(struct kiln_integration *integration, struct kiln_step_reports *reports, struct kiln_error *error)
{
    (void)integration;
    (void)reports;
    (void)error;
    return KILN_OK;
}

static const struct kiln_role roles[] = {{"sky", "sky", "the sky", "the sky", false, false},
                                         {"rest", "rest", "the rest", "the rest", true, false}};
static const struct kiln_integrator pair = {.name = "pair",
                                            .roles = roles,
                                            .role_count = 2,
                                            .next = pair_next,
                                            .begin_step = pair_begin,
                                            .take = pair_take,
                                            .end_step = pair_end};

/* ---- the companion ---- */

/* How often each was asked; points on this rank, by whoever took them. */
struct visits {
    uint32_t created, settled, before, complete, after, closed, ended, destroyed;
    uint64_t points;
};
static struct visits visits;

static bool visitor_wanted(const struct kiln_integrate_params *params)
{
    (void)params;
    return true;
}

static int visitor_create(void **self, const struct kiln_companion_site *site, struct kiln_error *error)
{
    (void)site;
    (void)error;
    *self = &visits;
    visits = (struct visits){.created = 1};
    return KILN_OK;
}

static void visitor_destroy(void **self)
{
    visits.destroyed++;
    *self = NULL;
}

static int visitor_settle(void **self, const struct kiln_companion_site *site, struct kiln_error *error)
{
    (void)error;
    ((struct visits *)*self)->settled += site->solution->own != NULL;
    return KILN_OK;
}

static int visitor_before(void *self, const struct kiln_companion_site *site, struct kiln_error *error)
{
    (void)site;
    (void)error;
    ((struct visits *)self)->before++;
    return KILN_OK;
}

static int visitor_complete(void *self, const struct kiln_companion_site *site, struct kiln_error *error)
{
    (void)site;
    (void)error;
    ((struct visits *)self)->complete++;
    return KILN_OK;
}

static int visitor_after(void *self, const struct kiln_companion_site *site, double unit, struct kiln_error *error)
{
    (void)site;
    (void)error;
    ((struct visits *)self)->after += unit > 0.0;
    return KILN_OK;
}

static int visitor_end(void *self, const struct kiln_companion_site *site, struct kiln_error *error)
{
    (void)site;
    (void)error;
    ((struct visits *)self)->ended++;
    return KILN_OK;
}

static void visitor_take(const void *self, const struct kiln_taking *taking, const struct kiln_rank_data *data,
                         const struct kiln_tile_run *tile_run, const void *results)
{
    (void)self;
    (void)taking;
    (void)data;
    (void)results;
    (void)__atomic_fetch_add(&visits.points, tile_run->count, __ATOMIC_RELAXED);
}

/* ---- what the companion says of itself ---- */

/* Sees that the ledger would take all light that points reflect as sent. */
static void visitor_close(const struct kiln_companion_site *site, struct kiln_energy_closing *closing)
{
    (void)site;
    visits.closed += closing->albedo_scale == 1.0;
}

static void visitor_identify(const struct kiln_job *job, json_t *fields)
{
    (void)job;
    (void)json_object_set_new(fields, "visits", json_string("of all points"));
}

static void visitor_count(const struct kiln_solution *solution, uint64_t counts[KILN_COMPANION_COUNTS])
{
    counts[1] = solution->own->surface.count;
}

static void visitor_settings(const struct kiln_companion_told *told, json_t *json)
{
    (void)json_object_set_new(json, "visits_asked", json_integer(told->job->plan.ranks));
}

static void visitor_ranks(const struct kiln_companion_told *told, json_t *json)
{
    (void)json_object_set_new(json, "visits", json_integer((json_int_t)told->counts[1]));
}

static int visitor_measure(const struct kiln_companion_sample *sample, struct kiln_companion_measured *measured,
                           struct kiln_error *error)
{
    static const char *const dark[] = {"direct", NULL};
    (void)error;
    measured->seconds = 2.0 * (double)sample->points;
    measured->dark = dark;
    measured->dark_share = 0.25;
    measured->json = json_pack("{s:i}", "ranks", (int)sample->ranks);
    return KILN_OK;
}

/* A byte for each second that was measured. */
static void visitor_demand(const struct kiln_companion_demand *demand, struct kiln_companion_bytes *bytes)
{
    bytes->in_step += (uint64_t)demand->measured->seconds;
}

static uint64_t visitor_saved(const struct kiln_integrate_settings *settings)
{
    (void)settings;
    return 3;
}

static const char *const visitor_identity[] = {"seed", NULL}, *const visitor_no_identity[] = {"no such option", NULL};

static const struct kiln_companion visitor = {
    .name = "visitor",
    .identity = visitor_identity,
    .no_identity = visitor_no_identity,
    .close = visitor_close,
    .identify = visitor_identify,
    .count = visitor_count,
    .report = {[KILN_REPORT_SETTINGS] = visitor_settings, [KILN_REPORT_RANKS] = visitor_ranks},
    .measure = visitor_measure,
    .demand = visitor_demand,
    .saved_bytes = visitor_saved,
    .wanted = visitor_wanted,
    .create = visitor_create,
    .destroy = visitor_destroy,
    .settle = visitor_settle,
    .before_step = visitor_before,
    .complete = visitor_complete,
    .after_step = visitor_after,
    .end = visitor_end,
    .take = visitor_take};

static void halve(const struct kiln_integrate_settings *settings, const struct kiln_step *step,
                  const struct kiln_rank_data *data, size_t tile_run, struct kiln_selection *selection)
{
    (void)settings;
    (void)step;
    (void)data;
    selection->computed = tile_run % 2 == 0 ? selection->computed : 0;
}

static const struct kiln_companion half = {.name = "half", .by_step = true, .wanted = visitor_wanted, .select = halve};

/* In the place of kiln's own table. */
const struct kiln_companion *const kiln_companions[] = {&half, &visitor, NULL};
enum { HALF, VISITOR, TABLE };

/* Checks the visits of a bake with two steps and so many points on all ranks. */
static int check_visits(uint64_t points)
{
    uint64_t taken = visits.points;
    struct kiln_step step = {.with = 0};
    int failures = visits.created != 1 || visits.settled != 1 || visits.before != 2 || visits.complete != 2 ||
                   visits.after != 2 || visits.closed != 1 || visits.ended != 1 || visits.destroyed != 1;
    (void)MPI_Allreduce(MPI_IN_PLACE, &taken, 1, MPI_UINT64_T, MPI_SUM, MPI_COMM_WORLD);
    failures += taken != 2 * points;
    failures += kiln_companions_select(kiln_companions, &step);
    step.with = 1;
    failures += !kiln_companions_select(kiln_companions, &step);
    failures += kiln_companions_selection(kiln_companions, NULL, &step, NULL, 0).computed != UINT64_MAX;
    failures += kiln_companions_selection(kiln_companions, NULL, &step, NULL, 1).computed != 0;
    if (failures != 0)
        (void)fprintf(stderr, "a companion was asked %u %u %u %u %u %u %u times, for %llu of 2 x %llu points\n",
                      visits.created, visits.settled, visits.before, visits.complete, visits.after, visits.ended,
                      visits.destroyed, (unsigned long long)taken, (unsigned long long)points);
    return failures;
}

/* Checks what `kiln plan` would say of a bake of so many points. */
static int check_plan(const struct kiln_integrate_params *params, uint64_t points)
{
    const struct kiln_companion_sample sample = {.params = params, .points = points, .ranks = RANKS};
    const struct kiln_companion_demand demand = {.settings = params->settings, .points = points, .ranks = RANKS};
    struct kiln_companion_measured measured[TABLE];
    struct kiln_error error = {""};
    json_t *told = json_object(), *wanted = json_pack("{s:{s:i}}", "visitor", "ranks", RANKS);
    int failures = kiln_companions_measure(kiln_companions, &sample, measured, &error) != KILN_OK;
    kiln_companions_tell_measured(kiln_companions, measured, told);
    failures += json_equal(told, wanted) == 0;
    failures += kiln_companions_demand(kiln_companions, measured, &demand).in_step != 2 * points;
    failures += kiln_companions_saved_bytes(kiln_companions, params) != 3;
    failures += kiln_companions_dark(kiln_companions, measured, "direct") != 0.25;
    failures += kiln_companions_dark(kiln_companions, measured, "indirect") != 0.0;
    kiln_companions_forget(kiln_companions, measured);
    failures += measured[VISITOR].json != NULL;
    json_decref(told);
    json_decref(wanted);
    return failures;
}

/* Checks what run.json would say: on rank 0, of the counts of all ranks. */
static int check_report(const struct kiln_solution *solution, const struct kiln_job *job, int rank)
{
    const struct kiln_companion_told told = {.job = job, .solution = solution};
    uint64_t counts[TABLE * KILN_COMPANION_COUNTS] = {0};
    json_t *json = json_object(),
           *wanted = json_pack("{s:I}", "visits", (json_int_t)solution->own->surface.point_count);
    kiln_companions_count(kiln_companions, solution, counts);
    (void)MPI_Allreduce(MPI_IN_PLACE, counts, TABLE * KILN_COMPANION_COUNTS, MPI_UINT64_T, MPI_SUM, MPI_COMM_WORLD);
    kiln_companions_report(kiln_companions, KILN_REPORT_RANKS, &told, counts, json);
    const int failures = rank == 0 && json_equal(json, wanted) == 0;
    json_decref(json);
    json_decref(wanted);
    return failures;
}

static bool has_text(const json_t *json, const char *key, const char *text)
{
    const char *value = json_string_value(json_object_get(json, key));
    return value != NULL && strcmp(value, text) == 0;
}

/* Checks the identity of a bake, and the settings that kiln.h5 has. */
static int check_identity(const struct kiln_prepared *prepared, const struct kiln_job *job)
{
    bool known[2];
    const bool counts = kiln_identity_counts("seed", &known[0]),
               others = kiln_identity_counts("no such option", &known[1]);
    json_t *identity = kiln_identity_make(job, prepared);
    char *provenance = kiln_provenance(job, prepared);
    int failures = !counts || others || !known[0] || !known[1];
    failures += !has_text(json_object_get(identity, "fields"), "visits", "of all points");
    failures += provenance == NULL || strstr(provenance, "\"visits_asked\":2") == NULL;
    free(provenance);
    json_decref(identity);
    return failures;
}

/* ---- a bake without files ---- */

struct world {
    char folder[64];
    int rank;
    struct fixture *fixture;
    struct kiln_geometry *geometry;
    struct kiln_lights *lights;
    struct kiln_control *control;
    struct kiln_checkpoint *checkpoint;
};

static const volatile sig_atomic_t no_signal = 0;

/* Two cubes in a corner of each other, under a sky. */
static int make_world(struct world *w, struct kiln_error *error)
{
    static const double beside[12] = {1, 0, 0, 2.2, 0, 1, 0, 0.5, 0, 0, 1, -0.4};
    w->fixture = fixture_create();
    w->fixture->environment =
        (struct kiln_environment){.kind = KILN_ENVIRONMENT_CONSTANT, .radiance = {1.0f, 0.5f, 0.25f}};
    const uint32_t cube = fixture_cube(w->fixture, 3, 0.5, fixture_material(w->fixture, 0.5f, 0.25f, 0.75f));
    fixture_object(w->fixture, cube, NULL, 96, 64);
    fixture_object(w->fixture, cube, beside, 64, 48);
    int status = kiln_geometry_create(&w->geometry, &w->fixture->scene, error);
    if (status == KILN_OK)
        status = kiln_lights_create(&w->lights, &w->fixture->scene, w->geometry, error);
    if (w->rank == 0 && mkdtemp(strcpy(w->folder, "/tmp/kiln-integrator-XXXXXX")) == NULL)
        status = kiln_fail_errno(error, KILN_SYSTEM, "no folder");
    (void)MPI_Bcast(w->folder, sizeof w->folder, MPI_CHAR, 0, MPI_COMM_WORLD);
    status = kiln_agree(MPI_COMM_WORLD, status, error);
    const struct kiln_control_params params = {
        .communicator = MPI_COMM_WORLD, .directory = w->folder, .begin = MPI_Wtime(), .signal = &no_signal};
    if (status == KILN_OK)
        status = kiln_control_create(&w->control, &params, error);
    return status == KILN_OK ? kiln_checkpoint_open(&w->checkpoint, MPI_COMM_WORLD, w->folder, false, error) : status;
}

static void free_world(struct world *w)
{
    kiln_checkpoint_close(&w->checkpoint);
    if (w->control != NULL)
        kiln_control_conclude(w->control, KILN_OK, "", true);
    kiln_control_destroy(&w->control);
    if (w->rank == 0)
        (void)rmdir(w->folder);
    kiln_lights_destroy(&w->lights);
    kiln_geometry_destroy(&w->geometry);
    fixture_destroy(w->fixture);
}

/* Result of a bake, by global order: 6 floats a point, and the energies of two steps. */
struct found {
    uint64_t points;
    float *light;
    struct kiln_step_energy energy[2];
    size_t steps;
    int failures; /* of what the companions say of themselves */
};

static int keep(struct found *found, const struct kiln_solution *solution)
{
    const struct kiln_surface *surface = &solution->own->surface;
    *found = (struct found){.points = surface->point_count, .steps = solution->report.steps.count};
    found->light = calloc(6 * found->points, sizeof *found->light);
    for (uint64_t i = 0; i < surface->count; i++) {
        memcpy(found->light + 6 * (surface->first.at + i), solution->direct + 3 * i, 3 * sizeof(float));
        memcpy(found->light + 6 * (surface->first.at + i) + 3, solution->indirect + 3 * i, 3 * sizeof(float));
    }
    for (size_t i = 0; i < 2 && i < found->steps; i++)
        found->energy[i] = solution->report.steps.of[i].energy;
    return KILN_OK;
}

static int check_told(const struct world *w, const struct kiln_integrate_params *params,
                      const struct kiln_solution *solution, const struct kiln_job *job)
{
    struct kiln_prepared prepared = {.scene = &w->fixture->scene,
                                     .geometry = w->geometry,
                                     .lights = w->lights,
                                     .backend = params->backend,
                                     .surface = params->surface,
                                     .instruction_set = "any"};
    const int plan = check_plan(params, params->surface->point_count), report = check_report(solution, job, w->rank),
              identity = check_identity(&prepared, job);
    if (plan + report + identity > 0)
        (void)fprintf(stderr, "a companion does not show: %d in the plan, %d in the report, %d in the identity\n", plan,
                      report, identity);
    return plan + report + identity;
}

static int bake(const struct world *w, const struct kiln_integrator *integrator, struct found *found,
                struct kiln_error *error)
{
    const struct kiln_integrate_settings settings = {.integrator = integrator,
                                                     .schedule = KILN_SCHEDULE_EQUAL,
                                                     .bounces = 1,
                                                     .samples_direct = SAMPLES,
                                                     .samples_indirect = SAMPLES,
                                                     .work_stealing = true};
    const struct kiln_job job = {.plan.ranks = RANKS}; /* asks for no more fields than all bakes have */
    struct kiln_field_set fields;
    kiln_field_set_choose(&fields, &job);
    int status = kiln_field_set_add(&fields, &samples_field, false, error);
    const struct kiln_surface_params surface = {
        .scene = &w->fixture->scene, .geometry = w->geometry, .rank = (uint32_t)w->rank, .ranks = RANKS, .threads = 1};
    const struct kiln_backend_params backend = {
        .scene = &w->fixture->scene, .geometry = w->geometry, .lights = w->lights, .threads = 1};
    struct kiln_integrate_params params = {.communicator = MPI_COMM_WORLD,
                                           .rank = w->rank,
                                           .ranks = RANKS,
                                           .begin = MPI_Wtime(),
                                           .settings = &settings,
                                           .fields = &fields,
                                           .area = 48.0,
                                           .control = w->control,
                                           .checkpoint = w->checkpoint,
                                           .companions = kiln_companions,
                                           .threads = 1};
    struct kiln_emission_result emission;
    struct kiln_surface_report report;
    struct kiln_solution *solution = NULL;
    if (status == KILN_OK)
        status = kiln_surface_build(&params.surface, &surface, &report, error);
    if (status == KILN_OK)
        status = kiln_backend_create(&params.backend, "embree", &backend, error);
    if (status == KILN_OK)
        status = kiln_backend_set_surface(params.backend, params.surface, error);
    if (status == KILN_OK)
        status = kiln_backend_emission(params.backend, 1000, &emission, error);
    params.emission = &emission;
    status = kiln_agree(MPI_COMM_WORLD, status, error);
    if (status == KILN_OK)
        status = kiln_node_create(&params.node, MPI_COMM_WORLD, 0, error);
    if (status == KILN_OK)
        status = kiln_integrate(&solution, &params, error);
    if (status == KILN_OK)
        status = keep(found, solution);
    if (status == KILN_OK)
        found->failures = check_told(w, &params, solution, &job);
    kiln_solution_destroy(&solution);
    kiln_backend_destroy(&params.backend);
    kiln_surface_destroy(&params.surface);
    kiln_node_destroy(&params.node);
    return status;
}

/* ---- the comparison ---- */

static int compare(struct found *a, struct found *b)
{
    double sums[2] = {0.0, 0.0};
    if (a->points != b->points || a->points < 1000 || a->steps != 2 || b->steps != 2) {
        (void)fprintf(stderr, "%llu points in %zu steps, and %llu in %zu\n", (unsigned long long)a->points, a->steps,
                      (unsigned long long)b->points, b->steps);
        return 1;
    }
    const int count = (int)(6 * a->points); /* each point is on one rank; the others have 0 */
    (void)MPI_Allreduce(MPI_IN_PLACE, a->light, count, MPI_FLOAT, MPI_SUM, MPI_COMM_WORLD);
    (void)MPI_Allreduce(MPI_IN_PLACE, b->light, count, MPI_FLOAT, MPI_SUM, MPI_COMM_WORLD);
    for (int i = 0; i < count; i++)
        sums[i % 6 / 3] += (double)a->light[i];
    if (!(sums[0] > 0.0) || !(sums[1] > 0.0)) {
        (void)fprintf(stderr, "no light: direct %g, indirect %g\n", sums[0], sums[1]);
        return 1;
    }
    if (memcmp(a->light, b->light, (size_t)count * sizeof *a->light) != 0 ||
        memcmp(a->energy, b->energy, sizeof a->energy) != 0) {
        (void)fprintf(stderr, "two integrators that compute the same differ\n");
        return 1;
    }
    return 0;
}

int main(int argc, char **argv)
{
    if (argc > 1 && strcmp(argv[1], KILN_JSON_CHILD) == 0) /* which reads manifests of checkpoints */
        return kiln_foreign_json_child(argc, argv, NULL);
    struct world w = {.rank = 0};
    struct found own = {0}, cells = {0};
    struct kiln_error error = {""};
    int size;
    (void)MPI_Init(&argc, &argv);
    (void)MPI_Comm_rank(MPI_COMM_WORLD, &w.rank);
    (void)MPI_Comm_size(MPI_COMM_WORLD, &size);
    if (size != RANKS) {
        (void)fprintf(stderr, "this test wants %d ranks, not %d\n", RANKS, size);
        (void)MPI_Abort(MPI_COMM_WORLD, 1);
    }
    int status = make_world(&w, &error);
    if (status == KILN_OK)
        status = bake(&w, &pair, &own, &error);
    if (status == KILN_OK)
        status = bake(&w, kiln_integrator_find("cells"), &cells, &error);
    if (status != KILN_OK)
        (void)fprintf(stderr, "%s\n", error.message);
    const int failures =
        status == KILN_OK ? compare(&own, &cells) + check_visits(cells.points) + own.failures + cells.failures : 1;
    free(own.light);
    free(cells.light);
    free_world(&w);
    (void)MPI_Finalize();
    return failures;
}
