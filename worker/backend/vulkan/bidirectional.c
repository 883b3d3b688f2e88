/* The bidirectional pass (worker/pass/bidirectional.h), sample by sample. Light paths are traced, and their vertices
 * stored. If those of all paths are merged, shaders/photons.comp sorts them into buckets. Then the paths of pixels are
 * followed (bidirectional_stages.c). Results depend neither on the number of paths at once, nor on the order in which
 * vertices are stored. */
#include <math.h>
#include <stdint.h>
#include <string.h>

#include "shaders/shared/bidirectional.h"
#include "worker/backend/vulkan/bidirectional.h"
#include "worker/base/memory.h"

/* MOST_PIXELS: pixels whose own light paths are stored at once, if no other paths are needed. */
enum { MOST_PIXELS = 1 << 21, MOST_BOUNCES = 1 << 29, SUM_POWER = -30 };

/* ---- what is on the device ---- */

static uint32_t method_of(enum kiln_bidirectional_method method)
{
    const uint32_t connects = KILN_GPU_BOTH_SPLATS | KILN_GPU_BOTH_CONNECTS;
    switch (method) {
    case KILN_BIDIRECTIONAL_LIGHT:
        return KILN_GPU_BOTH_SPLATS;
    case KILN_BIDIRECTIONAL_BDPT:
        return connects;
    case KILN_BIDIRECTIONAL_VCM:
        return connects | KILN_GPU_BOTH_MERGES;
    case KILN_BIDIRECTIONAL_VCM_SINGLE:
        return connects | KILN_GPU_BOTH_MERGES | KILN_GPU_BOTH_OWN;
    case KILN_BIDIRECTIONAL_PPM:
    case KILN_BIDIRECTIONAL_SPPM:
        break;
    }
    return KILN_GPU_BOTH_MERGES;
}

/* Whether the vertices of all paths are merged. */
static bool merges_all(const struct both_run *r)
{
    return (r->method & KILN_GPU_BOTH_MERGES) != 0 && (r->method & KILN_GPU_BOTH_OWN) == 0;
}

/* Uploads the probabilities of the lights, and their cumulative sums, as the kernels' `real`. */
static int upload_chances(struct both_run *r, struct kiln_error *error)
{
    const struct kiln_emission *e = r->emission;
    const size_t size = r->b->float64 ? sizeof(double) : sizeof(float), half = (e->count * size + 7) / 8 * 8;
    unsigned char *data = NULL;
    int status;
    KILN_TRY(kiln_allocate(&data, 2, half, "the lights' emission", error));
    for (size_t i = 0; i < 2 * e->count; i++) {
        const size_t light = i % e->count;
        const double wide = i < e->count ? e->chance[light] : e->up_to[light];
        const float slim = (float)wide;
        memcpy(data + (i < e->count ? 0 : half) + light * size, r->b->float64 ? (const void *)&wide : &slim, size);
    }
    KILN_TRY(gpu_buffer_of(r->b->gpu, &r->chances, data, 2 * half, "the lights' emission", error));
end:
    r->shared.chances = r->chances.address;
    r->shared.up_to = r->chances.address + half;
    kiln_free(&data);
    return status;
}

static int upload_nodes(struct both_run *r, struct kiln_error *error)
{
    const struct kiln_emission *e = r->emission;
    const size_t nodes = e->lights->node_count;
    uint32_t *words = NULL;
    int status = kiln_allocate(&words, nodes + e->count, sizeof *words, "the lights' emission", error);
    if (status == KILN_OK) {
        if (nodes > 0)
            memcpy(words, e->parent, nodes * sizeof *words);
        memcpy(words + nodes, e->leaf, e->count * sizeof *words);
        status = gpu_buffer_of(r->b->gpu, &r->nodes, words, (nodes + e->count) * sizeof *words, "the lights' emission",
                               error);
    }
    r->shared.parents = r->nodes.address;
    r->shared.leaves = r->nodes.address + nodes * sizeof *words;
    kiln_free(&words);
    return status;
}

