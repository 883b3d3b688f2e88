#include "coordinator/bake/prepare/prepare.h"
#include "coordinator/bake/points/divided.h"

#include <math.h>
#include <omp.h>
#include <sched.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "coordinator/bake/prepare/materials.h"
#include "coordinator/bake/prepare/results_memory.h"
#include "coordinator/bake/points/surface_exchange.h"
#include "coordinator/mpi/agree.h"
#include "coordinator/bake/prepare/devices.h"
#include "worker/backend/extended.h"
#include "worker/backend/start.h"
#include "worker/base/memory.h"
#include "worker/base/thread.h"
#include "worker/scene/gloss.h"
#include "worker/scene/leaves.h"
#include "worker/pass/validity.h"

enum { FIRST_TILE_RUNS = 256, MOST_TILE_RUNS = 1 << 16 }; /* sizes of a batch of the validity pass */

static const char *const instruction_sets[] = {"sse2", "sse4.2", "avx", "avx2", "avx512"};
enum { SETS = 5 };

/* Index of the best instruction set that this processor has. */
static int own_instruction_set(void)
{
#if defined(__x86_64__)
    __builtin_cpu_init();
    if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512bw") &&
        __builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("avx512cd"))
        return 4;
    if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma"))
        return 3;
    if (__builtin_cpu_supports("avx"))
        return 2;
    if (__builtin_cpu_supports("sse4.2"))
        return 1;
#endif
    return 0;
}

const char *kiln_own_instruction_set(void) { return instruction_sets[own_instruction_set()]; }

bool kiln_instruction_set_common(MPI_Comm communicator, const char *name)
{
    int common = own_instruction_set();
    (void)MPI_Allreduce(MPI_IN_PLACE, &common, 1, MPI_INT, MPI_MIN, communicator);
    for (int i = 0; i <= common; i++)
        if (strcmp(name, instruction_sets[i]) == 0)
            return true;
    return false;
}

/* Collective. Chooses the lowest instruction set among those of all ranks. Embree finds the same hits with any number
 * of threads, but not with any instruction set. */
static int agree_on_instruction_set(struct kiln_prepared *p, const char *wanted, struct kiln_error *error)
{
    const int own = own_instruction_set();
    int common = own, chosen = -1;
    (void)MPI_Allreduce(MPI_IN_PLACE, &common, 1, MPI_INT, MPI_MIN, p->communicator);
    for (int i = 0; i < SETS && wanted != NULL; i++)
        if (strcmp(wanted, instruction_sets[i]) == 0)
            chosen = i;
    if (chosen > common)
        return kiln_fail(error, KILN_NO_DEVICE, "instruction set %s is not available on every rank; all have %s",
                         wanted, instruction_sets[common]);
    (void)snprintf(p->instruction_set, sizeof p->instruction_set, "%s",
                   instruction_sets[chosen >= 0 ? chosen : common]);
    return KILN_OK;
}

uint32_t kiln_own_cores(int node_ranks)
{
    cpu_set_t set;
    CPU_ZERO(&set);
    const long online = sysconf(_SC_NPROCESSORS_ONLN);
    long own = sched_getaffinity(0, sizeof set, &set) == 0 ? CPU_COUNT(&set) : online;
    if (own >= online)
        own = online / node_ranks;
    return own < 1 ? 1 : (uint32_t)own;
}

static int learn_about_ranks(struct kiln_prepared *p, const struct kiln_job *job, struct kiln_error *error)
{
    MPI_Comm node;
    (void)MPI_Comm_rank(p->communicator, &p->rank);
    (void)MPI_Comm_size(p->communicator, &p->ranks);
    (void)MPI_Comm_split_type(p->communicator, MPI_COMM_TYPE_SHARED, 0, MPI_INFO_NULL, &node);
    (void)MPI_Comm_rank(node, &p->node_rank);
    (void)MPI_Comm_size(node, &p->node_ranks);
    (void)MPI_Comm_free(&node);
    p->threads = job->machine.threads != 0 ? job->machine.threads : kiln_own_cores(p->node_ranks);
    omp_set_num_threads((int)p->threads); /* for parallel loops without a thread count */
    return kiln_node_create(&p->node, p->communicator, job->ranks.shared_memory_ranks, error);
}

