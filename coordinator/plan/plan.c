#include "coordinator/plan/plan.h"

#include <math.h>
#include <string.h>
#include <time.h>

#include "coordinator/field/field.h"
#include "coordinator/integrate/companion.h"
#include "coordinator/integrate/energy.h"
#include "coordinator/run/process.h"
#include "coordinator/run/process_memory.h"
#include "coordinator/integrate/integrate.h"
#include "coordinator/bake/settings/light_settings.h"
#include "coordinator/bake/volume/occluders.h"
#include "coordinator/bake/reckon/preview_size.h"
#include "coordinator/bake/reckon/work.h"
#include "coordinator/bake/prepare/foretell.h"
#include "coordinator/bake/prepare/results_memory.h"
#include "coordinator/bake/identity/transport_identity.h"
#include "coordinator/bake/volume/volume.h"
#include "coordinator/export/export.h"
#include "coordinator/output/output.h"
#include "coordinator/output/points_ahead.h"
#include "worker/backend/emission.h"
#include "worker/base/memory.h"
#include "worker/pass/probes.h"
#include "worker/scene/radiosity.h"
#include "worker/store/store.h"

/* Tile runs traced per sample: enough for every thread, or to keep a GPU busy. */
enum { THREAD_TILE_RUNS = 4, LEAST_TILE_RUNS = 8, DEVICE_TILE_RUNS = 2048, SAMPLE_PROBES = 256, LEAST_SAMPLES = 8 };
enum { CHEAP_TILE_RUNS = 4 }; /* factor on tile runs for gathers with fewer samples than another kind of step */
static const double CALIBRATION_SECONDS = 15.0;

/* Embree 3.13, robust, medium quality: bytes of BVH a triangle, measured between 32 thousand and 4 million triangles.
 */
static const double BVH_BYTES = 100.0;
static const uint64_t LEAST_PROGRAM_BYTES = 24ull << 20;

/* Denoised lightmaps compress better; in kiln.h5, half of the bits of both errors are zero. */
static const double DENOISE_LIGHTMAP_DISK = 0.87, DENOISE_POINT_DISK = -4.0;

static const double TAKE_POINT_SECONDS = 0.11e-6; /* of one thread, in each pass: entered into results and sums */
/* Bytes per texel of a lightmap in bands, sent to the part that denoises it (output/map/denoise/denoise_parts.h). */
static const double TEXEL_BYTES = 90.0;
static const double H5_PLACE_SECONDS = 3e-6; /* of rank 0 alone: for a column of a chunk of kiln.h5 */
/* Checkpoints. SAVE_BANDWIDTH: bytes per second that a node hashes, writes and syncs. COPY_BYTE_SECONDS: seconds of one
 * thread to copy a byte in the background (--checkpoint-local), to files that the system first keeps in memory. */
static const double SAVE_BANDWIDTH = 1e9, COPY_BYTE_SECONDS = 0.6e-9;
static const double COMPACT_BYTES = 4.0, FULL_BYTES = 8.0; /* of a point's radiosity on its way */
static const double MAP_ENTRY_BYTES = 24.0;                /* of a tile or split, sent from its finder to every rank */
static const double MAP_POINT_SECONDS = 0.5e-9;            /* of a rank, for a point that another found */

/* Compressed bytes, measured over the project's scenes. */
static const double LIGHTMAP_POINT_DISK = 33.0, H5_POINT_DISK = 42.0, PROBE_DISK = 0.85, OCCLUDER_DISK = 0.2,
                    PREVIEW_DISK = 0.4e6;

static struct kiln_field_set fields_of(const struct kiln_job *job)
{
    struct kiln_field_set fields;
    kiln_field_set_choose(&fields, job);
    return fields;
}

static uint64_t rank_surface_bytes(const struct kiln_surface *s, const struct kiln_field_set *fields)
{
    const bool built = s->piece_base != NULL && s->area_cdf_base != NULL && s->tile_run_count > 0;
    const uint64_t items[KILN_DOMAINS] = {[KILN_DOMAIN_TILE_RUN] = s->tile_run_count,
                                          [KILN_DOMAIN_POINT] = s->count,
                                          [KILN_DOMAIN_PIECE] = built ? s->piece_base[s->tile_run_count] : 0,
                                          [KILN_DOMAIN_AREA_CDF] = built ? s->area_cdf_base[s->tile_run_count] : 0};
    return kiln_field_set_bytes(fields, KILN_FIELD_SURFACE, items);
}

static uint64_t all_bytes(const struct kiln_surface *s, const struct kiln_geometry *geometry)
{
    struct kiln_store store;
    kiln_store_build(&store, s, geometry);
    return kiln_store_bytes(&store) + (s->cell_first != NULL ? s->cell_count * sizeof *s->cell_first : 0);
}

static uint64_t section_bytes(const struct kiln_scene *scene, enum kiln_scene_section section)
{
    return scene->header->sections[section].count * kiln_scene_element_size(section);
}

static bool on_device(const struct kiln_prepared *p)
{
    struct kiln_backend_info info;
    kiln_backend_info(p->backend, &info);
    return info.on_device;
}

static uint64_t result_bytes(const struct kiln_plan *plan, const struct kiln_prepared *p, const struct kiln_job *job)
{
    return kiln_results_memory(&(struct kiln_results_size){.scene = p->scene,
                                                           .job = job,
                                                           .ranks = job->plan.ranks,
                                                           .threads = p->threads,
                                                           .own = plan->here.light.points_most,
                                                           .points = (double)plan->surface.points,
                                                           .texels = (double)plan->surface.texels});
}

static void known_memory(struct kiln_plan *plan, const struct kiln_prepared *p)
{
    struct kiln_plan_memory *m = &plan->memory;
    const struct kiln_geometry *g = p->geometry;
    m->textures =
        section_bytes(p->scene, KILN_SECTION_TEXELS) + section_bytes(p->scene, KILN_SECTION_ENVIRONMENT_TEXELS);
    m->scene = p->scene->mapped_bytes - m->textures;
    m->geometry = g->vertex_count * 3 * sizeof *g->vertices +
                  g->triangle_count * (3 * sizeof *g->indices + sizeof *g->records + sizeof *g->stored_triangle);
    m->bvh = on_device(p) ? 0 : (uint64_t)(BVH_BYTES * (double)g->triangle_count);
}

