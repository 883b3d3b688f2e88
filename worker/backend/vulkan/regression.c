/* Surface regression (worker/pass/regression.h): five sweeps of one kernel; each finishes all points before the next
 * begins. */
#include "worker/backend/vulkan/regression.h"

#include "worker/base/memory.h"

/* Its own constant is the number of the sweep. */
static const struct vulkan_shader regression_shader = {
    .name = "regression", .compute = VULKAN_CODE(regression), .compute_float = VULKAN_CODE(regression_float)};

enum {
    STRETCH = 1 << 17,    /* points transferred at a time */
    FIRST_GUESS = 1 << 12 /* points of the first dispatch */
};

static const char what[] = "denoising on the device";

/* Arrays on the device, by points or by cells. They are kept for the next call unless they are large. */
enum { POINTS, CELLS, FIRST, RANGES, GIVEN, FITS, CHOICES, RESULTS };
_Static_assert(RESULTS + 1 == VULKAN_REGRESSION_ARRAYS, "arrays of the regression");

#define STAYS (64ull << 20) /* bytes: all arrays together */

struct run {
    struct vulkan_backend *b;
    const struct kiln_regression_work *work;
};

static uint64_t bytes_of(const struct kiln_regression_work *w, int array)
{
    const uint64_t count = w->count, lights = w->lights;
    switch (array) {
    case POINTS:
        return count * sizeof(struct kiln_gpu_regression_point);
    case CELLS:
        return count * sizeof *w->cells;
    case FIRST:
        return (w->cell_count + 1) * sizeof *w->first;
    case RANGES:
        return (uint64_t)w->first[w->cell_count] * sizeof *w->ranges;
    case GIVEN:
        return count * lights * sizeof(struct kiln_gpu_regression_given);
    case FITS:
        return count * (1 + lights) * KILN_REGRESSION_FITS * sizeof(float);
    case CHOICES:
        return count * lights * sizeof(struct kiln_gpu_regression_choice);
    default:
        return count * lights * sizeof(struct kiln_gpu_regression_result);
    }
}

static int make_room(struct run *r, struct kiln_error *error)
{
    int status = KILN_OK;
    for (int i = 0; i < VULKAN_REGRESSION_ARRAYS && status == KILN_OK; i++)
        status = vulkan_grow_buffer(r->b, &r->b->regression[i], (size_t)bytes_of(r->work, i), GPU_DEVICE, what, error);
    return status;
}

void vulkan_regression_release(struct vulkan_backend *b)
{
    for (int i = 0; i < VULKAN_REGRESSION_ARRAYS; i++)
        gpu_buffer_destroy(b->gpu, &b->regression[i]);
    kiln_free(&b->regression_host);
    b->regression_room = 0;
}

/* Bytes that lie there. */
static uint64_t bytes_there(const struct vulkan_backend *b)
{
    uint64_t bytes = 0;
    for (int i = 0; i < VULKAN_REGRESSION_ARRAYS; i++)
        bytes += b->regression[i].size;
    return bytes;
}

static bool has_room(const struct run *r)
{
    uint64_t bytes = 0;
    for (int i = 0; i < VULKAN_REGRESSION_ARRAYS; i++)
        bytes += bytes_of(r->work, i);
    return bytes < (gpu_memory_left(r->b->gpu) + bytes_there(r->b)) / 8 * 7;
}

/* ---- there and back ---- */

static size_t stretch_at(const struct run *r, size_t first)
{
    return r->work->count - first < STRETCH ? r->work->count - first : STRETCH;
}

/* Allocates host memory for a stretch of points, which is kept for the next call. */
static int make_host_room(struct run *r, size_t bytes, struct kiln_error *error)
{
    return kiln_grow(&r->b->regression_host, &r->b->regression_room, bytes, 1, what, error);
}

static int bring_points(struct run *r, struct kiln_error *error)
{
    const struct kiln_regression_work *w = r->work;
    const size_t most = stretch_at(r, 0), point = sizeof(struct kiln_gpu_regression_point),
                 light = w->lights * sizeof(struct kiln_gpu_regression_given);
    int status;
    KILN_TRY(make_host_room(r, most * (point + light), error));
    for (size_t first = 0, count; first < w->count; first += count) {
        struct kiln_gpu_regression_point *points = (void *)r->b->regression_host;
        struct kiln_gpu_regression_given *given = (void *)(points + most);
        count = stretch_at(r, first);
        w->give(w->context, first, count, points, given);
        KILN_TRY(gpu_fill(r->b->gpu, &r->b->regression[POINTS], first * point, points, count * point, error));
        KILN_TRY(gpu_fill(r->b->gpu, &r->b->regression[GIVEN], first * light, given, count * light, error));
    }
end:
    return status;
}

