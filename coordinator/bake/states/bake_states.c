/* Many states of lights, colours and sky from one load (kiln relight --states, --listen). Loaded once stay surface
 * points, rows and direct light of parts of the lights (state_lights.h); of a state only the light between surfaces is
 * computed (integrate/relight/states.h), several at once. Each is then written as a bake of its own.
 *
 * Where rays go on from gloss or are tinted, a state is computed whole, by the lockstep runner with the kept rows and
 * chains (integrate/relight/transport.h): it has the bits of a relit bake of its scene. Scene, surface points and
 * backend are loaded once. */
#include <errno.h>
#include <math.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>
#include <xxhash.h>

#include "coordinator/bake/bake_private.h"
#include "coordinator/bake/volume/volume.h"
#include "coordinator/output/vertex_light.h"
#include "coordinator/integrate/solution.h"
#include "coordinator/run/progress.h"
#include "coordinator/bake/prepare/prepare.h"
#include "coordinator/bake/prepare/stages.h"
#include "coordinator/run/phases.h"
#include "coordinator/integrate/integrate.h"
#include "coordinator/run/control.h"
#include "coordinator/bake/states/state_lights.h"
#include "coordinator/bake/identity/transport_identity.h"
#include "coordinator/files/json.h"
#include "coordinator/files/publish.h"
#include "coordinator/import/changes.h"
#include "coordinator/job/changes.h"
#include "coordinator/mpi/agree.h"
#include "worker/backend/emission.h"
#include "worker/base/memory.h"

/* Time spent, s: by the clock, and processor time of all threads of this rank. */
struct spent {
    double seconds, processor;
};

/* A state under way. */
struct one {
    const char *name;
    struct kiln_state_scene scene;
    uint16_t *albedo; /* own; NULL: the scene's */
    struct kiln_state state;
    struct spent solve, write;
    double device_seconds; /* of solving */
    uint64_t returned;     /* bytes received from a device in this time */
};

struct engine {
    struct kiln_bake *b;
    struct kiln_resident *resident;
    struct kiln_states *states;
    struct kiln_state_lights *lights;
    bool whole;                     /* states are computed whole, one at a time; the three pointers above are NULL */
    struct kiln_solution *solution; /* then: of the last one */
    struct kiln_state_scene base;
    struct kiln_scene before; /* pointers of the scene as it was prepared */
    const uint16_t *base_albedo;
    struct one ones[KILN_STATES_MOST];
    size_t width;
    struct spent load, begin;
    char output[KILN_PATH_SIZE]; /* of all */
    json_t *summary;             /* rank 0: of each state */
    /* --listen, per lightmap: hash of the light written last, and hash of the present light; `only`: whether it is to
     * be written; `any_written`: whether any was written before */
    uint64_t *written, *light;
    uint8_t *only;
    bool any_written;
    uint64_t written_scene;
    /* of --states: number of all, and of those that are done; MPI_Wtime() when the first one began */
    size_t state_count, done_count;
    double states_begin;
};

static struct spent now(void) { return (struct spent){MPI_Wtime(), (double)clock() / CLOCKS_PER_SEC}; }

static struct spent since(struct spent begin)
{
    const struct spent end = now();
    return (struct spent){end.seconds - begin.seconds, end.processor - begin.processor};
}

/* Time spent on getting rays so far. */
static struct spent loading(const struct engine *e)
{
    if (e->whole)
        return (struct spent){0.0, 0.0};
    const struct kiln_resident_counts c = kiln_resident_counts(e->resident);
    return (struct spent){c.seconds, c.processor};
}

static struct kiln_solution *solution_of(const struct engine *e, size_t place)
{
    return e->whole ? e->solution : kiln_states_solution(e->states, place);
}

/* ---- what cannot be ---- */

static const char *why_not(const struct kiln_job *job)
{
    if (kiln_job_is_radiosity(job) || kiln_job_is_reference(job))
        return "they read kept rows: of a bake that has kept links one state is relit at a time, without these";
    if (job->light.target_error > 0.0)
        return "leave --target-error out, whose samples hang on the light";
    if (job->ranks.exchange_points == KILN_EXCHANGE_VISIBLE || job->light.only_visible_from != NULL)
        return "leave --exchange-points and --only-visible-from out";
    if (job->scene.group_count > 0)
        return "leave --light-groups out";
    if (job->lightmaps.check_density)
        return "leave --check-density out";
    return NULL;
}