/* Measures the memory of the program itself: all resident memory, less the data that the plan counts by name. Call it
 * before the rank's surface points are built, which would count too. */
static void measure_program(struct kiln_plan *plan, const struct kiln_prepared *p, const struct kiln_job *job)
{
    struct kiln_plan_memory *m = &plan->memory;
    const struct kiln_field_set fields = fields_of(job);
    const uint64_t named = m->textures + m->scene + m->geometry + m->bvh + all_bytes(p->surface, p->geometry) +
                           rank_surface_bytes(p->surface, &fields);
    kiln_process_give_back(); /* what is free is nobody's */
    const uint64_t resident = kiln_process_memory(KILN_MEMORY_NOW);
    m->program = KILN_PASS_BYTES + (resident > named + LEAST_PROGRAM_BYTES ? resident - named : LEAST_PROGRAM_BYTES);
}

/* Memory for the bake's companions. */
static struct kiln_companion_bytes companion_bytes(const struct kiln_plan *plan, const struct kiln_prepared *p,
                                                   const struct kiln_job *job)
{
    const struct kiln_integrate_settings settings = kiln_light_settings(job, p->lights, plan->surface.points);
    const double bvh = on_device(p) ? BVH_BYTES * (double)p->geometry->triangle_count : 0.0;
    const struct kiln_companion_demand demand = {.settings = &settings,
                                                 .points = plan->surface.points,
                                                 .own = plan->here.light.points_most,
                                                 .ranks = job->plan.ranks,
                                                 .device = on_device(p),
                                                 .triangles = p->geometry->triangle_count,
                                                 .host_bvh = (uint64_t)bvh};
    return kiln_companions_demand(kiln_companions, plan->companions, &demand);
}

static void plan_memory(struct kiln_plan *plan, const struct kiln_prepared *p, const struct kiln_surface *rank_surface,
                        const struct kiln_job *job)
{
    struct kiln_plan_memory *m = &plan->memory;
    struct kiln_backend_info info = {0};
    kiln_backend_info(p->backend, &info);
    m->device = on_device(p) ? info.memory : 0;
    m->surface_all = all_bytes(rank_surface, p->geometry);
    const struct kiln_field_set fields = fields_of(job);
    const double own =
        rank_surface->count > 0 ? (double)rank_surface_bytes(rank_surface, &fields) / (double)rank_surface->count : 0.0;
    const double results = (double)kiln_field_set_point_bytes(&fields, KILN_FIELD_RESULT); /* they move, too */
    m->surface_own = (uint64_t)(own * plan->here.light.points_most);
    m->light = kiln_field_set_light_bytes(&fields, (uint64_t)plan->here.light.points_most, plan->surface.points);
    const struct kiln_companion_bytes companions = companion_bytes(plan, p, job);
    m->light += companions.always;
    m->device += companions.device;
    m->volume = plan->probes * (KILN_PROBE_BYTES + job->scene.group_count * sizeof(struct kiln_probe_group)) +
                plan->probe_paths.bytes;
    m->results = result_bytes(plan, p, job);
    m->moving = plan->here.light.repartitions > 0 ? (uint64_t)(fmax(own, results) * plan->here.light.points_most) : 0;
    m->in_step = companions.in_step;
    const uint64_t early = m->moving > m->in_step ? m->moving : m->in_step,
                   last = m->volume + m->results; /* there is none of these while points move, or in a step of light */
    m->total = m->program + m->scene + m->textures + m->geometry + m->bvh + m->surface_all + m->surface_own + m->light +
               (last > early ? last : early);
    if (plan->surface.points > 0)
        plan->bytes_per_point =
            own + (double)m->surface_all / (double)plan->surface.points +
            (double)kiln_field_set_light_bytes(&fields, plan->surface.points, plan->surface.points) /
                (double)plan->surface.points;
    if (p->geometry->triangle_count > 0)
        plan->bytes_per_triangle = (double)(m->scene + m->geometry) / (double)p->geometry->triangle_count;
}

/* Floats of a point that are 0 and take no disk, as a mean over all points. */
static double dark_floats(const struct kiln_plan *plan, const struct kiln_field_set *fields, bool in_lightmaps)
{
    double floats = 0.0;
    for (size_t i = 0; i < fields->count; i++) {
        const struct kiln_field *field = fields->entry[i].field;
        const bool published = in_lightmaps ? fields->entry[i].in_lightmaps : field->dataset != NULL;
        floats +=
            published ? kiln_companions_dark(kiln_companions, plan->companions, field->name) * field->components : 0.0;
    }
    return floats;
}