static int make_device_buffer(struct both_run *r, struct gpu_buffer *buffer, size_t size, const char *what,
                              struct kiln_error *error)
{
    if (buffer->size >= size)
        return KILN_OK;
    gpu_buffer_destroy(r->b->gpu, buffer);
    return gpu_buffer_create(r->b->gpu, buffer, size, GPU_DEVICE, what, error);
}

int both_make_zeros(struct both_run *r, struct gpu_buffer *buffer, size_t size, const char *what,
                    struct kiln_error *error)
{
    const int status = make_device_buffer(r, buffer, size, what, error);
    return status == KILN_OK ? both_clear(r, buffer->address, size, error) : status;
}

/* Allocates the vertices of the light paths that run at once. */
static int make_vertices(struct both_run *r, uint64_t paths, struct kiln_error *error)
{
    const double each = r->b->light_vertices > 0.0 ? r->b->light_vertices : 4.0;
    const uint64_t wanted = (uint64_t)(each * (double)paths) + 1024, most = UINT32_MAX / 2;
    r->shared.room = (uint32_t)(wanted < most ? wanted : most);
    const int status = make_device_buffer(r, &r->vertices, r->shared.room * sizeof(struct kiln_gpu_light_vertex),
                                          "the vertices of paths of light", error);
    r->shared.vertices = r->vertices.address;
    return status;
}

static void describe(struct both_run *r)
{
    const struct kiln_path_parameters *c = &r->p->camera;
    const struct kiln_emission *e = r->emission;
    struct kiln_gpu_both *s = &r->shared;
    s->lights = (uint32_t)e->count;
    s->endless = c->bounces == KILN_PATH_ALL_BOUNCES;
    s->most = c->bounces < MOST_BOUNCES ? c->bounces : MOST_BOUNCES;
    s->path_length = c->length;
    s->lens_radius = c->lens_radius;
    s->focus_distance = c->focus_distance;
    s->width = c->width;
    s->height = c->height;
    s->orthographic = c->orthographic;
    s->position = c->position;
    s->forward = c->forward;
    s->right = c->right;
    s->up = c->up;
    s->centre = vec3_of(e->centre);
    s->sphere = (float)e->radius;
    s->extent = r->b->params.geometry->extent;
    s->pixel = (float)(4.0 * (double)vec3_length(c->right) * (double)vec3_length(c->up) / (double)r->paths);
    s->paths = (float)r->paths;
    s->unit = (float)kiln_emission_splat_unit(e);
    s->unit_power = (uint32_t)(ilogb(kiln_emission_splat_unit(e)) + SUM_POWER);
}

/* Sets all sums to zero. */
static int begin_sums(struct both_run *r, struct kiln_error *error)
{
    const bool points = (r->method & KILN_GPU_BOTH_POINTS) != 0;
    const size_t sums = points ? sizeof(struct kiln_gpu_point_sums) : sizeof(struct kiln_gpu_path_sums);
    int status;
    KILN_TRY(both_make_zeros(r, &r->counts, sizeof(struct kiln_gpu_both_counts), "counts of paths", error));
    KILN_TRY(both_make_zeros(r, &r->sums, r->count * sums, "the sums of paths", error));
    if ((r->method & KILN_GPU_BOTH_SPLATS) != 0)
        KILN_TRY(both_make_zeros(r, &r->film, 3 * sizeof(int64_t) * r->paths, "the film of paths of light", error));
end:
    return status;
}

int both_prepare(struct both_run *r, struct kiln_error *error)
{
    struct vulkan_backend *b = r->b;
    const uint32_t low = (uint32_t)b->params.seed, high = (uint32_t)(b->params.seed >> 32);
    r->push.seed = kiln_hash2(low, high ^ KILN_PATH_SEED);
    r->light_of = KILN_GPU_OF_LIGHT;
    int status = kiln_emission_create(&r->emission, b->params.lights, error);
    if (status == KILN_OK)
        status = vulkan_surfaces(b, error);
    r->push.scene = b->scene.address;
    KILN_TRY(status);
    KILN_TRY(both_stages_create(r, error));
    KILN_TRY(upload_chances(r, error));
    KILN_TRY(upload_nodes(r, error));
    KILN_TRY(make_device_buffer(r, &r->all, sizeof r->shared, "what paths share", error));
    KILN_TRY(begin_sums(r, error));
    describe(r);
end:
    r->push.both = r->all.address;
    r->shared.counts = r->counts.address;
    r->shared.film = r->film.address;
    return status;
}