/* The folder of a state must be no link, for its files would be written elsewhere; and the folder of the bake whose
 * rays these are must not become it. */
static int check_folder(const struct kiln_bake *b, const char *output, const char *name, char folder[KILN_PATH_SIZE],
                        struct kiln_error *error)
{
    struct stat one, other;
    int status = kiln_path_join(folder, output, name, error);
    if (status == KILN_OK)
        status = kiln_check_below(output, name, true, error);
    if (status != KILN_OK)
        return status;
    if (stat(folder, &one) != 0 || stat(b->job->relighting.folder, &other) != 0 || one.st_dev != other.st_dev ||
        one.st_ino != other.st_ino)
        return KILN_OK;
    return kiln_fail(error, KILN_USAGE, "%.500s is the folder of the bake that is relit: give another name or -o",
                     folder);
}

/* ---- making ---- */

static int make_ones(struct engine *e, struct kiln_error *error)
{
    const struct kiln_prepared *p = e->b->prepared;
    int status;
    KILN_TRY(kiln_state_scene_create(&e->base, p->scene, error));
    for (size_t i = 0; i < e->width; i++)
        KILN_TRY(kiln_state_scene_create(&e->ones[i].scene, p->scene, error));
    KILN_TRY(kiln_allocate(&e->written, p->surface->map_count, sizeof *e->written, "lightmaps", error));
    KILN_TRY(kiln_allocate(&e->light, p->surface->map_count, sizeof *e->light, "lightmaps", error));
    KILN_TRY(kiln_allocate(&e->only, p->surface->map_count, 1, "lightmaps", error));
end:
    return kiln_agree(e->b->communicator, status, error);
}

/* Collective. Creates the data of states that share their rays. */
static int make_shared(struct engine *e, struct kiln_error *error)
{
    struct kiln_bake *b = e->b;
    int status;
    KILN_TRY(kiln_agree(b->communicator, kiln_resident_create(&e->resident, &b->light_params, error), error));
    KILN_TRY(kiln_states_create(&e->states, &b->light_params, e->resident, e->width, error));
    KILN_TRY(kiln_state_lights_create(&e->lights, b, e->states, &e->base, error));
end:
    return status;
}

/* Collective. */
static int create(struct engine *e, struct kiln_error *error)
{
    struct kiln_bake *b = e->b;
    const char *why = why_not(b->job);
    int status = why != NULL ? kiln_fail(error, KILN_USAGE, "kiln relight --states or --listen: %s", why) : KILN_OK;
    if (status == KILN_OK)
        status = kiln_bake_transport_begin(b, error);
    if (status == KILN_OK)
        status = kiln_bake_settle_light(b, error);
    if (status != KILN_OK)
        return status;
    b->light_params.checkpoint = NULL;
    b->light_params.beside = NULL;
    b->light_params.progress = NULL;         /* which shows how many states are done */
    b->light_settings.work_stealing = false; /* points stay where they are, for the next state */
    b->light_settings.rebalance = KILN_REBALANCE_NEVER;
    e->before = *b->prepared->scene;
    e->base_albedo = b->prepared->surface->albedo;
    status = make_ones(e, error);
    return status == KILN_OK && !e->whole ? make_shared(e, error) : status;
}

static void destroy(struct engine *e)
{
    struct kiln_prepared *p = e->b->prepared;
    kiln_state_lights_destroy(&e->lights);
    kiln_states_destroy(&e->states);
    kiln_solution_destroy(&e->solution);
    kiln_resident_destroy(&e->resident);
    if (e->base_albedo != NULL) {
        p->surface->albedo = (uint16_t *)(uintptr_t)e->base_albedo;
        p->scene->lights = e->before.lights;
        p->scene->materials = e->before.materials;
        p->scene->environment = e->before.environment;
    }
    for (size_t i = 0; i < e->width; i++) {
        kiln_state_scene_release(&e->ones[i].scene);
        kiln_free(&e->ones[i].albedo);
    }
    kiln_state_scene_release(&e->base);
    kiln_free(&e->written);
    kiln_free(&e->light);
    kiln_free(&e->only);
    json_decref(e->summary);
    e->b->solution = NULL; /* which was one of the states' */
}

/* ---- a state's scene ---- */

static struct kiln_changeable changeable(const struct engine *e, const struct kiln_state_scene *scene)
{
    const struct kiln_scene *s = e->b->prepared->scene;
    return (struct kiln_changeable){.strings = s->strings,
                                    .lights = scene->lights,
                                    .light_count = s->light_count,
                                    .materials = scene->materials,
                                    .material_count = s->material_count};
}