static void plan_disk(struct kiln_plan *plan, const struct kiln_prepared *p, const struct kiln_job *job)
{
    const double points = (double)plan->surface.points;
    const struct kiln_field_set fields = fields_of(job);
    const bool denoises = kiln_job_denoises(job);
    const double channels = (double)kiln_field_set_channels(&fields) - dark_floats(plan, &fields, true),
                 columns = (double)kiln_field_set_column_bytes(&fields) -
                           dark_floats(plan, &fields, false) * (double)sizeof(float);
    plan->lightmap_bytes = (uint64_t)(points * LIGHTMAP_POINT_DISK * (job->lightmaps.half ? 0.45 : 1.0) *
                                      (denoises ? DENOISE_LIGHTMAP_DISK : 1.0) * (channels / 9.0));
    plan->h5_bytes =
        (uint64_t)(points * (H5_POINT_DISK + columns - KILN_RESULTS_COLUMNS + (denoises ? DENOISE_POINT_DISK : 0.0)));
    plan->volume_bytes =
        (uint64_t)((double)plan->probes * (PROBE_DISK * (double)sizeof(struct kiln_probe_result) +
                                           OCCLUDER_DISK * (double)sizeof(struct kiln_probe_occluders)));
    plan->scene_bytes = p->scene->mapped_bytes;
    plan->preview_bytes = job->preview ? (uint64_t)(PREVIEW_DISK * kiln_preview_share(job, p->scene, points)) : 0;
    plan->export_bytes = job->write_scene ? kiln_export_size(p->scene) : 0;
    const struct kiln_companion_kept kept = {
        .job = job, .points = plan->surface.points, .goes_on = kiln_transport_goes_on(job, p)};
    plan->transport_bytes = kiln_companions_files(kiln_companions, &kept, NULL);
    for (size_t i = 0; i < plan->steps.count; i++)
        plan->transport_bytes += kiln_companions_files(kiln_companions, &kept, &plan->steps.of[i].step);
    plan->disk_bytes = plan->lightmap_bytes + plan->h5_bytes + plan->volume_bytes + plan->scene_bytes +
                       plan->preview_bytes + plan->export_bytes + plan->transport_bytes;
    const struct kiln_integrate_settings settings = kiln_light_settings(job, p->lights, plan->surface.points);
    const struct kiln_integrate_params params = {.settings = &settings};
    plan->checkpoint_bytes = (uint64_t)points * (kiln_field_set_saved_bytes(&fields) +
                                                 kiln_companions_saved_bytes(kiln_companions, &params));
}

/* ---- calibration ---- */

static int sample_step(const struct kiln_prepared *p, const struct kiln_batch *batch, const struct kiln_cost_kind *kind,
                       double *seconds, struct kiln_error *error)
{
    struct kiln_backend_info begin, end;
    uint64_t rays = 0;
    kiln_backend_info(p->backend, &begin);
    const double start = MPI_Wtime();
    const int status = kiln_backend_run(p->backend, kind->pass, kind->parameters, batch, &rays, error);
    *seconds = MPI_Wtime() - start;
    kiln_backend_info(p->backend, &end);
    if (end.thread_seconds > begin.thread_seconds)
        *seconds = (end.thread_seconds - begin.thread_seconds) / p->threads;
    return status;
}

static bool is_cheap(const struct kiln_planned_steps *steps, uint32_t kind)
{
    bool cheap = false;
    for (uint32_t k = 0; k < steps->kind_count; k++)
        cheap = cheap || (steps->kinds[k].pass == steps->kinds[kind].pass &&
                          steps->kinds[kind].samples < steps->kinds[k].samples);
    return cheap;
}

/* Input for taking samples. */
struct calibration {
    const struct kiln_prepared *p;
    struct kiln_integrate_params params; /* of one rank, as companions want them */
    struct kiln_rank_data data;          /* of all points: fields by which companions select points */
};

static int take_sample(const struct kiln_planned_steps *steps, const struct calibration *c, size_t first, size_t count,
                       struct kiln_plan_sample *sample, struct kiln_error *error)
{
    const struct kiln_prepared *p = c->p;
    const struct kiln_tile_run *tile_runs = p->surface->tile_runs;
    const size_t rest = p->surface->tile_run_count - first;
    int status = KILN_OK;
    struct kiln_selection *selections = NULL;
    size_t room = 0;
    *sample = (struct kiln_plan_sample){.first = tile_runs[first].first.at};
    for (uint32_t k = 0; k < steps->kind_count && status == KILN_OK; k++) {
        const size_t wanted = is_cheap(steps, k) ? CHEAP_TILE_RUNS * count : count;
        struct kiln_batch batch = {.first = first,
                                   .count = wanted < rest ? wanted : rest,
                                   .stream = steps->kinds[k].stream,
                                   .samples = steps->kinds[k].samples};
        const struct kiln_step step = {.stream = batch.stream, .with = steps->kinds[k].with};
        status = kiln_companions_choose(kiln_companions, c->params.settings, &step, &c->data, &batch, &selections,
                                        &room, error);
        sample->points[k] = kiln_tile_runs_points(&tile_runs[first], &tile_runs[first + batch.count - 1]);
        if (status == KILN_OK && !steps->kinds[k].answered)
            status = sample_step(p, &batch, &steps->kinds[k], &sample->seconds[k], error);
        sample->seconds[k] *= kiln_companions_share(kiln_companions, &step); /* timed with all patches */
    }
    kiln_free(&selections);
    return status;
}

/* Tile run for sample i, in bit-reversed order: whenever time runs out, the samples taken are spread over the scene. */
static size_t sample_place(size_t i)
{
    size_t place = 0;
    for (size_t bit = 1; bit < KILN_PLAN_SAMPLES; bit <<= 1, i >>= 1)
        place = place << 1 | (i & 1);
    return place;
}

static int fill_radiosity(const struct kiln_prepared *p, uint64_t **radiosity, struct kiln_error *error)
{
    static const float light[3] = {1.0f, 0.9f, 0.8f};
    const int status =
        kiln_allocate(radiosity, p->surface->point_count, sizeof **radiosity, "a sample's radiosity", error);
    for (uint64_t i = 0; status == KILN_OK && i < p->surface->point_count; i++)
        (*radiosity)[i] = kiln_radiosity_pack(light, (uint32_t)i);
    return status == KILN_OK ? kiln_backend_set_radiosity(p->backend, *radiosity, error) : status;
}

static int calibrate(struct kiln_plan *plan, const struct calibration *c, struct kiln_error *error)
{
    const struct kiln_prepared *p = c->p;
    const size_t count = p->surface->tile_run_count,
                 busy = on_device(p) ? DEVICE_TILE_RUNS : (size_t)p->threads * THREAD_TILE_RUNS;
    size_t run = busy < LEAST_TILE_RUNS ? LEAST_TILE_RUNS : busy;
    if (run * KILN_PLAN_SAMPLES > count)
        run = on_device(p) ? (count < DEVICE_TILE_RUNS ? count : DEVICE_TILE_RUNS)
                           : (count + KILN_PLAN_SAMPLES - 1) / KILN_PLAN_SAMPLES;
    const double start = MPI_Wtime();
    struct kiln_plan_sample warm;
    int status = count > 0 ? take_sample(&plan->steps, c, 0, run < 4 ? run : 4, &warm, error) : KILN_OK;
    for (size_t i = 0; i < KILN_PLAN_SAMPLES && status == KILN_OK && count > 0; i++) {
        if (i >= LEAST_SAMPLES && MPI_Wtime() - start > CALIBRATION_SECONDS)
            break;
        const size_t first = sample_place(i) * (count - run) / (KILN_PLAN_SAMPLES - 1);
        status = take_sample(&plan->steps, c, first, run, &plan->samples[plan->sample_count++], error);
    }
    return status;
}