void both_finish(struct both_run *r)
{
    struct gpu_buffer *buffers[] = {&r->chances, &r->nodes,   &r->all,  &r->counts, &r->vertices, &r->last,
                                    &r->photons, &r->buckets, &r->film, &r->sums,   &r->points,   &r->brought};
    for (size_t i = 0; i < sizeof buffers / sizeof buffers[0]; i++)
        gpu_buffer_destroy(r->b->gpu, buffers[i]);
    both_stages_destroy(r);
    kiln_emission_destroy(&r->emission);
    kiln_free(&r->results);
}

/* ---- running ---- */

int both_upload(struct both_run *r, struct kiln_error *error)
{
    return gpu_upload(r->b->gpu, &r->all, 0, &r->shared, sizeof r->shared, error);
}

int both_read_counts(struct both_run *r, struct kiln_gpu_both_counts *counts, struct kiln_error *error)
{
    const int status = gpu_download(r->b->gpu, &r->counts, 0, counts, sizeof *counts, error);
    if (status == KILN_OK && counts->stopped != 0)
        return kiln_fail(error, KILN_NO_DEVICE,
                         "%s ends long loops early, and a path needs one; use another device or --backend embree",
                         gpu_about(r->b->gpu)->name);
    if (status == KILN_OK && counts->too_much != 0 && (r->method & KILN_GPU_BOTH_POINTS) != 0)
        return kiln_fail(error, KILN_BAD_INPUT,
                         "one path brings more to a surface point than 2^95 times %g W/m2, which is all that the sums "
                         "of such paths hold on a device; --backend embree has no such limit",
                         ldexp(1.0, (int)r->shared.unit_power));
    if (status == KILN_OK && counts->too_much != 0)
        return kiln_fail(error, KILN_BAD_INPUT,
                         "one path brings more to a pixel than 2^53 times %g W/(m2 sr), which is all that the "
                         "sums of such paths hold; --method path has no such limit",
                         (double)r->shared.unit);
    return status;
}

int both_trace_light(struct both_run *r, uint64_t first, uint64_t count, struct kiln_gpu_both_counts *counts,
                     struct kiln_error *error)
{
    const struct kiln_gpu_both_counts none = {0};
    const uint64_t before = r->rays;
    int status = make_device_buffer(r, &r->last, count * sizeof(uint32_t), "the ends of paths of light", error);
    r->shared.last = r->last.address;
    for (bool fits = false; !fits && status == KILN_OK;) {
        r->rays = before;
        status = make_vertices(r, count, error);
        if (status == KILN_OK)
            status = both_upload(r, error);
        if (status == KILN_OK)
            status = gpu_upload(r->b->gpu, &r->counts, 0, &none, sizeof none, error);
        if (status == KILN_OK)
            status = both_light_paths(r, first, count, error);
        if (status == KILN_OK)
            status = both_read_counts(r, counts, error);
        fits = status == KILN_OK && counts->vertices <= r->shared.room;
        if (status == KILN_OK && !fits && r->shared.room >= UINT32_MAX / 2)
            return kiln_fail(error, KILN_NO_DEVICE, "paths of light have more than 2^31 vertices in a sample");
        if (status == KILN_OK && !fits)
            r->b->light_vertices = 1.25 * (double)counts->vertices / (double)count;
    }
    if (status == KILN_OK && (r->method & KILN_GPU_BOTH_SPLATS) != 0)
        status = both_splats(r, counts->vertices, error);
    return status;
}

