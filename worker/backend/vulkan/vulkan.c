#include "worker/backend/vulkan/vulkan.h"

#include <assert.h>
#include <omp.h>
#include <stdio.h>
#include <string.h>

#include "shaders/shared/chain.h"
#include "worker/backend/vulkan/held.h"
#include "worker/backend/vulkan/kept_rows.h"
#include "worker/backend/vulkan/regression.h"
#include "worker/backend/vulkan/resources.h"
#include "worker/base/memory.h"

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
    int status;
    KILN_TRY(gpu_buffer_of(b->gpu, &b->records, g->records, g->triangle_count * sizeof *g->records,
                           "what rays need to know of triangles", error));
    KILN_TRY(vulkan_materials_create(b->gpu, &b->params, b->all_materials, &b->materials, &b->layout.materials, error));
    if (b->params.lights != NULL)
        KILN_TRY(vulkan_lights_create(b->gpu, b->params.lights, b->float64, &b->lights, &b->layout.lights, error));
    KILN_TRY(gpu_buffer_create(b->gpu, &b->scene, sizeof b->layout, GPU_DEVICE, "the scene", error));
    if (b->params.direct_lights != NULL)
        KILN_TRY(upload_direct_lights(b, error));
end:
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

/* ---- who is there ---- */

#define ROW(name) [KILN_PASS_INDEX_##name] = &vulkan_pass_##name,
static const struct vulkan_pass *const passes[KILN_PASS_COUNT] = {KILN_PASS_LIST_OF_ALL(ROW)}; /* NULL: not here */
#undef ROW

/* Begins to compile the kernels that the backend's passes (params.passes) will need, each in a thread, without waiting.
 * With `surface` also allocates the memory for their answers; without it only compiles kernels that do not depend on
 * the surface. On software devices all this is done when needed. */
static void kernels_ahead(struct vulkan_backend *b, bool surface)
{
    for (int p = 0; p < KILN_PASS_COUNT && vulkan_has_makers(b); p++) {
        if (passes[p] == NULL || (b->params.passes >> p & 1u) == 0)
            continue;
        const struct vulkan_wish *wishes = passes[p]->ahead;
        for (int i = 0; i < VULKAN_WISHES && wishes[i].shader != NULL; i++)
            if ((wishes[i].wanted == NULL || wishes[i].wanted(b)) &&
                (surface || !vulkan_hangs_on_surface(b, &wishes[i])))
                vulkan_kernels_at_once(b, &wishes[i], 1);
    }
    if (surface && vulkan_has_makers(b))
        vulkan_passes_ahead(b);
    if (surface && b->params.regresses)
        vulkan_regression_ahead(b);
}

/* ---- life ---- */

/* Numbers of kernels found in the cache and compiled, on this device and earlier ones. */
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
    for (int i = 0; i < GPU_SLOTS; i++) {
        gpu_buffer_destroy(b->gpu, &b->slots[i].scratch);
        gpu_buffer_destroy(b->gpu, &b->slots[i].answers);
        gpu_buffer_destroy(b->gpu, &b->slots[i].host);
        gpu_buffer_destroy(b->gpu, &b->slots[i].guides);
        gpu_buffer_destroy(b->gpu, &b->slots[i].guides_host);
    }
    for (int p = 0; p < KILN_PASS_COUNT; p++)
        if (passes[p] != NULL && passes[p]->release != NULL)
            passes[p]->release(b);
    vulkan_held_release(b);
    vulkan_regression_release(b);
    vulkan_resources_release(b);
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
    return b->float64 ? KILN_OK : gpu_code_read(b->gpu, &kiln_code_file, error);
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

/* Creates the device again, with all resources. */
static int make_anew(struct vulkan_backend *b, struct kiln_error *error)
{
    clear(b);
    int status;
    KILN_TRY(start_device(b, error));
    KILN_TRY(set_up(b, error));
    KILN_TRY(vulkan_resources_bring(b, error));
end:
    return status;
}

enum { SCRATCH_PART = 16 };

/* Scratch memory. Sums of points with many samples need much, and chunks with few points leave most of a large device
 * idle. */