/* Refuses a changed colour of a material from which kept rays go on. */
static int check_colours(const struct engine *e, const struct one *one, struct kiln_error *error)
{
    const struct kiln_prepared *p = e->b->prepared;
    for (uint32_t i = 0; i < p->scene->material_count; i++) {
        const struct kiln_material *before = &e->base.materials[i], *with = &one->scene.materials[i];
        if (memcmp(before->base_color, with->base_color, sizeof before->base_color) != 0 &&
            kiln_transport_keeps_colour(e->b->job, p, i))
            return kiln_fail(
                error, KILN_BAD_INPUT,
                "kept rays go on from surfaces of material '%.100s', or pass them, and its colour is among "
                "what was kept: bake again, or leave its albedo",
                kiln_scene_string(p->scene, before->name));
    }
    return KILN_OK;
}

static int apply(const struct engine *e, struct one *one, const char *changes, struct kiln_error *error)
{
    const struct kiln_changeable to = changeable(e, &one->scene);
    kiln_state_scene_copy(&one->scene, &e->base, e->b->prepared->scene);
    const int status = kiln_changes_apply_to(&to, changes, error);
    if (status != KILN_OK)
        return status;
    kiln_changes_apply_to_environment(&one->scene.environment, changes);
    return check_colours(e, one, error);
}

static bool same_colours(const struct engine *e, const struct kiln_state_scene *a, const struct kiln_state_scene *b)
{
    bool same = true;
    for (size_t i = 0; i < e->b->prepared->scene->material_count && same; i++)
        same = memcmp(a->materials[i].base_color, b->materials[i].base_color, sizeof a->materials[i].base_color) == 0;
    return same;
}

/* Collective. Finds the albedo of the state's surface. It is copied from an earlier state with the same colours, if
 * there is one. */
static int find_albedo(struct engine *e, size_t place, struct kiln_error *error)
{
    struct one *one = &e->ones[place];
    int status = KILN_OK;
    kiln_free(&one->albedo);
    one->state.albedo = e->base_albedo;
    if (same_colours(e, &e->base, &one->scene))
        return KILN_OK;
    for (size_t i = 0; i < place; i++)
        if (same_colours(e, &e->ones[i].scene, &one->scene)) {
            one->state.albedo = e->ones[i].state.albedo;
            return KILN_OK;
        }
    status = kiln_state_scene_use(e->b->prepared, &one->scene, error);
    if (status == KILN_OK)
        status = kiln_prepare_albedo(e->b->prepared, e->b->job, &one->albedo, error);
    one->state.albedo = one->albedo;
    return status;
}

/* ---- solving ---- */

/* Collective. Prepares the states [0, count): computes everything except light between surfaces. */
static int mix(struct engine *e, size_t count, struct kiln_error *error)
{
    int status = KILN_OK;
    for (size_t i = 0; i < count; i++)
        KILN_TRY(find_albedo(e, i, error));
    for (size_t i = 0; i < count; i++)
        KILN_TRY(kiln_state_lights_mix(e->lights, &e->ones[i].scene, i, &e->ones[i].state, error));
end:
    return status;
}

/* Collective. Computes the only state of the batch by all steps of a bake. */
static int solve_whole(struct engine *e, struct kiln_error *error)
{
    struct kiln_bake *b = e->b;
    struct one *one = &e->ones[0];
    const struct spent begin = now();
    kiln_solution_destroy(&e->solution);
    b->solution = NULL;
    int status = find_albedo(e, 0, error);
    if (status == KILN_OK)
        status = kiln_state_scene_use(b->prepared, &one->scene, error);
    if (status != KILN_OK)
        return status;
    b->prepared->surface->albedo = (uint16_t *)(uintptr_t)one->state.albedo;
    status = kiln_backend_emission(b->prepared->backend, KILN_EMISSION_SAMPLES, &b->emission, error);
    status = kiln_agree(b->communicator, status, error);
    if (status == KILN_OK)
        status = kiln_integrate(&e->solution, &b->light_params, error);
    one->state.emission = &b->emission;
    one->solve = since(begin);
    return status;
}

/* Collective. Computes the light of the states. Time for fetching rays the first time, for tracing direct light and for
 * data that a device creates or fetches once counts as loading. */
