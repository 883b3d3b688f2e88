#include "worker/backend/embree/embree.h"

#include <omp.h>
#include <stdio.h>
#include <string.h>
#include <time.h>
#ifdef __SSE__
#    include <xmmintrin.h>
#endif

#include "shaders/shared/random.h"
#include "worker/backend/embree/passage.h"
#include "worker/backend/embree/light_vertices.h"
#include "worker/backend/embree/reference.h"
#include "worker/base/memory.h"
#include "worker/light/light_groups.h"
#include "worker/material/scene_lobes.h"
#include "worker/pass/groups.h"

unsigned embree_enter(void)
{
#ifdef __SSE__
    const unsigned saved = _mm_getcsr();
    _mm_setcsr(saved | 0x8040u); /* flush to zero, denormals are zero */
    return saved;
#else
    return 0;
#endif
}

void embree_leave(unsigned saved)
{
#ifdef __SSE__
    _mm_setcsr(saved);
#else
    (void)saved;
#endif
}

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

/* Embree's threads ask while they build. */
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
    light_vertices_destroy(&b->light_vertices);
    reference_paths_destroy(&b->reference);
    kiln_free(backend);
}

static double seconds_of(clockid_t clock)
{
    struct timespec t;
    clock_gettime(clock, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

enum { PART_POINTS = 1 << 16 };

double embree_thread_seconds(void) { return seconds_of(CLOCK_THREAD_CPUTIME_ID); }

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
    const char *isa = params->instruction_set;
    char config[128];
    (void)snprintf(config, sizeof config, "threads=%u%s%s", b->threads, isa != NULL ? ",isa=" : "",
                   isa != NULL ? isa : "");
    const double start = seconds_of(CLOCK_MONOTONIC);
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
        rtcSetSceneFlags(b->scene, RTC_SCENE_FLAG_ROBUST);
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
        b->build_seconds = seconds_of(CLOCK_MONOTONIC) - start;
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
                                       .computes_for_others = true,
                                       .part_points = PART_POINTS};
    memcpy(info->device, b->device_text, sizeof info->device);
    for (size_t p = 0; p < KILN_PASS_COUNT; p++)
        if (backend->ran[p])
            info->kernels[info->kernel_count++] = kiln_passes[p]->name;
}

static int embree_set_surface(struct kiln_backend *backend, const struct kiln_surface *surface,
                              struct kiln_error *error)
{
    (void)error;
    struct embree_backend *b = (struct embree_backend *)backend;
    b->surface = surface;
    kiln_store_build(&b->store, surface, b->params.geometry);
    return KILN_OK;
}

static int embree_set_radiosity(struct kiln_backend *backend, const uint64_t *radiosity, struct kiln_error *error)
{
    (void)error;
    ((struct embree_backend *)backend)->radiosity = radiosity;
    return KILN_OK;
}

