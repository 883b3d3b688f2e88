#include "worker/backend/vulkan/vulkan.h"

#include <assert.h>
#include <omp.h>
#include <stdio.h>
#include <string.h>

#include "shaders/shared/chain.h"
#include "worker/backend/vulkan/bright.h"
#include "worker/backend/vulkan/chunks.h"
#include "worker/backend/vulkan/groups.h"
#include "worker/backend/vulkan/held.h"
#include "worker/backend/vulkan/kept_rows.h"
#include "worker/backend/vulkan/regression.h"
#include "worker/backend/vulkan/spheres.h"
#include "worker/backend/vulkan/visibility.h"
#include "worker/base/memory.h"
#include "worker/sampling/sequence.h"

#include "shaders/intersect.h"
#include "shaders/intersect_pipeline.h"

static const struct vulkan_shader intersect_shader = {
    .name = "intersect", .compute = VULKAN_CODE(intersect), .pipeline = VULKAN_CODE(intersect_pipeline)};

/* ---- the scene on the device ---- */

static int upload_direct_lights(struct vulkan_backend *b, struct kiln_error *error)
{
    const int status =
        vulkan_lights_create(b->gpu, b->params.direct_lights, b->float64, &b->direct_lights, &b->direct_layout, error);
    return status == KILN_OK ? gpu_buffer_create(b->gpu, &b->direct_scene, sizeof b->layout, GPU_DEVICE,
                                                 "the scene of direct light", error)
                             : status;
}

static int upload_scene(struct vulkan_backend *b, struct kiln_error *error)
{
    const struct kiln_geometry *g = b->params.geometry;
    b->all_materials = b->all_materials || vulkan_materials_take_gloss(b->params.scene);
    int status = gpu_buffer_of(b->gpu, &b->records, g->records, g->triangle_count * sizeof *g->records,
                               "what rays need to know of triangles", error);
    if (status == KILN_OK)
        status =
            vulkan_materials_create(b->gpu, &b->params, b->all_materials, &b->materials, &b->layout.materials, error);
    if (status == KILN_OK && b->params.lights != NULL)
        status = vulkan_lights_create(b->gpu, b->params.lights, b->float64, &b->lights, &b->layout.lights, error);
    if (status == KILN_OK)
        status = gpu_buffer_create(b->gpu, &b->scene, sizeof b->layout, GPU_DEVICE, "the scene", error);
    if (status == KILN_OK && b->params.direct_lights != NULL)
        status = upload_direct_lights(b, error);
    b->layout.records = b->records.address;
    b->layout.opaque_count = (uint32_t)g->opaque_count;
    b->constants[VULKAN_HAS_ALPHA] = g->passage;
    b->constants[VULKAN_HAS_COINCIDENT] = g->coincident;
    b->constants[VULKAN_LIGHT_KINDS] = b->lights.kinds;
    for (size_t i = 0; i < b->params.scene->mesh_count; i++)
        b->constants[VULKAN_HAS_SMOOTH] |= (b->params.scene->meshes[i].flags & KILN_MESH_SMOOTH) != 0;
    b->layout.chain_length = b->params.chain_length != 0 ? b->params.chain_length : KILN_CHAIN_LENGTH;
    return status == KILN_OK && b->materials.gloss ? vulkan_surfaces(b, error) : status;
}

/* The root of everything: after each change of an address. */
int vulkan_upload_root(struct vulkan_backend *b, struct kiln_error *error)
{
    const int status = gpu_upload(b->gpu, &b->scene, 0, &b->layout, sizeof b->layout, error);
    if (status != KILN_OK || b->params.direct_lights == NULL)
        return status;
    struct kiln_gpu_scene direct = b->layout;
    direct.lights = b->direct_layout;
    return gpu_upload(b->gpu, &b->direct_scene, 0, &direct, sizeof direct, error);
}

/* ---- radiance probes ---- */