static int solve(struct engine *e, size_t count, struct kiln_error *error)
{
    if (e->whole)
        return solve_whole(e, error);
    const struct spent rays = loading(e), begin = now();
    struct kiln_state of[KILN_STATES_MOST];
    int status = mix(e, count, error);
    const struct spent mixing = since(begin), after = now();
    struct kiln_backend_info before, behind;
    kiln_backend_info(e->b->prepared->backend, &before);
    for (size_t i = 0; i < count; i++)
        of[i] = e->ones[i].state;
    if (status == KILN_OK &&
        e->b->job->light.directional != KILN_DIRECTIONAL_NONE) /* one at a time: it asks the lights */
        status = kiln_state_scene_use(e->b->prepared, &e->ones[0].scene, error);
    if (status == KILN_OK)
        status = kiln_states_solve(e->states, of, count, error);
    const struct spent all = since(after), with = loading(e);
    kiln_backend_info(e->b->prepared->backend, &behind);
    const struct spent got = {with.seconds - rays.seconds + behind.once_seconds - before.once_seconds,
                              with.processor - rays.processor + behind.once_processor - before.once_processor};
    e->load.seconds += mixing.seconds + got.seconds;
    e->load.processor += mixing.processor + got.processor;
    for (size_t i = 0; i < count; i++) {
        struct one *one = &e->ones[i];
        one->solve = (struct spent){(all.seconds - got.seconds) / (double)count,
                                    (all.processor - got.processor) / (double)count};
        one->device_seconds = (behind.device_seconds - before.device_seconds) / (double)count;
        one->returned = (behind.returned - before.returned) / count;
    }
    return status;
}

/* ---- writing ---- */

/* Collective. The bake is that of the state from now on. */
static int become(struct engine *e, size_t place, const char *folder, struct kiln_error *error)
{
    struct kiln_bake *b = e->b;
    struct one *one = &e->ones[place];
    int status = kiln_state_scene_use(b->prepared, &one->scene, error);
    b->settled.output = (char *)(uintptr_t)folder;
    b->solution = solution_of(e, place);
    b->emission = *one->state.emission;
    b->prepared->surface->albedo = (uint16_t *)(uintptr_t)one->state.albedo;
    return status;
}

static void forget(struct kiln_bake *b)
{
    if (b->only == NULL)
        kiln_free(&b->lightmaps);
    kiln_vertex_light_release(&b->vertices);
    b->vertices = (struct kiln_vertex_light){0};
    kiln_volume_destroy(&b->volume);
    b->volume = (struct kiln_volume_result){0};
    b->probe_rays = 0;
    json_decref(b->report);
    json_decref(b->preview);
    json_decref(b->state);
    b->report = b->preview = b->state = NULL;
    b->exported = false;
}

static json_t *state_json(const struct engine *e, size_t place)
{
    const struct one *one = &e->ones[place];
    size_t parts = 0;
    const bool same = !e->whole && kiln_state_lights_same(e->lights, place, &parts);
    const char *direct = e->whole ? "traced" : same ? "as baked" : "parts, scaled";
    return json_pack("{s:s, s:s, s:s, s:i, s:s, s:f, s:f}", "from", e->b->job->relighting.folder, "state", one->name,
                     "direct_light", direct, "parts", (int)parts, "volume",
                     e->b->job->volume.samples > 0 ? "traced" : "none", "solve_seconds", one->solve.seconds,
                     "solve_processor_seconds", one->solve.processor);
}

/* Collective. Writes the scene of the state, which from now on has the hash of that file. */
static int write_scene(const struct engine *e, size_t place, const char *folder, struct kiln_error *error)
{
    struct kiln_scene *s = e->b->prepared->scene;
    const struct kiln_changeable before = changeable(e, &e->base), with = changeable(e, &e->ones[place].scene);
    int status = e->b->rank == 0 ? kiln_changes_write_scene(s, &before, &with, &e->ones[place].scene.environment,
                                                            folder, s->own_header.content_hash, error)
                                 : KILN_OK;
    status = kiln_agree(e->b->communicator, status, error);
    if (status == KILN_OK)
        (void)MPI_Bcast(s->own_header.content_hash, (int)sizeof s->own_header.content_hash, MPI_BYTE, 0,
                        e->b->communicator);
    return status;
}

