#include "worker/backend/embree/embree.h"

#include <omp.h>
#include <stdio.h>
#include <string.h>

#include "worker/backend/embree/passage.h"
#include "worker/backend/embree/reference_paths.h"
#include "worker/backend/hand_over.h"
#include "worker/base/memory.h"
#include "worker/light/light_groups.h"
#include "worker/material/scene_lobes.h"
#include "worker/pass/groups.h"

static int embree_failure(RTCDevice device, const char *what, struct kiln_error *error)
{
    const enum RTCError code = rtcGetDeviceError(device);
    if (code == RTC_ERROR_NONE)
        return KILN_OK;
    const char *const names[] = {
        "", "unknown error", "invalid argument", "invalid operation", "out of memory", "unsupported CPU", "cancelled"};
    return kiln_fail(error, code == RTC_ERROR_UNSUPPORTED_CPU ? KILN_NO_DEVICE : KILN_SYSTEM, "Embree, %s: %s", what,
                     code > 0 && (size_t)code < sizeof names / sizeof *names ? names[code] : "error");
}

static void attach(struct embree_backend *b, unsigned id, size_t first, size_t count)
{
    const struct kiln_geometry *g = b->params.geometry;
    if (count == 0)
        return;
    RTCGeometry geometry = rtcNewGeometry(b->device, RTC_GEOMETRY_TYPE_TRIANGLE);
    rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, g->vertices, 0,
                               3 * sizeof(float), g->vertex_count);
    rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, g->indices,
                               first * 3 * sizeof(uint32_t), 3 * sizeof(uint32_t), count);
    rtcSetGeometryMask(geometry, ~0u);
    if (id == 1)
        embree_set_filters(b, geometry);
    rtcCommitGeometry(geometry);
    rtcAttachGeometryByID(b->scene, geometry, id);
    rtcReleaseGeometry(geometry);
}

/* Progress callback of Embree's build threads; false cancels the build. */
static bool goes_on(void *context, double share)
{
    (void)share;
    return !kiln_stop_asked(context);
}

static void embree_destroy(struct kiln_backend **backend)
{
    struct embree_backend *b = (struct embree_backend *)*backend;
    if (b == NULL)
        return;
    if (b->scene != NULL)
        rtcReleaseScene(b->scene);
    if (b->device != NULL)
        rtcReleaseDevice(b->device);
    kiln_free(&b->coincides);
    kiln_free(&b->lobes);
    reference_paths_destroy(&b->reference);
    kiln_free(backend);
}

enum {
    PART_POINTS = 1 << 16,
    TREE_BYTES = 67 /* of the BVH a triangle, unless it is compact: 60 to 67 were measured */
};

static int embree_create(struct kiln_backend **backend, const struct kiln_backend_params *params,
                         struct kiln_error *error)
{
    struct embree_backend *b = NULL;
    *backend = NULL;
    int status = kiln_allocate(&b, 1, sizeof *b, "the Embree backend", error);
    if (status != KILN_OK)
        return status;
    b->base.api = &kiln_backend_embree;
    b->params = *params;
    b->threads = params->threads != 0 ? params->threads : (uint32_t)omp_get_num_procs();
    b->coherent = params->geometry->triangle_count < 1024;
    b->compact =
        params->tree_memory > 0 && params->geometry->triangle_count > params->tree_memory / (uint64_t)TREE_BYTES;
    const char *isa = params->instruction_set;
    char config[128];
    (void)snprintf(config, sizeof config, "threads=%u%s%s", b->threads, isa != NULL ? ",isa=" : "",
                   isa != NULL ? isa : "");
    const double start = kiln_clock_seconds();
    if (params->geometry->coincident)
        status = kiln_allocate(&b->coincides, params->geometry->triangle_count, sizeof *b->coincides,
                               "the coincident triangles", error);
    if (status == KILN_OK)
        status =
            params->scene != NULL ? kiln_scene_lobes(&b->lobes, params->scene, error) : KILN_OK; /* or rays alone */
    b->device = rtcNewDevice(config);
    if (status == KILN_OK && b->device == NULL) {
        status = embree_failure(NULL, "creating the device", error);
        if (status == KILN_OK)
            status = kiln_fail(error, KILN_NO_DEVICE, "Embree could not create its device with '%s'", config);
    }
    if (status == KILN_OK) {
        b->scene = rtcNewScene(b->device);
        /* robust: rays cannot slip through the edge that two triangles share; a sealed room stays exactly black */
        rtcSetSceneFlags(b->scene, RTC_SCENE_FLAG_ROBUST | (b->compact ? RTC_SCENE_FLAG_COMPACT : RTC_SCENE_FLAG_NONE));
        rtcSetSceneBuildQuality(b->scene, RTC_BUILD_QUALITY_MEDIUM);
        attach(b, 0, 0, params->geometry->opaque_count - params->geometry->opaque_receivers);
        attach(b, 1, params->geometry->opaque_count,
               params->geometry->triangle_count - params->geometry->opaque_count - params->geometry->alpha_receivers);
        if (params->stop != NULL)
            rtcSetSceneProgressMonitorFunction(b->scene, goes_on, (void *)(uintptr_t)params->stop);
        rtcCommitScene(b->scene);
        status = embree_failure(b->device, "building the BVH", error);
        if (kiln_stop_asked(params->stop))
            status = kiln_give_up(error);
        b->build_seconds = kiln_clock_seconds() - start;
        (void)snprintf(b->device_text, sizeof b->device_text, "Embree %ld.%ld.%ld, %s, %u thread%s",
                       rtcGetDeviceProperty(b->device, RTC_DEVICE_PROPERTY_VERSION_MAJOR),
                       rtcGetDeviceProperty(b->device, RTC_DEVICE_PROPERTY_VERSION_MINOR),
                       rtcGetDeviceProperty(b->device, RTC_DEVICE_PROPERTY_VERSION_PATCH),
                       isa != NULL ? isa : "best instruction set", b->threads, b->threads == 1 ? "" : "s");
    }
    *backend = &b->base;
    if (status != KILN_OK)
        embree_destroy(backend);
    return status;
}