static void clear_probes(struct vulkan_backend *b)
{
    gpu_buffer_destroy(b->gpu, &b->probes_root);
    gpu_buffer_destroy(b->gpu, &b->probe_positions);
    gpu_buffer_destroy(b->gpu, &b->probe_data);
}

/* Copies the probes to the device, in the place of those before. */
static int upload_probes(struct vulkan_backend *b, struct kiln_error *error)
{
    const struct kiln_radiance_probes *p = b->probes;
    clear_probes(b);
    if (p == NULL)
        return KILN_OK;
    const size_t count = (size_t)kiln_probes_count(&p->grid);
    int status = gpu_buffer_of(b->gpu, &b->probe_positions, p->positions, count * sizeof *p->positions,
                               "the positions of radiance probes", error);
    if (status == KILN_OK)
        status = gpu_buffer_of(b->gpu, &b->probe_data, p->data, count * p->grid.floats * sizeof *p->data,
                               "the radiance of probes", error);
    const struct kiln_gpu_radiance_probes root = {
        .grid = p->grid, .positions = b->probe_positions.address, .data = b->probe_data.address};
    if (status == KILN_OK)
        status = gpu_buffer_of(b->gpu, &b->probes_root, &root, sizeof root, "radiance probes", error);
    return status;
}

/* ---- life ---- */

/* Back to the own points. */
static void leave_others(struct vulkan_backend *b)
{
    if (b->own_points == NULL)
        return;
    vulkan_points_destroy(&b->points);
    b->points = b->own_points;
    b->own_points = NULL;
    b->surface = b->own;
}

static void clear_surface(struct vulkan_backend *b)
{
    leave_others(b);
    vulkan_points_destroy(&b->points);
    for (size_t i = 0; i < KILN_STORE_ARRAYS; i++)
        gpu_buffer_destroy(b->gpu, &b->store_arrays[i]);
    gpu_buffer_destroy(b->gpu, &b->radiosity_buffer);
}

/* Kernels found and compiled, of this device and those before it. */
static void count_kernels(const struct vulkan_backend *b, uint64_t *found, uint64_t *made)
{
    uint64_t now[2] = {0, 0};
    if (b->gpu != NULL)
        gpu_kernels_count(b->gpu, &now[0], &now[1]);
    *found = b->kernels_found + now[0];
    *made = b->kernels_made + now[1];
}

/* Everything that lives on the device, and the device. */
static void clear(struct vulkan_backend *b)
{
    if (b->gpu == NULL)
        return;
    struct gpu_clock clock;
    gpu_clock_read(b->gpu, &clock);
    b->busy_before += clock.busy;
    count_kernels(b, &b->kernels_found, &b->kernels_made);
    vulkan_forget_kernels(b);
    clear_surface(b);
    clear_probes(b);
    for (int i = 0; i < GPU_SLOTS; i++) {
        gpu_buffer_destroy(b->gpu, &b->slots[i].scratch);
        gpu_buffer_destroy(b->gpu, &b->slots[i].answers);
        gpu_buffer_destroy(b->gpu, &b->slots[i].host);
        gpu_buffer_destroy(b->gpu, &b->slots[i].guides);
        gpu_buffer_destroy(b->gpu, &b->slots[i].guides_host);
    }
    vulkan_bidirectional_release(b);
    vulkan_techniques_release(b);
    vulkan_spheres_release(b);
    vulkan_rows_release(b);
    vulkan_groups_release(b);
    vulkan_held_release(b);
    vulkan_regression_release(b);
    gpu_buffer_destroy(b->gpu, &b->row_lights);
    gpu_buffer_destroy(b->gpu, &b->direction_set);
    vulkan_bright_release(b);
    for (int i = 0; i < VULKAN_LINK_ARRAYS; i++)
        gpu_buffer_destroy(b->gpu, &b->links[i]);
    for (int i = 0; i < VULKAN_LINK_GROUPS; i++) {
        gpu_buffer_destroy(b->gpu, &b->link_rays[i]);
        gpu_buffer_destroy(b->gpu, &b->link_answers[i]);
    }
    gpu_buffer_destroy(b->gpu, &b->patches);
    gpu_buffer_destroy(b->gpu, &b->node_facings);
    gpu_buffer_destroy(b->gpu, &b->node_shapes);
    vulkan_visibility_release(b);
    gpu_buffer_destroy(b->gpu, &b->sobol);
    b->sobol_count = 0;
    gpu_buffer_destroy(b->gpu, &b->rays);
    gpu_buffer_destroy(b->gpu, &b->hits);
    gpu_buffer_destroy(b->gpu, &b->scene);
    vulkan_lights_destroy(b->gpu, &b->lights);
    vulkan_lights_destroy(b->gpu, &b->direct_lights);
    gpu_buffer_destroy(b->gpu, &b->direct_scene);
    vulkan_materials_destroy(b->gpu, &b->materials);
    gpu_buffer_destroy(b->gpu, &b->path_triangles);
    gpu_buffer_destroy(b->gpu, &b->records);
    vulkan_tracer_destroy(b->gpu, &b->tracer);
    gpu_destroy(&b->gpu);
}

