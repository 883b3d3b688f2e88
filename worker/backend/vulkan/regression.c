/* Surface regression (worker/pass/regression.h): five sweeps of one kernel, each over all points before the next. */
#include "worker/backend/vulkan/regression.h"

#include "worker/backend/vulkan/chunks.h"
#include "worker/base/memory.h"

#include "shaders/regression.h"
#include "shaders/regression_float.h"

/* Its own constant is the number of the sweep. */
static const struct vulkan_shader regression_shader = {
    .name = "regression", .compute = VULKAN_CODE(regression), .compute_float = VULKAN_CODE(regression_float)};

enum {
    STRETCH = 1 << 17,    /* points that are handed over at a time */
    FIRST_GUESS = 1 << 12 /* points of the first dispatch */
};

static const char what[] = "denoising on the device";

/* What lies on the device; arrays by points, but for those of cells. */
struct run {
    struct vulkan_backend *b;
    const struct kiln_regression_work *work;
    struct gpu_buffer points, cells, first, ranges, given, fits, choices, results;
};

/* An array on the device. */
struct room {
    struct gpu_buffer *buffer;
    uint64_t bytes;
};
enum { ROOMS = 8 };

static void list_rooms(struct run *r, struct room rooms[ROOMS])
{
    const struct kiln_regression_work *w = r->work;
    const uint64_t count = w->count, lights = w->lights;
    const struct room all[ROOMS] = {
        {&r->points, count * sizeof(struct kiln_gpu_regression_point)},
        {&r->cells, count * sizeof *w->cells},
        {&r->first, (w->cell_count + 1) * sizeof *w->first},
        {&r->ranges, (uint64_t)w->first[w->cell_count] * sizeof *w->ranges},
        {&r->given, count * lights * sizeof(struct kiln_gpu_regression_given)},
        {&r->fits, count * (1 + lights) * KILN_REGRESSION_FITS * sizeof(float)},
        {&r->choices, count * lights * sizeof(struct kiln_gpu_regression_choice)},
        {&r->results, count * lights * sizeof(struct kiln_gpu_regression_result)},
    };
    for (int i = 0; i < ROOMS; i++)
        rooms[i] = all[i];
}

static int make_rooms(struct run *r, struct kiln_error *error)
{
    struct room rooms[ROOMS];
    int status = KILN_OK;
    list_rooms(r, rooms);
    for (int i = 0; i < ROOMS && status == KILN_OK; i++)
        status = gpu_buffer_create(r->b->gpu, rooms[i].buffer, (size_t)rooms[i].bytes, GPU_DEVICE, what, error);
    return status;
}

static void drop_rooms(struct run *r)
{
    struct room rooms[ROOMS];
    list_rooms(r, rooms);
    for (int i = 0; i < ROOMS; i++)
        gpu_buffer_destroy(r->b->gpu, rooms[i].buffer);
}

static bool fits_in(struct run *r)
{
    struct room rooms[ROOMS];
    uint64_t bytes = 0;
    list_rooms(r, rooms);
    for (int i = 0; i < ROOMS; i++)
        bytes += rooms[i].bytes;
    return bytes < gpu_memory_left(r->b->gpu) / 8 * 7;
}

/* ---- there and back ---- */

static size_t stretch_at(const struct run *r, size_t first)
{
    return r->work->count - first < STRETCH ? r->work->count - first : STRETCH;
}

static int bring_points(struct run *r, struct kiln_error *error)
{
    const struct kiln_regression_work *w = r->work;
    struct kiln_gpu_regression_point *points = NULL;
    struct kiln_gpu_regression_given *given = NULL;
    const size_t most = stretch_at(r, 0);
    int status = kiln_allocate(&points, most, sizeof *points, what, error);
    if (status == KILN_OK)
        status = kiln_allocate(&given, most * w->lights, sizeof *given, what, error);
    for (size_t first = 0, count; first < w->count && status == KILN_OK; first += count) {
        count = stretch_at(r, first);
        w->give(w->context, first, count, points, given);
        status = gpu_fill(r->b->gpu, &r->points, first * sizeof *points, points, count * sizeof *points, error);
        if (status == KILN_OK)
            status = gpu_fill(r->b->gpu, &r->given, first * w->lights * sizeof *given, given,
                              count * w->lights * sizeof *given, error);
    }
    kiln_free(&points);
    kiln_free(&given);
    return status;
}