static double take_seconds(const struct kiln_prepared *p) { return TAKE_POINT_SECONDS / p->threads; }

/* A moment, s: by the clock, and of the processor. */
struct moment {
    double clock, processor;
};

static struct moment moment_now(void)
{
    struct timespec time = {0, 0};
    (void)clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &time);
    return (struct moment){MPI_Wtime(), (double)time.tv_sec + 1e-9 * (double)time.tv_nsec};
}

/* Seconds since `begin`. On a CPU at most the mean CPU time of a thread, so that other programs do not count. */
static double seconds_since(struct moment begin, const struct kiln_prepared *p)
{
    const struct moment now = moment_now();
    const double clock = now.clock - begin.clock;
    return on_device(p) ? clock : fmin(clock, (now.processor - begin.processor) / p->threads);
}

static int probe_seconds(const struct kiln_prepared *p, const struct kiln_job *job, double *seconds,
                         struct kiln_error *error)
{
    struct kiln_vec3 positions[SAMPLE_PROBES];
    struct kiln_probe_occluders occluders[SAMPLE_PROBES];
    uint64_t rays = 0;
    const struct kiln_vec3 low = p->geometry->bounds_min, size = vec3_sub(p->geometry->bounds_max, low);
    for (int i = 0; i < SAMPLE_PROBES; i++) {
        const float t = ((float)i + 0.5f) / SAMPLE_PROBES;
        positions[i] = vec3(low.x + t * size.x, low.y + (1.0f - t) * size.y, low.z + t * size.z);
    }
    const struct moment begin = moment_now();
    const struct kiln_batch items = {.count = SAMPLE_PROBES, .positions = positions, .samples = job->volume.samples};
    const struct kiln_probe_parameters parameters = {0};
    int status = kiln_backend_run(p->backend, &kiln_pass_probes, &parameters, &items, &rays, error);
    if (status == KILN_OK)
        status = kiln_occluders_find(p->backend, p->geometry, positions, SAMPLE_PROBES, occluders, &rays, error);
    *seconds = seconds_since(begin, p) / SAMPLE_PROBES;
    return status;
}

static int emission_seconds(const struct kiln_prepared *p, double *seconds, struct kiln_error *error)
{
    struct kiln_emission_result result;
    const struct moment begin = moment_now();
    const int status = kiln_backend_emission(p->backend, KILN_EMISSION_SAMPLES, &result, error);
    *seconds = seconds_since(begin, p);
    return status;
}

/* ---- time ---- */

static double phase_seconds(const struct kiln_phases *phases, const char *name)
{
    for (size_t i = 0; i < phases->count; i++)
        if (strcmp(phases->name[i], name) == 0)
            return phases->seconds[i];
    return 0.0;
}

/* Seconds of a phase. On a CPU at most its CPU time divided by `threads`, so that other programs do not count. */
static double worked_seconds(const struct kiln_phases *phases, const char *name, const struct kiln_prepared *p,
                             uint32_t threads)
{
    const double seconds = phase_seconds(phases, name);
    for (size_t i = 0; i < phases->count && !on_device(p); i++)
        if (strcmp(phases->name[i], name) == 0 && phases->processor[i] > 0.0)
            return fmin(seconds, phases->processor[i] / threads);
    return seconds;
}

/* Number of ranks that share a node's cores. Ranks of a node share them, unless the number of threads was given; each
 * rank has a GPU of its own. */
static double crowd(const struct kiln_prepared *p, const struct kiln_job *job)
{
    const uint32_t together = job->submit.ranks_per_node > 0 ? job->submit.ranks_per_node : 1;
    return on_device(p) || job->machine.threads != 0 ? 1.0 : together < job->plan.ranks ? together : job->plan.ranks;
}

/* The bake on one rank with all its threads, which the simulation shares out. */
static struct kiln_reckoned reckoned_alone(const struct kiln_plan *plan, const struct kiln_prepared *p)
{
    struct kiln_reckon_question alone = plan->question;
    alone.ranks = 1.0;
    alone.threads = p->threads;
    return kiln_reckon_bake(&alone, plan->backend);
}

/* Seconds of a point in phases, on one rank. */
static double point_seconds(const struct kiln_plan *plan, const struct kiln_prepared *p,
                            const enum kiln_reckon_phase *phases, size_t count)
{
    const struct kiln_reckoned alone = reckoned_alone(plan, p);
    double seconds = 0.0;
    for (size_t i = 0; i < count; i++)
        seconds += alone.seconds[phases[i]];
    return seconds / fmax(1.0, (double)plan->surface.points);
}

/* Seconds to denoise and to write a point: its lightmaps and its part of kiln.h5. */
static double denoise_seconds(const struct kiln_plan *plan, const struct kiln_prepared *p)
{
    static const enum kiln_reckon_phase phases[] = {KILN_RECKON_denoising};
    return point_seconds(plan, p, phases, 1);
}
static double written_seconds(const struct kiln_plan *plan, const struct kiln_prepared *p)
{
    static const enum kiln_reckon_phase phases[] = {KILN_RECKON_denoising, KILN_RECKON_lightmaps, KILN_RECKON_h5};
    return point_seconds(plan, p, phases, 3);
}

/* Seconds per point that rank 0 takes to place its part of kiln.h5, while the others wait. */
static double place_seconds(const struct kiln_job *job)
{
    const struct kiln_field_set fields = fields_of(job);
    return H5_PLACE_SECONDS * (double)kiln_h5_columns(&fields) / KILN_H5_CHUNK_ROWS;
}