static void vulkan_destroy(struct kiln_backend **backend)
{
    struct vulkan_backend *b = (struct vulkan_backend *)*backend;
    if (b == NULL)
        return;
    clear(b);
    kiln_free(&b->kernels);
    kiln_free(&b->results);
    kiln_free(&b->resident);
    kiln_free(backend);
}

/* The device, without a scene. */
static int start_device(struct vulkan_backend *b, struct kiln_error *error)
{
    const struct gpu_choice choice = {.device = (int32_t)b->params.device - 1,
                                      .local_rank = b->params.local_rank,
                                      .local_ranks = b->params.local_ranks,
                                      .slice_seconds = b->params.slice_seconds,
                                      .threads = b->threads,
                                      .memory_limit = b->params.device_memory,
                                      .compute_only = !vulkan_tracer_may_be_pipeline(&b->params),
                                      .faults = &b->faults,
                                      .kernels = b->params.kernels};
    const int status = gpu_create(&b->gpu, &choice, error);
    if (status != KILN_OK)
        return status;
    b->float64 = gpu_about(b->gpu)->float64;
    for (int i = 0; i < VULKAN_PACES; i++)
        b->pacers[i].slice_seconds = gpu_slice(b->gpu);
    return KILN_OK;
}

/* Brings the scene to the device. */
static int set_up(struct vulkan_backend *b, struct kiln_error *error)
{
    int status = upload_scene(b, error);
    const double start = kiln_clock_seconds();
    if (status == KILN_OK)
        status = vulkan_tracer_create(b, error);
    b->build_seconds = kiln_clock_seconds() - start;
    (void)snprintf(b->device_text, sizeof b->device_text, "%.60s, %s%s", gpu_about(b->gpu)->name,
                   vulkan_tracer_name(&b->tracer), b->float64 ? "" : ", no doubles");
    return status;
}

enum { MOST_RECOVERIES = 3, SCRATCH_PART = 16 };
static const uint64_t LEAST_SCRATCH = 1ull << 20;

/* Sums of points with many samples take much room, and chunks of few points leave most of a large device idle. */
static uint64_t scratch_of(const struct gpu *gpu)
{
    const uint64_t part = gpu_about(gpu)->software ? 0 : gpu_memory_left(gpu) / SCRATCH_PART;
    return part > VULKAN_USUAL_SCRATCH ? part : VULKAN_USUAL_SCRATCH;
}

bool vulkan_can_recover(const struct vulkan_backend *b)
{
    return b->gpu != NULL && b->recoveries < MOST_RECOVERIES && (gpu_lost(b->gpu) || gpu_short_of_memory(b->gpu));
}

static int upload_surface(struct vulkan_backend *b, struct kiln_error *error);
static int upload_radiosity(struct vulkan_backend *b, struct kiln_error *error);

