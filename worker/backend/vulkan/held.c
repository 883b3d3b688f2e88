#include "worker/backend/vulkan/held.h"

#include <math.h>
#include <string.h>

#include "worker/backend/vulkan/chunks.h"
#include "worker/backend/vulkan/kept_rows.h"
#include "worker/base/memory.h"
#include "worker/sampling/keys.h"

#include "shaders/held.h"

static const struct vulkan_shader held_shader = {.name = "light that stays", .compute = VULKAN_CODE(held)};

/* The kernel's own constant. */
enum { PACKED, COMPACT, ERRORS, SUMS };

enum { GROUP = 64, CHUNK_MOST = 1 << 20 /* points: chunks.c */ };
_Static_assert(KILN_HELD_POWERS == KILN_GPU_HELD_POWERS, "sums of power");
_Static_assert(sizeof(struct kiln_held_power) == sizeof(struct kiln_gpu_held_power), "sums of power");

void vulkan_held_release(struct vulkan_backend *b)
{
    struct vulkan_held *h = &b->held;
    struct gpu_buffer *const all[] = {&h->root,  &h->points, &h->lights, &h->sums,         &h->errors,
                                      &h->parts, &h->powers, &h->bytes,  &h->radiosity[0], &h->radiosity[1]};
    for (size_t i = 0; i < sizeof all / sizeof *all; i++)
        gpu_buffer_destroy(b->gpu, all[i]);
    for (size_t i = 0; i < KILN_ROW_LIGHTS; i++)
        gpu_buffer_destroy(b->gpu, &h->albedo[i]);
    kiln_free(&h->words);
    h->word_room = 0;
    h->surface = NULL;
    h->count = 0;
}

int vulkan_held_fail(struct vulkan_backend *b, int status, struct kiln_error *error)
{
    const struct kiln_error why = error != NULL ? *error : (struct kiln_error){""};
    b->held.count = 0;
    if (status == KILN_NO_DEVICE && vulkan_can_recover(b) && vulkan_recover(b, error) == KILN_OK && error != NULL)
        *error = why;
    return status;
}

/* ---- room ---- */

static size_t powers_bytes(uint32_t count)
{
    return (size_t)count * KILN_GPU_HELD_POWERS * sizeof(struct kiln_gpu_held_power);
}

static size_t groups_most(uint64_t points)
{
    return (size_t)((points < CHUNK_MOST ? points : CHUNK_MOST) + GROUP) / GROUP;
}

/* Bytes of all but the albedo, about. */
static uint64_t room_for(uint64_t points, uint32_t count)
{
    const uint64_t a_light = 2 * sizeof(uint64_t) + 3 * sizeof(float) + sizeof(uint32_t) + 3 * sizeof(uint16_t);
    return points * (a_light * count + sizeof(struct kiln_gpu_held_point) + sizeof(uint64_t)) +
           groups_most(points) * powers_bytes(count);
}

static int make_room(struct vulkan_backend *b, uint32_t count, struct kiln_error *error)
{
    struct vulkan_held *h = &b->held;
    const size_t points = (size_t)b->surface->point_count, all = points * count;
    const struct {
        struct gpu_buffer *buffer;
        size_t bytes;
    } rooms[] = {{&h->root, sizeof h->layout},
                 {&h->lights, count * sizeof(struct kiln_gpu_held_light)},
                 {&h->sums, 3 * all * sizeof(float)},
                 {&h->errors, all * sizeof(uint32_t)},
                 {&h->parts, groups_most(points) * powers_bytes(count)},
                 {&h->powers, powers_bytes(count) + sizeof(uint32_t)},
                 {&h->bytes, points * sizeof(uint64_t)},
                 {&h->radiosity[0], all * sizeof(uint64_t)},
                 {&h->radiosity[1], all * sizeof(uint64_t)}};
    int status = KILN_OK;
    for (size_t i = 0; i < sizeof rooms / sizeof *rooms && status == KILN_OK; i++)
        status =
            vulkan_grow_buffer(b, rooms[i].buffer, rooms[i].bytes, GPU_DEVICE, "light that stays on the device", error);
    h->layout = (struct kiln_gpu_held){.from = h->radiosity[0].address,
                                       .to = h->radiosity[1].address,
                                       .sums = h->sums.address,
                                       .errors = h->errors.address,
                                       .of_point = h->points.address,
                                       .lights = h->lights.address,
                                       .parts = h->parts.address,
                                       .powers = h->powers.address,
                                       .points = points,
                                       .count = count};
    return status;
}

