#include "coordinator/cli/view_rounds.h"

#include <mpi.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "coordinator/bake/identity/identity.h"
#include "coordinator/files/checksummed_json.h"
#include "coordinator/files/folder.h"
#include "coordinator/files/json.h"
#include "coordinator/job/options.h"
#include "coordinator/mpi/agree.h"
#include "coordinator/run/checkpoint.h"
#include "coordinator/run/output_folder.h"
#include "coordinator/run/process.h"
#include "worker/base/memory.h"
#include "worker/base/text.h"

enum { ROUND = 8 }; /* paths per pixel in a round, after the short first rounds */

struct kiln_view_rounds {
    const struct kiln_job *job;
    int rank;
    struct kiln_output_folder *folder; /* rank 0 */
    struct kiln_checkpoint *checkpoint;
    json_t *identity;
    double begin, saved; /* MPI_Wtime() of the first round's begin, and of the last checkpoint */
    uint32_t first;      /* paths of a pixel that the folder had */
    uint32_t kept;       /* and has */
    uint32_t samples;    /* in the picture */
    int signal;          /* that has ended the rounds; 0: none */
    bool catches;        /* signals do not end the process */
};

/* Decisions after a round. Each is the maximum over all ranks. */
enum decision { SIGNAL, OVER, SAVE, DECISIONS };

/* ---- begin and end ---- */

int kiln_view_rounds_create(struct kiln_view_rounds **rounds, const struct kiln_job *job, struct kiln_error *error)
{
    *rounds = NULL;
    if (job->view.accumulate == NULL && !(job->checkpoints.max_time > 0.0))
        return KILN_OK;
    const int status =
        kiln_agree(MPI_COMM_WORLD, kiln_allocate(rounds, 1, sizeof **rounds, "the rounds of a view", error), error);
    if (status == KILN_OK) {
        (*rounds)->job = job;
        (void)MPI_Comm_rank(MPI_COMM_WORLD, &(*rounds)->rank);
    } else {
        kiln_free(rounds);
    }
    return status;
}

void kiln_view_rounds_destroy(struct kiln_view_rounds **rounds)
{
    struct kiln_view_rounds *r = *rounds;
    if (r == NULL)
        return;
    if (r->catches)
        kiln_process_release();
    kiln_checkpoint_close(&r->checkpoint);
    kiln_output_folder_end(&r->folder, false);
    json_decref(r->identity);
    kiln_free(rounds);
}

int kiln_view_rounds_stopped(const struct kiln_view_rounds *r, struct kiln_error *error)
{
    if (r == NULL || r->signal == 0)
        return KILN_OK;
    return r->job->view.accumulate == NULL
               ? kiln_fail(error, KILN_STOPPED, "stopped by %s: the picture has %u of %u paths a pixel",
                           kiln_process_signal_name(r->signal), r->samples, r->job->view.samples_pixel)
               : kiln_fail(error, KILN_STOPPED,
                           "stopped by %s: the picture has %u of %u paths a pixel, %.300s keeps %u; the same command "
                           "goes on",
                           kiln_process_signal_name(r->signal), r->samples, r->job->view.samples_pixel,
                           r->job->view.accumulate, r->kept);
}

/* ---- what is kept ---- */

static json_t *vector_json(struct kiln_vec3 v)
{
    char text[80];
    (void)snprintf(text, sizeof text, "%.9g %.9g %.9g", (double)v.x, (double)v.y, (double)v.z);
    return json_string(text);
}

static json_t *number_json(double number, int digits)
{
    char text[40];
    (void)snprintf(text, sizeof text, "%.*g", digits, number);
    return json_string(text);
}