static double write_seconds(const struct kiln_plan *plan, const struct kiln_job *job)
{
    const double *s = plan->reckoned[plan->backend].seconds;
    return s[KILN_RECKON_denoising] + s[KILN_RECKON_lightmaps] + s[KILN_RECKON_h5] + s[KILN_RECKON_preview] +
           s[KILN_RECKON_rest] + (double)plan->surface.points * place_seconds(job);
}

/* Bytes per point in the exchange after a bounce, with `points` points in all. */
static double bounce_bytes(const struct kiln_job *job, uint64_t points)
{
    return kiln_exchange_is_compact(job->ranks.exchange, points) ? COMPACT_BYTES : FULL_BYTES;
}

/* Times of samples that are no phases. */
struct timing {
    double probe;    /* s each */
    double emission; /* s in all */
    double views;    /* s in all, by one rank */
};

/* Plans all times that do not depend on how evenly the ranks' work is distributed. */
static void plan_before_and_after(struct kiln_plan *plan, const struct kiln_prepared *p, const struct kiln_job *job,
                                  const struct kiln_phases *phases, const struct timing *timing)
{
    struct kiln_plan_seconds *s = &plan->seconds;
    const double together = crowd(p, job), ranks = (double)job->plan.ranks;
    s->import = phase_seconds(phases, "import");
    s->world = worked_seconds(phases, "scene and BVH", p, 1) * together;
    s->surface = worked_seconds(phases, "surface points", p, 1) * together / ranks;
    if (plan->surface.points > 0)
        s->validity = worked_seconds(phases, "validity", p, p->threads) * (double)plan->surface.points_max * together /
                      (double)plan->surface.points;
    s->emission = timing->emission * together / fmin(ranks, KILN_EMISSION_GROUPS);
    s->views = timing->views * together / ranks;
    s->probes = (timing->probe * ceil((double)plan->probes / ranks) + plan->probe_paths.seconds / ranks) * together;
    if (ranks > 1.0)
        plan->exchange_bytes =
            bounce_bytes(job, plan->surface.points) * ((double)plan->surface.points - (double)plan->surface.points_max);
    s->write = write_seconds(plan, job);
}

/* Puts what was measured and simulated in the place of reckoned phases. */
static void put_phases(struct kiln_plan *plan)
{
    const struct kiln_plan_seconds *s = &plan->seconds;
    struct kiln_reckoned *r = &plan->reckoned[plan->backend];
    const struct {
        enum kiln_reckon_phase phase;
        double seconds;
    } known[] = {{KILN_RECKON_import, s->import},     {KILN_RECKON_world, s->world},
                 {KILN_RECKON_points, s->surface},    {KILN_RECKON_validity, s->validity},
                 {KILN_RECKON_emission, s->emission}, {KILN_RECKON_probes, s->probes}};
    for (size_t i = 0; i < sizeof known / sizeof *known; i++)
        kiln_reckon_put(r, known[i].phase, known[i].seconds);
    for (int i = KILN_RECKON_direct; i <= KILN_RECKON_quantities; i++) {
        double seconds = 0.0;
        for (uint32_t role = 0; role < plan->steps.roles.count; role++)
            seconds += (int)kiln_reckon_phase_of(plan->steps.roles.of[role]->phase) == i ? s->light[role] : 0.0;
        kiln_reckon_put(r, (enum kiln_reckon_phase)i, seconds);
    }
}

static void plan_light(struct kiln_plan *plan, const struct kiln_job *job)
{
    struct kiln_plan_seconds *s = &plan->seconds;
    s->exchange = plan->here.exchange;
    s->move = plan->here.light.move;
    s->save = plan->here.save;
    for (uint32_t role = 0; role < plan->steps.roles.count; role++)
        s->light[role] = plan->here.light.seconds[role];
    put_phases(plan);
    s->total = plan->reckoned[plan->backend].total + (double)plan->surface.points * place_seconds(job) + s->views +
               s->exchange + s->move + s->save;
}

/* ---- scaling ---- */

/* The nearest sample; NULL when there is none. */
static const struct kiln_plan_sample *sample_near(const struct kiln_plan *plan, uint64_t point)
{
    const struct kiln_plan_sample *best = NULL;
    double least_away = INFINITY;
    for (size_t i = 0; i < plan->sample_count; i++) {
        const struct kiln_plan_sample *s = &plan->samples[i];
        const double away = fabs((double)s->first - (double)point);
        if (away < least_away && s->points[0] > 0) {
            least_away = away;
            best = s;
        }
    }
    return best;
}

/* Mean seconds per point over a range of points, from the samples taken there, or else from the nearest one. */
static double cost_in(const struct kiln_plan *plan, uint64_t first, uint64_t count, uint32_t kind)
{
    double seconds = 0.0, points = 0.0;
    for (size_t i = 0; i < plan->sample_count; i++) {
        const struct kiln_plan_sample *s = &plan->samples[i];
        if (s->first >= first && s->first < first + count) {
            seconds += s->seconds[kind];
            points += (double)s->points[kind];
        }
    }
    const struct kiln_plan_sample *near = points > 0.0 ? NULL : sample_near(plan, first + count / 2);
    return points > 0.0 ? seconds / points : near != NULL ? near->seconds[kind] / (double)near->points[kind] : 0.0;
}

/* The cells of the simulation: their points, and the cost of one point. */
struct cells {
    uint64_t *points;
    double *cost[KILN_COST_KINDS_MAX];
    size_t count;
};

static void free_cells(struct cells *cells)
{
    kiln_free(&cells->points);
    for (uint32_t l = 0; l < KILN_COST_KINDS_MAX; l++)
        kiln_free(&cells->cost[l]);
}

/* Seconds of all rounds over those of the first, which the planned steps are, for a kind of steps; of light paths the
 * part that is expected of those that are planned. */