static const struct kiln_prepare_care careless = {0};

static const struct kiln_stop *stop_of(const struct kiln_prepare_care *care)
{
    return care->control != NULL ? kiln_control_stop(care->control) : NULL;
}

/* Collective, after each step. Agrees on errors, and checks for requests to stop, also while it waits for other
 * ranks. */
static int go_on(const struct kiln_prepared *p, const struct kiln_prepare_care *care, int status,
                 struct kiln_error *error)
{
    if (status == KILN_OK && kiln_stop_asked(stop_of(care)))
        status = kiln_give_up(error);
    if (care->control != NULL)
        kiln_control_meet(care->control);
    return kiln_agree(p->communicator, status, error);
}

static int refuse(const struct kiln_prepared *p, const struct kiln_prepare_care *care, struct kiln_error *error)
{
    return care->refuse != NULL ? care->refuse(care->context, p, error) : KILN_OK;
}

static int import_scene(struct kiln_prepared *p, const struct kiln_job *job, const char *scene_file,
                        const struct kiln_prepare_care *care, struct kiln_error *error)
{
    const double start = MPI_Wtime();
    const int status = kiln_scene_import(&p->import, p->communicator, job, scene_file, stop_of(care), error);
    if (status == KILN_OK && p->rank == 0 && p->import.parts != NULL && care->control != NULL && !job->quiet) {
        char text[400];
        kiln_parts_sentence(job, p->import.parts, text, sizeof text);
        (void)fprintf(stderr, "kiln: %s\n", text);
    }
    p->import_seconds = MPI_Wtime() - start;
    return go_on(p, care, status, error);
}

/* kiln_node_builder */
static int build_geometry(void *context, const struct kiln_allocator *memory, struct kiln_error *error)
{
    struct kiln_prepared *p = context;
    const int status = kiln_geometry_create_in(&p->geometry, p->scene, memory, error);
    return status == KILN_OK && p->leaf_size > 0.0 ? kiln_leaves_lay(p->geometry, p->leaf_size, error) : status;
}

/* Collective. Builds the geometry on one rank of each node, in memory that all its ranks share. */
static int share_geometry(struct kiln_prepared *p, struct kiln_error *error)
{
    int status = kiln_node_build(p->node, build_geometry, p, error);
    if (status != KILN_OK)
        return kiln_node_full(p->node) ? build_geometry(p, &kiln_own_memory, error) : status;
    struct kiln_geometry made = {0};
    if (p->geometry != NULL)
        made = *p->geometry;
    kiln_node_broadcast(p->node, &made, sizeof made);
    const struct kiln_allocator memory = kiln_node_allocator(p->node);
    return p->geometry != NULL ? KILN_OK : kiln_geometry_attach(&p->geometry, &made, kiln_node_place, &memory, error);
}

/* Collective. Checks that all ranks read the same scene file as rank 0. Hosts without a common file system may have
 * other files under the same path. */
static int check_same_scene(const struct kiln_prepared *p, const char *scene_file, struct kiln_error *error)
{
    uint64_t first[2];
    const uint64_t *own = p->scene->header->content_hash;
    memcpy(first, own, sizeof first);
    (void)MPI_Bcast(first, 2, MPI_UINT64_T, 0, p->communicator);
    const int status = memcmp(first, own, sizeof first) == 0 ? KILN_OK
                                                             : kiln_fail(error, KILN_SITE,
                                                                         "%s is not the file that rank 0 has written: "
                                                                         "choose a folder that all hosts share",
                                                                         scene_file);
    return kiln_agree(p->communicator, status, error);
}

/* Collective. Reckons the bake on both backends; all ranks take what rank 0 finds, for it asks clocks and files. */
static int reckon(struct kiln_prepared *p, const struct kiln_job *job, const struct kiln_prepare_care *care,
                  struct kiln_error *error)
{
    struct kiln_backend_known known = {.threads = p->threads, .ranks = (uint32_t)p->ranks, .import = p->import_seconds};
    (void)MPI_Allreduce(MPI_IN_PLACE, &known.threads, 1, MPI_UINT64_T, MPI_SUM, p->communicator);
    p->choice = (struct kiln_backend_choice){
        .asked = (job->machine.backend == NULL || strcmp(job->machine.backend, "auto") == 0) && !care->device_first};
    const int status = p->rank == 0 ? kiln_backend_ask(&p->choice, job, p->scene, &known, error) : KILN_OK;
    (void)MPI_Bcast(&p->choice, (int)sizeof p->choice, MPI_BYTE, 0, p->communicator);
    kiln_backend_predict(&p->choice);
    return kiln_agree(p->communicator, status, error);
}