static int bring_cells(struct run *r, struct kiln_error *error)
{
    const struct kiln_regression_work *w = r->work;
    int status = gpu_fill(r->b->gpu, &r->cells, 0, w->cells, w->count * sizeof *w->cells, error);
    if (status == KILN_OK)
        status = gpu_fill(r->b->gpu, &r->first, 0, w->first, (w->cell_count + 1) * sizeof *w->first, error);
    if (status == KILN_OK)
        status = gpu_fill(r->b->gpu, &r->ranges, 0, w->ranges, w->first[w->cell_count] * sizeof *w->ranges, error);
    return status;
}

static int take_results(struct run *r, struct kiln_error *error)
{
    const struct kiln_regression_work *w = r->work;
    struct kiln_gpu_regression_result *results = NULL;
    int status = kiln_allocate(&results, stretch_at(r, 0) * w->lights, sizeof *results, what, error);
    for (size_t first = 0, count; first < w->count && status == KILN_OK; first += count) {
        count = stretch_at(r, first);
        const size_t bytes = count * w->lights * sizeof *results;
        status = gpu_download(r->b->gpu, &r->results, first * w->lights * sizeof *results, results, bytes, error);
        if (status == KILN_OK)
            w->take(w->context, first, count, results);
    }
    kiln_free(&results);
    return status;
}

/* ---- sweeps ---- */

static int sweep(struct run *r, uint32_t number, struct kiln_error *error)
{
    struct gpu_pacer *pacer = &r->b->pacers[VULKAN_PACE_REGRESSION + number];
    struct kiln_gpu_regression_push push = {.scene = r->b->scene.address,
                                            .points = r->points.address,
                                            .cells = r->cells.address,
                                            .firsts = r->first.address,
                                            .ranges = r->ranges.address,
                                            .given = r->given.address,
                                            .fits = r->fits.address,
                                            .choices = r->choices.address,
                                            .results = r->results.address,
                                            .lights = r->work->lights};
    struct gpu_kernel *kernel;
    int status = vulkan_kernel_of(r->b, &regression_shader, false, number, &kernel, error);
    for (uint32_t at = 0; at < r->work->count && status == KILN_OK; at += push.count) {
        const uint64_t next = gpu_pacer_next(pacer, FIRST_GUESS), left = r->work->count - at;
        push.first = at;
        push.count = (uint32_t)(next < left ? next : left);
        const struct gpu_step step = {.kernel = kernel,
                                      .threads_x = push.count,
                                      .threads_y = 1,
                                      .constants = &push,
                                      .constant_bytes = sizeof push};
        double seconds = 0.0;
        status = gpu_run(r->b->gpu, &step, 1, &seconds, error);
        if (status == KILN_OK)
            gpu_pacer_learn(pacer, push.count, seconds);
    }
    return status;
}

static int run_all(struct run *r, struct kiln_error *error)
{
    int status = make_rooms(r, error);
    if (status == KILN_OK)
        status = bring_points(r, error);
    if (status == KILN_OK)
        status = bring_cells(r, error);
    for (uint32_t number = 0; number < VULKAN_REGRESSION_SWEEPS && status == KILN_OK; number++)
        status = sweep(r, number, error);
    if (status == KILN_OK)
        status = take_results(r, error);
    drop_rooms(r);
    return status;
}

void vulkan_regression_ahead(struct vulkan_backend *b)
{
    struct vulkan_wish wishes[VULKAN_REGRESSION_SWEEPS];
    for (uint32_t i = 0; i < VULKAN_REGRESSION_SWEEPS; i++)
        wishes[i] = (struct vulkan_wish){.shader = &regression_shader, .own = i};
    vulkan_kernels_at_once(b, wishes, VULKAN_REGRESSION_SWEEPS);
}

int vulkan_regress(struct kiln_backend *backend, const struct kiln_regression_work *work, bool *done,
                   struct kiln_error *error)
{
    struct run r = {.b = (struct vulkan_backend *)backend, .work = work};
    if (!fits_in(&r))
        return KILN_OK;
    vulkan_regression_ahead(r.b);
    int status = run_all(&r, error);
    while (status != KILN_OK && vulkan_can_recover(r.b)) {
        status = vulkan_recover(r.b, error);
        if (status == KILN_OK)
            status = run_all(&r, error);
    }
    *done = status == KILN_OK;
    return status;
}
