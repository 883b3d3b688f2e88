#include "coordinator/bake/bake.h"

#include "coordinator/bake/bake_private.h"
#include "coordinator/bake/reckon/kernels_kept.h"
#include "coordinator/mpi/agree.h"
#include "coordinator/run/checkpoint_local.h"
#include "coordinator/run/process.h"
#include "worker/base/memory.h"

enum { COPY_SECONDS = 3600 }; /* a rank that copies a checkpoint longer is taken for stuck */

/* Adds the time spent on checkpoints to the phases. */
static void note_checkpoints(struct kiln_bake *b)
{
    uint64_t count, bytes;
    double seconds;
    kiln_checkpoint_spent(b->checkpoint, &count, &seconds, &bytes);
    if (count > 0) /* the same on all ranks */
        kiln_phase_add(&b->phases, "checkpoints", seconds);
}

/* Notes that all kernels of a bake of this kind are kept now. */
static void mark_kernels(const struct kiln_bake *b)
{
    struct kiln_backend_info info;
    kiln_backend_info(b->prepared->backend, &info);
    if (b->rank == 0 && info.on_device && !info.fell_back)
        kiln_kernels_mark(b->job, &b->light_settings, b->prepared->scene);
}

static int run_phases(struct kiln_bake *b, struct kiln_error *error)
{
    int status;
    KILN_TRY(kiln_bake_prepare(b, error));
    if (b->job->relighting.states != NULL || b->job->relighting.listen)
        return kiln_bake_states(b, error);
    KILN_TRY(kiln_bake_expect(b, error));
    KILN_TRY(kiln_bake_light(b, error));
    KILN_TRY(kiln_bake_volume(b, error));
    b->light_done = true;
    KILN_TRY(kiln_bake_check_density(b, error));
    note_checkpoints(b);
    KILN_TRY(kiln_bake_transport_write(b, error));
    KILN_TRY(kiln_bake_clear_folder(b, error));
    KILN_TRY(kiln_bake_write(b, error));
    mark_kernels(b);
end:
    return status;
}

/* Collective, after KILN_STOPPED. Saves the results so far and composes the message. A bake that was stopped within a
 * pass or the probe pass has saved already. Otherwise either nothing has been computed yet, or only files are
 * missing. */
static int save_early(struct kiln_bake *b, struct kiln_error *error)
{
    kiln_phase(&b->phases, NULL);
    if (!b->light_done && b->saves)
        return KILN_STOPPED;
    kiln_control_why(b->control);
    if (!b->light_done)
        return b->job->relighting.listen || b->job->relighting.states != NULL
                   ? kiln_stopped_between(b->control, error)
                   : kiln_stopped_early(
                         b->control, b->job->checkpoints.resume ? kiln_checkpoint_generation(b->checkpoint) : 0, error);
    return kiln_bake_save(b, error);
}

/* Collective. Does as save_early, and then copies the nodes' checkpoints to the bake's folder. */
static int end_early(struct kiln_bake *b, struct kiln_error *error)
{
    const int status = save_early(b, error);
    kiln_control_blocking(b->control, "copying a checkpoint", COPY_SECONDS);
    kiln_checkpoint_settle(b->checkpoint);
    kiln_control_blocking(b->control, NULL, 0.0);
    return status;
}

/* Drops the timeline, which cannot be written, or is not to be: another bake may be at work in the folder. */
static void drop_trace(struct kiln_bake *b)
{
    kiln_trace_destroy(&b->trace);
    b->phases.trace = NULL;
}

static int run(struct kiln_bake *b, struct kiln_error *error)
{
    int status = kiln_bake_take_charge(b, error);
    if (status == KILN_OK)
        status = kiln_bake_check_folder(b, error);
    if (status == KILN_OK)
        status = run_phases(b, error);
    else
        drop_trace(b);
    return status == KILN_STOPPED ? end_early(b, error) : status;
}

/* Collective. Writes the timeline, also after a bake that failed. In that case the failure of the bake is the error
 * reported. */
