/* The commands of kiln. Each takes the parsed job, writes results to stdout and progress to stderr, and returns an exit
 * status, with a message in `error` unless it is 0. kiln_main prints that message once, on rank 0. Commands marked
 * (MPI) run between MPI_Init and MPI_Finalize and are collective. The others never start MPI and run in one process. */
#ifndef KILN_COORDINATOR_CLI_COMMANDS_H
#define KILN_COORDINATOR_CLI_COMMANDS_H

#include "coordinator/job/job.h"

int kiln_main(int argc, char **argv);

int kiln_command_bake(struct kiln_job *job, struct kiln_error *error);    /* (MPI) */
int kiln_command_relight(struct kiln_job *job, struct kiln_error *error); /* (MPI) */
int kiln_command_plan(struct kiln_job *job, struct kiln_error *error);    /* (MPI) */
int kiln_command_mix(struct kiln_job *job, struct kiln_error *error);
int kiln_command_import(struct kiln_job *job, struct kiln_error *error);
int kiln_command_info(struct kiln_job *job, struct kiln_error *error);
int kiln_command_check(struct kiln_job *job, struct kiln_error *error);
int kiln_command_view(struct kiln_job *job, struct kiln_error *error); /* (MPI) with --method path */
int kiln_command_compare(struct kiln_job *job, struct kiln_error *error);
int kiln_command_probe(struct kiln_job *job, struct kiln_error *error);
int kiln_command_generate(struct kiln_job *job, struct kiln_error *error);
int kiln_command_report(struct kiln_job *job, struct kiln_error *error);
int kiln_command_bench(struct kiln_job *job, struct kiln_error *error); /* (MPI) */
int kiln_command_submit(struct kiln_job *job, struct kiln_error *error);
int kiln_command_verify(struct kiln_job *job, struct kiln_error *error);
int kiln_command_export(struct kiln_job *job, struct kiln_error *error);

int kiln_command_status(struct kiln_job *job, struct kiln_error *error);
int kiln_command_stop(struct kiln_job *job, struct kiln_error *error);

#endif