/* Collective. Light by probes, and all files of a state, into its folder. */
static int write_state(struct engine *e, size_t place, const char *folder, struct kiln_error *error)
{
    struct kiln_bake *b = e->b;
    const struct spent begin = now();
    int status = become(e, place, folder, error);
    forget(b);
    if (b->rank == 0)
        b->state = state_json(e, place);
    KILN_TRY(status);
    KILN_TRY(kiln_bake_volume(b, error));
    KILN_TRY(kiln_agree(b->communicator, b->rank == 0 ? kiln_make_directories(folder, error) : KILN_OK, error));
    KILN_TRY(kiln_bake_check_folder(b, error));
    KILN_TRY(kiln_bake_clear_folder(b, error));
    KILN_TRY(write_scene(e, place, folder, error));
    KILN_TRY(kiln_bake_write(b, error));
end:
    e->ones[place].write = since(begin);
    b->settled.output = e->output;
    return status;
}

/* ---- --states ---- */

static json_t *times_json(const struct one *one)
{
    return json_pack("{s:s, s:f, s:f, s:f, s:I, s:f, s:f}", "state", one->name, "solve_seconds", one->solve.seconds,
                     "solve_processor_seconds", one->solve.processor, "solve_device_seconds", one->device_seconds,
                     "returned_bytes", (json_int_t)one->returned, "write_seconds", one->write.seconds,
                     "write_processor_seconds", one->write.processor);
}

/* kiln_progress_reckoning: states to come take as long as those that are done. */
static double left_of_states(void *context, double share)
{
    const struct engine *e = context;
    (void)share;
    return e->done_count > 0
               ? (MPI_Wtime() - e->states_begin) * (double)(e->state_count - e->done_count) / (double)e->done_count
               : -1.0;
}

/* Collective. The states in [0, count) of a batch. */
static int do_batch(struct engine *e, size_t count, struct kiln_error *error)
{
    int status = solve(e, count, error);
    for (size_t i = 0; i < count && status == KILN_OK; i++) {
        char folder[KILN_PATH_SIZE];
        status = check_folder(e->b, e->output, e->ones[i].name, folder, error);
        status = kiln_agree(e->b->communicator, status, error);
        if (status == KILN_OK)
            status = write_state(e, i, folder, error);
        if (status == KILN_OK && e->b->rank == 0)
            (void)json_array_append_new(e->summary, times_json(&e->ones[i]));
        e->done_count++;
    }
    return status;
}

/* Applies the changes of all states before the first one is computed, so that errors in them are reported at once. */
static int check_states(struct engine *e, const json_t *states, struct kiln_error *error)
{
    const char *name;
    json_t *changes;
    int status = KILN_OK;
    json_object_foreach((json_t *)(uintptr_t)states, name, changes)
    {
        char folder[KILN_PATH_SIZE];
        struct kiln_error own;
        char *text = json_dumps(changes, JSON_COMPACT);
        status = check_folder(e->b, e->output, name, folder, error);
        const int applied = status == KILN_OK ? apply(e, &e->ones[0], text, &own) : KILN_OK;
        free(text);
        if (applied != KILN_OK)
            status = kiln_fail(error, applied, "state %.100s: %.1500s", name, own.message);
        if (status != KILN_OK)
            break;
    }
    return kiln_agree(e->b->communicator, status, error);
}

static int do_states(struct engine *e, const json_t *states, struct kiln_error *error)
{
    const char *name;
    json_t *changes;
    size_t count = 0, left = json_object_size(states);
    int status = check_states(e, states, error);
    e->load = since(e->begin);
    e->state_count = left;
    e->states_begin = MPI_Wtime();
    kiln_progress_reckon(e->b->progress, left_of_states, e);
    json_object_foreach((json_t *)(uintptr_t)states, name, changes)
    {
        char *text = json_dumps(changes, JSON_COMPACT);
        if (status == KILN_OK)
            status = apply(e, &e->ones[count], text, error);
        free(text);
        e->ones[count].name = name;
        left--;
        if (status == KILN_OK && (++count == e->width || left == 0)) {
            status = do_batch(e, count, error);
            count = 0;
        }
        if (status != KILN_OK)
            break;
    }
    kiln_progress_reckon(e->b->progress, NULL, NULL);
    return status;
}