/* Makes the identity of the view: everything that its sums depend on. */
static json_t *make_identity(const struct kiln_view_rounds *r, const struct kiln_view_traced *traced)
{
    static const char *const options[] = {"method", "bounces", "path-length", "materials", "seed"};
    const struct kiln_path_parameters *c = &traced->view->parameters;
    struct kiln_backend_info info;
    char room[KILN_OPTION_TEXT];
    json_t *fields = json_object();
    kiln_backend_info(traced->backend, &info);
    for (size_t i = 0; i < sizeof options / sizeof *options; i++) {
        const struct kiln_option *option = kiln_option_find_for(options[i], KILN_FOR_VIEW);
        (void)json_object_set_new(fields, options[i], json_string(kiln_option_text(r->job, option, room)));
    }
    (void)json_object_set_new(fields, "kiln", json_string(KILN_VERSION));
    (void)json_object_set_new(fields, "scene content", kiln_hash_json(traced->scene->header->content_hash));
    (void)json_object_set_new(fields, "width", number_json(c->width, 9));
    (void)json_object_set_new(fields, "height", number_json(c->height, 9));
    (void)json_object_set_new(fields, "camera's position", vector_json(c->position));
    (void)json_object_set_new(fields, "camera's direction", vector_json(c->forward));
    (void)json_object_set_new(fields, "camera's right side", vector_json(c->right));
    (void)json_object_set_new(fields, "camera's upper side", vector_json(c->up));
    (void)json_object_set_new(fields, "orthographic", json_string(c->orthographic ? "yes" : "no"));
    (void)json_object_set_new(fields, "lens-radius", number_json((double)c->lens_radius, 9));
    (void)json_object_set_new(fields, "focus-distance", number_json((double)c->focus_distance, 9));
    (void)json_object_set_new(fields, "merge-radius",
                              number_json(traced->view->both_ways ? traced->view->radius : 0.0, 17));
    return json_pack("{s:s, s:o, s:{}, s:{s:s, s:s}}", "of", "a view", "fields", fields, "sources", "machine",
                     "backend", info.name, "instruction set", traced->instruction_set);
}

/* Refuses the folder of a bake. Such a folder has a scene, or a checkpoint with another kind of identity. */
static int refuse_bake(const struct kiln_view_rounds *r, struct kiln_error *error)
{
    return kiln_fail(error, KILN_USAGE, "--accumulate %.300s: that is the folder of a bake; name another",
                     r->job->view.accumulate);
}

/* Rank 0: the folder, which no other view or bake may use meanwhile. */
static int take_folder(struct kiln_view_rounds *r, bool *had_one, struct kiln_error *error)
{
    const struct kiln_output_folder_params params = {
        .directory = r->job->view.accumulate, .kind = KILN_FOLDER_LOCKED, .no_locks = r->job->faults.no_locks};
    uint64_t generation;
    char scene[KILN_PATH_SIZE];
    int status;
    KILN_TRY(kiln_path_join(scene, r->job->view.accumulate, "scene.kscene", error));
    if (access(scene, F_OK) == 0)
        KILN_TRY(refuse_bake(r, error));
    KILN_TRY(kiln_output_folder_begin(&r->folder, &params, error));
end:
    *had_one = status == KILN_OK && kiln_checkpoint_newest(r->job->view.accumulate, &generation);
    return status;
}

/* Not collective. Checks that kept sums can be continued; *note: differences that do not matter. */
static int check_kept(const struct kiln_view_rounds *r, bool had_one, char *note, size_t note_size,
                      struct kiln_error *error)
{
    const json_t *then = kiln_checkpoint_identity(r->checkpoint);
    note[0] = '\0';
    if (had_one && then == NULL && r->job->checkpoints.resume)
        return kiln_fail(error, KILN_BAD_INPUT,
                         "--accumulate %.300s: what is kept there is damaged; --no-resume begins anew",
                         r->job->view.accumulate);
    if (then != NULL && json_object_get(then, "of") == NULL)
        return refuse_bake(r, error);
    if (then == NULL || !r->job->checkpoints.resume)
        return KILN_OK;
    return kiln_identity_compare(then, r->identity, r->job->view.accumulate, note, note_size, error);
}

/* Reads this rank's sums, and on rank 0 the film. */
static int read_kept(struct kiln_view_rounds *r, struct kiln_path_sums *sums, struct kiln_splat_film *film,
                     size_t pixels, struct kiln_error *error)
{
    const struct kiln_checkpoint *c = r->checkpoint;
    int status;
    KILN_TRY(kiln_checkpoint_read(c, "samples", 0, 1, sizeof sums->samples, &sums->samples, error));
    KILN_TRY(kiln_checkpoint_read(c, "pixels", sums->first, sums->count, sizeof *sums->pixels, sums->pixels, error));
    if (film != NULL)
        KILN_TRY(kiln_checkpoint_read(c, "film unit", 0, 1, sizeof film->unit, &film->unit, error));
    if (film != NULL && r->rank == 0)
        KILN_TRY(kiln_checkpoint_read(c, "film", 0, pixels, 3 * sizeof *film->sums, film->sums, error));
end:
    r->first = r->kept = sums->samples;
    return status;
}

