/* A bake as a batch job of Slurm: the script, and handing it to sbatch.
 *
 * The script runs on the first node of the allocation, starts mpirun over all of them and waits. Slurm's warning before
 * the time limit comes to the script alone (--signal=B:USR1@SECONDS: without "B:" it would reach only the ranks of
 * remote nodes); the script passes it to mpirun, which passes it to every rank. A bake that stopped for it (exit 75)
 * and one whose rank or node was lost are put back into the queue, where the same script goes on from the last
 * checkpoint; a bake that failed for a reason that would be the same again is not. With `tries` the loss of a node is
 * first met within the allocation: the nodes that answer go on at once. The price is --no-kill, under which Slurm lets
 * an allocation lie idle until the time limit when its first node is lost, and the script with it. Nothing from outside
 * stands in a line that Slurm reads, and everything from outside that stands in a line that the shell reads is quoted.
 */
#ifndef KILN_COORDINATOR_BATCH_BATCH_H
#define KILN_COORDINATOR_BATCH_BATCH_H

#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

#include "worker/base/status.h"

/* One bake. Strings are borrowed. */
struct kiln_batch_item {
    const char *job;    /* job file or scene; absolute */
    const char *output; /* bake folder; absolute */
};

/* Strings are borrowed; NULL and 0 mean not given, if nothing else is said. */
struct kiln_batch {
    const char *program;                    /* kiln, or its launcher; absolute */
    const char *mpirun;                     /* needed */
    const char *folder;                     /* where the script runs; absolute */
    const char *setup;                      /* a shell script to read first; absolute */
    const char *backend;                    /* --backend of the bake */
    const char *time, *partition, *account; /* as Slurm writes them */
    uint32_t nodes, ranks_per_node;         /* both at least 1 */
    uint32_t gpus;                          /* a node */
    uint32_t threads;                       /* a rank; 0: whole nodes, all their cores */
    double memory;                          /* a node, GiB */
    uint32_t warning;                       /* seconds before the time limit */
    uint32_t tries;                         /* in one allocation, when nodes are lost; at least 1 */
    const struct kiln_batch_item *items;
    size_t item_count; /* more than one: a job array */
};

/* Writes the script. KILN_USAGE, before anything is written, when a value has characters that Slurm's names and times
 * have not; KILN_IO when the stream fails. */
int kiln_batch_write(FILE *stream, const struct kiln_batch *batch, struct kiln_error *error);

/* Writes `text` as one word of bash, whatever bytes (but NUL) it is made of, on one line. */
void kiln_batch_quote(FILE *stream, const char *text);

/* Gives the script to sbatch, found in PATH, on its standard input, without a shell between. *id becomes the job's
 * number, from malloc. KILN_SITE when there is no sbatch or it refuses; its own words have gone to stderr then. */
int kiln_batch_submit(const char *script, size_t length, char **id, struct kiln_error *error);

#endif