static double of_rounds(const struct kiln_plan *plan, uint32_t kind)
{
    const struct kiln_work *w = &plan->question.work;
    size_t i = 0;
    while (plan->steps.of[i].kind != kind)
        i++;
    const struct kiln_step *step = &plan->steps.of[i].step;
    if (plan->steps.kinds[kind].answered)
        return w->paths_planned > 0.0 ? w->paths / w->paths_planned : 1.0;
    return w->rounds.rounds > 0 && (step->pass == &kiln_pass_direct || step->terminal) ? w->rounds.samples : 1.0;
}

/* Seconds of a point in a step of a kind, of a rank with all the cores that it gets; in a stretch of `count` points. */
static double kind_seconds(const struct kiln_plan *plan, uint64_t first, uint64_t count, uint32_t kind)
{
    const struct kiln_step step = {.with = plan->steps.kinds[kind].with};
    return of_rounds(plan, kind) *
           (plan->steps.kinds[kind].answered
                ? kiln_companions_seconds(kiln_companions, plan->companions, &step) / (double)plan->surface.points
                : cost_in(plan, first, count, kind));
}

static int fill_cells(const struct kiln_plan *plan, const struct kiln_prepared *p, const struct kiln_job *job,
                      struct cells *cells, struct kiln_error *error)
{
    const struct kiln_surface *s = p->surface; /* of one rank: all */
    const bool in_cells = s->cell_first != NULL;
    cells->count = in_cells ? (size_t)s->cell_count : s->tile_run_count;
    int status;
    KILN_TRY(kiln_allocate(&cells->points, cells->count, sizeof *cells->points, "the simulated cells", error));
    for (uint32_t l = 0; l < plan->steps.kind_count; l++)
        KILN_TRY(kiln_allocate(&cells->cost[l], cells->count, sizeof *cells->cost[l], "the simulated cells", error));
    for (size_t i = 0; i < cells->count; i++) {
        const uint64_t first = in_cells ? s->cell_first[i] : s->tile_runs[i].first.at;
        cells->points[i] = in_cells ? s->cell_first[i + 1] - first : s->tile_runs[i].count;
        for (uint32_t l = 0; l < plan->steps.kind_count; l++)
            cells->cost[l][i] = crowd(p, job) * (kind_seconds(plan, first, cells->points[i], l) + take_seconds(p));
    }
end:
    return status;
}

static double mean_cost(const struct cells *cells, uint32_t kind)
{
    double cost = 0.0, points = 0.0;
    for (size_t i = 0; i < cells->count; i++) {
        cost += cells->cost[kind][i] * (double)cells->points[i];
        points += (double)cells->points[i];
    }
    return points > 0.0 ? cost / points : 0.0;
}

/* Gives steps of one pass a common cost pattern over cells, since they are costly in the same places, but their samples
 * came from different tile runs. The pattern is the mean over the pass's kinds of cost in a cell / mean cost of all
 * cells. The total cost of each kind stays. */
static void share_patterns(const struct kiln_planned_steps *steps, const struct cells *cells)
{
    double mean[KILN_COST_KINDS_MAX], share[KILN_COST_KINDS_MAX];
    for (uint32_t k = 0; k < steps->kind_count; k++)
        mean[k] = mean_cost(cells, k);
    for (size_t i = 0; i < cells->count; i++) {
        for (uint32_t k = 0; k < steps->kind_count; k++) {
            double sum = 0.0, kinds = 0.0;
            for (uint32_t l = 0; l < steps->kind_count; l++)
                if (steps->kinds[l].pass == steps->kinds[k].pass && mean[l] > 0.0) {
                    sum += cells->cost[l][i] / mean[l];
                    kinds += 1.0;
                }
            share[k] = kinds > 0.0 ? sum / kinds : 0.0;
        }
        for (uint32_t k = 0; k < steps->kind_count; k++)
            cells->cost[k][i] = mean[k] * share[k];
    }
}

/* Parameters of the simulation. Whatever grows with the number of points does so proportionally. */
static struct kiln_simulation simulation_of(const struct kiln_plan *plan, const struct kiln_prepared *p,
                                            const struct kiln_job *job, const struct kiln_integrate_settings *settings,
                                            const struct cells *cells, const struct timing *timing)
{
    const struct kiln_plan_seconds *s = &plan->seconds;
    const double together = crowd(p, job), points = fmax(1.0, (double)plan->surface.points);
    const struct kiln_field_set fields = fields_of(job);
    const double surface =
        p->surface->count > 0 ? (double)rank_surface_bytes(p->surface, &fields) / (double)p->surface->count : 0.0;
    const struct kiln_reckoned alone = reckoned_alone(plan, p);
    struct kiln_backend_info info = {0};
    kiln_backend_info(p->backend, &info);
    struct kiln_simulation simulation = {
        .light = {.settings = settings,
                  .steps = &plan->steps,
                  .ranks_per_node = job->submit.ranks_per_node,
                  .shared_memory_ranks = job->ranks.shared_memory_ranks,
                  .cell_points = cells->points,
                  .cell_count = cells->count,
                  .tile_runs = plan->surface.tile_runs,
                  .threads = p->threads,
                  .computes_for_others = info.computes_for_others,
                  .keeps_points = info.keeps_points,
                  .part_points = info.part_points,
                  .moved_bytes = surface + (double)kiln_field_set_point_bytes(&fields, KILN_FIELD_RESULT),
                  .bandwidth = job->plan.node_bandwidth * 1e9,
                  .latency = job->plan.node_latency * 1e-6},
        .density = job->plan.points > 0 ? (double)job->plan.points / points : 1.0,
        .once = alone.seconds[KILN_RECKON_start] + alone.seconds[KILN_RECKON_preview] +
                alone.seconds[KILN_RECKON_rest] + s->import + s->world + s->emission,
        .find_a_point = s->surface * job->plan.ranks / points,
        .map_a_point = MAP_POINT_SECONDS * together,
        .map_bytes = MAP_ENTRY_BYTES * (double)(p->surface->tile_count + p->surface->split_count) / points,
        .shared_a_point =
            s->validity / fmax(1.0, (double)plan->surface.points_max) + together * written_seconds(plan, p),
        .shared = (timing->probe * (double)plan->probes + plan->probe_paths.seconds + timing->views) * together,
        .seen_a_texel =
            kiln_job_denoises(job) ? denoise_seconds(plan, p) + TEXEL_BYTES / (job->plan.node_bandwidth * 1e9) : 0.0,
        .largest_map = (double)kiln_largest_lightmap(p->scene),
        .alone_a_point = place_seconds(job),
        .radiosity_bytes = bounce_bytes(job, job->plan.points > 0 ? job->plan.points : plan->surface.points),
        .exchanges = plan->bounces + 1,
        .saved_bytes = (double)plan->checkpoint_bytes / points,
        .saved_bandwidth = SAVE_BANDWIDTH,
        .save_every = job->checkpoints.every,
        .copied_byte = job->checkpoints.local != NULL ? together * COPY_BYTE_SECONDS / p->threads : 0.0};
    for (uint32_t k = 0; k < KILN_COST_KINDS_MAX; k++)
        simulation.light.cell_cost[k] = cells->cost[k];
    return simulation;
}