int vulkan_recover(struct vulkan_backend *b, struct kiln_error *error)
{
    struct kiln_error why = {"the device failed"};
    if (error != NULL)
        why = *error;
    if (!gpu_lost(b->gpu))
        b->scratch_most /= 2;
    int status = KILN_NO_DEVICE;
    while (status != KILN_OK && b->recoveries < MOST_RECOVERIES && b->scratch_most >= LEAST_SCRATCH) {
        b->recoveries++;
        clear(b);
        status = start_device(b, error);
        if (status == KILN_OK)
            status = set_up(b, error);
        if (status == KILN_OK && b->surface != NULL)
            status = upload_surface(b, error);
        if (status == KILN_OK && b->radiosity != NULL)
            status = upload_radiosity(b, error);
        if (status == KILN_OK)
            status = upload_probes(b, error);
    }
    if (status != KILN_OK)
        return kiln_fail(error, KILN_NO_DEVICE,
                         "%.300s; made anew %u times without success: use --backend embree or another --device",
                         why.message, b->recoveries);
    return KILN_OK;
}

int vulkan_run_to_end(struct vulkan_backend *b, vulkan_run_left run_left, const void *parameters,
                      const struct kiln_batch *batch, uint64_t *rays, struct kiln_error *error)
{
    struct kiln_batch left = *batch;
    bool refused = false;
    int status = run_left(b, parameters, &left, rays, &refused, error);
    while (status != KILN_OK && !refused && vulkan_can_recover(b)) {
        status = vulkan_recover(b, error);
        if (status == KILN_OK)
            status = run_left(b, parameters, &left, rays, &refused, error);
    }
    return status;
}

static int vulkan_begin(struct kiln_backend **backend, const struct kiln_backend_params *params,
                        struct kiln_error *error)
{
    struct vulkan_backend *b = NULL;
    *backend = NULL;
    int status = kiln_allocate(&b, 1, sizeof *b, "the Vulkan backend", error);
    if (status != KILN_OK)
        return status;
    *backend = &b->base;
    b->base.api = &kiln_backend_vulkan;
    b->params = *params;
    b->scratch_most = VULKAN_USUAL_SCRATCH;
    b->all_threads = params->threads != 0 ? params->threads : (uint32_t)omp_get_num_procs();
    b->threads = vulkan_light_threads(b->all_threads);
    b->faults.wanted = params->faults;
    status = start_device(b, error);
    if (status != KILN_OK)
        vulkan_destroy(backend);
    return status;
}

static int vulkan_create(struct kiln_backend **backend, const struct kiln_backend_params *params,
                         struct kiln_error *error)
{
    struct vulkan_backend *b = (struct vulkan_backend *)*backend;
    b->params = *params;
    int status = set_up(b, error);
    if (status == KILN_OK)
        b->scratch_most = scratch_of(b->gpu);
    else if (vulkan_can_recover(b))
        status = vulkan_recover(b, error);
    if (status == KILN_OK)
        vulkan_kernels_ahead(b, false);
    else
        vulkan_destroy(backend);
    return status;
}

/* Each name once, though a kernel may have several variants. */
static void add_kernel(struct kiln_backend_info *info, const char *name)
{
    for (size_t i = 0; i < info->kernel_count; i++)
        if (strcmp(info->kernels[i], name) == 0)
            return;
    if (info->kernel_count < KILN_KERNELS_MOST)
        info->kernels[info->kernel_count++] = name;
}

struct vulkan_once vulkan_once_begin(void) { return (struct vulkan_once){kiln_clock_seconds(), clock()}; }

void vulkan_once_end(struct vulkan_backend *b, struct vulkan_once begin)
{
    b->once_seconds += kiln_clock_seconds() - begin.seconds;
    b->once_processor += (double)(clock() - begin.processor) / CLOCKS_PER_SEC;
}

