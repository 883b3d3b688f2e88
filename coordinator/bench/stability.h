/* kiln bench stability: what must hold where numbers get extreme, as a table of rows. Each row makes a small scene,
 * bakes it, and compares with a closed form, or with another bake that must be the same. */
#ifndef KILN_COORDINATOR_BENCH_STABILITY_H
#define KILN_COORDINATOR_BENCH_STABILITY_H

#include "coordinator/bench/trial.h"

enum { KILN_ROW_TEXT = 160 };

/* What a row has found. */
struct kiln_row_found {
    bool holds;
    char measured[KILN_ROW_TEXT];
};

struct kiln_row {
    const char *group; /* the name by which rows are chosen */
    const char *tried, *expected;
    double x, tolerance; /* what is extreme; and the error, relative unless the row says otherwise */
    /* Makes the scene, bakes and compares. A bake that fails is a row that does not hold, not a failure. */
    int (*run)(struct kiln_trial *trial, const struct kiln_row *row, struct kiln_row_found *found);
    bool by_name_only; /* takes much time or memory: runs only where its group is named */
};

/* stability_rows.c */
extern const struct kiln_row kiln_rows[];
extern const size_t kiln_row_count;

/* Runs the rows whose groups are arguments 1, 2, ... of the job, or all but those that want to be named. Options of the
 * job that bake also has are passed on to the bakes. Prints the table to stdout, as JSON with job->json; progress to
 * stderr. KILN_MISMATCH if a row does not hold; KILN_USAGE for a group that there is none of. Call it before MPI is
 * started, from a process with one thread. */
int kiln_stability_bench(struct kiln_job *job, struct kiln_error *error);

#endif