/* ---- points ---- */

static void describe(const struct vulkan_backend *b, size_t tile_run, struct kiln_gpu_held_point *points)
{
    const struct kiln_surface *s = b->surface;
    const struct kiln_tile_run *f = &s->tile_runs[tile_run];
    const bool counts = (b->params.scene->objects[kiln_map_object(s, f->map)].flags & KILN_OBJECT_RECEIVER_ONLY) == 0;
    struct kiln_own_point own = kiln_own_of_global(s, f->first);
    for (uint64_t rest = f->mask; rest != 0; rest &= rest - 1, own.at++) {
        const double area = counts && kiln_point_valid(s, own) ? kiln_lit_area(s, own, 1.0f) : 0.0;
        struct kiln_gpu_held_point *p = &points[own.at];
        memcpy(p->area, &area, sizeof p->area);
        p->tile = kiln_hash2(f->map, f->tile);
        p->bit = (uint32_t)__builtin_ctzll(rest);
    }
}

/* What the device must know of points, once. */
static int bring_points(struct vulkan_backend *b, struct kiln_error *error)
{
    const struct kiln_surface *s = b->surface;
    struct kiln_gpu_held_point *points = NULL;
    if (b->held.surface == s)
        return KILN_OK;
    int status = kiln_allocate(&points, (size_t)s->count, sizeof *points, "light that stays on the device", error);
    if (status != KILN_OK)
        return status;
#pragma omp parallel for num_threads((int)b->threads) if (s->tile_run_count > 64)
    for (size_t f = 0; f < s->tile_run_count; f++)
        describe(b, f, points);
    gpu_buffer_destroy(b->gpu, &b->held.points);
    status = gpu_buffer_of(b->gpu, &b->held.points, points, (size_t)s->count * sizeof *points,
                           "light that stays on the device", error);
    b->held.surface = status == KILN_OK ? s : NULL;
    kiln_free(&points);
    return status;
}

/* ---- lights ---- */

/* Runs the kernel for a step of one light, or of all. */
static int run(struct vulkan_backend *b, uint32_t step, uint32_t light, struct kiln_error *error)
{
    struct vulkan_held *h = &b->held;
    struct gpu_kernel *kernel;
    const struct kiln_gpu_held_push push = {
        .scene = b->scene.address, .held = h->root.address, .bytes = h->bytes.address, .light = light};
    const struct gpu_step dispatch = {.threads_x = (uint32_t)h->layout.points,
                                      .threads_y = step == SUMS ? h->layout.count : 1,
                                      .constants = &push,
                                      .constant_bytes = sizeof push};
    const int status = vulkan_kernel_of(b, &held_shader, false, step, &kernel, error);
    struct gpu_step with = dispatch;
    with.kernel = kernel;
    return status == KILN_OK ? gpu_run(b->gpu, &with, 1, NULL, error) : status;
}

static int bring_bytes(struct vulkan_backend *b, const void *bytes, size_t size, uint32_t step, uint32_t light,
                       struct kiln_error *error)
{
    const int status = gpu_upload(b->gpu, &b->held.bytes, 0, bytes, size, error);
    return status == KILN_OK ? run(b, step, light, error) : status;
}