/* Passes that take any numbers of samples; and those that run in chunks, with nothing for a whole batch. */
enum {
    MIXED = 1 << KILN_PASS_INDEX_direct,
    CLAIMS = 1 << KILN_PASS_INDEX_direct | 1 << KILN_PASS_INDEX_gather | 1 << KILN_PASS_INDEX_guided |
             1 << KILN_PASS_INDEX_caustic | 1 << KILN_PASS_INDEX_occlusion | 1 << KILN_PASS_INDEX_directional
};

/* What a point takes to come to the device, from those that have come. */
static double point_seconds(const struct vulkan_backend *b)
{
    const struct vulkan_points *p = b->own_points != NULL ? b->own_points : b->points;
    return p != NULL && p->brought > 0 ? p->seconds / (double)p->brought : 0.0;
}

static void vulkan_info(const struct kiln_backend *backend, struct kiln_backend_info *info)
{
    const struct vulkan_backend *b = (const struct vulkan_backend *)backend;
    struct gpu_clock clock = {0.0, 0.0};
    if (b->gpu != NULL)
        gpu_clock_read(b->gpu, &clock);
    *info = (struct kiln_backend_info){.name = "vulkan",
                                       .memory = b->gpu != NULL ? gpu_memory_used(b->gpu) : 0,
                                       .build_seconds = b->build_seconds,
                                       .device_seconds = b->busy_before + clock.busy,
                                       .once_seconds = b->once_seconds,
                                       .once_processor = b->once_processor,
                                       .returned = b->returned,
                                       .recoveries = b->recoveries,
                                       .starting = b->base.starting,
                                       .making = b->making,
                                       .take_threads = b->threads,
                                       .computes_for_others = b->gpu != NULL,
                                       .keeps_points = true,
                                       .point_seconds = point_seconds(b),
                                       .mixed = MIXED,
                                       .claims = CLAIMS,
                                       .regresses = b->gpu != NULL && !gpu_about(b->gpu)->software};
    (void)snprintf(info->device, sizeof info->device, "%s", b->device_text);
    count_kernels(b, &info->kernels_found, &info->kernels_made);
    for (size_t i = 0; i < b->kernel_count; i++)
        if (b->kernels[i].ran)
            add_kernel(info, b->kernels[i].shader->name);
}

/* ---- what changes ---- */

/* Copies the store's arrays to the device. */
static int upload_store(struct vulkan_backend *b, const struct kiln_store *store, struct kiln_error *error)
{
    struct kiln_store_array arrays[KILN_STORE_ARRAYS];
    uint64_t addresses[KILN_STORE_ARRAYS];
    int status = KILN_OK;
    kiln_store_arrays(store, arrays);
    for (size_t i = 0; i < KILN_STORE_ARRAYS; i++) {
        const struct kiln_store_array *array = &arrays[i];
        if (status == KILN_OK)
            status = gpu_buffer_of(b->gpu, &b->store_arrays[i], array->data, array->bytes, array->what, error);
        addresses[i] = b->store_arrays[i].address;
    }
    _Static_assert(sizeof b->layout.store == sizeof addresses, "the store's arrays");
    memcpy(&b->layout.store, addresses, sizeof addresses);
    return status;
}

/* To the points of the others, where there are some. */
static int enter_others(struct vulkan_backend *b, struct kiln_error *error)
{
    struct vulkan_points *points;
    if (b->others.surface == NULL)
        return KILN_OK;
    const int status = vulkan_points_of_others(&points, b->points, &b->others, error);
    if (status != KILN_OK)
        return status;
    b->own_points = b->points;
    b->points = points;
    b->surface = b->others.surface;
    return KILN_OK;
}