static uint64_t scratch_of(const struct gpu *gpu)
{
    const uint64_t part = gpu_about(gpu)->software ? 0 : gpu_memory_left(gpu) / SCRATCH_PART;
    return part > VULKAN_USUAL_SCRATCH ? part : VULKAN_USUAL_SCRATCH;
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
    b->make_anew = make_anew;
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
        kernels_ahead(b, false);
    else
        vulkan_destroy(backend);
    return status;
}

static int vulkan_set(struct kiln_backend *backend, enum kiln_resource_index index, struct kiln_error *error)
{
    struct vulkan_backend *b = (struct vulkan_backend *)backend;
    if (index == KILN_RESOURCE_surface)
        b->surface = b->own = backend->given.surface;
    if (index == KILN_RESOURCE_surface || index == KILN_RESOURCE_radiosity)
        b->radiosity = index == KILN_RESOURCE_radiosity ? backend->given.radiosity : NULL;
    b->probes = backend->given.probes;
    const int status = vulkan_resource_bring(b, index, error);
    if (status == KILN_OK && index == KILN_RESOURCE_surface)
        kernels_ahead(b, true);
    return status != KILN_OK && vulkan_can_recover(b) ? vulkan_recover(b, error) : status;
}

/* ---- what it tells ---- */

/* Adds a kernel's name, unless it is there: a kernel may have several variants. */
static void add_kernel(struct kiln_backend_info *info, const char *name)
{
    for (size_t i = 0; i < info->kernel_count; i++)
        if (strcmp(info->kernels[i], name) == 0)
            return;
    if (info->kernel_count < KILN_KERNELS_MOST)
        info->kernels[info->kernel_count++] = name;
}

/* Flags for passes that allow any numbers of samples; and for passes that run in chunks, without data for a whole
 * batch. */
enum {
    MIXED = 1 << KILN_PASS_INDEX_direct,
    CLAIMS = 1 << KILN_PASS_INDEX_direct | 1 << KILN_PASS_INDEX_gather | 1 << KILN_PASS_INDEX_guided |
             1 << KILN_PASS_INDEX_caustic | 1 << KILN_PASS_INDEX_occlusion | 1 << KILN_PASS_INDEX_directional
};

/* Returns the mean seconds to upload a point, measured so far. */
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
                                       .on_device = true,
                                       .makes_kernels = true,
                                       .computes_for_others = b->gpu != NULL,
                                       .keeps_points = true,
                                       .point_seconds = point_seconds(b),
                                       .mixed = MIXED,
                                       .claims = CLAIMS,
                                       .regresses = b->gpu != NULL && !gpu_about(b->gpu)->software};
    (void)snprintf(info->device, sizeof info->device, "%s", b->device_text);
    memcpy(info->slowest, b->slowest, sizeof info->slowest);
    count_kernels(b, &info->kernels_found, &info->kernels_made);
    for (size_t i = 0; i < b->kernel_count; i++)
        if (b->kernels[i].ran)
            add_kernel(info, b->kernels[i].shader->name);
}

/* ---- passes ---- */

static bool vulkan_takes(const struct kiln_backend *backend, const struct kiln_pass *pass, const void *parameters)
{
    const struct vulkan_pass *p = passes[pass->index];
    return p != NULL && (p->takes == NULL || p->takes((const struct vulkan_backend *)backend, parameters));
}

static void vulkan_expect(struct kiln_backend *backend, const struct kiln_pass *pass, const void *parameters)
{
    struct vulkan_backend *b = (struct vulkan_backend *)backend;
    const struct vulkan_pass *p = passes[pass->index];
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
    return passes[pass->index]->run(b, parameters, batch, rays, error);
}

static const struct kiln_backend_extras extras = {
    .ceiling = vulkan_ceiling,
    .replay = vulkan_replay,
    .hold = vulkan_hold,
    .hold_step = vulkan_hold_step,
    .hold_fetch = vulkan_hold_fetch,
    .regress = vulkan_regress,
};

const struct kiln_backend_api kiln_backend_vulkan = {
    .name = "vulkan",
    .begin = vulkan_begin,
    .create = vulkan_create,
    .destroy = vulkan_destroy,
    .devices = gpu_list,
    .info = vulkan_info,
    .set = vulkan_set,
    .mixed = MIXED,
    .claims = CLAIMS,
    .run = vulkan_run,
    .takes = vulkan_takes,
    .expect = vulkan_expect,
    .intersect = vulkan_intersect,
    .extras = &extras,
};