/* Collective. Prints the summary of kiln relight, and writes it to OUTPUT/states.json. */
static int summarize(struct engine *e, struct kiln_error *error)
{
    uint64_t counts[] = {e->b->transport.found, e->b->transport.traced, 0}, all[] = {0, 0, 0}, traced = 0, bytes;
    int status = KILN_OK;
    if (!e->whole) {
        const struct kiln_resident_counts rays = kiln_resident_counts(e->resident);
        kiln_state_lights_counts(e->lights, &traced, &bytes);
        counts[0] = rays.read;
        counts[1] = rays.traced;
        counts[2] = rays.bytes + bytes;
    }
    (void)MPI_Reduce(counts, all, 3, MPI_UINT64_T, MPI_SUM, 0, e->b->communicator);
    forget(e->b);
    if (e->b->rank == 0) {
        e->b->report =
            json_pack("{s:s, s:f, s:f, s:I, s:I, s:I, s:I, s:O}", "from", e->b->job->relighting.folder, "load_seconds",
                      e->load.seconds, "load_processor_seconds", e->load.processor, "rays_read", (json_int_t)all[0],
                      "rays_traced", (json_int_t)all[1], "direct_light_traced", (json_int_t)traced, "resident_bytes",
                      (json_int_t)all[2], "states", e->summary);
        char *text = json_dumps(e->b->report, JSON_INDENT(2));
        status = text == NULL ? kiln_fail(error, KILN_SYSTEM, "out of memory: states.json")
                              : kiln_publish_bytes_below(e->output, "states.json", text, strlen(text), error);
        free(text);
    }
    return kiln_agree(e->b->communicator, status, error);
}

static int run_states(struct engine *e, struct kiln_error *error)
{
    json_t *states = json_loads(e->b->job->relighting.stated, 0, NULL);
    e->summary = json_array();
    const int status = kiln_agree(
        e->b->communicator,
        states != NULL && e->summary != NULL ? KILN_OK : kiln_fail(error, KILN_SYSTEM, "out of memory: states"), error);
    const int done = status == KILN_OK ? do_states(e, states, error) : status;
    const int said = done == KILN_OK ? summarize(e, error) : done;
    json_decref(states);
    return said;
}

/* ---- --listen ---- */

/* Standard input by lines. */
struct input {
    char bytes[(1 << 16) + 1];
    size_t used, taken; /* bytes in the buffer; bytes of them that belong to the line before */
    bool ended;
};

/* Waits for input. Returns false if a request to stop came first. */
static bool wait_for_input(const struct kiln_stop *stop)
{
    struct pollfd input = {.fd = STDIN_FILENO, .events = POLLIN};
    while (!kiln_stop_asked(stop))
        if (poll(&input, 1, 200) > 0)
            return true;
    return false;
}

/* Waits for standard input, and reads the bytes that are there. */
static int read_more(struct input *in, const struct kiln_stop *stop, struct kiln_error *error)
{
    if (!wait_for_input(stop))
        return kiln_give_up(error);
    const ssize_t got = read(STDIN_FILENO, in->bytes + in->used, sizeof in->bytes - 1 - in->used);
    if (got < 0 && errno != EINTR && errno != EAGAIN)
        return kiln_fail_errno(error, KILN_IO, "standard input cannot be read");
    in->ended = got == 0;
    in->used += got > 0 ? (size_t)got : 0;
    return KILN_OK;
}

/* The next line of *length bytes, ended by a 0; NULL: there is none. KILN_BAD_INPUT: it is too long. */
static int read_line(struct input *in, const struct kiln_stop *stop, char **line, uint64_t *length,
                     struct kiln_error *error)
{
    int status = KILN_OK;
    *line = NULL;
    memmove(in->bytes, in->bytes + in->taken, in->used - in->taken);
    in->used -= in->taken;
    in->taken = 0;
    while (status == KILN_OK) {
        char *end = memchr(in->bytes, '\n', in->used);
        if (end == NULL && in->ended && in->used > 0)
            end = in->bytes + in->used;
        if (end != NULL) {
            *end = '\0';
            *line = in->bytes;
            *length = (uint64_t)(end - in->bytes);
            in->taken = *length + (end < in->bytes + in->used);
            return KILN_OK;
        }
        if (in->ended)
            return KILN_OK;
        if (in->used == sizeof in->bytes - 1)
            return kiln_fail(error, KILN_BAD_INPUT, "standard input: a line is longer than %zu bytes",
                             sizeof in->bytes - 1);
        status = read_more(in, stop, error);
    }
    return status;
}

