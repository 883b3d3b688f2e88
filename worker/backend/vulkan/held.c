#include "worker/backend/vulkan/held.h"

#include <math.h>
#include <string.h>

#include "worker/backend/vulkan/kept_rows.h"
#include "worker/base/memory.h"
#include "worker/sampling/keys.h"

static const struct vulkan_shader held_shader = {.name = "light that stays", .compute = VULKAN_CODE(held)};
static const struct vulkan_shader direct_shader = {.name = "light that stays: direct",
                                                   .compute = VULKAN_CODE(held_direct)};
const struct vulkan_shader vulkan_held_powers = {.name = "light that stays: powers",
                                                 .compute = VULKAN_CODE(held_powers)};

/* The kernel's own constant. */
enum { PACKED, COMPACT, ERRORS, SUMS, FETCHED };

enum { GROUP = 64, CHUNK_MOST = 1 << 20 /* points: chunks.c */ };
_Static_assert(KILN_HELD_POWERS == KILN_GPU_HELD_POWERS, "sums of power");
_Static_assert(sizeof(struct kiln_held_power) == sizeof(struct kiln_gpu_held_power), "sums of power");
_Static_assert(sizeof(struct kiln_direct_answer) == sizeof(struct kiln_gpu_direct_answer) &&
                   offsetof(struct kiln_direct_answer, error) == offsetof(struct kiln_gpu_direct_answer, error) &&
                   offsetof(struct kiln_direct_answer, count) == offsetof(struct kiln_gpu_direct_answer, count),
               "answers");

