#include "coordinator/bake/light/density_check.h"

#include <math.h>

#include "coordinator/field/field.h"
#include "coordinator/bake/settings/light_settings.h"
#include "coordinator/mpi/agree.h"
#include "worker/base/color.h"
#include "worker/base/memory.h"

/* Samples of the coarse solve where it has many points: means over whole objects are wanted to 1 %, not texels. With
 * fewer than ENOUGH_POINTS there are more samples, up to SAMPLES_TIMES as many. */
enum { SAMPLES_DIRECT = 16, SAMPLES_BOUNCE = 4, SAMPLES_INDIRECT = 16, SAMPLES_TIMES = 16, ENOUGH_POINTS = 1 << 14 };
/* Maximum number of bounces of the coarse solve; a tail estimate follows them. */
enum { MOST_BOUNCES = 12 };
/* Objects darker than this fraction of the scene's mean are left out: changes in them are not visible. */
static const double DARKEST = 1e-3;

/* Sums of one object: area (m2), light (W) and variance (W2). */
struct sums {
    struct kiln_exact_sum area, light, variance;
};

/* Quantization steps of the fixed-point sums. */
struct units {
    double area, light, variance;
};

enum { SUMS = sizeof(struct sums) / sizeof(struct kiln_exact_sum) };

/* Adds this rank's points [first, first + count) of one tile run. */
static void add_tile_run(struct sums *sums, const struct units *units, const struct kiln_solution *solution,
                         uint64_t first, uint32_t count)
{
    const struct kiln_surface *s = &solution->own->surface;
    for (uint64_t i = first; i < first + count; i++) {
        if (!kiln_point_valid(s, (struct kiln_own_point){i}))
            continue;
        const double area = (double)s->area[i];
        double rgb[3];
        for (size_t c = 0; c < 3; c++)
            rgb[c] = (double)solution->direct[3 * i + c] + (double)solution->indirect[3 * i + c] +
                     (solution->own->caustic != NULL ? (double)solution->own->caustic[3 * i + c] : 0.0);
        const double error = area * (double)kiln_error_unpack(solution->error[i]);
        kiln_exact_add(&sums->area, area, 1.0 / units->area);
        kiln_exact_add(&sums->light, area * kiln_luminance(rgb), 1.0 / units->light);
        kiln_exact_add(&sums->variance, error * error, 1.0 / units->variance);
    }
}

/* Collective. The sums of each object over all ranks. */
static int add_up(struct sums *sums, size_t objects, const struct units *units, MPI_Comm communicator,
                  const struct kiln_solution *solution, struct kiln_error *error)
{
    const struct kiln_surface *s = &solution->own->surface;
    for (size_t i = 0; i < s->tile_run_count; i++) {
        const struct kiln_tile_run *run = &s->tile_runs[i];
        if (!kiln_map_back(s, run->map))
            add_tile_run(&sums[kiln_map_object(s, run->map)], units, solution, run->first.at - s->first.at, run->count);
    }
    return kiln_exact_reduce(communicator, &sums[0].area, SUMS * objects, error);
}

static double mean_of(const struct sums *s, const struct units *units)
{
    const double area = kiln_exact_value(&s->area, units->area);
    return area > 0.0 ? kiln_exact_value(&s->light, units->light) / area : 0.0;
}

static double variance_of(const struct sums *s, const struct units *units)
{
    const double area = kiln_exact_value(&s->area, units->area);
    return area > 0.0 ? kiln_exact_value(&s->variance, units->variance) / (area * area) : 0.0;
}

/* Compares the sums of the bake with those of the coarse solve, object by object. */
static void judge(struct kiln_density_check *check, const struct sums *fine, const struct sums *coarse, size_t objects,
                  const struct units *units)
{
    double area = 0.0, light = 0.0;
    for (size_t i = 0; i < objects; i++) {
        area += kiln_exact_value(&fine[i].area, units->area);
        light += kiln_exact_value(&fine[i].light, units->light);
    }
    for (size_t i = 0; i < objects; i++) {
        struct kiln_density_object *o = &check->objects[i];
        o->mean = mean_of(&fine[i], units);
        o->coarse = mean_of(&coarse[i], units);
        o->error = sqrt(variance_of(&fine[i], units) + variance_of(&coarse[i], units));
        if (!(o->mean * area > DARKEST * light) || coarse[i].area.value == 0)
            continue;
        o->moves = fabs(o->coarse - o->mean) / (exp2(KILN_DENSITY_ORDER) * o->mean);
        check->count += o->moves > KILN_DENSITY_MOST;
    }
}