/* Collective. Gets the next line of *length bytes, which rank 0 reads; *text is NULL at the end. */
static int next_line(const struct engine *e, struct input *in, char **text, uint64_t *length, struct kiln_error *error)
{
    const struct kiln_bake *b = e->b;
    uint64_t sent[2] = {0, 0}; /* whether there is a line; its bytes */
    int status = b->rank == 0 ? read_line(in, kiln_control_stop(b->control), text, &sent[1], error) : KILN_OK;
    kiln_control_meet(b->control);
    status = kiln_agree(b->communicator, status, error);
    sent[0] = b->rank == 0 && *text != NULL;
    (void)MPI_Bcast(sent, 2, MPI_UINT64_T, 0, b->communicator);
    if (b->rank != 0)
        *text = sent[0] != 0 ? in->bytes : NULL;
    if (sent[0] != 0)
        (void)MPI_Bcast(in->bytes, (int)sent[1] + 1, MPI_CHAR, 0, b->communicator);
    *length = sent[1];
    return status;
}

/* Hashes the light of each lightmap's points. Collective. */
static void hash_light(const struct engine *e)
{
    const struct kiln_bake *b = e->b;
    const struct kiln_rank_data *own = solution_of(e, 0)->own;
    memset(e->light, 0, own->surface.map_count * sizeof *e->light);
    for (size_t i = 0; i < b->fields.count; i++) {
        const struct kiln_field *field = b->fields.entry[i].field;
        if (field->life != KILN_FIELD_RESULT || field->domain != KILN_DOMAIN_POINT)
            continue;
        const char *values = kiln_rank_field(own, &b->fields, i);
        const size_t size = kiln_field_size(field);
        for (size_t f = 0; values != NULL && f < own->surface.tile_run_count; f++) {
            const struct kiln_tile_run *run = &own->surface.tile_runs[f];
            const uint64_t at = kiln_own_of_global(&own->surface, run->first).at, seed = run->first.at * 64 + i;
            e->light[run->map] += XXH3_64bits_withSeed(values + at * size, run->count * size, seed);
        }
    }
    (void)MPI_Allreduce(MPI_IN_PLACE, e->light, (int)own->surface.map_count, MPI_UINT64_T, MPI_SUM, b->communicator);
}

static uint64_t hash_scene(const struct engine *e)
{
    const struct kiln_scene *s = e->b->prepared->scene;
    const struct kiln_state_scene *scene = &e->ones[0].scene;
    uint64_t hash = XXH3_64bits(scene->lights, s->light_count * sizeof *scene->lights);
    hash = XXH3_64bits_withSeed(scene->materials, s->material_count * sizeof *scene->materials, hash);
    return XXH3_64bits_withSeed(&scene->environment, sizeof scene->environment, hash);
}

/* Collective. Writes the results of the state that differ from those written last. *maps receives the number of
 * lightmaps whose light has changed. */
static int write_changes(struct engine *e, size_t *maps, struct kiln_error *error)
{
    struct kiln_bake *b = e->b;
    const size_t count = b->prepared->surface->map_count;
    const uint64_t scene = hash_scene(e);
    int status = KILN_OK;
    hash_light(e);
    *maps = 0;
    for (size_t i = 0; i < count; i++) {
        e->only[i] = !e->any_written || e->light[i] != e->written[i];
        *maps += e->only[i] != 0 && b->prepared->surface->lightmaps[i].published != 0;
    }
    e->ones[0].write = (struct spent){0.0, 0.0};
    if (*maps == 0 && e->any_written && scene == e->written_scene)
        return KILN_OK;
    b->only = e->any_written ? e->only : NULL;
    status = write_state(e, 0, e->output, error);
    b->only = e->only; /* reports are kept until the next */
    if (status == KILN_OK) {
        memcpy(e->written, e->light, count * sizeof *e->written);
        e->written_scene = scene;
        e->any_written = true;
    }
    return status;
}

/* Bytes per write of an answer. If poll(2) reports room, there is room for at least so many, so no write blocks on a
 * reader that does not read. */
enum { ANSWER_PART = 256 };

/* Writes an answer to standard output. Waits for its reader until something requests a stop. */
static int say(const char *text, size_t size, const struct kiln_stop *stop, struct kiln_error *error)
{
    for (size_t at = 0; at < size;) {
        struct pollfd output = {.fd = STDOUT_FILENO, .events = POLLOUT};
        if (kiln_stop_asked(stop))
            return kiln_give_up(error);
        if (poll(&output, 1, 200) <= 0)
            continue;
        const ssize_t done = write(STDOUT_FILENO, text + at, size - at < ANSWER_PART ? size - at : ANSWER_PART);
        if (done < 0 && errno != EINTR && errno != EAGAIN)
            return kiln_fail_errno(error, KILN_IO, "an answer cannot be written to standard output");
        at += done > 0 ? (size_t)done : 0;
    }
    return KILN_OK;
}