/* Colours of surfaces are brought once for all lights that share them. */
static int bring_albedo(struct vulkan_backend *b, const struct kiln_held *begin, uint32_t light, uint64_t *address,
                        struct kiln_error *error)
{
    struct gpu_buffer *buffer = &b->held.albedo[light];
    for (uint32_t i = 0; i < light; i++)
        if (begin->lights[i].albedo == begin->lights[light].albedo) {
            *address = b->held.albedo[i].address;
            return KILN_OK;
        }
    const size_t bytes = 3 * (size_t)b->surface->point_count * sizeof *begin->lights->albedo;
    int status = vulkan_grow_buffer(b, buffer, (bytes + 3) / 4 * 4, GPU_DEVICE, "the albedo of a state", error);
    if (status == KILN_OK)
        status = gpu_upload(b->gpu, buffer, 0, begin->lights[light].albedo, bytes, error);
    *address = buffer->address;
    return status;
}

static int bring_light(struct vulkan_backend *b, const struct kiln_held *begin, uint32_t light,
                       struct kiln_error *error)
{
    const struct kiln_held_light *from = &begin->lights[light];
    const size_t points = (size_t)b->surface->point_count;
    int status = bring_bytes(b, from->next, points * (begin->compact ? sizeof(uint32_t) : sizeof(uint64_t)),
                             begin->compact ? COMPACT : PACKED, light, error);
    if (status == KILN_OK)
        status = bring_bytes(b, from->error, points * sizeof *from->error, ERRORS, light, error);
    if (status == KILN_OK)
        status = gpu_upload(b->gpu, &b->held.sums, 3 * points * light * sizeof *from->sum, from->sum,
                            3 * points * sizeof *from->sum, error);
    return status;
}

static int bring_lights(struct vulkan_backend *b, const struct kiln_held *begin, struct kiln_error *error)
{
    struct kiln_gpu_held_light lights[KILN_ROW_LIGHTS] = {{0}};
    int status = KILN_OK;
    for (uint32_t l = 0; l < begin->count && status == KILN_OK; l++) {
        const struct kiln_held_light *from = &begin->lights[l];
        lights[l] = (struct kiln_gpu_held_light){.scale = (uint32_t)ilogb(from->scale),
                                                 .unit = (uint32_t)ilogb(from->unit),
                                                 .unit_squared = (uint32_t)ilogb(from->unit_squared)};
        status = bring_albedo(b, begin, l, &lights[l].albedo, error);
    }
    if (status == KILN_OK)
        status = gpu_upload(b->gpu, &b->held.lights, 0, lights, begin->count * sizeof *lights, error);
    if (status == KILN_OK)
        status = gpu_upload(b->gpu, &b->held.root, 0, &b->held.layout, sizeof b->held.layout, error);
    for (uint32_t l = 0; l < begin->count && status == KILN_OK; l++)
        status = bring_light(b, begin, l, error);
    return status;
}

int vulkan_hold(struct kiln_backend *backend, const struct kiln_held *begin, bool *held, struct kiln_error *error)
{
    struct vulkan_backend *b = (struct vulkan_backend *)backend;
    const uint64_t room = room_for(b->surface->point_count, begin->count);
    b->held.count = 0;
    if (!b->float64 || !vulkan_keeps_rows(b) || b->surface->point_count >= UINT32_MAX / 3 ||
        (room > b->held.sums.size && room > gpu_memory_left(b->gpu) / 2))
        return KILN_OK;
    int status = bring_points(b, error);
    if (status == KILN_OK)
        status = make_room(b, begin->count, error);
    if (status == KILN_OK)
        status = bring_lights(b, begin, error);
    if (status != KILN_OK)
        return vulkan_held_fail(b, status, error);
    b->held.count = begin->count;
    *held = true;
    return KILN_OK;
}

/* ---- steps ---- */

/* What was made is gathered from, and what was gathered from is made anew. */
static void turn(struct kiln_gpu_held *layout)
{
    const uint64_t from = layout->from;
    layout->from = layout->to;
    layout->to = from;
}