int both_sort_photons(struct both_run *r, uint32_t count, struct kiln_error *error)
{
    uint32_t buckets = 64;
    while (buckets < count && buckets < 1u << 30)
        buckets *= 2;
    r->shared.bucket_mask = buckets - 1;
    int status =
        make_device_buffer(r, &r->buckets, 2 * sizeof(uint32_t) * (size_t)buckets, "buckets of photons", error);
    if (status == KILN_OK)
        status =
            make_device_buffer(r, &r->photons, (count + (size_t)1) * sizeof(struct kiln_gpu_photon), "photons", error);
    r->shared.begins = r->buckets.address;
    r->shared.ends = r->buckets.address + sizeof(uint32_t) * (uint64_t)buckets;
    r->shared.photons = r->photons.address;
    KILN_TRY(status);
    KILN_TRY(both_upload(r, error));
    KILN_TRY(both_clear(r, r->shared.ends, sizeof(uint32_t) * (uint64_t)buckets, error));
    for (uint32_t stage = KILN_GPU_PHOTONS_COUNT; stage <= KILN_GPU_PHOTONS_PLACE; stage++) {
        r->push.stage = stage;
        KILN_TRY(both_run_stage(r, &r->photon, 0, stage == KILN_GPU_PHOTONS_BEGIN ? buckets : count, NULL, error));
    }
end:
    return status;
}

static void begin_sample(struct both_run *r, uint32_t k)
{
    const uint32_t low = (uint32_t)r->b->params.seed, high = (uint32_t)(r->b->params.seed >> 32);
    const double radius = kiln_merge_radius(r->p->radius, k),
                 merged = (r->method & KILN_GPU_BOTH_OWN) != 0 ? 1.0 : (double)r->paths;
    r->push.light_key = kiln_hash2(kiln_hash2(low, high ^ KILN_LIGHT_PATH_SEED), k);
    r->push.sampled = r->p->method == KILN_BIDIRECTIONAL_PPM ? 0 : k;
    r->shared.radius = (float)radius;
    r->shared.area = (r->method & KILN_GPU_BOTH_MERGES) != 0 ? (float)(KILN_PI * radius * radius * merged) : 0.0f;
}

int both_follow(struct both_run *r, uint64_t first, uint64_t count, struct kiln_error *error)
{
    struct kiln_gpu_both_counts counts;
    const int status = both_eye_paths(r, first, count, error);
    return status == KILN_OK ? both_read_counts(r, &counts, error) : status;
}

static int run_sample(struct both_run *r, uint32_t k, struct kiln_error *error)
{
    struct kiln_gpu_both_counts counts;
    int status = KILN_OK;
    begin_sample(r, k);
    if (merges_all(r)) {
        status = both_trace_light(r, 0, r->paths, &counts, error);
        if (status == KILN_OK)
            status = both_sort_photons(r, counts.vertices, error);
        return status == KILN_OK ? both_follow(r, r->first, r->count, error) : status;
    }
    for (uint64_t done = 0; done < r->count && status == KILN_OK; done += MOST_PIXELS) {
        const uint64_t left = r->count - done, some = left < MOST_PIXELS ? left : MOST_PIXELS;
        status = both_trace_light(r, r->first + done, some, &counts, error);
        if (status == KILN_OK)
            status = both_follow(r, r->first + done, some, error);
    }
    return status;
}

/* ---- answers ---- */

/* Copies `size` bytes of a buffer to r->brought on the host. */
static int bring(struct both_run *r, const struct gpu_buffer *from, size_t size, struct kiln_error *error)
{
    const struct gpu_step step = {.from = from, .to = &r->brought, .size = size};
    return gpu_run(r->b->gpu, &step, 1, NULL, error);
}

/* Adds the device's film to the caller's. */
static int add_film(struct both_run *r, struct kiln_error *error)
{
    const size_t count = 3 * r->paths;
    const int64_t *from = r->brought.mapped;
    int64_t *to = r->p->film->sums;
    r->p->film->unit = (double)r->shared.unit;
    if ((r->method & KILN_GPU_BOTH_SPLATS) == 0)
        return KILN_OK;
    const int status = bring(r, &r->film, count * sizeof *from, error);
    if (status != KILN_OK)
        return status;
#pragma omp parallel for num_threads((int)r->b->threads) if (count > 1 << 16)
    for (size_t i = 0; i < count; i++)
        to[i] += from[i];
    return KILN_OK;
}