/* Simulates the bake as requested, then the scaling curves. */
static int simulate(struct kiln_plan *plan, const struct kiln_prepared *p, const struct kiln_job *job,
                    const struct timing *timing, struct kiln_error *error)
{
    const struct kiln_integrate_settings settings = kiln_light_settings(job, p->lights, plan->surface.points);
    struct cells cells = {0};
    int status = fill_cells(plan, p, job, &cells, error);
    if (status == KILN_OK) {
        share_patterns(&plan->steps, &cells);
        struct kiln_simulation simulation = simulation_of(plan, p, job, &settings, &cells, timing);
        const double density = simulation.density, bytes = simulation.radiosity_bytes;
        simulation.density = 1.0;
        simulation.radiosity_bytes = bounce_bytes(job, plan->surface.points);
        status = kiln_simulate(&simulation, job->plan.ranks, 1.0, &plan->here, error);
        simulation.density = density;
        simulation.radiosity_bytes = bytes;
        if (status == KILN_OK)
            status =
                kiln_simulate_curves(&simulation, job->plan.ranks, plan->strong, plan->weak, &plan->curve_count, error);
    }
    free_cells(&cells);
    return status;
}

static bool selects(const struct calibration *c, const struct kiln_companion *row)
{
    return row->find != NULL && row->wanted(&c->params);
}

/* The fields by which companions select, of all points. */
static int find_fields(struct calibration *c, struct kiln_error *error)
{
    const struct kiln_field_set *fields = c->params.fields;
    int status = KILN_OK;
    for (size_t i = 0; kiln_companions[i] != NULL && status == KILN_OK; i++)
        if (selects(c, kiln_companions[i]))
            status =
                kiln_rank_data_add(&c->data, fields, kiln_field_set_find(fields, kiln_companions[i]->field), error);
    return status == KILN_OK ? kiln_companions_find(kiln_companions, &c->params, &c->data, error) : status;
}

static void free_fields(struct calibration *c)
{
    for (size_t i = 0; kiln_companions[i] != NULL; i++)
        if (selects(c, kiln_companions[i]))
            kiln_rank_data_remove(&c->data, c->params.fields,
                                  kiln_field_set_find(c->params.fields, kiln_companions[i]->field));
}

/* Callback: takes the parameters that a companion makes for its passes, as in the first bounce with even light. */
static int make_parameters(const struct kiln_companion *row, void *self, struct kiln_planned_steps *steps,
                           const uint64_t *radiosity, struct kiln_error *error)
{
    struct kiln_step step = {.bounce = 1, .stream = 1};
    for (uint32_t k = 0; k < steps->kind_count; k++)
        step.samples = row->makes(steps->kinds[k].pass) ? steps->kinds[k].samples : step.samples;
    const int status = row->parameters(self, radiosity, &step, error);
    for (uint32_t k = 0; k < steps->kind_count && status == KILN_OK; k++)
        if (row->makes(steps->kinds[k].pass))
            steps->kinds[k].parameters = step.parameters;
    return status;
}

/* Creates the companions that make parameters. `self` has room for all; they use the calibration, which must outlive
 * them. */
static int make_companions(const struct calibration *c, struct kiln_planned_steps *steps, const uint64_t *radiosity,
                           void **self, struct kiln_error *error)
{
    const struct kiln_companion_site site = {.params = &c->params, .plans = true};
    int status = KILN_OK;
    for (size_t i = 0; i < KILN_COMPANIONS && status == KILN_OK; i++) {
        const struct kiln_companion *row = kiln_companions[i];
        if (row->parameters == NULL || !row->wanted(&c->params))
            continue;
        status = row->create(&self[i], &site, error);
        if (status == KILN_OK)
            status = make_parameters(row, self[i], steps, radiosity, error);
    }
    return status;
}

static int trace_samples(struct kiln_plan *plan, const struct kiln_prepared *p, const struct kiln_job *job,
                         const struct kiln_integrate_settings *settings, struct timing *timing,
                         struct kiln_error *error)
{
    uint64_t *radiosity = NULL;
    void *companions[KILN_COMPANIONS] = {NULL};
    const struct kiln_field_set fields = fields_of(job);
    struct calibration c = {.p = p,
                            .params = {.communicator = MPI_COMM_SELF,
                                       .ranks = 1,
                                       .settings = settings,
                                       .fields = &fields,
                                       .backend = p->backend,
                                       .surface = p->surface,
                                       .seen = plan->visible.seen,
                                       .threads = p->threads},
                            .data = {.surface = *p->surface}};
    const double start = MPI_Wtime();
    int status;
    KILN_TRY(fill_radiosity(p, &radiosity, error));
    KILN_TRY(find_fields(&c, error));
    KILN_TRY(make_companions(&c, &plan->steps, radiosity, companions, error));
    KILN_TRY(calibrate(plan, &c, error));
    if (plan->probes > 0)
        KILN_TRY(probe_seconds(p, job, &timing->probe, error));
    KILN_TRY(emission_seconds(p, &timing->emission, error));
end:
    plan->calibration_seconds = MPI_Wtime() - start;
    for (size_t i = 0; i < KILN_COMPANIONS; i++)
        if (companions[i] != NULL)
            kiln_companions[i]->destroy(&companions[i]);
    kiln_free(&radiosity);
    free_fields(&c);
    return status;
}