int vulkan_held_begin(struct vulkan_backend *b, const struct kiln_held_step *step, uint32_t stream,
                      struct kiln_error *error)
{
    struct vulkan_held *h = &b->held;
    const unsigned char nothing[KILN_ROW_LIGHTS * KILN_GPU_HELD_POWERS * sizeof(struct kiln_gpu_held_power) + 4] = {0};
    int status = KILN_OK;
    if (h->count == 0)
        return kiln_fail(error, KILN_NO_DEVICE, "the device was lost, with the light of states that was on it");
    if (step->packs) {
        h->layout.stream = step->pack_stream;
        status = gpu_upload(b->gpu, &h->root, 0, &h->layout, sizeof h->layout, error);
        if (status == KILN_OK)
            status = run(b, SUMS, 0, error);
    }
    turn(&h->layout);
    h->layout.final = step->final;
    h->layout.compact = step->compact;
    h->layout.stream = stream;
    h->layout.seed = step->seed;
    if (status == KILN_OK)
        status = gpu_upload(b->gpu, &h->root, 0, &h->layout, sizeof h->layout, error);
    if (status == KILN_OK)
        status = gpu_upload(b->gpu, &h->powers, 0, nothing, powers_bytes(h->count) + sizeof(uint32_t), error);
    return status;
}

int vulkan_held_end(struct vulkan_backend *b, struct kiln_held_power *powers, struct kiln_error *error)
{
    struct vulkan_held *h = &b->held;
    unsigned char found[KILN_ROW_LIGHTS * KILN_GPU_HELD_POWERS * sizeof(struct kiln_gpu_held_power) + 4];
    const size_t bytes = powers_bytes(h->count);
    uint32_t bad;
    const int status = gpu_download(b->gpu, &h->powers, 0, found, bytes + sizeof bad, error);
    if (status != KILN_OK)
        return status;
    b->returned += bytes + sizeof bad;
    memcpy(powers, found, bytes);
    memcpy(&bad, found + bytes, sizeof bad);
    return bad == 0 ? KILN_OK
                    : kiln_fail(error, KILN_NO_DEVICE,
                                "%s ends long loops early, and a surface point needs one; use another device or "
                                "--backend embree",
                                gpu_about(b->gpu)->name);
}

/* ---- the end ---- */

/* Errors as they came, all light's in the lower half of a word. */
static void part_errors(const struct vulkan_backend *b, const uint32_t *words, uint16_t *all, uint16_t *indirect)
{
#pragma omp parallel for num_threads((int)b->threads) if (b->surface->point_count > 1 << 14)
    for (uint64_t i = 0; i < b->surface->point_count; i++) {
        all[i] = (uint16_t)words[i];
        if (indirect != NULL)
            indirect[i] = (uint16_t)(words[i] >> 16);
    }
}

int vulkan_hold_fetch(struct kiln_backend *backend, uint32_t light, float *sum, uint16_t *error_all,
                      uint16_t *error_indirect, struct kiln_error *error)
{
    struct vulkan_backend *b = (struct vulkan_backend *)backend;
    const size_t points = (size_t)b->surface->point_count, sums = 3 * points * sizeof *sum,
                 errors = points * sizeof(uint32_t);
    uint32_t *words = NULL;
    int status = kiln_grow(&b->held.words, &b->held.word_room, points, sizeof *words, "the errors of a state", error);
    words = b->held.words;
    if (status == KILN_OK)
        status = gpu_download(b->gpu, &b->held.sums, light * sums, sum, sums, error);
    if (status == KILN_OK)
        status = gpu_download(b->gpu, &b->held.errors, light * errors, words, errors, error);
    if (status == KILN_OK) {
        b->returned += sums + errors;
        part_errors(b, words, error_all, error_indirect);
    }
    return status == KILN_OK ? KILN_OK : vulkan_held_fail(b, status, error);
}