static int read_pixels(struct both_run *r, struct kiln_error *error)
{
    const int status = bring(r, &r->sums, r->count * sizeof(struct kiln_gpu_path_sums), error);
    return status == KILN_OK ? vulkan_read_path_sums(r->b, r->brought.mapped, r->count, r->results, &r->rays, error)
                             : status;
}

/* ---- a call ---- */

static uint64_t paths_of(const struct kiln_bidirectional_parameters *p)
{
    return (uint64_t)p->camera.width * p->camera.height;
}

/* Room on the host for answers. */
static int make_room(struct both_run *r, struct kiln_error *error)
{
    const size_t sums = r->count * sizeof(struct kiln_gpu_path_sums), film = 3 * sizeof(int64_t) * r->paths;
    const int status =
        gpu_buffer_create(r->b->gpu, &r->brought, sums > film ? sums : film, GPU_HOST, "the answers of pixels", error);
    return status == KILN_OK ? kiln_allocate(&r->results, r->count, sizeof *r->results, "the answers of pixels", error)
                             : status;
}

void vulkan_bidirectional_release(struct vulkan_backend *b)
{
    if (b->both != NULL)
        both_finish(b->both);
    kiln_free(&b->both);
}

/* Prepares b->both for these pixels: reuses that of the call before, if it had as many pixels and the same method,
 * since allocating its memory takes as long as several samples; else makes a new one. */
static int prepare_call(struct vulkan_backend *b, const struct kiln_bidirectional_parameters *p,
                        const struct kiln_batch *batch, struct kiln_error *error)
{
    struct both_run *r = b->both;
    if (r != NULL && r->method == method_of(p->method) && r->count == batch->count && r->paths == paths_of(p)) {
        r->p = p;
        r->first = batch->first;
        r->rays = 0;
        r->push.scene = b->scene.address;
        describe(r);
        const int status = both_kernels(r, error);
        return status == KILN_OK ? begin_sums(r, error) : status;
    }
    vulkan_bidirectional_release(b);
    int status = kiln_allocate(&b->both, 1, sizeof *b->both, "paths under way", error);
    if (status != KILN_OK)
        return status;
    *b->both = (struct both_run){.b = b,
                                 .p = p,
                                 .method = method_of(p->method),
                                 .first = batch->first,
                                 .count = batch->count,
                                 .paths = paths_of(p)};
    status = both_prepare(b->both, error);
    return status == KILN_OK ? make_room(b->both, error) : status;
}

/* Runs the whole batch; if it fails, nothing is taken: the film cannot be added to in parts. */
static int run_left(struct vulkan_backend *b, const void *parameters, struct kiln_batch *left, uint64_t *rays,
                    bool *refused, struct kiln_error *error)
{
    int status = prepare_call(b, parameters, left, error);
    for (uint32_t i = 0; i < left->samples && status == KILN_OK; i++)
        status = run_sample(b->both, left->first_sample + i, error);
    if (status == KILN_OK)
        status = read_pixels(b->both, error);
    if (status == KILN_OK)
        status = add_film(b->both, error);
    if (status == KILN_OK) {
        *rays += b->both->rays;
        status =
            left->take != NULL ? left->take(left->context, left->first, left->count, b->both->results, error) : KILN_OK;
        *refused = status != KILN_OK;
        *left = kiln_batch_range(left, left->first + left->count, 0);
    }
    if (status != KILN_OK)
        vulkan_bidirectional_release(b);
    return status;
}

static int run(struct vulkan_backend *b, const void *parameters, const struct kiln_batch *batch, uint64_t *rays,
               struct kiln_error *error)
{
    return vulkan_run_to_end(b, run_left, parameters, batch, rays, error);
}

const struct vulkan_pass vulkan_pass_bidirectional = {.run = run, .release = vulkan_bidirectional_release};