void vulkan_held_release(struct vulkan_backend *b)
{
    struct vulkan_held *h = &b->held;
    struct gpu_buffer *const all[] = {&h->root,   &h->points,        &h->lights,      &h->sums,  &h->errors,
                                      &h->direct, &h->direct_errors, &h->mixes,       &h->parts, &h->powers,
                                      &h->bytes,  &h->radiosity[0],  &h->radiosity[1]};
    for (size_t i = 0; i < sizeof all / sizeof *all; i++)
        gpu_buffer_destroy(b->gpu, all[i]);
    for (size_t i = 0; i < KILN_ROW_LIGHTS; i++)
        gpu_buffer_destroy(b->gpu, &h->albedo[i]);
    for (size_t i = 0; i < h->answer_count; i++)
        gpu_buffer_destroy(b->gpu, &h->answers[i].buffer);
    kiln_free(&h->answers);
    h->answer_count = h->answer_room = 0;
    h->surface = NULL;
    h->room = 0;
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

/* Bytes needed, approximately, except albedo and stored direct light. */
static uint64_t room_for(uint64_t points, uint32_t count)
{
    const uint64_t a_light = 2 * sizeof(uint64_t) + 6 * sizeof(float) + 2 * sizeof(uint32_t) + 3 * sizeof(uint16_t);
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
                 {&h->direct, 3 * all * sizeof(float)},
                 {&h->direct_errors, all * sizeof(uint32_t)},
                 {&h->parts, groups_most(points) * powers_bytes(count)},
                 {&h->powers, powers_bytes(count) + sizeof(uint32_t)},
                 {&h->bytes, (points + 1) * sizeof(uint64_t)},
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
                                       .direct = h->direct.address,
                                       .direct_errors = h->direct_errors.address,
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

/* Uploads the data of points, once. */
static int bring_points(struct vulkan_backend *b, struct kiln_error *error)
{
    const struct kiln_surface *s = b->surface;
    struct kiln_gpu_held_point *points = NULL;
    if (b->held.surface == s)
        return KILN_OK;
    const struct vulkan_once once = vulkan_once_begin();
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
    vulkan_once_end(b, once);
    return status;
}

/* ---- stored direct light ---- */

static struct vulkan_held_answers *find_answers(const struct vulkan_held *h, uint64_t key)
{
    for (size_t i = 0; i < h->answer_count; i++)
        if (h->answers[i].key == key)
            return &h->answers[i];
    return NULL;
}

/* Marks the stored answers that are wanted; returns the bytes of those that are missing. */
static uint64_t want_answers(struct vulkan_backend *b, const struct kiln_held *begin)
{
    struct vulkan_held *h = &b->held;
    uint64_t bytes = 0;
    for (size_t i = 0; i < h->answer_count; i++)
        h->answers[i].wanted = false;
    for (uint32_t l = 0; l < begin->count; l++)
        for (uint32_t k = 0; begin->lights[l].mixed && k < begin->lights[l].part_count; k++) {
            struct vulkan_held_answers *there = find_answers(h, begin->lights[l].parts[k].key);
            if (there != NULL)
                there->wanted = true;
            else /* missing; one that two lights share is counted twice */
                bytes += b->surface->point_count * sizeof(struct kiln_direct_answer);
        }
    return bytes;
}

/* Frees the stored answers that are not wanted. */
static void drop_answers(struct vulkan_backend *b)
{
    struct vulkan_held *h = &b->held;
    for (size_t i = 0; i < h->answer_count;)
        if (h->answers[i].wanted) {
            i++;
        } else {
            gpu_buffer_destroy(b->gpu, &h->answers[i].buffer);
            h->answers[i] = h->answers[--h->answer_count];
        }
}

/* Whether there is memory for the wanted answers. */
static bool has_room(struct vulkan_backend *b, const struct kiln_held *begin)
{
    const uint64_t bytes = want_answers(b, begin);
    if (bytes > gpu_memory_left(b->gpu) / 2)
        drop_answers(b);
    return bytes <= gpu_memory_left(b->gpu) / 2;
}

static int bring_answers(struct vulkan_backend *b, const struct kiln_held_term *part, struct kiln_error *error)
{
    struct vulkan_held *h = &b->held;
    if (find_answers(h, part->key) != NULL)
        return KILN_OK;
    const struct vulkan_once once = vulkan_once_begin();
    struct vulkan_held_answers made = {.key = part->key, .wanted = true};
    int status;
    KILN_TRY(kiln_grow(&h->answers, &h->answer_room, h->answer_count + 1, sizeof *h->answers,
                       "direct light on the device", error));
    KILN_TRY(gpu_buffer_of(b->gpu, &made.buffer, part->answers, (size_t)b->surface->point_count * sizeof *part->answers,
                           "direct light on the device", error));
    h->answers[h->answer_count++] = made;
end:
    vulkan_once_end(b, once);
    return status;
}

/* Uploads the parts of all lights, and stores in each light which parts are its own. */
static int bring_parts(struct vulkan_backend *b, const struct kiln_held *begin, struct kiln_gpu_held_light *lights,
                       struct kiln_error *error)
{
    struct vulkan_held *h = &b->held;
    struct kiln_gpu_held_term *parts = NULL;
    uint32_t count = 0;
    int status = KILN_OK;
    for (uint32_t l = 0; l < begin->count; l++)
        count += begin->lights[l].mixed ? begin->lights[l].part_count : 0;
    status = kiln_allocate(&parts, count + 1, sizeof *parts, "direct light on the device", error);
    count = 0;
    for (uint32_t l = 0; l < begin->count && status == KILN_OK; l++) {
        const struct kiln_held_light *from = &begin->lights[l];
        lights[l].part_first = count;
        lights[l].part_count = from->mixed ? from->part_count : KILN_GPU_NONE;
        lights[l].samples = from->samples;
        for (uint32_t k = 0; from->mixed && k < from->part_count && status == KILN_OK; k++) {
            status = bring_answers(b, &from->parts[k], error);
            if (status != KILN_OK)
                break;
            parts[count].answers = find_answers(h, from->parts[k].key)->buffer.address;
            memcpy(parts[count++].factor, from->parts[k].factor, sizeof parts->factor);
        }
    }
    if (status == KILN_OK)
        status = vulkan_grow_buffer(b, &h->mixes, (count + 1) * sizeof *parts, GPU_DEVICE, "direct light on the device",
                                    error);
    if (status == KILN_OK && count > 0)
        status = gpu_upload(b->gpu, &h->mixes, 0, parts, count * sizeof *parts, error);
    h->layout.mixes = h->mixes.address;
    kiln_free(&parts);
    return status;
}

/* ---- lights ---- */

/* Runs the kernel for a step, of one light or of all. */
static int run(struct vulkan_backend *b, uint32_t step, uint32_t light, struct kiln_error *error)
{
    struct vulkan_held *h = &b->held;
    struct gpu_kernel *kernel;
    const struct kiln_gpu_held_push push = {
        .scene = b->scene.address, .held = h->root.address, .bytes = h->bytes.address, .light = light};
    const uint32_t points = (uint32_t)h->layout.points;
    const struct gpu_step dispatch = {.threads_x = step == FETCHED ? (points + 1) / 2 : points,
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

/* Uploads surface colours, once for all lights that share them. */
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
    int status;
    KILN_TRY(bring_bytes(b, from->next, points * (begin->compact ? sizeof(uint32_t) : sizeof(uint64_t)),
                         begin->compact ? COMPACT : PACKED, light, error));
    KILN_TRY(bring_bytes(b, from->error, points * sizeof *from->error, ERRORS, light, error));
    KILN_TRY(gpu_upload(b->gpu, &b->held.sums, 3 * points * light * sizeof *from->sum, from->sum,
                        3 * points * sizeof *from->sum, error));
end:
    return status;
}

static int bring_lights(struct vulkan_backend *b, const struct kiln_held *begin, struct kiln_error *error)
{
    struct kiln_gpu_held_light lights[KILN_ROW_LIGHTS] = {{0}};
    int status = KILN_OK;
    for (uint32_t l = 0; l < begin->count; l++) {
        const struct kiln_held_light *from = &begin->lights[l];
        lights[l] = (struct kiln_gpu_held_light){.scale = (uint32_t)ilogb(from->scale),
                                                 .unit = (uint32_t)ilogb(from->unit),
                                                 .unit_squared = (uint32_t)ilogb(from->unit_squared)};
        KILN_TRY(bring_albedo(b, begin, l, &lights[l].albedo, error));
    }
    KILN_TRY(bring_parts(b, begin, lights, error));
    KILN_TRY(gpu_upload(b->gpu, &b->held.lights, 0, lights, begin->count * sizeof *lights, error));
    KILN_TRY(gpu_upload(b->gpu, &b->held.root, 0, &b->held.layout, sizeof b->held.layout, error));
    for (uint32_t l = 0; l < begin->count; l++)
        if (!begin->lights[l].mixed)
            KILN_TRY(bring_light(b, begin, l, error));
end:
    return status;
}

static int begin_powers(struct vulkan_backend *b, uint32_t count, struct kiln_error *error)
{
    const unsigned char nothing[KILN_ROW_LIGHTS * KILN_GPU_HELD_POWERS * sizeof(struct kiln_gpu_held_power) + 4] = {0};
    return gpu_upload(b->gpu, &b->held.powers, 0, nothing, powers_bytes(count) + sizeof(uint32_t), error);
}

/* Computes the direct light of those lights that are mixed from stored parts. */
static int mix(struct vulkan_backend *b, const struct kiln_held *begin, struct kiln_held_power *powers,
               struct kiln_error *error)
{
    struct vulkan_held *h = &b->held;
    struct gpu_kernel *kernel, *sums;
    const uint32_t points = (uint32_t)h->layout.points;
    int status;
    KILN_TRY(vulkan_kernel_of(b, &direct_shader, false, 0, &kernel, error));
    KILN_TRY(vulkan_kernel_of(b, &vulkan_held_powers, false, 0, &sums, error));
    KILN_TRY(begin_powers(b, begin->count, error));
    for (uint32_t first = 0; first < points; first += CHUNK_MOST) {
        const uint32_t some = points - first < CHUNK_MOST ? points - first : CHUNK_MOST;
        const struct kiln_gpu_held_push push = {.scene = b->scene.address,
                                                .held = h->root.address,
                                                .groups = (some + GROUP - 1) / GROUP,
                                                .first = first,
                                                .count = some};
        const struct gpu_step steps[] = {{.kernel = kernel,
                                          .threads_x = some,
                                          .threads_y = begin->count,
                                          .constants = &push,
                                          .constant_bytes = sizeof push},
                                         {.kernel = sums,
                                          .threads_x = GROUP * KILN_GPU_HELD_POWERS,
                                          .threads_y = begin->count,
                                          .constants = &push,
                                          .constant_bytes = sizeof push}};
        KILN_TRY(gpu_run(b->gpu, steps, sizeof steps / sizeof *steps, NULL, error));
    }
    KILN_TRY(gpu_download(b->gpu, &h->powers, 0, powers, powers_bytes(begin->count), error));
end:
    b->returned += status == KILN_OK ? powers_bytes(begin->count) : 0;
    return status;
}

int vulkan_hold(struct kiln_backend *backend, const struct kiln_held *begin, bool *held, struct kiln_held_power *powers,
                struct kiln_error *error)
{
    struct vulkan_backend *b = (struct vulkan_backend *)backend;
    const uint64_t room = room_for(b->surface->point_count, begin->count);
    bool mixes = false;
    b->held.count = 0;
    if (!b->float64 || !vulkan_keeps_rows(b) || b->surface->point_count >= UINT32_MAX / 3 || !has_room(b, begin) ||
        (room > b->held.room && room - b->held.room > gpu_memory_left(b->gpu) / 2))
        return KILN_OK;
    for (uint32_t l = 0; l < begin->count; l++)
        mixes = mixes || begin->lights[l].mixed;
    int status = bring_points(b, error);
    if (status == KILN_OK)
        status = make_room(b, begin->count, error);
    b->held.room = room > b->held.room ? room : b->held.room;
    b->held.layout.compact = begin->compact;
    b->held.layout.stream = begin->stream;
    b->held.layout.seed = begin->seed;
    if (status == KILN_OK)
        status = bring_lights(b, begin, error);
    if (status == KILN_OK && mixes)
        status = mix(b, begin, powers, error);
    if (status != KILN_OK)
        return vulkan_held_fail(b, status, error);
    b->held.count = begin->count;
    *held = true;
    return KILN_OK;
}

/* ---- steps ---- */

/* Swaps the arrays: the new radiosity is gathered from next, the old one is overwritten. */
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
        status = begin_powers(b, h->count, error);
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

/* Downloads one of the arrays of errors that the kernel has written. */
static int fetch_errors(struct vulkan_backend *b, size_t array, uint16_t *to, struct kiln_error *error)
{
    const size_t points = (size_t)b->surface->point_count, bytes = points * sizeof *to;
    if (to == NULL)
        return KILN_OK;
    b->returned += bytes;
    return gpu_download(b->gpu, &b->held.bytes, array * ((points + 1) / 2 * 2) * sizeof *to, to, bytes, error);
}

static int fetch_light(struct vulkan_backend *b, const struct gpu_buffer *from, uint32_t light, float *to,
                       struct kiln_error *error)
{
    const size_t bytes = 3 * (size_t)b->surface->point_count * sizeof *to;
    if (to == NULL)
        return KILN_OK;
    b->returned += bytes;
    return gpu_download(b->gpu, from, light * bytes, to, bytes, error);
}

int vulkan_hold_fetch(struct kiln_backend *backend, uint32_t light, const struct kiln_held_fetch *to,
                      struct kiln_error *error)
{
    struct vulkan_backend *b = (struct vulkan_backend *)backend;
    uint16_t *const errors[] = {to->error, to->error_direct, to->error_indirect};
    int status;
    KILN_TRY(run(b, FETCHED, light, error));
    KILN_TRY(fetch_light(b, &b->held.sums, light, to->sum, error));
    KILN_TRY(fetch_light(b, &b->held.direct, light, to->direct, error));
    for (size_t i = 0; i < sizeof errors / sizeof *errors; i++)
        KILN_TRY(fetch_errors(b, i, errors[i], error));
end:
    return status == KILN_OK ? KILN_OK : vulkan_held_fail(b, status, error);
}