static int embree_set_probes(struct kiln_backend *backend, const struct kiln_radiance_probes *probes,
                             struct kiln_error *error)
{
    (void)error;
    ((struct embree_backend *)backend)->probes = probes;
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

/* Hands over the results of the items that are not left out. */
static int take_results(const struct embree_backend *b, const struct kiln_pass *pass, const struct kiln_batch *part,
                        const char *results, struct kiln_error *error)
{
    const size_t end = part->first + part->count;
    int status = KILN_OK;
    for (size_t i = part->first, next; i < end && status == KILN_OK; i = next) {
        next = kiln_batch_stretch(part, i, end);
        if (!kiln_batch_leaves_out(part, i))
            status = part->take(part->context, i, next - i, results, error);
        for (size_t item = i; item < next; item++)
            results += results_of(b, pass, item) * pass->result_bytes;
    }
    return status;
}

/* Room for what groups answer in a part of so many points that begins with the tile run. */
static int begin_groups(struct embree_backend *b, size_t tile_run, uint64_t points, struct kiln_error *error)
{
    struct kiln_groups *g = b->base.groups;
    if (g == NULL)
        return KILN_OK;
    g->first = b->surface->tile_runs[tile_run].first.at;
    return kiln_grow(&g->answers, &g->room, (size_t)points * g->lights->count * KILN_GROUP_FLOATS, sizeof *g->answers,
                     "the light of groups", error);
}

/* The batch in parts of some PART_POINTS results, or whole, which are taken before the next part is computed. */
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
        const struct kiln_batch part = kiln_batch_part(batch, first, end - first);
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

/* ---- any rays ---- */

/* Rounding may leave out what is met at the very end of a ray: they are traced a little farther. */
static const float LENGTHENED = 1.0001f;

static int embree_intersect(struct kiln_backend *backend, const struct kiln_vec3 *origins,
                            const struct kiln_vec3 *directions, size_t count, struct kiln_hit *hits,
                            struct kiln_error *error)
{
    (void)error;
    struct embree_backend *b = (struct embree_backend *)backend;
#pragma omp parallel num_threads((int)b->threads)
    {
        const unsigned saved = embree_enter();
        struct embree_context context;
        embree_context(b, &context);
#pragma omp for schedule(dynamic, 4096)
        for (size_t i = 0; i < count; i++) {
            struct RTCRayHit r = {.ray = {.org_x = origins[i].x,
                                          .org_y = origins[i].y,
                                          .org_z = origins[i].z,
                                          .dir_x = directions[i].x,
                                          .dir_y = directions[i].y,
                                          .dir_z = directions[i].z,
                                          .tfar = INFINITY,
                                          .mask = ~0u},
                                  .hit = {.geomID = RTC_INVALID_GEOMETRY_ID, .instID = {RTC_INVALID_GEOMETRY_ID}}};
            hits[i] = (struct kiln_hit){.triangle = KILN_NONE, .tint = {1.0f, 1.0f, 1.0f}};
            embree_nearest1(b, &context, &r, kiln_ray_seed(origins[i], directions[i]), hits[i].tint);
            if (r.hit.geomID == RTC_INVALID_GEOMETRY_ID)
                continue;
            hits[i].triangle = embree_triangle(b, r.hit.geomID, r.hit.primID);
            hits[i].u = r.hit.u;
            hits[i].v = r.hit.v;
            hits[i].distance = r.ray.tfar;
            hits[i].back = r.hit.Ng_x * r.ray.dir_x + r.hit.Ng_y * r.ray.dir_y + r.hit.Ng_z * r.ray.dir_z > 0.0f;
        }
        embree_leave(saved);
    }
    return KILN_OK;
}

/* Rays [first, first + lanes) in one packet. `lengths`: NULL, as far as they go. */
static void intersect8(const struct embree_backend *b, struct embree_context *context, const struct kiln_vec3 *origins,
                       const struct kiln_vec3 *directions, const float *lengths, uint32_t lanes, struct kiln_hit *hits)
{
    struct RTCRayHit8 r;
    int valid[PACKET] __attribute__((aligned(32)));
    uint32_t seed[PACKET] = {0};
    float tint[PACKET][3];
    for (uint32_t i = 0; i < PACKET; i++) {
        const uint32_t from = i < lanes ? i : 0;
        valid[i] = i < lanes && (lengths == NULL || lengths[i] > 0.0f) ? -1 : 0;
        r.ray.org_x[i] = origins[from].x, r.ray.org_y[i] = origins[from].y, r.ray.org_z[i] = origins[from].z;
        r.ray.dir_x[i] = directions[from].x, r.ray.dir_y[i] = directions[from].y, r.ray.dir_z[i] = directions[from].z;
        r.ray.tnear[i] = r.ray.time[i] = 0.0f;
        r.ray.tfar[i] = lengths != NULL ? LENGTHENED * lengths[from] : INFINITY;
        r.ray.mask[i] = ~0u;
        r.ray.flags[i] = 0;
        r.hit.geomID[i] = r.hit.instID[0][i] = RTC_INVALID_GEOMETRY_ID;
        for (int c = 0; c < 3; c++)
            tint[i][c] = 1.0f;
        if (embree_blends(b))
            seed[i] = kiln_ray_seed(origins[from], directions[from]);
    }
    embree_nearest8(b, context, valid, &r, seed, tint);
    for (uint32_t i = 0; i < lanes; i++) {
        hits[i] = (struct kiln_hit){.triangle = KILN_NONE, .tint = {tint[i][0], tint[i][1], tint[i][2]}};
        if (r.hit.geomID[i] == RTC_INVALID_GEOMETRY_ID)
            continue;
        hits[i].triangle = embree_triangle(b, r.hit.geomID[i], r.hit.primID[i]);
        hits[i].u = r.hit.u[i];
        hits[i].v = r.hit.v[i];
        hits[i].distance = r.ray.tfar[i];
        hits[i].back =
            r.hit.Ng_x[i] * r.ray.dir_x[i] + r.hit.Ng_y[i] * r.ray.dir_y[i] + r.hit.Ng_z[i] * r.ray.dir_z[i] > 0.0f;
    }
}

/* Eight neighbours at a time. */
static int embree_intersect_within(struct kiln_backend *backend, const struct kiln_vec3 *origins,
                                   const struct kiln_vec3 *directions, const float *lengths, size_t count,
                                   struct kiln_hit *hits, struct kiln_error *error)
{
    (void)error;
    struct embree_backend *b = (struct embree_backend *)backend;
#pragma omp parallel num_threads((int)b->threads)
    {
        const unsigned saved = embree_enter();
        struct embree_context context;
        embree_context(b, &context);
        context.rtc.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
#pragma omp for schedule(dynamic, 512)
        for (size_t i = 0; i < count; i += PACKET)
            intersect8(b, &context, origins + i, directions + i, lengths != NULL ? lengths + i : NULL,
                       count - i < PACKET ? (uint32_t)(count - i) : PACKET, hits + i);
        embree_leave(saved);
    }
    return KILN_OK;
}

static int embree_intersect_alike(struct kiln_backend *backend, const struct kiln_vec3 *origins,
                                  const struct kiln_vec3 *directions, size_t count, struct kiln_hit *hits,
                                  struct kiln_error *error)
{
    return embree_intersect_within(backend, origins, directions, NULL, count, hits, error);
}

const struct kiln_backend_api kiln_backend_embree = {
    .name = "embree",
    .create = embree_create,
    .destroy = embree_destroy,
    .devices = embree_devices,
    .info = embree_info,
    .set_surface = embree_set_surface,
    .set_radiosity = embree_set_radiosity,
    .set_probes = embree_set_probes,
    .mixed = 1u << KILN_PASS_INDEX_direct,
    .run = embree_run,
    .intersect = embree_intersect,
    .intersect_within = embree_intersect_within,
    .clearance = embree_clearance,
    .intersect_alike = embree_intersect_alike,
    .ceiling = embree_ceiling,
};
