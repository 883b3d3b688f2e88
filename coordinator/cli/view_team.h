/* Path-traced views by several ranks. Rank 0 runs kiln view as usual, with the team's renderer instead of the
 * lightmaps; the other ranks compute their parts of each picture. A picture's pixels are divided among the ranks in
 * contiguous ranges, so its bits do not depend on the number of ranks. Private to coordinator/cli. */
#ifndef KILN_COORDINATOR_CLI_VIEW_TEAM_H
#define KILN_COORDINATOR_CLI_VIEW_TEAM_H

#include "coordinator/job/job.h"
#include "coordinator/view/path_view.h"

struct kiln_view_team;

/* Collective over MPI_COMM_WORLD. Each rank has opened the same scene, which must outlive the team, or passes in
 * `opened` the status of the failed opening; all ranks return the worst status. Destroy with kiln_view_team_destroy. */
int kiln_view_team_create(struct kiln_view_team **team, const struct kiln_job *job, const struct kiln_scene *scene,
                          int opened, struct kiln_error *error);
/* Collective. */
void kiln_view_team_destroy(struct kiln_view_team **team);

/* Sets the source's geometry, lights, backend and renderer to the team's, which are valid until the team is destroyed.
 * For rank 0. Each picture that the renderer draws is collective: the other ranks must be in kiln_view_team_serve. */
void kiln_view_team_lend(struct kiln_view_team *team, struct kiln_view_source *source);

/* Collective: rank 0 calls `end` once it wants no more pictures; the others call `serve`, which returns then. If a
 * picture fails, it fails on all ranks with the same status, which the renderer returns on rank 0. */
void kiln_view_team_end(struct kiln_view_team *team);
void kiln_view_team_serve(struct kiln_view_team *team);

/* KILN_STOPPED, with a sentence, if a signal has ended the picture before it had all its paths; else KILN_OK. */
int kiln_view_team_stopped(const struct kiln_view_team *team, struct kiln_error *error);

/* Work on rank 0 for all pictures so far: rays of all ranks, and the seconds that they took after the kernels were
 * made; for the last picture, paths of a pixel and the merge radius in sample 0, m (0 with methods that do not merge).
 */
struct kiln_view_work {
    uint64_t rays;
    uint32_t samples;
    double seconds, radius;
};
struct kiln_view_work kiln_view_team_work(const struct kiln_view_team *team);

#endif