/* Collective. Rank 0 writes the answer, a line; takes over its reference. */
static int answer(const struct engine *e, json_t *json, struct kiln_error *error)
{
    const struct kiln_bake *b = e->b;
    int status = KILN_OK;
    if (b->rank == 0) {
        char *text = json_dumps(json, JSON_COMPACT);
        const struct kiln_stop *stop = kiln_control_stop(b->control);
        status = text == NULL ? kiln_fail(error, KILN_SYSTEM, "out of memory: an answer")
                              : say(text, strlen(text), stop, error);
        if (status == KILN_OK)
            status = say("\n", 1, stop, error);
        free(text);
    }
    json_decref(json);
    kiln_control_meet(b->control);
    return kiln_agree(b->communicator, status, error);
}

/* Collective. Does what a line asks for. A wrong line is answered with an error, and changes nothing. */
static int do_line(struct engine *e, uint64_t number, const char *line, size_t length, struct kiln_error *error)
{
    char where[32], *changes = NULL;
    const struct spent load = e->load;
    struct kiln_error own;
    size_t maps = 0;
    (void)snprintf(where, sizeof where, "line %llu", (unsigned long long)number);
    int wrong = kiln_changes_line(line, length, where, &changes, &own);
    if (wrong == KILN_OK)
        wrong = apply(e, &e->ones[0], changes, &own);
    free(changes);
    wrong = kiln_agree(e->b->communicator, wrong, &own);
    if (wrong != KILN_OK) {
        const int said = answer(
            e, json_pack("{s:I, s:i, s:s}", "line", (json_int_t)number, "status", wrong, "error", own.message), error);
        return wrong == KILN_SYSTEM ? kiln_fail(error, wrong, "%s", own.message) : said;
    }
    e->ones[0].name = where;
    int status = solve(e, 1, error);
    if (status == KILN_OK)
        status = write_changes(e, &maps, error);
    if (status != KILN_OK)
        return status;
    json_t *json = times_json(&e->ones[0]);
    (void)json_object_del(json, "state");
    (void)json_object_set_new(json, "line", json_integer((json_int_t)number));
    (void)json_object_set_new(json, "status", json_integer(KILN_OK));
    (void)json_object_set_new(json, "load_seconds", json_real(e->load.seconds - load.seconds));
    (void)json_object_set_new(json, "lightmaps", json_integer((json_int_t)maps));
    return answer(e, json, error);
}

static int listen_to_input(struct engine *e, struct kiln_error *error)
{
    struct input *in = NULL;
    char *line = NULL;
    uint64_t number = 0, length = 0;
    int status = kiln_agree(e->b->communicator, kiln_allocate(&in, 1, sizeof *in, "standard input", error), error);
    while (status == KILN_OK) {
        status = next_line(e, in, &line, &length, error);
        if (status != KILN_OK || line == NULL)
            break;
        number++;
        if (strspn(line, " \t\r") < length)
            status = do_line(e, number, line, length, error);
    }
    kiln_free(&in);
    return status;
}

/* ---- all ---- */

static size_t width_of(const struct kiln_job *job)
{
    json_t *states = job->relighting.stated != NULL ? json_loads(job->relighting.stated, 0, NULL) : NULL;
    const size_t count = json_object_size(states);
    json_decref(states);
    return count < 1 || job->light.directional != KILN_DIRECTIONAL_NONE ? 1
           : count < KILN_STATES_MOST                                   ? count
                                                                        : KILN_STATES_MOST;
}

int kiln_bake_states(struct kiln_bake *b, struct kiln_error *error)
{
    struct engine *e = NULL;
    int status = kiln_agree(b->communicator, kiln_allocate(&e, 1, sizeof *e, "the states", error), error);
    if (status != KILN_OK) {
        kiln_free(&e);
        return status;
    }
    e->b = b;
    e->begin = (struct spent){b->begin, 0.0};
    e->whole = kiln_transport_goes_on(b->job, b->prepared);
    e->width = e->whole ? 1 : width_of(b->job);
    (void)snprintf(e->output, sizeof e->output, "%s", b->job->output);
    kiln_phase(&b->phases, "direct light");
    kiln_progress_phase(b->progress, KILN_STAGE_STATES, 0);
    status = create(e, error);
    if (status == KILN_OK)
        status = b->job->relighting.listen ? listen_to_input(e, error) : run_states(e, error);
    b->only = NULL;
    destroy(e);
    b->settled.output = (char *)(uintptr_t)b->asked->output;
    kiln_free(&e);
    return status;
}