/* Collective. */
static int open_folder(struct kiln_view_rounds *r, const struct kiln_view_traced *traced, struct kiln_path_sums *sums,
                       struct kiln_splat_film *film, struct kiln_error *error)
{
    const struct kiln_path_parameters *c = &traced->view->parameters;
    char note[400] = "";
    bool had_one = false;
    int status = kiln_agree(MPI_COMM_WORLD, r->rank == 0 ? take_folder(r, &had_one, error) : KILN_OK, error);
    if (status == KILN_OK)
        status = kiln_checkpoint_open(&r->checkpoint, MPI_COMM_WORLD, r->job->view.accumulate, true, error);
    if (status != KILN_OK)
        return status;
    r->identity = make_identity(r, traced);
    status = check_kept(r, had_one, note, sizeof note, error);
    if (r->rank == 0 && note[0] != '\0')
        kiln_print(stderr, "kiln: note: %s\n", note);
    if (status == KILN_OK && r->job->checkpoints.resume && kiln_checkpoint_generation(r->checkpoint) != 0)
        status = read_kept(r, sums, film, (size_t)c->width * c->height, error);
    return kiln_agree(MPI_COMM_WORLD, status, error);
}

void kiln_view_add_films(struct kiln_splat_film *film, size_t pixels)
{
    enum { MOST = 1 << 24 }; /* that an int counts with ease */
    int rank;
    (void)MPI_Comm_rank(MPI_COMM_WORLD, &rank);
    (void)MPI_Allreduce(MPI_IN_PLACE, &film->unit, 1, MPI_DOUBLE, MPI_MAX, MPI_COMM_WORLD); /* 0 without pixels */
    for (size_t i = 0; i < 3 * pixels; i += MOST) {
        const int part = (int)(3 * pixels - i < MOST ? 3 * pixels - i : MOST);
        (void)MPI_Reduce(rank == 0 ? MPI_IN_PLACE : film->sums + i, film->sums + i, part, MPI_INT64_T, MPI_SUM, 0,
                         MPI_COMM_WORLD);
    }
    if (rank != 0)
        memset(film->sums, 0, 3 * pixels * sizeof *film->sums);
}

/* Collective. Writes a checkpoint of the sums. */
static int save(struct kiln_view_rounds *r, const struct kiln_path_parameters *c, const struct kiln_path_sums *sums,
                struct kiln_splat_film *film, struct kiln_error *error)
{
    const size_t pixels = (size_t)c->width * c->height;
    if (film != NULL)
        kiln_view_add_films(film, pixels);
    const struct kiln_array_range blocks[] = {
        {.name = "pixels",
         .first = sums->first,
         .count = sums->count,
         .size = sizeof *sums->pixels,
         .data = sums->pixels},
        {.name = "samples", .count = 1, .size = sizeof sums->samples, .data = &sums->samples},
        {.name = "film unit", .count = 1, .size = sizeof film->unit, .data = film != NULL ? &film->unit : NULL},
        {.name = "film", .count = pixels, .size = 3 * sizeof *film->sums, .data = film != NULL ? film->sums : NULL}};
    const size_t count = r->rank != 0 ? 1 : film == NULL ? 2 : sizeof blocks / sizeof *blocks;
    int status = kiln_agree(MPI_COMM_WORLD,
                            r->rank == 0 ? kiln_lock_check(kiln_output_folder_lock(r->folder), error) : KILN_OK, error);
    if (status == KILN_OK)
        status = kiln_checkpoint_write(r->checkpoint, r->identity, blocks, count, error);
    r->kept = sums->samples;
    r->saved = MPI_Wtime();
    return status;
}

/* ---- rounds ---- */

/* Returns the number of paths per pixel of the round that begins after `done` of them. */
static uint32_t whole_round(uint32_t done)
{
    if (done < ROUND)
        return done == 0 ? 1 : done;
    return ROUND;
}