static void embree_info(const struct kiln_backend *backend, struct kiln_backend_info *info)
{
    const struct embree_backend *b = (const struct embree_backend *)backend;
    *info = (struct kiln_backend_info){.name = "embree",
                                       .build_seconds = b->build_seconds,
                                       .thread_seconds = b->thread_seconds,
                                       .keeps_chains = true,
                                       .computes_for_others = true,
                                       .compact_tree = b->compact,
                                       .part_points = PART_POINTS};
    memcpy(info->device, b->device_text, sizeof info->device);
    for (size_t p = 0; p < KILN_PASS_COUNT; p++)
        if (backend->ran[p])
            info->kernels[info->kernel_count++] = kiln_passes[p]->name;
}

/* Copies values that passes read too often to look them up in `given`. Makes the lookup from hits to surface points. */
static int embree_set(struct kiln_backend *backend, enum kiln_resource_index index, struct kiln_error *error)
{
    (void)error;
    struct embree_backend *b = (struct embree_backend *)backend;
    b->surface = backend->surface;
    b->radiosity = backend->given.radiosity;
    b->probes = backend->given.probes;
    if (index == KILN_RESOURCE_surface || index == KILN_RESOURCE_others)
        kiln_store_build(&b->store, b->surface, b->params.geometry);
    return KILN_OK;
}

/* ---- passes ---- */

typedef int (*pass_function)(struct embree_backend *b, const void *parameters, const struct kiln_batch *part,
                             void *results, uint64_t *rays, struct kiln_error *error);
#define ROW(name) [KILN_PASS_INDEX_##name] = embree_##name,
static const pass_function pass_functions[KILN_PASS_COUNT] = {KILN_PASS_LIST(ROW)};
#undef ROW

/* Results that one item has. */
static uint64_t results_of(const struct embree_backend *b, const struct kiln_pass *pass, size_t item)
{
    return pass->domain == KILN_DOMAIN_TILE_RUNS ? b->surface->tile_runs[item].count : 1;
}

/* Passes on the results of the items that are not left out. */
static int take_results(const struct embree_backend *b, const struct kiln_pass *pass, const struct kiln_batch *part,
                        const char *results, struct kiln_error *error)
{
    return pass->domain == KILN_DOMAIN_TILE_RUNS
               ? kiln_batch_hand_over(part, b->surface, pass->result_bytes, part->first, part->count, results, error)
               : part->take(part->context, part->first, part->count, results, error);
}

/* Allocates results of groups for a part with this number of points, which begins with the tile run. */
static int begin_groups(struct embree_backend *b, size_t tile_run, uint64_t points, struct kiln_error *error)
{
    struct kiln_groups *g = b->base.given.groups;
    if (g == NULL)
        return KILN_OK;
    g->first = b->surface->tile_runs[tile_run].first.at;
    return kiln_grow(&g->answers, &g->room, (size_t)points * g->lights->count * KILN_GROUP_FLOATS, sizeof *g->answers,
                     "the light of groups", error);
}

/* Runs the batch in parts of about PART_POINTS results, or as a whole; each part is taken before the next is computed.
 */
static int embree_run(struct kiln_backend *backend, const struct kiln_pass *pass, const void *parameters,
                      const struct kiln_batch *batch, uint64_t *rays, struct kiln_error *error)
{
    struct embree_backend *b = (struct embree_backend *)backend;
    const size_t last = batch->first + batch->count;
    uint64_t most = 0;
    for (size_t i = batch->first; i < last && (pass->is_whole || most < PART_POINTS + KILN_TILE_TEXELS); i++)
        most += results_of(b, pass, i);
    char *results = NULL;
    int status = kiln_allocate(&results, (size_t)most, pass->result_bytes, "a batch's results", error);
    for (size_t first = batch->first; first < last && status == KILN_OK;) {
        size_t end = first;
        for (uint64_t points = 0; end < last && (pass->is_whole || points < PART_POINTS); end++)
            points += results_of(b, pass, end);
        const struct kiln_batch part = kiln_batch_range(batch, first, end - first);
        status = pass->domain == KILN_DOMAIN_TILE_RUNS ? begin_groups(b, first, most, error) : KILN_OK;
        if (status == KILN_OK)
            status = pass_functions[pass->index](b, parameters, &part, results, rays, error);
        if (status == KILN_OK && batch->take != NULL)
            status = take_results(b, pass, &part, results, error);
        first = end;
    }
    kiln_free(&results);
    return status;
}

static const struct kiln_backend_extras extras = {.clearance = embree_clearance, .ceiling = embree_ceiling};

const struct kiln_backend_api kiln_backend_embree = {
    .name = "embree",
    .create = embree_create,
    .destroy = embree_destroy,
    .devices = embree_devices,
    .info = embree_info,
    .set = embree_set,
    .mixed = 1u << KILN_PASS_INDEX_direct,
    .run = embree_run,
    .intersect = embree_intersect,
    .extras = &extras,
};