/* The name of the backend that the job asks for; for `auto` the one that is predicted to be quicker. */
static const char *choose_backend(const struct kiln_prepared *p, const struct kiln_job *job)
{
    if (p->choice.asked && p->choice.processors)
        return "embree";
    return job->machine.backend != NULL ? job->machine.backend : "auto";
}

/* Passes that run for certain, whatever the scene is: bit KILN_PASS_INDEX_... */
static uint32_t passes_of(const struct kiln_job *job)
{
    const bool gathers = job->light.bounces != 0 && !kiln_job_is_reference(job) && !kiln_job_is_radiosity(job);
    return 1u << KILN_PASS_INDEX_validity | (uint32_t)(job->light.samples_direct > 0) << KILN_PASS_INDEX_direct |
           (uint32_t)gathers << KILN_PASS_INDEX_gather;
}

/* Parameters to start a device with. */
static struct kiln_backend_params device_params(const struct kiln_prepared *p, const struct kiln_job *job,
                                                const struct kiln_prepare_care *care)
{
    struct kiln_backend_params params = {.threads = p->threads,
                                         .instruction_set = p->instruction_set,
                                         .seed = job->light.seed,
                                         .tree_memory = kiln_tree_memory(job, p->node_ranks),
                                         .chain_length = job->light.chain_length,
                                         .rays = kiln_backend_rays(&p->choice) / (double)p->ranks,
                                         .passes = passes_of(job),
                                         .regresses = kiln_job_denoises(job),
                                         .stop = stop_of(care)};
    kiln_devices_choose(job, p->node_rank, p->node_ranks, &params);
    return params;
}

/* Begins to start a device for the backend `name`, unless a start is under way already. */
static void begin_device(struct kiln_prepared *p, const struct kiln_job *job, const char *name,
                         const struct kiln_prepare_care *care)
{
    const struct kiln_backend_params params = device_params(p, job, care);
    if (p->start == NULL)
        kiln_backend_begin(&p->start, name, &params);
}

/* ---- building a backend in the background ---- */

/* A backend that is built in the background. The time goes partly into one thread's work, partly into waiting for
 * drivers. */
struct kiln_backend_building {
    pthread_t thread;
    const char *name;
    struct kiln_backend_params params;
    struct kiln_backend *backend;
    struct kiln_aside aside;
    int status;
    struct kiln_error error;
};

static void *build(void *context)
{
    struct kiln_backend_building *b = context;
    omp_set_num_threads((int)b->params.threads); /* of this thread's loops */
    b->aside.begin = kiln_clock_seconds();
    b->status = kiln_backend_create(&b->backend, b->name, &b->params, &b->error);
    b->aside.end = kiln_clock_seconds();
    return NULL;
}

/* False: there is no thread for it. */
static bool begin_building(struct kiln_prepared *p, const char *name, const struct kiln_backend_params *params)
{
    struct kiln_backend_building *b = NULL;
    if (kiln_allocate(&b, 1, sizeof *b, "the start of a backend", NULL) != KILN_OK)
        return false;
    b->name = name;
    b->params = *params;
    b->aside.count = 1;
    if (kiln_thread_start(&b->thread, build, b))
        p->building = b;
    else
        kiln_free(&b);
    return p->building != NULL;
}

/* Waits for the backend, if it is being built. Not collective. */
static int end_building(struct kiln_prepared *p, struct kiln_error *error)
{
    struct kiln_backend_building *b = p->building;
    const double start = kiln_clock_seconds();
    if (b == NULL)
        return KILN_OK;
    (void)pthread_join(b->thread, NULL);
    p->backend = b->backend;
    p->built = b->aside;
    p->built.waited = fmax(p->built.end - fmax(start, p->built.begin), 0.0);
    const int status = b->status;
    if (status != KILN_OK && error != NULL)
        *error = b->error;
    kiln_free(&p->building);
    kiln_backend_start_end(&p->start);
    return status;
}