static int upload_surface(struct vulkan_backend *b, struct kiln_error *error)
{
    struct kiln_store store;
    clear_surface(b);
    const struct kiln_surface *s = b->own;
    kiln_store_build(&store, s, b->params.geometry);
    int status = upload_store(b, &store, error);
    if (status == KILN_OK)
        status = gpu_buffer_create(b->gpu, &b->radiosity_buffer, kiln_store_count(&store) * sizeof(uint64_t),
                                   GPU_DEVICE, "the radiosity of all points", error);
    if (status == KILN_OK)
        status = vulkan_points_create(&b->points, b->gpu, &b->params, s, &b->materials, error);
    b->layout.object_count = s->object_count;
    b->layout.slot_last = s->bricks != NULL ? s->slot_count - 1 : 0;
    b->constants[VULKAN_HAS_DIVIDED] = s->divided_count > 0;
    b->constants[VULKAN_HAS_OCTREE] = s->bricks != NULL;
    b->layout.radiosity = b->radiosity_buffer.address;
    if (status == KILN_OK)
        status = vulkan_upload_root(b, error);
    return status == KILN_OK ? enter_others(b, error) : status;
}

static int upload_radiosity(struct vulkan_backend *b, struct kiln_error *error)
{
    return gpu_fill(b->gpu, &b->radiosity_buffer, 0, b->radiosity, b->surface->point_count * sizeof *b->radiosity,
                    error);
}

static int vulkan_set_surface(struct kiln_backend *backend, const struct kiln_surface *surface,
                              struct kiln_error *error)
{
    struct vulkan_backend *b = (struct vulkan_backend *)backend;
    b->surface = b->own = surface;
    b->others.surface = NULL;
    b->radiosity = NULL;
    const int status = upload_surface(b, error);
    if (status == KILN_OK)
        vulkan_kernels_ahead(b, true);
    return status != KILN_OK && vulkan_can_recover(b) ? vulkan_recover(b, error) : status;
}

static int vulkan_set_others(struct kiln_backend *backend, const struct kiln_others *others, struct kiln_error *error)
{
    struct vulkan_backend *b = (struct vulkan_backend *)backend;
    leave_others(b);
    b->others = *others;
    return enter_others(b, error);
}

static int vulkan_set_radiosity(struct kiln_backend *backend, const uint64_t *radiosity, struct kiln_error *error)
{
    struct vulkan_backend *b = (struct vulkan_backend *)backend;
    b->radiosity = radiosity;
    const int status = upload_radiosity(b, error);
    return status != KILN_OK && vulkan_can_recover(b) ? vulkan_recover(b, error) : status;
}

static int vulkan_set_probes(struct kiln_backend *backend, const struct kiln_radiance_probes *probes,
                             struct kiln_error *error)
{
    struct vulkan_backend *b = (struct vulkan_backend *)backend;
    b->probes = probes;
    if (b->points != NULL)
        vulkan_points_forget_probes(b->points);
    const int status = upload_probes(b, error);
    return status != KILN_OK && vulkan_can_recover(b) ? vulkan_recover(b, error) : status;
}

/* Brings lights and materials anew. Kernels stay, unless there are lights of a kind that they leave out. */
static int upload_light(struct vulkan_backend *b, struct kiln_error *error)
{
    vulkan_bidirectional_release(b);
    vulkan_lights_destroy(b->gpu, &b->lights);
    vulkan_materials_destroy(b->gpu, &b->materials);
    int status =
        vulkan_materials_create(b->gpu, &b->params, b->all_materials, &b->materials, &b->layout.materials, error);
    if (status == KILN_OK)
        status = vulkan_lights_create(b->gpu, b->params.lights, b->float64, &b->lights, &b->layout.lights, error);
    if (status == KILN_OK && (b->lights.kinds & ~b->constants[VULKAN_LIGHT_KINDS]) != 0) {
        b->constants[VULKAN_LIGHT_KINDS] |= b->lights.kinds;
        vulkan_forget_kernels(b);
    }
    return status == KILN_OK ? vulkan_upload_root(b, error) : status;
}

static int vulkan_change_light(struct kiln_backend *backend, struct kiln_error *error)
{
    struct vulkan_backend *b = (struct vulkan_backend *)backend;
    const int status = upload_light(b, error);
    return status != KILN_OK && vulkan_can_recover(b) ? vulkan_recover(b, error) : status;
}

