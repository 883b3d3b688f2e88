/* Path-traced views in rounds of a few paths a pixel. Between rounds a view can stop: after a time, or by a signal. Its
 * sums are kept in a folder, as a checkpoint (coordinator/run/checkpoint.h), and a later call continues from them.
 * Private to coordinator/cli.
 *
 * Rounds have 1, 1, 2 and 4 paths a pixel, then 8 each; the last one has the remaining paths. Only whole rounds are
 * kept. So N paths at once, and n paths followed later by N - n, have the same bits, on any numbers of ranks; at most 7
 * paths a pixel are traced a second time. Views without rounds add up longer stretches, and differ by the rounding of
 * floats. */
#ifndef KILN_COORDINATOR_CLI_VIEW_ROUNDS_H
#define KILN_COORDINATOR_CLI_VIEW_ROUNDS_H

#include <jansson.h>

#include "coordinator/job/job.h"
#include "coordinator/view/path_view.h"

struct kiln_view_rounds;

/* Collective over MPI_COMM_WORLD. The job must outlive the rounds. *rounds is NULL if the job has neither --accumulate
 * nor --max-time, and so needs no rounds. Opens nothing yet. Destroy with kiln_view_rounds_destroy, collectively. */
int kiln_view_rounds_create(struct kiln_view_rounds **rounds, const struct kiln_job *job, struct kiln_error *error);
void kiln_view_rounds_destroy(struct kiln_view_rounds **rounds);

/* A view to trace, the same on all ranks except for the range. */
struct kiln_view_traced {
    struct kiln_backend *backend;
    const struct kiln_scene *scene;
    const char *instruction_set;
    const struct kiln_path_view *view;
    struct kiln_path_progress progress; /* `tell` gets the fraction done of the paths of this call */
};

/* Collective. Reads the folder's sums of this view, and adds paths until each pixel has view->samples, the time is over
 * or a signal has arrived; in the last two cases it adds at least one. `sums` are those of this rank's range; the
 * ranges follow one another; `film` is NULL or covers the whole picture. KILN_BAD_INPUT if the folder is damaged or has
 * another view, with a table of the differences; the statuses of the backend and of checkpoints. */
int kiln_view_rounds_trace(struct kiln_view_rounds *rounds, const struct kiln_view_traced *traced,
                           struct kiln_path_sums *sums, struct kiln_splat_film *film, uint64_t *rays,
                           struct kiln_error *error);

/* KILN_STOPPED, with a sentence, if a signal has ended the rounds early; else KILN_OK. */
int kiln_view_rounds_stopped(const struct kiln_view_rounds *rounds, struct kiln_error *error);

/* Collective. Adds up the ranks' films on rank 0, and sets the films of the other ranks to 0. */
void kiln_view_add_films(struct kiln_splat_film *film, size_t pixels);

#endif