/* Whether the backend is built in the background. It is not if Embree is asked for or predicted to be faster:
 * processors then have no idle time. Nor is it in plans, which time one thing after the other. Embree in place of a
 * missing device is built in the background, too. */
static bool builds_beside(const char *backend, const struct kiln_prepare_care *care)
{
    return care->control != NULL && kiln_backend_may_use_device(backend);
}

/* Collective. Builds what backends need of an open scene, geometry and lights, and creates the backend or begins to. */
static int build_backend(struct kiln_prepared *p, const struct kiln_job *job, const struct kiln_prepare_care *care,
                         struct kiln_error *error)
{
    if (job->lightmaps.store != KILN_STORE_KIND_LIGHTMAP)
        p->leaf_size = job->lightmaps.leaf_size > 0.0 ? job->lightmaps.leaf_size
                                                      : 1.0 / (double)p->scene->header->texels_per_metre;
    int status = reckon(p, job, care, error);
    if (status != KILN_OK)
        return status;
    const char *backend = choose_backend(p, job);
    begin_device(p, job, backend, care);
    status = go_on(p, care, share_geometry(p, error), error);
    if (status == KILN_OK)
        status = kiln_lights_create(&p->lights, p->scene, p->geometry, error);
    if (status == KILN_OK && job->light.patches.lights == KILN_LIGHTS_PATCHES)
        status = kiln_lights_create_without_areas(&p->direct_lights, p->scene, p->geometry, error);
    if (status == KILN_OK) {
        struct kiln_backend_params params = device_params(p, job, care);
        params.scene = p->scene;
        params.geometry = p->geometry;
        params.lights = p->lights;
        params.direct_lights = p->direct_lights;
        params.start = p->start;
        if (!builds_beside(backend, care) || !begin_building(p, backend, &params)) {
            status = kiln_backend_create(&p->backend, backend, &params, error);
            kiln_backend_start_end(&p->start);
        }
    }
    return go_on(p, care, status, error);
}

static int build_world(struct kiln_prepared *p, const struct kiln_job *job, const char *scene_file,
                       const struct kiln_prepare_care *care, struct kiln_error *error)
{
    int status = agree_on_instruction_set(p, job->machine.instruction_set, error);
    if (status == KILN_OK)
        status = kiln_scene_open(&p->scene, scene_file, error);
    status = go_on(p, care, status, error);
    if (status == KILN_OK)
        status = check_same_scene(p, scene_file, error);
    if (status == KILN_OK)
        status = kiln_agree(p->communicator, kiln_materials_check(job, p->scene, error), error);
    if (status == KILN_OK)
        status =
            kiln_agree(p->communicator, kiln_points_memory_check(p->scene, job, p->ranks, p->node_ranks, error), error);
    if (status == KILN_OK)
        status = kiln_agree(p->communicator,
                            kiln_scene_take_gloss(p->scene, (enum kiln_gloss_mode)job->light.materials, error), error);
    if (status == KILN_OK)
        status = refuse(p, care, error);
    return status == KILN_OK ? build_backend(p, job, care, error) : status;
}

/* Collective over the node. Moves an array that is the same on all ranks of the node to a shared block. If there is no
 * memory for the block, the array stays where it is. */
static bool share_array(struct kiln_prepared *p, void *pointer, size_t count, size_t size, const char *what)
{
    void *own, *block;
    memcpy(&own, pointer, sizeof own);
    if (kiln_node_region(p->node, &block, count, size, what, NULL) != KILN_OK)
        return false;
    if (kiln_node_rank(p->node) == 0)
        memcpy(block, own, count * size);
    kiln_free(&own);
    memcpy(pointer, &block, sizeof block);
    return true;
}

