/* The kernels of the bidirectional pass, and of light paths that land, one after the other. Each does one step at a
 * surface for all active paths (shaders/subpaths.glsl). Paths that end leave the list of active paths, so that kernels
 * have work in all threads. Light is summed exactly, so results depend neither on the order nor on the number of paths
 * at once. */
#include <stddef.h>
#include <stdint.h> /* before the shaders */
#include <string.h>

#include "worker/backend/vulkan/bidirectional.h"

#define KILN_STORED_REAL double /* which takes the more room */
#define KILN_STORED_NAME(name) name
#include "shaders/shared/layout_land_real.h"

#define SHADER_WITH_GLOSS(shader, text)                                                                                \
    static const struct vulkan_shader shader##_with_gloss = {.name = text " with gloss",                               \
                                                             .compute = VULKAN_CODE(shader##_gloss),                   \
                                                             .compute_float = VULKAN_CODE(shader##_gloss_float)};      \
    static const struct vulkan_shader shader##_shader = {.name = text,                                                 \
                                                         .compute = VULKAN_CODE(shader),                               \
                                                         .compute_float = VULKAN_CODE(shader##_float),                 \
                                                         .gloss = &shader##_with_gloss};
SHADER_WITH_GLOSS(light_paths, "paths of light")
SHADER_WITH_GLOSS(eye_paths, "paths of the camera")
/* at diffuse surfaces, in scenes with gloss */
static const struct vulkan_shader light_paths_diffuse = {.name = "paths of light at diffuse surfaces",
                                                         .compute = VULKAN_CODE(light_paths),
                                                         .compute_float = VULKAN_CODE(light_paths_float)};
static const struct vulkan_shader eye_paths_diffuse = {.name = "paths of the camera at diffuse surfaces",
                                                       .compute = VULKAN_CODE(eye_paths),
                                                       .compute_float = VULKAN_CODE(eye_paths_float)};
SHADER_WITH_GLOSS(path_connect, "connections of paths")
SHADER_WITH_GLOSS(path_merge, "merging of photons")
SHADER_WITH_GLOSS(path_splat, "light to the camera")
/* those that trace */
#define SHADER_THAT_TRACES(shader, text)                                                                               \
    static const struct vulkan_shader shader##_with_gloss = {.name = text " with gloss",                               \
                                                             .compute = VULKAN_CODE(shader##_gloss),                   \
                                                             .compute_float = VULKAN_CODE(shader##_gloss_float),       \
                                                             .pipeline = VULKAN_CODE(shader##_gloss_pipeline),         \
                                                             .pipeline_float =                                         \
                                                                 VULKAN_CODE(shader##_gloss_pipeline_float)};          \
    static const struct vulkan_shader shader##_shader = {.name = text,                                                 \
                                                         .compute = VULKAN_CODE(shader),                               \
                                                         .compute_float = VULKAN_CODE(shader##_float),                 \
                                                         .pipeline = VULKAN_CODE(shader##_pipeline),                   \
                                                         .pipeline_float = VULKAN_CODE(shader##_pipeline_float),       \
                                                         .gloss = &shader##_with_gloss};
SHADER_THAT_TRACES(path_rays, "rays of paths")
SHADER_THAT_TRACES(point_paths, "paths of surface points")
static const struct vulkan_shader path_pairs_shader = {
    .name = "pairs of vertices", .compute = VULKAN_CODE(path_pairs), .compute_float = VULKAN_CODE(path_pairs_float)};
static const struct vulkan_shader photons_shader = {
    .name = "buckets of photons", .compute = VULKAN_CODE(photons), .compute_float = VULKAN_CODE(photons_float)};
static const struct vulkan_shader land_shader = {
    .name = "light paths that land", .compute = VULKAN_CODE(land), .compute_float = VULKAN_CODE(land_float)};
static const struct vulkan_shader land_first_shader = {.name = "light paths that land, at first surfaces",
                                                       .compute = VULKAN_CODE(land_first),
                                                       .compute_float = VULKAN_CODE(land_first_float)};
static const struct vulkan_shader land_cross_shader = {.name = "light paths at probes",
                                                       .compute = VULKAN_CODE(land_cross),
                                                       .compute_float = VULKAN_CODE(land_cross_float)};
static const struct vulkan_shader land_on_shader = {.name = "light paths that land, at gloss",
                                                    .compute = VULKAN_CODE(land_on),
                                                    .compute_float = VULKAN_CODE(land_on_float)};

/* MOST_SLOTS: active paths. FIRST_GUESS: where pacers begin. LEAST: fewest threads of a dispatch; a GPU runs thousands
 * at once, a software device a handful. TALLIES: dispatches until all tallies are cleared. PAIRS: room for pairs per
 * path. */
enum {
    MOST_SLOTS = 1 << 21,
    MOST_SLOTS_SOFTWARE = 1 << 16,
    FIRST_GUESS = 1 << 13,
    LEAST = 1 << 13,
    LEAST_SOFTWARE = 64,
    TALLIES = 1 << 12,
    PAIRS = 2,
    PAIRS_OF_FEW = 16,  /* PAIRS if there are few active paths */
    LIGHT_SURFACES = 4, /* of light paths, submitted together */
    EYE_SURFACES = 4,   /* of paths of the camera, at most */
    LAND_SURFACES = 4,  /* of paths that land: at first, */
    LAND_MORE = 16,     /* and of the fewer that are left */
    LISTS = 4           /* lists of slots: active paths and the next ones; those at gloss, and others */
};

/* ---- what is on the device ---- */

/* Room for a path's shadow rays at a surface: their largest number, or one for each of its pairs. */
static uint64_t shadows_of_path(const struct both_run *r)
{
    const uint64_t samples = 2 + (uint64_t)r->b->layout.lights.directional_count;
    return samples > PAIRS ? samples : PAIRS;
}

static bool lands(const struct both_run *r) { return (r->method & KILN_GPU_BOTH_LANDS) != 0; }
static bool from_points(const struct both_run *r) { return (r->method & KILN_GPU_BOTH_POINTS) != 0; }
static uint64_t sum_words(const struct both_run *r)
{
    return from_points(r) ? KILN_GPU_BOTH_POINT_WORDS : KILN_GPU_BOTH_SUM_WORDS;
}

/* Bytes. */
static uint64_t room_of_slot(const struct both_run *r)
{
    const bool points = from_points(r);
    const uint64_t a_ray = sizeof(struct kiln_gpu_shadow_ray) + (points ? sizeof(struct kiln_gpu_point_ray) : 0),
                   any = sizeof(struct kiln_gpu_subpath) + LISTS * sizeof(uint32_t);
    return lands(r) ? any + sizeof(struct kiln_gpu_land_path)
                    : any + sizeof(struct kiln_gpu_eye_vertex) + sum_words(r) * sizeof(uint32_t) +
                          PAIRS * sizeof(struct kiln_gpu_both_pair) + shadows_of_path(r) * a_ray +
                          (points ? sizeof(struct kiln_gpu_point_path) : 0);
}

static void choose_slots(struct both_run *r)
{
    const bool points = from_points(r);
    uint64_t slots = r->b->scratch_most / room_of_slot(r), paths = r->count;
    const uint64_t most = gpu_about(r->b->gpu)->software ? MOST_SLOTS_SOFTWARE : MOST_SLOTS;
    if ((r->method & KILN_GPU_BOTH_MERGES) != 0)
        paths = points && paths > r->paths ? paths : r->paths;
    slots = slots < most ? slots : most;
    slots = slots < paths ? slots : paths;
    r->slots = slots > 64 ? (uint32_t)slots : 64;
    r->shadow_room = (uint32_t)(r->slots * shadows_of_path(r));
    r->pair_room = r->slots * PAIRS;
}

static int create_slots(struct both_run *r, struct kiln_error *error)
{
    const bool both = !lands(r);
    const struct {
        struct gpu_buffer *buffer;
        size_t each, count;
        const char *what;
    } of[] = {
        {&r->subpaths, sizeof(struct kiln_gpu_subpath), r->slots, "paths under way"},
        {&r->point_paths, sizeof(struct kiln_gpu_point_path), from_points(r) ? r->slots : 0, "paths of points"},
        {&r->point_rays, sizeof(struct kiln_gpu_point_ray), from_points(r) ? r->shadow_room : 0, "rays of points"},
        {&r->lands, sizeof(struct kiln_gpu_land_path), both ? 0 : r->slots, "light paths under way"},
        {&r->eyes, sizeof(struct kiln_gpu_eye_vertex), both ? r->slots : 0, "vertices of paths under way"},
        {&r->radiance, (size_t)sum_words(r) * sizeof(uint32_t), both ? r->slots : 0, "what paths have brought"},
        {&r->lists, LISTS * sizeof(uint32_t), r->slots, "lists of paths under way"},
        {&r->pairs, sizeof(struct kiln_gpu_both_pair), both ? r->pair_room : 0, "pairs of vertices"},
        {&r->shadows, sizeof(struct kiln_gpu_shadow_ray), both ? r->shadow_room : 0, "shadow rays"},
        {&r->tallies, sizeof(struct kiln_gpu_both_tally), TALLIES, "what dispatches leave to do"}};
    int status = gpu_buffer_create(r->b->gpu, &r->answer, BOTH_QUEUE * sizeof(struct kiln_gpu_both_tally), GPU_HOST,
                                   "what dispatches leave to do", error);
    for (size_t i = 0; i < sizeof of / sizeof of[0] && status == KILN_OK; i++)
        if (of[i].count > 0)
            status =
                gpu_buffer_create(r->b->gpu, of[i].buffer, of[i].each * of[i].count, GPU_DEVICE, of[i].what, error);
    r->shared.subpaths = r->subpaths.address;
    r->shared.eyes = r->eyes.address;
    r->shared.lands = r->lands.address;
    r->shared.radiance = r->radiance.address;
    r->shared.pairs = r->pairs.address;
    r->shared.shadows = r->shadows.address;
    r->tally = TALLIES;
    return status;
}

static bool connects(const struct both_run *r) { return (r->method & KILN_GPU_BOTH_CONNECTS) != 0; }
static bool merges(const struct both_run *r) { return (r->method & KILN_GPU_BOTH_MERGES) != 0; }
/* connects to light vertices; else only to light samples */
static bool links(const struct both_run *r) { return connects(r) && (r->method & KILN_GPU_BOTH_ALONE) == 0; }

/* A stage, and its kernel. */
struct stage_kernel {
    struct both_stage *stage;
    const struct vulkan_shader *shader;
    uint32_t constant;
    size_t pace;
    bool wanted;
};
enum { MOST_STAGES = 24 };

/* Lists the stages of this run; returns their number in `stages`. */
static size_t stages_of(struct both_run *r, struct stage_kernel stages[MOST_STAGES])
{
    const bool connects = (r->method & KILN_GPU_BOTH_CONNECTS) != 0, merges = (r->method & KILN_GPU_BOTH_MERGES) != 0,
               splats = (r->method & KILN_GPU_BOTH_SPLATS) != 0, own = (r->method & KILN_GPU_BOTH_OWN) != 0,
               alone = (r->method & KILN_GPU_BOTH_ALONE) != 0, land = lands(r), both = !land;
    const uint32_t points = r->method & KILN_GPU_BOTH_POINTS,
                   next = r->method & (KILN_GPU_BOTH_POINTS | KILN_GPU_BOTH_LANDS),
                   crosses = r->crosses ? KILN_GPU_LAND_CROSSES : 0, shares = r->shares ? KILN_GPU_LAND_SHARES : 0;
    r->sorts = r->b->materials.gloss || land;
    const struct vulkan_shader *ends = points != 0 ? &point_paths_shader
                                       : r->sorts  ? &eye_paths_diffuse
                                                   : &eye_paths_shader;
    const struct stage_kernel of[] = {
        {&r->light, &light_paths_shader, points, VULKAN_PACE_LIGHT_PATHS, both && !alone},
        {&r->eye, &eye_paths_shader, r->method, VULKAN_PACE_EYE_PATHS, both},
        {&r->light_diffuse, &light_paths_diffuse, points, VULKAN_PACE_LIGHT_DIFFUSE, both && r->sorts && !alone},
        {&r->eye_diffuse, &eye_paths_diffuse, r->method, VULKAN_PACE_EYE_DIFFUSE, both && r->sorts},
        {&r->eye_ends, ends, r->method, VULKAN_PACE_EYE_ENDS, both},
        {&r->begin_landing, &land_shader, KILN_GPU_LAND_BEGINS | crosses, KILN_PASS_INDEX_land, land},
        {&r->cross, &land_cross_shader, crosses, VULKAN_PACE_SPHERES, land && r->crosses},
        {&r->met_first, &land_first_shader, shares, KILN_PASS_INDEX_land, land},
        {&r->light, &land_on_shader, shares | crosses, KILN_PASS_INDEX_land, land},
        {&r->light_diffuse, &land_shader, shares, KILN_PASS_INDEX_land, land},
        {&r->next, land ? &path_rays_with_gloss : &path_rays_shader, KILN_GPU_RAYS_NEXT | next,
         land ? KILN_PASS_INDEX_land : VULKAN_PACE_PATH_RAYS, true},
        {&r->to_paths, &path_rays_shader, KILN_GPU_RAYS_TO_PATHS | points, VULKAN_PACE_SHADOW_RAYS, connects},
        {&r->to_camera, &path_rays_shader, KILN_GPU_RAYS_TO_CAMERA, VULKAN_PACE_CAMERA_RAYS, splats},
        {&r->connected, &path_pairs_shader, KILN_GPU_PAIRS_CONNECTED, VULKAN_PACE_PAIRS, links(r)},
        {&r->near, &path_pairs_shader, own ? KILN_GPU_PAIRS_OWN : KILN_GPU_PAIRS_NEAR, VULKAN_PACE_NEAR, merges},
        {&r->connect, &path_connect_shader, points, VULKAN_PACE_CONNECT, links(r)},
        {&r->merge, &path_merge_shader, r->method, VULKAN_PACE_MERGE, merges},
        {&r->splat, &path_splat_shader, r->method, VULKAN_PACE_SPLAT, splats},
        {&r->photon, &photons_shader, 0, VULKAN_PACE_PHOTONS, true}};
    _Static_assert(sizeof of / sizeof of[0] <= MOST_STAGES, "room for them");
    memcpy(stages, of, sizeof of);
    return sizeof of / sizeof of[0];
}

void both_expect(struct both_run *r)
{
    struct stage_kernel of[MOST_STAGES];
    struct vulkan_wish wishes[MOST_STAGES];
    const size_t stages = stages_of(r, of);
    const bool points = (r->method & KILN_GPU_BOTH_POINTS) != 0;
    size_t count = 0;
    for (size_t i = 0; i < stages; i++)
        if (of[i].wanted && (points || of[i].stage != &r->eye_ends)) /* else its kernel is there already */
            wishes[count++] = (struct vulkan_wish){.shader = of[i].shader, .own = of[i].constant};
    vulkan_kernels_at_once(r->b, wishes, count);
}

int both_kernels(struct both_run *r, struct kiln_error *error)
{
    struct stage_kernel of[MOST_STAGES];
    const size_t stages = stages_of(r, of);
    int status = KILN_OK;
    both_expect(r);
    for (size_t i = 0; i < stages && status == KILN_OK; i++) {
        if (!of[i].wanted)
            continue;
        of[i].stage->pace = of[i].pace;
        status = vulkan_kernel_of(r->b, of[i].shader, false, of[i].constant, &of[i].stage->kernel, error);
    }
    return status;
}

int both_stages_create(struct both_run *r, struct kiln_error *error)
{
    choose_slots(r);
    const int status = both_kernels(r, error);
    return status == KILN_OK ? create_slots(r, error) : status;
}

void both_stages_destroy(struct both_run *r)
{
    struct gpu_buffer *buffers[] = {&r->subpaths, &r->eyes,    &r->lands,  &r->radiance,    &r->lists,     &r->pairs,
                                    &r->shadows,  &r->tallies, &r->answer, &r->point_paths, &r->point_rays};
    for (size_t i = 0; i < sizeof buffers / sizeof buffers[0]; i++)
        gpu_buffer_destroy(r->b->gpu, buffers[i]);
}

/* ---- a dispatch ---- */

static int dispatch(struct both_run *r, struct gpu_kernel *kernel, bool answers, double *seconds,
                    struct kiln_error *error)
{
    const struct gpu_step steps[] = {{.kernel = kernel,
                                      .threads_x = r->push.count,
                                      .threads_y = 1,
                                      .constants = &r->push,
                                      .constant_bytes = sizeof r->push},
                                     {.from = &r->tallies,
                                      .to = &r->answer,
                                      .from_offset = (r->tally - 1) * sizeof(struct kiln_gpu_both_tally),
                                      .size = sizeof(struct kiln_gpu_both_tally)}};
    return gpu_run(r->b->gpu, steps, answers ? 2 : 1, seconds, error);
}

int both_clear(struct both_run *r, uint64_t address, uint64_t size, struct kiln_error *error)
{
    const uint64_t most = 1u << 30; /* bytes at once */
    const struct kiln_gpu_both_push before = r->push;
    int status = KILN_OK;
    r->push.stage = KILN_GPU_PHOTONS_CLEAR;
    for (uint64_t done = 0; done < size && status == KILN_OK; done += most) {
        r->push.sums = address + done;
        r->push.count = (uint32_t)((size - done < most ? size - done : most) / 4);
        status = dispatch(r, r->photon.kernel, false, NULL, error);
    }
    r->push = before;
    return status;
}

static int next_tally(struct both_run *r, struct kiln_error *error)
{
    int status = KILN_OK;
    if (r->tally == TALLIES) {
        status = both_clear(r, r->tallies.address, r->tallies.size, error);
        r->tally = 0;
    }
    r->push.tally = r->tallies.address + r->tally++ * sizeof(struct kiln_gpu_both_tally);
    return status;
}

/* Measures the speed, but ignores slow dispatches with few threads: they take as long as a single thread, and tell
 * nothing about larger ones. */
static void learn(struct gpu_pacer *pacer, uint64_t work, double seconds)
{
    if (!(pacer->rate > 0.0) || seconds > pacer->slice_seconds / 16.0 || (double)work > pacer->rate * seconds)
        gpu_pacer_learn(pacer, work, seconds);
}

/* Runs a stage in time slices, with r's current tally. `answers`: copies it to r->answer at the end. */
static int run_slices(struct both_run *r, const struct both_stage *stage, uint64_t first, uint64_t count, bool answers,
                      struct kiln_error *error)
{
    struct gpu_pacer *pacer = &r->b->pacers[stage->pace];
    const uint64_t least = gpu_about(r->b->gpu)->software ? LEAST_SOFTWARE : LEAST;
    int status = KILN_OK;
    r->push.counter = 0;
    for (uint64_t done = 0; done < count && status == KILN_OK; done += r->push.count) {
        const uint64_t enough = gpu_pacer_next_filling(pacer, FIRST_GUESS, least), left = count - done,
                       some = enough < 1u << 30 ? enough : 1u << 30;
        double seconds;
        r->push.offset = (uint32_t)(first + done);
        r->push.count = (uint32_t)(some < left ? some : left);
        status = dispatch(r, stage->kernel, answers && some >= left, &seconds, error);
        if (status == KILN_OK)
            learn(pacer, r->push.count, seconds);
    }
    return status;
}

int both_run_stage(struct both_run *r, const struct both_stage *stage, uint64_t first, uint64_t count,
                   struct kiln_gpu_both_tally *tally, struct kiln_error *error)
{
    int status = next_tally(r, error);
    if (status == KILN_OK)
        status = run_slices(r, stage, first, count, tally != NULL, error);
    if (tally != NULL && count == 0)
        *tally = (struct kiln_gpu_both_tally){0};
    else if (tally != NULL && status == KILN_OK)
        memcpy(tally, r->answer.mapped, sizeof *tally);
    return status;
}

/* ---- dispatches that are submitted together ---- */

/* Begins a queue. Clears the tallies if they might not suffice, so that both_add needs no new ones. */
static int begin_queue(struct both_run *r, struct kiln_error *error)
{
    int status = KILN_OK;
    if (r->tally + BOTH_QUEUE > TALLIES) {
        status = both_clear(r, r->tallies.address, r->tallies.size, error);
        r->tally = 0;
    }
    r->queue.count = 0;
    r->queue.tally = r->tally;
    r->queue.seconds = 0.0;
    r->queue.known = true;
    return status;
}

static uint64_t tally_address(const struct both_run *r, size_t number, size_t offset)
{
    return r->tallies.address + (r->queue.tally + number) * sizeof(struct kiln_gpu_both_tally) + offset;
}

/* Adds a dispatch of at most `most` threads with the present push constants; the word at `counter` (0: none) limits the
 * number of threads with work. Returns its number in the queue, which is also that of its tally. */
static size_t add(struct both_run *r, const struct both_stage *stage, uint64_t most, uint64_t counter)
{
    struct both_queue *q = &r->queue;
    const size_t number = q->count++;
    const double rate = r->b->pacers[stage->pace].rate;
    r->push.counter = counter;
    r->push.offset = 0;
    r->push.count = (uint32_t)most;
    r->push.tally = tally_address(r, number, 0);
    q->pushes[number] = r->push;
    q->steps[number] = (struct gpu_step){.kernel = stage->kernel,
                                         .threads_x = r->push.count,
                                         .threads_y = 1,
                                         .constants = &q->pushes[number],
                                         .constant_bytes = sizeof r->push};
    q->known = q->known && rate > 0.0;
    if (rate > 0.0)
        q->seconds += (double)most / rate;
    return number;
}

/* Whether the whole queue takes no longer than a single dispatch may. */
static bool fits_slice(const struct both_run *r)
{
    return r->queue.known && r->queue.seconds < 0.8 * gpu_slice(r->b->gpu);
}

/* Ends the queue with a copy of all its tallies to r->answer. */
static void end_queue(struct both_run *r)
{
    struct both_queue *q = &r->queue;
    q->steps[q->count] = (struct gpu_step){.from = &r->tallies,
                                           .to = &r->answer,
                                           .from_offset = q->tally * sizeof(struct kiln_gpu_both_tally),
                                           .size = q->count * sizeof(struct kiln_gpu_both_tally)};
    r->tally += (uint32_t)q->count;
}

/* Runs the queue. *tallies: one per dispatch, valid until the next run. */
static int run_queue(struct both_run *r, const struct kiln_gpu_both_tally **tallies, struct kiln_error *error)
{
    end_queue(r);
    *tallies = r->answer.mapped;
    return gpu_run(r->b->gpu, r->queue.steps, r->queue.count + 1, NULL, error);
}

/* ---- paths ---- */

/* Returns one of two alternating lists of slots: active paths, and those that continue. */
static uint64_t list_of(const struct both_run *r, uint32_t turn)
{
    return r->lists.address + (turn % 2) * (uint64_t)r->slots * sizeof(uint32_t);
}

/* List of slots of paths at diffuse surfaces, or without a hit; gloss_list follows after r->slots entries. */
static uint64_t sorted_list(const struct both_run *r)
{
    return list_of(r, 0) + 2 * (uint64_t)r->slots * sizeof(uint32_t);
}
static uint64_t gloss_list(const struct both_run *r) { return sorted_list(r) + (uint64_t)r->slots * sizeof(uint32_t); }

/* Copies the speed of one stage to the other, if that is unknown because it had no work. */
static void share_speed(struct both_run *r, const struct both_stage *a, const struct both_stage *b)
{
    struct gpu_pacer *x = &r->b->pacers[a->pace], *y = &r->b->pacers[b->pace];
    if (!(x->rate > 0.0))
        x->rate = y->rate;
    if (!(y->rate > 0.0))
        y->rate = x->rate;
}

/* Runs the stages at the paths' surfaces, sorted by kind: `diffuse` and `gloss` of them. */
static int run_sorted(struct both_run *r, const struct both_stage *at_diffuse, const struct both_stage *at_gloss,
                      uint64_t diffuse, uint64_t gloss, struct kiln_gpu_both_tally *tally, struct kiln_error *error)
{
    const uint64_t list = r->push.list;
    int status = next_tally(r, error);
    r->push.list = sorted_list(r);
    if (status == KILN_OK && diffuse > 0)
        status = run_slices(r, at_diffuse, 0, diffuse, gloss == 0, error);
    r->push.list = gloss_list(r);
    if (status == KILN_OK && gloss > 0)
        status = run_slices(r, at_gloss, 0, gloss, true, error);
    r->push.list = list;
    share_speed(r, at_diffuse, at_gloss);
    *tally = (struct kiln_gpu_both_tally){0};
    if (status == KILN_OK && diffuse + gloss > 0)
        memcpy(tally, r->answer.mapped, sizeof *tally);
    return status;
}

/* Moves all active paths to their next surfaces, and runs the stages there. */
static int run_surface(struct both_run *r, const struct both_stage *at_diffuse, const struct both_stage *at_gloss,
                       uint64_t count, struct kiln_gpu_both_tally *tally, struct kiln_error *error)
{
    const uint64_t onward = r->push.onward;
    struct kiln_gpu_both_tally met = {0};
    r->rays += count;
    r->push.onward = sorted_list(r);
    r->push.room = r->slots;
    int status = both_run_stage(r, &r->next, 0, count, r->sorts ? &met : NULL, error);
    r->push.onward = onward;
    if (status != KILN_OK)
        return status;
    return r->sorts ? run_sorted(r, at_diffuse, at_gloss, met.paths, met.shadows, tally, error)
                    : both_run_stage(r, at_gloss, 0, count, tally, error);
}

/* As run_surface, in the queue, for at most `most` paths, limited by the word at `counter`. Returns the number of the
 * tally with the result. */
static size_t add_surface(struct both_run *r, const struct both_stage *at_diffuse, const struct both_stage *at_gloss,
                          uint64_t most, uint64_t counter)
{
    const uint64_t list = r->push.list, onward = r->push.onward;
    struct both_queue *q = &r->queue;
    r->push.onward = sorted_list(r);
    r->push.room = r->slots;
    const size_t met = add(r, &r->next, most, counter);
    r->push.onward = onward;
    if (r->crosses)
        (void)add(r, &r->cross, most, counter);
    if (!r->sorts)
        return add(r, at_gloss, most, counter);
    r->push.list = sorted_list(r);
    const size_t number = add(r, at_diffuse, most, tally_address(r, met, offsetof(struct kiln_gpu_both_tally, paths)));
    r->push.list = gloss_list(r);
    const size_t other = add(r, at_gloss, most, tally_address(r, met, offsetof(struct kiln_gpu_both_tally, shadows)));
    q->pushes[other].tally = q->pushes[number].tally;
    q->steps[other].alongside = true;
    r->push.list = list;
    return number;
}

static int trace_shadows(struct both_run *r, const struct both_stage *stage, uint64_t count, struct kiln_error *error)
{
    r->rays += count;
    return both_run_stage(r, stage, 0, count, NULL, error);
}

/* Moves all active light paths to their next surfaces, with one submission for each dispatch. */
static int light_surface(struct both_run *r, uint32_t *under_way, struct kiln_error *error)
{
    struct kiln_gpu_both_tally tally = {0};
    const int status = run_surface(r, &r->light_diffuse, &r->light, *under_way, &tally, error);
    *under_way = tally.paths;
    return status;
}

/* As light_surface, for LIGHT_SURFACES surfaces submitted together; *done: false if that might take too long. */
static int light_surfaces(struct both_run *r, uint32_t turn, uint32_t *under_way, bool *done, struct kiln_error *error)
{
    const struct kiln_gpu_both_tally *tallies;
    size_t number[LIGHT_SURFACES];
    uint64_t counter = 0;
    int status = begin_queue(r, error);
    for (uint32_t k = 0; k < LIGHT_SURFACES; k++) {
        r->push.list = list_of(r, turn + k);
        r->push.onward = list_of(r, turn + k + 1);
        number[k] = add_surface(r, &r->light_diffuse, &r->light, *under_way, counter);
        counter = tally_address(r, number[k], offsetof(struct kiln_gpu_both_tally, paths));
    }
    *done = fits_slice(r);
    if (status != KILN_OK || !*done)
        return status;
    status = run_queue(r, &tallies, error);
    for (uint32_t k = 0; k < LIGHT_SURFACES && status == KILN_OK; k++) {
        r->rays += *under_way;
        *under_way = tallies[number[k]].paths;
    }
    return status;
}

/* Traces the light paths first .. first + count - 1, which have slots. */
static int trace_light_paths(struct both_run *r, uint64_t first, uint64_t count, struct kiln_error *error)
{
    struct kiln_gpu_both_tally tally = {0};
    r->push.light = r->light_of;
    r->push.path = (uint32_t)first;
    r->push.stage = KILN_GPU_STAGE_BEGIN;
    r->push.list = 0;
    r->push.onward = list_of(r, 0);
    int status = both_run_stage(r, &r->light, 0, count, &tally, error);
    uint32_t under_way = status == KILN_OK ? tally.paths : 0;
    r->push.stage = KILN_GPU_STAGE_ARRIVE;
    for (uint32_t turn = 0; status == KILN_OK && under_way > 0;) {
        bool done;
        status = light_surfaces(r, turn, &under_way, &done, error);
        turn += done ? LIGHT_SURFACES : 0;
        if (status != KILN_OK || done)
            continue;
        r->push.list = list_of(r, turn);
        r->push.onward = list_of(r, turn + 1);
        status = light_surface(r, &under_way, error);
        turn++;
    }
    return status;
}

int both_light_paths(struct both_run *r, uint64_t first, uint64_t count, struct kiln_error *error)
{
    int status = KILN_OK;
    r->push.first = (uint32_t)first;
    for (uint64_t done = 0; done < count && status == KILN_OK; done += r->slots) {
        const uint64_t left = count - done;
        status = trace_light_paths(r, first + done, left < r->slots ? left : r->slots, error);
    }
    return status;
}

/* ---- light paths that land ---- */

/* Adds `surfaces` surfaces for at most `most` paths, limited by the word at `counter`, whose slots are in list `turn`.
 * The last tally of the queue has the number of paths that continue. */
static void add_landings(struct both_run *r, uint32_t turn, uint32_t surfaces, uint64_t most, uint64_t counter)
{
    for (uint32_t k = 0; k < surfaces; k++) {
        r->push.list = list_of(r, turn + k);
        r->push.onward = list_of(r, turn + k + 1);
        const size_t number = add_surface(r, &r->light_diffuse, &r->light, most, counter);
        counter = tally_address(r, number, offsetof(struct kiln_gpu_both_tally, paths));
        r->queue.left = number;
    }
}

/* Adds the beginning of all paths and their first surfaces; paths that have hit their targets continue. */
static uint64_t add_first_landings(struct both_run *r, uint32_t count)
{
    const size_t paths = offsetof(struct kiln_gpu_both_tally, paths);
    r->push.list = 0;
    r->push.onward = list_of(r, 0);
    const size_t begun = add(r, &r->begin_landing, count, 0);
    r->push.list = list_of(r, 0);
    r->push.onward = list_of(r, 1);
    const size_t met = add_surface(r, &r->light_diffuse, &r->met_first, count, tally_address(r, begun, paths));
    r->push.list = list_of(r, 1);
    r->push.onward = list_of(r, 0);
    const size_t gone_on = add(r, &r->light, count, tally_address(r, met, paths));
    return tally_address(r, gone_on, paths);
}

int both_begin_landings(struct both_run *r, uint32_t slot, uint32_t count, struct kiln_error *error)
{
    const int status = begin_queue(r, error);
    if (status != KILN_OK)
        return status;
    r->push.light = KILN_GPU_OF_LIGHT;
    add_landings(r, 0, LAND_SURFACES - 1, count, add_first_landings(r, count));
    end_queue(r);
    return gpu_submit(r->b->gpu, slot, r->queue.steps, r->queue.count + 1, error);
}

int both_wait_for_landings(struct both_run *r, uint32_t slot, double *seconds, struct kiln_error *error)
{
    const struct kiln_gpu_both_tally *tallies = r->answer.mapped;
    uint32_t turn = LAND_SURFACES - 1;
    int status = gpu_wait(r->b->gpu, slot, seconds, error);
    uint32_t left = status == KILN_OK ? tallies[r->queue.left].paths : 0;
    for (; status == KILN_OK && left > 0; turn += LAND_MORE) {
        status = begin_queue(r, error);
        if (status != KILN_OK)
            break;
        add_landings(r, turn, LAND_MORE, left, 0);
        status = run_queue(r, &tallies, error);
        left = status == KILN_OK ? tallies[r->queue.left].paths : 0;
    }
    return status;
}

int both_splats(struct both_run *r, uint64_t count, struct kiln_error *error)
{
    int status = KILN_OK;
    r->push.pixel = r->first;
    r->push.pixels = r->count;
    for (uint64_t done = 0; done < count && status == KILN_OK; done += r->shadow_room) {
        const uint64_t left = count - done, some = left < r->shadow_room ? left : r->shadow_room;
        struct kiln_gpu_both_tally tally = {0};
        status = both_run_stage(r, &r->splat, done, some, &tally, error);
        if (status == KILN_OK)
            status = trace_shadows(r, &r->to_camera, tally.shadows, error);
    }
    return status;
}

/* Finds pairs for the vertices of `count` paths, as many as fit, and runs `stage` over them; repeats while any are
 * `left`. */
static int run_pairs(struct both_run *r, const struct both_stage *find, const struct both_stage *stage, uint64_t count,
                     bool left, struct kiln_error *error)
{
    struct kiln_gpu_both_tally found = {0}, tally = {0};
    int status = KILN_OK;
    r->push.room = r->pair_room;
    while (status == KILN_OK && left) {
        status = both_run_stage(r, find, 0, count, &found, error);
        const uint32_t pairs = found.pairs < r->pair_room ? found.pairs : r->pair_room;
        if (status == KILN_OK)
            status = both_run_stage(r, stage, 0, pairs, &tally, error);
        if (status == KILN_OK)
            status = trace_shadows(r, &r->to_paths, tally.shadows, error);
        left = found.left > 0;
    }
    return status;
}

/* Connects the vertices of `count` paths to light vertices, and merges photons, if pairs are left of either. */
static int meet_light(struct both_run *r, uint64_t count, bool connect, bool merge, struct kiln_error *error)
{
    int status = run_pairs(r, &r->connected, &r->connect, count, connect, error);
    if (status == KILN_OK)
        status = run_pairs(r, &r->near, &r->merge, count, merge, error);
    return status;
}

/* Moves all active camera paths to their next surfaces, with one submission for each dispatch. */
static int eye_surface(struct both_run *r, uint32_t *under_way, struct kiln_error *error)
{
    const uint32_t count = *under_way;
    struct kiln_gpu_both_tally tally = {0};
    int status = run_surface(r, &r->eye_diffuse, &r->eye, count, &tally, error);
    *under_way = tally.paths;
    if (status == KILN_OK)
        status = trace_shadows(r, &r->to_paths, tally.shadows, error);
    return status == KILN_OK ? meet_light(r, count, links(r), merges(r), error) : status;
}

/* Numbers of a surface's dispatches in the queue, for camera paths. */
struct surface_in_queue {
    size_t eye, connected, near;
};

/* Adds the search for the pairs of at most `most` paths, limited by the word at `counter`, and the processing of the
 * pairs. Returns the number of the search in the queue. */
static size_t add_pairs(struct both_run *r, const struct both_stage *find, const struct both_stage *stage,
                        uint64_t most, uint64_t counter)
{
    const uint64_t few = PAIRS_OF_FEW * most;
    r->push.room = few < r->pair_room ? (uint32_t)few : r->pair_room;
    const size_t found = add(r, find, most, counter);
    const uint64_t pairs = tally_address(r, found, offsetof(struct kiln_gpu_both_tally, pairs));
    const size_t sent = add(r, stage, r->push.room, pairs);
    if (stage == &r->connect)
        (void)add(r, &r->to_paths, r->push.room, tally_address(r, sent, offsetof(struct kiln_gpu_both_tally, shadows)));
    return found;
}

/* Adds all work at a surface for at most `most` camera paths, limited by the word at `counter`. */
static struct surface_in_queue add_eye_surface(struct both_run *r, uint64_t most, uint64_t counter)
{
    struct surface_in_queue in = {0};
    in.eye = add_surface(r, &r->eye_diffuse, &r->eye, most, counter);
    if (connects(r))
        (void)add(r, &r->to_paths, most * shadows_of_path(r),
                  tally_address(r, in.eye, offsetof(struct kiln_gpu_both_tally, shadows)));
    if (links(r))
        in.connected = add_pairs(r, &r->connected, &r->connect, most, counter);
    if (merges(r))
        in.near = add_pairs(r, &r->near, &r->merge, most, counter);
    return in;
}

static void set_lists(struct both_run *r, uint32_t turn)
{
    r->push.list = turn > 0 ? list_of(r, turn) : 0;
    r->push.onward = list_of(r, turn + 1);
}

/* Adds surfaces from number `turn` on, as long as they take little time. If the pairs of a surface do not fit, kernels
 * skip the later surfaces. Returns the number added. */
static size_t add_eye_surfaces(struct both_run *r, uint32_t turn, uint64_t most, struct surface_in_queue in[])
{
    const size_t left = offsetof(struct kiln_gpu_both_tally, left);
    uint64_t counter = 0;
    size_t count = 0;
    for (; count < EYE_SURFACES; count++) {
        const size_t before = r->queue.count;
        set_lists(r, turn + (uint32_t)count);
        in[count] = add_eye_surface(r, most, counter);
        if (!fits_slice(r)) {
            r->queue.count = before;
            break;
        }
        counter = tally_address(r, in[count].eye, offsetof(struct kiln_gpu_both_tally, paths));
        r->push.halts[0] = links(r) ? tally_address(r, in[count].connected, left) : 0;
        r->push.halts[1] = merges(r) ? tally_address(r, in[count].near, left) : 0;
    }
    r->push.halts[0] = r->push.halts[1] = 0;
    return count;
}

/* Runs several surfaces, submitted together. *done: number of completed surfaces; 0: even one takes too long. */
static int eye_surfaces(struct both_run *r, uint32_t turn, uint32_t *under_way, uint32_t *done,
                        struct kiln_error *error)
{
    const struct kiln_gpu_both_tally *tallies;
    struct surface_in_queue in[EYE_SURFACES];
    bool more_connected = false, more_near = false;
    uint32_t count = 0;
    *done = 0;
    int status = begin_queue(r, error);
    if (status != KILN_OK)
        return status;
    const size_t surfaces = add_eye_surfaces(r, turn, *under_way, in);
    if (surfaces == 0)
        return KILN_OK;
    status = run_queue(r, &tallies, error);
    while (status == KILN_OK && *done < surfaces && !more_connected && !more_near) {
        const struct surface_in_queue *s = &in[(*done)++];
        count = *under_way;
        more_connected = links(r) && tallies[s->connected].left > 0;
        more_near = merges(r) && tallies[s->near].left > 0;
        r->rays += count + tallies[s->eye].shadows + (links(r) ? tallies[s->connected + 1].shadows : 0);
        *under_way = tallies[s->eye].paths;
    }
    set_lists(r, turn + *done - 1);
    return status == KILN_OK ? meet_light(r, count, more_connected, more_near, error) : status;
}

/* Begins paths at partly buried points, then connects and merges the points themselves with light paths. */
static int begin_at_points(struct both_run *r, uint64_t count, struct kiln_error *error)
{
    int status = KILN_OK;
    if (r->buried && r->buried_begin.kernel == NULL) {
        r->buried_begin.pace = VULKAN_PACE_BURIED_ENDS;
        KILN_TRY(vulkan_kernel_of(r->b, &point_paths_shader, true, r->method, &r->buried_begin.kernel, error));
    }
    if (r->buried)
        KILN_TRY(both_run_stage(r, &r->buried_begin, 0, count, NULL, error));
    KILN_TRY(meet_light(r, count, links(r), merges(r), error));
end:
    return status;
}

/* Follows the paths of pixels or points first .. first + count - 1, which have slots. */
static int follow_eye_paths(struct both_run *r, uint64_t first, uint64_t count, struct kiln_error *error)
{
    uint32_t under_way = (uint32_t)count;
    const size_t sums = from_points(r) ? sizeof(struct kiln_gpu_point_sums) : sizeof(struct kiln_gpu_path_sums);
    r->push.light = KILN_GPU_OF_CAMERA;
    r->push.pixel = first;
    r->push.sums = r->sums.address + (first - r->first) * sums;
    r->push.list = 0;
    r->push.stage = KILN_GPU_STAGE_BEGIN;
    int status = both_run_stage(r, &r->eye_ends, 0, count, NULL, error);
    if (status == KILN_OK && from_points(r))
        status = begin_at_points(r, count, error);
    r->push.stage = KILN_GPU_STAGE_ARRIVE;
    for (uint32_t turn = 0; status == KILN_OK && under_way > 0;) {
        uint32_t done;
        status = eye_surfaces(r, turn, &under_way, &done, error);
        if (status == KILN_OK && done == 0) {
            set_lists(r, turn);
            status = eye_surface(r, &under_way, error);
        }
        turn += done > 0 ? done : 1;
    }
    r->push.list = 0;
    r->push.stage = KILN_GPU_STAGE_END;
    return status == KILN_OK ? both_run_stage(r, &r->eye_ends, 0, count, NULL, error) : status;
}

int both_eye_paths(struct both_run *r, uint64_t first, uint64_t count, struct kiln_error *error)
{
    int status = KILN_OK;
    for (uint64_t done = 0; done < count && status == KILN_OK; done += r->slots) {
        const uint64_t left = count - done;
        status = follow_eye_paths(r, first + done, left < r->slots ? left : r->slots, error);
    }
    return status;
}