int vulkan_sobol(struct vulkan_backend *b, uint32_t count, struct kiln_error *error)
{
    const bool exact = gpu_guarded(b->gpu);
    if (exact ? b->sobol_count == count : b->sobol_count >= count)
        return KILN_OK;
    const uint32_t room = count < 1024 && !exact ? 1024 : count;
    uint32_t *table = NULL;
    gpu_buffer_destroy(b->gpu, &b->sobol);
    b->sobol_count = 0;
    int status = kiln_allocate(&table, (size_t)room * KILN_DIMENSIONS, sizeof *table, "the samples of a pass", error);
    for (uint32_t d = 0; status == KILN_OK && d < KILN_DIMENSIONS; d++)
        for (uint32_t k = 0; k < room; k++)
            table[(size_t)d * room + k] = kiln_sobol(k, d);
    if (status == KILN_OK)
        status = gpu_buffer_of(b->gpu, &b->sobol, table, (size_t)room * KILN_DIMENSIONS * sizeof *table,
                               "the samples of a pass", error);
    if (status == KILN_OK)
        b->sobol_count = room;
    kiln_free(&table);
    return status;
}

/* ---- any rays ---- */

int vulkan_intersect_on_device(struct vulkan_backend *b, uint64_t origins, uint64_t directions, uint64_t hits,
                               uint32_t count, double *seconds, struct kiln_error *error)
{
    struct gpu_kernel *kernel;
    const int status = vulkan_kernel_of(b, &intersect_shader, false, 0, &kernel, error);
    if (status != KILN_OK)
        return status;
    const struct kiln_gpu_intersect_push push = {
        .scene = b->scene.address, .origins = origins, .directions = directions, .hits = hits, .count = count};
    const struct gpu_step step = {
        .kernel = kernel, .threads_x = count, .threads_y = 1, .constants = &push, .constant_bytes = sizeof push};
    return gpu_run(b->gpu, &step, 1, seconds, error);
}

/* Some rays at once, through buffers that hold `room` of them. */
static int intersect_some(struct vulkan_backend *b, size_t room, const struct kiln_vec3 *origins,
                          const struct kiln_vec3 *directions, size_t count, struct kiln_hit *hits,
                          struct kiln_error *error)
{
    struct kiln_vec3 *from = b->rays.mapped, *to = from + room;
#pragma omp parallel for schedule(static) num_threads((int)b->threads) if (count > 1 << 14)
    for (size_t i = 0; i < count; i++) {
        from[i] = origins[i];
        to[i] = directions[i];
    }
    double seconds;
    const int status = vulkan_intersect_on_device(b, b->rays.address, b->rays.address + room * sizeof *directions,
                                                  b->hits.address, (uint32_t)count, &seconds, error);
    if (status != KILN_OK)
        return status;
    gpu_pacer_learn(&b->pacers[VULKAN_PACE_INTERSECT], count, seconds);
    const struct kiln_gpu_hit *found = b->hits.mapped;
#pragma omp parallel for schedule(static) num_threads((int)b->threads) if (count > 1 << 14)
    for (size_t i = 0; i < count; i++)
        hits[i] = (struct kiln_hit){.triangle = found[i].triangle,
                                    .u = found[i].u,
                                    .v = found[i].v,
                                    .distance = found[i].distance,
                                    .back = found[i].back != 0,
                                    .tint = {found[i].tint[0], found[i].tint[1], found[i].tint[2]}};
    return KILN_OK;
}

