/* Path-traced views by several ranks. Rank 0 runs kiln view as it always does, with the renderer of the team in the
 * place of the lightmaps; the others compute their parts of each picture. A picture's pixels are divided among the
 * ranks in contiguous ranges, so its bits do not depend on their number. Private to coordinator/cli. */
#ifndef KILN_COORDINATOR_CLI_VIEW_TEAM_H
#define KILN_COORDINATOR_CLI_VIEW_TEAM_H

#include "coordinator/job/job.h"
#include "coordinator/view/path_view.h"

struct kiln_view_team;

/* Collective over MPI_COMM_WORLD. Each rank has opened the same scene, which must outlive the team, or passes the
 * status with which that failed; all ranks return the worst. Destroy with kiln_view_team_destroy. */
int kiln_view_team_create(struct kiln_view_team **team, const struct kiln_job *job, const struct kiln_scene *scene,
                          int opened, struct kiln_error *error);
/* Collective. */
void kiln_view_team_destroy(struct kiln_view_team **team);

/* Sets the source's geometry, lights, backend and renderer to the team's, which are good until it is destroyed. For
 * rank 0: each picture that the renderer draws is collective, and kiln_view_team_serve is what the other ranks call. */
void kiln_view_team_lend(struct kiln_view_team *team, struct kiln_view_source *source);

/* Collective: rank 0 calls `end` once it wants no more pictures, the others call `serve`, which returns then. A picture
 * that has failed has failed on all ranks with the same status, which rank 0 returns from its renderer. */
void kiln_view_team_end(struct kiln_view_team *team);
void kiln_view_team_serve(struct kiln_view_team *team);

/* KILN_STOPPED, with a sentence, if a signal has ended the picture before it had all its paths; else KILN_OK. */
int kiln_view_team_stopped(const struct kiln_view_team *team, struct kiln_error *error);

/* Work for all pictures so far, on rank 0: rays of all ranks, and seconds that they took once the kernels were made;
 * paths of a pixel of the last one; and its radius of merging in sample 0, m, 0 with methods that do not merge. */
struct kiln_view_work {
    uint64_t rays;
    uint32_t samples;
    double seconds, radius;
};
struct kiln_view_work kiln_view_team_work(const struct kiln_view_team *team);

#endif