/* Collective. */
static int compare(struct kiln_density_check *check, size_t objects, const struct kiln_integrate_params *params,
                   const struct kiln_solution *fine, const struct kiln_solution *coarse, struct kiln_error *error)
{
    const double power = kiln_luminance(params->emission->emitted), light = kiln_exact_unit(power);
    const struct units units = {kiln_exact_unit(params->area), light, kiln_exact_unit(power * power)};
    struct sums *sums = NULL;
    int status = kiln_allocate(&sums, 2 * objects, sizeof *sums, "objects' means", error);
    if (status == KILN_OK)
        status = kiln_allocate(&check->objects, objects, sizeof *check->objects, "objects' means", error);
    status = kiln_agree(params->communicator, status, error);
    if (status == KILN_OK)
        status = add_up(sums, objects, &units, params->communicator, fine, error);
    if (status == KILN_OK)
        status = add_up(sums + objects, objects, &units, params->communicator, coarse, error);
    if (status == KILN_OK)
        judge(check, sums, sums + objects, objects, &units);
    kiln_free(&sums);
    return status;
}

/* The job's settings with few samples, and nothing but light. `bounces`: how many the bake took. */
static struct kiln_integrate_settings coarse_settings(const struct kiln_job *job, const struct kiln_prepared *coarse,
                                                      uint32_t bounces)
{
    const uint64_t points = coarse->surface->point_count, many = points > 0 ? ENOUGH_POINTS / points : 0;
    const uint32_t times = many < 1 ? 1 : many < SAMPLES_TIMES ? (uint32_t)many : SAMPLES_TIMES;
    struct kiln_integrate_settings s = kiln_light_settings(job, coarse->lights, points);
    s.samples_direct = SAMPLES_DIRECT * times;
    s.samples_bounce = SAMPLES_BOUNCE * times;
    s.samples_indirect = SAMPLES_INDIRECT * times;
    if (s.bounces < 0 || s.bounces > MOST_BOUNCES) {
        s.tail = s.tail || s.bounces < 0;
        s.bounces = bounces < MOST_BOUNCES ? bounces : MOST_BOUNCES;
    }
    s.parts = 1;
    s.target_error = s.published_error = 0.0;
    s.indirect_scale = s.final_scale = 1;
    s.occlusion = NULL;
    s.directional = KILN_DIRECTIONAL_NONE;
    s.faults = (struct kiln_faults){0};
    return s;
}

/* Collective. Solves at half the density and compares. */
static int solve(struct kiln_density_check *check, const struct kiln_prepared *coarse, const struct kiln_job *job,
                 const struct kiln_integrate_params *of_bake, const struct kiln_solution *solution,
                 struct kiln_error *error)
{
    const struct kiln_integrate_settings settings = coarse_settings(job, coarse, solution->report.bounces);
    struct kiln_job plain = *job; /* asks for no fields but light */
    struct kiln_field_set fields;
    struct kiln_solution *solved = NULL;
    plain.lightmaps.error_map = false;
    plain.scene.group_count = 0;
    plain.light.target_error = plain.light.published_error = 0.0;
    plain.light.indirect_scale = plain.light.final_scale = 0;
    plain.lightmaps.denoise = KILN_DENOISE_NONE;
    plain.light.occlusion.distance = 0.0;
    plain.light.directional = KILN_DIRECTIONAL_NONE;
    kiln_field_set_choose(&fields, &plain);
    struct kiln_integrate_params params = *of_bake;
    params.beside = NULL;
    params.settings = &settings;
    params.fields = &fields;
    params.backend = coarse->backend;
    params.surface = coarse->surface;
    params.node = coarse->node;
    params.progress = NULL;
    params.checkpoint = NULL;
    params.identity = NULL;
    params.trace = NULL;
    params.groups = NULL;
    int status = kiln_integrate(&solved, &params, error);
    if (status == KILN_OK)
        status = compare(check, coarse->scene->object_count, &params, solution, solved, error);
    check->points = coarse->surface->point_count;
    kiln_solution_destroy(&solved);
    return status;
}

int kiln_density_check_run(struct kiln_density_check *check, const struct kiln_prepared *prepared,
                           const struct kiln_job *job, const struct kiln_integrate_params *params,
                           const struct kiln_solution *solution, struct kiln_error *error)
{
    struct kiln_prepared *coarse = NULL;
    const double begin = MPI_Wtime();
    check->wanted = true;
    int status = kiln_prepare_coarser(&coarse, prepared, job, params->control, error);
    if (status == KILN_OK)
        status = solve(check, coarse, job, params, solution, error);
    kiln_prepared_destroy(&coarse);
    check->seconds = MPI_Wtime() - begin;
    check->done = status == KILN_OK;
    if (status == KILN_OK || status == KILN_STOPPED)
        return status;
    check->because = *error;
    kiln_free(&check->objects);
    return KILN_OK;
}

void kiln_density_check_release(struct kiln_density_check *check) { kiln_free(&check->objects); }