/* Collective. Shares the map of the surface, which is the same on all ranks. */
static void share_map(struct kiln_prepared *p)
{
    struct kiln_surface *s = p->surface;
    if (kiln_node_ranks(p->node) == 1 || kiln_node_full(p->node))
        return;
    struct kiln_tile *tiles = s->tiles;
    if (!share_array(p, &tiles, s->tile_count, sizeof *s->tiles, "the lightmap tiles"))
        return;
    /* from here on the node owns the whole map; small arrays that do not fit into shared memory stay allocated to the
     * end */
    s->tiles = tiles;
    s->global_is_borrowed = true;
    (void)share_array(p, &s->splits, s->split_count, sizeof *s->splits, "the split lightmap tiles");
    if (s->divided_count > 0)
        (void)share_array(p, &s->divided, s->divided_count, sizeof *s->divided, "divided texels");
    if (s->part_count > 0)
        (void)share_array(p, &s->parts, s->part_count, sizeof *s->parts, "the parts of texels");
    (void)share_array(p, &s->lightmaps, s->map_count, sizeof *s->lightmaps, "the lightmaps");
    if (s->bricks != NULL) {
        (void)share_array(p, &s->bricks, s->tile_count, sizeof *s->bricks, "the bricks");
        (void)share_array(p, &s->slots, s->slot_count, sizeof *s->slots, "the slots of bricks");
    }
    if (s->cell_first != NULL)
        (void)share_array(p, &s->cell_first, s->cell_count + 1, sizeof *s->cell_first, "the cells");
    kiln_node_wait(p->node);
}

/* Collective. Counts the points and tile runs of the surface again, whose divided texels have several points each. */
static void count_again(struct kiln_prepared *p)
{
    const struct kiln_surface *s = p->surface;
    struct kiln_surface_report *report = &p->surface_report;
    uint64_t sums[] = {s->count, s->tile_run_count}, most[] = {s->count, UINT64_MAX - s->count};
    MPI_Allreduce(MPI_IN_PLACE, sums, 2, MPI_UINT64_T, MPI_SUM, p->communicator);
    MPI_Allreduce(MPI_IN_PLACE, most, 2, MPI_UINT64_T, MPI_MAX, p->communicator);
    report->points = sums[0];
    report->tile_runs = sums[1];
    report->points_max = most[0];
    report->points_min = UINT64_MAX - most[1];
    if (report->points > 0)
        report->imbalance = (double)report->points_max / ((double)report->points / p->ranks) - 1.0;
}

/* Collective. Builds the surface of the scene as it is now. */
static int find_surface(const struct kiln_prepared *p, const struct kiln_job *job,
                        const struct kiln_surface_exchange *exchange, const struct kiln_stop *stop,
                        struct kiln_surface **surface, struct kiln_surface_report *report, struct kiln_error *error)
{
    const struct kiln_surface_params params = {
        .scene = p->scene,
        .geometry = p->geometry,
        .cell_size = job->ranks.cell_size,
        .partition = job->ranks.partition_objects ? KILN_PARTITION_OBJECTS : KILN_PARTITION_CELLS,
        .whole_tiles = job->light.indirect_scale > 0 || job->light.final_scale > 0 || job->light.guide > 0,
        .both_sides = job->lightmaps.both_sides,
        .rank = (uint32_t)p->rank,
        .ranks = (uint32_t)p->ranks,
        .exchange = p->ranks > 1 ? exchange : NULL,
        .threads = p->threads,
        .stop = stop};
    return kiln_agree(p->communicator, kiln_surface_build(surface, &params, report, error), error);
}

int kiln_prepare_albedo(const struct kiln_prepared *p, const struct kiln_job *job, uint16_t **albedo,
                        struct kiln_error *error)
{
    struct kiln_surface_meeting meeting = {.communicator = p->communicator};
    const struct kiln_surface_exchange exchange = kiln_surface_exchange_over(&meeting);
    struct kiln_surface *surface = NULL;
    struct kiln_surface_report report;
    *albedo = NULL;
    int status = find_surface(p, job, &exchange, NULL, &surface, &report, error);
    if (status == KILN_OK)
        status = kiln_agree(p->communicator,
                            kiln_divide_texels(surface, p->scene, p->geometry, p->backend, p->threads,
                                               p->ranks > 1 ? &exchange : NULL, NULL, error),
                            error);
    if (status != KILN_OK) {
        kiln_surface_destroy(&surface);
        return status;
    }
    if (surface->count != p->surface->count || surface->first.at != p->surface->first.at)
        status = kiln_fail(error, KILN_BUG, "the surface has other points with other colours");
    *albedo = surface->albedo;
    surface->albedo = NULL;
    kiln_surface_destroy(&surface);
    return kiln_agree(p->communicator, status, error);
}