static int bring_cells(struct run *r, struct kiln_error *error)
{
    const struct kiln_regression_work *w = r->work;
    int status;
    KILN_TRY(gpu_fill(r->b->gpu, &r->b->regression[CELLS], 0, w->cells, w->count * sizeof *w->cells, error));
    KILN_TRY(gpu_fill(r->b->gpu, &r->b->regression[FIRST], 0, w->first, (w->cell_count + 1) * sizeof *w->first, error));
    KILN_TRY(gpu_fill(r->b->gpu, &r->b->regression[RANGES], 0, w->ranges, w->first[w->cell_count] * sizeof *w->ranges,
                      error));
end:
    return status;
}

static int take_results(struct run *r, struct kiln_error *error)
{
    const struct kiln_regression_work *w = r->work;
    const size_t light = w->lights * sizeof(struct kiln_gpu_regression_result);
    int status = make_host_room(r, stretch_at(r, 0) * light, error);
    for (size_t first = 0, count; first < w->count && status == KILN_OK; first += count) {
        count = stretch_at(r, first);
        status = gpu_download(r->b->gpu, &r->b->regression[RESULTS], first * light, r->b->regression_host,
                              count * light, error);
        if (status == KILN_OK)
            w->take(w->context, first, count, (void *)r->b->regression_host);
    }
    return status;
}

/* ---- sweeps ---- */

static struct kiln_gpu_regression_push push_of(const struct run *r)
{
    const struct gpu_buffer *a = r->b->regression;
    return (struct kiln_gpu_regression_push){.scene = r->b->scene.address,
                                             .points = a[POINTS].address,
                                             .cells = a[CELLS].address,
                                             .firsts = a[FIRST].address,
                                             .ranges = a[RANGES].address,
                                             .given = a[GIVEN].address,
                                             .fits = a[FITS].address,
                                             .choices = a[CHOICES].address,
                                             .results = a[RESULTS].address,
                                             .count = r->work->count,
                                             .lights = r->work->lights};
}

/* One sweep, in slices of time. */
static int sweep(struct run *r, uint32_t number, struct gpu_kernel *kernel, struct kiln_error *error)
{
    struct gpu_pacer *pacer = &r->b->pacers[VULKAN_PACE_REGRESSION + number];
    struct kiln_gpu_regression_push push = push_of(r);
    int status = KILN_OK;
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

/* Whether each sweep is known to fit into a time slice. */
static bool is_short(const struct run *r)
{
    bool fits = true;
    for (int i = 0; i < VULKAN_REGRESSION_SWEEPS; i++) {
        const struct gpu_pacer *pacer = &r->b->pacers[VULKAN_PACE_REGRESSION + i];
        fits = fits && pacer->rate > 0.0 && gpu_pacer_next(pacer, FIRST_GUESS) >= r->work->count;
    }
    return fits;
}

/* All sweeps in one submission. */
static int sweep_at_once(struct run *r, struct gpu_kernel *const *kernels, struct kiln_error *error)
{
    const struct kiln_gpu_regression_push push = push_of(r);
    struct gpu_step steps[VULKAN_REGRESSION_SWEEPS];
    for (int i = 0; i < VULKAN_REGRESSION_SWEEPS; i++)
        steps[i] = (struct gpu_step){.kernel = kernels[i],
                                     .threads_x = push.count,
                                     .threads_y = 1,
                                     .constants = &push,
                                     .constant_bytes = sizeof push};
    return gpu_run(r->b->gpu, steps, VULKAN_REGRESSION_SWEEPS, NULL, error);
}

static int sweep_all(struct run *r, struct kiln_error *error)
{
    struct gpu_kernel *kernels[VULKAN_REGRESSION_SWEEPS];
    int status = KILN_OK;
    for (uint32_t i = 0; i < VULKAN_REGRESSION_SWEEPS; i++)
        KILN_TRY(vulkan_kernel_of(r->b, &regression_shader, false, i, &kernels[i], error));
    if (is_short(r))
        return sweep_at_once(r, kernels, error);
    for (uint32_t i = 0; i < VULKAN_REGRESSION_SWEEPS; i++)
        KILN_TRY(sweep(r, i, kernels[i], error));
end:
    return status;
}

static int run_all(struct run *r, struct kiln_error *error)
{
    int status;
    KILN_TRY(make_room(r, error));
    KILN_TRY(bring_points(r, error));
    KILN_TRY(bring_cells(r, error));
    KILN_TRY(sweep_all(r, error));
    KILN_TRY(take_results(r, error));
end:
    if (status != KILN_OK || bytes_there(r->b) > STAYS)
        vulkan_regression_release(r->b);
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
    if (!has_room(&r))
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