/* Maps a round's progress to the progress of all paths of this call. */
struct share {
    const struct kiln_path_progress *progress;
    double before, part;
};

static void tell(void *context, double share)
{
    const struct share *s = context;
    s->progress->tell(s->progress->context, s->before + s->part * share);
}

/* Collective. Makes the decisions after a round; the next round would have `next` paths per pixel. */
static void decide(const struct kiln_view_rounds *r, uint32_t done, uint32_t next, int decisions[DECISIONS])
{
    const double now = MPI_Wtime(), spent = now - r->begin, limit = r->job->checkpoints.max_time;
    memset(decisions, 0, DECISIONS * sizeof *decisions);
    decisions[SIGNAL] = (int)__atomic_load_n(kiln_process_signal(), __ATOMIC_RELAXED);
    if (r->rank == 0) {
        decisions[OVER] = limit > 0.0 && spent * (1.0 + (double)next / (double)(done - r->first)) > limit;
        decisions[SAVE] = r->job->checkpoints.every > 0.0 && now - r->saved > r->job->checkpoints.every;
        if (r->folder != NULL)
            kiln_lock_beat(kiln_output_folder_lock(r->folder));
    }
    (void)MPI_Allreduce(MPI_IN_PLACE, decisions, DECISIONS, MPI_INT, MPI_MAX, MPI_COMM_WORLD);
}

/* Collective. Adds a round of `samples` paths a pixel. */
static int trace_round(struct kiln_view_rounds *r, const struct kiln_view_traced *traced, uint32_t samples,
                       struct kiln_path_sums *sums, struct kiln_splat_film *film, uint64_t *rays,
                       struct kiln_error *error)
{
    const double all = traced->view->samples - r->first;
    struct share share = {&traced->progress, (sums->samples - r->first) / all, samples / all};
    const struct kiln_path_progress progress = {.tell = tell, .context = &share};
    return kiln_agree(MPI_COMM_WORLD,
                      kiln_path_sums_add(sums, traced->backend, traced->view, samples, &progress, film, rays, error),
                      error);
}

/* Collective. Rounds until there are enough paths, or a decision ends them. */
static int trace_rounds(struct kiln_view_rounds *r, const struct kiln_view_traced *traced, struct kiln_path_sums *sums,
                        struct kiln_splat_film *film, uint64_t *rays, struct kiln_error *error)
{
    const struct kiln_path_parameters *c = &traced->view->parameters;
    const uint32_t wanted = traced->view->samples;
    int decisions[DECISIONS] = {0}, status = KILN_OK;
    while (sums->samples < wanted && status == KILN_OK && decisions[SIGNAL] == 0 && decisions[OVER] == 0) {
        const uint32_t whole = whole_round(sums->samples), left = wanted - sums->samples;
        if (left < whole && r->checkpoint != NULL && r->kept < sums->samples)
            status = save(r, c, sums, film, error); /* what comes now is no whole round */
        if (status == KILN_OK)
            status = trace_round(r, traced, left < whole ? left : whole, sums, film, rays, error);
        if (status != KILN_OK)
            break;
        decide(r, sums->samples, whole_round(sums->samples), decisions);
        const bool ends = sums->samples == wanted || decisions[SIGNAL] != 0 || decisions[OVER] != 0;
        if (left >= whole && r->checkpoint != NULL && (ends || decisions[SAVE] != 0))
            status = save(r, c, sums, film, error);
    }
    r->signal = sums->samples < wanted ? decisions[SIGNAL] : 0;
    return status;
}

int kiln_view_rounds_trace(struct kiln_view_rounds *r, const struct kiln_view_traced *traced,
                           struct kiln_path_sums *sums, struct kiln_splat_film *film, uint64_t *rays,
                           struct kiln_error *error)
{
    kiln_process_catch();
    r->catches = true;
    int status = r->job->view.accumulate != NULL ? open_folder(r, traced, sums, film, error) : KILN_OK;
    r->begin = r->saved = MPI_Wtime();
    if (status == KILN_OK)
        status = trace_rounds(r, traced, sums, film, rays, error);
    r->samples = sums->samples;
    return status;
}