/* Traces some light paths for probes, and has the companions measured. */
static int measure_companions(struct kiln_plan *plan, const struct kiln_prepared *p, const struct kiln_job *job,
                              const struct kiln_integrate_settings *settings, const struct kiln_volume_result *volume,
                              struct kiln_error *error)
{
    const struct kiln_probe_paths_params paths = {
        .backend = p->backend, .scene = p->scene, .settings = settings, .samples = job->volume.samples};
    const struct kiln_integrate_params params = {.communicator = MPI_COMM_SELF,
                                                 .ranks = 1,
                                                 .settings = settings,
                                                 .backend = p->backend,
                                                 .surface = p->surface,
                                                 .threads = p->threads};
    struct kiln_companion_sample sample = {.params = &params, .points = plan->surface.points, .ranks = job->plan.ranks};
    int status;
    KILN_TRY(kiln_probe_paths_measure(&plan->probe_paths, &paths, volume, plan->surface.points, p->threads,
                                      job->plan.ranks, error));
    sample.probe_seconds = plan->probe_paths.seconds;
    KILN_TRY(kiln_companions_measure(kiln_companions, &sample, plan->companions, error));
end:
    return status;
}

/* Finds the surfaces that the job's views need. */
static int find_visible(struct kiln_plan *plan, const struct kiln_prepared *p, const struct kiln_job *job,
                        struct timing *timing, struct kiln_error *error)
{
    const double start = MPI_Wtime();
    if (job->light.only_visible_from == NULL)
        return KILN_OK;
    const int status = kiln_visible_from_find(&plan->visible, p, job->light.only_visible_from, error);
    timing->views = MPI_Wtime() - start;
    return status;
}

/* Tries light, and reckons the bake on both backends, for all ranks. */
static int reckon(struct kiln_plan *plan, const struct kiln_prepared *p, const struct kiln_job *job,
                  const struct kiln_integrate_settings *settings, const struct kiln_phases *phases,
                  struct kiln_error *error)
{
    const struct kiln_backend_known known = {.threads =
                                                 (uint64_t)fmax(p->threads * job->plan.ranks / crowd(p, job), 1.0),
                                             .ranks = job->plan.ranks,
                                             .import = phase_seconds(phases, "import"),
                                             .points = (double)plan->surface.points,
                                             .lights = p->lights,
                                             .foretold = &plan->foretold};
    struct kiln_backend_choice choice = {.asked = false};
    struct kiln_tried_light tried;
    int status = kiln_prepare_try(p, settings, &tried, error);
    if (status == KILN_OK)
        status = kiln_prepare_foretell(&tried, settings, kiln_job_denoises(job), INFINITY, &plan->foretold, error);
    kiln_prepare_forget(&tried);
    if (status == KILN_OK)
        status = kiln_backend_ask(&choice, job, p->scene, &known, error);
    kiln_backend_predict(&choice);
    plan->question = choice.question;
    plan->backend = on_device(p) ? KILN_RECKON_VULKAN : KILN_RECKON_EMBREE;
    memcpy(plan->reckoned, choice.reckoned, sizeof plan->reckoned);
    return status;
}

int kiln_plan_make(struct kiln_plan *plan, const struct kiln_prepared *prepared, const struct kiln_job *job,
                   const struct kiln_phases *phases, struct kiln_error *error)
{
    *plan = (struct kiln_plan){.triangles = prepared->geometry->triangle_count,
                               .bounces = kiln_work_bounces(job, prepared->scene)};
    known_memory(plan, prepared);
    measure_program(plan, prepared, job);
    struct kiln_surface *rank_surface = NULL;
    const struct kiln_surface_params params = {
        .scene = prepared->scene,
        .geometry = prepared->geometry,
        .cell_size = job->ranks.cell_size,
        .partition = job->ranks.partition_objects ? KILN_PARTITION_OBJECTS : KILN_PARTITION_CELLS,
        .whole_tiles = job->light.indirect_scale > 0 || job->light.final_scale > 0 || job->light.guide > 0,
        .both_sides = job->lightmaps.both_sides,
        .ranks = job->plan.ranks,
        .threads = prepared->threads};
    int status = kiln_surface_build(&rank_surface, &params, &plan->surface, error);
    struct kiln_volume_result volume = {0};
    struct timing timing = {0};
    if (status == KILN_OK && job->volume.samples > 0)
        status = kiln_volume_grid(&volume, prepared->scene, job->volume.spacing, job->volume.bounds, error);
    const struct kiln_integrate_settings settings = kiln_light_settings(job, prepared->lights, plan->surface.points);
    KILN_TRY(status);
    KILN_TRY(kiln_planned_steps_make(&plan->steps, &settings, plan->bounces, error));
    KILN_TRY(reckon(plan, prepared, job, &settings, phases, error));
    plan->probes = volume.size[0] * volume.size[1] * volume.size[2];
    KILN_TRY(find_visible(plan, prepared, job, &timing, error));
    KILN_TRY(trace_samples(plan, prepared, job, &settings, &timing, error));
    KILN_TRY(measure_companions(plan, prepared, job, &settings, &volume, error));
    plan_disk(plan, prepared, job);
    plan_before_and_after(plan, prepared, job, phases, &timing);
    KILN_TRY(simulate(plan, prepared, job, &timing, error));
    plan_light(plan, job);
    plan_memory(plan, prepared, rank_surface, job);
    KILN_TRY(kiln_working_set_find(&plan->working_set, prepared, job, plan->bytes_per_triangle, error));
end:
    kiln_surface_destroy(&rank_surface);
    return status;
}

void kiln_plan_release(struct kiln_plan *plan)
{
    kiln_planned_steps_release(&plan->steps);
    kiln_companions_forget(kiln_companions, plan->companions);
    kiln_working_set_release(&plan->working_set);
    kiln_visible_from_release(&plan->visible);
}