static int build_surface(struct kiln_prepared *p, const struct kiln_job *job, const struct kiln_prepare_care *care,
                         struct kiln_error *error)
{
    struct kiln_surface_meeting meeting = {.communicator = p->communicator};
    const struct kiln_surface_exchange exchange = kiln_surface_exchange_over(&meeting);
    int status;
    KILN_TRY(find_surface(p, job, &exchange, stop_of(care), &p->surface, &p->surface_report, error));
    KILN_TRY(go_on(p, care, end_building(p, error), error));
    KILN_TRY(kiln_divide_texels(p->surface, p->scene, p->geometry, p->backend, p->threads,
                                p->ranks > 1 ? &exchange : NULL, stop_of(care), error));
    count_again(p);
    share_map(p);
    KILN_TRY(kiln_backend_set_surface(p->backend, p->surface, error));
end:
    status = go_on(p, care, status, error);
    return status == KILN_OK ? refuse(p, care, error) : status;
}

/* ---- validity ---- */

/* State of the validity pass on this rank. */
struct validity_work {
    struct kiln_prepared *p;
    struct kiln_control *control; /* NULL: none */
    struct kiln_progress *progress;
    size_t next, batch; /* tile runs */
};

static int run_batch(struct validity_work *w, double *seconds, struct kiln_error *error)
{
    const struct kiln_surface *s = w->p->surface;
    const size_t left = s->tile_run_count - w->next, count = left < w->batch ? left : w->batch;
    const double start = MPI_Wtime(), wanted = w->control != NULL ? 0.5 * kiln_control_batch_seconds(w->control) : 1.0;
    const struct kiln_batch items = {
        .first = w->next, .count = count, .take = kiln_validity_keep, .context = w->p->surface};
    uint64_t rays = 0; /* not reported: validity rays sample no light */
    const int status = kiln_backend_run(w->p->backend, &kiln_pass_validity, NULL, &items, &rays, error);
    *seconds = MPI_Wtime() - start;
    w->next += count;
    kiln_progress_advance(w->progress, w->next);
    if (*seconds < 0.5 * wanted)
        w->batch = 2 * w->batch < MOST_TILE_RUNS ? 2 * w->batch : MOST_TILE_RUNS;
    else if (*seconds > 2.0 * wanted && w->batch > 1)
        w->batch /= 2;
    return status;
}

/* Runs until this rank is done; with a control, until all ranks are done or the control ends the pass. */
static int run_validity(struct validity_work *w, struct kiln_error *error)
{
    const size_t count = w->p->surface->tile_run_count;
    int status = KILN_OK;
    for (;;) {
        enum kiln_event event = KILN_EVENT_DONE;
        double seconds = 0.0;
        const bool works = status == KILN_OK && w->next < count;
        if (works)
            status = run_batch(w, &seconds, error);
        const bool done = w->next == count;
        const double share = count > 0 ? (double)w->next / (double)count : 1.0;
        if (w->control != NULL)
            event = works ? kiln_control_poll(w->control, done, share, seconds, status)
                          : kiln_control_wait(w->control, done, share, status, NULL, NULL);
        else if (status == KILN_OK && !done)
            event = KILN_EVENT_NONE;
        if (event == KILN_EVENT_DONE || event == KILN_EVENT_FAIL)
            return kiln_agree(w->p->communicator, status, error);
        if (event == KILN_EVENT_STOP) /* nothing has been computed yet that a checkpoint could keep */
            return kiln_agree(w->p->communicator, status != KILN_OK ? status : kiln_give_up(error), error);
    }
}

static int find_valid_points(struct kiln_prepared *p, const struct kiln_prepare_care *care,
                             struct kiln_progress *progress, struct kiln_error *error)
{
    struct validity_work w = {.p = p, .control = care->control, .progress = progress, .batch = FIRST_TILE_RUNS};
    if (w.control != NULL)
        kiln_control_begin(w.control, "validity");
    const int status = run_validity(&w, error);
    if (status == KILN_OK)
        kiln_surface_leave_walls_out(p->surface);
    return status;
}

