/* Slurm batch jobs: writes the script of a bake and hands it to sbatch.
 *
 * The script runs on the first node of the allocation, starts mpirun over all nodes and waits. Slurm's warning before
 * the time limit goes to the script alone (--signal=B:USR1@SECONDS; without "B:" it would reach only the ranks of
 * remote nodes). The script passes it to mpirun, which passes it to every rank. A bake is requeued if the warning
 * stopped it (exit 75), or if a rank or node was lost; the same script then continues from the last checkpoint. A bake
 * that failed for a reason that would occur again is not requeued.
 *
 * With `tries` above 1, the loss of a node is first handled within the allocation: the bake continues at once on the
 * nodes that answer. The price is --no-kill: if the allocation's first node is lost, the script is lost with it, and
 * Slurm lets the allocation idle until the time limit.
 *
 * User text never appears in a line that Slurm reads. In lines that the shell reads, user text is quoted. */
#ifndef KILN_COORDINATOR_BATCH_BATCH_H
#define KILN_COORDINATOR_BATCH_BATCH_H

#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

#include "worker/base/status.h"

/* One bake of a batch. Strings are borrowed. */
struct kiln_batch_item {
    const char *job;    /* job file or scene; absolute */
    const char *output; /* bake folder; absolute */
};

/* The batch job. Strings are borrowed; NULL and 0 mean "not given", unless a field says otherwise. */
struct kiln_batch_job {
    const char *program;                    /* absolute path of kiln or its launcher */
    const char *mpirun;                     /* required */
    const char *folder;                     /* absolute path of the folder that the script runs in */
    const char *setup;                      /* absolute path of a shell script to source first */
    const char *backend;                    /* --backend of the bake */
    const char *time, *partition, *account; /* in Slurm's notation */
    uint32_t nodes, ranks_per_node;         /* both at least 1 */
    uint32_t gpus;                          /* per node */
    uint32_t threads;                       /* per rank; 0: whole nodes, with all their cores */
    double memory;                          /* per node, GiB */
    uint32_t warning;                       /* seconds before the time limit */
    /* how often the bake may start in one allocation when nodes are lost; at least 1 */
    uint32_t tries;
    const struct kiln_batch_item *items;
    size_t item_count; /* more than one: a job array */
};

/* Writes the script. KILN_USAGE, before anything is written, when a value has characters that Slurm's names and times
 * cannot have; KILN_IO when the stream fails. */
int kiln_batch_write(FILE *stream, const struct kiln_batch_job *batch, struct kiln_error *error);

/* Writes `text`, which may hold any bytes but NUL, as one word of bash on one line. */
void kiln_batch_quote(FILE *stream, const char *text);

/* Passes the script to sbatch (found in PATH) on its standard input, without a shell. *id becomes the job's number,
 * from malloc. KILN_SITE when there is no sbatch or it refuses the job; sbatch has then printed its reason to
 * stderr. */
int kiln_batch_submit(const char *script, size_t length, char **id, struct kiln_error *error);

#endif
