/* The status file of a bake, DIR/checkpoint/status.json, which shows its progress to anybody who can read the folder;
 * and the stop file, DIR/checkpoint/stop, whose existence asks the bake to end.
 *
 * Rank 0 of a bake writes the status file once a second under another name and renames it, so that a reader always sees
 * a complete file. It is removed with the checkpoint when the bake succeeds (run.json is there then), and when a bake
 * fails before it has a checkpoint. */
#ifndef KILN_COORDINATOR_RUN_STATUS_FILE_H
#define KILN_COORDINATOR_RUN_STATUS_FILE_H

#include <stdbool.h>
#include <stdint.h>

#include "worker/base/status.h"

struct kiln_bake_status {
    char state[16]; /* "running", "stopped", "failed" */
    char phase[64];
    double phase_share; /* fraction of the phase that is done, 0 to 1; -1: unknown */
    double share;       /* fraction of the bake, 0 to 1; -1: unknown */
    double left;        /* time left of the bake, s; -1: unknown */
    double seconds;     /* since this run of the bake began */
    int32_t ranks;
    char host[64];       /* host of rank 0 */
    int64_t process;     /* process number of rank 0 */
    uint64_t started;    /* start of that process in kernel ticks; differs for a later process of this number */
    double updated;      /* when this was written, s since 1970 */
    uint64_t beat;       /* how often the file has been written */
    uint64_t generation; /* the last checkpoint; 0: none */
    double saved;        /* time at which that checkpoint was written, s since 1970 */
    int32_t code;        /* exit status, when not running */
    char message[512];   /* the message, when not running */
};

/* The functions below are not collective. */

/* Fills in host, process, started and updated for this process. */
void kiln_bake_status_sign(struct kiln_bake_status *status);
/* Writes the file. The folder DIR/checkpoint must exist. Failures are ignored. */
void kiln_bake_status_write(const char *directory, const struct kiln_bake_status *status);
/* KILN_NO_INPUT if there is no such file; KILN_BAD_INPUT if kiln has not written it. */
int kiln_bake_status_read(const char *directory, struct kiln_bake_status *status, struct kiln_error *error);
void kiln_bake_status_remove(const char *directory);

/* Tells whether the process that wrote the file is alive. On the same host its process number decides. On another host
 * the file is watched for changes for up to three seconds; if it is older than 15 s, the process counts as dead. */
bool kiln_bake_status_alive(const char *directory, const struct kiln_bake_status *status);

/* Start time of a process of this host, in kernel ticks; 0: it does not exist or is dead. */
uint64_t kiln_process_started(int64_t process);

/* Creates, looks for, and removes the stop file. */
int kiln_stop_request(const char *directory, struct kiln_error *error);
bool kiln_stop_requested(const char *directory);
void kiln_stop_forget(const char *directory);

#endif