int kiln_prepare(struct kiln_prepared **prepared, MPI_Comm communicator, const struct kiln_job *job,
                 const char *scene_file, struct kiln_phases *phases, struct kiln_progress *progress,
                 const struct kiln_prepare_care *care, struct kiln_error *error)
{
    struct kiln_prepared *p = NULL;
    care = care != NULL ? care : &careless;
    int status;
    KILN_TRY(kiln_agree(communicator, kiln_allocate(&p, 1, sizeof *p, "the run", error), error));
    p->communicator = communicator;
    KILN_TRY(learn_about_ranks(p, job, error));
    kiln_phase(phases, "import");
    kiln_progress_phase(progress, "import", 0);
    KILN_TRY(import_scene(p, job, scene_file, care, error));
    kiln_phase(phases, "scene and BVH");
    kiln_progress_phase(progress, "scene and BVH", 0);
    KILN_TRY(build_world(p, job, scene_file, care, error));
    kiln_phase(phases, "surface points");
    kiln_progress_phase(progress, "surface points", 0);
    KILN_TRY(build_surface(p, job, care, error));
    kiln_phase(phases, "validity");
    kiln_progress_phase(progress, "validity", p->surface->tile_run_count);
    p->first_pass = MPI_Wtime();
    KILN_TRY(find_valid_points(p, care, progress, error));
end:
    kiln_phase(phases, NULL);
    if (status != KILN_OK)
        kiln_prepared_destroy(&p);
    *prepared = p;
    return status;
}

/* A view of the scene whose lightmaps have half as many texels a side. */
static int halve_lightmaps(struct kiln_prepared *p, const struct kiln_scene *scene, struct kiln_error *error)
{
    int status = kiln_allocate(&p->coarser, scene->object_count, sizeof *p->coarser, "coarser lightmaps", error);
    if (status == KILN_OK)
        status = kiln_allocate(&p->scene, 1, sizeof *p->scene, "coarser lightmaps", error);
    if (status != KILN_OK)
        return status;
    *p->scene = *scene;
    p->scene->objects = p->coarser;
    for (size_t i = 0; i < scene->object_count; i++) {
        p->coarser[i] = scene->objects[i];
        p->coarser[i].lightmap_width = (scene->objects[i].lightmap_width + 1) / 2;
        p->coarser[i].lightmap_height = (scene->objects[i].lightmap_height + 1) / 2;
    }
    return KILN_OK;
}

int kiln_prepare_coarser(struct kiln_prepared **prepared, const struct kiln_prepared *fine, const struct kiln_job *job,
                         struct kiln_control *control, struct kiln_error *error)
{
    const struct kiln_prepare_care care = {.control = control};
    struct kiln_prepared *p = NULL;
    int status;
    KILN_TRY(kiln_agree(fine->communicator, kiln_allocate(&p, 1, sizeof *p, "the run", error), error));
    p->communicator = fine->communicator;
    memcpy(p->instruction_set, fine->instruction_set, sizeof p->instruction_set);
    KILN_TRY(learn_about_ranks(p, job, error));
    KILN_TRY(go_on(p, &care, halve_lightmaps(p, fine->scene, error), error));
    KILN_TRY(build_backend(p, job, &care, error));
    KILN_TRY(build_surface(p, job, &care, error));
    KILN_TRY(find_valid_points(p, &care, NULL, error));
end:
    if (status != KILN_OK)
        kiln_prepared_destroy(&p);
    *prepared = p;
    return status;
}

void kiln_prepared_destroy(struct kiln_prepared **prepared)
{
    struct kiln_prepared *p = *prepared;
    if (p == NULL)
        return;
    (void)end_building(p, NULL);
    kiln_backend_start_end(&p->start);
    kiln_backend_destroy(&p->backend);
    kiln_surface_destroy(&p->surface);
    kiln_lights_destroy(&p->lights);
    kiln_lights_destroy(&p->direct_lights);
    kiln_geometry_destroy(&p->geometry);
    if (p->coarser != NULL)
        kiln_free(&p->scene);
    else
        kiln_scene_close(&p->scene);
    kiln_free(&p->coarser);
    kiln_free(&p->enclosed);
    kiln_scene_import_release(&p->import);
    kiln_node_destroy(&p->node);
    kiln_free(prepared);
}