int vulkan_intersect(struct kiln_backend *backend, const struct kiln_vec3 *origins, const struct kiln_vec3 *directions,
                     size_t count, struct kiln_hit *hits, struct kiln_error *error)
{
    enum { MOST = 1 << 20 };
    struct vulkan_backend *b = (struct vulkan_backend *)backend;
    const size_t room = count < MOST ? count : MOST;
    int status = vulkan_grow_buffer(b, &b->rays, 2 * room * sizeof *origins, GPU_HOST, "rays", error);
    if (status == KILN_OK)
        status = vulkan_grow_buffer(b, &b->hits, room * sizeof(struct kiln_gpu_hit), GPU_HOST, "hits", error);
    for (size_t done = 0; done < count && status == KILN_OK;) {
        size_t some = gpu_pacer_next(&b->pacers[VULKAN_PACE_INTERSECT], 1 << 16);
        some = some > room ? room : some < 64 ? 64 : some;
        some = some > count - done ? count - done : some;
        status = intersect_some(b, room, origins + done, directions + done, some, hits + done, error);
        done += some;
    }
    return status;
}

/* Starts over after a recovery. */
static int intersect_again(struct kiln_backend *backend, const struct kiln_vec3 *origins,
                           const struct kiln_vec3 *directions, size_t count, struct kiln_hit *hits,
                           struct kiln_error *error)
{
    struct vulkan_backend *b = (struct vulkan_backend *)backend;
    int status = vulkan_intersect(backend, origins, directions, count, hits, error);
    while (status != KILN_OK && vulkan_can_recover(b)) {
        status = vulkan_recover(b, error);
        if (status != KILN_OK)
            return status;
        status = vulkan_intersect(backend, origins, directions, count, hits, error);
    }
    return status;
}

/* ---- passes ---- */

#define ROW(name) [KILN_PASS_INDEX_##name] = &vulkan_pass_##name,
const struct vulkan_pass *const vulkan_passes[KILN_PASS_COUNT] = {KILN_PASS_LIST(ROW)};
#undef ROW

static bool vulkan_takes(const struct kiln_backend *backend, const struct kiln_pass *pass, const void *parameters)
{
    const struct vulkan_pass *p = vulkan_passes[pass->index];
    return !pass->on_embree_only && (p->takes == NULL || p->takes((const struct vulkan_backend *)backend, parameters));
}

static void vulkan_expect(struct kiln_backend *backend, const struct kiln_pass *pass, const void *parameters)
{
    struct vulkan_backend *b = (struct vulkan_backend *)backend;
    const struct vulkan_pass *p = vulkan_passes[pass->index];
    if (b->gpu == NULL)
        return;
    vulkan_kernels_at_once(b, p->ahead, VULKAN_WISHES);
    if (p->expect != NULL)
        p->expect(b, parameters);
}

static int vulkan_run(struct kiln_backend *backend, const struct kiln_pass *pass, const void *parameters,
                      const struct kiln_batch *batch, uint64_t *rays, struct kiln_error *error)
{
    struct vulkan_backend *b = (struct vulkan_backend *)backend;
    assert(!pass->reads_radiosity || b->radiosity != NULL);
    if (!vulkan_takes(backend, pass, parameters))
        return kiln_fail(error, KILN_USAGE, "the Vulkan backend has no %s of this kind: give --backend embree",
                         pass->what);
    return vulkan_passes[pass->index]->run(b, parameters, batch, rays, error);
}

const struct kiln_backend_api kiln_backend_vulkan = {
    .name = "vulkan",
    .begin = vulkan_begin,
    .create = vulkan_create,
    .destroy = vulkan_destroy,
    .devices = gpu_list,
    .info = vulkan_info,
    .set_surface = vulkan_set_surface,
    .set_others = vulkan_set_others,
    .set_radiosity = vulkan_set_radiosity,
    .set_probes = vulkan_set_probes,
    .mixed = MIXED,
    .claims = CLAIMS,
    .run = vulkan_run,
    .takes = vulkan_takes,
    .expect = vulkan_expect,
    .intersect = intersect_again,
    .ceiling = vulkan_ceiling,
    .change_light = vulkan_change_light,
    .replay = vulkan_replay,
    .hold = vulkan_hold,
    .hold_step = vulkan_hold_step,
    .hold_fetch = vulkan_hold_fetch,
    .regress = vulkan_regress,
};