static int write_trace(struct kiln_bake *b, int status, struct kiln_error *error)
{
    if (b->trace == NULL)
        return status;
    struct kiln_error own;
    const int written = kiln_trace_write(b->trace, b->job->ranks.trace, &own);
    kiln_trace_destroy(&b->trace);
    b->phases.trace = NULL;
    if (status == KILN_OK && written != KILN_OK)
        *error = own;
    return status == KILN_OK ? written : status;
}

/* Collective. Starts monitoring of the bake: progress, phases, watchdog and timeline. */
static int begin(struct kiln_bake *b, struct kiln_error *error)
{
    const struct kiln_job *job = b->job;
    (void)MPI_Comm_rank(b->communicator, &b->rank);
    b->begin = MPI_Wtime();
    b->progress =
        b->rank == 0 && job->quiet ? kiln_progress_create_silent() : kiln_progress_create(job->quiet, b->rank);
    kiln_phase(&b->phases, NULL);
    int status = kiln_watchdog_create(&b->watchdog, b->communicator, job->checkpoints.watchdog,
                                      kiln_faults_halt(&job->faults, (uint32_t)b->rank), error);
    if (status == KILN_OK && job->ranks.trace != NULL)
        status = kiln_trace_create(&b->trace, b->communicator, error);
    b->phases.watchdog = b->watchdog;
    b->phases.trace = b->trace;
    return status;
}

int kiln_bake_run(struct kiln_bake **bake, MPI_Comm communicator, const struct kiln_job *job, struct kiln_error *error)
{
    struct kiln_bake *b = NULL;
    int status = kiln_agree(communicator, kiln_allocate(&b, 1, sizeof *b, "the bake", error), error);
    if (status != KILN_OK)
        kiln_free(&b);
    *bake = b;
    if (b == NULL)
        return status;
    b->job = b->asked = job;
    b->communicator = communicator;
    status = begin(b, error);
    if (status == KILN_OK)
        status = run(b, error);
    return write_trace(b, status, error);
}

json_t *kiln_bake_report(const struct kiln_bake *bake) { return bake->report; }

const char *kiln_bake_preview(const struct kiln_bake *bake)
{
    return bake->preview_text[0] != '\0' ? bake->preview_text : NULL;
}

/* Writes the final status, which is kept as long as there is a checkpoint to continue from. */
static void conclude(struct kiln_bake *b, int status, const struct kiln_error *error)
{
    uint64_t generation;
    const bool there = kiln_checkpoint_newest(b->job->output, &generation);
    if (b->rank == 0)
        kiln_bake_settle_scene(b, status != KILN_OK && status != KILN_STOPPED && !there);
    kiln_control_conclude(b->control, status, status == KILN_OK ? "" : error->message, status == KILN_OK || !there);
}

void kiln_bake_end(struct kiln_bake **bake, int status, const struct kiln_error *error)
{
    struct kiln_bake *b = *bake;
    if (b == NULL)
        return;
    if (b->checkpoint != NULL && status == KILN_OK)
        kiln_checkpoint_remove(b->checkpoint); /* run.json is complete, so the checkpoint is no longer needed */
    if (b->control != NULL)
        conclude(b, status, error);
    kiln_process_release();
    kiln_progress_observe(b->progress, NULL, NULL);
    kiln_control_destroy(&b->control);
    kiln_checkpoint_close(&b->checkpoint);
    json_decref(b->identity);
    json_decref(b->report);
    json_decref(b->preview);
    kiln_progress_destroy(&b->progress);
    kiln_free(&b->lightmaps);
    kiln_vertex_light_release(&b->vertices);
    kiln_density_check_release(&b->density);
    kiln_volume_destroy(&b->volume);
    kiln_bake_transport_release(b);
    kiln_bake_groups_release(b);
    kiln_points_ahead_destroy(&b->ahead); /* reads what the solution has */
    kiln_solution_destroy(&b->solution);
    kiln_visible_from_release(&b->visible);
    kiln_prepared_destroy(&b->prepared);
    kiln_watchdog_destroy(&b->watchdog); /* last, so that the watchdog also watches the collective calls above */
    kiln_free(bake);
}
